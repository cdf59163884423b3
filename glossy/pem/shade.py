"""The method "pem": one lookup per lobe in the mirror direction, summed over visible regions.

A lobe is a power of the cosine about the mirror direction r, read from the level that was
calibrated for it, times the lobe's reflectivity at that view::

    L = sum over lobes ks (r0 A(cos_o) + (1 - r0) B(cos_o)) sum_i VIS_i PEM_i(r, level(s))      (1)

A and B: the integrals of f cos with 1 and (1 - wo.wh)^5 for F, from a table; so a white environment
gives the albedo. Without visibility the inner sum is one lookup in the pyramid of the whole.

The exponent of a lobe is that of the cosine with the same mean direction, at normal view, where
the lobe is round: with c = r.wi, x = (1 - c)/(1 + c) and K(c) = exp(-x/m^2) c ((1 + c)/2)^(-5/2) ::

    E = int_0^1 K c dc / int_0^1 K dc = (s + 1)/(s + 2),   s = (2 E - 1)/(1 - E)                (2)

which tends to 1/(2 m^2) for narrow lobes. s is at least 1, as the model has it. Anisotropic lobes
are round with m = sqrt(mx my), for the exponent and the albedo alike. Transmission lobes look
straight through the surface, with 1 - F.

The level is the material's, as in the source (footprint ``constant``). Ours: ``distance`` counts in
that a texel's solid angle falls as d^-3 towards the corners of the cube, ``view`` also that the
lobe narrows across the plane of incidence, to a solid angle smaller by cos_o ::

    level = level(s) + 1/2 log2(d^3) - mean of that over the sphere + 1/2 log2(cos_o)           (3)
    d = |r|/|r|_inf

What is left out: that the lobe gets longer than wide, leans from the mirror direction and ends at
the horizon.

Source: Knuth et al., eq. 5; (2) and (3) are ours.
"""

import functools
import math

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from ..brdf import Material
from ..frames import SurfacePoints
from ..sampler import k_trilinear_rgb
from ..shading import chunks, k_frame
from ..splitsum.shade import ENTRIES, albedo_table, equivalent_width, k_albedo
from .glossiness import calibrate
from .maps import PartialMaps, check_visibility, k_visible_rgb

NODES = 96  # of the quadrature behind eq. (2)
TAIL = 40.0  # in units of m^2, where it ends
FOOTPRINTS = ("constant", "distance", "view")
MEAN_SHIFT = 0.4162217  # of 1/2 log2(d^3) over the sphere [level]

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

ZERO, HALF, ONE = (np.float32(v) for v in (0.0, 0.5, 1.0))
THREE_HALVES = np.float32(1.5)


@kernel
def k_mirror(
    wo: tuple[Scalar, Scalar, Scalar], frame: tuple[Scalar, ...], side: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Mirror direction in world coordinates; for a transmission lobe (side -1) straight through."""
    x, y, z = -wo[0], -wo[1], side * wo[2]
    return (
        frame[0] * x + frame[3] * y + frame[6] * z,
        frame[1] * x + frame[4] * y + frame[7] * z,
        frame[2] * x + frame[5] * y + frame[8] * z,
    )


@kernel
def k_local_level(
    level: Scalar, footprint: Scalar, x: Scalar, y: Scalar, z: Scalar, cos_o: Scalar
) -> Scalar:
    """Eq. (3): ``level`` at a unit direction and view; footprint by its place in FOOTPRINTS."""
    if footprint >= ONE:
        level = level - THREE_HALVES * np.log2(max(abs(x), abs(y), abs(z)))
    if footprint > ONE:
        level = level + HALF * np.log2(cos_o)
    return level


@row_kernel
def _shade_whole(
    begin: int,
    end: int,
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    lobes: FloatArray,
    tables: FloatArray,
    colours: FloatArray,
    buffer: Float32Array,
    chain: Int64Array,
    out: FloatArray,
) -> None:
    # (P, 3) x3; lobes (L, 4): level, side, alpha, footprint; (L, ENTRIES, 2); (L, 2, 3); out (P, 3)
    for p in range(begin, end):
        out[p, 0] = out[p, 1] = out[p, 2] = ZERO
        frame, wo = k_frame(normal[p], tangent[p], view[p])
        if wo[2] <= ZERO:
            continue
        for j in range(lobes.shape[0]):
            x, y, z = k_mirror(wo, frame, lobes[j, 1])
            level = k_local_level(lobes[j, 0], lobes[j, 3], x, y, z, wo[2])
            r, g, b = k_trilinear_rgb(x, y, z, level, buffer, chain, 4, ZERO * x)
            scale, bias = k_albedo(tables[j], lobes[j, 2], wo[2])
            out[p, 0] += (colours[j, 0, 0] * scale + colours[j, 1, 0] * bias) * r
            out[p, 1] += (colours[j, 0, 1] * scale + colours[j, 1, 1] * bias) * g
            out[p, 2] += (colours[j, 0, 2] * scale + colours[j, 1, 2] * bias) * b


@row_kernel
def _shade_visible(
    begin: int,
    end: int,
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    visibility: FloatArray,
    lobes: FloatArray,
    tables: FloatArray,
    colours: FloatArray,
    buffer: Float32Array,
    boxes: Int64Array,
    sizes: Int64Array,
    out: FloatArray,
) -> None:
    # as _shade_whole, with visibility (P, R)
    for p in range(begin, end):
        out[p, 0] = out[p, 1] = out[p, 2] = ZERO
        frame, wo = k_frame(normal[p], tangent[p], view[p])
        if wo[2] <= ZERO:
            continue
        for j in range(lobes.shape[0]):
            x, y, z = k_mirror(wo, frame, lobes[j, 1])
            level = k_local_level(lobes[j, 0], lobes[j, 3], x, y, z, wo[2])
            r, g, b = k_visible_rgb(x, y, z, level, visibility[p], buffer, boxes, sizes)
            scale, bias = k_albedo(tables[j], lobes[j, 2], wo[2])
            out[p, 0] += (colours[j, 0, 0] * scale + colours[j, 1, 0] * bias) * r
            out[p, 1] += (colours[j, 0, 1] * scale + colours[j, 1, 1] * bias) * g
            out[p, 2] += (colours[j, 0, 2] * scale + colours[j, 1, 2] * bias) * b


@functools.lru_cache(maxsize=256)
def cosine_exponent(m: float) -> float:
    """Exponent of the cosine lobe for a lobe of roughness ``m``, eq. (2); infinite for 0."""
    if m == 0.0:
        return math.inf
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    x = 0.5 * (nodes + 1.0) * min(1.0, TAIL * m * m)
    c = (1.0 - x) / (1.0 + x)
    density = weights * np.exp(-x / m**2) * c * (0.5 * (1.0 + c)) ** -2.5 / (1.0 + x) ** 2
    rest = float(density @ (1.0 - c) / density.sum())  # 1 - E
    return max(1.0 / rest - 2.0, 1.0)


def lobe_arrays(
    material: Material, maps: PartialMaps, footprint: str, bias: float, dtype: type
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lobes, tables and colours for the kernels; the options are those of ``pem``."""
    if not isinstance(maps, PartialMaps):
        raise _check.fail("prepared", "must come from partial_maps", maps)
    index = FOOTPRINTS.index(_check.choice("footprint", footprint, FOOTPRINTS))
    shift = _check.in_range("bias", bias, -32.0, 32.0) - (MEAN_SHIFT if index else 0.0)
    rows, tables, colours = [], [], []
    for lobe, side in material.sided_lobes():
        m = equivalent_width(lobe)
        level = float(calibrate(maps.filter, maps.cube.size).level(cosine_exponent(m)))
        ks, r0 = _check.rgb("ks", lobe.ks), _check.rgb("r0", lobe.r0)
        rows.append((level + shift, side, lobe.alpha, index))
        tables.append(albedo_table(m, lobe.alpha, side < 0.0))
        colours.append((ks * r0, ks * (1.0 - r0)))
    return (
        _check.frozen(np.array(rows, dtype).reshape(-1, 4)),
        _check.frozen(np.array(tables, dtype).reshape(-1, ENTRIES, 2)),
        _check.frozen(np.array(colours, dtype).reshape(-1, 2, 3)),
    )


def visibility_rows(
    points: SurfacePoints, maps: PartialMaps, visibility: npt.ArrayLike | None, dtype: type
) -> FloatArray | None:
    """Visibility (P, R) of every point; None for None."""
    if visibility is None:
        return None
    shares = check_visibility(visibility, len(maps.regions), dtype)
    shape = (*points.shape, shares.shape[-1])
    try:
        shares = np.broadcast_to(shares, shape)
    except ValueError:
        raise _check.fail("visibility", f"must broadcast to {shape}", shares.shape) from None
    return np.asarray(shares.reshape(-1, shape[-1]))


def pem(
    points: SurfacePoints,
    material: Material,
    maps: PartialMaps,
    *,
    precision: str = "single",
    visibility: npt.ArrayLike | None = None,
    footprint: str = "constant",
    bias: float = 0.0,
) -> FloatArray:
    """Partial environment maps, eq. (1).

    Parameters
    ----------
    maps : PartialMaps
        From ``partial_maps``.
    visibility : (..., R) array, optional
        Share of each region that a point sees, in the order of ``maps.regions``; None if nothing
        is in the way, which costs one lookup a lobe instead of one for each region.
    footprint : "constant", "distance" or "view"
        What the level depends on, eq. (3): the material alone, as published; also the place on the
        cube; also the view.
    bias : float [level]
        Added to the calibrated level.
    precision : "single" or "double"

    Returns
    -------
    (..., 3) radiance of the glossy lobes. The diffuse term is ``shade``'s, from ``irradiance``;
    that under visibility is ``maps.irradiance(normal, visibility)``.
    """
    dtype = _check.dtype_of(precision)
    shared = lobe_arrays(material, maps, footprint, bias, dtype)
    out = np.zeros((points.coverage.size, 3), dtype=dtype)
    shares = visibility_rows(points, maps, visibility, dtype)
    for pick, vectors in chunks(points, np.flatnonzero(points.coverage), dtype):
        part = np.empty((len(pick), 3), dtype=dtype)
        if shares is None:
            buffer, chain, _ = maps.pyramid.kernel_arguments
            in_rows(_shade_whole, len(pick), *vectors, *shared, buffer, chain, part, grain=64)
        else:
            seen = _check.frozen(shares[pick])
            in_rows(
                _shade_visible, len(pick), *vectors, seen, *shared, *maps.kernel_arguments, part,
                grain=64,
            )  # fmt: skip
        out[pick] = part
    return out.reshape(*points.shape, 3)
