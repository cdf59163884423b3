"""Partial environment maps: a filtered pyramid for each region of an environment.

Every region's map is the cube map with the other regions black, filtered as a whole cube map is.
Filters are linear, so the maps sum to the pyramid of the whole, and a lookup under visibility is ::

    L = sum_i VIS_i PEM_i(r, level),    sum_i PEM_i = pyramid                               (1)

With every VIS_i = 1 one lookup in the whole pyramid serves; the maps are then never made.

Layouts: ``whole`` keeps R complete cube maps, as published. ``cropped`` keeps of each face and
level the smallest rectangle that holds all of the map's light there, what the filters spread over
edges included: the same results to the last bit, since what it leaves out is zero.

All maps lie in one flat buffer of RGBA texels; rectangles are in rows and columns of a face with
its ``seams.PAD`` rings, of which the innermost is kept for the lookup across seams.

Source: Knuth et al., eq. 5 and section 4; the cropped faces stand for their parabolic maps of the
used part (section 5).
"""

import dataclasses
import functools
import warnings

import numpy as np
import numpy.typing as npt

from .. import _check
from .._arguments import checked
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from ..cubemap import CubeMap
from ..pyramid import FILTERS, STORAGES, Pyramid, build_pyramid
from ..sampler import k_face_uv
from ..seams import PAD
from .glossiness import calibrate
from .regions import Regions, regions

LAYOUTS = ("cropped", "whole")
FILTER = "pem5:sqrtcos"  # the authors' choice
TEXEL = 4  # floats

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)


@kernel
def k_visible_rgb(
    x: Scalar,
    y: Scalar,
    z: Scalar,
    level: Scalar,
    visibility: FloatArray,
    buffer: Float32Array,
    boxes: Int64Array,
    sizes: Int64Array,
) -> tuple[Scalar, Scalar, Scalar]:
    """Eq. (1) for one direction of any length, visibility (R,), trilinear.

    ``boxes`` (levels, 6, R, 5): first texel in the buffer, top, bottom, left, right; ``sizes``
    (levels,): texels along a face's edge.
    """
    face, u, v = k_face_uv(x, y, z)
    top = sizes.shape[0] - 1
    clamped = min(max(level, ZERO * u), type(u)(top))
    first = min(np.int64(clamped), top)
    f = clamped - type(u)(first)
    red = green = blue = ZERO * u
    for j in range(2):
        share = ONE - f if j == 0 else f
        if share == ZERO:
            continue
        at = min(first + j, top)
        size = type(u)(sizes[at])
        px, py = u * size - HALF, v * size - HALF
        fx, fy = np.floor(px), np.floor(py)
        a, b = px - fx, py - fy
        row, col = np.int64(fy) + PAD, np.int64(fx) + PAD
        upper, lower = share * (ONE - b), share * b
        weights = (upper * (ONE - a), upper * a, lower * (ONE - a), lower * a)
        for i in range(boxes.shape[2]):
            start, low, high, left, right = boxes[at, face, i]
            seen = visibility[i]
            if row + 1 < low or row >= high or col + 1 < left or col >= right or seen == ZERO:
                continue
            r = g = c = ZERO * u
            for q in range(4):
                line, place = row + q // 2, col + q % 2
                if low <= line < high and left <= place < right:
                    t = (start + (line - low) * (right - left) + place - left) * TEXEL
                    r += buffer[t] * weights[q]
                    g += buffer[t + 1] * weights[q]
                    c += buffer[t + 2] * weights[q]
            red, green, blue = red + seen * r, green + seen * g, blue + seen * c
    return red, green, blue


@row_kernel
def _sample(
    begin: int,
    end: int,
    directions: FloatArray,
    levels: FloatArray,
    visibility: FloatArray,
    buffer: Float32Array,
    boxes: Int64Array,
    sizes: Int64Array,
    out: FloatArray,
) -> None:
    # (K, 3), (K,), (K, R), then PartialMaps.kernel_arguments, (K, 3)
    for k in range(begin, end):
        x, y, z = directions[k, 0], directions[k, 1], directions[k, 2]
        out[k, 0], out[k, 1], out[k, 2] = k_visible_rgb(
            x, y, z, levels[k], visibility[k], buffer, boxes, sizes
        )


def _padded(pyramid: Pyramid) -> list[Float32Array]:
    """Levels (6, n + 2 PAD, n + 2 PAD, TEXEL) of a pyramid of three channels."""
    buffer, chain, stride = pyramid.kernel_arguments
    levels = []
    for offset, n in chain:
        size = int(n) + 2 * PAD
        part = buffer[offset * stride : (offset + 6 * size * size) * stride]
        levels.append(part.reshape(6, size, size, stride))
    return levels


@kernel
def _lit_box(texels: Float32Array, begin: Scalar, end: Scalar) -> tuple[int, int, int, int]:
    """Smallest rectangle (top, bottom, left, right) with all that is not zero in a square."""
    top, bottom, left, right = end, begin, end, begin
    for row in range(begin, end):
        for col in range(begin, end):
            a, b, c, d = texels[row, col]
            if a != ZERO or b != ZERO or c != ZERO or d != ZERO:
                top, bottom = min(top, row), row + 1
                left, right = min(left, col), max(right, col + 1)
    if bottom <= top:
        return begin, begin, begin, begin
    return top, bottom, left, right


def _box(texels: Float32Array, layout: str) -> tuple[int, int, int, int]:
    """Rectangle (top, bottom, left, right) to keep of a padded face (n, n, TEXEL)."""
    begin, end = PAD - 1, len(texels) - PAD + 1
    if layout == "whole":
        return begin, end, begin, end
    return _lit_box(_check.frozen(texels), begin, end)


@dataclasses.dataclass(frozen=True, eq=False)
class PartialMaps:
    """An environment with its regions, their filtered maps, and the pyramid of the whole.

    What is not looked at is not made: regions, maps and pyramid come when they are first needed.
    """

    cube: CubeMap
    count: int
    filter: str
    storage: str
    layout: str

    @functools.cached_property
    def regions(self) -> Regions:
        """The partition; R of them."""
        return regions(self.cube, self.count)

    @functools.cached_property
    def pyramid(self) -> Pyramid:
        """The pyramid of the whole cube map, to which the maps sum."""
        return build_pyramid(self.cube, filter=self.filter, storage=self.storage)

    def region_pyramid(self, index: int) -> Pyramid:
        """One region's map as a pyramid of its own."""
        i = _check.count("index", index, low=0, high=len(self.regions) - 1)
        masked = self.regions.masked(self.cube, i)
        return build_pyramid(masked, filter=self.filter, storage=self.storage)

    @functools.cached_property
    def kernel_arguments(self) -> tuple[Float32Array, Int64Array, Int64Array]:
        """Buffer, boxes and sizes for ``k_visible_rgb``."""
        sizes = self.pyramid.kernel_arguments[1][:, 1]
        boxes = np.zeros((len(sizes), 6, len(self.regions), 5), dtype=np.int64)
        parts: list[Float32Array] = []
        start = 0
        one = self.region_pyramid(0)
        for i in range(len(self.regions)):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # half floats: the whole pyramid has warned
                one.update(self.regions.masked(self.cube, i))
            for level, padded in enumerate(_padded(one)):
                for face in range(6):
                    top, bottom, left, right = _box(padded[face], self.layout)
                    boxes[level, face, i] = start, top, bottom, left, right
                    parts.append(padded[face, top:bottom, left:right].reshape(-1).copy())
                    start += (bottom - top) * (right - left)
        buffer = np.concatenate(parts)
        return _check.frozen(buffer), _check.frozen(boxes), _check.frozen(sizes)

    @property
    def texels(self) -> int:
        """Texels that the regions' maps hold, with the ring that their lookups need."""
        return len(self.kernel_arguments[0]) // TEXEL

    def sample(
        self,
        directions: npt.ArrayLike,
        level: npt.ArrayLike,
        visibility: npt.ArrayLike | None = None,
        precision: str = "single",
    ) -> FloatArray:
        """Eq. (1): radiance (..., 3) along directions (..., 3), trilinear, seamless.

        Parameters
        ----------
        directions : (..., 3) array
            Any finite non-zero vectors.
        level : (...) array
            Broadcast against the directions; clamped to the chain.
        visibility : (..., R) array, optional
            Share of each region that is seen; None for all of all, one lookup in the pyramid.
        precision : "single" or "double"

        Raises
        ------
        ValueError
            For a zero or non-finite direction, a NaN level, or a visibility of a wrong shape or
            not finite.
        """
        if visibility is None:
            return self.pyramid.sample(directions, level, precision=precision)
        dtype = _check.dtype_of(precision)
        d = _check.vectors("directions", directions, dtype)
        lod = _check.array("level", level, dtype)
        if np.any(np.isnan(lod)):
            raise _check.fail("level", "must not be NaN", f"{int(np.isnan(lod).sum())} NaN")
        seen = check_visibility(visibility, len(self.regions), dtype)
        try:
            shape = np.broadcast_shapes(d.shape[:-1], lod.shape, seen.shape[:-1])
        except ValueError:
            shapes = (d.shape, lod.shape, seen.shape)
            raise _check.fail("directions, level, visibility", "must broadcast", shapes) from None
        flat = _check.frozen(np.broadcast_to(d, (*shape, 3)).reshape(-1, 3))
        lod = _check.frozen(np.broadcast_to(lod, shape).reshape(-1))
        seen = _check.frozen(np.broadcast_to(seen, (*shape, seen.shape[-1])).reshape(len(flat), -1))
        out = np.empty((len(flat), 3), dtype=dtype)
        in_rows(_sample, len(flat), flat, lod, seen, *self.kernel_arguments, out, grain=512)
        return out.reshape(*shape, 3)

    def irradiance(
        self, normal: npt.ArrayLike, visibility: npt.ArrayLike | None = None
    ) -> Float64Array:
        """Irradiance (..., 3) on surfaces of ``normal`` (..., 3), the lobe s = 1 of ``glossiness``.

        pi times a lookup at the level of the cosine about the normal: for the diffuse term under
        visibility (..., R). Without anything in the way ``irradiance`` is exact.
        """
        n = _check.unit_vectors("normal", normal)
        level = calibrate(self.filter, self.cube.size).level(1.0)
        return np.pi * self.sample(n, level, visibility, precision="double").astype(np.float64)

    def __repr__(self) -> str:
        return (
            f"PartialMaps(size={self.cube.size}, count={self.count}, filter={self.filter!r}, "
            f"storage={self.storage!r}, layout={self.layout!r})"
        )


def check_visibility(visibility: npt.ArrayLike, count: int, dtype: type = np.float64) -> FloatArray:
    """Visibility (..., R) of ``count`` regions, finite."""
    seen = _check.array("visibility", visibility, dtype)
    if seen.ndim == 0 or seen.shape[-1] != count:
        raise _check.fail("visibility", f"must have shape (..., {count})", seen.shape)
    if not np.all(np.isfinite(seen)):
        raise _check.fail("visibility", "must be finite", "NaN or inf")
    return seen


@checked
def partial_maps(
    cube: CubeMap,
    count: int = 48,
    filter: str = FILTER,
    storage: str = "rgba32f",
    layout: str = "cropped",
) -> PartialMaps:
    """Partial environment maps of a cube map, for the method "pem".

    Parameters
    ----------
    cube : CubeMap
        Its size must be a power of two.
    count : int
        Regions over the cube, a multiple of six; see ``regions``.
    filter : str
        Of the pyramids, as for ``build_pyramid``: meant are "pem5:box", "pem5:gauss", "pem5:cos",
        "pem5:sqrtcos" and, without smoothing, "box".
    storage : "rgba32f" or "rgba16f"
        ``rgba16f`` rounds each level to half floats.
    layout : "cropped" or "whole"
        Rectangles of what is not zero, or complete cube maps, as published; same results.

    Raises
    ------
    ValueError
        For a size that is not a power of two, a count that is not a multiple of six, or an unknown
        filter, storage or layout.
    """
    _check.choice("filter", filter, FILTERS)
    _check.choice("storage", storage, STORAGES)
    _check.choice("layout", layout, LAYOUTS)
    if cube.size & (cube.size - 1):
        raise _check.fail("cube size", "must be a power of two", cube.size)
    whole = _check.count("count", count, low=6, high=6 * cube.size**2)
    if whole % 6:
        raise _check.fail("count", "must be a multiple of six", count)
    return PartialMaps(cube, whole, filter, storage, layout)
