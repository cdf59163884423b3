"""MIP pyramid of a cube map: filters, storage, and the levels' lookup.

Each level halves the one above with a separable kernel (method of the regular sampling paper,
Table 1; the binomial weights are our reading of "Gauss 4 x 4" and "6 x 6")::

    box     [1 1]/2
    gauss4  [1 3 3 1]/8
    gauss6  [1 5 10 10 5 1]/32
    round   8 x 8 weights of its own for every texel: taps round on the sphere (``round_weights``)
    pem5:*  [1 1]/2, then five taps at the new level (``pem_filter``)

How wide a tap is, and which level has a given width: ``taps``.

Kernels reach across face edges into the neighbour face (``seams``); the lookup is ``sampler``.

All levels lie in one flat buffer, smallest first, every face with ``seams.PAD`` rings around it
and channels padded to a multiple of four: one kernel per precision serves every size, no lookup
branches at a seam, and two neighbouring RGBA texels are one wide load.
"""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check
from ._arguments import checked
from ._jit import Scalar, kernel, row_kernel
from ._rows import LANES, LINE, OUTPUT_ROWS, halve_rows, quarter_rgb
from ._threads import in_rows
from .cubemap import MAX_SIZE, CubeMap
from .pem_filter import PEM_TAPS, smooth
from .round_filter import reduce_round
from .sampler import sample_chain
from .seams import PAD, fold_table, k_fill_seams

FILTERS = ("box", "gauss4", "gauss6", "round", *PEM_TAPS)
STORAGES = ("rgba32f", "rgba16f")
HALF_MAX = 65504.0
LEVEL_ROUNDINGS = ("even", "opengl")

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

TEXEL = 4  # floats: RGB and a fourth
SERIAL = 64  # levels up to this size are not worth waking other threads for
ZERO = np.float32(0.0)
FLOAT_MAX = np.finfo(np.float32).max
HEADROOM = np.float32(2.0**-16)  # more than the sum of any filter's weights before they are scaled
THREE, FIVE, TEN = np.float32(3.0), np.float32(5.0), np.float32(10.0)
HALF, QUARTER = np.float32(0.5), np.float32(0.25)
EIGHTH, INV32 = np.float32(0.125), np.float32(1.0 / 32.0)


# --- building -------------------------------------------------------------------------------------


@row_kernel
def _store_rgb(begin: int, end: int, faces: Float32Array, level: Float32Array) -> None:
    n = faces.shape[1]
    for i in range(begin, end):
        face, row = i // n, i % n
        for col in range(n):
            level[face, row + PAD, col + PAD, 0] = faces[face, row, col, 0]
            level[face, row + PAD, col + PAD, 1] = faces[face, row, col, 1]
            level[face, row + PAD, col + PAD, 2] = faces[face, row, col, 2]
            level[face, row + PAD, col + PAD, 3] = ZERO


@kernel
def _halve_small(fine: Float32Array, coarse: Float32Array, weights: Any, face: Scalar) -> None:
    """One face of a level of a few texels, term by term in the order of ``halve_rows``."""
    half, n = len(weights), coarse.shape[1] - 2 * PAD
    for row in range(n):
        for col in range(n):
            top, left = 2 * row + PAD + 1 - half, 2 * col + PAD + 1 - half
            for c in range(TEXEL):
                total = ZERO
                for k in range(half):
                    pair = ZERO
                    for x in (left + k, left + 2 * half - 1 - k):
                        down = ZERO
                        for m in range(half):
                            ends = (
                                fine[face, top + m, x, c] + fine[face, top + 2 * half - 1 - m, x, c]
                            )
                            down += weights[m] * ends
                        pair += down
                    total += weights[k] * pair
                coarse[face, row + PAD, col + PAD, c] = total


@kernel
def _halve_block(fine: Float32Array, coarse: Float32Array, weights: Any, block: Scalar) -> None:
    """The ``block``-th group of ``OUTPUT_ROWS`` rows of a level, counted through the faces."""
    n, width, across = coarse.shape[1] - 2 * PAD, fine.shape[1] * TEXEL, coarse.shape[1] * TEXEL
    face, row = OUTPUT_ROWS * block // n, OUTPUT_ROWS * block % n
    top = face * fine.shape[1] + 2 * row + PAD + 1 - len(weights)
    begin = (face * coarse.shape[1] + row + PAD) * across + PAD * TEXEL
    source, target = fine.reshape(-1), coarse.reshape(-1)
    start = top * width + PAD * TEXEL
    halve_rows(source, start, width, weights, target, begin, across, n // 4)


@kernel
def k_level(buffer: Float32Array, chain: Int64Array, level: Scalar) -> Float32Array:
    """A level of the flat buffer, (6, n + 2 PAD, n + 2 PAD, TEXEL)."""
    size = chain[level, 1] + 2 * PAD
    start = chain[level, 0] * TEXEL
    return buffer[start : start + 6 * size * size * TEXEL].reshape((6, size, size, TEXEL))


@row_kernel
def _halve(
    begin: int, end: int, buffer: Float32Array, chain: Int64Array, weights: Any, level: int
) -> None:
    """Groups of rows of a level, from the one before."""
    fine, coarse = k_level(buffer, chain, level - 1), k_level(buffer, chain, level)
    for i in range(begin, end):
        _halve_block(fine, coarse, weights, i)


@kernel
def _reduce_small(
    buffer: Float32Array, chain: Int64Array, weights: Any, table: Int64Array, first: int, last: int
) -> None:
    """Levels ``first`` to ``last``, each from the one before, with their rings."""
    for level in range(first, last + 1):
        fine, coarse = k_level(buffer, chain, level - 1), k_level(buffer, chain, level)
        n = coarse.shape[1] - 2 * PAD
        if n < OUTPUT_ROWS:
            for face in range(6):
                _halve_small(fine, coarse, weights, face)
        else:
            for i in range(6 * n // OUTPUT_ROWS):
                _halve_block(fine, coarse, weights, i)
        k_fill_seams(coarse, table)


def _reduce(
    buffer: Float32Array, chain: Int64Array, weights: Any, table: Int64Array, first: int, last: int
) -> None:
    """Levels ``first`` to ``last``, each from the one before: large ones on all threads."""
    sizes = chain[:, 1].tolist()
    while first <= last and sizes[first] > SERIAL:
        in_rows(_halve, 6 * sizes[first] // OUTPUT_ROWS, buffer, chain, weights, first, grain=4)
        k_fill_seams(k_level(buffer, chain, first), table)
        first += 1
    if first <= last:
        _reduce_small(buffer, chain, weights, table, first, last)


@row_kernel
def _quarter(
    begin: int, end: int, faces: Float32Array, buffer: Float32Array, chain: Int64Array
) -> None:
    """Levels 1 and 2 of the box filter, from the packed faces, without their rings."""
    size = faces.shape[1]
    one, two, n = k_level(buffer, chain, 1), k_level(buffer, chain, 2), size // 4
    source, width = faces.reshape(-1), 3 * size
    for i in range(begin, end):
        face, row = i // n, i % n
        across, start = one.shape[1] * TEXEL, (face * size + 4 * row) * width
        target = ((face * one.shape[1] + 2 * row + PAD) * one.shape[1] + PAD) * TEXEL
        second = ((face * two.shape[1] + row + PAD) * two.shape[1] + PAD) * TEXEL
        target, second = target + chain[1, 0] * TEXEL, second + chain[2, 0] * TEXEL
        quarter_rgb(source, start, width, QUARTER, buffer, target, across, second, size // 16)


WEIGHTS = {
    "box": (HALF,),
    "gauss4": (EIGHTH, THREE * EIGHTH),
    "gauss6": (INV32, FIVE * INV32, TEN * INV32),
}
"""Of one axis, outermost first."""


def _round_to_half(level: Float32Array) -> int:
    """Round a level to half floats in place; return how many values were out of range."""
    over = int(np.count_nonzero(np.abs(level) > HALF_MAX))
    np.clip(level, -HALF_MAX, HALF_MAX, out=level)
    level[...] = level.astype(np.float16)
    return over


def _aligned(count: int) -> Float32Array:
    """Numbers that start a cache line: rows of RGBA texels then do, too, from level size 4 on.

    A vector more is allocated at the end, which the filters' wide loads may touch.
    """
    raw = np.empty(count + 2 * LANES, dtype=np.float32)
    start = -raw.ctypes.data % LINE // raw.itemsize
    return raw[start : start + count]


class Pyramid:
    """A chain of cube-map levels with the GPU's lookup.

    Parameters
    ----------
    levels : sequence of (6, n, n, C) arrays
        Level 0 first; each is half the size of the one before, rounded down, at least 1. The chain
        may end before size 1. Any channel count.
    storage : "rgba32f" or "rgba16f"
        ``rgba16f`` rounds every level to half floats; values beyond 65504 are clamped with a
        warning.

    Raises
    ------
    ValueError
        For a wrong shape or size, or NaN or infinite texels.
    """

    @checked
    def __init__(self, levels: Sequence[npt.ArrayLike], storage: str = "rgba32f") -> None:
        _check.choice("storage", storage, STORAGES)
        arrays = [_check.array(f"levels[{i}]", level, np.float32) for i, level in enumerate(levels)]
        if not arrays:
            raise _check.fail("levels", "must hold at least one level", [])
        shape = arrays[0].shape
        for i, a in enumerate(arrays):
            n = max(1, shape[1] >> i) if len(shape) == 4 else 0
            if len(shape) != 4 or a.shape != (6, n, n, shape[3]) or shape[3] < 1:
                rule = f"must have shape (6, {n}, {n}, C)" if n else "must have shape (6, N, N, C)"
                raise _check.fail(f"levels[{i}]", rule, a.shape)
            if not np.all(np.isfinite(a)):
                raise _check.fail(f"levels[{i}]", "must be finite", "NaN or inf")
        self._allocate(shape[1], shape[3], len(arrays), storage, None)
        over = 0
        for level, a in zip(self._padded, arrays, strict=True):
            level[...] = 0.0
            level[:, PAD:-PAD, PAD:-PAD, : self.channels] = a
            if storage == "rgba16f":
                over += _round_to_half(level[:, PAD:-PAD, PAD:-PAD])
            k_fill_seams(level, fold_table())
        self._warn_clamped(over)

    def _allocate(
        self, size: int, channels: int, count: int, storage: str, filter: str | None
    ) -> None:
        _check.count("size", size, high=MAX_SIZE)
        sizes = [max(1, size >> level) for level in range(count)]
        widths = [6 * (n + 2 * PAD) ** 2 for n in sizes]
        offsets = np.concatenate([[0], np.cumsum(widths[::-1])])[:-1][::-1]
        self.size, self.channels, self.storage, self.filter = size, channels, storage, filter
        self._stride = -4 * (-channels // 4)
        self._buffer = _aligned(sum(widths) * self._stride)
        self._chain = np.asarray(_check.frozen(np.stack([offsets, sizes], axis=1).astype(np.int64)))
        self._padded = []
        for offset, width, n in zip(offsets, widths, sizes, strict=True):
            part = self._buffer[offset * self._stride : (offset + width) * self._stride]
            self._padded.append(part.reshape(6, n + 2 * PAD, n + 2 * PAD, self._stride))

    def update(self, cube: CubeMap) -> None:
        """Make every level anew from another cube map of the same size, in place.

        For renderers that capture their surroundings again and again: no level is allocated. Views
        from ``levels`` show the new texels.

        Raises
        ------
        ValueError
            For another size, or if the pyramid was not made by ``build_pyramid``.
        """
        if self.filter is None:
            raise _check.fail("pyramid", "must come from build_pyramid", self)
        if cube.size != self.size:
            raise _check.fail("cube size", f"must be {self.size}", cube.size)
        self._warn_clamped(self._fill(cube.faces))

    def _fill(self, faces: Float32Array) -> int:
        """Every level from the faces of the first; returns how many values were clamped."""
        over = self._store_base(faces)
        if self.storage == "rgba32f":
            self._reduce(faces)
            if not self._is_finite():
                self._reduce_scaled(faces)
        else:
            for i in range(1, len(self._padded)):
                self._make_levels(i, i)
                over += self._to_half(i)
        return over

    def _store_base(self, faces: Float32Array) -> int:
        in_rows(_store_rgb, 6 * faces.shape[1], faces, self._padded[0], grain=64)
        if self.storage == "rgba16f":
            return self._to_half(0)
        k_fill_seams(self._padded[0], fold_table())
        return 0

    def _to_half(self, level: int) -> int:
        texels = self._padded[level]
        over = _round_to_half(texels[:, PAD:-PAD, PAD:-PAD])
        k_fill_seams(texels, fold_table())
        return over

    def _reduce(self, faces: Float32Array) -> None:
        """Levels from 1 on; ``faces`` are what the first level was filled from."""
        buffer, first = self._buffer, 1
        if self.filter == "box" and self.size >= LANES and buffer.ctypes.data % LINE == 0:
            in_rows(_quarter, 6 * (self.size // 4), faces, buffer, self._chain, grain=4)
            for level in (1, 2):
                k_fill_seams(k_level(buffer, self._chain, level), fold_table())
            first = 3
        self._make_levels(first, len(self._padded) - 1)

    def _is_finite(self) -> bool:
        """Whether no sum of texels passed the end of float32: infinity reaches the last level.

        The mean of three texels beyond a cube corner may stay in its level.
        """
        rings = [*range(PAD), *range(-PAD, 0)]
        beyond = [level[:, rings][:, :, rings] for level in self._padded]
        return all(bool(np.isfinite(part).all()) for part in (self.levels[-1], *beyond))

    def _reduce_scaled(self, faces: Float32Array) -> None:
        """As ``_reduce`` for texels near the end of float32, scaled down and up again."""
        small = _check.frozen(faces * HEADROOM)
        self._store_base(small)
        self._reduce(small)
        most = FLOAT_MAX * HEADROOM
        for level in self._padded:
            np.clip(level, -most, most, out=level)  # a mean may round up
            level /= HEADROOM
        in_rows(_store_rgb, 6 * faces.shape[1], faces, self._padded[0], grain=64)

    def _make_levels(self, first: int, last: int) -> None:
        """Levels ``first`` to ``last``, each from the one before."""
        filter, table = str(self.filter), fold_table()
        if filter in WEIGHTS:
            _reduce(self._buffer, self._chain, WEIGHTS[filter], table, first, last)
            return
        for i in range(first, last + 1):
            if filter == "round":
                reduce_round(self._padded[i - 1], self._padded[i], table, deltas=i == 1)
            else:
                _reduce(self._buffer, self._chain, WEIGHTS["box"], table, i, i)
                smooth(self._padded[i], filter, table)

    @staticmethod
    def _warn_clamped(over: int) -> None:
        if over:
            warnings.warn(
                f"rgba16f: {over} values beyond {HALF_MAX:g} clamped (half float)", stacklevel=3
            )

    @property
    def levels(self) -> list[Float32Array]:
        """Levels (6, n, n, C), finest first: read-only views into the buffer."""
        inner = slice(PAD, -PAD)
        views = [level[:, inner, inner, : self.channels] for level in self._padded]
        for view in views:
            view.flags.writeable = False
        return views

    @property
    def kernel_arguments(self) -> tuple[Float32Array, Int64Array, int]:
        """Flat buffer, chain (levels, 2) of texel offset and size, and stride, for kernels."""
        return _check.frozen(self._buffer), self._chain, self._stride

    def sample(
        self,
        directions: npt.ArrayLike,
        level: npt.ArrayLike,
        filter: str = "linear",
        mip: str = "linear",
        seamless: bool = True,
        level_rounding: str = "even",
        subtexel_bits: int | None = None,
        precision: str = "single",
    ) -> FloatArray:
        """What the GPU's sampler returns: eqs. (1), (2) of ``sampler``.

        Parameters
        ----------
        directions : (..., 3) array
            Any finite non-zero vectors; broadcast against ``level``.
        level : (...) array
            Level of detail; clamped to the chain, +-inf too.
        filter, mip : "linear" or "nearest"
            Within a level, and between levels.
        seamless : bool
            False clamps to the face instead of reading the neighbour.
        level_rounding : "even" or "opengl"
            Where ``mip="nearest"`` sends exactly x.5: to the even level, or down, as the OpenGL
            and Vulkan texts have it.
        subtexel_bits : int, optional
            Round texel coordinates and the level's fraction to this many fractional bits, as
            hardware does (8 in Direct3D).
        precision : "single" or "double"
            Arithmetic of the lookup.

        Returns
        -------
        (..., C) float32, or float64 in double precision.

        Raises
        ------
        ValueError
            For a zero or non-finite direction, a NaN level, or an unknown option.
        """
        dtype = _check.dtype_of(precision)
        linear = _check.choice("filter", filter, ("linear", "nearest")) == "linear"
        mip_linear = _check.choice("mip", mip, ("linear", "nearest")) == "linear"
        even = _check.choice("level_rounding", level_rounding, LEVEL_ROUNDINGS) == "even"
        d = _check.vectors("directions", directions, dtype)
        lod = _check.array("level", level, dtype)
        if np.any(np.isnan(lod)):
            raise _check.fail("level", "must not be NaN", f"{int(np.isnan(lod).sum())} NaN")
        try:
            shape = np.broadcast_shapes(d.shape[:-1], lod.shape)
        except ValueError:
            raise _check.fail("directions, level", "must broadcast", (d.shape, lod.shape)) from None
        d = _check.frozen(np.broadcast_to(d, (*shape, 3)).reshape(-1, 3))
        lod = _check.frozen(np.broadcast_to(lod, shape).reshape(-1))
        out = np.empty((d.shape[0], self.channels), dtype=dtype)
        steps = dtype(subtexel_steps(subtexel_bits))
        buffer, chain, stride = self.kernel_arguments
        in_rows(
            sample_chain,
            len(d),
            d,
            lod,
            buffer,
            chain,
            stride,
            steps,
            linear,
            mip_linear,
            bool(seamless),
            even,
            out,
            grain=512,
        )
        return out.reshape(*shape, self.channels)

    def __repr__(self) -> str:
        return (
            f"Pyramid(size={self.size}, levels={len(self._padded)}, filter={self.filter!r}, "
            f"storage={self.storage!r})"
        )


def subtexel_steps(bits: int | None) -> float:
    """Steps per texel of a fixed-point sampler; 0 for exact fractions."""
    return 0.0 if bits is None else float(1 << _check.count("subtexel_bits", bits, high=20))


@checked
def build_pyramid(cube: CubeMap, filter: str = "gauss6", storage: str = "rgba32f") -> Pyramid:
    """MIP pyramid of a cube map down to size 1.

    Parameters
    ----------
    cube : CubeMap
        Its size must be a power of two.
    filter : "box", "gauss4", "gauss6", "round", or "pem5:" and box, gauss, cos or sqrtcos
        Kernel per axis before decimation by two; "round" weighs each texel's neighbourhood by
        itself, "pem5:..." smooths after it.
    storage : "rgba32f" or "rgba16f"
        ``rgba16f`` rounds each level to half floats before the next is made from it, as a renderer
        that draws into a half-float texture does.

    Raises
    ------
    ValueError
        For an unknown filter or storage, or a size that is not a power of two.
    """
    _check.choice("filter", filter, FILTERS)
    _check.choice("storage", storage, STORAGES)
    size = cube.size
    if size & (size - 1):
        raise _check.fail("cube size", "must be a power of two", size)
    pyramid = Pyramid.__new__(Pyramid)
    pyramid._allocate(size, 3, size.bit_length(), storage, filter)
    pyramid._warn_clamped(pyramid._fill(cube.faces))
    return pyramid
