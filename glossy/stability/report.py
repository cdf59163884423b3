"""The report of the hard cases: summary by group, what failed, the furnace table, the figure."""

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

from .checks import Result

Path = str | os.PathLike[str]


def groups(results: Sequence[Result]) -> dict[str, list[Result]]:
    """Results by group, in the order of the catalogue."""
    found: dict[str, list[Result]] = {}
    for result in results:
        found.setdefault(result.group, []).append(result)
    return found


def worst(results: Sequence[Result]) -> dict[str, float]:
    """Largest of each figure."""
    found: dict[str, float] = {}
    for result in results:
        for name, value in result.measured.items():
            found[name] = max(found.get(name, -math.inf), value)
    return found


def markdown(results: Sequence[Result], furnace: Sequence[Mapping[str, Any]]) -> str:
    """The report as Markdown."""
    bad = [r for r in results if not r.holds]
    total = f"{len(results)} hard cases, {len(bad)} of them beyond what is guaranteed."
    lines = ["# Hard cases", "", total, ""]
    lines += [
        "| group | cases | failed | largest figures (limit of the worst) |",
        "|---|---|---|---|",
    ]
    for group, own in groups(results).items():
        failed = sum(not r.holds for r in own)
        lines.append(f"| {group} | {len(own)} | {failed} | {_figures(own)} |")
    if bad:
        lines += ["", "## Failed", ""]
        lines += [f"* {r.group}: {r.name}: {'; '.join(r.broken)}" for r in bad]
    thin = [r for r in results if r.group == "truth" and r.measured["bound"] > 0.01]
    if thin:
        lines += ["", "## Truth that ran out of work", ""]
        lines += ["Relative bound above 0.01 when the work was spent; it is still a bound.", ""]
        lines += [
            f"* {r.name}: bound {r.measured['bound']:.2g}, albedo {r.measured['albedo']:.4g}"
            for r in thin
        ]
    lines += ["", "## White furnace: radiance over albedo", "", *_table(furnace), ""]
    return "\n".join(lines)


def _figures(results: Sequence[Result]) -> str:
    parts = []
    for name, value in worst(results).items():
        at = next(r for r in results if r.measured.get(name) == value)
        limit = f" ({at.limits[name]:.1e})" if name in at.limits else ""
        parts.append(f"{name} {value:.1e}{limit}")
    return ", ".join(parts) or "none to measure"


def _table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    names = [k for k in rows[0] if not k.endswith(" error")]
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    for row in rows:
        cells = [f"{row[k]:g}" if k in ("m", "angle") else f"{row[k]:.4f}" for k in names]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def to_dict(results: Sequence[Result], furnace: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The report as JSON holds it."""
    return {
        "schema": 1,
        "command": "stability",
        "holds": all(r.holds for r in results),
        "results": [
            {
                "group": r.group,
                "name": r.name,
                "measured": r.measured,
                "limits": r.limits,
                "broken": list(r.broken),
                "holds": r.holds,
            }
            for r in results
        ],
        "furnace": [dict(row) for row in furnace],
    }


def plot(results: Sequence[Result], furnace: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Error of single precision against the view (left), furnace ratios (right), as PNG."""
    import matplotlib.figure

    from .._output import write_figure

    figure = matplotlib.figure.Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for frame, colour in (("axes", "tab:blue"), ("turned", "tab:red")):
        points: dict[float, list[float]] = {}
        limit: dict[float, float] = {}
        for r in results:
            if r.group.endswith(f"frame {frame}"):
                cosine = float(r.name.split(",")[0].rpartition("=")[2])
                points.setdefault(cosine, []).append(r.measured["auto"])
                limit[cosine] = r.limits["auto"]
        x = sorted(points)
        left.loglog(x, [max(points[c]) for c in x], "o-", color=colour, label=f"frame {frame}")
        left.loglog(x, [limit[c] for c in x], ":", color=colour, label="guaranteed")
    left.set(xlabel="wo.n", ylabel="largest relative error of float32")
    left.legend(fontsize=8)
    for name, line in (("regular/paper", "o-"), ("regular/projected", "s-"), ("importance", "^-")):
        for angle, colour in ((0.0, "tab:blue"), (60.0, "tab:green"), (80.0, "tab:red")):
            rows = [row for row in furnace if row["angle"] == angle]
            label = f"{name}, {angle:g}°"
            right.semilogx([r["m"] for r in rows], [r[name] for r in rows], line, color=colour,
                           label=label, markersize=4)  # fmt: skip
    right.axhline(1.0, color="black", linewidth=0.8)
    right.set(xlabel="m", ylabel="white furnace: radiance / albedo", ylim=(0.6, 1.4))
    right.legend(fontsize=6, ncols=3)
    write_figure(path, figure, dpi=90)
