"""Where the lobe of a pixel lies: its mean, and its axes in the plane of directions.

In slopes s = (hx, hy)/hz the lobe is a Gaussian of covariance S = diag(mx^2, my^2)/2. What reaches
the viewer is that times (wi.n)^b / (wh.n), b = 1 - alpha, where along e, the direction of the
viewer's azimuth ::

    wi.n ~ max(0, z + e.s / sqrt(e.S e)),   z = (wo.n) / (2 |wo_xy| sqrt(e.S e))         (1)

A Gaussian cut by a ramp has these moments, with Phi, phi the normal distribution at z::

    mean = b S e / sqrt(e.S e) Phi / (z Phi + phi)                                      (2)
    A = S - b (1 - v) S e (S e)^T / (e.S e),  v = 1 + phi/(z Phi + phi) - (Phi/(z Phi + phi))^2
    C^-1 = A^-1 + max(4 b - 1, 0) I                                                           (3)

(3) is the curvature of the cosines at the pole, cos 2d / cos d. About the mean, displacements of s
move wi by J, the differential of the reflection, whose area factor is 4 (wo.wh)(wh.n)^3. The
axes s1 >= s2 of J C J^T and their images in slopes, columns of J^-1 U, carry the taps::

    s = mean + x1 g1 + x2 g2,   [g1 g2] = J^-1 U diag(s1, s2)                            (4)

A round lobe has no axes: rounding would turn them. So that a round lobe along the normal has the
surface's, the first axis of J counts as longer by a thousandth of the smaller variance.
"""

import math

import numpy as np

from .._jit import Scalar, kernel

ZERO, HALF, ONE, TWO, FOUR = (np.float32(v) for v in (0.0, 0.5, 1.0, 2.0, 4.0))
TINY = np.float32(1e-30)
GRAZING = np.float32(1e-6)
NUDGE = np.float32(1e-3)
FAR = np.float32(12.0)  # standard deviations beyond which a Gaussian is cut
INV_SQRT_2PI = np.float32(1.0 / math.sqrt(2.0 * math.pi))
P = np.float32(0.2316419)  # Abramowitz and Stegun 26.2.17, absolute error below 7.5e-8
B1, B2, B3, B4, B5 = (
    np.float32(v) for v in (0.319381530, -0.356563782, 1.781477937, -1.821255978, 1.330274429)
)


@kernel
def k_reach(wox: Scalar, woy: Scalar, woz: Scalar, mx: Scalar, my: Scalar) -> Scalar:
    """Return z of eq. (1), at most ``FAR``; the caller brings exp(-z^2/2) / sqrt(2 pi)."""
    x, y = mx * wox, my * woy
    root = math.sqrt(max(HALF * (x * x + y * y), TINY))
    return min(max(woz, GRAZING) / (TWO * root), FAR)


@kernel
def k_lobe_moments(
    wox: Scalar,
    woy: Scalar,
    woz: Scalar,
    mx: Scalar,
    my: Scalar,
    beta: Scalar,
    reach: Scalar,
    density: Scalar,
) -> tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]:
    """Mean slopes (2), C (xx, xy, yy) and its determinant, eqs. (2) and (3).

    ``reach`` is z of ``k_reach``, ``density`` the normal distribution there. No branches and no
    calls, here and below, and few results: loops over pixels have to become vector code.
    """
    oz = max(woz, GRAZING)
    vx, vy = HALF * mx * mx, HALF * my * my
    ax, ay = vx * wox, vy * woy  # S e times |wo_xy|
    along = ax * wox + ay * woy  # e.S e times |wo_xy|^2
    root = math.sqrt(max(along, TINY))
    w = TWO * root / oz
    t = ONE / (ONE + P * reach)
    below = ONE - density * t * (B1 + t * (B2 + t * (B3 + t * (B4 + t * B5))))
    total = ONE / (below + w * density)
    slope, spread = w * below * total, w * density * total
    shift = beta * slope / root
    less = beta * (slope * slope - spread) / max(along, TINY)
    axx, axy, ayy = vx - less * ax * ax, -less * ax * ay, vy - less * ay * ay
    det = vx * vy * (ONE - less * along)
    bend = max(FOUR * beta - ONE, ZERO)
    scale = ONE / (ONE + bend * (axx + ayy) + bend * bend * det)
    cxx, cyy = (axx + bend * det) * scale, (ayy + bend * det) * scale
    return shift * ax, shift * ay, cxx, axy * scale, cyy, det * scale


@kernel
def k_lobe_jacobian(
    wox: Scalar, woy: Scalar, woz: Scalar, mean_x: Scalar, mean_y: Scalar
) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """J as [[j11, j12], [0, j22]] and a0 = (wo.wh)(wh.n)^3, at the mean.

    The basis of J has its first axis along J's first column.
    """
    hz = ONE / math.sqrt(ONE + mean_x * mean_x + mean_y * mean_y)
    hx, hy = mean_x * hz, mean_y * hz
    c = wox * hx + woy * hy + max(woz, GRAZING) * hz
    # dwi/ds = 2 ((wo.dh) h + (wo.h) dh), dh = hz (e - h (h.e)): products of its columns
    px, py = hz * (wox - c * hx), hz * (woy - c * hy)  # wo.dh
    dxx, dxy = hz * hz * (ONE - hx * hx), -hz * hz * hx * hy
    height = c * hz * hz * hz
    j11 = TWO * math.sqrt(px * px + c * c * dxx)
    over = ONE / j11
    return j11, FOUR * (px * py + c * c * dxy) * over, FOUR * height * over, height


@kernel
def k_lobe_axes(
    j11: Scalar, j12: Scalar, j22: Scalar, cxx: Scalar, cxy: Scalar, cyy: Scalar, det: Scalar
) -> tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]:
    """g1 (2), g2 (2), s1^2, s2^2 of eq. (4)."""
    s11 = j11 * j11 * cxx + TWO * j11 * j12 * cxy + j12 * j12 * cyy
    s12 = j22 * (j11 * cxy + j12 * cyy)
    s22 = j22 * j22 * cyy
    area = j11 * j22
    square = area * area * det
    difference = s11 - s22 + NUDGE * square / (s11 + s22)
    gap = math.sqrt(difference * difference + FOUR * s12 * s12)
    major = HALF * (s11 + s22 + gap)
    minor = square / major
    u = gap + difference if difference >= ZERO else TWO * s12  # along the first axis
    v = TWO * s12 if difference >= ZERO else gap - difference
    u = u if gap > ZERO else ONE
    norm = ONE / math.sqrt(u * u + v * v)
    cosine, sine = u * norm, v * norm
    s1, s2, over1, over2 = math.sqrt(major), math.sqrt(minor), ONE / j11, ONE / j22
    shear = j12 * over2
    g1x, g1y = s1 * (cosine - shear * sine) * over1, s1 * sine * over2
    g2x, g2y = s2 * (-sine - shear * cosine) * over1, s2 * cosine * over2
    return g1x, g1y, g2x, g2y, major, minor
