"""What the pyramid's filter does to each method's error.

    python benchmarks/filter_gains.py --maps DIR --json gains.json

Random views to 80 degrees of four lobes at 7 to 30 samples; every method's level bias is tuned with
every filter on one map of bright spots, and the error is read on others: built-in maps and the
files of ``--maps``. Reported: error with a filter over error with ``gauss6``, case by case (a case
is a map, a lobe and a number of samples), relative RMS against the deterministic truth.
"""

import math
import pathlib
import sys
from typing import Any

import common
import numpy as np
import numpy.typing as npt

import glossy
from glossy.pyramid import FILTERS

LOBES = ((0.05, 0.05), (0.15, 0.15), (0.2, 0.075), (0.3, 0.06))
SAMPLES = (7, 14, 20, 30)
METHODS: dict[str, dict[str, Any]] = {
    "regular, paper": {"method": "regular", "footprint": "paper"},
    "regular, thesis": {"method": "regular", "footprint": "thesis"},
    "regular, jacobian": {"method": "regular", "footprint": "jacobian"},
    "importance": {"method": "importance"},
}
BIASES = np.arange(-2.0, 1.01, 0.125)
TOLERANCE = 2e-3  # of the truth

Array = npt.NDArray[np.floating]


def views(count: int, seed: int) -> glossy.SurfacePoints:
    """Surfaces of any orientation seen at 0 to 80 degrees, tangents at random."""
    rng = np.random.default_rng(seed)
    n, t = rng.normal(size=(2, count, 3))
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    t -= n * np.sum(n * t, axis=-1, keepdims=True)
    t /= np.linalg.norm(t, axis=-1, keepdims=True)
    angle, turn = np.radians(rng.uniform(0.0, 80.0, count)), rng.uniform(0.0, 2 * np.pi, count)
    side = np.cos(turn)[:, None] * t + np.sin(turn)[:, None] * np.cross(n, t)
    view = np.cos(angle)[:, None] * n + np.sin(angle)[:, None] * side
    return glossy.SurfacePoints(normal=n, tangent=t, view=view)


def error(got: Array, truth: Array) -> float:
    """Relative RMS."""
    return math.sqrt(float(np.mean((got - truth) ** 2) / np.mean(truth**2)))


def main() -> None:
    """Tune, read, and print the ratios of every method and filter."""
    parser = common.arguments(__doc__)
    parser.add_argument("--maps", type=pathlib.Path, help="folder of .hdr and .exr environments")
    parser.add_argument("--size", type=int, default=256, help="texels of a face's edge")
    parser.add_argument("--points", type=int, default=300)
    parser.add_argument("--filters", nargs="+", default=list(FILTERS))
    args = parser.parse_args()
    if args.quick:
        args.size, args.points = 32, 20
    points = views(args.points, seed=5)
    names = ["spots", "studio", "sky"]
    train = glossy.environment("spots", args.size, seed=0)
    tests = {name: glossy.environment(name, args.size, seed=1) for name in names}
    for path in sorted(args.maps.iterdir()) if args.maps else ():
        if path.suffix in (".hdr", ".exr"):
            tests[path.stem] = glossy.read_environment(path, size=args.size)
    cubes = {"train": train, **tests}
    pyramids = {
        (f, name): glossy.build_pyramid(cube, filter=f)
        for f in args.filters
        for name, cube in cubes.items()
    }
    rows: list[dict[str, Any]] = []
    for mx, my in LOBES:
        lobe = glossy.Lobe(mx=mx, my=my)
        print(f"lobe {mx} {my}", file=sys.stderr)
        truth = {
            name: glossy.reference(points, lobe, cube, tolerance=TOLERANCE).radiance
            for name, cube in cubes.items()
        }
        for samples in SAMPLES:
            for label, options in METHODS.items():
                for f in args.filters:

                    def run(
                        name: str,
                        bias: float,
                        f: str = f,
                        options: dict[str, Any] = options,
                        samples: int = samples,
                        lobe: glossy.Lobe = lobe,
                        truth: dict[str, Any] = truth,
                    ) -> float:
                        image = glossy.shade(
                            points, lobe, pyramids[f, name], samples=samples, bias=bias, **options
                        )
                        return error(image, truth[name])

                    errors = [run("train", float(b)) for b in BIASES]
                    bias = float(BIASES[int(np.argmin(errors))])
                    for name in tests:
                        rows.append(
                            {"lobe": [mx, my], "samples": samples, "method": label, "filter": f,
                             "bias": bias, "map": name, "error": run(name, bias)}
                        )  # fmt: skip
    print(report(rows, args.filters))
    common.write(args.json, "filter_gains", rows)


def report(rows: list[dict[str, Any]], filters: list[str]) -> str:
    """Median error and ratio to ``gauss6`` of every method and filter."""
    found = {
        (r["method"], r["filter"], *r["lobe"], r["samples"], r["map"]): r["error"] for r in rows
    }
    lines = []
    for label in METHODS:
        for f in filters:
            cases = [k for k in found if k[0] == label and k[1] == f]
            errors = np.array([found[k] for k in cases])
            base = np.array([found.get((label, "gauss6", *k[2:]), math.nan) for k in cases])
            ratio = errors / base
            q = np.percentile(ratio, [10, 25, 50, 75, 90])
            bias = np.median([r["bias"] for r in rows if (r["method"], r["filter"]) == (label, f)])
            lines.append(
                [label, f, f"{bias:+.2f}", f"{np.median(errors):.4f}", f"{q[2]:.2f}",
                 f"{q[1]:.2f} to {q[3]:.2f}", f"{q[0]:.2f} to {q[4]:.2f}",
                 f"{np.mean(ratio < 1.0):.0%}"]
            )  # fmt: skip
    header = ["method", "filter", "bias", "median error", "over gauss6", "half of the cases",
              "80 % of the cases", "better"]  # fmt: skip
    return common.table(header, lines)


if __name__ == "__main__":
    main()
