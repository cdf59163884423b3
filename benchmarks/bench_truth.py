"""What the ground truth costs: CPU time per point and error reached, by tolerance and roughness.

    python benchmarks/bench_truth.py --json truth.json

A 128 x 128 sphere under the built-in spots, cube map 256. Errors are relative RMS differences to
the same quadrature at a tolerance ten times smaller than the smallest in the table.
"""

import time
from typing import Any

import common
import numpy as np

TOLERANCES = (0.3, 0.1, 1e-2, 1e-3, 1e-4)
LOBES = ({"mx": 0.5}, {"mx": 0.15}, {"mx": 0.2, "my": 0.075}, {"mx": 0.05}, {"mx": 0.01})


def measure(side: int, size: int) -> list[dict[str, Any]]:
    """A row for each lobe and tolerance."""
    import glossy

    cube = glossy.environment("spots", size=size)
    sphere = glossy.Sphere()
    camera = glossy.camera.default_camera(sphere, side, side)
    points = glossy.surface_points(camera, sphere)
    count = int(points.coverage.sum())
    rows = []
    for parameters in LOBES:
        lobe = glossy.Lobe(**parameters)
        best = glossy.reference(points, lobe, cube, tolerance=0.1 * min(TOLERANCES)).radiance
        level = np.sqrt(np.mean(best**2))
        for tolerance in TOLERANCES:
            start = time.process_time()
            truth = glossy.reference(points, lobe, cube, tolerance=tolerance)
            spent = time.process_time() - start
            rows.append(
                {
                    "lobe": parameters,
                    "tolerance": tolerance,
                    "cpu_us_per_point": spent / count * 1e6,
                    "relative_rms_error": float(
                        np.sqrt(np.mean((truth.radiance - best) ** 2)) / level
                    ),
                    "relative_bound": float(np.sqrt(np.mean(truth.error**2)) / level),
                }
            )
    return rows


def main() -> None:
    """Print the table."""
    parser = common.arguments(__doc__)
    parser.add_argument("--side", type=int, default=128)
    parser.add_argument("--size", type=int, default=256)
    args = parser.parse_args()
    if args.quick:
        args.side, args.size = 4, 16
    rows = measure(args.side, args.size)
    body: list[list[object]] = []
    for parameters in LOBES:
        mine = [r for r in rows if r["lobe"] == parameters]
        name = "m = " + ", ".join(f"{m:g}" for m in parameters.values())
        cells = [f"{r['cpu_us_per_point']:.0f} µs, {r['relative_rms_error']:.0e}" for r in mine]
        body.append([name, *cells])
    print(common.table(["tolerance", *(f"{t:g}" for t in TOLERANCES)], body))
    common.write(args.json, "truth", rows)


if __name__ == "__main__":
    main()
