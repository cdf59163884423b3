"""A cube map filtered with radial profiles, as a sum over the parts of its texels.

The radiance between texel centres is bilinear, and a profile p is a function of the angle a to the
axis r ::

    I(r) = int p(angle(r, l)) L(l) dl                                                       (1)

On every piece between texel centres (and on the half pieces at a face's edges) L is a polynomial;
each piece is divided into g x g parts with 2 x 2 Gauss-Legendre nodes (s_i, t_j) each: exact to the
third degree, the kinks of L at the texels' centres included. With J = (1 + s^2 + t^2)^(-3/2) ::

    I(r) = P S(L)/S(1),   S(L) = sum_ij w_i w_j J_ij p(a_ij) L(s_i, t_j),   P = int p dl    (2)

The quotient makes a constant map exact. Parts are at most half as wide as the least angle over
which p changes by half of its maximum, or (profiles with steps) an eighth of the angle that holds
half of its volume, so that a lobe narrower than a texel meets nodes as densely as a wide one ::

    g = ceil(2 h / width) <= FINEST,   h = 2/N, a texel's width in the middle of a face     (3)

Under noise and under a sun of one texel this is within 5e-5 of many more nodes for smooth profiles,
3e-4 for a cone, 1e-3 for a disc of half a texel.

The kernel looks p up in a table even in
the chord |r - l|, ``TABLE`` steps from 0 to the profile's end.

Source of (1): Kautz and McCool 2000, eq. (2), without the cosine and over the plain solid angle;
the rule (2), (3) is ours.
"""

import functools
import math

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import row_kernel
from .._threads import in_rows
from ..cubemap import CubeMap, texel_directions
from ..frames import normalise
from ..splitsum.chain import k_face_axes
from .stack import ring_solid_angles

FINEST = 128  # parts of a piece along an axis, at most
STEP = 0.125  # of the angle that holds half of the volume: the least width of a profile
TABLE = 8192

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]


# --- nodes and profiles ---------------------------------------------------------------------------


@functools.lru_cache(maxsize=16)
def nodes(size: int, parts: int) -> tuple[Float64Array, Float64Array]:
    """Coordinates in [-1, 1] and weights, (n,), of the quadrature along a face's axis, eq. (2)."""
    centres = (np.arange(size) + 0.5) * (2.0 / size) - 1.0
    edges = np.concatenate([[-1.0], centres, [1.0]])
    half = -(-parts // 2)
    counts = [half, *[parts] * (size - 1), half]
    ends = zip(edges[:-1], edges[1:], counts, strict=True)
    pieces = [np.linspace(a, b, k + 1)[:-1] for a, b, k in ends]
    bounds = np.append(np.concatenate(pieces), 1.0)
    middle, radius = 0.5 * (bounds[1:] + bounds[:-1]), 0.5 * np.diff(bounds)
    offset = radius / math.sqrt(3.0)
    at = np.stack([middle - offset, middle + offset], axis=1).reshape(-1)
    return np.asarray(_check.frozen(at)), np.asarray(_check.frozen(np.repeat(radius, 2)))


def checked_profile(
    angles: npt.ArrayLike, profile: npt.ArrayLike
) -> tuple[Float64Array, Float64Array]:
    """Nodes (A,) and values (A, 1 or 3) of a profile, or a ``ValueError``."""
    a = np.asarray(_check.array("angles", angles), dtype=np.float64)
    rising = a.ndim == 1 and len(a) > 1 and np.isfinite(a).all() and np.all(np.diff(a) > 0.0)
    if not rising or a[0] != 0.0 or a[-1] > math.pi + 1e-12:
        raise _check.fail("angles", "must rise from 0 to at most pi", a.tolist())
    p = np.asarray(_check.array("profile", profile), dtype=np.float64)
    p = p[:, None] if p.ndim == 1 else p
    if p.ndim != 2 or len(p) != len(a) or p.shape[1] not in (1, 3):
        raise _check.fail("profile", f"must have shape ({len(a)}, 1 or 3)", p.shape)
    if not np.isfinite(p).all() or p.min() < 0.0:
        raise _check.fail("profile", "must be finite and not negative", float(p.min()))
    return a, p


def at_angles(angles: Float64Array, profile: Float64Array, where: Float64Array) -> Float64Array:
    """The profile (K, C) at angles (K,); zero beyond its last node."""
    columns = [np.interp(where, angles, p, right=0.0) for p in profile.T]
    return np.stack(columns, axis=-1)


def volume(angles: Float64Array, profile: Float64Array) -> Float64Array:
    """Integral P (C,) of the profile over the sphere, eq. (2)."""
    return np.asarray(ring_solid_angles(angles) @ profile)


def _half_change(values: Float64Array) -> int:
    """Least steps over which a column of (K, C) changes by a half, K - 1 if none does."""
    most = least = values  # over ``span`` steps from each row on

    def over(steps: int) -> tuple[Float64Array, Float64Array]:
        keep, ahead = len(values) - steps, steps - span
        return (
            np.maximum(most[:keep], most[ahead : ahead + keep]),
            np.minimum(least[:keep], least[ahead : ahead + keep]),
        )

    span, last = 0, len(values) - 1
    while span < last:
        wider = min(max(2 * span, 1), last)
        high, low = over(wider)
        if np.max(high - low) >= 0.5:
            first, stop = span + 1, wider
            while first < stop:
                middle = (first + stop) // 2
                if np.max(np.subtract(*over(middle))) >= 0.5:
                    stop = middle
                else:
                    first = middle + 1
            return stop
        most, least, span = high, low, wider
    return last


def width_of(angles: Float64Array, profile: Float64Array) -> float:
    """Width of a profile's finest feature, for eq. (3); the profile's end if it has none."""
    grid = np.linspace(0.0, angles[-1], 4097)
    values = at_angles(angles, profile, grid)
    values = values[:, values.max(axis=0) > 0.0]
    if not values.shape[1]:
        return float(angles[-1])
    held = np.cumsum(values * np.sin(grid)[:, None], axis=0)
    inner = grid[np.argmax(held >= 0.5 * held[-1], axis=0)].min()
    return float(max(grid[_half_change(values / values.max(axis=0))], STEP * inner))


def parts_for(size: int, angles: Float64Array, profile: Float64Array, fine: int = 2) -> int:
    """Parts g of a piece along an axis, eq. (3), with ``fine`` for its 2."""
    return min(max(math.ceil(2.0 * fine / (size * width_of(angles, profile))), 1), FINEST)


def chord_table(angles: Float64Array, profile: Float64Array) -> tuple[Float64Array, float]:
    """The profile, (TABLE + 2, 3), at even steps of |r - l|/2, and steps per unit; ends with 0."""
    end = math.sin(0.5 * float(angles[-1]))
    at = 2.0 * np.arcsin(np.minimum(np.linspace(0.0, end, TABLE + 1), 1.0))
    at[-1] = angles[-1]
    values = np.broadcast_to(at_angles(angles, profile, at), (TABLE + 1, 3))
    table = np.concatenate([values, values[-1:]])
    return np.asarray(_check.frozen(table)), TABLE / end


# --- the sum --------------------------------------------------------------------------------------


@row_kernel
def _sum_nodes(
    begin: int,
    end: int,
    directions: Float64Array,
    at: Float64Array,
    weight: Float64Array,
    padded: Float32Array,
    table: Float64Array,
    per_unit: float,
    radius: float,
    out: Float64Array,
) -> None:
    # (K, 3) unit; (n,) x2; (6, N+2, N+2, 3); (T, 3) over |r - l|/2; its end; S(L), S(1) (K, 6)
    size = padded.shape[1] - 2
    last = table.shape[0] - 2
    most = math.sin(0.5 * radius) ** 2
    sine = math.sin(radius) if radius < 0.5 * math.pi else 1.0
    for k in range(begin, end):
        x, y, z = directions[k, 0], directions[k, 1], directions[k, 2]
        r0 = r1 = r2 = w0 = w1 = w2 = 0.0
        for face in range(6):
            rs, rt, ra = k_face_axes(face, x, y, z)
            left, right = -1.0, 1.0
            top, low = -1.0, 1.0
            if sine < math.hypot(rs, ra):
                mid, half = math.atan2(rs, ra), math.asin(sine / math.hypot(rs, ra))
                left = math.tan(max(mid - half, -0.25 * math.pi))
                right = math.tan(min(mid + half, 0.25 * math.pi))
                if mid - half > 0.25 * math.pi or mid + half < -0.25 * math.pi:
                    continue
            if sine < math.hypot(rt, ra):
                mid, half = math.atan2(rt, ra), math.asin(sine / math.hypot(rt, ra))
                top = math.tan(max(mid - half, -0.25 * math.pi))
                low = math.tan(min(mid + half, 0.25 * math.pi))
                if mid - half > 0.25 * math.pi or mid + half < -0.25 * math.pi:
                    continue
            first, stop = np.searchsorted(at, left), np.searchsorted(at, right)
            for i in range(np.searchsorted(at, top), np.searchsorted(at, low)):
                t = at[i]
                v = (t + 1.0) * (0.5 * size) + 0.5
                row = min(int(v), size)
                b = v - row
                for j in range(first, stop):
                    s = at[j]
                    inverse = 1.0 / math.sqrt(1.0 + s * s + t * t)
                    chord = 0.5 - 0.5 * (rs * s + rt * t + ra) * inverse
                    if chord < most:
                        p = math.sqrt(max(chord, 0.0)) * per_unit
                        e = min(int(p), last)
                        f = p - e
                        w = weight[i] * weight[j] * inverse * inverse * inverse
                        p0 = w * (table[e, 0] + f * (table[e + 1, 0] - table[e, 0]))
                        p1 = w * (table[e, 1] + f * (table[e + 1, 1] - table[e, 1]))
                        p2 = w * (table[e, 2] + f * (table[e + 1, 2] - table[e, 2]))
                        u = (s + 1.0) * (0.5 * size) + 0.5
                        col = min(int(u), size)
                        a = u - col
                        c00, c01 = (1.0 - a) * (1.0 - b), a * (1.0 - b)
                        c10, c11 = (1.0 - a) * b, a * b
                        q, m = padded[face, row, col], padded[face, row, col + 1]
                        g, h = padded[face, row + 1, col], padded[face, row + 1, col + 1]
                        r0 += p0 * (c00 * q[0] + c01 * m[0] + c10 * g[0] + c11 * h[0])
                        r1 += p1 * (c00 * q[1] + c01 * m[1] + c10 * g[1] + c11 * h[1])
                        r2 += p2 * (c00 * q[2] + c01 * m[2] + c10 * g[2] + c11 * h[2])
                        w0, w1, w2 = w0 + p0, w1 + p1, w2 + p2
        out[k, 0], out[k, 1], out[k, 2] = r0, r1, r2
        out[k, 3], out[k, 4], out[k, 5] = w0, w1, w2


def filter_directions(
    cube: CubeMap,
    angles: npt.ArrayLike,
    profile: npt.ArrayLike,
    directions: npt.ArrayLike,
    parts: int | None = None,
) -> Float64Array:
    """The map filtered with one profile about each direction, eqs. (1) and (2).

    Parameters
    ----------
    cube : CubeMap
    angles : (A,) array
        Nodes of the profile [rad], rising from 0 to at most pi; zero beyond the last.
    profile : (A,) or (A, C) array
        Values [1/sr] >= 0, linear between nodes; C = 1 or 3 channels.
    directions : (..., 3) array
        Axes of the lobe, any length.
    parts : int, optional
        Parts of a piece along an axis; by eq. (3) if not given.

    Returns
    -------
    (..., 3) float64.

    Raises
    ------
    ValueError
        For nodes that do not rise, or a profile that is negative or not finite.
    """
    a, p = checked_profile(angles, profile)
    d = normalise(directions)
    g = (
        parts_for(cube.size, a, p)
        if parts is None
        else _check.count("parts", parts, high=2 * FINEST)
    )
    at, weight = nodes(cube.size, g)
    table, per_unit = chord_table(a, p)
    sums = np.empty((d.size // 3, 6))
    axes = _check.frozen(d.reshape(-1, 3))
    in_rows(
        _sum_nodes, len(axes), axes, at, weight, cube.padded, table, per_unit, float(a[-1]), sums
    )
    norm = np.where(sums[:, 3:] > 0.0, sums[:, 3:], 1.0)
    return np.asarray((volume(a, p) * sums[:, :3] / norm).reshape(d.shape))


def filter_exact(
    cube: CubeMap, angles: npt.ArrayLike, profile: npt.ArrayLike, size: int
) -> Float64Array:
    """``filter_directions`` at the texel centres of a cube map: (6, size, size, 3) float64."""
    return filter_directions(cube, angles, profile, texel_directions(size))
