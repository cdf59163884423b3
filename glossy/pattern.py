"""Sample patterns: half vectors of one lobe, shared by every pixel, and their density constant.

A regular pattern fills the lobe with n_c circles about the pole, evenly spaced by s in theta out to
theta_max, where the widest axis of the lobe has fallen to the threshold xi0::

    theta_max = arctan( sqrt(-ln xi0) max(mx, my) )                                 (1)
    s1:  theta_i = i s,         s = theta_max / (n_c - 1/2),      circles 0, 1: 1, 6 samples
    s2:  theta_i = (r0 + i) s,  s = theta_max / (n_c - 1/2 + r0), circle 0: 4, r0 = 1/sqrt(2)
    n_i = 2 floor( n_first sin theta_i / (2 sin theta_first) + 1/2 )                (2)
    exp(q) < xi0 is rejected,   q = -(hx/hz/mx)^2 - (hy/hz/my)^2                    (3)

Each circle starts at phi = 0 or half a sample later, whichever keeps the larger sum of exp(q);
equal sums (relative 1e-9) take phi = 0. The importance pattern sends Hammersley points through the
lobe's sampling, (hx, hy)/hz = sqrt(-ln xi1) (mx cos 2 pi xi2, my sin 2 pi xi2). The constants::

    pdf_constant           = mean of D(h),  D = exp(q) / (pi mx my hz^4)     [1/sr] (4)
    projected_pdf_constant = mean of D(h) hz                                 [1/sr] (5)

Source: the regular sampling paper, eqs. 11-13 and 18. Departures: its eq. 12 cannot be read, (2)
is the reading that gives every published count; the sum that decides between the two starts runs
over the kept samples. (5) is ours: with it, dense patterns tend to the integral.
"""

import dataclasses
import functools
import math
import pathlib
from typing import Protocol

import numpy as np
import numpy.typing as npt

from . import _check
from .lowdiscrepancy import hammersley

Float64Array = npt.NDArray[np.float64]

M_MIN, M_MAX = 1e-5, 10.0  # as of Lobe, which would load the compiler
SPACINGS = ("s1", "s2")
MAX_SAMPLES = 10_000_000
R0 = math.sqrt(0.5)


class HasWidths(Protocol):
    """A Lobe, without loading the compiler it comes with."""

    @property
    def widths(self) -> tuple[float, float]:
        """(mx, my)."""


Widths = HasWidths | tuple[float, float]


def widths_of(lobe: Widths) -> tuple[float, float]:
    """(mx, my) of a Lobe or of a pair of numbers."""
    pair = getattr(lobe, "widths", lobe)
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise _check.fail("lobe", "must be a Lobe or its widths (mx, my)", lobe)
    mx, my = (_check.in_range(n, m, M_MIN, M_MAX) for n, m in zip(("mx", "my"), pair, strict=True))
    return mx, my


def _exponent(h: Float64Array, mx: float, my: float) -> Float64Array:
    """Exponent q of eq. (3), shape (n,)."""
    with np.errstate(over="ignore"):
        return np.asarray(-((h[:, 0] / h[:, 2] / mx) ** 2) - (h[:, 1] / h[:, 2] / my) ** 2)


def distribution(h: Float64Array, mx: float, my: float) -> Float64Array:
    """D(h) of eq. (4) [1/sr], shape (n,)."""
    return np.exp(_exponent(h, mx, my) - 4.0 * np.log(h[:, 2])) / (math.pi * mx * my)


@dataclasses.dataclass(frozen=True, init=False, eq=False)
class Pattern:
    """Half vectors in the frame (t, b, n), with what the estimators need to know of them.

    Parameters
    ----------
    half_vectors : (n, 3) array
        Unit within 1e-3, then renormalised; hz > 0.
    cell : float or (n,) array, optional [sr]
        Solid angle of half vectors that a sample stands for. Regular: s^2; importance: 1/(n p_h).
        From the lobe if not given: equal cells that give the lobe's D hz the integral 1.
    pdf_constant, projected_pdf_constant : float, optional [1/sr]
        Eqs. (4) and (5); computed from ``lobe`` if not given.
    lobe : Lobe or (mx, my), optional
        The lobe the pattern samples.
    method, spacing, circles, threshold : optional
        How the pattern was made, for the record.

    Attributes
    ----------
    widths : (mx, my), or None without a lobe.

    Raises
    ------
    ValueError
        For a wrong shape, vectors not unit or not above the surface, or values not positive.
    """

    half_vectors: Float64Array
    cell: float | Float64Array | None
    pdf_constant: float | None
    projected_pdf_constant: float | None
    widths: tuple[float, float] | None
    method: str
    spacing: str | None
    circles: int | None
    threshold: float | None

    def __init__(
        self,
        half_vectors: npt.ArrayLike,
        cell: npt.ArrayLike | None = None,
        pdf_constant: float | None = None,
        projected_pdf_constant: float | None = None,
        lobe: Widths | None = None,
        method: str = "table",
        spacing: str | None = None,
        circles: int | None = None,
        threshold: float | None = None,
    ) -> None:
        h = _check.unit_vectors("half_vectors", half_vectors)
        if h.ndim != 2 or len(h) == 0:
            raise _check.fail("half_vectors", "must have shape (n, 3) with n >= 1", h.shape)
        if np.any(h[:, 2] <= 0.0):
            worst = h[np.argmin(h[:, 2])].tolist()
            raise _check.fail("half_vectors", "must lie above the surface (z > 0)", worst)
        widths = None if lobe is None else widths_of(lobe)
        if widths is not None:
            d = distribution(h, *widths)
            if pdf_constant is None:
                pdf_constant = float(d.mean())
            if projected_pdf_constant is None:
                projected_pdf_constant = float((d * h[:, 2]).mean())
            if cell is None and projected_pdf_constant > 0.0:
                cell = 1.0 / (len(h) * projected_pdf_constant)
        values = {
            "half_vectors": _check.frozen(h),
            "cell": _cell(cell, len(h)),
            "pdf_constant": _constant("pdf_constant", pdf_constant),
            "projected_pdf_constant": _constant("projected_pdf_constant", projected_pdf_constant),
            "widths": widths,
            "method": method,
            "spacing": spacing,
            "circles": circles,
            "threshold": threshold,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.half_vectors)

    def export(self, form: str = "json", path: str | pathlib.Path | None = None) -> str:
        """The pattern as json, csv, glsl, hlsl or wgsl text; written to ``path`` if given.

        The shader forms declare a constant array of half vectors, their count and both density
        constants, each number in the shortest digits that give the same float32 again.

        Raises
        ------
        ValueError
            For an unknown format.
        """
        from .export.tables import export

        return export(self, form, path)


def _constant(name: str, value: float | None) -> float | None:
    return None if value is None else _check.positive(name, value)


def _cell(value: npt.ArrayLike | None, n: int) -> float | Float64Array | None:
    """A positive number, or n of them, read-only."""
    if value is None:
        return None
    cells = np.array(_check.array("cell", value), dtype=np.float64)
    if cells.ndim == 0:
        return _check.positive("cell", value)
    if cells.shape != (n,):
        raise _check.fail("cell", f"must be a number or have shape ({n},)", cells.shape)
    if not (np.all(np.isfinite(cells)) and np.all(cells > 0.0)):
        raise _check.fail("cell", "must be finite and positive", float(cells.min()))
    cells.flags.writeable = False
    return cells


@dataclasses.dataclass(frozen=True)
class _Circles:
    """The circles of a regular pattern before rejection; arrays over the circles but the pole.

    ``arc`` is the half-width in phi, about the lobe's longer axis, of what the lobe's border
    leaves of the circle; pi/2 when it is all inside.
    """

    step: float
    pole: bool
    theta: Float64Array
    count: npt.NDArray[np.int64]
    arc: Float64Array

    @property
    def bounds(self) -> tuple[int, int]:
        """At least and at most so many samples are kept, whichever way the circles start.

        An arc w of a circle with samples d apart holds floor(w/d) or one more. Either start puts
        samples on the longer axis, and the better one never keeps none: at least two.
        """
        per_arc = self.arc / math.pi * self.count
        low = np.maximum(2 * np.floor(per_arc - 1e-9), 2).astype(np.int64)
        high = 2 * np.floor(per_arc + 1e-9).astype(np.int64) + 2
        whole = self.arc >= 0.5 * math.pi
        low, high = (np.where(whole, self.count, np.minimum(b, self.count)) for b in (low, high))
        return int(low.sum()) + self.pole, int(high.sum()) + self.pole


def _circles(mx: float, my: float, circles: int, spacing: str, threshold: float) -> _Circles:
    """Eqs. (1) and (2)."""
    level = -math.log(threshold)
    wide, narrow = max(mx, my), min(mx, my)
    theta_max = math.atan(math.sqrt(level) * wide)
    if spacing == "s1":
        step, first = theta_max / (circles - 0.5), 6
        theta = step * np.arange(1, circles)
    else:
        step, first = theta_max / (circles - 0.5 + R0), 4
        theta = step * (R0 + np.arange(circles))
    ratio = np.sin(theta) / np.sin(theta[:1])
    count = 2 * np.floor(0.5 * first * ratio + 0.5).astype(np.int64)
    slope2 = np.tan(theta) ** 2
    arc = np.full(theta.shape, 0.5 * math.pi)
    cut = slope2 > level * narrow**2 * (1.0 - 1e-12)
    sine2 = (level / slope2[cut] - wide**-2.0) / (narrow**-2.0 - wide**-2.0) if wide > narrow else 1
    arc[cut] = np.arcsin(np.sqrt(np.clip(sine2, 0.0, 1.0)))
    return _Circles(step, spacing == "s1", np.asarray(theta, dtype=np.float64), count, arc)


def _place(
    c: _Circles, mx: float, my: float, threshold: float, shift: float
) -> tuple[npt.NDArray[np.int64], Float64Array, Float64Array]:
    """Kept samples of half of every circle, started ``shift`` samples after phi = 0.

    Returns the circle of each sample, its phi, and the sum of exp(q) per circle. Counts are even,
    so the other half is the same half a turn further. Only the arc within the border is generated:
    a thousand times longer than wide, a lobe keeps few of a circle's samples.
    """
    axis = 0.0 if mx >= my else 0.5 * math.pi
    half = c.count // 2
    delta = 2.0 * math.pi / c.count
    low = np.floor((axis - c.arc) / delta - shift).astype(np.int64)
    high = np.ceil((axis + c.arc) / delta - shift).astype(np.int64)
    whole = high - low + 1 >= half
    low, number = np.where(whole, 0, low), np.where(whole, half, high - low + 1)
    circle = np.repeat(np.arange(c.theta.size), number)
    k = np.arange(circle.size) - np.repeat(np.cumsum(number) - number, number) + low[circle]
    k = k % half[circle]
    phi = (k + shift) * delta[circle]
    slope = np.tan(c.theta)[circle]
    q = -((slope * np.cos(phi) / mx) ** 2) - (slope * np.sin(phi) / my) ** 2
    value = np.exp(q)
    kept = value >= threshold
    sums = np.bincount(circle[kept], weights=value[kept], minlength=c.theta.size)
    return circle[kept], phi[kept], sums.astype(np.float64, copy=False)


def _half_vectors(c: _Circles, mx: float, my: float, threshold: float) -> Float64Array:
    """The pattern, circle by circle from the pole outwards, phi rising."""
    placed = [_place(c, mx, my, threshold, shift) for shift in (0.0, 0.5)]
    later = placed[1][2] > placed[0][2] * (1.0 + 1e-9)
    chosen = [(circle, phi, later[circle] == bool(j)) for j, (circle, phi, _) in enumerate(placed)]
    circle = np.concatenate([np.tile(i[use], 2) for i, _, use in chosen])
    phi = np.concatenate([p for _, phi, use in chosen for p in (phi[use], phi[use] + math.pi)])
    order = np.lexsort((phi, circle))
    theta, phi = c.theta[circle[order]], phi[order]
    around = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    around[np.abs(around) < 1e-15] = 0.0  # samples on an axis lie on it
    h = np.concatenate([np.sin(theta)[:, None] * around, np.cos(theta)[:, None]], axis=-1)
    return np.concatenate([[[0.0, 0.0, 1.0]], h]) if c.pole else h


def regular_pattern(
    lobe: Widths, circles: int = 3, spacing: str = "s2", threshold: float = 0.1
) -> Pattern:
    """Regular pattern of ``circles`` concentric circles.

    Parameters
    ----------
    lobe : Lobe or (mx, my)
    circles : int >= 1
        n_c. With one circle ``s1`` is the pole alone.
    spacing : "s1" or "s2"
        Where the innermost circle lies.
    threshold : float in (0, 1)
        xi0: the fraction of the lobe's peak, in exp(q), at which the pattern ends.

    Returns
    -------
    Pattern; the count, ``len``, follows from the shape of the lobe. ``cell`` is s^2: a nominal
    value, for six samples on a circle of radius s (s1) or four on r0 s (s2) are fewer than the
    circumference has room for, and s^2 each covers 0.955 (s1) or 0.900 (s2) of a dense pattern.

    Raises
    ------
    ValueError
        For an argument out of range, or for more than ten million samples.
    """
    mx, my = widths_of(lobe)
    n_c = _check.count("circles", circles)
    _check.choice("spacing", spacing, SPACINGS)
    xi0 = _check.in_range("threshold", threshold, 0.0, 1.0, open_low=True, open_high=True)
    return _regular(mx, my, n_c, spacing, xi0)


@functools.lru_cache(maxsize=256)
def _regular(mx: float, my: float, circles: int, spacing: str, threshold: float) -> Pattern:
    c = _circles(mx, my, circles, spacing, threshold)
    if c.bounds[1] > MAX_SAMPLES:
        raise _check.fail("circles", f"must place at most {MAX_SAMPLES} samples", circles)
    h = _half_vectors(c, mx, my, threshold)
    made = {"spacing": spacing, "circles": circles, "threshold": threshold}
    return Pattern(h, cell=c.step**2, lobe=(mx, my), method="regular", **made)  # type: ignore[arg-type]


def pattern_for_budget(lobe: Widths, samples: int = 20, threshold: float = 0.1) -> Pattern:
    """The regular pattern whose count is nearest to ``samples``.

    Both spacings are tried with 1, 2, ... circles until each holds twice the budget. Of equally
    near counts the smaller wins, then ``s1``, then fewer circles.

    Parameters
    ----------
    lobe : Lobe or (mx, my)
    samples : int from 1 to 100 000
    threshold : float in (0, 1)

    Raises
    ------
    ValueError
        For an argument out of range.
    """
    mx, my = widths_of(lobe)
    budget = _check.count("samples", samples, 1, 100_000)
    xi0 = _check.in_range("threshold", threshold, 0.0, 1.0, open_low=True, open_high=True)
    return _regular(mx, my, *_search(mx, my, budget, xi0), xi0)


@functools.lru_cache(maxsize=256)
def _search(mx: float, my: float, budget: int, threshold: float) -> tuple[int, str]:
    """Circles and spacing for a budget; patterns that cannot come nearest are not generated."""
    best = (budget, budget, "", 0)  # distance, count, spacing, circles: compared in this order
    circles, least = 0, 0
    while least < 2 * budget:
        circles += 1
        lows = []
        for spacing in SPACINGS:
            c = _circles(mx, my, circles, spacing, threshold)
            low, high = c.bounds
            lows.append(low)
            if low - budget > best[0] or budget - high > best[0]:
                continue
            n = low if low == high else len(_half_vectors(c, mx, my, threshold))
            best = min(best, (abs(n - budget), n, spacing, circles))
        least = min(lows)
    return best[3], best[2]


def importance_pattern(lobe: Widths, samples: int = 40) -> Pattern:
    """Hammersley points sent through the lobe's importance sampling.

    Parameters
    ----------
    lobe : Lobe or (mx, my)
    samples : int >= 1
        The count is exact.

    Returns
    -------
    Pattern; ``cell`` (n,) is 1/(n p_h) with p_h = D(h) hz the density of the half vectors.

    Raises
    ------
    ValueError
        For an argument out of range.
    """
    mx, my = widths_of(lobe)
    xi = hammersley(_check.count("samples", samples, 1, MAX_SAMPLES))
    radius, phi = np.sqrt(-np.log(xi[:, 0])), 2.0 * math.pi * xi[:, 1]
    slopes = np.stack([mx * radius * np.cos(phi), my * radius * np.sin(phi)], axis=-1)
    h = np.concatenate([slopes, np.ones((len(xi), 1))], axis=-1)
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    p_h = distribution(h, mx, my) * h[:, 2]
    return Pattern(h, cell=1.0 / (len(h) * p_h), lobe=(mx, my), method="importance")
