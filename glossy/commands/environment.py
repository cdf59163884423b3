"""``glossy environment``: read or make an environment, write it in another layout."""

import argparse
import json
import pathlib
from typing import TYPE_CHECKING, Any

from . import options
from .inputs import protect
from .provenance import attributes, provenance

if TYPE_CHECKING:
    from ..cubemap import CubeMap

EXAMPLE = """\
examples:
  glossy environment studio.hdr -o studio_cross.exr --size 512
  glossy environment sky.exr -o sky.exr --layout faces --orientation three
      writes sky_px.exr sky_nx.exr sky_py.exr sky_ny.exr sky_pz.exr sky_nz.exr
  glossy environment faces/ -o back.hdr --layout latlong
  glossy environment spots -o spots.png --size 1024 --exposure -1
"""

FILE_OPTIONS = (
    "input_layout", "orientation", "negative", "nonfinite", "encoding", "crop", "max_pixels",
)  # fmt: skip


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the ``glossy`` parser."""
    parser = subparsers.add_parser(
        "environment",
        help="convert an environment map, or make a built-in one",
        description="Reads a lat-long picture, cross, strip or six faces (or makes spots, studio, "
        "sky, white, axes), converts it to a cube map with its power kept, and writes it.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "input",
        metavar="IN",
        help="a file, a folder of six faces, or a built-in name (./sky is a file)",
    )
    options.add_output_argument(
        parser,
        "OUT",
        ".exr, .hdr or .png; with --layout faces also a folder (then px.exr ... in it)",
    )
    parser.add_argument("--size", type=int, metavar="N", help="texels along a face's edge (256)")
    parser.add_argument(
        "--layout", choices=("faces", "cross", "latlong"), default="cross", help="default cross"
    )
    parser.add_argument(
        "--input-layout",
        metavar="L",
        help="by an EXR's attribute envmap, else recognised from the aspect ratio",
    )
    parser.add_argument(
        "--orientation",
        metavar="O",
        help="convention of a lat-long input (by its attribute envmap, else glossy)",
    )
    parser.add_argument(
        "--output-orientation", metavar="O", help="convention of a lat-long output (glossy)"
    )
    policies = ("error", "clamp", "keep")
    parser.add_argument("--negative", choices=policies, help="negative radiance (clamp)")
    parser.add_argument("--nonfinite", choices=policies, help="NaN and infinity (error)")
    parser.add_argument("--encoding", choices=("linear", "srgb"), help="of 8 and 16-bit input")
    parser.add_argument(
        "--crop",
        choices=("error", "black"),
        help="an EXR that stores part of its display window: refused (error), or the rest is black",
    )
    parser.add_argument(
        "--max-pixels", type=int, metavar="N", help="refuse larger files (default 2^28 pixels)"
    )
    parser.add_argument("--seed", type=int, metavar="S", help="arrangement of spots (0)")
    parser.add_argument("--exposure", type=float, default=0.0, metavar="E", help=".png: stops (0)")
    options.add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Convert, write, and print what was recognised."""
    from ..environment import BUILTIN
    from ..latlong import orientation_of

    if args.output_orientation is not None:
        if args.layout != "latlong":
            raise ValueError("--output-orientation: needs --layout latlong")
        orientation_of(args.output_orientation)
    protect(args, {str(path): path for path in _places(args)})
    if args.input in BUILTIN:
        cube, report = _make(args)
    else:
        cube, report = _read(args)
    after = cube.power().tolist()
    report = {
        "schema": 1,
        "command": "environment",
        "input": args.input,
        **report,
        "size": cube.size,
        "power": after,
    }
    report["output_layout"] = args.layout
    origin = provenance(args, environment=(args.input, cube))
    report["files"] = _write(cube, args, attributes(origin))
    report["provenance"] = origin
    if args.json:
        print(json.dumps(report, allow_nan=False))
    else:
        print(_text(report))
    return 0


def _make(args: argparse.Namespace) -> tuple["CubeMap", dict[str, Any]]:
    from .. import builtin

    for name in FILE_OPTIONS:
        if getattr(args, name) is not None:
            option = "--" + name.replace("_", "-")
            raise ValueError(f"{option}: has no meaning for the built-in {args.input}")
    if args.seed is not None and args.input != "spots":
        raise ValueError(f"--seed: has no meaning for the built-in {args.input}")
    size = 256 if args.size is None else args.size
    return builtin.environment(args.input, size, args.seed or 0), {"layout": "built-in"}


def _read(args: argparse.Namespace) -> tuple["CubeMap", dict[str, Any]]:
    import numpy as np

    from ..environment import read_source
    from ..latlong import orientation_of

    if args.seed is not None:
        raise ValueError("--seed: has no meaning for a file")
    if args.orientation is not None:
        orientation_of(args.orientation)
    policies = args.negative or "clamp", args.nonfinite or "error"
    more = {n: getattr(args, n) for n in ("crop", "max_pixels") if getattr(args, n) is not None}
    source = read_source(args.input, args.input_layout, *policies, args.encoding, **more)
    orientation = args.orientation or source.orientation
    cube = source.to_cube(256 if args.size is None else args.size, args.orientation)
    before = source.power(orientation)
    report: dict[str, Any] = {"layout": source.layout, "source_size": source.size}
    if source.layout == "latlong":
        height, width = source.pixels.shape[:2]
        report |= {"width": width, "height": height, "orientation": orientation}
    report["source_power"] = before.tolist() if np.isfinite(before).all() else None
    report |= {"negative": source.negative, "nonfinite": source.nonfinite}
    return cube, report


def _places(args: argparse.Namespace) -> list[pathlib.Path]:
    """The files that are written."""
    from ..layouts import face_paths

    return face_paths(args.output) if args.layout == "faces" else [pathlib.Path(args.output)]


def _write(cube: "CubeMap", args: argparse.Namespace, header: dict[str, str]) -> list[str]:
    from ..image import write_image
    from ..latlong import cube_to_latlong
    from ..layouts import place_faces

    files = _places(args)
    more: dict[str, Any] = {"exposure": args.exposure} if args.exposure else {}
    if files[0].suffix.lower() == ".exr":
        more["metadata"] = header
    if args.layout == "faces":
        if not pathlib.Path(args.output).suffix:
            pathlib.Path(args.output).mkdir(exist_ok=True)
        for file, face in zip(files, cube.faces, strict=True):
            write_image(file, face, **more)
        return [str(f) for f in files]
    if args.layout == "cross":
        pixels = place_faces(cube.faces, "cross-horizontal")
    else:
        pixels = cube_to_latlong(cube, 2 * cube.size, args.output_orientation or "glossy")
    write_image(args.output, pixels, **more)
    return [args.output]


def _text(report: dict[str, Any]) -> str:
    def rgb(values: list[float]) -> str:
        return " ".join(f"{v:.6g}" for v in values)

    lines = []
    if report["layout"] == "built-in":
        lines.append(f"{report['input']}: built-in, cube map of {report['size']}")
    else:
        shape = f"faces of {report['source_size']}"
        if report["layout"] == "latlong":
            shape = f"{report['width']} x {report['height']}, orientation {report['orientation']}"
        lines.append(
            f"{report['input']}: {report['layout']}, {shape}; cube map of {report['size']}"
        )
        if report["source_power"] is not None:
            lines.append(f"power of the source: {rgb(report['source_power'])}")
        lines.append(f"values negative: {report['negative']}, NaN or inf: {report['nonfinite']}")
    lines.append(f"power of the cube map: {rgb(report['power'])}")
    files = report["files"]
    written = files[0] if len(files) == 1 else f"{files[0]} ... {files[-1]}"
    return "\n".join([*lines, f"{written}: {report['output_layout']}"])
