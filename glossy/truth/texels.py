"""Deterministic quadrature of lobe times radiance over the texels, with an error bound.

Per surface point and lobe, the sphere is covered by blocks of the radiance tree (``cells``);
where the lobe is narrower than a leaf, by single pieces of bilinear radiance and their halves.
Every block carries a value and an error. With g = f cos and its bound from ``bounds``, a block
across which the lobe is too narrow for polynomials has ::

    value 0,               error <= max(g) integral abs(L)                                  (1)

and any other, g_P being the polynomial through the nodes, ::

    value sum w_k g(x_k),  error <= max|g - g_P| integral abs(L)                            (2)
                           error <= ||L J - q|| ||g - g_P|| + |integral q (g - g_P)|        (3)

whichever is less: in (3) the polynomial q follows the radiance, and Gauss nodes make the last term
tiny. How far g is from g_P is read from the decay of its Legendre coefficients, or known
beforehand where the horizon crosses the block. The block of the largest error is divided next,
until the errors' sum is below the tolerance or the work is spent; what remains is the bound.
"""

import math

import numpy as np

from .. import _check
from .._jit import kernel, row_kernel
from .._threads import in_rows
from ..brdf import PackedMaterial
from .blocks import (
    COL,
    FACE,
    KIND,
    MANY,
    PIECE,
    ROW,
    k_block_mass,
    k_children,
    k_cone,
    k_face_basis,
    k_interval,
)
from .bounds import FLAT, k_decay, k_kink, k_lobe_bound, k_tail
from .cells import (
    Float32Array,
    Float64Array,
    IntArray,
    P,
    RadianceTree,
    k_block_index,
)
from .nodes import k_nodes

FLOOR = (
    1e-4  # results below this share of (albedo x mean radiance) are held to it in absolute terms
)
DUST = 1e-6  # share of the tolerance below which a block is put aside for good
MAX_DEPTH = 44  # halvings of a piece: the coordinates' last bits
CHUNKS = 256  # sets of points that threads take one by one
ROOM = 1 << 22  # most blocks held for one point
BILINEAR = 2.0  # (3) on a piece: L J less a quadratic is at most this times rho^3 of it
ROUNDING = 1e-11  # of the weights and of the sums, relative


@kernel
def k_measure(
    block: IntArray,
    padded: Float32Array,
    edge: Float64Array,
    texel: IntArray,
    level: int,
    weights: Float64Array,
    mass: Float64Array,
    rough: Float64Array,
    frame: Float64Array,
    wo: Float64Array,
    lobe: Float64Array,
    diffuse: bool,
    plain: Float64Array,
    schlick: Float64Array,
    basis: Float64Array,
    v: Float64Array,
    w: Float64Array,
    value: Float64Array,
    error: Float64Array,
) -> int:
    """Value and error bound (3,) of a block, eqs. (1)-(3); returns the evaluations spent.

    The lobe's colour: f = plain v + schlick v w, v the lobe without F, w the Schlick weight.
    """
    value[:] = 0.0
    error[:] = 0.0
    s0, s1 = k_interval(edge, block, 1, level)
    t0, t1 = k_interval(edge, block, 0, level)
    k_face_basis(block[FACE], frame, lobe[4], basis)
    rho, lowest, highest = k_cone(s0, s1, t0, t1, basis, v)
    if highest <= 0.0:
        return 0
    cx, cy, cz = v[0], v[1], v[2]
    if diffuse:
        bound, rest, fresnel, width, near = min(cz + rho, 1.0), 1.0, 0.0, rho, 1.0 / rho
        power = 1.0
    else:
        bound, rest, fresnel, width, near = k_lobe_bound(cx, cy, cz, rho, wo, lobe)
        power = 1.0 - lobe[3]
        if bound == 0.0:
            return 0
    kind = block[KIND]
    b = -1
    if kind <= level:
        b = k_block_index(kind, block[FACE], block[ROW], block[COL])
        for ch in range(3):
            error[ch] = mass[b, ch]  # the integral of abs(L), until the last lines
    else:
        k_block_mass(block, padded, edge, texel, s0, s1, t0, t1, error)
    top, top_w = bound, bound * fresnel
    mean = mean_w = whole = whole_w = math.inf
    used = 0
    if width <= FLAT and kind != MANY:
        used = P * P
        k_nodes(
            block,
            s0,
            s1,
            t0,
            t1,
            padded,
            texel,
            weights,
            b,
            basis,
            wo,
            lobe,
            diffuse,
            plain,
            schlick,
            v,
            w,
            value,
        )
        if lowest < 0.0:
            top, mean, whole = k_kink(power, rest, rho, bound, width)
            top_w, mean_w, whole_w = top * fresnel, mean * fresnel, whole * fresnel
        else:
            decay = k_decay(near)
            top, mean, whole = k_tail(v, decay)
            if schlick[0] != 0.0 or schlick[1] != 0.0 or schlick[2] != 0.0:
                top_w, mean_w, whole_w = k_tail(w, decay)
            else:
                top_w = mean_w = whole_w = 0.0
    for ch in range(3):
        light, p, q = error[ch], plain[ch], abs(schlick[ch])
        loose = rough[b, ch] if b >= 0 else BILINEAR * rho * rho * rho * light
        error[ch] = light * (p * top + q * top_w)
        if used:
            fine = loose * (p * mean + q * mean_w) + light * (p * whole + q * whole_w)
            error[ch] = min(error[ch], fine)
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


@row_kernel
def _integrate(
    begin: int,
    end: int,
    frames: Float64Array,
    views: Float64Array,
    lobe: Float64Array,
    diffuse: bool,
    plain: Float64Array,
    schlick: Float64Array,
    padded: Float32Array,
    edge: Float64Array,
    texel: IntArray,
    level: int,
    weights: Float64Array,
    mass: Float64Array,
    rough: Float64Array,
    tolerance: float,
    floor: float,
    work: int,
    radiance: Float64Array,
    bound: Float64Array,
    evaluations: IntArray,
) -> None:
    # (K, 3, 3), (K, 3); adds to radiance and bound (K, 3), evaluations (K,)
    points = views.shape[0]
    chunks = min(points, CHUNKS)
    room = min(work // 8, ROOM) + 64
    for chunk in range(begin, end):
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
                    cost = k_measure(
                        children[i],
                        padded,
                        edge,
                        texel,
                        level,
                        weights,
                        mass,
                        rough,
                        frame,
                        wo,
                        lobe,
                        diffuse,
                        plain,
                        schlick,
                        basis,
                        v,
                        w,
                        value,
                        error,
                    )
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
                if in_heap == 0 or spent >= work or in_heap + 8 > room:
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
                bound[point, ch] += e + ROUNDING * abs(a)


def integrate(
    frames: Float64Array,
    views: Float64Array,
    material: PackedMaterial,
    tree: RadianceTree,
    tolerance: float,
    work: int,
    share: Float64Array | None = None,
) -> tuple[Float64Array, Float64Array, IntArray]:
    """Outgoing radiance (K, 3), its bound (K, 3) and the BSDF evaluations spent (K,).

    ``frames`` (K, 3, 3): tangent, bitangent, normal in world coordinates; ``views`` (K, 3): local
    directions to the viewer. Every lobe is integrated for itself to ``tolerance``, the sum over the
    channels of the error against that of the result; ``work`` caps its evaluations. ``share``
    (K, 3) scales the diffuse terms at each point.
    """
    count = len(views)
    radiance, bound = np.zeros((count, 3)), np.zeros((count, 3))
    evaluations = np.zeros(count, dtype=np.int64)
    level0 = tree.mass[:6].sum(axis=0) / (4.0 * math.pi)
    frames, views = _check.frozen(frames), _check.frozen(views)
    jobs = []
    for kd, side in zip(material.kd, (1.0, -1.0), strict=True):
        if np.any(kd > 0.0):
            flat = np.array([1.0, 1.0, 1.0, 0.0, side])
            jobs.append((flat, True, kd, np.zeros(3), kd * math.pi))
    last_diffuse = len(jobs)
    for lobe, ks, r0 in zip(material.lobes, material.ks, material.r0, strict=True):
        rest = ks * (1.0 - r0)
        if lobe[4] > 0.0:
            jobs.append((lobe, False, ks * r0, rest, ks))
        else:
            jobs.append((lobe, False, rest, -rest, ks))
    for done, (lobe, diffuse, plain, schlick, albedo) in enumerate(jobs, start=1):
        floor = FLOOR * float(albedo @ level0)
        in_rows(
            _integrate,
            min(len(views), CHUNKS),
            frames,
            views,
            _check.frozen(lobe),
            diffuse,
            _check.frozen(plain),
            _check.frozen(schlick),
            tree.padded,
            tree.edge,
            tree.texel,
            tree.level,
            tree.weights,
            tree.mass,
            tree.rough,
            tolerance,
            floor,
            work,
            radiance,
            bound,
            evaluations,
        )
        if share is not None and done == last_diffuse:
            radiance *= share
            bound *= share
    return radiance, bound, evaluations
