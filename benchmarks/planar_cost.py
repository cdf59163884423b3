"""What a planar reflector costs by its samples, and where samples that miss its buffer should look.

Reflectors of the built-in ``hall``. Costs: CPU time over that of 10 samples. Misses: relative RMS
against rays cast into the scene, with very many unfiltered samples, so that only the buffer, its
margin and the fallback matter. Fills two tables of docs/planar.md.

    python benchmarks/planar_cost.py [--page docs/planar.md]
"""

import functools
import pathlib
from collections.abc import Callable

import numpy as np
from common import arguments, interleaved, median_ratio, table, write
from planar_place import Place, apart
from reproduce_thesis import fill

import glossy
from glossy.planar import mirror_pass, shade_planar
from glossy.scenes import view

COUNTS = (1, 3, 5, 10, 13, 20, 40)
MARGINS = (0.0, 0.1, 0.25, 0.5)
WIDTHS = (0.03, 0.1, 0.2)
REFLECTORS = ("floor", "panel")


def costs(place: Place, rounds: int) -> tuple[str, object]:
    """Shading by samples and level rule, and the mirror pass, over shading with 10 samples."""
    material = glossy.Material(reflection=[glossy.Lobe(0.05, alpha=0.5)])
    buffer, points = place.buffer(), place.part.points

    def shade(n: int, level: str) -> None:
        shade_planar(points, material, buffer, samples=n, level=level, fallback=place.spare)

    contenders: dict[str, Callable[[], object]] = {
        **{f"ellipse {n}": functools.partial(shade, n, "ellipse") for n in COUNTS},
        **{f"sample {n}": functools.partial(shade, n, "sample") for n in COUNTS},
        "mirror pass": lambda: mirror_pass(place.prepared, place.part),
        "the same, margin 0.25": lambda: mirror_pass(place.prepared, place.part, margin=0.25),
        "the view's rays": lambda: view(place.prepared, place.part.camera, 1),
    }
    times = interleaved(contenders, rounds)
    rows = [
        [n, *(median_ratio(times, f"{rule} {n}", "ellipse 10") for rule in ("ellipse", "sample"))]
        for n in COUNTS
    ]
    rows += [[name, median_ratio(times, name, "ellipse 10"), ""] for name in list(contenders)[-3:]]
    return table(["samples", "ellipse", "sample"], rows), times


def misses(place: Place, many: int) -> list[list[object]]:
    """Rows of error by margin and fallback, and the share of samples that missed."""
    rows = []
    for margin in MARGINS:
        buffer = mirror_pass(place.prepared, place.part, place.scale, margin)
        for name, spare in (("edge", None), ("cube", place.spare)):
            row: list[object] = [margin, name]
            for width in WIDTHS:
                material = glossy.Material(reflection=[glossy.Lobe(width, alpha=0.5)])
                truth, noise = place.truth(material, many)
                found = shade_planar(
                    place.part.points, material, buffer, kind="importance", samples=many,
                    level="none", fallback=spare,
                )  # fmt: skip
                value = np.asarray(found, dtype=np.float64)
                row.append(f"{100.0 * apart(value, truth, noise):.1f} %")
            rows.append(row)
    return rows


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--page", type=pathlib.Path, help="fill the tables of this page")
    args = parser.parse_args()
    height, many = (12, 32) if args.quick else (90, 1024)
    rows = []
    for reflector in REFLECTORS:
        place = Place(height, reflector, coarse=args.quick)
        rows += [[reflector, *row] for row in misses(place, many)]
    header = ["", "margin", "misses", *(f"m = {m}" for m in WIDTHS)]
    large = Place(12 if args.quick else 360, coarse=args.quick)
    work, times = costs(large, 1 if args.quick else args.rounds)
    tables = {"work": work, "margins": table(header, rows)}
    print("\n\n".join(tables.values()))
    if args.page:
        fill(args.page, tables)
    write(args.json, "planar_cost", {"misses": rows, "times": times})


if __name__ == "__main__":
    main()
