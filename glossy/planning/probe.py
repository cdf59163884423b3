"""What candidates of a lobe do wrong on given views of a map, against the ground truth.

The map itself is asked, not a model of it. With L_j the radiance of lobe j by the quadrature of
``reference`` over the pyramid's finest level, d its error bound summed over the lobes, and L_jk the
radiance by candidate k, a choice k(j) is wrong at a point by ::

    e = sum_j (L_jk(j) - L_j)                                                               (1)

in each channel: errors of lobes that look at the same lights add with their signs. The candidate
that leaves a lobe out has L_jk = 0. With weights w, sums over points and channels ::

    R = sum w e^2 / sum w L^2,   L = sum_j L_j,   D^2 = sum w d^2 / sum w L^2               (2)

A picture's error is sqrt(R). Nothing but d is unknown if all its points are measured, so that its
bound is sqrt(R) + D; of points drawn, R has a standard error S, and ::

    bound = sqrt(R + SURE S) + D,   S^2 = sum_i (w_i (e_i^2 - R L_i^2))^2 / (sum w L^2)^2   (3)

is an estimate. Of views that are not known it is the largest sqrt(R) + D of any narrow view.
"""

import dataclasses
import weakref

import numpy as np
import numpy.typing as npt

from .._threads import using
from ..brdf import Lobe, Material
from ..cubemap import CubeMap
from ..pyramid import Pyramid
from ..reference import reference
from .model import CANDIDATES, run_candidate
from .views import Views

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

COARSE = 16  # levels up to this size tell whether a pyramid was refilled
TOLERANCE = 3e-3  # of the truth, at each point and lobe
WORK = 200_000  # evaluations of it, for each
SURE = 2.0  # standard errors
AT_ONCE = 256  # choices
OVERFLOWN = 1e100  # error of a candidate that leaves single precision: NaN would compare as none

_finest: list[tuple["weakref.ref[Pyramid]", bytes, CubeMap]] = []


def state(pyramid: Pyramid) -> bytes:
    """The coarse levels, which change when a pyramid is refilled."""
    return b"".join(level.tobytes() for level in pyramid.levels if level.shape[1] <= COARSE)


def finest(pyramid: Pyramid) -> CubeMap:
    """The finest level as a map. Only the last is kept: with its quadrature it is large."""
    now = state(pyramid)
    for of, then, cube in tuple(_finest):
        if of() is pyramid and then == now:
            return cube
    cube = CubeMap(pyramid.levels[0], negative="keep")
    _finest[:] = [(weakref.ref(pyramid), now, cube)]
    return cube


def alone(lobe: Lobe, side: float) -> Material:
    """A material of one lobe: side +1 reflects, -1 transmits."""
    return Material(reflection=[lobe]) if side > 0.0 else Material(transmission=[lobe])


@dataclasses.dataclass(frozen=True, eq=False)
class Truths:
    """``radiance`` (L, P, 3) of each lobe, and the bound ``off`` (P, 3) on the error of its sum."""

    radiance: Float64Array
    off: Float64Array


def truths(material: Material, cube: CubeMap, views: Views) -> Truths:
    """The truth of every lobe at the points of some views."""
    found = [
        reference(views.points, alone(*pair), cube, samples=WORK, tolerance=TOLERANCE)
        for pair in material.sided_lobes()
    ]
    return Truths(np.stack([t.radiance for t in found]), np.sum([t.error for t in found], axis=0))


@dataclasses.dataclass(frozen=True, eq=False)
class Probe:
    """Errors (L, K, P, 3) of each lobe's candidates at the points of ``views``, and the truth."""

    errors: Float64Array
    truth: Truths
    views: Views

    def measure(self, choice: Int64Array) -> tuple[Float64Array, Float64Array]:
        """Relative RMS error (M,) of choices (M, L) and its bound (M,), eqs. (1) to (3)."""
        parts = range(0, len(choice), AT_ONCE)
        found = [self._measure(choice[start : start + AT_ONCE]) for start in parts]
        return tuple(np.concatenate(a) for a in zip(*found, strict=True))  # type: ignore[return-value]

    def _measure(self, choice: Int64Array) -> tuple[Float64Array, Float64Array]:
        wrong = sum(self.errors[j, choice[:, j]] for j in range(choice.shape[1]))
        return self._judge(np.sum(np.square(wrong), axis=-1))

    def alone(self, lobe: int) -> tuple[Float64Array, Float64Array]:
        """The same (K,) of each candidate of one lobe, were the others exact."""
        return self._judge(np.sum(np.square(self.errors[lobe]), axis=-1))

    def _judge(self, square: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Error and bound (M,) of squared errors (M, P)."""
        w = self.views.weight
        power = np.sum(np.square(self.truth.radiance.sum(axis=0)), axis=-1)
        off = np.sum(np.square(self.truth.off), axis=-1)
        share = _ratio(square @ w, power @ w)
        error = np.sqrt(share)
        if self.views.group:
            own = (len(power) // self.views.group, self.views.group)
            each, of, d = (
                a.reshape(*a.shape[:-1], *own).sum(axis=-1) for a in (square, power, off)
            )
            bound = np.max(np.sqrt(_ratio(each, of)) + np.sqrt(_ratio(d, of)), axis=-1)
            return error, bound
        spread = np.zeros_like(share)
        if not self.views.complete:
            apart = w * (square - share[:, None] * power)
            spread = _ratio(np.sqrt(np.sum(np.square(apart), axis=-1)), power @ w)
        return error, np.sqrt(share + SURE * spread) + np.sqrt(_ratio(off @ w, power @ w))


def _ratio(a: Float64Array, b: Float64Array | float) -> Float64Array:
    """``a / b``, 0 of nothing and infinite of something over nothing."""
    a, b = np.broadcast_arrays(a, b)
    with np.errstate(divide="ignore", over="ignore"):
        return np.divide(a, b, out=np.zeros(a.shape), where=a > 0.0)


def probe(material: Material, pyramid: Pyramid, views: Views, truth: Truths) -> Probe:
    """Measure every candidate of every lobe of a material."""
    errors = np.empty((len(truth.radiance), len(CANDIDATES), *truth.off.shape))
    with using(1), np.errstate(invalid="ignore", over="ignore"):
        for j, pair in enumerate(material.sided_lobes()):
            for k, candidate in enumerate(CANDIDATES):
                errors[j, k] = -truth.radiance[j]
                if candidate.samples:
                    errors[j, k] += run_candidate(candidate, views.points, alone(*pair), pyramid)
    errors[~np.isfinite(errors)] = OVERFLOWN
    return Probe(errors, truth, views)
