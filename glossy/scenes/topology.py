"""What a file's triangles enclose: corners that meet, whether they close, which side is out.

Corners meet where their coordinates are equal (0 and -0 are), whatever indices a file gives them:
an STL repeats every corner, an OBJ one for each normal. No tolerance: a gap is a gap. A triangle
with two corners in one place is left out, as is the second of two on the same corners if it is
wound alike or if all triangles of its part are so doubled (a sheet with two sides).

A mesh is closed if each edge is passed as often one way as the other. Its outside is then where
its volume is positive, and what is wound inside out is turned; a part within another may be a
cavity and stays as it is.
"""

import dataclasses
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .. import _memory
from ..frames import dot
from .soup import Soup

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

LARGEST = 1e12  # coordinate: triple products of single precision end at its cube
BYTES = 800  # that a triangle takes while this is found out
TESTED = 100_000_000  # pairs of a part and a triangle about it that are looked at
SMALL = 1e-8  # angle [rad] of a triangle that has no normal; share of a sum that cancels


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """``vertices`` and unit ``normals`` (V, 3), ``triangles`` (T, 3), and whether it is ``closed``.

    Vertices are the places and normals that differ, in the file's order.
    """

    vertices: Float64Array
    triangles: Int64Array
    normals: Float64Array
    closed: bool


def surface(soup: Soup, file: str) -> Surface:
    """The surface of a file's triangles; ``file`` is for messages.

    Normals of the file are kept, so that its creases stay; without them a vertex has the mean of
    the triangles about its place, by their angles there.

    Raises
    ------
    ValueError
        Without triangles, or with corners that are not finite or too far out.
    """
    _memory.check(f"file: {file!r}", BYTES * len(soup.triangles) + 100 * len(soup.points))
    points = soup.points + 0.0  # -0 is 0
    first, label = _groups(points)
    points = points[first]
    triangles, given = _reduced(label[soup.triangles], soup.triangles)
    used = points[triangles]
    if not len(triangles) or not np.all(np.abs(used) <= LARGEST):
        found = f"{len(triangles)} triangles" if len(triangles) else "none"
        rule = f"must hold triangles with finite corners within {LARGEST:g} of the origin"
        raise ValueError(f"file: {rule}, got {found} in {file!r}")
    closed, mixed = _edges(triangles)
    if mixed:
        text = "triangles side by side are wound opposite ways; taken for open, smooth normals fail"
        warnings.warn(f"{file}: {text}", stacklevel=2)
    if closed:
        turned = _inside_out(points[triangles], _parts(triangles), file)
        if turned.any():
            text = (
                f"{int(turned.sum())} of {len(turned)} triangles are wound inside out, and turned"
            )
            warnings.warn(f"{file}: {text}", stacklevel=2)
            triangles[turned], given[turned] = triangles[turned, ::-1], given[turned, ::-1]
    return _with_normals(points, triangles, given, soup.normals, closed)


def _groups(rows: npt.NDArray[Any]) -> tuple[Int64Array, Int64Array]:
    """First of each group of equal rows (N, K), in their order, and the group of each row."""
    order = np.lexsort(rows.T)
    new = np.any(rows[order[1:]] != rows[order[:-1]], axis=1)
    new = np.concatenate([np.ones(min(len(rows), 1), dtype=bool), new])
    first = order[new]
    label = np.empty(len(rows), dtype=np.int64)
    label[order] = np.argsort(np.argsort(first))[np.cumsum(new) - 1]
    return np.sort(first), label


def _reduced(triangles: Int64Array, given: Int64Array) -> tuple[Int64Array, Int64Array]:
    """Triangles by place and as given, without those of the top of this module."""
    a, b, c = triangles.T
    keep = (a != b) & (b != c) & (c != a)
    triangles, given = triangles[keep], given[keep]
    if not len(triangles):
        return triangles, given
    turn = np.argmin(triangles, axis=1)[:, None]
    first, _ = _groups(np.take_along_axis(triangles, (turn + np.arange(3)) % 3, axis=1))
    triangles, given = triangles[first], given[first]
    first, label = _groups(np.sort(triangles, axis=1))
    double = np.bincount(label)[label] == 2
    if double.any():
        part = _parts(triangles)
        sheet = np.bincount(part, ~double) == 0.0
        keep = ~sheet[part]
        keep[first] = True
        triangles, given = triangles[keep], given[keep]
    return triangles, given


def _parts(triangles: Int64Array) -> Int64Array:
    """(T,) number of the part, connected by corners, that a triangle is of."""
    a, b, c = triangles.T
    ends = np.concatenate([a, a]), np.concatenate([b, c])
    count = int(triangles.max()) + 1
    links = coo_array((np.ones(2 * len(triangles), dtype=bool), ends), shape=(count, count))
    return np.unique(connected_components(links, directed=False)[1][a], return_inverse=True)[1]


def _edges(triangles: Int64Array) -> tuple[bool, bool]:
    """Whether all edges are passed as often one way as the other; whether one of two only one."""
    start, end = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    _, label, count = np.unique(
        low * (int(high.max()) + 1) + high, return_inverse=True, return_counts=True
    )
    way = np.bincount(label.reshape(-1), np.where(start < end, 1.0, -1.0))
    return bool(np.all(way == 0.0)), bool(np.any((count == 2) & (way != 0.0)))


def _inside_out(corners: Float64Array, part: Int64Array, file: str) -> BoolArray:
    """(T,) triangles of closed parts (T, 3, 3) that have to be turned."""
    count = int(part.max()) + 1
    order = np.argsort(part, kind="stable")
    start = np.searchsorted(part[order], np.arange(count))
    low = np.minimum.reduceat(corners.min(axis=1)[order], start)
    high = np.maximum.reduceat(corners.max(axis=1)[order], start)
    a, b, c = np.moveaxis(corners - (0.5 * (low + high))[part][:, None], 1, 0)
    volume = np.bincount(part, dot(a, np.cross(b, c)), minlength=count)
    whole = float(volume.sum()) < 0.0
    turned = np.full(count, whole)
    rows = np.split(order, start[1:])
    left = TESTED
    for k in np.flatnonzero((volume > 0.0) if whole else (volume < 0.0)):
        about = np.all((low <= low[k]) & (high >= high[k]), axis=1)
        about[k] = False
        left -= sum(len(rows[j]) for j in np.flatnonzero(about)) + count
        if left < 0:
            text = "has more parts within each other than are looked at; some may be inside out"
            warnings.warn(f"{file}: {text}", stacklevel=3)
            break
        point = corners[rows[k][0], 0]
        if not any(_within(point, corners[rows[j]]) for j in np.flatnonzero(about)):
            turned[k] = not turned[k]
    return turned[part]


def _within(point: Float64Array, corners: Float64Array) -> bool:
    """Whether closed triangles (T, 3, 3) enclose a point: their solid angle (van Oosterom 1983)."""
    a, b, c = np.moveaxis(corners - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
    angle = 2.0 * np.arctan2(dot(a, np.cross(b, c)), below)
    return bool(abs(float(angle.sum())) > 2.0 * np.pi)


def _with_normals(
    points: Float64Array,
    triangles: Int64Array,
    given: Int64Array,
    normals: Float64Array | None,
    closed: bool,
) -> Surface:
    """The surface: the mean normal at each place, or the file's where it has one."""
    mean = _mean_normals(points, triangles)
    if normals is None or not np.isfinite(normals[given]).any():
        used = np.zeros(len(points), dtype=bool)
        used[triangles] = True
        number = np.cumsum(used) - 1
        return Surface(points[used], number[triangles], mean[used], closed)
    with np.errstate(all="ignore"):
        own = normals[given]  # (T, 3, 3)
        own = own / np.linalg.norm(own, axis=-1, keepdims=True)
    own = np.where(np.isfinite(own).all(axis=-1, keepdims=True), own, mean[triangles])
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    if np.mean(dot(own, np.cross(b - a, c - a)[:, None]) < 0.0) > 0.5:
        own = -own  # they belong to the other winding
    rows = np.concatenate([points[triangles], own + 0.0], axis=-1).reshape(-1, 6)
    first, label = _groups(rows)
    rows = rows[first]
    return Surface(rows[:, :3], label.reshape(-1, 3), rows[:, 3:], closed)


def _mean_normals(points: Float64Array, triangles: Int64Array) -> Float64Array:
    """(V, 3) mean of the triangles' unit normals about each point, by their angles there.

    Zero where they cancel: what rounding leaves of them is no direction.
    """
    a, b, c = (points[triangles[:, k]] for k in range(3))
    face = _unit(np.cross(b - a, c - b))
    ab, ac, bc = _unit(b - a), _unit(c - a), _unit(c - b)
    at_a = np.arccos(np.clip((ab * ac) @ np.ones(3), -1.0, 1.0))
    at_b = np.arccos(np.clip((-ab * bc) @ np.ones(3), -1.0, 1.0))
    angle = np.stack([at_a, at_b, np.pi - at_a - at_b], axis=1)
    angle[(angle < SMALL).any(axis=1)] = 0.0
    corner = triangles.reshape(-1)
    weights = [(angle * face[:, k, None]).reshape(-1) for k in range(3)]
    sums = [np.bincount(corner, w, minlength=len(points)) for w in weights]
    total: Float64Array = np.stack(sums, axis=1, dtype=np.float64)
    most = np.bincount(corner, angle.reshape(-1), minlength=len(points))
    total[np.abs(total).max(axis=1) < SMALL * most] = 0.0
    return _unit(total)


def _unit(v: Float64Array) -> Float64Array:
    """Vectors (N, 3) of length 1; zero stays zero."""
    length = np.sqrt(np.dot(v * v, np.ones(3)))
    return np.asarray(v * (1.0 / np.where(length > 0.0, length, 1.0))[:, None])
