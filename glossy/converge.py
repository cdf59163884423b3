"""Progressive refinement: the real-time picture at once, then the truth as it accumulates.

While the camera moves there is the real-time picture A. When it rests, quasi-Monte Carlo passes
accumulate an estimate E of standard error sigma (``reference_passes``); A never enters it. What is
shown is ::

    S = A + w (E - A),   w = max(0, 1 - sum sigma^2 / sum (E - A)^2)                        (1)

per pixel, sums over the channels. It is the mean of A and E that has the least expected error: that
needs w = b^2 / (b^2 + sigma^2), b the error of A, and (E - A)^2 - sigma^2 is an unbiased guess of
b^2. So A stays as long as E is noisier than A is wrong, and E takes over pixel by pixel as its
error falls below; in the limit S = E. A pass doubles the samples, and costs what all before it did.

Source: thesis sections 1.4.3 and 4.4.2, which blend random samples with the previous picture
"whenever the camera is still"; the rule (1) is ours.
"""

import dataclasses
import math
import time
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check
from ._arguments import checked
from .brdf import Lobe, Material
from .cubemap import CubeMap
from .frames import SurfacePoints
from .planes import BoundingPlanes
from .reference import reference_passes
from .scene import Scene

Float64Array = npt.NDArray[np.float64]

SAMPLES = 1 << 16  # per point, unless a limit stops before
Pass = tuple[Float64Array, Float64Array, int]


@dataclasses.dataclass(frozen=True, eq=False)
class Convergence:
    """What there is to show after a pass.

    Attributes
    ----------
    display : (..., 3) float64
        Eq. (1); the real-time picture itself before the first pass.
    estimate, error : (..., 3) float64
        The accumulated estimate and its standard error; 0 and inf before the first pass.
    weight : (...) float64
        Share w of the estimate in the display; 1 where it has no error.
    passes, samples : int
        Passes so far, and evaluations of the BSDF that each point took.
    relative_error : float
        RMS of the standard errors over the RMS of the estimate; inf before the first pass.
    seconds : float
        Since the start.
    """

    display: Float64Array
    estimate: Float64Array
    error: Float64Array
    weight: Float64Array
    passes: int
    samples: int
    relative_error: float
    seconds: float

    def to_dict(self) -> dict[str, Any]:
        """The figures of the pass, fit for JSON."""
        found = math.isfinite(self.relative_error)
        return {
            "passes": self.passes,
            "samples": self.samples,
            "relative_error": self.relative_error if found else None,
            "rms_error": _rms(self.error) if found else None,
            "mean_weight": float(self.weight.mean()) if self.weight.size else 0.0,
            "seconds": round(self.seconds, 6),
        }


@dataclasses.dataclass(frozen=True)
class Limits:
    """When to stop: whatever comes first; see ``converge``."""

    target_error: float | None = None
    time: float | None = None
    passes: int | None = None

    def __post_init__(self) -> None:
        for name in ("target_error", "time"):
            if getattr(self, name) is not None:
                _check.positive(name, getattr(self, name))
        if self.passes is not None:
            _check.count("passes", self.passes)

    @property
    def given(self) -> bool:
        """Whether there is any."""
        return (self.target_error, self.time, self.passes) != (None, None, None)

    def reached(self, state: Convergence) -> bool:
        """Whether to stop after this pass; the next one would take as long again."""
        return (
            (self.target_error is not None and state.relative_error <= self.target_error)
            or (self.time is not None and 2.0 * state.seconds > self.time)
            or (self.passes is not None and state.passes >= self.passes)
        )


def _rms(x: npt.NDArray[np.floating]) -> float:
    return float(np.sqrt(np.mean(np.square(x)))) if x.size else 0.0


def blend(
    shown: npt.ArrayLike, estimate: npt.ArrayLike, error: npt.ArrayLike
) -> tuple[Float64Array, Float64Array]:
    """Eq. (1): the display (..., 3) and the weights (...) of real-time picture and estimate.

    ``error`` (..., 3) is the estimate's standard error.
    """
    a, e, sigma = (
        np.asarray(v, dtype=np.float64) for v in np.broadcast_arrays(shown, estimate, error)
    )
    gap = e - a
    apart, noise = np.sum(gap**2, axis=-1), np.sum(sigma**2, axis=-1)
    weight = np.where(apart > noise, 1.0 - noise / np.where(apart > noise, apart, 1.0), 0.0)
    weight = np.where(noise == 0.0, 1.0, weight)
    return a + weight[..., None] * gap, weight


def accumulate(
    shown: npt.NDArray[np.floating], passes: Iterable[Pass], limits: Limits, start: float
) -> Iterator[Convergence]:
    """States of a picture ``shown`` (..., 3): at once, then after each pass until a limit.

    ``passes`` gives estimate, standard error and samples per point; ``start`` is the
    ``time.perf_counter`` to count from.
    """
    a = np.asarray(shown, dtype=np.float64)
    unknown = np.full(a.shape, np.inf)
    none = np.zeros(a.shape)
    yield Convergence(a, none, unknown, none[..., 0], 0, 0, math.inf, time.perf_counter() - start)
    for count, (estimate, error, samples) in enumerate(passes, start=1):
        display, weight = blend(a, estimate, error)
        level = _rms(estimate)
        relative = _rms(error) / level if level > 0.0 else 0.0
        spent = time.perf_counter() - start
        state = Convergence(display, estimate, error, weight, count, samples, relative, spent)
        yield state
        if limits.reached(state):
            return


@checked
def converge(
    points: SurfacePoints,
    material: Material | Lobe,
    prepared: Any,
    cube: CubeMap,
    method: str = "regular",
    *,
    target_error: float | None = None,
    time_limit: float | None = None,
    passes: int | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
    parallax: BoundingPlanes | None = None,
    options: dict[str, Any] | None = None,
) -> Iterator[Convergence]:
    """Yield the real-time result, then the display after each pass of the estimate.

    Parameters
    ----------
    points, material, prepared, method
        As for ``shade``; ``options``: its further arguments (``samples``, ``irradiance``, ...).
    cube : CubeMap
        The map that ``prepared`` was made of.
    target_error : float, optional
        Stop when the RMS of the standard errors is at most this share of the RMS radiance.
    time_limit : float, optional [s]
        Stop before a pass that would exceed it; the first pass is always made.
    passes : int, optional
        Stop after as many.
    samples : int
        Evaluations per point at which it ends in any case (65536).
    seed : int
        Of the estimate.
    parallax : BoundingPlanes, optional
        For both.

    Yields
    ------
    Convergence
        ``estimate`` and ``error`` are those of ``reference`` with estimator "qmc", the same seed
        and the pass's number of samples, bit for bit.

    Raises
    ------
    ValueError
        As ``shade`` and ``reference``, and for limits out of range.
    """
    from .shading import shade

    if time_limit is not None:
        _check.positive("time_limit", time_limit)
    limits = Limits(target_error, time_limit, passes)
    start = time.perf_counter()
    found = reference_passes(points, material, cube, "qmc", samples, seed=seed, parallax=parallax)
    shown = shade(points, material, prepared, method, parallax=parallax, **(options or {}))
    truths = ((t.radiance, t.error, int(t.samples.max(initial=0))) for t in found)
    return accumulate(shown, truths, limits, start)


@checked
def converge_scene(
    scene: Scene, limits: Limits, samples: int = SAMPLES, seed: int = 0
) -> tuple[SurfacePoints, CubeMap, Iterator[Convergence]]:
    """A scene's surface points, its environment, and the states of its picture.

    The pictures are black where nothing is seen (``render.with_background``).

    Raises
    ------
    ValueError, OSError
        As ``render_scene``.
    """
    from . import methods
    from .render import diffuse_irradiance, split_options

    preparation, options = split_options(scene.method, scene.options)
    methods.check_options(scene.method, {k: v for k, v in options.items() if k != "precision"})
    material, points = scene.load_material(), scene.points()
    cube = scene.environment.load()
    prepared = methods.prepare(scene.method, cube, material, **preparation)
    options |= diffuse_irradiance(material, cube, points)
    if "samples" in methods.options(scene.method):
        options["samples"] = scene.samples
    states = converge(
        points,
        material,
        prepared,
        cube,
        scene.method,
        target_error=limits.target_error,
        time_limit=limits.time,
        passes=limits.passes,
        samples=samples,
        seed=seed,
        options=options,
    )
    return points, cube, states
