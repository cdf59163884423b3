"""The ``glossy`` command: parser, dispatch, one-line errors.

Each command is a module of ``glossy.commands`` with ``add_parser(subparsers)`` and ``run(args)``,
which returns the exit code. Those modules import what they compute with inside ``run``, so that
``--help`` and ``compare`` start without a compiler.
"""

import argparse
import contextlib
import importlib
import io
import json
import os
import re
import sys
import textwrap
import traceback
import warnings
from collections.abc import Sequence
from typing import NoReturn

from . import _memory
from ._version import __version__
from .commands import streams, talk
from .commands.provenance import COMMAND_LINE

COMMANDS = (
    "render",
    "reference",
    "compare",
    "study",
    "trace",
    "pattern",
    "plan",
    "environment",
    "fit",
    "material",
    "stability",
)
BAD_INPUT = 2
INTERRUPTED = 130
CLOSED_PIPE = 141  # 128 + SIGPIPE, as shells report a reader that went away
LONGEST = 1000  # characters of a message
NEGATIVE = re.compile(r"-\.?\d")


class _Parser(argparse.ArgumentParser):
    """Says what is wrong on one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"{self.prog}: {_line(message)}; see {self.prog} --help\n")


class _Version(argparse.Action):
    """``--version``, as JSON if ``--json`` stands anywhere."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        as_json = "--json" in COMMAND_LINE.get()
        made = {"schema": 1, "command": "version", "version": __version__}
        print(json.dumps(made) if as_json else f"glossy {__version__}")
        parser.exit()


def build_parser() -> argparse.ArgumentParser:
    """The parser with every command of ``COMMANDS``."""
    parser = _Parser(
        prog="glossy",
        description="Real-time glossy rendering from environment maps, emulated on the CPU, "
        "with the ground truth beside it.",
        epilog="glossy help COMMAND, or glossy COMMAND --help, says what a command takes.",
    )
    parser.add_argument(
        "--version", action=_Version, nargs=0, help="print the version (with --json as JSON)"
    )
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND")
    for name in COMMANDS:
        importlib.import_module(f"{__package__}.commands.{name}").add_parser(subparsers)
        subparsers.choices[name].add_argument(
            "--max-memory",
            metavar="SIZE",
            help="most that reading one input may take, as 4G (default half of the machine's)",
        )
    for each in (parser, *subparsers.choices.values()):
        each.description = textwrap.fill(each.description or "", 80)
        for name, text in talk.HELP.items():  # taken out before, since they may stand anywhere
            each.add_argument(
                name[1:3], name, action="store_true", default=argparse.SUPPRESS, help=text
            )
    return parser


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"glossy: warning: {_line(message)}", file=sys.stderr)


def _line(message: object) -> str:
    """A message as one printable line."""
    from ._check import shortened  # with NumPy, which --help does without

    text = shortened(str(message), LONGEST)
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def _joined(words: Sequence[str]) -> list[str]:
    """``--name -1,3`` as ``--name=-1,3``, since argparse takes such a value for an option."""
    found: list[str] = []
    for word in words:
        if NEGATIVE.match(word) and found and re.fullmatch(r"--\w[\w-]*", found[-1]):
            found[-1] += f"={word}"
        else:
            found.append(word)
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; bad input is one line on stderr and exit code 2.

    Output that nobody reads any more (``| head``) ends it quietly with ``CLOSED_PIPE``.
    """
    sys.stdout, sys.stderr = sys.stdout or io.StringIO(), sys.stderr or io.StringIO()  # closed
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a name that is no UTF-8 must not end a report
            stream.reconfigure(errors="backslashreplace")
    try:
        try:
            return _main(sys.argv[1:] if argv is None else argv)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        for stream in (sys.stdout, sys.stderr):  # nothing is left to flush
            with contextlib.suppress(OSError, ValueError, AttributeError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return CLOSED_PIPE
    except OSError as error:  # a full disk behind standard output
        print(f"glossy: standard output: {_line(error.strerror or error)}", file=sys.stderr)
        with contextlib.suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BAD_INPUT


def _main(words: Sequence[str]) -> int:
    COMMAND_LINE.set(tuple(words))
    words, level = talk.split_words(_joined(words))
    if words[:1] == ["help"]:
        words = [*words[1:2], "--help"]
    parser = build_parser()
    args = parser.parse_args(words)
    if args.command is None:
        parser.print_help()
        return 0
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        if level == talk.QUIET:
            warnings.simplefilter("ignore")
        try:
            with (
                streams.redirected(args, level == talk.QUIET),
                talk.telling(args.command, level),
                _memory.limited(getattr(args, "max_memory", None)),
            ):
                return int(args.run(args))
        except BrokenPipeError:
            raise
        except (ValueError, OSError, OverflowError, RecursionError, MemoryError) as error:
            if level == talk.VERBOSE:
                traceback.print_exc()
            text = _line(error) or type(error).__name__
            print(f"glossy {args.command}: {text}", file=sys.stderr)
            return BAD_INPUT
        except KeyboardInterrupt:
            print(f"glossy {args.command}: interrupted", file=sys.stderr)
            return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
