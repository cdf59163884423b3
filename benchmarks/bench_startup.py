"""How long it takes to start: importing, printing help, a first picture and the next one.

    python benchmarks/bench_startup.py --json startup.json

Every case is a process of its own. "cold" has an empty kernel cache, as after an installation;
"warm" finds what the cold one left (``--quick`` leaves that one out and uses the cache there is).
CPU time of the process and elapsed time; "python" is an interpreter that does nothing, contained in
all the others.
"""

import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from typing import Any

import common

TARGETS = {
    "import glossy": 0.2, "glossy compare --help": 0.5, "glossy render, cold": 20.0,
    "glossy render, warm": 1.5,
}  # fmt: skip


def seconds(command: Sequence[str], environment: dict[str, str]) -> tuple[float, float]:
    """CPU and elapsed seconds of a process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
    elapsed = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return cpu, elapsed


def measure(rounds: int, cold_rounds: int, size: str) -> dict[str, list[tuple[float, float]]]:
    """(CPU, elapsed) seconds of every round of every case."""
    run = [sys.executable, "-c"]
    main = "import sys; from glossy.cli import main; sys.exit(main(sys.argv[1:]))"
    times: dict[str, list[tuple[float, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        picture = str(pathlib.Path(folder) / "picture.exr")
        render = [*run, main, "render", "--width", size, "--height", size, "-o", picture]
        without = ("PYTHONDONTWRITEBYTECODE", "NUMBA_CACHE_DIR" if cold_rounds else "")
        environment = {k: v for k, v in os.environ.items() if k not in without}
        for k in range(cold_rounds):
            environment["XDG_CACHE_HOME"] = str(pathlib.Path(folder) / f"cache{k}")
            times.setdefault("glossy render, cold", []).append(seconds(render, environment))
        cases = {
            "python": [*run, "pass"],
            "import numpy": [*run, "import numpy"],
            "import glossy": [*run, "import glossy"],
            "glossy compare --help": [*run, main, "compare", "--help"],
            "glossy render, warm": render,
        }
        for _ in range(rounds):
            for name, command in cases.items():
                times.setdefault(name, []).append(seconds(command, environment))
    return {name: times[name] for name in [*cases, "glossy render, cold"] if name in times}


def main() -> None:
    """Print the table."""
    parser = common.arguments(__doc__)
    parser.add_argument("--cold-rounds", type=int, default=2, help="runs without a kernel cache")
    parser.add_argument("--size", default="256", help="width and height of the picture")
    args = parser.parse_args()
    if args.quick:
        args.rounds, args.cold_rounds, args.size = 1, 0, "8"
    times = measure(args.rounds, args.cold_rounds, args.size)
    rows: list[list[str]] = []
    results: list[dict[str, Any]] = []
    for name, values in times.items():
        cpu, elapsed = ([v[i] for v in values] for i in range(2))
        rows.append(
            [name, f"{statistics.median(cpu):.2f}", f"{statistics.median(elapsed):.2f}",
             f"{TARGETS[name]:g}" if name in TARGETS else ""]
        )  # fmt: skip
        results.append({"name": name, "cpu_seconds": cpu, "seconds": elapsed})
    print(common.table(["process", "CPU s", "elapsed s", "wanted, s"], rows))
    common.write(args.json, "startup", results)


if __name__ == "__main__":
    main()
