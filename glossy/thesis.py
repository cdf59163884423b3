"""The thesis's estimators: a mean of the samples above the horizon, weighted by the lobe itself.

With p the importance density of wi and f the lobe (sums over the samples with wi.n > 0)::

    4.23   L = sum L_mip f (wi.n)          / sum p                                        (1)
    4.24   L = sum L_mip f (wi.n)^2        / sum p (wi.n)                                 (2)
    4.25   L = sum L_mip f^2 (wi.n)^2 / p  / sum f (wi.n)                                 (3)

All three are a weighted mean of X, what importance sampling takes of one sample::

    L = sum w X / sum w,   X = L_mip f (wi.n) / p = L_mip F (wi.n)^(1 - alpha)
                                                  / ((wh.n) (wo.n)^alpha)                 (4)
    w = p,  p (wi.n),  f (wi.n);   p = D(wh) (wh.n) / (4 (wo.wh))                         (5)

so for alpha = 0 no pixel is brighter than twice the brightest texel (X < 2 L_mip). In colour, f of
(3) is that of the channel: each channel has weights of its own when r0 does. ``thesis_tiles`` holds
the pixel loop once more, laid out for vector units.

Source: thesis, eqs. 4.23-4.25, footprint 4.14-4.17; ``docs/methods.md`` has the limits of dense
patterns. The weights are scaled by a factor of the pixel and summed in the order of the pattern.
"""

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check, tiles
from ._jit import Scalar, kernel, row_kernel
from ._threads import in_rows
from .brdf import Material
from .footprint import FOOTPRINTS, JACOBIAN, k_lobe_area
from .frames import SurfacePoints
from .pattern import distribution
from .pyramid import Pyramid
from .sampler import k_trilinear_rgb
from .shading import KERNELS, chunks, k_frame, k_fresnel, k_tap
from .tap_table import Patterns, Row, TapTable, cut_row, join_rows, patterns_of
from .thesis_pattern import thesis_pattern
from .thesis_tiles import BY_BRDF_COS, BY_PDF, BY_PDF_COS, shade_mean_tiles

ESTIMATORS = ("4.23", "4.24", "4.25")  # BY_PDF, BY_PDF_COS, BY_BRDF_COS

ZERO, ONE, TWO = (np.float32(v) for v in (0.0, 1.0, 2.0))

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]


@dataclasses.dataclass(frozen=True)
class MeanTable(TapTable):
    """A ``TapTable`` whose samples are averaged; ``taps`` (K, 6) ends with D (wh.n), scaled."""

    estimator: int


@kernel
def k_share(
    estimator: Scalar, tap: FloatArray, wo: tuple[Scalar, Scalar, Scalar], weight: Scalar
) -> Scalar:
    """Weight w of eq. (5) without F, times a factor of the pixel that keeps it near 1.

    ``weight`` is that of ``k_tap`` with g = 1/(wh.n): X / (F L_mip).
    """
    cos_h = wo[0] * tap[0] + wo[1] * tap[1] + wo[2] * tap[2]
    density = tap[5] * wo[2] / cos_h  # wo.wh > (wo.n)/2 above the horizon
    if estimator == BY_PDF:
        return density
    if estimator == BY_PDF_COS:
        return density * (TWO * cos_h * tap[2] - wo[2])
    return density * weight


@row_kernel
def _shade_mean(
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
    estimator: Scalar,
    bias: Scalar,
    steps: Scalar,
    pi: Scalar,
    buffer: Float32Array,
    chain: Int64Array,
    stride: Scalar,
    out: FloatArray,
) -> None:
    # as shading._shade; out (P, 3)
    for p in range(begin, end):
        out[p, 0] = out[p, 1] = out[p, 2] = ZERO
        frame, wo = k_frame(normal[p], tangent[p], view[p])
        if wo[2] <= ZERO:
            continue
        for j in range(lobes.shape[0]):
            area = ONE * pi
            if footprint != JACOBIAN:
                area = k_lobe_area(borders[j, 0], borders[j, 1], wo, pi)
            scale = wo[2] ** lobes[j, 3] if estimator == BY_BRDF_COS else ONE * pi
            red = green = blue = ZERO * pi
            red_sum = green_sum = blue_sum = ZERO * pi
            for k in range(first[j], first[j + 1]):
                kept, x, y, z, _texels, level, weight, schlick = k_tap(
                    taps[k], lobes[j], area, footprint, bias, wo, frame
                )
                if not kept:
                    continue
                share = k_share(estimator, taps[k], wo, weight) * scale
                r, g, b = k_trilinear_rgb(x, y, z, level, buffer, chain, stride, steps)
                fr = k_fresnel(r0[j, 0], schlick, lobes[j, 4])
                fg = k_fresnel(r0[j, 1], schlick, lobes[j, 4])
                fb = k_fresnel(r0[j, 2], schlick, lobes[j, 4])
                wr = wg = wb = share
                if estimator == BY_BRDF_COS:
                    wr, wg, wb = share * fr, share * fg, share * fb
                red_sum += wr
                green_sum += wg
                blue_sum += wb
                red += wr * (weight * fr) * r
                green += wg * (weight * fg) * g
                blue += wb * (weight * fb) * b
            if red_sum > ZERO:
                out[p, 0] += ks[j, 0] * (red / red_sum)
            if green_sum > ZERO:
                out[p, 1] += ks[j, 1] * (green / green_sum)
            if blue_sum > ZERO:
                out[p, 2] += ks[j, 2] * (blue / blue_sum)


def thesis_table(
    material: Material,
    pyramid: Pyramid,
    *,
    samples: int = 20,
    kind: str = "auto",
    threshold: float = 0.01,
    estimator: str = "4.25",
    footprint: str = "thesis",
    bias: float = 0.0,
    pattern: Patterns = None,
    subtexel_bits: int | None = None,
) -> MeanTable:
    """The samples of ``thesis`` for one material; same options."""
    _check.choice("footprint", footprint, FOOTPRINTS)
    _check.choice("estimator", estimator, ESTIMATORS)
    rows: list[Row] = []
    densities = [np.empty(0)]
    lobes = [lobe for lobe, _ in material.sided_lobes()]
    for lobe, given in zip(lobes, patterns_of(pattern, len(lobes)), strict=True):
        own = given or thesis_pattern(lobe, samples, kind, threshold)
        height = own.half_vectors[:, 2]
        rows.append(cut_row(lobe, own, 1.0 / height, footprint, threshold))
        p_h = distribution(own.half_vectors, *lobe.widths) * height
        densities.append(p_h / (len(own) * max(float(p_h.max()), 1e-300)))
    table = join_rows(material, pyramid, rows, footprint, bias, subtexel_bits)
    fields = {f.name: getattr(table, f.name) for f in dataclasses.fields(table)}
    fields["taps"] = np.column_stack([table.taps, np.concatenate(densities)])
    return MeanTable(**fields, estimator=ESTIMATORS.index(estimator))


def _by_channel(table: MeanTable) -> MeanTable:
    """The table with each lobe of coloured r0 as three, black but for one channel.

    ``thesis_tiles`` keeps one weight for all channels.
    """
    sources, masks = [], []
    for j, r0 in enumerate(table.r0):
        coloured = bool(np.any(r0 != r0[0]))
        sources += [j] * (3 if coloured else 1)
        masks += [*np.eye(3)] if coloured else [np.ones(3)]
    if len(sources) == len(table.r0):
        return table
    dtype, pick, mask = table.r0.dtype, np.array(sources), np.array(masks)
    counts = np.diff(table.first)[pick]
    r0 = np.array([r0[int(np.argmax(m))] for r0, m in zip(table.r0[pick], mask, strict=True)])
    arrays: dict[str, Any] = {
        "taps": np.concatenate([table.taps[table.first[j] : table.first[j + 1]] for j in pick]),
        "first": np.concatenate([[0], np.cumsum(counts)]),
        "borders": table.borders[pick],
        "lobes": table.lobes[pick],
        "ks": (table.ks[pick] * mask).astype(dtype),
        "r0": np.repeat(r0[:, None], 3, axis=1),
    }
    frozen: dict[str, Any] = {k: _check.frozen(a) for k, a in arrays.items()}
    return dataclasses.replace(table, **frozen)


def thesis(
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    *,
    precision: str = "single",
    samples: int = 20,
    kind: str = "auto",
    threshold: float = 0.01,
    estimator: str = "4.25",
    footprint: str = "thesis",
    bias: float = 0.0,
    pattern: Patterns = None,
    subtexel_bits: int | None = None,
    kernel: str = "auto",
) -> FloatArray:
    """The thesis's real-time integration, eqs. (1)-(3).

    Parameters
    ----------
    samples : int
        Count of each lobe.
    kind, threshold
        As for ``thesis_pattern``.
    estimator : "4.25", "4.24" or "4.23"
        The thesis's equation; 4.23 shows a line where a sample passes the horizon.
    footprint : "thesis", "paper" or "jacobian"
        Texels per sample, eqs. (3)-(5) of ``footprint``.
    bias, pattern, subtexel_bits, kernel, precision
        As for ``regular``. Any pattern will do: the density is that of the lobe.

    Returns
    -------
    (..., 3) radiance of the glossy lobes.

    Raises
    ------
    ValueError
        For a value out of range, or a pyramid not of three channels.
    """
    dtype = _check.dtype_of(precision)
    if not isinstance(pyramid, Pyramid) or pyramid.channels != 3:
        raise _check.fail("pyramid", "must be a Pyramid of three channels", pyramid)
    table = thesis_table(
        material,
        pyramid,
        samples=samples,
        kind=kind,
        threshold=threshold,
        estimator=estimator,
        footprint=footprint,
        bias=bias,
        pattern=pattern,
        subtexel_bits=subtexel_bits,
    ).cast(dtype)
    tiled = _check.choice("kernel", kernel, KERNELS) == "auto" and tiles.fits(
        pyramid, dtype, table.steps
    )
    if tiled:
        table = _by_channel(table)
    buffer, chain, stride = pyramid.kernel_arguments
    out: npt.NDArray[Any] = np.zeros((points.coverage.size, 3), dtype=dtype)
    shared = (
        table.taps, table.first, table.borders, table.lobes, table.ks, table.r0, table.footprint,
        table.estimator, table.bias,
    )  # fmt: skip
    if tiled:
        seen, packed = points.packed
        log_size = np.int32(pyramid.size.bit_length() - 1)
        in_rows(
            shade_mean_tiles,
            tiles.tiles_of(seen),
            seen,
            packed,
            *shared,
            dtype(math.pi),
            buffer,
            log_size,
            out,
            grain=4,
        )
        return out.reshape(*points.shape, 3)
    for pick, (n, t, v) in chunks(points, np.flatnonzero(points.coverage), dtype):
        part = np.empty((len(pick), 3), dtype=dtype)
        in_rows(
            _shade_mean,
            len(n),
            n,
            t,
            v,
            *shared,
            table.steps,
            dtype(math.pi),
            buffer,
            chain,
            stride,
            part,
            grain=64,
        )
        out[pick] = part
    return out.reshape(*points.shape, 3)
