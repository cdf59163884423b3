"""Patterns as text: JSON, CSV, and constant arrays for GLSL, HLSL and WGSL.

The shader forms hold single precision (see ``languages``); JSON and CSV hold the float64 values,
likewise exact.
"""

import csv
import dataclasses
import io
import json
import pathlib
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _check
from .._output import write_text
from .languages import LANGUAGES, Language

if TYPE_CHECKING:
    from ..pattern import Pattern

FORMATS = ("json", "csv", *LANGUAGES)


def export(pattern: "Pattern", form: str, path: str | pathlib.Path | None = None) -> str:
    """See ``Pattern.export``."""
    _check.choice("form", form, FORMATS)
    writers = {"json": _json, "csv": _csv}
    text = writers[form](pattern) if form in writers else _constants(pattern, LANGUAGES[form])
    write(text, path)
    return text


def write(text: str, path: str | pathlib.Path | None) -> None:
    """Write ``text`` to ``path``, whole or not at all; nothing without a path."""
    if path is not None:
        write_text(path, text)


def _json(pattern: "Pattern") -> str:
    fields = {f.name: getattr(pattern, f.name) for f in dataclasses.fields(pattern)}
    rows = [json.dumps(row) for row in fields.pop("half_vectors").tolist()]
    if isinstance(fields["cell"], np.ndarray):
        fields["cell"] = fields["cell"].tolist()
    head = json.dumps({"schema": 1, "samples": len(pattern), **fields}, indent=2)
    return f'{head[:-2]},\n  "half_vectors": [\n{_lines(rows)}\n  ]\n}}\n'


def _csv(pattern: "Pattern") -> str:
    """One row per half vector; constants repeat in every row, unknown ones are empty."""
    n = len(pattern)
    given = (pattern.cell, pattern.pdf_constant, pattern.projected_pdf_constant)
    columns = [[""] * n if c is None else np.broadcast_to(c, n).tolist() for c in given]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["hx", "hy", "hz", "cell", "pdf_constant", "projected_pdf_constant"])
    writer.writerows(zip(*pattern.half_vectors.T.tolist(), *columns, strict=True))
    return out.getvalue()


def _lines(items: Iterable[str]) -> str:
    return ",\n".join(f"    {item}" for item in items)


def made_by(pattern: "Pattern") -> str:
    """How a pattern was made, in words."""
    parts: dict[str, Any] = {"method": pattern.method}
    if pattern.widths is not None:
        parts["mx"], parts["my"] = pattern.widths
    for name in ("circles", "spacing", "threshold"):
        parts[name] = getattr(pattern, name)
    return ", ".join(f"{k} = {v}" for k, v in parts.items() if v is not None)


def _constants(pattern: "Pattern", language: Language) -> str:
    out = [
        f"// {made_by(pattern)}",
        "// Half vectors along (tangent, bitangent, normal).",
        language.declare("PATTERN_SIZE", len(pattern)),
        language.declare("PATTERN", pattern.half_vectors),
    ]
    cell = pattern.cell[:, None] if isinstance(pattern.cell, np.ndarray) else pattern.cell
    for name, value, meaning in (
        ("PATTERN_PDF", pattern.pdf_constant, "Mean of D(h) [1/sr]"),
        ("PATTERN_PDF_PROJECTED", pattern.projected_pdf_constant, "Mean of D(h) cos(theta) [1/sr]"),
        ("PATTERN_CELL", cell, "Solid angle of half vectors per sample [sr]"),
    ):
        if value is not None:
            out += [f"// {meaning}.", language.declare(name, value)]
    return "\n".join(out) + "\n"
