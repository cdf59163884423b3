"""How much of level 0 each texel of a ``round`` level stands for.

A level's texels average level 0 with weights k_q(x) that sum to one over x, not over q: where their
width changes along the sphere, the wider ones reach over to the narrower ones' place. The shares S
of the texels are what covers level 0 once, ::

    sum_q S(q) k_q(x) = Omega(x)                                                               (1)

as far as non-negative S can: from S = Omega by the Richardson-Lucy iteration

    S(q) <- S(q) sum_x k_q(x) Omega(x) / (sum_q' S(q') k_q'(x))                                (2)

A few steps are enough for what is smooth, and keep S smooth. Level by level: the texels x are those
of the level above, and Omega their shares.

Weights of windows are those of a face's first quarter; every face and quarter has the same, so that
a texel beyond an edge, or beyond the middle, is its own mirror image.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ._gather import TAPS

Float64Array = npt.NDArray[np.float64]

RING = TAPS // 2 - 1  # texels beyond an edge that a window reaches
ROUNDS = 8


def mean(weights: Float64Array, fine: Float64Array) -> Float64Array:
    """What windows with ``weights`` (h, h, TAPS, TAPS) average of a symmetric (2h, 2h) map."""
    n = fine.shape[0]
    padded = np.pad(fine, RING, mode="symmetric")
    out = np.zeros(weights.shape[:2])
    for i in range(TAPS):
        for j in range(TAPS):
            out += weights[..., i, j] * padded[i : i + n : 2, j : j + n : 2]
    return out


def spread(weights: Float64Array, coarse: Float64Array) -> Float64Array:
    """The transpose of ``mean``: (2h, 2h) from (h, h)."""
    n = 2 * coarse.shape[0]
    out = np.zeros((n + 2 * RING, n + 2 * RING))
    for i in range(TAPS):
        for j in range(TAPS):
            out[i : i + n : 2, j : j + n : 2] += weights[..., i, j] * coarse
    for _ in range(2):  # rows, then columns
        out[RING : 2 * RING] += out[RING - 1 :: -1]
        out[-2 * RING : -RING] += out[: -RING - 1 : -1]
        out = out[RING:-RING].T
    return out


def share(
    spread: Callable[[Float64Array], Float64Array],
    mean: Callable[[Float64Array], Float64Array],
    start: Float64Array,
    goal: Float64Array,
) -> Float64Array:
    """Eq. (2) from ``start``; ``spread``: the sum over q, ``mean``: that over x."""
    found = start
    for _ in range(ROUNDS):
        found = found * mean(goal / spread(found))
    return found
