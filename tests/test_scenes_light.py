"""Baked light and captured cube maps against closed forms and brute force."""

import dataclasses
import math
import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from picture_files import rgb_exr

from glossy import CubeMap, Material, build_pyramid
from glossy.camera import Camera
from glossy.cubemap import texel_directions, texel_solid_angles
from glossy.frames import normalise
from glossy.scene import EnvironmentSource
from glossy.scenes import sun
from glossy.scenes.arealight import towards
from glossy.scenes.bake import bake
from glossy.scenes.capture import Radiance, capture
from glossy.scenes.geometry import Geometry
from glossy.scenes.lightmaps import LightMaps, surface_points
from glossy.scenes.model import AreaLight, BakeSettings, Checker, ObjectScene, SceneObject
from glossy.scenes.shapes import Box, Mesh, Rectangle, Shape, Sphere, Torus, Transform

Array = npt.NDArray[np.float64]
CAMERA = Camera(width=8, height=8)
DOWN, UP = Transform((0.0, 1.0, 0.0), rotation=(90.0, 0.0, 0.0)), Transform(rotation=(-90.0, 0, 0))


def scene(
    objects: list[SceneObject], lights: list[AreaLight] | None = None, **bake_: Any
) -> ObjectScene:
    return ObjectScene(tuple(objects), CAMERA, tuple(lights or []), bake=BakeSettings(**bake_))


def geometry_of(s: ObjectScene) -> Geometry:
    placed: list[tuple[Shape, Transform]] = [(o.shape, o.transform) for o in s.objects]
    return Geometry(placed + [(Rectangle(light.size), light.transform) for light in s.lights])


def baked(s: ObjectScene, sky: CubeMap | None = None) -> LightMaps:
    return bake(s, geometry_of(s), None if sky is None else build_pyramid(sky))


def wall(place: Transform, size: tuple[float, float] = (1.0, 1.0), kd: float = 0.5) -> SceneObject:
    return SceneObject(Rectangle(size, one_sided=True), place, Material(kd=kd))


def test_lamberts_formula_matches_a_fine_sum_over_the_light() -> None:
    """Points all around a light, above and below their horizon: 400 x 400 patches of it."""
    place = Transform((0.2, 1.0, 0.1), 1.0, (80.0, 10.0, 0.0))
    corners = AreaLight((1.2, 0.8), transform=place).corners()
    draw = np.random.default_rng(1)
    points = draw.uniform(-1.0, 1.0, (60, 3)) - [0.0, 0.4, 0.0]
    normals = normalise(draw.normal(size=(60, 3)))
    u, v = np.meshgrid((np.arange(400) + 0.5) / 400, (np.arange(400) + 0.5) / 400)
    e1, e2 = corners[1] - corners[0], corners[3] - corners[0]
    patch = corners[0] + u[..., None] * e1 + v[..., None] * e2
    facing = np.cross(e1, e2)
    xi = draw.random((60, 2))
    _, _, weight, whole = towards(points, normals, corners, xi)
    for p, n, value in zip(points, normals, whole, strict=True):
        d = patch - p
        square = np.sum(d * d, axis=-1)
        cosines = np.maximum(d @ n, 0.0) * np.maximum(-(d @ facing), 0.0) / square**2
        assert value == pytest.approx(cosines.mean(), rel=2e-3, abs=2e-4)  # the horizon's patches
    assert np.sum(whole > 0.05) > 10
    d = corners[0] + xi[:, :1] * e1 + xi[:, 1:] * e2 - points
    expected = np.maximum(np.sum(d * normals, -1), 0) * np.maximum(-(d @ facing), 0)
    area = np.linalg.norm(facing)
    np.testing.assert_allclose(weight, expected / np.sum(d * d, -1) ** 2 / area, rtol=1e-9)


def test_parallel_squares_exchange_their_form_factor() -> None:
    """Unit squares a unit apart: F = 0.19982 (closed form); irradiance pi F for radiance 1."""
    lit = baked(scene([wall(UP)], [AreaLight(transform=DOWN)], texel=0.05, samples=64, bounces=0))
    x = 1.0
    r = math.sqrt(1 + x * x)
    log = math.log((1 + x * x) ** 2 / (1 + 2 * x * x))
    form = (log / 2 + 2 * x * r * math.atan(x / r) - 2 * x * math.atan(x)) * 2 / (math.pi * x * x)
    assert form == pytest.approx(0.1998, abs=1e-4)
    np.testing.assert_allclose(lit.values[:400].mean(axis=0), math.pi * form, rtol=1e-3)
    assert lit.error < 1e-3  # points within texels; the light itself has no sampling error


def test_a_closed_box_that_glows_is_a_geometric_series() -> None:
    """Emission 1 and reflectivity 1/2 from everywhere: E = pi (1 + 1/2 + 1/4 + 1/8)."""
    places = [
        Transform((0.0, 0.5, 0.0), rotation=(90.0, 0, 0)),
        Transform((0.0, -0.5, 0.0), rotation=(-90.0, 0, 0)),
        Transform((0.0, 0.0, -0.5)),
        Transform((0.0, 0.0, 0.5), rotation=(0, 180.0, 0)),
        Transform((-0.5, 0.0, 0.0), rotation=(0, 90.0, 0)),
        Transform((0.5, 0.0, 0.0), rotation=(0, -90.0, 0)),
    ]
    walls = [dataclasses.replace(wall(p), emission=1.0) for p in places]
    lit = baked(scene(walls, texel=0.1, samples=64, bounces=3))
    front = lit.plan.charts[::2]
    for start, h, w, *_ in front:
        np.testing.assert_allclose(lit.values[start : start + h * w], math.pi * 1.875, rtol=1e-6)
    assert lit.error < 1e-6


def brute_force(s: ObjectScene, sky: CubeMap, point: Array, normal: Array, paths: int) -> Array:
    """Irradiance by plain path tracing without next-event estimation, (mean, standard error)."""
    geometry, draw = geometry_of(s), np.random.default_rng(7)
    light = np.array([a.radiance for a in s.lights])
    weight, total = np.ones((paths, 3)), np.zeros((paths, 3))
    x, n = np.tile(point, (paths, 1)), np.tile(normal, (paths, 1))
    alive = np.arange(paths)
    for _ in range(s.bake.bounces + 1):
        d = draw.normal(size=(len(alive), 3))
        d = normalise(n + d / np.linalg.norm(d, axis=-1, keepdims=True))  # cosine weighted
        hits = geometry.intersect(x + geometry.offset * n, d)
        miss = ~hits.found
        total[alive[miss]] += weight[alive[miss]] * sky.lookup(d[miss])
        on = hits.object >= len(s.objects)
        front = on & hits.front
        index = hits.object[front] - len(s.objects)
        total[alive[front]] += weight[alive[front]] * light[index]
        go = hits.found & ~on
        rho = np.array([o.material.diffuse for o in s.objects])[hits.object[go]]
        weight[alive[go]] *= rho
        alive, x, n = alive[go], hits.position[go], hits.normal[go]
    value = np.pi * total
    return np.stack([value.mean(axis=0), value.std(axis=0) / math.sqrt(paths)])


def test_shadows_and_bounces_match_path_tracing() -> None:
    """A light above a box and a ball on a floor beside a wall, under a coloured sky."""
    objects = [
        wall(Transform(rotation=(-90.0, 0, 0)), (3.0, 3.0), 0.6),
        wall(Transform((0.0, 1.0, -1.0)), (3.0, 2.0), 0.8),
        SceneObject(Box((0.5, 0.6, 0.5)), Transform((0.4, 0.3, 0.0)), Material(kd=(0.8, 0.3, 0.2))),
        SceneObject(Sphere(0.25), Transform((-0.5, 0.25, 0.2)), Material(kd=0.5)),
    ]
    light = AreaLight((0.8, 0.5), (4.0, 3.0, 2.0), Transform((0.2, 1.6, 0.1), 1.0, (90.0, 0, 0)))
    s = scene(objects, [light], texel=0.06, samples=256, bounces=3)
    ramp = normalise(texel_directions(8))
    sky = CubeMap(0.5 + 0.4 * ramp)
    lit = baked(s, sky)
    geometry = geometry_of(s)
    for place, aim in (
        ((-0.05, 2.0, 0.45), (0, -1, 0)),  # the floor in the open
        ((0.05, 2.0, 0.0), (0.001, -1, 0)),  # beside the box
        ((-0.5, 1.0, 0.1), (0.0, -0.6, -0.2)),  # on the ball
        ((0.3, 0.8, 1.0), (0.0, 0.0, -1.0)),  # the wall
    ):
        hit = geometry.intersect(np.array([place]), np.array([aim], dtype=float), skip=4)
        mean, error = brute_force(s, sky, hit.position[0], hit.normal[0], 40_000)
        # four sigma of the paths, and 2 % for texels that light varies across
        assert np.all(np.abs(lit.irradiance(hit)[0] - mean) < 4.0 * error + 0.02 * mean)
    assert 0.0 < lit.error < 0.02


def test_texels_inside_an_object_take_the_light_around_it() -> None:
    """A box stands on a floor under an even sky; without care its footprint would be black."""
    objects = [
        wall(Transform(rotation=(-90.0, 0, 0)), (2.0, 2.0)),
        SceneObject(Box((0.6, 0.6, 0.6)), Transform((0.0, 0.3, 0.0)), Material(kd=0.0)),
    ]
    lit = baked(scene(objects, texel=0.1, samples=64, bounces=0), CubeMap(np.ones((6, 4, 4, 3))))
    floor = lit.values[:400, 0].reshape(20, 20)
    assert floor[10, 10] > 1.0
    assert floor.max() <= math.pi * 1.001
    assert floor[0, 0] > 2.9
    assert floor[10, 14] < 2.3  # half of the sky is hidden


def test_a_checker_is_seen_and_averaged_by_the_bake() -> None:
    item = dataclasses.replace(wall(UP), checker=Checker(kd=0.1, repeat=(4.0, 4.0)))
    s = scene([item], texel=0.25, samples=16)
    geometry = geometry_of(s)
    lit = baked(s, CubeMap(np.ones((6, 4, 4, 3))))
    x = np.linspace(-0.49, 0.49, 99)
    hits = geometry.intersect(np.column_stack([x, np.ones(99), np.full(99, 0.3)]), [0.0, -1.0, 0.0])
    values = lit.radiance(hits)[:, 0]
    assert set(np.round(values, 2)) == {0.1, 0.5}
    assert np.sum(np.abs(np.diff(values)) > 0.2) == 3


def six_colours(size: float = 4.0) -> list[SceneObject]:
    """A room whose walls glow in the colour of their axis: +x red, -x cyan, ..."""
    faces = [
        (Transform((size / 2, 0, 0), rotation=(0, -90.0, 0)), (1, 0, 0)),
        (Transform((-size / 2, 0, 0), rotation=(0, 90.0, 0)), (0, 1, 1)),
        (Transform((0, size / 2, 0), rotation=(90.0, 0, 0)), (0, 1, 0)),
        (Transform((0, -size / 2, 0), rotation=(-90.0, 0, 0)), (1, 0, 1)),
        (Transform((0, 0, size / 2), rotation=(0, 180.0, 0)), (0, 0, 1)),
        (Transform((0, 0, -size / 2)), (1, 1, 0)),
    ]
    return [
        dataclasses.replace(wall(place, (size, size), 0.0), emission=colour)
        for place, colour in faces
    ]


def test_a_captured_cube_map_has_the_package_s_orientation() -> None:
    """Six glowing walls about a ball, which is not in its own map: each face has its colour."""
    ball = SceneObject(Sphere(0.5), Transform(), Material())
    s = scene([*six_colours(), ball], texel=1.0, samples=16, bounces=0)
    geometry = geometry_of(s)
    world = Radiance(s, geometry, baked(s), None)
    cube = capture(world, 6, size=8, supersampling=2)
    for face, item in zip(cube.faces, s.objects, strict=False):
        np.testing.assert_array_equal(face, np.broadcast_to(item.emission, face.shape))
    # a small patch on the +x wall, up and towards +z, appears where its direction is looked up
    patch = dataclasses.replace(
        wall(Transform((1.9, 1.0, 0.5), rotation=(0, -90.0, 0)), (0.4, 0.4), 0.0), emission=9.0
    )
    s = scene([*six_colours(), ball, patch], texel=1.0, samples=16, bounces=0)
    world = Radiance(s, geometry_of(s), baked(s), None)
    cube = capture(world, 6, size=64, supersampling=1)
    np.testing.assert_allclose(cube.lookup([1.9, 1.0, 0.5]), 9.0)
    np.testing.assert_allclose(cube.lookup([1.9, 0.5, 1.0]), [1.0, 0.0, 0.0])
    off = capture(world, 7, size=16)
    np.testing.assert_allclose(
        off.lookup([-1.9, -1.0, -0.5]), 0.0
    )  # from the patch: the black ball


def test_a_sky_shows_where_nothing_is_hit_and_lights_only_from_the_front() -> None:
    ball = SceneObject(Torus(0.5, 0.1), Transform(), Material(kd=0.5))
    light = AreaLight((4.0, 4.0), 5.0, Transform((0.0, 2.0, 0.0), 1.0, (90.0, 0.0, 0.0)))
    behind = AreaLight((4.0, 4.0), 5.0, Transform((0.0, -2.0, 0.0), 1.0, (90.0, 0.0, 0.0)))
    s = scene([ball], [light, behind], texel=0.3, samples=16, bounces=0)
    sky = CubeMap(np.full((6, 4, 4, 3), 0.25))
    world = Radiance(s, geometry_of(s), baked(s, sky), sky)
    cube = capture(world, 0, size=4)
    np.testing.assert_allclose(cube.lookup([[0, 1, 0], [1, 0, 0]]), [[5.0] * 3, [0.25] * 3])
    np.testing.assert_allclose(cube.lookup([0.01, -1, 0]), 0.0)


def test_an_environment_lights_an_open_floor(tmp_path: pathlib.Path) -> None:
    """White sky, no obstacles: E = pi; the same from an image given instead of the bake."""
    from glossy import write_image

    s = dataclasses.replace(
        scene([wall(UP)], texel=0.5, samples=16), environment=EnvironmentSource("white", 8)
    )
    white = CubeMap(np.ones((6, 8, 8, 3)))
    np.testing.assert_allclose(baked(s, white).values[:4], math.pi, rtol=1e-6)
    image = np.arange(24, dtype=np.float32).reshape(2, 4, 3)
    write_image(str(tmp_path / "map.exr"), image)
    given = dataclasses.replace(s.objects[0], light_map=str(tmp_path / "map.exr"))
    s = dataclasses.replace(s, objects=(given,))
    lit = baked(s, white)
    assert lit.error == 0.0
    # rotated by -90 degrees about x the rectangle's upper row lies at -z
    hits = geometry_of(s).intersect([[-0.375, 1.0, -0.25], [0.375, 1.0, 0.25]], [0.0, -1.0, 0.0])
    np.testing.assert_allclose(lit.irradiance(hits), image[[0, 1], [0, 3]])
    crop = rgb_exr(image, data=(0, 0, 3, 1), display=(0, 0, 3, 3))
    (tmp_path / "map.exr").write_bytes(crop)
    with pytest.raises(ValueError, match=r"map\.exr: stores only part of the picture"):
        baked(s, white)


def test_a_mesh_keeps_its_light_at_its_vertices(tmp_path: pathlib.Path) -> None:
    """A ball of 320 triangles over a black floor: the vertices see 1 - F of a white sky."""
    trimesh = pytest.importorskip("trimesh", reason="the extra 'mesh' is not installed")
    pytest.importorskip("embreex", reason="the extra 'mesh' is not installed")
    trimesh.creation.icosphere(2).export(tmp_path / "ball.ply")
    ball = SceneObject(Mesh(str(tmp_path / "ball.ply")), Transform((0, 3.0, 0)), Material(kd=0.4))
    floor = wall(Transform(rotation=(-90.0, 0, 0)), (600.0, 600.0), 0.0)
    s = scene([ball, floor], texel=10.0, samples=256, bounces=1)
    lit = baked(s, CubeMap(np.ones((6, 4, 4, 3))))
    vertices = lit.geometry.meshes[0]
    values = lit.values[: len(vertices.vertices), 0]
    # a wide floor hides (1 - n.y) / 2 of the cosine-weighted sky, but for 0.6 degrees at its end
    expected = math.pi * (1.0 + vertices.normals[:, 1]) / 2.0
    # one ray is 0.4 % of the sky, and the horizon parts 256 of them at random
    np.testing.assert_allclose(values, expected, atol=0.03 * math.pi)
    assert np.mean(values - expected) == pytest.approx(0.0, abs=0.005 * math.pi)
    hits = lit.geometry.intersect([[0.0, 9.0, 0.0], [0.0, 3.0, 9.0]], [[0, -1.0, 0], [0, 0, -1.0]])
    np.testing.assert_allclose(lit.radiance(hits)[:, 0], [0.4, 0.2], atol=0.01)


# --- a sun ----------------------------------------------------------------------------------------


def sunny(radiance: float = 4e4, size: int = 64) -> tuple[CubeMap, Array, float]:
    """A dim sky with one texel of sun: the map, where the sun stands, and its L omega in red."""
    faces = np.full((6, size, size, 3), 0.1)
    row, column = size // 2 - 12, size // 2 + 7
    faces[2, row, column] = radiance * np.array([1.0, 0.8, 0.5])
    direction = normalise(texel_directions(size))[2, row, column]
    return CubeMap(faces), direction, radiance * float(texel_solid_angles(size)[row, column])


def sun_on_floor(monkeypatch: pytest.MonkeyPatch, cap: float) -> tuple[Array, Array]:
    """Red irradiance (h, w) of a floor under a square, and where its texels are, (h, w, 3)."""
    monkeypatch.setattr(sun, "CAP", cap)
    floor = SceneObject(Rectangle((4.0, 4.0), one_sided=True), UP, Material(kd=0.5))
    block = wall(Transform((0.0, 0.5, 0.0), rotation=(-90.0, 0.0, 0.0)))
    s = scene([floor, block], texel=0.1, samples=64, bounces=0)
    maps = baked(s, sunny()[0])
    start, h, w = (int(v) for v in maps.plan.charts[0, :3])
    u, v = np.meshgrid((np.arange(w) + 0.5) / w, (np.arange(h) + 0.5) / h)
    places = surface_points(maps.geometry, 0, 0, u, v)[0]
    values = maps.values[start : start + h * w, 0].astype(np.float64)
    return values.reshape(h, w), places


def test_a_sun_lights_a_floor_and_a_square_shades_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """E = L omega cos in the open, 0 in the shadow: the square moved along the light."""
    _, direction, power = sunny()
    found, places = sun_on_floor(monkeypatch, sun.CAP)
    on = places - 0.5 / direction[1] * -direction  # where the light met the square's plane
    away = np.max(np.abs(on[..., [0, 2]]), axis=-1) - 0.5  # beyond the square's edge
    sky = math.pi * 0.1
    lit, dark = away > 0.15, away < -0.15  # a texel and half its diagonal, and the sun's width
    assert dark.sum() > 20
    assert lit.sum() > 1000
    full = power * direction[1]
    np.testing.assert_allclose(found[lit], full + sky, atol=2e-3 * full + sky)
    assert found[dark].max() <= sky * (1.0 + 1e-6)
    by_chance, _ = sun_on_floor(monkeypatch, math.inf)
    noise = [np.std(e[lit]) / full for e in (found, by_chance)]
    assert noise[0] < 0.02 * noise[1]


def test_the_split_gives_all_of_the_light() -> None:
    """Rest and bright texels add up to the map, and without bright ones it is left alone."""
    cube, direction, _ = sunny()
    pyramid = build_pyramid(cube)
    rest, bright = sun.split_bright(pyramid)
    assert bright is not None
    whole = cube.faces.astype(np.float64)
    left = whole - rest.levels[0]
    np.testing.assert_allclose(left[bright.places], bright.radiance, rtol=1e-6)
    assert np.count_nonzero(left.any(axis=-1)) == 1
    u = np.random.default_rng(2).random((4096, 2))
    d, weight = bright.sample(u)
    assert np.min(d @ direction) > math.cos(2.0 / 64)
    omega = texel_solid_angles(64)[bright.places[1], bright.places[2]]
    np.testing.assert_allclose(weight.mean(axis=0), omega @ bright.radiance, rtol=1e-3)
    grey = build_pyramid(CubeMap(np.ones((6, 8, 8, 3))))
    assert sun.split_bright(grey) == (grey, None)
