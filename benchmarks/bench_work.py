"""What shading costs as the work grows, what costs nothing, and how much memory it takes.

    python benchmarks/bench_work.py --json work.json --plot work.png

CPU time of one thread with everything compiled and prepared, the least of several turns: of
samples a pixel, pixels, size of the map, lobes. Elapsed time for the number of threads. Then what
should be free: a lobe with ks = 0, pixels behind the mask, samples below the horizon. Memory is the
largest the process ever had, of a process that makes a map of 4096 a face and a frame of
3840 x 2160.
"""

import argparse
import functools
import json
import math
import os
import pathlib
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import common
import numpy as np

Row = dict[str, Any]


def sphere_points(width: int, height: int, mask: Any = None) -> Any:
    """A sphere that covers the frame, seen from far away."""
    import glossy

    x = (np.arange(width) + 0.5) / width * 2 - 1
    y = 1 - (np.arange(height) + 0.5) / height * 2
    s, t = np.meshgrid(0.7 * x, 0.7 * y)
    n = np.stack([s, t, np.sqrt(1 - s * s - t * t)], axis=-1)
    return glossy.SurfacePoints(n, None, np.broadcast_to([0.0, 0.0, 1.0], n.shape), mask)


def least(
    frames: dict[Any, Callable[[], object]],
    rounds: int,
    clock: Callable[[], float] = time.process_time,
) -> dict[Any, float]:
    """Least seconds of each, taking turns."""
    return {k: min(v) for k, v in common.interleaved(frames, rounds, clock).items()}


class Work:
    """One scene to vary: 320 x 320 pixels, map of 256, one lobe of m = 0.15, 19 samples."""

    def __init__(self, rounds: int, pixels: int, size: int) -> None:
        import glossy

        self.glossy, self.rounds, self.pixels, self.size = glossy, rounds, pixels, size
        self.lobe = glossy.Lobe(mx=0.15)
        self.points = sphere_points(pixels, pixels)
        self.pyramid = self.map_of(size)
        self.count = len(glossy.pattern_for_budget(self.lobe, samples=20))

    def map_of(self, size: int) -> Any:
        """Pyramid of noise: the texels do not matter, where they are does."""
        rng = np.random.default_rng(0)
        faces = rng.random((6, size, size, 3), dtype=np.float32)
        return self.glossy.build_pyramid(self.glossy.CubeMap(faces))

    def frame(
        self, lobes: Any = None, points: Any = None, pyramid: Any = None, **options: Any
    ) -> Callable[[], object]:
        """What draws one frame."""
        material = self.glossy.Material(reflection=[self.lobe] if lobes is None else lobes)
        used = (points or self.points, material, pyramid or self.pyramid)
        return functools.partial(self.glossy.shade, *used, **{"samples": 20, **options})

    def samples(self, counts: list[int]) -> list[Row]:
        """Time against the samples a pixel."""
        patterns = [self.glossy.pattern_for_budget(self.lobe, samples=n) for n in counts]
        times = least({len(p): self.frame(pattern=p) for p in patterns}, self.rounds)
        return [{"x": n, "seconds": t, "work": self.pixels**2 * n} for n, t in times.items()]

    def frames(self, sizes: list[tuple[int, int]]) -> list[Row]:
        """Time against the pixels."""
        times = least({s: self.frame(points=sphere_points(*s)) for s in sizes}, self.rounds)
        return [
            {"x": w * h, "seconds": t, "work": w * h * self.count} for (w, h), t in times.items()
        ]

    def maps(self, sizes: list[int]) -> list[Row]:
        """Time against the size of the map, for a wide lobe and for a narrow one."""
        cases = {}
        narrow = self.glossy.Lobe(mx=0.02)
        for size in sizes:
            pyramid = self.map_of(size)
            cases[size, "seconds"] = self.frame(pyramid=pyramid)
            cases[size, "seconds_narrow"] = self.frame([narrow], pyramid=pyramid)
        times = least(cases, self.rounds)
        return [{"x": n, **{k: t for (m, k), t in times.items() if m == n}} for n in sizes]

    def lobes(self, most: int) -> list[Row]:
        """Time of 1 to ``most`` lobes together, and the sum of their times alone."""
        every = [self.glossy.Lobe(mx=m, ks=0.2) for m in (0.15, 0.08, 0.3, 0.2)[:most]]
        counts = range(1, most + 1)
        cases: dict[Any, Callable[[], object]] = {k: self.frame(every[:k]) for k in counts}
        cases |= {("alone", k): self.frame([every[k - 1]]) for k in counts}
        times = least(cases, self.rounds)
        alone = np.cumsum([times["alone", k] for k in counts])
        return [{"x": k, "seconds": times[k], "sum_alone": float(alone[k - 1])} for k in counts]

    def threads(self, most: int) -> list[Row]:
        """Elapsed and CPU time against the threads."""
        import numba

        frame = self.frame(samples=100)

        def run(count: int) -> None:
            numba.set_num_threads(count)
            frame()

        cases: dict[Any, Callable[[], object]] = {
            k: functools.partial(run, k) for k in range(1, most + 1)
        }
        elapsed, cpu = least(cases, self.rounds, time.perf_counter), least(cases, self.rounds)
        numba.set_num_threads(1)
        return [{"x": k, "seconds": elapsed[k], "cpu_seconds": cpu[k]} for k in cases]

    def free(self) -> list[Row]:
        """What should cost nothing: time over that of the frame without it, and if it were free."""
        everywhere = (self.pixels, self.pixels)
        cases = {
            "frame": self.frame(),
            "a second lobe with ks = 0": self.frame([self.lobe, self.glossy.Lobe(mx=0.2, ks=0.0)]),
        }
        ideal = {"a second lobe with ks = 0": ("frame", 1.0)}
        side = np.arange(self.pixels) / self.pixels
        for share in (0.5, 0.9):
            name = f"{share:.0%} of the pixels masked"
            points = sphere_points(*everywhere, np.broadcast_to(side >= share, everywhere))
            cases[name], ideal[name] = self.frame(points=points), ("frame", 1.0 - share)
        up = np.broadcast_to([0.0, 0.0, 1.0], (*everywhere, 3))
        for degrees in (0, 80, 87):
            theta = math.radians(degrees)
            view = np.array([math.sin(theta), 0.0, math.cos(theta)])
            points = self.glossy.SurfacePoints(
                up, np.broadcast_to([1.0, 0.0, 0.0], up.shape), np.broadcast_to(view, up.shape)
            )
            kept = self._kept(view)
            name = f"{1.0 - kept:.0%} of the samples below the horizon" if degrees else "plane"
            cases[name] = self.frame(points=points)
            if degrees:
                ideal[name] = ("plane", kept)
        times = least(cases, self.rounds)
        return [
            {"case": name, "over": times[name] / times[against], "nothing": share}
            for name, (against, share) in ideal.items()
        ]

    def _kept(self, view: Any) -> float:
        """Share of the pattern's samples that are above the horizon."""
        h = self.glossy.pattern_for_budget(self.lobe, samples=20).half_vectors
        cosine = h @ view
        return float(np.mean((cosine > 0.0) & (2.0 * cosine * h[:, 2] - view[2] > 0.0)))


def peak() -> float:
    """Most memory that this process had so far, in GB."""
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e9


def memory_worker(size: int, width: int, height: int) -> list[Row]:
    """Peaks of a process that makes the map, the pyramid, the points and the frame."""
    import glossy

    rows: list[Row] = [{"stage": "start", "gigabytes": peak()}]

    def note(stage: str, data: float) -> None:
        rows.append({"stage": stage, "gigabytes": peak(), "data": data / 1e9})

    faces = np.empty((6, size, size, 3), dtype=np.float32)
    faces[:] = np.random.default_rng(0).random((size, 1), dtype=np.float32)
    note(f"array of 6 x {size} x {size} x 3 float32", faces.nbytes)
    cube = glossy.CubeMap(faces)
    note("CubeMap of it", cube.faces.nbytes)
    pyramid = glossy.build_pyramid(cube)
    note("build_pyramid", pyramid._buffer.nbytes)
    points = sphere_points(width, height)
    note(f"SurfacePoints of {width} x {height}", 3 * points.normal.nbytes)
    material = glossy.Material(reflection=[glossy.Lobe(mx=0.15)])
    frame = glossy.shade(points, material, pyramid, samples=20)
    note("shade", frame.nbytes)
    return rows


def plot(path: pathlib.Path, results: dict[str, list[Row]]) -> None:
    """Five small diagrams, one a kind of work."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 5.6), dpi=90, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.subplots(2, 3).ravel()
    titles = {
        "samples": "samples a pixel", "frames": "pixels", "maps": "map size N",
        "lobes": "lobes", "threads": "threads",
    }  # fmt: skip
    for ax, (name, label) in zip(axes, titles.items(), strict=False):
        x = [r["x"] for r in results[name]]
        ax.plot(x, [r["seconds"] * 1e3 for r in results[name]], "o-", color="C0", label="measured")
        if name in ("samples", "frames"):
            slope = results[name][-1]["seconds"] / x[-1] * 1e3
            ax.plot(x, [slope * v for v in x], "--", color="0.6", label="proportional to the last")
            ax.set_xscale("log")
            ax.set_yscale("log")
        elif name == "maps":
            narrow = [r["seconds_narrow"] * 1e3 for r in results[name]]
            ax.lines[0].set_label("m = 0.15")
            ax.plot(x, narrow, "s-", color="C1", label="m = 0.02")
            ax.set_xscale("log", base=2)
            ax.set_ylim(bottom=0.0)
        elif name == "lobes":
            total = [r["sum_alone"] * 1e3 for r in results[name]]
            ax.plot(x, total, "x--", color="C1", label="sum of each alone")
            ax.set_ylim(bottom=0.0)
            ax.set_xticks(x)
        else:
            ax.lines[0].set_label("elapsed")
            cpu = [r["cpu_seconds"] * 1e3 for r in results[name]]
            ax.plot(x, cpu, "s--", color="C1", label="CPU")
            ax.set_ylim(bottom=0.0)
            ax.set_xticks(x)
        ax.set_xlabel(label)
        ax.set_ylabel("ms" if name == "threads" else "CPU ms, 1 thread")
        ax.legend(fontsize=8, frameon=False)
        ax.grid(alpha=0.25)
    ax = axes[5]
    rows = results["free"]
    at = np.arange(len(rows))
    ax.barh(at - 0.2, [r["over"] for r in rows], 0.4, color="C0", label="measured")
    ax.barh(at + 0.2, [r["nothing"] for r in rows], 0.4, color="0.7", label="if it were free")
    labels = [r["case"].replace(" with", "\nwith").replace(" of the ", " of the\n") for r in rows]
    ax.set_yticks(at, labels, fontsize=7)
    ax.invert_yaxis()
    ax.set_xlabel("time / time without it")
    ax.legend(fontsize=8, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    path.parent.mkdir(parents=True, exist_ok=True)
    canvas.print_figure(path)


def show(results: dict[str, list[Row]], memory: list[Row]) -> None:
    """Tables of everything."""
    for name, label in (("samples", "samples a pixel"), ("frames", "pixels")):
        body = [
            [r["x"], f"{r['seconds'] * 1e3:.2f}", f"{r['seconds'] / r['work'] * 1e9:.1f}"]
            for r in results[name]
        ]
        print(common.table([label, "CPU ms", "ns a sample"], body), end="\n\n")
    body = [
        [r["x"], f"{r['seconds'] * 1e3:.2f}", f"{r['seconds_narrow'] * 1e3:.2f}"]
        for r in results["maps"]
    ]
    print(common.table(["N", "CPU ms, m = 0.15", "CPU ms, m = 0.02"], body), end="\n\n")
    body = [
        [r["x"], f"{r['seconds'] * 1e3:.2f}", f"{r['sum_alone'] * 1e3:.2f}",
         f"{r['seconds'] / r['sum_alone']:.2f}"]
        for r in results["lobes"]
    ]  # fmt: skip
    print(common.table(["lobes", "CPU ms", "sum of each alone", "ratio"], body), end="\n\n")
    body = [
        [r["x"], f"{r['seconds'] * 1e3:.1f}", f"{r['cpu_seconds'] * 1e3:.1f}"]
        for r in results["threads"]
    ]
    print(common.table(["threads", "elapsed ms", "CPU ms"], body), end="\n\n")
    body = [[r["case"], f"{r['over']:.2f}", f"{r['nothing']:.2f}"] for r in results["free"]]
    print(common.table(["case", "time over without", "if it were free"], body), end="\n\n")
    body = [
        [r["stage"], f"{r['data']:.2f}" if "data" in r else "", f"{r['gigabytes']:.2f}"]
        for r in memory
    ]
    print(common.table(["after", "its own data, GB", "peak of the process, GB"], body))


def measure(args: argparse.Namespace) -> dict[str, list[Row]]:
    """Everything but memory, on one thread."""
    import numba

    numba.set_num_threads(1)
    most = min(2 if args.quick else 8, os.cpu_count() or 1)
    if args.quick:
        work = Work(1, 16, 16)
        frames, maps, counts = [(16, 16), (32, 16)], [16, 32], [7, 19]
    else:
        work = Work(args.rounds, 320, 256)
        frames = [(64, 64), (160, 160), (320, 320), (640, 640), (1280, 720), (1920, 1080)]
        maps, counts = [16, 64, 128, 256, 512, 1024, 2048], [1, 7, 19, 37, 61, 127, 271]
    return {
        "samples": work.samples(counts),
        "frames": work.frames(frames),
        "maps": work.maps(maps),
        "lobes": work.lobes(2 if args.quick else 4),
        "threads": work.threads(most),
        "free": work.free(),
    }


def main() -> None:
    """Measure, print, draw."""
    parser = common.arguments(__doc__)
    parser.add_argument("--plot", type=pathlib.Path, help="draw the diagrams into this PNG")
    parser.add_argument("--memory-worker", type=int, nargs=3, help=argparse.SUPPRESS)
    parser.set_defaults(rounds=25)
    args = parser.parse_args()
    if args.memory_worker:
        print(json.dumps(memory_worker(*args.memory_worker)))
        return
    # first, while this process is small: a child's peak begins with its parent's size
    sizes = ["64", "64", "32"] if args.quick else ["4096", "3840", "2160"]
    command = [sys.executable, __file__, "--memory-worker", *sizes]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
    memory: list[Row] = json.loads(done.stdout)
    results = measure(args)
    show(results, memory)
    if args.plot is not None:
        plot(args.plot, results)
    common.write(args.json, "work", {**results, "memory": memory})


if __name__ == "__main__":
    main()
