"""The ``round`` filter's reduction: each texel a weighted sum with weights of its own.

The weights are those of ``round_weights``; the six faces share them. Levels larger than the largest
table read that of a place nearby: weights change little from one texel to the next.
"""

import numba
import numpy as np
import numpy.typing as npt

from ._gather import FACES, TAPS, gather, gather_mirrored
from ._jit import Scalar, kernel, parallel_kernel
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
    """One row of every face."""
    n, width, across = coarse.shape[1] - 2 * PAD, fine.shape[1], coarse.shape[1]
    half, entries, last = n // 2, weights.shape[0], width - TAPS
    row = np.int64(row)
    inner = min(row, n - 1 - row)
    top = max(2 * inner + PAD + 1 - TAPS // 2, 0)
    entry, step, first = _entry(inner, shift) * entries, TAPS, 0
    if row >= half:
        top, step, first = last - top, -TAPS, (TAPS - 1) * TAPS
    source, target, table = fine.reshape(-1), coarse.reshape(-1), weights.reshape(-1)
    start, begin = top * width * 4, ((row + PAD) * across + PAD) * 4
    fine_face, coarse_face = width * width * 4, across * across * 4
    for _ in range(0, 6, FACES):
        for col in range(half):
            left = max(2 * col + PAD + 1 - TAPS // 2, 0)
            at = (entry + _entry(col, shift)) * (TAPS * TAPS) + first
            places, ends = (start + 4 * left, width * 4, fine_face), (begin + 4 * col, coarse_face)
            gather(source, places, table, at, step, target, ends)
        for i in range(half):
            col = half - 1 - i
            left = max(2 * col + PAD + 1 - TAPS // 2, 0)
            at = (entry + _entry(col, shift)) * (TAPS * TAPS) + first
            places = (start + 4 * (last - left), width * 4, fine_face)
            ends = (begin + 4 * (n - 1 - col), coarse_face)
            gather_mirrored(source, places, table, at, step, target, ends)
        start += FACES * fine_face
        begin += FACES * coarse_face


@parallel_kernel
def _gather_level(
    fine: Float32Array, coarse: Float32Array, weights: Float32Array, table: Int64Array
) -> None:
    """A level from the one above, both (6, n + 2 PAD, n + 2 PAD, 4), with its rings."""
    n, shift = coarse.shape[1] - 2 * PAD, 0
    while 2 * weights.shape[0] << shift < n:
        shift += 1
    if n <= SERIAL:
        for row in range(n):
            _gather_row(fine, coarse, weights, shift, row)
    else:
        for row in numba.prange(n):
            _gather_row(fine, coarse, weights, shift, row)
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
