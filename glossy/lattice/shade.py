"""``method="lattice"``: few filtered lookups with the lobe's spread and its exact reflectivity.

For the lobe that a pixel sees (``frame``) and its taps (``table``), x = (s1 z1, s2 z2)::

    s = mean + x1 g1/s1 + x2 g2/s2,   wh = (s, 1)/|(s, 1)|,   wi = reflect(wo, wh)       (1)
    w = w(t) exp(z.z/2 - (sx/mx)^2 - (sy/my)^2) (wi.n) max(wi.n, tau s2)^-alpha / (wh.n)  (2)
    sigma^2 = (tau s2)^2 a/a0,   a = (wo.wh)(wh.n)^3, a0 its value at the mean            (3)
    L = ks R(wo) sum w F L_mip(wi, level) / sum w F                                       (4)

(2) is the exact lobe, corrected for what the tap's own width adds: on the plane a sum of taps
weighted w(t) makes a Gaussian of the lobe's spread, and exp(z.z/2) takes that Gaussian's place out
again. Within a tap's own width of the horizon its cosine is a ramp whatever alpha is: else, for
alpha = 1, a whole tap would go out where its middle sets. R is the lobe's reflectivity, so a white
environment comes out as well as R is read, and samples below the horizon darken nothing. The level
is that whose trilinear tap comes closest to a round Gaussian of
width sigma: with u = sigma^2 over the variance of the level below, the mixture of variances 1 and 4
nearest (least squares) to one of variance u has the fraction ::

    f = (3/10 - 3 / ((u + 4)(u + 1))) / (9/40)                                            (5)

a little more of the coarser level than equal variance has. Between levels 0 and 1, of variances
v0 = 1/6 and v1, which differ by more than four, the mixture is measured to be best near
log(v/v0) / log(v1/v0) for one tap, and a little finer where several share a lobe ::

    f = (v - v0)/(v1 - v0) (v1 + k)/(v + k),   k = v1 / 2                               (6)

The method is ours; ``tiles`` holds the loop laid out for vector units.
"""

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check, tiles
from .._jit import Scalar, row_kernel
from .._threads import in_rows
from ..brdf import Material
from ..frames import SurfacePoints
from ..pyramid import Pyramid, subtexel_steps
from ..sampler import k_trilinear_rgb
from ..shading import KERNELS, chunks, k_frame, k_fresnel
from ..taps import tap_constants
from .table import lattice_taps, reflectivity_table
from .tap import k_gauss_level, k_lattice_pixel, k_lattice_tap, k_reflected
from .tiles import shade_lattice_tiles

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

ZERO, ONE = np.float32(0.0), np.float32(1.0)
UNKNOWN = "box"  # what an explicit chain is taken to be


@dataclasses.dataclass(frozen=True)
class LatticeTable:
    """What the kernels take: taps and reflectivities of all lobes of one material.

    ``taps`` (K, 15) and ``widths`` (L, 5): polynomials of ``table``; ``first`` (L + 1,): where each
    lobe's taps begin; ``lobes``, ``ks``, ``r0``: as in ``PackedMaterial``; ``white`` (L, rows,
    columns, 3): ``reflectivity_table``; ``law`` (2,): ``tap_constants``.
    """

    taps: FloatArray
    widths: FloatArray
    first: Int64Array
    lobes: FloatArray
    ks: FloatArray
    r0: FloatArray
    white: FloatArray
    law: FloatArray
    texels: float
    bias: float
    steps: float

    def cast(self, dtype: type) -> "LatticeTable":
        """The table in the kernels' precision."""
        names = ("taps", "widths", "lobes", "ks", "r0", "white", "law")
        arrays: dict[str, Any] = {k: _check.frozen(getattr(self, k).astype(dtype)) for k in names}
        numbers = {k: dtype(getattr(self, k)) for k in ("texels", "bias", "steps")}
        return dataclasses.replace(self, **arrays, **numbers)


def lattice_table(
    material: Material,
    pyramid: Pyramid,
    *,
    samples: int = 14,
    bias: float = 0.0,
    subtexel_bits: int | None = None,
) -> LatticeTable:
    """The taps of ``lattice`` for one material; same options."""
    if not isinstance(pyramid, Pyramid) or pyramid.channels != 3:
        raise _check.fail("pyramid", "must be a Pyramid of three channels", pyramid)
    packed = material.pack()
    lobes = [lobe for lobe, _ in material.sided_lobes()]
    taps = lattice_taps(samples)
    white = [reflectivity_table(*lobe.widths, lobe.alpha) for lobe in lobes]
    columns = max((w.shape[1] for w in white), default=1)
    even = [np.broadcast_to(w, (len(w), columns, 3)) if w.shape[1] == 1 else w for w in white]
    return LatticeTable(
        taps=np.tile(taps.rows, (len(lobes), 1)),
        widths=np.tile(taps.log2_width, (len(lobes), 1)),
        first=np.asarray(_check.frozen(len(taps) * np.arange(len(lobes) + 1, dtype=np.int64))),
        lobes=packed.lobes,
        ks=packed.ks,
        r0=packed.r0,
        white=np.stack(even) if even else np.zeros((0, 2, 1, 3)),
        law=np.array(tap_constants(pyramid.filter or UNKNOWN)),
        texels=0.25 * float(pyramid.size) ** 2,
        bias=_check.number("bias", bias),
        steps=subtexel_steps(subtexel_bits),
    )


@row_kernel
def _shade_lattice(
    begin: int,
    end: int,
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    taps: FloatArray,
    widths: FloatArray,
    first: Int64Array,
    lobes: FloatArray,
    ks: FloatArray,
    r0: FloatArray,
    white: FloatArray,
    law: FloatArray,
    texels: Scalar,
    bias: Scalar,
    steps: Scalar,
    pi: Scalar,
    buffer: Float32Array,
    chain: Int64Array,
    stride: Scalar,
    out: FloatArray,
) -> None:
    # (P, 3) x3, then LatticeTable's arrays, then Pyramid's; out (P, 3)
    for p in range(begin, end):
        out[p, 0] = out[p, 1] = out[p, 2] = ZERO
        frame, wo = k_frame(normal[p], tangent[p], view[p])
        if wo[2] <= ZERO:
            continue
        for j in range(lobes.shape[0]):
            pixel = k_lattice_pixel(wo, lobes[j], widths[j])
            spread = pixel[7] * texels
            red = green = blue = ZERO * pi
            red_sum = green_sum = blue_sum = ZERO * pi
            for k in range(first[j], first[j + 1]):
                kept, x, y, z, area, weight, schlick = k_lattice_tap(
                    taps[k], lobes[j], pixel, wo, frame
                )
                if not kept:
                    continue
                d = ONE / max(abs(x), abs(y), abs(z))
                level = k_gauss_level(spread * area * (d * d * d), law[0], law[1]) + bias
                r, g, b = k_trilinear_rgb(x, y, z, level, buffer, chain, stride, steps)
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


def lattice(
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    *,
    precision: str = "single",
    samples: int = 14,
    bias: float = 0.0,
    subtexel_bits: int | None = None,
    kernel: str = "auto",
) -> FloatArray:
    """Lattice sampling, eq. (4).

    Parameters
    ----------
    samples : int
        Budget of each lobe; the nearest number of taps there is a table for is taken
        (``lattice_taps``: every one up to 32, then 40, 48 and 64).
    bias : float [level]
        Added to every level.
    subtexel_bits : int, optional
        Fixed-point fractions of the sampler (see ``Pyramid.sample``).
    kernel : "auto" or "plain"
        As for ``regular``.
    precision : "single" or "double"

    Returns
    -------
    (..., 3) radiance of the glossy lobes. In a pyramid built by ``build_pyramid`` the filter's own
    widths set the level; an explicit chain of levels is taken to be a box chain.
    """
    dtype = _check.dtype_of(precision)
    table = lattice_table(
        material, pyramid, samples=samples, bias=bias, subtexel_bits=subtexel_bits
    )
    tiled = _check.choice("kernel", kernel, KERNELS) == "auto" and tiles.fits(
        pyramid, dtype, table.steps
    )
    cast = table.cast(dtype)
    shared = (
        cast.taps, cast.widths, cast.first, cast.lobes, cast.ks, cast.r0, cast.white, cast.law,
        cast.texels, cast.bias,
    )  # fmt: skip
    buffer, chain, stride = pyramid.kernel_arguments
    out: npt.NDArray[Any] = np.zeros((points.coverage.size, 3), dtype=dtype)
    pi = dtype(math.pi)
    if tiled:
        seen, packed = points.packed
        log_size = np.int32(pyramid.size.bit_length() - 1)
        in_rows(
            shade_lattice_tiles,
            tiles.tiles_of(seen),
            seen,
            packed,
            *shared,
            pi,
            buffer,
            log_size,
            out,
            grain=4,
        )
    else:
        for pick, (n, t, v) in chunks(points, np.flatnonzero(points.coverage), dtype):
            part = np.empty((len(pick), 3), dtype=dtype)
            in_rows(
                _shade_lattice,
                len(n),
                n,
                t,
                v,
                *shared,
                cast.steps,
                pi,
                buffer,
                chain,
                stride,
                part,
                grain=64,
            )
            out[pick] = part
    return out.reshape(*points.shape, 3)
