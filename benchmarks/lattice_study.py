"""The lattice method against the published ones: error ratios on maps that nothing was tuned on.

A case is a map, a lobe, a band of views (0-40, 40-65, 65-80 degrees) and a budget, at the count
that the regular pattern really has. Every method's free parameters are chosen on the same training
maps (three of the built-in bright spots, other seeds) for each lobe and count: threshold and bias
of the regular method with each footprint, bias of importance sampling, bias of the lattice. The
ratio is the lattice's RMS error over that of the best of the four others in this very case, and
over that of the printed regular method; cases where the better error is below 1e-3 of the truth are
counted apart. Intervals: 95 %, bootstrap over maps. Truth: ``glossy.reference`` to a bound of 3e-3.

    python benchmarks/lattice_study.py -o study.json
"""

import argparse
import json
import math
import os
import pathlib
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

import glossy

Array = npt.NDArray[np.float64]

BANDS = ((0.0, 40.0), (40.0, 65.0), (65.0, 80.0))
LOBES = (
    (0.02, 0.02), (0.05, 0.05), (0.15, 0.15), (0.3, 0.3), (0.5, 0.5),
    (0.1, 0.02), (0.2, 0.075), (0.3, 0.06), (0.5, 0.05),
)  # fmt: skip
BUDGETS = (5, 7, 10, 14, 20, 32)
TRAINING = tuple(("spots", seed) for seed in (11, 12, 13))
BUILT_IN = (("spots", 0), ("studio", 0), ("sky", 0))
THRESHOLDS = (0.01, 0.03, 0.1, 0.2, 0.35)
BIASES = tuple(float(b) for b in np.arange(-1.5, 0.51, 0.25))
FOOTPRINTS = ("paper", "thesis", "jacobian")
TOLERANCE = 3e-3
SMALL = 1e-3


def views(count: int, seed: int) -> glossy.SurfacePoints:
    """``count`` random points in each band, (bands, count)."""
    r = np.random.default_rng(seed)
    shape = (len(BANDS), count, 3)
    n = r.normal(size=shape)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    t = np.cross(n, r.normal(size=shape))
    t /= np.linalg.norm(t, axis=-1, keepdims=True)
    low, high = (np.cos(np.radians([band[k] for band in BANDS]))[:, None] for k in (1, 0))
    c = (low + (high - low) * r.random(shape[:2]))[..., None]
    phi = 2.0 * math.pi * r.random(shape[:2])[..., None]
    side = np.sqrt(1.0 - c * c) * (np.cos(phi) * t + np.sin(phi) * np.cross(n, t))
    return glossy.SurfacePoints(n, t, c * n + side)


def relative(picture: npt.ArrayLike, truth: Array) -> Array:
    """RMS error over the RMS of the truth, for each band."""
    difference = np.asarray(picture, dtype=np.float64) - truth
    return np.asarray(np.sqrt(np.mean(difference**2, axis=(1, 2)) / np.mean(truth**2, axis=(1, 2))))


def candidates(lobe: glossy.Lobe, budget: int) -> Iterator[tuple[str, int, dict[str, Any]]]:
    """(method, taps, options of ``shade``) with every setting of the free parameters."""
    count = len(glossy.pattern_for_budget(lobe, budget))
    for threshold in THRESHOLDS:
        taps = len(glossy.pattern_for_budget(lobe, budget, threshold))
        if taps > count:
            continue  # nobody gets more taps than the others
        for footprint in FOOTPRINTS:
            for bias in BIASES:
                options = {"threshold": threshold, "footprint": footprint, "bias": bias}
                yield f"regular {footprint}", taps, {"samples": budget, **options}
    for bias in BIASES:
        yield "importance", count, {"method": "importance", "samples": count, "bias": bias}
    for bias in (-0.25, 0.0, 0.25):
        yield "lattice", count, {"method": "lattice", "samples": count, "bias": bias}


class Maps:
    """Cube maps, pyramids and truths, made once each."""

    def __init__(self, size: int, points: glossy.SurfacePoints, filters: dict[str, str]) -> None:
        self.size, self.points, self.filters = size, points, filters

    def load(self, name: str, seed: int) -> None:
        """Take up a map: a built-in name, or a file."""
        if name in ("spots", "studio", "sky"):
            self.cube = glossy.environment(name, size=self.size, seed=seed)
        else:
            self.cube = glossy.read_environment(name, size=self.size)
        self.pyramids = {
            f: glossy.build_pyramid(self.cube, filter=f) for f in set(self.filters.values())
        }

    def truth(self, material: glossy.Material) -> Array:
        """The integral at every point."""
        found = glossy.reference(self.points, material, self.cube, tolerance=TOLERANCE)
        return np.asarray(found.radiance)

    def error(
        self, name: str, options: dict[str, Any], material: glossy.Material, truth: Array
    ) -> Array:
        """Relative RMS error of a method in each band."""
        pyramid = self.pyramids[self.filters["lattice" if name == "lattice" else "others"]]
        return relative(glossy.shade(self.points, material, pyramid, **options), truth)


def tune(maps: Maps, log: Callable[[str], None]) -> dict[tuple[int, int, str], dict[str, Any]]:
    """The best setting of every method for each lobe and budget, on the training maps."""
    sums: dict[tuple[int, int, str], dict[str, tuple[float, dict[str, Any]]]] = {}
    for name, seed in TRAINING:
        maps.load(name, seed)
        for j, widths in enumerate(LOBES):
            material = glossy.Material(reflection=[glossy.Lobe(*widths)])
            truth = maps.truth(material)
            for budget in BUDGETS:
                for method, _, options in candidates(material.reflection[0], budget):
                    error = maps.error(method, options, material, truth)
                    cell = sums.setdefault((j, budget, method), {})
                    key = json.dumps(options, sort_keys=True)
                    cell[key] = (
                        cell.get(key, (0.0, options))[0] + float(np.sum(error**2)),
                        options,
                    )
        log(f"tuned on {name} {seed}")
    return {k: min(cell.values(), key=lambda pair: pair[0])[1] for k, cell in sums.items()}


def measure(
    maps: Maps, tuned: dict[tuple[int, int, str], dict[str, Any]], tests: list[tuple[str, int]],
    log: Callable[[str], None],
) -> list[dict[str, Any]]:  # fmt: skip
    """One record for each case."""
    records = []
    for name, seed in tests:
        maps.load(name, seed)
        label = pathlib.Path(name).stem if seed == 0 else f"{name} {seed}"
        for j, widths in enumerate(LOBES):
            material = glossy.Material(reflection=[glossy.Lobe(*widths)])
            truth = maps.truth(material)
            for budget in BUDGETS:
                methods = sorted({m for a, b, m in tuned if (a, b) == (j, budget)})
                errors = {m: maps.error(m, tuned[j, budget, m], material, truth) for m in methods}
                count = len(glossy.pattern_for_budget(material.reflection[0], budget))
                for k, band in enumerate(BANDS):
                    own = {m: float(e[k]) for m, e in errors.items()}
                    case = {"map": label, "lobe": widths, "taps": count, "view": band}
                    records.append({**case, "errors": own})
        log(f"measured {label}")
    return records


def figures(records: list[dict[str, Any]], against: str) -> dict[str, Any]:
    """Median ratio, shares and extremes, with intervals from a bootstrap over maps."""
    ratios: dict[str, list[float]] = {}
    small = 0
    for record in records:
        errors: dict[str, float] = record["errors"]
        others = [e for m, e in errors.items() if m != "lattice"]
        rival = min(others) if against == "best" else errors[against]
        if min(rival, errors["lattice"]) < SMALL:
            small += 1
            continue
        ratios.setdefault(str(record["map"]), []).append(errors["lattice"] / rival)
    every = np.concatenate([np.array(v) for v in ratios.values()])
    r = np.random.default_rng(1)
    names = list(ratios)
    draws = []
    for _ in range(1000):
        pick = np.concatenate(
            [np.array(ratios[names[i]]) for i in r.integers(0, len(names), len(names))]
        )
        draws.append((np.median(pick), np.mean(pick <= 0.9), np.mean(pick > 1.1)))
    low, high = np.percentile(np.array(draws), [2.5, 97.5], axis=0)
    return {
        "cases": len(every),
        "below 1e-3": small,
        "median": float(np.median(every)),
        "median interval": [round(float(low[0]), 3), round(float(high[0]), 3)],
        "share <= 0.9": float(np.mean(every <= 0.9)),
        "share <= 0.9 interval": [round(float(low[1]), 3), round(float(high[1]), 3)],
        "share > 1.1": float(np.mean(every > 1.1)),
        "share > 1.1 interval": [round(float(low[2]), 3), round(float(high[2]), 3)],
        "worst": float(every.max()),
    }


def main(arguments: list[str] | None = None) -> int:
    raw = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("-o", "--output", default="lattice-study.json")
    parser.add_argument("--size", type=int, default=256, help="texels along an edge (default: 256)")
    parser.add_argument("--points", type=int, default=150, help="in each band (default: 150)")
    parser.add_argument(
        "--filter", default="round", help="of the lattice's pyramid (default: round)"
    )
    parser.add_argument("--others", default="gauss6", help="of the others' (default: gauss6)")
    args = parser.parse_args(arguments)

    def log(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    folder = os.environ.get("GLOSSY_DATA")
    real: list[tuple[str, int]] = []
    if folder:
        paths = sorted(pathlib.Path(folder, "env").glob("*.*"))
        real = [(str(p), 0) for p in paths if p.suffix in (".hdr", ".exr")]
    else:
        log("GLOSSY_DATA is not set: built-in maps only")
    maps = Maps(args.size, views(args.points, 77), {"lattice": args.filter, "others": args.others})
    tuned = tune(maps, log)
    records = measure(maps, tuned, [*BUILT_IN, *real], log)
    groups = {"all": records}
    for widths in LOBES:
        groups[f"m = {widths}"] = [r for r in records if r["lobe"] == widths]
    for band in BANDS:
        groups[f"views {band}"] = [r for r in records if r["view"] == band]
    for low, high in ((0, 8), (8, 16), (16, 40)):
        groups[f"taps {low + 1}-{high}"] = [r for r in records if low < r["taps"] <= high]
    table = {
        name: {rival: figures(part, rival) for rival in ("best", "regular paper")}
        for name, part in groups.items()
        if part
    }
    for name, row in table.items():
        best, printed = row["best"], row["regular paper"]
        print(
            f"{name:22s} best of four: median {best['median']:.2f} {best['median interval']}, "
            f"<= .9 in {best['share <= 0.9']:.0%}, > 1.1 in {best['share > 1.1']:.1%}, worst "
            f"{best['worst']:.2f} ({best['cases']} cases, {best['below 1e-3']} apart); "
            f"printed: median {printed['median']:.2f}"
        )
    out = {
        "schema": 1, "size": args.size, "points": args.points, "filter": args.filter,
        "others": args.others, "table": table, "records": records,
        "tuned": {" ".join(map(str, k)): v for k, v in tuned.items()},
    }  # fmt: skip
    scratch = pathlib.Path(args.output + ".part")
    scratch.write_text(json.dumps(out, indent=1) + "\n")
    scratch.replace(args.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
