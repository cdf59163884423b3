"""Quadrature for any material that can be evaluated, in plain NumPy, point by point.

The same product integration as ``texels`` over the same blocks, but with nothing known of the
material: the polynomial's error is read from the decay of its Legendre coefficients alone, blocks
that the horizon crosses count with their largest value, and probes, the material's own samples and
those of ``scan``, tell where a lobe may hide between the nodes: a block is divided as long as a
probe in it sees more than ``HIDDEN`` times what its nodes see.

The error is an estimate, as good as those rules. Where neither node nor probe meets anything
(``NOTHING``), it is the map's largest radiance: what a surface that returns all light could send.
"""

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from ..cubemap import CubeMap, face_directions, locate
from ..frames import normalise
from .cells import GAUSS, LEGENDRE, NODES, P, RadianceTree
from .scan import scan

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

START_LEVEL = 2
HIDDEN = 4.0
SAFETY = 4.0
FLOOR = 1e-4
MAX_DEPTH = 24
PROBES = 256
REACHED = 1e-4  # of the highest node: blocks whose neighbours are probed
BESIDE = np.array([[-1, -1, 1, 1, -0.3, 0.3, -0.3, 0.3], [-0.3, 0.3, -0.3, 0.3, -1, -1, 1, 1]])
NOTHING = 1e-6  # f cos times the sphere's solid angle: a lobe of this albedo, or of none
ROUNDING = 1e-11  # of the weights and of the sums, relative


@dataclasses.dataclass(frozen=True)
class Probes:
    """Directions where the lobe was tried: face (m,), piece (2, m) in t and s, the share of it that
    is passed (2, m), and f cos without its sign (m, 3).
    """

    face: IntArray
    piece: IntArray
    part: Float64Array
    value: Float64Array

    def joined(self, other: "Probes") -> "Probes":
        """These and more."""
        return Probes(
            np.concatenate([self.face, other.face]),
            np.concatenate([self.piece, other.piece], axis=1),
            np.concatenate([self.part, other.part], axis=1),
            np.concatenate([self.value, other.value]),
        )


_ANALYSIS = LEGENDRE * GAUSS * (np.arange(P)[:, None] + 0.5)


class PlainQuadrature:
    """Integrates ``material.eval`` times radiance over the sphere, one point at a time."""

    def __init__(
        self, material: Any, cube: CubeMap, tree: RadianceTree, tolerance: float, work: int
    ) -> None:
        self.material, self.cube, self.tree = material, cube, tree
        self.tolerance, self.work = tolerance, work
        self.peak = 0.0  # the most f cos that was seen at the point

    def _lobe(self, local: Float64Array, wo: Float64Array) -> Float64Array:
        """F cos, (..., 3)."""
        f = np.asarray(
            self.material.eval(local, np.broadcast_to(wo, local.shape)), dtype=np.float64
        )
        f = f[..., None] if f.ndim == local.ndim - 1 else f
        return np.asarray(np.broadcast_to(f, local.shape) * np.abs(local[..., 2:]))

    def _bounds(self, blocks: IntArray) -> tuple[Float64Array, Float64Array]:
        """Bounds in t and in s, each (n, 2), of blocks (n, 4): level, face, row, column.

        Levels beyond the tree's divide the pieces; there row and column count halves of the pieces'
        virtual binary grid, whose empty places have width 0.
        """
        edge, pieces = self.tree.edge, len(self.tree.texel)
        full = (pieces - 1).bit_length()
        level = blocks[:, :1]
        over = np.maximum(level - full, 0)
        out = []
        for axis in (2, 3):
            place = blocks[:, axis : axis + 1] + np.array([0, 1])
            slot, part = place >> over, place - ((place >> over) << over)
            low = slot * pieces >> np.minimum(level, full)
            high = np.minimum((slot + 1) * pieces >> np.minimum(level, full), pieces)
            low = np.minimum(low, pieces)
            out.append(edge[low] + (edge[high] - edge[low]) * part / (1 << over))
        return out[0], out[1]

    def _measure(
        self,
        blocks: IntArray,
        frame: Float64Array,
        wo: Float64Array,
    ) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
        """Values, errors, largest f cos at the nodes and integral of abs(L), (n, 3) each."""
        tree = self.tree
        t, s = self._bounds(blocks)
        hs, ht = 0.5 * (s[:, 1] - s[:, 0]), 0.5 * (t[:, 1] - t[:, 0])
        sn = np.repeat((s.mean(axis=1)[:, None] + hs[:, None] * NODES)[:, None, :], P, axis=1)
        tn = np.repeat((t.mean(axis=1)[:, None] + ht[:, None] * NODES)[:, :, None], P, axis=2)
        world = face_directions(blocks[:, 1, None, None], sn, tn)
        square = np.einsum("...i,...i->...", world, world)
        world /= np.sqrt(square)[..., None]
        local = world @ frame.T
        g = self._lobe(local, wo)
        flat = g.reshape(len(g), P * P, 3)
        level, face, row, col = blocks.T
        in_tree = level <= tree.level
        where = np.minimum(level, tree.level)
        index = 2 * ((1 << (2 * where)) - 1) + (face << (2 * where)) + (row << where) + col
        index = np.where(in_tree, index, 0)
        weights, mass, rough = tree.weights[index], tree.mass[index], tree.rough[index]
        many = np.zeros(len(blocks), dtype=bool)
        if not in_tree.all():
            out = ~in_tree
            area = (hs * ht)[out, None, None] * np.outer(GAUSS, GAUSS) * square[out] ** -1.5
            light = self.cube.lookup(world[out]) * area[..., None]
            weights[out] = light.reshape(-1, P * P, 3)
            mass[out] = np.abs(weights[out]).sum(axis=1)
            single = level[out] >= (len(tree.texel) - 1).bit_length()
            rough[out] = 0.0
            many[out] = ~single
        value = np.einsum("nkc,nkc->nc", weights, flat)
        error = self._error(g, mass, rough)
        peak = np.abs(flat).max(axis=1)
        crossing = (local[..., 2].min(axis=(1, 2)) < 0.0) & (local[..., 2].max(axis=(1, 2)) > 0.0)
        error = np.where((crossing | many)[:, None], mass * peak, error)
        return value, error, peak, mass

    def _beside(
        self, blocks: IntArray, peak: Float64Array, frame: Float64Array, wo: Float64Array
    ) -> Probes:
        """Probes half a block beyond the edges of the blocks (n, 4) that the lobe has reached."""
        reached = blocks[peak.max(axis=1) > REACHED * self.peak]
        t, s = self._bounds(reached)
        world = face_directions(
            reached[:, 1, None],
            s.mean(axis=1)[:, None] + np.diff(s) * BESIDE[0],
            t.mean(axis=1)[:, None] + np.diff(t) * BESIDE[1],
        ).reshape(-1, 3)
        return self._located(world, self._lobe(normalise(world) @ frame.T, wo))

    def _seen(self, blocks: IntArray, probes: Probes) -> Float64Array:
        """The most that probes see in each of the blocks (n, 4): (n, 3)."""
        face, piece, part, value = probes.face, probes.piece, probes.part, probes.value
        pieces, seen = len(self.tree.texel), np.zeros((len(blocks), 3))
        full = (pieces - 1).bit_length()
        for level in np.unique(blocks[:, 0]):
            coarse, over = min(int(level), full), max(int(level) - full, 0)
            slot = (((piece + 1) << coarse) - 1) // pieces
            place = (slot << over) + np.floor(part * (1 << over)).astype(np.int64)
            of = np.flatnonzero(blocks[:, 0] == level)
            # rows and columns by their rank among the blocks': whole places do not fit one key
            key, wanted, known = face, blocks[of, 1], np.ones(len(face), dtype=bool)
            for axis in range(2):
                ranks = np.unique(blocks[of, 2 + axis])
                rank = np.minimum(np.searchsorted(ranks, place[axis]), len(ranks) - 1)
                known &= ranks[rank] == place[axis]
                key = key * len(ranks) + rank
                wanted = wanted * len(ranks) + np.searchsorted(ranks, blocks[of, 2 + axis])
            order = np.argsort(wanted)
            at = np.minimum(np.searchsorted(wanted, key, sorter=order), len(of) - 1)
            block = of[order[at]]
            known &= wanted[order[at]] == key
            np.maximum.at(seen, block[known], value[known])
        return seen

    def _located(self, directions: Float64Array, values: Float64Array) -> Probes:
        """Probes of directions (m, 3) in the world."""
        face, s, t = locate(directions)
        edge = self.tree.edge
        x = np.stack([t, s])
        piece = np.clip(np.searchsorted(edge, x, side="right") - 1, 0, len(edge) - 2)
        part = (x - edge[piece]) / (edge[piece + 1] - edge[piece])
        return Probes(face, piece, np.clip(part, 0.0, 1.0 - 1e-12), np.abs(values))

    @staticmethod
    def _error(g: Float64Array, mass: Float64Array, rough: Float64Array) -> Float64Array:
        """As ``bounds.k_tail``, for many blocks and the channels at once."""
        top, mean, whole = (np.zeros((len(g), 3)) for _ in range(3))
        for c in (
            np.einsum("kj,nijc->nikc", _ANALYSIS, g),
            np.einsum("kj,njic->nikc", _ANALYSIS, g),
        ):
            last = np.abs(c[:, :, P - 2 :]).sum(axis=2).max(axis=1)
            before = np.abs(c[:, :, P - 4 : P - 2]).sum(axis=2).max(axis=1)
            ratio = np.minimum(1.0, last / np.where(before > 0.0, before, 1.0))
            ratio = np.where(before > 0.0, ratio, 1.0)
            square = np.einsum(
                "i,nikc,k->nc",
                0.5 * GAUSS,
                c[:, :, P - 2 :] ** 2,
                1.0 / (2.0 * np.arange(P - 2, P) + 1.0),
            )
            top += last * ratio
            mean += np.sqrt(square) * ratio
            whole += last * ratio**2
        return SAFETY * np.minimum(mass * top, rough * mean + mass * whole)

    def point(
        self,
        frame: Float64Array,
        wo: Float64Array,
        probe_xi: Float64Array,
    ) -> tuple[Float64Array, Float64Array, int]:
        """Radiance (3,), error (3,) and evaluations at one point.

        ``frame`` (3, 3): tangent, bitangent, normal; ``wo`` (3,) local; ``probe_xi`` (m, 2):
        uniform numbers for the material's own samples.
        """
        views = np.broadcast_to(wo, (len(probe_xi), 3))
        local = np.asarray(self.material.sample(probe_xi, views), dtype=np.float64)
        tried, seen = scan(lambda wi: self._lobe(wi, wo), wo, normalise(local))
        lit = seen.any(axis=-1)
        probes = self._located(tried[lit] @ frame, seen[lit])
        self.peak = float(np.abs(seen).max())
        grid = np.arange(1 << START_LEVEL)
        face, row, col = (
            a.reshape(-1) for a in np.meshgrid(np.arange(6), grid, grid, indexing="ij")
        )
        new = np.stack([np.full(len(face), START_LEVEL), face, row, col], axis=1)
        blocks, value, error, peak, mass = new[:0], *(np.zeros((0, 3)) for _ in range(4))
        used = len(tried)
        floor = FLOOR * float(self.tree.mass[:6].sum()) / (4.0 * np.pi)
        while True:
            first, measured = len(blocks), self._measure(new, frame, wo)
            used += P * P * len(new)
            blocks = np.concatenate([blocks, new])
            value, error, peak, mass = (
                np.concatenate(pair)
                for pair in zip((value, error, peak, mass), measured, strict=True)
            )
            self.peak = max(self.peak, float(peak.max()))
            beside = self._beside(new, measured[2], frame, wo)
            used += len(beside.face)
            for start, some in ((first, probes), (0, beside)):
                seen = self._seen(blocks[start:], some)
                hidden = seen > HIDDEN * peak[start:]
                larger = np.maximum(error[start:], mass[start:] * seen)
                error[start:] = np.where(hidden, larger, error[start:])
            probes = probes.joined(beside)
            target = self.tolerance * max(abs(float(value.sum())), floor)
            key = error.sum(axis=1)
            order = np.argsort(key, kind="stable")
            keep = int(np.searchsorted(np.cumsum(key[order]), 0.5 * target, side="right"))
            if key.sum() <= target or used > self.work:
                break
            split = np.zeros(len(blocks), dtype=bool)
            split[order[keep:]] = True
            split &= blocks[:, 0] < self.tree.level + MAX_DEPTH
            if not split.any():
                break
            old = blocks[split]
            blocks, value, error, peak, mass = (
                a[~split] for a in (blocks, value, error, peak, mass)
            )
            new = np.repeat(old, 4, axis=0)
            new[:, 0] += 1
            new[:, 2] = 2 * new[:, 2] + np.tile([0, 0, 1, 1], len(old))
            new[:, 3] = 2 * new[:, 3] + np.tile([0, 1, 0, 1], len(old))
            t, s = self._bounds(new)
            new = new[(t[:, 1] > t[:, 0]) & (s[:, 1] > s[:, 0])]
        total, missing = value.sum(axis=0), error.sum(axis=0)
        missing += ROUNDING * np.abs(total)
        if 4.0 * np.pi * self.peak < NOTHING:
            missing = np.maximum(missing, np.abs(self.cube.faces).max(axis=(0, 1, 2)))
        return total, missing, used
