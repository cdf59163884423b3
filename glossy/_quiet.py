"""Catching what the image libraries print while they read or write.

The C libraries explain a damaged file on the process's standard error, and OpenEXR's binding
prints a warning on standard output; both would break a command's one-line errors and its JSON.
Other threads that print meanwhile lose nothing: their lines are passed on afterwards.
"""

import contextlib
import io
import os
import re
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from typing import IO, TextIO

_lock = threading.Lock()
_users = 0
_file: IO[bytes] | None = None
_saved = -1
_stdout: TextIO = sys.stdout
_text = io.StringIO()

_OURS = re.compile(
    r"\(EXR_ERR_\w+\)|^libpng (error|warning): |^ojph (info|warning|error) "
    r"|^Warning: Exception raised reading pixel data"
)


def _begin() -> None:
    global _users, _file, _saved, _stdout, _text
    with _lock:
        _users += 1
        if _users > 1:
            return
        _text, _stdout = io.StringIO(), sys.stdout
        sys.stdout = _text
        with contextlib.suppress(OSError):  # no standard error, or no place for the file
            _file = tempfile.TemporaryFile()  # noqa: SIM115 (closed in _end)
            _saved = os.dup(2)
            os.dup2(_file.fileno(), 2)


def _end() -> None:
    global _users, _file, _saved
    with _lock:
        _users -= 1
        if _users:
            return
        sys.stdout = _stdout
        text = _said()
        if _saved >= 0:
            os.dup2(_saved, 2)
            with contextlib.suppress(OSError):
                os.close(_saved)
        if _file is not None:
            _file.close()
        _file, _saved = None, -1
        for line in text.splitlines(keepends=True):
            if not _OURS.search(line):
                os.write(2, line.encode(errors="replace"))
        for line in _text.getvalue().splitlines(keepends=True):
            if not _OURS.search(line):
                sys.stdout.write(line)


def _said() -> str:
    if _file is None:
        return ""
    try:
        size = os.fstat(_file.fileno()).st_size
        return os.pread(_file.fileno(), size, 0).decode(errors="replace")
    except OSError:
        return ""


def _reason(name: str) -> str:
    lines = [m for m in _said().splitlines() if m.startswith(f"{name}: ")]
    return _OURS.sub("", lines[0][len(name) + 2 :]).strip() if lines else ""


@contextlib.contextmanager
def c_messages() -> Iterator[Callable[[str], str]]:
    """Catch the library's messages; gives a function from a file's name to its first one."""
    _begin()
    try:
        yield _reason
    finally:
        _end()
