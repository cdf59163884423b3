"""Ground truth with shadows: the environment seen past the objects of a scene.

::

    L(x, wo) = integral over the sphere of L(wi) V(x, wi) f(wi, wo) abs(wi.n) dwi          (1)

V is 1 where the ray from x along wi leaves the scene and 0 where it meets something: blockers are
black, as shadow maps know nothing of the light they reflect (Knuth et al., their conclusion). The
environment is infinitely far away. Without blockers (1) is what ``glossy.reference`` integrates.

The estimators are those of ``reference`` (``truth.montecarlo``: material and environment sampled
together, standard error per point), with a ray cast for every direction that can bring light.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from ..cubemap import CubeMap
from ..frames import SurfacePoints, dot
from ..reference import (
    MOST_SAMPLES,
    SAMPLES,
    Truth,
    draw_passes,
    seen_points,
    shown_material,
)
from ..scenes.geometry import Geometry
from ..truth.cells import check_finite
from ..truth.environment import EnvironmentSampler
from ..truth.montecarlo import local_directions, material_directions, weighted_bsdf

Float64Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

ESTIMATORS = ("qmc", "mc")


def open_rays(
    geometry: Geometry,
    position: Float64Array,
    normal: Float64Array,
    directions: Float64Array,
    offset: float,
) -> BoolArray:
    """V of eq. (1): whether rays (K, 3) along unit directions leave the scene.

    They start ``offset`` off the surface, on the side they go to.
    """
    side = np.where(dot(normal, directions) < 0.0, -offset, offset)
    origin = position + side[:, None] * normal
    return ~geometry.blocked(_check.frozen(origin), _check.frozen(directions))


class OccludedDraws:
    """Draws at points of ``position`` (K, 3) under a cube map that objects hide in part.

    What the material does not reflect costs no ray, nor what is black.
    """

    dimensions, evaluations = 4, 2

    def __init__(
        self,
        material: Any,
        cube: CubeMap,
        geometry: Geometry,
        frames: Float64Array,
        views: Float64Array,
        position: Float64Array,
        offset: float,
    ) -> None:
        self.material, self.cube, self.geometry = material, cube, geometry
        self.frames, self.views, self.position = frames, views, position
        self.offset, self.sampler = offset, EnvironmentSampler(cube)

    def values(self, at: slice, u: Float64Array) -> Float64Array:
        """As ``truth.montecarlo.Draws``."""
        frames, x = self.frames[at], self.position[at]
        wo = np.broadcast_to(self.views[at][:, None, :], (*u.shape[:2], 3))
        world = self.sampler.sample(u[..., 2:])
        drawn = (
            material_directions(self.material, frames, wo, u[..., :2]),
            (local_directions(frames, world), world),
        )
        total = np.zeros((*u.shape[:2], 3))
        for local, w in drawn:
            factor = weighted_bsdf(self.material, local, wo, self.sampler.pdf(w))
            value = self.cube.lookup(w) * factor
            point, draw = np.nonzero(value.any(axis=-1))
            along = w[point, draw]
            seen = open_rays(self.geometry, x[point], frames[point, 2], along, self.offset)
            total[point[seen], draw[seen]] += value[point[seen], draw[seen]]
        return total


def check_geometry(geometry: object) -> Geometry:
    """The geometry of ``glossy.scenes``, or an error."""
    if not isinstance(geometry, Geometry):
        raise _check.fail("geometry", "must be a glossy.scenes.Geometry", type(geometry).__name__)
    return geometry


def place(points: object) -> Float64Array:
    """Positions (K, 3) of the points that are seen, or an error."""
    if not isinstance(points, SurfacePoints):
        raise _check.fail("points", "must be SurfacePoints", type(points).__name__)
    if points.position is None:
        raise _check.fail("points", "must have positions for shadows", None)
    return points.position.reshape(-1, 3)[np.flatnonzero(points.coverage.reshape(-1))]


def reference_occluded(
    points: SurfacePoints,
    material: Any,
    cube: CubeMap,
    geometry: Geometry,
    estimator: str = "qmc",
    samples: int | None = None,
    tolerance: float | None = None,
    seed: int = 0,
    diffuse: bool = True,
    offset: float | None = None,
) -> Truth:
    """Ground truth of eq. (1): radiance under an environment with ray-cast shadows.

    Parameters
    ----------
    points : SurfacePoints
        With positions, on or off the objects. Masked points cost nothing and come out 0.
    material : Material, Lobe, or anything with ``eval``, ``sample`` and ``pdf``
        As for ``reference``.
    cube : CubeMap
        The environment, infinitely far away.
    geometry : glossy.scenes.Geometry
        What is in the way: any shapes, the one the points lie on as a rule among them.
    estimator : "qmc" or "mc"
    samples : int, optional
        Evaluations per point (4096; at most 262 144 when a tolerance is given).
    tolerance : float, optional
        Samples double until the RMS of the standard errors is at most this share of the radiance's.
    seed : int
        A point's draws depend on it and on the point's flat index.
    diffuse : bool
        False leaves the diffuse terms out.
    offset : float, optional [scene units]
        How far along the normal rays start, ``geometry.offset`` (1e-5 of the scene's diagonal) by
        default. Larger for points that lie on the surface only roughly.

    Returns
    -------
    Truth
        ``radiance``, ``error`` (one standard error) and ``samples``, float64.

    Raises
    ------
    ValueError
        As ``reference``, and for points without positions, or another geometry.

    Notes
    -----
    Same arguments, same bits, for any number of threads. Interpolated normals of a mesh serve f and
    the cosine; its flat triangles are what rays meet.
    """
    _check.choice("estimator", estimator, ESTIMATORS)
    _check.count("seed", seed, low=0, high=2**63 - 1)
    goal = None if tolerance is None else _check.positive("tolerance", tolerance)
    default = SAMPLES if goal is None else MOST_SAMPLES
    most = _check.count("samples", default if samples is None else samples, low=2)
    away = None if offset is None else _check.in_range("offset", offset, low=0.0)
    check_geometry(geometry)
    position = place(points)
    if not isinstance(cube, CubeMap):
        raise _check.fail("cube", "must be a CubeMap", type(cube).__name__)
    check_finite(cube)
    seen, frames, views = seen_points(points)
    shown = shown_material(material, diffuse)
    lift = geometry.offset if away is None else away
    draws = OccludedDraws(shown, cube, geometry, frames, views, position, lift)
    *_, last = draw_passes(points.shape, seen, draws, estimator, most, goal, seed)
    return last
