"""Regular sampling as one would first write it in Numba: a scalar loop over pixels and samples.

The opponent of ``bench_shade``. Same formulas as the product's loop (isotropic or not, footprint
``paper``), fast arithmetic and parallel pixels, unpadded faces with the seams looked up per texel.
"""

import math

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float32]


@numba.njit(fastmath={"nsz", "arcp", "contract", "afn", "reassoc"}, error_model="numpy", cache=True)
def _fetch(
    level: Array, face: int, u: np.float32, v: np.float32
) -> tuple[np.float32, np.float32, np.float32]:
    n = level.shape[1] - 4
    x, y = u * np.float32(n) + np.float32(1.5), v * np.float32(n) + np.float32(1.5)
    col, row = int(x), int(y)
    a, b = x - np.float32(col), y - np.float32(row)
    one = np.float32(1.0)
    w00, w01, w10, w11 = (one - a) * (one - b), a * (one - b), (one - a) * b, a * b
    p, q = level[face, row, col], level[face, row, col + 1]
    r, s = level[face, row + 1, col], level[face, row + 1, col + 1]
    return (
        p[0] * w00 + q[0] * w01 + r[0] * w10 + s[0] * w11,
        p[1] * w00 + q[1] * w01 + r[1] * w10 + s[1] * w11,
        p[2] * w00 + q[2] * w01 + r[2] * w10 + s[2] * w11,
    )


@numba.njit(
    fastmath={"nsz", "arcp", "contract", "afn", "reassoc"},
    error_model="numpy",
    parallel=True,
    cache=True,
)
def shade(
    normal: Array,
    tangent: Array,
    view: Array,
    taps: Array,
    sines: Array,
    r0: np.float32,
    alpha: np.float32,
    levels: tuple[Array, ...],
    out: Array,
) -> None:
    """``taps`` (n, 5): half vector, D/(n p_h), N^2/(4 n); ``levels``: padded RGBA faces."""
    half, one, two, zero = np.float32(0.5), np.float32(1.0), np.float32(2.0), np.float32(0.0)
    pi = np.float32(math.pi)
    top = np.float32(len(levels) - 1)
    for p in numba.prange(normal.shape[0]):
        n, t, v = normal[p], tangent[p], view[p]
        bx = n[1] * t[2] - n[2] * t[1]
        by = n[2] * t[0] - n[0] * t[2]
        bz = n[0] * t[1] - n[1] * t[0]
        ox = v[0] * t[0] + v[1] * t[1] + v[2] * t[2]
        oy = v[0] * bx + v[1] * by + v[2] * bz
        oz = v[0] * n[0] + v[1] * n[1] + v[2] * n[2]
        su, sv = sines[0] * math.sqrt(ox * ox + oz * oz), sines[1] * math.sqrt(oy * oy + oz * oz)
        cu, cv = one - two * su * su, one - two * sv * sv
        area = two * pi
        if cu > zero and cv > zero:
            tu, tv = (
                two * su * math.sqrt(one - su * su) / cu,
                two * sv * math.sqrt(one - sv * sv) / cv,
            )
            area = min(area, pi * tu * tv)
        red = green = blue = zero
        for k in range(taps.shape[0]):
            h = taps[k]
            c = ox * h[0] + oy * h[1] + oz * h[2]
            ix, iy, iz = two * c * h[0] - ox, two * c * h[1] - oy, two * c * h[2] - oz
            if iz <= zero or c <= zero:
                continue
            x = t[0] * ix + bx * iy + n[0] * iz
            y = t[1] * ix + by * iy + n[1] * iz
            z = t[2] * ix + bz * iy + n[2] * iz
            ax, ay, az = abs(x), abs(y), abs(z)
            if az >= ax and az >= ay:
                face, d = (4 if z > zero else 5), one / az
                u, w = (x if z > zero else -x) * d, -y * d
            elif ay >= ax:
                face, d = (2 if y > zero else 3), one / ay
                u, w = x * d, (z if y > zero else -z) * d
            else:
                face, d = (0 if x > zero else 1), one / ax
                u, w = (-z if x > zero else z) * d, -y * d
            u, w = half * u + half, half * w + half
            level = min(max(half * np.log2(h[4] * area * d / c), zero), top)
            first = int(level)
            f = level - np.float32(first)
            r, g, b = _fetch(levels[first], face, u, w)
            if f > zero:
                r1, g1, b1 = _fetch(levels[first + 1], face, u, w)
                r, g, b = r + f * (r1 - r), g + f * (g1 - g), b + f * (b1 - b)
            weight = h[3] * iz
            if alpha != zero:
                weight = weight / (iz * oz) ** alpha
            if r0 != one:
                e = one - c
                weight = weight * (r0 + (one - r0) * (e * e) * (e * e) * e)
            red, green, blue = red + weight * r, green + weight * g, blue + weight * b
        out[p, 0], out[p, 1], out[p, 2] = red, green, blue
