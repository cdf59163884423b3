"""Prefiltered maps: how well radially symmetric lobes stand for a BRDF.

Tables and plot of docs/prefiltered.md:

* figure7: RMS error against the number of lobes for Ward's model (kd 0, ks 0.8, alpha 0.04), and
  three readings of "minimum profile" under which the error may rise again.
* materials: single lobe, one shape, three lobes; a copper, Ward, wide lobes, and Cornell's Cayman
  lacquer where the real data is (``--data``).
* searches: where the axes are looked for, on BRDFs that the peak serves well or badly.

    python benchmarks/reproduce_prefiltered.py [--data DIR] [--plot FILE.png] [--json FILE]
"""

import math
import pathlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from common import arguments, table, write

import glossy
from glossy.prefiltered import profiles
from glossy.prefiltered.approximate import approximate, default_angles, default_cosines
from glossy.prefiltered.error import CELLS, lobe_error
from glossy.prefiltered.search import SEARCHES, find_axis
from glossy.prefiltered.slices import Function, Slice, half_width, make_slice
from glossy.prefiltered.ward import Ward

Array = npt.NDArray[np.float64]
Profile = Callable[[Function, Array, Slice, Array, Array], Array]

WARD = Ward(kd=0.0, ks=0.8, alpha=0.04)
COPPER = glossy.Material(reflection=[glossy.Lobe(0.15, r0=(0.955, 0.638, 0.538))])
WIDE = glossy.Material(reflection=[glossy.Lobe(0.3)])
LOBES = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12)
VIEWS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
FINISHES = ("minimum", "mean", "refit")
REFITTED = 6  # lobes at most: the common fit grows with their square


def mean_rms(material: Any, stacks: Any, views: npt.ArrayLike) -> float:
    """Relative RMS error of a view, the mean over the views."""
    return float(lobe_error(material, stacks, views).rms.mean())


def minimum(rest: Function, axis: Array, piece: Slice, value: Array, angles: Array) -> Array:
    """The package's: below every sample."""
    return profiles.minimum_profile(rest, axis, angles, piece.wi, value)


def four_curves(rest: Function, axis: Array, piece: Slice, value: Array, angles: Array) -> Array:
    """Least of four curves alone, which may pass the BRDF between them."""
    return np.asarray(rest(profiles.about(axis, angles, 4)).min(axis=0))


def mean(rest: Function, axis: Array, piece: Slice, value: Array, angles: Array) -> Array:
    """Mean of the curves."""
    return profiles.mean_profile(rest, axis, angles)


READINGS: dict[str, Profile] = {"minimum": minimum, "4 curves": four_curves, "mean": mean}


def greedy(profile: Profile, views: Sequence[float], counts: Sequence[int]) -> list[float]:
    """RMS error after each count of lobes, every slice by itself; what is left is clamped at 0."""
    scale, angles = half_width(WARD), default_angles(WARD)
    errors = np.zeros((len(views), max(counts)))
    for row, view in zip(errors, views, strict=True):
        piece = make_slice(WARD, view, scale, True)
        other = make_slice(WARD, view, scale, True, CELLS)
        lobes: list[tuple[Array, Array]] = []
        value, estimate = piece.value, np.zeros_like(other.value)
        for k in range(max(counts)):
            rest = profiles.residual(piece.function, lobes, angles)
            axis = find_axis(piece, rest, value, angles, "peak")
            lobe = profile(rest, axis, piece, value, angles)
            lobes.append((axis, lobe))
            at = profiles.angle_to(axis, piece.wi)
            value = np.maximum(value - profiles.evaluate(angles, lobe, at), 0.0)
            at = profiles.angle_to(axis, other.wi)
            estimate = estimate + profiles.evaluate(angles, lobe, at)
            apart = np.sum(other.area @ (estimate - other.value) ** 2)
            row[k] = math.sqrt(float(apart / np.sum(other.area @ other.value**2)))
    return [float(errors[:, n - 1].mean()) for n in counts]


def figure7(quick: bool) -> list[dict[str, Any]]:
    """Errors by number of lobes: the readings, and the stacks between their slices."""
    counts = LOBES[:2] if quick else LOBES
    views = VIEWS[4:5] if quick else VIEWS
    slices = 3 if quick else 16
    nodes = default_cosines(slices)
    between = 0.5 * (nodes[1:] + nodes[:-1])[1:]
    readings = {name: greedy(profile, views, counts) for name, profile in READINGS.items()}
    rows = []
    for k, n in enumerate(counts):
        row: dict[str, Any] = {"lobes": n} | {name: e[k] for name, e in readings.items()}
        for finish in FINISHES:
            if finish == "refit" and n > REFITTED:
                continue
            stacks = approximate(WARD, "multi", n, slices, cosine="outside", finish=finish)
            row[f"stacks, {finish}"] = mean_rms(WARD, stacks, between)
        rows.append(row)
    return rows


METHODS: dict[str, dict[str, Any]] = {
    "flat": {"mode": "flat"},
    "single": {"mode": "single"},
    "single, n.r outside": {"mode": "single", "cosine": "outside"},
    "3 lobes, minimum": {"mode": "multi", "lobes": 3, "finish": "minimum"},
    "3 lobes, mean": {"mode": "multi", "lobes": 3},
    "3 lobes, rescaled": {"mode": "multi", "lobes": 3, "finish": "rescale"},
    "3 lobes, refit": {"mode": "multi", "lobes": 3, "finish": "refit"},
}


def materials(data: pathlib.Path | None) -> dict[str, Any]:
    """The BRDFs of the tables; Cayman from the real data, or not at all."""
    found: dict[str, Any] = {"copper": COPPER, "Ward": WARD, "m = 0.3": WIDE}
    file = None if data is None else data / "brdf" / "cornell_cayman.brdf"
    if file is None or not file.is_file():
        print("Cayman lacquer left out: --data names no folder with brdf/cornell_cayman.brdf\n")
    else:
        found["Cayman"] = glossy.measured_material(file)
    return found


def methods(found: dict[str, Any], quick: bool) -> list[dict[str, Any]]:
    """RMS error (mean of the views) and error of the brightness (largest) by method."""
    slices = 3 if quick else 16
    nodes = default_cosines(slices)
    between = (0.5 * (nodes[1:] + nodes[:-1]))[1::2]
    rows = []
    for name, material in found.items():
        for method, options in METHODS.items():
            stacks = approximate(material, elevations=slices, **options)
            error = lobe_error(material, stacks, between)
            rows.append({
                "material": name,
                "method": method,
                "rms": float(error.rms.mean()),
                f"rms at {math.degrees(math.acos(between[0])):.0f}°": float(error.rms[0]),
                "furnace": float(error.furnace.flat[np.argmax(np.abs(error.furnace))]),
            })  # fmt: skip
    return rows


class RoundLobe:
    """f cos theta_i round about the reflected direction: with a hollow, or sent back in part."""

    def __init__(self, hollow: bool) -> None:
        self.hollow = hollow

    def eval(self, wi: Array, wo: Array) -> Array:
        """BRDF [1/sr]."""
        mirror = np.einsum("...i,...i->...", wi, wo * [-1.0, -1.0, 1.0])
        back = np.einsum("...i,...i->...", wi, wo)
        a, b = (np.arccos(np.clip(x, -1.0, 1.0)) / 0.1 for x in (mirror, back))
        value = np.exp(-(a**2))
        value = value * (0.2 + a**2) if self.hollow else value + 0.5 * np.exp(-(b**2))
        z = wi[..., 2]
        return np.where(z > 0.0, value / np.maximum(z, 1e-9), 0.0)


def searches(found: dict[str, Any], quick: bool) -> list[dict[str, Any]]:
    """RMS error at the slices by search, one and three lobes."""
    views = [0.6] if quick else [0.3, 0.6, 0.9]
    rows = []
    cases = {**found, "hollow": RoundLobe(True), "partly sent back": RoundLobe(False)}
    for name, material in cases.items():
        for search in SEARCHES:
            row: dict[str, Any] = {"material": name, "search": search}
            for label, options in (
                ("1 lobe", {"mode": "single"}),
                ("3 lobes, minimum", {"mode": "multi", "lobes": 3, "finish": "minimum"}),
                ("3 lobes, mean", {"mode": "multi", "lobes": 3}),
            ):
                stacks = approximate(material, elevations=views, search=search, **options)
                row[label] = mean_rms(material, stacks, views)
            rows.append(row)
    return rows


def show(rows: list[dict[str, Any]]) -> str:
    """A Markdown table; a column is there if any row has it."""
    header = list(dict.fromkeys(key for row in rows for key in row))

    def text(value: object) -> str:
        return f"{value:.3f}" if isinstance(value, float) else str(value)

    return table(header, [[text(row.get(key, "")) for key in header] for row in rows])


def plot(rows: list[dict[str, Any]], path: pathlib.Path) -> None:
    """Error against lobes."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6.0, 3.6), dpi=100)
    styles = {"minimum": "-o", "4 curves": "-s", "mean": "-^"}
    for name in [key for key in rows[0] if key != "lobes"]:
        pairs = [(row["lobes"], row[name]) for row in rows if name in row]
        axes.plot(*zip(*pairs, strict=True), styles.get(name, "--"), label=name, markersize=4)
    axes.set_xlabel("lobes")
    axes.set_ylabel("relative RMS error of the BRDF")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(path)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--data", type=pathlib.Path, help="folder of real data, with brdf/")
    parser.add_argument("--plot", type=pathlib.Path, help="write the plot of figure 7 here")
    parser.add_argument(
        "--part", choices=("figure7", "materials", "searches"), help="only this part"
    )
    args = parser.parse_args()
    results: dict[str, Any] = {}
    if args.part in (None, "figure7"):
        results["figure7"] = figure7(args.quick)
        print("RMS error by number of lobes\n\n" + show(results["figure7"]) + "\n")
        if args.plot is not None:
            plot(results["figure7"], args.plot)
    if args.part in (None, "materials", "searches"):
        found = {"Ward": WARD} if args.quick else materials(args.data)
        for name, run in (("materials", methods), ("searches", searches)):
            if args.part in (None, name):
                results[name] = run(found, args.quick)
                print(f"{name}\n\n" + show(results[name]) + "\n")
    write(args.json, "prefiltered", results)


if __name__ == "__main__":
    main()
