"""What arrives at surface points in a room of bounding planes: lookup and sampling, in NumPy.

The definition of ``planes`` step by step: a ray meets every plane at some distance, the nearest in
front is kept, and the map is looked up from its centre towards that hit::

    L(x, w) = cube(w'(x, w))                                                                (1)

instead of cube(w) is what the estimators integrate. Lamps are drawn as the map holds them: a
direction v of density p_e meets its nearest plane in h, seen from the centre c, and leads from the
point along w = (h - x) / |h - x|. Per solid angle at the point that is, summed over the planes ::

    p(w) = sum p_e(v) |h - x|^2 |v.n| / (|h - c|^2 |w.n|)                                   (2)

A direction v that meets nothing is kept, w = v.
"""

import numpy as np
import numpy.typing as npt

from ..cubemap import CubeMap
from ..frames import dot
from ..planes import BoundingPlanes
from .environment import EnvironmentSampler

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


class PlaneLight:
    """Radiance, draws and density at points (K, 3); directions are (K, S, 3)."""

    def __init__(self, cube: CubeMap, planes: BoundingPlanes, position: Float64Array) -> None:
        self.cube, self.planes, self.position = cube, planes, position
        self.sampler = EnvironmentSampler(cube)
        self.centre = np.asarray(planes.centre)

    def at(self, pick: slice) -> "PlaneLight":
        """The same light at some of the points."""
        part = object.__new__(PlaneLight)
        part.__dict__.update(self.__dict__, position=self.position[pick])
        return part

    def distances(self, origin: Float64Array, w: Float64Array) -> Float64Array:
        """Distances (..., M) from ``origin`` along unit ``w`` (..., 3), inf behind or never."""
        normals = self.planes.normals
        to_plane = dot((self.planes.points - origin[..., None, :]), normals)
        slope = w @ normals.T
        with np.errstate(divide="ignore", invalid="ignore"):
            away = to_plane / slope
        return np.where((away > 0.0) & np.isfinite(away), away, np.inf)

    def redirect(self, w: Float64Array) -> Float64Array:
        """W' of the points (K, S, 3), of any length."""
        x = np.broadcast_to(self.position[:, None, :], w.shape)
        away = self.distances(x, w)
        k = self.planes.width
        if k == 0.0:
            nearest = away.min(axis=-1, initial=np.inf)[..., None]
            met = np.isfinite(nearest)
            hit = x + np.where(met, nearest, 0.0) * w
            return np.asarray(np.where(met, hit - self.centre, w))
        normals = self.planes.normals
        to_plane = dot((self.planes.points - x[..., None, :]), normals)
        slopes = w @ normals.T
        flat = to_plane == 0.0
        signed = np.where(flat, 0.0, slopes / np.where(flat, 1.0, to_plane))
        q = np.zeros(w.shape[:-1])
        for i in range(signed.shape[-1]):
            a, b = signed[..., i], q
            q = np.maximum(a, b) + np.maximum(0.0, k - np.abs(a - b)) ** 2 / (4.0 * k)
        return np.asarray(w + q[..., None] * (x - self.centre))

    def lookup(self, w: Float64Array) -> Float64Array:
        """Radiance (K, S, 3), eq. (1)."""
        return self.cube.lookup(self.redirect(w))

    def sample(self, u: Float64Array) -> Float64Array:
        """Unit directions (K, S, 3) for uniform numbers (K, S, 2)."""
        v = self.sampler.sample(u)
        away = self.distances(np.broadcast_to(self.centre, v.shape), v)
        nearest = away.min(axis=-1, initial=np.inf)[..., None]
        met = np.isfinite(nearest)
        hit = self.centre + np.where(met, nearest, 0.0) * v
        w = np.where(met, hit - self.position[:, None, :], v)
        length = np.sqrt(dot(w, w))[..., None]
        return np.where(length > 0.0, w / np.where(length > 0.0, length, 1.0), v)

    def pdf(self, w: Float64Array) -> Float64Array:
        """Density [1/sr] (K, S) of ``sample`` at unit directions (K, S, 3), the sum of eq. (2)."""
        x = np.broadcast_to(self.position[:, None, :], w.shape)
        away = self.distances(x, w)
        unmet = np.isinf(self.distances(np.broadcast_to(self.centre, w.shape), w)).all(axis=-1)
        total = np.where(unmet, self.sampler.pdf(w), 0.0)
        for i, normal in enumerate(self.planes.normals):
            met = np.isfinite(away[..., i])
            s = np.where(met, away[..., i], 1.0)
            v = x + s[..., None] * w - self.centre
            length = np.sqrt(dot(v, v))
            met &= length > 0.0
            v = np.where(met[..., None], v, w) / np.where(met, length, 1.0)[..., None]
            seen = self.distances(np.broadcast_to(self.centre, v.shape), v)
            met &= seen[..., i] <= seen.min(axis=-1) * (1.0 + 1e-9)
            slope_v, slope_w = np.abs(v @ normal), np.abs(w @ normal)
            ratio = (s / np.where(met, length, 1.0)) ** 2 * slope_v / np.where(met, slope_w, 1.0)
            total += np.where(met, self.sampler.pdf(v) * ratio, 0.0)
        return total
