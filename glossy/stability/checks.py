"""What is measured for each hard case, and whether what is guaranteed held.

Guaranteed everywhere: finite, not negative, errors within the stated limits, and for alpha = 0 no
pixel brighter than the brightest texel times ks times the sum of the pattern's weights, or times 2
for the thesis's means. For alpha > 0 the model may send out more than it receives; its albedo is
reported.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from .._threads import using
from ..brdf import Lobe, Material
from ..cubemap import CubeMap, face_directions
from ..frames import SurfacePoints, normalise, to_world
from ..pyramid import Pyramid, build_pyramid
from ..reference import reference
from ..shading import TABLES, shade
from . import cases, twin
from .cases import ShadeCase

FloatArray = npt.NDArray[np.floating]
Float64Array = npt.NDArray[np.float64]

WORK = 100_000  # evaluations of the truth per point, 1/20 of the default
LARGE = 4096  # texels along an edge of the largest map
ROUNDED = 1e-5  # room of the energy bound for float32
EVAL_DOUBLE = 1e-9  # of f, relative
EVAL_NEAR = (
    1e-5  # the same beside the peak: directions hold 2e-16, the lobe is m (wo.n) = 1e-10 wide
)
REFLECTIVITY = {"r0 = 1": 5e-3, "r0 = 0.04": 1e-2}  # of the lattice's table, relative
LOOKUP_SINGLE = 1e-6  # of the largest texel, times N: the place in the face rounds to 6e-8 N texels


@dataclasses.dataclass(frozen=True)
class Result:
    """One case: what was measured, the limit of each figure that has one, what did not hold."""

    group: str
    name: str
    measured: dict[str, float]
    limits: dict[str, float]
    broken: tuple[str, ...]

    @property
    def holds(self) -> bool:
        """Whether every guarantee held."""
        return not self.broken


def judge(
    group: str,
    name: str,
    measured: dict[str, float],
    limits: dict[str, float],
    facts: dict[str, bool] | None = None,
) -> Result:
    """Compare figures with their limits; ``facts`` are guarantees without a figure."""
    broken = [f"{k} = {measured[k]:.3g} > {limits[k]:.3g}" for k in limits
              if not measured[k] <= limits[k]]  # fmt: skip
    broken += [k for k, held in (facts or {}).items() if not held]
    return Result(group, name, measured, limits, tuple(broken))


def deviation(value: FloatArray, exact: FloatArray, by: str = "value") -> float:
    """Largest error relative to each exact value, or to the largest of all."""
    gap = np.abs(np.asarray(value, np.float64) - exact)
    size = np.abs(exact) if by == "value" else np.full_like(gap, np.abs(exact).max(initial=0.0))
    return float(np.where(gap > 0.0, gap / np.maximum(size, 1e-300), 0.0).max(initial=0.0))


@functools.lru_cache(maxsize=16)
def _pyramid(name: str, size: int) -> Pyramid:
    return build_pyramid(cases.make_map(name, size))


def points_of(cosines: tuple[float, ...], frame: str, seed: int = 1) -> SurfacePoints:
    """Views at each cosine and ``AZIMUTHS`` azimuths, (K,)."""
    phi = (np.arange(cases.AZIMUTHS) + 0.3) * (2.0 * math.pi / cases.AZIMUTHS)
    z = np.repeat(cosines, len(phi))
    phi = np.tile(phi, len(cosines))
    s = np.sqrt((1.0 - z) * (1.0 + z))
    local = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)
    if frame == "axes":
        normal = np.broadcast_to([0.0, 0.0, 1.0], local.shape)
        tangent = np.broadcast_to([1.0, 0.0, 0.0], local.shape)
    else:
        rng = np.random.default_rng(seed)
        normal = normalise(rng.normal(size=local.shape))
        tangent = normalise(np.cross(normal, rng.normal(size=local.shape)))
    return SurfacePoints(normal, tangent, to_world(local, tangent, normal))


@using(1)  # a few dozen points: waking another thread takes longer than their work
def check_shade(case: ShadeCase) -> Result:
    """Both kernels in single precision against double, double against the extended twin."""
    pyramid = _pyramid(case.map, case.size)
    points = points_of(case.cosines, case.frame)
    options = dict(case.options)
    double = shade(points, case.material, pyramid, case.method, "double", **options)
    exact = twin.shade(points, case.material, pyramid, case.method, **options)
    single = {
        kernel: shade(points, case.material, pyramid, case.method, kernel=kernel, **options)
        for kernel in ("plain", "auto")
    }
    measured = {k: deviation(v, double, case.by) for k, v in single.items()}
    measured["double"] = deviation(double, exact, case.by)
    limits = {"plain": case.single, "auto": case.single, "double": case.double}
    all_ = (double, *single.values())
    facts = {
        "finite": all(bool(np.isfinite(v).all()) for v in all_),
        "not negative": all(bool((v >= 0.0).all()) for v in all_),
    }
    if case.lobe.alpha == 0.0:
        weights = 1.0 if case.method == "lattice" else 2.0  # a mean times R; see ``thesis``
        if case.method in TABLES:
            weights = float(TABLES[case.method](case.material, pyramid, **options).taps[:, 3].sum())
        weights *= float(np.max(case.lobe.ks))
        largest = max(float(v.max()) for v in all_)
        most = weights * float(np.max(pyramid.levels[0])) * (1.0 + ROUNDED)
        facts["energy"] = largest <= most
    return judge(case.group, case.name, measured, limits, facts)


def check_reflectivity() -> Iterator[Result]:
    """The lattice in a white map against the albedo: what reading its table costs."""
    white = _pyramid("1", 1)
    z = np.repeat([1.0, 0.98, 0.1, 1e-3], cases.AZIMUTHS)
    phi = np.tile(np.arctan(10.0 ** np.linspace(-3.0, 3.0, cases.AZIMUTHS)), 4)  # towards both axes
    s = np.sqrt((1.0 - z) * (1.0 + z))
    local = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)
    normal, tangent = (np.broadcast_to(axis, local.shape) for axis in np.eye(3)[[2, 0]])
    points = SurfacePoints(normal, tangent, local)
    for lobe in cases.LATTICE_LOBES:
        material = Material(reflection=[dataclasses.replace(lobe, r0=(1.0, 1.0, 0.04))])
        value = shade(points, material, white, "lattice", "double", samples=1)
        albedo = material.albedo(local)[0]
        measured = {"r0 = 1": deviation(value[:, 0], albedo[:, 0]),
                    "r0 = 0.04": deviation(value[:, 2], albedo[:, 2])}  # fmt: skip
        m = lobe.widths
        name = f"m = {m[0]:g} {m[1]:g}, alpha = {lobe.alpha:g}"
        yield judge("lattice's reflectivity", name, measured, REFLECTIVITY)


def check_eval() -> Iterator[Result]:
    """The BSDF against its equations in extended precision."""
    for name, (wi, wo) in cases.pairs().items():
        for transmitted in (False, True):
            worst, facts = 0.0, {"finite": True, "not negative": True, "reciprocal": True}
            for m in cases.EVAL_WIDTHS:
                for alpha in cases.ALPHAS:
                    for r0 in (0.0, 1.0):
                        lobe = Lobe(*m, r0=r0, alpha=alpha)
                        material = _sided(lobe, transmitted)
                        i = wi * [1.0, 1.0, -1.0 if transmitted else 1.0]
                        values = [material.eval(i, wo, p) for p in ("double", "single")]
                        exact = np.asarray(twin.lobe_value(i, wo, lobe, transmitted), np.float64)
                        # where the exponent is large, the slopes' rounding is magnified by it
                        peak = 1.0 / (math.pi * m[0] * m[1])
                        use = exact > 1e-12 * peak
                        worst = max(worst, deviation(values[0][use], exact[use]))
                        facts["finite"] &= all(bool(np.isfinite(v).all()) for v in values)
                        facts["not negative"] &= all(bool((v >= 0.0).all()) for v in values)
                        if not transmitted:
                            back = material.eval(wo, i)
                            facts["reciprocal"] &= bool(np.array_equal(back, values[0])) or (
                                deviation(back[use], values[0][use]) < EVAL_DOUBLE
                            )
            side = "transmission" if transmitted else "reflection"
            limit = EVAL_NEAR if name == "wh near the pole" else EVAL_DOUBLE
            yield judge("BSDF", f"{name}, {side}", {"double": worst}, {"double": limit}, facts)


def _sided(lobe: Lobe, transmitted: bool) -> Material:
    return Material(transmission=[lobe]) if transmitted else Material(reflection=[lobe])


def check_lookup(sizes: tuple[int, ...] = (1, 2, 3, 64)) -> Iterator[Result]:
    """Lookups at hard directions and levels: within the map's range, equal in both precisions."""
    d = cases.directions()
    for size in sizes:
        rng = np.random.default_rng(size)
        levels = []
        n = size
        while n >= 1:
            levels.append(rng.random((6, n, n, 3), dtype=np.float32))
            n //= 2
        pyramid = Pyramid(levels)
        for level in cases.LEVELS:
            double = pyramid.sample(d, level, precision="double")
            single = pyramid.sample(d, level)
            unit = normalise(d.astype(np.float32))
            lod = np.full(len(d), np.clip(level, 0.0, len(levels)), dtype=np.longdouble)
            exact = twin.lookup(pyramid, twin.extended(unit), lod)
            known = np.abs(d).max(axis=1) >= np.finfo(np.float32).tiny  # float32 holds its digits
            measured = {
                "single": deviation(single[known], exact[known], "peak"),
                "double": deviation(pyramid.sample(unit, level, precision="double"), exact, "peak"),
            }
            limits = {"single": LOOKUP_SINGLE * size, "double": 1e-12 * size}
            everything = np.concatenate([single, double])
            facts = {
                "finite": bool(np.isfinite(everything).all()),
                "range": bool((everything >= 0.0).all() and (everything <= 1.0 + 1e-6).all()),
            }
            yield judge("lookup", f"N = {size}, level {level:g}", measured, limits, facts)


def check_large(size: int) -> Result:
    """Hot texels in a large map of one channel: each is found where it is."""
    rng = np.random.default_rng(2)
    face, row, col = rng.integers(0, [6, size, size], (64, 3)).T
    faces = np.zeros((6, size, size, 1), dtype=np.float32)
    faces[face, row, col] = 1e6
    s, t = ((k + 0.5) * (2.0 / size) - 1.0 for k in (col, row))
    value = Pyramid([faces]).sample(face_directions(face, s, t), 0.0)[:, 0]
    single = deviation(value, np.full(64, 1e6))
    return judge("lookup", f"N = {size}, hot texels", {"single": single},
                 {"single": LOOKUP_SINGLE * size})  # fmt: skip


def check_truth() -> Iterator[Result]:
    """The deterministic truth against quasi-Monte-Carlo, and its bound at hard lobes."""
    cube = cases.make_map("noise", 16)
    for m, cosine, alpha in cases.TRUTH:
        lobe = Lobe(*m, alpha=alpha)
        points = points_of((cosine,), "turned")[:2]
        bound = reference(points, lobe, cube, samples=WORK)
        random = reference(points, lobe, cube, "qmc", samples=2048)
        gap = np.abs(bound.radiance - random.radiance) - bound.error
        sigma = np.maximum(random.error, 1e-12 * np.abs(random.radiance) + 1e-300)
        share = bound.error.sum(-1) / np.maximum(random.radiance.sum(-1), 1e-300)
        albedo = float(np.max(Material(reflection=[lobe]).albedo(points.local_view)[0]))
        measured = {
            "bound": float(share.max()),
            "sigmas beyond": float((gap / sigma).max()),
            "work": float(bound.samples.max()),
            "albedo": albedo,
        }
        values = np.stack([bound.radiance, bound.error, random.radiance, random.error])
        facts = {
            "finite": bool(np.isfinite(values).all()),
            "not negative": bool((values >= 0.0).all()),
            "albedo of alpha 0": alpha > 0.0 or albedo <= 1.0 + 1e-9,
        }
        limits = {"sigmas beyond": 6.0}
        name = f"m = {m[0]:g} {m[1]:g}, wo.n = {cosine:g}, alpha = {alpha:g}"
        yield judge("truth", name, measured, limits, facts)


def furnace() -> list[dict[str, Any]]:
    """A white map: each method and truth over the albedo, by width and view (m, degrees)."""
    cube = CubeMap(np.ones((6, 8, 8, 3)))
    pyramid = build_pyramid(cube)
    cosines = tuple(math.cos(math.radians(a)) for a in cases.FURNACE_ANGLES)
    points = points_of(cosines, "axes")[:: cases.AZIMUTHS]
    rows: list[dict[str, Any]] = []
    for m in cases.FURNACE_WIDTHS:
        lobe = Lobe(m)
        albedo = Material(reflection=[lobe]).albedo(points.local_view)[0]
        columns = {
            name: shade(points, lobe, pyramid, method, "double", **options)[:, 0]
            for name, (method, options) in cases.FURNACE_METHODS.items()
        }
        for estimator in ("texels", "mc", "qmc"):
            truth = reference(points, lobe, cube, estimator)
            columns[estimator] = truth.radiance[:, 0]
            columns[f"{estimator} error"] = truth.error[:, 0]
        for k, angle in enumerate(cases.FURNACE_ANGLES):
            ratios = {name: float(v[k] / albedo[k]) for name, v in columns.items()}
            rows.append({"m": m, "angle": angle, "albedo": float(albedo[k]), **ratios})
    return rows


def check_furnace(rows: list[dict[str, Any]]) -> Iterator[Result]:
    """The truths must give the albedo; the real-time methods are reported."""
    for row in rows:
        measured = {"texels": abs(row["texels"] - 1.0)}
        limits = {"texels": row["texels error"] + 1e-9}
        for name in ("mc", "qmc"):
            measured[name] = abs(row[name] - 1.0)
            limits[name] = 6.0 * row[f"{name} error"] + 1e-9
        yield judge("furnace", f"m = {row['m']:g}, {row['angle']:g} degrees", measured, limits)


def refusals() -> Iterator[Result]:
    """Input that cannot mean anything is one line that names it."""
    pyramid = _pyramid("smooth", 2)
    calls: dict[str, Callable[[], object]] = {
        "level NaN": lambda: pyramid.sample([1.0, 0, 0], math.nan),
        "direction zero": lambda: pyramid.sample([0.0, 0, 0], 0.0),
        "direction NaN": lambda: pyramid.sample([math.nan, 0, 1.0], 0.0),
        "direction inf": lambda: pyramid.sample([math.inf, 0, 1.0], 0.0),
        "m = 0": lambda: Lobe(0.0),
        "m NaN": lambda: Lobe(math.nan),
        "alpha = 2": lambda: Lobe(0.1, alpha=2.0),
        "r0 = 1.1": lambda: Lobe(0.1, r0=1.1),
        "view zero": lambda: SurfacePoints([0, 0, 1.0], [1.0, 0, 0], [0.0, 0, 0]),
        "radiance NaN": lambda: CubeMap(np.full((6, 1, 1, 3), math.nan)),
        "radiance negative": lambda: CubeMap(np.full((6, 1, 1, 3), -1.0)),
        "N = 0": lambda: CubeMap(np.zeros((6, 0, 0, 3))),
    }
    for name, call in calls.items():
        try:
            call()
            refused = False
        except ValueError as error:
            refused = "\n" not in str(error)
        yield judge("refused", name, {}, {}, {"refused in one line": refused})


@using(1)
def run(progress: Callable[[Any], Any] = iter) -> tuple[list[Result], list[dict[str, Any]]]:
    """Everything: results in the order of the catalogue, and the furnace table."""
    results = [check_shade(case) for case in progress(cases.SHADE)]
    for part in (check_reflectivity, check_eval, check_lookup, check_truth, refusals):
        results += list(part())
    results.append(check_large(LARGE))
    rows = furnace()
    results += list(check_furnace(rows))
    return results, rows
