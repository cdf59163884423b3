"""What a fit recovers: parameters of known materials, the published fits, real measurements.

    python benchmarks/fit_study.py recovery published real --data DATA --json fit.json

recovery   bias and spread over seeds of every parameter, with noise, shadows, few directions
published  thesis Tables 3.1-3.3 as generators at the thesis's incident directions, refitted
real       L1 error of one, two, three lobes of four models for every file of DATA/brdf

Errors of ``real`` are eq. 3.7 over the weighted mean of p cos theta_i: the share of the light that
is misplaced. A file that cannot be read is named and left out.
"""

import argparse
import os
import pathlib
import sys
from typing import Any

import common
import numpy as np

CONDITIONS: dict[str, dict[str, Any]] = {
    "clean": {},
    "noise 10 %": {"noise": 0.1},
    "noise 30 %": {"noise": 0.3},
    "shadow 15°, noise 10 %": {"noise": 0.1, "shadow": 15.0},
    "2 incident angles, noise 10 %": {"noise": 0.1, "theta": (10.0, 45.0), "phi": (0.0, 90.0)},
    "normal incidence only, noise 10 %": {"noise": 0.1, "theta": (0.0,), "phi": (0.0,)},
    "all: 2 angles, shadow 15°, noise 30 %": {
        "noise": 0.3,
        "shadow": 15.0,
        "theta": (10.0, 45.0),
        "phi": (0.0, 90.0),
    },
}
NAMES = ("mx", "my", "alpha", "r0", "ks", "ks r0", "kd")
MODELS = ("kurt", "ward", "beckmann", "ggx")


def values_of(material: Any) -> list[float]:
    """Parameters of every lobe and kd, in the order of ``NAMES`` a lobe."""
    out = []
    for x in material.lobes:
        out += [x.mx, x.my, x.alpha, x.r0, x.ks, x.ks * x.r0, material.kd]
    return out


def recovery(seeds: int, quick: bool) -> list[dict[str, Any]]:
    """Rows of bias and spread for two materials under each condition."""
    import glossy
    from glossy.measured.synthetic import synthetic_table

    one = glossy.Material(0.05, [glossy.Lobe(0.15, 0.08, ks=0.8, r0=0.7, alpha=0.3)])
    two = glossy.Material(
        0.05,
        [glossy.Lobe(0.1, 0.06, ks=0.5, r0=0.8, alpha=0.4), glossy.Lobe(0.4, 0.3, ks=0.4, r0=0.6)],
    )
    rows = []
    for name, material in (("one lobe", one), ("two lobes", two)):
        truth = np.array(values_of(material))
        for condition, options in CONDITIONS.items():
            grid: dict[str, Any] = (
                {"rows": 8, "columns": 12} if quick else {"rows": 18, "columns": 24}
            )
            found, errors = [], []
            for seed in range(1 if condition == "clean" else seeds):
                table = synthetic_table(material, seed=seed, **grid, **options)
                fit = glossy.fit_table(table, len(material.reflection), grid=7, rounds=2)
                assert fit.material is not None
                found.append(values_of(fit.material))
                errors.append(fit.error)
            off = np.array(found) - truth
            rows.append(
                {
                    "material": name,
                    "condition": condition,
                    "seeds": len(found),
                    "truth": truth.tolist(),
                    "bias": off.mean(axis=0).tolist(),
                    "spread": off.std(axis=0).tolist(),
                    "error": float(np.mean(errors)),
                }
            )
            print(name, condition, file=sys.stderr)
    return rows


def published(quick: bool) -> list[dict[str, Any]]:
    """Every published fit as a generator, clean and with 10 % noise, and what comes back."""
    import glossy
    from glossy.materials import PUBLISHED, published_material
    from glossy.measured.synthetic import synthetic_table

    rows = []
    for name in PUBLISHED:
        entry = published_material(name)
        phi = (0.0, 45.0, 90.0) if len(entry.phi) > 1 else (0.0, 90.0)
        grid: dict[str, Any] = {"rows": 30, "columns": 60}
        if quick:
            grid = {"rows": 8, "columns": 12}
        for noise in (0.0, 0.1):
            table = synthetic_table(entry.material, entry.theta, phi, noise=noise, **grid)
            m = entry.material
            fit = glossy.fit_table(
                table,
                len(m.reflection),
                len(m.transmission),
                grid=7,
                rounds=2,
                fixed={} if not m.transmission else {"transmission.r0": m.transmission[0].r0},
            )
            assert fit.material is not None
            rows.append(
                {
                    "name": name,
                    "noise": noise,
                    "rows": len(table),
                    "error": fit.error,
                    "grid_errors": [s.error for s in fit.stages if s.name.endswith("grid")],
                    "truth": [_lobe(x) for x in m.lobes],
                    "found": [_lobe(x) for x in fit.material.lobes],
                    "kd": [m.kd, fit.material.kd],
                }
            )
            print(name, noise, fit.error, file=sys.stderr)
    return rows


def _lobe(x: Any) -> dict[str, float]:
    return {k: getattr(x, k) for k in ("mx", "my", "alpha", "r0", "ks")}


def real(folder: pathlib.Path, files: str, quick: bool) -> list[dict[str, Any]]:
    """A row for each file, model and number of lobes."""
    import glossy
    from glossy.measured.fit_rows import lit_from, row_weights

    rows = []
    for path in sorted(folder.glob(files)):
        try:
            table = lit_from(glossy.read_measured(path), "above")
        except (ValueError, OSError) as error:
            print(f"left out: {error}", file=sys.stderr)
            continue
        w = row_weights(table, "auto")[:, None] * (table.f != 0.0)
        y = table.f * np.abs(table.wi[:, 2:] * table.wo[:, 2:])
        level = float((w * np.abs(y)).sum() / w.sum())
        for model in MODELS:
            for lobes in (1,) if quick else (1, 2, 3):
                fit = glossy.fit_table(
                    table,
                    lobes,
                    model=model,
                    grid=3 if quick else (5 if len(table) > 20_000 else 7),
                    levels=1 if quick else 4,
                    rounds=1 if quick else 2,
                    polish="none" if quick else "local",
                )
                rows.append(
                    {
                        "file": path.name,
                        "rows": fit.rows,
                        "level": level,
                        "model": model,
                        "lobes": lobes,
                        "error": fit.error,
                        "share": fit.error / level,
                        "errors": dict(fit.errors),
                        "parameters": {k: v.tolist() for k, v in fit.parameters.items()},
                        "at_bounds": list(fit.at_bounds),
                        "stages": [[s.name, s.error, s.seconds] for s in fit.stages],
                        "seconds": fit.seconds,
                    }
                )
                print(path.name, model, lobes, f"{fit.error / level:.4f}", file=sys.stderr)
    return rows


def print_recovery(rows: list[dict[str, Any]]) -> None:
    """Bias ± spread in per cent of the truth (alpha and kd: absolute, times 100)."""
    for name in dict.fromkeys(r["material"] for r in rows):
        mine = [r for r in rows if r["material"] == name]
        lobes = len(mine[0]["truth"]) // len(NAMES)
        for j in range(lobes):
            head = f"{name}" + (f", lobe {j + 1}" if lobes > 1 else "")
            body: list[list[object]] = []
            for r in mine:
                cells = []
                for k, parameter in enumerate(NAMES):
                    at = j * len(NAMES) + k
                    unit = 1.0 if parameter in ("alpha", "kd") else abs(r["truth"][at])
                    bias, spread = 100 * r["bias"][at] / unit, 100 * r["spread"][at] / unit
                    cells.append(f"{bias + 0.0:+.1f} ± {spread:.1f}".replace("-0.0", "+0.0"))
                body.append([r["condition"], *cells])
            print(common.table([head, *NAMES], body), "\n")


def print_published(rows: list[dict[str, Any]]) -> None:
    """Truth and what came back, a line a lobe."""
    body: list[list[object]] = []
    for r in rows:
        for k, (truth, found) in enumerate(zip(r["truth"], r["found"], strict=True)):
            label = f"{r['name']}, {100 * r['noise']:.0f} %" if k == 0 else ""
            cells = [f"{truth[n]:.4g} → {found[n]:.4g}" for n in truth]
            error = f"{r['error']:.2g}" if k == 0 else ""
            body.append([label, *cells, error])
    print(common.table(["generator, noise", "mx", "my", "alpha", "r0", "ks", "L1"], body), "\n")


def print_real(rows: list[dict[str, Any]]) -> None:
    """Share of misplaced light [%] for each file, model and number of lobes."""
    body: list[list[object]] = []
    counts = sorted({r["lobes"] for r in rows})
    for name in dict.fromkeys(r["file"] for r in rows):
        mine = {(r["model"], r["lobes"]): r for r in rows if r["file"] == name}
        cells = [f"{100 * mine[m, n]['share']:.2f}" for m in MODELS for n in counts]
        body.append([name, *cells])
    print(common.table(["file", *(f"{m} {n}" for m in MODELS for n in counts)], body), "\n")


def main() -> None:
    """Run the parts asked for and print their tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="+", choices=("recovery", "published", "real"))
    parser.add_argument("--data", default=os.environ.get("GLOSSY_DATA", "."), metavar="DIR")
    parser.add_argument("--files", default="*.*", metavar="GLOB", help="of the real data")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--quick", action="store_true", help="tiny: to see that it runs")
    parser.add_argument("--json", type=pathlib.Path, help="write the figures to this file")
    args = parser.parse_args()
    results: dict[str, Any] = {}
    if "recovery" in args.parts:
        results["recovery"] = recovery(1 if args.quick else args.seeds, args.quick)
        print_recovery(results["recovery"])
    if "published" in args.parts:
        results["published"] = published(args.quick)
        print_published(results["published"])
    if "real" in args.parts:
        results["real"] = real(pathlib.Path(args.data) / "brdf", args.files, args.quick)
        print_real(results["real"])
    common.write(args.json, "fit_study", results)


if __name__ == "__main__":
    main()
