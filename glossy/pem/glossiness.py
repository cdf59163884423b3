"""Glossiness: the cosine lobes that a pyramid's levels stand for, and which level stands for which.

A surface of glossiness g collects light with a power of the cosine about the direction r::

    s = 1/(1 - g),   f(r, s) = integral L(w) max(0, r.w)^s dw                                (1)

whose volume, the integral of the lobe, is 2 pi/(s + 1); a pyramid's lookup is normalised, so that
f = 2 pi/(s + 1) times the lookup. Which level: the one at which the filtered impulse, a single
white texel, has the volume of the lobe when both have a peak of 1::

    V(level) = integral h(w) dw / max h = 2 pi/(s + 1),   h(w) = lookup(w, level)            (2)

V is the mean over ``PLACES`` white texels spread over a face (their share of solid angle is their
weight), since h depends on where a texel lies on its face and between coarser texels; it is
computed at every eighth of a level, once for each filter and size. The integrals are sums over
circles about the white texel, denser towards it; the maximum is looked for among the centres of
texels too, where a bilinear function has its peaks.

Source: Knuth et al., eqs. 3 and 4 and section 5. They do not say where their white pixel lies.
"""

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from ..cubemap import CubeMap, texel_directions, texel_solid_angles
from ..frames import normalise
from ..lowdiscrepancy import hammersley
from ..pyramid import FILTERS, Pyramid, build_pyramid

PLACES = 12
STEPS = 8  # of the table, to a level
CIRCLES, AZIMUTHS = 64, 24
SPREAD = 24.0  # texels of the coarser level, from the white one: farther than five taps reach
BRIGHTEST = 32  # texels of a level whose centres may be the maximum: five taps make plateaus

Float64Array = npt.NDArray[np.float64]


def exponent(glossiness: npt.ArrayLike) -> Float64Array:
    """Exponent s (...) of glossiness g (...) in [0, 1], eq. (1); infinite for a mirror, g = 1."""
    g = _check.array("glossiness", glossiness)
    if not np.all((g >= 0.0) & (g <= 1.0)):
        raise _check.fail("glossiness", "must be in [0, 1]", glossiness)
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / (1.0 - g))


def glossiness(exponent: npt.ArrayLike) -> Float64Array:
    """Glossiness g (...) of the exponent s (...) >= 1, eq. (1); 1 for infinity."""
    s = _check.array("exponent", exponent)
    if not np.all(s >= 1.0):
        raise _check.fail("exponent", "must be at least 1", exponent)
    return np.asarray(1.0 - 1.0 / s)


def lobe_volume(exponent: npt.ArrayLike) -> Float64Array:
    """Integral of max(0, cos)^s over the sphere [sr]: 2 pi/(s + 1)."""
    return np.asarray(2.0 * np.pi / (_check.array("exponent", exponent) + 1.0))


def circles(axes: Float64Array, reach: float, rings: int, azimuths: int) -> tuple[Any, ...]:
    """Quadrature over caps of ``reach`` [rad] about axes (P, 3).

    Returns the angles from the axis (K,), directions (P, K, 3) and weights (K,) [sr].
    """
    x = (np.arange(rings) + 0.5) / rings
    angle = reach * x * x
    phi = (np.arange(azimuths) + 0.5) * (2.0 * np.pi / azimuths)
    side = normalise(np.cross(axes, np.eye(3)[np.argmin(np.abs(axes), axis=1)]))
    other = np.cross(axes, side)
    ring = np.cos(phi)[:, None, None] * side + np.sin(phi)[:, None, None] * other
    sine, cosine = np.sin(angle)[:, None, None, None], np.cos(angle)[:, None, None, None]
    directions = np.moveaxis((sine * ring + cosine * axes).reshape(-1, len(axes), 3), 1, 0)
    weight = np.sin(angle) * (2.0 * reach * x / rings) * (2.0 * np.pi / azimuths)
    return np.repeat(angle, azimuths), directions, np.repeat(weight, azimuths)


class Impulses:
    """White texels, each alone in a map, through a filter: what a lookup makes of them.

    Attributes
    ----------
    axes : (P, 3)
        Unit directions of the texels.
    weights : (P,)
        Their share of solid angle.
    levels : int
        Of the pyramid.
    """

    def __init__(self, filter: str, size: int, texels: npt.NDArray[np.intp]) -> None:
        # texels (P, 3): face, row, column; three at a time, one for each channel
        where = tuple(texels.T)
        self.axes = normalise(texel_directions(size)[where])
        omega = texel_solid_angles(size)[where[1:]]
        self.weights = omega / omega.sum()
        self._pyramids: list[Pyramid] = []
        for start in range(0, len(texels), 3):
            faces = np.zeros((6, size, size, 3), dtype=np.float32)
            for channel, (face, row, column) in enumerate(texels[start : start + 3]):
                faces[face, row, column, channel] = 1.0
            self._pyramids.append(build_pyramid(CubeMap(faces), filter=filter))
        self.size, self.levels = size, size.bit_length()

    def lookup(self, index: int, directions: npt.ArrayLike, level: npt.ArrayLike) -> Float64Array:
        """What directions (..., 3) see of one of the texels at levels (...), (...)."""
        seen = self._pyramids[index // 3].sample(directions, level, precision="double")
        return np.asarray(seen[..., index % 3])

    def _all(self, directions: Float64Array, level: npt.ArrayLike) -> Float64Array:
        """What directions (P, K, 3) see of their texels at levels (...): (P, ..., K)."""
        lod = np.asarray(level, dtype=np.float64)[..., None]
        return np.stack([self.lookup(i, own, lod) for i, own in enumerate(directions)])

    def _brightest(self, level: int) -> Float64Array:
        """Directions of the brightest texels of a level, (P, BRIGHTEST, 3)."""
        centres = texel_directions(self.size >> level).reshape(-1, 3)
        keep = min(BRIGHTEST, len(centres))
        found = []
        for i in range(len(self.axes)):
            texels = self._pyramids[i // 3].levels[level][..., i % 3].reshape(-1)
            found.append(centres[np.argpartition(-texels, keep - 1)[:keep]])
        return np.stack(found)

    def reach(self, level: float) -> float:
        """Angle [rad] beyond which nothing of a texel is seen."""
        return min(math.pi, SPREAD * 2.0 ** math.ceil(level) / self.size)

    def table(self) -> tuple[Float64Array, Float64Array]:
        """Levels (K,) in steps of 1/STEPS, and the left side of eq. (2) there, (K, P) [sr].

        Between two levels the integral is linear; the peak is not.
        """
        volume, bright = [], []
        for level in range(self.levels):
            _, d, w = circles(self.axes, self.reach(level), CIRCLES, AZIMUTHS)
            volume.append(self._all(d, level) @ w)
            bright.append(self._brightest(level))
        steps = np.arange((self.levels - 1) * STEPS + 1) / STEPS
        first = np.minimum(steps.astype(int), max(self.levels - 2, 0))
        out = []
        for level in range(self.levels):
            own = steps[first == level]
            among = np.concatenate(bright[level : level + 2], axis=1)
            peak = self._all(among, own).max(axis=-1)
            f = own - level
            mixed = np.outer(volume[level], 1.0 - f) + np.outer(
                volume[min(level + 1, self.levels - 1)], f
            )
            out.append(mixed / peak)
        return steps, np.concatenate(out, axis=1).T


def places(size: int, count: int = PLACES) -> npt.NDArray[np.intp]:
    """Texels (P, 3) spread over one face: face, row, column. The others are its images."""
    at = np.minimum((hammersley(count) * size).astype(np.intp), size - 1)
    return np.concatenate([np.full((count, 1), 4, dtype=np.intp), at], axis=1)


@dataclasses.dataclass(frozen=True, eq=False)
class Calibration:
    """Levels and lobes of a filter at one size of cube map, eq. (2).

    Attributes
    ----------
    filter, size : str, int
    levels, volumes : (K,)
        The table: every eighth of a level, and V there [sr], which never falls.
    """

    filter: str
    size: int
    levels: Float64Array
    volumes: Float64Array

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest exponent that the chain has a level for."""
        low, high = 2.0 * np.pi / self.volumes[[-1, 0]] - 1.0
        return float(low), float(high)

    def level(self, exponent: npt.ArrayLike) -> Float64Array:
        """Level (...) whose filtered impulse has the volume of the exponent (...) > -1.

        Exponents beyond ``range`` get the end of the chain; infinity gets 0.
        """
        s = _check.array("exponent", exponent)
        if not np.all(s > -1.0):
            raise _check.fail("exponent", "must be above -1", exponent)
        with np.errstate(divide="ignore"):
            wanted = -np.log(s + 1.0)
        table = np.log(self.volumes / (2.0 * np.pi))
        return np.asarray(np.interp(wanted, table, self.levels))

    def exponent(self, level: npt.ArrayLike) -> Float64Array:
        """Exponent (...) that a level (...) stands for, clamped to the chain."""
        table = np.log(self.volumes)
        volume = np.exp(np.interp(_check.array("level", level), self.levels, table))
        return np.asarray(2.0 * np.pi / volume - 1.0)


@functools.lru_cache(maxsize=32)
def calibrate(filter: str, size: int) -> Calibration:
    """Calibrate a filter at a size of cube map, eq. (2); computed once in a process.

    Parameters
    ----------
    filter : str
        As for ``build_pyramid``.
    size : int
        Texels along a face's edge, a power of two.

    Raises
    ------
    ValueError
        For an unknown filter or a size that is not a power of two.
    """
    _check.choice("filter", filter, FILTERS)
    n = _check.count("size", size)
    if n & (n - 1):
        raise _check.fail("size", "must be a power of two", size)
    white = Impulses(filter, n, places(n))
    levels, volumes = white.table()
    return Calibration(filter, n, levels, np.maximum.accumulate(volumes @ white.weights))
