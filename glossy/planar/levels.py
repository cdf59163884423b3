"""Pyramid of a picture: filters without wrap-around, any size, pixels that count nothing.

A level halves the one before along both axes, sizes rounded up, with the binomial kernels of the
cube map's pyramid (box, gauss4, gauss6). A pixel of level l is 2^l pixels of level 0 wide, whatever
the size: the last one of a row may reach over the picture's edge. Beyond the edge kernel and lookup
read the pixel at the edge, so that a constant picture stays constant. With x in pixels of level 0,
pixel i spanning [i, i + 1)::

    p = x / 2^l - 1/2,   bilinear about p,   linear between two levels                     (1)

Each pixel has a weight c, 0 if it holds nothing. c L and c are filtered alike, and a lookup returns
their ratio: what weighs nothing is left out of every mean.

Departure from graphics hardware, which rounds odd sizes down and so stretches the levels by up to
half: here the levels stay in register.
"""

import dataclasses
import itertools

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

FILTERS = ("box", "gauss4", "gauss6")
KERNELS = {
    "box": (1.0 / 2.0,),
    "gauss4": (1.0 / 8.0, 3.0 / 8.0),
    "gauss6": (1.0 / 32.0, 5.0 / 32.0, 10.0 / 32.0),
}
"""Half of each symmetric kernel, outermost first."""

CHANNELS = 4
ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)


@row_kernel
def _halve(
    begin: int, end: int, fine: Float32Array, coarse: Float32Array, weights: Float32Array
) -> None:
    # (h, w, 4), (ceil h/2, ceil w/2, 4), (taps/2,)
    height, width, half = fine.shape[0], fine.shape[1], weights.shape[0]
    for row in range(begin, end):
        column = np.empty((width, CHANNELS), dtype=np.float32)
        for x in range(width):
            for c in range(CHANNELS):
                column[x, c] = ZERO
        for k in range(half):
            above = max(2 * row + 1 - half + k, 0)
            below = min(2 * row + half - k, height - 1)
            for x in range(width):
                for c in range(CHANNELS):
                    column[x, c] += weights[k] * (fine[above, x, c] + fine[below, x, c])
        for x in range(coarse.shape[1]):
            for c in range(CHANNELS):
                total = ZERO
                for k in range(half):
                    left = max(2 * x + 1 - half + k, 0)
                    right = min(2 * x + half - k, width - 1)
                    total += weights[k] * (column[left, c] + column[right, c])
                coarse[row, x, c] = total


@kernel
def k_look_up(
    x: Scalar, y: Scalar, level: Scalar, buffer: Float32Array, chain: Int64Array
) -> tuple[Scalar, Scalar, Scalar]:
    """Eq. (1): radiance at a pixel position; black where nothing around it has a weight.

    ``chain`` (levels, 3): offset in pixels, height, width.
    """
    top = chain.shape[0] - 1
    lod = min(max(level, ZERO * level), type(level)(top))
    first = min(np.int64(lod), top)
    f = lod - type(level)(first)
    r = g = b = a = ZERO * x
    for j in range(2):
        share = ONE - f if j == 0 else f
        if share == ZERO:
            continue
        at = min(first + j, top)
        offset, height, width = chain[at, 0], chain[at, 1], chain[at, 2]
        scale = type(x)(np.int64(1) << at)
        px = min(max(x / scale - HALF, ZERO * x), type(x)(width - 1))
        py = min(max(y / scale - HALF, ZERO * x), type(x)(height - 1))
        column, row = np.int64(px), np.int64(py)
        u, v = px - type(x)(column), py - type(x)(row)
        right, down = min(column + 1, width - 1) - column, min(row + 1, height - 1) - row
        i = (offset + row * width + column) * CHANNELS
        k = i + down * width * CHANNELS
        right *= CHANNELS
        w00, w01 = (ONE - u) * (ONE - v) * share, u * (ONE - v) * share
        w10, w11 = (ONE - u) * v * share, u * v * share
        p, q = i + right, k + right
        r += buffer[i] * w00 + buffer[p] * w01 + buffer[k] * w10 + buffer[q] * w11
        g += buffer[i + 1] * w00 + buffer[p + 1] * w01 + buffer[k + 1] * w10 + buffer[q + 1] * w11
        b += buffer[i + 2] * w00 + buffer[p + 2] * w01 + buffer[k + 2] * w10 + buffer[q + 2] * w11
        a += buffer[i + 3] * w00 + buffer[p + 3] * w01 + buffer[k + 3] * w10 + buffer[q + 3] * w11
    if a <= ZERO:
        return ZERO * x, ZERO * x, ZERO * x
    return r / a, g / a, b / a


@row_kernel
def _sample(
    begin: int,
    end: int,
    x: FloatArray,
    y: FloatArray,
    level: FloatArray,
    buffer: Float32Array,
    chain: Int64Array,
    out: FloatArray,
) -> None:
    for k in range(begin, end):
        out[k, 0], out[k, 1], out[k, 2] = k_look_up(x[k], y[k], level[k], buffer, chain)


@dataclasses.dataclass(frozen=True, eq=False)
class Levels:
    """The levels of a picture in one flat buffer; made by ``build_levels``.

    ``buffer`` (floats,): red, green, blue, each times the weight, and the weight; ``chain``
    (levels, 3): offset in pixels, height, width.
    """

    buffer: Float32Array
    chain: Int64Array
    filter: str

    @property
    def levels(self) -> list[Float32Array]:
        """Levels (h, w, 4), finest first: views of the buffer."""
        views = []
        for offset, height, width in self.chain.tolist():
            part = self.buffer[CHANNELS * offset : CHANNELS * (offset + height * width)]
            views.append(part.reshape(height, width, CHANNELS))
        return views

    def sample(
        self,
        x: npt.ArrayLike,
        y: npt.ArrayLike,
        level: npt.ArrayLike = 0.0,
        precision: str = "single",
    ) -> FloatArray:
        """Radiance (..., 3) at pixel positions, eq. (1); all three arguments broadcast.

        Raises
        ------
        ValueError
            For a position or level that is NaN.
        """
        dtype = _check.dtype_of(precision)
        named = {"x": x, "y": y, "level": level}
        arrays = [_check.array(name, value, dtype) for name, value in named.items()]
        for name, value in zip(named, arrays, strict=True):
            if np.any(np.isnan(value)):
                raise _check.fail(name, "must not be NaN", f"{int(np.isnan(value).sum())} NaN")
        arrays = list(np.broadcast_arrays(*arrays))
        px, py, lod = (_check.frozen(a.reshape(-1)) for a in arrays)
        out = np.empty((px.size, 3), dtype=dtype)
        in_rows(
            _sample,
            len(px),
            px,
            py,
            lod,
            _check.frozen(self.buffer),
            _check.frozen(self.chain),
            out,
            grain=512,
        )
        return out.reshape(*arrays[0].shape, 3)


def build_levels(
    radiance: npt.ArrayLike, weights: npt.ArrayLike | None = None, filter: str = "box"
) -> Levels:
    """The pyramid of a picture, down to one pixel.

    Parameters
    ----------
    radiance : (H, W, 3) array
    weights : (H, W) array >= 0, optional
        How much each pixel counts; all alike by default.
    filter : "box", "gauss4" or "gauss6"

    Raises
    ------
    ValueError
        For a wrong shape, radiance that is not finite, a negative weight, or an unknown filter.
    """
    rgb = _check.array("radiance", radiance, np.float32)
    if rgb.ndim != 3 or rgb.shape[-1] != 3 or rgb.size == 0:
        raise _check.fail("radiance", "must have shape (H, W, 3)", rgb.shape)
    if not np.all(np.isfinite(rgb)):
        raise _check.fail("radiance", "must be finite", "NaN or inf")
    given = np.ones(rgb.shape[:2]) if weights is None else weights
    share = _check.array("weights", given, np.float32)
    if share.shape != rgb.shape[:2]:
        raise _check.fail("weights", f"must have shape {rgb.shape[:2]}", share.shape)
    if not np.all((share >= 0.0) & np.isfinite(share)):
        raise _check.fail("weights", "must be finite and not negative", float(share.min()))
    _check.choice("filter", filter, FILTERS)
    sizes = [rgb.shape[:2]]
    while max(sizes[-1]) > 1:
        sizes.append((-(-sizes[-1][0] // 2), -(-sizes[-1][1] // 2)))
    counts = np.cumsum([0] + [h * w for h, w in sizes])
    chain = np.array([(o, *s) for o, s in zip(counts[:-1], sizes, strict=True)], dtype=np.int64)
    made = Levels(np.empty(CHANNELS * int(counts[-1]), dtype=np.float32), chain, filter)
    levels = made.levels
    levels[0][..., :3] = share[..., None] * rgb
    levels[0][..., 3] = share
    taps = _check.frozen(np.array(KERNELS[filter], dtype=np.float32))
    for fine, coarse in itertools.pairwise(levels):
        in_rows(_halve, len(coarse), _check.frozen(fine), coarse, taps)
    return made
