"""Hierarchical grid search for one lobe, thesis section 3.4.1.

n equidistant values between the bounds of each free parameter are tried in every combination; the
box shrinks to the best one +- range / (n - 1), cut at the bounds; and so on, level by level::

    next box = [best - range / (n - 1), best + range / (n - 1)]                          (1)

Equidistant means in the parameter itself; with ``spacing="log"``, in ln m and in the cubic root of
ks, which reach sharp and weak lobes that an even grid steps over. The n^3 shapes (mx, my,
alpha) cost an exponential a row each; the n^2 pairs (r0, ks) enter linearly and cost a few
multiplications, so a level of 9^5 combinations over 10 000 rows takes a fraction of a second.
"""

import itertools

import numpy as np
import numpy.typing as npt

from .fit_kernels import LOBE
from .fit_metrics import grid_errors
from .fit_rows import Rows
from .fit_space import Space

Float64Array = npt.NDArray[np.float64]


def linear_pair(ks: Float64Array, r0: Float64Array, sign: float) -> Float64Array:
    """(2, M): the factors of P and of S P, fit_rows eq. (1)."""
    if sign > 0.0:
        return np.stack([ks * r0, ks * (1.0 - r0)])
    return np.stack([ks * (1.0 - r0), -ks * (1.0 - r0)])


def search_lobe(
    rows: Rows,
    space: Space,
    target: Float64Array,
    base: Float64Array,
    code: int,
    n: int,
    levels: int,
    spacing: str = "log",
) -> tuple[Float64Array, float, int]:
    """The best lobe that the grid finds.

    Parameters
    ----------
    rows : Rows
        Of one channel.
    space : Space
        Of one lobe and one channel; its kd plays no part.
    target, base : (K,) arrays
        What is to be met, and what the model already has, both as y.
    code, n, levels : int
        Metric, values on each axis, refinements.
    spacing : str
        "log" or "linear": in what the values of mx, my and ks are equidistant.

    Returns
    -------
    parameters (5,): mx, my, alpha, r0, ks; the sum of the metric; the number of evaluations.
    """
    at = space.at(0)
    low, high = space.low[at:].copy(), space.high[at:].copy()
    scale = space.logarithmic[at:] & (spacing == "log")
    low[scale], high[scale] = np.log(low[scale]), np.log(high[scale])
    power = 3.0 if spacing == "log" else 1.0
    low[LOBE], high[LOBE] = low[LOBE] ** (1.0 / power), high[LOBE] ** (1.0 / power)
    left, right = low.copy(), high.copy()
    best, best_error, count = low.copy(), np.inf, 0
    for _ in range(levels):
        axes = [
            np.linspace(a, b, n) if b > a else np.array([a])
            for a, b in zip(left, right, strict=True)
        ]
        if space.tied:
            points = np.array([(x, x, z) for x, z in itertools.product(axes[0], axes[2])])
        else:
            points = np.array(list(itertools.product(*axes[:3])))
        shapes = points.copy()
        shapes[:, scale[:3]] = np.exp(shapes[:, scale[:3]])
        r0, ks = (v.ravel() for v in np.meshgrid(axes[3], axes[LOBE], indexing="ij"))
        sums = grid_errors(rows, target, base, shapes, linear_pair(ks**power, r0, rows.sign), code)
        i, m = np.unravel_index(int(np.argmin(sums)), sums.shape)
        count += sums.size
        if sums[i, m] < best_error:
            best_error = float(sums[i, m])
            best = np.array([*points[i], r0[m], ks[m]])
        reach = (right - left) / (n - 1)
        left, right = np.maximum(best - reach, low), np.minimum(best + reach, high)
    best[scale] = np.exp(best[scale])
    best[LOBE] **= power
    return best, best_error, count
