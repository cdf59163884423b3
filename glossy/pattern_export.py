"""Patterns as text: JSON, CSV, and constant arrays for GLSL, HLSL and WGSL.

The shader forms hold single precision: every number is the shortest decimal that reads back as the
same float32, always with a point or an exponent, so that no compiler takes it for an integer. JSON
and CSV hold the float64 values, likewise exact.
"""

import csv
import dataclasses
import io
import json
import pathlib
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _check
from .image_write import replacing

if TYPE_CHECKING:
    from .pattern import Pattern

FORMATS = ("json", "csv", "glsl", "hlsl", "wgsl")


@dataclasses.dataclass(frozen=True)
class _Language:
    """How a shading language writes a constant, an array of constants, and their types."""

    constant: str  # takes type, name, value
    array: str  # takes type, name, count
    close: str
    types: dict[str, str]


_LANGUAGES = {
    "glsl": _Language(
        "const {0} {1} = {2};",
        "const {0} {1}[{2}] = {0}[{2}](",
        ");",
        {"int": "int", "float": "float", "vector": "vec3"},
    ),
    "hlsl": _Language(
        "static const {0} {1} = {2};",
        "static const {0} {1}[{2}] = {{",
        "}};",
        {"int": "int", "float": "float", "vector": "float3"},
    ),
    "wgsl": _Language(
        "const {1}: {0} = {2};",
        "const {1}: array<{0}, {2}> = array<{0}, {2}>(",
        ");",
        {"int": "i32", "float": "f32", "vector": "vec3<f32>"},
    ),
}


def export(pattern: "Pattern", form: str, path: str | pathlib.Path | None = None) -> str:
    """See ``Pattern.export``."""
    _check.choice("form", form, FORMATS)
    writers = {"json": _json, "csv": _csv}
    text = writers[form](pattern) if form in writers else _shader(pattern, _LANGUAGES[form])
    if path is not None:
        with replacing(path) as temporary:
            pathlib.Path(temporary).write_text(text, encoding="utf-8")
    return text


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


def _single(value: float) -> str:
    """The shortest decimal of a float32, with a point or an exponent."""
    number = np.float32(value)
    if number == 0.0 or 1e-4 <= abs(number) < 1e7:
        return np.format_float_positional(number, unique=True, trim="0")
    return np.format_float_scientific(number, unique=True, trim="0", exp_digits=1)


def _lines(items: Iterable[str]) -> str:
    return ",\n".join(f"    {item}" for item in items)


def _made_by(pattern: "Pattern") -> str:
    parts: dict[str, Any] = {"method": pattern.method}
    if pattern.widths is not None:
        parts["mx"], parts["my"] = pattern.widths
    for name in ("circles", "spacing", "threshold"):
        parts[name] = getattr(pattern, name)
    return ", ".join(f"{k} = {v}" for k, v in parts.items() if v is not None)


def _shader(pattern: "Pattern", language: _Language) -> str:
    n, types = len(pattern), language.types
    out = [
        f"// {_made_by(pattern)}",
        "// Half vectors along (tangent, bitangent, normal).",
        language.constant.format(types["int"], "PATTERN_SIZE", n),
        language.array.format(types["vector"], "PATTERN", n),
        _lines(
            f"{types['vector']}({', '.join(map(_single, h))})"
            for h in pattern.half_vectors.tolist()
        ),
        language.close.format(),
    ]
    for name, value, meaning in (
        ("PATTERN_PDF", pattern.pdf_constant, "Mean of D(h) [1/sr]"),
        ("PATTERN_PDF_PROJECTED", pattern.projected_pdf_constant, "Mean of D(h) cos(theta) [1/sr]"),
        ("PATTERN_CELL", pattern.cell, "Solid angle of half vectors per sample [sr]"),
    ):
        if value is None:
            continue
        out.append(f"// {meaning}.")
        if isinstance(value, np.ndarray):
            out.append(language.array.format(types["float"], name, n))
            out += [_lines(_single(c) for c in value.tolist()), language.close.format()]
        else:
            out.append(language.constant.format(types["float"], name, _single(value)))
    return "\n".join(out) + "\n"
