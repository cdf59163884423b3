"""Deterministic quadrature of lobe times radiance over the texels, with an error bound.

Per surface point and lobe, the sphere is covered by blocks of the radiance tree (``cells``); where
the lobe is narrower than a leaf, by single pieces of bilinear radiance and their halves. Every block
carries an error: ::

    not resolved:  value 0,              error <= max(g) integral_B abs(L)                     (1)
    resolved:      value sum w_k g(x_k), error <= max|g - g_P| integral_B abs(L)               (2)

with g = f cos, its bound from ``bounds``, and g_P the polynomial through the nodes, how far it is from
g being read from the decay of its Legendre coefficients. The block of the largest error is divided
next, until the sum of the errors is below the tolerance or the work is spent; the sum of the
errors that remain is the bound that is reported.
"""

import math

import numba
import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import kernel, parallel_kernel
from ..brdf import PackedMaterial, k_lobe
from .bounds import k_lobe_bound, k_tail
from .cells import (
    GAUSS,
    NODES,
    Float32Array,
    Float64Array,
    IntArray,
    P,
    RadianceTree,
    k_block_index,
    k_jacobian,
    k_radiance,
)

FLOOR = 1e-4  # results below this share of (albedo x mean radiance) are held to it in absolute terms
DUST = 1e-6  # share of the tolerance below which a block is put aside for good
MAX_DEPTH = 44  # halvings of a piece: the coordinates' last bits
KINK = 0.2  # interpolation error of max(0, x) on [-1, 1], with reserve
CHUNKS = 256

# Columns of a block's row: face; level of the tree, or MANY, or PIECE + depth; then for a tree block
# row and column; for pieces their range; for a part of a piece its place in the binary grid.
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
    # bounds in s (axis 1) or t (axis 0) of a block
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
def k_piece_mass(padded: Float32Array, edge: Float64Array, texel: IntArray, face: int, r: int, c: int,
                 s0: float, s1: float, t0: float, t1: float, out: Float64Array) -> None:
    # adds a bound of the integral of abs(L) over a part of a piece
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
def k_measure(block: IntArray, padded: Float32Array, edge: Float64Array, texel: IntArray, level: int,
              weights: Float64Array, mass: Float64Array, frame: Float64Array, wo: Float64Array,
              lobe: Float64Array, diffuse: bool, plain: Float64Array, schlick: Float64Array,
              basis: Float64Array, v: Float64Array, w: Float64Array, value: Float64Array,
              error: Float64Array) -> int:
    """Value and error bound (3,) of a block, eqs. (1)-(2); returns the evaluations spent.

    The lobe's colour: f = plain v + schlick v w, with v the lobe without F and w the Schlick weight.
    """
    value[:] = 0.0
    error[:] = 0.0
    face, kind = block[FACE], block[KIND]
    s0, s1 = k_interval(edge, block, 1, level)
    t0, t1 = k_interval(edge, block, 0, level)
    k_face_basis(face, frame, lobe[4], basis)

    # the block as a cone, and the exact signs of wi.n at its corners
    sm, tm = 0.5 * (s0 + s1), 0.5 * (t0 + t1)
    norm = 1.0 / math.sqrt(1.0 + sm * sm + tm * tm)
    rho2, lowest, highest = 0.0, math.inf, -math.inf
    for i in range(4):
        s, t = (s1 if i & 1 else s0), (t1 if i & 2 else t0)
        n = 1.0 / math.sqrt(1.0 + s * s + t * t)
        da, ds, dt = n - norm, s * n - sm * norm, t * n - tm * norm
        rho2 = max(rho2, da * da + ds * ds + dt * dt)
        z = basis[0, 2] + s * basis[1, 2] + t * basis[2, 2]
        lowest, highest = min(lowest, z), max(highest, z)
    if highest <= 0.0:
        return 0
    crossing = lowest < 0.0
    rho = math.sqrt(rho2)
    cx = (basis[0, 0] + sm * basis[1, 0] + tm * basis[2, 0]) * norm
    cy = (basis[0, 1] + sm * basis[1, 1] + tm * basis[2, 1]) * norm
    cz = (basis[0, 2] + sm * basis[1, 2] + tm * basis[2, 2]) * norm
    if diffuse:
        bound, rest, fresnel, followed, power = min(cz + rho, 1.0), 1.0, 0.0, True, 1.0
    else:
        bound, rest, fresnel, followed = k_lobe_bound(cx, cy, cz, rho, wo, lobe)
        power = 1.0 - lobe[3]
        if bound == 0.0:
            return 0

    # integral of abs(L), here in `error`
    if kind <= level:
        b = k_block_index(kind, face, block[ROW], block[COL])
        for ch in range(3):
            error[ch] = mass[b, ch]
    elif kind == MANY:
        b = -1
        for r in range(block[R0], block[R1]):
            for c in range(block[C0], block[C1]):
                k_piece_mass(padded, edge, texel, face, r, c, edge[c], edge[c + 1], edge[r],
                             edge[r + 1], error)
    else:
        b = -1
        k_piece_mass(padded, edge, texel, face, block[R0], block[C0], s0, s1, t0, t1, error)

    used = 0
    gap, gap_w = bound, bound * fresnel
    if followed and kind != MANY:
        used = P * P
        hs, ht = 0.5 * (s1 - s0), 0.5 * (t1 - t0)
        half = 0.5 * (padded.shape[1] - 2)
        light = np.empty(3)
        coloured = schlick[0] != 0.0 or schlick[1] != 0.0 or schlick[2] != 0.0
        a0 = a1 = a2 = b0 = b1 = b2 = 0.0
        k = 0
        for j in range(P):
            t = tm + ht * NODES[j]
            for i in range(P):
                s = sm + hs * NODES[i]
                n = 1.0 / math.sqrt(1.0 + s * s + t * t)
                z = (basis[0, 2] + s * basis[1, 2] + t * basis[2, 2]) * n
                g = f = 0.0
                if z > 0.0:
                    if diffuse:
                        g = z
                    else:
                        x = (basis[0, 0] + s * basis[1, 0] + t * basis[2, 0]) * n
                        y = (basis[0, 1] + s * basis[1, 1] + t * basis[2, 1]) * n
                        g, f = k_lobe(x, y, z, wo[0], wo[1], wo[2], lobe)
                        g *= z
                        f *= g
                v[k], w[k] = g, f
                if b >= 0:
                    w0, w1, w2 = weights[b, k, 0], weights[b, k, 1], weights[b, k, 2]
                else:
                    area = hs * ht * GAUSS[i] * GAUSS[j] * n * n * n
                    k_radiance(padded, face, texel[block[R0]], texel[block[C0]],
                               (s + 1.0) * half + 0.5 - texel[block[C0]],
                               (t + 1.0) * half + 0.5 - texel[block[R0]], light)
                    w0, w1, w2 = area * light[0], area * light[1], area * light[2]
                a0 += w0 * g
                a1 += w1 * g
                a2 += w2 * g
                b0 += w0 * f
                b1 += w1 * f
                b2 += w2 * f
                k += 1
        if crossing:
            share = KINK * power + (1.0 - power)
            gap = min(gap, k_tail(v, False) + share * rest * rho**power)
            gap = min(gap, bound)
            gap_w = gap * fresnel
        else:
            analytic = power == 1.0 or power == 0.0 or cz > 2.0 * rho
            gap = min(gap, k_tail(v, analytic))
            if coloured:
                gap_w = min(gap_w, k_tail(w, analytic))
        value[0] = plain[0] * a0 + schlick[0] * b0
        value[1] = plain[1] * a1 + schlick[1] * b1
        value[2] = plain[2] * a2 + schlick[2] * b2
    for ch in range(3):
        error[ch] *= plain[ch] * gap + abs(schlick[ch]) * gap_w
    return used


@kernel
def k_push(keys: Float64Array, slots: IntArray, n: int, key: float, slot: int) -> None:
    """Insert into a binary heap of ``n`` entries, largest key first."""
    i = n
    while i > 0:
        parent = (i - 1) >> 1
        if keys[parent] >= key:
            break
        keys[i], slots[i] = keys[parent], slots[parent]
        i = parent
    keys[i], slots[i] = key, slot


@kernel
def k_pop(keys: Float64Array, slots: IntArray, n: int) -> int:
    """Remove the largest of ``n`` entries; returns its slot."""
    first = slots[0]
    key, slot = keys[n - 1], slots[n - 1]
    last, i = n - 1, 0
    while True:
        child = 2 * i + 1
        if child >= last:
            break
        if child + 1 < last and keys[child + 1] > keys[child]:
            child += 1
        if keys[child] <= key:
            break
        keys[i], slots[i] = keys[child], slots[child]
        i = child
    keys[i], slots[i] = key, slot
    return int(first)


@parallel_kernel
def _integrate(frames: Float64Array, views: Float64Array, lobe: Float64Array, diffuse: bool,
               plain: Float64Array, schlick: Float64Array, padded: Float32Array, edge: Float64Array,
               texel: IntArray, level: int, weights: Float64Array, mass: Float64Array,
               tolerance: float, floor: float, work: int, radiance: Float64Array,
               bound: Float64Array, evaluations: IntArray) -> None:
    # (K, 3, 3), (K, 3); adds to radiance and bound (K, 3), evaluations (K,)
    points = views.shape[0]
    chunks = min(points, CHUNKS)
    room = work // 8 + 64
    for chunk in numba.prange(chunks):
        blocks = np.empty((room, 8), np.int64)
        values, errors = np.empty((room, 3)), np.empty((room, 3))
        keys, heap, free = np.empty(room), np.empty(room, np.int64), np.empty(room, np.int64)
        basis, v, w = np.empty((3, 3)), np.empty(P * P), np.empty(P * P)
        children, value, error = np.empty((6, 8), np.int64), np.empty(3), np.empty(3)
        done, done_error = np.empty(3), np.empty(3)
        for point in range(chunk, points, chunks):
            wo, frame = views[point], frames[point]
            if not wo[2] > 0.0:
                continue
            used_slots, n_free, in_heap, spent, steps = 0, 0, 0, 0, 0
            done[:] = 0.0
            done_error[:] = 0.0
            total, missing = 0.0, math.inf
            for face in range(6):
                children[face] = 0
                children[face, FACE] = face
            n = 6
            while True:
                for i in range(n):
                    cost = k_measure(children[i], padded, edge, texel, level, weights, mass, frame,
                                     wo, lobe, diffuse, plain, schlick, basis, v, w, value, error)
                    spent += cost + 1
                    evaluations[point] += cost
                    key = error[0] + error[1] + error[2]
                    total += value[0] + value[1] + value[2]
                    missing += key
                    depth = children[i, KIND] - PIECE
                    if key <= DUST * tolerance * floor or depth >= MAX_DEPTH:
                        for ch in range(3):
                            done[ch] += value[ch]
                            done_error[ch] += error[ch]
                        continue
                    if n_free > 0:
                        n_free -= 1
                        slot = free[n_free]
                    else:
                        slot = used_slots
                        used_slots += 1
                    blocks[slot] = children[i]
                    for ch in range(3):
                        values[slot, ch], errors[slot, ch] = value[ch], error[ch]
                    k_push(keys, heap, in_heap, key, slot)
                    in_heap += 1
                # running sums drift: now and then they are taken afresh
                if steps % 64 == 0 or missing <= tolerance * max(abs(total), floor):
                    total = done[0] + done[1] + done[2]
                    missing = done_error[0] + done_error[1] + done_error[2]
                    for i in range(in_heap):
                        slot = heap[i]
                        for ch in range(3):
                            total += values[slot, ch]
                            missing += errors[slot, ch]
                    if missing <= tolerance * max(abs(total), floor):
                        break
                if in_heap == 0 or spent > work or in_heap + 8 > room:
                    break
                steps += 1
                slot = k_pop(keys, heap, in_heap)
                in_heap -= 1
                for ch in range(3):
                    total -= values[slot, ch]
                    missing -= errors[slot, ch]
                free[n_free] = slot
                n_free += 1
                n = k_children(blocks[slot], level, texel.shape[0], children)
            for ch in range(3):
                a, e = done[ch], done_error[ch]
                for i in range(in_heap):
                    a += values[heap[i], ch]
                    e += errors[heap[i], ch]
                radiance[point, ch] += a
                bound[point, ch] += e


def integrate(frames: Float64Array, views: Float64Array, material: PackedMaterial,
              tree: RadianceTree, tolerance: float, work: int,
              ) -> tuple[Float64Array, Float64Array, IntArray]:
    """Outgoing radiance (K, 3), its bound (K, 3) and the BSDF evaluations spent (K,).

    ``frames`` (K, 3, 3): tangent, bitangent, normal in world coordinates; ``views`` (K, 3): local
    directions to the viewer. Every lobe is integrated for itself to ``tolerance``, the sum over the
    channels of the error against that of the result; ``work`` caps its evaluations.
    """
    count = len(views)
    radiance, bound = np.zeros((count, 3)), np.zeros((count, 3))
    evaluations = np.zeros(count, dtype=np.int64)
    level0 = tree.mass[:6].sum(axis=0) / (4.0 * math.pi)
    frames, views = _check.frozen(frames), _check.frozen(views)
    jobs = []
    if np.any(material.kd > 0.0):
        flat = np.array([1.0, 1.0, 1.0, 0.0, 1.0])
        jobs.append((flat, True, material.kd, np.zeros(3), material.kd * math.pi))
    for lobe, ks, r0 in zip(material.lobes, material.ks, material.r0, strict=True):
        rest = ks * (1.0 - r0)
        if lobe[4] > 0.0:
            jobs.append((lobe, False, ks * r0, rest, ks))
        else:
            jobs.append((lobe, False, rest, -rest, ks))
    for lobe, diffuse, plain, schlick, albedo in jobs:
        floor = FLOOR * float(albedo @ level0)
        _integrate(frames, views, _check.frozen(lobe), diffuse, _check.frozen(plain),
                   _check.frozen(schlick), tree.padded, tree.edge, tree.texel, tree.level,
                   tree.weights, tree.mass, tolerance, floor, work, radiance, bound, evaluations)
    return radiance, bound, evaluations
