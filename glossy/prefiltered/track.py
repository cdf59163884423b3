"""Lobes of separate slices, put in order: each stack follows one lobe over the elevations.

An axis is held by its offsets from the reflected direction, polar angle and azimuth. An axis in
the plane of incidence has azimuth 0, also on the viewer's side of the normal, where its polar angle
is below zero. Two axes of neighbouring slices are compared where both reflected directions are
turned to the pole, by the angle between them; stacks are joined so that the sum of the angles,
each weighted by what the two lobes hold, is least (an assignment), from a middle slice to both
ends.
"""

import math

import numpy as np
from scipy.optimize import linear_sum_assignment

from .slices import Float64Array

AT_NORMAL = 1e-3  # rad
FAINT = 0.005  # share of a slice's volume below which a lobe does not say where its axis is


def offsets(axis: Float64Array, theta_o: float) -> tuple[float, float]:
    """(theta_offset, phi_offset) [rad] of an axis (3,) for wo in the plane of x and +z.

    The azimuth is in [-pi/2, pi/2]; the polar angle theta_o + theta_offset in [-pi, pi].
    """
    x, y, z = -axis[0], -axis[1], axis[2]  # the reflected direction has azimuth 0
    polar = math.atan2(math.hypot(x, y), z)
    if math.hypot(x, y) == 0.0:
        return polar - theta_o, 0.0
    phi = math.atan2(y, x)
    if abs(phi) > 0.5 * math.pi:
        return -polar - theta_o, phi - math.copysign(math.pi, phi)
    return polar - theta_o, phi


def turned(axes: Float64Array, theta_o: float) -> Float64Array:
    """Axes (L, 3) in the frame whose pole is the reflected direction (-sin theta_o, 0, cos)."""
    c, s = math.cos(theta_o), math.sin(theta_o)
    x, y, z = axes.T
    return np.stack([c * x + s * z, y, c * z - s * x], axis=-1)


def order(axes: Float64Array, volumes: Float64Array, theta_o: Float64Array) -> list[list[int]]:
    """Which lobe of each slice belongs to which stack.

    Parameters
    ----------
    axes : (E, L, 3) array
    volumes : (E, L) array
        What the lobes hold, in any unit.
    theta_o : (E,) array [rad]

    Returns
    -------
    For each slice the index of the lobe of each stack: E lists of L.
    """
    frames = [turned(a, t) for a, t in zip(axes, theta_o, strict=True)]
    e, count = axes.shape[:2]
    start = e // 2
    chosen: list[list[int]] = [[] for _ in range(e)]
    chosen[start] = list(range(count))
    for step in (1, -1):
        for k in range(start + step, e if step > 0 else -1, step):
            before = frames[k - step][chosen[k - step]]
            angle = np.arccos(np.clip(before @ frames[k].T, -1.0, 1.0))
            held = volumes[k - step][chosen[k - step]][:, None] + volumes[k]
            chosen[k] = [int(c) for c in linear_sum_assignment(angle * held)[1]]
    return chosen


def continuous(theta: Float64Array, phi: Float64Array, theta_o: Float64Array) -> None:
    """Write each pair of offsets (E,) of a stack in the form nearest to its neighbour, in place.

    Polar angle p and azimuth phi name the same axis as -p and phi +- pi. At the normal (within
    AT_NORMAL) the azimuth is the neighbour's.
    """
    start = len(theta) // 2
    for step in (1, -1):
        for k in range(start + step, len(theta) if step > 0 else -1, step):
            polar = theta[k] + theta_o[k]
            if abs(math.sin(polar)) < AT_NORMAL:
                phi[k] = phi[k - step]
                continue
            forms = [
                (sign * polar - theta_o[k], phi[k] + turn * math.pi)
                for turn in range(-2, 3)
                for sign in (1.0 if turn % 2 == 0 else -1.0,)
            ]
            near = (theta[k - step], phi[k - step])
            theta[k], phi[k] = min(
                forms, key=lambda f: (f[0] - near[0]) ** 2 + (f[1] - near[1]) ** 2
            )


def hold_faint(
    theta: Float64Array, phi: Float64Array, share: Float64Array, cosines: Float64Array
) -> None:
    """Replace the offsets (E,) where a lobe holds next to nothing by their neighbours', in place.

    ``share`` (E,) is what the lobe holds of what all lobes of its slice do.

    Near the normal the further lobes fade out and their axes are accidents; followed, the axis
    would swing about while the lobe of the next slice is still there.
    """
    solid = share > FAINT
    if solid.any():
        for offset in (theta, phi):
            offset[~solid] = np.interp(cosines[~solid], cosines[solid], offset[solid])
