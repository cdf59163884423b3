"""``glossy render --converge``: a picture at once, then better ones."""

import argparse
import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from . import options
from .provenance import attributes

if TYPE_CHECKING:
    from ..converge import Convergence, Limits
    from ..cubemap import CubeMap
    from ..scene import Scene

TARGET = 0.01  # relative error asked for if no limit is given
MOST_SAMPLES = 1 << 20  # per point, with any limit


def _limits(args: argparse.Namespace) -> "Limits":
    from ..converge import Limits

    limits = Limits(args.target_error, args.time, args.passes)
    return limits if limits.given else Limits(target_error=TARGET)


def _states(
    args: argparse.Namespace,
) -> tuple[Any, Iterator["Convergence"], str, dict[str, Any], float | None]:
    """Seen pixels, the states with their background, the method, provenance and exposure."""
    limits, seed = _limits(args), args.seed or 0
    objects = options.object_scene_from(args)
    if objects is not None:
        from ..scenes.bounds import check_planes
        from ..scenes.converge import converge_objects
        from ..scenes.prepared import prepare
        from ..scenes.render import view_exposure

        check_planes(objects)
        prepared = prepare(objects, True, bool(args.update), options.bar())
        found = converge_objects(prepared, limits, MOST_SAMPLES, seed)
        origin = options.scene_origin(args, objects, None, method=objects.method)
        stops = options.exposure_of(args, view_exposure(prepared, found.view))
        return found.view.seen, found.states, objects.method, origin, stops
    from ..converge import converge_scene
    from ..render import averaged, finer

    k = options.rays_of(args)
    plain = options.scene_from(args)
    scene = finer(plain, k)
    points, cube, states = converge_scene(scene, limits, MOST_SAMPLES, seed)
    own = {"samples": scene.samples, **scene.options}
    origin = options.scene_origin(args, scene, cube, method=scene.method, options=own)
    pictures = (_picture(state, scene, cube, points.coverage, k) for state in states)
    stops = options.exposure_of_shape(args, plain, cube)
    return averaged(points.coverage, k) >= 0.5, pictures, scene.method, origin, stops


def _picture(
    state: "Convergence", scene: "Scene", cube: "CubeMap", hit: Any, k: int
) -> "Convergence":
    """A state of the picture with its background, k x k rays averaged to a pixel."""
    from ..render import averaged, averaged_error, with_background

    display = with_background(scene, cube, state.display.copy(), hit)
    return dataclasses.replace(
        state,
        display=averaged(display, k),
        estimate=averaged(state.estimate, k),
        error=averaged_error(state.error, k, "standard"),
        weight=averaged(state.weight, k),
    )


def run_converging(args: argparse.Namespace) -> int:
    """Write every state of the picture, and say how far the estimate has come."""
    seen, states, method, origin, exposure = _states(args)
    rows = []
    for state in states:
        stops = _write(args.output, state, seen, exposure, attributes(origin))
        exposure = exposure if stops is None else stops
        row = state.to_dict()
        rows.append(row)
        if not args.json:
            print(_line(row), flush=True)
    last = rows[-1]
    height, width = seen.shape
    result = {"output": args.output, "width": width, "height": height, "method": method, **last}
    if args.json:
        result["states"] = rows
    if exposure is not None:
        result["exposure"] = exposure
    options.report(args, "render", result, origin)
    return 0


def _write(
    path: str, state: "Convergence", seen: Any, exposure: float | None, header: dict[str, str]
) -> float | None:
    """The display; in EXR also estimate and error, once there are any."""
    from ..image import write_exr
    from ..render import write_picture

    image = state.display
    if not path.lower().endswith(".exr") or exposure is not None or not state.passes:
        return write_picture(path, image, seen, exposure, header)
    channels = {name: image[..., k] for k, name in enumerate("RGB")}
    for part in ("estimate", "error"):
        value = getattr(state, part)
        channels |= {f"{part}.{name}": value[..., k] for k, name in enumerate("RGB")}
    write_exr(path, channels, metadata={"errorKind": "standard", **header})
    return None


def _line(row: dict[str, Any]) -> str:
    if row["relative_error"] is None:
        return f"real-time picture after {row['seconds']:.2f} s"
    return (
        f"pass {row['passes']}: {row['samples']} samples a point, "
        f"relative standard error {row['relative_error']:.3g}, "
        f"mean weight {row['mean_weight']:.3f}, {row['seconds']:.2f} s"
    )
