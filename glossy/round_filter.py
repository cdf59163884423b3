"""The ``round`` filter's reduction: each texel a weighted sum with weights of its own.

The weights are those of ``round_weights``; the six faces share them. Levels larger than the largest
table read that of a place nearby: weights change little from one texel to the next.

Windows reach ``RING`` texels beyond an edge, one more than the levels' rings: the texels along an
edge are gathered from a strip with that many of the neighbour's.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from ._gather import FACES, TAPS, gather, gather_mirrored
from ._jit import Scalar, kernel, row_kernel
from ._rows import copy_texel
from ._threads import in_rows
from .round_shares import RING
from .round_weights import DENSE, LARGEST, dense_weights, window_weights
from .seams import PAD, k_fill_seams

Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

SERIAL = 32  # levels up to this size are not worth waking other threads for
EXACT = 4  # rows next to an edge that a larger level takes from the same rows of its table
ZERO = np.float32(0.0)


@kernel
def _entry(i: Scalar, shift: Scalar) -> Scalar:
    """Row of the table for the ``i``-th row from the edge of a level 2^shift times as large."""
    return i if i < EXACT else max(i >> shift, EXACT)


@kernel
def _gather_row(
    fine: Float32Array, coarse: Float32Array, weights: Float32Array, shift: Scalar, row: Scalar
) -> None:
    """One row of every face, but for its ends."""
    n, width, across = coarse.shape[1] - 2 * PAD, fine.shape[1], coarse.shape[1]
    half, entries, last = n // 2, weights.shape[0], width - TAPS
    row = np.int64(row)
    inner = min(row, n - 1 - row)
    top = 2 * inner + PAD - RING
    entry, step, first = _entry(inner, shift) * entries, TAPS, 0
    if row >= half:
        top, step, first = last - top, -TAPS, (TAPS - 1) * TAPS
    source, target, table = fine.reshape(-1), coarse.reshape(-1), weights.reshape(-1)
    start, begin = top * width * 4, ((row + PAD) * across + PAD) * 4
    fine_face, coarse_face = width * width * 4, across * across * 4
    for _ in range(0, 6, FACES):
        for col in range(1, half):
            left = 2 * col + PAD - RING
            at = (entry + _entry(col, shift)) * (TAPS * TAPS) + first
            places, ends = (start + 4 * left, width * 4, fine_face), (begin + 4 * col, coarse_face)
            gather(source, places, table, at, step, target, ends)
        for i in range(half - 1):
            col = half - 1 - i
            left = 2 * col + PAD - RING
            at = (entry + _entry(col, shift)) * (TAPS * TAPS) + first
            places = (start + 4 * (last - left), width * 4, fine_face)
            ends = (begin + 4 * (n - 1 - col), coarse_face)
            gather_mirrored(source, places, table, at, step, target, ends)
        start += FACES * fine_face
        begin += FACES * coarse_face


@kernel
def _place(n: Scalar, table: Int64Array, face: Scalar, edge: Scalar, i: Scalar, d: Scalar) -> Any:
    """Where in a level of n the texel ``i`` along an edge and ``d`` inside it starts.

    Either may lie beyond the face, not both.
    """
    far, beyond = d < 0, (i < 0) | (i >= n)
    across = n - 1 - d if edge & 1 else d
    row, col = (i, across) if edge < 2 else (across, i)
    if far | beyond:
        over, along, depth = edge, i, -1 - d
        if beyond:
            over = (2 if edge < 2 else 0) + (1 if i >= n else 0)
            along, depth = across, i - n if i >= n else -1 - i
        fold = table[face, over]
        face = fold[0]
        row = fold[1] * (n - 1) + fold[2] * along + fold[3] * depth
        col = fold[4] * (n - 1) + fold[5] * along + fold[6] * depth
    return ((face * (n + 2 * PAD) + row + PAD) * (n + 2 * PAD) + col + PAD) * 4


@kernel
def _gather_ends(
    fine: Float32Array, coarse: Float32Array, weights: Float32Array, table: Int64Array,
    shift: Scalar, group: Scalar,
) -> None:  # fmt: skip
    """The texels along ``FACES`` edges of a face, whose windows reach beyond the rings."""
    m, n = fine.shape[1] - 2 * PAD, coarse.shape[1] - 2 * PAD
    face, edge, width = group * FACES // 4, group * FACES % 4, m + 2 * RING
    strips = np.zeros((FACES, TAPS, width, 4), dtype=np.float32)
    found = np.empty((FACES, n, 4), dtype=np.float32)
    source, target, flat, level = (
        strips.reshape(-1), found.reshape(-1), weights.reshape(-1), fine.reshape(-1)
    )  # fmt: skip
    for k in range(FACES):
        for d in range(-RING, TAPS - RING):
            end = ((k * TAPS + d + RING) * width + RING) * 4
            start = _place(m, table, face, edge + k, 0, d)
            step = _place(m, table, face, edge + k, 1, d) - start
            for i in range(m):
                copy_texel(level, start + i * step, source, end + 4 * i)
            for i in range(RING if d >= 0 else 0):  # nothing beyond the corner
                start = _place(m, table, face, edge + k, -1 - i, d)
                copy_texel(level, start, source, end - 4 * (i + 1))
                start = _place(m, table, face, edge + k, m + i, d)
                copy_texel(level, start, source, end + 4 * (m + i))
    for col in range(n // 2):
        at = _entry(col, shift) * (TAPS * TAPS)
        places = (8 * col, 4 * width, 4 * width * TAPS)
        gather(source, places, flat, at, TAPS, target, (4 * col, 4 * n))
        places = (4 * (width - TAPS - 2 * col), 4 * width, 4 * width * TAPS)
        gather_mirrored(source, places, flat, at, TAPS, target, (4 * (n - 1 - col), 4 * n))
    for k in range(FACES):
        side = (n - 1) * ((edge + k) % 2) + PAD
        if edge + k < 2:
            coarse[face, PAD + 1 : PAD + n - 1, side] = found[k, 1 : n - 1]
        else:  # the corners are these
            coarse[face, side, PAD : PAD + n] = found[k]


@row_kernel
def _gather_rows(
    begin: int,
    end: int,
    fine: Float32Array,
    coarse: Float32Array,
    weights: Float32Array,
    table: Int64Array,
    shift: int,
) -> None:
    """Of a level from the one above, both (6, n + 2 PAD, n + 2 PAD, 4): its ends, then its rows."""
    ends = 24 // FACES
    for i in range(begin, end):
        if i < ends:
            _gather_ends(fine, coarse, weights, table, shift, i)
        else:
            _gather_row(fine, coarse, weights, shift, i - ends + 1)


def _gather_level(
    fine: Float32Array, coarse: Float32Array, weights: Float32Array, table: Int64Array
) -> None:
    n, shift = coarse.shape[1] - 2 * PAD, 0
    while 2 * len(weights) << shift < n:
        shift += 1
    count = 24 // FACES + n - 2
    grain = count if n <= SERIAL else 1
    in_rows(_gather_rows, count, fine, coarse, weights, table, shift, grain=grain)
    k_fill_seams(coarse, table)


@kernel
def _average_level(
    fine: Float32Array, coarse: Float32Array, weights: Float32Array, table: Int64Array
) -> None:
    """A level of a few texels, each from all texels of the level above."""
    n, m = coarse.shape[1] - 2 * PAD, fine.shape[1] - 2 * PAD
    for i in range(6 * n * n):
        k, r, g, b = 0, ZERO, ZERO, ZERO
        for face in range(6):
            for row in range(m):
                for col in range(m):
                    w, texel = weights[i, k], fine[face, row + PAD, col + PAD]
                    r += w * texel[0]
                    g += w * texel[1]
                    b += w * texel[2]
                    k += 1
        out = coarse[i // (n * n), i // n % n + PAD, i % n + PAD]
        out[0], out[1], out[2], out[3] = r, g, b, ZERO
    k_fill_seams(coarse, table)


def reduce_round(fine: Float32Array, coarse: Float32Array, table: Int64Array, deltas: bool) -> None:
    """Fill a level from the one above, with its rings; ``deltas``: that one is level 0."""
    n = coarse.shape[1] - 2 * PAD
    if n <= DENSE:
        _average_level(fine, coarse, dense_weights(n, deltas), table)
    else:
        _gather_level(fine, coarse, window_weights(min(n, LARGEST), deltas), table)
