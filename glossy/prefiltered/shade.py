"""``method="prefiltered"``: one lookup for each lobe, in a stack of maps filtered in advance.

::

    L = sum over lobes  (n.r) weight(cos_o) E(axis; cos_o)                                  (1)

with E from ``maps`` eq. (1), the axis turned from the reflected direction by the lobe's offsets
(``stack`` eq. 2), and (n.r) = cos theta_o where the lobe stands for f. Nothing depends on the
tangent but the azimuth of a lobe beside the plane of incidence, seen exactly along the normal.

Source: Kautz and McCool 2000, section 5.
"""

import numba
import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, parallel_kernel
from ..brdf import Material
from ..cubemap import CubeMap
from ..frames import SurfacePoints
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


@parallel_kernel
def _shade_stack(
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    rows: FloatArray,
    outside: Scalar,
    turned: bool,
    buffer: npt.NDArray[np.float32],
    chain: npt.NDArray[np.int64],
    out: FloatArray,
) -> None:
    # (P, 3) x3; FilteredStack's rows (K, 7), buffer and chain; out (P, 3) added to
    top = rows.shape[0] - 1
    for p in numba.prange(normal.shape[0]):
        nx, ny, nz = normal[p, 0], normal[p, 1], normal[p, 2]
        vx, vy, vz = view[p, 0], view[p, 1], view[p, 2]
        c = vx * nx + vy * ny + vz * nz
        if c <= ZERO:
            continue
        i, last = 0, top
        while last - i > 1:  # the rows around c
            middle = (i + last) // 2
            if rows[middle, 0] <= c:
                i = middle
            else:
                last = middle
        j = min(i + 1, top)
        f = ZERO * c
        if j > i:
            f = (c - rows[i, 0]) / (rows[j, 0] - rows[i, 0])
            f = min(max(f, ZERO * c), ONE)
        level = rows[i, 1] + f * (rows[j, 1] - rows[i, 1])
        # along: away from the viewer in the surface; the mirror direction is c n + s along
        x, y, z = (c + c) * nx - vx, (c + c) * ny - vy, (c + c) * nz - vz
        if turned:
            ex, ey, ez = c * nx - vx, c * ny - vy, c * nz - vz
            square = ex * ex + ey * ey + ez * ez
            s = np.sqrt(square)
            if square > TINY:
                ex, ey, ez = ex / s, ey / s, ez / s
            else:
                ex, ey, ez = -tangent[p, 0], -tangent[p, 1], -tangent[p, 2]
            up = rows[i, 5] + f * (rows[j, 5] - rows[i, 5])
            side = rows[i, 6] + f * (rows[j, 6] - rows[i, 6])
            sine, cosine = np.sin(up), np.cos(up)
            a, b = c * cosine - s * sine, s * cosine + c * sine
            g, h = b * np.cos(side), b * np.sin(side)
            x = a * nx + g * ex + h * (ny * ez - nz * ey)
            y = a * ny + g * ey + h * (nz * ex - nx * ez)
            z = a * nz + g * ez + h * (nx * ey - ny * ex)
        red, green, blue = k_trilinear_rgb(x, y, z, level, buffer, chain, 4, ZERO * c)
        k = c if outside > ZERO else ONE
        out[p, 0] += k * (rows[i, 2] + f * (rows[j, 2] - rows[i, 2])) * red
        out[p, 1] += k * (rows[i, 3] + f * (rows[j, 3] - rows[i, 3])) * green
        out[p, 2] += k * (rows[i, 4] + f * (rows[j, 4] - rows[i, 4])) * blue


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
    if not isinstance(maps, PrefilteredMaps):
        raise _check.fail("prepared", "must come from prefilter", type(maps).__name__)
    seen = np.flatnonzero(points.coverage)
    out = np.zeros((points.coverage.size, 3), dtype=dtype)
    rows = [np.asarray(_check.frozen(own.rows.astype(dtype))) for own in maps.stacks]
    for pick, (n, t, v) in chunks(points, seen, dtype):
        part = np.zeros((len(pick), 3), dtype=dtype)
        for own, table in zip(maps.stacks, rows, strict=True):
            outside = dtype(own.stack.cosine_outside)
            turned = bool(own.rows[:, 5:].any())
            _shade_stack(n, t, v, table, outside, turned, own.buffer, own.chain, part)
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

    Raises
    ------
    ValueError
        For an anisotropic or transmitting material, or an option out of range.
    """
    if not material.sided_lobes():
        return PrefilteredMaps((), map_size)
    count = (LOBES if mode == "multi" else 1) if lobes is None else lobes
    stacks = approximate(material, mode=mode, lobes=count, elevations=elevations)
    return prefilter(cube, stacks, map_size, tolerance)
