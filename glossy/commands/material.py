"""``glossy material``: a material's parameters, where they come from, and its energy."""

import argparse
from typing import Any

from . import options

EXAMPLE = """\
examples:
  glossy material                            the names, and where each comes from
  glossy material white-foil
  glossy material mx=.3,r0=.04,alpha=.5,kd=.6 --json

Reflectivity and transmissivity are the light sent to either side of what arrives at an angle, the
largest over azimuths and channels. More than 1 together is reported, never clamped.
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the ``glossy`` parser."""
    parser = subparsers.add_parser(
        "material",
        help="parameters, origin and energy of a material",
        description="Print a material: its parameters, whether they are published or chosen by "
        "us, and how much light it sends out over angle.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("material", nargs="*", metavar="M", help="a name, a file or parameters")
    options.add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print one material, or the list of names."""
    from ..materials import describe, material_names, material_to_dict, parse_material

    given = " ".join(args.material)  # blanks between parameters are allowed
    if not given:
        rows = {name: " -- ".join(describe(name)) for name in material_names()}
        options.report(args, "material", {"materials": rows} if args.json else rows)
        return 0
    from ..energy import energy

    material = parse_material(given)
    named = given in material_names()
    origin, source = describe(given) if named else ("given", "")
    found = energy(material)
    result: dict[str, Any] = {"name": given, "origin": origin}
    if source:
        result["source"] = source
    if args.json:
        result |= {"parameters": material_to_dict(material), "energy": found.to_dict()}
        options.report(args, "material", result)
        return 0
    for name, value in material_to_dict(material).items():
        if name in ("reflection", "transmission"):
            for k, lobe in enumerate(value):
                result[f"{name} {k}"] = lobe
        else:
            result[name] = value
    options.report(args, "material", result)
    print(f"{'theta':>6} {'reflectivity':>13} {'transmissivity':>15} {'sum':>7}")
    up, down = found.reflectivity.max(axis=(1, 2)), found.transmissivity.max(axis=(1, 2))
    both = (found.reflectivity + found.transmissivity).max(axis=(1, 2))
    for row in zip(found.theta, up, down, both, strict=True):
        print("{:6.1f} {:13.4f} {:15.4f} {:7.4f}".format(*row))
    if found.conserved:
        print("sends out no more than it receives")
    else:
        print(
            f"sends out more than it receives from {found.exceeds_from:g} degrees, at most "
            f"{found.largest:.3g} times as much at {found.worst[0]:g} degrees"
        )
    return 0
