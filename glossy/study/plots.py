"""Plots of a study: error against time, and pictures beside the truth as in the paper's figures.

Pictures are exposed so that the truth's 95th percentile is white, then sRGB encoded; the exposure
is printed. Differences are |image - truth| in luminance over the truth's RMS, one scale for each
row.
"""

import pathlib
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .._output import write_figure
from ..image_write import encode_srgb
from .bench import comparable
from .claims import Table
from .measure import LUMINANCE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .bench import Cell
    from .run import Study

FloatArray = npt.NDArray[np.floating]

COLOURS = ("#0072b2", "#009e73", "#e69f00", "#d55e00", "#cc79a7", "#56b4e9", "#000000")
MARKERS = ("o", "s", "D", "^", "v", "P", "X")
WHITE = 95.0  # percentile of the truth's luminance that becomes white
PICTURE_ROWS = (14, 30, 270)


def _figure(width: float, height: float) -> "Figure":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _save(figure: "Figure", path: pathlib.Path) -> None:
    write_figure(path, figure)


def speed_against_error(cells: Sequence["Cell"], path: pathlib.Path, subtitle: str) -> None:
    """Relative RMS error over CPU time per pixel, log-log, one panel for each case.

    The time is ``cpu_ratio`` in units of the baseline's least time, so that a machine which slows
    down for a while moves no marker.
    Filled markers and full lines have the best bias, hollow ones and dashed lines none; the
    numbers are samples. Where the truth's own error is large enough to be seen it is shaded.
    Cells whose times must not be compared with the others are left out (``comparable``).
    """
    from matplotlib.lines import Line2D
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    whole, cells = len(cells), comparable(cells)
    if cells[0].loaded:
        subtitle += ", times under load"
    if len(cells) < whole:
        subtitle += f", {len(cells)} of {whole} cells"
    table, unit = Table(cells), baseline_microseconds(cells)
    methods = list(dict.fromkeys(c.method for c in cells))
    width = max(5.2, 4.4 * len(table.cases))
    figure = _figure(width, 4.9)
    panels = figure.subplots(1, len(table.cases), sharex=True, sharey=True, squeeze=False)[0]
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    for panel, case in zip(panels, table.cases, strict=True):
        for k, method in enumerate(methods):
            style = {**_style(k), "markersize": 5.5}
            for bias, line in (("zero", "--"), ("best", "-")):
                row = table.line(method, case, bias)
                x = [unit * c.cpu_ratio for c in row]
                y = [100.0 * c.relative_rms for c in row]
                face = "white" if bias == "zero" else style["color"]
                alpha = 0.65 if bias == "zero" else 1.0
                panel.plot(x, y, line, linewidth=1.4, markerfacecolor=face, alpha=alpha, **style)
        free = 0.0  # where the next number may stand without touching the one before
        for budget in table.budgets:
            own = [c for c in cells if (c.case, c.budget) == (case, budget)]
            free = _count(panel, own, unit, free)
        doubt = max(100.0 * c.truth_error / c.truth_level for c in cells if c.case == case)
        if doubt > 0.0:
            panel.axhline(doubt, color="#999999", linewidth=1.0)
            panel.axhspan(doubt * 1e-3, doubt, color="#999999", alpha=0.18, linewidth=0)
        words = f"truth known to ±{doubt:.2g} %"
        panel.text(0.03, 0.03, words, transform=panel.transAxes, fontsize=8.5, color="#444444")
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_title(_wrapped(case, 4.0), fontsize=11)
        panel.set_xlabel("CPU time per pixel [µs, one thread]")
        panel.grid(visible=True, which="major", color="#d8d8d8", linewidth=0.7)
        panel.grid(visible=True, which="minor", color="#eeeeee", linewidth=0.4)
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(LogLocator(base=10.0, subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(plain)
            axis.set_minor_formatter(NullFormatter())
    panels[0].set_ylabel("RMS error / RMS of the truth [%]")
    errors = [100.0 * c.relative_rms for c in cells if c.relative_rms > 0.0]
    if errors:
        panels[0].set_ylim(0.4 * min(errors), 1.5 * max(errors))
    low, high = panels[0].get_xlim()
    if high < 2.0 * low:  # ticks of a scale shorter than this tell noise apart
        middle = (low * high) ** 0.5
        panels[0].set_xlim(middle / 2.0**0.5, middle * 2.0**0.5)
    handles = [Line2D([], [], **_style(k), label=method) for k, method in enumerate(methods)]
    handles += [
        Line2D([], [], color="#555555", label="best bias"),
        Line2D([], [], color="#555555", linestyle="--", label="bias 0"),
    ]
    figure.set_figheight(4.7 + 0.2 * _legend(figure, handles))
    figure.suptitle(_wrapped(f"Error against time. {subtitle}", width), fontsize=11)
    _save(figure, path)


def _style(k: int) -> dict[str, Any]:
    """Colour and marker of the k-th method; colours come back with other markers."""
    return {"color": COLOURS[k % 7], "marker": MARKERS[(k + k // 7) % 7]}


def _wrapped(text: str, width: float) -> str:
    """A figure's title in lines that ``width`` inches hold."""
    return textwrap.fill(text, int(11 * width))


def _legend(figure: "Figure", handles: Sequence[Any]) -> int:
    """Put the legend below the panels, in as many rows as its width needs; returns their number."""
    for columns in range(len(handles), 0, -1):
        legend = figure.legend(
            handles=handles, loc="outside lower center", ncols=columns, fontsize=9
        )
        if columns == 1 or legend.get_window_extent().width <= 0.98 * figure.bbox.width:
            break
        legend.remove()
    return -(-len(handles) // columns)


def baseline_microseconds(cells: Sequence["Cell"]) -> float:
    """Least CPU time of the baseline [us per pixel, one thread]: the unit of ``cpu_ratio``."""
    return 1e6 * min(c.cpu_seconds / (max(c.cpu_ratio, 1e-9) * c.pixels) for c in cells)


def _count(panel: Any, cells: Sequence["Cell"], unit: float, free: float) -> float:
    """The samples of one budget below the lowest of its markers, if there is room from ``free``."""
    shown = [c for c in cells if c.relative_rms > 0.0 and c.bias_kind == "best"]
    if not shown:
        return free
    x = unit * float(np.exp(np.mean([np.log(c.cpu_ratio) for c in shown])))
    if x < free:
        return free
    y = 100.0 * min(c.relative_rms for c in shown)
    style: dict[str, Any] = {"ha": "center", "fontsize": 8.5, "color": "#333333"}
    text = f"n={shown[0].samples}"
    panel.annotate(text, (x, y), (0, -17), textcoords="offset points", **style)
    return 1.35 * x


def _grid(values: FloatArray, seen: npt.NDArray[np.bool_], background: float) -> FloatArray:
    out = np.full((*seen.shape, *values.shape[1:]), background)
    out[seen] = values
    return out


def pictures(study: "Study", case_name: str, bias_kind: str, path: pathlib.Path) -> bool:
    """Rows of budgets; columns: two methods, the truth, and the two false-colour differences.

    Returns
    -------
    False if fewer than two methods were measured, and then nothing is written.
    """
    names = [m.label for m in study.plan.methods]
    first = ("regular/paper", "importance")
    wanted = [n for n in names if n in first]
    wanted += [n for n in names if n not in wanted]
    if len(names) < 2:
        return False
    pair = wanted[:2]
    table = Table(study.cells)
    budgets = [n for n in PICTURE_ROWS if n in table.budgets] or table.budgets[:3]
    case = next(c for c in study.plan.cases if c.name == case_name)
    truth = np.asarray(study.truths[case_name].radiance)
    level = float(np.sqrt(np.mean(np.square(truth))))
    white = max(float(np.percentile(truth @ LUMINANCE, WHITE)), 1e-12)
    rows: list[list[tuple[Cell, FloatArray]]] = []
    for budget in budgets:
        row = []
        for label in pair:
            method = next(m for m in study.plan.methods if m.label == label)
            line = table.line(label, case_name, bias_kind) or table.line(label, case_name, "zero")
            cell = next((c for c in line if c.budget == budget), line[0])
            row.append(
                (cell, np.asarray(study.bench.image(case, method, cell.budget, cell.bias), float))
            )
        rows.append(row)
    height, width = study.bench.seen.shape
    aspect = height / width
    figure = _figure(12.6, 2.3 * aspect * len(budgets) + 0.35 * len(budgets) + 0.9)
    panels = figure.subplots(len(budgets), 5, squeeze=False)

    def show(panel: Any, values: FloatArray) -> None:
        encoded = encode_srgb(np.clip(_grid(values, study.bench.seen, 0.0) / white, 0.0, 1.0))
        panel.imshow(encoded, interpolation="nearest")

    for panel_row, row in zip(panels, rows, strict=True):
        for panel, (cell, image) in zip(panel_row[:2], row, strict=True):
            show(panel, image)
            xi = f", ξ={cell.threshold:g}" if cell.threshold is not None else ""
            bias = f", bias {cell.bias:+.2f}" if bias_kind == "best" else ""
            panel.set_title(f"{cell.method}\nn={cell.samples}{xi}{bias}", fontsize=9)
        show(panel_row[2], truth)
        panel_row[2].set_title("truth\n(texel quadrature)", fontsize=9)
        errors = [100.0 * np.abs((image - truth) @ LUMINANCE) / level for _, image in row]
        top = max(float(np.percentile(np.concatenate(errors), 99.5)), 1e-12)
        for panel, (cell, _), error in zip(panel_row[3:], row, errors, strict=True):
            grid = np.ma.masked_array(_grid(error, study.bench.seen, 0.0), ~study.bench.seen)
            scale = panel.imshow(grid, cmap="inferno", vmin=0.0, vmax=top, interpolation="nearest")
            panel.set_facecolor("#3a3a3a")
            figures = f"RMS {100.0 * cell.relative_rms:.3g} %"
            panel.set_title(f"|{cell.method} − truth|\n{figures}", fontsize=9)
        bar = figure.colorbar(scale, ax=panel_row[4], shrink=0.95, extend="max")
        bar.set_label("% of the truth's RMS", fontsize=8.5)
        bar.ax.tick_params(labelsize=8.5)
        for panel in panel_row:
            panel.set_xticks([])
            panel.set_yticks([])
    bias = "with the best level bias" if bias_kind == "best" else "without level bias"
    tone = f"white = radiance {white:.3g}, the truth's {WHITE:g}th percentile; sRGB"
    figure.suptitle(_wrapped(f"{case_name}, {bias}   ({tone})", 12.6), fontsize=11)
    _save(figure, path)
    return True
