"""What every benchmark shares: interleaved timing, the record of the machine, table and JSON."""

import argparse
import json
import os
import pathlib
import platform
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from typing import Any

PACKAGES = ("glossy-envmap", "numpy", "numba", "opencv-python-headless", "moderngl", "mitsuba")


def versions() -> dict[str, str]:
    """Versions of this package and of the peers that are installed."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "absent"
    return found


def machine() -> dict[str, Any]:
    """Processor, threads and versions: figures mean nothing without them."""
    model = platform.processor()
    cpuinfo = pathlib.Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [x for x in cpuinfo.read_text().splitlines() if x.startswith("model name")]
        model = names[0].split(":", 1)[1].strip() if names else model
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "versions": versions(),
    }


def interleaved(
    contenders: Mapping[str, Callable[[], object]],
    rounds: int = 7,
    clock: Callable[[], float] = time.process_time,
) -> dict[str, list[float]]:
    """Seconds of every contender, run in turn ``rounds`` times after one warm-up each.

    The default clock is the CPU time of the process, all threads together: it does not count what
    other programs take. Taking turns spreads a change of the machine's speed over all of them.
    """
    for run in contenders.values():
        run()
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, run in contenders.items():
            start = clock()
            run()
            times[name].append(clock() - start)
    return times


def ratio(
    times: Mapping[str, Sequence[float]], name: str, against: str
) -> tuple[float, float, float]:
    """Time of ``name`` over that of ``against``, round by round: minimum, median, maximum."""
    values = [a / b for a, b in zip(times[name], times[against], strict=True)]
    return min(values), statistics.median(values), max(values)


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Columns of text, Markdown's way, so that a result can be pasted into the docs."""
    cells = [[str(c) for c in row] for row in [header, *rows]]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    lines = [" | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in cells]
    rule = "|".join("-" * (w + 2) for w in widths)
    return "\n".join([f"| {lines[0]} |", f"|{rule}|", *(f"| {line} |" for line in lines[1:])])


def arguments(description: str | None) -> argparse.ArgumentParser:
    """A parser with the options of every benchmark."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=pathlib.Path, help="write the figures to this file")
    parser.add_argument("--rounds", type=int, default=7, help="timed runs of each contender")
    parser.add_argument(
        "--quick", action="store_true", help="small sizes, one round: to see that it runs"
    )
    return parser


def median_ratio(times: Mapping[str, Sequence[float]], name: str, against: str) -> str:
    """``ratio`` as text: median (minimum to maximum), or "absent" for a peer not installed."""
    if name not in times or against not in times:
        return "absent"
    low, middle, high = ratio(times, name, against)
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"


def write(path: pathlib.Path | None, name: str, results: object) -> None:
    """The figures as JSON, with the machine they were measured on."""
    if path is None:
        return
    record = {"schema": 1, "benchmark": name, "machine": machine(), "results": results}
    partial = path.with_name(path.name + ".part")
    partial.write_text(json.dumps(record, indent=1) + "\n")
    partial.replace(path)
    print(f"wrote {path}", file=sys.stderr)
