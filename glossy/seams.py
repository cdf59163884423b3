"""Texels beyond the edges of a cube face: the rings that let filters and lookups cross seams.

A face is stored with ``PAD`` rings of texels around it. A texel beyond an edge is the one found by
folding the neighbour face flat about that edge. In the square beyond two edges, where only three
faces meet, the texel ``i`` beyond one edge and ``j`` beyond the other is the mean of the three
texels that lie ``i`` and ``j`` inside their own two edges: for i = j = 0 the rule of the GPU
sampler. The mean keeps a constant map constant and turns with every symmetry of the cube.
"""

import functools

import numpy as np
import numpy.typing as npt

from . import _check
from ._jit import Scalar, kernel
from ._rows import copy_texel
from .cubemap import face_directions, locate

PAD = 2  # rings: the 6-tap filter reaches two texels over an edge, the bilinear lookup one

Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]


def _folded(face: int, edge: int, i: int, d: int, n: int = 4) -> Int64Array:
    """Face, row and column of the texel ``i`` along an edge and ``d`` beyond it, by geometry."""
    along, across = (i + 0.5) * 2.0 / n - 1.0, (-1.0, 1.0)[edge % 2]
    s, t = (across, along) if edge < 2 else (along, across)
    inward = face_directions(face, 0.0, 0.0)
    f, u, v = locate(face_directions(face, s, t) - (d + 0.5) * (2.0 / n) * inward)
    return np.array([int(f), int((v + 1.0) * 0.5 * n), int((u + 1.0) * 0.5 * n)])


@functools.cache
def fold_table() -> Int64Array:
    """Where the texels beyond each edge come from, (6 faces, 4 edges, 7).

    Edges: left, right, top, bottom. For the texel ``i`` along the edge and ``d`` beyond it (from 0)
    the source is face [0], row ``[1] (n-1) + [2] i + [3] d``, column ``[4] (n-1) + [5] i + [6] d``.
    Read off the geometry with a 4-texel face, so that no adjacency is typed by hand.
    """
    n = 4  # any even size shows the pattern
    table = np.zeros((6, 4, 7), dtype=np.int64)
    for face in range(6):
        for edge in range(4):
            origin = _folded(face, edge, 0, 0)
            step_i, step_d = (_folded(face, edge, i, d) - origin for i, d in ((1, 0), (0, 1)))
            far = (origin[1:] == n - 1).astype(np.int64)
            table[face, edge] = [
                origin[0], far[0], step_i[1], step_d[1], far[1], step_i[2], step_d[2],
            ]  # fmt: skip
    return np.asarray(_check.frozen(table))


@kernel
def k_fill_edges(level: Float32Array, table: Int64Array, face: Scalar) -> None:
    """Fill the rings of one face of a level (6, n + 2 PAD, n + 2 PAD, C), corners excepted.

    C must be a multiple of four; from the other faces only their interior is read.
    """
    n, width, channels = level.shape[1] - 2 * PAD, level.shape[2], level.shape[3]
    flat = level.reshape(-1)
    for edge in range(4):
        fold = table[face, edge]
        source = (fold[0] * width + fold[1] * (n - 1) + PAD) * width + fold[4] * (n - 1) + PAD
        along, across = fold[2] * width + fold[5], fold[3] * width + fold[6]
        across *= min(n - 1, 1)  # one texel has nothing further in
        row, col = PAD, PAD
        if edge < 2:
            col = n + PAD if edge else PAD - 1
        else:
            row = n + PAD if edge == 3 else PAD - 1
        target = (face * width + row) * width + col
        forward, outward = (width, 1) if edge < 2 else (1, width)
        if edge % 2 == 0:
            outward = -outward
        for i in range(n):
            for d in range(PAD):
                begin = (source + i * along + d * across) * channels
                to = (target + i * forward + d * outward) * channels
                for c in range(0, channels, 4):
                    copy_texel(flat, begin + c, flat, to + c)


@kernel
def k_fill_corners(level: Float32Array, face: Scalar) -> None:
    """Fill the four squares beyond two edges of one face, whose edges are filled."""
    n, channels = level.shape[1] - 2 * PAD, level.shape[3]
    last = n - 1 + PAD
    for corner in range(4):
        down, right = corner // 2, corner % 2
        for dr in range(PAD):
            for dc in range(PAD):
                er, ec = min(dr, n - 1), min(dc, n - 1)
                row_in = last - er if down else PAD + er
                col_in = last - ec if right else PAD + ec
                row_out = last + 1 + dr if down else PAD - 1 - dr
                col_out = last + 1 + dc if right else PAD - 1 - dc
                for c in range(channels):
                    three = (
                        np.float64(level[face, row_in, col_in, c])
                        + np.float64(level[face, row_in, col_out, c])
                        + np.float64(level[face, row_out, col_in, c])
                    )
                    level[face, row_out, col_out, c] = np.float32(three / 3.0)


@kernel
def k_fill_seams(level: Float32Array, table: Int64Array) -> None:
    """Fill the rings of one level (6, n + 2 PAD, n + 2 PAD, C), C a multiple of four."""
    for face in range(6):
        k_fill_edges(level, table, face)
        k_fill_corners(level, face)
