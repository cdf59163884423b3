"""Planar reflectors among the objects of a scene: ``method = { name = "planar" }``."""

import dataclasses
import time
from collections.abc import Iterator
from typing import Any

from .. import _check
from ..scenes.prepared import PreparedScene
from ..scenes.render import Part, Shaded
from ..thesis_pattern import ANISOTROPY
from .converge import Refined, Refinement, refine_planar
from .mirror import MirrorBuffer, mirror_camera, reflector_plane, render_mirror
from .shade import Fallback, shade_counted

MISSES = ("cube", "edge")
MARGIN = 0.25


def mirror_pass(
    prepared: PreparedScene, part: Part, scale: float = 1.0, margin: float = 0.0
) -> MirrorBuffer:
    """The mirror buffer of one part of a view.

    Parameters
    ----------
    prepared : PreparedScene
    part : Part
        A rectangle's, of ``view(prepared).parts``.
    scale, margin : float
        As for ``mirror_camera``.

    Raises
    ------
    ValueError
        If the object is no rectangle, or a value is out of range.
    """
    point, normal = reflector_plane(prepared.geometry, part.index)
    camera = mirror_camera(part.camera, point, normal, scale, margin)
    return render_mirror(prepared.world, part.index, camera)


def _fallback(prepared: PreparedScene, part: Part, misses: str) -> Fallback | None:
    """What samples that miss the buffer read."""
    if _check.choice("misses", misses, MISSES) == "edge":
        return None
    lookup = prepared.lookup(part.index, "regular")
    return Fallback(lookup, prepared.geometry.center(part.index))


def refine_reflector(
    prepared: PreparedScene,
    part: Part,
    most: int,
    seed: int = 0,
    *,
    intersections: int | None = None,
    scale: float = 1.0,
    margin: float = MARGIN,
    misses: str = "cube",
    **options: Any,
) -> Iterator[Refined]:
    """States of a reflector's converging buffer, up to ``most`` samples a point (``converge``).

    Options as for ``shade_reflector``; those that are about few samples have no say here.
    """
    buffer = mirror_pass(prepared, part, scale, margin)
    run = Refinement(
        part.points,
        part.material,
        buffer,
        intersections=intersections,
        fallback=_fallback(prepared, part, misses),
        seed=seed,
    )
    return refine_planar(run, most)


def shade_reflector(
    prepared: PreparedScene,
    part: Part,
    *,
    precision: str = "single",
    samples: int = 10,
    kind: str = "auto",
    threshold: float = 0.01,
    anisotropy: float = ANISOTROPY,
    estimator: str = "auto",
    level: str = "ellipse",
    bias: float = 0.0,
    filter: str = "box",
    intersections: int = 2,
    scale: float = 1.0,
    margin: float = MARGIN,
    misses: str = "cube",
) -> Shaded:
    """Radiance (K, 3) of a planar reflector's lobes in a view, its mirror pass, what it missed.

    Options as for ``shade_planar`` and ``mirror_camera``; ``misses``: "cube" reads samples that
    miss the buffer from the object's own cube map, which is captured for nothing else, "edge" from
    the buffer's edge.
    """
    start = time.perf_counter()
    buffer = mirror_pass(prepared, part, scale, margin)
    buffer.pyramid(filter)
    made = time.perf_counter() - start
    fallback = _fallback(prepared, part, misses)
    start = time.perf_counter()
    radiance, counts = shade_counted(
        part.points,
        part.material,
        buffer,
        precision=precision,
        samples=samples,
        kind=kind,
        threshold=threshold,
        anisotropy=anisotropy,
        estimator=estimator,
        level=level,
        bias=bias,
        filter=filter,
        intersections=intersections,
        fallback=fallback,
    )
    seconds = {"mirror": made, "shade": time.perf_counter() - start}
    size = {"width": buffer.camera.width, "height": buffer.camera.height}
    return Shaded(radiance, seconds, {"mirror": size, "mapping": dataclasses.asdict(counts)})
