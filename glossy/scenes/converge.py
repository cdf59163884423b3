"""Progressive refinement of a scene of objects: the picture at once, then towards its truth.

Every object's lobes are estimated over its own cube map, pass by pass, those of a planar reflector
over its mirror buffer (``planar.converge``); what is not glossy is known at once and the same in
both pictures (``render``). The rule of ``glossy.converge`` is applied to
whole pixels, after the average over their rays.
"""

import dataclasses
import time
from collections.abc import Iterator

from .. import methods
from ..converge import SAMPLES, Convergence, Limits, Pass, accumulate
from ..reference import reference_passes
from .bounds import bounding_planes, check_planes
from .prepared import PreparedScene
from .render import Part, View, shade_part, view


@dataclasses.dataclass(frozen=True)
class ObjectConvergence:
    """A view and the states of its picture, the real-time one first."""

    view: View
    states: Iterator[Convergence]


def _runs(prepared: PreparedScene, part: Part, samples: int, seed: int) -> Iterator[Pass]:
    """Radiance and standard error (K, 3) of a part's lobes and samples a point, pass by pass."""
    name, options = prepared.scene.method_of(prepared.scene.objects[part.index])
    if name in methods.VIEWED:
        own = methods.viewed(name, methods.VIEWED_PASSES)
        for state in own(prepared, part, samples, seed, **options):
            yield state.radiance, state.error, state.samples
        return
    for truth in reference_passes(
        part.points,
        part.material,
        prepared.cube_map(part.index),
        "qmc",
        samples,
        seed=seed,
        diffuse=False,
        parallax=bounding_planes(prepared, part.index),
    ):
        yield truth.radiance, truth.error, int(truth.samples.max(initial=0))


def _passes(prepared: PreparedScene, seen: View, samples: int, seed: int) -> Iterator[Pass]:
    runs = [_runs(prepared, part, samples, seed) for part in seen.parts]
    for states in zip(*runs, strict=True):
        lobes, errors = [s[0] for s in states], [s[1] for s in states]
        used = max(s[2] for s in states)
        yield seen.picture(lobes), seen.errors(errors, "standard"), used


def converge_objects(
    prepared: PreparedScene, limits: Limits, samples: int = SAMPLES, seed: int = 0
) -> ObjectConvergence:
    """States of a scene's picture; the last estimate is that of ``reference_objects``.

    For planar reflectors it is the converged mirror buffer instead.

    Raises
    ------
    ValueError
        As ``render_objects`` and ``reference_objects``.
    """
    check_planes(prepared.scene)
    seen = view(prepared)
    for part in seen.parts:
        if prepared.scene.method_of(prepared.scene.objects[part.index])[0] not in methods.VIEWED:
            prepared.cube_map(part.index)  # captured once; the clock runs from the picture on
    start = time.perf_counter()
    shown = seen.picture([shade_part(prepared, part) for part in seen.parts])
    passes = _passes(prepared, seen, samples, seed)
    return ObjectConvergence(seen, accumulate(shown, passes, limits, start))
