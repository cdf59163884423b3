"""The one pass over two images that all figures of `metrics` are made of."""

import dataclasses
import math
import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check

Plane = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]
Float64Array = npt.NDArray[np.float64]

BLOCK = 65536  # values; four float64 buffers of it (2 MB) stay in cache
UNDERFLOW = 1e-280  # a sum of squares below this has lost digits
LARGEST = 2.0**480  # the square of which can be summed over 2^60 values
SERIAL = 2 * BLOCK  # fewer values than this are not worth a thread
MOST_THREADS = 16
_COLUMNS = ("signed", "absolute", "squared", "reference", "relative", "log")


@dataclasses.dataclass(frozen=True)
class Sums:
    """Sums over the compared values, of both images times ``scale`` (a power of two).

    The sums of squares over b^2 + e and of logarithms are those of the unscaled values.
    ``largest`` is (|a - b| times scale, x, y, channel number).
    """

    table: tuple[tuple[float, ...], ...]
    pixels: int
    scale: float
    largest: tuple[float, int, int, int]

    @property
    def count(self) -> int:
        """Values compared: pixels times channels."""
        return self.pixels * len(self.table)

    def channel(self, column: str, number: int) -> float:
        """One sum of one channel."""
        return self.table[number][_COLUMNS.index(column)]

    def total(self, column: str) -> float:
        """One sum over all channels."""
        return _add([row[_COLUMNS.index(column)] for row in self.table])


def sweep(
    a: Sequence[Plane],
    b: Sequence[Plane],
    mask: Mask | None,
    names: Sequence[str],
    labels: tuple[str, str],
    relative_epsilon: float | None,
    log_epsilon: float | None,
) -> Sums:
    """Sum over channels ``a`` and ``b`` (each (H, W)), where ``mask`` is true.

    Where float64 values, or their differences, are so large or small that their squares leave
    its range, the sweep is repeated on values scaled by a power of two, which is exact. A sum is
    left at 0 whose epsilon is None.

    Raises
    ------
    ValueError
        If a compared value is NaN or infinite; names label, count, first pixel and channel.
    """
    room = LARGEST
    sums = _sweep(a, b, mask, 1.0, relative_epsilon, log_epsilon)
    if not all(math.isfinite(v) for row in sums.table for v in row):
        for label, planes in zip(labels, (a, b), strict=True):
            _refuse_nonfinite(label, planes, mask, names)
        room = 2.0**-8
    elif sums.largest[0] == 0.0 or sums.total("squared") >= UNDERFLOW:
        return sums
    kept = [p if mask is None else p[mask] for p in (*a, *b)]
    top = max(max(abs(float(p.max())), abs(float(p.min()))) for p in kept)
    scale = math.ldexp(1.0, min(math.frexp(room)[1] - math.frexp(top)[1], 1000))
    return _sweep(a, b, mask, scale, relative_epsilon, log_epsilon)


def _sweep(
    a: Sequence[Plane],
    b: Sequence[Plane],
    mask: Mask | None,
    scale: float,
    relative_epsilon: float | None,
    log_epsilon: float | None,
) -> Sums:
    height, width = a[0].shape
    rows = max(1, BLOCK // width)
    blocks = -(-height // rows)
    table = np.zeros((len(a), blocks, len(_COLUMNS)))
    peak = np.full((len(a), blocks), -1.0)
    place = np.zeros((len(a), blocks), dtype=np.int64)

    def work(first: int, step: int) -> None:
        buffers = np.empty((4, rows * width))
        for k in range(first, blocks, step):
            y0, y1 = k * rows, min((k + 1) * rows, height)
            keep = None if mask is None else np.flatnonzero(mask[y0:y1])
            if keep is not None and keep.size == 0:
                continue
            for c in range(len(a)):
                views = [row[: (y1 - y0) * width] for row in buffers]
                for view, plane in zip(views, (a[c], b[c]), strict=False):
                    np.copyto(view.reshape(-1, width), plane[y0:y1])
                    if keep is not None:
                        view[: keep.size] = view[keep]
                if keep is not None:
                    views = [view[: keep.size] for view in views]
                with np.errstate(all="ignore"):
                    out = table[c, k]
                    x, y, t, u = views
                    spot, value = _block(x, y, t, u, scale, relative_epsilon, log_epsilon, out)
                peak[c, k] = value
                place[c, k] = y0 * width + (spot if keep is None else keep[spot])

    spread(work, blocks, height * width * len(a))
    sums = tuple(tuple(_add(column) for column in rows.T.tolist()) for rows in table)
    pixels = height * width if mask is None else int(np.count_nonzero(mask))
    value, index, channel = min(
        (-float(peak[c, k]), int(place[c, k]), c) for c in range(len(a)) for k in range(blocks)
    )
    return Sums(sums, pixels, scale, (-value, index % width, index // width, channel))


def _block(
    x: Float64Array,
    y: Float64Array,
    t: Float64Array,
    u: Float64Array,
    scale: float,
    relative_epsilon: float | None,
    log_epsilon: float | None,
    out: Float64Array,
) -> tuple[int, float]:
    # values of a and b, two buffers, all overwritten -> out in the order of _COLUMNS;
    # place and size of the largest |a - b|
    if scale != 1.0:
        x *= scale
        y *= scale
    np.subtract(x, y, out=t)
    out[0] = t.sum()
    np.abs(t, out=u)
    out[1] = u.sum()
    spot = int(u.argmax())
    value = float(u[spot])
    np.multiply(t, t, out=u)
    out[2] = u.sum()
    np.multiply(y, y, out=t)
    out[3] = t.sum()
    if scale != 1.0:
        out[4:] = _far_from_one(x, y, scale, relative_epsilon, log_epsilon)
        return spot, value
    if relative_epsilon is not None:
        t += relative_epsilon
        u /= t
        out[4] = u.sum()
    if log_epsilon is not None:
        for v in (x, y):
            if v.min() < 0.0:
                np.maximum(v, 0.0, out=v)
            v += log_epsilon
        x /= y
        np.log(x, out=x)
        x *= x
        out[5] = x.sum()
    return spot, value


def _far_from_one(
    x: Float64Array,
    y: Float64Array,
    scale: float,
    relative_epsilon: float | None,
    log_epsilon: float | None,
) -> tuple[float, float]:
    # the last two sums where b^2 or a ratio would leave the range; x, y are a, b times scale
    relative = log = 0.0
    if relative_epsilon is not None:
        t = (x - y) / np.hypot(y, math.sqrt(relative_epsilon) * scale)
        relative = float((t * t).sum())
    if log_epsilon is not None:
        first, second = (np.log(np.maximum(v / scale, 0.0) + log_epsilon) for v in (x, y))
        log = float(((first - second) ** 2).sum())
    return relative, log


def _add(values: list[float]) -> float:
    # the exact sum, rounded once; math.fsum raises where it leaves the range
    try:
        return math.fsum(values)
    except (OverflowError, ValueError):
        return math.inf


def spread(work: Callable[[int, int], None], blocks: int, values: int) -> None:
    """``work(first, step)`` on threads, if there are ``values`` enough; each block by one of them.

    NumPy lets other threads run during a block, and each block has its own place for results.
    """
    threads = 1 if values < SERIAL else min(blocks, _processors())
    if threads == 1:
        work(0, 1)
        return
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(threads) as pool:
        for job in [pool.submit(work, i, threads) for i in range(threads)]:
            job.result()


def _processors() -> int:
    try:
        available = len(os.sched_getaffinity(0))
    except AttributeError:  # not on this system
        available = os.cpu_count() or 1
    return min(available, MOST_THREADS)


def _refuse_nonfinite(
    label: str, planes: Sequence[Plane], mask: Mask | None, names: Sequence[str]
) -> None:
    number, first = 0, (0, "")
    for name, plane in zip(names, planes, strict=True):
        bad = ~np.isfinite(plane)
        if mask is not None:
            bad &= mask
        here = int(np.count_nonzero(bad))
        if here:
            spot = int(np.argmax(bad))
            first = min(first, (spot, name), key=lambda f: f[0]) if number else (spot, name)
            number += here
    if number:
        y, x = divmod(first[0], planes[0].shape[1])
        where = f"the first at x={x}, y={y}, channel {first[1]}"
        raise _check.fail(label, "must be finite", _Words(f"{number} NaN or inf values, {where}"))


class _Words(str):
    """Text that an error message shows without quotation marks."""

    def __repr__(self) -> str:
        return str(self)
