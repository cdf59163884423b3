"""Ground truth: the radiance that leaves surface points under an environment map, with its error.

::

    L(wo) = integral over the sphere of L(wi) f(wi, wo) abs(wi.n) dwi                        (1)

with L between texel centres as the cube map's seamless bilinear lookup returns it: what infinitely
many unfiltered samples see. Three estimators share nothing but that lookup and the BSDF:

``texels``
    Deterministic: polynomials follow the lobe, the radiance is integrated against them
    beforehand, and blocks of texels are divided until the error bound meets the tolerance
    (``truth.texels``).
``mc``, ``qmc``
    Multiple importance sampling of material and environment with independent or low-discrepancy
    draws, and its standard error (``truth.montecarlo``). With ``parallax``, L depends on the place
    too (``truth.planes``).

Nothing here knows of pyramids, footprints or patterns.
"""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check
from ._arguments import checked
from .brdf import Lobe, Material
from .cubemap import CubeMap
from .frames import SurfacePoints
from .planes import BoundingPlanes
from .truth.cells import check_finite, radiance_tree
from .truth.given import GivenMaterial
from .truth.montecarlo import CubeDraws, Draws, monte_carlo, quasi_monte_carlo
from .truth.plain import PROBES, PlainQuadrature
from .truth.planes import PlaneLight
from .truth.random import uniform
from .truth.texels import integrate

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

ESTIMATORS = ("texels", "mc", "qmc")
TOLERANCE = 1e-3  # of "texels": the bound; what is missed in fact is some hundred times less
WORK = 2_000_000  # of "texels": evaluations per point and lobe
SAMPLES = 4096  # of "mc" and "qmc"
MOST_SAMPLES = 1 << 18  # of "mc" and "qmc" with a tolerance
NO_DIFFUSE: dict[str, Any] = {"kd": 0.0, "diffuse_transmission": 0.0}


@dataclasses.dataclass(frozen=True, eq=False)
class Truth:
    """What ``reference`` returns.

    Attributes
    ----------
    radiance : (..., 3) float64
    error : (..., 3) float64
        On the radiance, of the kind ``error_kind``.
    error_kind : "bound", "estimate" or "standard"
        A bound the truth lies within (``texels`` of a ``Material``), an estimate of one (``texels``
        of any other material), or one standard error (``mc``, ``qmc``).
    estimator : str
    samples : (...) int64
        Evaluations of the BSDF that each point took.
    """

    radiance: Float64Array
    error: Float64Array
    error_kind: str
    estimator: str
    samples: IntArray


@checked
def reference(
    points: SurfacePoints,
    material: Any,
    cube: CubeMap,
    estimator: str = "texels",
    samples: int | None = None,
    tolerance: float | None = None,
    seed: int = 0,
    diffuse: bool = True,
    parallax: BoundingPlanes | None = None,
) -> Truth:
    """Ground truth of eq. (1) at surface points.

    Parameters
    ----------
    points : SurfacePoints
        Of any shape. Masked points cost nothing and come out 0.
    material : Material, Lobe, or anything with ``eval``, ``sample`` and ``pdf``
        Called as ``eval(wi, wo)``, ``sample(xi, wo)``, ``pdf(wi, wo)`` with NumPy arrays:
        directions (..., 3) in the frame (t, b, n), uniform numbers (..., 2); BSDF (...) or
        (..., 3) without the cosine, density per solid angle over the whole sphere. For such a
        material ``texels`` is some hundred times slower than for a ``Material``, and its error an
        estimate: a lobe that neither its samples nor a scan of the sphere meets is missed.
    cube : CubeMap
        Finite; its quadrature weights are kept with it after the first call.
    estimator : "texels", "mc" or "qmc"
    samples : int, optional
        ``texels``: most evaluations per point and lobe (2 million); spent, the reported bound is
        larger than asked for, but still a bound. ``mc``, ``qmc``: evaluations per point (4096; at
        most 262 144 when a tolerance is given), rounded up to pairs, or pairs for 16 replicates.
    tolerance : float, optional
        ``texels``: error bound asked for at each point and lobe, relative to its radiance, both
        summed over the channels (1e-3), or to 1e-4 of albedo times mean radiance where
        the point is darker. ``mc``, ``qmc``: the number of samples is doubled until the
        RMS of all standard errors is at most this share of the RMS of the radiance.
    seed : int
        Of ``mc`` and ``qmc``. A point's draws depend on it and on the point's flat index.
    diffuse : bool
        False leaves the diffuse terms out.
    parallax : BoundingPlanes, optional
        Look the map up where each direction meets these planes, ``planes`` eqs. (1)-(3); needs
        points with positions and ``mc`` or ``qmc``.

    Returns
    -------
    Truth

    Raises
    ------
    ValueError
        For an unknown estimator, numbers out of range, a material without the methods, or whose
        methods return what they must not, a map with NaN or infinities, or ``diffuse=False`` for a
        material that has no known diffuse part.

    Notes
    -----
    Same arguments, same bits, for any number of threads and whether or not other points are there.
    """
    *_, last = reference_passes(
        points, material, cube, estimator, samples, tolerance, seed, diffuse, parallax
    )
    return last


@checked
def reference_passes(
    points: SurfacePoints,
    material: Any,
    cube: CubeMap,
    estimator: str = "qmc",
    samples: int | None = None,
    tolerance: float | None = None,
    seed: int = 0,
    diffuse: bool = True,
    parallax: BoundingPlanes | None = None,
) -> Iterator[Truth]:
    """Yield the truth again and again, each time better; the last is what ``reference`` returns.

    Arguments as ``reference``. ``mc`` and ``qmc`` accumulate, and the number of samples doubles
    from pass to pass; ``texels`` has a single pass, as there is nothing random to accumulate.
    """
    _check.choice("estimator", estimator, ESTIMATORS)
    _check.count("seed", seed, low=0, high=2**63 - 1)
    goal = None if tolerance is None else _check.positive("tolerance", tolerance)
    default = WORK if estimator == "texels" else SAMPLES if goal is None else MOST_SAMPLES
    most = _check.count("samples", default if samples is None else samples, low=2)
    check_finite(cube)
    shown = shown_material(material, diffuse)
    seen, frames, views = seen_points(points)
    if estimator == "texels":
        if parallax is not None:
            raise _check.fail("estimator", "must be mc or qmc with parallax", estimator)
        bound = TOLERANCE if goal is None else goal
        return _texels(points.shape, shown, cube, frames, views, seen, bound, most, seed)
    light = None if parallax is None else _plane_light(points, cube, parallax, seen)
    draws = CubeDraws(shown, cube, frames, views, light)
    return draw_passes(points.shape, seen, draws, estimator, most, goal, seed)


def seen_points(points: SurfacePoints) -> tuple[IntArray, Float64Array, Float64Array]:
    """Flat indices (K,) of the points that count, frames (K, 3, 3) and local views (K, 3)."""
    seen = np.flatnonzero(points.coverage.reshape(-1))
    axes = (points.tangent, points.bitangent, points.normal)
    frames = np.stack([a.reshape(-1, 3)[seen] for a in axes], axis=1)
    return seen, frames, points.local_view.reshape(-1, 3)[seen]


def _plane_light(
    points: SurfacePoints, cube: CubeMap, planes: BoundingPlanes, seen: IntArray
) -> PlaneLight:
    if points.position is None:
        raise _check.fail("points", "must have positions for parallax", None)
    return PlaneLight(cube, planes, points.position.reshape(-1, 3)[seen])


def _truth(
    shape: tuple[int, ...],
    seen: IntArray,
    found: tuple[Float64Array, Float64Array, IntArray],
    kind: str,
    estimator: str,
) -> Truth:
    """Radiance and error (K, 3) and samples (K,) of the points seen, spread over all of them."""
    size = int(np.prod(shape))
    radiance, error = np.zeros((size, 3)), np.zeros((size, 3))
    count = np.zeros(size, dtype=np.int64)
    radiance[seen], error[seen], count[seen] = found
    whole = radiance.reshape(*shape, 3), error.reshape(*shape, 3)
    return Truth(*whole, kind, estimator, count.reshape(shape))


def draw_passes(
    shape: tuple[int, ...],
    seen: IntArray,
    draws: Draws,
    estimator: str,
    samples: int,
    tolerance: float | None,
    seed: int,
) -> Iterator[Truth]:
    """Truths of points of ``shape``, of which those at ``seen`` (K,) count, pass by pass."""
    method = monte_carlo if estimator == "mc" else quasi_monte_carlo
    for value, error, used in method(draws, seen, samples, seed):
        count = np.full(len(seen), used, dtype=np.int64)
        yield _truth(shape, seen, (value, error, count), "standard", estimator)
        if tolerance is not None and _rms(error) <= tolerance * _rms(value):
            return


def _rms(x: Float64Array) -> float:
    return float(np.sqrt(np.mean(x**2))) if x.size else 0.0


def _texels(
    shape: tuple[int, ...],
    material: Any,
    cube: CubeMap,
    frames: Float64Array,
    views: Float64Array,
    index: IntArray,
    tolerance: float,
    work: int,
    seed: int,
) -> Iterator[Truth]:
    tree = radiance_tree(cube)
    if isinstance(material, Material):
        share = material.diffuse_share(views)
        found = integrate(frames, views, material.pack(), tree, tolerance, work, share)
        yield _truth(shape, index, found, "bound", "texels")
        return
    plain = PlainQuadrature(material, cube, tree, tolerance, work)
    value, error = np.zeros((len(views), 3)), np.zeros((len(views), 3))
    used = np.zeros(len(views), dtype=np.int64)
    for k, flat in enumerate(index):
        xi = uniform(seed, np.array([flat]), 0, PROBES, 2)[0]
        value[k], error[k], used[k] = plain.point(frames[k], views[k], xi)
    yield _truth(shape, index, (value, error, used), "estimate", "texels")


def shown_material(material: Any, diffuse: bool) -> Any:
    """The material as it is to be integrated; a Lobe alone is a Material of one."""
    if isinstance(material, Lobe):
        material = Material(reflection=[material])
    if isinstance(material, Material):
        return material if diffuse else dataclasses.replace(material, **NO_DIFFUSE)
    names = ("eval", "sample", "pdf")
    own = None if isinstance(material, type) else material  # a class has no material's numbers
    missing = [n for n in names if not callable(getattr(own, n, None))]
    if missing:
        raise _check.fail(
            "material", "must have eval, sample and pdf", f"none of {', '.join(missing)}"
        )
    if not diffuse:
        raise _check.fail(
            "diffuse", "must be True for a material other than glossy.Material", diffuse
        )
    return GivenMaterial(material)
