"""The ground truth against Mitsuba 3: CPU time to 1 % and to 0.1 % relative RMS error.

    python benchmarks/bench_reference.py --json reference.json

A sphere of 128 x 128 pixels under a map of small bright discs, one lobe, one ray to each covered
pixel's centre. Both start from the same lat-long picture (256 x 512, rows on the poles as Mitsuba
has them): Mitsuba uses it as its emitter, this package makes a cube map of it, 256 a face.

Errors are against the integral to a bound of 1e-4, this package's of its own cube map and Mitsuba's
of a cube map of 1024 a face, which lies nearer to the picture; what separates Mitsuba's mean
from that is estimated from two independent renderings (column "bias") and is not its noise. The
truth itself is checked by Monte Carlo on some of the points: the z-scores of its differences.

"Certified" is the time at a tolerance of the goal itself, whose bound says that it is met; the
other is the least time of a tolerance whose error, known afterwards, meets it. Who has no truth at
hand can only ask for the former.

Mitsuba's time to an error follows from the power law through its measured points; beyond the last
of them it is an extrapolation, and marked so. CPU time of all threads, compiled before.
"""

import argparse
import functools
import math
import time
from collections.abc import Callable
from typing import Any

import common
import numpy as np

import glossy
from glossy.camera import Sphere, default_camera, surface_points
from glossy.latlong import cube_to_latlong, latlong_to_cube

LOBES = {"m=.15": (0.15, 0.15), "m=.2/.075": (0.2, 0.075)}
GOALS = (1e-2, 1e-3)
TOLERANCES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08, 0.05, 0.03, 0.02, 0.01)
CHECKED = 64  # points of the truth that Monte Carlo looks at


def clocked(run: Callable[[], Any], rounds: int) -> tuple[Any, float]:
    """Result and least CPU time; the first run compiles and does not count."""
    result, best = run(), math.inf
    for _ in range(rounds):
        start = time.process_time()
        result = run()
        best = min(best, time.process_time() - start)
    return result, best


def relative(error: Any, truth: Any) -> float:
    """Relative RMS."""
    return float(np.sqrt(np.mean(error**2) / np.mean(truth**2)))


def ours(points: Any, material: Any, cube: Any, truth: Any, rounds: int) -> list[dict[str, Any]]:
    """Error and CPU time of the deterministic estimator, tolerance by tolerance."""
    rows: list[dict[str, Any]] = []
    for tolerance in (*GOALS, *TOLERANCES):
        if rows and tolerance == rows[0]["tolerance"]:
            continue
        run = functools.partial(glossy.reference, points, material, cube, tolerance=tolerance)
        found, seconds = clocked(run, rounds)
        error = relative(found.radiance - truth, truth)
        rows.append({"tolerance": tolerance, "error": error, "seconds": seconds})
        if tolerance not in GOALS and error < 0.3 * GOALS[-1]:
            break
    return rows


def prepare(cube: Any) -> None:
    """What the first call with a map does for all later ones: a new map of the same texels."""
    pole = glossy.SurfacePoints([0.0, 0.0, 1.0], None, [0.0, 0.0, 1.0])
    glossy.reference(pole, glossy.Material(), glossy.CubeMap(cube.faces), tolerance=1.0)


def check(points: Any, material: Any, cube: Any, truth: Any, samples: int) -> float:
    """RMS z-score of the truth against Monte Carlo on a few points."""
    some = np.random.default_rng(1).choice(len(truth), min(CHECKED, len(truth)), replace=False)
    other = glossy.reference(points[some], material, cube, estimator="mc", samples=samples)
    z = (other.radiance - truth[some]) / other.error
    return float(np.sqrt(np.mean(z**2)))


def theirs(sphere: Any, truth: Any, counts: list[int], rounds: int) -> list[dict[str, Any]]:
    """Error and CPU time of Mitsuba, count by count."""
    rows = []
    for samples in counts:
        first, second = (sphere.radiance(samples, seed) - truth for seed in (1, 2))
        _, seconds = clocked(functools.partial(sphere.radiance, samples, 3), rounds)
        both = float(np.mean(first * second) / np.mean(truth**2))
        error = math.sqrt((relative(first, truth) ** 2 + relative(second, truth) ** 2) / 2)
        rows.append(
            {"samples": samples, "error": error, "seconds": seconds,
             "bias": math.copysign(math.sqrt(abs(both)), both)}
        )  # fmt: skip
    return rows


def time_to(rows: list[dict[str, Any]], goal: float) -> tuple[float, bool]:
    """CPU seconds to an error by the power law through the points; True if extrapolated."""
    x = np.log([r["error"] for r in rows])
    slope, offset = np.polyfit(x, np.log([r["seconds"] for r in rows]), 1)
    return float(np.exp(offset + slope * math.log(goal))), goal < min(r["error"] for r in rows)


def measure(args: argparse.Namespace) -> list[dict[str, Any]]:
    """One record for each lobe."""
    picture = cube_to_latlong(glossy.environment("spots", size=args.size), args.size, "mitsuba")
    cube = glossy.CubeMap(latlong_to_cube(picture, args.size, "mitsuba"))
    fine = glossy.CubeMap(latlong_to_cube(picture, 4 * args.size, "mitsuba"))
    camera = default_camera(Sphere(), args.pixels, args.pixels)
    grid = surface_points(camera, Sphere())
    points = grid[grid.coverage]
    records = []
    for name, (mx, my) in LOBES.items():
        material = glossy.Material(reflection=[glossy.Lobe(mx=mx, my=my)])
        truth, true = (
            glossy.reference(points, material, c, tolerance=1e-4).radiance for c in (cube, fine)
        )
        record: dict[str, Any] = {
            "lobe": name,
            "points": len(truth),
            "z": check(points, material, cube, truth, args.check),
            "preparation": clocked(lambda: prepare(cube), args.rounds)[1],
            "glossy": ours(points, material, cube, truth, args.rounds),
        }
        try:
            import mitsuba_sphere

            rays = camera.rays()[grid.coverage].astype(np.float32)
            sphere = mitsuba_sphere.Sphere(picture, camera.position, rays, mx, my)
            record["mitsuba"] = theirs(sphere, true, args.counts, args.rounds)
        except ImportError as error:
            record["mitsuba_absent"] = str(error)
        records.append(record)
    return records


def report(records: list[dict[str, Any]]) -> None:
    """Tables: every measured point, then the time to each goal."""
    rows: list[list[str]] = []
    goals: list[list[str]] = []
    for record in records:
        name = record["lobe"]
        for r in record["glossy"]:
            setting = f"tolerance {r['tolerance']:g}"
            rows.append([name, "glossy", setting, f"{r['error']:.1e}", "", f"{r['seconds']:.2f}"])
        for r in record.get("mitsuba", []):
            texts = (f"{r['error']:.1e}", f"{r['bias']:.0e}", f"{r['seconds']:.2f}")
            rows.append([name, "mitsuba", f"{r['samples']} samples", *texts])
        for goal in GOALS:
            good = [r for r in record["glossy"] if r["error"] <= goal]
            own = min(r["seconds"] for r in good) if good else math.nan
            sure = next(r["seconds"] for r in record["glossy"] if r["tolerance"] == goal)
            other, ratio, certified = "absent", "absent", "absent"
            if record.get("mitsuba"):
                seconds, extrapolated = time_to(record["mitsuba"], goal)
                other = f"{seconds:.1f}{' (extrapolated)' if extrapolated else ''}"
                ratio, certified = f"{seconds / own:.0f}", f"{seconds / sure:.0f}"
            goals.append(
                [name, f"{goal:.1%}", f"{own:.2f}", f"{own + record['preparation']:.2f}", other,
                 ratio, f"{sure:.2f}", certified, f"{record['z']:.2f}"]
            )  # fmt: skip
    print(common.table(["lobe", "program", "setting", "error", "bias", "CPU s"], rows))
    print()
    header = ["lobe", "error", "glossy, CPU s", "with preparation", "mitsuba, CPU s",
              "mitsuba over glossy", "certified, CPU s", "over certified",
              "z of the truth"]  # fmt: skip
    print(common.table(header, goals))


def main() -> None:
    """Measure and print."""
    parser = common.arguments(__doc__)
    parser.set_defaults(rounds=3)
    parser.add_argument("--size", type=int, default=256, help="of a cube face, rows of the picture")
    parser.add_argument("--pixels", type=int, default=128)
    parser.add_argument("--counts", type=int, nargs="+", default=[64, 256, 1024, 2070])
    parser.add_argument("--check", type=int, default=65536, help="samples a point of the check")
    args = parser.parse_args()
    if args.quick:
        args.rounds, args.size, args.pixels, args.counts, args.check = 1, 16, 8, [4, 16], 64
    records = measure(args)
    report(records)
    common.write(args.json, "reference", records)


if __name__ == "__main__":
    main()
