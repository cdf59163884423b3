"""The thesis's figures again, in our room: PSNR of its estimators, and time against samples.

A test object stands on the low table of the built-in ``room``; its cube map is captured there, and
lookups meet the room's bounding planes (floor and ceiling), as in the thesis. Every row of Figs.
4.24 and 4.39 to 4.42 is shaded with the row's material and number of samples and compared with the
converged integral over the same cube map and planes. Then Table 4.1: time against samples, and the
line through it. Writes the tables of docs/thesis.md and its picture.

    python benchmarks/reproduce_thesis.py [--page docs/thesis.md] [--picture docs/images/thesis.png]
"""

import dataclasses
import functools
import itertools
import math
import pathlib
import re
import statistics
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from common import arguments, interleaved, table, write

import glossy
from glossy.image_write import write_image
from glossy.materials import describe
from glossy.scenes import prepare, view
from glossy.scenes.bounds import bounding_planes
from glossy.scenes.model import BakeSettings, CaptureSettings, ObjectScene, SceneObject
from glossy.scenes.shapes import Sphere, Transform

Array = npt.NDArray[np.float64]

PLACE, RADIUS = (0.1, 0.645, -0.3), 0.2
TEST_OBJECTS = (
    "chrome", "aluminium", "brushed aluminium", "lacquer", "plastic", "porcelain", "white foil",
    "frosted glass", "glass",
)  # fmt: skip
OWN = {
    "brushed-metal": (
        glossy.Material(reflection=[glossy.Lobe(0.2, 0.05, r0=0.8, alpha=0.4)]),
        "four times as wide along one axis; the fit of Miro 5 is too sharp for this figure",
    )
}
TABLE_4_1 = {
    3: (70, 95), 5: (52, 75), 7: (41, 60), 9: (35, 52), 11: (30, 43), 13: (26, 40), 15: (24, 35),
    17: (22, 31), 19: (20, 28),
}  # samples: frames a second, full and half screen  # fmt: skip
COLBERT = "Colbert"
BIASES = (0.0, -0.5, -1.0, -1.5, -2.0)
SWEEP = (1, 3, 5, 7, 11, 15, 19)
GAIN = 5.0
NAMES = {
    "display": "displayed", "linear": "linear", "clipped": "≤ white",
    "clipped_linear": "≤ white, linear", "biased": "best bias",
}  # of the measures  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Row:
    """One published figure: ``samples`` a lobe, ``printed`` as the caption counts them."""

    figure: str
    subject: str
    material: str
    estimator: str
    samples: int
    printed: str
    published: float


def _pairs(
    figure: str, subject: str, material: str, values: Mapping[int, float], lobes: int = 1
) -> list[Row]:
    return [
        Row(figure, subject, material, "4.25", n // lobes, f"{n}", v) for n, v in values.items()
    ]


ROWS = (
    Row("4.24a", "glossy metal", "alanod-2000gs", "4.24", 15, "15", 38.41),
    Row("4.24e", "glossy metal", "alanod-2000gs", "4.25", 15, "15", 41.27),
    Row("4.24b", "anisotropic", "brushed-metal", "4.24", 15, "15", 37.25),
    Row("4.24f", "anisotropic", "brushed-metal", "4.25", 15, "15", 41.35),
    Row("4.24c", "frosted glass", "frosted-glass", "4.24", 5, "5+5", 50.86),
    Row("4.24g", "frosted glass", "frosted-glass", "4.25", 5, "5+5", 50.99),
    Row("4.24d", "varnish", "varnish", "4.24", 7, "7", 49.88),
    Row("4.24h", "varnish", "varnish", "4.25", 7, "7", 50.33),
    *_pairs("4.39", "Scattergloss", "alanod-2000gs", {7: 41.08, 15: 43.49}),
    *_pairs("4.39", "Miro", "miro-5", {7: 47.22, 15: 48.84}),
    *_pairs("4.39", "chrome", "chrome", {7: 38.04, 15: 40.87}),
    *_pairs("4.40", "lacquer", "lacquer", {3: 55.05, 7: 57.48}),
    *_pairs("4.40", "plastic", "plastic", {3: 56.30, 7: 59.03}),
    *_pairs("4.40", "porcelain", "porcelain", {3: 68.95, 7: 71.70}),
    *_pairs("4.41", "white foil", "white-foil", {8: 39.44, 16: 45.41}, lobes=2),
    *_pairs("4.41", "frosted glass", "frosted-glass", {8: 47.20, 16: 48.22}, lobes=2),
    *_pairs("4.41", "glass", "glass", {4: 62.60, 8: 65.65}, lobes=2),
    Row("4.42a", "close-up", "alanod-2000gs", "4.25", 11, "11", 40.71),
    Row("4.42c", "close-up", "alanod-2000gs", COLBERT, 40, "40", 42.17),
)
MATERIALS = tuple(dict.fromkeys(row.material for row in ROWS))


def find(name: str) -> glossy.Material:
    """A material of the library or of this page."""
    return OWN[name][0] if name in OWN else glossy.material(name)


def width(name: str) -> float:
    """Mean slope width sqrt(mx my) of a material's widest lobe."""
    m = find(name)
    return max(
        math.sqrt(lobe.widths[0] * lobe.widths[1]) for lobe in (*m.reflection, *m.transmission)
    )


def display(image: npt.ArrayLike) -> Array:
    """What is shown: exposure 0, clipped to [0, 1], sRGB, rounded to 8 bits; in units of white."""
    v = np.clip(np.asarray(image, dtype=np.float64), 0.0, 1.0)
    curve = np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1.0 / 2.4) - 0.055)
    return np.asarray(np.round(255.0 * curve) / 255.0)


class Place:
    """The test object in its room: points, cube map, planes, and the picture around it.

    ``coarse`` bakes and captures quickly, to try things out.
    """

    def __init__(self, pixels: int, coarse: bool = False) -> None:
        room = glossy.load_scene("room")
        assert isinstance(room, ObjectScene)
        keep = tuple(o for o in room.objects if o.name not in TEST_OBJECTS)
        stand_in = glossy.Material(reflection=[glossy.Lobe(0.15, r0=0.5)])
        test = SceneObject(Sphere(RADIUS), Transform(PLACE), stand_in, name="test object")
        eye = (PLACE[0] + 0.25, PLACE[1] + 0.4, PLACE[2] + 1.05)
        camera = glossy.Camera(eye, PLACE, fov=25.0, width=4 * pixels // 3, height=pixels)
        scene = dataclasses.replace(room, objects=(*keep, test), camera=camera, supersampling=1)
        if coarse:
            bake, capture = BakeSettings(0.5, samples=16, bounces=1), CaptureSettings(64, 1)
            scene = dataclasses.replace(scene, bake=bake, capture=capture)
        prepared = prepare(scene)
        index = len(keep)
        self.seen = view(prepared)
        self.points = self.seen.parts[0].points
        self.planes = bounding_planes(prepared, index)
        faces = prepared.cube_map(index).faces
        self.cubes = {
            "captured": glossy.CubeMap(faces),
            "clipped": glossy.CubeMap(faces.clip(0, 1)),
        }
        self.pyramids = {light: glossy.build_pyramid(cube) for light, cube in self.cubes.items()}
        self.above = prepared.irradiance(index, self.points.normal)
        self.below = prepared.irradiance(index, -self.points.normal)
        self._truths: dict[tuple[str, str, int], tuple[Array, Array]] = {}

    def diffuse(self, name: str) -> Array:
        """Radiance (K, 3) of the diffuse terms, the same in both pictures."""
        material = find(name)
        value = material.diffuse / np.pi * self.above + material.diffuse_below / np.pi * self.below
        share = material.diffuse_share(self.points.local_view)
        return np.asarray(value if share is None else share * value)

    def lobes(
        self, name: str, estimator: str, samples: int, light: str = "captured", bias: float = 0.0
    ) -> Array:
        """Radiance (K, 3) of the lobes in real time."""
        own = {"method": "thesis", "estimator": estimator}
        if estimator == COLBERT:
            own = {"method": "importance"}
        bare = dataclasses.replace(find(name), kd=0.0, diffuse_transmission=0.0, kd_falloff=False)
        value = glossy.shade(
            self.points, bare, self.pyramids[light], samples=samples, bias=bias,
            parallax=self.planes, **own,
        )  # fmt: skip
        return np.asarray(value, dtype=np.float64)

    def truth(self, name: str, samples: int, light: str = "captured") -> tuple[Array, Array]:
        """Radiance (K, 3) of the lobes and its standard error, kept."""
        key = (name, light, samples)
        if key not in self._truths:
            found = glossy.reference(
                self.points, find(name), self.cubes[light], "qmc", samples=samples, diffuse=False,
                parallax=self.planes,
            )  # fmt: skip
            self._truths[key] = found.radiance, found.error
        return self._truths[key]

    def picture(self, name: str, lobes: Array) -> Array:
        """(H, W, 3) of the room with the object, its diffuse terms and these lobes."""
        return self.seen.picture([self.diffuse(name) + lobes])


def measure(place: Place, row: Row, samples: int) -> dict[str, Any]:
    """PSNR [dB] of one row over the object's pixels.

    ``bias``: displayed, with the level bias that is best for the row; ``clipped``: with no light
    above white. ``truth`` is what the standard error of the truth alone would give, linear.
    """
    diffuse = place.diffuse(row.material)
    value = place.lobes(row.material, row.estimator, row.samples)
    exact, error = place.truth(row.material, samples)
    shown = display(diffuse + exact)

    def displayed(bias: float) -> float:
        lobes = place.lobes(row.material, row.estimator, row.samples, bias=bias)
        return glossy.psnr(display(diffuse + lobes), shown)

    best = max(BIASES, key=displayed)
    flat, _ = place.truth(row.material, samples, "clipped")
    dim = place.lobes(row.material, row.estimator, row.samples, "clipped")
    return {
        **dataclasses.asdict(row),
        "display": displayed(0.0),
        "linear": glossy.psnr(diffuse + value, diffuse + exact),
        "clipped": glossy.psnr(display(diffuse + dim), display(diffuse + flat)),
        "clipped_linear": glossy.psnr(diffuse + dim, diffuse + flat),
        "best_bias": best,
        "biased": displayed(best),
        "truth": -20.0 * math.log10(float(np.sqrt(np.mean(np.square(error))))),
        "truth_display": glossy.psnr(display(diffuse + exact + error), shown),
    }


MEASURES = ("display", "linear", "clipped", "clipped_linear", "biased")


def orders(results: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What must hold, pair by pair: by how many dB it does, published and by each measure.

    4.25 against 4.24, more samples against fewer of one equation, Colbert's 40 against the 11.
    """
    found = []
    for a, b in itertools.permutations(results, 2):
        if (a["figure"][:4], a["subject"]) != (b["figure"][:4], b["subject"]):
            continue
        if a["samples"] == b["samples"] and (a["estimator"], b["estimator"]) == ("4.25", "4.24"):
            claim = "4.25 ≥ 4.24"
        elif a["samples"] > b["samples"]:
            claim = f"{a['printed']} ≥ {b['printed']} samples"
        else:
            continue
        gains = {m: a[m] - b[m] for m in ("published", *MEASURES)}
        found.append({"pair": f"{a['figure'][:4]} {a['subject']}", "claim": claim, **gains})
    return found


def sweep(place: Place, samples: int) -> list[list[str]]:
    """Displayed PSNR of eq. 4.25 over the object for more and more samples, sharp lobes first."""
    rows = []
    for name in sorted(MATERIALS, key=width):
        diffuse = place.diffuse(name)
        shown = display(diffuse + place.truth(name, samples)[0])
        cells = [glossy.psnr(display(diffuse + place.lobes(name, "4.25", n)), shown) for n in SWEEP]
        rows.append([name, f"{width(name):.3f}", *(f"{c:.1f}" for c in cells)])
    return rows


def line(x: Sequence[float], y: Sequence[float]) -> tuple[float, float, float]:
    """Slope, intercept and R^2 of the least-squares line."""
    slope, start = np.polyfit(x, y, 1)
    left = np.asarray(y) - (slope * np.asarray(x) + start)
    return float(slope), float(start), 1.0 - float(np.var(left) / np.var(y))


def clock(place: Place, rounds: int, size: tuple[int, int]) -> dict[str, Any]:
    """CPU seconds of a screen full, or half full, of glossy pixels against samples."""
    near = glossy.Camera((0.0, 0.0, 1.4), fov=40.0, width=size[0], height=size[1])
    found = glossy.surface_points(near, glossy.Sphere(radius=1.0))
    shift = np.asarray(PLACE) + RADIUS * found.normal
    full = dataclasses.replace(found, position=shift)
    lobe = find("alanod-2000gs")
    mask = np.broadcast_to(np.arange(size[0]) < size[0] // 2, full.coverage.shape)
    screens = {"full": full, "half": dataclasses.replace(full, mask=full.coverage & mask)}

    def run(screen: str, n: int) -> None:
        glossy.shade(screens[screen], lobe, place.pyramids["captured"], "thesis", samples=n,
                     irradiance=np.ones(3), parallax=place.planes)  # fmt: skip

    contenders = {
        f"{screen} {n}": functools.partial(run, screen, n) for screen in screens for n in TABLE_4_1
    }
    times = interleaved(contenders, rounds)
    return {
        screen: {n: statistics.median(times[f"{screen} {n}"]) for n in TABLE_4_1}
        for screen in screens
    }


def time_tables(measured: Mapping[str, Mapping[int, float]]) -> tuple[str, str]:
    """Times relative to 19 samples on a full screen beside the published, and the fitted lines."""
    published = {
        screen: {n: 1.0 / fps[k] for n, fps in TABLE_4_1.items()}
        for k, screen in enumerate(("full", "half"))
    }
    sources = {"published": published, "ours": measured}
    body = []
    for n in TABLE_4_1:
        cells = [
            f"{s[k][n] / s['full'][19]:.2f}" for k in ("full", "half") for s in sources.values()
        ]
        body.append([n, *cells])
    head = ["samples", "full, published", "full, ours", "half, published", "half, ours"]
    fits = []
    for name, source in sources.items():
        for screen, values in source.items():
            slope, start, r2 = line(list(values), list(values.values()))
            row = [f"{name}, {screen}", f"{1e3 * slope:.2f}", f"{1e3 * start:.2f}"]
            fits.append([*row, f"{start / slope:.1f}", f"{r2:.4f}"])
    fit_head = ["", "ms a sample", "ms without any", "fixed cost in samples", "R²"]
    return table(head, body), table(fit_head, fits)


def row_table(results: Sequence[Mapping[str, Any]]) -> str:
    """Every row: published, ours."""
    head = ["figure", "subject", "eq.", "n", "published", "displayed", "linear",
            "≤ white", "≤ white, linear", "best bias", "truth"]  # fmt: skip
    body = []
    for r in results:
        cells = [f"{r[m]:.1f}" for m in ("display", "linear", "clipped", "clipped_linear")]
        bias = f"{r['biased']:.1f} ({r['best_bias']:g})"
        truth = f"{r['truth_display']:.0f}, {r['truth']:.0f}"
        first = [r["figure"], r["subject"], r["estimator"], r["printed"], f"{r['published']:.2f}"]
        body.append([*first, *cells, bias, truth])
    return table(head, body)


def material_table() -> str:
    """Which material stands for which subject, and where it comes from."""
    body = []
    for name in MATERIALS:
        subjects = ", ".join(dict.fromkeys(r.subject for r in ROWS if r.material == name))
        origin, why = ("chosen for this page", OWN[name][1]) if name in OWN else describe(name)
        note = why if name in OWN else ("" if origin == "chosen by us" else why.split(":")[0])
        body.append([subjects, f"`{name}`", origin, note])
    return table(["subject", "material", "", ""], body)


def order_table(found: Sequence[Mapping[str, Any]]) -> str:
    """Every gain [dB]; what goes the other way is bold."""
    columns = ("published", *MEASURES)
    body = []
    for pair in found:
        cells = [f"{pair[m]:+.1f}" if pair[m] >= 0 else f"**{pair[m]:+.2f}**" for m in columns]
        body.append([pair["pair"], pair["claim"], *cells])
    return table(["pair", "claim", "published", *(NAMES[m] for m in MEASURES)], body)


def rank_correlation(results: Sequence[Mapping[str, Any]], measure: str) -> float:
    """Spearman's coefficient between the published figures and ours."""
    ranks = [np.argsort(np.argsort([r[k] for r in results])) for k in ("published", measure)]
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])


def fill(page: pathlib.Path, tables: Mapping[str, str]) -> None:
    """Put the tables between their marks in the page."""
    text = page.read_text(encoding="utf-8")
    for name, content in tables.items():
        mark = re.compile(rf"(<!-- {name} -->\n).*?(\n<!-- end -->)", re.S)
        text, count = mark.subn(lambda m, c=content: m[1] + c + m[2], text)  # type: ignore[misc]
        if count != 1:
            raise SystemExit(f"{page}: has no place for the table {name!r}")
    partial = page.with_name(page.name + ".part")
    partial.write_text(text, encoding="utf-8")
    partial.replace(page)


def strip(place: Place, samples: int) -> npt.NDArray[np.float32]:
    """Real time, truth and ``GAIN`` times their displayed difference for Figs. 4.39 to 4.41."""
    columns = []
    for name in dict.fromkeys(r.material for r in ROWS if "4.39" <= r.figure < "4.42"):
        count = max(r.samples for r in ROWS if r.material == name and r.figure < "4.42")
        value = place.picture(name, place.lobes(name, "4.25", count))
        exact = place.picture(name, place.truth(name, samples)[0])
        apart = GAIN * np.abs(display(value) - display(exact))
        linear = np.where(apart <= 0.04045, apart / 12.92, ((apart + 0.055) / 1.055) ** 2.4)
        h, w = value.shape[:2]
        size = 7 * h // 8
        top, left = (h - size) // 2, (w - size) // 2
        cut = np.s_[top : top + size, left : left + size]
        columns.append(np.concatenate([value[cut], exact[cut], linear[cut]]))
    return np.concatenate(columns, axis=1).astype(np.float32)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--page", type=pathlib.Path, help="fill the tables of this page")
    parser.add_argument("--picture", metavar="P.png", help="real time, truth, difference")
    args = parser.parse_args()
    pixels, samples, screen = (24, 64, (64, 36)) if args.quick else (96, 1024, (640, 360))
    place = Place(pixels, coarse=args.quick)
    times = clock(place, 1 if args.quick else args.rounds, screen)
    results = []
    for row in ROWS:
        results.append(measure(place, row, samples))
        print(f"{row.figure} {row.subject}", file=sys.stderr)
    found = orders(results)
    against, fits = time_tables(times)
    head = ["material", "width", *(f"n = {n}" for n in SWEEP)]
    tables = {
        "materials": material_table(),
        "rows": row_table(results),
        "orders": order_table(found),
        "ranks": table(
            ["measure", "rank correlation"],
            [[NAMES[m], f"{rank_correlation(results, m):.2f}"] for m in MEASURES],
        ),
        "sweep": table(head, sweep(place, samples)),
        "times": against,
        "fits": fits,
    }
    print("\n\n".join(tables.values()))
    if args.page:
        fill(args.page, tables)
    if args.picture:
        write_image(args.picture, strip(place, samples))
    write(args.json, "thesis", {"rows": results, "orders": found, "times": times})


if __name__ == "__main__":
    main()
