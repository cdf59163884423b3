"""``glossy reference``: the ground truth of a scene, with its error."""

import argparse
from typing import TYPE_CHECKING, Any

from . import options
from .provenance import attributes

if TYPE_CHECKING:
    from ..cubemap import CubeMap
    from ..render import TruthRendering
    from ..scene import Scene
    from ..scenes.model import ObjectScene
    from ..scenes.render import ObjectTruth

EXAMPLE = """\
examples:
  glossy reference --env spots --material mx=.15 -o truth.exr
  glossy reference --env room.hdr --size 256 --tolerance 1e-4 -o truth.exr
  glossy reference room --supersampling 1 --estimator qmc --samples 1024 -o truth.exr
  glossy reference teapot.toml --supersampling 1 --occlusion --samples 1024 -o truth.exr
  glossy reference --env studio --material paint.bsdf --samples 512 -o truth.exr
  glossy reference scene.toml --estimator qmc --samples 4096 --seed 1 -o truth.exr --json

The EXR holds R, G, B and the error of each pixel and channel as error.R, error.G, error.B:
a bound on the absolute error (texels) or its standard error (mc, qmc).
Planar reflectors of a scene of objects are integrated by casting rays into it (qmc, mc).
The material may be a file of measurements: .bsdf (RGL), .brdf (Cornell), .xml (Klems), .binary
(MERL), .txt or .dat (table).
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the ``glossy`` parser."""
    parser = subparsers.add_parser(
        "reference",
        help="ground truth of a scene, with error bars",
        description="Integrate the reflected radiance of a scene without any of the real-time "
        "methods' approximations, and say how far off it may be.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    options.add_scene_arguments(parser, objects=True)
    options.add_object_arguments(parser)
    options.add_background_argument(parser)
    options.add_exposure_argument(parser)
    group = parser.add_argument_group("estimator")
    group.add_argument(
        "--estimator",
        choices=("texels", "mc", "qmc"),
        help="default texels; qmc for a file of measurements",
    )
    group.add_argument("--tolerance", type=float, metavar="X", help="relative error to reach")
    group.add_argument("--samples", type=int, metavar="N", help="samples per pixel (mc, qmc)")
    group.add_argument("--seed", type=int, default=0, help="of the random numbers (default 0)")
    group.add_argument(
        "--occlusion",
        action="store_true",
        help="objects of a scene that are not convex shadow themselves, by rays",
    )
    options.add_output_argument(parser, "OUT", ".exr, .hdr or .png")
    options.add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Integrate and write the picture with its error."""
    from ..image import write_exr
    from ..render import render_reference, write_picture

    options.check_output(args, args.output, (".exr", ".hdr", ".png"))
    wanted = {"samples": args.samples, "tolerance": args.tolerance, "seed": args.seed}
    args.samples = None  # of the estimator here, not of a method
    estimator, args.estimator = args.estimator, None  # of the truth, not of a method
    objects = options.object_scene_from(args)
    rendering: TruthRendering | ObjectTruth
    scene: Scene | ObjectScene
    cube: CubeMap | None
    given: dict[str, Any]
    if objects is not None:
        from ..scenes.render import reference_objects

        progress, update = options.bar(), bool(args.update)
        rendering = reference_objects(
            objects, estimator or "texels", progress, update, bool(args.occlusion), **wanted
        )
        scene, cube, given = objects, None, {"objects": rendering.objects}
        stops = options.exposure_of(args, rendering.exposure)
    else:
        if args.occlusion:
            raise ValueError("--occlusion: has a meaning for a scene of objects only")
        scene = options.scene_from(args)
        rendering = render_reference(scene, estimator, options.rays_of(args), **wanted)
        cube, given = rendering.cube, rendering.options
        stops = options.exposure_of_shape(args, scene, cube)
    used = {"method": rendering.estimator, "options": given}
    origin = options.scene_origin(args, scene, cube, **used)
    header = {"errorKind": rendering.error_kind, **attributes(origin)}
    exposed = {}
    if str(args.output).lower().endswith(".exr") and args.exposure is None:
        channels = {name: rendering.image[..., k] for k, name in enumerate("RGB")}
        channels |= {f"error.{name}": rendering.error[..., k] for k, name in enumerate("RGB")}
        write_exr(args.output, channels, metadata=header)
    else:
        stops = write_picture(args.output, rendering.image, rendering.seen, stops)
        exposed = {} if stops is None else {"exposure": stops}
    result = {"output": args.output, **rendering.to_dict(), **exposed}
    options.report(args, "reference", result, origin)
    return 0
