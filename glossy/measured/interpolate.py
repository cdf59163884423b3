"""Evaluation of a table between its measured directions (thesis section 3.2, Figs. 3.1, 3.2).

The incident directions of a table lie on rings of equal polar angle. A query has up to four
neighbours among them, two azimuths on two rings, with bilinear weights v_j; beyond the first and
the last ring the ring itself is used. With g_j the function measured for neighbour j ::

    linear        g = sum_j v_j g_j(wo)                                                     (1)
    half-vector   g = sum_j v_j g_j(reflect(wi_j, h)),      h = (wi + wo) / |wi + wo|       (2)

(1) blends lobes that stay where they were measured; (2) moves each to where the query's mirror
direction is. Neighbours whose moved direction falls below the surface are left out, the weights of
the others raised. g is one of ::

    f           p = f |cos theta_o|           root = f sqrt(|cos theta_i cos theta_o|)      (3)

of which f is then the quotient. The thesis interpolates p. For a lobe that is moved, the root keeps
its height best (a microfacet lobe with masking varies as the root's divisor), and it is the
default; f suits what is diffuse. Beyond the measured polar angles the divisors stay as they are
there, so f does too. Between outgoing directions see `disc`.

Light from below, and light that passes, is turned to the upper hemisphere: each of the four
combinations of sides is a block of its own, and in (2) a passing direction counts as its mirror
image at the surface.

Symmetry supplies incident azimuths that were not measured: ``isotropic`` (both directions turn
together, and left and right are alike), ``quadrant`` (x and y axes are mirrors), ``mirror`` (only
the x axis), ``none``.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from .disc import Disc, build_disc, k_above, k_grid_nodes, k_triangle_nodes
from .table import MeasuredTable

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Four = tuple[int, int, int, int]
FourWeights = tuple[float, float, float, float]

INTERPOLATIONS = ("linear", "half-vector")
QUANTITIES = ("root", "p", "f")
SYMMETRIES = ("none", "mirror", "quadrant", "isotropic")
RING_WIDTH = np.radians(0.1)  # polar angles closer than this are one ring
LOWEST = 1e-6  # cosine below which p does not tell f


@dataclasses.dataclass(frozen=True, eq=False)
class Block:
    """What was measured on one combination of sides, all in the upper hemisphere.

    ``theta`` (R,) of the rings, ``first`` (R + 1,) index of a ring's first incident direction,
    ``phi`` (J,), and one disc for each incident direction. ``lowest``: cosines of the incident and
    the outgoing direction nearest to the horizon.
    """

    theta: Float64Array
    first: IntArray
    phi: Float64Array
    discs: tuple[Disc, ...]
    symmetry: int
    lowest: tuple[float, float]

    def arguments(self) -> tuple[Any, ...]:
        """Flat arrays for the kernels."""
        return self._flat

    def __post_init__(self) -> None:
        def ends(parts: list[npt.NDArray[Any]]) -> IntArray:
            return np.concatenate([[0], np.cumsum([len(p) for p in parts])]).astype(np.int64)

        def joined(get: Callable[[Disc], npt.NDArray[Any]]) -> tuple[Any, IntArray]:
            parts = [get(d) for d in self.discs]
            return np.concatenate(parts), ends(parts)

        points, at_point = joined(lambda d: d.points)
        triangles, at_triangle = joined(lambda d: d.triangles)
        theta, at_theta = joined(lambda d: d.theta)
        phi, at_phi = joined(lambda d: d.phi)
        starts = np.stack([at_point, at_theta, at_phi], axis=1)
        beside, _ = joined(lambda d: d.neighbours)
        shift = np.repeat(at_triangle[:-1], np.diff(at_triangle))[:, None]
        beside = np.where(beside < 0, -1, beside + shift)
        triangles = triangles + np.repeat(at_point[:-1], np.diff(at_triangle))[:, None]
        flat = (
            self.theta,
            self.first,
            self.phi,
            starts,
            points,
            np.concatenate([d.values for d in self.discs]),
            triangles,
            beside,
            np.stack([d.seeds + at for d, at in zip(self.discs, at_triangle[:-1], strict=True)]),
            theta,
            phi,
        )
        packed = (*(_check.frozen(a) for a in flat), self.symmetry)
        object.__setattr__(self, "_flat", packed)

    _flat: tuple[Any, ...] = dataclasses.field(init=False, repr=False)


def guess_symmetry(table: MeasuredTable) -> str:
    """The symmetry that the incident azimuths suggest: none beyond 90 or 180 degrees.

    A table that is not isotropic but has azimuths from 0 to 90 degrees only was measured so
    because the rest is the same (thesis section 2.3); likewise up to 180.
    """
    if table.isotropic:
        return "isotropic"
    away = np.hypot(table.wi[:, 0], table.wi[:, 1]) > 1e-3
    phi = np.arctan2(table.wi[away, 1], table.wi[away, 0])
    top = float(np.max(np.where(phi < -1e-3, phi + 2.0 * np.pi, phi), initial=0.0))
    if top < 0.5 * np.pi + 1e-3:
        return "quadrant"
    return "mirror" if top < np.pi + 1e-3 else "none"


def _factor(
    quantity: str, wi: Float64Array, wo: Float64Array, lowest: tuple[float, float]
) -> Float64Array:
    """What f is multiplied by before it is interpolated, (K, 1), eq. (3)."""
    i, o = (np.maximum(w[:, 2:], c) for w, c in zip((wi, wo), lowest, strict=True))
    if quantity == "f":
        return np.ones_like(o)
    return o if quantity == "p" else np.sqrt(i * o)


def build_blocks(
    table: MeasuredTable,
    quantity: str = "root",
    symmetry: str | None = None,
    closed: bool = False,
) -> dict[tuple[int, int], Block]:
    """Blocks by the signs of wi.z and wo.z; combinations that were not measured are missing.

    ``closed`` discs end at the horizon with the value 0 and have no grid, see `disc.build_disc`.
    """
    _check.choice("quantity", quantity, QUANTITIES)
    kind = guess_symmetry(table) if symmetry is None else symmetry
    code = SYMMETRIES.index(_check.choice("symmetry", kind, SYMMETRIES))
    blocks = {}
    for si in (1, -1):
        for so in (1, -1):
            rows = (table.wi[:, 2] * si > 0.0) & (table.wo[:, 2] * so > LOWEST)
            if rows.any():
                part = table.select(rows)
                wi, wo = part.wi * [1.0, 1.0, si], part.wo * [1.0, 1.0, so]
                lowest = (float(wi[:, 2].min()), float(wo[:, 2].min()))
                values = part.f * _factor(quantity, wi, wo, lowest)
                blocks[si, so] = _block(wi, wo, values, code, lowest, closed)
    return blocks


def _block(
    wi: Float64Array,
    wo: Float64Array,
    values: Float64Array,
    symmetry: int,
    lowest: tuple[float, float],
    closed: bool,
) -> Block:
    theta_i = np.arctan2(np.hypot(wi[:, 0], wi[:, 1]), wi[:, 2])
    if symmetry == 3:  # turn the light to azimuth 0; left is as right
        length = np.maximum(np.hypot(wi[:, 0], wi[:, 1]), 1e-300)
        c, s = wi[:, 0] / length, wi[:, 1] / length
        c, s = np.where(theta_i < 1e-6, 1.0, c), np.where(theta_i < 1e-6, 0.0, s)
        x, y = c * wo[:, 0] + s * wo[:, 1], c * wo[:, 1] - s * wo[:, 0]
        wo = np.concatenate([np.stack([x, sign * y, wo[:, 2]], axis=1) for sign in (1.0, -1.0)])
        wi = np.stack([np.sin(theta_i), np.zeros_like(theta_i), np.cos(theta_i)], axis=1)
        wi, values, theta_i = np.tile(wi, (2, 1)), np.tile(values, (2, 1)), np.tile(theta_i, 2)
    places, rows = MeasuredTable(wi, wo, values[:, :1]).incident_directions()
    theta = np.arctan2(np.hypot(places[:, 0], places[:, 1]), places[:, 2])
    phi = np.arctan2(places[:, 1], places[:, 0]) % (2.0 * np.pi)
    phi = np.where((theta < 1e-4) | (phi > 2.0 * np.pi - 1e-6), 0.0, phi)
    order = np.argsort(theta, kind="stable")
    ring = np.zeros(len(places), dtype=np.int64)
    ring[order] = np.concatenate([[0], np.cumsum(np.diff(theta[order]) > RING_WIDTH)])
    order = np.lexsort((phi, ring))
    count = np.bincount(ring)
    return Block(
        np.bincount(ring, theta) / count,
        np.concatenate([[0], np.cumsum(count)]),
        phi[order],
        tuple(build_disc(wo[rows[j]], values[rows[j]], closed) for j in order),
        symmetry,
        lowest,
    )


@kernel
def k_ring(
    phi: Float64Array, start: int, end: int, p: float, wraps: bool
) -> tuple[int, int, Scalar]:
    """Indices of the azimuths about p among ``phi[start:end]``, and the share of the second."""
    n = end - start
    if n == 1:
        return start, start, 0.0
    k = k_above(phi, start, end, p) - start
    if not wraps and k == 0:
        return start, start, 0.0
    if not wraps and k == n:
        return end - 1, end - 1, 0.0
    low, high = start + (k - 1) % n, start + k % n
    gap, past = phi[high] - phi[low], p - phi[low]
    gap += 2.0 * np.pi if gap <= 0.0 else 0.0
    past += 2.0 * np.pi if past < 0.0 else 0.0
    return low, high, past / gap


@kernel
def k_neighbours(
    theta: Float64Array,
    first: IntArray,
    phi: Float64Array,
    symmetry: int,
    x: float,
    y: float,
    z: float,
) -> tuple[Four, FourWeights, Four]:
    """Incident directions about (x, y, z), their weights, and the ring of each."""
    t = np.arctan2(np.sqrt(x * x + y * y), z)
    p = np.arctan2(y, x)
    p += 2.0 * np.pi if p < 0.0 else 0.0
    high = k_above(theta, 0, len(theta), t)
    low = max(high - 1, 0)
    high = min(high, len(theta) - 1)
    f = (t - theta[low]) / (theta[high] - theta[low]) if high > low else 0.0
    f = min(max(f, 0.0), 1.0)
    wraps = symmetry == 0
    a, b, fa = k_ring(phi, first[low], first[low + 1], p, wraps)
    c, d, fc = k_ring(phi, first[high], first[high + 1], p, wraps)
    weights = ((1.0 - f) * (1.0 - fa), (1.0 - f) * fa, f * (1.0 - fc), f * fc)
    return (a, b, c, d), weights, (low, low, high, high)


@kernel
def k_add(
    out: Float64Array,
    at: int,
    weight: float,
    j: int,
    x: float,
    y: float,
    z: float,
    starts: IntArray,
    points: Float64Array,
    values: Float64Array,
    triangles: IntArray,
    neighbours: IntArray,
    seeds: IntArray,
    grid_theta: Float64Array,
    grid_phi: Float64Array,
) -> None:
    """Add ``weight`` times the function of incident direction j at (x, y, z) to ``out[at]``."""
    t0, t1, p0, p1 = starts[j, 1], starts[j + 1, 1], starts[j, 2], starts[j + 1, 2]
    base = 0
    if t1 > t0:
        base = starts[j, 0]
        nodes, w = k_grid_nodes(x, y, z, grid_theta, grid_phi, t0, t1, p0, p1)
    else:
        nodes, w = k_triangle_nodes(x, y, z, points, triangles, neighbours, seeds, j)
    for k in range(4):
        if w[k] != 0.0:
            for c in range(out.shape[1]):
                out[at, c] += weight * w[k] * values[base + nodes[k], c]


@kernel
def k_fold(symmetry: int, x: float, y: float) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Matrix (a, b, c, d) that turns or mirrors azimuths to where ``(x, y)`` was measured.

    It takes (u, v) to (a u + b v, c u + d v), and its transpose takes them back.
    """
    if symmetry == 3:
        across = np.sqrt(x * x + y * y)
        c, s = (x / across, y / across) if across > 1e-12 else (1.0, 0.0)
        return c, s, -s, c
    flip_x = -1.0 if symmetry == 2 and x < 0.0 else 1.0
    flip_y = -1.0 if symmetry > 0 and y < 0.0 else 1.0
    return flip_x, 0.0, 0.0, flip_y


@kernel
def k_interpolate(
    out: Float64Array,
    k: int,
    ix: float,
    iy: float,
    iz: float,
    ox: float,
    oy: float,
    oz: float,
    aligned: bool,
    theta: Float64Array,
    first: IntArray,
    phi: Float64Array,
    starts: IntArray,
    points: Float64Array,
    values: Float64Array,
    triangles: IntArray,
    neighbours: IntArray,
    seeds: IntArray,
    grid_theta: Float64Array,
    grid_phi: Float64Array,
    symmetry: int,
) -> None:
    """Add eq. (1) or (2) for folded directions to the zeros in ``out[k]``."""
    js, weights, rings = k_neighbours(theta, first, phi, symmetry, ix, iy, iz)
    if aligned:
        hx, hy, hz = ix + ox, iy + oy, iz + oz
        length = np.sqrt(hx * hx + hy * hy + hz * hz)
        hx, hy, hz = hx / length, hy / length, hz / length
        total = 0.0
        for n in range(4):
            if weights[n] == 0.0:
                continue
            t, p = theta[rings[n]], phi[js[n]]
            jx, jy, jz = np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)
            cosine = 2.0 * (jx * hx + jy * hy + jz * hz)
            if cosine * hz - jz > 0.0:
                total += weights[n]
                k_add(
                    out, k, weights[n], js[n],
                    cosine * hx - jx, cosine * hy - jy, cosine * hz - jz,
                    starts, points, values, triangles, neighbours, seeds, grid_theta, grid_phi,
                )  # fmt: skip
        if total > 0.0:
            for c in range(out.shape[1]):
                out[k, c] /= total
            return
    for n in range(4):
        if weights[n] != 0.0:
            k_add(
                out, k, weights[n], js[n], ox, oy, oz,
                starts, points, values, triangles, neighbours, seeds, grid_theta, grid_phi,
            )  # fmt: skip


@row_kernel
def _evaluate(
    begin: int,
    end: int,
    wi: Float64Array,
    wo: Float64Array,
    aligned: bool,
    out: Float64Array,
    theta: Float64Array,
    first: IntArray,
    phi: Float64Array,
    starts: IntArray,
    points: Float64Array,
    values: Float64Array,
    triangles: IntArray,
    neighbours: IntArray,
    seeds: IntArray,
    grid_theta: Float64Array,
    grid_phi: Float64Array,
    symmetry: int,
) -> None:
    # for wi, wo (K, 3), both above, into out (K, C)
    for k in range(begin, end):
        ix, iy, ox, oy = wi[k, 0], wi[k, 1], wo[k, 0], wo[k, 1]
        a, b, c, d = k_fold(symmetry, ix, iy)
        k_interpolate(
            out, k, a * ix + b * iy, c * ix + d * iy, wi[k, 2],
            a * ox + b * oy, c * ox + d * oy, wo[k, 2], aligned, theta, first, phi, starts,
            points, values, triangles, neighbours, seeds, grid_theta, grid_phi, symmetry,
        )  # fmt: skip


def evaluate_block(
    block: Block, wi: Float64Array, wo: Float64Array, interpolation: str
) -> Float64Array:
    """The measured function (K, C) for unit directions (K, 3) of the upper hemisphere."""
    out = np.zeros((len(wi), block.discs[0].values.shape[1]))
    aligned = interpolation == "half-vector"
    in_rows(
        _evaluate,
        len(wi),
        _check.frozen(wi),
        _check.frozen(wo),
        aligned,
        out,
        *block.arguments(),
        grain=256,
    )
    return out


class TableFunction:
    """The BSDF of a table, everywhere.

    Parameters
    ----------
    table : MeasuredTable
    interpolation : "half-vector" or "linear"
        Eq. (2) or (1).
    quantity : "root", "p" or "f"
        What is interpolated, eq. (3).
    symmetry : str, optional
        One of the names at the top; by default what `guess_symmetry` says.

    Passing light that was measured from one side only has the reciprocal value from the other.
    """

    def __init__(
        self,
        table: MeasuredTable,
        interpolation: str = "half-vector",
        quantity: str = "root",
        symmetry: str | None = None,
    ) -> None:
        self.interpolation = _check.choice("interpolation", interpolation, INTERPOLATIONS)
        self.quantity = quantity
        self.channels = len(table.channels)
        self.blocks = build_blocks(table, quantity, symmetry)
        self.symmetry = guess_symmetry(table) if symmetry is None else symmetry

    def __call__(self, wi: Float64Array, wo: Float64Array) -> Float64Array:
        """BSDF (K, C) [1/sr] for unit directions (K, 3); zero where nothing was measured."""
        out = np.zeros((len(wi), self.channels))
        for si in (1, -1):
            for so in (1, -1):
                rows = np.flatnonzero((wi[:, 2] * si > 0.0) & (wo[:, 2] * so > 0.0))
                first, second = wi[rows] * [1.0, 1.0, si], wo[rows] * [1.0, 1.0, so]
                block = self.blocks.get((si, so))
                if block is None and si != so:
                    block, first, second = self.blocks.get((so, si)), second, first
                if block is None or not len(rows):
                    continue
                value = evaluate_block(block, first, second, self.interpolation)
                out[rows] = value / _factor(self.quantity, first, second, block.lowest)
        return out
