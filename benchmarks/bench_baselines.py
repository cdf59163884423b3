"""Error of split sum, bent reflection and taps along the axis, by the angle of the view.

    python benchmarks/bench_baselines.py --json baselines.json
    python benchmarks/bench_baselines.py --env room.hdr

Relative RMS error against the ground truth over random frames and azimuths, one angle between view
and normal at a time: at 0 degrees the split sum's assumption N = V = R holds, elsewhere it does
not. Below, the largest error under white light, where only the albedo of an anisotropic lobe's
stand-in is wrong. No method has a level bias.
"""

import math
from typing import Any

import common
import numpy as np

ANGLES = (0, 20, 40, 60, 70, 80)
LOBES = ((0.05, 0.05), (0.15, 0.15), (0.3, 0.3), (0.5, 0.5), (0.2, 0.075), (0.3, 0.06))
CONTENDERS: dict[str, dict[str, Any]] = {
    "split-sum": {"method": "split-sum"},
    "bent, filament": {"method": "bent"},
    "bent, hdrp": {"method": "bent", "bend": "hdrp"},
    "axis-taps, n = 8": {"method": "axis-taps", "samples": 8},
    "axis-taps, n = 16": {"method": "axis-taps", "samples": 16},
    "importance, n = 20": {"method": "importance", "samples": 20},
    "regular/jacobian, n = 20": {
        "method": "regular",
        "samples": 20,
        "threshold": 0.2,
        "footprint": "jacobian",
    },
}
SPLIT = ("split-sum", "bent", "axis-taps")


def points(angle: float, count: int) -> Any:
    """Random frames, seen from this many degrees off the normal at random azimuths."""
    import glossy
    from glossy.frames import normalise

    rng = np.random.default_rng(7)
    n, t = normalise(rng.normal(size=(2, count, 3)))
    t = normalise(t - np.sum(t * n, axis=1, keepdims=True) * n)
    phi, theta = rng.uniform(0.0, 2.0 * math.pi, (count, 1)), math.radians(angle)
    around = np.cos(phi) * t + np.sin(phi) * np.cross(n, t)
    return glossy.SurfacePoints(n, t, math.sin(theta) * around + math.cos(theta) * n)


def measure(cube: Any, white: Any, count: int) -> list[dict[str, Any]]:
    """A row for each lobe and method; isotropic lobes leave out what equals the split sum."""
    import glossy

    pyramids = {True: glossy.split_sum_chain(cube), False: glossy.build_pyramid(cube)}
    whites = {True: glossy.split_sum_chain(white), False: glossy.build_pyramid(white)}
    rows = []
    for widths in LOBES:
        lobe, same = glossy.Lobe(*widths), widths[0] == widths[1]
        places = {angle: points(angle, count) for angle in ANGLES}
        truths = {
            angle: glossy.reference(p, lobe, cube, tolerance=1e-3).radiance
            for angle, p in places.items()
        }
        for name, options in CONTENDERS.items():
            split = options["method"] in SPLIT
            if same and split and name != "split-sum":
                continue
            row: dict[str, Any] = {"lobe": widths, "method": name, "relative_rms": [], "white": []}
            for angle, p in places.items():
                e = glossy.shade(p, lobe, pyramids[split], **options) - truths[angle]
                level = np.sqrt(np.mean(np.square(truths[angle])))
                row["relative_rms"].append(float(np.sqrt(np.mean(e * e)) / level))
                albedo = glossy.Material(reflection=[lobe]).albedo(p.local_view)[0][..., None]
                furnace = glossy.shade(p, lobe, whites[split], **options) / albedo
                row["white"].append(float(np.abs(furnace - 1.0).max()))
            rows.append(row)
    return rows


def main() -> None:
    """Print both tables."""
    parser = common.arguments(__doc__)
    parser.add_argument("--env", default="spots", help="a built-in name or a file")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--points", type=int, default=400, help="for each angle")
    args = parser.parse_args()
    if args.quick:
        args.size, args.points = 8, 8
    from glossy.environment import environment
    from glossy.scene import EnvironmentSource

    cube = EnvironmentSource(args.env, args.size).load()
    rows = measure(cube, environment("white", 8), args.points)
    head = ["lobe", "method", *(f"{angle}°" for angle in ANGLES)]
    for title, key in (("relative RMS error", "relative_rms"), ("white light", "white")):
        body: list[list[object]] = []
        for row in rows:
            mx, my = row["lobe"]
            lobe = f"m = {mx:g}" if mx == my else f"({mx:g}, {my:g})"
            body.append([lobe, row["method"], *(f"{value:.3f}" for value in row[key])])
        print(f"{title}, {args.env}, {args.size}\n\n{common.table(head, body)}\n")
    common.write(args.json, "baselines", rows)


if __name__ == "__main__":
    main()
