"""Prefiltered maps: cost of filtering, error and memory over slices and size, time of a frame.

    python benchmarks/bench_prefiltered.py --json prefiltered.json
    python benchmarks/bench_prefiltered.py --env room.hdr --rounds 9

Four tables:

1. the fast filter against the sum over texels: RMS error relative to the result, and CPU time of
   one slice of the given size (that of the sum is extrapolated from ``--points`` directions);
2. what the error against the ground truth is made of, relative to the truth's RMS: the round lobes
   themselves (48 slices, no maps), 16 slices for 48, maps for none;
3. CPU time of the preparation, memory, and the error in all, over slices and size;
4. CPU time of a frame over that of ``regular`` with 20 samples and over the split sum.
"""

import math
import time
from typing import Any

import common
import numpy as np

WIDTHS = (0.01, 0.03, 0.1, 0.3)  # standard deviations of the profiles of table 1
LOBES = (0.05, 0.15, 0.3)
MODES = {"flat": ("flat", 1), "single": ("single", 1), "3 lobes": ("multi", 3)}
SLICES, TRUE_SLICES = 16, 48
RATIOS = ("over_regular", "over_split_sum")


def spent(run: Any, *arguments: Any, **options: Any) -> tuple[Any, float]:
    """A function's result and the CPU time it took."""
    start = time.process_time()
    result = run(*arguments, **options)
    return result, time.process_time() - start


def rms(a: Any) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(a))))


def bell(width: float) -> tuple[Any, Any]:
    """A Gaussian profile, cut off at six standard deviations."""
    angles = np.linspace(0.0, min(6.0 * width, math.pi), 97)
    return angles, np.exp(-0.5 * (angles / width) ** 2)


def filters(cube: Any, size: int, count: int) -> list[dict[str, Any]]:
    """Table 1."""
    from glossy.cubemap import texel_directions
    from glossy.frames import normalise
    from glossy.prefiltered.exact import filter_directions
    from glossy.prefiltered.filter import MapFilter

    few = normalise(np.random.default_rng(3).normal(size=(count, 3)))
    whole = texel_directions(size)
    rows = []
    for width in WIDTHS:
        angles, profile = bell(width)
        filter_directions(cube, angles, profile, few[:1])
        _, once = spent(filter_directions, cube, angles, profile, few[:1])
        exact, seconds = spent(filter_directions, cube, angles, profile, few)
        for tolerance in (1e-2, 1e-3, 1e-4):
            fast = MapFilter(cube, tolerance)
            error = rms(fast.filtered(angles, profile, few) - exact) / rms(exact)
            _, own = spent(fast.filtered, angles, profile, whole)
            row = {"width": width, "tolerance": tolerance, "error": error, "seconds": own}
            each = max(seconds - once, 0.0) / (count - 1)
            rows.append({**row, "sum_seconds": once + each * 6 * size**2})
    return rows


def points(count: int) -> Any:
    """Random frames, views up to 84 degrees off the normal, even in the cosine."""
    import glossy
    from glossy.frames import normalise

    rng = np.random.default_rng(7)
    n, t = normalise(rng.normal(size=(2, count, 3)))
    t = normalise(t - np.sum(t * n, axis=1, keepdims=True) * n)
    phi, cos = rng.uniform(0.0, 2.0 * math.pi, (count, 1)), rng.uniform(0.1, 1.0, (count, 1))
    around = np.cos(phi) * t + np.sin(phi) * np.cross(n, t)
    return glossy.SurfacePoints(n, t, np.sqrt(1.0 - cos**2) * around + cos * n)


def without_maps(fast: Any, stacks: Any, where: Any) -> Any:
    """The stacks' estimate with the filtered radiance at the very axis, (K, 3)."""
    from glossy.frames import to_world

    wo = where.local_view
    total = np.zeros((len(wo), 3))
    for stack in stacks:
        axis = to_world(stack.axis(wo), where.tangent, where.normal)
        low, share = stack.slice_at(wo[:, 2])
        light = np.zeros((len(wo), 3))
        for e, profile in enumerate(stack.profiles):
            part = np.where(low == e, 1.0 - share, np.where(low + 1 == e, share, 0.0))
            pick = np.flatnonzero(part)
            if len(pick) and profile.any():
                found = fast.filtered(stack.angles, profile, axis[pick])
                light[pick] += part[pick, None] * found
        total += stack.factor(wo)[:, None] * stack.weight(wo[:, 2]) * light
    return total


def parts_of_error(
    cube: Any, widths: Any, sizes: Any, count: int, slices: int, coarse: int = SLICES
) -> list[dict[str, Any]]:
    """Table 2."""
    import glossy
    from glossy.prefiltered.approximate import approximate
    from glossy.prefiltered.filter import MapFilter

    where, fast, rows = points(count), MapFilter(cube, 1e-3), []
    for m in widths:
        material = glossy.Material(reflection=[glossy.Lobe(m)])
        truth = glossy.reference(where, material, cube).radiance
        chain = glossy.split_sum_chain(cube)
        split = rms(glossy.shade(where, material, chain, method="split-sum") - truth) / rms(truth)
        for name, (mode, lobes) in MODES.items():
            fine = approximate(material, mode, lobes, elevations=slices)
            stacks = approximate(material, mode, lobes, elevations=coarse)
            ideal, real = (without_maps(fast, s, where) for s in (fine, stacks))
            row = {"m": m, "mode": name, "split_sum": split}
            row["lobes"] = rms(ideal - truth) / rms(truth)
            row["slices"] = rms(real - ideal) / rms(truth)
            for size in sizes:
                maps = glossy.prefilter(cube, stacks, size)
                image = glossy.shade(where, material, maps, method="prefiltered")
                row[f"map_{size}"] = rms(image - real) / rms(truth)
            row["all"] = rms(image - truth) / rms(truth)
            rows.append(row)
    return rows


def costs(cube: Any, slices: Any, sizes: Any, count: int) -> list[dict[str, Any]]:
    """Table 3: one lobe of m = 0.15."""
    import glossy
    from glossy.prefiltered.approximate import approximate

    material, where = glossy.Material(reflection=[glossy.Lobe(0.15)]), points(count)
    truth = glossy.reference(where, material, cube).radiance
    rows = []
    for elevations in slices:
        stacks, fitting = spent(approximate, material, elevations=elevations)
        for size in sizes:
            maps, seconds = spent(glossy.prefilter, cube, stacks, size)
            image = glossy.shade(where, material, maps, method="prefiltered")
            row = {"slices": elevations, "size": size, "fit": fitting, "seconds": seconds}
            row |= {"bytes": maps.nbytes, "error": rms(image - truth) / rms(truth)}
            rows.append(row)
    return rows


def frames(cube: Any, height: int, rounds: int, coarse: int = SLICES) -> list[dict[str, Any]]:
    """Table 4."""
    import glossy
    from glossy.prefiltered.approximate import approximate
    from glossy.scene import Scene, Sphere, default_camera

    where = Scene(camera=default_camera(Sphere(), height, height)).points()
    material = glossy.Material(reflection=[glossy.Lobe(0.15)])
    pyramid, chain = glossy.build_pyramid(cube), glossy.split_sum_chain(cube)
    runs: dict[str, Any] = {
        "regular, n = 20": lambda: glossy.shade(where, material, pyramid, samples=20),
        "split-sum": lambda: glossy.shade(where, material, chain, method="split-sum"),
    }
    for name, (mode, lobes) in MODES.items():
        maps = glossy.prefilter(cube, approximate(material, mode, lobes, elevations=coarse), 64)
        runs[f"prefiltered, {name}"] = lambda maps=maps: glossy.shade(
            where, material, maps, method="prefiltered"
        )
    times = common.interleaved(runs, rounds)
    pixels = int(where.coverage.sum())
    return [
        {
            "method": name,
            "ns_per_pixel": 1e9 * min(own) / pixels,
            "over_regular": common.ratio(times, name, "regular, n = 20"),
            "over_split_sum": common.ratio(times, name, "split-sum"),
        }
        for name, own in times.items()
    ]


def main() -> None:
    """Print the tables."""
    parser = common.arguments(__doc__)
    parser.add_argument("--env", default="spots", help="a built-in name or a file")
    parser.add_argument("--size", type=int, default=128, help="of the cube map")
    parser.add_argument("--points", type=int, default=400)
    args = parser.parse_args()
    sizes, slices, widths = [32, 64, 128], [4, 8, 16, 32], list(LOBES)
    coarse, fine, height = SLICES, TRUE_SLICES, 512
    if args.quick:
        args.size, args.points, args.rounds = 8, 8, 1
        sizes, slices, widths = [4], [2], [0.3]
        coarse, fine, height = 2, 3, 16
    from glossy.scene import EnvironmentSource

    cube = EnvironmentSource(args.env, args.size).load()
    results: dict[str, Any] = {}
    print(f"{args.env}, {args.size}\n")
    rows = results["filters"] = filters(cube, sizes[len(sizes) // 2], args.points)
    head = ["width", "tolerance", "error", "CPU s", "sum over texels, CPU s"]
    body: list[list[object]] = [
        [
            f"{r['width']:g}",
            f"{r['tolerance']:g}",
            f"{r['error']:.1e}",
            f"{r['seconds']:.2f}",
            f"{r['sum_seconds']:.1f}",
        ]
        for r in rows
    ]
    print(common.table(head, body), "\n")
    rows = results["parts"] = parts_of_error(cube, widths, sizes, args.points, fine, coarse)
    keys = ["lobes", "slices", *(f"map_{n}" for n in sizes), "all", "split_sum"]
    head = ["m", "mode", *(k.replace("_", " ") for k in keys)]
    body = [[r["m"], r["mode"], *(f"{r[k]:.3f}" for k in keys)] for r in rows]
    print(f"relative RMS error\n\n{common.table(head, body)}\n")
    rows = results["costs"] = costs(cube, slices, sizes, args.points)
    head = ["slices", "size", "fit, CPU s", "filter, CPU s", "MB", "error"]
    body = [
        [
            r["slices"],
            r["size"],
            f"{r['fit']:.2f}",
            f"{r['seconds']:.2f}",
            f"{r['bytes'] / 1e6:.1f}",
            f"{r['error']:.3f}",
        ]
        for r in rows
    ]
    print(common.table(head, body), "\n")
    rows = results["frames"] = frames(cube, height, args.rounds, coarse)
    head = ["method", "ns a pixel", "over regular", "over split-sum"]
    body = [
        [
            r["method"],
            f"{r['ns_per_pixel']:.1f}",
            *(f"{r[k][1]:.2f} ({r[k][0]:.2f} to {r[k][2]:.2f})" for k in RATIOS),
        ]
        for r in rows
    ]
    print(common.table(head, body))
    common.write(args.json, "prefiltered", results)


if __name__ == "__main__":
    main()
