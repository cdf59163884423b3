"""Bounds of what multiplies the radiance, over a block of directions seen as a cone.

A block lies in the ball of chord radius rho about its central direction c, so H = wi + wo lies in
the ball about C = c + wo. Seen along one tangent axis, the slope Hx/Hz then has an angle within
asin(rho / |(Cx, Cz)|) of atan(Cx/Cz); that bounds both slopes from below, hence the exponential::

    D cos^-4 <= (1 + X + Y)^2 exp(-X/mx^2 - Y/my^2) / (pi mx my)  for slopes^2 >= (X, Y)    (1)

The right side is log-concave in (X, Y), so its largest value is known in closed form. With
|H| >= max(|C| - rho, wo.n + wi.n) the rest of f cos is bounded by ::

    (wi.n)^(1-alpha) / (2 |H| (wo.n)^alpha)                                              (2)

How far the slopes move across the block, in units of the lobe's width, says whether polynomials can
follow the lobe there.
"""

import math

import numpy as np
import numpy.typing as npt

from .._jit import kernel
from .cells import GAUSS, LEGENDRE, P

Float64Array = npt.NDArray[np.float64]

FLAT = 2.0  # slopes may move by this many lobe widths either way for a block to count as resolved

# Legendre coefficients of the polynomial through the values at the nodes
_ANALYSIS = LEGENDRE * GAUSS * (np.arange(P)[:, None] + 0.5)
SAFETY = 4.0  # on extrapolated errors: twice what thousands of drawn cases needed


@kernel
def k_slope_range(cx: float, cz: float, rho: float) -> tuple[float, float]:
    """Smallest and largest slope x/z over the ball's part above z = 0; a smallest of inf: none."""
    radius2 = cx * cx + cz * cz
    if rho * rho >= radius2:
        return -math.inf, math.inf
    x = abs(cx)
    tangent = math.sqrt(radius2 - rho * rho)
    below = cz * tangent + x * rho
    if below <= 0.0:
        return math.inf, math.inf
    low = (x * tangent - cz * rho) / below
    above = cz * tangent - x * rho
    high = (x * tangent + cz * rho) / above if above > 0.0 else math.inf
    return low, high


@kernel
def k_distribution_bound(xx: float, yy: float, lobe: Float64Array) -> float:
    """Eq. (1): the largest D cos^-4 where the squared slopes are at least ``xx``, ``yy``."""
    px, py = lobe[0] * lobe[0], lobe[1] * lobe[1]  # 1/m^2
    if px <= py:
        xx = max(xx, 2.0 / px - 1.0 - yy)
    else:
        yy = max(yy, 2.0 / py - 1.0 - xx)
    q = xx * px + yy * py
    if not q < 745.0:
        return 0.0
    tilt = 1.0 + xx + yy
    return float(lobe[2] * tilt * tilt * math.exp(-q))


@kernel
def k_lobe_bound(
    cx: float,
    cy: float,
    cz: float,
    rho: float,
    wo: Float64Array,
    lobe: Float64Array,
) -> tuple[float, float, float, float, float]:
    """Bounds of the lobe over the block, and how well polynomials can follow it there.

    Returns the bound of f cos without ks and F; the same without (wi.n)^(1-alpha); the bound of the
    Schlick weight; how many lobe widths the block reaches either way; how many radii rho away the
    next singularity is.
    """
    hx, hy, hz = cx + wo[0], cy + wo[1], cz + wo[2]
    x0, x1 = k_slope_range(hx, hz, rho)
    y0, y1 = k_slope_range(hy, hz, rho)
    if x0 == math.inf or y0 == math.inf:
        return 0.0, 0.0, 0.0, 0.0, 1.0
    xx, yy = max(x0, 0.0), max(y0, 0.0)
    d = k_distribution_bound(xx * xx, yy * yy, lobe)
    if d == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 1.0
    length = math.sqrt(hx * hx + hy * hy + hz * hz)
    z0, z1 = max(cz - rho, 0.0), min(cz + rho, 1.0)
    alpha, woz = lobe[3], wo[2]
    shortest = max(length - rho, woz + z0)
    power = 1.0 - alpha
    if alpha == 0.0:
        rise = z1 / (z1 + woz)
        top = z1
    else:
        z = max(z0, min(z1, woz * power / alpha))
        rise = z**power / (z + woz)
        top = z1**power
    scale = 0.5 * d / woz**alpha
    bound = scale * min(rise, top / shortest)
    width = 0.5 * max((x1 - x0) * lobe[0], (y1 - y0) * lobe[1])
    x = max(0.0, 1.0 - 0.5 * shortest)
    x2 = x * x
    near = length if alpha == 0.0 or alpha == 1.0 else min(length, cz)
    return (
        bound,
        scale / shortest,
        x2 * x2 * x,
        width if rho <= 0.5 * length else math.inf,
        near / rho,
    )


@kernel
def k_decay(distance: float) -> float:
    """Least ratio of Legendre coefficients two degrees apart, a singularity so far from [-1, 1]."""
    if distance <= 1.0:
        return 1.0
    root = distance + math.sqrt(distance * distance - 1.0)
    return 1.0 / (root * root)


@kernel
def k_tail(v: Float64Array, decay: float) -> tuple[float, float, float]:
    """Errors of the interpolant through P x P values: largest, root mean square, of its integral.

    Per line of nodes the last two Legendre coefficients are compared with the two before; the sum
    of the missing ones is extrapolated from their ratio, which is at least ``decay``. Gauss nodes
    integrate the product with a polynomial of degree 2 without error up to degree 2P - 3.
    """
    top = mean = whole = 0.0
    for axis in range(2):
        stride, step = (1, P) if axis == 0 else (P, 1)
        last = before = square = 0.0
        for line in range(P):
            hi = lo = 0.0
            for k in range(P - 4, P):
                c = 0.0
                for j in range(P):
                    c += _ANALYSIS[k, j] * v[line * step + j * stride]
                if k >= P - 2:
                    hi += abs(c)
                    square += 0.5 * GAUSS[line] * c * c / (2 * k + 1)
                else:
                    lo += abs(c)
            last, before = max(last, hi), max(before, lo)
        if last > 0.0:
            ratio = max(min(1.0, last / before), decay) if before > 0.0 else 1.0
            top += last * ratio
            mean += math.sqrt(square) * ratio
            whole += last * ratio * ratio
    return SAFETY * top, SAFETY * mean, SAFETY * whole


@kernel
def k_kink(
    power: float,
    rest: float,
    rho: float,
    bound: float,
    width: float,
) -> tuple[float, float, float]:
    """The same three errors where the horizon crosses the block, f cos = rest (wi.n)^power.

    The worst over all lines through the block was measured for every power; the smooth factor's own
    error is that of a Gaussian.
    """
    edge = rest * rho**power
    w2 = width * width
    bend = bound * w2 * w2 * width
    return (
        2.6 * 0.065**power * edge + 0.1 * bend,
        0.36 * 0.075**power * edge + 0.05 * bend,
        0.15 * 0.075**power * edge + 0.02 * bend * width * w2,
    )
