"""``method="prefiltered"``: one lookup for each lobe, in a stack of maps filtered in advance.

::

    L = sum over lobes  (n.r) weight(cos_o) E(axis; cos_o)                                  (1)

with E from ``maps`` eq. (1), the axis turned from the reflected direction by the lobe's offsets
(``stack`` eq. 2), and (n.r) = cos theta_o where the lobe stands for f. Nothing depends on the
tangent but the azimuth of a lobe beside the plane of incidence, seen exactly along the normal.

Source: Kautz and McCool 2000, section 5.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from ..brdf import Material
from ..cubemap import CubeMap
from ..frames import SurfacePoints
from ..parallax import k_redirect, plane_chunks
from ..planes import BoundingPlanes
from ..sampler import k_trilinear_rgb
from ..shading import chunks
from .approximate import approximate
from .filter import TOLERANCE
from .maps import SIZE, PrefilteredMaps, prefilter

ELEVATIONS = 16
LOBES = 3  # of mode "multi"
TINY = np.float32(1e-12)  # squared sine of a view that counts as along the normal
ZERO, ONE = np.float32(0.0), np.float32(1.0)

FloatArray = npt.NDArray[np.floating]
Lobe = tuple[FloatArray, bool, bool, npt.NDArray[np.float32], npt.NDArray[np.int64]]
"""What the kernels take for a lobe: rows, outside, turned, buffer, chain."""


@kernel
def k_axis(
    point: tuple[Scalar, ...], rows: FloatArray, turned: bool
) -> tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]:
    """View cosine, the row of ``rows`` at or below it and the share of the next, and the axis.

    ``point``: normal, tangent, view, three numbers each.
    """
    nx, ny, nz, tx, ty, tz, vx, vy, vz = point
    c = vx * nx + vy * ny + vz * nz
    i, last = 0, rows.shape[0] - 1
    while last - i > 1:
        middle = (i + last) // 2
        if rows[middle, 0] <= c:
            i = middle
        else:
            last = middle
    f = ZERO * c
    if last > i:
        f = min(max((c - rows[i, 0]) / (rows[last, 0] - rows[i, 0]), f), f + ONE)
    else:
        i = last
    x, y, z = (c + c) * nx - vx, (c + c) * ny - vy, (c + c) * nz - vz
    if turned:
        # e: away from the viewer, in the surface; the mirror direction is c n + s e
        ex, ey, ez = c * nx - vx, c * ny - vy, c * nz - vz
        square = ex * ex + ey * ey + ez * ez
        s = np.sqrt(square)
        if square > TINY:
            ex, ey, ez = ex / s, ey / s, ez / s
        else:
            ex, ey, ez = -tx, -ty, -tz
        up, side = k_mix(rows, i, f, 5), k_mix(rows, i, f, 6)
        sine, cosine = np.sin(up), np.cos(up)
        a, b = c * cosine - s * sine, s * cosine + c * sine
        g, h = b, ZERO * b
        if side != ZERO:
            g, h = b * np.cos(side), b * np.sin(side)
        x = a * nx + g * ex + h * (ny * ez - nz * ey)
        y = a * ny + g * ey + h * (nz * ex - nx * ez)
        z = a * nz + g * ez + h * (nx * ey - ny * ex)
    return c, i, f, x, y, z


@kernel
def k_mix(rows: FloatArray, i: Scalar, f: Scalar, column: Scalar) -> Scalar:
    """A column between row ``i`` and the next (or at ``i``, where it is the last)."""
    j = min(i + 1, rows.shape[0] - 1)
    return rows[i, column] + f * (rows[j, column] - rows[i, column])


@row_kernel
def _shade_stack(
    begin: int,
    end: int,
    seen: npt.NDArray[np.intp],
    packed: FloatArray,
    rows: FloatArray,
    outside: bool,
    turned: bool,
    buffer: npt.NDArray[np.float32],
    chain: npt.NDArray[np.int64],
    out: FloatArray,
) -> None:
    # (P,) places in out, (9, P); FilteredStack's rows (K, 7), buffer and chain; out added to
    for k in range(begin, end):
        a, p = packed, seen[k]
        point = (a[0, k], a[1, k], a[2, k], a[3, k], a[4, k], a[5, k], a[6, k], a[7, k], a[8, k])
        c, i, f, x, y, z = k_axis(point, rows, turned)
        if c <= ZERO:
            continue
        level = k_mix(rows, i, f, 1)
        red, green, blue = k_trilinear_rgb(x, y, z, level, buffer, chain, 4, ZERO * c)
        factor = c if outside else ONE
        out[p, 0] += factor * k_mix(rows, i, f, 2) * red
        out[p, 1] += factor * k_mix(rows, i, f, 3) * green
        out[p, 2] += factor * k_mix(rows, i, f, 4) * blue


@row_kernel
def _shade_stack_planes(
    begin: int,
    end: int,
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    offset: FloatArray,
    inverse: FloatArray,
    normals: FloatArray,
    width: Scalar,
    rows: FloatArray,
    outside: bool,
    turned: bool,
    buffer: npt.NDArray[np.float32],
    chain: npt.NDArray[np.int64],
    out: FloatArray,
) -> None:
    # (P, 3) x4, inverse (P, M), normals (M, 3); then as _shade_stack
    for p in range(begin, end):
        n, t, v = normal[p], tangent[p], view[p]
        point = (n[0], n[1], n[2], t[0], t[1], t[2], v[0], v[1], v[2])
        c, i, f, x, y, z = k_axis(point, rows, turned)
        if c <= ZERO:
            continue
        x, y, z, _det = k_redirect((x, y, z), offset[p], inverse[p], normals, width)
        level = k_mix(rows, i, f, 1)
        red, green, blue = k_trilinear_rgb(x, y, z, level, buffer, chain, 4, ZERO * c)
        k = c if outside else ONE
        out[p, 0] += k * k_mix(rows, i, f, 2) * red
        out[p, 1] += k * k_mix(rows, i, f, 3) * green
        out[p, 2] += k * k_mix(rows, i, f, 4) * blue


def _arguments(maps: PrefilteredMaps, dtype: type) -> list[Lobe]:
    """Of every lobe, what the kernels take."""
    if not isinstance(maps, PrefilteredMaps):
        raise _check.fail("prepared", "must come from prefilter", type(maps).__name__)
    found: list[Lobe] = []
    for own in maps.stacks:
        rows: FloatArray = _check.frozen(own.rows.astype(dtype))
        turned = bool(own.rows[:, 5:].any())
        found.append((rows, bool(own.stack.cosine_outside), turned, own.buffer, own.chain))
    return found


def prefiltered(
    points: SurfacePoints,
    material: Material,
    maps: PrefilteredMaps,
    *,
    precision: str = "single",
) -> FloatArray:
    """One lookup for each lobe of the stacks, eq. (1).

    Parameters
    ----------
    material : Material
        The one the maps were made for; only its diffuse term is still looked at, by ``shade``.
    maps : PrefilteredMaps
        From ``prefilter`` or ``methods.prepare("prefiltered", cube, material)``.
    precision : "single" or "double"

    Returns
    -------
    (..., 3) radiance of the glossy lobes.

    Raises
    ------
    ValueError
        If ``maps`` are not ``PrefilteredMaps``.
    """
    dtype = _check.dtype_of(precision)
    lobes = _arguments(maps, dtype)
    out: npt.NDArray[Any] = np.zeros((points.coverage.size, 3), dtype=dtype)
    if precision == "single":
        seen, packed = points.packed
        for lobe in lobes:
            in_rows(_shade_stack, len(seen), seen, packed, *lobe, out, grain=64)
        return out.reshape(*points.shape, 3)
    for pick, vectors in chunks(points, np.flatnonzero(points.coverage), dtype):
        packed = np.asarray(_check.frozen(np.concatenate(vectors, axis=1).T))
        for lobe in lobes:
            in_rows(_shade_stack, len(pick), _check.frozen(pick), packed, *lobe, out, grain=64)
    return out.reshape(*points.shape, 3)


def shade_prefiltered(
    points: SurfacePoints,
    material: Material,
    maps: PrefilteredMaps,
    method: str,
    planes: BoundingPlanes,
    precision: str,
    options: Mapping[str, Any],
) -> FloatArray:
    """The same with bounding planes: each lookup goes where its axis meets the room.

    A slice holds a lobe's whole blur, so the footprint is "thesis", as for the split sum.

    Raises
    ------
    ValueError
        For the footprint "projected".
    """
    if planes.footprint != "thesis":
        rule = f"must be 'thesis' for method {method!r}, whose slices are those of the lobe"
        raise _check.fail("footprint", rule, planes.footprint)
    dtype = _check.dtype_of(precision)
    lobes = _arguments(maps, dtype)
    normals, width = _check.frozen(planes.normals.astype(dtype)), dtype(planes.width)
    out: npt.NDArray[Any] = np.zeros((points.coverage.size, 3), dtype=dtype)
    for pick, (n, t, v, offset, inverse) in plane_chunks(points, planes, dtype):
        part: npt.NDArray[Any] = np.zeros((len(pick), 3), dtype=dtype)
        for lobe in lobes:
            in_rows(
                _shade_stack_planes,
                len(n),
                n,
                t,
                v,
                offset,
                inverse,
                normals,
                width,
                *lobe,
                part,
                grain=64,
            )
        out[pick] = part
    return out.reshape(*points.shape, 3)


def prepare(
    cube: CubeMap,
    material: Material,
    mode: str = "single",
    lobes: int | None = None,
    elevations: int = ELEVATIONS,
    map_size: int = SIZE,
    tolerance: float = TOLERANCE,
    cosine: str = "inside",
    finish: str = "mean",
) -> PrefilteredMaps:
    """Lobes that stand for the material, and the map filtered with them.

    Parameters
    ----------
    cube : CubeMap
    material : Material
        Isotropic, without transmission.
    mode : "single", "flat" or "multi"
        One lobe for each elevation; one for all; ``lobes`` for each (``approximate``).
    lobes : int
        Of "multi".
    elevations, map_size, tolerance
        Slices, texels along a face's edge, and RMS error of each (``prefilter``).
    cosine, finish
        Of ``approximate``: "inside" or "outside"; "mean", "minimum", "rescale" or "refit".

    Raises
    ------
    ValueError
        For an anisotropic or transmitting material, or an option out of range.
    """
    if not material.sided_lobes():
        return PrefilteredMaps((), map_size)
    count = (LOBES if mode == "multi" else 1) if lobes is None else lobes
    stacks = approximate(
        material, mode=mode, lobes=count, elevations=elevations, cosine=cosine, finish=finish
    )
    return prefilter(cube, stacks, map_size, tolerance)
