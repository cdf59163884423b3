"""Directions drawn in proportion to a measured function: tables of half vectors.

For a set of views the measured transfer density is tabulated over half vectors, where a lobe
stands still while the view changes::

    P(cell | wo) ~ Y(f(reflect(wo, h), wo)) cos(theta_i) 4 (wo.h) omega_cell                 (1)

(Y the luminance, h the centre of the cell). Cells crowd about the normal: theta_h goes with the
square of its row. A draw takes one of the views about ``wo`` by their bilinear weights, a cell by
inversion, a direction evenly within the cell; its density is what that makes of it, summed over
the views::

    p(wi | wo) = sum_s v_s P_s(cell) / (omega_cell 4 (wo.h))                                (2)

Passing light is tabulated by its mirror image at the surface. A share of the draws, ``DIFFUSE``,
goes to the cosine lobe of each hemisphere that light comes from, so that the density is positive
wherever the function is, and so that the ratio of the two is bounded at grazing angles.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from ..frames import reflect, spherical
from .disc import k_above

Float64Array = npt.NDArray[np.float64]
Function = Callable[[Float64Array, Float64Array], Float64Array]

ROWS, COLUMNS = 64, 32
VIEWS = 24  # polar angles of tabulated views of an isotropic material
TURNED_VIEWS, TURNS = 12, 16  # polar angles and azimuths of another
DIFFUSE = 0.2
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
HALF_PI = 0.5 * np.pi
TWO_PI = 2.0 * np.pi
GRAZING = np.radians(88.5)  # last tabulated view


def luminance(f: Float64Array) -> Float64Array:
    """Intensity (K,) of values (K, C)."""
    return np.asarray(f @ LUMINANCE if f.shape[-1] == 3 else f[..., 0])


def half_vector_cells(rows: int, columns: int) -> tuple[Float64Array, Float64Array]:
    """Centres (K, 3) and solid angles (K,) of cells that cover the hemisphere of half vectors.

    Their borders in theta go with the square of the row, so they crowd about the normal.
    """
    edge = HALF_PI * (np.arange(rows + 1) / rows) ** 2
    theta = HALF_PI * ((np.arange(rows) + 0.5) / rows) ** 2
    phi = TWO_PI * (np.arange(columns) + 0.5) / columns
    h = spherical(*np.meshgrid(theta, phi, indexing="ij")).reshape(-1, 3)
    band = (np.cos(edge[:-1]) - np.cos(edge[1:])) * (TWO_PI / columns)
    return h, np.repeat(band, columns)


class ImportanceTable:
    """Sampling and density for a function f(wi, wo) of unit directions, see the module's top.

    Parameters
    ----------
    function : callable
        BSDF (K, C) for directions (K, 3).
    isotropic : bool
        Azimuths of half vectors are relative to the view then.
    """

    def __init__(self, function: Function, isotropic: bool) -> None:
        h, area = half_vector_cells(ROWS, COLUMNS)
        views, turns = (VIEWS, 1) if isotropic else (TURNED_VIEWS, TURNS)
        self.theta = np.linspace(0.0, GRAZING, views)
        self.phi = TWO_PI * np.arange(turns) / turns
        count = 2 * views * turns
        cells = np.zeros((count, 2, ROWS, COLUMNS))
        chance = np.zeros((count, 4))
        for side in range(2):  # views above, views below
            for k in range(views * turns):
                v = spherical(self.theta[k // turns], self.phi[k % turns])
                wi = reflect(v, h)
                cosine = h @ v
                up = (cosine > 0.0) & (wi[:, 2] > 0.0)
                flip = np.array([1.0, 1.0, 1.0 if side == 0 else -1.0])
                wo = np.broadcast_to(v * flip, (int(up.sum()), 3))
                at = side * views * turns + k
                for lobe in range(2):  # the same side, the other side
                    mirror = np.array([1.0, 1.0, 1.0 if lobe == 0 else -1.0])
                    f = luminance(function(wi[up] * flip * mirror, np.ascontiguousarray(wo)))
                    mass = np.zeros(len(h))
                    mass[up] = np.maximum(f, 0.0) * wi[up, 2] * 4.0 * cosine[up] * area[up]
                    cells[at, lobe] = mass.reshape(ROWS, COLUMNS)
                both = cells[at].sum(axis=(1, 2))
                total = both.sum()
                share = both / total if total > 0.0 else np.array([1.0, 0.0])
                chance[at, :2] = (1.0 - DIFFUSE) * share if total > 0.0 else 0.0
                chance[at, 2:] = (DIFFUSE if total > 0.0 else 1.0) * share
        mass = cells.sum(axis=(2, 3), keepdims=True)
        even = np.broadcast_to(area.reshape(ROWS, COLUMNS) / area.sum(), cells.shape)
        cells = np.where(mass > 0.0, cells / np.where(mass > 0.0, mass, 1.0), even)
        self._arguments: tuple[Any, ...] = tuple(
            _check.frozen(a)
            for a in (
                self.theta,
                np.cumsum(chance, axis=1),
                cells,
                np.cumsum(cells.sum(axis=3), axis=2).reshape(-1),
                np.cumsum(cells, axis=3).reshape(-1),
            )
        )
        self.turns = turns

    def sample(self, xi: Float64Array, wo: Float64Array) -> Float64Array:
        """Directions (K, 3) for uniform numbers (K, 2) in [0, 1) and views (K, 3)."""
        out = np.empty((len(wo), 3))
        in_rows(
            _sample,
            len(wo),
            _check.frozen(xi),
            _check.frozen(wo),
            out,
            self.turns,
            *self._arguments,
            grain=512,
        )
        return out

    def pdf(self, wi: Float64Array, wo: Float64Array) -> Float64Array:
        """Density (K,) [1/sr] of ``sample``, eq. (2)."""
        out = np.empty(len(wi))
        in_rows(
            _pdf,
            len(wi),
            _check.frozen(wi),
            _check.frozen(wo),
            out,
            self.turns,
            *self._arguments,
            grain=1024,
        )
        return out


@kernel
def k_views(
    theta: Float64Array, turns: int, x: float, y: float, z: float
) -> tuple[tuple[int, int, int, int], tuple[float, float, float, float]]:
    """Tables of the views about a direction, and their bilinear weights."""
    across = np.sqrt(x * x + y * y)
    n = len(theta)
    t = np.arctan2(across, abs(z)) / theta[n - 1] * (n - 1)
    low = min(int(t), n - 2)
    ft = min(t - low, 1.0)
    base = 0 if z > 0.0 else n * turns
    if turns == 1:
        return (base + low, base + low + 1, 0, 0), (1.0 - ft, ft, 0.0, 0.0)
    p = np.arctan2(y, x) / TWO_PI * turns
    p += turns if p < 0.0 else 0.0
    c0 = min(int(p), turns - 1)
    fp = min(p - c0, 1.0)
    c1 = (c0 + 1) % turns
    a, b = base + low * turns, base + (low + 1) * turns
    weights = ((1.0 - ft) * (1.0 - fp), (1.0 - ft) * fp, ft * (1.0 - fp), ft * fp)
    return (a + c0, a + c1, b + c0, b + c1), weights


@kernel
def k_place(below: float, reached: float, u: float) -> Scalar:
    """Place of u between two entries of a cumulative table, in [0, 1)."""
    width = reached - below
    return min(max((u - below) / width, 0.0), 1.0 - 1e-12) if width > 0.0 else 0.5


@row_kernel
def _sample(
    begin: int,
    end: int,
    xi: Float64Array,
    wo: Float64Array,
    out: Float64Array,
    turns: int,
    theta: Float64Array,
    chance: Float64Array,
    cells: Float64Array,
    rows: Float64Array,
    columns: Float64Array,
) -> None:
    for k in range(begin, end):
        x, y, z = wo[k, 0], wo[k, 1], wo[k, 2]
        side = 1.0 if z > 0.0 else -1.0
        views, weights = k_views(theta, turns, x, y, z)
        u, v = xi[k, 0], xi[k, 1]
        s, reached, last = views[0], 0.0, 0
        for n in range(4):
            if weights[n] > 0.0:
                last = n
        for n in range(4):
            if weights[n] > 0.0 and (u < reached + weights[n] or n == last):
                s = views[n]
                u = min(max((u - reached) / weights[n], 0.0), 1.0 - 1e-12)
                break
            reached += weights[n]
        part = 0
        while part < 3 and chance[s, part] <= u:
            part += 1
        u = k_place(chance[s, part - 1] if part > 0 else 0.0, chance[s, part], u)
        if part >= 2:
            r, p = np.sqrt(u), TWO_PI * v
            sign = side if part == 2 else -side
            out[k, 0], out[k, 1] = r * np.cos(p), r * np.sin(p)
            out[k, 2] = sign * np.sqrt(max(1.0 - u, 1e-24))
            continue
        at = (s * 2 + part) * ROWS
        row = min(k_above(rows, at, at + ROWS, u) - at, ROWS - 1)
        at += row
        fr = k_place(rows[at - 1] if row > 0 else 0.0, rows[at], u)
        v *= columns[(at + 1) * COLUMNS - 1]
        at *= COLUMNS
        column = min(k_above(columns, at, at + COLUMNS, v) - at, COLUMNS - 1)
        at += column
        fc = k_place(columns[at - 1] if column > 0 else 0.0, columns[at], v)
        # evenly by solid angle: sin^2(theta / 2) is linear in it
        low = np.sin(0.5 * HALF_PI * (row / ROWS) ** 2) ** 2
        high = np.sin(0.5 * HALF_PI * ((row + 1.0) / ROWS) ** 2) ** 2
        t = 2.0 * np.arcsin(np.sqrt(low + fr * (high - low)))
        p = TWO_PI * (column + fc) / COLUMNS
        if turns == 1:
            p += np.arctan2(y, x)
        hx, hy, hz = np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)
        up = abs(z)
        cosine = 2.0 * (x * hx + y * hy + up * hz)
        sign = side if part == 0 else -side
        out[k, 0], out[k, 1] = cosine * hx - x, cosine * hy - y
        out[k, 2] = sign * (cosine * hz - up)


@kernel
def k_cell(x: float, y: float, z: float, turn: float) -> tuple[int, int, Scalar]:
    """Row, column and solid angle of the cell of a half vector, its azimuth less ``turn``."""
    across = np.sqrt(x * x + y * y)
    row = min(int(ROWS * np.sqrt(np.arctan2(across, z) / HALF_PI)), ROWS - 1)
    p = (np.arctan2(y, x) - turn) / TWO_PI
    column = min(int((p - np.floor(p)) * COLUMNS), COLUMNS - 1)
    low = np.sin(0.5 * HALF_PI * (row / ROWS) ** 2) ** 2
    high = np.sin(0.5 * HALF_PI * ((row + 1.0) / ROWS) ** 2) ** 2
    return row, column, 2.0 * (high - low) * TWO_PI / COLUMNS


@row_kernel
def _pdf(
    begin: int,
    end: int,
    wi: Float64Array,
    wo: Float64Array,
    out: Float64Array,
    turns: int,
    theta: Float64Array,
    chance: Float64Array,
    cells: Float64Array,
    rows: Float64Array,
    columns: Float64Array,
) -> None:
    for k in range(begin, end):
        x, y, z = wo[k, 0], wo[k, 1], wo[k, 2]
        side = 1.0 if z > 0.0 else -1.0
        views, weights = k_views(theta, turns, x, y, z)
        turn = np.arctan2(y, x) if turns == 1 else 0.0
        total = 0.0
        for part in range(2):  # half vectors of wi, and of its mirror image
            toward = side * wi[k, 2] if part == 0 else -side * wi[k, 2]
            hx, hy, hz = wi[k, 0] + x, wi[k, 1] + y, toward + abs(z)
            length = np.sqrt(hx * hx + hy * hy + hz * hz)
            cosine = (x * hx + y * hy + abs(z) * hz) / max(length, 1e-300)
            row, column, area = k_cell(hx, hy, max(hz, 0.0), turn)
            for n in range(4):
                if weights[n] == 0.0:
                    continue
                s = views[n]
                before = chance[s, 0] if part == 1 else 0.0
                if hz > 0.0 and cosine > 0.0 and chance[s, part] > before:
                    lobe = (chance[s, part] - before) * cells[s, part, row, column]
                    total += weights[n] * lobe / (area * 4.0 * cosine)
                if toward > 0.0:
                    even = chance[s, part + 2] - chance[s, part + 1]
                    total += weights[n] * even * toward / np.pi
        out[k] = total
