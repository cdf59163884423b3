"""The taps of one elongation as text or as a picture; a shader holds those of all (``export``)."""

import csv
import io
import json
import pathlib

import numpy as np

from .. import _check
from .._output import write_figure
from ..export.tables import write
from .table import lattice_taps

FORMATS = ("json", "csv")
PICTURES = (".png", ".pdf", ".svg")


def export(
    samples: int, elongation: float, form: str, path: str | pathlib.Path | None = None
) -> str:
    """Places (z1, z2) in units of (s1, s2), weights, and the taps' width in units of s2.

    JSON also holds the coefficients: z1, z2, log w of every tap, five each, and log2 of the width.

    Raises
    ------
    ValueError
        For an unknown form, an elongation below 1, or a budget below 1.
    """
    _check.choice("format", form, FORMATS)
    taps = lattice_taps(samples)
    place, weight, width = taps.at(elongation)
    rows = np.column_stack([place, weight]).tolist()
    if form == "csv":
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(["z1", "z2", "weight", "width"])
        writer.writerows([*row, width] for row in rows)
        text = out.getvalue()
    else:
        data = {
            "schema": 1, "method": "lattice", "samples": len(taps), "elongation": elongation,
            "width": width, "taps": rows, "coefficients": taps.rows.tolist(),
            "log2_width": taps.log2_width.tolist(),
        }  # fmt: skip
        text = json.dumps(data, indent=1) + "\n"
    write(text, path)
    return text


def plot(samples: int, elongation: float, path: str | pathlib.Path) -> None:
    """Draw the taps in the plane of directions, in units of s2; a disc of radius width for each."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Ellipse

    if pathlib.Path(path).suffix.lower() not in PICTURES:
        raise _check.fail("plot", "must end in .png, .pdf or .svg", str(path))
    place, weight, width = lattice_taps(samples).at(elongation)
    at = place * [elongation, 1.0]
    figure = Figure(figsize=(8.0, 4.8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for radius in (1.0, 2.0):
        size = (2.0 * radius * elongation, 2.0 * radius)
        label = f"{radius:g} standard deviations of the lobe"
        axes.add_patch(Ellipse((0.0, 0.0), *size, fill=False, edgecolor="C1", label=label))
    for centre, share in zip(at, weight / weight.max(), strict=True):
        axes.add_patch(Circle(tuple(centre), width, color="C0", alpha=0.35 * share, linewidth=0))
    axes.plot(*at.T, "k.", label=f"{len(at)} taps; disc: one standard deviation, dark: weight")
    reach = np.maximum(np.abs(at).max(axis=0) + width, 2.1 * np.array([elongation, 1.0]))
    axes.set(
        xlim=(-reach[0], reach[0]), ylim=(-reach[1], reach[1]),
        aspect="equal" if elongation <= 8.0 else "auto",
        xlabel="along the major axis / s2", ylabel="along the minor axis / s2",
        title=f"lattice, elongation {elongation:g}",
    )  # fmt: skip
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    write_figure(path, figure, dpi=110)
