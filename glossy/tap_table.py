"""What the pixel loops take for a material: the samples of every lobe's pattern in one table.

A row (``Row``) holds one lobe's half vectors, their g of ``shading``'s eq. (2), the solid angle of
half vectors that each stands for (``cell``, 0 where a footprint does without), and the sines of the
angles at which the lobe ends. ``join_rows`` makes the table of them.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from . import _check
from ._arguments import require
from .brdf import Lobe, Material
from .footprint import FOOTPRINTS, JACOBIAN, border_sines
from .pattern import Pattern
from .pyramid import Pyramid, subtexel_steps

FloatArray = npt.NDArray[np.floating]
Int64Array = npt.NDArray[np.int64]
Patterns = Pattern | Sequence[Pattern] | None
Row = tuple[FloatArray, FloatArray, FloatArray, tuple[float, float]]


@dataclasses.dataclass(frozen=True)
class TapTable:
    """What the kernels take for one material: the patterns of its lobes, ready to use.

    ``taps`` (K, 5): wh in the frame, g of eq. (2), spread of the footprint, and what a method adds;
    ``first`` (L + 1,): where each lobe's taps begin; ``borders`` (L, 2): sines of the lobe's border
    angles; ``lobes``, ``ks``, ``r0``: as in ``PackedMaterial``.
    """

    taps: FloatArray
    first: Int64Array
    borders: FloatArray
    lobes: FloatArray
    ks: FloatArray
    r0: FloatArray
    footprint: int
    bias: float
    steps: float

    def cast(self, dtype: type) -> Self:
        """The table in the kernels' precision."""
        names = ("taps", "borders", "lobes", "ks", "r0")
        arrays: dict[str, Any] = {k: _check.frozen(getattr(self, k).astype(dtype)) for k in names}
        bias, steps = dtype(self.bias), dtype(self.steps)
        return dataclasses.replace(self, **arrays, bias=bias, steps=steps)


def patterns_of(pattern: Patterns, count: int) -> list[Pattern | None]:
    """One pattern (or None) for each of ``count`` lobes."""
    if pattern is None or isinstance(pattern, Pattern):
        return [pattern] * count
    require("pattern", pattern, Pattern | Iterable)
    patterns = list(pattern)
    if len(patterns) != count or not all(isinstance(p, Pattern) for p in patterns):
        raise _check.fail("pattern", f"must be a Pattern or {count}, one for each lobe", pattern)
    return list(patterns)


def cut_row(lobe: Lobe, own: Pattern, gain: FloatArray, footprint: str, threshold: float) -> Row:
    """Row of a pattern cut off at its own threshold, or else at ``threshold``."""
    if footprint == "jacobian" and own.cell is None:
        raise _check.fail("pattern", "must have a cell for footprint 'jacobian'", own.cell)
    cell = np.broadcast_to(np.float64(0.0) if own.cell is None else own.cell, len(own))
    xi = threshold if own.threshold is None else own.threshold
    return own.half_vectors, gain, cell, border_sines(*lobe.widths, xi)


def join_rows(
    material: Material,
    pyramid: Pyramid,
    rows: Sequence[Row],
    footprint: str,
    bias: float,
    subtexel_bits: int | None,
) -> TapTable:
    """Join the rows (half vectors, g, cell, border sines) of the lobes into one table."""
    packed = material.pack()
    index = FOOTPRINTS.index(footprint)
    face = float(pyramid.size) ** 2
    parts = []
    for h, gain, cell, _ in rows:
        spread = face * cell if index == JACOBIAN else np.full(len(h), face / (4.0 * len(h)))
        parts.append(np.column_stack([h, gain, spread]))
    counts = [len(part) for part in parts]
    return TapTable(
        taps=np.concatenate(parts) if parts else np.empty((0, 5)),
        first=np.asarray(_check.frozen(np.concatenate([[0], np.cumsum(counts)]).astype(np.int64))),
        borders=np.array([row[3] for row in rows]).reshape(-1, 2),
        lobes=packed.lobes,
        ks=packed.ks,
        r0=packed.r0,
        footprint=index,
        bias=_check.number("bias", bias),
        steps=subtexel_steps(subtexel_bits),
    )
