"""What fitting a table costs: seconds for one and two lobes, and candidates against NumPy.

    python benchmarks/bench_fit.py --json fit.json

A table of 10 080 rows, anisotropic, 10 % noise. *Cold* is a new process with an empty kernel cache,
compilation included. Candidates of the grid search are compared, in turns, with the metric in
NumPy, one set of parameters after the other, as the polish has it.
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import time
from typing import Any

import common
import numpy as np

COLD = """
import sys, time
start = time.perf_counter()
sys.path.insert(0, {folder!r})
import bench_fit
bench_fit.fit(bench_fit.table(24, 28), 1, 9)
print(time.perf_counter() - start)
"""


def table(rows: int, columns: int) -> Any:
    """The table of a metal with two lobes under 15 incident directions."""
    import glossy
    from glossy.measured.synthetic import synthetic_table

    theta, phi = (0.0, 20.0, 35.0, 50.0, 65.0), (0.0, 45.0, 90.0)
    metal = glossy.material("alanod-2000gs-two-lobes")
    return synthetic_table(metal, theta, phi, rows, columns, noise=0.1)


def fit(measured: Any, lobes: int, grid: int) -> Any:
    """One fit with the defaults."""
    import glossy

    return glossy.fit_table(measured, lobes, grid=grid)


def fits(measured: Any, grid: int) -> list[dict[str, Any]]:
    """Elapsed and CPU seconds of fits with compiled kernels."""
    rows = []
    for lobes in (1, 2):
        start, cpu = time.perf_counter(), time.process_time()
        found = fit(measured, lobes, grid)
        rows.append(
            {
                "lobes": lobes,
                "rows": found.rows,
                "seconds": time.perf_counter() - start,
                "cpu_seconds": time.process_time() - cpu,
                "evaluations": found.evaluations,
                "stages": [[s.name, s.error, s.seconds] for s in found.stages],
            }
        )
    return rows


def candidates(measured: Any, n: int, rounds: int) -> dict[str, list[float]]:
    """CPU seconds a candidate of a grid level and of NumPy, in turns."""
    from glossy.measured import fit_metrics, fit_rows

    rows = fit_rows.rows_of(measured, "reflection", "kurt", "auto")
    assert rows is not None
    axis = np.linspace(0.1, 0.3, n)
    shapes = np.stack([a.ravel() for a in np.meshgrid(axis, axis, axis)], axis=1)
    pairs = np.stack([a.ravel() for a in np.meshgrid(axis, axis)])
    y, base = rows.measured[:, 0], np.zeros(len(rows.measured))
    one = np.array([[0.0, 0.15, 0.1, 0.2, 0.7, 0.8]])
    singles = 20

    def numpy_metric() -> None:
        for _ in range(singles):
            fit_metrics.errors(rows, rows.measured, one, 0)

    times = common.interleaved(
        {
            "grid": lambda: fit_metrics.grid_errors(rows, y, base, shapes, pairs, 0),
            "numpy": numpy_metric,
        },
        rounds,
    )
    counts = {"grid": shapes.shape[0] * pairs.shape[1], "numpy": singles}
    return {k: [t / counts[k] for t in v] for k, v in times.items()}


def cold() -> float:
    """Seconds of the one-lobe fit in a new process with an empty kernel cache."""
    with tempfile.TemporaryDirectory() as cache:
        done = subprocess.run(
            [sys.executable, "-c", COLD.format(folder=str(pathlib.Path(__file__).parent))],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "NUMBA_CACHE_DIR": cache},
        )
    return float(done.stdout)


def main() -> None:
    """Print both tables."""
    args = common.arguments(__doc__).parse_args()
    measured = table(4, 6) if args.quick else table(24, 28)
    grid = 3 if args.quick else 9
    times = candidates(measured, grid, 1 if args.quick else args.rounds)
    rows = fits(measured, grid)
    body: list[list[object]] = [
        [r["lobes"], r["rows"], f"{r['seconds']:.1f}", f"{r['cpu_seconds']:.1f}", r["evaluations"]]
        for r in rows
    ]
    print(common.table(["lobes", "rows", "elapsed s", "CPU s", "evaluations"], body))
    first = None if args.quick else cold()
    if first is not None:
        print(f"\nOne lobe, cold: {first:.1f} s elapsed\n")
    body = [
        [name, f"{1e6 * min(times[name]):.3g}", common.median_ratio(times, name, "numpy")]
        for name in times
    ]
    print(common.table(["candidate by", "CPU µs", "over NumPy"], body))
    common.write(args.json, "fit", {"fits": rows, "candidates": times, "cold_seconds": first})


if __name__ == "__main__":
    main()
