"""Weights of the ``round`` pyramid filter: taps that are round on the sphere.

One texel p of a level is a weighted mean of texels q of the level above, all of them known by
their true directions, across edges and corners too::

    w(q) ~ S(q) exp(-x.A x / 2 + b.x),  x = 2 (q.e1, q.e2) / (1 + q.p)                         (1)

with a tangent frame (e1, e2) at p and the part S of level 0 that each q stands for (``shares``):
its solid angle in level 0, less than that where wider neighbours cover the same place again. The
five numbers in A and b are solved for (Newton) such that what the texel averages of level 0 has
its centre at p and the covariance ::

    C(p) = sigma^2 I - J J^T / 6,   sigma = c h d^(-3/2),  h = 2 / n,  d = |p| / |p|_inf       (2)

J J^T / 6 is the mean covariance of the bilinear lookup between the level's n x n texels (J: texel
steps on the sphere), so that a lookup's tap, level and interpolation together, is round and
sigma wide wherever it falls. d^(-3/2) is the texels' own size: levels count as for other filters.

Wide taps follow the heat kernel, the Gaussian of the sphere: a variance v per axis has the tangent
covariance (1 - exp(-3 v)) / 3 and shortens the mean direction to exp(-v).

By (2) what the texels of the level above average is known, too, and S is taken from a chain that
starts at size 2 ``LARGEST``; so a table depends on its size and on whether the level above is
level 0, on nothing else.
"""

import functools
import math

import numpy as np
import numpy.typing as npt

from . import _check
from ._gather import TAPS
from ._jit import kernel
from .cubemap import face_directions, locate, texel_directions, texel_solid_angles
from .round_shares import RING, mean, share, spread
from .seams import fold_table

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

WIDTH = 1.0  # c of eq. (2)
BILINEAR = 1.0 / 6.0
DENSE = 8  # levels up to this size are averages of the whole level above
LARGEST = 128  # the largest size with a table of its own: larger levels read it
STEPS = 40
ENOUGH = 1e-7  # of the moments, in units of sigma


@kernel
def _dot(a: Float64Array, b: Float64Array) -> float:
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@kernel
def _solve(a: Float64Array, b: Float64Array) -> None:
    """Solve a x = b in place by elimination with the largest pivot; b becomes x."""
    n = b.size
    for i in range(n):
        best = i
        for r in range(i + 1, n):
            if abs(a[r, i]) > abs(a[best, i]):
                best = r
        for c in range(n):
            a[i, c], a[best, c] = a[best, c], a[i, c]
        b[i], b[best] = b[best], b[i]
        for r in range(i + 1, n):
            f = a[r, i] / a[i, i]
            for c in range(i, n):
                a[r, c] -= f * a[i, c]
            b[r] -= f * b[i]
    for i in range(n - 1, -1, -1):
        for c in range(i + 1, n):
            b[i] -= a[i, c] * b[c]
        b[i] /= a[i, i]


@kernel
def _match(
    place: Float64Array, area: Float64Array, moments: Float64Array, goal: Float64Array,
    shape: Float64Array, weights: Float64Array,
) -> float:  # fmt: skip
    """Weights (K,) of eq. (1) whose means of ``moments`` (K, 5) are ``goal`` (5); what is left.

    ``place`` (K, 2): x of eq. (1) in units of sigma; texels without ``area`` take no part.
    ``shape``: A xx, xy, yy and b of eq. (1), where to start and where it ends.
    """
    basis, step = np.empty(5), np.zeros(5)
    last = math.inf
    for _ in range(STEPS):
        total, mean_basis, mean, slope = 0.0, np.zeros(5), np.zeros(5), np.zeros((5, 5))
        for k in range(weights.size):
            x, y = place[k, 0], place[k, 1]
            basis[0], basis[1], basis[2] = -0.5 * x * x, -x * y, -0.5 * y * y
            basis[3], basis[4] = x, y
            weights[k] = area[k] * math.exp(min(_dot(shape, basis), 500.0))
            total += weights[k]
            for i in range(5):
                mean_basis[i] += weights[k] * basis[i]
                mean[i] += weights[k] * moments[k, i]
                for j in range(5):
                    slope[i, j] += weights[k] * moments[k, i] * basis[j]
        worst = 0.0
        for i in range(5):
            mean_basis[i] /= total
            mean[i] /= total
            worst = max(worst, abs(goal[i] - mean[i]))
        for k in range(weights.size):
            weights[k] /= total
        if worst < ENOUGH:
            return worst
        if worst > last:  # too far: half of the last step back
            for i in range(5):
                step[i] *= 0.5
                shape[i] -= step[i]
            continue
        last = worst
        largest = 0.0
        for i in range(5):
            step[i] = goal[i] - mean[i]
            for j in range(5):
                slope[i, j] = slope[i, j] / total - mean[i] * mean_basis[j]
        _solve(slope, step)
        for i in range(5):
            largest = max(largest, abs(step[i]))
        for i in range(5):
            step[i] /= max(largest, 1.0)
            shape[i] += step[i]
    return last


@kernel
def _match_windows(
    frames: Float64Array, goals: Float64Array, sigma: Float64Array, texels: Float64Array,
    rows: Int64Array, cols: Int64Array, taps: int, weights: Float64Array, left: Float64Array,
) -> None:  # fmt: skip
    """Weights (R, C, taps * taps) of R x C texels with windows of ``texels`` (H, W, 13).

    ``frames`` (R, C, 3, 3): e1, e2, p. ``texels``: direction, S, mean direction, second
    moments xx yy zz xy xz yz. ``goals`` (R, C, 2, 2): covariances; ``rows``, ``cols``: where the
    windows start. A texel starts from its neighbour's solution.
    """
    count = taps * taps
    place, area, moments = np.empty((count, 2)), np.empty(count), np.empty((count, 5))
    goal, shape = np.zeros(5), np.zeros(5)
    for row in range(frames.shape[0]):
        shape[:] = 0.0
        shape[0], shape[2] = 1.0, 1.0
        for col in range(frames.shape[1]):
            e1, e2, p = frames[row, col, 0], frames[row, col, 1], frames[row, col, 2]
            unit = 1.0 / sigma[row, col]
            for i in range(count):
                q = texels[rows[row] + i // taps, cols[col] + i % taps]
                scale = 2.0 * unit / max(1.0 + _dot(q[:3], p), 1e-3)
                place[i, 0], place[i, 1] = scale * _dot(q[:3], e1), scale * _dot(q[:3], e2)
                area[i] = q[3]
                moments[i, 0] = unit * _dot(q[4:7], e1)
                moments[i, 1] = unit * _dot(q[4:7], e2)
                for j in range(3):
                    a, b = (e1 if j < 2 else e2), (e1 if j < 1 else e2)
                    moments[i, 2 + j] = (unit * unit) * (
                        q[7] * a[0] * b[0] + q[8] * a[1] * b[1] + q[9] * a[2] * b[2]
                        + q[10] * (a[0] * b[1] + a[1] * b[0])
                        + q[11] * (a[0] * b[2] + a[2] * b[0])
                        + q[12] * (a[1] * b[2] + a[2] * b[1])
                    )  # fmt: skip
            goal[2], goal[3] = goals[row, col, 0, 0], goals[row, col, 0, 1]
            goal[4] = goals[row, col, 1, 1]
            goal[2:] *= unit * unit
            left[row, col] = _match(place, area, moments, goal, shape, weights[row, col])


def _frames(s: Float64Array, t: Float64Array, n: int) -> tuple[Float64Array, ...]:
    """Frames (..., 3, 3) on face +z, the covariance (..., 2, 2) of eq. (2), and sigma (...)."""
    x = face_directions(4, s, t)
    d = np.linalg.norm(x, axis=-1)[..., None]
    p = x / d
    across, down = ((a - p * np.sum(p * a, -1, keepdims=True)) / d for a in np.eye(3)[:2])
    e1 = across / np.linalg.norm(across, axis=-1, keepdims=True)
    e2 = np.cross(p, e1)
    steps = np.stack([across, -down], axis=-1) * (2.0 / n)
    jacobian = np.stack([np.einsum("...i,...ij->...j", e, steps) for e in (e1, e2)], axis=-2)
    sigma = WIDTH * (2.0 / n) * d[..., 0] ** -1.5
    bilinear = BILINEAR * jacobian @ np.swapaxes(jacobian, -1, -2)
    covariance = sigma[..., None, None] ** 2 * np.eye(2) - bilinear
    v = 0.5 * np.trace(covariance, axis1=-2, axis2=-1)[..., None, None]
    return np.stack([e1, e2, p], axis=-2), covariance * -np.expm1(-3.0 * v) / (3.0 * v), sigma


def _texels(row: Int64Array, col: Int64Array, n: int, deltas: bool) -> Float64Array:
    """What ``_match_windows`` takes, for texels (...) of face +z, (..., 13); deltas: of level 0."""
    s, t = (np.asarray((x + 0.5) * (2.0 / n) - 1.0, dtype=np.float64) for x in (col, row))
    frames, covariance, _ = _frames(s, t, n)
    tangents, p = frames[..., :2, :], frames[..., 2, :]
    if deltas:
        covariance = np.zeros_like(covariance)
    trace = np.trace(covariance, axis1=-2, axis2=-1)[..., None]
    mean = p * np.cbrt(1.0 - 1.5 * trace)  # exp(-v), as trace = 2 (1 - exp(-3 v)) / 3
    second = np.swapaxes(tangents, -1, -2) @ covariance @ tangents
    second += (1.0 - trace[..., None]) * p[..., :, None] * p[..., None, :]
    area = (_solid_angles(n) if deltas else shares(n))[row, col][..., None]
    return np.concatenate([p, area, mean, _packed(second)], axis=-1)


def _packed(m: Float64Array) -> Float64Array:
    return np.stack([m[..., i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], -1)


def _rotation(face: int) -> Float64Array:
    """The rotation of the cube that takes face +z to ``face``, columns and rows with it."""
    middle = face_directions(face, 0.0, 0.0)
    across, down = (face_directions(face, *a) - middle for a in ((1.0, 0.0), (0.0, 1.0)))
    return np.stack([across, -down, middle], axis=-1)


def _turned(texels: Float64Array, rotation: Float64Array) -> Float64Array:
    """The same of another face."""
    xx, yy, zz, xy, xz, yz = np.moveaxis(texels[..., 7:], -1, 0)
    second = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], -1).reshape(*xx.shape, 3, 3)
    second = _packed(rotation @ second @ rotation.T)
    parts = [texels[..., :3] @ rotation.T, texels[..., 3:4], texels[..., 4:7] @ rotation.T, second]
    return np.concatenate(parts, axis=-1)


def _padded_texels(n: int, deltas: bool) -> Float64Array:
    """The first rows and columns of face +z with ``RING`` rings, (H, H, 13): what its first
    quarter reaches. Nothing beyond the cube's corner.
    """
    i = np.arange(n // 2 + RING)
    row, col = np.meshgrid(i, i, indexing="ij")
    out = np.zeros((i.size + RING, i.size + RING, 13))
    out[RING:, RING:] = _texels(row, col, n, deltas)
    for edge in (0, 2):
        other, far0, i0, d0, far1, i1, d1 = fold_table()[4, edge]
        for d in range(RING):
            rows, cols = far0 * (n - 1) + i0 * i + d0 * d, far1 * (n - 1) + i1 * i + d1 * d
            ring = _turned(_texels(rows, cols, n, deltas), _rotation(int(other)))
            if edge == 0:
                out[RING:, RING - 1 - d] = ring
            else:
                out[RING - 1 - d, RING:] = ring
    return out


@functools.lru_cache(maxsize=32)
def window_weights(n: int, deltas: bool) -> Float32Array:
    """Weights (n/2, n/2, 8, 8) of a quarter of each face of a level of n, DENSE < n <= ``LARGEST``.

    ``deltas``: the level above is level 0. Texel (i, j) takes rows 2 i - ``RING`` and on, columns
    2 j - ``RING`` and on; the other quarters are mirrored.
    """
    starts = 2 * np.arange(n // 2)
    weights, _ = _matched(n, starts.size, _padded_texels(2 * n, deltas), starts, TAPS)
    shaped = weights.reshape(n // 2, n // 2, TAPS, TAPS).astype(np.float32)
    return np.asarray(_check.frozen(shaped))


@functools.lru_cache(maxsize=16)
def shares(n: int) -> Float64Array:
    """S (n, n) of eq. (1) on a face of a level of n, in solid angles of a mean texel of its size.

    Such that the level's texels, S times each, cover what they are made of once: ``share``.
    """
    own = _solid_angles(n)
    if n > LARGEST:
        return own
    goal = shares(2 * n)
    if n <= DENSE:
        table = dense_weights(n, False).astype(np.float64)
        whole, goal = (np.tile(a.reshape(-1), 6) for a in (own, goal))
        found = share(lambda a: 4.0 * a @ table, lambda x: table @ x, whole, goal)
        return found[: n * n].reshape(n, n)
    h, weights = n // 2, window_weights(n, False).astype(np.float64)
    found = share(
        lambda a: 4.0 * spread(weights, a), lambda x: mean(weights, x), own[:h, :h], goal[:n, :n]
    )
    return np.block([[found, found[:, ::-1]], [found[::-1], found[::-1, ::-1]]])


def _solid_angles(n: int) -> Float64Array:
    return texel_solid_angles(n) * (0.25 * n * n)


def _matched(
    n: int, count: int, texels: Float64Array, starts: Int64Array, taps: int
) -> tuple[Float64Array, Float64Array]:
    """Weights of the first ``count`` rows and columns of face +z, and what is left of (2)."""
    along = (np.arange(count) + 0.5) * (2.0 / n) - 1.0
    s, t = np.meshgrid(along, along)
    frames, goals, sigma = _frames(s, t, n)
    weights, left = np.empty((count, count, taps * taps)), np.empty((count, count))
    _match_windows(frames, goals, sigma, texels, starts, starts, taps, weights, left)
    return weights, left


@functools.lru_cache(maxsize=8)
def dense_weights(n: int, deltas: bool) -> Float32Array:
    """Weights (6 n n, 24 n n) of a level of n <= ``DENSE`` over all texels of the level above."""
    fine = 2 * n
    row, col = np.meshgrid(np.arange(fine), np.arange(fine), indexing="ij")
    face = _texels(row, col, fine, deltas)
    every = np.concatenate([_turned(face, _rotation(f)).reshape(-1, 13) for f in range(6)])
    count = math.isqrt(len(every) - 1) + 1  # as a square, filled up with texels of no area
    square = np.zeros((count * count, every.shape[1]))
    square[: len(every)] = every
    starts = np.zeros(n, dtype=np.int64)
    found, _ = _matched(n, n, square.reshape(count, count, -1), starts, count)
    weights = found.reshape(n * n, -1)[:, : len(every)]
    rows = []
    for f in range(6):  # what face +z sees of the texel that face f sees
        g, u, v = locate(texel_directions(fine).reshape(-1, 3) @ _rotation(f))
        i, j = (np.floor((x + 1.0) * 0.5 * fine).astype(int) for x in (v, u))
        rows.append(weights[:, (g * fine + i) * fine + j])
    return np.asarray(_check.frozen(np.concatenate(rows).astype(np.float32)))
