"""The results as text: tables for the terminal, report.md, study.json and study.csv."""

import csv
import dataclasses
import io
import json
import math
import textwrap
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .bench import CPU_TOLERANCE, Cell, comparable
from .claims import Claim, Table
from .measure import BLOCK
from .preparation import WIDER

if TYPE_CHECKING:
    from .run import Study

SCHEMA = 1
WIDTH = 100  # characters of a line of a table
PICTURES = """\
Radiance is shown sRGB encoded, with one white for all pictures of a figure, chosen from its truth
and printed above it; brighter pixels are clipped. The false colours are |image - truth| in
luminance, in percent of the truth's RMS; the scale of each row ends at the 99.5th percentile of
its two differences.
"""
PREPARATION = f"""\
CPU time on one thread of what a method makes anew when the map changes, and when the lobes become
{WIDER:g} times as wide; the memory of it, without the map itself. Compiled beforehand.
"""


def error_table(cells: Sequence[Cell]) -> str:
    """Relative RMS error [%], without and with the best bias, one block for each case.

    Budgets that a line of ``WIDTH`` characters does not hold follow in further blocks.
    """
    table = Table(cells)
    methods = list(dict.fromkeys(c.method for c in cells))
    width = max(len(m) for m in methods) + 2
    lines = []
    for case in table.cases:
        own = [c for c in cells if c.case == case]
        doubt = 100.0 * own[0].truth_error / max(own[0].truth_level, 1e-300)
        lines.append(f"{case}: RMS error / RMS of the truth [%], truth +-{doubt:.2g} %")
        counts = [next((c.samples for c in own if c.budget == n), None) for n in table.budgets]
        rows = [("", "samples", ["" if n is None else str(n) for n in counts])]
        for method in methods:
            zero, best = (table.row(method, case, b) for b in ("zero", "best"))
            rows.append((method, "bias 0", _texts(zero, _percent)))
            rows.append(("", "best bias", _texts(best, _percent)))
            rows.append(("", "   (bias)", _texts(best, lambda c: f"{c.bias:+.2f}")))
        lines += _blocks(rows, width)
    return "\n".join(lines)


def _blocks(rows: Sequence[tuple[str, str, list[str]]], width: int) -> list[str]:
    """Rows of columns as lines, in as many blocks as ``WIDTH`` needs, each with an empty line."""
    most = max(1, (WIDTH - 2 - width - 11) // 8)
    lines = []
    for start in range(0, max(len(values) for _, _, values in rows), most):
        lines += [_row(m, label, values[start : start + most], width) for m, label, values in rows]
        lines.append("")
    return lines


def _texts(row: Sequence[Cell | None], text: Callable[[Cell], str]) -> list[str]:
    return ["" if cell is None else text(cell) for cell in row]


def time_table(cells: Sequence[Cell]) -> str:
    """Times of the bias-0 cells on one thread: of a picture, over the baseline's, per sample.

    Times that must not be compared with the others of the table are left out (``comparable``).
    """
    shown = {id(c) for c in comparable(cells)}
    table = Table(cells)
    methods = list(dict.fromkeys(c.method for c in cells))
    width = max(len(m) for m in methods) + 2
    lines = []
    for case in table.cases:
        lines.append(f"{case}: time of a picture on one thread; CPU time over the baseline's")
        rows = []
        for method in methods:
            row = [c if id(c) in shown else None for c in table.row(method, case, "zero")]
            for label, name, unit in (
                ("CPU ms", "cpu_seconds", 1e3),
                ("wall ms", "seconds", 1e3),
                ("CPU ratio", "cpu_ratio", 1.0),
                ("CPU ns/tap", "ns_per_sample", 1.0),
            ):
                texts = ["" if c is None else f"{unit * getattr(c, name):.3g}" for c in row]
                rows.append((method if label == "CPU ms" else "", label, texts))
        lines += _blocks(rows, width)
    note = time_note(cells)
    return "\n".join([*lines, *([note, ""] if note else [])])


def time_note(cells: Sequence[Cell]) -> str:
    """What must be said about the times: taken under load, or not all shown. Empty: nothing."""
    shown = comparable(cells)
    notes = []
    if shown and shown[0].loaded:
        notes.append("Times were taken while other cells ran: compare them with no others.")
    if len(shown) < len(cells):
        notes.append(
            f"Times of {len(cells) - len(shown)} of {len(cells)} cells are left out: taken under "
            "load or on another processor."
        )
    return " ".join(notes)


def preparation_table(study: "Study") -> str:
    """What each method needs before its first picture, as Markdown."""
    rows = [
        "case | method | new map [ms] | new material [ms] | memory [MB]",
        "---|---|---:|---:|---:",
    ]
    for p in study.preparations:
        figures = (1e3 * p.new_map_seconds, 1e3 * p.new_material_seconds, 1e-6 * p.bytes)
        rows.append(" | ".join([p.case, p.method, *(f"{value:.3g}" for value in figures)]))
    return "\n".join(f"| {row} |" for row in rows)


def processor_note(cells: Sequence[Cell]) -> str:
    """How far errors of different processors may differ; empty for one processor."""
    models = sorted({c.cpu for c in cells})
    if len(models) < 2:
        return ""
    return (
        f"Measured on {len(models)} models of processor ({', '.join(models)}): an RMS error "
        f"without bias may differ between them by {CPU_TOLERANCE:g} of the truth's RMS.\n"
    )


def _row(method: str, label: str, values: Sequence[str], width: int) -> str:
    return f"  {method:<{width}}{label:<11}" + "".join(f"{v:>8}" for v in values)


def _percent(cell: Cell) -> str:
    value = 100.0 * cell.relative_rms
    return f"{value:.4g}" if value < 1.0 else f"{value:.2f}"


def claim_lines(claims: Sequence[Claim]) -> str:
    """Verdict, statement and numbers of each claim, in lines of ``WIDTH`` characters."""
    lines = []
    for claim in claims:
        head = f"  {claim.verdict.upper():<19} "
        for first, text in ((head, f"{claim.statement} [{claim.source}]"), ("", claim.numbers)):
            lines += textwrap.wrap(
                text, WIDTH, initial_indent=f"{first:<22}", subsequent_indent=22 * " "
            )
    return "\n".join(lines)


def variant_table(variants: dict[str, list[Claim]]) -> str:
    """Verdicts of the claims with each regular variant in place of the paper's, as Markdown."""
    names = list(variants)
    rows = [["claim", *names], ["---"] * (len(names) + 1)]
    for first in variants[names[0]]:
        row = [first.id]
        for name in names:
            same = [c for c in variants[name] if c.id.replace(name, names[0]) == first.id]
            row.append(same[0].verdict if same else "")
        rows.append(row)
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def to_csv(cells: Sequence[Cell]) -> str:
    """One line for each cell; lists are joined by spaces, None is empty."""
    stream = io.StringIO()
    names = [f.name for f in dataclasses.fields(Cell) if f.name != "search"]
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(names)
    for cell in cells:
        values = [getattr(cell, name) for name in names]
        writer.writerow([" ".join(map(str, v)) if isinstance(v, list) else v for v in values])
    return stream.getvalue()


def to_dict(
    study: "Study", variants: dict[str, list[Claim]], pictures: Sequence[str]
) -> dict[str, Any]:
    """The whole study, fit for JSON."""
    truths = [
        {"case": name, "error_kind": t.kind, "rms_error": t.rms_error, "seconds": t.seconds}
        for name, t in study.truths.items()
    ]
    claims = {name: [dataclasses.asdict(c) for c in found] for name, found in variants.items()}
    value = {
        "schema": SCHEMA,
        "command": "study",
        "settings": study.settings,
        "sessions": study.store.sessions,
        "baseline": _baseline(study),
        "truths": truths,
        "cells": [dataclasses.asdict(c) for c in study.cells],
        "preparations": [dataclasses.asdict(p) for p in study.preparations],
        "claims": claims,
        "pictures": list(pictures),
    }
    return _without_infinities(value)  # type: ignore[no-any-return]


def _baseline(study: "Study") -> str:
    case, method, budget = study.plan.reference
    if dataclasses.replace(study.plan, baseline=None).reference == study.plan.reference:
        return "first case, first method, smallest budget, bias 0"
    return f"{case}, {method}, budget {budget}, bias 0"


def _without_infinities(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_infinities(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_without_infinities(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def markdown(study: "Study", variants: dict[str, list[Claim]], pictures: Sequence[str]) -> str:
    """report.md."""
    s = study.settings
    first = next(iter(variants), None)
    thresholds = ", ".join(f"{n}: {xi:g}" for n, xi in s["thresholds"].items())
    parts = [
        "# Study: speed against error\n",
        f"Environment `{s['environment']}`, cube map of {s['cube_size']}, pyramid {s['filter']}; "
        f"picture {s['width']} x {s['height']}, {s['pixels']} covered pixels. Threshold for each "
        f"budget: {thresholds}. All methods of a budget take the count the regular pattern "
        "reaches. Best bias: least RMS error over "
        f"about {s['bias_search_pixels']} of the pixels; errors are over all of them.\n",
        *(["Reproduce with\n", f"```\n{study.command}\n```\n"] if study.command else []),
        "## The truth\n",
        truth_table(study),
        "",
        "Verdicts and errors hold up to this: an error against the truth differs from that against "
        "the exact integral by no more.\n",
        "## Which of the paper's claims hold in these runs\n",
    ]
    if first is None:
        parts.append("Needs a regular method and `importance`.\n")
    else:
        parts.append(f"{first} against importance:\n")
        parts += [
            f"* **{c.verdict}** ({c.id}): {c.statement} [{c.source}]" + _indented(c.numbers)
            for c in variants[first]
        ]
        parts.append("")
    if len(variants) > 1:
        parts += ["The same with the other regular variants:\n", variant_table(variants), ""]
    parts += [
        "## Errors\n",
        processor_note(study.cells),
        "```",
        error_table(study.cells).rstrip(),
        "```\n",
    ]
    parts += ["![error against time](speed.png)\n", "## Times\n"]
    parts += [_timing(study), "```", time_table(study.cells).rstrip(), "```\n"]
    parts += ["## Before the first picture\n", PREPARATION, preparation_table(study), ""]
    if pictures:
        parts += ["## Pictures\n", PICTURES]
        parts += [f"![{name}]({name})\n" for name in pictures]
    return "\n".join(parts)


def _indented(text: str) -> str:
    """A line break of Markdown and the text in lines that belong to the item above."""
    lines = textwrap.wrap(text, WIDTH, initial_indent="  ", subsequent_indent="  ")
    return "".join(["  \n" * bool(text), "\n".join(lines)])


def truth_table(study: "Study") -> str:
    """How the truth of each case was found and how well it is known, as Markdown."""
    rows = ["case | RMS of the truth | RMS of its error | relative | kind | seconds"]
    rows.append(" | ".join(["---"] * 6))
    for name, truth in study.truths.items():
        level = float(np.sqrt(np.mean(np.square(truth.radiance))))
        share = f"{100.0 * truth.rms_error / level:.2g} %" if level > 0.0 else "-"
        figures = f"{level:.5g} | {truth.rms_error:.2g} | {share}"
        rows.append(f"{name} | {figures} | {truth.kind} | {truth.seconds:.3g}")
    return "\n".join(f"| {row} |" for row in rows)


def _timing(study: "Study") -> str:
    last = study.store.sessions[-1]
    text = (
        f"{last['cpu']}, {last['system']}; glossy {last['glossy']}, Python {last['python']}, NumPy "
        f"{last['numpy']}, Numba {last['numba']}. All on one thread, compiled beforehand: "
        f"{study.settings['repeats']} blocks of at least {1e3 * BLOCK:g} ms; CPU: the least of the "
        f"blocks, wall: their median. Ratio: over the baseline ({_baseline(study)}), timed in "
        "turn with each cell. Bias 0; study.csv has the rest.\n"
    )
    used = sorted({c.session for c in study.cells})
    if len(used) > 1:
        text += f"\nMeasured in {len(used)} sessions, which study.json lists.\n"
    if last.get("workers"):
        text += f"\nThe last session ran on {last['workers']}.\n"
    return text


def dumps(value: dict[str, Any]) -> str:
    """JSON text; infinities must be gone."""
    return json.dumps(value, indent=1, allow_nan=False) + "\n"
