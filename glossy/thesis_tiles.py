"""The pixel loop of ``thesis`` again, laid out for vector units as ``tiles`` describes.

A tile keeps one sum of weights for each pixel, so that r0 has to be the same in all channels (a
lobe of coloured r0 comes as three lobes of one channel); F is then part of a sample's weight and
one sum of lookups serves::

    L = sum (w X / L_mip) L_mip / sum w,   w, X: eqs. (4) and (5) of ``thesis``
"""

import numpy as np
import numpy.typing as npt

from ._jit import Scalar, kernel, row_kernel
from .footprint import JACOBIAN, k_lobe_area
from .tiles import (
    AREA,
    COS,
    FRESNEL,
    GAIN,
    OX,
    OY,
    OZ,
    PLAIN,
    SCHLICK,
    SCRATCH,
    T,
    k_addresses,
    k_directions,
    k_faces,
    k_levels,
    k_load_frames,
    k_look_up,
    k_weights,
)

Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

BY_PDF, BY_PDF_COS, BY_BRDF_COS = range(3)

# rows of the scratch array: the coloured sums of ``tiles`` are free
SUM, SCALE = FRESNEL, FRESNEL + T

ZERO, ONE, TWO = (np.float32(v) for v in (0.0, 1.0, 2.0))


@kernel
def _fold_shares(
    s: Float32Array, tap: Float32Array, estimator: Scalar, r0: Scalar, side: Scalar, fresnel: bool
) -> None:
    """Add w to each pixel's sum, and turn its weight into that of the lookup, w X / L_mip."""
    base = r0 if side > ZERO else ZERO
    for i in range(T):
        s[SCHLICK + i] = base + (ONE - r0) * s[SCHLICK + i] if fresnel else base
    for i in range(T):
        weight, oz = s[GAIN + i], s[OZ + i]
        dropped = weight == ZERO
        c = ONE if dropped else s[COS + i]
        share = tap[5] * oz / c
        if estimator == BY_PDF_COS:
            share = share * (TWO * c * tap[2] - oz)
        elif estimator == BY_BRDF_COS:
            share = share * weight * (s[SCALE + i] * s[SCHLICK + i])
        share = ZERO if dropped else share
        s[SUM + i] = s[SUM + i] + share
        s[GAIN + i] = share * (weight * s[SCHLICK + i])


@row_kernel
def shade_mean_tiles(
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
    estimator: Scalar,
    bias: Scalar,
    pi: Scalar,
    buffer: Float32Array,
    log_size: Scalar,
    out: Float32Array,
) -> None:
    """``thesis._shade_mean`` where ``tiles.fits`` and r0 is grey; adds to ``out``.

    Arguments as for ``tiles.shade_tiles``.
    """
    top = np.float32(log_size)
    for tile in range(begin, end):
        start = tile * T
        count = min(T, pixels.shape[0] - start)
        s = np.empty(SCRATCH, dtype=np.float32)
        k_load_frames(s, start, count, vectors)
        for j in range(lobes.shape[0]):
            fresnel = r0[j, 0] != ONE
            for i in range(8 * T):
                s[PLAIN + i] = ZERO
            for i in range(T):
                s[SUM + i] = ZERO
                s[SCALE + i] = max(s[OZ + i], ZERO) ** lobes[j, 3]
            if footprint != JACOBIAN:
                for i in range(T):
                    wo = (s[OX + i], s[OY + i], s[OZ + i])
                    s[AREA + i] = k_lobe_area(borders[j, 0], borders[j, 1], wo, pi)
            for k in range(first[j], first[j + 1]):
                if not k_weights(s, taps[k]):
                    continue
                k_directions(s, taps[k], lobes[j, 4], lobes[j, 3], fresnel)
                _fold_shares(s, taps[k], estimator, r0[j, 0], lobes[j, 4], fresnel)
                k_faces(s)
                k_levels(s, footprint, taps[k, 4], bias, top)
                k_addresses(s, log_size, True)
                k_addresses(s, log_size, False)
                k_look_up(s, buffer, count, False)
            for i in range(count):
                p = pixels[start + i]
                if s[SUM + i] > ZERO:
                    for c in range(3):
                        a = s[PLAIN + 8 * i + c] + s[PLAIN + 8 * i + 4 + c]
                        out[p, c] += ks[j, c] * (a / s[SUM + i])
