"""The pixel loop of ``shade`` again, laid out for vector units as ``glossy.tiles`` describes.

The sums of weights, with and without Schlick's term, are two more rows; exponentials come from
``k_exp2``. Arguments below -100 are taken as -100: such a tap weighs nothing.
"""

import math

import numpy as np
import numpy.typing as npt

from .._jit import Scalar, kernel, row_kernel
from .._lanes import bits, from_bits
from ..tiles import (
    BX,
    BY,
    BZ,
    COS,
    FRESNEL,
    GAIN,
    LEVEL,
    NX,
    NY,
    NZ,
    OX,
    OY,
    OZ,
    PLAIN,
    SCHLICK,
    SCRATCH,
    TX,
    TY,
    TZ,
    WX,
    WY,
    WZ,
    D,
    T,
    k_addresses,
    k_exp2,
    k_faces,
    k_load_frames,
    k_log2,
    k_look_up,
)
from .frame import k_lobe_axes, k_lobe_jacobian, k_lobe_moments, k_reach
from .tap import (
    BASE,
    INV_SQRT_2PI,
    KNEE,
    SCALE,
    SLACK,
    THREE,
    k_edge,
    k_fresnel_white,
    k_view,
    k_view_scale,
    k_white,
)

Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

# rows of the scratch array behind those of ``glossy.tiles``
(MEAN_X, MEAN_Y, G1X, G1Y, G2X, G2Y, PLACE, SPREAD, SUM, SUM_EDGE, HX, HY, HZ, ACROSS_X,
 ACROSS_Y, EXPONENT, RAMP) = (SCRATCH + T * k for k in range(17))  # fmt: skip
ROOM = SCRATCH + 17 * T

ZERO, HALF, ONE, TWO, FOUR = (np.float32(v) for v in (0.0, 0.5, 1.0, 2.0, 4.0))
QUARTER = np.float32(0.25)
LOG2_E, LEAST = np.float32(1.0 / math.log(2.0)), np.float32(-100.0)
TINY = np.float32(1e-30)
ROOT_LOG2_E = np.float32(1.0 / math.sqrt(math.log(2.0)))
EXPONENT_ONE = np.int32(127)


@kernel
def _place_lobe(s: Float32Array, lobe: Float32Array, width: Float32Array, texels: Scalar) -> None:
    """``k_lattice_pixel`` for every pixel of the tile; SPREAD in texels of level 0."""
    mx, my, beta = ONE / lobe[0], ONE / lobe[1], ONE - lobe[3]
    w0, w1, w2, w3, w4 = width[0], width[1], width[2], width[3], width[4]
    for i in range(T):
        reach = k_reach(s[OX + i], s[OY + i], s[OZ + i], mx, my)
        s[COS + i] = reach
        s[GAIN + i] = INV_SQRT_2PI * k_exp2(max(-HALF * LOG2_E * reach * reach, LEAST))
    for i in range(T):
        mean_x, mean_y, cxx, cxy, cyy, det = k_lobe_moments(
            s[OX + i], s[OY + i], s[OZ + i], mx, my, beta, s[COS + i], s[GAIN + i]
        )
        s[MEAN_X + i], s[MEAN_Y + i], s[PLACE + i] = mean_x, mean_y, det
        s[HX + i], s[HY + i], s[HZ + i] = cxx, cxy, cyy
    for i in range(T):
        j11, j12, j22, height = k_lobe_jacobian(
            s[OX + i], s[OY + i], s[OZ + i], s[MEAN_X + i], s[MEAN_Y + i]
        )
        s[G1X + i], s[G1Y + i], s[G2X + i], s[SPREAD + i] = j11, j12, j22, texels / height
    for i in range(T):
        g1x, g1y, g2x, g2y, major, minor = k_lobe_axes(
            s[G1X + i], s[G1Y + i], s[G2X + i], s[HX + i], s[HY + i], s[HZ + i], s[PLACE + i]
        )
        s[G1X + i], s[G1Y + i], s[G2X + i], s[G2Y + i] = g1x, g1y, g2x, g2y
        s[PLACE + i] = major / minor
        s[SPREAD + i] = s[SPREAD + i] * minor
        s[RAMP + i] = minor
    for i in range(T):
        octaves = max(HALF * k_log2(s[PLACE + i]), ZERO)
        t = min(octaves, FOUR) * QUARTER
        beyond = max(octaves - FOUR, ZERO)
        s[PLACE + i] = t
        square = k_exp2(TWO * (w0 + t * (w1 + t * (w2 + t * (w3 + t * w4))) + beyond))
        s[SPREAD + i] = s[SPREAD + i] * square
        s[RAMP + i] = math.sqrt(max(s[RAMP + i] * square, TINY))


@kernel
def _place_pair(s: Float32Array, tap: Float32Array) -> None:
    """Place of a tap (its partner's is the negative) and its exponent, from the polynomials."""
    a0, a1, a2, a3, a4 = tap[0], tap[1], tap[2], tap[3], tap[4]
    b0, b1, b2, b3, b4 = tap[5], tap[6], tap[7], tap[8], tap[9]
    c0, c1, c2, c3, c4 = tap[10], tap[11], tap[12], tap[13], tap[14]
    for i in range(T):
        t = s[PLACE + i]
        z1 = a0 + t * (a1 + t * (a2 + t * (a3 + t * a4)))
        z2 = b0 + t * (b1 + t * (b2 + t * (b3 + t * b4)))
        e = c0 + t * (c1 + t * (c2 + t * (c3 + t * c4)))
        s[ACROSS_X + i] = z1 * s[G1X + i] + z2 * s[G2X + i]
        s[ACROSS_Y + i] = z1 * s[G1Y + i] + z2 * s[G2Y + i]
        s[EXPONENT + i] = LOG2_E * (e + HALF * (z1 * z1 + z2 * z2))


@kernel
def _place_tap(s: Float32Array, sign: Scalar, lobe: Float32Array) -> None:
    """Half vector, cosine, and weight without F; 0 below the horizon."""
    rx, ry, alpha = lobe[0] * ROOT_LOG2_E, lobe[1] * ROOT_LOG2_E, lobe[3]
    for i in range(T):
        sx = s[MEAN_X + i] + sign * s[ACROSS_X + i]
        sy = s[MEAN_Y + i] + sign * s[ACROSS_Y + i]
        square = ONE + sx * sx + sy * sy
        hz = ONE / math.sqrt(square)
        hx, hy = sx * hz, sy * hz
        oz = s[OZ + i]
        c = s[OX + i] * hx + s[OY + i] * hy + oz * hz
        iz = TWO * c * hz - oz
        qx, qy = sx * rx, sy * ry
        weight = k_exp2(max(s[EXPONENT + i] - qx * qx - qy * qy, LEAST)) * (square * hz)
        kept = (c > ZERO) & (iz > ZERO) & (oz > ZERO)
        s[HX + i], s[HY + i], s[HZ + i], s[COS + i] = hx, hy, hz, c
        s[LEVEL + i] = iz
        s[GAIN + i] = weight * iz if kept else ZERO
    if alpha == HALF:
        for i in range(T):
            s[GAIN + i] = s[GAIN + i] / math.sqrt(max(s[LEVEL + i], s[RAMP + i]))
    elif alpha == ONE:
        for i in range(T):
            s[GAIN + i] = s[GAIN + i] / max(s[LEVEL + i], s[RAMP + i])
    elif alpha != ZERO:
        for i in range(T):
            power = k_exp2(-alpha * k_log2(max(s[LEVEL + i], s[RAMP + i])))
            s[GAIN + i] = s[GAIN + i] * power


@kernel
def _direct(s: Float32Array, side: Scalar, fresnel: bool) -> None:
    """Directions in world coordinates, Schlick's term, and the sums of weights."""
    for i in range(T):
        hx, hy, hz, c2 = s[HX + i], s[HY + i], s[HZ + i], TWO * s[COS + i]
        ix, iy, iz = c2 * hx - s[OX + i], c2 * hy - s[OY + i], c2 * hz - s[OZ + i]
        up = iz * side
        s[WX + i] = s[TX + i] * ix + s[BX + i] * iy + s[NX + i] * up
        s[WY + i] = s[TY + i] * ix + s[BY + i] * iy + s[NY + i] * up
        s[WZ + i] = s[TZ + i] * ix + s[BZ + i] * iy + s[NZ + i] * up
        s[SUM + i] = s[SUM + i] + s[GAIN + i]
    if fresnel:
        for i in range(T):
            c = s[COS + i]
            dx, dy = c * s[HX + i] - s[OX + i], c * s[HY + i] - s[OY + i]
            dz = c * s[HZ + i] - s[OZ + i]
            x = (dx * dx + dy * dy + dz * dz) / (ONE + c)
            x = x if c > ZERO else ZERO
            edge = (x * x) * (x * x) * x
            rest = c * (ONE + x * (ONE + x * (ONE + x * (ONE + x))))
            edge = rest if side < ZERO else edge
            s[SCHLICK + i] = edge
            s[SUM_EDGE + i] = s[SUM_EDGE + i] + s[GAIN + i] * edge


@kernel
def _levels(s: Float32Array, law: Float32Array, bias: Scalar, top: Scalar) -> None:
    """``k_gauss_level`` clamped to the chain; a dropped lane may hold any level."""
    a, b = law[0], law[1]
    one = FOUR * a - b
    knee = KNEE * one
    slope = (one + knee) / (one - BASE)
    inverse = ONE / a
    for i in range(T):
        d, hz = s[D + i], s[HZ + i]
        v = s[SPREAD + i] * abs(s[COS + i]) * (hz * hz * hz) * (d * d * d)
        x = (v + b) * inverse
        first = np.int32(np.int32(np.int32(bits(x) >> 23) - EXPONENT_ONE) >> 1)
        u = x * from_bits(np.int32(np.int32(EXPONENT_ONE - np.int32(2 * first)) << 23))
        coarse = np.float32(first) + (SLACK - THREE / ((u + FOUR) * (u + ONE))) * SCALE
        fine = (v - BASE) * slope / (v + knee)
        level = (fine if v < one else coarse) + bias
        level = level if level > ZERO else ZERO
        s[LEVEL + i] = level if level < top else top


@row_kernel
def shade_lattice_tiles(
    begin: int,
    end: int,
    pixels: Int64Array,
    vectors: Float32Array,
    taps: Float32Array,
    widths: Float32Array,
    first: Int64Array,
    lobes: Float32Array,
    ks: Float32Array,
    r0: Float32Array,
    white: Float32Array,
    law: Float32Array,
    texels: Scalar,
    bias: Scalar,
    pi: Scalar,
    buffer: Float32Array,
    log_size: Scalar,
    out: Float32Array,
) -> None:
    """``shade._shade_lattice`` where ``glossy.tiles.fits``; adds to ``out``."""
    top = np.float32(log_size)
    for tile in range(begin, end):
        start = tile * T
        count = min(T, pixels.shape[0] - start)
        s = np.empty(ROOM, dtype=np.float32)
        k_load_frames(s, start, count, vectors)
        for j in range(lobes.shape[0]):
            side = lobes[j, 4]
            fresnel = side < ZERO or r0[j, 0] != ONE or r0[j, 1] != ONE or r0[j, 2] != ONE
            for i in range(16 * T):
                s[PLAIN + i] = ZERO
            for i in range(2 * T):
                s[SUM + i] = ZERO
            _place_lobe(s, lobes[j], widths[j], texels)
            odd = 1 - (first[j + 1] - first[j]) % 2
            for k in range(first[j], first[j + 1]):
                fresh = k == first[j] or (k - first[j]) % 2 != odd
                if fresh:
                    _place_pair(s, taps[k])
                _place_tap(s, ONE if fresh else -ONE, lobes[j])
                _direct(s, side, fresnel)
                k_faces(s)
                _levels(s, law, bias, top)
                k_addresses(s, log_size, True)
                k_addresses(s, log_size, False)
                k_look_up(s, buffer, count, fresnel)
            mx, my = ONE / lobes[j, 0], ONE / lobes[j, 1]
            for i in range(count):
                p, oz, total = pixels[start + i], s[OZ + i], s[SUM + i]
                if oz <= ZERO or total == ZERO:
                    continue
                azimuth, k = k_view(s[OX + i], s[OY + i], mx, my)
                full = k_white(white[j], 0, azimuth, oz, k)
                scale = k_view_scale(oz, k, lobes[j, 3])
                if not fresnel:
                    scale = scale * full / total
                    for c in range(3):
                        a = s[PLAIN + 8 * i + c] + s[PLAIN + 8 * i + 4 + c]
                        out[p, c] += ks[j, c] * (scale * a)
                    continue
                edge = k_edge(white[j], side, azimuth, oz, k)
                for c in range(3):
                    a = s[PLAIN + 8 * i + c] + s[PLAIN + 8 * i + 4 + c]
                    b = s[FRESNEL + 8 * i + c] + s[FRESNEL + 8 * i + 4 + c]
                    value = k_fresnel_white(r0[j, c], a, b, side)
                    sums = k_fresnel_white(r0[j, c], total, s[SUM_EDGE + i], side)
                    if sums > ZERO:
                        share = scale * k_fresnel_white(r0[j, c], full, edge, side)
                        out[p, c] += ks[j, c] * (share * value / sums)
