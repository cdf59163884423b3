"""Arguments that several commands share, and the scene they describe.

Every default is None, so that an argument on the command line overrides the scene file and a
missing one leaves it; what neither names takes the defaults of ``Scene``.
"""

import argparse
import dataclasses
import os
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from .gbuffer import add_gbuffer_arguments, gbuffer_options
from .inputs import add_force_argument, protect
from .provenance import provenance

if TYPE_CHECKING:
    from ..cubemap import CubeMap
    from ..scene import Scene
    from ..scenes.model import ObjectScene

METHOD_OPTIONS = (
    "threshold", "filter", "footprint", "normalisation", "estimator", "kind", "bias", "precision",
    "max_error", "count", "mode", "lobes", "finish", "elevations", "map_size",
)  # fmt: skip


def add_scene_arguments(
    parser: argparse.ArgumentParser, gbuffer: bool = True, objects: bool = False
) -> None:
    """SCENE (of one shape or ``objects``), --env, --material, picture size and what is in it."""
    group = parser.add_argument_group("scene")
    group.add_argument(
        "scene",
        nargs="?",
        metavar="SCENE",
        help="scene file (TOML), room, showroom or hall"
        if objects
        else "scene file (TOML) of one shape, without [[objects]]",
    )
    group.add_argument(
        "--env",
        metavar="E",
        help="environment: a file (EXR, HDR), a folder or pattern (sky_*.exr) of six faces, or a "
        "built-in name: spots, studio, sky, white, axes (default spots)",
    )
    group.add_argument("--size", type=int, metavar="N", help="cube map size (default 256)")
    group.add_argument(
        "--material",
        metavar="M",
        help="a published name, a file, or parameters such as mx=.2,my=.075,r0=1,alpha=0 "
        "(default mx=0.15)",
    )
    group.add_argument("--shape", choices=("sphere", "plane"), help="default sphere")
    group.add_argument("--width", type=int, help="pixels (default 256)")
    group.add_argument("--height", type=int, help="pixels (default 256)")
    group.add_argument(
        "--input-layout", metavar="L", help="layout of the environment file, if not recognised"
    )
    group.add_argument("--orientation", metavar="O", help="orientation preset of the environment")
    group.add_argument(
        "--crop",
        choices=("error", "black"),
        help="environment EXR that stores part of its display window: refused, or black elsewhere",
    )
    group.add_argument(
        "--max-pixels", type=int, metavar="N", help="refuse larger environment files (2^28 pixels)"
    )
    group.add_argument("--negative", choices=("error", "clamp", "keep"), help="negative radiance")
    group.add_argument("--nonfinite", choices=("error", "clamp", "keep"), help="NaN and infinity")
    group.add_argument("--encoding", choices=("linear", "srgb"), help="of an 8 or 16-bit map")
    if gbuffer:
        add_gbuffer_arguments(parser)


def add_background_argument(parser: argparse.ArgumentParser) -> None:
    """--background, for commands that write pictures."""
    parser.add_argument(
        "--background",
        choices=("environment", "black"),
        help="pixels that see no surface (default environment; black with a G-buffer)",
    )


def add_exposure_argument(parser: argparse.ArgumentParser) -> None:
    """--exposure, for commands that write PNG."""
    parser.add_argument(
        "--exposure",
        metavar="S",
        help="PNG: stops to brighten by, or like:FILE for those of another picture (default: the "
        "brightest hundredth becomes about white, the same for every picture of a scene)",
    )


def exposure_of(args: argparse.Namespace, automatic: float | None) -> float | None:
    """Stops that are asked for, or those of the scene for a PNG; None: as the picture needs."""
    if args.exposure is not None:
        from ..exposure import parse

        return parse(args.exposure)
    return automatic if _is_png(args) else None


def exposure_of_shape(args: argparse.Namespace, scene: "Scene", cube: "CubeMap") -> float | None:
    """`exposure_of` the pictures of one shape."""
    from ..exposure import scene_exposure

    wanted = args.exposure is None and _is_png(args)
    found = scene_exposure(scene.points(), scene.load_bsdf(), cube) if wanted else None
    return exposure_of(args, found)


def _is_png(args: argparse.Namespace) -> bool:
    return str(args.output).lower().endswith(".png")


def add_method_arguments(parser: argparse.ArgumentParser) -> None:
    """--method, --samples and the options of the methods."""
    group = parser.add_argument_group("method")
    group.add_argument(
        "--method",
        metavar="NAME",
        help="regular, importance, thesis, lattice, pem, ... (regular); planar: rectangles of a "
        "scene of objects",
    )
    group.add_argument("--samples", type=int, metavar="N", help="samples per lobe (default 20)")
    group.add_argument("--threshold", type=float, metavar="X", help="pattern's density threshold")
    group.add_argument(
        "--filter",
        metavar="NAME",
        help="pyramid: box, gauss4, gauss6, round, pem5:cos, ... (gauss6; pem: pem5:sqrtcos)",
    )
    group.add_argument(
        "--footprint",
        metavar="NAME",
        help="paper, thesis or jacobian (paper); pem: constant, distance or view (constant)",
    )
    group.add_argument("--normalisation", metavar="NAME", help="paper or projected")
    group.add_argument(
        "--estimator", metavar="NAME", help="thesis, planar: 4.23, 4.24 or 4.25 (4.25)"
    )
    group.add_argument(
        "--kind",
        metavar="NAME",
        help="thesis, planar: auto, ring, line, multi-ring or blend (auto)",
    )
    group.add_argument("--bias", type=float, metavar="B", help="added to the level (default 0)")
    group.add_argument(
        "--max-error", type=float, metavar="X", help="auto: accepted relative RMS error (0.05)"
    )
    group.add_argument(
        "--regions", type=int, dest="count", metavar="N", help="pem: a multiple of six (48)"
    )
    group.add_argument(
        "--mode", metavar="NAME", help="prefiltered: single, flat or multi lobes (single)"
    )
    group.add_argument("--lobes", type=int, metavar="N", help="prefiltered: lobes of multi (3)")
    group.add_argument(
        "--finish", metavar="NAME", help="prefiltered: mean, minimum, rescale or refit (mean)"
    )
    group.add_argument("--elevations", type=int, metavar="N", help="prefiltered: slices (16)")
    group.add_argument(
        "--map-size", type=int, metavar="N", help="prefiltered: texels along a slice's face (64)"
    )
    group.add_argument("--precision", choices=("single", "double"), help="arithmetic (single)")


def add_json_argument(parser: argparse.ArgumentParser) -> None:
    """--json."""
    parser.add_argument("--json", action="store_true", help="print what was done as JSON")


def scene_from(args: argparse.Namespace) -> "Scene":
    """The scene file with the command line's arguments laid over it."""
    from ..scene import EnvironmentSource, Plane, Scene, Sphere, default_camera, load_scene

    scene = load_scene(args.scene, _folder(args)) if args.scene else Scene()
    if not isinstance(scene, Scene):
        raise ValueError(f"{args.scene}: a scene of objects; this command takes one shape")
    given = {k: v for k, v in vars(args).items() if v is not None}

    env = dataclasses.asdict(scene.environment)
    for name, key in (
        ("env", "source"),
        ("size", "size"),
        ("input_layout", "layout"),
        ("orientation", "orientation"),
        ("crop", "crop"),
        ("max_pixels", "max_pixels"),
        ("negative", "negative"),
        ("nonfinite", "nonfinite"),
        ("encoding", "encoding"),
    ):
        if name in given:
            env[key] = given[name]
    change: dict[str, Any] = {"environment": EnvironmentSource(**env)}

    for name in ("material", "background", "method", "samples"):
        if name in given and name in {f.name for f in dataclasses.fields(Scene)}:
            change[name] = given[name]
    options = {name: given[name] for name in METHOD_OPTIONS if name in given}
    change["options"] = {**scene.options, **options}

    picture: dict[str, int] = {k: given[k] for k in ("width", "height") if k in given}
    gbuffer = given.get("gbuffer", None if picture or "shape" in given else scene.gbuffer)
    if gbuffer is not None:
        clash = [f"--{k}" for k in ("shape", "width", "height") if k in given]
        if clash:
            raise ValueError(f"--gbuffer: brings its own points, so {clash[0]} has no meaning")
        background = given.get("background", "black")
        if background != "black":
            raise ValueError("--background: a G-buffer has no rays to the environment, only black")
        reading = scene.gbuffer_options if gbuffer == scene.gbuffer else {}
        reading = {**reading, **gbuffer_options(given, used=True)}
        change |= {"gbuffer": gbuffer, "gbuffer_options": reading, "background": "black"}
    else:
        gbuffer_options(given, used=False)
        shape = scene.shape
        if "shape" in given:
            shape = Sphere() if given["shape"] == "sphere" else Plane()
        old = scene.camera
        size: dict[str, int] = {"width": 256, "height": 256}
        if old is not None:
            size = {"width": old.width, "height": old.height}
        size.update(picture)
        framed = (
            old is None
            or shape is not scene.shape
            or old == default_camera(shape, old.width, old.height)
        )
        camera = default_camera(shape, **size) if framed else dataclasses.replace(old, **size)  # type: ignore[type-var]
        change |= {"gbuffer": None, "shape": shape, "camera": camera}
    return dataclasses.replace(scene, **change)


def _folder(args: argparse.Namespace) -> str | None:
    """What paths in the scene file are relative to, if not to its own folder."""
    return getattr(args, "scene_folder", None)


def object_scene_from(args: argparse.Namespace) -> "ObjectScene | None":
    """The scene of objects that the arguments name, with them laid over it; None for one shape."""
    from ..scene import load_scene
    from ..scenes.load import overlay
    from ..scenes.model import ObjectScene

    scene = load_scene(args.scene, _folder(args)) if args.scene else None
    if not isinstance(scene, ObjectScene):
        return None
    given = {k: v for k, v in vars(args).items() if v is not None}
    gbuffer_options(given, used=False)
    return overlay(scene, given, METHOD_OPTIONS)


def add_object_arguments(parser: argparse.ArgumentParser) -> None:
    """--supersampling, and --update for scenes of objects."""
    parser.add_argument(
        "--supersampling",
        type=int,
        metavar="K",
        help="K x K rays a pixel, averaged (default 1; a scene of objects: its file's, or 2)",
    )
    group = parser.add_argument_group(
        "scene of objects (a file with [[objects]], room, showroom, hall)"
    )
    group.add_argument(
        "--update", action="store_true", default=None, help="bake and capture again, cached or not"
    )


def rays_of(args: argparse.Namespace) -> int:
    """Rays along a pixel's axes of a picture of one shape."""
    return 1 if args.supersampling is None else int(args.supersampling)


def bar() -> Any:
    """Wraps the baker's loop with a bar on stderr when that is a terminal."""
    return lambda items: progress(items, len(items), "bake")


def progress(items: Any, total: int | None = None, label: str = "") -> Iterator[Any]:
    """``items`` with a bar on stderr when that is a terminal, and nothing otherwise."""
    from tqdm import tqdm

    yield from tqdm(items, total=total, desc=label, disable=not sys.stderr.isatty(), leave=False)


def scene_origin(
    args: argparse.Namespace, scene: "Scene | ObjectScene", cube: "CubeMap | None", **used: Any
) -> dict[str, Any]:
    """Provenance of a picture, empty if neither an EXR nor JSON is written.

    ``used``: method or estimator and its options. Of a scene of objects the files tell the rest.
    """
    if not (args.json or str(args.output).lower().endswith(".exr")):
        return {}
    if cube is None and scene.environment is not None:
        from ..builtin import NAMES

        if scene.environment.source in NAMES:
            cube = scene.environment.load()
    if cube is not None and scene.environment is not None:
        used |= {"environment": (scene.environment.source, cube)}
        used |= {"material": getattr(scene, "material", None)}
    return provenance(args, **used)


PICTURES = ("exr", "hdr", "png")


def add_output_argument(
    parser: argparse.ArgumentParser,
    metavar: str,
    text: str,
    formats: tuple[str, ...] = PICTURES,
    required: bool = True,
) -> None:
    """-o, the format of -o -, and --force."""
    parser.add_argument(
        "-o",
        "--output",
        metavar=metavar,
        required=required,
        help=f"{text}; - for standard output, messages then on standard error",
    )
    parser.add_argument("--output-format", choices=formats, help=f"of -o - (default {formats[0]})")
    add_force_argument(parser)


def check_output(
    args: argparse.Namespace, path: str, suffixes: tuple[str, ...], option: str = "--output"
) -> None:
    """Refuse an unwritable output, or one that is an input, before the work is done."""
    import pathlib

    file = pathlib.Path(path)
    if file.suffix.lower() not in suffixes:
        raise ValueError(f"{option}: must end in {', '.join(suffixes)}, got {path!r}")
    if not file.parent.is_dir():
        raise FileNotFoundError(f"{option}: no folder {str(file.parent)!r}")
    if not os.access(file.resolve().parent, os.W_OK):
        raise PermissionError(f"{option}: folder {str(file.parent)!r} cannot be written")
    protect(args, {option: path})


def report(
    args: argparse.Namespace,
    command: str,
    result: dict[str, Any],
    origin: dict[str, Any] | None = None,
) -> None:
    """Print a result: JSON with its schema and provenance, or one ``name: value`` line each."""
    if args.json:
        import json

        more = {} if origin is None else {"provenance": origin}
        print(json.dumps({"schema": 1, "command": command, **result, **more}, indent=2))
        return
    for name, value in result.items():
        print(f"{name.replace('_', ' ')}: {_text(value)}")


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return ", ".join(f"{k} {_text(v)}" for k, v in value.items()) or "none"
    if isinstance(value, list):
        return " ".join(_text(v) for v in value)
    return str(value)
