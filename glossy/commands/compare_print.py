"""What ``glossy compare`` prints: figures of one image, a table of a folder, JSON."""

import argparse
import math
from typing import TYPE_CHECKING, Any

from . import compare_limits

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..metrics import Comparison
    from .compare_files import Result


def shown(name: str) -> str:
    """A file's name on one line of text, whatever bytes it has."""
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in name)
    return text.encode("utf-8", "backslashreplace").decode()


def as_dict(args: argparse.Namespace, results: "Sequence[Result]", folder: bool) -> dict[str, Any]:
    """The record of all rows, or the one row itself."""
    rows = [_row(result) for result in results]
    limits = compare_limits.as_dict(args)
    if not folder:
        return {"schema": 1, "command": "compare", **rows[0], "limits": limits}
    for row, result in zip(rows, results, strict=True):
        row["name"] = result.name
    within = all(row["within_limits"] for row in rows)
    record = {"schema": 1, "command": "compare", "files": rows}
    return {**record, "within_limits": within, "limits": limits}


def _row(result: "Result") -> dict[str, Any]:
    figures = {} if result.comparison is None else result.comparison.to_dict()
    figures.pop("schema", None)
    if figures:
        left = dict(zip(("a", "reference"), map(list, result.left_out), strict=True))
        figures |= {"identical": result.identical, "channels_left_out": left}
        figures["unlike"] = list(result.unlike)
    a, reference = result.paths
    row = {**figures, "a": a, "reference": reference}
    if result.error:
        row["error"] = result.error
    row["within_limits"] = not result.failures and not result.error
    return {**row, "failures": list(result.failures), "warnings": list(result.warnings)}


def left_out(result: "Result") -> str:
    """Channels that were not compared, and of which file if of one only; empty if all were."""
    both = [c for c in result.left_out[0] if c in result.left_out[1]]
    parts = [", ".join(both)] if both else []
    for path, names in zip(result.paths, result.left_out, strict=True):
        own = [c for c in names if c not in both]
        if own:
            parts.append(f"{', '.join(own)} (of {shown(path)} only)")
    return ", ".join(parts)


def _psnr(c: "Comparison") -> str:
    return "infinite" if math.isinf(c.psnr) else f"{c.psnr:.4f} dB"


def print_figures(result: "Result") -> None:
    """One image: a line for each figure."""
    c = result.comparison
    assert c is not None
    print(f"{shown(result.paths[0])} against {shown(result.paths[1])}")
    print(f"  {c.width} x {c.height}, {c.pixels} pixels, channels {', '.join(c.channels)}")
    by_channel = "  ".join(f"{n} {v:.6g}" for n, v in zip(c.channels, c.channel_rms, strict=True))
    lines = [
        ("rms", f"{c.rms:.6g}   ({by_channel})"),
        ("relative rms", f"{c.relative_rms:.6g}"),
        ("psnr", f"{_psnr(c)} (peak {c.peak:g})"),
        ("mae", f"{c.mae:.6g}"),
        ("bias", f"{c.bias:+.6g}"),
        ("largest", f"{c.max_abs:.6g} at x={c.max_at[0]}, y={c.max_at[1]} in {c.max_channel}"),
        ("relative mse", f"{c.relative_mse:.6g}   (d^2 / (b^2 + {c.relative_epsilon:g}))"),
        ("log rms", f"{c.log_rms:.6g}   (ln(max(v, 0) + {c.log_epsilon:g}))"),
    ]
    if c.percentiles is not None:
        lines.append(("percentiles", "  ".join(f"{p:.15g}: {v:.6g}" for p, v in c.percentiles)))
    if c.outliers is not None and c.outlier_share is not None:
        lines.append(
            ("outliers", f"{c.outliers} ({100.0 * c.outlier_share:.4g} %) {_tolerance(c)}")
        )
    if c.flip is not None:
        lines.append(("flip", f"{c.flip:.6g}   ({str(c.flip_kind).upper()}-FLIP)"))
    if any(result.left_out):
        lines.append(("not compared", left_out(result)))
    lines += [("differ in", text) for text in result.unlike]
    if result.identical:
        whole = c.pixels == c.width * c.height
        lines.append(("identical", "yes" if whole else f"yes, in the {c.pixels} pixels compared"))
    for label, value in lines:
        print(f"  {label:<13} {value}")


def _tolerance(c: "Comparison") -> str:
    relative = f" + {c.max_relative_difference:g} |b|" if c.max_relative_difference else ""
    return f"  (|a - b| above {c.max_difference:g}{relative})"


def print_table(args: argparse.Namespace, results: "Sequence[Result]") -> None:
    """A folder: a line for each file."""
    head = f"{'rms':>12} {'relative rms':>13} {f'psnr (peak {args.peak:g})':>16} {'largest':>12}"
    flip = any(r.comparison is not None and r.comparison.flip is not None for r in results)
    print(head + (f" {'flip':>10}" if flip else "") + "  file")
    width = len(head) + (11 if flip else 0)
    for result in results:
        c = result.comparison
        if c is None:
            row = f"{'not compared':>{width}}"
        else:
            row = f"{c.rms:12.6g} {c.relative_rms:13.6g} {_psnr(c):>16} {c.max_abs:12.6g}"
            row += "" if c.flip is None else f" {c.flip:10.6g}"
        notes = ["outside the limits"] if result.failures else []
        if any(result.left_out):
            notes.append(f"without {left_out(result)}")
        notes += [f"differ in {text}" for text in result.unlike]
        end = f"  {'; '.join(notes)}" if notes else ""
        print(f"{row}  {shown(str(result.name))}{end}")
