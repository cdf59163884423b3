"""Test what plans promise, or calibrate what they cost.

    python benchmarks/calibrate_plan.py                        plans for the pictures' own points
    python benchmarks/calibrate_plan.py --unknown              plans that do not know them
    python benchmarks/calibrate_plan.py --data DIR --maps a,b  real maps (DIR/env) and a teapot, too
    python benchmarks/calibrate_plan.py --write constants.json measure the costs anew

Each case is a map, a lobe, a picture (``plan_scenes``) and an error asked for. "promised": those
whose bound is within the error asked for, "kept": those of them whose picture is, too, with the
95 % interval of the share; "of bound": the largest measured error over the bound of all cases, the
others included; "of asked": over the error asked for, of those promised.
"""

import argparse
import json
import math
import pathlib
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from common import table
from plan_scenes import LOBES, half_sphere, pictures, relative

import glossy
from glossy._threads import using
from glossy.planning import model
from glossy.planning.model import FILTERS, lobe_cost

GOALS = (0.05, 0.1, 0.2)
SIZE = 64
PIXELS = 200
TOLERANCE = 3e-3  # of the truth's bound; its error is some hundred times less
FIXED = (1, 2, 4, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64)


def time_of(run: Any, rounds: int = 15) -> float:
    """Least CPU time in seconds."""
    run()
    least = np.inf
    for _ in range(rounds):
        start = time.process_time()
        run()
        least = min(least, time.process_time() - start)
    return float(least)


def costs() -> dict[str, Any]:
    """Nanoseconds a pixel and a tap of each method, and a texel of each filter; one thread."""
    cube = glossy.environment("spots", size=256)
    pyramid = glossy.build_pyramid(cube, filter="round")
    points = half_sphere(np.random.default_rng(1), 1 << 15)
    found: dict[str, Any] = {}
    with using(1):
        for method in ("regular", "importance", "lattice"):
            own = {"footprint": "jacobian"} if method == "regular" else {}
            few, many = (
                time_of(
                    lambda n=n, m=method, o=own: glossy.shade(
                        points, glossy.Lobe(0.15), pyramid, method=m, samples=n, **o
                    )
                )
                for n in (14, 30)
            )
            tap = (many - few) / 16.0
            found[method] = [round(1e9 * t / (1 << 15), 2) for t in (few - 14.0 * tap, tap)]
        found["build"] = {
            f: round(1e9 * time_of(lambda f=f: glossy.build_pyramid(cube, filter=f)) / 393216, 2)
            for f in FILTERS
        }
    return found


def cases(
    data: pathlib.Path | None, some: str | None, unknown: bool, size: int
) -> Iterator[dict[str, Any]]:
    """Every case: what was asked and promised, what was measured, and of fixed numbers of taps."""
    maps = {name: glossy.environment(name, size) for name in ("spots", "studio", "sky")}
    if data is not None:
        files = sorted((data / "env").iterdir())
        starts = tuple((some or "").split(","))
        files = [f for f in files if f.name.startswith(starts)]
        maps |= {f.stem: glossy.read_environment(f, size=size) for f in files}
    kinds = pictures(data)
    for index, (name, cube) in enumerate(maps.items()):
        pyramid = glossy.build_pyramid(cube, filter="round")
        for number, widths in enumerate(LOBES):
            lobe, rng = glossy.Lobe(*widths), np.random.default_rng([index, number])
            plans = [glossy.plan(lobe, pyramid, max_error=g, filters=()) for g in GOALS] * unknown
            for kind, (draw, count) in kinds.items():
                for _ in range(count):
                    points = draw(rng, PIXELS)
                    truth = glossy.reference(points, lobe, cube, tolerance=TOLERANCE).radiance
                    fixed = [
                        relative(glossy.shade(points, lobe, pyramid, "lattice", samples=n), truth)
                        for n in FIXED
                    ]
                    for k, goal in enumerate(GOALS):
                        found = (
                            plans[k]
                            if unknown
                            else glossy.plan(
                                lobe, pyramid, max_error=goal, filters=(), points=points
                            )
                        )
                        (row,) = found.lobes
                        own = {"footprint": "jacobian"} if row.method == "regular" else {}
                        picture: npt.NDArray[Any] = 0.0 * truth
                        if row.samples:
                            picture = glossy.shade(
                                points, lobe, pyramid, row.method, samples=row.samples, **own
                            )
                        yield {
                            "map": name, "lobe": widths, "kind": kind, "asked": goal,
                            "bound": found.bound, "reached": found.reached, "cost": found.cost,
                            "measured": relative(picture, truth), "fixed": fixed,
                        }  # fmt: skip
        print(f"{name} done", file=sys.stderr)


def interval(kept: int, of: int) -> str:
    """Wilson's 95 % interval of a share."""
    if not of:
        return "-"
    z, p = 1.96, kept / of
    middle = p + z * z / (2 * of)
    side = z * math.sqrt(p * (1.0 - p) / of + z * z / (4 * of * of))
    low, high = ((middle + sign * side) / (1.0 + z * z / of) for sign in (-1.0, 1.0))
    return f"{100 * low:.1f} to {100 * high:.1f} %"


def line(title: list[Any], rows: list[dict[str, Any]]) -> list[Any]:
    """One row of a table."""
    promised = [r for r in rows if r["reached"]]
    kept = sum(r["measured"] <= r["asked"] for r in promised)
    of_bound = max(r["measured"] / r["bound"] if r["measured"] else 0.0 for r in rows)
    of_asked = max((r["measured"] / r["asked"] for r in promised), default=math.nan)
    return [
        *title, f"{len(promised)} of {len(rows)}", f"{kept} ({interval(kept, len(promised))})",
        f"{of_bound:.2f}", f"{of_asked:.2f}",
    ]  # fmt: skip


def costs_of(rows: list[dict[str, Any]]) -> list[Any]:
    """Cost of the promised, and of the fewest taps for all of them that keep as many."""
    promised = [r for r in rows if r["reached"]]
    if not promised:
        return ["-", "-"]
    price = np.array([r["cost"] for r in promised])
    kept = np.mean([r["measured"] <= r["asked"] for r in promised])
    share = [np.mean([r["fixed"][k] <= r["asked"] for r in promised]) for k in range(len(FIXED))]
    fit = [n for n, s in zip(FIXED, share, strict=True) if s >= kept]
    best = FIXED[int(np.argmax(share))]
    fixed = (
        f"n = {fit[0]}: {lobe_cost('lattice', fit[0]):.2f}"
        if fit
        else (f"none; n = {best} keeps {max(share):.2f}")
    )
    return [f"{price.mean():.2f} ({np.median(price):.2f})", fixed]


def report(rows: list[dict[str, Any]], real: bool) -> str:
    """Tables by kind of picture, and by error asked for."""
    head = ["promised", "kept", "of bound", "of asked"]
    built_in = ("spots", "studio", "sky")
    by_kind = [
        line([kind], [r for r in rows if r["kind"] == kind])
        for kind in dict.fromkeys(r["kind"] for r in rows)
    ]
    by_goal = []
    for where in ("built-in", "real")[: 1 + real]:
        own = [r for r in rows if (r["map"] in built_in) == (where == "built-in")]
        for goal in GOALS:
            some = [r for r in own if r["asked"] == goal]
            by_goal.append([*line([where, f"{goal:g}"], some), *costs_of(some)])
    return "\n\n".join([
        table(["picture", *head], [*by_kind, line(["all"], rows)]),
        table(["maps", "asked", *head, "cost, mean (median)", "fixed lattice"], by_goal),
    ])  # fmt: skip


def main() -> None:
    """Parse the arguments, measure costs or test."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=pathlib.Path, help="folder with env/ and mesh/teapot.ply")
    parser.add_argument("--maps", metavar="A,B", help="how the real maps' names begin (all)")
    parser.add_argument("--unknown", action="store_true", help="plan without the points")
    parser.add_argument("--size", type=int, default=SIZE, help="of the cube maps")
    parser.add_argument("--json", type=pathlib.Path, help="write every case to this file")
    parser.add_argument("--write", type=pathlib.Path, help="measure the costs, and write this file")
    args = parser.parse_args()
    if args.write:
        record = {"cost": costs()}
        partial = args.write.with_name(args.write.name + ".part")
        partial.write_text(json.dumps(record, indent=1) + "\n")
        partial.replace(args.write)
        model.constants.cache_clear()
        print(json.dumps(record))
        return
    rows = list(cases(args.data, args.maps, args.unknown, args.size))
    if args.json:
        args.json.write_text(json.dumps(rows))
    print(report(rows, args.data is not None))


if __name__ == "__main__":
    main()
