"""The real-time estimators: a few filtered lookups per pixel along a pattern of half vectors.

For every half vector wh of a lobe's pattern, with wi = reflect(wo, wh)::

    L = ks/n sum L_mip(wi, level) f(wi, wo) (wi.n) / p,   p = p_h / (4 (wi.wh))         (1)

Samples with wi.n <= 0 add nothing and count in n. The regular pattern has one density for all of
its samples, p_h = mean of D(wh) ("paper") or of D(wh)(wh.n) ("projected": dense patterns then tend
to the integral); importance sampling has p_h = D(wh)(wh.n) for each. Since wh is known exactly, the
lobe needs no exponential per pixel: with F and the lobe's D, (1) is ::

    L = ks sum g L_mip F(wo.wh) (wi.n) / ((wi.n)(wo.n))^alpha,   g = D(wh) / (n p_h)    (2)

``k_tap`` is the definition of one sample; the plain pixel loop and ``trace`` both call it, and
``tiles`` holds the same loop laid out for vector units. Transmission
lobes look up wi mirrored in the surface, with 1 - F for F.

Source: the regular sampling paper, eqs. 2, 9, 16-18 and its ``EvaluateSpecularLobe``; importance
sampling with filtered lookups is Colbert and Krivanek's, with Hammersley points.
"""

import math
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check, methods, tiles
from ._arguments import checked, require
from ._jit import Scalar, kernel, row_kernel
from ._threads import in_rows
from .brdf import Lobe, Material, k_schlick, k_schlick_rest
from .footprint import FOOTPRINTS, JACOBIAN, k_level, k_lobe_area, k_texels
from .frames import SurfacePoints
from .pattern import distribution, importance_pattern, pattern_for_budget
from .pyramid import Pyramid
from .sampler import k_trilinear_rgb
from .tap_table import Patterns, Row, TapTable, cut_row, join_rows, patterns_of

NORMALISATIONS = ("paper", "projected")
KERNELS = ("auto", "plain")
CHUNK = 1 << 20  # pixels converted to the kernel's precision at a time

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

ZERO, ONE, TWO = (np.float32(v) for v in (0.0, 1.0, 2.0))


# --- one sample -----------------------------------------------------------------------------------


@kernel
def k_tap(
    tap: FloatArray,
    lobe: FloatArray,
    area: Scalar,
    footprint: Scalar,
    bias: Scalar,
    wo: tuple[Scalar, Scalar, Scalar],
    frame: tuple[Scalar, ...],
) -> tuple[bool, Scalar, Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]:
    """One sample: kept, wi in world coordinates, texels, level, weight without F, Schlick's term.

    ``wo`` is local; ``frame`` holds t, b, n in world coordinates. The last is (1 - wo.wh)^5 for a
    reflection lobe, 1 - (1 - wo.wh)^5 for a transmission lobe.
    """
    wox, woy, woz = wo
    cos_h = wox * tap[0] + woy * tap[1] + woz * tap[2]
    ix, iy = TWO * cos_h * tap[0] - wox, TWO * cos_h * tap[1] - woy
    iz = TWO * cos_h * tap[2] - woz
    if cos_h <= ZERO or iz <= ZERO:
        none = ZERO * cos_h
        return False, none, none, none, none, none, none, none
    up = iz * lobe[4]
    x = frame[0] * ix + frame[3] * iy + frame[6] * up
    y = frame[1] * ix + frame[4] * iy + frame[7] * up
    z = frame[2] * ix + frame[5] * iy + frame[8] * up
    d = ONE / max(abs(x), abs(y), abs(z))
    texels = k_texels(footprint, tap[4], area, cos_h, d)
    weight = tap[3] * iz
    if lobe[3] != ZERO:
        weight = weight / (iz * woz) ** lobe[3]
    if lobe[4] > ZERO:
        schlick = k_schlick(ix, iy, iz, wox, woy, woz, cos_h)
    else:
        schlick = k_schlick_rest(ix, iy, iz, wox, woy, woz, cos_h)
    return True, x, y, z, texels, k_level(texels, bias), weight, schlick


@kernel
def k_fresnel(r0: Scalar, schlick: Scalar, side: Scalar) -> Scalar:
    """F for a reflection lobe (side +1), 1 - F for a transmission lobe (-1); see ``k_tap``."""
    f = (ONE - r0) * schlick
    return r0 + f if side > ZERO else f


@kernel
def k_frame(
    normal: FloatArray, tangent: FloatArray, view: FloatArray
) -> tuple[tuple[Scalar, ...], tuple[Scalar, Scalar, Scalar]]:
    """Frame t, b, n in world coordinates, and the local direction to the viewer."""
    nx, ny, nz = normal[0], normal[1], normal[2]
    tx, ty, tz = tangent[0], tangent[1], tangent[2]
    bx, by, bz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
    vx, vy, vz = view[0], view[1], view[2]
    wo = (
        vx * tx + vy * ty + vz * tz,
        vx * bx + vy * by + vz * bz,
        vx * nx + vy * ny + vz * nz,
    )
    return (tx, ty, tz, bx, by, bz, nx, ny, nz), wo


@row_kernel
def _shade(
    begin: int,
    end: int,
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    taps: FloatArray,
    first: Int64Array,
    borders: FloatArray,
    lobes: FloatArray,
    ks: FloatArray,
    r0: FloatArray,
    footprint: Scalar,
    bias: Scalar,
    steps: Scalar,
    pi: Scalar,
    buffer: Float32Array,
    chain: Int64Array,
    stride: Scalar,
    out: FloatArray,
) -> None:
    # (P, 3) x3, then TapTable's arrays, then Pyramid's; out (P, 3)
    for p in range(begin, end):
        out[p, 0] = out[p, 1] = out[p, 2] = ZERO
        frame, wo = k_frame(normal[p], tangent[p], view[p])
        if wo[2] <= ZERO:
            continue
        for j in range(lobes.shape[0]):
            area = ONE * pi
            if footprint != JACOBIAN:
                area = k_lobe_area(borders[j, 0], borders[j, 1], wo, pi)
            red = green = blue = ZERO * pi
            for k in range(first[j], first[j + 1]):
                kept, x, y, z, _texels, level, weight, schlick = k_tap(
                    taps[k], lobes[j], area, footprint, bias, wo, frame
                )
                if kept:
                    r, g, b = k_trilinear_rgb(x, y, z, level, buffer, chain, stride, steps)
                    red += weight * k_fresnel(r0[j, 0], schlick, lobes[j, 4]) * r
                    green += weight * k_fresnel(r0[j, 1], schlick, lobes[j, 4]) * g
                    blue += weight * k_fresnel(r0[j, 2], schlick, lobes[j, 4]) * b
            out[p, 0] += ks[j, 0] * red
            out[p, 1] += ks[j, 1] * green
            out[p, 2] += ks[j, 2] * blue


# --- tables ---------------------------------------------------------------------------------------


def regular_table(
    material: Material,
    pyramid: Pyramid,
    *,
    samples: int = 20,
    threshold: float = 0.1,
    footprint: str = "paper",
    normalisation: str = "paper",
    bias: float = 0.0,
    pattern: Patterns = None,
    subtexel_bits: int | None = None,
) -> TapTable:
    """The samples of ``regular`` for one material; same options."""
    _check.choice("footprint", footprint, FOOTPRINTS)
    _check.choice("normalisation", normalisation, NORMALISATIONS)
    rows: list[Row] = []
    lobes = [lobe for lobe, _ in material.sided_lobes()]
    for lobe, given in zip(lobes, patterns_of(pattern, len(lobes)), strict=True):
        own = given or pattern_for_budget(lobe, samples=samples, threshold=threshold)
        mx, my = lobe.widths
        h = own.half_vectors
        d = distribution(h, mx, my)
        p_h = own.pdf_constant if normalisation == "paper" else own.projected_pdf_constant
        if p_h is None:
            p_h = float(np.mean(d if normalisation == "paper" else d * h[:, 2]))
        rows.append(cut_row(lobe, own, d / (len(h) * p_h), footprint, threshold))
    return join_rows(material, pyramid, rows, footprint, bias, subtexel_bits)


def importance_table(
    material: Material,
    pyramid: Pyramid,
    *,
    samples: int = 20,
    bias: float = 0.0,
    pattern: Patterns = None,
    subtexel_bits: int | None = None,
) -> TapTable:
    """The samples of ``importance`` for one material; same options."""
    rows: list[Row] = []
    lobes = [lobe for lobe, _ in material.sided_lobes()]
    for lobe, given in zip(lobes, patterns_of(pattern, len(lobes)), strict=True):
        h = (given or importance_pattern(lobe, samples=samples)).half_vectors
        p_h = distribution(h, *lobe.widths) * h[:, 2]
        rows.append((h, 1.0 / (len(h) * h[:, 2]), 1.0 / (len(h) * p_h), (0.0, 0.0)))
    return join_rows(material, pyramid, rows, "jacobian", bias, subtexel_bits)


TABLES = {"regular": regular_table, "importance": importance_table}


# --- methods --------------------------------------------------------------------------------------


def chunks(
    points: SurfacePoints, seen: Int64Array, dtype: type
) -> Iterator[tuple[Int64Array, tuple[FloatArray, FloatArray, FloatArray]]]:
    """Some of the points ``seen`` at a time, with normal, tangent, view for the kernels."""
    vectors = [v.reshape(-1, 3) for v in (points.normal, points.tangent, points.view)]
    for start in range(0, len(seen), CHUNK):
        pick = seen[start : start + CHUNK]
        n, t, v = (_check.frozen(a[pick].astype(dtype)) for a in vectors)
        yield pick, (n, t, v)


def run_table(
    points: SurfacePoints,
    table: TapTable,
    pyramid: Pyramid,
    precision: str = "single",
    kernel: str = "auto",
) -> FloatArray:
    """Evaluate eq. (2) at every point, shape (..., 3)."""
    dtype = _check.dtype_of(precision)
    if not isinstance(pyramid, Pyramid) or pyramid.channels != 3:
        raise _check.fail("pyramid", "must be a Pyramid of three channels", pyramid)
    tiled = _check.choice("kernel", kernel, KERNELS) == "auto" and tiles.fits(
        pyramid, dtype, table.steps
    )
    cast = table.cast(dtype)
    buffer, chain, stride = pyramid.kernel_arguments
    seen, packed = points.packed if tiled else (np.flatnonzero(points.coverage), None)
    out: npt.NDArray[Any] = np.zeros((points.coverage.size, 3), dtype=dtype)
    shared = (cast.taps, cast.first, cast.borders, cast.lobes, cast.ks, cast.r0, cast.footprint)
    if packed is not None:
        log_size = np.int32(pyramid.size.bit_length() - 1)
        in_rows(
            tiles.shade_tiles, tiles.tiles_of(seen), seen, packed, *shared, cast.bias,
            dtype(math.pi), buffer, log_size, out, grain=4,
        )  # fmt: skip
    else:
        for pick, (n, t, v) in chunks(points, seen, dtype):
            part = np.empty((len(pick), 3), dtype=dtype)
            in_rows(
                _shade, len(pick), n, t, v, *shared, cast.bias, cast.steps, dtype(math.pi),
                buffer, chain, stride, part, grain=256,
            )  # fmt: skip
            out[pick] = part
    return out.reshape(*points.shape, 3)


def regular(
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    *,
    precision: str = "single",
    samples: int = 20,
    threshold: float = 0.1,
    footprint: str = "paper",
    normalisation: str = "paper",
    bias: float = 0.0,
    pattern: Patterns = None,
    subtexel_bits: int | None = None,
    kernel: str = "auto",
) -> FloatArray:
    """Regular sampling, eq. (1) with one density per pattern.

    Parameters
    ----------
    samples : int
        Budget of each lobe; the nearest pattern is taken (``pattern_for_budget``).
    threshold : float in (0, 1)
        Share of the peak at which the lobe is cut off.
    footprint : "paper", "thesis" or "jacobian"
        Texels per sample, eqs. (3)-(5) of ``footprint``.
    normalisation : "paper" or "projected"
        The density constant: mean of D, or of D (wh.n).
    bias : float [level]
        Added to every level.
    pattern : Pattern or one for each lobe, optional
        Used as given; ``samples`` is then without effect, and ``threshold`` too if the pattern
        records its own.
    subtexel_bits : int, optional
        Fixed-point fractions of the sampler (see ``Pyramid.sample``).
    kernel : "auto" or "plain"
        "auto" takes the vectorised loop where it applies (single precision, a full chain of
        powers of two up to 4096, exact fractions); "plain" is the loop that defines the method.
    precision : "single" or "double"

    Returns
    -------
    (..., 3) radiance of the glossy lobes.
    """
    table = regular_table(
        material,
        pyramid,
        samples=samples,
        threshold=threshold,
        footprint=footprint,
        normalisation=normalisation,
        bias=bias,
        pattern=pattern,
        subtexel_bits=subtexel_bits,
    )
    return run_table(points, table, pyramid, precision, kernel)


def importance(
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    *,
    precision: str = "single",
    samples: int = 20,
    bias: float = 0.0,
    pattern: Patterns = None,
    subtexel_bits: int | None = None,
    kernel: str = "auto",
) -> FloatArray:
    """Filtered importance sampling: the same Hammersley pattern at every pixel.

    Options as for ``regular``; a sample's footprint is the solid angle 1/(n p) it stands for.
    """
    table = importance_table(
        material,
        pyramid,
        samples=samples,
        bias=bias,
        pattern=pattern,
        subtexel_bits=subtexel_bits,
    )
    return run_table(points, table, pyramid, precision, kernel)


@checked
def shade(
    points: SurfacePoints,
    material: Material | Lobe,
    prepared: Any,
    method: str = "regular",
    precision: str = "single",
    irradiance: npt.ArrayLike | None = None,
    irradiance_below: npt.ArrayLike | None = None,
    parallax: object = None,
    **options: Any,
) -> FloatArray:
    """Radiance towards the viewer from every point, by a real-time method.

    Parameters
    ----------
    points : SurfacePoints
        Any shape (...); masked points and points seen from behind are black.
    material : Material, or a Lobe alone
    prepared : Pyramid
        What the method looks up; other methods prepare something else.
    method : str
        A name of ``methods.METHODS``.
    precision : "single" or "double"
        "single" follows the GPU's arithmetic, "double" is its yardstick.
    irradiance : (..., 3) array, optional
        Irradiance at the points for the diffuse term kd/pi E. A material with kd > 0 without it
        is warned about.
    irradiance_below : (..., 3) array, optional
        Irradiance on the other side, for ``diffuse_transmission`` in the same way.
    parallax : BoundingPlanes, optional
        Look up where each sample's direction meets these planes; needs points with positions and
        a method of ``methods.PLANES``.
    **options
        The method's own: for ``regular`` samples, threshold, footprint, normalisation, bias,
        pattern, subtexel_bits, kernel.

    Returns
    -------
    (..., 3) float32, or float64 in double precision.

    Raises
    ------
    ValueError
        For an unknown method, an option foreign to it, a value out of range, or radiance beyond the
        largest number of the precision where the map is finite.
    """
    function = methods.resolve(method)
    methods.check_options(method, options)
    if method not in methods.PREPARE:  # these say what makes theirs
        require("prepared", prepared, Pyramid)
    if isinstance(material, Lobe):
        material = Material(reflection=[material])
    dtype = _check.dtype_of(precision)
    out: FloatArray
    if parallax is None:
        out = function(points, material, prepared, precision=precision, **options)
    else:
        from .parallax import shade_planes

        out = shade_planes(points, material, prepared, method, parallax, precision, options)
    diffuse = (
        ("kd", material.diffuse, "irradiance", irradiance),
        ("diffuse_transmission", material.diffuse_below, "irradiance_below", irradiance_below),
    )
    for name, weight, source, given in diffuse:
        if not weight.any():
            continue
        if given is None:
            message = (
                f"material has {name} > 0 but no {source} was given: the diffuse term is left out"
            )
            warnings.warn(message, stacklevel=3)
            continue
        e = _check.array(source, given)
        try:
            e = np.broadcast_to(e, (*points.shape, 3))
        except ValueError:
            rule = f"must broadcast to {(*points.shape, 3)}"
            raise _check.fail(source, rule, e.shape) from None
        front = points.coverage & (np.sum(points.view * points.normal, axis=-1) > 0.0)
        share = material.diffuse_share(points.local_view)
        light = weight / math.pi * e if share is None else weight / math.pi * share * e
        with np.errstate(over="ignore"):
            out += np.where(front[..., None], light, 0.0).astype(dtype)
    finite = np.isfinite(out)
    if not finite.all() and _is_finite(prepared, irradiance, irradiance_below):
        over = np.asarray(~finite.all(axis=-1))
        rule = f"must not make radiance beyond {np.finfo(dtype).max:.3g}{_check.first_place(over)}"
        got = f"{int(over.sum())} points that are"
        name = "prepared" if irradiance is None else "prepared, irradiance"
        raise _check.fail(name, f"{rule}; scale the map down", got)
    return out


def _is_finite(prepared: Any, *diffuse: npt.ArrayLike | None) -> bool:
    """Whether what is looked up, or the map it was made of, has neither NaN nor infinity."""
    cube = getattr(prepared, "cube", None)
    held = getattr(prepared, "levels", []) if cube is None else [cube.faces]
    given = [light for light in diffuse if light is not None]
    return all(bool(np.all(np.isfinite(values))) for values in (*held, *given))
