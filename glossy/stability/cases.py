"""The hard cases, as data: what the tests, the command and the documentation all go by.

A ``ShadeCase`` is a real-time method under stress, in single precision by both kernels, in double
precision, and by a twin in extended precision. Its error is relative to each value (``by`` =
"value"), or to the brightest one where neighbouring texels differ by many powers of ten: there a
dark pixel beside a bright texel magnifies the rounding of the direction, not of the method.
Views are cosines above the horizon; each is taken at ``AZIMUTHS`` azimuths. "axes" is a frame along
the world's axes, in which float32 represents normal, tangent and view without rounding; in a
"turned" frame their rounding alone moves the cosine wo.n by some 1e-7.
"""

import dataclasses
import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ..brdf import Lobe, Material
from ..cubemap import CubeMap, texel_directions
from ..frames import normalise

Float64Array = npt.NDArray[np.float64]

AZIMUTHS = 12
COSINES = (1.0, 0.1, 1e-2, 1e-4, 1e-6)
WIDTHS = ((1e-4, 1e-4), (1e-2, 1e-2), (0.15, 0.15), (2.0, 2.0), (1.0, 1e-3), (1e-4, 0.1))
METHODS = ("regular", "importance", "thesis")

SINGLE = 3e-6
"""Relative error of float32 where its input is exact: some fifty operations at 6e-8."""
INPUT = 2e-7
"""Rounding of normal, tangent and view to float32 as it shows in wo.n; over it in a pixel."""
DOUBLE = 1e-12
"""Relative error of float64, by the extended twin."""
DOUBLE_INPUT = 4e-16
"""``INPUT`` in double precision."""
LATTICE = 1e-5
"""``SINGLE`` of the lattice: axes of a lobe hang on differences of its variances."""
POLE = 3e-3
"""Of a long lobe seen along the normal in a turned frame: rounding decides the azimuth at which the
lattice reads its table of reflectivities, which errs by so much from azimuth to azimuth."""


@dataclasses.dataclass(frozen=True)
class ShadeCase:
    """One hard case of a real-time method; ``single``, ``double`` are the errors admitted."""

    group: str
    name: str
    lobe: Lobe
    cosines: tuple[float, ...] = (1.0, 0.5, 0.1)
    frame: str = "axes"
    transmission: bool = False
    map: str = "smooth"
    size: int = 32
    method: str = "regular"
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    by: str = "value"
    single: float = SINGLE
    double: float = DOUBLE

    @property
    def material(self) -> Material:
        """The lobe as a material of its side."""
        if self.transmission:
            return Material(transmission=[self.lobe])
        return Material(reflection=[self.lobe])


def make_map(name: str, size: int) -> CubeMap:
    """The maps of the cases, (6, N, N, 3)."""
    rng = np.random.default_rng(7)
    d = normalise(texel_directions(size))
    if name == "smooth":
        red, green = 1.0 + 0.9 * d[..., 0], 1.5 + d[..., 1] * d[..., 2]
        return CubeMap(np.stack([red, green, 0.1 + d[..., 2] ** 2], -1))
    if name == "noise":
        return CubeMap(rng.random((6, size, size, 3)))
    if name == "wide":
        return CubeMap(10.0 ** rng.uniform(-30.0, 30.0, (6, size, size, 3)))
    faces = np.full((6, size, size, 3), 0.0 if name in ("black", "hot") else float(name))
    if name == "hot":
        faces[2, size // 3, size // 4] = 1e6
    return CubeMap(faces)


def _views() -> list[ShadeCase]:
    found = []
    for frame, transmission in itertools.product(("axes", "turned"), (False, True)):
        for cosine, alpha in itertools.product(COSINES, (0.0, 0.5, 1.0)):
            turned = frame == "turned"
            side = "transmission" if transmission else "reflection"
            for m in WIDTHS[:4] if alpha != 0.5 else WIDTHS:
                found.append(
                    ShadeCase(
                        f"{side}, frame {frame}",
                        f"wo.n = {cosine:g}, m = {m[0]:g} {m[1]:g}, alpha = {alpha:g}",
                        Lobe(*m, r0=0.2, alpha=alpha),
                        (cosine,),
                        frame,
                        transmission,
                        method="importance" if m[0] != m[1] else "regular",
                        single=SINGLE + (INPUT / cosine if turned else 0.0),
                        double=DOUBLE + (DOUBLE_INPUT / cosine if turned else 0.0),
                    )
                )
    return found


def _lobes() -> list[ShadeCase]:
    found = []
    for method, r0, m in itertools.product(
        ("regular", "importance", "thesis"),
        (0.0, 1.0),
        ((1.0, 1e-3), (2e-3, 2.0), (1e-4, 1e-4), (2.0, 2.0)),
    ):
        for transmission in (False, True):
            side = "transmission" if transmission else "reflection"
            name = f"{method}, {side}, r0 = {r0:g}, m = {m[0]:g} {m[1]:g}"
            lobe = Lobe(*m, r0=r0)
            views = (0.5, 0.1) if r0 == 0.0 else (1.0, 0.5, 0.1)
            found.append(
                ShadeCase("widths and r0", name, lobe, views, "axes", transmission, method=method)
            )
    return found


def _cut() -> list[ShadeCase]:
    return [
        ShadeCase(
            "threshold and footprint",
            f"{footprint}, threshold {threshold:g}, m = {m:g}",
            Lobe(m),
            frame="turned",
            single=SINGLE + INPUT / 0.1,
            options={"threshold": threshold, "footprint": footprint},
        )
        for footprint, threshold, m in itertools.product(
            ("paper", "thesis", "jacobian"), (1e-6, 0.01, 0.5, 0.99), (1e-4, 0.5, 2.0)
        )
    ]


def _counts() -> list[ShadeCase]:
    return [
        ShadeCase(
            "samples",
            f"{method}, {count} samples",
            Lobe(0.3),
            method=method,
            options={"samples": count},
            single=SINGLE * max(1.0, count / (250.0 if method == "thesis" else 500.0)),  # two sums
        )
        for method, count in itertools.product(METHODS, (1, 7, 100, 1000, 10_000))
    ]


def _estimators() -> list[ShadeCase]:
    """Other normalisations and estimators at grazing views, with and without F and alpha."""
    found = []
    for cosine, m, (r0, alpha), transmission in itertools.product(
        (1.0, 0.1, 1e-4, 1e-6),
        ((1e-4, 1e-4), (0.15, 0.15), (2.0, 2.0), (1.0, 1e-3)),
        ((1.0, 0.0), (0.2, 1.0)),
        (False, True),
    ):
        kinds: dict[str, tuple[str, dict[str, Any]]] = {
            "projected": ("regular", {"normalisation": "projected"})
        }
        kinds |= {e: ("thesis", {"estimator": e}) for e in ("4.23", "4.24", "4.25")}
        for kind, (method, options) in kinds.items():
            found.append(
                ShadeCase(
                    f"{method}, {kind}",
                    f"wo.n = {cosine:g}, m = {m[0]:g} {m[1]:g}, r0 = {r0:g}, alpha = {alpha:g}"
                    + (", transmission" if transmission else ""),
                    Lobe(*m, r0=r0, alpha=alpha),
                    (cosine,),
                    transmission=transmission,
                    method=method,
                    options=options,
                )
            )
    return found


def _maps() -> list[ShadeCase]:
    found = []
    for name in ("wide", "hot", "black", "1", "1e-30", "1e30", "3e38", "noise"):
        for m in (1e-3, 0.05, 0.5):
            by = "peak" if name in ("wide", "hot", "noise") else "value"
            lobe = Lobe(m)
            found.append(
                ShadeCase(
                    "radiance",
                    f"map {name}, m = {m:g}",
                    lobe,
                    map=name,
                    by=by,
                    frame="turned",
                    single=SINGLE + INPUT / 0.1,
                )
            )
            mean = dataclasses.replace(found[-1], name=f"thesis, {found[-1].name}", method="thesis")
            found.append(mean)
    for size, level in itertools.product((1, 2, 64), (-1e30, -50.0, 0.0, 50.0, 1e30)):
        name = f"N = {size}, level bias {level:g}"
        options = {"bias": level}
        found.append(
            ShadeCase(
                "sizes and levels",
                name,
                Lobe(0.1),
                map="noise",
                size=size,
                options=options,
                by="peak",
                frame="turned",
                single=SINGLE + INPUT / 0.1,
            )
        )
    return found


LATTICE_LOBES = (
    *(Lobe(m, r0=0.2, alpha=alpha) for m, alpha in ((1e-4, 0.0), (0.15, 0.5), (2.0, 1.0))),
    Lobe(1.0, 1e-3, r0=0.2),
    Lobe(1e-4, 0.1, r0=0.2, alpha=1.0),
)


def _lattice() -> list[ShadeCase]:
    found = []
    for lobe, cosine, (frame, transmission) in itertools.product(
        LATTICE_LOBES, COSINES, (("axes", False), ("axes", True), ("turned", False))
    ):
        m, turned = lobe.widths, frame == "turned"
        side = "transmission" if transmission else "reflection"
        single = LATTICE + (INPUT / cosine if turned else 0.0)
        found.append(
            ShadeCase(
                "lattice",
                f"{side}, frame {frame}, wo.n = {cosine:g}, m = {m[0]:g} {m[1]:g}",
                lobe,
                (cosine,),
                frame,
                transmission,
                method="lattice",
                single=single + (POLE if turned and cosine == 1.0 and m[0] != m[1] else 0.0),
                double=DOUBLE + (DOUBLE_INPUT / cosine if turned else 0.0),
            )
        )
    limit = LATTICE + INPUT / 0.1
    base = ShadeCase("lattice", "", Lobe(0.1), frame="turned", method="lattice", single=limit)
    for count in (1, 2, 7, 32, 64):
        own = {"samples": count}
        found.append(dataclasses.replace(base, name=f"{count} samples", options=own))
    for name in ("wide", "hot", "black", "1e-30", "1e30", "noise"):
        by = "peak" if name in ("wide", "hot", "noise") else "value"
        found.append(dataclasses.replace(base, name=f"map {name}", map=name, by=by))
    for size, bias in itertools.product((1, 2, 64), (-1e30, 0.0, 50.0)):
        name, biased = f"N = {size}, level bias {bias:g}", {"bias": float(bias)}
        fields: dict[str, Any] = {"map": "noise", "size": size, "options": biased, "by": "peak"}
        found.append(dataclasses.replace(base, name=name, **fields))
    return found


SHADE = tuple(
    case
    for part in (_views, _lobes, _cut, _counts, _estimators, _maps, _lattice)
    for case in part()
)

EVAL_WIDTHS = ((1e-4, 1e-4), (1e-2, 1e-2), (0.15, 0.15), (2.0, 2.0), (1.0, 1e-3))
ALPHAS = (0.0, 0.3, 0.5, 1.0)


def pairs() -> dict[str, tuple[Float64Array, Float64Array]]:
    """Named hard pairs of wi, wo, (k, 3) each, for the BSDF itself."""
    rng = np.random.default_rng(3)
    z = np.concatenate([10.0 ** rng.uniform(-6.0, 0.0, 200), [1.0, 1e-6]])
    phi = rng.uniform(0.0, 2.0 * np.pi, len(z))
    wo = np.stack([np.sqrt(1.0 - z * z) * np.cos(phi), np.sqrt(1.0 - z * z) * np.sin(phi), z], -1)
    mirror = wo * [-1.0, -1.0, 1.0]
    near = normalise(mirror + 1e-3 * z[:, None] * rng.normal(size=wo.shape))
    return {
        "wh at the pole": (mirror, wo),
        "wh near the pole": (near, wo),
        "wh at the equator": (wo * [1.0, 1.0, -1.0], wo),
        "wi = wo": (wo, wo),
        "wi = -wo": (-wo, wo),
        "any": (rng.permutation(wo), wo),
    }


def directions() -> Float64Array:
    """Lookup directions (k, 3): axes, edges, corners, ties, and lengths from denormal to huge."""
    grid = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)))
    grid = grid[grid.any(axis=1)]
    nudged = np.concatenate([grid * (1.0 + s * np.array([1e-7, 0.0, -1e-7])) for s in (-1, 1)])
    rng = np.random.default_rng(5)
    base = np.concatenate([grid, nudged, rng.normal(size=(100, 3))])
    return np.concatenate([base * scale for scale in (1.0, 1e-44, 1e-38, 1e-20, 1e20, 1e38 / 4)])


LEVELS = (-np.inf, -1.0, 0.0, 0.5, 1.0 - 1e-7, 3.0, 100.0, np.inf)

TRUTH = tuple(
    (m, cosine, alpha)
    for m in ((1e-4, 1e-4), (1e-4, 0.1), (1.0, 1e-3), (0.15, 0.15), (2.0, 2.0))
    for cosine, alpha in ((1.0, 0.0), (0.05, 0.0), (1e-6, 0.0), (1e-6, 0.5))
)
"""Widths, cosine and alpha for the ground truth on a map of noise, N = 16."""

FURNACE_WIDTHS = (0.01, 0.05, 0.15, 0.3, 0.5, 1.0)
FURNACE_ANGLES = (0.0, 30.0, 60.0, 80.0, 89.0)
FURNACE_METHODS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "regular/paper": ("regular", {"samples": 30}),
    "regular/projected": ("regular", {"samples": 30, "normalisation": "projected"}),
    "importance": ("importance", {"samples": 30}),
    "thesis/4.23": ("thesis", {"samples": 7, "estimator": "4.23"}),
    "thesis/4.24": ("thesis", {"samples": 7, "estimator": "4.24"}),
    "thesis/4.25": ("thesis", {"samples": 7, "estimator": "4.25"}),
    "lattice": ("lattice", {"samples": 14}),
}
