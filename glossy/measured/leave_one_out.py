"""What an interpolation is worth: leave an incident direction out, and predict what was measured.

For each incident direction whose polar angle lies between others, its rows are taken out of the
table, the rest is interpolated at them, and the prediction is compared in transfer densities::

    error = sum_t w_t |p_t - p'_t| / sum_t w_t |p_t|                                        (1)

over the rows of that direction, all channels, with the solid angles w of the rows: the share of
the light that went to a wrong direction (2 if all of it did). Thesis section 3.2 argues with
Figs. 3.1 and 3.2 that alignment by half vectors must win for lobes; this measures it.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from .interpolate import INTERPOLATIONS, TableFunction
from .solid_angle import solid_angles
from .table import MeasuredTable, angles

Float64Array = npt.NDArray[np.float64]

PEAK = 0.1  # of the largest luminance: rows above it are the lobe


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """Errors of eq. (1) for one incident direction.

    ``theta``, ``phi`` [deg]; ``error`` by name of the interpolation, over all rows, and ``peak``
    over those above a tenth of the largest.
    """

    theta: float
    phi: float
    rows: int
    error: dict[str, float]
    peak: dict[str, float]


def leave_one_out(
    table: MeasuredTable, quantity: str = "root", most: int | None = None
) -> list[LeftOut]:
    """Errors of all interpolations at each incident direction that lies between others.

    Parameters
    ----------
    table : MeasuredTable
        Reflection or transmission or both; rows of both sides of a direction are left out at once.
    quantity : "root", "p" or "f"
        What is interpolated, see `interpolate`.
    most : int, optional
        At most so many directions, spread evenly over them.

    Raises
    ------
    ValueError
        If no incident direction lies between others.
    """
    weight = solid_angles(table) if table.weight is None else table.weight
    places, rows = table.incident_directions()
    theta, phi = angles(places)
    height = np.round(np.where(theta > 90.0, 180.0 - theta, theta), 1)
    inner = []
    for j in range(len(places)):
        same = np.sign(places[:, 2]) == np.sign(places[j, 2])
        if height[same].min() < height[j] < height[same].max():
            inner.append(j)
    if not inner:
        raise ValueError(f"table: no incident direction of {len(places)} lies between others")
    if most is not None and most < len(inner):
        inner = [inner[k] for k in np.linspace(0, len(inner) - 1, most).round().astype(int)]
    result = []
    for j in inner:
        left = np.zeros(len(table), dtype=bool)
        left[rows[j]] = True
        if table.isotropic:  # other azimuths of the same angle are the same measurement
            for k in np.flatnonzero(height == height[j]):
                left[rows[k]] = True
        rest, own = table.select(~left), table.select(rows[j])
        w, cosine = weight[rows[j], None], np.abs(own.wo[:, 2:])
        bright = own.transfer.mean(axis=1) >= PEAK * own.transfer.mean(axis=1).max()
        error, peak = {}, {}
        function = TableFunction(rest, quantity=quantity)
        for name in INTERPOLATIONS:
            function.interpolation = name
            wrong = w * np.abs(function(own.wi, own.wo) - own.f) * cosine
            right = w * np.abs(own.transfer)
            error[name] = float(wrong.sum() / max(right.sum(), 1e-300))
            peak[name] = float(wrong[bright].sum() / max(right[bright].sum(), 1e-300))
        result.append(LeftOut(float(theta[j]), float(phi[j]), len(rows[j]), error, peak))
    return result
