"""Triangle meshes in the world: rays through Embree, which comes with the extra ``mesh``.

Embree answers in float32 which triangle a ray meets first; where on it is then solved in float64,
so a hit point lies on the triangle's plane to rounding.
"""

import functools
import importlib.util
import os
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from .._files import check_regular
from .._threads import in_rows
from ..frames import dot
from .intersect import meets_box
from .mesh_files import read_mesh
from .shapes import Mesh
from .topology import LARGEST, Surface, surface

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

FLATNESS = 1e-6  # of the extent: how far off a plane counts as on it
BAND = 64  # triangles looked at together


class TriangleMesh:
    """A mesh in the world: ``vertices`` (V, 3), ``triangles`` (T, 3), unit ``normals`` (V, 3).

    Parameters
    ----------
    shape : Mesh
    matrix : (3, 4) array
        To the world.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is damaged or holds no triangles, or Embree is not installed.
    """

    def __init__(self, shape: Mesh, matrix: Float64Array) -> None:
        if importlib.util.find_spec("embreex") is None:
            rule = "needs the extra 'mesh' (pip install 'glossy-envmap[mesh]')"
            raise ValueError(f"shape: a mesh {rule}: embreex is not installed")
        size = check_regular(shape.file)
        found = _read(shape.file, (os.stat(shape.file).st_mtime_ns, size))
        self.triangles, self.closed = found.triangles, found.closed
        self.smooth = shape.smooth
        self.vertices = found.vertices @ matrix[:, :3].T + matrix[:, 3]
        if not np.all(np.abs(self.vertices) <= LARGEST):
            rule = f"must place its corners within {LARGEST:g} of the origin"
            raise _check.fail("transform", rule, shape.file)
        turned = found.normals @ np.linalg.inv(matrix[:, :3])
        length = np.linalg.norm(turned, axis=1, keepdims=True)
        self.normals = turned / np.where(length > 0.0, length, 1.0)
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        self.corner, self.edge1, self.edge2 = a, b - a, c - a
        self.face = np.cross(self.edge1, self.edge2)
        self.up = matrix[:, 1] / np.linalg.norm(matrix[:, 1])

    @functools.cached_property
    def bounds(self) -> Float64Array:
        """(2, 3) lowest and highest coordinates."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @functools.cached_property
    def convex(self) -> bool:
        """Closed, or flat, and all on one side of every triangle's plane."""
        slack = FLATNESS * float(np.ptp(self.bounds, axis=0).max())
        length = np.linalg.norm(self.face, axis=1)
        rows = np.flatnonzero(length > 0.0)
        for start in range(0, len(rows), BAND):
            part = rows[start : start + BAND]
            axis = self.face[part] / length[part, None]
            away = self.vertices @ axis.T - dot(self.corner[part], axis)
            high, low = away.max(axis=0) > slack, away.min(axis=0) < -slack
            if np.any(high & low) or not (self.closed or not np.any(high | low)):
                return False
        return True

    @functools.cached_property
    def _run(self) -> Callable[..., Any]:
        from embreex.mesh_construction import TriangleMesh as Triangles
        from embreex.rtcore_scene import EmbreeScene

        scene = EmbreeScene()
        vertices, triangles = self.vertices.astype(np.float32), self.triangles.astype(np.int32)
        kept = Triangles(scene, vertices, triangles)
        return functools.partial(_query, scene, kept)

    def _candidates(self, origins: Float64Array, directions: Float64Array) -> Int64Array:
        """Rays that meet the bounding box."""
        low, high = self.bounds
        pad = 1e-6 * float(np.max(np.abs([low, high])))
        out = np.empty(len(origins), dtype=bool)
        box = _check.frozen(np.stack([low - pad, high + pad]))
        in_rows(
            meets_box,
            len(origins),
            _check.frozen(origins),
            _check.frozen(directions),
            box,
            out,
            grain=1024,
        )
        return np.flatnonzero(out)

    def closest(
        self, origins: Float64Array, directions: Float64Array, near: float
    ) -> tuple[Int64Array, Float64Array, Int64Array, Float64Array]:
        """Rays that hit (K,), their t, triangle and barycentric coordinates (K, 2)."""
        rays = self._candidates(origins, directions)
        triangle = np.asarray(self._run(origins[rays], directions[rays], near), dtype=np.int64)
        rays, triangle = rays[triangle >= 0], triangle[triangle >= 0]
        d, away = directions[rays], origins[rays] - self.corner[triangle]
        e1, e2, n = self.edge1[triangle], self.edge2[triangle], self.face[triangle]
        across = -dot(d, n)
        across = np.where(np.abs(across) > 1e-300, across, 1e-300)
        t = dot(away, n) / across
        side = np.cross(away, d)
        uv = np.stack([dot(side, e2), -dot(side, e1)], axis=-1) / across[:, None]
        uv = np.clip(uv, 0.0, 1.0)
        uv /= np.maximum(uv.sum(axis=-1, keepdims=True), 1.0)
        return rays, t, triangle, uv

    def frame(
        self, triangle: Int64Array, uv: Float64Array, directions: Float64Array
    ) -> tuple[Float64Array, Float64Array, BoolArray]:
        """Normal, tangent (K, 3), and whether the outside is seen (by the winding).

        A closed mesh's normal points outwards, an open one's to where the ray comes from.
        """
        flat = self.face[triangle]
        front = dot(flat, directions) < 0.0
        if self.smooth:
            corners = self.normals[self.triangles[triangle]]
            w = np.column_stack([1.0 - uv.sum(axis=-1), uv])
            normal = np.einsum("kc,kcx->kx", w, corners)
            bad = dot(normal, flat) <= 0.0
            normal[bad] = flat[bad]
        else:
            normal = flat.copy()
        normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-300)
        if not self.closed:
            normal[~front] *= -1.0
        tangent = np.cross(self.up, normal)
        length = np.linalg.norm(tangent, axis=-1)
        pole = length < 1e-9
        other = np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
        tangent[pole] = np.cross(normal[pole], np.cross(other[pole], normal[pole]))
        return normal, tangent / np.linalg.norm(tangent, axis=-1, keepdims=True), front


def _query(
    scene: Any, _kept: Any, origins: Float64Array, directions: Float64Array, near: float
) -> Any:
    """Triangle met first beyond ``near``, -1 for none: the rays start there."""
    if len(origins) == 0:
        return np.empty(0, dtype=np.int64)
    start = (origins + near * directions).astype(np.float32)
    return scene.run(start, directions.astype(np.float32))


@functools.lru_cache(maxsize=16)
def _read(file: str, _changed: tuple[int, int]) -> Surface:
    """The surface of a mesh file, read once as long as it stays the same."""
    return surface(read_mesh(file), file)
