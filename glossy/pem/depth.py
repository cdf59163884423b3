"""Depth maps of a scene as distant lights see it: orthographic, one per light.

With c and R the centre and radius of the scene's bounding sphere, and (u, v, l) a right-handed
frame whose l points to the light, a place x has the coordinates ::

    a = (x - c).u / R,  b = (x - c).v / R,  z = -(x - c).l / R,   all in [-1, 1]           (1)

z grows away from the light. Texel (row j, column i) of S x S looks along b = (2j + 1)/S - 1,
a = (2i + 1)/S - 1 and holds the z that it meets first, 1 where it meets nothing. Triangles are
rasterised, the other shapes met by rays.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import row_kernel
from .._threads import in_rows
from ..scenes.geometry import Geometry

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]

FAR = 1.0  # depth where nothing is met


@dataclasses.dataclass(frozen=True)
class LightSpace:
    """The coordinates of eq. (1): ``centre`` (3,), ``radius``, ``frames`` (R, 3, 3) of u, v, l."""

    centre: Float64Array
    radius: float
    frames: Float64Array

    def of(self, position: Float64Array) -> Float64Array:
        """(R, K, 3): a, b, z of places (K, 3) for every light."""
        out = np.einsum("kx,rax->rka", (position - self.centre) / self.radius, self.frames)
        out[..., 2] *= -1.0
        return np.asarray(out)


def light_frames(directions: Float64Array) -> Float64Array:
    """(R, 3, 3) rows u, v, l for unit directions l (R, 3), without a direction where they break.

    Source: Duff et al. 2017, the branch by the sign of z.
    """
    x, y, z = directions.T
    sign = np.where(z < 0.0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    u = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    v = np.stack([b, sign + y * y * a, -y], axis=-1)
    return np.stack([u, v, directions], axis=1)


def light_space(geometry: Geometry, directions: npt.ArrayLike) -> LightSpace:
    """The coordinates that lights along ``directions`` (R, 3) see a scene in.

    Raises
    ------
    ValueError
        For directions of another shape, or a scene of nothing.
    """
    light = _check.unit_vectors("directions", directions)
    if light.ndim != 2:
        raise _check.fail("directions", "must have shape (lights, 3)", light.shape)
    if geometry.diagonal == 0.0:
        raise _check.fail("geometry", "must hold something that casts shadows", "nothing")
    low, high = geometry.boxes[:, 0].min(axis=0), geometry.boxes[:, 1].max(axis=0)
    return LightSpace(0.5 * (low + high), 0.5 * geometry.diagonal, light_frames(light))


@row_kernel
def _rasterise(
    begin: int, end: int, corners: Float64Array, frames: Float64Array, depth: Float32Array
) -> None:
    # (T, 3, 3) triangles in units of eq. (1), (R, 3, 3), (R, S, S): nearer z are written
    size = depth.shape[1]
    half = 0.5 * size
    for r in range(begin, end):
        p = np.empty((3, 3))
        for k in range(corners.shape[0]):
            for c in range(3):
                for axis in range(3):
                    p[c, axis] = (
                        corners[k, c, 0] * frames[r, axis, 0]
                        + corners[k, c, 1] * frames[r, axis, 1]
                        + corners[k, c, 2] * frames[r, axis, 2]
                    )
            x0, x1, x2 = half * (p[0, 0] + 1.0), half * (p[1, 0] + 1.0), half * (p[2, 0] + 1.0)
            y0, y1, y2 = half * (p[0, 1] + 1.0), half * (p[1, 1] + 1.0), half * (p[2, 1] + 1.0)
            area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
            if area == 0.0:
                continue
            first = max(int(np.ceil(min(y0, y1, y2) - 0.5)), 0)
            last = min(int(np.floor(max(y0, y1, y2) - 0.5)), size - 1)
            left = max(int(np.ceil(min(x0, x1, x2) - 0.5)), 0)
            right = min(int(np.floor(max(x0, x1, x2) - 0.5)), size - 1)
            for j in range(first, last + 1):
                y = j + 0.5
                for i in range(left, right + 1):
                    x = i + 0.5
                    w1 = ((x - x0) * (y2 - y0) - (x2 - x0) * (y - y0)) / area
                    w2 = ((x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)) / area
                    if w1 < 0.0 or w2 < 0.0 or w1 + w2 > 1.0:
                        continue
                    z = -(p[0, 2] + w1 * (p[1, 2] - p[0, 2]) + w2 * (p[2, 2] - p[0, 2]))
                    if z < depth[r, j, i]:
                        depth[r, j, i] = z


def depth_maps(geometry: Geometry, space: LightSpace, size: int) -> Float32Array:
    """Depths (R, S, S) of a scene for every light, eq. (1)."""
    count = len(space.frames)
    depth = np.full((count, size, size), FAR, dtype=np.float32)
    for mesh in geometry.meshes.values():
        corners = np.stack(
            [mesh.corner, mesh.corner + mesh.edge1, mesh.corner + mesh.edge2], axis=1
        )
        corners = (corners - space.centre) / space.radius
        in_rows(
            _rasterise,
            len(space.frames),
            _check.frozen(corners),
            _check.frozen(space.frames),
            depth,
        )
    if len(geometry.meshes) == len(geometry.kinds):
        return depth
    across = (np.arange(size) + 0.5) * (2.0 / size) - 1.0
    b, a = np.meshgrid(across, across, indexing="ij")
    start = 2.0  # radii from the centre: before everything
    for r, (u, v, light) in enumerate(space.frames):
        plane = a[..., None] * u + b[..., None] * v + start * light
        origin = (space.centre + space.radius * plane).reshape(-1, 3)
        ray = np.broadcast_to(-light, origin.shape)
        met = geometry.analytic_distances(_check.frozen(origin), _check.frozen(ray))
        z = (met / space.radius - start).reshape(size, size)
        np.minimum(depth[r], z.astype(np.float32), out=depth[r])
    return depth
