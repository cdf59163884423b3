"""Split-sum methods with bounding planes: their few lookups are turned to where rays meet the room.

A level of the chain holds a lobe's whole blur, and its choice knows of no solid angle. So there is
nothing to widen or narrow, as engines leave it: the footprint is "thesis" (eq. (2) of ``parallax``
with e = 0), and "projected" is refused.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, row_kernel
from .._threads import in_rows
from ..brdf import Material
from ..frames import SurfacePoints
from ..parallax import k_redirect, plane_chunks
from ..planes import BoundingPlanes
from ..sampler import k_trilinear_rgb
from ..shading import k_frame
from .chain import SplitSumChain
from .shade import LOOKUPS, k_albedo, k_lookup, lobe_rows

FloatArray = npt.NDArray[np.floating]

ZERO = np.float32(0.0)


@row_kernel
def _shade_lobe_planes(
    begin: int,
    end: int,
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    offset: FloatArray,
    inverse: FloatArray,
    normals: FloatArray,
    width: Scalar,
    taps: FloatArray,
    bend: Scalar,
    minor: Scalar,
    side: Scalar,
    alpha: Scalar,
    albedo: FloatArray,
    colour: FloatArray,
    level: Scalar,
    buffer: npt.NDArray[np.float32],
    chain: npt.NDArray[np.int64],
    out: FloatArray,
) -> None:
    # as shade._shade_lobe; offset (P, 3), inverse (P, M), normals (M, 3); out (P, 3) added to
    for p in range(begin, end):
        frame, wo = k_frame(normal[p], tangent[p], view[p])
        woz = wo[2]
        if woz <= ZERO:
            continue
        red = green = blue = total = ZERO * woz
        for k in range(taps.shape[0]):
            kept, x, y, z = k_lookup(taps[k], bend, minor, side, wo, frame)
            if not kept:
                continue
            x, y, z, _det = k_redirect((x, y, z), offset[p], inverse[p], normals, width)
            r, g, b = k_trilinear_rgb(x, y, z, level, buffer, chain, 4, ZERO * woz)
            weight = taps[k, 3]
            red, green, blue = red + weight * r, green + weight * g, blue + weight * b
            total += weight
        if total > ZERO:
            scale, bias = k_albedo(albedo, alpha, woz)
            out[p, 0] += (colour[0, 0] * scale + colour[1, 0] * bias) * (red / total)
            out[p, 1] += (colour[0, 1] * scale + colour[1, 1] * bias) * (green / total)
            out[p, 2] += (colour[0, 2] * scale + colour[1, 2] * bias) * (blue / total)


def shade_chain(
    points: SurfacePoints,
    material: Material,
    chain: SplitSumChain,
    method: str,
    planes: BoundingPlanes,
    precision: str,
    options: Mapping[str, Any],
) -> FloatArray:
    """Glossy radiance (..., 3); ``parallax.shade_planes`` has checked points and options.

    Raises
    ------
    ValueError
        For the footprint "projected", or a value out of range.
    """
    if planes.footprint != "thesis":
        rule = f"must be 'thesis' for method {method!r}, whose levels are those of the lobe"
        raise _check.fail("footprint", rule, planes.footprint)
    dtype = _check.dtype_of(precision)
    own = dict(options)
    bias = own.pop("bias", 0.0)
    rows = lobe_rows(material, chain, *LOOKUPS[method](**own), bias, dtype)
    normals = _check.frozen(planes.normals.astype(dtype))
    out: npt.NDArray[Any] = np.zeros((points.coverage.size, 3), dtype=dtype)
    for pick, (n, t, v, offset, inverse) in plane_chunks(points, planes, dtype):
        part: npt.NDArray[Any] = np.zeros((len(pick), 3), dtype=dtype)
        for row in rows:
            in_rows(
                _shade_lobe_planes, len(n), n, t, v, offset, inverse, normals, dtype(planes.width),
                *row, part, grain=64
            )  # fmt: skip
        out[pick] = part
    return out.reshape(*points.shape, 3)
