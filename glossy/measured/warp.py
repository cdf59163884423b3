"""Bilinear densities on the unit square, and the warp from uniform numbers to them.

A slice is a grid of H x W non-negative values with nodes at ((column) / (W-1), (row) / (H-1)),
scaled so that its bilinear interpolant integrates to one. With S(y, x) the integral along a row up
to a node and M(y) that of the row integrals, both by the trapezoidal rule, the interpolant's
marginal is linear between rows and its conditional linear between columns, so that both are
inverted by a quadratic: on a cell with border values a and b, the share x of the mass ::

    u = a x + (b - a) x^2 / 2        x = (a - sqrt(a^2 - 2 u (a - b))) / (a - b)            (1)

Slices are tabulated over parameters (the direction of the incident light); between them all
tables are blended linearly, which keeps (1) exact.

Source: Dupuy & Jakob 2018, "An adaptive parameterization for efficient material acquisition and
rendering", ACM TOG 37(6), section 5.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel

Float64Array = npt.NDArray[np.float64]
Slices = tuple[int, int, int, int]
Weights = tuple[float, float, float, float]

FIRST: Slices = (0, 0, 0, 0)
ALONE: Weights = (1.0, 0.0, 0.0, 0.0)  # the weights of one slice by itself


@dataclasses.dataclass(frozen=True, eq=False)
class Warp:
    """Tables of the slices: values (S, H, W), row integrals (S, H, W), their integral (S, H)."""

    values: Float64Array
    conditional: Float64Array
    marginal: Float64Array

    @classmethod
    def build(cls, values: npt.ArrayLike) -> "Warp":
        """Normalise slices (S, H, W); a slice without mass is an error."""
        v = np.array(values, dtype=np.float64)
        rows = np.zeros_like(v)
        rows[:, :, 1:] = np.cumsum(0.5 * (v[:, :, 1:] + v[:, :, :-1]), axis=2)
        whole = np.zeros(v.shape[:2])
        whole[:, 1:] = np.cumsum(0.5 * (rows[:, 1:, -1] + rows[:, :-1, -1]), axis=1)
        mass = whole[:, -1:]
        if not (v >= 0.0).all() or not (mass > 0.0).all():
            raise ValueError("a density has no mass, or negative values")
        tables = (v / mass[:, :, None], rows / mass[:, :, None], whole / mass)
        return cls(*(_check.frozen(t) for t in tables))


@kernel
def k_blend(table: Float64Array, y: int, x: int, s: Slices, w: Weights) -> Scalar:
    """Blend one entry of the slices ``s`` with the weights ``w``."""
    value = w[0] * table[s[0], y, x]
    for k in range(1, 4):
        if w[k] != 0.0:
            value += w[k] * table[s[k], y, x]
    return value


@kernel
def k_bilinear(table: Float64Array, u: float, v: float, s: Slices, w: Weights) -> Scalar:
    """Bilinear lookup at (u, v) of the unit square, u along columns; outside clamps."""
    rows, columns = table.shape[1] - 1, table.shape[2] - 1
    fx, fy = min(max(u, 0.0), 1.0) * columns, min(max(v, 0.0), 1.0) * rows
    x, y = min(int(fx), columns - 1), min(int(fy), rows - 1)
    fx -= x
    fy -= y
    low = (1.0 - fx) * k_blend(table, y, x, s, w) + fx * k_blend(table, y, x + 1, s, w)
    high = (1.0 - fx) * k_blend(table, y + 1, x, s, w) + fx * k_blend(table, y + 1, x + 1, s, w)
    return (1.0 - fy) * low + fy * high


@kernel
def k_invert(
    values: Float64Array,
    conditional: Float64Array,
    marginal: Float64Array,
    u: float,
    v: float,
    s: Slices,
    w: Weights,
) -> tuple[Scalar, Scalar, Scalar]:
    """Uniform numbers that the point (u, v) stands for, and the density there."""
    rows, columns = values.shape[1] - 1, values.shape[2] - 1
    fx, fy = min(max(u, 0.0), 1.0) * columns, min(max(v, 0.0), 1.0) * rows
    x, y = min(int(fx), columns - 1), min(int(fy), rows - 1)
    fx -= x
    fy -= y
    c0 = (1.0 - fy) * k_blend(values, y, x, s, w) + fy * k_blend(values, y + 1, x, s, w)
    c1 = (1.0 - fy) * k_blend(values, y, x + 1, s, w) + fy * k_blend(values, y + 1, x + 1, s, w)
    density = ((1.0 - fx) * c0 + fx * c1) * rows * columns
    along = fx * (c0 + 0.5 * fx * (c1 - c0))
    along += (1.0 - fy) * k_blend(conditional, y, x, s, w)
    along += fy * k_blend(conditional, y + 1, x, s, w)
    r0 = k_blend(conditional, y, columns, s, w)
    r1 = k_blend(conditional, y + 1, columns, s, w)
    whole = (1.0 - fy) * r0 + fy * r1
    across = fy * (r0 + 0.5 * fy * (r1 - r0))
    for k in range(4):
        if w[k] != 0.0:
            across += w[k] * marginal[s[k], y]
    return (along / whole if whole > 0.0 else 0.5), across, density


@kernel
def k_solve(u: float, a: float, b: float) -> Scalar:
    """Position x in [0, 1] where eq. (1) reaches u."""
    root = np.sqrt(max(a * a - 2.0 * u * (a - b), 0.0))
    below = a + root  # the other form of the root: no cancellation when a and b are close
    return min(2.0 * u / below, 1.0) if below > 0.0 else 0.5


@kernel
def k_sample(
    values: Float64Array,
    conditional: Float64Array,
    marginal: Float64Array,
    u: float,
    v: float,
    s: Slices,
    w: Weights,
) -> tuple[Scalar, Scalar, Scalar]:
    """Inverse of ``k_invert``: the point of the square for uniform numbers, and its density."""
    rows, columns = values.shape[1] - 1, values.shape[2] - 1
    low, high = 0, rows
    base = 0.0
    while high - low > 1:
        middle = (low + high) // 2
        reached = 0.0
        for k in range(4):
            if w[k] != 0.0:
                reached += w[k] * marginal[s[k], middle]
        if reached <= v:
            low, base = middle, reached
        else:
            high = middle
    y = low
    r0 = k_blend(conditional, y, columns, s, w)
    r1 = k_blend(conditional, y + 1, columns, s, w)
    fy = k_solve(v - base, r0, r1)
    target = u * ((1.0 - fy) * r0 + fy * r1)
    low, high = 0, columns
    base = 0.0
    while high - low > 1:
        middle = (low + high) // 2
        reached = (1.0 - fy) * k_blend(conditional, y, middle, s, w)
        reached += fy * k_blend(conditional, y + 1, middle, s, w)
        if reached <= target:
            low, base = middle, reached
        else:
            high = middle
    x = low
    c0 = (1.0 - fy) * k_blend(values, y, x, s, w) + fy * k_blend(values, y + 1, x, s, w)
    c1 = (1.0 - fy) * k_blend(values, y, x + 1, s, w) + fy * k_blend(values, y + 1, x + 1, s, w)
    fx = k_solve(target - base, c0, c1)
    return (x + fx) / columns, (y + fy) / rows, ((1.0 - fx) * c0 + fx * c1) * rows * columns
