"""Arguments that say how a G-buffer is to be read; docs/gbuffer.md."""

import argparse
from collections.abc import Mapping
from typing import Any

NAMED = ("normal", "view", "tangent", "mask")


def add_gbuffer_arguments(parser: argparse.ArgumentParser) -> None:
    """--gbuffer, what its channels are called and how its vectors are stored."""
    group = parser.add_argument_group("G-buffer (instead of a shape)")
    group.add_argument("--gbuffer", metavar="F", help="surface points from a file (EXR, npz)")
    for name in NAMED:
        kind = "channel" if name == "mask" else "prefix of the channels"
        group.add_argument(
            f"--gbuffer-{name}", metavar="NAME", help=f"{kind} or npz array of {name} ({name})"
        )
    group.add_argument(
        "--gbuffer-encoded",
        metavar="NAMES",
        help="vectors stored as v/2 + 1/2, as normal or normal,view",
    )
    group.add_argument(
        "--normalise",
        action="store_true",
        default=None,
        help="take vectors of any length: of 8 or 10 bits, or interpolated",
    )


def gbuffer_options(given: Mapping[str, Any], used: bool) -> dict[str, Any]:
    """Options of ``read_gbuffer`` among the arguments that are given.

    Raises
    ------
    ValueError
        For one of them where no G-buffer is ``used``.
    """
    found = {name: given[f"gbuffer_{name}"] for name in NAMED if f"gbuffer_{name}" in given}
    if "gbuffer_encoded" in given:
        found["encoded"] = tuple(given["gbuffer_encoded"].split(","))
    if "normalise" in given:
        found["normalise"] = True
    if found and not used:
        option = next(iter(found))
        flag = "normalise" if option == "normalise" else f"gbuffer-{option}"
        raise ValueError(f"--{flag}: has a meaning with --gbuffer only")
    return found
