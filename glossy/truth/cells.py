"""Product-integration weights of a cube map's radiance, on a quadtree of blocks per face.

Radiance L is bilinear on the pieces between texel centres (and the half pieces at a face's edges);
what multiplies it, g(wi) = f cos, is smooth. So the radiance is integrated once and for all against
the Lagrange polynomials l_k of P x P Gauss-Legendre nodes x_k in every block B::

    w_k = integral_B L(s,t) l_k(s,t) J(s,t) ds dt,   J = (1 + s^2 + t^2)^(-3/2)         (1)
    integral_B L g domega  ~=  sum_k w_k g(x_k)                                         (2)

Equation (2) is exact for every g that is a polynomial of degree P - 1 in s and in t over the block,
whatever the radiance does there, a sun in a single texel included. A block's weights follow from
those of its four children without loss::

    w_k(parent) = sum over children, nodes j:  l_k(x_j(child)) w_j(child)               (3)

Level l has 2^l by 2^l blocks per face, block i spanning the pieces floor(i n / 2^l) to
floor((i+1) n / 2^l) of n along an axis; faces of any size are served. The leaves hold four to
eight pieces a side (more beyond N = 2048).

What equation (2) misses comes from the part of L that no low polynomial follows; its size, against
which the error of the nodes' polynomial counts, is kept per block::

    rough = sqrt(area) ||L J - q||,  q the projection of L J on degree 2 in s and in t     (4)
"""

import dataclasses
import math
import weakref

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import kernel, row_kernel
from .._threads import in_rows
from ..cubemap import CubeMap

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

P = 6  # nodes per axis in a block
NODES, GAUSS = np.polynomial.legendre.leggauss(P)  # on [-1, 1]
FINE_NODES, FINE_GAUSS = np.polynomial.legendre.leggauss(
    3
)  # per piece: exact to degree 5 > P - 1 + 1
LEAF_PIECES = 4
MAX_LEAF_LEVEL = 8
MIN_PIECES = 32
SMOOTH = 2  # degree of the smooth part of the radiance that eq. (4) leaves out
LEGENDRE = np.array([np.polynomial.legendre.Legendre.basis(k)(NODES) for k in range(P)])

_BARY = np.array([1.0 / np.prod([a - b for b in NODES if b != a]) for a in NODES])


@kernel
def k_lagrange(x: float, out: Float64Array) -> None:
    """The P Lagrange polynomials of the Gauss nodes at ``x`` in [-1, 1]."""
    for k in range(P):
        value = _BARY[k]
        for j in range(P):
            if j != k:
                value *= x - NODES[j]
        out[k] = value


@kernel
def k_jacobian(s: float, t: float) -> float:
    """Solid angle per area of the face's plane, J of eq. (1)."""
    square = 1.0 + s * s + t * t
    return 1.0 / (square * math.sqrt(square))


@kernel
def k_block_index(level: int, face: int, row: int, col: int) -> int:
    """Index of a block in the arrays of the tree, coarse levels first."""
    return 2 * ((1 << (2 * level)) - 1) + (face << (2 * level)) + (row << level) + col


@row_kernel
def _leaf_weights(
    begin: int,
    end: int,
    padded: Float32Array,
    edge: Float64Array,
    texel: IntArray,
    level: int,
    weights: Float64Array,
    mass: Float64Array,
    rough: Float64Array,
) -> None:
    # padded (6, N+2, N+2, 3); edge (n+1,); texel (n,); weights (B, P*P, 3); mass, rough (B, 3);
    # `rough` receives the integral of (L J)^2 ds dt
    side = 1 << level
    pieces = texel.shape[0]
    half = 0.5 * (padded.shape[1] - 2)
    for row_of_blocks in range(begin, end):
        face, i = row_of_blocks // side, row_of_blocks % side
        basis_t, line, value = np.empty(P), np.empty((P, 3)), np.empty(3)
        line_mass, line_square = np.empty(3), np.empty(3)
        basis_s = np.empty((2 * LEAF_PIECES << 4, 3, P))
        r0, r1 = i * pieces >> level, (i + 1) * pieces >> level
        for j in range(side):
            c0, c1 = j * pieces >> level, (j + 1) * pieces >> level
            b = k_block_index(level, face, i, j)
            weights[b] = 0.0
            mass[b] = 0.0
            rough[b] = 0.0
            s_mid, t_mid = 0.5 * (edge[c0] + edge[c1]), 0.5 * (edge[r0] + edge[r1])
            s_scale, t_scale = 2.0 / (edge[c1] - edge[c0]), 2.0 / (edge[r1] - edge[r0])
            for c in range(c0, c1):
                for gs in range(3):
                    s = (
                        0.5 * (edge[c] + edge[c + 1])
                        + 0.5 * (edge[c + 1] - edge[c]) * FINE_NODES[gs]
                    )
                    k_lagrange((s - s_mid) * s_scale, basis_s[c - c0, gs])
            for r in range(r0, r1):
                for gt in range(3):
                    ht = 0.5 * (edge[r + 1] - edge[r])
                    t = 0.5 * (edge[r] + edge[r + 1]) + ht * FINE_NODES[gt]
                    y = (t + 1.0) * half + 0.5 - texel[r]
                    line[:] = 0.0
                    line_mass[:] = 0.0
                    line_square[:] = 0.0
                    for c in range(c0, c1):
                        hs = 0.5 * (edge[c + 1] - edge[c])
                        for gs in range(3):
                            s = 0.5 * (edge[c] + edge[c + 1]) + hs * FINE_NODES[gs]
                            x = (s + 1.0) * half + 0.5 - texel[c]
                            jacobian = k_jacobian(s, t)
                            w = hs * FINE_GAUSS[gs] * jacobian
                            k_radiance(padded, face, texel[r], texel[c], x, y, value)
                            for ch in range(3):
                                amount = w * value[ch]
                                line_mass[ch] += abs(amount)
                                line_square[ch] += amount * value[ch] * jacobian
                                for k in range(P):
                                    line[k, ch] += amount * basis_s[c - c0, gs, k]
                    k_lagrange((t - t_mid) * t_scale, basis_t)
                    w = ht * FINE_GAUSS[gt]
                    for ch in range(3):
                        mass[b, ch] += w * line_mass[ch]
                        rough[b, ch] += w * line_square[ch]
                    for ky in range(P):
                        for kx in range(P):
                            for ch in range(3):
                                weights[b, ky * P + kx, ch] += w * basis_t[ky] * line[kx, ch]


@kernel
def k_radiance(
    padded: Float32Array, face: int, row: int, col: int, x: float, y: float, out: Float64Array
) -> None:
    """Bilinear radiance between four padded texels; x, y are the fractions across and down."""
    for ch in range(3):
        top = padded[face, row, col, ch] * (1.0 - x) + padded[face, row, col + 1, ch] * x
        low = padded[face, row + 1, col, ch] * (1.0 - x) + padded[face, row + 1, col + 1, ch] * x
        out[ch] = top * (1.0 - y) + low * y


@row_kernel
def _parent_weights(
    begin: int,
    end: int,
    edge: Float64Array,
    level: int,
    weights: Float64Array,
    mass: Float64Array,
    rough: Float64Array,
) -> None:
    # eq. (3): fills the blocks of `level` from those of `level + 1`
    side = 1 << level
    pieces = edge.shape[0] - 1
    for row_of_blocks in range(begin, end):
        face, i = row_of_blocks // side, row_of_blocks % side
        basis_s, basis_t = np.empty((2, P, P)), np.empty((2, P, P))
        line = np.empty((P, 3))
        _child_bases(
            edge,
            i * pieces >> level,
            (2 * i + 1) * pieces >> (level + 1),
            (i + 1) * pieces >> level,
            basis_t,
        )
        for j in range(side):
            _child_bases(
                edge,
                j * pieces >> level,
                (2 * j + 1) * pieces >> (level + 1),
                (j + 1) * pieces >> level,
                basis_s,
            )
            b = k_block_index(level, face, i, j)
            weights[b] = 0.0
            mass[b] = 0.0
            rough[b] = 0.0
            for v in range(2):
                for u in range(2):
                    child = k_block_index(level + 1, face, 2 * i + v, 2 * j + u)
                    for ch in range(3):
                        mass[b, ch] += mass[child, ch]
                        rough[b, ch] += rough[child, ch]
                    for ty in range(P):
                        line[:] = 0.0
                        for tx in range(P):
                            for k in range(P):
                                for ch in range(3):
                                    line[k, ch] += (
                                        basis_s[u, tx, k] * weights[child, ty * P + tx, ch]
                                    )
                        for ky in range(P):
                            for kx in range(P):
                                for ch in range(3):
                                    weights[b, ky * P + kx, ch] += basis_t[v, ty, ky] * line[kx, ch]


@kernel
def _child_bases(edge: Float64Array, first: int, middle: int, last: int, out: Float64Array) -> None:
    # out (2, P, P): Lagrange polynomials of the parent at the nodes of either child
    mid, scale = 0.5 * (edge[first] + edge[last]), 2.0 / (edge[last] - edge[first])
    for half in range(2):
        a = edge[first] if half == 0 else edge[middle]
        b = edge[middle] if half == 0 else edge[last]
        for j in range(P):
            x = 0.5 * (a + b) + 0.5 * (b - a) * NODES[j]
            k_lagrange((x - mid) * scale, out[half, j])


@row_kernel
def _roughness(
    begin: int, end: int, edge: Float64Array, level: int, weights: Float64Array, rough: Float64Array
) -> None:
    # eq. (4), in place of the integrals of (L J)^2
    pieces = edge.shape[0] - 1
    for row_of_blocks in range(begin, end):
        face, i = row_of_blocks >> level, row_of_blocks & ((1 << level) - 1)
        height = edge[(i + 1) * pieces >> level] - edge[i * pieces >> level]
        line = np.empty(P)
        for j in range(1 << level):
            area = height * (edge[(j + 1) * pieces >> level] - edge[j * pieces >> level])
            b = k_block_index(level, face, i, j)
            for ch in range(3):
                smooth = 0.0
                for k in range(SMOOTH + 1):
                    for y in range(P):
                        line[y] = 0.0
                        for x in range(P):
                            line[y] += LEGENDRE[k, x] * weights[b, y * P + x, ch]
                    for m in range(SMOOTH + 1):
                        moment = 0.0
                        for y in range(P):
                            moment += LEGENDRE[m, y] * line[y]
                        smooth += moment * moment * (2 * k + 1) * (2 * m + 1) / area
                left = max(rough[b, ch] - smooth, 1e-14 * rough[b, ch])
                rough[b, ch] = math.sqrt(area * left)


@dataclasses.dataclass(frozen=True)
class RadianceTree:
    """What the quadrature needs of a cube map.

    ``padded`` (6, N+2, N+2, 3); ``edge`` (n+1,): bounds of the pieces in [-1, 1]; ``texel`` (n,):
    padded index of a piece's first texel; ``level``: of the leaves; ``weights`` (B, P*P, 3):
    eq. (1), blocks of all levels, coarse first; ``mass`` (B, 3): integral of abs(L) over the block;
    ``rough`` (B, 3): eq. (4).
    """

    padded: Float32Array
    edge: Float64Array
    texel: IntArray
    level: int
    weights: Float64Array
    mass: Float64Array
    rough: Float64Array


def _pieces(size: int) -> tuple[Float64Array, IntArray]:
    """Bounds of the pieces along an axis and the padded texel each starts from."""
    centres = (np.arange(size) + 0.5) * (2.0 / size) - 1.0
    bounds = np.concatenate([[-1.0], centres, [1.0]])
    split = math.ceil(MIN_PIECES / (size + 1))
    steps = np.arange(split) / split
    edge = (bounds[:-1, None] + np.diff(bounds)[:, None] * steps).reshape(-1)
    return np.append(edge, 1.0), np.repeat(np.arange(size + 1), split)


_finite: "weakref.WeakSet[CubeMap]" = weakref.WeakSet()


def check_finite(cube: CubeMap) -> None:
    """Refuse a map read with ``nonfinite="keep"`` that holds NaN or infinities."""
    if cube not in _finite:
        bad = cube.faces.size - int(np.count_nonzero(np.isfinite(cube.faces)))
        if bad:
            raise _check.fail("cube", "must be finite", f"{bad} NaN or infinite values")
        _finite.add(cube)


def build_tree(cube: CubeMap) -> RadianceTree:
    """The weights of all blocks of a cube map, eqs. (1) and (3).

    Raises
    ------
    ValueError
        If the radiance is not finite (a map read with ``nonfinite="keep"``).
    """
    check_finite(cube)
    edge, texel = _pieces(cube.size)
    level = min(int(math.log2(len(texel) / LEAF_PIECES)), MAX_LEAF_LEVEL)
    blocks = 2 * ((1 << (2 * level + 2)) - 1)
    weights = np.empty((blocks, P * P, 3))
    mass, rough = np.empty((blocks, 3)), np.empty((blocks, 3))
    edge, texel = _check.frozen(edge), _check.frozen(texel)
    in_rows(_leaf_weights, 6 << level, cube.padded, edge, texel, level, weights, mass, rough)
    for parent in range(level - 1, -1, -1):
        in_rows(_parent_weights, 6 << parent, edge, parent, weights, mass, rough)
    for any_level in range(level + 1):
        in_rows(_roughness, 6 << any_level, edge, any_level, weights, rough)
    weights, mass, rough = _check.frozen(weights), _check.frozen(mass), _check.frozen(rough)
    return RadianceTree(cube.padded, edge, texel, level, weights, mass, rough)


_trees: "weakref.WeakKeyDictionary[CubeMap, RadianceTree]" = weakref.WeakKeyDictionary()


def radiance_tree(cube: CubeMap) -> RadianceTree:
    """The tree of a cube map, built on first use and kept as long as the map lives."""
    tree = _trees.get(cube)
    if tree is None:
        tree = _trees[cube] = build_tree(cube)
    return tree
