"""A radially symmetric lobe, followed over the elevations of the view.

A slice of an isotropic BRDF, seen from theta_o, becomes a profile p over the angle a to an axis.
Slices are linear in cos theta_o, profiles linear in a, and the axis turns with the view::

    q(wi, wo) = weight(cos_o) p(angle(wi, axis(wo)); cos_o)                             (1)
    axis      = polar angle theta_o + theta_offset, azimuth phi_o + pi + phi_offset      (2)

Zero offsets are the reflected direction. The estimate of the reflected light is an integral over
the whole sphere, since a map filtered in advance does not know the horizon ::

    L = (n.r) int q L dw   where q stands for f (M eq. 2)                                (3)
    L =       int q L dw   where q stands for f cos theta_i

and (n.r) = cos theta_o. A radiance of 1 everywhere gives the lobe's share of the albedo::

    int p dw = 2 pi sum_k p_k int hat_k(a) sin a da = sum_k p_k omega_k                  (4)

Source (M): Kautz and McCool 2000, "Approximation of Glossy Reflection with Prefiltered Environment
Maps", sections 3 and 4; plain solid angle for its "projected" one.
"""

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from .. import _check
from ..frames import dot, spherical

Float64Array = npt.NDArray[np.float64]


def ring_solid_angles(angles: npt.ArrayLike) -> Float64Array:
    """Solid angles omega (A,) [sr] of the nodes' hat functions about an axis, eq. (4).

    ``angles`` (A,) rise from 0 to at most pi; those that end at pi have solid angles of 4 pi in
    all.
    """
    a = _check.array("angles", angles).astype(np.float64)
    step = np.diff(a)
    # int (x - a0)/step sin x dx and its mirror image, as sines of half the step: no cancellation
    half = 0.5 * step
    mid = 0.5 * (a[1:] + a[:-1])
    sinc = np.sinc(half / math.pi)  # sin(half)/half
    both = step * np.sin(mid) * sinc  # cos a0 - cos a1
    # odd part: int (x - mid)/step sin x dx = cos(mid) (sin(half) - half cos(half)) 2 / step
    small = half < 1e-2
    series = half**2 / 3.0 * (1.0 - half**2 / 10.0)
    direct = sinc - np.cos(half)
    odd = np.cos(mid) * np.where(small, series, direct)
    out = np.zeros(len(a))
    out[:-1] += 0.5 * both - odd
    out[1:] += 0.5 * both + odd
    return 2.0 * math.pi * out


def _rising(name: str, value: npt.ArrayLike) -> Float64Array:
    """A vector of rising finite numbers."""
    a = _check.array(name, value).astype(np.float64)
    if a.ndim != 1 or not len(a) or not np.isfinite(a).all() or np.any(np.diff(a) <= 0.0):
        raise _check.fail(name, "must be a vector of rising finite numbers", value)
    return a


def _cosines(name: str, value: npt.ArrayLike) -> Float64Array:
    c = _rising(name, value)
    if c[0] <= 0.0 or c[-1] > 1.0:
        raise _check.fail(name, "must lie in (0, 1]", c.tolist())
    return c


def _shaped(name: str, value: npt.ArrayLike, shape: tuple[int | None, ...]) -> Float64Array:
    """Finite numbers of a shape, where None stands for 1 or 3 channels."""
    a = _check.array(name, value).astype(np.float64)
    fits = a.ndim == len(shape) and all(
        n == want or (want is None and n in (1, 3)) for n, want in zip(a.shape, shape, strict=True)
    )
    if not fits:
        rule = ", ".join("1 or 3" if n is None else str(n) for n in shape)
        raise _check.fail(name, f"must have shape ({rule})", a.shape)
    if not np.isfinite(a).all():
        raise _check.fail(name, "must be finite", float(a[~np.isfinite(a)][0]))
    return a


def _not_negative(name: str, a: Float64Array) -> Float64Array:
    if a.size and a.min() < 0.0:
        raise _check.fail(name, "must not be negative", float(a.min()))
    return a


@dataclasses.dataclass(frozen=True, eq=False)
class LobeStack:
    """One lobe over the elevations of the view, eqs. (1) and (2).

    Parameters
    ----------
    cosines : (E,) array
        cos theta_o of the slices, rising within (0, 1].
    angles : (A,) array
        Nodes of the profiles [rad], rising from 0 to at most pi. Beyond the last a profile is 0.
    profiles : (E, A, C) array
        Values [1/sr] >= 0, C = 1 or 3 channels. One slice (E = 1) for a lobe of one shape.
    view_cosines : (K,) array
        cos theta_o of the nodes of weight and offsets; a lobe of one shape has more of them than
        slices.
    weights : (K, C) array
        Factors >= 0 of the profile.
    theta_offset, phi_offset : (K,) array
        Axis minus reflected direction [rad]: polar angle and azimuth. A polar angle below zero is
        one on the side of the viewer.
    cosine_outside : bool
        True: the lobe stands for f, and (n.r) is a factor of the estimate; False: for f cos
        theta_i, eq. (3).

    Raises
    ------
    ValueError
        For a wrong shape, nodes that do not rise or lie outside their range, values that are
        negative or not finite.

    Notes
    -----
    Between nodes everything is linear, and constant before the first and after the last.
    """

    cosines: Float64Array
    angles: Float64Array
    profiles: Float64Array
    view_cosines: Float64Array
    weights: Float64Array
    theta_offset: Float64Array
    phi_offset: Float64Array
    cosine_outside: bool

    def __post_init__(self) -> None:
        cosines = _cosines("cosines", self.cosines)
        views = _cosines("view_cosines", self.view_cosines)
        angles = _rising("angles", self.angles)
        if len(angles) < 2 or angles[0] != 0.0 or angles[-1] > math.pi + 1e-12:
            raise _check.fail("angles", "must rise from 0 to at most pi", angles.tolist())
        e, a, k = len(cosines), len(angles), len(views)
        profiles = _not_negative("profiles", _shaped("profiles", self.profiles, (e, a, None)))
        channels = profiles.shape[-1]
        weights = _not_negative("weights", _shaped("weights", self.weights, (k, channels)))
        offsets = [_shaped(n, getattr(self, n), (k,)) for n in ("theta_offset", "phi_offset")]
        if not isinstance(self.cosine_outside, bool | np.bool_):
            raise _check.fail("cosine_outside", "must be True or False", self.cosine_outside)
        values = (cosines, angles, profiles, views, weights, *offsets)
        names = [f.name for f in dataclasses.fields(self)]
        for name, value in zip(names[:-1], values, strict=True):
            object.__setattr__(self, name, _check.frozen(value.copy()))

    @property
    def channels(self) -> int:
        """1 or 3."""
        return int(self.profiles.shape[-1])

    def slice_at(self, cosine: npt.ArrayLike) -> tuple[npt.NDArray[np.intp], Float64Array]:
        """Slices between which views lie: the lower index (...) and the share (...) of the upper.

        A single slice has index 0 and share 0 everywhere.
        """
        c = _check.array("cosine", cosine).astype(np.float64)
        at = np.interp(c, self.cosines, np.arange(len(self.cosines)))
        low = np.minimum(at.astype(np.intp), max(len(self.cosines) - 2, 0))
        return low, np.asarray(at - low)

    def weight(self, cosine: npt.ArrayLike) -> Float64Array:
        """Factor (..., C) at cos theta_o (...)."""
        c = _check.array("cosine", cosine).astype(np.float64)
        columns = [np.interp(c, self.view_cosines, w) for w in self.weights.T]
        return np.stack(columns, axis=-1)

    def axis(self, wo: npt.ArrayLike) -> Float64Array:
        """Directions (..., 3) of the axis in the local frame, eq. (2), for unit ``wo`` (..., 3).

        For ``wo`` along the normal the azimuth counts as 0.
        """
        o = _check.unit_vectors("wo", wo)
        theta = np.arctan2(np.hypot(o[..., 0], o[..., 1]), o[..., 2])
        phi = np.arctan2(o[..., 1], o[..., 0])
        polar = theta + np.interp(o[..., 2], self.view_cosines, self.theta_offset)
        turn = np.interp(o[..., 2], self.view_cosines, self.phi_offset)
        return spherical(polar, phi + math.pi + turn)

    def factor(self, wo: npt.ArrayLike) -> Float64Array:
        """What stands before the integral of eq. (3), (...): n.r, or 1."""
        o = _check.unit_vectors("wo", wo)
        return np.maximum(o[..., 2], 0.0) if self.cosine_outside else np.ones(o.shape[:-1])

    def evaluate(self, wi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
        """Eq. (1) [1/sr], (..., C), for unit directions (..., 3) in the local frame.

        It stands for f or for f cos theta_i, see ``cosine_outside``; ``wi`` below the horizon is
        not cut off. Views below the horizon give zero.
        """
        i, o = _check.unit_vectors("wi", wi), _check.unit_vectors("wo", wo)
        i, o = np.broadcast_arrays(i, o)
        axis = self.axis(o)
        cross = np.linalg.norm(np.cross(i, axis), axis=-1)
        angle = np.arctan2(cross, dot(i, axis))
        at = np.interp(angle, self.angles, np.arange(len(self.angles)))
        k = np.minimum(at.astype(np.intp), len(self.angles) - 2)
        g = (at - k)[..., None]
        low, f = self.slice_at(o[..., 2])
        high = np.minimum(low + 1, len(self.cosines) - 1)
        rows = [(1.0 - g) * self.profiles[e, k] + g * self.profiles[e, k + 1] for e in (low, high)]
        value = (1.0 - f)[..., None] * rows[0] + f[..., None] * rows[1]
        inside = (angle <= self.angles[-1]) & (o[..., 2] > 0.0)
        return np.asarray(np.where(inside[..., None], self.weight(o[..., 2]) * value, 0.0))

    def volumes(self) -> Float64Array:
        """Integral (E, C) of every slice's profile over the sphere, eq. (4), without weights."""
        omega = ring_solid_angles(self.angles)
        return np.asarray(np.einsum("eac,a->ec", self.profiles, omega))

    def furnace(self, wo: npt.ArrayLike) -> Float64Array:
        """What eq. (3) gives for a radiance of 1 everywhere, (..., C)."""
        o = _check.unit_vectors("wo", wo)
        low, f = self.slice_at(o[..., 2])
        high = np.minimum(low + 1, len(self.cosines) - 1)
        volumes = self.volumes()
        volume = (1.0 - f)[..., None] * volumes[low] + f[..., None] * volumes[high]
        up = (o[..., 2] > 0.0)[..., None]
        return np.asarray(self.factor(o)[..., None] * self.weight(o[..., 2]) * volume * up)
