"""Error of the thesis's patterns and estimators against the truth: which one, and when a line.

    python benchmarks/thesis_errors.py

Relative RMS over 500 random frames and views (wo.n from 0.2 to 1) of small bright lights, N = 128,
truth to 0.2 %. Every figure is given without and with its best level bias.
"""

import functools
import math
from typing import Any

import numpy as np

import glossy
from glossy.frames import normalise, spherical, to_world
from glossy.study.measure import best_bias

COUNT = 500
LOBES = ((0.05, 0.05), (0.15, 0.15), (0.3, 0.3), (0.2, 0.075))
RATIOS = (0.7, 0.5, 0.35, 0.25, 0.1)


def random_points(seed: int = 1) -> glossy.SurfacePoints:
    """Frames and views, evenly in wo.n."""
    rng = np.random.default_rng(seed)
    n = normalise(rng.normal(size=(COUNT, 3)))
    t = normalise(np.cross(n, rng.normal(size=(COUNT, 3))))
    local = spherical(np.arccos(rng.uniform(0.2, 1.0, COUNT)), rng.uniform(0, 2 * math.pi, COUNT))
    return glossy.SurfacePoints(n, t, to_world(local, t, n))


def main() -> None:
    """Print both tables."""
    cube = glossy.environment("spots", size=128)
    pyramid, points = glossy.build_pyramid(cube), random_points()

    def figures(lobe: glossy.Lobe, truth: glossy.Truth, method: str, **options: Any) -> str:
        level = math.sqrt(np.mean(np.square(truth.radiance)))

        def error(bias: float) -> float:
            value = glossy.shade(points, lobe, pyramid, method, bias=bias, **options)
            return math.sqrt(np.mean(np.square(value - truth.radiance))) / level

        tried = best_bias(error)[1]
        return f"{error(0.0):.3f} / {min(e for _, e in tried):.3f}"

    contenders = {
        "regular/thesis": functools.partial(figures, method="regular", footprint="thesis"),
        "importance": functools.partial(figures, method="importance"),
        **{
            e: functools.partial(figures, method="thesis", estimator=e)
            for e in ("4.23", "4.24", "4.25")
        },
    }
    print("| lobe | n | " + " | ".join(contenders) + " |")
    print("|---" * (len(contenders) + 2) + "|")
    for widths in LOBES:
        lobe = glossy.Lobe(*widths)
        truth = glossy.reference(points, lobe, cube, tolerance=2e-3)
        for samples in (7, 15, 30):
            own = len(glossy.pattern_for_budget(lobe, samples, 0.2))
            cells = []
            for name, run in contenders.items():
                more = {"threshold": 0.2} if name.startswith("regular") else {}
                cells.append(run(lobe, truth, samples=own, **more))
            print(
                f"| {widths[0]:g} {widths[1]:g} | {own} | " + " | ".join(cells) + " |", flush=True
            )
    kinds = ("ring", "line", "blend")
    print("\n| widths | n | " + " | ".join(kinds) + " |\n" + "|---" * 5 + "|")
    for ratio in RATIOS:
        lobe = glossy.Lobe(0.15, 0.15 * ratio)
        truth = glossy.reference(points, lobe, cube, tolerance=2e-3)
        for samples in (7, 15):
            cells = [figures(lobe, truth, "thesis", kind=k, samples=samples) for k in kinds]
            print(f"| .15, ratio {ratio:g} | {samples} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
