"""``shade`` against a software GPU and a scalar loop: 1280 x 720 full coverage, cube map 1024.

    python benchmarks/bench_shade.py --json shade.json

CPU time, contenders in turn, for one and for two threads (each in a process of its own, because
Mesa reads its thread count at start). Every picture is compared with double precision.
"""

import argparse
import functools
import json
import math
import os
import statistics
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import common
import numpy as np

WIDTH, HEIGHT = 1280, 720
LOBES = {
    "m=.15": {"mx": 0.15},
    "m=.02": {"mx": 0.02},
    "m=.15 F a": {"mx": 0.15, "r0": 0.05, "alpha": 0.5},
}


def gbuffer() -> tuple[Any, Any, Any]:
    """A sphere that covers the whole frame, seen from far away."""
    x, y = np.meshgrid(
        (np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1, 1 - (np.arange(HEIGHT) + 0.5) / HEIGHT * 2
    )
    s, t = 0.8 * x, 0.55 * y
    n = np.stack([s, t, np.sqrt(1 - s * s - t * t)], axis=-1)
    tangent = np.stack([n[..., 2], np.zeros_like(s), -n[..., 0]], axis=-1)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    view = np.broadcast_to([0.0, 0.0, 1.0], n.shape)
    return n.astype(np.float32), tangent.astype(np.float32), view.astype(np.float32)


def _ours(keep: dict[str, Any], points: Any, material: Any, pyramid: Any, samples: int) -> None:
    import glossy

    keep["glossy"] = glossy.shade(points, material, pyramid, samples=samples)


def measure(threads: int, rounds: int, size: int, counts: list[int]) -> list[dict[str, Any]]:
    """All cases with this many threads; a row each."""
    import numba
    import scalar_loop

    import glossy
    from glossy import shading

    numba.set_num_threads(threads)
    scalar: Any = scalar_loop.shade
    n, t, v = gbuffer()
    points = glossy.SurfacePoints(n, t, v)
    cube = glossy.environment("spots", size=size)
    rows = []
    for filter in ("gauss6", "box"):
        pyramid = glossy.build_pyramid(cube, filter=filter)
        for name, parameters in LOBES.items():
            for count in counts:
                if filter == "box" and (count != 20 or name != "m=.15"):
                    continue
                lobe = glossy.Lobe(**parameters)
                material = glossy.Material(reflection=[lobe])
                table = shading.regular_table(material, pyramid, samples=count)
                taps = np.ascontiguousarray(table.taps, dtype=np.float32)
                border = np.ascontiguousarray(table.borders[0], dtype=np.float32)
                flat = [np.ascontiguousarray(a.reshape(-1, 3)) for a in (n, t, v)]
                padded, loop_out = tuple(pyramid._padded), np.empty((n.size // 3, 3), np.float32)
                r0, alpha = float(parameters.get("r0", 1.0)), float(parameters.get("alpha", 0.0))
                products: dict[str, Any] = {}

                ours = functools.partial(_ours, products, points, material, pyramid, count)
                sides = np.float32(r0), np.float32(alpha)
                loop = functools.partial(scalar, *flat, taps, border, *sides, padded, loop_out)
                contenders: dict[str, Callable[[], object]] = {"glossy": ours, "scalar loop": loop}
                shader = None
                try:
                    import llvmpipe

                    sines = (float(border[0]), float(border[1]))
                    shader = llvmpipe.Shader(pyramid.levels, (n, t, v), taps, sines, r0, alpha)
                    contenders["llvmpipe"] = shader.run
                except (ImportError, OSError) as error:
                    print(f"llvmpipe absent: {error}", file=sys.stderr)
                times = common.interleaved(contenders, rounds)
                double = glossy.shade(points, material, pyramid, samples=count, precision="double")
                pictures = {"glossy": products["glossy"], "scalar loop": loop_out.reshape(n.shape)}
                if shader is not None:
                    pictures["llvmpipe"] = shader.read()
                    shader.context.release()
                scale = math.sqrt(np.mean(double**2))
                row: dict[str, Any] = {
                    "threads": threads, "filter": filter, "lobe": name, "samples": len(taps),
                    "renderer": shader.renderer if shader else "absent",
                }  # fmt: skip
                for key, picture in pictures.items():
                    work = n.size / 3 * len(taps)
                    row[key] = {
                        "ns_per_sample": statistics.median(times[key]) / work * 1e9,
                        "relative_rms": float(np.sqrt(np.mean((picture - double) ** 2)) / scale),
                    }
                    if key != "glossy":
                        low, middle, high = common.ratio(times, key, "glossy")
                        row[key]["speedup"] = {"min": low, "median": middle, "max": high}
                rows.append(row)
                print(format_row(row), file=sys.stderr)
    return rows


def format_row(row: dict[str, Any]) -> str:
    """One line for the reader."""
    parts = [f"{row['threads']}T {row['filter']:6} {row['lobe']:10} n={row['samples']:3}"]
    for key in ("glossy", "llvmpipe", "scalar loop"):
        if key in row:
            e = row[key]
            text = f"{key} {e['ns_per_sample']:.1f} ns rms {e['relative_rms']:.1e}"
            if "speedup" in e:
                text += f" ({e['speedup']['median']:.2f}x)"
            parts.append(text)
        else:
            parts.append(f"{key} absent")
    return "  ".join(parts)


def main() -> None:
    """Run the cases for one and for two threads and print the table."""
    parser = common.arguments(__doc__)
    parser.add_argument("--size", type=int, default=1024)
    parser.add_argument("--samples", type=int, nargs="+", default=[7, 20, 30])
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--worker", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.quick:
        args.size, args.samples, args.threads, args.rounds = 32, [7], [1], 1
    if args.worker:
        print(json.dumps(measure(args.worker, args.rounds, args.size, args.samples)))
        return
    rows = []
    for threads in args.threads:
        environment = {**os.environ, "LP_NUM_THREADS": str(threads)}
        command = [
            sys.executable, __file__, "--worker", str(threads), "--rounds", str(args.rounds),
            "--size", str(args.size), "--samples", *map(str, args.samples),
        ]  # fmt: skip
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
        rows += json.loads(done.stdout)
    header = ["threads", "filter", "lobe", "n", "ns/sample", "rms", "x llvmpipe", "x scalar loop"]
    body = []
    for row in rows:
        peers = [
            f"{row[k]['speedup']['median']:.2f}" if k in row else "absent"
            for k in ("llvmpipe", "scalar loop")
        ]
        own = row["glossy"]
        body.append(
            [row["threads"], row["filter"], row["lobe"], row["samples"],
             f"{own['ns_per_sample']:.1f}", f"{own['relative_rms']:.1e}", *peers]
        )  # fmt: skip
    print(common.table(header, body))
    common.write(args.json, "shade", rows)


if __name__ == "__main__":
    main()
