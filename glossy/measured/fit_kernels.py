"""Kernels of the fit: the metric of many candidates over all rows of a table.

Candidates are spread over the threads; each one's sum runs over the rows in their order, so it has
the same bits for any number of threads. ``f`` (9, K) are the features of ``fit_rows``; the metrics
are numbered as in ``fit_metrics.METRICS``.
"""

import numba
import numpy as np
import numpy.typing as npt

from .._jit import Scalar, kernel, parallel_kernel

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


@kernel
def k_error(
    f: Float64Array,
    diffuse: Float64Array,
    measured: Float64Array,
    weight: Float64Array,
    p: Float64Array,
    metric: int,
    ggx: bool,
    sign: float,
) -> float:
    """Sum of fit_metrics eqs. (1)-(4), before division and root, for one parameter set (P,).

    A set is kd of every channel, then mx, my, alpha, r0 and ks of every channel for each lobe. Also
    called from Python, where waking other threads for one candidate would cost more than it.
    """
    channels = measured.shape[1]
    lobes = (p.size - channels) // (LOBE + channels)
    total = 0.0
    model = np.empty(channels)
    for k in range(measured.shape[0]):
        for c in range(channels):
            model[c] = p[c] * diffuse[k]
        for j in range(lobes):
            at = channels + j * (LOBE + channels)
            fresnel = p[at + 3] + (1.0 - p[at + 3]) * f[2, k]
            if sign < 0.0:
                fresnel = 1.0 - fresnel
            value = fresnel * k_shape(f, k, p[at], p[at + 1], p[at + 2], ggx)
            for c in range(channels):
                model[c] += p[at + LOBE + c] * value
        for c in range(channels):
            if weight[k, c] > 0.0:
                d = measured[k, c] - k_transform(model[c], metric)
                total += weight[k, c] * (abs(d) if metric == L1 else d * d)
    return total


@parallel_kernel
def errors_kernel(
    f: Float64Array,
    diffuse: Float64Array,
    measured: Float64Array,
    weight: Float64Array,
    parameters: Float64Array,
    metric: int,
    ggx: bool,
    sign: float,
    out: Float64Array,
) -> None:
    """``k_error`` of every parameter set (N, P)."""
    for n in numba.prange(parameters.shape[0]):
        out[n] = k_error(f, diffuse, measured, weight, parameters[n], metric, ggx, sign)


@parallel_kernel
def grid_kernel(
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
    for n in numba.prange(shapes.shape[0]):
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
