"""The GPU's cube-map sampler: face, bilinear within a level, linear between levels.

Follows the OpenGL/Vulkan text: the face of the largest component (ties z, y, x), seamless edges,
the level clamped to the chain::

    p = N (s + 1)/2 - 1/2,   L = mix of the four texels around p                 (1)
    L(level) = (1 - f) L(floor level) + f L(floor level + 1)                     (2)

All levels lie in one flat buffer, every face with ``seams.PAD`` rings around it: one kernel per
precision serves every size and no lookup branches at a seam.
"""

import numpy as np
import numpy.typing as npt

from ._jit import Scalar, kernel, row_kernel
from .seams import PAD

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)


@kernel
def k_face_uv(x: Scalar, y: Scalar, z: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Face and coordinates in [0, 1] of a direction of any length; ties z over y over x."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if az >= ay and az >= ax:
        if z >= ZERO:
            return 4, HALF * (x / az) + HALF, HALF * (-y / az) + HALF
        return 5, HALF * (-x / az) + HALF, HALF * (-y / az) + HALF
    if ay >= ax:
        if y >= ZERO:
            return 2, HALF * (x / ay) + HALF, HALF * (z / ay) + HALF
        return 3, HALF * (x / ay) + HALF, HALF * (-z / ay) + HALF
    if x >= ZERO:
        return 0, HALF * (-z / ax) + HALF, HALF * (-y / ax) + HALF
    return 1, HALF * (z / ax) + HALF, HALF * (-y / ax) + HALF


@kernel
def k_quantise(value: Scalar, steps: Scalar) -> Scalar:
    """Round to a multiple of 1/steps (a sampler's fixed-point fraction); 0 steps: leave."""
    if steps > ZERO:
        return np.floor(value * steps + HALF) / steps
    return value


@kernel
def k_bilinear(
    face: Scalar,
    u: Scalar,
    v: Scalar,
    offset: Scalar,
    n: Scalar,
    stride: Scalar,
    steps: Scalar,
    seamless: bool,
) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Eq. (1): buffer index of the upper left texel, of the one below it, and the fractions."""
    size = type(u)(n)
    px = k_quantise(u * size - HALF, steps)
    py = k_quantise(v * size - HALF, steps)
    if not seamless:
        px = min(max(px, ZERO), size - ONE)
        py = min(max(py, ZERO), size - ONE)
    fx, fy = np.floor(px), np.floor(py)
    width = n + 2 * PAD
    col, row = np.int64(fx) + PAD, np.int64(fy) + PAD
    index = (offset + (face * width + row) * width + col) * stride
    return index, index + width * stride, px - fx, py - fy


@kernel
def k_trilinear_rgb(
    x: Scalar,
    y: Scalar,
    z: Scalar,
    level: Scalar,
    buffer: Float32Array,
    chain: Int64Array,
    stride: Scalar,
    steps: Scalar,
) -> tuple[Scalar, Scalar, Scalar]:
    """Eq. (2), three channels. ``chain`` (levels, 2): texel offset and face size of each level."""
    face, u, v = k_face_uv(x, y, z)
    top = chain.shape[0] - 1
    clamped = min(max(level, ZERO * level), type(level)(top))
    first = min(np.int64(clamped), top)
    f = k_quantise(clamped - type(level)(first), steps)
    r = g = b = ZERO * u
    for j in range(2):
        weight = ONE - f if j == 0 else f
        if weight != ZERO:
            at = min(first + j, top)
            i, k, a, c = k_bilinear(face, u, v, chain[at, 0], chain[at, 1], stride, steps, True)
            w00, w01 = (ONE - a) * (ONE - c) * weight, a * (ONE - c) * weight
            w10, w11 = (ONE - a) * c * weight, a * c * weight
            p, q = i + stride, k + stride
            r += buffer[i] * w00 + buffer[p] * w01 + buffer[k] * w10 + buffer[q] * w11
            g += (
                buffer[i + 1] * w00
                + buffer[p + 1] * w01
                + buffer[k + 1] * w10
                + buffer[q + 1] * w11
            )
            b += (
                buffer[i + 2] * w00
                + buffer[p + 2] * w01
                + buffer[k + 2] * w10
                + buffer[q + 2] * w11
            )
    return r, g, b


@kernel
def k_round_level(level: Scalar, half_to_even: bool) -> Scalar:
    """Nearest level; exactly x.5 goes to the even one, or down (ceil(level + 1/2) - 1)."""
    down = np.int64(np.ceil(level + HALF)) - 1
    if half_to_even and level - type(level)(down) == HALF and down % 2 == 1:
        return down + 1
    return down


@row_kernel
def sample_chain(
    begin: int,
    end: int,
    directions: FloatArray,
    levels: FloatArray,
    buffer: Float32Array,
    chain: Int64Array,
    stride: Scalar,
    steps: Scalar,
    linear: bool,
    mip_linear: bool,
    seamless: bool,
    half_to_even: bool,
    out: FloatArray,
) -> None:
    """Look up directions (K, 3) at levels (K,) into ``out`` (K, C); see ``Pyramid.sample``."""
    top = chain.shape[0] - 1
    for k in range(begin, end):
        d = directions[k]
        face, u, v = k_face_uv(d[0], d[1], d[2])
        level = min(max(levels[k], ZERO * u), type(u)(top))
        first = (
            min(np.int64(level), top) if mip_linear else max(k_round_level(level, half_to_even), 0)
        )
        f = k_quantise(level - type(u)(first), steps) if mip_linear else ZERO * u
        for c in range(out.shape[1]):
            out[k, c] = ZERO
        for j in range(2):
            weight = ONE - f if j == 0 else f
            if weight == ZERO:
                continue
            at = min(first + j, top)
            offset, n = chain[at, 0], chain[at, 1]
            if linear:
                i, low, a, b = k_bilinear(face, u, v, offset, n, stride, steps, seamless)
                w00, w01 = (ONE - a) * (ONE - b), a * (ONE - b)
                w10, w11 = (ONE - a) * b, a * b
                for c in range(out.shape[1]):
                    out[k, c] += weight * (
                        buffer[i + c] * w00
                        + buffer[i + stride + c] * w01
                        + buffer[low + c] * w10
                        + buffer[low + stride + c] * w11
                    )
            else:
                width = n + 2 * PAD
                col = min(np.int64(u * type(u)(n)), n - 1) + PAD
                row = min(np.int64(v * type(u)(n)), n - 1) + PAD
                i = (offset + (face * width + row) * width + col) * stride
                for c in range(out.shape[1]):
                    out[k, c] += weight * buffer[i + c]
