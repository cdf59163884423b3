"""Profile curves of a slice about an axis, and the radially symmetric lobe made of them.

A profile curve is the slice along a great circle through the axis. Their mean is the radially
symmetric lobe that is closest to the slice in the mean square; below the horizon a slice is 0, so
that mean loses no energy. Their minimum stays below the slice, so that a rest >= 0 is left for
further lobes; it looks at directions above the horizon only.

The minimum of finitely many curves may still pass the slice between them. Each node k of the
profile is therefore scaled by

    g_k = min(1, min r_j / p(a_j))                                                          (1)

over the samples j (of value r_j, at angle a_j) in the two intervals that the node bounds. A value
between two nodes then shrinks at least by its own ratio, and no sample is passed.
"""

import math

import numpy as np

from ..frames import dot, spherical
from .slices import Float64Array, Function

CURVES = 96  # great circles through the axis, half of each on either side


def tangents(axis: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Two unit vectors (3,) that make a right-handed frame with ``axis`` (3,)."""
    side = np.array([0.0, 1.0, 0.0]) if abs(axis[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    u = np.cross(side, axis)
    u /= np.linalg.norm(u)
    return u, np.cross(axis, u)


def about(axis: Float64Array, angles: Float64Array, curves: int = CURVES) -> Float64Array:
    """Directions (curves, A, 3) at ``angles`` from ``axis`` (3,), on even azimuths about it."""
    frame = np.stack([*tangents(axis), axis])
    phi = 2.0 * math.pi * (np.arange(curves) + 0.5) / curves
    return np.asarray(spherical(*np.broadcast_arrays(angles, phi[:, None])) @ frame)


def angle_to(axis: Float64Array, wi: Float64Array) -> Float64Array:
    """Angle [rad] of directions (..., 3) to ``axis`` (3,), exact near it."""
    cross = np.linalg.norm(np.cross(wi, axis), axis=-1)
    return np.asarray(np.arctan2(cross, dot(wi, np.broadcast_to(axis, wi.shape))))


def evaluate(angles: Float64Array, profile: Float64Array, at: Float64Array) -> Float64Array:
    """A profile (A, C) at angles (...): (..., C), zero beyond the last node."""
    columns = [np.interp(at, angles, p, right=0.0) for p in profile.T]
    return np.stack(columns, axis=-1)


def mean_profile(function: Function, axis: Float64Array, angles: Float64Array) -> Float64Array:
    """Mean (A, C) of the profile curves."""
    return np.asarray(function(about(axis, angles)).mean(axis=0))


def minimum_profile(
    function: Function,
    axis: Float64Array,
    angles: Float64Array,
    wi: Float64Array,
    value: Float64Array,
) -> Float64Array:
    """Least (A, C) of the profile curves, nowhere above the samples ``wi`` (G, 3), ``value``."""
    directions = about(axis, angles)
    up = directions[..., 2] > 0.0
    f = np.where(up[..., None], function(directions), np.inf)
    f[:, ~up.any(axis=0)] = 0.0
    return _below(angles, f.min(axis=0), angle_to(axis, wi), value)


def _below(
    angles: Float64Array, profile: Float64Array, at: Float64Array, value: Float64Array
) -> Float64Array:
    """The profile (A, C) scaled by eq. (1)."""
    inside = at <= angles[-1]
    at, value = at[inside], value[inside]
    p = evaluate(angles, profile, at)
    ratio = np.divide(value, p, out=np.ones_like(p), where=p > value)
    low = np.clip(np.searchsorted(angles, at, side="right") - 1, 0, len(angles) - 2)
    factor = np.ones_like(profile)
    np.minimum.at(factor, low, ratio)
    np.minimum.at(factor, low + 1, ratio)
    return profile * factor


def residual(
    function: Function, lobes: list[tuple[Float64Array, Float64Array]], angles: Float64Array
) -> Function:
    """The function minus lobes (axis, profile), and not below 0."""

    def rest(wi: Float64Array) -> Float64Array:
        value = function(wi)
        for axis, profile in lobes:
            value = value - evaluate(angles, profile, angle_to(axis, wi))
        return np.maximum(value, 0.0)

    return rest
