"""Functions of the outgoing direction between scattered measured ones: triangles on a disc.

The hemisphere is laid on a disc of radius sqrt 2 by Lambert's map, which keeps areas::

    (x, y) = (wx, wy) sqrt(2 / (1 + wz)),      d omega = dx dy                              (1)

There the measured directions are triangulated (Delaunay), and a function is linear on each
triangle. Just outside the rim a ring of further points takes what the nearest measured direction
has, so the disc is covered. Directions that form a full grid of polar angles and azimuths are
interpolated bilinearly in these angles instead: with the two angles of the incident light that is
the quadrilinear interpolation of the thesis.
"""

import dataclasses
import functools
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import Delaunay, cKDTree

from .._jit import Scalar, kernel

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Nodes = tuple[tuple[int, int, int, int], tuple[float, float, float, float]]

RIM = 1.5  # radius of the further points; the disc itself has sqrt 2 = 1.414
RING = 64  # of them
SEEDS = 24  # cells per axis of the grid that tells in which triangle to start
SAME = 1e-6  # distance at which two measured directions are one
SAME_ANGLE = 1e-5  # rad, of the angles of a grid


@dataclasses.dataclass(frozen=True, eq=False)
class Disc:
    """Triangulated directions of one incident direction, and their grid if they form one.

    ``points`` (P, 2) on the disc, ``values`` (P, C), ``triangles`` and ``neighbours`` (T, 3),
    ``seeds`` (SEEDS, SEEDS). ``theta`` and ``phi`` are empty, or the angles of the grid whose
    nodes are the first points, azimuths fastest.
    """

    points: Float64Array
    values: Float64Array
    triangles: IntArray
    neighbours: IntArray
    seeds: IntArray
    theta: Float64Array
    phi: Float64Array


def to_disc(w: Float64Array) -> Float64Array:
    """Eq. (1) for directions (..., 3) of the upper hemisphere."""
    return np.asarray(w[..., :2] * np.sqrt(2.0 / (1.0 + w[..., 2:])))


def from_disc(xy: Float64Array) -> Float64Array:
    """Inverse of eq. (1): directions (..., 3) for points (..., 2) of the disc."""
    r2 = np.minimum(np.sum(xy * xy, axis=-1, keepdims=True), 2.0)
    return np.concatenate([xy * np.sqrt(1.0 - 0.25 * r2), 1.0 - 0.5 * r2], axis=-1)


def build_disc(wo: Float64Array, values: Float64Array, closed: bool = False) -> Disc:
    """Triangulate directions (K, 3) above the surface; those measured twice are averaged.

    A ``closed`` disc has its ring of further points on the rim itself, with value 0, and is never
    a grid: its triangles are all there is of the function.
    """
    xy = to_disc(wo)
    _, first, label = np.unique(np.round(xy / SAME), axis=0, return_index=True, return_inverse=True)
    label = label.reshape(-1)
    count = np.bincount(label)[:, None]
    mean = np.stack([np.bincount(label, column) for column in values.T], axis=1) / count
    xy, w = xy[first], wo[first]
    theta, phi, order = (np.empty(0),) * 3 if closed else _grid(w)
    if len(theta):
        xy, mean = xy[order], mean[order]
    points, nearest, triangles, neighbours, seeds = _mesh(xy.tobytes(), closed)
    rim = np.zeros((RING, mean.shape[1])) if closed else mean[nearest]
    values = np.concatenate([mean, rim])
    return Disc(points, values, triangles, neighbours, seeds, theta, phi)


@functools.lru_cache(maxsize=8)
def _mesh(data: bytes, closed: bool) -> tuple[Any, ...]:
    """Points with the rim, what the rim copies, triangles, neighbours and seeds.

    The same for every incident direction that shares its outgoing ones, hence kept.
    """
    xy = np.frombuffer(data).reshape(-1, 2)
    angle = 2.0 * np.pi * np.arange(RING) / RING
    rim = np.sqrt(2.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    nearest = cKDTree(xy).query(rim)[1]
    points = np.concatenate([xy, rim if closed else rim * (RIM / np.sqrt(2.0))])
    mesh = Delaunay(points)
    grid = np.sqrt(2.0) * ((np.arange(SEEDS) + 0.5) * 2.0 / SEEDS - 1.0)
    seeds = mesh.find_simplex(np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1))
    triangles, neighbours = mesh.simplices.astype(np.int64), mesh.neighbors.astype(np.int64)
    return points, nearest, triangles, neighbours, np.maximum(seeds, 0).astype(np.int64)


def _grid(w: Float64Array) -> tuple[Float64Array, Float64Array, IntArray]:
    """Angles of a full grid, and for each of its nodes the direction; empty if there is none."""
    none = (np.empty(0), np.empty(0), np.empty(0, dtype=np.int64))
    theta = np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2])
    phi = np.arctan2(w[:, 1], w[:, 0]) % (2.0 * np.pi)
    phi = np.where(phi > 2.0 * np.pi - SAME_ANGLE, 0.0, phi)
    pole = theta < SAME_ANGLE
    rows, row = np.unique(np.round(theta / SAME_ANGLE), return_inverse=True)
    away = np.flatnonzero(~pole)
    columns, column = np.unique(np.round(phi[away] / SAME_ANGLE), return_inverse=True)
    n_rows, n_columns = len(rows), len(columns)
    if n_columns < 3 or n_rows < 2 or len(away) != (n_rows - int(pole.any())) * n_columns:
        return none
    nodes = np.full((n_rows, n_columns), -1)
    nodes[row.reshape(-1)[away], column.reshape(-1)] = away
    if pole.any():
        nodes[0] = np.flatnonzero(pole)[0]
    if nodes.min() < 0:
        return none
    return rows * SAME_ANGLE, columns * SAME_ANGLE, nodes.reshape(-1)


@kernel
def k_above(a: Float64Array, start: int, end: int, x: float) -> int:
    """First index of the rising ``a[start:end]`` whose entry is above x; ``end`` if none is."""
    while start < end:
        middle = (start + end) // 2
        if a[middle] <= x:
            start = middle + 1
        else:
            end = middle
    return start


@kernel
def k_grid_nodes(
    x: float,
    y: float,
    z: float,
    theta: Float64Array,
    phi: Float64Array,
    t0: int,
    t1: int,
    p0: int,
    p1: int,
) -> Nodes:
    """Nodes of the grid theta[t0:t1] x phi[p0:p1] about a direction, and their bilinear weights.

    Polar angles clamp, azimuths wrap.
    """
    t = np.arctan2(np.sqrt(x * x + y * y), z)
    p = np.arctan2(y, x)
    p += 2.0 * np.pi if p < 0.0 else 0.0
    high = min(max(k_above(theta, t0, t1, t), t0 + 1), t1 - 1)
    ft = (t - theta[high - 1]) / (theta[high] - theta[high - 1])
    ft = min(max(ft, 0.0), 1.0)
    n = p1 - p0
    c = k_above(phi, p0, p1, p) - p0
    c0, c1 = (c - 1) % n, c % n
    gap = phi[p0 + c1] - phi[p0 + c0]
    gap += 2.0 * np.pi if gap <= 0.0 else 0.0
    past = p - phi[p0 + c0]
    past += 2.0 * np.pi if past < 0.0 else 0.0
    fp = past / gap
    row = high - t0
    nodes = ((row - 1) * n + c0, (row - 1) * n + c1, row * n + c0, row * n + c1)
    return nodes, ((1.0 - ft) * (1.0 - fp), (1.0 - ft) * fp, ft * (1.0 - fp), ft * fp)


@kernel
def k_triangle_nodes(
    x: float,
    y: float,
    z: float,
    points: Float64Array,
    triangles: IntArray,
    neighbours: IntArray,
    seeds: IntArray,
    j: int,
) -> Nodes:
    """Corners of the triangle of disc j about a direction and their weights; the fourth has none.

    Walks from a nearby triangle across the side that the point lies farthest beyond.
    """
    scale = np.sqrt(2.0 / (1.0 + max(z, 0.0)))
    u, v = x * scale, y * scale
    n = seeds.shape[1]
    a = min(max(int((u / np.sqrt(2.0) + 1.0) * 0.5 * n), 0), n - 1)
    b = min(max(int((v / np.sqrt(2.0) + 1.0) * 0.5 * n), 0), n - 1)
    t = seeds[j, a, b]
    w0: Scalar = 0.0
    w1: Scalar = 0.0
    w2: Scalar = 0.0
    for _ in range(len(triangles)):
        p, q, r = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        px, py = points[p, 0], points[p, 1]
        qx, qy = points[q, 0] - px, points[q, 1] - py
        rx, ry = points[r, 0] - px, points[r, 1] - py
        area = qx * ry - rx * qy
        if area == 0.0:
            area = 1e-300
        w1 = ((u - px) * ry - rx * (v - py)) / area
        w2 = (qx * (v - py) - (u - px) * qy) / area
        w0 = 1.0 - w1 - w2
        least, side = w0, 0
        if w1 < least:
            least, side = w1, 1
        if w2 < least:
            least, side = w2, 2
        if least > -1e-12 or neighbours[t, side] < 0:
            break
        t = neighbours[t, side]
    w0, w1, w2 = min(max(w0, 0.0), 1.0), min(max(w1, 0.0), 1.0), min(max(w2, 0.0), 1.0)
    total = w0 + w1 + w2
    nodes = (triangles[t, 0], triangles[t, 1], triangles[t, 2], triangles[t, 2])
    return nodes, (w0 / total, w1 / total, w2 / total, 0.0)
