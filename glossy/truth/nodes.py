"""Lobe times cosine at the P x P nodes of a block, and the sums over them.

The nodes are those of ``cells``, row by row. A block of the radiance tree has its weights there,
into which the radiance has gone; below the tree they are Gauss weights times the bilinear radiance.
"""

import math

import numpy as np

from .._jit import kernel
from .blocks import C0, FACE, R0
from .cells import (
    GAUSS,
    NODES,
    Float32Array,
    Float64Array,
    IntArray,
    P,
    k_radiance,
)

NODES_S, NODES_T = np.tile(NODES, P), np.repeat(NODES, P)  # of the P x P nodes, row by row
GAUSS_ST = np.tile(GAUSS, P) * np.repeat(GAUSS, P)


@kernel
def k_exp(x: float) -> float:
    """exp(x) for x in [-87, 0], relative error below 1e-12, in a form that loops can be vectorised.

    The series of exp(x/1024) to the eighth power, squared ten times.
    """
    y = x * (1.0 / 1024.0)
    e = 1.0 + y * (1.0 / 7.0) * (1.0 + y * (1.0 / 8.0))
    e = 1.0 + y * (1.0 / 5.0) * (1.0 + y * (1.0 / 6.0) * e)
    e = 1.0 + y * (1.0 + y * (1.0 / 2.0) * (1.0 + y * (1.0 / 3.0) * (1.0 + y * (1.0 / 4.0) * e)))
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e


@kernel
def k_lobe_at_nodes(
    sm: float,
    tm: float,
    hs: float,
    ht: float,
    basis: Float64Array,
    wo: Float64Array,
    lobe: Float64Array,
    v: Float64Array,
    w: Float64Array,
) -> None:
    """``brdf.k_lobe`` times the cosine at all nodes of a block: without F into v, times s into w.

    Its formulas again, with ``k_exp``, in one loop without branches that the compiler vectorises.
    """
    b00, b01, b02 = basis[0, 0], basis[0, 1], basis[0, 2]
    b10, b11, b12 = basis[1, 0], basis[1, 1], basis[1, 2]
    b20, b21, b22 = basis[2, 0], basis[2, 1], basis[2, 2]
    ox, oy, oz = wo[0], wo[1], wo[2]
    mx, my, norm, alpha = lobe[0], lobe[1], lobe[2], lobe[3]
    for k in range(P * P):
        s, t = sm + hs * NODES_S[k], tm + ht * NODES_T[k]
        n = 1.0 / math.sqrt(1.0 + s * s + t * t)
        x = (b00 + s * b10 + t * b20) * n
        y = (b01 + s * b11 + t * b21) * n
        z = (b02 + s * b12 + t * b22) * n
        hx, hy, hz = x + ox, y + oy, z + oz
        inverse = 1.0 / hz
        sx, sy = hx * inverse * mx, hy * inverse * my
        q = -(sx * sx + sy * sy)
        length2 = hx * hx + hy * hy + hz * hz
        length = math.sqrt(length2)
        tilt = length2 * inverse * inverse
        value = k_exp(max(q, -87.0)) * norm * tilt * tilt * z / (2.0 * length)
        value = value if (z > 0.0) & (q > -87.0) else 0.0
        dx, dy, dz = x - ox, y - oy, z - oz
        u = (dx * dx + dy * dy + dz * dz) / (4.0 + 2.0 * length)
        v[k] = value
        w[k] = (u * u) * (u * u) * u
    if alpha != 0.0:
        for k in range(P * P):
            if v[k] > 0.0:
                s, t = sm + hs * NODES_S[k], tm + ht * NODES_T[k]
                z = (b02 + s * b12 + t * b22) / math.sqrt(1.0 + s * s + t * t)
                v[k] /= math.sqrt(z * oz) if alpha == 0.5 else (z * oz) ** alpha
    for k in range(P * P):
        w[k] *= v[k]


@kernel
def k_nodes(
    block: IntArray,
    s0: float,
    s1: float,
    t0: float,
    t1: float,
    padded: Float32Array,
    texel: IntArray,
    weights: Float64Array,
    b: int,
    basis: Float64Array,
    wo: Float64Array,
    lobe: Float64Array,
    diffuse: bool,
    plain: Float64Array,
    schlick: Float64Array,
    v: Float64Array,
    w: Float64Array,
    value: Float64Array,
) -> None:
    """Sum of w_k g(x_k), (3,), over the nodes of a block; g without and with the weight in v, w.

    ``b`` is the block's row in ``weights``; below the tree (-1) the weights are Gauss weights times
    the bilinear radiance of the one piece.
    """
    sm, tm = 0.5 * (s0 + s1), 0.5 * (t0 + t1)
    hs, ht = 0.5 * (s1 - s0), 0.5 * (t1 - t0)
    if diffuse:
        for k in range(P * P):
            s, t = sm + hs * NODES_S[k], tm + ht * NODES_T[k]
            z = basis[0, 2] + s * basis[1, 2] + t * basis[2, 2]
            v[k] = max(z, 0.0) / math.sqrt(1.0 + s * s + t * t)
            w[k] = 0.0
    else:
        k_lobe_at_nodes(sm, tm, hs, ht, basis, wo, lobe, v, w)
    a0 = a1 = a2 = b0 = b1 = b2 = 0.0
    if b >= 0:
        for k in range(P * P):
            g, f = v[k], w[k]
            a0 += weights[b, k, 0] * g
            a1 += weights[b, k, 1] * g
            a2 += weights[b, k, 2] * g
            b0 += weights[b, k, 0] * f
            b1 += weights[b, k, 1] * f
            b2 += weights[b, k, 2] * f
    else:
        half = 0.5 * (padded.shape[1] - 2)
        first_row, first_col = texel[block[R0]], texel[block[C0]]
        for k in range(P * P):
            s, t = sm + hs * NODES_S[k], tm + ht * NODES_T[k]
            n = 1.0 / math.sqrt(1.0 + s * s + t * t)
            area = hs * ht * GAUSS_ST[k] * n * n * n
            k_radiance(
                padded,
                block[FACE],
                first_row,
                first_col,
                (s + 1.0) * half + 0.5 - first_col,
                (t + 1.0) * half + 0.5 - first_row,
                value,
            )
            g, f = v[k], w[k]
            a0 += area * value[0] * g
            a1 += area * value[1] * g
            a2 += area * value[2] * g
            b0 += area * value[0] * f
            b1 += area * value[1] * f
            b2 += area * value[2] * f
    value[0] = plain[0] * a0 + schlick[0] * b0
    value[1] = plain[1] * a1 + schlick[1] * b1
    value[2] = plain[2] * a2 + schlick[2] * b2
