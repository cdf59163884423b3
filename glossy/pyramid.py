"""MIP pyramid of a cube map: filters, storage, and the levels' lookup.

Each level halves the one above with a separable kernel (method of the regular sampling paper,
Table 1; the binomial weights are our reading of "Gauss 4 x 4" and "6 x 6")::

    box     [1 1]/2
    gauss4  [1 3 3 1]/8
    gauss6  [1 5 10 10 5 1]/32

Kernels reach across face edges into the neighbour face (``seams``); the lookup is ``sampler``.

All levels lie in one flat buffer, smallest first, every face with ``seams.PAD`` rings around it
and channels padded to a multiple of four: one kernel per precision serves every size, no lookup
branches at a seam, and two neighbouring RGBA texels are one wide load.
"""

import warnings
from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from . import _check
from ._jit import Scalar, kernel, parallel_kernel
from ._lanes import filter_row4, filter_row16
from .cubemap import MAX_SIZE, CubeMap
from .sampler import sample_chain
from .seams import PAD, fold_table, k_fill_seams

FILTERS = ("box", "gauss4", "gauss6")
STORAGES = ("rgba32f", "rgba16f")
HALF_MAX = 65504.0
LEVEL_ROUNDINGS = ("even", "opengl")

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Int64Array = npt.NDArray[np.int64]

TEXEL = 4  # floats: RGB and a fourth
ZERO = np.float32(0.0)
THREE, FIVE, TEN = np.float32(3.0), np.float32(5.0), np.float32(10.0)
QUARTER, EIGHTH, INV32 = np.float32(0.25), np.float32(0.125), np.float32(1.0 / 32.0)


# --- building -------------------------------------------------------------------------------------


@parallel_kernel
def _store_rgb(faces: Float32Array, level: Float32Array) -> None:
    n = faces.shape[1]
    for i in numba.prange(6 * n):
        face, row = i // n, i % n
        for col in range(n):
            level[face, row + PAD, col + PAD, 0] = faces[face, row, col, 0]
            level[face, row + PAD, col + PAD, 1] = faces[face, row, col, 1]
            level[face, row + PAD, col + PAD, 2] = faces[face, row, col, 2]
            level[face, row + PAD, col + PAD, 3] = ZERO


@kernel
def _filter_rows(
    fine: Float32Array, start: Scalar, pairs: Any, weights: Any, line: Float32Array
) -> None:
    """The vertical pass of one output row: whole input rows into ``line``."""
    if line.size % 16 == 0:
        filter_row16(fine, start, np.int64(16), pairs, weights, line, np.int64(0), line.size // 16)
    else:
        filter_row4(fine, start, np.int64(4), pairs, weights, line, np.int64(0), line.size // 4)


@parallel_kernel
def _reduce_box(fine: Float32Array, coarse: Float32Array) -> None:
    n, width = coarse.shape[1] - 2 * PAD, fine.shape[2] * TEXEL
    source, target = fine.reshape(-1), coarse.reshape(-1)
    pairs = (np.int64(0), np.int64(TEXEL), width, width + TEXEL)
    for i in numba.prange(6 * n):
        face, row = i // n, i % n
        start = ((face * fine.shape[1]) + 2 * row + PAD) * width + PAD * TEXEL
        begin = ((face * coarse.shape[1] + row + PAD) * coarse.shape[2] + PAD) * TEXEL
        step = np.int64(2 * TEXEL)
        filter_row4(source, start, step, pairs, (QUARTER, QUARTER), target, begin, n)


@parallel_kernel
def _reduce_gauss4(fine: Float32Array, coarse: Float32Array) -> None:
    n, width = coarse.shape[1] - 2 * PAD, fine.shape[2] * TEXEL
    source, target = fine.reshape(-1), coarse.reshape(-1)
    weights = (EIGHTH, THREE * EIGHTH)
    down = (np.int64(0), 3 * width, width, 2 * width)
    across = (np.int64(0), np.int64(3 * TEXEL), np.int64(TEXEL), np.int64(2 * TEXEL))
    for i in numba.prange(6 * n):
        face, row = i // n, i % n
        line = np.empty(width, dtype=np.float32)
        top = ((face * fine.shape[1]) + 2 * row + PAD - 1) * width
        _filter_rows(source, top, down, weights, line)
        begin = ((face * coarse.shape[1] + row + PAD) * coarse.shape[2] + PAD) * TEXEL
        start, step = np.int64((PAD - 1) * TEXEL), np.int64(2 * TEXEL)
        filter_row4(line, start, step, across, weights, target, begin, n)


@parallel_kernel
def _reduce_gauss6(fine: Float32Array, coarse: Float32Array) -> None:
    n, width = coarse.shape[1] - 2 * PAD, fine.shape[2] * TEXEL
    source, target = fine.reshape(-1), coarse.reshape(-1)
    weights = (INV32, FIVE * INV32, TEN * INV32)
    down = (np.int64(0), 5 * width, width, 4 * width, 2 * width, 3 * width)
    across = (
        np.int64(0), np.int64(5 * TEXEL), np.int64(TEXEL),
        np.int64(4 * TEXEL), np.int64(2 * TEXEL), np.int64(3 * TEXEL),
    )  # fmt: skip
    for i in numba.prange(6 * n):
        face, row = i // n, i % n
        line = np.empty(width, dtype=np.float32)
        top = ((face * fine.shape[1]) + 2 * row + PAD - 2) * width
        _filter_rows(source, top, down, weights, line)
        begin = ((face * coarse.shape[1] + row + PAD) * coarse.shape[2] + PAD) * TEXEL
        start, step = np.int64((PAD - 2) * TEXEL), np.int64(2 * TEXEL)
        filter_row4(line, start, step, across, weights, target, begin, n)


_REDUCE = {"box": _reduce_box, "gauss4": _reduce_gauss4, "gauss6": _reduce_gauss6}


def _round_to_half(level: Float32Array) -> int:
    """Round a level to half floats in place; return how many values were out of range."""
    over = int(np.count_nonzero(np.abs(level) > HALF_MAX))
    np.clip(level, -HALF_MAX, HALF_MAX, out=level)
    level[...] = level.astype(np.float16)
    return over


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
        self._buffer = np.empty(sum(widths) * self._stride, dtype=np.float32)
        self._chain = np.asarray(_check.frozen(np.stack([offsets, sizes], axis=1).astype(np.int64)))
        self._padded = []
        for offset, width, n in zip(offsets, widths, sizes, strict=True):
            part = self._buffer[offset * self._stride : (offset + width) * self._stride]
            self._padded.append(part.reshape(6, n + 2 * PAD, n + 2 * PAD, self._stride))

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
        sample_chain(
            d, lod, buffer, chain, stride, steps, linear, mip_linear, bool(seamless), even, out
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


def build_pyramid(cube: CubeMap, filter: str = "gauss6", storage: str = "rgba32f") -> Pyramid:
    """MIP pyramid of a cube map down to size 1.

    Parameters
    ----------
    cube : CubeMap
        Its size must be a power of two.
    filter : "box", "gauss4" or "gauss6"
        Kernel per axis before decimation by two.
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
    padded, table, over = pyramid._padded, fold_table(), 0
    for i, level in enumerate(padded):
        if i == 0:
            _store_rgb(cube.faces, level)
        else:
            _REDUCE[filter](padded[i - 1], level)
        if storage == "rgba16f":
            over += _round_to_half(level[:, PAD:-PAD, PAD:-PAD])
        k_fill_seams(level, table)
    pyramid._warn_clamped(over)
    return pyramid
