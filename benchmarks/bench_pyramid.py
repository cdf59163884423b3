"""``build_pyramid``'s filters on one thread against a copy of the map and against OpenCV.

    python benchmarks/bench_pyramid.py --json pyramid.json

Timed are levels 1 and up, with their seams, into buffers that exist already; beside it what comes
before them: checking the faces, and packing them with their seams as level 0. OpenCV halves each
face by itself, seams left open, down the same chain. The paper's milliseconds (its Table 1) are of
a GPU.
"""

import functools
import statistics
from collections.abc import Callable
from typing import Any

import common
import numba
import numpy as np

import glossy

PAPER = {
    ("box", 256): 0.18, ("box", 512): 0.44, ("box", 1024): 1.45,
    ("gauss4", 256): 0.52, ("gauss4", 512): 1.23, ("gauss4", 1024): 3.86,
    ("gauss6", 256): 0.65, ("gauss6", 512): 1.77, ("gauss6", 1024): 5.97,
}  # fmt: skip
PEERS = {"box": "INTER_AREA", "gauss4": None, "gauss6": "pyrDown", "round": None}


def opencv_chains(faces: Any) -> dict[str, Callable[[], None]]:
    """OpenCV's chains down to one texel, into buffers of their own; empty if it is absent."""
    try:
        import cv2
    except ImportError:
        return {}
    cv2.setNumThreads(1)
    sizes = [faces.shape[1] >> k for k in range(1, faces.shape[1].bit_length())]
    area, gauss = ([np.empty((6, n, n, 3), np.float32) for n in sizes] for _ in range(2))

    def run_area() -> None:
        for face in range(6):
            fine = faces[face]
            for level in area:
                n = level.shape[1]
                cv2.resize(fine, (n, n), dst=level[face], interpolation=cv2.INTER_AREA)
                fine = level[face]

    def run_gauss() -> None:
        for face in range(6):
            fine = faces[face]
            for level in gauss:
                n = level.shape[1]
                cv2.pyrDown(fine, dst=level[face], dstsize=(n, n))
                fine = level[face]

    return {"INTER_AREA": run_area, "pyrDown": run_gauss}


def measure(size: int, rounds: int) -> dict[str, list[float]]:
    """Seconds of every contender at one size."""
    faces = np.random.default_rng(0).random((6, size, size, 3), dtype=np.float32)
    cube = glossy.CubeMap(faces)
    target = np.empty_like(faces)
    contenders: dict[str, Callable[[], object]] = {"copy": lambda: np.copyto(target, cube.faces)}
    pyramids: dict[str, glossy.Pyramid] = {}
    for filter in PEERS:
        pyramids[filter] = glossy.build_pyramid(cube, filter=filter)
        contenders[filter] = functools.partial(pyramids[filter]._reduce, cube.faces)
    contenders |= opencv_chains(faces)
    contenders["check"] = functools.partial(glossy.CubeMap, faces)
    contenders["pack"] = functools.partial(pyramids["gauss6"]._store_base, cube.faces)
    contenders["update"] = functools.partial(pyramids["gauss6"].update, cube)
    return common.interleaved(contenders, rounds)


def main() -> None:
    """Every size; a table of the filters and one of what surrounds them."""
    parser = common.arguments(__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[256, 512, 1024])
    args = parser.parse_args()
    if args.quick:
        args.sizes, args.rounds = [32], 1
    numba.set_num_threads(1)
    rows: list[list[str]] = []
    around: list[list[str]] = []
    results: list[dict[str, Any]] = []
    for size in args.sizes:
        times = measure(size, args.rounds)
        middle = {k: statistics.median(v) * 1e3 for k, v in times.items()}
        for filter, peer in PEERS.items():
            paper = PAPER.get((filter, size))
            against = "" if peer is None else common.median_ratio(times, filter, peer)
            rows.append(
                [str(size), filter, f"{middle[filter]:.2f}", "" if paper is None else f"{paper:g}",
                 common.median_ratio(times, filter, "copy"), peer or "", against]
            )  # fmt: skip
        around.append(
            [str(size), *(f"{middle[k]:.2f}" for k in ("copy", "check", "pack", "update"))]
        )
        results.append({"size": size, "seconds": times})
    header = ["N", "filter", "CPU ms", "paper, GPU ms", "over a copy", "OpenCV", "over OpenCV"]
    print(common.table(header, rows))
    print()
    print(common.table(["N", "copy, ms", "check", "pack level 0", "update, gauss6"], around))
    common.write(args.json, "pyramid", results)


if __name__ == "__main__":
    main()
