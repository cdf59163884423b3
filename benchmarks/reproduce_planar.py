"""The thesis's figures of planar reflectors again, on the floor of our hall: pictures, PSNR, time.

Figs. 4.32, 4.34, 4.35, 4.45 and 4.46 with the floor of the built-in ``hall`` in four materials. The
thesis compares a few samples with the converged buffer alone; here both are compared with rays cast
into the scene too. Then Table 4.2: time against samples, and the line through it. Writes tables of
docs/planar.md and its pictures.

    python benchmarks/reproduce_planar.py [--page docs/planar.md] [--pictures docs/images]
"""

import dataclasses
import functools
import pathlib
import statistics
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from common import arguments, interleaved, table, write
from planar_place import Array, Place
from reproduce_thesis import display, fill, line

import glossy
from glossy.image_write import write_image
from glossy.planar import build_levels, mirror_pass, shade_planar

MATERIALS = {
    "polished floor": (glossy.Lobe(0.02, r0=0.22, alpha=0.5), True),
    "metal floor": (glossy.Lobe(0.08, r0=(0.62, 0.61, 0.58), alpha=0.5), False),
    "anisotropic": (glossy.Lobe(0.02, 0.1, r0=(0.62, 0.61, 0.58), alpha=0.5), False),
    "Alanod aluminium": (glossy.material("alanod-2000gs").reflection[0], False),
}  # lobe, and whether the floor's diffuse term is seen
TABLE_4_2 = {
    3: (47, 80), 5: (39, 69), 7: (33, 58), 9: (28, 50), 11: (25, 45), 13: (22, 40), 15: (20, 36),
    17: (18, 33), 19: (17, 31),
}  # samples: frames a second, full and half screen  # fmt: skip
GAIN = 5.0
MARGIN = 0.5  # picture heights that a wider mirror pass shows on every side


@dataclasses.dataclass(frozen=True)
class Row:
    """A picture: ``published`` PSNR to the converged buffer [dB], if there is one."""

    figure: str
    subject: str
    samples: int
    published: float | None = None
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def note(self) -> str:
        """Options that differ from the method's own."""
        return ", ".join(f"{k} {v}" for k, v in self.options.items())


UNFILTERED = {"level": "none"}
ROWS = (
    Row("4.34a", "metal floor", 10, options={"kind": "ring", **UNFILTERED}),
    Row("4.34b", "metal floor", 10, options={"kind": "multi-ring", **UNFILTERED}),
    Row("4.35a", "polished floor", 16),
    Row("4.35b", "Alanod aluminium", 16),
    Row("4.45a", "polished floor", 5, 46.65),
    Row("4.45b", "polished floor", 13, 49.73),
    Row("4.45d", "metal floor", 10, 37.15),
    Row("4.45e", "metal floor", 19, 39.68),
    Row("4.45g", "anisotropic", 10, 37.24),
    Row("4.45h", "anisotropic", 19, 40.08),
    Row("4.46a", "Alanod aluminium", 19),
)


class Gallery:
    """The floor in every material: converged buffer, truth, real time."""

    def __init__(self, place: Place, samples: int) -> None:
        self.place, self.samples = place, samples

    def base(self, subject: str) -> Array:
        """What of the floor's radiance (K, 3) is diffuse."""
        value = self.place.diffuse()
        return value if MATERIALS[subject][1] else np.zeros_like(value)

    def material(self, subject: str) -> glossy.Material:
        """The floor's lobes."""
        return glossy.Material(reflection=[MATERIALS[subject][0]])

    def converged(
        self, subject: str, planes: str = "averaged", margin: float = 0.0, white: bool = False
    ) -> tuple[Array, Array]:
        """Radiance and standard error (K, 3) of the converged buffer."""
        material = self.material(subject)
        state = self.place.converged(material, self.samples, margin, white, planes=planes)
        return state.radiance, state.error

    def truth(self, subject: str) -> tuple[Array, Array]:
        """Radiance and standard error (K, 3) by rays."""
        return self.place.truth(self.material(subject), self.samples)

    def shown(self, row: Row, margin: float = 0.0, white: bool = False) -> Array:
        """Radiance (K, 3) in real time."""
        material, options = self.material(row.subject), dict(row.options)
        return self.place.real_time(material, margin, white, samples=row.samples, **options)

    def picture(self, subject: str, lobes: Array) -> Array:
        """(H, W, 3) of the lower part of the view, where the floor is."""
        image = self.place.picture(lobes, diffuse=MATERIALS[subject][1])
        return image[3 * len(image) // 10 :]


def measure(gallery: Gallery, row: Row) -> dict[str, Any]:
    """PSNR [dB] over the floor's pixels: displayed, and linear with peak 1."""
    base, value = gallery.base(row.subject), gallery.shown(row)
    found: dict[str, Any] = {"row": dataclasses.asdict(row)}
    exact, noise = gallery.truth(row.subject)
    for name, other in (("converged", gallery.converged(row.subject)[0]), ("truth", exact)):
        found[name] = glossy.psnr(display(base + value), display(base + other))
        found[f"{name}, linear"] = glossy.psnr(base + value, base + other)
    dim, flat = gallery.shown(row, white=True), gallery.converged(row.subject, white=True)[0]
    found["white"] = glossy.psnr(display(base + dim), display(base + flat))
    wide = gallery.shown(row, MARGIN)
    found["margin"] = glossy.psnr(display(base + wide), display(base + exact))
    found["margin, linear"] = glossy.psnr(base + wide, base + exact)
    found["± truth"] = glossy.psnr(display(base + exact + noise), display(base + exact))
    return found


def row_table(results: Sequence[Mapping[str, Any]]) -> str:
    """Every picture: published, ours to the converged buffer, ours to the truth."""
    head = ["figure", "subject", "n", "", "published", "to converged", "linear", "≤ white",
            "to truth", "linear", "with margin", "linear", "± truth"]  # fmt: skip
    body = []
    for row, found in zip(ROWS, results, strict=True):
        printed = "" if row.published is None else f"{row.published:.2f}"
        figures = ("converged", "converged, linear", "white", "truth", "truth, linear", "margin",
                   "margin, linear", "± truth")  # fmt: skip
        cells = [f"{found[name]:.1f}" for name in figures]
        body.append([row.figure, row.subject, row.samples, row.note, printed, *cells])
    return table(head, body)


def limits(gallery: Gallery) -> list[dict[str, Any]]:
    """PSNR of the converged buffer to the truth (Figs. 4.32, 4.45 right, 4.46b)."""
    rows = []
    for subject in MATERIALS:
        base, (exact, _) = gallery.base(subject), gallery.truth(subject)
        found: dict[str, Any] = {"subject": subject}
        runs = {"averaged": ("averaged", 0.0), "own": ("own", 0.0), "wide": ("averaged", MARGIN)}
        for name, run in runs.items():
            value, error = gallery.converged(subject, *run)
            found[name] = glossy.psnr(display(base + value), display(base + exact))
            found[f"{name}, linear"] = glossy.psnr(base + value, base + exact)
            found[f"± {name}"] = glossy.psnr(display(base + value + error), display(base + value))
        one, other = (gallery.converged(subject, p)[0] for p in ("averaged", "own"))
        found["apart"] = glossy.psnr(display(base + one), display(base + other))
        rows.append(found)
    return rows


def limit_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """``limits`` as text."""
    names = ("averaged", "averaged, linear", "own", "own, linear", "wide", "wide, linear",
             "apart", "± averaged")  # fmt: skip
    head = ["subject", "averaged planes", "linear", "own planes", "linear",
            "averaged, margin", "linear", "averaged to own", "±"]  # fmt: skip
    return table(head, [[r["subject"], *(f"{r[n]:.1f}" for n in names)] for r in rows])


def clock(place: Place, rounds: int, size: tuple[int, int]) -> dict[str, Any]:
    """CPU seconds of a screen full, or half full, of the floor against samples."""
    eye, target = (0.0, 1.65, 1.0), (0.0, 0.0, -0.9)
    camera = glossy.Camera(eye, target, fov=46.0, width=size[0], height=size[1])
    rays = camera.rays()
    away = -camera.position[1] / rays[..., 1:2]
    position = np.asarray(camera.position) + away * rays
    up, side = (np.broadcast_to(v, rays.shape) for v in ([0.0, 1.0, 0.0], [1.0, 0.0, 0.0]))
    part = dataclasses.replace(place.part, camera=camera)
    buffer = mirror_pass(place.prepared, part)
    material = glossy.Material(reflection=[MATERIALS["metal floor"][0]])
    half = np.broadcast_to(np.arange(size[0]) < size[0] // 2, rays.shape[:2])
    points = {
        "full": glossy.SurfacePoints(up, side, -rays, position=position),
        "half": glossy.SurfacePoints(up, side, -rays, position=position, mask=half),
    }

    def run(screen: str, n: int) -> None:
        shade_planar(points[screen], material, buffer, samples=n, fallback=place.spare())

    contenders: dict[str, Any] = {
        f"{screen} {n}": functools.partial(run, screen, n) for screen in points for n in TABLE_4_2
    }
    contenders["mirror pass"] = lambda: mirror_pass(place.prepared, part)
    contenders["pyramid"] = lambda: build_levels(buffer.radiance, buffer.covered)
    times = interleaved(contenders, rounds)
    found: dict[str, Any] = {
        screen: {n: statistics.median(times[f"{screen} {n}"]) for n in TABLE_4_2}
        for screen in points
    }
    for name in ("mirror pass", "pyramid"):
        found[name] = statistics.median(times[name])
    return found


def time_tables(measured: Mapping[str, Any]) -> tuple[str, str]:
    """Times relative to 19 samples on a full screen beside the published, and the fitted lines."""
    published = {
        screen: {n: 1.0 / fps[k] for n, fps in TABLE_4_2.items()}
        for k, screen in enumerate(("full", "half"))
    }
    sources: dict[str, Mapping[str, Any]] = {"published": published, "ours": measured}
    body = []
    for n in TABLE_4_2:
        cells = [
            f"{s[k][n] / s['full'][19]:.2f}" for k in ("full", "half") for s in sources.values()
        ]
        body.append([n, *cells])
    whole = measured["full"][19]
    for name in ("mirror pass", "pyramid"):
        body.append([name, "", f"{measured[name] / whole:.2f}", "", ""])
    head = ["samples", "full, published", "full, ours", "half, published", "half, ours"]
    fits = []
    for name, source in sources.items():
        for screen in ("full", "half"):
            values = source[screen]
            slope, start, r2 = line(list(values), list(values.values()))
            fits.append([f"{name}, {screen}", f"{start / slope:.1f}", f"{r2:.4f}"])
            if name == "ours":
                start += measured["mirror pass"] + measured["pyramid"]
                fits.append([f"with pass and pyramid, {screen}", f"{start / slope:.1f}", ""])
    return table(head, body), table(["", "fixed cost in samples", "R²"], fits)


def linear(shown: Array) -> Array:
    """Radiance whose displayed value is ``shown``, for differences of displayed pixels."""
    return np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)


def side_by_side(rows: Sequence[Sequence[Array]]) -> Array:
    """One picture of many, with a narrow gap."""

    def gap(images: Sequence[Array], axis: int) -> Array:
        shape = list(images[0].shape)
        shape[axis] = 2
        between = np.ones(shape)
        pieces = [piece for image in images for piece in (between, image)][1:]
        return np.concatenate(pieces, axis=axis)

    return gap([gap(row, 1) for row in rows], 0)


def detail(image: Array) -> Array:
    """The left part of a picture, every pixel twice as large."""
    cut = image[:, : 5 * image.shape[1] // 8]
    return np.repeat(np.repeat(cut, 2, axis=0), 2, axis=1)


def pictures(gallery: Gallery) -> dict[str, Array]:
    """The pictures of the page by name.

    ``planar``: real time, converged buffer, truth, difference of the first and the third;
    ``planar-rings``: Fig. 4.34, then converged buffer and truth; ``planar-averaged``: Fig. 4.46:
    real time, converged with own and with averaged planes, truth.
    """
    best = {
        s: max((r for r in ROWS if r.subject == s and not r.options), key=lambda r: r.samples)
        for s in MATERIALS
    }
    rows = []
    for subject, row in best.items():
        lobes = [gallery.shown(row), gallery.converged(subject)[0], gallery.truth(subject)[0]]
        images = [gallery.picture(subject, value) for value in lobes]
        apart = GAIN * np.abs(display(images[0]) - display(images[2]))
        rows.append([*images, linear(np.clip(apart, 0.0, 1.0))])
    metal, blurry = "metal floor", "Alanod aluminium"
    rings = [gallery.shown(row) for row in ROWS[:2]]
    rings += [gallery.converged(metal)[0], gallery.truth(metal)[0]]
    soft = [gallery.shown(best[blurry])]
    soft += [gallery.converged(blurry, planes)[0] for planes in ("own", "averaged")]
    soft += [gallery.truth(blurry)[0]]
    return {
        "planar": side_by_side(rows),
        "planar-rings": side_by_side([[detail(gallery.picture(metal, v)) for v in rings]]),
        "planar-averaged": side_by_side([[detail(gallery.picture(blurry, v)) for v in soft]]),
    }


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--page", type=pathlib.Path, help="fill the tables of this page")
    parser.add_argument("--pictures", type=pathlib.Path, help="folder for the pictures")
    args = parser.parse_args()
    height, scale, samples, screen = (18, 2.0, 64, (64, 36)) if args.quick else (
        72, 5.0, 1024, (640, 360)
    )  # fmt: skip
    place = Place(height, scale=scale, coarse=args.quick)
    gallery = Gallery(place, samples)
    times = clock(place, 1 if args.quick else args.rounds, screen)
    ends = limits(gallery)
    print("converged", file=sys.stderr)
    results = [measure(gallery, row) for row in ROWS]
    against, fits = time_tables(times)
    tables = {
        "rows": row_table(results),
        "limits": limit_table(ends),
        "times": against,
        "fits": fits,
    }
    print("\n\n".join(tables.values()))
    if args.page:
        fill(args.page, tables)
    if args.pictures:
        for name, image in pictures(gallery).items():
            write_image(args.pictures / f"{name}.png", image.astype(np.float32), exposure=0.0)
    write(args.json, "planar", {"rows": results, "limits": ends, "times": times})


if __name__ == "__main__":
    main()
