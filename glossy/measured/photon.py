"""Photon bounces from a table (thesis section 3.2): absorbed, reflected or passed on, and where to.

A photon from ``wi`` ends with probability 1 - (r + t) (Russian roulette, thesis eq. 3.1), where
the shares r and t of reflected and passed light are integrals of the measured transfer density p
at the measured incident directions, interpolated between them. Between outgoing directions p is
linear on triangles of an area-preserving disc (see `disc`) and zero at the horizon, so the
integrals are sums over triangles::

    r_j = sum_T area(T) (p_1 + p_2 + p_3) / 3                                               (1)

The direction is drawn in one of two ways.

``rejection``: candidates spread evenly over the hemisphere are accepted with probability p / p_max.
The threshold is drawn anew for each candidate; one threshold a photon, as the thesis's pseudo-code
has it, favours bright directions too little and is biased. On average this takes ::

    tries = 2 pi p_max / r                                                                  (2)

``inversion``: a neighbour is drawn by v_j r_j, one of its triangles by its share of (1) from a
cumulative table, a point in it from the linear density. Blended linearly, this has the density
sum_j v_j p_j(wo) of the rejection. With half-vector alignment the point drawn is moved to where
the neighbour's lobe goes, which keeps the density of half vectors::

    p(wo | wi) = sum_j v_j p_j(wo_j) (wi_j.h) / (wi.h),     wo_j = reflect(wi_j, h)         (3)

Points moved below the horizon are drawn again. The rejection with alignment has the thesis's
interpolation, (3) without the quotient.

Colours: probabilities are those of the luminance, so a photon's power keeps its luminance.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from ..truth.random import k_mix, k_unit
from .disc import k_above
from .importance import luminance
from .interpolate import (
    INTERPOLATIONS,
    Block,
    build_blocks,
    evaluate_block,
    k_fold,
    k_interpolate,
    k_neighbours,
)
from .table import MeasuredTable

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

METHODS = ("inversion", "rejection")
MOST_TRIES = 1_000_000  # of one photon; then it counts as absorbed
ABSORBED, REFLECTED, TRANSMITTED = 0, 1, 2


@dataclasses.dataclass(frozen=True, eq=False)
class Bounce:
    """What became of photons.

    ``fate`` (K,): 0 absorbed, 1 reflected, 2 passed on. ``wo`` (K, 3): where they go, zero if
    nowhere. ``tries`` (K,): candidates that were drawn for it.
    """

    fate: IntArray
    wo: Float64Array
    tries: IntArray


@dataclasses.dataclass(frozen=True, eq=False)
class _Side:
    """A block with its shares r_j, the cumulative masses of its triangles, and its largest p_j."""

    block: Block
    share: Float64Array
    mass: Float64Array
    first: IntArray
    top: Float64Array

    @classmethod
    def build(cls, block: Block) -> "_Side":
        parts = []
        for disc in block.discs:
            p, q, r = (disc.points[disc.triangles[:, k]] for k in range(3))
            cross = (q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0]
            corners = disc.values[:, 0][disc.triangles]
            parts.append(np.cumsum(0.5 * np.abs(cross) * corners.mean(axis=1)))
        return cls(
            block,
            _check.frozen(np.array([part[-1] for part in parts])),
            _check.frozen(np.concatenate(parts)),
            _check.frozen(np.concatenate([[0], np.cumsum([len(part) for part in parts])])),
            _check.frozen(np.array([disc.values.max() for disc in block.discs])),
        )


class PhotonTable:
    """Photon bounces at a surface known by measurement.

    Parameters
    ----------
    table : MeasuredTable
        Negative values count as 0, colours as their luminance.
    interpolation : "linear" or "half-vector"
        Between incident directions.
    symmetry : str, optional
        As `MeasuredMaterial` takes it.

    Raises
    ------
    ValueError
        For an unknown option.
    """

    def __init__(
        self,
        table: MeasuredTable,
        interpolation: str = "linear",
        symmetry: str | None = None,
    ) -> None:
        self.interpolation = _check.choice("interpolation", interpolation, INTERPOLATIONS)
        grey = MeasuredTable(
            table.wi,
            table.wo,
            np.maximum(luminance(table.f), 0.0),
            isotropic=table.isotropic,
        )
        blocks = build_blocks(grey, "p", symmetry, closed=True)
        self._sides = {key: _Side.build(block) for key, block in blocks.items()}

    def shares(self, wi: npt.ArrayLike) -> tuple[Float64Array, Float64Array]:
        """Probabilities (...) to be reflected and to be passed on; of data above 1 scaled to 1."""
        i = _check.unit_vectors("wi", wi)
        flat = i.reshape(-1, 3)
        found = np.zeros((2, len(flat)))
        for (si, so), side in self._sides.items():
            rows = np.flatnonzero(flat[:, 2] * si > 0.0)
            value = np.zeros(len(rows))
            block = side.block
            upper = _check.frozen(flat[rows] * [1.0, 1.0, si])
            in_rows(
                _shares,
                len(upper),
                upper,
                block.theta,
                block.first,
                block.phi,
                block.symmetry,
                side.share,
                value,
                grain=64,
            )
            found[0 if si == so else 1, rows] = value
        found /= np.maximum(found.sum(axis=0), 1.0)
        return found[0].reshape(i.shape[:-1]), found[1].reshape(i.shape[:-1])

    def expected_tries(self, wi: npt.ArrayLike) -> Float64Array:
        """Mean number of candidates (...) of the rejection per reflected photon, eq. (2)."""
        i = _check.unit_vectors("wi", wi)
        flat = i.reshape(-1, 3)
        tries = np.full(len(flat), np.inf)
        for (si, so), side in self._sides.items():
            if si == so:
                rows = np.flatnonzero(flat[:, 2] * si > 0.0)
                upper = _check.frozen(flat[rows] * [1.0, 1.0, si])
                block = side.block
                axes = (block.theta, block.first, block.phi, block.symmetry)
                share, top = np.zeros(len(rows)), np.zeros(len(rows))
                in_rows(_shares, len(upper), upper, *axes, side.share, share, grain=64)
                in_rows(_shares, len(upper), upper, *axes, side.top, top, grain=64)
                lit = share > 0.0
                tries[rows[lit]] = 2.0 * np.pi * top[lit] / share[lit]
        return tries.reshape(i.shape[:-1])

    def bounce(self, wi: npt.ArrayLike, seed: int = 0, method: str = "inversion") -> Bounce:
        """What becomes of photons that come from ``wi`` (K, 3).

        Parameters
        ----------
        wi : (K, 3) array
            Unit directions, leaving the surface.
        seed : int
            A photon's fate depends on it and on its place in ``wi``.
        method : "inversion" or "rejection"
        """
        i = _check.unit_vectors("wi", wi)
        if i.ndim != 2:
            raise _check.fail("wi", "must have shape (K, 3)", i.shape)
        _check.count("seed", seed, low=0, high=2**63 - 1)
        _check.choice("method", method, METHODS)
        r, t = self.shares(i)
        u = _roulette(seed, len(i))
        fate = np.where(u < r, REFLECTED, np.where(u < r + t, TRANSMITTED, ABSORBED))
        wo, tries = np.zeros_like(i), np.zeros(len(i), dtype=np.int64)
        aligned = self.interpolation == "half-vector"
        for (si, so), side in self._sides.items():
            wanted = REFLECTED if si == so else TRANSMITTED
            rows = np.flatnonzero((i[:, 2] * si > 0.0) & (fate == wanted))
            upper = _check.frozen(i[rows] * [1.0, 1.0, si])
            out, count = np.zeros((len(rows), 3)), np.zeros(len(rows), dtype=np.int64)
            common = (upper, _check.frozen(rows), seed, aligned, out, count)
            if method == "inversion":
                tables = (side.share, side.mass, side.first, *side.block.arguments())
                in_rows(_invert, len(rows), *common, *tables, grain=64)
            else:
                scratch = np.zeros((len(rows), 1))
                tables = (scratch, side.top, *side.block.arguments())
                in_rows(_reject, len(rows), *common, *tables, grain=64)
            wo[rows], tries[rows] = out * [1.0, 1.0, so], count
        fate[(fate != ABSORBED) & ~wo.any(axis=1)] = ABSORBED
        return Bounce(fate, wo, tries)

    def density(
        self, wo: npt.ArrayLike, wi: npt.ArrayLike, method: str = "inversion"
    ) -> Float64Array:
        """Density p (K,) [1/sr] of the directions ``wo`` (K, 3) that ``bounce`` draws for a ``wi``.

        It integrates to the shares, less what aligned inversion draws again.
        """
        o, i = _check.unit_vectors("wo", wo), _check.unit_vectors("wi", wi)
        _check.choice("method", method, METHODS)
        out = np.zeros(len(o))
        for (si, so), side in self._sides.items():
            rows = np.flatnonzero((o[:, 2] * so > 0.0) & (i[2] * si > 0.0))
            w, v = o[rows] * [1.0, 1.0, so], i * [1.0, 1.0, si]
            if self.interpolation == "linear" or method == "rejection":
                many = np.broadcast_to(v, w.shape)
                out[rows] = evaluate_block(side.block, many, w, self.interpolation)[:, 0]
            elif len(rows):
                out[rows] = _moved(side.block, v, w)
        return out


def _moved(block: Block, wi: Float64Array, wo: Float64Array) -> Float64Array:
    """Eq. (3) for one ``wi`` and ``wo`` (K, 3), all above."""
    h = wi + wo
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    a, b, c, d = k_fold(block.symmetry, wi[0], wi[1])
    fold = np.array([[a, b, 0.0], [c, d, 0.0], [0.0, 0.0, 1.0]])
    h, v = h @ fold.T, fold @ wi
    axes = (block.theta, block.first, block.phi, block.symmetry)
    js, weights, rings = k_neighbours(*axes, v[0], v[1], v[2])
    total = np.zeros(len(wo))
    for j, weight, ring in zip(js, weights, rings, strict=True):
        if weight > 0.0:
            t, p = block.theta[ring], block.phi[j]
            near = np.array([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)])
            moved = 2.0 * (h @ near)[:, None] * h - near
            up = moved[:, 2] > 0.0
            many = np.broadcast_to(near, (int(up.sum()), 3))
            value = evaluate_block(block, many, moved[up], "linear")[:, 0]
            total[up] += weight * value * (h[up] @ near) / (h[up] @ v)
    return total


def _roulette(seed: int, n: int) -> Float64Array:
    out = np.empty(n)
    _uniform(seed, out)
    return out


@kernel
def k_photon(seed: int, photon: int) -> np.uint64:
    """Start of a photon's chain of random numbers."""
    return k_mix(k_mix(np.uint64(2), np.uint64(seed)), np.uint64(photon))


@kernel
def _uniform(seed: int, out: Float64Array) -> None:
    for k in range(len(out)):
        out[k] = k_unit(k_mix(k_photon(seed, k), np.uint64(0)))


@row_kernel
def _shares(
    begin: int,
    end: int,
    wi: Float64Array,
    theta: Float64Array,
    first: IntArray,
    phi: Float64Array,
    symmetry: int,
    share: Float64Array,
    out: Float64Array,
) -> None:
    # sum_j v_j share_j for wi (K, 3) above
    for k in range(begin, end):
        x, y = wi[k, 0], wi[k, 1]
        a, b, c, d = k_fold(symmetry, x, y)
        js, weights, _ = k_neighbours(
            theta, first, phi, symmetry, a * x + b * y, c * x + d * y, wi[k, 2]
        )
        for n in range(4):
            out[k] += weights[n] * share[js[n]]


@row_kernel
def _reject(
    begin: int,
    end: int,
    wi: Float64Array,
    photons: IntArray,
    seed: int,
    aligned: bool,
    out: Float64Array,
    tries: IntArray,
    scratch: Float64Array,
    top: Float64Array,
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
    for k in range(begin, end):
        x, y, z = wi[k, 0], wi[k, 1], wi[k, 2]
        a, b, c, d = k_fold(symmetry, x, y)
        ix, iy = a * x + b * y, c * x + d * y
        js, weights, _ = k_neighbours(theta, first, phi, symmetry, ix, iy, z)
        most: Scalar = 0.0
        for n in range(4):
            if weights[n] > 0.0:
                most = max(most, top[js[n]]) if aligned else most + weights[n] * top[js[n]]
        state = k_photon(seed, photons[k])
        for attempt in range(MOST_TRIES):
            state = k_mix(state, np.uint64(1))
            z_out = k_unit(k_mix(state, np.uint64(2)))
            turn = 2.0 * np.pi * k_unit(k_mix(state, np.uint64(3)))
            across = np.sqrt(1.0 - z_out * z_out)
            ox, oy = across * np.cos(turn), across * np.sin(turn)
            scratch[k, 0] = 0.0
            k_interpolate(
                scratch, k, ix, iy, z, ox, oy, z_out, aligned, theta, first, phi, starts,
                points, values, triangles, neighbours, seeds, grid_theta, grid_phi, symmetry,
            )  # fmt: skip
            if most * k_unit(k_mix(state, np.uint64(4))) < scratch[k, 0]:
                out[k] = (a * ox + c * oy, b * ox + d * oy, z_out)
                tries[k] = attempt + 1
                break


@row_kernel
def _invert(
    begin: int,
    end: int,
    wi: Float64Array,
    photons: IntArray,
    seed: int,
    aligned: bool,
    out: Float64Array,
    tries: IntArray,
    share: Float64Array,
    mass: Float64Array,
    start: IntArray,
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
    for k in range(begin, end):
        x, y, z = wi[k, 0], wi[k, 1], wi[k, 2]
        a, b, c, d = k_fold(symmetry, x, y)
        ix, iy = a * x + b * y, c * x + d * y
        js, weights, rings = k_neighbours(theta, first, phi, symmetry, ix, iy, z)
        whole: Scalar = 0.0
        for n in range(4):
            whole += weights[n] * share[js[n]]
        state = k_photon(seed, photons[k])
        for attempt in range(MOST_TRIES):
            state = k_mix(state, np.uint64(1))
            u = whole * k_unit(k_mix(state, np.uint64(2)))
            pick = 0
            for n in range(4):
                if weights[n] * share[js[n]] > 0.0:
                    pick = n
                    if u < weights[n] * share[js[n]]:
                        break
                    u -= weights[n] * share[js[n]]
            j = js[pick]
            if share[j] <= 0.0:
                break
            v = share[j] * k_unit(k_mix(state, np.uint64(3)))
            t = min(k_above(mass, start[j], start[j + 1], v), start[j + 1] - 1)
            # a corner by its value, then weights whose density grows with that corner's
            p0, p1, p2 = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            v0, v1, v2 = values[p0, 0], values[p1, 0], values[p2, 0]
            corner = (v0 + v1 + v2) * k_unit(k_mix(state, np.uint64(4)))
            e0 = -np.log(k_unit(k_mix(state, np.uint64(5))))
            e1 = -np.log(k_unit(k_mix(state, np.uint64(6))))
            e2 = -np.log(k_unit(k_mix(state, np.uint64(7))))
            extra = -np.log(k_unit(k_mix(state, np.uint64(8))))
            if corner < v0:
                e0 += extra
            elif corner < v0 + v1:
                e1 += extra
            else:
                e2 += extra
            total = e0 + e1 + e2
            px = (e0 * points[p0, 0] + e1 * points[p1, 0] + e2 * points[p2, 0]) / total
            py = (e0 * points[p0, 1] + e1 * points[p1, 1] + e2 * points[p2, 1]) / total
            square = min(px * px + py * py, 2.0)
            scale = np.sqrt(1.0 - 0.25 * square)
            ox, oy, oz = px * scale, py * scale, 1.0 - 0.5 * square
            if aligned:
                ring, turn = theta[rings[pick]], phi[j]
                jx, jy, jz = np.sin(ring) * np.cos(turn), np.sin(ring) * np.sin(turn), np.cos(ring)
                hx, hy, hz = jx + ox, jy + oy, jz + oz
                length = np.sqrt(hx * hx + hy * hy + hz * hz)
                hx, hy, hz = hx / length, hy / length, hz / length
                cosine = 2.0 * (ix * hx + iy * hy + z * hz)
                ox, oy, oz = cosine * hx - ix, cosine * hy - iy, cosine * hz - z
            if oz > 0.0:
                out[k] = (a * ox + c * oy, b * ox + d * oy, oz)
                tries[k] = attempt + 1
                break
