"""Errors of interpolating between measured incident directions, for every file of real data.

    python benchmarks/leave_one_out.py --data DATA --json leave.json

Each incident direction between others is left out and predicted from the rest, see
`glossy.measured.leave_one_out`. Files with transmission have a row for each side.
"""

import argparse
import os
import pathlib
import sys
from typing import Any

import common
import numpy as np

QUANTITIES = ("p", "root", "f")


def study(path: pathlib.Path, most: int | None) -> list[dict[str, Any]]:
    """A row for each side, interpolated quantity and incident direction of a file."""
    import glossy
    from glossy.measured.leave_one_out import leave_one_out

    table = glossy.read_measured(path)
    passed = table.wi[:, 2] * table.wo[:, 2] < 0.0
    rows = []
    for side, own in (("reflection", ~passed), ("transmission", passed)):
        if not own.any():
            continue
        name = path.stem + (f", {side}" if passed.any() else "")
        for quantity in QUANTITIES:
            for left in leave_one_out(table.select(own), quantity, most):
                rows.append({"name": name, "quantity": quantity, **vars(left)})
        print(name, file=sys.stderr)
    return rows


def print_means(rows: list[dict[str, Any]]) -> None:
    """Means over the directions; of the root also the medians and the lobe."""

    def column(name: str, quantity: str, field: str, way: str) -> list[float]:
        return [r[field][way] for r in rows if r["name"] == name and r["quantity"] == quantity]

    body: list[list[object]] = []
    for name in dict.fromkeys(r["name"] for r in rows):
        cells = [
            np.mean(column(name, quantity, "error", way))
            for quantity in QUANTITIES
            for way in ("linear", "half-vector")
        ]
        for way in ("linear", "half-vector"):
            cells.append(np.median(column(name, "root", "error", way)))
            cells.append(np.mean(column(name, "root", "peak", way)))
        body.append([name, *(f"{x:.3f}" for x in cells)])
    head = [f"{way} ({q})" for q in QUANTITIES for way in ("linear", "aligned")]
    head += [f"{what}, {way}" for way in ("linear", "aligned") for what in ("median", "lobe")]
    print(common.table(["file", *head], body), "\n")


def main() -> None:
    """Study the files and print their table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", default=os.environ.get("GLOSSY_DATA", "."), metavar="DIR")
    parser.add_argument("--files", default="*.*", metavar="GLOB", help="of DIR/brdf")
    parser.add_argument("--most", type=int, help="incident directions of a file")
    parser.add_argument("--json", type=pathlib.Path, help="write the figures to this file")
    args = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for path in sorted((pathlib.Path(args.data) / "brdf").glob(args.files)):
        rows += study(path, args.most)
    if not rows:
        raise SystemExit(f"no files {args.files} in {args.data}/brdf")
    print_means(rows)
    common.write(args.json, "leave_one_out", rows)


if __name__ == "__main__":
    main()
