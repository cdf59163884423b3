"""Solid angle that each row of a table stands for.

The directions measured for one incident direction share their hemisphere: each has what is nearer
to it than to the others. Points that fill the hemisphere evenly are counted by nearest direction.
Where an isotropic surface was measured on one side of the plane of incidence only, the other side
is its mirror image.
"""

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from .. import _check
from .table import MeasuredTable

Float64Array = npt.NDArray[np.float64]

POINTS = 40_000  # of a hemisphere; each counts 1.6e-4 sr
MOST_SETS = 1024  # of places that are counted, some 9 ms each
ONE_SIDE = 1e-4  # distance from the plane of incidence that is none
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


def even_hemisphere(n: int) -> Float64Array:
    """Points (n, 3) of a Fibonacci spiral on the upper hemisphere, of equal solid angle."""
    k = np.arange(n) + 0.5
    z, phi = 1.0 - k / n, GOLDEN * k
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=1)


def solid_angles(table: MeasuredTable) -> Float64Array:
    """Weights (K,) [sr]; those of one incident direction and one side of the surface sum to 2 pi.

    Directions that were measured twice share. Exact to about the square root of 1.6e-4 sr a row.

    Raises
    ------
    ValueError
        If the incident directions have more than ``MOST_SETS`` different sets of outgoing ones.
    """
    weight = np.zeros(len(table))
    sets: dict[bytes, tuple[float, Float64Array, Float64Array]] = {}
    shared = []
    lights, members = table.incident_directions()
    for light, rows in zip(lights, members, strict=True):
        for side in (1.0, -1.0):
            own = rows[table.wo[rows, 2] * side > 0.0]
            if not len(own):
                continue
            places, label = np.unique(np.round(table.wo[own], 6), axis=0, return_inverse=True)
            wall = _wall(places, light) if table.isotropic else np.zeros(3)
            key = places.tobytes() + wall.tobytes() + bytes([side > 0.0])
            sets.setdefault(key, (side, places, wall))
            shared.append((own, label.reshape(-1), key))
    if len(sets) > MOST_SETS:
        rule = f"must have at most {MOST_SETS} different sets of outgoing directions"
        raise _check.fail("table", rule, f"{len(lights)} incident directions")
    even = even_hemisphere(POINTS)
    area = {key: _shares(even, *found) for key, found in sets.items()}
    for own, label, key in shared:
        weight[own] = (area[key] / np.bincount(label))[label]
    return weight


def _shares(
    even: Float64Array, side: float, places: Float64Array, wall: Float64Array
) -> Float64Array:
    """Solid angle (n,) nearest to each of the places (n, 3) of one hemisphere."""
    points = even * np.array([1.0, 1.0, side])
    points -= 2.0 * np.minimum(points @ wall, 0.0)[:, None] * wall
    nearest = cKDTree(places).query(points)[1]
    return np.asarray(np.bincount(nearest, minlength=len(places)) * (2.0 * np.pi / POINTS))


def _wall(places: Float64Array, light: Float64Array) -> Float64Array:
    """Unit normal of the plane of incidence on the side that has all the places, else zero."""
    length = np.hypot(light[0], light[1])
    if length < ONE_SIDE:
        return np.zeros(3)
    across: Float64Array = np.array([-light[1], light[0], 0.0]) / length
    sides = places @ across
    if sides.min() > -ONE_SIDE:
        return across
    return -across if sides.max() < ONE_SIDE else np.zeros(3)
