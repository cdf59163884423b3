"""The pixel loop with bounding planes: every sample's direction is corrected before its lookup.

With o = x - c, inverse plane distances 1/((p - x).n) of the point and unit w (``planes``, eqs. 1 to
3), the corrected direction w' = w + q o sees, from the centre, the solid angle ::

    dw'/dw = |1 + o.g + (o.w)(q - w.g)| / |w'|^3,   g = dq/dw                               (1)

which for a single plane is |1 + q_w o.n| / |w'|^3. A sample of ``shading.k_tap`` covers texels in
proportion to d^e, d = |w| / |w|_inf (e = 1 for the paper's footprint, else 3). Corrected::

    texels' = texels (d'/d)^e              "thesis": the object is small                    (2)
    texels' = texels (d'/d)^e dw'/dw       "projected"                                      (3)

(2) is what the thesis describes: the sample's solid angle as it leaves the surface, the cube as it
is met along w'. Nothing here runs unless planes are given. The loop here is that of the methods
with a table of samples; others have theirs where ``methods.PLANES`` says.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check, methods
from ._jit import Scalar, kernel, row_kernel
from ._threads import in_rows
from .brdf import Material
from .footprint import JACOBIAN, PAPER, k_lobe_area
from .frames import SurfacePoints
from .planes import BoundingPlanes
from .pyramid import Pyramid
from .sampler import k_trilinear_rgb
from .shading import chunks, k_frame, k_fresnel, k_tap
from .thesis import MeanTable, k_share
from .thesis_tiles import BY_BRDF_COS
from .trace import SUM, TABLES

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

LARGEST = 1e12  # inverse distance of points in a plane: squares and cubes stay float32

ZERO, HALF, ONE, TWO, FOUR = (np.float32(v) for v in (0.0, 0.5, 1.0, 2.0, 4.0))


@kernel
def k_redirect(
    w: tuple[Scalar, Scalar, Scalar],
    offset: FloatArray,
    inverse: FloatArray,
    normals: FloatArray,
    width: Scalar,
) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Corrected direction of unit ``w``, not normalised, and |w'|^3 dw'/dw of eq. (1).

    ``offset`` (3,): x - c; ``inverse`` (M,): 1 / ((p - x).n); ``normals`` (M, 3); ``width`` as
    ``BoundingPlanes.width``.
    """
    q = gx = gy = gz = ZERO * w[0]
    for i in range(inverse.shape[0]):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        own = (w[0] * nx + w[1] * ny + w[2] * nz) * inverse[i]
        near = width - abs(own - q)
        share = ONE if own > q else ZERO
        largest = own if own > q else q
        if near > ZERO:
            largest += near * near / (FOUR * width)
            share += (near if own <= q else -near) / (TWO * width)
        scale = share * inverse[i]
        gx, gy, gz = (
            gx * (ONE - share) + scale * nx,
            gy * (ONE - share) + scale * ny,
            gz * (ONE - share) + scale * nz,
        )
        q = largest
    ox, oy, oz = offset[0], offset[1], offset[2]
    along = w[0] * ox + w[1] * oy + w[2] * oz
    det = ONE + ox * gx + oy * gy + oz * gz
    det += along * (q - (w[0] * gx + w[1] * gy + w[2] * gz))
    return w[0] + q * ox, w[1] + q * oy, w[2] + q * oz, abs(det)


@kernel
def k_texels_change(
    w: tuple[Scalar, Scalar, Scalar],
    v: tuple[Scalar, Scalar, Scalar],
    det: Scalar,
    cubed: bool,
    projected: bool,
) -> Scalar:
    """Texels covered along ``v`` over those along unit ``w``, eq. (2) or (3)."""
    before = max(abs(w[0]), abs(w[1]), abs(w[2]))  # 1 / d
    length = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    after = max(abs(v[0]), abs(v[1]), abs(v[2])) / length
    ratio = before / after
    if cubed:
        ratio = ratio * ratio * ratio
    if projected:
        ratio = ratio * det / (length * length * length)
    return ratio


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
    # as shading._shade and thesis._shade_mean; offset (P, 3), inverse (P, M), normals (M, 3)
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
                w = (x, y, z)
                vx, vy, vz, det = k_redirect(w, offset[p], inverse[p], normals, width)
                ratio = k_texels_change(w, (vx, vy, vz), det, footprint != PAPER, projected)
                level += HALF * np.log2(ratio)
                r, g, b = k_trilinear_rgb(vx, vy, vz, level, buffer, chain, stride, steps)
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


def inverse_distances(
    position: npt.NDArray[np.float64], planes: BoundingPlanes
) -> npt.NDArray[np.float64]:
    """1 / ((p - x).n) for positions (K, 3): (K, M); 0, never met, for a plane through the point."""
    to_plane = np.sum((planes.points - position[:, None]) * planes.normals, axis=-1)
    with np.errstate(over="ignore"):
        q = np.divide(1.0, to_plane, out=np.zeros_like(to_plane), where=to_plane != 0.0)
    return np.asarray(np.clip(q, -LARGEST, LARGEST))


def plane_chunks(
    points: SurfacePoints, planes: BoundingPlanes, dtype: type
) -> Iterator[tuple[Int64Array, tuple[FloatArray, ...]]]:
    """Some of the points at a time: normal, tangent, view, x - c (K, 3), and (K, M) distances."""
    assert points.position is not None
    position = points.position.reshape(-1, 3)
    for pick, frames in chunks(points, np.flatnonzero(points.coverage), dtype):
        offset = _check.frozen((position[pick] - planes.centre).astype(dtype))
        inverse = _check.frozen(inverse_distances(position[pick], planes).astype(dtype))
        yield pick, (*frames, offset, inverse)


def shade_planes(
    points: SurfacePoints,
    material: Material,
    prepared: Any,
    method: str,
    planes: object,
    precision: str,
    options: Mapping[str, Any],
) -> FloatArray:
    """Glossy radiance (..., 3) of a method of ``methods.PLANES``, with corrected lookups.

    Raises
    ------
    ValueError
        For another method, points without positions, or a value out of range.
    """
    if method not in methods.PLANES:
        rule = f"is for the methods {', '.join(methods.PLANES)}"
        raise _check.fail("parallax", rule, method)
    if not isinstance(planes, BoundingPlanes):
        raise _check.fail("parallax", "must be BoundingPlanes", type(planes).__name__)
    if points.position is None:
        raise _check.fail("points", "must have positions for parallax", None)
    methods.check_options(method, options)
    _check.dtype_of(precision)
    own = {name: value for name, value in options.items() if name != "kernel"}
    run = methods.with_planes(method)
    out: FloatArray = run(points, material, prepared, method, planes, precision, own)
    return out


def shade_table(
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    method: str,
    planes: BoundingPlanes,
    precision: str,
    options: Mapping[str, Any],
) -> FloatArray:
    """``shade_planes`` of a method that samples by a table."""
    if not isinstance(pyramid, Pyramid) or pyramid.channels != 3:
        raise _check.fail("pyramid", "must be a Pyramid of three channels", pyramid)
    dtype = _check.dtype_of(precision)
    table = TABLES[method](material, pyramid, **options).cast(dtype)
    estimator = table.estimator if isinstance(table, MeanTable) else SUM
    normals = _check.frozen(planes.normals.astype(dtype))
    out: npt.NDArray[Any] = np.zeros((points.coverage.size, 3), dtype=dtype)
    for pick, (n, t, v, offset, inverse) in plane_chunks(points, planes, dtype):
        part = np.empty((len(pick), 3), dtype=dtype)
        in_rows(_shade_planes, len(n), n, t, v, offset, inverse, normals, dtype(planes.width),
            planes.footprint == "projected", table.taps, table.first, table.borders, table.lobes,
            table.ks, table.r0, table.footprint, estimator, table.bias, table.steps,
            dtype(math.pi), *pyramid.kernel_arguments, part, grain=64,
        )  # fmt: skip
        out[pick] = part
    return out.reshape(*points.shape, 3)
