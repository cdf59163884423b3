"""Pictures of a table beside its fit, as in the thesis: all on the cubic root of p.

* ``plane.png``: p in the plane of incidence over the outgoing angle, polar, one panel for each
  incident direction (Figs. 3.12, 3.15, 3.18). Measured green, fitted red.
* ``discs.png``: one disc for each incident direction (Figs. 2.6, 3.11, 3.14), theta_o = 0 in its
  centre and 90 degrees at its border. The light is at the top (red dot) and the sample turned under
  it: the green line is its tangent. Measured beside fitted, one scale for both.
* ``angles.png``: error and albedo over the incident angle.

Colour tables are shown by the mean of their channels.
"""

import pathlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from .._output import write_figure
from ..frames import spherical
from .fit import SIDES, Fit
from .fit_report import AngleLine
from .table import MeasuredTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Float64Array = npt.NDArray[np.float64]

MEASURED, FITTED = "#2ca02c", "#d62728"
PANELS = 7  # incident angles in a row of panels
AZIMUTHS = 7
DISC = 72  # pixels across a disc
OFF_PLANE = 0.06  # sine of the angle to the plane of incidence within which a row is drawn


def _figure(width: float, height: float) -> "Figure":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _save(figure: "Figure", path: pathlib.Path) -> None:
    write_figure(path, figure)


def _spread(values: Float64Array, n: int) -> npt.NDArray[np.intp]:
    """Indices of at most ``n`` of the values, from first to last."""
    return np.unique(np.linspace(0, len(values) - 1, min(n, len(values))).round().astype(np.intp))


class _Lights:
    """The incident directions of a table, by polar angle and azimuth [deg]."""

    def __init__(self, table: MeasuredTable) -> None:
        self.directions, self.rows = table.incident_directions()
        z = np.abs(self.directions[:, 2])
        self.theta = np.degrees(np.arccos(np.clip(z, 0.0, 1.0)))
        self.phi = np.degrees(np.arctan2(self.directions[:, 1], self.directions[:, 0])) + 0.0
        self.phi[self.theta < 1e-3] = 0.0

    def chosen_theta(self) -> Float64Array:
        values = np.unique(self.theta.round(1))
        return values[_spread(values, PANELS)]

    def chosen_phi(self, n: int) -> Float64Array:
        """At most ``n`` azimuths in [0, 180); one if the table has one."""
        if not (self.theta > 1.0).any():
            return np.zeros(1)
        values = np.unique(self.phi[self.theta > 1.0].round(1))
        half = values[(values >= 0.0) & (values < 180.0)]
        values = half if len(half) else values[:1]
        return values[_spread(values, n)]

    def nearest(self, theta: float, phi: float) -> int | None:
        """The incident direction there, or None: none within 4 degrees and 23 of azimuth."""
        turn = np.abs((self.phi - phi + 180.0) % 360.0 - 180.0)
        turn = np.where(self.theta < 1.0, 0.0, turn)
        distance = np.abs(self.theta - theta) + 0.1 * turn
        near = np.where((np.abs(self.theta - theta) < 4.0) & (turn < 23.0), distance, np.inf)
        k = int(np.argmin(near))
        return k if np.isfinite(near[k]) else None


def plane_plot(table: MeasuredTable, fit: Fit, path: pathlib.Path) -> None:
    """Cubic root of p in the plane of incidence, measured and fitted, polar."""
    lights = _Lights(table)
    thetas, phis = lights.chosen_theta(), lights.chosen_phi(PANELS)
    phis = phis[np.unique([0, int(np.argmin(np.abs(phis - phis[0] - 90.0)))])]
    sides = [side for side in SIDES if side in fit.parameters]
    height = 2.0 if len(sides) > 1 else 1.35
    figure = _figure(1.9 * len(thetas) + 0.3, height * len(phis) + 0.5)
    panels = figure.subplots(len(phis), len(thetas), squeeze=False)
    for row, phi in zip(panels, phis, strict=True):
        for panel, theta in zip(row, thetas, strict=True):
            panel.set_axis_off()
            k = lights.nearest(theta, phi)
            if k is not None:
                turn = float(phi if lights.theta[k] < 1.0 else lights.phi[k])
                _plane_panel(panel, table.select(lights.rows[k]), fit, sides, turn)
                title = f"θi {lights.theta[k]:.0f}°, φi {turn % 360.0:.0f}°"
                panel.set_title(title, fontsize=9)
    words = f"Cubic root of p [1/sr] in the plane of incidence: measured green, {fit.model} fit red"
    figure.suptitle(f"{words}; the light is on the left (dotted)", fontsize=10)
    _save(figure, path)


def _plane_panel(
    panel: Any, rows: MeasuredTable, fit: Fit, sides: Sequence[str], phi: float
) -> None:
    """One incident direction: distance from the middle is p^(1/3), the angle theta_o."""
    light = rows.wi[0]
    up = float(np.sign(light[2]))
    turn = np.radians(phi)
    forward = np.array([-np.cos(turn), -np.sin(turn), 0.0])  # away from the light
    normal = np.array([0.0, 0.0, up])
    p = rows.transfer.mean(axis=1)
    across = np.abs(rows.wo[:, 0] * forward[1] - rows.wo[:, 1] * forward[0])
    near = (across < OFF_PLANE) & (p != 0.0)
    radius = np.cbrt(np.maximum(p[near], 0.0))
    top = float(radius.max(initial=1e-6))
    wo = rows.wo[near]
    panel.plot(radius * (wo @ forward), radius * (wo @ normal), ".", color=MEASURED, markersize=3.5)
    angle = np.radians(np.linspace(-89.9, 89.9, 721))
    for side in sides:
        z = up if side == "reflection" else -up
        out = np.sin(angle)[:, None] * forward + z * np.cos(angle)[:, None] * [0.0, 0.0, 1.0]
        model = np.cbrt(np.maximum(fit.eval(light, out).mean(axis=1) * np.cos(angle), 0.0))
        top = max(top, float(model.max()))
        panel.plot(model * np.sin(angle), z * up * model * np.cos(angle), color=FITTED, lw=1.1)
    ring = np.linspace(-0.5, 0.5, 91) * np.pi
    for part in (0.5, 1.0):
        for z in (1.0, -1.0)[: len(sides)] if sides[0] == "reflection" else (-1.0,):
            x, y = part * top * np.sin(ring), z * part * top * np.cos(ring)
            panel.plot(x, y, color="#cccccc", lw=0.6, zorder=0)
    panel.plot([-top, top], [0.0, 0.0], color="#888888", lw=0.8, zorder=0)
    tip = top * light
    panel.plot([0.0, tip @ forward], [0.0, tip @ normal], ":", color="#666666", lw=1.0)
    panel.text(top, 0.0, f"{top:.2g}", fontsize=7, ha="right", va="top", color="#666666")
    panel.set_aspect("equal")


def _disc_directions(phi: float, sign: float) -> tuple[Float64Array, npt.NDArray[np.bool_]]:
    """Directions (DISC, DISC, 3) of a disc's pixels with the light at the top, and the inside."""
    x = (np.arange(DISC) + 0.5) / DISC * 2.0 - 1.0
    xx, yy = np.meshgrid(x, -x)
    radius = np.hypot(xx, yy)
    turn = np.arctan2(yy, xx) - 0.5 * np.pi + np.radians(phi)
    out = spherical(np.minimum(radius, 1.0) * np.radians(89.9), turn)
    out[..., 2] *= sign
    return out, radius < 0.98


def _disc(
    table: MeasuredTable, fit: Fit, rows: npt.NDArray[np.intp], light: Float64Array, phi: float
) -> tuple[Float64Array, Float64Array]:
    """Cubic root of p (DISC, DISC), measured (nearest row) and fitted; NaN outside."""
    wo = table.wo[rows]
    sign = float(np.sign(np.median(wo[:, 2])))
    out, inside = _disc_directions(phi, sign)
    tree = cKDTree(wo)
    spacing = float(np.median(tree.query(wo, k=min(2, len(wo)))[0][:, -1])) if len(wo) > 1 else 0.1
    distance, nearest = tree.query(out[inside])
    values = table.transfer[rows].mean(axis=1)[nearest]
    values = np.where(distance < max(4.0 * spacing, 0.05), values, 0.0)
    measured, fitted = np.full((DISC, DISC), np.nan), np.full((DISC, DISC), np.nan)
    measured[inside] = np.cbrt(np.maximum(values, 0.0))
    model = fit.eval(light, out[inside]).mean(axis=1) * np.abs(out[inside][:, 2])
    fitted[inside] = np.cbrt(np.maximum(model, 0.0))
    return measured, fitted


def discs_plot(table: MeasuredTable, fit: Fit, path: pathlib.Path) -> None:
    """Discs of all outgoing directions, measured beside fitted, thesis Figs. 2.6 and 3.11."""
    parts = [
        (side, part)
        for side, part in (("reflection", table.reflection), ("transmission", table.transmission))
        if side in fit.parameters and len(part)
    ]
    first = _Lights(parts[0][1])
    thetas, phis = first.chosen_theta(), first.chosen_phi(AZIMUTHS)
    across = len(phis) == 1  # isotropic: angles from left to right, as in Fig. 3.14
    height, width = (1, len(thetas)) if across else (len(thetas), len(phis))
    blocks = [(side, part, kind) for side, part in parts for kind in ("measured", "fitted")]
    columns = 1 if across else 2
    rows = len(blocks) // columns
    figure = _figure(0.72 * width * columns + 1.6, (0.76 * height + 0.42) * rows + 0.7)
    panels = figure.subplots(rows, columns, squeeze=False)
    for index, (side, part) in enumerate(parts):
        lights = _Lights(part)
        pictures = [np.full((height * DISC, width * DISC), np.nan) for _ in range(2)]
        centres = []
        for i, theta in enumerate(thetas):
            for j, phi in enumerate(phis):
                k = lights.nearest(theta, phi)
                if k is None:
                    continue
                turn = phi if lights.theta[k] < 1.0 else float(lights.phi[k])
                row, column = (0, i) if across else (i, j)
                place = np.s_[row * DISC : (row + 1) * DISC, column * DISC : (column + 1) * DISC]
                two = _disc(part, fit, lights.rows[k], lights.directions[k], turn)
                for picture, disc in zip(pictures, two, strict=True):
                    picture[place] = disc
                centres.append(((column + 0.5) * DISC, (row + 0.5) * DISC, turn))
        finite = pictures[0][np.isfinite(pictures[0])]
        top = float(np.percentile(finite, 99.9)) if finite.size else 1.0
        for kind, picture in enumerate(pictures):
            at = 2 * index + kind
            panel = panels[at // columns, at % columns]
            shown = panel.imshow(
                picture, cmap="gray", vmin=0.0, vmax=max(top, 1e-6), interpolation="nearest"
            )
            panel.set_title(f"{side}, {('measured', fit.model + ' fit')[kind]}", fontsize=9)
            _mark(panel, centres)
            _ticks(panel, thetas, phis, across)
        own = panels.reshape(-1)[2 * index : 2 * index + 2].tolist()
        bar = figure.colorbar(shown, ax=own, shrink=0.9, pad=0.01)
        bar.ax.tick_params(labelsize=7)
        bar.set_label("p^(1/3)", fontsize=8)
    figure.suptitle("All outgoing directions; light at the top, green: the tangent", fontsize=10)
    _save(figure, path)


def _mark(panel: Any, centres: Sequence[tuple[float, float, float]]) -> None:
    """The light's dot and the tangent's line on every disc."""
    for x, y, phi in centres:
        panel.plot(x, y - 0.47 * DISC, "o", color="#ff2020", markersize=2.6)
        turn = 0.5 * np.pi - np.radians(phi)  # of the tangent, seen with the light at the top
        dx, dy = 0.49 * DISC * np.cos(turn), -0.49 * DISC * np.sin(turn)
        for near, far in ((0.86, 1.0), (-1.0, -0.86)):
            panel.plot(
                [x + near * dx, x + far * dx],
                [y + near * dy, y + far * dy],
                color="#20d020",
                lw=1.4,
            )


def _ticks(panel: Any, thetas: Float64Array, phis: Float64Array, across: bool) -> None:
    centre = (np.arange(max(len(thetas), len(phis))) + 0.5) * DISC
    if across:
        panel.set_xticks(centre[: len(thetas)], [f"{v:.0f}°" for v in thetas], fontsize=7)
        panel.set_yticks([])
        panel.set_xlabel("θi", fontsize=8)
    else:
        panel.set_xticks(centre[: len(phis)], [f"{v:.0f}°" for v in phis], fontsize=7)
        panel.set_yticks(centre[: len(thetas)], [f"{v:.0f}°" for v in thetas], fontsize=7)
        panel.set_xlabel("φi", fontsize=8)
        panel.set_ylabel("θi", fontsize=8)


def angles_plot(lines: Sequence[AngleLine], fit: Fit, path: pathlib.Path) -> None:
    """Error and albedo over the incident angle."""
    figure = _figure(8.4, 3.3)
    left, right = figure.subplots(1, 2)
    for side, mark in (("reflection", "o"), ("transmission", "s")):
        own = [x for x in lines if x.side == side]
        if not own:
            continue
        theta = [x.theta for x in own]
        left.plot(theta, [x.error for x in own], f"-{mark}", color="#333333", label=side, ms=4)
        right.plot(
            theta, [x.measured for x in own], mark, color=MEASURED, label=f"{side}, measured"
        )
        right.plot(
            theta,
            [x.fitted for x in own],
            f"-{mark}",
            color=FITTED,
            ms=3,
            label="fitted, same rows",
        )
        right.plot(theta, [x.model for x in own], "--", color=FITTED, label="fitted, whole")
    left.set_ylabel(f"error ({fit.metric})")
    right.set_ylabel("albedo")
    for panel in (left, right):
        panel.set_xlabel("incident angle θi [°]")
        panel.set_ylim(bottom=0.0)
        panel.grid(color="#dddddd", linewidth=0.6)
        panel.legend(fontsize=7.5)
    _save(figure, path)


def write_plots(
    table: MeasuredTable, fit: Fit, lines: Sequence[AngleLine], folder: pathlib.Path
) -> None:
    """Write ``plane.png``, ``discs.png`` and ``angles.png`` into a folder that exists."""
    plane_plot(table, fit, folder / "plane.png")
    discs_plot(table, fit, folder / "discs.png")
    angles_plot(lines, fit, folder / "angles.png")
