"""Partial environment maps: the figures of their paper, and the errors of the method apart.

    python benchmarks/reproduce_pem.py [--quick] [--plot PICTURE.png]

1. Filters (their Figs. 4 and 5): error of a level against the cosine lobe of the same volume.
2. Errors of a picture's pixels against the ground truth: of the model (a cosine lobe for the
   Kurt lobe) and of the filter (a level for the cosine lobe), for each footprint.
3. Regions (their Figs. 7 and 8): importance, memory, CPU time with a visibility for each region.
"""

import argparse
import statistics
from typing import Any

import common
import numpy as np
import numpy.typing as npt

import glossy
from glossy.frames import SurfacePoints, normalise, reflect, sphere_tangent
from glossy.pem.cosine import cosine_radiance
from glossy.pem.glossiness import Impulses, lobe_volume
from glossy.pem.lobe_error import lobe_error
from glossy.pem.memory import memory
from glossy.pem.shade import FOOTPRINTS, cosine_exponent

FloatArray = npt.NDArray[np.floating]

FILTERS = ("box", "pem5:gauss", "pem5:cos", "pem5:box", "pem5:sqrtcos")
COLOURS = ("tab:purple", "black", "tab:green", "tab:red", "tab:blue")  # theirs
EXPONENTS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)
MiB = 2.0**20


def filters(size: int, exponents: tuple[float, ...]) -> list[list[object]]:
    """Error of each filter in % of the lobe's volume: next to a face's centre / mean of places."""
    rows: list[list[object]] = []
    centre = [[4, size // 2, size // 2]]
    for name in FILTERS:
        near = lobe_error(name, size, exponents, centre)[:, 0]
        mean = lobe_error(name, size, exponents).mean(axis=1)
        cells = [
            "–" if np.isnan(a) else f"{100 * a:.0f} / {100 * b:.0f}"
            for a, b in zip(near, mean, strict=True)
        ]
        rows.append([name, *cells])
    return rows


def cross_section(name: str, size: int, angle: FloatArray) -> FloatArray:
    """What directions in a plane through a white texel see of it, peak 1, at the level of s = 1."""
    white = Impulses(name, size, np.array([[4, size // 2, size // 2]]))
    steps, volumes = white.table()
    level = np.interp(lobe_volume(1.0), np.maximum.accumulate(volumes[:, 0]), steps)
    axis = white.axes[0]
    side = normalise(np.cross(axis, [0.0, 1.0, 0.0]))
    h = white.lookup(0, np.outer(np.cos(angle), axis) + np.outer(np.sin(angle), side), level)
    return np.asarray(h / h.max())


def plot(path: str, size: int, count: int) -> None:
    """Figs. 4 and 5: lobes at s = 1, error over s; a white texel next to the centre of a face."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, len(FILTERS), height_ratios=(1.0, 2.2))
    angle = np.linspace(-np.pi, np.pi, 361)
    for column, name in enumerate(FILTERS):
        axes = figure.add_subplot(grid[0, column])
        for radius, colour in (
            (np.maximum(np.cos(angle), 0.0), "tab:blue"),
            (cross_section(name, size, angle), "tab:red"),
        ):
            axes.plot(radius * np.sin(angle), radius * np.cos(angle), color=colour, lw=1.2)
        axes.set(title=name, aspect="equal", xlim=(-0.75, 0.75), ylim=(-0.45, 1.05))
        axes.set_axis_off()
    axes = figure.add_subplot(grid[1, :])
    s = np.geomspace(1.0, 400.0, count)
    for name, colour in zip(FILTERS, COLOURS, strict=True):
        error = lobe_error(name, size, s, [[4, size // 2, size // 2]])[:, 0]
        style = ":" if name == "box" else "-"
        axes.plot(s, 100.0 * error, style, color=colour, label=name)
    axes.set(xscale="log", xlabel="exponent s", ylabel="error [% of the lobe's volume]")
    axes.set(xlim=(1.0, 400.0), ylim=(0.0, 60.0))
    axes.grid(alpha=0.3)
    axes.legend(ncols=2)
    figure.savefig(path, dpi=90)


def points(count: int, angle: float) -> SurfacePoints:
    """Random frames, all seen at one angle from the normal."""
    rng = np.random.default_rng(1)
    n = normalise(rng.normal(size=(count, 3)))
    t = sphere_tangent(n)
    phi = rng.uniform(0.0, 2.0 * np.pi, (count, 1))
    across = np.cos(phi) * t + np.sin(phi) * np.cross(n, t)
    return SurfacePoints(normal=n, tangent=t, view=np.cos(angle) * n + np.sin(angle) * across)


def errors(
    environment: str, size: int, count: int, widths: tuple[float, ...], angles: tuple[int, ...]
) -> list[list[object]]:
    """Relative RMS errors: model, then filter and total of each footprint."""
    rows: list[list[object]] = []
    cube = glossy.environment(environment, size=size)
    maps = glossy.partial_maps(cube)
    for m in widths:
        s, lobe = cosine_exponent(m), glossy.Lobe(mx=m, my=m)
        material = glossy.Material(reflection=[lobe])
        for angle in angles:
            p = points(count, np.radians(max(angle, 0.01)))
            truth = glossy.reference(p, lobe, cube, tolerance=2e-3).radiance
            scale = np.sqrt(np.mean(truth**2))
            r = reflect(p.view, p.normal)
            albedo = material.albedo([0.0, np.sin(np.radians(angle)), np.cos(np.radians(angle))])
            refine = 2 if m * size < 16.0 else 1
            model = albedo[0] * cosine_radiance(cube, r, s, refine) / lobe_volume(s)

            def rms(a: FloatArray, b: FloatArray, scale: float = scale) -> float:
                return float(np.sqrt(np.mean((a - b) ** 2)) / scale)

            cells = []
            for footprint in FOOTPRINTS:
                image = glossy.shade(p, lobe, maps, method="pem", footprint=footprint)
                cells.append(f"{rms(image, model):.3f} / {rms(image, truth):.3f}")
            rows.append(
                [environment, m, f"{s:.1f}", f"{angle}°", f"{rms(model, truth):.3f}", *cells]
            )
    return rows


def regions(size: int, counts: tuple[int, ...], pixels: int) -> list[list[object]]:
    """Spread of importance, memory and time against the number of regions."""
    cube = glossy.environment("spots", size=size)
    p = points(pixels, 0.7)
    lobe = glossy.Lobe(mx=0.15, my=0.15)
    rng = np.random.default_rng(2)
    maps = {n: glossy.partial_maps(cube, n, storage="rgba16f") for n in counts}
    seen = {n: rng.random((pixels, n), dtype=np.float32) for n in counts}
    contenders: dict[str, Any] = {
        "none": lambda: glossy.shade(p, lobe, maps[counts[0]], method="pem")
    }
    for n in counts:
        contenders[str(n)] = lambda n=n: glossy.shade(
            p, lobe, maps[n], method="pem", visibility=seen[n]
        )
    times = common.interleaved(contenders, rounds=5)
    rows: list[list[object]] = []
    for n in counts:
        held, found = memory(maps[n]), maps[n].regions
        share = found.importance / np.repeat(
            np.bincount(found.face, found.importance) * 6.0 / n, n // 6
        )
        low, middle, high = common.ratio(times, str(n), "none")
        rows.append([
            n,
            f"{share.min():.2f} … {share.max():.2f}",
            f"{found.importance.max() / found.importance.min():.0f}",
            f"{held.whole / MiB:.1f}",
            f"{held.held / MiB:.2f}",
            f"{held.shadows / MiB:.1f}",
            f"{middle:.1f} ({low:.1f} to {high:.1f})",
            f"{1e9 * statistics.median(times[str(n)]) / pixels:.0f}",
        ])  # fmt: skip
    return rows


def main() -> None:
    """Print the tables; draw the picture if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few seconds, for tests")
    parser.add_argument("--plot", metavar="PNG", help="draw the errors over the exponent")
    args = parser.parse_args()
    quick = args.quick
    size = 32 if quick else 128
    print(f"\nError in % of the lobe's volume, N = {size}: next to the face's centre / mean\n")
    exponents = EXPONENTS[::4] if quick else EXPONENTS
    header = ["filter", *(f"s = {s:g}" for s in exponents)]
    print(common.table(header, filters(size, exponents)))
    if args.plot:
        plot(args.plot, size, 11 if quick else 161)
    widths, angles = ((0.3,), (0,)) if quick else ((0.05, 0.15, 0.3, 0.5), (0, 20, 40, 60, 80))
    print("\nRelative RMS error: model, then filter / total of each footprint\n")
    header = ["map", "m", "s", "view", "model", *FOOTPRINTS]
    maps = ("spots",) if quick else ("spots", "studio")
    rows = [
        row for name in maps for row in errors(name, size, 30 if quick else 400, widths, angles)
    ]
    print(common.table(header, rows))
    counts = (6, 12) if quick else (6, 12, 24, 48, 96, 192, 384)
    n = 32 if quick else 256
    print(f"\nRegions, N = {n}, rgba16f, MiB; time with visibility over one lookup in the whole\n")
    header = [
        "regions", "importance, of the face's mean", "largest over least", "whole", "cropped",
        "shadow maps", "time", "ns a pixel",
    ]  # fmt: skip
    print(common.table(header, regions(n, counts, 500 if quick else 100_000)))


if __name__ == "__main__":
    main()
