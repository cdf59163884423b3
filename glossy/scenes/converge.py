"""Progressive refinement of a scene of objects: the picture at once, then towards its truth.

Every object's lobes are estimated over its own cube map, pass by pass; what is not glossy is known
at once and the same in both pictures (``render``). The rule of ``glossy.converge`` is applied to
whole pixels, after the average over their rays.
"""

import dataclasses
import time
from collections.abc import Iterator

from ..converge import SAMPLES, Convergence, Limits, Pass, accumulate
from ..reference import reference_passes
from .bounds import bounding_planes, check_planes
from .prepared import PreparedScene
from .render import View, shade_part, view


@dataclasses.dataclass(frozen=True)
class ObjectConvergence:
    """A view and the states of its picture, the real-time one first."""

    view: View
    states: Iterator[Convergence]


def _passes(prepared: PreparedScene, seen: View, samples: int, seed: int) -> Iterator[Pass]:
    runs = [
        reference_passes(
            part.points,
            part.material,
            prepared.cube_map(part.index),
            "qmc",
            samples,
            seed=seed,
            diffuse=False,
            parallax=bounding_planes(prepared, part.index),
        )
        for part in seen.parts
    ]
    for truths in zip(*runs, strict=True):
        lobes, errors = [t.radiance for t in truths], [t.error for t in truths]
        used = max(int(t.samples.max(initial=0)) for t in truths)
        yield seen.picture(lobes), seen.errors(errors, "standard"), used


def converge_objects(
    prepared: PreparedScene, limits: Limits, samples: int = SAMPLES, seed: int = 0
) -> ObjectConvergence:
    """States of a scene's picture; the last estimate is that of ``reference_objects``.

    Raises
    ------
    ValueError
        As ``render_objects`` and ``reference_objects``.
    """
    check_planes(prepared.scene)
    seen = view(prepared)
    for part in seen.parts:
        prepared.cube_map(part.index)  # captured once; the clock runs from the picture on
    start = time.perf_counter()
    shown = seen.picture([shade_part(prepared, part) for part in seen.parts])
    passes = _passes(prepared, seen, samples, seed)
    return ObjectConvergence(seen, accumulate(shown, passes, limits, start))
