"""A cube map filtered with radial profiles, fast: broad parts by harmonics, narrow ones by nodes.

Smooth profiles take the harmonics up to the lowest degree that keeps the tolerance (``harmonics``
eq. (2), from the map's own power spectrum: a sun asks for more degrees than a sky). Where the
degrees of the map's table do not suffice, the profile is split by a window about the axis ::

    p = p w + p (1 - w),   w = 1 - x^4 (35 - 84 x + 70 x^2 - 20 x^3),   x = min(a/R, 1)     (1)

and the narrow part is summed over the nodes within R (``exact``), a few texels, while the smooth
rest goes through the harmonics. R starts at ``REACH`` over the number of degrees and grows until
the rest keeps the tolerance. A profile that ends within R is summed whole.

What falls below zero is cut off where neither map nor profile is negative.
"""

import numpy as np
import numpy.typing as npt

from .. import _check
from .._arguments import checked
from ..cubemap import CubeMap, texel_directions
from ..frames import normalise
from .exact import at_angles, checked_profile, filter_directions, parts_for
from .harmonics import MapHarmonics, zonal_factors

TOLERANCE = 1e-3
SAFETY = 0.8  # of the tolerance is for the degrees left out
DEGREES = 384  # of a map's table, at most
PER_TEXEL = 6  # degrees for each texel along a face's edge, up to that
REACH = 8.0
GROWTH = 1.3
FURTHER = 4  # times the table's degrees: how far the factors of a profile are looked at
WINDOW = 257  # nodes across the window

Float64Array = npt.NDArray[np.float64]


def window(x: Float64Array) -> Float64Array:
    """W of eq. (1): 1 at 0, 0 from 1 on, with three continuous derivatives."""
    y = np.clip(x, 0.0, 1.0)
    return np.asarray(1.0 - y**4 * (35.0 - 84.0 * y + 70.0 * y**2 - 20.0 * y**3))


class MapFilter:
    """Filters one cube map with any number of profiles.

    Parameters
    ----------
    cube : CubeMap
        Finite. Its harmonics are made at the first profile.
    tolerance : float in [1e-5, 0.5]
        RMS error over the sphere, relative to the RMS of the filtered map, for each channel. What
        harmonics leave out is bounded by it; interpolation adds some 1e-6, the sum over nodes up to
        1e-4 (profiles with tips or steps narrower than a texel under a sun: 1e-2).

    Raises
    ------
    ValueError
        For a map that is not finite, or a tolerance out of range.
    """

    def __init__(self, cube: CubeMap, tolerance: float = TOLERANCE) -> None:
        if not np.isfinite(cube.faces).all():
            raise _check.fail("cube", "must be finite", "NaN or inf")
        self.cube = cube
        self.tolerance = _check.in_range("tolerance", tolerance, 1e-5, 0.5)
        self._harmonics: MapHarmonics | None = None

    @property
    def harmonics(self) -> MapHarmonics:
        """Of the map, made once."""
        if self._harmonics is None:
            count = min(max(PER_TEXEL * self.cube.size, 32), DEGREES)
            self._harmonics = MapHarmonics(self.cube, count)
        return self._harmonics

    def degrees(self, factors: Float64Array, whole: Float64Array | None = None) -> int | None:
        """Degrees that keep the tolerance, from lambda_l (FURTHER count, C); None if too few.

        ``whole``: the factors that the error is relative to, those of ``factors`` if not given.
        """
        count, power = self.harmonics.count, self.harmonics.power
        own = factors if whole is None else whole
        result = np.sum(np.square(own[:count]) * power[:-1], axis=0)
        left = np.square(factors[:count]) * power[:-1]
        beyond = np.square(factors[count:]).max(axis=0) * power[-1]
        # left out when degrees < k are kept, k = 0 .. count
        tail = np.concatenate([np.cumsum(left[::-1], axis=0)[::-1], np.zeros((1, 3))]) + beyond
        kept = np.flatnonzero(np.all(tail <= (SAFETY * self.tolerance) ** 2 * result, axis=1))
        return max(int(kept[0]), 1) if len(kept) else None

    def _near(
        self, angles: Float64Array, profile: Float64Array, directions: Float64Array
    ) -> Float64Array:
        """The sum over nodes, half as many along an axis where a tolerance of 1e-3 will do."""
        fine = 1 if self.tolerance >= TOLERANCE else 2
        parts = parts_for(self.cube.size, angles, profile, fine)
        return filter_directions(self.cube, angles, profile, directions, parts)

    def filtered(
        self, angles: npt.ArrayLike, profile: npt.ArrayLike, directions: npt.ArrayLike
    ) -> Float64Array:
        """As ``filter_directions``, within the tolerance."""
        a, p = checked_profile(angles, profile)
        axes = normalise(directions)
        flat = axes.reshape(-1, 3)
        count = self.harmonics.count
        factors = zonal_factors(a, p, FURTHER * count)
        degrees, rest, reach = self.degrees(factors), factors, 0.0
        while degrees is None:
            reach = GROWTH * reach if reach else REACH / count
            if reach >= a[-1]:
                return self._near(a, p, axes)
            grid = np.union1d(a, np.linspace(0.0, reach, WINDOW))
            near = at_angles(a, p, grid) * window(grid / reach)[:, None]
            rest = zonal_factors(grid, at_angles(a, p, grid) - near, FURTHER * count)
            degrees = self.degrees(rest, factors)
        out = self.harmonics.filtered(rest[:degrees], flat)
        if reach:
            inside = grid <= reach
            out += self._near(grid[inside], near[inside], flat)
        if self.cube.faces.min() >= 0.0:
            np.maximum(out, 0.0, out=out)
        return out.reshape(axes.shape)


@checked
def filter_map(
    cube: CubeMap,
    angles: npt.ArrayLike,
    profile: npt.ArrayLike,
    size: int,
    tolerance: float | None = TOLERANCE,
) -> Float64Array:
    """The map filtered with a radial profile, (6, size, size, 3) float64.

    ::

        I(r) = int p(angle(r, l)) L(l) dl

    Parameters
    ----------
    cube : CubeMap
    angles : (A,) array
        Nodes of the profile [rad], rising from 0 to at most pi; it is zero beyond the last.
    profile : (A,) or (A, C) array
        Values [1/sr] >= 0, linear between nodes; C = 1 or 3 channels.
    size : int
        Texels along a face's edge of the result.
    tolerance : float or None
        RMS error over the sphere relative to the result's RMS; None sums over all texels, which
        takes some hundred times as long for broad profiles.

    Raises
    ------
    ValueError
        For nodes that do not rise, or a profile that is negative or not finite.
    """
    directions = texel_directions(size)
    if tolerance is None:
        return filter_directions(cube, angles, profile, directions)
    return MapFilter(cube, tolerance).filtered(angles, profile, directions)
