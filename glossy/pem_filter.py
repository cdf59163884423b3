"""The filters of partial environment maps: a 5-tap smoothing of each level after halving.

A level is the 2 x 2 mean of the level above as filtered, then filtered at its own size with five
taps per axis, across seams; level 0 stays as it is. With c = cos(-60, -30, 0, 30, 60 degrees)::

    pem5:box      1                     pem5:cos      c
    pem5:gauss    exp(-k^2 / 2)         pem5:sqrtcos  sqrt(c),     k = -2 ... 2

each normalised. Source: Knuth et al., sections 3.2 to 4; the Gaussian's width is ours, they give
none. Their fifth case, without smoothing, is ``box``.
"""

import math

import numpy as np
import numpy.typing as npt

from ._jit import row_kernel
from ._threads import in_rows
from .seams import PAD, k_fill_seams

Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]


def _normalised(middle: float, next: float, last: float) -> tuple[float, float, float]:
    total = middle + 2.0 * (next + last)
    return middle / total, next / total, last / total


PEM_TAPS = {
    "pem5:box": _normalised(1.0, 1.0, 1.0),
    "pem5:gauss": _normalised(1.0, math.exp(-0.5), math.exp(-2.0)),
    "pem5:cos": _normalised(1.0, math.sqrt(0.75), 0.5),
    "pem5:sqrtcos": _normalised(1.0, 0.75**0.25, math.sqrt(0.5)),
}
"""Weight of the middle, of the next, and of the outermost tap of one axis."""


@row_kernel
def _smooth(
    begin: int, end: int, level: Float32Array, before: Float32Array, taps: Float32Array
) -> None:
    # (6, n + 2 PAD, n + 2 PAD, 4), a copy of it, (3,)
    n = level.shape[1] - 2 * PAD
    for i in range(begin, end):
        face, row = i // n, i % n + PAD
        lines = before[face]
        down = np.empty((n + 2 * PAD, 4), dtype=np.float32)
        for x in range(n + 2 * PAD):
            for c in range(4):
                near = lines[row - 1, x, c] + lines[row + 1, x, c]
                far = lines[row - 2, x, c] + lines[row + 2, x, c]
                down[x, c] = taps[0] * lines[row, x, c] + taps[1] * near + taps[2] * far
        for x in range(PAD, n + PAD):
            for c in range(4):
                near, far = down[x - 1, c] + down[x + 1, c], down[x - 2, c] + down[x + 2, c]
                level[face, row, x, c] = taps[0] * down[x, c] + taps[1] * near + taps[2] * far


def smooth(level: Float32Array, filter: str, table: Int64Array) -> None:
    """Filter a halved level, with its rings, in place."""
    taps = np.array(PEM_TAPS[filter], dtype=np.float32)
    in_rows(_smooth, 6 * (level.shape[1] - 2 * PAD), level, level.copy(), taps, grain=16)
    k_fill_seams(level, table)
