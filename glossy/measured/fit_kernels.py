"""Kernel of the grid search: the metric of many candidates over all rows of a table.

Candidates are spread over the threads; each one's sum runs over the rows in their order, so it has
the same bits for any number of threads. ``f`` (9, K) are the features of ``fit_rows``; the metrics
are numbered as in ``fit_metrics.METRICS``.

Only the grid has a kernel: it shares each row's exponential among all (r0, ks). One whole
parameter set after the other is quicker in NumPy, whose exponential takes several rows at a time.
"""

import numpy as np
import numpy.typing as npt

from .._jit import Scalar, kernel, row_kernel

Float64Array = npt.NDArray[np.float64]

L1, L2, CUBIC_ROOT, LOG = range(4)
LOBE = 4  # parameters of a lobe before its ks: mx, my, alpha, r0


@kernel
def k_shape(f: Float64Array, k: int, mx: Scalar, my: Scalar, alpha: Scalar, ggx: bool) -> Scalar:
    """P of row ``k``: fit_rows eqs. (2) and (5)."""
    q = f[0, k] / (mx * mx) + f[1, k] / (my * my)
    if ggx:
        si = np.sqrt(1.0 + mx * mx * f[5, k] + my * my * f[6, k])
        so = np.sqrt(1.0 + mx * mx * f[7, k] + my * my * f[8, k])
        return 2.0 * f[4, k] / ((si + so) * mx * my * (1.0 + q) * (1.0 + q))
    return f[4, k] * np.exp(-q - alpha * f[3, k]) / (mx * my)


@kernel
def k_transform(y: Scalar, metric: int) -> Scalar:
    """What the metric compares: y, its cubic root or ln(1 + y), odd in y."""
    if metric == CUBIC_ROOT:
        return np.cbrt(y)
    if metric == LOG:
        return np.copysign(np.log1p(abs(y)), y)
    return y


@row_kernel
def grid_kernel(
    begin: int,
    end: int,
    f: Float64Array,
    target: Float64Array,
    base: Float64Array,
    weight: Float64Array,
    shapes: Float64Array,
    pairs: Float64Array,
    metric: int,
    ggx: bool,
    out: Float64Array,
) -> None:
    """Sums (N, M) over rows for every shape (N, 3) with every linear pair (2, M).

    The model is base + a P + b S P. P is shared by the M pairs, whose loop has no other cost than
    its arithmetic; each sum runs over the rows in their order.
    """
    a, b = pairs[0], pairs[1]
    for n in range(begin, end):
        total = np.zeros(pairs.shape[1])
        for k in range(target.size):
            p = k_shape(f, k, shapes[n, 0], shapes[n, 1], shapes[n, 2], ggx)
            s = f[2, k] * p
            t, w = target[k], weight[k]
            if metric == L1:
                rest = t - base[k]
                for m in range(total.size):
                    total[m] += w * abs(rest - a[m] * p - b[m] * s)
            elif metric == L2:
                rest = t - base[k]
                for m in range(total.size):
                    d = rest - a[m] * p - b[m] * s
                    total[m] += w * (d * d)
            else:
                for m in range(total.size):
                    d = t - k_transform(base[k] + a[m] * p + b[m] * s, metric)
                    total[m] += w * (d * d)
        out[n] = total
