"""``glossy render``: one picture with a real-time method."""

import argparse
from typing import TYPE_CHECKING, Any

from . import options
from .provenance import attributes

if TYPE_CHECKING:
    from ..render import Rendering
    from ..scenes.render import ObjectRendering

EXAMPLE = """\
examples:
  glossy render -o spots.png
  glossy render --env studio --material mx=.2,my=.075 --samples 30 --threshold 0.1 -o out.exr
  glossy render --method pem --material mx=.2 --footprint distance -o pem.png
  glossy render --method prefiltered --mode multi --lobes 3 --finish refit -o lobes.png
  glossy render room -o room.png
  glossy render hall --samples 13 -o hall.png
  glossy render scene.toml --footprint jacobian --bias -0.5 --json -o out.exr
  glossy render room --converge --time 30 -o room.exr
  glossy render --material mx=.1 --converge --target-error 0.005 -o still.png
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the ``glossy`` parser."""
    parser = subparsers.add_parser(
        "render",
        help="render a scene with a real-time method",
        description="Render a scene, or the surface points of a G-buffer, with one of the "
        "real-time methods. EXR and HDR hold linear radiance; PNG is exposed, clipped and sRGB "
        "encoded.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    options.add_scene_arguments(parser, objects=True)
    options.add_object_arguments(parser)
    options.add_background_argument(parser)
    options.add_method_arguments(parser)
    options.add_exposure_argument(parser)
    group = parser.add_argument_group(
        "progressive refinement",
        "The picture is written at once, then again after each pass as quasi-Monte Carlo\n"
        "samples accumulate and replace it pixel by pixel. EXR files also hold\n"
        "estimate.R, G, B and its standard error error.R, G, B. Planar reflectors end at\n"
        "their converged mirror buffer.",
    )
    group.add_argument("--converge", action="store_true", help="refine until a limit is reached")
    group.add_argument(
        "--target-error",
        type=float,
        metavar="X",
        help="relative RMS standard error to reach (default 0.01 if no limit is given)",
    )
    group.add_argument("--time", type=float, metavar="S", help="seconds not to exceed")
    group.add_argument("--passes", type=int, metavar="N", help="passes; each doubles the samples")
    group.add_argument("--seed", type=int, metavar="K", help="of the estimate (default 0)")
    options.add_output_argument(parser, "OUT", ".exr, .hdr or .png")
    options.add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Render and write the picture."""
    from ..render import render_scene, write_picture

    options.check_output(args, args.output, (".exr", ".hdr", ".png"))
    if args.converge:
        from .converging import run_converging

        return run_converging(args)
    for name in ("target_error", "time", "passes", "seed"):
        if getattr(args, name) is not None:
            raise ValueError(f"--{name.replace('_', '-')}: has a meaning with --converge only")
    objects = options.object_scene_from(args)
    rendering: Rendering | ObjectRendering
    used: dict[str, Any]
    if objects is not None:
        from ..scenes.render import render_objects

        rendering = render_objects(objects, options.bar(), bool(args.update))
        used = {"method": objects.method, "options": {"objects": rendering.objects}}
        origin = options.scene_origin(args, objects, None, **used)
        stops = options.exposure_of(args, rendering.exposure)
    else:
        scene = options.scene_from(args)
        rendering = render_scene(scene, options.rays_of(args))
        used = {"method": rendering.method}
        used["options"] = {**rendering.options, "samples": rendering.samples}
        origin = options.scene_origin(args, scene, rendering.cube, **used)
        stops = options.exposure_of_shape(args, scene, rendering.cube)
    stops = write_picture(args.output, rendering.image, rendering.seen, stops, attributes(origin))
    exposed = {} if stops is None else {"exposure": stops}
    result = {"output": args.output, **rendering.to_dict(), **exposed}
    options.report(args, "render", result, origin)
    return 0
