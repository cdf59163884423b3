"""``-`` for standard input and output, and how much a command says.

A command that is given ``-`` sees temporary files: what is piped in, and what it writes, which goes
to standard output when it has succeeded. What it prints is on standard error then, and ``-`` stands
in every message for the temporary name.
"""

import argparse
import contextlib
import os
import pathlib
import shutil
import sys
import tempfile
from collections.abc import Iterator
from typing import Any, TextIO, cast

from .inputs import NAMES, typed
from .standard_input import spooled

DEFAULTS = {"render": "exr", "reference": "exr", "environment": "exr", "fit": "toml"}
"""The format of ``-o -`` for the commands that write files, without ``--output-format``."""

TEXT = ("toml", "json")
PRINTED = ("pattern", "stability")
"""Commands that print what they would write, so that ``-o -`` is no ``-o``."""

MAGIC = {
    b"\x76\x2f\x31\x01": ".exr",
    b"#?": ".hdr",
    b"\x89PNG": ".png",
    b"\xff\xd8\xff": ".jpg",
    b"II*\0": ".tif",
    b"MM\0*": ".tif",
    b"PF": ".pfm",
    b"PK": ".npz",
    b"tensor_file": ".bsdf",
    b"<": ".xml",
    b"{": ".json",
}


class Told:
    """A text stream with names replaced; ``quiet``: not a terminal, so without progress."""

    def __init__(self, stream: TextIO, names: dict[str, str], quiet: bool = False) -> None:
        self._stream, self._names, self._quiet = stream, names, quiet

    def write(self, text: str) -> int:
        """Write with every temporary name as ``-``."""
        return self._stream.write(_renamed(text, self._names))

    def isatty(self) -> bool:
        """Whether progress may be drawn."""
        return not self._quiet and self._stream.isatty()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _renamed(text: str, names: dict[str, str]) -> str:
    for old, new in names.items():
        text = text.replace(old, new)
    return text


@contextlib.contextmanager
def redirected(args: argparse.Namespace, quiet: bool) -> Iterator[None]:
    """Standard streams and arguments for one command; ``-`` among them is a temporary file.

    Raises
    ------
    ValueError
        For a second ``-`` to read, or one where a folder is written or a terminal would show bytes.
    """
    names: dict[str, str] = {}
    stdout, stderr = sys.stdout, sys.stderr
    with contextlib.ExitStack() as stack:
        written = None
        if args.command != "compare":
            _read(args, names, stack)
            written = _written(args, names, stack)
        out = stderr if written else stdout
        if quiet and not getattr(args, "json", False) and _has_product(args):
            out = stack.enter_context(open(os.devnull, "w", encoding="utf-8"))
        told = cast(TextIO, Told(out, names)) if names else out
        errors = cast(TextIO, Told(stderr, names, quiet))
        with contextlib.redirect_stdout(told), contextlib.redirect_stderr(errors):
            try:
                yield
            except (ValueError, OSError) as error:
                if not any(old in str(error) for old in names):
                    raise
                kind = OSError if isinstance(error, OSError) else ValueError
                raise kind(_renamed(str(error), names)) from error
        if written and os.path.exists(written):
            stdout.flush()
            with open(written, "rb") as file:
                shutil.copyfileobj(file, stdout.buffer)
            stdout.buffer.flush()


def _has_product(args: argparse.Namespace) -> bool:
    """Whether what is printed is not all there is: a file, or an exit code that judges."""
    return args.command == "compare" or getattr(args, "output", None) is not None


def _read(args: argparse.Namespace, names: dict[str, str], stack: contextlib.ExitStack) -> None:
    piped = [name for name in NAMES if typed(args, name) == "-"]
    if piped and args.command == "study":
        raise ValueError(f"{piped[0]}: a study reads its files again when it is resumed, so not -")
    if len(piped) > 1:
        raise ValueError(f"{', '.join(piped)}: standard input can be read once")
    for name in piped:
        spool = stack.enter_context(spooled(name))
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="glossy-"))
        path = pathlib.Path(folder, f"input{_suffix(spool, name)}")
        os.link(spool, path)
        names[str(path)] = "-"
        whole = getattr(args, name)
        setattr(args, name, [str(path)] if isinstance(whole, list) else whole[:-1] + str(path))
        if name == "scene":
            args.scene_folder = "."
    if piped:
        args.stands_for = dict(names)


def _suffix(path: str, name: str) -> str:
    with open(path, "rb") as file:
        start = file.read(16).removeprefix(b"\xef\xbb\xbf").lstrip()
    if name != "scene":
        for magic, suffix in MAGIC.items():
            if start.startswith(magic):
                return suffix
    return ".txt" if name == "table" else ".toml"


def _written(
    args: argparse.Namespace, names: dict[str, str], stack: contextlib.ExitStack
) -> str | None:
    """Name of the temporary file that goes to standard output; None if nothing does."""
    form = getattr(args, "output_format", None)
    if getattr(args, "output", None) != "-":
        if form is not None:
            raise ValueError("--output-format: is for -o -; a file has its suffix")
        return None
    if args.command in PRINTED:
        args.output = None
        return None
    if args.command not in DEFAULTS or getattr(args, "layout", None) == "faces":
        raise ValueError("--output: - is one file, and several are written")
    if not hasattr(sys.stdout, "buffer"):
        raise ValueError("--output: - is standard output, which is closed or takes no bytes")
    form = form or DEFAULTS[args.command]
    if form not in TEXT and sys.stdout.isatty():
        raise ValueError("--output: - is a terminal, which shows no pictures")
    folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="glossy-"))
    path = os.path.join(folder, f"output.{form}")
    names[path] = "-"
    args.output = path
    return path
