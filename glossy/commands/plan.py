"""``glossy plan``: methods, taps and filter for an error that is accepted."""

import argparse

from . import options
from .provenance import provenance

EXAMPLE = """\
examples:
  glossy plan --material mx=.15 --env studio --shape plane --max-error .05
  glossy plan --material white-foil --env room.hdr --size 512 --max-error .1 --json
  glossy plan --gbuffer points.exr --pixels 1000000      the map changes with every picture
  glossy plan --material mx=.1 --any-view                pictures are not known yet
  glossy render --method auto --max-error .05 -o out.exr      shades by such a plan

The plan is for the picture that render makes of the same arguments. The error is the relative RMS
error of its glossy radiance, which stays under the bound; bound kind is "bound" where all points
were measured, else "estimate". Cost 1 is regular sampling with 20 samples a lobe.
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the ``glossy`` parser."""
    parser = subparsers.add_parser(
        "plan",
        help="methods, taps and filter for an accepted error",
        description="Choose method and number of taps of each lobe, and the pyramid's filter, for "
        "a picture and an error that is accepted; predict error and cost. Takes what render takes "
        "for one shape or a G-buffer: a material of Kurt lobes, given by name, file or parameters "
        "(no measurements), an environment, and a picture or --any-view.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    options.add_scene_arguments(parser)
    parser.add_argument(
        "--max-error", type=float, default=0.05, metavar="X", help="relative RMS error (0.05)"
    )
    parser.add_argument(
        "--filter", metavar="NAME", help="plan for this filter only (default: the best there is)"
    )
    parser.add_argument(
        "--any-view",
        action="store_true",
        help="for any views of up to 80 degrees, not those of the picture: takes more taps",
    )
    parser.add_argument(
        "--pixels", type=int, metavar="N", help="pixels shaded each time the map changes"
    )
    options.add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Plan and print."""
    from ..planning.plan import plan
    from ..pyramid import build_pyramid

    name = args.filter
    given = {k: v for k, v in vars(args).items() if k not in ("filter", "max_error")}
    scene = options.scene_from(argparse.Namespace(**given))
    pyramid = build_pyramid(scene.environment.load(), filter=name or "round")
    found = plan(
        scene.load_material(),
        pyramid,
        max_error=args.max_error,
        filters=None if name is None else (),
        pixels=args.pixels,
        points=None if args.any_view else scene.points(),
    )
    result = found.to_dict()
    if args.json:
        made = {"environment": scene.environment.source, **result}
        options.report(args, "plan", made, provenance(args))
        return 0
    lobes, reasons = result.pop("lobes"), result.pop("reasons")
    for k, lobe in enumerate(lobes):
        result[f"lobe {k}"] = lobe
    options.report(args, "plan", result)
    for reason in reasons:
        print(f"- {reason}")
    return 0
