"""The ``glossy`` command: parser, dispatch, one-line errors.

Each command is a module of ``glossy.commands`` with ``add_parser(subparsers)`` and ``run(args)``,
which returns the exit code. Those modules import what they compute with inside ``run``, so that
``--help`` and ``compare`` start without a compiler.
"""

import argparse
import importlib
import os
import re
import sys
import warnings
from collections.abc import Sequence

from ._version import __version__

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
NEGATIVE = re.compile(r"-\.?\d")


def build_parser() -> argparse.ArgumentParser:
    """The parser with every command of ``COMMANDS``."""
    parser = argparse.ArgumentParser(
        prog="glossy",
        description="Real-time glossy rendering from environment maps, emulated on the CPU, "
        "with the ground truth beside it.",
    )
    parser.add_argument("--version", action="version", version=f"glossy {__version__}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in COMMANDS:
        importlib.import_module(f"{__package__}.commands.{name}").add_parser(subparsers)
    return parser


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"glossy: warning: {message}", file=sys.stderr)


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
    try:
        try:
            return _main(_joined(sys.argv[1:] if argv is None else argv))
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nothing left to flush
        return CLOSED_PIPE


def _main(argv: Sequence[str]) -> int:
    args = build_parser().parse_args(argv)
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            return int(args.run(args))
        except BrokenPipeError:
            raise
        except (ValueError, OSError) as error:
            text = " ".join(str(error).split())
            print(f"glossy {args.command}: {text}", file=sys.stderr)
            return BAD_INPUT
        except KeyboardInterrupt:
            print(f"glossy {args.command}: interrupted", file=sys.stderr)
            return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
