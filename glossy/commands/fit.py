"""``glossy fit``: a measured table to a material that renders."""

import argparse
import pathlib
from typing import TYPE_CHECKING

from . import options
from .inputs import protect
from .provenance import provenance

if TYPE_CHECKING:
    from ..measured.table import MeasuredTable

EXAMPLE = """\
examples:
  glossy fit paint.brdf                               prints the material
  glossy fit paint.brdf -o paint.toml
  glossy fit aluminium.txt --lobes 2 --report fit-out -o aluminium.toml
  glossy fit foil.txt --bound mx=.05:.4 --fix transmission.r0=.2 --metric cubic-root -o foil.toml
  glossy fit paint.bsdf --compare ward,beckmann,ggx --report fit-out -o paint.toml
  glossy render --material paint.toml --env room.hdr -o paint.exr

A name of --bound and --fix is kd, diffuse_transmission, or mx, my, alpha, r0 or ks for all lobes,
or one lobe's: reflection[0].mx. DIR of --report receives report.md, fit.json and three pictures.
"""


ANGLE = 89.9  # degrees: the largest that is reported
PLOTS = ("plane.png", "discs.png", "angles.png")


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the ``glossy`` parser."""
    parser = subparsers.add_parser(
        "fit",
        help="a measured table to a material that renders",
        description="Fit Kurt lobes to a table of measurements: hierarchical grid search as in "
        "the thesis, lobes by turns, then a polish that never ends worse.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("table", metavar="TABLE", help="text table, .brdf, .bsdf, .xml or .binary")
    options.add_output_argument(
        parser, "MATERIAL", "file to write, .toml or .json", ("toml", "json"), required=False
    )
    parser.add_argument("--report", metavar="DIR", help="folder for the fit report and its plots")
    parser.add_argument("--format", metavar="F", help="of TABLE, if its name does not tell")
    group = parser.add_argument_group("model")
    group.add_argument("--lobes", type=int, default=1, metavar="N", help="reflection (default 1)")
    group.add_argument(
        "--transmission-lobes", type=int, metavar="N", help="default: 1 if the table has such rows"
    )
    group.add_argument("--isotropic", action="store_true", default=None, help="my equals mx")
    group.add_argument("--anisotropic", action="store_false", dest="isotropic", default=None)
    group.add_argument("--bound", action="append", metavar="NAME=A:B", help="narrow the search")
    group.add_argument(
        "--bound-energy",
        action="store_true",
        help="send out no more than is received, up to an angle (--bound-to)",
    )
    group.add_argument(
        "--bound-to",
        type=float,
        metavar="DEG",
        help=f"of --bound-energy: degrees from the normal (default {ANGLE:g})",
    )
    group.add_argument("--fix", action="append", metavar="NAME=V", help="hold; V or R/G/B")
    group.add_argument(
        "--kd",
        choices=("free", "mode"),
        default="free",
        help="free (default): polished from the histogram's mode; mode: kept there",
    )
    group = parser.add_argument_group("metric")
    group.add_argument(
        "--metric", default="l1", metavar="NAME", help="l1, l2, cubic-root, log (l1)"
    )
    group.add_argument("--weights", default="auto", metavar="NAME", help="auto, sine, table, equal")
    group.add_argument(
        "--light", default="above", metavar="WHERE", help="above, below, both (above)"
    )
    group.add_argument("--rows", type=int, metavar="N", help="fit to N rows drawn at random")
    group = parser.add_argument_group("search")
    group.add_argument("--grid", type=int, default=9, metavar="N", help="values on each axis (9)")
    group.add_argument("--levels", type=int, default=4, metavar="N", help="refinements (4)")
    group.add_argument(
        "--spacing", default="log", metavar="S", help="of mx, my, ks: log, linear (log)"
    )
    group.add_argument("--rounds", type=int, default=3, metavar="N", help="turns through lobes (3)")
    group.add_argument("--polish", default="local", metavar="P", help="none, local, global (local)")
    group.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of --rows and global polish"
    )
    group.add_argument(
        "--time-limit", type=float, metavar="S", help="seconds; the best so far counts"
    )
    group.add_argument("--compare", metavar="A,B", help="fit also: ward, beckmann, ggx")
    options.add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read the table, fit it, write the material and the report."""
    from .._output import write_text
    from ..measured.fit import Fit, fit_table
    from ..measured.fit_report import (
        angle_lines,
        energy_line,
        material_line,
        material_text,
        parameter_table,
        report_json,
        report_text,
    )
    from ..measured.read import read_measured

    if args.output is not None:
        options.check_output(args, args.output, (".toml", ".json"))
    if args.report is not None:
        names = ("report.md", "fit.json", *PLOTS)
        protect(args, {f"--report {n}": pathlib.Path(args.report, n) for n in names})
    if args.bound_to is None:
        args.bound_to = ANGLE
    elif not args.bound_energy:
        raise ValueError("--bound-to: is of --bound-energy, which is not given")
    others = args.compare.split(",") if args.compare else []
    table = _subset(read_measured(args.table, args.format), args.rows, args.seed)

    def fitted(model: str) -> Fit:
        return fit_table(
            table,
            args.lobes,
            args.transmission_lobes,
            model=model,
            metric=args.metric,
            weights=args.weights,
            light=args.light,
            bounds=_bounds(args.bound or []),
            fixed=_fixed(args.fix or []),
            kd=args.kd,
            isotropic=args.isotropic,
            grid=args.grid,
            levels=args.levels,
            spacing=args.spacing,
            rounds=args.rounds,
            polish=args.polish,
            seed=args.seed,
            time_limit=args.time_limit,
            energy_limit=args.bound_to if args.bound_energy and model == "kurt" else None,
            progress=True,
        )

    fit = fitted("kurt")
    baselines = [fitted(name.strip()) for name in others]
    assert fit.material is not None
    if args.output is not None:
        target = pathlib.Path(args.output)
        text = material_text(fit.material, target.suffix.lower())
        comment = f"# {energy_line(fit)}\n" if target.suffix.lower() == ".toml" else ""
        write_text(target, comment + text)
    from ..measured.fit_rows import lit_from

    shown = lit_from(table, args.light)
    lines = angle_lines(shown, fit)
    record = report_json(table, fit, lines, baselines)
    if args.report is not None:
        import json

        from ..measured.fit_plots import write_plots

        folder = pathlib.Path(args.report)
        folder.mkdir(parents=True, exist_ok=True)
        write_plots(shown, fit, lines, folder)
        write_text(folder / "report.md", report_text(table, fit, lines, baselines))
        write_text(folder / "fit.json", json.dumps({"schema": 1, **record}, indent=2) + "\n")
    if args.json:
        made = {"material": args.output, "report": args.report, **record}
        options.report(args, "fit", made, provenance(args))
        return 0
    print(parameter_table(fit))
    if args.output is None:
        line = material_line(fit.material)
        print(f"material: {line}" if line else material_text(fit.material).rstrip())
    print(f"error ({fit.metric}): {fit.error:.5g}, {fit.rows} rows, {fit.seconds:.1f} s")
    for other in baselines:
        print(f"error of {other.model}: {other.error:.5g}")
    print(energy_line(fit))
    if fit.energy is not None and fit.energy["exceeds_from"] is not None and not args.bound_energy:
        print(f"--bound-energy keeps it at or below 1, to {ANGLE:g} degrees or --bound-to")
    if fit.at_bounds:
        print(f"on a bound: {', '.join(fit.at_bounds)}")
    if fit.stopped:
        print("stopped by the time limit")
    return 0


def _subset(table: "MeasuredTable", rows: int | None, seed: int) -> "MeasuredTable":
    """The table, or ``rows`` of its rows drawn without replacement, in their order."""
    import numpy as np

    from .. import _check

    if rows is None:
        return table
    n = _check.count("--rows", rows)
    if n >= len(table):
        return table
    pick = np.random.default_rng(_check.count("--seed", seed, 0)).permutation(len(table))[:n]
    return table.select(np.sort(pick))


def _split(option: str, text: str) -> tuple[str, str]:
    name, equals, value = (part.strip() for part in text.partition("="))
    if not equals:
        raise ValueError(f"{option}: must be NAME=VALUE, got {text!r}")
    return name, value


def _number(option: str, text: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ValueError(f"{option}: must have numbers, got {text!r}") from None


def _bounds(texts: list[str]) -> dict[str, tuple[float, float]]:
    found = {}
    for text in texts:
        name, value = _split("--bound", text)
        low, colon, high = value.partition(":")
        if not colon:
            raise ValueError(f"--bound: must be NAME=LOW:HIGH, got {text!r}")
        found[name] = (_number("--bound", text, low), _number("--bound", text, high))
    return found


def _fixed(texts: list[str]) -> dict[str, list[float]]:
    found = {}
    for text in texts:
        name, value = _split("--fix", text)
        found[name] = [_number("--fix", text, part) for part in value.split("/")]
    return found
