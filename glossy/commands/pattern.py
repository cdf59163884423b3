"""``glossy pattern``: a sample pattern as a table for a shader, or as a picture."""

import argparse
import json
import pathlib
import sys
from typing import TYPE_CHECKING, Any

from .inputs import add_force_argument, protect

if TYPE_CHECKING:
    from ..brdf import Lobe, Material
    from ..pattern import Pattern, Widths

PICTURES = (".png", ".pdf", ".svg")
FORMATS = ("json", "csv", "glsl", "hlsl", "wgsl")
OWN = {
    "regular": ("samples", "circles", "spacing", "threshold"),
    "importance": ("samples",),
    "thesis": ("samples", "kind", "threshold"),
    "lattice": ("samples", "elongation"),
}
"""The arguments that mean something to each method."""

SHADERS = ("glsl", "hlsl", "wgsl")
SHADER_OPTIONS = ("footprint", "estimator", "normalisation", "bias", "filter", "name")

EXAMPLE = """\
examples:
  glossy pattern --mx 0.2 --my 0.075 --samples 17 --threshold 0.2 --format glsl
  glossy pattern --material white-foil --samples 20 --footprint thesis --bias -0.5 -o foil.hlsl
  glossy pattern --mx 0.15 --circles 3 --spacing s1 -o pattern.json --plot pattern.png
  glossy pattern --mx 0.15 --method importance --samples 40 -o pattern.wgsl
  glossy pattern --mx 0.01 --my 0.14 --method thesis --kind line --samples 7
  glossy pattern --mx 0.2 --my 0.05 --method lattice --filter round --format glsl
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the ``glossy`` parser."""
    parser = subparsers.add_parser(
        "pattern",
        help="make a sample pattern, or the shader of a method",
        description="Half vectors of a lobe in the frame (tangent, bitangent, normal), with the "
        "density constants of the estimators, as text or as a picture in slope space. In a shading "
        "language, the whole method: constants, a function for each lobe of the material, and "
        "their sum (docs/shaders.md).",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--mx", type=float, help="roughness along the tangent")
    parser.add_argument("--my", type=float, help="roughness along the bitangent (default mx)")
    parser.add_argument(
        "--material",
        metavar="M",
        help="instead of --mx: a published name, a file, or mx=.2,my=.075,r0=1,alpha=0",
    )
    parser.add_argument("--method", choices=tuple(OWN), default="regular")
    parser.add_argument(
        "--samples",
        type=int,
        metavar="N",
        help="regular: the nearest count there is (default 20); others: exact (importance 40, "
        "thesis 7, lattice 14: nearest)",
    )
    parser.add_argument("--circles", type=int, metavar="N", help="regular: instead of --samples")
    parser.add_argument(
        "--spacing", choices=("s1", "s2"), help="with --circles: pole or ring of four (default s2)"
    )
    parser.add_argument(
        "--threshold",
        type=float,
        metavar="X",
        help="where the lobe ends (regular 0.1, thesis 0.01)",
    )
    parser.add_argument(
        "--kind",
        choices=("auto", "ring", "line", "multi-ring", "blend"),
        help="thesis: the arrangement (default auto: ring, or line for long lobes)",
    )
    parser.add_argument(
        "--elongation",
        type=float,
        metavar="E",
        help="lattice: of the lobe as a pixel sees it (default: along the normal)",
    )
    parser.add_argument(
        "--format", choices=FORMATS, help="default: the suffix of the output file, else json"
    )
    shader = parser.add_argument_group("shader (glsl, hlsl, wgsl)")
    shader.add_argument("--footprint", metavar="NAME", help="paper, thesis or jacobian")
    shader.add_argument("--estimator", metavar="EQ", help="thesis: 4.23, 4.24 or 4.25 (default)")
    shader.add_argument("--normalisation", metavar="NAME", help="regular: paper or projected")
    shader.add_argument("--bias", type=float, metavar="B", help="added to the level (default 0)")
    shader.add_argument("--filter", metavar="NAME", help="lattice: of the levels (default gauss6)")
    shader.add_argument("--name", help="start of every name in the shader (default glossy)")
    parser.add_argument("-o", "--output", metavar="FILE", help="default, and -: standard output")
    parser.add_argument("--plot", metavar="FILE", help="picture, .png, .pdf or .svg")
    add_force_argument(parser)
    parser.add_argument(
        "--json",
        action="store_true",
        help="with -o: print what was done as JSON; else as --format json",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print or write the pattern; a file is reported in one line."""
    form = args.format
    if form is None:
        suffix = pathlib.Path(args.output or "").suffix[1:].lower()
        form = suffix if suffix in FORMATS else "json"
    if args.json and args.output is None and form != "json":
        raise ValueError(f"--json: prints the pattern without -o, which --format {form} does too")
    protect(args, {"--output": args.output, "--plot": args.plot})
    given = {k: getattr(args, k) for k in SHADER_OPTIONS if getattr(args, k) is not None}
    if given and form not in SHADERS:
        raise ValueError(f"--{next(iter(given))}: has no meaning with --format {form}")
    if args.method == "lattice":
        return _lattice(args, form, given)
    lobes = _lobes(args)
    if len(lobes) != 1 and (form not in SHADERS or args.plot is not None):
        rule = f"{form} holds the pattern" if form not in SHADERS else "--plot draws the pattern"
        raise ValueError(f"--material: {rule} of one lobe, {args.material} has {len(lobes)}")
    patterns = [_make(args, lobe) for lobe in lobes]
    if args.plot is not None:
        plot(patterns[0], args.plot)
    if form in SHADERS:
        text = _shader(args, form, patterns, given)
    else:
        text = patterns[0].export(form, args.output)
    if args.output is None:
        sys.stdout.write(text)
    else:
        _report(args, form, [len(pattern) for pattern in patterns])
    return 0


def _report(args: argparse.Namespace, form: str, counts: list[int]) -> None:
    if args.json:
        made = {"output": args.output, "format": form, "method": args.method, "samples": counts}
        print(json.dumps({"schema": 1, "command": "pattern", **made}, indent=2))
        return
    count = " + ".join(str(n) for n in counts)
    print(f"{args.output}: {count} half vectors, {form}")


def _lobes(args: argparse.Namespace) -> "list[Widths]":
    """The lobes to sample; without a material a pair of numbers, which needs no compiler."""
    if args.material is None:
        if args.mx is None:
            raise ValueError("--mx: give it, or --material")
        return [(args.mx, args.mx if args.my is None else args.my)]
    if args.mx is not None or args.my is not None:
        raise ValueError("--material: give it or --mx and --my, not both")
    from ..materials import parse_material

    lobes: list[Widths] = [lobe for lobe, _ in parse_material(args.material).sided_lobes()]
    if not lobes:
        raise ValueError(f"--material: must have a glossy lobe, {args.material} has none")
    return lobes


def _shader(
    args: argparse.Namespace, form: str, patterns: "list[Pattern]", given: dict[str, Any]
) -> str:
    from ..export.shader import export_shader

    return export_shader(
        _material(args), form, args.method, pattern=patterns, path=args.output, **given
    )


def _lattice(args: argparse.Namespace, form: str, given: dict[str, Any]) -> int:
    """Taps for one elongation, or the shader, which holds those for every one."""
    _check_foreign(args)
    samples = 14 if args.samples is None else args.samples
    from ..lattice import pattern

    if args.plot is not None:
        pattern.plot(samples, _elongation(args), args.plot)
    if form not in SHADERS:
        text = pattern.export(samples, _elongation(args), form, args.output)
    else:
        if args.elongation is not None and args.plot is None:
            raise ValueError(f"--elongation: has no meaning with --format {form}")
        from ..export.shader import export_shader

        _lobes(args)
        given = {"samples": samples, **given}
        text = export_shader(_material(args), form, "lattice", path=args.output, **given)
    if args.output is None:
        sys.stdout.write(text)
    elif args.json:
        _report(args, form, [samples])
    else:
        print(f"{args.output}: lattice, {form}")
    return 0


def _elongation(args: argparse.Namespace) -> float:
    if args.elongation is not None:
        return float(args.elongation)
    lobes = _lobes(args)
    if len(lobes) != 1:
        raise ValueError(f"--material: give --elongation, {args.material} has {len(lobes)} lobes")
    from ..pattern import widths_of

    mx, my = widths_of(lobes[0])
    return max(mx, my) / min(mx, my)


def _material(args: argparse.Namespace) -> "Lobe | Material":
    from ..brdf import Lobe
    from ..materials import parse_material

    return Lobe(args.mx, args.my) if args.material is None else parse_material(args.material)


def _check_foreign(args: argparse.Namespace) -> None:
    names = {name for own in OWN.values() for name in own} - set(OWN[args.method])
    for name in sorted(names):
        if getattr(args, name) is not None:
            raise ValueError(f"--{name}: has no meaning with --method {args.method}")


def _make(args: argparse.Namespace, lobe: "Widths") -> "Pattern":
    from ..pattern import importance_pattern, pattern_for_budget, regular_pattern
    from ..thesis_pattern import thesis_pattern

    options: dict[str, Any] = {
        name: getattr(args, name)
        for name in ("samples", "circles", "spacing", "threshold", "kind")
        if getattr(args, name) is not None
    }
    _check_foreign(args)
    if args.method == "thesis":
        return thesis_pattern(lobe, **options)
    if args.method == "importance":
        return importance_pattern(lobe, **options)
    if "circles" in options:
        if "samples" in options:
            raise ValueError("--samples: give it or --circles, not both")
        return regular_pattern(lobe, **options)
    if "spacing" in options:
        raise ValueError("--spacing: needs --circles; a budget tries both spacings")
    return pattern_for_budget(lobe, **options)


def plot(pattern: "Pattern", path: str | pathlib.Path) -> None:
    """Draw a pattern that knows its lobe in slope space (hx/hz, hy/hz).

    Ellipses are contours of exp(q); each sample's cell is drawn as a round cap of its solid
    angle, which slope space stretches by 1/cos^2 along the radius and by 1/cos across it.
    """
    import matplotlib as mpl
    import numpy as np
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import EllipseCollection
    from matplotlib.figure import Figure
    from matplotlib.patches import Ellipse

    from .. import _check
    from .._output import write_figure

    suffix = pathlib.Path(path).suffix.lower()
    if suffix not in PICTURES:
        raise _check.fail("plot", "must end in .png, .pdf or .svg", str(path))
    if pattern.widths is None:
        raise _check.fail("pattern", "must know its lobe to be drawn", pattern.method)
    mx, my = pattern.widths
    h = pattern.half_vectors
    slopes, cosine = h[:, :2] / h[:, 2:], h[:, 2]
    figure = Figure(figsize=(6.4, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()

    reach = np.abs(slopes).max(axis=0)
    if pattern.cell is not None:
        radius = np.sqrt(np.broadcast_to(pattern.cell, len(h)) / np.pi)
        along, across = 2.0 * radius / cosine**2, 2.0 * radius / cosine
        angle = np.degrees(np.arctan2(slopes[:, 1], slopes[:, 0]))
        cells = EllipseCollection(
            along, across, angle, units="xy", offsets=slopes, transOffset=axes.transData,
            facecolors="#4c72b033", edgecolors="#4c72b0", linewidths=0.6,
        )  # fmt: skip
        axes.add_collection(cells)
        reach = np.maximum(reach, (np.abs(slopes) + 0.5 * along[:, None]).max(axis=0))
    levels = [0.5, 0.1, 0.01] if pattern.threshold is None else [0.5, pattern.threshold]
    colours = mpl.colormaps["autumn"](np.linspace(0.0, 0.6, len(levels)))
    for level, colour in zip(levels, colours, strict=True):
        size = np.sqrt(-np.log(level)) * np.array([mx, my])
        reach = np.maximum(reach, size)
        border = Ellipse(
            (0.0, 0.0), *(2.0 * size), fill=False, edgecolor=colour, linewidth=1.4,
            label=f"exp(q) = {level:g}",
        )  # fmt: skip
        axes.add_patch(border)
    axes.plot(*slopes.T, "k.", markersize=4 if len(h) <= 100 else 2, label=f"{len(h)} half vectors")
    axes.set(
        xlim=(-1.05 * reach[0], 1.05 * reach[0]),
        ylim=(-1.05 * reach[1], 1.05 * reach[1]),
        aspect="equal" if 0.1 < reach[0] / reach[1] < 10.0 else "auto",
        xlabel="slope along the tangent, hx / hz",
        ylabel="slope along the bitangent, hy / hz",
        title=f"{pattern.method} pattern, mx = {mx:g}, my = {my:g}",
    )
    figure.legend(loc="outside lower center", ncols=4, frameon=False)
    write_figure(path, figure, dpi=150, bbox_inches="tight")
