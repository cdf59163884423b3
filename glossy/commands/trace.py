"""``glossy trace``: every tap of one pixel, to find the wrong line of a shader."""

import argparse
import json

from . import options
from .provenance import provenance

EXAMPLE = """\
examples:
  glossy trace --pixel 128,90 --samples 14 --threshold 0.2
  glossy trace scene.toml --pixel 40,52 --precision double --json
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the ``glossy`` parser."""
    parser = subparsers.add_parser(
        "trace",
        help="list every tap of one pixel",
        description="Print what a real-time method does for one pixel of a sphere, a plane or a "
        "G-buffer: its frame, then for each tap half vector, light direction, footprint, level, "
        "radiance, BRDF, density and weight. Takes what render takes for one shape, and the "
        "methods that have taps to list: regular, importance, thesis, lattice, and auto, which "
        "lists those it chose. The diffuse part is left out.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    options.add_scene_arguments(parser)
    options.add_method_arguments(parser)
    parser.add_argument(
        "--pixel",
        required=True,
        metavar="X,Y",
        help="column and row, from 0,0 at the top left",
    )
    options.add_json_argument(parser)
    parser.set_defaults(run=run)


def parse_pixel(text: str) -> tuple[int, int]:
    """Column and row from "X,Y"."""
    try:
        x, y = (int(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"--pixel: must be X,Y with whole numbers, got {text!r}") from None
    return x, y


def run(args: argparse.Namespace) -> int:
    """Trace one pixel and print it."""
    from ..render import trace_pixel

    pixel = parse_pixel(args.pixel)
    traced = trace_pixel(options.scene_from(args), *pixel)
    if args.json:
        found = {"command": "trace", **traced.to_dict(), "provenance": provenance(args)}
        print(json.dumps({"schema": 1, **found}, indent=2))
    else:
        print(traced.format())
    return 0
