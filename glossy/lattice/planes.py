"""The lattice with bounding planes: taps of the lobe as it leaves the surface.

Places, weights and reflectivity are those of ``shade``; only the lookup changes. The tap's variance
in texels follows its footprint, eqs. (2) and (3) of ``parallax`` with e = 3: a square of a length,
like texels. A wide tap that meets several planes is looked up where its middle meets one.
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
from ..parallax import k_redirect, k_texels_change, plane_chunks
from ..planes import BoundingPlanes
from ..pyramid import Pyramid
from ..sampler import k_trilinear_rgb
from ..shading import k_frame, k_fresnel
from .shade import lattice_table
from .tap import k_gauss_level, k_lattice_pixel, k_lattice_tap, k_reflected

FloatArray = npt.NDArray[np.floating]

ZERO, ONE = np.float32(0.0), np.float32(1.0)


@row_kernel
def _shade_lattice_planes(
    begin: int,
    end: int,
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    offset: FloatArray,
    inverse: FloatArray,
    normals: FloatArray,
    width: Scalar,
    projected: bool,
    taps: FloatArray,
    widths: FloatArray,
    first: npt.NDArray[np.int64],
    lobes: FloatArray,
    ks: FloatArray,
    r0: FloatArray,
    white: FloatArray,
    law: FloatArray,
    texels: Scalar,
    bias: Scalar,
    steps: Scalar,
    buffer: npt.NDArray[np.float32],
    chain: npt.NDArray[np.int64],
    stride: Scalar,
    out: FloatArray,
) -> None:
    # as shade._shade_lattice; offset (P, 3), inverse (P, M), normals (M, 3)
    for p in range(begin, end):
        out[p, 0] = out[p, 1] = out[p, 2] = ZERO
        frame, wo = k_frame(normal[p], tangent[p], view[p])
        if wo[2] <= ZERO:
            continue
        for j in range(lobes.shape[0]):
            pixel = k_lattice_pixel(wo, lobes[j], widths[j])
            spread = pixel[7] * texels
            red = green = blue = ZERO * texels
            red_sum = green_sum = blue_sum = ZERO * texels
            for k in range(first[j], first[j + 1]):
                kept, x, y, z, area, weight, schlick = k_lattice_tap(
                    taps[k], lobes[j], pixel, wo, frame
                )
                if not kept:
                    continue
                w = (x, y, z)
                d = ONE / max(abs(x), abs(y), abs(z))
                vx, vy, vz, det = k_redirect(w, offset[p], inverse[p], normals, width)
                change = k_texels_change(w, (vx, vy, vz), det, True, projected)
                variance = spread * area * (d * d * d) * change
                level = k_gauss_level(variance, law[0], law[1]) + bias
                r, g, b = k_trilinear_rgb(vx, vy, vz, level, buffer, chain, stride, steps)
                wr = weight * k_fresnel(r0[j, 0], schlick, lobes[j, 4])
                wg = weight * k_fresnel(r0[j, 1], schlick, lobes[j, 4])
                wb = weight * k_fresnel(r0[j, 2], schlick, lobes[j, 4])
                red += wr * r
                green += wg * g
                blue += wb * b
                red_sum += wr
                green_sum += wg
                blue_sum += wb
            fr, fg, fb = k_reflected(white[j], lobes[j], ks[j], r0[j], wo)
            if red_sum > ZERO:
                out[p, 0] += fr * (red / red_sum)
            if green_sum > ZERO:
                out[p, 1] += fg * (green / green_sum)
            if blue_sum > ZERO:
                out[p, 2] += fb * (blue / blue_sum)


def shade_lattice(
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    _method: str,
    planes: BoundingPlanes,
    precision: str,
    options: Mapping[str, Any],
) -> FloatArray:
    """Glossy radiance (..., 3); ``parallax.shade_planes`` has checked points and options."""
    dtype = _check.dtype_of(precision)
    table = lattice_table(material, pyramid, **options).cast(dtype)
    normals = _check.frozen(planes.normals.astype(dtype))
    out: npt.NDArray[Any] = np.zeros((points.coverage.size, 3), dtype=dtype)
    for pick, (n, t, v, offset, inverse) in plane_chunks(points, planes, dtype):
        part = np.empty((len(pick), 3), dtype=dtype)
        in_rows(
            _shade_lattice_planes, len(n), n, t, v, offset, inverse, normals, dtype(planes.width),
            planes.footprint == "projected", table.taps, table.widths, table.first, table.lobes,
            table.ks, table.r0, table.white, table.law, table.texels, table.bias, table.steps,
            *pyramid.kernel_arguments, part, grain=64,
        )  # fmt: skip
        out[pick] = part
    return out.reshape(*points.shape, 3)
