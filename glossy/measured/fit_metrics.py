"""How far a model is from a table: metrics by name.

With y = p |cos theta_i| = f |cos theta_i cos theta_o| and weights w, sums over the non-zero
measurements and all channels::

    l1           sum w |y_meas - y_model| / sum w                                        (1)
    l2           sqrt( sum w (y_meas - y_model)^2 / sum w )                              (2)
    cubic-root   sqrt( sum w (y_meas^(1/3) - y_model^(1/3))^2 / sum w )                  (3)
    log          sqrt( sum w (ln(1 + y_meas) - ln(1 + y_model))^2 / sum w )              (4)

(3) and (4) take the sign out of negative measurements (noise) and put it back.

Sources: (1) thesis eq. 3.7, with the bars of an absolute value; (2) Ngan et al. 2005;
(3) after Fores et al. 2012; (4) the logarithm of the cosine-weighted BSDF after Low et al. 2012.
"""

import math
from typing import cast

import numpy as np
import numpy.typing as npt

from .. import _check
from .._threads import in_rows
from .fit_kernels import CUBIC_ROOT, L1, LOBE, LOG, grid_kernel
from .fit_rows import Rows

Float64Array = npt.NDArray[np.float64]

METRICS = ("l1", "l2", "cubic-root", "log")


def metric_code(metric: str) -> int:
    """Position of a metric's name in ``METRICS``."""
    return METRICS.index(_check.choice("metric", metric, METRICS))


def transform(y: Float64Array, code: int) -> Float64Array:
    """What the metric compares, for arrays."""
    if code == CUBIC_ROOT:
        return np.cbrt(y)
    return np.copysign(np.log1p(np.abs(y)), y) if code == LOG else y


def finish(total: float, weight: float, code: int) -> float:
    """Eqs. (1)-(4) from their sums."""
    mean = total / weight
    return mean if code == L1 else math.sqrt(max(mean, 0.0))


def errors(rows: Rows, target: Float64Array, parameters: Float64Array, code: int) -> Float64Array:
    """Sums of eqs. (1)-(4), before division and root, for parameter sets (N, P).

    A set is kd of every channel, then mx, my, alpha, r0 and ks of every channel for each lobe.
    ``target`` (K, C) is ``transform`` of the measured values, which is made once for many calls.
    """
    out = np.empty(len(parameters))
    for n, p in enumerate(parameters):
        d = target - transform(model_values(rows, p), code)
        out[n] = (rows.weight * (np.abs(d) if code == L1 else d * d)).sum()
    return out


def grid_errors(
    rows: Rows,
    target: Float64Array,
    base: Float64Array,
    shapes: Float64Array,
    pairs: Float64Array,
    code: int,
) -> Float64Array:
    """Sums (N, M) of the metric for every shape with every pair; ``rows`` has one channel.

    ``target`` (K,) and ``base`` (K,): what is to be met, and what the model already has, both y.
    """
    out = np.empty((len(shapes), pairs.shape[1]))
    in_rows(
        grid_kernel,
        len(shapes),
        rows.features,
        _check.frozen(transform(target, code)),
        _check.frozen(base),
        _check.frozen(rows.weight[:, 0]),
        _check.frozen(shapes),
        _check.frozen(pairs),
        code,
        rows.ggx,
        out,
    )
    return out


def shape_values(rows: Rows, mx: float, my: float, alpha: float) -> Float64Array:
    """P (K,) of one lobe in NumPy: fit_rows eqs. (2) and (5)."""
    f = rows.features
    q = f[0] / (mx * mx) + f[1] / (my * my)
    if rows.ggx:
        si = np.sqrt(1.0 + mx * mx * f[5] + my * my * f[6])
        so = np.sqrt(1.0 + mx * mx * f[7] + my * my * f[8])
        return cast(Float64Array, 2.0 * f[4] / ((si + so) * mx * my * (1.0 + q) ** 2))
    return cast(Float64Array, f[4] * np.exp(-q - alpha * f[3]) / (mx * my))


def lobe_values(rows: Rows, mx: float, my: float, alpha: float, r0: float) -> Float64Array:
    """Y (K,) of one lobe with ks = 1: fit_rows eq. (1)."""
    fresnel = r0 + (1.0 - r0) * rows.features[2]
    if rows.sign < 0.0:
        fresnel = 1.0 - fresnel
    return cast(Float64Array, fresnel * shape_values(rows, mx, my, alpha))


def model_values(rows: Rows, parameters: Float64Array) -> Float64Array:
    """Y (K, C) of the whole model; ``parameters`` (P,) as for ``errors``."""
    c = rows.channels
    total = rows.diffuse[:, None] * parameters[:c]
    for lobe in parameters[c:].reshape(-1, LOBE + c):
        total = total + lobe_values(rows, *lobe[:LOBE])[:, None] * lobe[LOBE:]
    return np.asarray(total)
