"""Blocks of directions: which part of a face each is, what it is divided into, its cone, its light.

A block is a row of eight integers. Down to the leaves it is a block of the radiance tree; a leaf is
divided into ranges of pieces (``MANY``) until single pieces are left (``PIECE``), on which the
radiance is bilinear; a piece is halved both ways as often as the lobe asks for.
"""

import math

from .._jit import kernel
from .cells import (
    Float32Array,
    Float64Array,
    IntArray,
    k_jacobian,
)

# Columns of a block's row: face; level of the tree, or MANY, or PIECE + number of halvings; row and
# column in the tree or among the halves of a piece; rows R0 to R1 and columns C0 to C1 of pieces.
FACE, KIND, ROW, COL, R0, R1, C0, C1 = range(8)
MANY, PIECE = 100, 101


@kernel
def k_face_basis(face: int, frame: Float64Array, side: float, out: Float64Array) -> None:
    """Local coordinates of a face's major axis, s and t axes: rows of ``out`` (3, 3).

    ``frame`` holds tangent, bitangent, normal; ``side`` -1 mirrors in the surface.
    """
    major = face >> 1
    sign = 1.0 if face % 2 == 0 else -1.0
    for k in range(3):
        x, y, z = frame[k, 0], frame[k, 1], frame[k, 2]
        flip = side if k == 2 else 1.0
        if major == 0:
            a, s, t = sign * x, -sign * z, -y
        elif major == 1:
            a, s, t = sign * y, x, sign * z
        else:
            a, s, t = sign * z, sign * x, -y
        out[0, k], out[1, k], out[2, k] = a * flip, s * flip, t * flip


@kernel
def k_interval(edge: Float64Array, block: IntArray, axis: int, level: int) -> tuple[float, float]:
    """Bounds of a block in s (axis 1) or t (axis 0)."""
    kind = block[KIND]
    if kind <= level:
        pieces = edge.shape[0] - 1
        i = block[ROW + axis]
        return edge[i * pieces >> kind], edge[(i + 1) * pieces >> kind]
    first = block[R0 + 2 * axis]
    if kind == MANY:
        return edge[first], edge[block[R1 + 2 * axis]]
    low, width = edge[first], edge[first + 1] - edge[first]
    share = width / (1 << (kind - PIECE))
    i = block[ROW + axis]
    return low + share * i, low + share * (i + 1)


@kernel
def k_children(block: IntArray, level: int, pieces: int, out: IntArray) -> int:
    """Rows of the children of a block; returns their number."""
    kind = block[KIND]
    n = 0
    if kind < level:
        for v in range(2):
            for u in range(2):
                out[n, FACE], out[n, KIND] = block[FACE], kind + 1
                out[n, ROW], out[n, COL] = 2 * block[ROW] + v, 2 * block[COL] + u
                n += 1
        return n
    if kind >= PIECE:
        for v in range(2):
            for u in range(2):
                out[n] = block
                out[n, KIND] = kind + 1
                out[n, ROW], out[n, COL] = 2 * block[ROW] + v, 2 * block[COL] + u
                n += 1
        return n
    if kind == level:
        r0, r1 = block[ROW] * pieces >> kind, (block[ROW] + 1) * pieces >> kind
        c0, c1 = block[COL] * pieces >> kind, (block[COL] + 1) * pieces >> kind
    else:
        r0, r1, c0, c1 = block[R0], block[R1], block[C0], block[C1]
    r_mid, c_mid = (r0 + r1 + 1) // 2, (c0 + c1 + 1) // 2
    for v in range(2):
        for u in range(2):
            a, b = (r0, r_mid) if v == 0 else (r_mid, r1)
            c, d = (c0, c_mid) if u == 0 else (c_mid, c1)
            if a < b and c < d:
                out[n, FACE] = block[FACE]
                out[n, KIND] = PIECE if b - a == 1 and d - c == 1 else MANY
                out[n, ROW] = out[n, COL] = 0
                out[n, R0], out[n, R1], out[n, C0], out[n, C1] = a, b, c, d
                n += 1
    return n


@kernel
def k_piece_mass(
    padded: Float32Array,
    edge: Float64Array,
    texel: IntArray,
    face: int,
    r: int,
    c: int,
    s0: float,
    s1: float,
    t0: float,
    t1: float,
    out: Float64Array,
) -> None:
    """Add a bound of the integral of abs(L) over a part of piece (r, c)."""
    half = 0.5 * (padded.shape[1] - 2)
    near_s = max(0.0, max(s0, -s1))
    near_t = max(0.0, max(t0, -t1))
    area = (s1 - s0) * (t1 - t0) * k_jacobian(near_s, near_t)
    x = 0.5 * (s0 + s1 + 2.0) * half + 0.5 - texel[c]
    y = 0.5 * (t0 + t1 + 2.0) * half + 0.5 - texel[r]
    for ch in range(3):
        top = abs(padded[face, texel[r], texel[c], ch]) * (1.0 - x)
        top += abs(padded[face, texel[r], texel[c] + 1, ch]) * x
        low = abs(padded[face, texel[r] + 1, texel[c], ch]) * (1.0 - x)
        low += abs(padded[face, texel[r] + 1, texel[c] + 1, ch]) * x
        out[ch] += area * (top * (1.0 - y) + low * y)


@kernel
def k_block_mass(
    block: IntArray,
    padded: Float32Array,
    edge: Float64Array,
    texel: IntArray,
    s0: float,
    s1: float,
    t0: float,
    t1: float,
    out: Float64Array,
) -> None:
    """A bound of the integral of abs(L) over a block below the tree, (3,)."""
    out[:] = 0.0
    if block[KIND] == MANY:
        for r in range(block[R0], block[R1]):
            for c in range(block[C0], block[C1]):
                k_piece_mass(
                    padded,
                    edge,
                    texel,
                    block[FACE],
                    r,
                    c,
                    edge[c],
                    edge[c + 1],
                    edge[r],
                    edge[r + 1],
                    out,
                )
    else:
        k_piece_mass(padded, edge, texel, block[FACE], block[R0], block[C0], s0, s1, t0, t1, out)


@kernel
def k_cone(
    s0: float,
    s1: float,
    t0: float,
    t1: float,
    basis: Float64Array,
    centre: Float64Array,
) -> tuple[float, float, float]:
    """Radius of the ball about the block's central direction, and least and greatest sign of wi.n.

    The radius is a chord between unit vectors. ``centre`` (3,) receives the central direction; the
    last two are wi.n at the corners times a positive factor, so that their signs are exact.
    """
    sm, tm = 0.5 * (s0 + s1), 0.5 * (t0 + t1)
    norm = 1.0 / math.sqrt(1.0 + sm * sm + tm * tm)
    for k in range(3):
        centre[k] = (basis[0, k] + sm * basis[1, k] + tm * basis[2, k]) * norm
    rho2, lowest, highest = 0.0, math.inf, -math.inf
    for i in range(4):
        s, t = (s1 if i & 1 else s0), (t1 if i & 2 else t0)
        n = 1.0 / math.sqrt(1.0 + s * s + t * t)
        da, ds, dt = n - norm, s * n - sm * norm, t * n - tm * norm
        rho2 = max(rho2, da * da + ds * ds + dt * dt)
        z = basis[0, 2] + s * basis[1, 2] + t * basis[2, 2]
        lowest, highest = min(lowest, z), max(highest, z)
    return math.sqrt(rho2), lowest, highest
