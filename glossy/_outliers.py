"""Figures of single pixels: what each misses, how many miss too much, and percentiles.

Over the channels of test a and reference b a pixel misses ::

    e = max (|a - b| - R |b|)            R = 0 unless a share of the reference is allowed     (1)

and is an outlier if e > X: NumPy's ``isclose``, by pixel. The p-th percentile of e at R = 0 is the
least value that p percent of the pixels do not exceed, so it is one that occurs.
"""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import TypeVar

import numpy as np

from ._sweep import BLOCK, Float64Array, Mask, Plane, spread

T = TypeVar("T")


def count_outliers(
    a: Sequence[Plane],
    b: Sequence[Plane],
    mask: Mask | None,
    absolute: float,
    relative: float = 0.0,
) -> int:
    """Pixels with e above ``absolute``, eq. (1) with R ``relative``; channels (H, W), finite."""
    found = _by_block(a, b, mask, relative, lambda e: int(np.count_nonzero(e > absolute)))
    return sum(found)


def percentiles_of(
    a: Sequence[Plane], b: Sequence[Plane], mask: Mask | None, wanted: Sequence[float]
) -> list[float]:
    """The ``wanted`` percentiles of e over the pixels where ``mask`` is true."""
    values = np.concatenate(_by_block(a, b, mask, 0.0, lambda e: e.copy()))
    ranks = [max(math.ceil(Fraction(repr(float(p))) * values.size / 100), 1) - 1 for p in wanted]
    values.partition(sorted(set(ranks)))
    return [float(values[rank]) for rank in ranks]


def _by_block(
    a: Sequence[Plane],
    b: Sequence[Plane],
    mask: Mask | None,
    relative: float,
    use: Callable[[Float64Array], T],
) -> list[T]:
    # what ``use`` makes of e, eq. (1), in each block of rows that holds a compared pixel
    height, width = a[0].shape
    rows = max(1, BLOCK // width)
    blocks = -(-height // rows)
    found: dict[int, T] = {}

    def work(first: int, step: int) -> None:
        for k in range(first, blocks, step):
            y = slice(k * rows, (k + 1) * rows)
            keep = slice(None) if mask is None else mask[y]
            worst: Float64Array | None = None
            for first_plane, second_plane in zip(a, b, strict=True):
                p, q = (
                    np.ravel(v[y][keep]).astype(np.float64) for v in (first_plane, second_plane)
                )
                with np.errstate(all="ignore"):
                    p -= q
                    np.abs(p, out=p)
                    if relative:
                        p -= relative * np.abs(q)
                        p[np.isnan(p)] = np.inf  # both beyond float64
                worst = p if worst is None else np.maximum(worst, p, out=worst)
            if worst is not None and worst.size:
                found[k] = use(worst)

    spread(work, blocks, height * width * len(a))
    return [found[k] for k in sorted(found)]
