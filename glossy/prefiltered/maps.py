"""Stacks of cube maps filtered with the profiles of radially symmetric lobes.

Slice e of a lobe's stack holds, for every direction r of a cube map's texel centres ::

    E_e(r) = int p_e(angle(r, l)) L(l) dl                                                   (1)

and a lookup at cos theta_o mixes the two slices around it linearly, as ``LobeStack`` does with the
profiles; within a slice it is seamless bilinear. The mix commutes with the integral, so between
slices (1) is exact for the stack; between texels it is not.

Texels are float32 RGBA, each slice with the rings of ``seams``.

Source: Kautz and McCool 2000, sections 4 and 5; cube maps for their dual paraboloids.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from .._arguments import checked
from .._threads import in_rows
from ..cubemap import MAX_SIZE, CubeMap, texel_directions
from ..sampler import sample_chain
from ..seams import PAD, fold_table, k_fill_seams
from .exact import filter_directions
from .filter import TOLERANCE, MapFilter
from .stack import LobeStack

SIZE = 64

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]


class FilteredStack:
    """One lobe's stack of filtered maps, as its kernel reads it.

    Attributes
    ----------
    stack : LobeStack
    buffer, chain :
        Flat texels and, for each slice, its first texel and face size: as in a ``Pyramid``.
    rows : (K, 7) float64
        At every cosine where a slice, weight or offset has a node: cos theta_o, slice, weight
        (three channels), polar and azimuthal offset. Linear between.
    """

    def __init__(self, stack: LobeStack, slices: Iterable[FloatArray], size: int) -> None:
        self.stack = stack
        count, width = len(stack.cosines), size + 2 * PAD
        levels = np.zeros((count, 6, width, width, 4), dtype=np.float32)
        for level, faces in zip(levels, slices, strict=True):
            level[:, PAD:-PAD, PAD:-PAD, :3] = faces
            k_fill_seams(level, fold_table())
        self._levels = levels
        self.buffer = np.asarray(_check.frozen(levels.reshape(-1)))
        offsets = np.arange(count) * (6 * width * width)
        chain = np.stack([offsets, np.full(count, size)], axis=1)
        self.chain = np.asarray(_check.frozen(chain.astype(np.int64)))
        c = np.union1d(stack.cosines, stack.view_cosines)
        slice_at = np.interp(c, stack.cosines, np.arange(count))
        weight = np.broadcast_to(stack.weight(c), (len(c), 3))
        offset = [
            np.interp(c, stack.view_cosines, o) for o in (stack.theta_offset, stack.phi_offset)
        ]
        self.rows = np.asarray(_check.frozen(np.column_stack([c, slice_at, weight, *offset])))

    @property
    def slices(self) -> Float32Array:
        """Filtered radiance (E, 6, n, n, 3), read-only."""
        view = self._levels[:, :, PAD:-PAD, PAD:-PAD, :3]
        view.flags.writeable = False
        return view

    def sample(
        self, directions: npt.ArrayLike, cosine: npt.ArrayLike, precision: str = "single"
    ) -> FloatArray:
        """Eq. (1) along directions (..., 3) for the slices at cos theta_o (...), (..., 3)."""
        dtype = _check.dtype_of(precision)
        d = _check.vectors("directions", directions, dtype)
        low, share = self.stack.slice_at(np.broadcast_to(np.asarray(cosine), d.shape[:-1]))
        out = np.empty(d.shape, dtype=dtype)
        at = _check.frozen((low + share).reshape(-1).astype(dtype))
        flat = _check.frozen(d.reshape(-1, 3))
        switches = (True, True, True, True)
        in_rows(
            sample_chain,
            len(flat),
            flat,
            at,
            self.buffer,
            self.chain,
            4,
            dtype(0.0),
            *switches,
            out.reshape(-1, 3),
            grain=512,
        )
        return out


class PrefilteredMaps:
    """What ``method="prefiltered"`` looks up: one ``FilteredStack`` for each lobe, in ``stacks``.

    ``size``: texels along a face's edge of every slice.
    """

    def __init__(self, stacks: tuple[FilteredStack, ...], size: int) -> None:
        self.stacks, self.size = stacks, size

    @property
    def nbytes(self) -> int:
        """Bytes of all slices, rings and fourth channel included."""
        return sum(stack.buffer.nbytes for stack in self.stacks)

    def __repr__(self) -> str:
        slices = [len(stack.stack.cosines) for stack in self.stacks]
        return f"PrefilteredMaps(size={self.size}, slices={slices})"


@checked
def prefilter(
    cube: CubeMap,
    stacks: LobeStack | Iterable[LobeStack],
    size: int = SIZE,
    tolerance: float | None = TOLERANCE,
) -> PrefilteredMaps:
    """Filter a cube map with every profile of the lobes, eq. (1).

    Parameters
    ----------
    cube : CubeMap
        Finite, any size.
    stacks : LobeStack, or several
        From ``approximate``, or made by hand.
    size : int
        Texels along a face's edge of each slice.
    tolerance : float or None
        RMS error of each slice over the sphere, relative to its own RMS; None sums over all
        texels (``filter_map``).

    Raises
    ------
    ValueError
        For a map that is not finite, or a number out of range.
    """
    n = _check.count("size", size, high=MAX_SIZE)
    given: tuple[Any, ...] = (stacks,) if isinstance(stacks, LobeStack) else tuple(stacks)
    for stack in given:
        if not isinstance(stack, LobeStack):
            raise _check.fail("stacks", "must be LobeStack or several", type(stack).__name__)
    directions = texel_directions(n)
    fast = None if tolerance is None else MapFilter(cube, tolerance)

    def filtered(stack: LobeStack, profile: Float64Array) -> Float64Array:
        if not profile.any():
            return np.zeros(directions.shape)
        if fast is None:
            return filter_directions(cube, stack.angles, profile, directions)
        return fast.filtered(stack.angles, profile, directions)

    made = [FilteredStack(s, (filtered(s, p) for p in s.profiles), n) for s in given]
    return PrefilteredMaps(tuple(made), n)
