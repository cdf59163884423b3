"""One measurement: error figures, the best level bias, and the time a picture takes.

Errors e = image - truth run over the covered pixels and channels; s is the squared error of a
pixel summed over its channels, L a luminance ::

    spread    = (sum s)^2 / (K sum s^2)     share of the K pixels that carry the error     (1)
    roughness = sqrt(mean (e_a - e_b)^2 / 2) / rms over neighbours a, b                    (2)
    dark_bias = sum (L_image - L_truth) / sum L_truth over the darker half of the pixels   (3)

An error that alternates from pixel to pixel like white noise has roughness 1, a smooth one less.
"""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from .._threads import using

FloatArray = npt.NDArray[np.floating]
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])

COARSE = tuple(np.arange(-2.5, 1.51, 0.5).tolist())
FURTHER = 4  # steps beyond the coarse grid, should the best lie on its edge
GOLDEN = 0.5 * (5.0**0.5 - 1.0)
GOLDEN_STEPS = 5

BLOCK = 0.02  # seconds of CPU time that a timed block lasts at least


@dataclasses.dataclass(frozen=True)
class Figures:
    """Error of one image; ``psnr`` uses ``peak``, the truth's largest value. None: no error."""

    rms: float
    relative_rms: float
    psnr: float | None
    peak: float
    max_error: float
    spread: float
    roughness: float
    dark_bias: float


class Judge:
    """The truth of the covered pixels, and what is wrong with an image of them.

    Parameters
    ----------
    truth : (K, 3) array
        Ground truth of the covered pixels, row by row.
    seen : (H, W) array of bool
        Where they lie in the picture.
    """

    def __init__(self, truth: FloatArray, seen: npt.NDArray[np.bool_]) -> None:
        self.truth = np.asarray(truth, dtype=np.float64)
        self.level = float(np.sqrt(np.mean(np.square(self.truth))))
        self.peak = float(self.truth.max())
        index = np.full(seen.shape, -1)
        index[seen] = np.arange(len(self.truth))
        pairs = [(index[:, :-1], index[:, 1:]), (index[:-1], index[1:])]
        a, b = (np.concatenate([p[k].ravel() for p in pairs]) for k in (0, 1))
        both = (a >= 0) & (b >= 0)
        self.neighbours = a[both], b[both]
        luminance = self.truth @ LUMINANCE
        self.dark = luminance <= np.median(luminance)
        self.dark_level = float(luminance[self.dark].sum())

    def rms(self, image: FloatArray, pick: slice | npt.NDArray[np.intp] | None = None) -> float:
        """RMS error of (a subset of) the pixels."""
        truth = self.truth if pick is None else self.truth[pick]
        return float(np.sqrt(np.mean(np.square(image - truth))))

    def figures(self, image: FloatArray) -> Figures:
        """All figures of an image (K, 3)."""
        e = np.asarray(image, dtype=np.float64) - self.truth
        s = np.sum(e * e, axis=-1)
        rms = self.rms(image)
        a, b = self.neighbours
        jump = float(np.sqrt(np.mean(np.square(e[a] - e[b])) / 2.0)) if len(a) else 0.0
        fourth = float(np.sum(s * s))
        return Figures(
            rms=rms,
            relative_rms=rms / self.level if self.level > 0.0 else 0.0,
            psnr=20.0 * float(np.log10(self.peak / rms)) if rms > 0.0 < self.peak else None,
            peak=self.peak,
            max_error=float(np.abs(e).max()),
            spread=float(np.sum(s)) ** 2 / (len(s) * fourth) if fourth > 0.0 else 0.0,
            roughness=jump / rms if rms > 0.0 else 0.0,
            dark_bias=float((e @ LUMINANCE)[self.dark].sum()) / max(self.dark_level, 1e-300),
        )


def best_bias(error: Callable[[float], float]) -> tuple[float, list[tuple[float, float]]]:
    """The level bias of least error: a coarse grid, golden section, a parabola at the end.

    Parameters
    ----------
    error : function of the bias
        Evaluated 9 times on a grid from -2.5 to 1.5, further while the best lies on its edge, then
        about 8 times within one step of the best.

    Returns
    -------
    (bias, every (bias, error) tried, in order); the bias is one of those tried.
    """
    tried: dict[float, float] = {}

    def at(bias: float) -> float:
        key = round(bias, 4)
        if key not in tried:
            tried[key] = error(key)
        return tried[key]

    grid = list(COARSE)
    for bias in grid:
        at(bias)
    for _ in range(FURTHER):
        best = min(tried, key=tried.__getitem__)
        if best == min(tried):
            at(best - 0.5)
        elif best == max(tried):
            at(best + 0.5)
        else:
            break
    centre = min(tried, key=tried.__getitem__)
    low, high = centre - 0.5, centre + 0.5
    a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    for _ in range(GOLDEN_STEPS):
        if at(a) <= at(b):
            high, b = b, a
            a = high - GOLDEN * (high - low)
        else:
            low, a = a, b
            b = low + GOLDEN * (high - low)
    x = sorted(sorted(tried, key=tried.__getitem__)[:3])
    at(float(np.clip(_vertex(x, [tried[k] for k in x]), low, high)))
    return min(tried, key=tried.__getitem__), list(tried.items())


def _vertex(x: list[float], y: list[float]) -> float:
    """Where the parabola through three points is lowest; the middle point if it opens downwards."""
    left, right = (y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1])
    bend = (right - left) / (x[2] - x[0])
    return x[1] if bend <= 0.0 else 0.5 * (x[0] + x[1]) - 0.5 * left / bend


@dataclasses.dataclass(frozen=True)
class Timing:
    """How long a picture takes on one thread, in seconds for each call of a timed block.

    ``seconds``: median wall time of the blocks ``runs``; ``cpu_seconds``: least CPU time of them;
    ``cpu_ratio``: that over the baseline's least, which is timed in turn with the picture;
    ``calls``: in each block. On one thread nothing waits for another thread, so other work on the
    machine lengthens the wall time and hardly the CPU time; what is left divides out of the ratio.
    """

    seconds: float
    runs: list[float]
    calls: list[int]
    cpu_seconds: float
    cpu_ratio: float


def timed(run: Callable[[], Any], baseline: Callable[[], Any], repeats: int) -> tuple[Any, Timing]:
    """What ``run`` returns, and its time; both functions must be warm.

    Each of ``repeats`` blocks calls ``run`` until ``BLOCK`` seconds of CPU time have passed, then
    ``baseline`` as often.
    """
    wall: list[float] = []
    cpu: list[float] = []
    base: list[float] = []
    calls: list[int] = []
    result = None
    with using(1):
        for _ in range(repeats):
            count = 0
            clock, start = time.perf_counter(), time.process_time()
            while (spent := time.process_time() - start) < BLOCK or count == 0:
                result = run()
                count += 1
            wall.append((time.perf_counter() - clock) / count)
            cpu.append(spent / count)
            start = time.process_time()
            for _ in range(count):
                baseline()
            base.append((time.process_time() - start) / count)
            calls.append(count)
    ratio = min(cpu) / max(min(base), 1e-9)
    return result, Timing(float(np.median(wall)), wall, calls, min(cpu), ratio)
