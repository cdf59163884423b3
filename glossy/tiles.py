"""The pixel loop of ``shading`` again, laid out for vector units: lanes are pixels.

A tile of ``T`` pixels goes through each sample in a few short loops without branches: direction,
face and coordinates, level, texel addresses and weights, then the lookup. The loops share one flat
scratch array with constant offsets; with separate arrays the compiler gives up on proving that they
do not overlap and leaves the loops scalar. Integers live in it as bits. The definition of a sample
is ``shading.k_tap``; this agrees with it to float32 rounding, and ``tests`` says how closely.

What it takes for granted, and ``fits`` checks: single precision, three channels in texels of four,
a full chain of powers of two, no fixed-point emulation.

Level: 0.5 log2(texels) from the exponent and, for the mantissa a in [1/sqrt 2, sqrt 2), ::

    ln a = 2 (z + z^3/3 + z^5/5 + z^7/7 + z^9/9 + ...),   z = (a - 1)/(a + 1), |z| < 0.172

whose first omitted term is below 1e-9. The Fresnel term is linear in r0, so two sums serve all
channels: F L = r0 L + (1 - r0) s L with s = (1 - wo.wh)^5. A transmission lobe has 1 - s for s and
leaves the first term out, which keeps the digits of 1 - F at grazing views.
"""

import math
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from ._jit import Scalar, kernel, row_kernel
from ._lanes import add_texels, add_texels2, bits, from_bits
from .footprint import JACOBIAN, PAPER, k_lobe_area
from .pyramid import Pyramid
from .seams import PAD

Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

MAX_SIZE = 4096  # texel addresses stay below 2^31
T = 64

# rows of the scratch array, T numbers each
(TX, TY, TZ, BX, BY, BZ, NX, NY, NZ, OX, OY, OZ, AREA,
 COS, WX, WY, WZ, GAIN, SCHLICK, FACE, U, V, D, LEVEL,
 A0, A1, AV, AL, AR, B0, B1, BV, BL, BR) = (T * k for k in range(34))  # fmt: skip
PLAIN = T * 34  # eight rows: sum of w L, the RGBA of left and right texels per pixel
FRESNEL = T * 42  # eight rows: sum of w s L
SCRATCH = T * 50

ZERO, HALF, ONE, TWO, FOUR = (np.float32(v) for v in (0.0, 0.5, 1.0, 2.0, 4.0))
TINY = np.float32(1e-30)
MARGIN = np.float32(PAD - 0.5)
INV_LN2 = np.float32(1.0 / math.log(2.0))
LN2 = np.float32(math.log(2.0))
SQRT2 = np.float32(math.sqrt(2.0))
C3, C5, C7, C9 = (np.float32(1.0 / k) for k in (3.0, 5.0, 7.0, 9.0))
E1, E2, E3, E4, E5, E6 = (np.float32(math.log(2.0) ** k / math.factorial(k)) for k in range(1, 7))
MANTISSA, EXPONENT_ONE = np.int32(0x7FFFFF), np.int32(127 << 23)


@kernel
def k_log2(x: Scalar) -> Scalar:
    """log2 of a positive float32, to 2e-7 absolute near 1 and half an ulp of the result beyond."""
    b = bits(x)
    e = np.float32(np.int32(np.int32(b >> 23) - 127))
    a = from_bits(np.int32(np.int32(b & MANTISSA) | EXPONENT_ONE))
    high = a > SQRT2
    a = a * HALF if high else a
    e = e + ONE if high else e
    z = (a - ONE) / (a + ONE)
    q = z * z
    series = z * (ONE + q * (C3 + q * (C5 + q * (C7 + q * C9))))
    return e + TWO * INV_LN2 * series


@kernel
def k_exp2(x: Scalar) -> Scalar:
    """2^x for |x| < 120, relative error below 2e-7."""
    whole = np.floor(x + HALF)
    f = x - whole
    series = ONE + f * (E1 + f * (E2 + f * (E3 + f * (E4 + f * (E5 + f * E6)))))
    return series * from_bits(np.int32(np.int32(np.int32(whole) + 127) << 23))


@kernel
def k_load_frames(s: Float32Array, start: Scalar, count: Scalar, vectors: Float32Array) -> None:
    """Frames and local views of one tile; the last point fills up a short one."""
    for i in range(T):
        p = start + min(i, count - 1)
        s[NX + i], s[NY + i], s[NZ + i] = vectors[0, p], vectors[1, p], vectors[2, p]
        s[TX + i], s[TY + i], s[TZ + i] = vectors[3, p], vectors[4, p], vectors[5, p]
        s[OX + i], s[OY + i], s[OZ + i] = vectors[6, p], vectors[7, p], vectors[8, p]
    for i in range(T):
        nx, ny, nz = s[NX + i], s[NY + i], s[NZ + i]
        tx, ty, tz = s[TX + i], s[TY + i], s[TZ + i]
        vx, vy, vz = s[OX + i], s[OY + i], s[OZ + i]
        bx, by, bz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
        s[BX + i], s[BY + i], s[BZ + i] = bx, by, bz
        s[OX + i] = vx * tx + vy * ty + vz * tz
        s[OY + i] = vx * bx + vy * by + vz * bz
        s[OZ + i] = vx * nx + vy * ny + vz * nz


@kernel
def k_weights(s: Float32Array, tap: Float32Array) -> bool:
    """Weight without F and alpha, 0 below the horizon; False if that is so for the whole tile."""
    hx, hy, hz, gain = tap[0], tap[1], tap[2], tap[3]
    found = np.int32(0)
    for i in range(T):
        oz = s[OZ + i]
        c = s[OX + i] * hx + s[OY + i] * hy + oz * hz
        iz = TWO * c * hz - oz
        kept = (c > ZERO) & (iz > ZERO) & (oz > ZERO)
        weight = gain * iz if kept else ZERO
        s[GAIN + i] = weight
        s[COS + i] = c
        found = np.int32(found | bits(weight))
    return bool(found != 0)


@kernel
def k_directions(
    s: Float32Array, tap: Float32Array, side: Scalar, alpha: Scalar, fresnel: Scalar
) -> None:
    """Directions in world coordinates, weight without F, Schlick's term."""
    hx, hy, hz = tap[0], tap[1], tap[2]
    for i in range(T):
        c2 = TWO * s[COS + i]
        ix, iy, iz = c2 * hx - s[OX + i], c2 * hy - s[OY + i], c2 * hz - s[OZ + i]
        up = iz * side
        s[WX + i] = s[TX + i] * ix + s[BX + i] * iy + s[NX + i] * up
        s[WY + i] = s[TY + i] * ix + s[BY + i] * iy + s[NY + i] * up
        s[WZ + i] = s[TZ + i] * ix + s[BZ + i] * iy + s[NZ + i] * up
    if alpha != ZERO:
        for i in range(T):
            oz = s[OZ + i]
            iz = TWO * s[COS + i] * hz - oz
            s[LEVEL + i] = max(iz * oz, TINY)
        if alpha == HALF:
            for i in range(T):
                s[GAIN + i] = s[GAIN + i] / math.sqrt(s[LEVEL + i])
        elif alpha == ONE:
            for i in range(T):
                s[GAIN + i] = s[GAIN + i] / s[LEVEL + i]
        else:
            for i in range(T):
                s[GAIN + i] = s[GAIN + i] * k_exp2(-alpha * k_log2(s[LEVEL + i]))
    if fresnel:
        for i in range(T):
            c = s[COS + i]
            dx, dy, dz = c * hx - s[OX + i], c * hy - s[OY + i], c * hz - s[OZ + i]
            x = (dx * dx + dy * dy + dz * dz) / (ONE + c)  # |wi - wo|^2 / (4 (1 + c))
            s[SCHLICK + i] = (x * x) * (x * x) * x
        if side < ZERO:
            for i in range(T):
                c = s[COS + i]
                dx, dy, dz = c * hx - s[OX + i], c * hy - s[OY + i], c * hz - s[OZ + i]
                x = (dx * dx + dy * dy + dz * dz) / (ONE + c)
                s[SCHLICK + i] = c * (ONE + x * (ONE + x * (ONE + x * (ONE + x))))


@kernel
def k_faces(s: Float32Array) -> None:
    """Face, coordinates in [0, 1] and distance to the cube; ties z over y over x."""
    for i in range(T):
        x, y, z = s[WX + i], s[WY + i], s[WZ + i]
        ax, ay, az = abs(x), abs(y), abs(z)
        on_z = (az >= ay) & (az >= ax)
        on_y = (ay >= ax) & (not on_z)
        major = z if on_z else (y if on_y else x)
        back = major < ZERO
        d = ONE / abs(major)
        across = x if (on_z | on_y) else -z
        across = -across if (back & (not on_y)) else across
        down = z if on_y else -y
        down = -down if (back & on_y) else down
        face = np.int32(6) if on_z else (np.int32(4) if on_y else np.int32(2))  # + 2, see below
        s[FACE + i] = from_bits(np.int32(face + (np.int32(1) if back else np.int32(0))))
        s[U + i] = HALF * (across * d) + HALF
        s[V + i] = HALF * (down * d) + HALF
        s[D + i] = d


@kernel
def k_levels(s: Float32Array, footprint: Scalar, spread: Scalar, bias: Scalar, top: Scalar) -> None:
    """Level of detail, clamped to the chain; a dropped lane may hold any level."""
    if footprint == PAPER:
        for i in range(T):
            s[LEVEL + i] = spread * s[AREA + i] * s[D + i] / s[COS + i]
    elif footprint == JACOBIAN:
        for i in range(T):
            d = s[D + i]
            s[LEVEL + i] = spread * s[COS + i] * (d * d * d)
    else:
        for i in range(T):
            d = s[D + i]
            s[LEVEL + i] = spread * s[AREA + i] * (d * d * d)
    for i in range(T):
        level = HALF * k_log2(s[LEVEL + i]) + bias
        level = level if level > ZERO else ZERO
        s[LEVEL + i] = level if level < top else top


@kernel
def k_addresses(s: Float32Array, log_size: Scalar, fine: bool) -> None:
    """Addresses and weights of the texels at the level below (``fine``) or above ``LEVEL``.

    With W = n + 4 the levels below n = 2^k fill 2 W^2 + 32 W + 96 k - 210 texels, so that a texel's
    place is ((face + 2) W + row + 32) W + column + 96 k - 210: no table.
    """
    top, low, down, left, right = (A0, A1, AV, AL, AR) if fine else (B0, B1, BV, BL, BR)
    for i in range(T):  # int32 arithmetic widens to int64 unless each result is cut back
        level = s[LEVEL + i]
        first = np.int32(level)
        f = level - np.float32(first)
        k = np.int32(log_size - first)
        k = k if fine else max(np.int32(k - 1), np.int32(0))
        n = from_bits(np.int32((k + 127) << 23))
        x, y = s[U + i] * n + MARGIN, s[V + i] * n + MARGIN
        col, row = np.int32(x), np.int32(y)
        width = np.int32(np.int32(n) + 2 * PAD)
        index = np.int32(np.int32(bits(s[FACE + i]) * width) + np.int32(row + 32))
        index = np.int32(np.int32(index * width) + np.int32(col + np.int32(96 * k)))
        index = np.int32(4 * np.int32(index - 210))
        s[top + i] = from_bits(index)
        s[low + i] = from_bits(np.int32(index + np.int32(4 * width)))
        share = s[GAIN + i] * (ONE - f if fine else f)
        a = share * (x - np.float32(col))
        s[left + i], s[right + i] = share - a, a
        s[down + i] = y - np.float32(row)


@kernel
def k_look_up(s: Float32Array, buffer: Float32Array, count: Scalar, fresnel: bool) -> None:
    """Trilinear lookup and accumulation, one pixel after the other."""
    for i in range(count):
        if s[GAIN + i] == ZERO:
            continue
        at = (
            np.int64(bits(s[A0 + i])), np.int64(bits(s[A1 + i])),
            np.int64(bits(s[B0 + i])), np.int64(bits(s[B1 + i])),
        )  # fmt: skip
        weights = (s[AV + i], s[AL + i], s[AR + i], s[BV + i], s[BL + i], s[BR + i])
        if fresnel:
            add_texels2(buffer, at, weights, s[SCHLICK + i], s, PLAIN + 8 * i, FRESNEL + 8 * i)
        else:
            add_texels(buffer, at, weights, s, PLAIN + 8 * i)


@row_kernel
def shade_tiles(
    begin: int,
    end: int,
    pixels: Int64Array,
    vectors: Float32Array,
    taps: Float32Array,
    first: Int64Array,
    borders: Float32Array,
    lobes: Float32Array,
    ks: Float32Array,
    r0: Float32Array,
    footprint: Scalar,
    bias: Scalar,
    pi: Scalar,
    buffer: Float32Array,
    log_size: Scalar,
    out: Float32Array,
) -> None:
    """``shading._shade`` for ``SurfacePoints.packed``, in a full power-of-two chain.

    Takes tiles of T pixels, ``begin`` to ``end``. Adds to ``out``. The other arguments as there;
    ``log_size`` (int32) is log2 of N at level 0.
    """
    top = np.float32(log_size)
    for tile in range(begin, end):
        start = tile * T
        count = min(T, pixels.shape[0] - start)
        s = np.empty(SCRATCH, dtype=np.float32)
        k_load_frames(s, start, count, vectors)
        for j in range(lobes.shape[0]):
            fresnel = r0[j, 0] != ONE or r0[j, 1] != ONE or r0[j, 2] != ONE
            for i in range(16 * T):
                s[PLAIN + i] = ZERO
            if footprint != JACOBIAN:
                for i in range(T):
                    wo = (s[OX + i], s[OY + i], s[OZ + i])
                    s[AREA + i] = k_lobe_area(borders[j, 0], borders[j, 1], wo, pi)
            for k in range(first[j], first[j + 1]):
                if not k_weights(s, taps[k]):
                    continue
                k_directions(s, taps[k], lobes[j, 4], lobes[j, 3], fresnel)
                k_faces(s)
                k_levels(s, footprint, taps[k, 4], bias, top)
                k_addresses(s, log_size, True)
                k_addresses(s, log_size, False)
                k_look_up(s, buffer, count, fresnel)
            for i in range(count):
                p = pixels[start + i]
                for c in range(3):
                    a = s[PLAIN + 8 * i + c] + s[PLAIN + 8 * i + 4 + c]
                    b = s[FRESNEL + 8 * i + c] + s[FRESNEL + 8 * i + 4 + c]
                    value = (ONE - r0[j, c]) * b
                    if lobes[j, 4] > ZERO:
                        value += r0[j, c] * a
                    out[p, c] += ks[j, c] * value


def tiles_of(pixels: Int64Array) -> int:
    """How many tiles of T pixels hold them all."""
    return -(-len(pixels) // T)


def fits(pyramid: Pyramid, dtype: type, steps: float) -> bool:
    """Whether ``shade_tiles`` can serve a lookup in this pyramid with this arithmetic."""
    config: Any = numba.config
    if config.DISABLE_JIT:  # the float bits exist in compiled code only
        return False
    size = pyramid.size
    full = len(pyramid.levels) == size.bit_length() and size & (size - 1) == 0
    return dtype is np.float32 and steps == 0.0 and full and size <= MAX_SIZE
