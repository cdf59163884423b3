"""What shading costs as the work grows, what costs nothing, and how much memory it takes.

    python benchmarks/bench_work.py --json work.json --plot work.png

CPU time of one thread with everything compiled and prepared, the least of several rounds: of
samples a pixel, pixels, size of the map, lobes. Elapsed time for the number of threads. Then what
should be free: a lobe with ks = 0, pixels behind the mask, samples below the horizon. Memory is the
largest the process ever had, of a process that makes a map of 4096 a face and a frame of
3840 x 2160.
"""

import argparse
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
    run: Callable[[], object], rounds: int, clock: Callable[[], float] = time.process_time
) -> float:
    """Least seconds of ``rounds``, after a run that does not count."""
    run()
    best = math.inf
    for _ in range(rounds):
        start = clock()
        run()
        best = min(best, clock() - start)
    return best


class Work:
    """One scene to vary: 320 x 320 pixels, map of 256, one lobe of m = 0.15, 19 samples."""

    def __init__(self, rounds: int, pixels: int, size: int) -> None:
        import glossy

        self.glossy, self.rounds, self.pixels, self.size = glossy, rounds, pixels, size
        self.lobe = glossy.Lobe(mx=0.15)
        self.points = sphere_points(pixels, pixels)
        self.pyramid = self.map_of(size)

    def map_of(self, size: int) -> Any:
        """Pyramid of noise: the texels do not matter, where they are does."""
        rng = np.random.default_rng(0)
        faces = rng.random((6, size, size, 3), dtype=np.float32)
        return self.glossy.build_pyramid(self.glossy.CubeMap(faces))

    def seconds(
        self, lobes: Any = None, points: Any = None, pyramid: Any = None, **options: Any
    ) -> float:
        """CPU time of one frame."""
        material = self.glossy.Material(reflection=[self.lobe] if lobes is None else lobes)
        used = self.points if points is None else points
        options = {"samples": 20, **options}
        return least(
            lambda: self.glossy.shade(used, material, pyramid or self.pyramid, **options),
            self.rounds,
        )

    def samples(self, counts: list[int]) -> list[Row]:
        """Time against the samples a pixel."""
        rows = []
        for count in counts:
            pattern = self.glossy.pattern_for_budget(self.lobe, samples=count)
            seconds = self.seconds(pattern=pattern)
            each = seconds / (self.pixels**2 * len(pattern))
            rows.append({"x": len(pattern), "seconds": seconds, "ns_per_sample": each * 1e9})
        return rows

    def frames(self, sizes: list[tuple[int, int]]) -> list[Row]:
        """Time against the pixels."""
        n = len(self.glossy.pattern_for_budget(self.lobe, samples=20))
        rows = []
        for width, height in sizes:
            seconds = self.seconds(points=sphere_points(width, height))
            each = seconds / (width * height * n)
            rows.append({"x": width * height, "seconds": seconds, "ns_per_sample": each * 1e9})
        return rows

    def maps(self, sizes: list[int]) -> list[Row]:
        """Time against the size of the map, for a wide lobe and for a narrow one."""
        rows: list[Row] = []
        narrow = self.glossy.Lobe(mx=0.02)
        for size in sizes:
            pyramid = self.map_of(size)
            rows.append(
                {
                    "x": size,
                    "seconds": self.seconds(pyramid=pyramid),
                    "seconds_narrow": self.seconds([narrow], pyramid=pyramid),
                }
            )
        return rows

    def lobes(self, most: int) -> list[Row]:
        """Time of 1 to ``most`` lobes together, and the sum of their times alone."""
        every = [self.glossy.Lobe(mx=m, ks=0.2) for m in (0.15, 0.08, 0.3, 0.2)[:most]]
        alone = [self.seconds([lobe]) for lobe in every]
        return [
            {"x": k, "seconds": self.seconds(every[:k]), "sum_alone": sum(alone[:k])}
            for k in range(1, most + 1)
        ]

    def threads(self, most: int) -> list[Row]:
        """Elapsed and CPU time against the threads."""
        import numba

        material = self.glossy.Material(reflection=[self.lobe])
        rows = []
        for count in range(1, most + 1):
            numba.set_num_threads(count)

            def run() -> None:
                self.glossy.shade(self.points, material, self.pyramid, samples=100)

            elapsed = least(run, self.rounds, time.perf_counter)
            rows.append({"x": count, "seconds": elapsed, "cpu_seconds": least(run, self.rounds)})
        numba.set_num_threads(1)
        return rows

    def free(self) -> list[Row]:
        """What should cost nothing, over the time of the frame without it."""
        plain = self.seconds()
        rows: list[Row] = [
            {
                "case": "a second lobe with ks = 0",
                "over": self.seconds([self.lobe, self.glossy.Lobe(mx=0.2, ks=0.0)]) / plain,
                "nothing": 1.0,
            }
        ]
        side = np.arange(self.pixels) / self.pixels
        for share in (0.5, 0.9):
            mask = np.broadcast_to(side >= share, (self.pixels, self.pixels))
            points = sphere_points(self.pixels, self.pixels, mask)
            rows.append(
                {
                    "case": f"{share:.0%} of the pixels masked",
                    "over": self.seconds(points=points) / plain,
                    "nothing": 1.0 - share,
                }
            )
        steep = math.radians(87.0)
        up = np.broadcast_to([0.0, 0.0, 1.0], (self.pixels, self.pixels, 3))
        tangent = np.broadcast_to([1.0, 0.0, 0.0], up.shape)
        for name, theta in (("normal view", 0.0), ("view at 87 degrees", steep)):
            view = np.broadcast_to([math.sin(theta), 0.0, math.cos(theta)], up.shape)
            points = self.glossy.SurfacePoints(up, tangent, view)
            kept = self._kept(view[0, 0])
            seconds = self.seconds(points=points)
            rows.append({"case": name, "over": seconds / rows[-1]["one"] if theta else 1.0,
                         "nothing": kept, "one": seconds})  # fmt: skip
        rows[-1]["case"] += f", {1.0 - rows[-1]['nothing']:.0%} of the samples below the horizon"
        return rows

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

    rows = [{"stage": "import", "gigabytes": peak()}]

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
    ax.barh(at + 0.2, [r["over"] for r in rows], 0.4, color="C0", label="measured")
    ax.barh(at - 0.2, [r["nothing"] for r in rows], 0.4, color="0.7", label="if it were free")
    ax.set_yticks(
        at,
        [r["case"].replace(", ", ",\n").replace(" of the ", "\nof the ") for r in rows],
        fontsize=7,
    )
    ax.invert_yaxis()
    ax.set_xlabel("time over that of the frame without it")
    ax.legend(fontsize=8, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    canvas.print_figure(path)


def show(results: dict[str, list[Row]], memory: list[Row]) -> None:
    """Tables of everything."""
    for name, label in (("samples", "samples a pixel"), ("frames", "pixels")):
        body = [
            [r["x"], f"{r['seconds'] * 1e3:.2f}", f"{r['ns_per_sample']:.1f}"]
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
