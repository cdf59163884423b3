"""How wrong the mirror buffer is against rays cast into the scene: by lobe, distance and variant.

The floor of the built-in ``hall`` takes lobes of growing width. Its converged buffer against the
truth is the error of the representation, the real-time picture against the converged buffer that
of sampling and filtering. Relative RMS over the floor's points; the noise of truth and converged
buffer is known and subtracted. Writes tables of docs/planar.md.

    python benchmarks/planar_errors.py [--page docs/planar.md]
"""

import functools
import itertools
import pathlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from common import arguments, interleaved, median_ratio, table, write
from planar_place import Array, Place, apart
from reproduce_thesis import fill

import glossy

WIDTHS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
HEIGHTS = (0.0, 0.3, 0.8, 1.6, 3.2)  # m over the floor; the ceiling is at the last
MARGIN = 0.5  # of the mirror pass in picture heights, but where "no margin" is written
REPRESENTATIONS: dict[str, dict[str, Any]] = {
    "no margin": {"planes": "own", "intersections": 2, "margin": 0.0},
    "own plane, 1": {"planes": "own", "intersections": 1, "margin": MARGIN},
    "own plane, 2": {"planes": "own", "intersections": 2, "margin": MARGIN},
    "averaged, 1": {"planes": "averaged", "intersections": 1, "margin": MARGIN},
    "averaged, 2": {"planes": "averaged", "intersections": 2, "margin": MARGIN},
}
MAIN = "own plane, 2"
VARIANTS: dict[str, dict[str, Any]] = {
    "ring, ellipse": {"kind": "ring", "level": "ellipse"},
    "ring, sample": {"kind": "ring", "level": "sample"},
    "multi-ring, ellipse": {"kind": "multi-ring", "level": "ellipse"},
    "multi-ring, ellipse, 1 plane": {"kind": "multi-ring", "level": "ellipse", "intersections": 1},
    "multi-ring, ellipse, no margin": {"kind": "multi-ring", "level": "ellipse", "margin": 0.0},
    "multi-ring, sample": {"kind": "multi-ring", "level": "sample"},
    "regular, ellipse": {"kind": "regular", "level": "ellipse"},
    "regular, sample": {"kind": "regular", "level": "sample"},
    "importance, sample": {"kind": "importance", "level": "sample"},
}
LINE = glossy.Material(reflection=[glossy.Lobe(0.02, 0.1)])
LINES: dict[str, dict[str, Any]] = {
    f"{kind}, {level}": {"kind": kind, "level": level}
    for kind in ("line", "regular")
    for level in ("ellipse", "sample")
}
SAMPLES = 10
REPEATS = 20  # of what is over at once, when its time is taken


def study(place: Place, width: float, many: int) -> dict[str, Any]:
    """All errors of one isotropic lobe."""
    material = glossy.Material(reflection=[glossy.Lobe(width)])
    truth, noise = place.truth(material, many)
    found: dict[str, Any] = {"m": width, "truth": apart(truth + noise, truth, 0.0), "rep": {}}
    for name, options in REPRESENTATIONS.items():
        state = place.converged(material, many, **options)
        both = np.hypot(state.error, noise)
        found["rep"][name] = apart(state.radiance, truth, both)
        if name in (MAIN, "no margin"):
            bias = float(np.mean(state.radiance - truth) / np.mean(truth))
            missed = state.counts.missed / state.counts.samples
            found[name] = {"bias": bias, "missed": missed}
        if name == MAIN:
            converged, own = state.radiance, state.error
    found |= real_time(place, material, VARIANTS, converged, own, truth, noise)
    shown = place.real_time(material, MARGIN, samples=SAMPLES, kind="multi-ring", level="ellipse")
    found["by height"] = by_height(place, shown, converged, own, truth, noise)
    return found


def real_time(
    place: Place,
    material: glossy.Material,
    variants: Mapping[str, Mapping[str, Any]],
    converged: Array,
    own: Array,
    truth: Array,
    noise: Array,
) -> dict[str, dict[str, tuple[float, float]]]:
    """Errors of each variant, (to the converged buffer, to the truth)."""
    found = {}
    for name, options in variants.items():
        value = place.real_time(material, **{"margin": MARGIN, "samples": SAMPLES, **options})
        found[name] = apart(value, converged, own, truth), apart(value, truth, noise)
    return {"real time": found}


def by_height(
    place: Place, shown: Array, converged: Array, own: Array, truth: Array, noise: Array
) -> list[tuple[float, float, float]]:
    """Share of the points, error of the representation and of real time, per range of heights."""
    heights, rows = place.heights(), []
    spans = [(heights >= low) & (heights < high) for low, high in itertools.pairwise(HEIGHTS)]
    for on in (*spans, heights >= HEIGHTS[-1]):
        both = np.hypot(own[on], noise[on])
        rows.append(
            (
                float(on.mean()),
                apart(converged[on], truth[on], both),
                apart(shown[on], truth[on], noise[on]),
            )
        )
    return rows


def percent(x: float) -> str:
    """A share as text."""
    return f"{100.0 * x:.1f}"


def representation_table(results: Sequence[Mapping[str, Any]]) -> str:
    """Converged buffer against truth."""
    head = ["m", "no margin", "missed", "bias", *list(REPRESENTATIONS)[1:], "missed", "bias",
            "truth ±"]  # fmt: skip
    rows = []
    for r in results:
        errors = [percent(e) for e in r["rep"].values()]
        ends = [
            [percent(r[name]["missed"]), f"{100.0 * r[name]['bias']:+.1f}"]
            for name in ("no margin", MAIN)
        ]
        rows.append([r["m"], errors[0], *ends[0], *errors[1:], *ends[1], percent(r["truth"])])
    return table(head, rows)


def variant_table(results: Sequence[Mapping[str, Any]], labels: Sequence[str]) -> str:
    """Real time: error to the converged buffer / to the truth."""
    rows = []
    for name in results[0]["real time"]:
        pairs = [r["real time"][name] for r in results]
        rows.append([name, *(" / ".join(percent(e) for e in pair) for pair in pairs)])
    return table([f"{SAMPLES} samples", *labels], rows)


def height_table(results: Sequence[Mapping[str, Any]]) -> str:
    """Errors by the distance of what is mirrored: representation / real time."""
    names = [f"{a:g} to {b:g} m" for a, b in itertools.pairwise(HEIGHTS)]
    rows = []
    for k, name in enumerate((*names, "ceiling, sky")):
        cells = [r["by height"][k] for r in results]
        errors = [f"{percent(rep)} / {percent(shown)}" for _, rep, shown in cells]
        rows.append([name, percent(cells[0][0]), *errors])
    return table(["mirrored", "points", *(f"m = {r['m']}" for r in results)], rows)


def lines(place: Place, many: int) -> dict[str, Any]:
    """The anisotropic lobe."""
    truth, noise = place.truth(LINE, many)
    state = place.converged(LINE, many, MARGIN, planes="own")
    found = real_time(place, LINE, LINES, state.radiance, state.error, truth, noise)
    both = np.hypot(state.error, noise)
    return {**found, "rep": apart(state.radiance, truth, both)}


def costs(place: Place, rounds: int) -> str:
    """CPU time of everything over the real-time picture of the same points."""
    material = glossy.Material(reflection=[glossy.Lobe(0.1)])
    part, buffer = place.with_material(material), place.buffer()

    def shade(**options: Any) -> None:
        for _ in range(REPEATS):
            place.real_time(material, kind="multi-ring", samples=SAMPLES, **options)

    def refine() -> None:
        glossy.planar.Refinement(part.points, part.material, buffer, fallback=place.spare()).add(
            256
        )

    contenders: dict[str, Callable[[], object]] = {
        "ellipse": functools.partial(shade, level="ellipse"),
        "sample": functools.partial(shade, level="sample"),
        "no level": functools.partial(shade, level="none"),
        "one plane": functools.partial(shade, intersections=1),
        "buffer, 256 samples": refine,
        "rays, 256 samples": lambda: glossy.planar.reference_planar(
            place.prepared, part, samples=256
        ),
    }
    times = interleaved(contenders, rounds)
    for name in list(contenders)[:4]:
        times[name] = [t / REPEATS for t in times[name]]
    rows = [[name, median_ratio(times, name, "ellipse")] for name in contenders]
    return table(["", f"over {SAMPLES} samples, ellipse"], rows)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--page", type=pathlib.Path, help="fill the tables of this page")
    args = parser.parse_args()
    height, scale, many = (12, 2.0, 64) if args.quick else (36, 10.0, 2048)
    place = Place(height, scale=scale, coarse=args.quick)
    results = []
    for width in WIDTHS:
        results.append(study(place, width, many))
        print(f"m = {width}", file=sys.stderr)
    line = lines(place, many)
    tables = {
        "representation": representation_table(results),
        "variants": variant_table(results, [f"m = {m}" for m in WIDTHS]),
        "lines": variant_table([line], ["m = 0.02, 0.1"]),
        "heights": height_table(results),
        "costs": costs(place, 1 if args.quick else args.rounds),
    }
    print("\n\n".join(tables.values()))
    if args.page:
        fill(args.page, tables)
    write(args.json, "planar", {"isotropic": results, "line": line})


if __name__ == "__main__":
    main()
