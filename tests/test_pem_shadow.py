"""Variance shadow maps against plain twins, closed forms and rays; rays against closed forms."""

import math
import pathlib
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import pytest
import tolerances
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import erf

import glossy
from glossy import SurfacePoints
from glossy.frames import dot, normalise
from glossy.pem import ShadowMaps, reference_occluded, region_visibility, shadow_maps
from glossy.pem.depth import depth_maps, light_frames, light_space
from glossy.pem.regions import regions
from glossy.pem.shadow import STORAGE, blurred_moments, disc_angles
from glossy.scenes import Geometry
from glossy.scenes.shapes import Box, Mesh, Rectangle, Sphere, Torus, Transform

Array = npt.NDArray[np.float64]

UP = np.array([0.0, 1.0, 0.0])
FLAT = (-90.0, 0.0, 0.0)
NARROW = [1e-4]  # solid angle of a light without width, sr
MOMENTS = 1e-6
"""float32 sums of up to a hundred products of numbers of at most 1."""

HALF = 2.0**-10
"""Half floats of magnitude up to 1: half a unit, after the drawing and each of two passes."""


def ground(x: Array, normal: Array = UP) -> SurfacePoints:
    shape = x.shape
    return SurfacePoints(
        np.broadcast_to(normal, shape), None, np.broadcast_to(normal, shape), position=x
    )


def scene() -> Geometry:
    """A ground with a ball above it and a ring that stands in it."""
    return Geometry(
        [
            (Rectangle((4.0, 4.0)), Transform(rotation=FLAT)),
            (Sphere(0.4), Transform((-0.5, 0.7, 0.1))),
            (Torus(0.5, 0.15), Transform((0.6, 0.4, 0.2), rotation=(80.0, 10.0, 0.0))),
        ]
    )


def seen_from(geometry: Geometry, count: int, seed: int = 1) -> SurfacePoints:
    """Points that rays from all around meet, with the normals there."""
    rng = np.random.default_rng(seed)
    away = normalise(rng.normal(size=(count, 3)))
    target = rng.uniform(
        geometry.boxes[:, 0].min(axis=0), geometry.boxes[:, 1].max(axis=0), (count, 3)
    )
    hits = geometry.intersect(target + 2.0 * geometry.diagonal * away, -away)
    on = hits.found
    return SurfacePoints(hits.normal[on], hits.tangent[on], away[on], position=hits.position[on])


@given(
    st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).filter(lambda v: np.linalg.norm(v) > 0.1)
)
def test_frames_are_right_handed_and_orthonormal(v: list[float]) -> None:
    f = light_frames(normalise([v]))[0]
    np.testing.assert_allclose(f @ f.T, np.eye(3), atol=tolerances.ROUNDOFF)
    assert np.linalg.det(f) == pytest.approx(1.0)


def test_depths_of_a_sphere_above_a_floor() -> None:
    """Straight down: 1 radius is the half diagonal; the sphere's cap, the floor, nothing."""
    geometry = Geometry(
        [(Rectangle((2.0, 2.0)), Transform(rotation=FLAT)), (Sphere(0.5), Transform((0, 0.5, 0)))]
    )
    space = light_space(geometry, [UP])
    found = depth_maps(geometry, space, 64)[0]
    across = (np.arange(64) + 0.5) / 32.0 - 1.0
    b, a = np.meshgrid(across, across, indexing="ij")
    plane = space.radius * (a[..., None] * space.frames[0, 0] + b[..., None] * space.frames[0, 1])
    square = plane[..., 0] ** 2 + plane[..., 2] ** 2
    height = np.where(square < 0.25, 0.5 + np.sqrt(np.maximum(0.25 - square, 0.0)), 0.0)
    z = -(height - space.centre[1]) / space.radius
    z[np.max(np.abs(plane), axis=-1) > 1.0] = 1.0
    np.testing.assert_allclose(found, z, atol=tolerances.SINGLE)


def test_triangles_are_rasterised_where_rays_meet_the_same_box(tmp_path: pathlib.Path) -> None:
    """A box as a mesh and as a shape; on their outlines a texel may be of either side."""
    trimesh: Any = pytest.importorskip("trimesh")
    file = tmp_path / "box.ply"
    trimesh.creation.box(extents=(1.0, 0.6, 1.4)).export(file)
    stand = Transform((0.2, 0.1, -0.3), rotation=(20.0, 30.0, 40.0))
    mesh, box = Geometry([(Mesh(str(file)), stand)]), Geometry([(Box((1.0, 0.6, 1.4)), stand)])
    lights = normalise(np.random.default_rng(3).normal(size=(5, 3)))
    space = light_space(box, lights)
    a, b = depth_maps(mesh, space, 48), depth_maps(box, space, 48)
    differ = np.abs(a - b) > tolerances.SINGLE
    assert differ.mean() < 0.002
    assert 0.1 < np.mean(a < 1.0) < 0.9


def blur_twin(z: Array, sigma: float) -> Array:
    """Both moments of one map in float64, sums written out; beyond the map z is 1."""
    n = math.ceil(3.0 * sigma)
    w = np.exp(-0.5 * (np.arange(-n, n + 1) / max(sigma, 1e-9)) ** 2)
    w /= w.sum()
    rows, columns = z.shape
    wide = np.pad(z, n, constant_values=1.0)
    out = np.zeros((2, rows, columns))
    for p in range(2):
        for i in range(2 * n + 1):
            for j in range(2 * n + 1):
                out[p] += w[i] * w[j] * wide[i : i + rows, j : j + columns] ** (p + 1)
    return out


@pytest.mark.parametrize("sigma", [0.0, 0.4, 2.3])
def test_the_blur_against_its_twin(sigma: float) -> None:
    z = np.random.default_rng(4).uniform(-1.0, 1.0, (2, 20, 20)).astype(np.float32)
    found = blurred_moments(z, np.array([sigma, 1.0]), "rg32f")
    np.testing.assert_allclose(found[0], blur_twin(z[0].astype(np.float64), sigma), atol=MOMENTS)
    np.testing.assert_allclose(found[1], blur_twin(z[1].astype(np.float64), 1.0), atol=MOMENTS)


def visibility_twin(maps: ShadowMaps, points: SurfacePoints) -> Array:
    """Eqs. (3)-(6) in plain NumPy."""
    assert points.position is not None
    x = (points.position - maps.space.centre) / maps.space.radius
    out = np.zeros((len(x), len(maps)))
    for r, (u, v, light) in enumerate(maps.space.frames):
        n = maps.size
        a, b, t = (x @ u + 1.0) * n / 2 - 0.5, (x @ v + 1.0) * n / 2 - 0.5, -(x @ light)
        i, j = (np.clip(np.floor(q), 0, n - 2).astype(int) for q in (a, b))
        a, b = np.clip(a - i, 0.0, 1.0), np.clip(b - j, 0.0, 1.0)
        m = maps.moments[r].astype(np.float64)
        m1, m2 = (
            (1 - b) * ((1 - a) * q[j, i] + a * q[j, i + 1])
            + b * ((1 - a) * q[j + 1, i] + a * q[j + 1, i + 1])
            for q in m
        )
        cosine = points.normal @ light
        square = np.maximum(cosine**2, 0.01)
        var = np.maximum(m2 - m1**2, maps.variance) + (1.0 / n) ** 2 * (1.0 - square) / square
        away = t - maps.bias - m1
        p = np.where(away <= 0.0, 1.0, var / (var + away**2))
        lit = np.maximum(p - maps.bleeding, 0.0) / (1.0 - maps.bleeding)
        h = np.clip(np.arcsin(np.clip(cosine, -1.0, 1.0)) / maps.angles[r], -1.0, 1.0)
        above = 0.5 + (h * np.sqrt(1.0 - h**2) + np.arcsin(h)) / math.pi
        out[:, r] = lit * above if maps.horizon else lit
    return out


@pytest.mark.parametrize("horizon", [False, True])
def test_visibility_against_its_twin_for_any_threads(horizon: bool) -> None:
    geometry = scene()
    lights = normalise(np.random.default_rng(5).normal(size=(7, 3)))
    own = (lights, np.geomspace(0.01, 2.0, 7), 64)
    maps = shadow_maps(geometry, *own, horizon=horizon)
    points = seen_from(geometry, 300)
    found = maps.visibility(points)
    np.testing.assert_allclose(found, visibility_twin(maps, points), atol=tolerances.SINGLE)
    assert 0.05 < found.mean() < 0.95
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        again = shadow_maps(geometry, *own, horizon=horizon)
        np.testing.assert_array_equal(again.visibility(points), found)
    finally:
        numba.set_num_threads(before)


def test_a_straight_edge_is_as_soft_as_the_blur() -> None:
    """Of two parallel planes Chebyshev's bound is the very share: the Gaussian's integral."""
    geometry = Geometry(
        [
            (Rectangle((4.0, 4.0)), Transform(rotation=FLAT)),
            (Rectangle((2.0, 4.0)), Transform((1.0, 0.5, 0.0), rotation=FLAT)),
        ]
    )
    omega = 0.05
    maps = shadow_maps(geometry, [UP], [omega], 512, softness=0.3, bias=0.0, bleeding=0.0)
    x = np.linspace(-1.0, 1.0, 81)
    found = maps.visibility(ground(np.stack([x, 0.0 * x, 0.0 * x], axis=-1)))[:, 0]
    sigma = 0.3 * disc_angles([omega])[0] * maps.space.radius
    expected = 0.5 * (1.0 - erf(x / (math.sqrt(2.0) * sigma)))
    np.testing.assert_allclose(found, expected, atol=0.01)  # the Gaussian ends at 3 sigma


def test_bleeding_between_two_blockers_is_cut_off() -> None:
    """Half covered by a high edge, wholly by a low plate: dark, yet the bound is not zero."""
    geometry = Geometry(
        [
            (Rectangle((4.0, 4.0)), Transform(rotation=FLAT)),
            (Rectangle((3.0, 3.0)), Transform((0.0, 0.2, 0.0), rotation=FLAT)),
            (Rectangle((2.0, 4.0)), Transform((1.0, 1.2, 0.0), rotation=FLAT)),
        ]
    )
    lit = [
        shadow_maps(geometry, [UP], [0.05], softness=0.3, bleeding=cut).visibility(
            ground(np.zeros((1, 3)))
        )[0, 0]
        for cut in (0.0, 0.2, 0.5)
    ]
    assert lit[0] > 0.25  # var = 1/4, t - M1 = 0.7 in units of the distance between the blockers
    assert lit[0] > lit[1] > lit[2]
    assert lit[2] == 0.0


@pytest.mark.parametrize("tilt", [0.0, 40.0, 75.0])
def test_a_lone_plane_does_not_shadow_itself(tilt: float) -> None:
    """However steep the light and wide the blur: what is hidden is below the horizon."""
    turn = math.radians(tilt)
    light = np.array([math.sin(turn), math.cos(turn), 0.0])
    geometry = Geometry([(Rectangle((2.0, 2.0)), Transform(rotation=FLAT))])
    x = np.random.default_rng(6).uniform(-0.9, 0.9, (50, 3)) * [1.0, 0.0, 1.0]
    for softness in (0.0, 0.07, 0.5):
        lights = ([light, -light], [0.05, 0.05], 64)
        maps = shadow_maps(geometry, *lights, softness=softness, horizon=True)
        found = maps.visibility(ground(x))
        np.testing.assert_allclose(found[:, 0], 1.0, atol=1e-3)
        assert not found[:, 1].any()


def test_the_horizon_halves_a_light_on_it() -> None:
    geometry = Geometry([(Sphere(0.1), Transform((5.0, 5.0, 5.0)))])
    maps = shadow_maps(geometry, [[1.0, 0.0, 0.0]], [0.3], 16, horizon=True)
    assert maps.visibility(ground(np.zeros((1, 3))))[0, 0] == pytest.approx(0.5)


def test_what_lies_beside_and_behind_the_map_is_lit() -> None:
    geometry = Geometry([(Sphere(0.5), Transform())])
    maps = shadow_maps(geometry, [UP, UP], [0.3, 0.01], 32)
    x = np.array([[3.0, 0.0, 0.0], [0.0, 0.0, -0.9], [0.8, -5.0, 0.0], [0.0, -5.0, 0.0]])
    found = maps.visibility(ground(x))
    np.testing.assert_array_equal(found[:3], 1.0)
    np.testing.assert_allclose(found[3], 0.0, atol=0.1)  # behind the ball


def test_close_to_the_rays_over_the_regions() -> None:
    """Better than the horizon alone, and than a hard shadow of the region's middle."""
    geometry, cube = scene(), glossy.environment("sky", size=16)
    cut = regions(cube, 48)
    points = seen_from(geometry, 250)
    truth = region_visibility(points, geometry, cut, samples=64)
    assert np.sqrt(np.mean(truth.error**2)) < 0.02
    soft, hard = (
        shadow_maps(geometry, cut.direction, cut.solid_angle, softness=s, horizon=True).visibility(
            points
        )
        for s in (0.07, 0.0)
    )
    nothing = Geometry([(Sphere(0.1), Transform((0.0, -9.0, 0.0)))])
    bare = shadow_maps(nothing, cut.direction, cut.solid_angle, 16, horizon=True).visibility(points)
    errors = [float(np.sqrt(np.mean((v - truth.share) ** 2))) for v in (soft, hard, bare)]
    assert errors[0] < 0.12
    assert errors[0] < 0.95 * errors[1]
    assert errors[0] < 0.6 * errors[2]


def test_the_teapot_shadows_itself(real_data: pathlib.Path) -> None:
    """Of its own light the shadow maps take away about what rays do."""
    pytest.importorskip("embreex")
    stand = Transform(rotation=(-90.0, 0.0, 0.0))
    geometry = Geometry([(Mesh(str(real_data / "mesh/teapot.ply")), stand)])
    assert not geometry.convex(0)
    camera = glossy.Camera((4.0, 4.5, -6.5), (0.2, 1.4, 0.0), fov=40.0, width=28, height=20)
    hits = geometry.intersect(camera.position, camera.rays())
    view, normal = -camera.rays()[hits.found], hits.normal[hits.found]
    normal = normalise(normal + np.maximum(1e-3 - dot(normal, view), 0.0)[:, None] * view)
    points = SurfacePoints(normal, None, view, position=hits.position[hits.found])
    cube, lobe = glossy.environment("sky", size=32), glossy.Lobe(0.1)
    maps = glossy.partial_maps(cube, 48)
    cut = maps.regions
    lit = shadow_maps(geometry, cut.direction, cut.solid_angle, 128).visibility(points)
    bare = glossy.shade(points, lobe, maps, method="pem")
    taken = bare - glossy.shade(points, lobe, maps, method="pem", visibility=lit)
    truth = reference_occluded(points, lobe, cube, geometry, samples=256).radiance
    hidden = glossy.reference(points, lobe, cube, "qmc", samples=256).radiance - truth
    assert np.sqrt(np.mean(hidden**2)) > 0.05 * np.sqrt(np.mean(truth**2))
    assert np.sqrt(np.mean((taken - hidden) ** 2)) < 0.6 * np.sqrt(np.mean(hidden**2))


def test_half_floats_take_half_the_memory_and_stay_close() -> None:
    geometry = scene()
    lights = normalise(np.random.default_rng(7).normal(size=(3, 3)))
    single, half = (shadow_maps(geometry, lights, [0.3] * 3, 64, storage=name) for name in STORAGE)
    assert (single.nbytes, half.nbytes) == (3 * 64 * 64 * 8, 3 * 64 * 64 * 4)
    assert 0.0 < np.abs(single.moments - half.moments).max() < 3 * HALF
    points = seen_from(geometry, 200)
    gap = single.visibility(points) - half.visibility(points)
    assert float(np.sqrt(np.mean(gap**2))) < 0.05


def test_a_ball_inside_a_region_hides_its_share() -> None:
    """Seen from below: 2 pi (1 - sqrt(1 - (r/d)^2)) of the top face's 2 pi / 3."""
    cut = regions(glossy.environment("white", size=8), 6)
    geometry = Geometry([(Sphere(0.5), Transform((0.1, 1.5, 0.0)))])
    points = ground(np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 0.0]]))
    found = region_visibility(points, geometry, cut, samples=4096)
    away = math.hypot(0.1, 1.5)
    hidden = 2.0 * math.pi * (1.0 - math.sqrt(1.0 - (0.5 / away) ** 2)) / cut.solid_angle[2]
    assert found.share[0, 2] == pytest.approx(1.0 - hidden, abs=5.0 * found.error[0, 2])
    assert 0.0 < found.error[0, 2] < 0.002
    np.testing.assert_array_equal(found.share[:, 3], 0.0)  # the face below: under the horizon
    assert found.share[1, 2] == 1.0  # the ball is below
    np.testing.assert_allclose(found.share[1, [0, 1, 4, 5]], 0.5, atol=0.01)


def test_masked_points_see_nothing_and_shapes_are_kept() -> None:
    geometry, cut = scene(), regions(glossy.environment("white", size=8), 6)
    x = np.broadcast_to([0.0, 5.0, 0.0], (2, 3, 3))
    mask = np.array([[True, False, True], [True, True, False]])
    view = np.broadcast_to(UP, x.shape)
    points = SurfacePoints(view, None, view, mask, x)
    lit = shadow_maps(geometry, cut.direction, cut.solid_angle, 16).visibility(points)
    cast = region_visibility(points, geometry, cut, samples=8).share
    for found in (lit, cast):
        assert found.shape == (2, 3, 6)
        assert not found[~mask].any()
        np.testing.assert_array_equal(found[mask][:, 2], 1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"geometry": 3}, "geometry: must be a glossy.scenes.Geometry"),
        ({"geometry": Geometry([])}, "geometry: must hold something"),
        ({"directions": [UP, UP]}, "solid_angles: must be 2, got 1"),
        ({"directions": UP}, "directions: must have shape"),
        ({"solid_angles": [7.0]}, "solid_angles: must be one list in"),
        ({"size": 1}, "size: must be from 2"),
        ({"softness": -0.1}, "softness: must be in"),
        ({"variance": 0.0}, "variance: must be in"),
        ({"bleeding": 1.0}, "bleeding: must be in"),
        ({"horizon": 1}, "horizon: must be true or false"),
        ({"storage": "r8"}, "storage: must be one of rg32f, rg16f"),
    ],
)
def test_errors_are_one_line(change: dict[str, Any], message: str) -> None:
    given = {"geometry": scene(), "directions": [UP], "solid_angles": NARROW}
    with pytest.raises(ValueError, match=message) as caught:
        shadow_maps(**{**given, **change})
    assert "\n" not in str(caught.value)


def test_shadows_need_places() -> None:
    points = SurfacePoints(UP, None, UP)
    maps = shadow_maps(scene(), [UP], NARROW, 16)
    with pytest.raises(ValueError, match="points: must have positions for shadows"):
        maps.visibility(points)


def test_visibility_of_something_else_is_refused() -> None:
    with pytest.raises(ValueError, match="regions: must be Regions, got 'list'"):
        region_visibility(ground(np.zeros((1, 3))), scene(), [])  # type: ignore[arg-type]
