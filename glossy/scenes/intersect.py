"""Rays against the analytic shapes: every ray against every shape, in float64.

A ray o + t d, with d of unit length in the world, is taken into the unit shape's coordinates, where
t stays what it is. Sphere: with m the ray's point nearest to the centre, at t = -b/a ::

    a = d.d,  b = o.d,  m = o - (b/a) d,   t = -b/a -+ sqrt((1 - m.m) / a)                 (1)

Torus of ring radius 1 and tube r, with unit u = d / |d| and s the distance from m ::

    f(s) = s^4 + 2 (k - 2 (ux^2 + uz^2)) s^2 - 8 (mx ux + mz uz) s + k^2 - 4 (mx^2 + mz^2),
    k = m.m + 1 - r^2                                                                      (2)

a quartic without its cubic term because m.u = 0. The zeros of f' (a depressed cubic, in closed
form) cut the line into monotone pieces; the first piece across which f changes sign holds the hit,
which bisection with Newton steps finds to rounding.
"""

import math

import numpy as np
import numpy.typing as npt

from .._jit import Scalar, kernel, row_kernel
from .shapes import BOX, MESH, RECTANGLE, SPHERE, TORUS

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]
Triple = tuple[Scalar, Scalar, Scalar]


@kernel
def _affine(m: Float64Array, v: Triple, w: Scalar) -> Triple:
    """A point (w = 1) or a vector (w = 0) through an affine map (3, 4)."""
    return (
        m[0, 0] * v[0] + m[0, 1] * v[1] + m[0, 2] * v[2] + w * m[0, 3],
        m[1, 0] * v[0] + m[1, 1] * v[1] + m[1, 2] * v[2] + w * m[1, 3],
        m[2, 0] * v[0] + m[2, 1] * v[1] + m[2, 2] * v[2] + w * m[2, 3],
    )


@kernel
def _first(low: Scalar, high: Scalar, near: Scalar, far: Scalar) -> Scalar:
    """The lower of two roots that lies in (near, far), inf if neither does."""
    if near < low < far:
        return low
    return high if near < high < far else math.inf


@kernel
def _critical(p: Scalar, q: Scalar) -> tuple[int, Triple]:
    """Real roots of s^3 + p s + q, ascending, and their number."""
    half = 0.5 * q
    under = half * half + p * p * p / 27.0
    if under > 0.0:
        root = math.sqrt(under)
        a = -half - root if half > 0.0 else -half + root
        u = math.copysign(abs(a) ** (1.0 / 3.0), a)
        return 1, (u - p / (3.0 * u), 0.0, 0.0)
    r = math.sqrt(max(-p / 3.0, 0.0))
    cosine = min(max(-half / max(r * r * r, 1e-300), -1.0), 1.0)
    angle = math.acos(cosine) / 3.0
    third = 2.0 * math.pi / 3.0
    return 3, (
        2.0 * r * math.cos(angle + third),
        2.0 * r * math.cos(angle - third),
        2.0 * r * math.cos(angle),
    )


@kernel
def _crossing(c2: Scalar, c1: Scalar, c0: Scalar, low: Scalar, high: Scalar) -> Scalar:
    """The root of a monotone piece of f = s^4 + c2 s^2 + c1 s + c0 that changes sign in it."""
    rising = ((high * high + c2) * high + c1) * high + c0 > 0.0
    s = 0.5 * (low + high)
    for _ in range(80):
        f = ((s * s + c2) * s + c1) * s + c0
        if (f > 0.0) == rising:
            high = s
        else:
            low = s
        slope = (4.0 * s * s + 2.0 * c2) * s + c1
        step = s - f / slope
        if not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - s) <= 4e-16 * abs(s) + 1e-300:
            return step
        s = step
    return s


@kernel
def _torus(o: Triple, d: Triple, ratio: Scalar, near: Scalar, far: Scalar) -> Scalar:
    """Eq. (2)."""
    a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    shift = (o[0] * d[0] + o[1] * d[1] + o[2] * d[2]) / a
    mx, my, mz = o[0] - shift * d[0], o[1] - shift * d[1], o[2] - shift * d[2]
    mm = mx * mx + my * my + mz * mz
    reach = (1.0 + ratio) * (1.0 + ratio) - mm
    if reach <= 0.0:
        return math.inf
    length = math.sqrt(a)
    ux, uz = d[0] / length, d[2] / length
    low = max(-math.sqrt(reach), (near + shift) * length)
    end = math.sqrt(reach)
    k = mm + 1.0 - ratio * ratio
    c2 = 2.0 * k - 4.0 * (ux * ux + uz * uz)
    c1 = -8.0 * (mx * ux + mz * uz)
    c0 = k * k - 4.0 * (mx * mx + mz * mz)
    count, roots = _critical(0.5 * c2, 0.25 * c1)
    before = ((low * low + c2) * low + c1) * low + c0
    for j in range(count + 1):
        high = end
        if j < count:
            high = min(roots[j], end)
        if high <= low:
            continue
        after = ((high * high + c2) * high + c1) * high + c0
        if (before > 0.0) != (after > 0.0):
            t = _crossing(c2, c1, c0, low, high) / length - shift
            return t if t < far else math.inf
        low, before = high, after
    return math.inf


@kernel
def _distance(
    kind: Scalar, o: Triple, d: Triple, ratio: Scalar, near: Scalar, far: Scalar
) -> Scalar:
    """The first t in (near, far) at which a local ray meets a unit shape, inf if there is none."""
    if kind == RECTANGLE:
        t = -o[2] / d[2]
        if not near < t < far:
            return math.inf
        inside = abs(o[0] + t * d[0]) <= 1.0 and abs(o[1] + t * d[1]) <= 1.0
        return t if inside else math.inf
    if kind == BOX:
        enter, leave = -math.inf, math.inf
        for i in range(3):
            if d[i] == 0.0:
                if abs(o[i]) > 1.0:
                    return math.inf
                continue
            t0, t1 = (-1.0 - o[i]) / d[i], (1.0 - o[i]) / d[i]
            enter, leave = max(enter, min(t0, t1)), min(leave, max(t0, t1))
        return _first(enter, leave, near, far) if enter <= leave else math.inf
    if kind == SPHERE:
        a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        shift = (o[0] * d[0] + o[1] * d[1] + o[2] * d[2]) / a
        x, y, z = o[0] - shift * d[0], o[1] - shift * d[1], o[2] - shift * d[2]
        under = 1.0 - (x * x + y * y + z * z)
        if under <= 0.0:
            return math.inf
        half = math.sqrt(under / a)
        return _first(-shift - half, -shift + half, near, far)
    if kind == TORUS:
        return _torus(o, d, ratio, near, far)
    return math.inf


@kernel
def _meets_bounds(o: Triple, d: Triple, bounds: Float64Array, far: Scalar) -> bool:
    """Whether a ray may meet a bounding sphere (x, y, z, radius^2) before ``far``."""
    x, y, z = bounds[0] - o[0], bounds[1] - o[1], bounds[2] - o[2]
    along = x * d[0] + y * d[1] + z * d[2]
    square = x * x + y * y + z * z
    if square <= bounds[3]:
        return True
    return bool(along > 0.0 and square - along * along <= bounds[3])


@row_kernel
def meets_box(
    begin: int,
    end: int,
    origins: Float64Array,
    directions: Float64Array,
    box: Float64Array,
    out: npt.NDArray[np.bool_],
) -> None:
    """Whether each ray (K, 3) meets the box between two corners (2, 3)."""
    for k in range(begin, end):
        enter, leave = 0.0, math.inf
        for i in range(3):
            o, d = origins[k, i], directions[k, i]
            if d == 0.0:
                if o < box[0, i] or o > box[1, i]:
                    leave = -1.0
                continue
            t0, t1 = (box[0, i] - o) / d, (box[1, i] - o) / d
            enter, leave = max(enter, min(t0, t1)), min(leave, max(t0, t1))
        out[k] = enter <= leave


@row_kernel
def closest(
    begin: int,
    end: int,
    origins: Float64Array,
    directions: Float64Array,
    far: Float64Array,
    near: Scalar,
    skip: Scalar,
    kinds: Int64Array,
    inverses: Float64Array,
    ratios: Float64Array,
    bounds: Float64Array,
    distance: Float64Array,
    found: Int64Array,
) -> None:
    """First hit of each ray in (near, far): its t and shape, or inf and -1; ``skip`` is left out.

    Rays (K, 3) with far (K,); shapes (M,), (M, 3, 4), (M,), (M, 4); results (K,).
    """
    for k in range(begin, end):
        o = (origins[k, 0], origins[k, 1], origins[k, 2])
        d = (directions[k, 0], directions[k, 1], directions[k, 2])
        best, which = math.inf, -1
        limit = far[k]
        for j in range(kinds.shape[0]):
            if j == skip or kinds[j] == MESH or not _meets_bounds(o, d, bounds[j], limit):
                continue
            m = inverses[j]
            t = _distance(kinds[j], _affine(m, o, 1.0), _affine(m, d, 0.0), ratios[j], near, limit)
            if t < limit:
                best, which, limit = t, j, t
        distance[k], found[k] = best, which


@row_kernel
def blocked(
    begin: int,
    end: int,
    origins: Float64Array,
    directions: Float64Array,
    far: Float64Array,
    near: Scalar,
    skip: Scalar,
    kinds: Int64Array,
    inverses: Float64Array,
    ratios: Float64Array,
    bounds: Float64Array,
    out: npt.NDArray[np.bool_],
) -> None:
    """Whether each ray meets any shape in (near, far)."""
    for k in range(begin, end):
        o = (origins[k, 0], origins[k, 1], origins[k, 2])
        d = (directions[k, 0], directions[k, 1], directions[k, 2])
        out[k] = False
        for j in range(kinds.shape[0]):
            if j == skip or kinds[j] == MESH:
                continue
            if not _meets_bounds(o, d, bounds[j], far[k]):
                continue
            m = inverses[j]
            local, along = _affine(m, o, 1.0), _affine(m, d, 0.0)
            if _distance(kinds[j], local, along, ratios[j], near, far[k]) < far[k]:
                out[k] = True
                break


@kernel
def _turn(x: Scalar, z: Scalar) -> Scalar:
    """Azimuth / 2 pi in [0, 1) of the lat-long convention: x = sin, z = -cos."""
    u = math.atan2(x, -z) / (2.0 * math.pi)
    return u + 1.0 if u < 0.0 else u


@kernel
def _surface(kind: Scalar, p: Triple, ratio: Scalar) -> tuple[Triple, Triple, Scalar, Scalar, int]:
    """Normal, tangent (any length), u, v and part of a unit shape at a local point of it."""
    x, y, z = p
    if kind == BOX:
        ax, ay, az = abs(x), abs(y), abs(z)
        if az >= ay and az >= ax:
            side = 1.0 if z > 0.0 else -1.0
            uv = 0.5 * (side * x + 1.0), 0.5 * (1.0 - y)
            return (0.0, 0.0, side), (side, 0.0, 0.0), uv[0], uv[1], 4 if z > 0.0 else 5
        if ay >= ax:
            side = 1.0 if y > 0.0 else -1.0
            uv = 0.5 * (x + 1.0), 0.5 * (side * z + 1.0)
            return (0.0, side, 0.0), (1.0, 0.0, 0.0), uv[0], uv[1], 2 if y > 0.0 else 3
        side = 1.0 if x > 0.0 else -1.0
        uv = 0.5 * (1.0 - side * z), 0.5 * (1.0 - y)
        return (side, 0.0, 0.0), (0.0, 0.0, -side), uv[0], uv[1], 0 if x > 0.0 else 1
    if kind == RECTANGLE:
        return (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), 0.5 * (x + 1.0), 0.5 * (1.0 - y), 0
    ring = math.hypot(x, z)
    tangent = (z, 0.0, -x) if ring > 1e-12 else (1.0, 0.0, 0.0)
    if kind == SPHERE:
        polar = math.atan2(ring, y) / math.pi
        return (x, y, z), tangent, _turn(x, z), polar, 0
    out = ring - 1.0  # torus: distance from the ring's circle, outwards
    v = math.atan2(y, out) / (2.0 * math.pi)
    around = x / ring, z / ring
    normal = (out * around[0], y, out * around[1])
    return normal, tangent, _turn(x, z), v + 1.0 if v < 0.0 else v, 0


@row_kernel
def details(
    begin: int,
    end: int,
    origins: Float64Array,
    directions: Float64Array,
    distance: Float64Array,
    found: Int64Array,
    kinds: Int64Array,
    forwards: Float64Array,
    inverses: Float64Array,
    ratios: Float64Array,
    position: Float64Array,
    normal: Float64Array,
    tangent: Float64Array,
    uv: Float64Array,
    part: Int64Array,
    front: npt.NDArray[np.bool_],
) -> None:
    """What each ray found: position, unit normal and tangent, uv, part, and the side it saw.

    Rectangles face the ray, closed shapes outwards. Rays that found nothing or a mesh are left.
    """
    for k in range(begin, end):
        j = found[k]
        if j < 0 or kinds[j] == MESH:
            continue
        t = distance[k]
        x = origins[k, 0] + t * directions[k, 0]
        y = origins[k, 1] + t * directions[k, 1]
        z = origins[k, 2] + t * directions[k, 2]
        inv, fwd = inverses[j], forwards[j]
        n, s, u, v, which = _surface(kinds[j], _affine(inv, (x, y, z), 1.0), ratios[j])
        nx = inv[0, 0] * n[0] + inv[1, 0] * n[1] + inv[2, 0] * n[2]
        ny = inv[0, 1] * n[0] + inv[1, 1] * n[1] + inv[2, 1] * n[2]
        nz = inv[0, 2] * n[0] + inv[1, 2] * n[1] + inv[2, 2] * n[2]
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        seen = nx * directions[k, 0] + ny * directions[k, 1] + nz * directions[k, 2] < 0.0
        if kinds[j] == RECTANGLE and not seen:
            length, which = -length, 1
        nx, ny, nz = nx / length, ny / length, nz / length
        tx, ty, tz = _affine(fwd, s, 0.0)
        along = tx * nx + ty * ny + tz * nz
        tx, ty, tz = tx - along * nx, ty - along * ny, tz - along * nz
        length = math.sqrt(tx * tx + ty * ty + tz * tz)
        position[k, 0], position[k, 1], position[k, 2] = x, y, z
        normal[k, 0], normal[k, 1], normal[k, 2] = nx, ny, nz
        tangent[k, 0], tangent[k, 1], tangent[k, 2] = tx / length, ty / length, tz / length
        uv[k, 0], uv[k, 1] = u, v
        part[k] = which
        front[k] = seen
