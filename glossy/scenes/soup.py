"""Triangles as a mesh file has them, before anything is made of them."""

import dataclasses

import numpy as np
import numpy.typing as npt

MOST_EARS = 1000  # corners of a face with dents: finding its ears takes up to their cube

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]


@dataclasses.dataclass(frozen=True, eq=False)
class Soup:
    """``points`` (V, 3), ``triangles`` (T, 3), and ``normals`` (V, 3), NaN where the file has none.

    Raises
    ------
    ValueError
        If a triangle names a vertex that is not there.
    """

    points: Float64Array
    triangles: Int64Array
    normals: Float64Array | None = None

    def __post_init__(self) -> None:
        index, count = self.triangles, len(self.points)
        if index.size and (index.min() < 0 or index.max() >= count):
            worst = int(index.min() if index.min() < 0 else index.max())
            raise ValueError(f"a face names vertex {worst}, of {count} that count from 0")


def fan(lengths: Int64Array, corners: Int64Array) -> Int64Array:
    """Triangles (T, 3) of polygons about their first corners.

    ``lengths``: corners of each polygon; ``corners``: those of all, one after the other.
    """
    start, each = np.cumsum(lengths) - lengths, np.maximum(lengths - 2, 0)
    first = np.repeat(start, each)
    step = np.arange(len(first)) - np.repeat(np.cumsum(each) - each, each)
    return np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], axis=1)


def cut(points: Float64Array, lengths: Int64Array, corners: Int64Array) -> Int64Array:
    """Triangles (T, 3) of polygons: ``fan``, but by their ears where a fan leaves the polygon.

    It does where one of its triangles faces against their sum, Newell's normal of the polygon.

    Raises
    ------
    ValueError
        For such a polygon of more than ``MOST_EARS`` corners.
    """
    triangles = fan(lengths, corners)
    if len(triangles) in (0, int(np.count_nonzero(lengths == 3))):
        return triangles
    if triangles.min() < 0 or triangles.max() >= len(points):
        return triangles  # which ``Soup`` refuses
    owner = np.repeat(np.arange(len(lengths)), np.maximum(lengths - 2, 0))
    a, b, c = (points[triangles[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    normal = np.zeros((len(lengths), 3))
    np.add.at(normal, owner, face)
    dented = np.unique(owner[np.einsum("tx,tx->t", face, normal[owner]) < 0.0])
    start = np.cumsum(lengths) - lengths
    parts = [triangles[~np.isin(owner, dented)]]
    for k in dented:
        if lengths[k] > MOST_EARS:
            raise ValueError(f"a face with dents has {lengths[k]} corners, at most {MOST_EARS}")
        named = corners[start[k] : start[k] + lengths[k]]
        drop = int(np.argmax(np.abs(normal[k])))
        axes = [(drop + 1) % 3, (drop + 2) % 3][:: 1 if normal[k, drop] > 0.0 else -1]
        parts.append(named[_ears(points[named][:, axes])])
    return np.concatenate(parts)


def _ears(flat: Float64Array) -> Int64Array:
    """Triangles (n - 2, 3) of a polygon (n, 2) that runs counter-clockwise."""
    left, found = list(range(len(flat))), []

    def is_ear(k: int) -> bool:
        a, b, c = corners = flat[[left[k - 1], left[k], left[(k + 1) % len(left)]]]
        if not _side(a, b, c[None])[0] > 0.0:
            return False
        others = flat[left]
        others = others[~(others[:, None] == corners).all(axis=-1).any(axis=1)]
        inside = [_side(p, q, others) >= 0.0 for p, q in ((a, b), (b, c), (c, a))]
        return not np.logical_and.reduce(inside).any()

    while len(left) > 3:
        k = next((k for k in range(len(left)) if is_ear(k)), 0)  # none: it meets itself
        found.append((left[k - 1], left[k], left[(k + 1) % len(left)]))
        del left[k]
    return np.array([*found, tuple(left)], dtype=np.int64)


def _side(a: Float64Array, b: Float64Array, points: Float64Array) -> Float64Array:
    # twice the area of a, b and each point, positive to the left
    along, across = b - a, points - a
    return np.asarray(along[0] * across[:, 1] - along[1] * across[:, 0])
