"""The method "pem" with bounding planes: its lookup is turned to where the ray meets the room.

The mirror direction r is corrected to r' (``parallax``), and the level follows what is covered as
seen from the cube map's centre::

    level of the material, or eq. (3) of ``shade`` along r'                 "thesis"
    + 1/2 log2(dr'/dr)                                                      "projected"        (1)

Regions are far away: there is no visibility with planes.
"""

from collections.abc import Mapping
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, parallel_kernel
from ..brdf import Material
from ..frames import SurfacePoints
from ..parallax import k_redirect, plane_chunks
from ..planes import BoundingPlanes
from ..sampler import k_trilinear_rgb
from ..shading import k_frame
from ..splitsum.shade import k_albedo
from .maps import PartialMaps
from .shade import k_local_level, k_mirror, lobe_arrays

FloatArray = npt.NDArray[np.floating]

ZERO, HALF = np.float32(0.0), np.float32(0.5)


@parallel_kernel
def _shade_planes(
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
    for p in numba.prange(normal.shape[0]):
        out[p, 0] = out[p, 1] = out[p, 2] = ZERO
        frame, wo = k_frame(normal[p], tangent[p], view[p])
        if wo[2] <= ZERO:
            continue
        for j in range(lobes.shape[0]):
            w = k_mirror(wo, frame, lobes[j, 1])
            x, y, z, det = k_redirect(w, offset[p], inverse[p], normals, width)
            length = np.sqrt(x * x + y * y + z * z)
            x, y, z = x / length, y / length, z / length
            level = k_local_level(lobes[j, 0], lobes[j, 3], x, y, z, wo[2])
            if projected:
                level += HALF * np.log2(det / (length * length * length))
            r, g, b = k_trilinear_rgb(x, y, z, level, buffer, chain, 4, ZERO * x)
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
        If a visibility is given, or a value is out of range.
    """
    own = dict(options)
    if own.pop("visibility", None) is not None:
        raise _check.fail("visibility", f"must be None for method {method!r} with planes", "one")
    dtype = _check.dtype_of(precision)
    footprint, bias = own.pop("footprint", "constant"), own.pop("bias", 0.0)
    shared = lobe_arrays(material, maps, footprint, bias, dtype)
    buffer, chain, _ = maps.pyramid.kernel_arguments
    normals, projected = (
        _check.frozen(planes.normals.astype(dtype)),
        planes.footprint == "projected",
    )
    out: npt.NDArray[Any] = np.zeros((points.coverage.size, 3), dtype=dtype)
    for pick, (n, t, v, offset, inverse) in plane_chunks(points, planes, dtype):
        part = np.empty((len(pick), 3), dtype=dtype)
        _shade_planes(
            n, t, v, offset, inverse, normals, dtype(planes.width), projected, *shared,
            buffer, chain, part,
        )  # fmt: skip
        out[pick] = part
    return out.reshape(*points.shape, 3)
