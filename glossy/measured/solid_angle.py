"""Solid angle that each row of a table stands for.

The directions measured for one incident direction share their hemisphere: each has what is nearer
to it than to the others. Points that fill the hemisphere evenly are counted by nearest direction.
"""

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from .table import MeasuredTable

Float64Array = npt.NDArray[np.float64]

POINTS = 40_000  # of a hemisphere; each counts 1.6e-4 sr
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
    """
    weight = np.zeros(len(table))
    even = even_hemisphere(POINTS)
    for rows in table.incident_directions()[1]:
        for side in (1.0, -1.0):
            own = rows[table.wo[rows, 2] * side > 0.0]
            if not len(own):
                continue
            places, label = np.unique(np.round(table.wo[own], 6), axis=0, return_inverse=True)
            label = label.reshape(-1)
            nearest = cKDTree(places).query(even * np.array([1.0, 1.0, side]))[1]
            area = np.bincount(nearest, minlength=len(places)) * (2.0 * np.pi / POINTS)
            weight[own] = (area / np.bincount(label))[label]
    return weight
