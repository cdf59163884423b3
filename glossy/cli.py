"""The ``glossy`` command: parser, dispatch, one-line errors.

Each command is a module of ``glossy.commands`` with ``add_parser(subparsers)`` and ``run(args)``,
which returns the exit code. Those modules import what they compute with inside ``run``, so that
``--help`` and ``compare`` start without a compiler.
"""

import argparse
import importlib
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


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; bad input is one line on stderr and exit code 2."""
    args = build_parser().parse_args(argv)
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            return int(args.run(args))
        except (ValueError, OSError) as error:
            text = " ".join(str(error).split())
            print(f"glossy {args.command}: {text}", file=sys.stderr)
            return BAD_INPUT
        except KeyboardInterrupt:
            print(f"glossy {args.command}: interrupted", file=sys.stderr)
            return 130


if __name__ == "__main__":
    sys.exit(main())
