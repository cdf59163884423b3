"""The ``round`` filter's reduction: each texel a weighted sum with weights of its own.

The weights are those of ``round_weights``. A level's rows are done across the six faces in turn,
which share them: the table is the largest thing that is read.
"""

import numba
import numpy as np
import numpy.typing as npt

from ._gather import TAPS, gather, gather_mirrored
from ._jit import Scalar, kernel, parallel_kernel
from .round_weights import DENSE, LARGEST, dense_weights, window_weights
from .seams import PAD, k_fill_seams

Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

SERIAL = 32  # levels up to this size are not worth waking other threads for
EXACT = 4  # rows next to an edge that a larger level takes from the same rows of its table
ZERO = np.float32(0.0)


@kernel
def _entry(i: Scalar, half: Scalar, entries: Scalar) -> Scalar:
    """Row of the table for the ``i``-th row from the edge of a level with ``2 half`` rows."""
    return i if i < EXACT else max(i * entries // half, EXACT)


@kernel
def _gather_row(fine: Float32Array, coarse: Float32Array, weights: Float32Array, i: Scalar) -> None:
    """One row of one face: rows are counted by face first."""
    n, width, across = coarse.shape[1] - 2 * PAD, fine.shape[1], coarse.shape[1]
    half, entries, last = n // 2, weights.shape[0], width - TAPS
    row, face = i // 6, i % 6
    inner = min(row, n - 1 - row)
    top = max(2 * inner + PAD + 1 - TAPS // 2, 0)
    entry, step = _entry(inner, half, entries) * entries, TAPS
    if row >= half:
        top, step = last - top, -TAPS
    first = (TAPS - 1) * TAPS if row >= half else 0
    source, target, table = fine.reshape(-1), coarse.reshape(-1), weights.reshape(-1)
    begin = ((face * across + row + PAD) * across + PAD) * 4
    start = (face * width + top) * width
    for col in range(half):
        left = max(2 * col + PAD + 1 - TAPS // 2, 0)
        at = (entry + _entry(col, half, entries)) * (TAPS * TAPS) + first
        place = begin + 4 * col
        gather(source, (start + left) * 4, width * 4, table, at, step, target, place)
        place = begin + 4 * (n - 1 - col)
        left = last - left
        gather_mirrored(source, (start + left) * 4, width * 4, table, at, step, target, place)


@parallel_kernel
def _gather_level(
    fine: Float32Array, coarse: Float32Array, weights: Float32Array, table: Int64Array
) -> None:
    """A level from the one above, both (6, n + 2 PAD, n + 2 PAD, 4), with its rings."""
    rows = 6 * (coarse.shape[1] - 2 * PAD)
    if rows <= 6 * SERIAL:
        for i in range(rows):
            _gather_row(fine, coarse, weights, i)
    else:
        for i in numba.prange(rows):
            _gather_row(fine, coarse, weights, i)
    k_fill_seams(coarse, table)


@kernel
def _average_level(
    fine: Float32Array, coarse: Float32Array, weights: Float32Array, table: Int64Array
) -> None:
    """A level of a few texels, each from all texels of the level above."""
    n, m = coarse.shape[1] - 2 * PAD, fine.shape[1] - 2 * PAD
    for i in range(6 * n * n):
        r = g = b = ZERO
        for k in range(6 * m * m):
            w = weights[i, k]
            texel = fine[k // (m * m), k // m % m + PAD, k % m + PAD]
            r += w * texel[0]
            g += w * texel[1]
            b += w * texel[2]
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
