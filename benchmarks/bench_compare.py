"""``glossy compare`` of two large EXR files against only reading them.

    python benchmarks/bench_compare.py --json compare.json

Two 4096 x 2048 RGB pictures of half floats, ZIP compressed, one of them slightly off. Everything
runs in one process, so that neither side pays for starting Python; both files are read at the same
time in every case. CPU time of all threads, and elapsed time.
"""

import contextlib
import importlib
import io
import pathlib
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import common
import numpy as np

from glossy import cli
from glossy.image import read_planes, write_exr


def write_pictures(folder: pathlib.Path, height: int) -> list[str]:
    """A picture with the noise of a rendering, and the same with other noise."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[0:height, 0 : 2 * height] / height
    smooth = 0.5 + 0.4 * np.sin(9 * x)[..., None] * np.cos([4, 5, 6] * y[..., None])
    paths = []
    for name in ("a.exr", "b.exr"):
        noise = rng.standard_normal(smooth.shape, dtype=np.float32) * np.float32(0.01)
        path = str(folder / name)
        picture = smooth + noise
        write_exr(path, {c: picture[..., i] for i, c in enumerate("RGB")}, half=True)
        paths.append(path)
    return paths


def readers(paths: list[str]) -> dict[str, Callable[[], object]]:
    """Ways to have both files in memory."""

    def both(read: Callable[[str], object]) -> Callable[[], object]:
        def run() -> object:
            with ThreadPoolExecutor(2) as pool:
                return list(pool.map(read, paths))

        return run

    found: dict[str, Callable[[], object]] = {"read, glossy": both(read_planes)}
    try:
        import OpenEXR

        found["read, OpenEXR"] = both(lambda p: OpenEXR.File(p, separate_channels=True).channels())
    except ImportError:
        pass
    try:
        oiio: Any = importlib.import_module("OpenImageIO")
        found["read, OpenImageIO"] = both(lambda p: oiio.ImageInput.open(p).read_image())
    except ImportError:
        pass
    return found


def measure(height: int, rounds: int) -> tuple[dict[str, list[float]], dict[str, list[float]]]:
    """CPU seconds and elapsed seconds of every contender."""
    with tempfile.TemporaryDirectory() as folder:
        paths = write_pictures(pathlib.Path(folder), height)

        def compare() -> None:
            with contextlib.redirect_stdout(io.StringIO()):
                if cli.main(["compare", *paths]) != 0:
                    raise SystemExit("compare failed")

        contenders = {"compare": compare, **readers(paths)}
        cpu = common.interleaved(contenders, rounds)
        return cpu, common.interleaved(contenders, rounds, time.perf_counter)


def main() -> None:
    """Print the table."""
    parser = common.arguments(__doc__)
    parser.add_argument("--height", type=int, default=2048)
    args = parser.parse_args()
    if args.quick:
        args.height, args.rounds = 64, 1
    cpu, elapsed = measure(args.height, args.rounds)
    rows: list[list[str]] = []
    results: list[dict[str, Any]] = []
    for name in ("compare", "read, glossy", "read, OpenEXR", "read, OpenImageIO"):
        if name not in cpu:
            rows.append([name, "absent", "", ""])
            continue
        milliseconds = [f"{statistics.median(t[name]) * 1e3:.0f}" for t in (cpu, elapsed)]
        rows.append([name, *milliseconds, common.median_ratio(cpu, "compare", name)])
        results.append({"name": name, "cpu_seconds": cpu[name], "seconds": elapsed[name]})
    size = f"two of {2 * args.height} x {args.height}"
    print(common.table([size, "CPU ms", "elapsed ms", "compare over it (CPU)"], rows))
    common.write(args.json, "compare", results)


if __name__ == "__main__":
    main()
