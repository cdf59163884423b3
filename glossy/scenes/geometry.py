"""Geometry of a scene: closest and any hit of many rays at once.

Analytic shapes are met in float64 by brute force, meshes through Embree; what is nearest wins, ties
go to the object named first.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from .._threads import in_rows
from ..frames import dot, normalise
from . import intersect
from .mesh import TriangleMesh
from .shapes import (
    RECTANGLE,
    TORUS,
    Mesh,
    Shape,
    Torus,
    Transform,
    extent,
    inverse,
    kind_of,
    world_bounds,
)

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

OFFSET = 1e-5  # of the scene's diagonal: how far from a surface rays leave it


@dataclasses.dataclass(frozen=True)
class Hits:
    """What rays met first; shape (...) as the rays.

    ``object`` (...): index of the object, -1 for none, where the other fields mean nothing.
    ``distance`` (...), ``position``, unit ``normal`` and ``tangent`` (..., 3): world. Closed
    shapes' normals point outwards, those of rectangles and open meshes to where the ray came from.
    ``uv`` (..., 2) and ``part`` (...): the place in the shape's chart (see ``shapes``). ``front``
    (...): the outside was seen (the side the rectangle's normal points to).
    """

    object: Int64Array
    distance: Float64Array
    position: Float64Array
    normal: Float64Array
    tangent: Float64Array
    uv: Float64Array
    part: Int64Array
    front: BoolArray

    @property
    def found(self) -> BoolArray:
        """Where there is a hit."""
        return self.object >= 0


def _unit(directions: npt.ArrayLike) -> Float64Array:
    """Unit vectors along ``directions``: ``normalise`` where its care is needed, else in one go."""
    d = _check.array("directions", directions).astype(np.float64, copy=False)
    if d.ndim and d.shape[-1] == 3:
        square = dot(d, d)
        if np.all((square > 1e-200) & (square < 1e200)):
            return np.asarray(d / np.sqrt(square)[..., None])
    return normalise(_check.vectors("directions", d))


class Geometry:
    """Shapes in their places, ready for rays.

    Parameters
    ----------
    objects : sequence of (shape, transform)

    Raises
    ------
    ValueError, FileNotFoundError
        For an unusable mesh; the message names the object, ``objects[2].shape``.
    """

    def __init__(self, objects: Sequence[tuple[Shape, Transform]]) -> None:
        count = len(objects)
        self.kinds = np.zeros(count, dtype=np.int64)
        self.ratios = np.zeros(count)
        self.forwards = np.zeros((count, 3, 4))
        self.boxes = np.zeros((count, 2, 3))
        self.meshes: dict[int, TriangleMesh] = {}
        for j, (shape, transform) in enumerate(objects):
            self.kinds[j] = kind_of(shape)
            self.ratios[j] = shape.tube / shape.radius if isinstance(shape, Torus) else 0.0
            self.forwards[j] = transform.matrix(extent(shape))
            if isinstance(shape, Mesh):
                try:
                    self.meshes[j] = TriangleMesh(shape, self.forwards[j])
                except ValueError as error:
                    raise ValueError(f"objects[{j}].shape.{error}") from None
                self.boxes[j] = self.meshes[j].bounds
            else:
                self.boxes[j] = world_bounds(
                    self.forwards[j], int(self.kinds[j]), float(self.ratios[j])
                )
        self.inverses = np.array([inverse(m) for m in self.forwards]).reshape(count, 3, 4)
        half = 0.5 * (self.boxes[:, 1] - self.boxes[:, 0])
        reach = np.square(half).sum(axis=1, keepdims=True) * (1.0 + 1e-9)
        bounds = np.column_stack([self.boxes.mean(axis=1), reach])
        arrays = (self.kinds, self.inverses, self.ratios, bounds)
        self._kinds, self._inverses, self._ratios, self._bounds = (_check.frozen(a) for a in arrays)

    @property
    def diagonal(self) -> float:
        """Length of the diagonal of everything's bounding box; 0 for an empty scene."""
        if not len(self.kinds):
            return 0.0
        return float(np.linalg.norm(self.boxes[:, 1].max(axis=0) - self.boxes[:, 0].min(axis=0)))

    @property
    def offset(self) -> float:
        """How far along the normal a ray should start from a surface."""
        return OFFSET * self.diagonal

    def center(self, index: int) -> Float64Array:
        """(3,) centre of an object's bounding box."""
        return np.asarray(self.boxes[index].mean(axis=0))

    def closed(self, index: int) -> bool:
        """Whether an object has an inside: sphere, box, torus, and a watertight mesh."""
        mesh = self.meshes.get(index)
        return mesh.closed if mesh is not None else bool(self.kinds[index] != RECTANGLE)

    def convex(self, index: int) -> bool:
        """Whether no ray that leaves an object outwards can meet it again."""
        mesh = self.meshes.get(index)
        return mesh.convex if mesh is not None else bool(self.kinds[index] != TORUS)

    def _rays(
        self, origins: npt.ArrayLike, directions: npt.ArrayLike
    ) -> tuple[tuple[int, ...], Float64Array, Float64Array]:
        o, d = _check.array("origins", origins), _unit(directions)
        try:
            shape = np.broadcast_shapes(o.shape, d.shape)
        except ValueError:
            raise _check.fail("origins", f"must broadcast with {d.shape}", o.shape) from None
        if shape[-1] != 3 or not np.all(np.isfinite(o)):
            raise _check.fail("origins", "must be finite, shape (..., 3)", o.shape)
        flat = (np.broadcast_to(a, shape).reshape(-1, 3) for a in (o, d))
        start, along = (_check.frozen(a.astype(np.float64, copy=False)) for a in flat)
        return shape[:-1], start, along

    def intersect(
        self,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        near: float = 0.0,
        far: npt.ArrayLike = np.inf,
        skip: int = -1,
    ) -> Hits:
        """What each ray meets first.

        Parameters
        ----------
        origins, directions : (..., 3) arrays
            Directions of any length; distances are in scene units.
        near, far : float, (...) array
            Hits count at distances between the two.
        skip : int
            Object that is left out.

        Raises
        ------
        ValueError
            For shapes that do not broadcast, or a vector that is zero or not finite.
        """
        shape, o, d = self._rays(origins, directions)
        limit = np.broadcast_to(np.asarray(far, dtype=np.float64), shape).reshape(-1)
        hits = self.cast(o, d, near, limit, skip)

        def shaped(a: npt.NDArray[Any]) -> npt.NDArray[Any]:
            return a.reshape(*shape, *a.shape[1:])

        return Hits(*(shaped(getattr(hits, f.name)) for f in dataclasses.fields(Hits)))

    def cast(
        self,
        o: Float64Array,
        d: Float64Array,
        near: float = 0.0,
        far: npt.ArrayLike = np.inf,
        skip: int = -1,
    ) -> Hits:
        """``intersect`` of rays (K, 3) that are C-ordered, read-only, and of unit length."""
        o, count = _check.frozen(o), len(o)
        limit = np.broadcast_to(np.asarray(far, dtype=np.float64), (count,))
        distance, found = np.empty(count), np.empty(count, dtype=np.int64)
        in_rows(intersect.closest, len(o), o, d, _check.frozen(limit), float(near), skip,
            self._kinds, self._inverses, self._ratios, self._bounds, distance, found, grain=256,
        )  # fmt: skip
        position, normal, tangent = (np.zeros((count, 3)) for _ in range(3))
        uv, part = np.zeros((count, 2)), np.zeros(count, dtype=np.int64)
        front = np.zeros(count, dtype=bool)
        for j, mesh in self.meshes.items():
            if j == skip:
                continue
            rays, t, triangle, place = mesh.closest(o, d, near)
            nearer = (t < distance[rays]) & (t < limit[rays])
            rays, t = rays[nearer], t[nearer]
            distance[rays], found[rays], part[rays] = t, j, triangle[nearer]
            uv[rays] = place[nearer]
        in_rows(
            intersect.details, len(o), o, d, _check.frozen(distance), _check.frozen(found),
            self._kinds,
            _check.frozen(self.forwards), self._inverses, self._ratios,
            position, normal, tangent, uv, part, front, grain=256,
        )  # fmt: skip
        for j, mesh in self.meshes.items():
            rays = np.flatnonzero(found == j)
            if len(rays):
                position[rays] = o[rays] + distance[rays, None] * d[rays]
                frame = mesh.frame(part[rays], uv[rays], d[rays])
                normal[rays], tangent[rays], front[rays] = frame
        return Hits(found, distance, position, normal, tangent, uv, part, front)

    def analytic_distances(self, o: Float64Array, d: Float64Array) -> Float64Array:
        """Distance (K,) to what rays as ``cast`` takes them meet first, meshes left out; inf."""
        distance, found = np.empty(len(o)), np.empty(len(o), dtype=np.int64)
        far = _check.frozen(np.broadcast_to(np.inf, (len(o),)))
        in_rows(intersect.closest, len(o), o, d, far, 0.0, -1,
            self._kinds, self._inverses, self._ratios, self._bounds, distance, found, grain=256,
        )  # fmt: skip
        return distance

    def occluded(
        self,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        far: npt.ArrayLike = np.inf,
        near: float = 0.0,
        skip: int = -1,
    ) -> BoolArray:
        """Whether each ray meets anything between ``near`` and ``far``, (...) bool.

        Arguments as for ``intersect``.
        """
        shape, o, d = self._rays(origins, directions)
        limit = np.broadcast_to(np.asarray(far, dtype=np.float64), shape).reshape(-1)
        return self.blocked(o, d, limit, near, skip).reshape(shape)

    def blocked(
        self,
        o: Float64Array,
        d: Float64Array,
        far: npt.ArrayLike = np.inf,
        near: float = 0.0,
        skip: int = -1,
    ) -> BoolArray:
        """``occluded`` for rays as ``cast`` takes them."""
        limit = np.broadcast_to(np.asarray(far, dtype=np.float64), (len(o),))
        out = np.zeros(len(o), dtype=bool)
        in_rows(intersect.blocked, len(o), o, d, _check.frozen(limit), float(near), skip,
            self._kinds, self._inverses, self._ratios, self._bounds, out, grain=256,
        )  # fmt: skip
        for j, mesh in self.meshes.items():
            if j == skip:
                continue
            left = np.flatnonzero(~out)
            rays, t, _, _ = mesh.closest(o[left], d[left], near)
            out[left[rays[t < limit[left[rays]]]]] = True
        return out
