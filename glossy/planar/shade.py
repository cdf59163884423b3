"""Shading of planar reflectors from the mirror buffer.

Every sample of a lobe's pattern is mapped into the buffer (``mapping``) and read from its pyramid
at a level of detail:

* ``ellipse``: once per point. The four border directions of the lobe, two along each axis, meet the
  tangent plane of the mirror hit; their pixels p are taken as the ends of an ellipse's axes ::

      A = pi |p1 - p2|/2 |p3 - p4|/2,   level = log2(A / n) / 2 + bias                     (1)

* ``sample``: each sample by itself. Its cell of half vectors covers 4 (wi.wh) cell [sr], and the
  mapping tells how many pixels that is ::

      level = log2(4 (wi.wh) cell  d pixels/d w) / 2 + bias                                (2)

* ``none``: level 0, for the limit of many samples.

(1) is the thesis's; a border direction without a pixel leaves the half axis to its opposite, from
the point's own pixel; without either the axis is the buffer's diagonal. (2) is ours.

Samples that miss the buffer are read from the reflector's cube map, in the direction from its
centre to the place that was found (``Fallback``), or at the nearest pixel of the buffer's edge; one
behind the camera then at the point's own pixel.
"""

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from ..brdf import Lobe, Material
from ..footprint import JACOBIAN
from ..frames import SurfacePoints
from ..pyramid import Pyramid
from ..sampler import k_trilinear_rgb
from ..shading import CHUNK, k_frame, k_fresnel, k_tap
from ..tap_table import Patterns
from ..thesis import k_share
from ..thesis_pattern import ANISOTROPY
from ..thesis_tiles import BY_BRDF_COS
from .levels import k_look_up
from .mapping import (
    BEHIND,
    KINDS,
    MISSED,
    MappingCounts,
    Vector,
    k_map,
    k_meet,
    k_own_pixel,
    k_turn,
)
from .mirror import MirrorBuffer
from .pattern import SUM, border_vectors, planar_table

FloatArray = npt.NDArray[np.floating]
Float64Array = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

LEVELS = ("none", "ellipse", "sample")
NONE, ELLIPSE, SAMPLE = range(3)

ZERO, HALF, ONE, TWO, FOUR = (np.float32(v) for v in (0.0, 0.5, 1.0, 2.0, 4.0))


@dataclasses.dataclass(frozen=True, eq=False)
class Fallback:
    """A cube map's pyramid, captured at ``centre`` (3,): what missed samples read."""

    pyramid: Pyramid
    centre: npt.ArrayLike

    def __post_init__(self) -> None:
        if not isinstance(self.pyramid, Pyramid) or self.pyramid.channels != 3:
            raise _check.fail("pyramid", "must be a Pyramid of three channels", self.pyramid)
        centre = _check.array("centre", self.centre).astype(np.float64)
        if centre.shape != (3,) or not np.all(np.isfinite(centre)):
            raise _check.fail("centre", "must be three finite numbers", self.centre)
        object.__setattr__(self, "centre", centre)


@kernel
def _border_pixel(
    wh: FloatArray,
    wo: Vector,
    frame: tuple[Scalar, ...],
    matrix: FloatArray,
    a: FloatArray,
    ma: Vector,
    own: FloatArray,
) -> tuple[bool, Scalar, Scalar]:
    """Pixel of a border direction through the tangent plane at P's own pixel, and if it has one."""
    u = TWO * (wo[0] * wh[0] + wo[1] * wh[1] + wo[2] * wh[2])
    x, y, z = u * wh[0] - wo[0], u * wh[1] - wo[1], u * wh[2] - wo[2]
    w = (
        frame[0] * x + frame[3] * y + frame[6] * z,
        frame[1] * x + frame[4] * y + frame[7] * z,
        frame[2] * x + frame[5] * y + frame[8] * z,
    )
    _, v, _, _ = k_meet(own, a, ma, w, k_turn(matrix, w[0], w[1], w[2]))
    if v[2] <= ZERO:
        return False, ZERO * x, ZERO * x
    return True, v[0] / v[2], v[1] / v[2]


@kernel
def k_ellipse(
    ends: FloatArray,
    wo: Vector,
    frame: tuple[Scalar, ...],
    matrix: FloatArray,
    a: FloatArray,
    ma: Vector,
    own: FloatArray,
    diagonal: Scalar,
    pi: Scalar,
) -> Scalar:
    """A of eq. (1); ``ends`` (4, 3) border half vectors."""
    area = ONE * pi
    for axis in range(2):
        first, x1, y1 = _border_pixel(ends[2 * axis], wo, frame, matrix, a, ma, own)
        other, x2, y2 = _border_pixel(ends[2 * axis + 1], wo, frame, matrix, a, ma, own)
        if first and other:
            half = HALF * np.sqrt((x1 - x2) * (x1 - x2) + (y1 - y2) * (y1 - y2))
        elif first or other:
            x, y = x1 + x2 - ma[0] / ma[2], y1 + y2 - ma[1] / ma[2]
            half = np.sqrt(x * x + y * y)
        else:
            half = diagonal
        area = area * min(half, diagonal)
    return area


@row_kernel
def _shade(
    begin: int,
    end: int,
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    offset: FloatArray,
    taps: FloatArray,
    first: Int64Array,
    ends: FloatArray,
    lobes: FloatArray,
    ks: FloatArray,
    r0: FloatArray,
    estimator: Scalar,
    rule: Scalar,
    bias: Scalar,
    spread: Scalar,
    twice: bool,
    pi: Scalar,
    matrix: FloatArray,
    planes: FloatArray,
    picture: Float32Array,
    levels: Int64Array,
    cubed: bool,
    shift: FloatArray,
    cube: Float32Array,
    chain: Int64Array,
    stride: Scalar,
    tally: Int64Array,
    out: FloatArray,
) -> None:
    # (P, 3) x4, offset: P - C'; TapTable's arrays, ends (L, 4, 3); spread: 4 Fx Fy / N^2, for the
    # taps' cells bear the cube map's N^2; shift (3,): C' - its centre; tally (P, 1 + KINDS)
    height, width = type(pi)(planes.shape[0]), type(pi)(planes.shape[1])
    diagonal = np.sqrt(height * height + width * width)
    for p in range(begin, end):
        out[p, 0] = out[p, 1] = out[p, 2] = ZERO
        for c in range(tally.shape[1]):
            tally[p, c] = 0
        frame, wo = k_frame(normal[p], tangent[p], view[p])
        if wo[2] <= ZERO:
            continue
        a = offset[p]
        ma = k_turn(matrix, a[0], a[1], a[2])
        row, column = k_own_pixel(ma, planes)
        own = planes[row, column]
        for j in range(lobes.shape[0]):
            level = ZERO * pi
            if rule == ELLIPSE:
                area = k_ellipse(ends[j], wo, frame, matrix, a, ma, own, diagonal, pi)
                level = HALF * np.log2(area / type(pi)(first[j + 1] - first[j])) + bias
            scale = wo[2] ** lobes[j, 3] if estimator == BY_BRDF_COS else ONE * pi
            red = green = blue = ZERO * pi
            red_sum = green_sum = blue_sum = ZERO * pi
            for k in range(first[j], first[j + 1]):
                kept, wx, wy, wz, _texels, cube_level, weight, schlick = k_tap(
                    taps[k], lobes[j], pi, JACOBIAN, bias, wo, frame
                )
                if not kept:
                    continue
                w = (wx, wy, wz)
                mw = k_turn(matrix, wx, wy, wz)
                flags, x, y, ratio, s, c = k_map(w, mw, a, ma, own, planes, twice)
                tally[p, 0] += 1
                if flags != 0:
                    for b in range(len(KINDS)):
                        tally[p, 1 + b] += (flags >> b) & 1
                if flags & MISSED != 0 and cubed:
                    r, g, b = k_trilinear_rgb(
                        s * wx + c * (a[0] + shift[0]),
                        s * wy + c * (a[1] + shift[1]),
                        s * wz + c * (a[2] + shift[2]),
                        cube_level, cube, chain, stride, ZERO * pi,
                    )  # fmt: skip
                else:
                    if flags & BEHIND != 0:
                        x, y = ma[0] / ma[2], ma[1] / ma[2]
                        ratio = ONE / (mw[2] * mw[2] * mw[2]) if mw[2] > ZERO else ONE * pi
                    if rule == SAMPLE:
                        cos_h = wo[0] * taps[k, 0] + wo[1] * taps[k, 1] + wo[2] * taps[k, 2]
                        level = HALF * np.log2(spread * taps[k, 4] * cos_h * ratio) + bias
                    x, y = min(max(x, ZERO * x), width), min(max(y, ZERO * y), height)
                    r, g, b = k_look_up(x, y, level, picture, levels)
                fr = k_fresnel(r0[j, 0], schlick, lobes[j, 4])
                fg = k_fresnel(r0[j, 1], schlick, lobes[j, 4])
                fb = k_fresnel(r0[j, 2], schlick, lobes[j, 4])
                wr = wg = wb = ONE * pi
                if estimator != SUM:
                    wr = wg = wb = k_share(estimator, taps[k], wo, weight) * scale
                if estimator == BY_BRDF_COS:
                    wr, wg, wb = wr * fr, wg * fg, wb * fb
                red_sum += wr
                green_sum += wg
                blue_sum += wb
                red += wr * (weight * fr) * r
                green += wg * (weight * fg) * g
                blue += wb * (weight * fb) * b
            if estimator == SUM:
                red_sum = green_sum = blue_sum = ONE * pi
            if red_sum > ZERO:
                out[p, 0] += ks[j, 0] * (red / red_sum)
            if green_sum > ZERO:
                out[p, 1] += ks[j, 1] * (green / green_sum)
            if blue_sum > ZERO:
                out[p, 2] += ks[j, 2] * (blue / blue_sum)


def shade_counted(
    points: SurfacePoints,
    material: Material | Lobe,
    buffer: MirrorBuffer,
    *,
    precision: str = "single",
    samples: int = 10,
    kind: str = "auto",
    threshold: float = 0.01,
    anisotropy: float = ANISOTROPY,
    estimator: str = "auto",
    level: str = "ellipse",
    bias: float = 0.0,
    filter: str = "box",
    intersections: int = 2,
    fallback: Fallback | None = None,
    pattern: Patterns = None,
) -> tuple[FloatArray, MappingCounts]:
    """``shade_planar``, and what came in the way of its samples."""
    dtype = _check.dtype_of(precision)
    if isinstance(material, Lobe):
        material = Material(reflection=[material])
    if points.position is None:
        raise _check.fail("points", "must have positions for a planar reflector", None)
    rule = LEVELS.index(_check.choice("level", level, LEVELS))
    _check.count("intersections", intersections, low=1, high=2)
    spare = fallback or Fallback(Pyramid([np.zeros((6, 1, 1, 3), dtype=np.float32)]), np.zeros(3))
    table, mean = planar_table(
        material,
        spare.pyramid,
        samples,
        kind,
        threshold,
        anisotropy,
        estimator,
        bias,
        pattern,
    )
    ends = _check.frozen(border_vectors(table).astype(dtype))
    table = table.cast(dtype)
    camera, made = buffer.camera, buffer.pyramid(filter)
    spread = dtype(4.0 * camera.density / spare.pyramid.size**2)
    matrix, planes, shift = (
        _check.frozen(v.astype(dtype))
        for v in (camera.matrix, buffer.planes, camera.position - np.asarray(spare.centre))
    )
    seen = np.flatnonzero(points.coverage)
    vectors = [v.reshape(-1, 3) for v in (points.normal, points.tangent, points.view)]
    position = points.position.reshape(-1, 3)
    out: npt.NDArray[Any] = np.zeros((points.coverage.size, 3), dtype=dtype)
    counted = np.zeros((1 + len(KINDS),), dtype=np.int64)
    for start in range(0, len(seen), CHUNK):
        pick = seen[start : start + CHUNK]
        n, t, v = (_check.frozen(x[pick].astype(dtype)) for x in vectors)
        offset = _check.frozen((position[pick] - camera.position).astype(dtype))
        part = np.empty((len(pick), 3), dtype=dtype)
        tally = np.empty((len(pick), 1 + len(KINDS)), dtype=np.int64)
        in_rows(
            _shade, len(n), n, t, v, offset, table.taps, table.first, ends, table.lobes, table.ks,
            table.r0, mean,
            rule, table.bias, spread, intersections == 2, dtype(math.pi), matrix, planes,
            _check.frozen(made.buffer), _check.frozen(made.chain), fallback is not None, shift,
            *spare.pyramid.kernel_arguments, tally, part, grain=64,
        )  # fmt: skip
        out[pick] = part
        counted += tally.sum(axis=0)
    return out.reshape(*points.shape, 3), MappingCounts.of(counted)


def shade_planar(
    points: SurfacePoints, material: Material | Lobe, buffer: MirrorBuffer, **options: Any
) -> FloatArray:
    """Glossy radiance of a plane reflector, from what its mirror pass has seen.

    Parameters
    ----------
    points : SurfacePoints
        Points of the plane, with positions; ``view`` towards the camera of the mirror pass.
    material : Material, or a Lobe alone
        Reflection lobes; kd is left out.
    buffer : MirrorBuffer
    samples : int
        n of each lobe (default 10).
    kind, threshold, anisotropy
        As for ``planar_pattern``.
    estimator : "auto", "4.23", "4.24", "4.25", "paper", "projected" or "importance"
        Weights of the samples; "auto": the thesis's 4.25, for regular and importance patterns
        their own.
    level : "ellipse", "sample" or "none"
        Level of detail, eqs. (1), (2).
    bias : float [level]
    filter : "box", "gauss4" or "gauss6"
        Of the buffer's pyramid.
    intersections : 2 or 1
        As for ``map_samples``.
    fallback : Fallback, optional
        Where missed samples are read; the buffer's edge without.
    pattern : Pattern or one for each lobe, optional
        Half vectors of your own.
    precision : "single" or "double"

    Returns
    -------
    (..., 3) float32, or float64 in double precision.

    Raises
    ------
    ValueError
        For points without positions, transmission lobes, or a value out of range.
    """
    return shade_counted(points, material, buffer, **options)[0]
