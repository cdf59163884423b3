"""``glossy render --converge``: a picture at once, then better ones."""

import argparse
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from . import options

if TYPE_CHECKING:
    from ..converge import Convergence, Limits

TARGET = 0.01  # relative error asked for if no limit is given
MOST_SAMPLES = 1 << 20  # per point, with any limit


def _limits(args: argparse.Namespace) -> "Limits":
    from ..converge import Limits

    limits = Limits(args.target_error, args.time, args.passes)
    return limits if limits.given else Limits(target_error=TARGET)


def _states(
    args: argparse.Namespace,
) -> tuple[Any, Iterator["Convergence"], Callable[[Any], Any], dict[str, Any]]:
    """Seen pixels, the states, what fills in the background, and what was rendered."""
    limits, seed = _limits(args), args.seed or 0
    objects = options.object_scene_from(args)
    if objects is not None:
        from ..scenes.bounds import check_planes
        from ..scenes.converge import converge_objects
        from ..scenes.prepared import prepare

        check_planes(objects)
        prepared = prepare(objects, True, bool(args.update), options.bar())
        found = converge_objects(prepared, limits, MOST_SAMPLES, seed)
        return found.view.seen, found.states, lambda image: image, {"method": objects.method}
    from ..converge import converge_scene
    from ..render import with_background

    scene = options.scene_from(args)
    points, cube, states = converge_scene(scene, limits, MOST_SAMPLES, seed)
    seen = points.coverage
    return (
        seen,
        states,
        lambda image: with_background(scene, cube, image.copy(), seen),
        {"method": scene.method},
    )


def run_converging(args: argparse.Namespace) -> int:
    """Write every state of the picture, and say how far the estimate has come."""
    seen, states, filled, about = _states(args)
    exposure, rows = args.exposure, []
    for state in states:
        stops = _write(args.output, state, filled, seen, exposure)
        exposure = exposure if stops is None else stops
        row = state.to_dict()
        rows.append(row)
        if not args.json:
            print(_line(row), flush=True)
    last = rows[-1]
    height, width = seen.shape
    result = {"output": args.output, "width": width, "height": height, **about, **last}
    if args.json:
        result["states"] = rows
    if exposure is not None:
        result["exposure"] = exposure
    options.report(args, "render", result)
    return 0


def _write(
    path: str, state: "Convergence", filled: Callable[[Any], Any], seen: Any, exposure: float | None
) -> float | None:
    """The display; in EXR also estimate and error, once there are any."""
    from ..image import write_exr
    from ..render import write_picture

    image = filled(state.display)
    if not path.lower().endswith(".exr") or exposure is not None or not state.passes:
        return write_picture(path, image, seen, exposure)
    channels = {name: image[..., k] for k, name in enumerate("RGB")}
    for part in ("estimate", "error"):
        value = getattr(state, part)
        channels |= {f"{part}.{name}": value[..., k] for k, name in enumerate("RGB")}
    write_exr(path, channels, metadata={"errorKind": "standard"})
    return None


def _line(row: dict[str, Any]) -> str:
    if row["relative_error"] is None:
        return f"real-time picture after {row['seconds']:.2f} s"
    return (
        f"pass {row['passes']}: {row['samples']} samples a point, "
        f"relative standard error {row['relative_error']:.3g}, "
        f"mean weight {row['mean_weight']:.3f}, {row['seconds']:.2f} s"
    )
