"""One pixel and one tap of the lattice: the kernels that both pixel loops are made of.

Equations: ``shade``.
"""

import math

import numpy as np
import numpy.typing as npt

from .._jit import Scalar, kernel
from ..brdf import k_schlick, k_schlick_rest
from .frame import GRAZING, k_lobe_axes, k_lobe_jacobian, k_lobe_moments, k_reach

FloatArray = npt.NDArray[np.floating]

ZERO, HALF, ONE, TWO, FOUR = (np.float32(v) for v in (0.0, 0.5, 1.0, 2.0, 4.0))
BASE = np.float32(1.0 / 6.0)  # variance of a tap of level 0
SLACK, SCALE, THREE = np.float32(0.3), np.float32(40.0 / 9.0), np.float32(3.0)
KNEE = np.float32(0.5)
QUARTER, TINY = np.float32(0.25), np.float32(1e-30)
INV_SQRT_2PI = np.float32(1.0 / math.sqrt(2.0 * math.pi))


@kernel
def k_gauss_level(variance: Scalar, a: Scalar, b: Scalar) -> Scalar:
    """Level whose tap is closest to a Gaussian of ``variance`` texels^2 of level 0, eqs. (5, 6)."""
    one = FOUR * a - b
    if variance < one:
        knee = KNEE * one
        f = (variance - BASE) / (one - BASE) * ((one + knee) / (variance + knee))
        return max(f, ZERO)
    scaled = (variance + b) / a
    first = np.floor(HALF * np.log2(scaled))
    u = scaled * np.exp2(-(first + first))
    return first + (SLACK - THREE / ((u + FOUR) * (u + ONE))) * SCALE


@kernel
def k_view(wox: Scalar, woy: Scalar, mx: Scalar, my: Scalar) -> tuple[Scalar, Scalar]:
    """Where the view's azimuth lies among the columns of the table, in [0, 1], and k towards it."""
    flat = wox * wox + woy * woy
    if mx == my or flat <= TINY:
        return ZERO * mx, mx
    x, y = np.sqrt(mx) * abs(wox), np.sqrt(my) * abs(woy)
    u, v = np.sqrt(x), np.sqrt(y)
    return v / (u + v), np.sqrt((mx * x * x + my * y * y) / flat)


@kernel
def k_white(table: FloatArray, part: Scalar, azimuth: Scalar, cosine: Scalar, k: Scalar) -> Scalar:
    """One of the parts of ``reflectivity_table``, bilinearly."""
    rows, columns = table.shape[0] - 1, table.shape[1] - 1
    x = HALF * cosine * (ONE + (ONE + k) / (cosine + k)) * np.float32(rows)
    i = min(np.int64(x), rows - 1)
    u = x - np.float32(i)
    if columns == 0:
        return (ONE - u) * table[i, 0, part] + u * table[i + 1, 0, part]
    y = azimuth * np.float32(columns)
    j = min(np.int64(y), columns - 1)
    v = y - np.float32(j)
    near = (ONE - u) * table[i, j, part] + u * table[i + 1, j, part]
    far = (ONE - u) * table[i, j + 1, part] + u * table[i + 1, j + 1, part]
    return (ONE - v) * near + v * far


@kernel
def k_edge(table: FloatArray, side: Scalar, azimuth: Scalar, cosine: Scalar, k: Scalar) -> Scalar:
    """Reflectivity of Schlick's term, or for a transmission lobe (side -1) of its rest."""
    if side < ZERO:
        return k_white(table, 2, azimuth, cosine, k)
    root = k_white(table, 1, azimuth, cosine, k)
    return (root * root) * (root * root) * root


@kernel
def k_view_scale(cosine: Scalar, k: Scalar, alpha: Scalar) -> Scalar:
    """What ``reflectivity_table`` is divided by: (c + k)^(1 - alpha) / c^alpha."""
    if alpha == ZERO:
        return cosine + k
    return (cosine + k) ** (ONE - alpha) * max(cosine, GRAZING) ** -alpha


@kernel
def k_polynomial(c: FloatArray, at: Scalar, t: Scalar) -> Scalar:
    """Polynomial of degree 4 in t with the coefficients c[at:at+5]."""
    return c[at] + t * (c[at + 1] + t * (c[at + 2] + t * (c[at + 3] + t * c[at + 4])))


@kernel
def k_lattice_tap(
    tap: FloatArray,
    lobe: FloatArray,
    pixel: tuple[Scalar, ...],
    wo: tuple[Scalar, Scalar, Scalar],
    frame: tuple[Scalar, ...],
) -> tuple[bool, Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]:
    """One sample: kept, wi in world coordinates, a of eq. (3), weight without F, Schlick's term.

    ``pixel`` is what ``k_lattice_pixel`` returned.
    """
    wox, woy, woz = wo
    t = pixel[6]
    z1, z2 = k_polynomial(tap, 0, t), k_polynomial(tap, 5, t)
    sx = pixel[0] + z1 * pixel[2] + z2 * pixel[4]
    sy = pixel[1] + z1 * pixel[3] + z2 * pixel[5]
    hz = ONE / np.sqrt(ONE + sx * sx + sy * sy)
    hx, hy = sx * hz, sy * hz
    c = wox * hx + woy * hy + woz * hz
    ix, iy, iz = TWO * c * hx - wox, TWO * c * hy - woy, TWO * c * hz - woz
    if c <= ZERO or iz <= ZERO:
        none = ZERO * c
        return False, none, none, none, none, none, none
    qx, qy = sx * lobe[0], sy * lobe[1]
    exponent = k_polynomial(tap, 10, t) + HALF * (z1 * z1 + z2 * z2) - qx * qx - qy * qy
    weight = np.exp(exponent) / hz
    weight = weight * iz
    if lobe[3] != ZERO:
        weight = weight / max(iz, pixel[8]) ** lobe[3]
    if lobe[4] > ZERO:
        schlick = k_schlick(ix, iy, iz, wox, woy, woz, c)
    else:
        schlick = k_schlick_rest(ix, iy, iz, wox, woy, woz, c)
    up = iz * lobe[4]
    x = frame[0] * ix + frame[3] * iy + frame[6] * up
    y = frame[1] * ix + frame[4] * iy + frame[7] * up
    z = frame[2] * ix + frame[5] * iy + frame[8] * up
    return True, x, y, z, c * (hz * hz * hz), weight, schlick


@kernel
def k_lattice_pixel(
    wo: tuple[Scalar, Scalar, Scalar], lobe: FloatArray, width: FloatArray
) -> tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]:
    """Mean, g1, g2 in slopes, t of the polynomials, (tau s2)^2 / a0 of eq. (3), and tau s2."""
    mx, my = ONE / lobe[0], ONE / lobe[1]
    reach = k_reach(wo[0], wo[1], wo[2], mx, my)
    density = INV_SQRT_2PI * np.exp(-HALF * reach * reach)
    mean_x, mean_y, cxx, cxy, cyy, det = k_lobe_moments(
        wo[0], wo[1], wo[2], mx, my, ONE - lobe[3], reach, density
    )
    j11, j12, j22, height = k_lobe_jacobian(wo[0], wo[1], wo[2], mean_x, mean_y)
    g1x, g1y, g2x, g2y, major, minor = k_lobe_axes(j11, j12, j22, cxx, cxy, cyy, det)
    octaves = max(HALF * np.log2(major / minor), ZERO)
    t = min(octaves, FOUR) * QUARTER
    beyond = max(octaves - FOUR, ZERO)
    square = minor * np.exp2(TWO * (k_polynomial(width, 0, t) + beyond))
    ramp = np.sqrt(max(square, TINY))
    return mean_x, mean_y, g1x, g1y, g2x, g2y, t, square / height, ramp


@kernel
def k_fresnel_white(r0: Scalar, full: Scalar, schlick: Scalar, side: Scalar) -> Scalar:
    """Reflectivity with F, or transmissivity with 1 - F, of ``k_white``'s parts."""
    f = (ONE - r0) * schlick
    return r0 * full + f if side > ZERO else f


@kernel
def k_reflected(
    table: FloatArray,
    lobe: FloatArray,
    ks: FloatArray,
    r0: FloatArray,
    wo: tuple[Scalar, Scalar, Scalar],
) -> tuple[Scalar, Scalar, Scalar]:
    """Return ks R(wo) of eq. (4): what a lobe makes of a white environment."""
    azimuth, k = k_view(wo[0], wo[1], ONE / lobe[0], ONE / lobe[1])
    full = k_white(table, 0, azimuth, wo[2], k)
    edge = k_edge(table, lobe[4], azimuth, wo[2], k)
    scale = k_view_scale(wo[2], k, lobe[3])
    return (
        ks[0] * scale * k_fresnel_white(r0[0], full, edge, lobe[4]),
        ks[1] * scale * k_fresnel_white(r0[1], full, edge, lobe[4]),
        ks[2] * scale * k_fresnel_white(r0[2], full, edge, lobe[4]),
    )
