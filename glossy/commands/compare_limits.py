"""Limits of ``glossy compare``: for each figure a level that fails, and one that only warns."""

import argparse
import dataclasses
import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..metrics import Comparison

LEVELS = ("max", "warn")
FIGURES = {
    "rms": ("X", "largest RMS difference"),
    "relative_rms": ("X", "largest RMS over the reference's RMS"),
    "psnr": ("Y", "smallest PSNR [dB]"),
    "abs": ("X", "largest difference of any pixel and channel"),
    "flip": ("X", "largest mean FLIP error (implies --flip)"),
    "percentile": ("P=X,...", "largest percentile P of the pixels' largest differences"),
    "outliers": ("SHARE", "largest share of pixels out of tolerance: .001, 0.1%% or 20px"),
    "difference": ("X", "the tolerance: a pixel may differ by X in each channel"),
    "relative_difference": ("R", "and by R times the reference's value there"),
}
"""Figure or tolerance: placeholder and help of its two options."""


def option(level: str, figure: str) -> str:
    """Name of an option as ``args`` has it: max_rms, warn_rms, min_psnr, warn_psnr, ..."""
    return f"{'min' if level == 'max' and figure == 'psnr' else level}_{figure}"


def flag(name: str) -> str:
    """The same as it is typed."""
    return f"--{name.replace('_', '-')}"


NAMES = tuple(option(level, figure) for level in LEVELS for figure in FIGURES)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of both levels."""
    group = parser.add_argument_group(
        "limits", "Exit code 1 beyond one. A tolerance without --max-outliers admits no outlier."
    )
    for figure, (value, text) in FIGURES.items():
        kind = str if figure in ("percentile", "outliers") else float
        group.add_argument(flag(option("max", figure)), type=kind, metavar=value, help=text)
        twin = flag(option("warn", figure))
        group.add_argument(twin, type=kind, metavar=value, help=argparse.SUPPRESS)


@dataclasses.dataclass(frozen=True)
class Share:
    """So much of the pixels, or so many."""

    text: str
    value: float
    pixels: bool

    def allowed(self, pixels: int) -> float:
        """Outliers admitted among ``pixels``."""
        return self.value if self.pixels else self.value * pixels


def parse(args: argparse.Namespace) -> None:
    """Check every limit; texts become a ``Share`` or pairs (P, X).

    Raises
    ------
    ValueError
        For a value out of range; names the option.
    """
    from .. import _check

    for name in NAMES:
        value = getattr(args, name)
        if value is None:
            continue
        if name.endswith("_outliers"):
            setattr(args, name, _share(flag(name), value))
        elif name.endswith("_percentile"):
            setattr(args, name, _percentile_limits(flag(name), value))
        elif name.endswith("_psnr"):
            _check.number(flag(name), value)
        else:
            _check.in_range(flag(name), value, 0.0)


def _share(name: str, text: str) -> Share:
    from .. import _check

    word = text.strip()
    unit = next((u for u in ("%", "px") if word.endswith(u)), "")
    top = {"%": 100.0, "px": math.inf, "": 1.0}[unit]
    try:
        value = _check.in_range(name, float(word[: len(word) - len(unit)]), 0.0, top)
    except ValueError:
        rule = "must be a share such as .001 or 0.1%, or a number of pixels such as 20px"
        raise _check.fail(name, rule, text) from None
    return Share(word, value / 100.0 if unit == "%" else value, unit == "px")


def percents(name: str, text: str) -> list[float]:
    """Numbers from 0 to 100 with commas."""
    return [_number(name, word, 100.0) for word in text.split(",")]


def _number(name: str, text: str, high: float = math.inf) -> float:
    from .. import _check

    try:
        value = float(text)
    except ValueError:
        raise _check.fail(name, "must be a number", text) from None
    return _check.in_range(name, value, 0.0, high)


def _percentile_limits(name: str, text: str) -> list[tuple[float, float]]:
    from .. import _check

    pairs = []
    for item in text.split(","):
        percent, sign, limit = item.partition("=")
        if not sign:
            raise _check.fail(name, "must be P=X with commas, such as 99=0.01", text)
        pairs.append((_number(name, percent, 100.0), _number(name, limit)))
    return pairs


def tolerance(args: argparse.Namespace, level: str) -> "tuple[float, float] | None":
    """X and R of a pixel at a level, None if it has no limit of outliers.

    The level that warns takes those of the other unless it has its own.
    """
    own = [getattr(args, option(level, f)) for f in ("difference", "relative_difference")]
    if own == [None, None]:
        if getattr(args, option(level, "outliers")) is None:
            return None
        if level == "warn":
            return tolerance(args, "max") or (0.0, 0.0)
    return own[0] or 0.0, own[1] or 0.0


def wanted_percentiles(args: argparse.Namespace) -> list[float]:
    """All that are asked for or limited, in order, each once."""
    found = {} if args.percentiles is None else dict.fromkeys(args.percentiles)
    for level in LEVELS:
        found |= {p: None for p, _ in getattr(args, option(level, "percentile")) or ()}
    return sorted(found)


def exceeded(
    args: argparse.Namespace,
    level: str,
    c: "Comparison",
    outliers: "Callable[[float, float], int]",
) -> dict[str, str]:
    """What lies beyond the limits of a level: a sentence by option.

    ``outliers`` counts those of a tolerance that ``c`` was not made for.
    """
    out: dict[str, str] = {}

    def judge(figure: str, label: str, value: float | None) -> None:
        name = option(level, figure)
        limit = getattr(args, name)
        if limit is not None and value is not None and value > limit:
            out[name] = f"{label} {value:.6g} is above {flag(name)} {limit:g}"

    judge("rms", "rms", c.rms)
    judge("relative_rms", "relative rms", c.relative_rms)
    judge("abs", "largest difference", c.max_abs)
    judge("flip", "flip", c.flip)
    name = option(level, "psnr")
    limit = getattr(args, name)
    if limit is not None and c.psnr < limit:
        out[name] = f"psnr {c.psnr:.4f} dB (peak {c.peak:g}) is below {flag(name)} {limit:g}"
    name = option(level, "percentile")
    values = dict(c.percentiles or ())
    for p, limit in getattr(args, name) or ():
        if values[p] > limit:
            text = f"percentile {p:.15g}, {values[p]:.6g}, is above {flag(name)} {p:.15g}={limit:g}"
            out[f"{name} {p}"] = text
    found = tolerance(args, level)
    if found is not None:
        same = (c.max_difference, c.max_relative_difference) == found and c.outliers is not None
        count = int(c.outliers or 0) if same else outliers(*found)
        name = option(level, "outliers")
        share = getattr(args, name) or Share("0", 0.0, True)
        if count > share.allowed(c.pixels):
            beyond = f"{found[0]:g}" + (f" + {found[1]:g} of the reference" if found[1] else "")
            out[name] = (
                f"{count} pixels ({100.0 * count / c.pixels:.4g} %) differ by more than {beyond}, "
                f"above {flag(name)} {share.text}"
            )
    return out


def as_dict(args: argparse.Namespace) -> dict[str, Any]:
    """All limits by name, fit for JSON."""
    out: dict[str, Any] = {}
    for name in NAMES:
        value = getattr(args, name)
        if isinstance(value, Share):
            value = value.text
        elif isinstance(value, list):
            value = {f"{p:.15g}": x for p, x in value}
        out[name] = value
    return out
