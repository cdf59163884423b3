"""Rays against shapes: closed forms, implicit functions, brute force, Embree."""

import math
import pathlib

import numpy as np
import numpy.typing as npt
import pytest
import tolerances
from hypothesis import given
from hypothesis import strategies as st

from glossy.cubemap import locate
from glossy.frames import dot, normalise
from glossy.scenes.geometry import Geometry
from glossy.scenes.lightmaps import surface_points
from glossy.scenes.shapes import Box, Mesh, Rectangle, Shape, Sphere, Torus, Transform

Array = npt.NDArray[np.float64]

PLACES: list[tuple[Shape, Transform]] = [
    (Sphere(0.8), Transform((0.3, -0.2, 0.1), (1.0, 0.5, 1.5), (20.0, 30.0, 40.0))),
    (Box((1.0, 2.0, 0.6)), Transform((-0.4, 0.1, 0.2), 0.9, (10.0, -50.0, 70.0))),
    (Rectangle((3.0, 2.0)), Transform((0.1, 0.2, -0.3), 1.0, (-70.0, 15.0, 5.0))),
    (Torus(1.0, 0.3), Transform((0.2, 0.0, -0.1), (1.2, 1.0, 0.8), (25.0, 0.0, -35.0))),
    (Torus(1.0, 0.95), Transform()),
]


def rays(count: int, seed: int = 0) -> tuple[Array, Array]:
    """Rays between points in a cube of half edge 3."""
    draw = np.random.default_rng(seed)
    start, aim = draw.uniform(-3, 3, (count, 3)), draw.uniform(-1, 1, (count, 3))
    return start, normalise(aim - start)


def implicit(shape: Shape, x: Array) -> Array:
    """Zero on the unit shape, of one sign inside."""
    if isinstance(shape, Sphere):
        return np.asarray(np.linalg.norm(x, axis=-1) - 1.0)
    if isinstance(shape, Box):
        return np.asarray(np.abs(x).max(axis=-1) - 1.0)
    if isinstance(shape, Torus):
        ring = np.hypot(x[..., 0], x[..., 2]) - 1.0
        return np.asarray(np.hypot(ring, x[..., 1]) - shape.tube / shape.radius)
    return np.asarray(x[..., 2])


def local(geometry: Geometry, x: Array, w: float = 1.0) -> Array:
    matrix = geometry.inverses[0]
    return np.asarray(x @ matrix[:, :3].T + w * matrix[:, 3])


SOLIDS = [p for p in PLACES if not isinstance(p[0], Rectangle)]


@pytest.mark.parametrize("place", SOLIDS, ids=lambda p: type(p[0]).__name__)
def test_the_first_hit_is_where_a_fine_march_first_crosses_the_surface(
    place: tuple[Shape, Transform],
) -> None:
    """Steps of 0.008: what the march finds the kernel finds, there and not before.

    The march misses chords shorter than a step, the kernel may not.
    """
    geometry = Geometry([place])
    start, along = rays(800)
    hits = geometry.intersect(start, along)
    t = np.linspace(0.0, 10.0, 1251)
    x = local(geometry, start)[:, None] + t[:, None] * local(geometry, along, 0.0)[:, None]
    outside = implicit(place[0], x) > 0.0
    changed = outside[:, 1:] != outside[:, :-1]
    marched = changed.any(axis=1)
    assert marched.sum() > 100
    assert not np.any(marched & ~hits.found)
    first = t[1:][changed.argmax(axis=1)]
    near = np.abs(hits.distance - first) <= 0.008 + 1e-9
    assert np.sum(hits.found & ~(marched & near)) <= 8
    np.testing.assert_array_equal(geometry.occluded(start, along), hits.found)


def test_a_rectangle_is_a_bounded_plane() -> None:
    shape, transform = PLACES[2]
    geometry = Geometry([(shape, transform)])
    start, along = rays(2000)
    right, up, normal = transform.matrix()[:, :3].T
    to = np.asarray(transform.position) - start
    t = (to @ normal) / (along @ normal)
    x = t[:, None] * along - to
    assert isinstance(shape, Rectangle)
    inside = (np.abs(x @ right) <= shape.size[0] / 2) & (np.abs(x @ up) <= shape.size[1] / 2)
    hits = geometry.intersect(start, along)
    np.testing.assert_array_equal(hits.found, inside & (t > 0.0))
    np.testing.assert_allclose(hits.distance[hits.found], t[hits.found], rtol=1e-12)
    np.testing.assert_array_equal(geometry.occluded(start, along), hits.found)


@pytest.mark.parametrize("place", PLACES, ids=lambda p: type(p[0]).__name__)
def test_hits_lie_on_the_surface_with_a_frame_that_fits_it(place: tuple[Shape, Transform]) -> None:
    geometry = Geometry([place])
    start, along = rays(4000, 1)
    hits = geometry.intersect(start, along)
    on = hits.found
    x = hits.position[on]
    np.testing.assert_allclose(implicit(place[0], local(geometry, x)), 0.0, atol=1e-12)
    np.testing.assert_allclose(x, start[on] + hits.distance[on, None] * along[on], atol=1e-12)
    n, s = hits.normal[on], hits.tangent[on]
    for a, b, value in ((n, n, 1.0), (s, s, 1.0), (n, s, 0.0)):
        np.testing.assert_allclose(dot(a, b), value, atol=tolerances.ROUNDOFF)
    # the chart's inverse gives the point and its normal back
    for part in np.unique(hits.part[on]):
        here = hits.part[on] == part
        uv = hits.uv[on][here]
        assert uv.min() >= 0.0
        assert uv.max() <= 1.0
        place_, normal = surface_points(geometry, 0, int(part), uv[:, 0], uv[:, 1])
        np.testing.assert_allclose(place_, x[here], atol=1e-9)
        np.testing.assert_allclose(normal, n[here], atol=1e-7)
    facing = dot(along[on], n) < 0.0
    if isinstance(place[0], Rectangle):
        assert facing.all()
        np.testing.assert_array_equal(hits.front[on], hits.part[on] == 0)
    else:
        np.testing.assert_array_equal(facing, hits.front[on])
    low, high = geometry.boxes[0]
    assert np.all(x >= low - 1e-12)
    assert np.all(x <= high + 1e-12)


def test_bounding_boxes_are_tight() -> None:
    for place in PLACES:
        geometry = Geometry([place])
        u, v = np.meshgrid(np.linspace(0, 1, 200), np.linspace(0, 1, 200))
        parts = 6 if isinstance(place[0], Box) else 1
        x = np.concatenate([surface_points(geometry, 0, k, u, v)[0] for k in range(parts)])
        flat = x.reshape(-1, 3)
        np.testing.assert_allclose(flat.min(axis=0), geometry.boxes[0, 0], atol=2e-3)
        np.testing.assert_allclose(flat.max(axis=0), geometry.boxes[0, 1], atol=2e-3)


@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 0.999))
def test_thin_and_fat_tori_from_any_side(seed: int, ratio: float) -> None:
    """A ray aimed at a point of the surface hits it, or something of the torus before it."""
    draw = np.random.default_rng(seed)
    geometry = Geometry([(Torus(1.0, ratio), Transform())])
    u, v = draw.random((2, 50))
    x, normal = surface_points(geometry, 0, 0, u, v)
    start = x + draw.uniform(0.1, 5.0, (50, 1)) * normalise(normal + draw.normal(size=(50, 3)) / 2)
    gap = np.linalg.norm(x - start, axis=-1)
    hits = geometry.intersect(start, x - start)
    head_on = dot(normalise(x - start), normal) < -0.1
    assert np.all(hits.found[head_on])
    assert np.all(hits.distance[head_on] <= gap[head_on] + 1e-9)
    np.testing.assert_allclose(implicit(Torus(1.0, ratio), hits.position[head_on]), 0.0, atol=1e-12)


def test_the_nearest_of_many_wins_and_a_skipped_object_is_not_there() -> None:
    geometry = Geometry(PLACES)
    start, along = rays(3000, 2)
    hits = geometry.intersect(start, along)
    each = np.array([Geometry([p]).intersect(start, along).distance for p in PLACES])
    np.testing.assert_array_equal(hits.distance, each.min(axis=0))
    found = np.isfinite(each.min(axis=0))
    np.testing.assert_array_equal(hits.object, np.where(found, each.argmin(axis=0), -1))
    without = geometry.intersect(start, along, skip=1)
    np.testing.assert_array_equal(without.distance, np.delete(each, 1, axis=0).min(axis=0))
    limit = np.nextafter(hits.distance, 0.0)
    assert not geometry.intersect(start, along, far=limit).found.any()
    assert not geometry.occluded(start, along, far=limit).any()
    past = geometry.intersect(start[found], along[found], near=4.0)
    assert np.all(past.distance > 4.0)


def test_box_faces_are_charted_as_a_cube_map() -> None:
    geometry = Geometry([(Box((2.0, 2.0, 2.0)), Transform())])
    _, along = rays(500, 3)
    hits = geometry.intersect(-5.0 * along, along)
    face, s, t = locate(hits.position)
    np.testing.assert_array_equal(hits.part, face)
    np.testing.assert_allclose(hits.uv, np.column_stack([s + 1.0, t + 1.0]) / 2.0, atol=1e-12)


def test_rotations_turn_about_x_then_y_then_z() -> None:
    turned = Transform(rotation=(90.0, 0.0, 90.0)).matrix()[:, :3]
    np.testing.assert_array_equal(turned @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(turned @ [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    angle = Transform(rotation=(0.0, 30.0, 0.0)).matrix()[:, :3] @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(angle, [0.5, 0.0, math.sqrt(0.75)], atol=1e-15)


def icosphere(path: pathlib.Path, levels: int = 5) -> pathlib.Path:
    trimesh = pytest.importorskip("trimesh", reason="the extra 'mesh' is not installed")
    pytest.importorskip("embreex", reason="the extra 'mesh' is not installed")
    trimesh.creation.icosphere(levels).export(path)
    return path


def test_a_fine_mesh_of_a_sphere_is_met_as_the_sphere(tmp_path: pathlib.Path) -> None:
    """20480 triangles lie within 0.0006 below the sphere; normals differ by half an edge."""
    file = icosphere(tmp_path / "ball.ply")
    where = Transform((0.3, -0.2, 0.4), 0.8, (10.0, 20.0, 30.0))
    mesh, ball = Geometry([(Mesh(str(file)), where)]), Geometry([(Sphere(0.8), where)])
    ball = Geometry([(Sphere(1.0), where)])
    start, along = rays(5000, 4)
    outside = np.linalg.norm(start - where.position, axis=-1) > 0.85
    start, along = start[outside], along[outside]
    a, b = mesh.intersect(start, along), ball.intersect(start, along)
    assert np.mean(a.found != b.found) < 2e-3  # the silhouette
    clear = a.found & b.found & (dot(along, b.normal) < -0.2)
    assert clear.sum() > 300
    np.testing.assert_allclose(a.distance[clear], b.distance[clear], atol=0.8 * 6e-4 / 0.2)
    np.testing.assert_allclose(dot(a.normal[clear], b.normal[clear]), 1.0, atol=1e-3)
    np.testing.assert_allclose(dot(a.tangent[clear], a.normal[clear]), 0.0, atol=1e-12)
    np.testing.assert_array_equal(mesh.occluded(start, along), a.found)
    assert mesh.closed(0)
    np.testing.assert_allclose(mesh.boxes, ball.boxes, atol=1e-3)
    both = Geometry([(Sphere(0.1), Transform((0.3, -0.2, 0.4))), (Mesh(str(file)), where)])
    assert set(both.intersect(start, along).object) == {-1, 1}


def test_an_open_mesh_faces_the_ray(tmp_path: pathlib.Path) -> None:
    icosphere(tmp_path / "unused.ply", 0)
    file = tmp_path / "triangle.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    geometry = Geometry([(Mesh(str(file), smooth=False), Transform())])
    hits = geometry.intersect([[0.2, 0.3, 2.0], [0.2, 0.3, -2.0]], [[0, 0, -1], [0, 0, 1]])
    np.testing.assert_allclose(hits.normal, [[0, 0, 1], [0, 0, -1]])
    np.testing.assert_allclose(hits.uv, [[0.2, 0.3]] * 2, atol=1e-12)
    np.testing.assert_array_equal(hits.front, [True, False])
    assert not geometry.closed(0)


def test_refusals(tmp_path: pathlib.Path) -> None:
    geometry = Geometry([(Sphere(), Transform())])
    with pytest.raises(ValueError, match="origins: must broadcast"):
        geometry.intersect(np.zeros((2, 3)), np.ones((3, 3)))
    with pytest.raises(ValueError, match="directions: must not contain a zero"):
        geometry.intersect(np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="origins: must be finite"):
        geometry.intersect([0, 0, math.nan], np.ones(3))
    with pytest.raises(FileNotFoundError, match="file: no such mesh file"):
        Mesh(str(tmp_path / "none.ply"))
    bad = tmp_path / "bad.ply"
    bad.write_text("nothing")
    with pytest.raises(ValueError, match=r"objects\[0\]\.shape\.file: .*no mesh"):
        Geometry([(Mesh(str(bad)), Transform())])
