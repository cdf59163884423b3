"""The truth with ray-cast shadows: closed forms, a plain quadrature, the truth without shadows."""

import math
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import pytest

import glossy
from glossy import CubeMap, Lobe, Material, SurfacePoints
from glossy.cubemap import texel_directions
from glossy.frames import normalise, spherical
from glossy.pem import reference_occluded
from glossy.scenes import Geometry
from glossy.scenes.shapes import Rectangle, Sphere, Transform

Array = npt.NDArray[np.float64]

WHITE = CubeMap(np.ones((6, 4, 4, 3)))
UP = np.array([0.0, 1.0, 0.0])
Z = 4.5  # standard errors: some thirty comparisons, 15 degrees of freedom


def ground(views: Array, x: Array | None = None) -> SurfacePoints:
    """Points of a ground y = 0, seen along ``views``."""
    place = np.zeros(views.shape) if x is None else x
    return SurfacePoints(np.broadcast_to(UP, views.shape), [1.0, 0.0, 0.0], views, position=place)


def colours() -> CubeMap:
    """A map of smooth waves."""
    d = normalise(texel_directions(16))
    return CubeMap(1.0 + 0.8 * np.sin(3.0 * d + np.array([0.3, 1.1, 2.0])))


@pytest.mark.parametrize("tilt", [0.0, 0.8])
def test_a_sphere_above_a_diffuse_ground(tilt: float) -> None:
    """Seen at angle t, with radius over distance s, it hides s^2 cos t of the irradiance."""
    away = 1.4
    place = (away * math.sin(tilt), away * math.cos(tilt), 0.0)
    geometry = Geometry([(Sphere(0.5), Transform(place))])
    truth = reference_occluded(ground(UP[None]), Material(kd=0.7), WHITE, geometry, samples=4096)
    expected = 0.7 * (1.0 - (0.5 / away) ** 2 * math.cos(tilt))
    np.testing.assert_array_less(np.abs(truth.radiance - expected), Z * truth.error)
    assert truth.error.max() < 0.005


@pytest.mark.parametrize("estimator", ["mc", "qmc"])
def test_a_wall_through_the_point_takes_half_of_a_lobe(estimator: str) -> None:
    """A half space: the lobe of a normal view is even in x, and so is a white map."""
    wall = Geometry([(Rectangle((1e6, 1e6)), Transform((-1e-3, 0.0, 0.0), rotation=(0, 90, 0)))])
    lobe = Lobe(0.3, 0.15)
    truth = reference_occluded(
        ground(UP[None]), lobe, WHITE, wall, estimator, samples=4096, seed=3, offset=1e-7
    )
    whole = Material(reflection=[lobe]).albedo([0.0, 0.0, 1.0])[0]
    np.testing.assert_array_less(np.abs(truth.radiance - 0.5 * whole), Z * truth.error)
    assert truth.estimator == estimator
    assert truth.error_kind == "standard"


def misses_sphere(w: Array, centre: Array, radius: float) -> npt.NDArray[np.bool_]:
    """Whether rays along unit ``w`` from the origin pass a sphere by."""
    along = w @ centre
    return (along <= 0.0) | (centre @ centre - along**2 > radius**2)


def test_against_a_plain_quadrature() -> None:
    """Midpoints of 384 x 1024 cells over the hemisphere, with a shadow test of their own."""
    rows, columns = 384, 1024
    z = (np.arange(rows) + 0.5) / rows
    phi = (np.arange(columns) + 0.5) * (2.0 * math.pi / columns)
    local = spherical(np.arccos(z)[:, None], phi[None, :]).reshape(-1, 3)
    world = local[:, [0, 2, 1]] * [1.0, 1.0, -1.0]  # t = +x, b = n x t = -z, n = +y
    centre, radius = np.array([0.5, 0.7, -0.2]), 0.4
    cube, material = colours(), Material(kd=0.2, reflection=[Lobe(0.4, 0.2, r0=0.5, alpha=0.3)])
    views = normalise(np.array([[-0.6, 0.8, 0.1], [0.0, 1.0, 0.4], [-0.9, 0.35, 0.0]]))
    points = ground(views)
    lit = cube.lookup(world) * misses_sphere(world, centre, radius)[:, None]
    cell = 2.0 * math.pi / (rows * columns)
    expected = [
        (material.eval(local, np.broadcast_to(wo, local.shape)).reshape(len(local), -1)
         * lit * local[:, 2:]).sum(axis=0) * cell
        for wo in points.local_view
    ]  # fmt: skip
    geometry = Geometry([(Sphere(radius), Transform(tuple(centre)))])
    truth = reference_occluded(points, material, cube, geometry, samples=2048)
    np.testing.assert_array_less(np.abs(truth.radiance - expected), Z * truth.error + 1e-4)
    plain = glossy.reference(points, material, cube, "qmc", samples=2048)
    assert np.all(plain.radiance - truth.radiance > 10.0 * truth.error)  # the sphere does matter


def test_nothing_in_the_way_is_the_truth_without_shadows() -> None:
    """What lies below the horizon of an opaque surface takes nothing: the same bits."""
    views = normalise(np.array([[0.3, 0.8, 0.1], [0.0, 0.2, 1.0]]))
    geometry = Geometry([(Rectangle((4.0, 4.0)), Transform(rotation=(-90, 0, 0)))])
    material, cube = Material(kd=0.1, reflection=[Lobe(0.2, r0=0.3)]), colours()
    truth = reference_occluded(ground(views), material, cube, geometry, samples=256, seed=5)
    plain = glossy.reference(ground(views), material, cube, "qmc", samples=256, seed=5)
    np.testing.assert_array_equal(truth.radiance, plain.radiance)
    np.testing.assert_array_equal(truth.error, plain.error)


def test_light_comes_through_a_foil_past_what_is_behind_it() -> None:
    """Rays start on the side they go to: a foil does not shadow itself, a ball below it does."""
    foil = (Rectangle((4.0, 4.0)), Transform(rotation=(-90, 0, 0)))
    ball = (Sphere(0.4), Transform((0.0, -0.8, 0.0)))
    material = Material(kd=0.0, diffuse_transmission=0.6)
    points = ground(UP[None])
    bare = reference_occluded(points, material, WHITE, Geometry([foil]), samples=1024)
    np.testing.assert_array_less(np.abs(bare.radiance - 0.6), Z * bare.error)
    truth = reference_occluded(points, material, WHITE, Geometry([foil, ball]), samples=4096)
    np.testing.assert_array_less(np.abs(truth.radiance - 0.6 * 0.75), Z * truth.error)


def test_points_alone_or_together_and_any_threads_give_the_same_bits() -> None:
    rng = np.random.default_rng(2)
    views = normalise(rng.normal(size=(5, 3)) * 0.4 + UP)
    x = rng.uniform(-1.0, 1.0, (5, 3)) * [1.0, 0.0, 1.0]
    geometry = Geometry([(Sphere(0.3), Transform((0.0, 0.5, 0.0)))])
    points = ground(views, x)
    mask = np.array([True, False, True, True, False])
    some = SurfacePoints(points.normal, points.tangent, points.view, mask, x)
    before = numba.get_num_threads()
    whole = reference_occluded(points, Lobe(0.2), colours(), geometry, samples=128)
    try:
        numba.set_num_threads(1)
        part = reference_occluded(some, Lobe(0.2), colours(), geometry, samples=128)
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(part.radiance[mask], whole.radiance[mask])
    assert not part.radiance[~mask].any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"geometry": None}, "geometry: must be a glossy.scenes.Geometry"),
        ({"points": SurfacePoints(UP, None, UP)}, "points: must have positions"),
        ({"points": None}, "points: must be SurfacePoints"),
        ({"estimator": "texels"}, "estimator: must be one of qmc, mc"),
        ({"offset": -1.0}, "offset: must be in"),
        ({"samples": 1}, "samples: must be at least 2"),
    ],
)
def test_errors_are_one_line(change: dict[str, Any], message: str) -> None:
    ball = Geometry([(Sphere(), Transform())])
    given = {"points": ground(UP[None]), "material": Lobe(0.2), "cube": WHITE, "geometry": ball}
    with pytest.raises(ValueError, match=message) as caught:
        reference_occluded(**{**given, **change})
    assert "\n" not in str(caught.value)
