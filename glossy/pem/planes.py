"""The method "pem" with bounding planes: its lookup is turned to where the ray meets the room.

The mirror direction r is corrected to r' (``parallax``), and the level follows what is covered as
seen from the cube map's centre::

    level of the material, or eq. (3) of ``shade`` along r'                 "thesis"
    + 1/2 log2(dr'/dr)                                                      "projected"        (1)

A visibility is that of the regions as the cube map holds them, far away.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from ..brdf import Material
from ..frames import SurfacePoints
from ..parallax import k_redirect, plane_chunks
from ..planes import BoundingPlanes
from ..sampler import k_trilinear_rgb
from ..shading import k_frame
from ..splitsum.shade import k_albedo
from .maps import PartialMaps, k_visible_rgb
from .shade import k_local_level, k_mirror, lobe_arrays, visibility_rows

FloatArray = npt.NDArray[np.floating]

ZERO, HALF = np.float32(0.0), np.float32(0.5)


@kernel
def _turned(
    w: tuple[Scalar, Scalar, Scalar],
    cos_o: Scalar,
    lobe: FloatArray,
    offset: FloatArray,
    inverse: FloatArray,
    normals: FloatArray,
    width: Scalar,
    projected: bool,
) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Unit direction that ``w`` is corrected to, and its level, eq. (1)."""
    x, y, z, det = k_redirect(w, offset, inverse, normals, width)
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    level = k_local_level(lobe[0], lobe[3], x, y, z, cos_o)
    if projected:
        level += HALF * np.log2(det / (length * length * length))
    return x, y, z, level


@row_kernel
def _shade_planes(
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
    lobes: FloatArray,
    tables: FloatArray,
    colours: FloatArray,
    buffer: npt.NDArray[np.float32],
    chain: npt.NDArray[np.int64],
    out: FloatArray,
) -> None:
    # as shade._shade_whole; offset (P, 3), inverse (P, M), normals (M, 3)
    for p in range(begin, end):
        out[p, 0] = out[p, 1] = out[p, 2] = ZERO
        frame, wo = k_frame(normal[p], tangent[p], view[p])
        if wo[2] <= ZERO:
            continue
        for j in range(lobes.shape[0]):
            w = k_mirror(wo, frame, lobes[j, 1])
            x, y, z, level = _turned(
                w, wo[2], lobes[j], offset[p], inverse[p], normals, width, projected
            )
            r, g, b = k_trilinear_rgb(x, y, z, level, buffer, chain, 4, ZERO * x)
            scale, bias = k_albedo(tables[j], lobes[j, 2], wo[2])
            out[p, 0] += (colours[j, 0, 0] * scale + colours[j, 1, 0] * bias) * r
            out[p, 1] += (colours[j, 0, 1] * scale + colours[j, 1, 1] * bias) * g
            out[p, 2] += (colours[j, 0, 2] * scale + colours[j, 1, 2] * bias) * b


@row_kernel
def _shade_planes_visible(
    begin: int,
    end: int,
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    offset: FloatArray,
    inverse: FloatArray,
    visibility: FloatArray,
    normals: FloatArray,
    width: Scalar,
    projected: bool,
    lobes: FloatArray,
    tables: FloatArray,
    colours: FloatArray,
    buffer: npt.NDArray[np.float32],
    boxes: npt.NDArray[np.int64],
    sizes: npt.NDArray[np.int64],
    out: FloatArray,
) -> None:
    # as _shade_planes, with visibility (P, R)
    for p in range(begin, end):
        out[p, 0] = out[p, 1] = out[p, 2] = ZERO
        frame, wo = k_frame(normal[p], tangent[p], view[p])
        if wo[2] <= ZERO:
            continue
        for j in range(lobes.shape[0]):
            w = k_mirror(wo, frame, lobes[j, 1])
            x, y, z, level = _turned(
                w, wo[2], lobes[j], offset[p], inverse[p], normals, width, projected
            )
            r, g, b = k_visible_rgb(x, y, z, level, visibility[p], buffer, boxes, sizes)
            scale, bias = k_albedo(tables[j], lobes[j, 2], wo[2])
            out[p, 0] += (colours[j, 0, 0] * scale + colours[j, 1, 0] * bias) * r
            out[p, 1] += (colours[j, 0, 1] * scale + colours[j, 1, 1] * bias) * g
            out[p, 2] += (colours[j, 0, 2] * scale + colours[j, 1, 2] * bias) * b


def shade_maps(
    points: SurfacePoints,
    material: Material,
    maps: PartialMaps,
    method: str,
    planes: BoundingPlanes,
    precision: str,
    options: Mapping[str, Any],
) -> FloatArray:
    """Glossy radiance (..., 3); ``parallax.shade_planes`` has checked points and options.

    Raises
    ------
    ValueError
        If a value is out of range or the visibility of a wrong shape.
    """
    dtype = _check.dtype_of(precision)
    footprint, bias = options.get("footprint", "constant"), options.get("bias", 0.0)
    shared = lobe_arrays(material, maps, footprint, bias, dtype)
    shares = visibility_rows(points, maps, options.get("visibility"), dtype)
    normals, projected = (
        _check.frozen(planes.normals.astype(dtype)),
        planes.footprint == "projected",
    )
    room = normals, dtype(planes.width), projected
    out: npt.NDArray[Any] = np.zeros((points.coverage.size, 3), dtype=dtype)
    for pick, (n, t, v, offset, inverse) in plane_chunks(points, planes, dtype):
        part = np.empty((len(pick), 3), dtype=dtype)
        if shares is None:
            buffer, chain, _ = maps.pyramid.kernel_arguments
            in_rows(
                _shade_planes,
                len(n),
                n,
                t,
                v,
                offset,
                inverse,
                *room,
                *shared,
                buffer,
                chain,
                part,
                grain=64,
            )
        else:
            seen = _check.frozen(shares[pick])
            in_rows(
                _shade_planes_visible,
                len(n),
                n,
                t,
                v,
                offset,
                inverse,
                seen,
                *room,
                *shared,
                *maps.kernel_arguments,
                part,
                grain=64,
            )
        out[pick] = part
    return out.reshape(*points.shape, 3)
