"""Time of the lattice method over that of regular sampling at the same number of taps.

python benchmarks/bench_lattice.py --json lattice.json

A sphere fills the picture; CPU time of the process, all threads together, taken in turn.
"""

import time

import common
import numpy as np

CASES = (((0.15, 0.15), 7), ((0.15, 0.15), 14), ((0.15, 0.15), 30), ((0.2, 0.075), 17))


def sphere(size: int) -> object:
    """The points of a picture of a sphere, seen from afar."""
    import glossy

    x = (np.arange(size) + 0.5) * 2.0 / size - 1.0
    u, v = np.meshgrid(x, -x)
    r2 = u * u + v * v
    seen = r2 < 0.98
    n = np.stack([u, v, np.sqrt(np.where(seen, 1.0 - r2, 1.0))], axis=-1)
    view = np.broadcast_to([0.0, 0.0, 1.0], n.shape)
    return glossy.SurfacePoints(np.where(seen[..., None], n, view), None, view, seen)


def main() -> int:
    import glossy

    args = common.arguments(__doc__).parse_args()
    size = 48 if args.quick else 768
    points = sphere(size)
    assert isinstance(points, glossy.SurfacePoints)
    pyramid = glossy.build_pyramid(glossy.environment("spots", size=64 if args.quick else 256))
    covered = int(points.coverage.sum())
    rows, results = [], []
    for widths, budget in CASES:
        material = glossy.Material(reflection=[glossy.Lobe(*widths)])
        n = len(glossy.pattern_for_budget(material.reflection[0], budget))
        contenders = {
            "regular": lambda m=material, k=budget: glossy.shade(points, m, pyramid, samples=k),
            "lattice": lambda m=material, k=n: glossy.shade(
                points, m, pyramid, method="lattice", samples=k
            ),
        }
        times = common.interleaved(contenders, 1 if args.quick else args.rounds, time.process_time)
        per = {k: min(v) / covered / n * 1e9 for k, v in times.items()}
        low, middle, high = common.ratio(times, "lattice", "regular")
        text = common.median_ratio(times, "lattice", "regular")
        rows.append([widths, n, f"{per['regular']:.1f}", f"{per['lattice']:.1f}", text])
        results.append({"widths": widths, "taps": n, "ns a tap": per, "ratio": [low, middle, high]})
    print(common.table(["lobe", "taps", "regular ns", "lattice ns", "lattice over regular"], rows))
    common.write(args.json, "lattice", results)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
