"""Planar reflectors: the mirror pass, its pyramid, the mapping of samples, and their shading."""

from typing import Any, cast

import numba
import numpy as np
import numpy.typing as npt
import planar_twin
import pytest
import rooms
import tolerances
from hypothesis import given
from hypothesis import strategies as st

import glossy
from glossy import Lobe, Material, SurfacePoints
from glossy.camera import Camera
from glossy.footprint import border_sines
from glossy.frames import dot, normalise, reflect
from glossy.planar import (
    Fallback,
    MirrorBuffer,
    build_levels,
    map_samples,
    mirror_camera,
    planar_pattern,
    reflector_plane,
    render_mirror,
    shade_planar,
)
from glossy.planar.shade import shade_counted
from glossy.scenes.geometry import Geometry, Hits
from glossy.scenes.shapes import Box, Rectangle, Sphere, Transform

Array = npt.NDArray[np.float64]

ROOM = (Box(tuple(rooms.HIGH - rooms.LOW)), Transform(tuple(0.5 * (rooms.HIGH + rooms.LOW))))
FLOOR = (Rectangle((4.0, 5.0)), Transform((0.0, 0.0, 0.0), rotation=(-90.0, 0.0, 0.0)))
CUBE = (Box((0.6, 0.6, 0.6)), Transform((0.3, 0.35, -0.9), rotation=(0.0, 30.0, 0.0)))
EYE = Camera((0.4, 1.3, 2.2), (0.0, 0.3, -1.0), fov=60.0, width=37, height=24)


class World:
    """Shapes of a procedural colour under a sky of another: what the mirror pass is shown."""

    def __init__(self, *shapes: Any, sky: float = 0.7, constant: bool = False) -> None:
        self.geometry = Geometry(list(shapes))
        self.sky, self.constant = sky, constant

    def of_hits(self, hits: Hits, directions: Array) -> Array:
        colour = np.where(hits.found[..., None], rooms.wall_colour(hits.position), self.sky)
        return np.ones_like(colour) if self.constant else np.asarray(colour)


def buffer_of(world: World, camera: Camera = EYE, **options: float) -> MirrorBuffer:
    point, normal = reflector_plane(world.geometry, 0)
    return render_mirror(cast(Any, world), 0, mirror_camera(camera, point, normal, **options))


def floor_points(camera: Camera = EYE) -> SurfacePoints:
    """What the camera sees of the plane y = 0 at its pixels' centres."""
    rays = camera.rays().reshape(-1, 3)
    rays = rays[rays[:, 1] < -0.05]
    place = np.asarray(camera.position) - rays * (camera.position[1] / rays[:, 1:2])
    inside = np.all(np.abs(place[:, [0, 2]]) < [2.0, 2.5], axis=1)
    up = np.broadcast_to([0.0, 1.0, 0.0], rays[inside].shape)
    side = np.broadcast_to([1.0, 0.0, 0.0], rays[inside].shape)
    return SurfacePoints(up, side, -rays[inside], position=place[inside])


@pytest.fixture(scope="module")
def room() -> MirrorBuffer:
    """A procedural room with a cube, over its floor."""
    return buffer_of(World(FLOOR, ROOM, CUBE), margin=0.1)


@pytest.fixture(scope="module")
def fallback() -> Fallback:
    return Fallback(glossy.build_pyramid(rooms.capture(16)), rooms.CENTRE)


# --- mirror pass ----------------------------------------------------------------------------------


@pytest.mark.parametrize("margin", [0.0, 0.2])
def test_a_pixel_of_the_buffer_is_the_reflected_ray_of_the_picture(margin: float) -> None:
    """Closed form: the slabs of the room, from the point of the floor along the reflected ray."""
    buffer = buffer_of(World(FLOOR, ROOM), margin=margin)
    points = floor_points()
    assert points.position is not None
    assert len(points.position) > 300
    at = buffer.camera.project(points.position)
    column, row = np.floor(at).astype(int).T
    np.testing.assert_allclose(at - np.floor(at), 0.5, atol=1e-9)  # pixel centres stay centres
    wi = reflect(points.view, points.normal)
    expected = rooms.ray_cast(points.position, wi)
    np.testing.assert_allclose(buffer.radiance[row, column], expected, rtol=1e-6)
    place = buffer.position[row, column]
    np.testing.assert_allclose(normalise(place - points.position), wi, atol=1e-9)
    walls = np.abs(dot(buffer.normal[row, column], wi))
    assert np.all(walls > 0.0)
    assert buffer.hit[row, column].all()


def test_scale_and_margin_keep_the_picture_in_its_place() -> None:
    point, normal = np.zeros(3), np.array([0.0, 3.0, 0.0])
    plain = mirror_camera(EYE, point, normal)
    finer = mirror_camera(EYE, point, -normal, scale=2.0, margin=0.25)
    assert (plain.width, plain.height) == (37, 24)
    assert (finer.width, finer.height) == (74 + 24, 48 + 24)
    x = np.random.default_rng(1).uniform([-2, 0, -2], [2, 2, 0], (50, 3))
    np.testing.assert_allclose(finer.project(x), 2.0 * plain.project(x) + 12.0, rtol=1e-12)
    rays = finer.rays()
    centres = finer.project(finer.position + 3.0 * rays)
    np.testing.assert_allclose(centres[5, 7], [7.5, 5.5], rtol=1e-12)
    assert np.isnan(plain.project(plain.position - rays[0, 0])).all()


def test_everything_behind_the_plane_is_clipped() -> None:
    """A ball below a glass table in the air: the buffer shows what is above, or the sky."""
    table = (Rectangle((1.0, 1.0)), Transform((0.0, 0.5, 0.0), rotation=(-90.0, 0.0, 0.0)))
    ball = (Sphere(0.2), Transform((0.0, 0.2, 0.0)))
    above = (Sphere(0.2), Transform((0.0, 0.9, -0.2)))
    buffer = buffer_of(World(table, ball, above))
    assert buffer.hit.sum() > 5
    assert np.all(buffer.position[buffer.hit][:, 1] > 0.5)
    sky = buffer.covered & ~buffer.hit
    np.testing.assert_array_equal(buffer.radiance[sky], np.float32(0.7))
    beyond = ~buffer.covered
    assert beyond.any()  # above the plane's horizon
    np.testing.assert_array_equal(buffer.radiance[beyond], 0.0)


def test_a_room_does_not_let_the_sky_in_at_the_end_of_its_floor() -> None:
    """Beyond the floor's end pixels see past the wall: they would bleed into those before it."""
    wall = (Rectangle((6.0, 4.0)), Transform((0.0, 2.0, -2.5)))
    buffer = buffer_of(World(FLOOR, wall, sky=1000.0))
    assert buffer.doubtful is not None
    assert np.all(~buffer.hit[buffer.doubtful])
    points = floor_points()
    assert points.position is not None
    last = points.position[:, 2] < -2.3
    assert last.sum() > 5
    found = shade_planar(points[last], Lobe(1e-4, alpha=0.5), buffer, precision="double")
    assert found.max() < 5.0  # the wall's colours, not the sky
    # in the open the same pixels are the sky that the plane mirrors
    open_ = buffer_of(World(FLOOR, sky=1000.0))
    assert open_.doubtful is not None
    assert not open_.doubtful.any()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: mirror_camera(EYE, [0, 1.3, 0], [0, 1, 0]), "camera.position: must not lie"),
        (lambda: mirror_camera(EYE, [0, 0, 0], [0, 0, 0]), "normal: must not contain a zero"),
        (lambda: mirror_camera(EYE, [0, 0], [0, 1, 0]), "point: must be three"),
        (lambda: mirror_camera(EYE, [0, 0, 0], [0, 1, 0], scale=0.0), r"scale: must be in \(0"),
        (lambda: mirror_camera(EYE, [0, 0, 0], [0, 1, 0], margin=-1.0), r"margin: must be in \[0"),
        (lambda: reflector_plane(Geometry([ROOM]), 0), "must be a rectangle"),
        (lambda: build_levels(np.zeros((4, 4))), r"radiance: must have shape \(H, W, 3\)"),
        (lambda: build_levels(np.ones((4, 4, 3)), filter="round"), "filter: must be one of box"),
        (lambda: build_levels(np.full((4, 4, 3), np.nan)), "radiance: must be finite"),
        (lambda: build_levels(np.ones((4, 4, 3)), np.ones(4)), "weights: must have shape"),
        (lambda: build_levels(np.ones((4, 4, 3))).sample(np.nan, 0.0), "x: must not be NaN"),
    ],
)
def test_bad_input_is_one_line(call: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()


# --- pyramid --------------------------------------------------------------------------------------


@given(
    st.integers(1, 40), st.integers(1, 40), st.sampled_from(["box", "gauss4", "gauss6"]),
    st.integers(0, 1000),
)  # fmt: skip
def test_a_constant_picture_stays_constant_holes_and_all(
    height: int, width: int, filter: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    covered = rng.random((height, width)) < 0.7
    covered[rng.integers(height), rng.integers(width)] = True
    levels = build_levels(np.full((height, width, 3), 0.37), covered, filter)
    assert levels.levels[-1].shape == (1, 1, 4)
    x, y, lod = rng.uniform(-3, 44, 30), rng.uniform(-3, 44, 30), rng.uniform(-1, 8, 30)
    found = levels.sample(x, y, lod, precision="double")
    black = np.all(found == 0.0, axis=-1)  # nothing covered around: only in the finest levels
    np.testing.assert_allclose(found[~black], 0.37, rtol=tolerances.SINGLE)
    assert not black[lod > 6].any()


@pytest.mark.parametrize("filter", ["box", "gauss4", "gauss6"])
def test_levels_are_those_of_the_plain_twin(filter: str) -> None:
    rng = np.random.default_rng(3)
    covered = rng.random((13, 22)) < 0.8
    made = build_levels(rng.random((13, 22, 3)), covered, filter)
    twin = [made.levels[0].astype(np.float64)]
    while max(twin[-1].shape[:2]) > 1:
        twin.append(planar_twin.halve(twin[-1], filter))
    assert [a.shape for a in twin] == [a.shape for a in made.levels]
    for a, b in zip(made.levels, twin, strict=True):
        np.testing.assert_allclose(a, b, atol=tolerances.SINGLE)
    x, y, lod = rng.uniform(-1, 23, 40), rng.uniform(-1, 14, 40), rng.uniform(-0.5, 6, 40)
    expected = [planar_twin.look_up(twin, *p) for p in np.column_stack([x, y, lod])]
    found = made.sample(x, y, lod, precision="double")
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("filter", ["box", "gauss4", "gauss6"])
def test_levels_stay_in_register_for_odd_sizes(filter: str) -> None:
    """A ramp is what it is at every level, away from the edges."""
    y, x = np.mgrid[:83, :101] + 0.5
    ramp = np.stack([x, y, x + 2.0 * y], axis=-1)
    levels = build_levels(ramp, filter=filter)
    at = np.random.default_rng(5).uniform(38.0, 44.0, (20, 2))
    for lod in (0.0, 1.0, 2.5, 3.0):
        found = levels.sample(at[:, 0], at[:, 1], lod, precision="double")
        np.testing.assert_allclose(found[:, :2], at, rtol=1e-5)


# --- mapping --------------------------------------------------------------------------------------


def wall_world(angle: float = 0.0) -> World:
    wall = (Rectangle((90.0, 60.0)), Transform((0.0, 5.0, -4.0), rotation=(0.0, angle, 0.0)))
    return World(FLOOR, wall)


def towards_wall(count: int, seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    place = rng.uniform([-0.8, 0.0, -1.0], [0.8, 0.0, 1.0], (count, 3))
    target = rng.uniform([-5.0, 0.2, -4.0], [5.0, 3.0, -4.0], (count, 3))
    return place, normalise(target - place)


@pytest.mark.parametrize("intersections", [1, 2])
@pytest.mark.parametrize("angle", [0.0, 25.0])
def test_a_single_wall_is_met_where_it_is(intersections: int, angle: float) -> None:
    world = wall_world(angle)
    buffer = buffer_of(world)
    x, w = towards_wall(200, 1)
    found = map_samples(buffer, x, w, intersections)
    hits = world.geometry.intersect(x, w, skip=0)
    assert hits.found.all()
    expected = buffer.camera.project(hits.position)
    np.testing.assert_allclose(np.stack([found.x, found.y], axis=-1), expected, rtol=1e-7)
    np.testing.assert_allclose(found.distance, hits.distance, rtol=1e-8)
    size = [buffer.camera.width, buffer.camera.height]
    np.testing.assert_array_equal(
        found.kind("outside"), ~np.all((expected >= 0) & (expected < size), axis=-1)
    )
    assert found.kind("outside").any()
    assert not found.kind("outside").all()


@pytest.mark.parametrize("sky", [False, True])
def test_pixels_per_solid_angle_are_the_derivative_of_the_mapping(sky: bool) -> None:
    buffer = buffer_of(World(FLOOR) if sky else wall_world(25.0))
    x, w = towards_wall(100, 2)
    found = map_samples(buffer, x, w)
    one = normalise(np.cross(w, [0.3, 1.0, 0.2]))
    two, step = np.cross(w, one), 1e-5
    ends = [map_samples(buffer, x, w + step * d) for d in (one, -one, two, -two)]
    pixels = [np.stack([m.x, m.y], axis=-1) for m in ends]
    du, dv = (pixels[0] - pixels[1]) / (2 * step), (pixels[2] - pixels[3]) / (2 * step)
    area = np.abs(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0])
    np.testing.assert_allclose(found.density, area, rtol=1e-6)
    assert found.kind("sky").all() == sky


def test_the_sky_is_met_at_infinity() -> None:
    buffer = buffer_of(World(FLOOR))
    x, w = towards_wall(50, 3)
    found = map_samples(buffer, x, w)
    far = buffer.camera.project(buffer.camera.position + w)
    np.testing.assert_allclose(np.stack([found.x, found.y], axis=-1), far, rtol=1e-9)
    assert np.isinf(found.distance).all()
    assert found.counts().sky == 50


def test_every_miss_is_told_apart() -> None:
    buffer = buffer_of(wall_world())
    x = np.array([0.0, 0.0, 0.0])
    away = map_samples(buffer, x, [0.0, 0.2, 1.0])  # from the wall, towards the eye and beyond
    assert away.kind("unmet").all()
    assert away.kind("behind").all()
    assert away.missed.all()
    assert np.isnan(away.x)
    wide = map_samples(buffer, x, [1.0, 0.1, -0.3])
    assert wide.kind("outside").all()
    assert not wide.kind("unmet").any()
    # the cube's side has no part in what lies beyond it, whose plane is met; its own is not
    scene = buffer_of(World(FLOOR, CUBE))
    points = floor_points()
    assert points.position is not None
    wi = normalise(reflect(points.view, points.normal) + np.array([0.25, 0.0, 0.0]))
    counts = map_samples(scene, points.position, wi).counts()
    assert counts.samples == len(points.position)
    assert 0 < counts.sky < counts.samples
    assert counts.missed == counts.behind + counts.outside > 0


def test_a_second_plane_finds_what_lies_beyond_an_edge() -> None:
    """Fig. 4.31: where sample and mirror ray meet different things, one plane errs by far more."""
    world = World(FLOOR, ROOM, CUBE)
    buffer = buffer_of(world, scale=4.0)
    points = floor_points()
    assert points.position is not None
    wi = normalise(reflect(points.view, points.normal) + np.array([0.12, 0.05, 0.0]))
    truth = world.geometry.intersect(points.position, wi, near=1e-6, skip=0)
    mirror = world.geometry.intersect(
        points.position, reflect(points.view, points.normal), near=1e-6, skip=0
    )
    pixel = buffer.camera.project(truth.position)
    along = normalise(truth.position - buffer.camera.position)
    height = -buffer.camera.position[1]
    start = buffer.camera.position + along * (height / along[:, 1])[:, None]
    seen = world.geometry.intersect(start, along, near=1e-6, skip=0)
    visible = np.linalg.norm(seen.position - truth.position, axis=-1) < 1e-6
    crossed = visible & (truth.object != mirror.object)
    assert crossed.sum() > 5
    error = []
    for intersections in (1, 2):
        found = map_samples(buffer, points.position, wi, intersections)
        off = np.hypot(found.x - pixel[:, 0], found.y - pixel[:, 1])
        error.append(np.median(off[crossed & ~found.missed]))
    assert error[1] < 0.05 * error[0]


# --- shading --------------------------------------------------------------------------------------

CASES: list[tuple[Lobe, dict[str, Any]]] = [
    (Lobe(0.08, r0=(0.2, 0.5, 0.9), alpha=0.5), {"level": "ellipse"}),
    (Lobe(0.15), {"level": "sample", "bias": -0.5, "filter": "gauss6", "kind": "ring"}),
    (Lobe(0.02, 0.2, ks=0.6), {"level": "ellipse", "filter": "gauss4", "intersections": 1}),
    (Lobe(0.1), {"level": "none", "kind": "importance", "samples": 21}),
    (Lobe(0.25, 0.1), {"level": "sample", "kind": "regular", "samples": 20, "threshold": 0.1}),
    (Lobe(0.3), {"level": "sample", "estimator": "4.23", "samples": 13}),
]


@pytest.mark.parametrize("cubed", [False, True])
@pytest.mark.parametrize(("lobe", "options"), CASES)
def test_shading_is_the_plain_twin(
    room: MirrorBuffer, fallback: Fallback, lobe: Lobe, options: dict[str, Any], cubed: bool
) -> None:
    points = floor_points()[::29]
    assert points.position is not None
    spare = fallback if cubed else None
    found = shade_planar(points, lobe, room, fallback=spare, precision="double", **options)
    twin = planar_twin.Twin(room, options.get("filter", "box"))
    kind, xi = options.get("kind", "auto"), options.get("threshold", 0.01)
    pattern = planar_pattern(lobe, options.get("samples", 10), kind, xi)
    summed = {"regular": "paper", "importance": "importance"}
    for k in range(len(points.position)):
        frame = np.stack([points.tangent[k], points.bitangent[k], points.normal[k]])
        expected = planar_twin.shade(
            twin, points.position[k], frame, points.view[k], lobe, pattern,
            options.get("estimator", summed.get(kind, "4.25")), options["level"],
            options.get("bias", 0.0), options.get("intersections", 2) == 2,
            border_sines(*lobe.widths, xi), spare,
        )  # fmt: skip
        np.testing.assert_allclose(found[k], expected, rtol=1e-6)


def test_single_precision_is_double_up_to_rounding(room: MirrorBuffer) -> None:
    points = floor_points()
    found = [shade_planar(points, Lobe(0.1), room, precision=p) for p in ("single", "double")]
    assert found[0].dtype == np.float32
    off = np.abs(found[0] / found[1] - 1.0).max(axis=-1)
    # a pixel position that rounds across a border between planes picks another one
    assert np.mean(off > 1e-3) < 0.01


def test_under_constant_light_a_plane_reflects_what_the_cube_map_methods_do() -> None:
    buffer = buffer_of(World(FLOOR, ROOM, CUBE, constant=True))
    points = floor_points()
    white = glossy.build_pyramid(glossy.environment("white", size=16))
    for lobe, kind in ((Lobe(0.2, alpha=0.5, r0=0.3), "multi-ring"), (Lobe(0.05, 0.3), "line")):
        pattern = planar_pattern(lobe, 13, kind)
        found = shade_planar(points, lobe, buffer, pattern=pattern)
        expected = glossy.shade(points, lobe, white, method="thesis", pattern=pattern)
        np.testing.assert_allclose(found, expected, rtol=1e-5)
    lobe = Lobe(0.2)
    found = shade_planar(points, lobe, buffer, kind="importance", samples=4096)
    albedo, _ = Material(reflection=[lobe]).albedo(points.local_view)
    np.testing.assert_allclose(found, np.asarray(albedo)[:, None] * np.ones(3), rtol=2e-3)


def test_a_sharp_lobe_shows_the_mirror_image() -> None:
    buffer = buffer_of(World(FLOOR, ROOM), scale=4.0)
    points = floor_points()
    assert points.position is not None
    found = shade_planar(points, Lobe(1e-4, r0=0.5, alpha=0.5), buffer)
    cos = dot(points.view, points.normal)
    fresnel = 0.5 + 0.5 * (1.0 - cos) ** 5
    image = rooms.ray_cast(points.position, reflect(points.view, points.normal))
    # bilinear over a quarter of a pixel, but for pixels with a corner of the room in them
    off = np.abs(found / (fresnel[:, None] * image) - 1.0)
    assert np.median(off) < 1e-3
    assert np.quantile(off, 0.9) < 5e-3


def test_misses_are_counted_and_read_elsewhere(fallback: Fallback) -> None:
    narrow = Camera(EYE.position, EYE.target, fov=25.0, width=37, height=24)
    buffer = buffer_of(World(FLOOR, ROOM), narrow)
    points = floor_points(narrow)
    lobe = Lobe(0.2)
    edge, counts = shade_counted(points, lobe, buffer)
    assert 0 < counts.missed < counts.samples
    wi = reflect(points.local_view[:, None], planar_pattern(lobe).half_vectors)
    frame = np.stack([points.tangent, points.bitangent, points.normal], axis=1)
    assert points.position is not None
    at, _ = np.nonzero(wi[..., 2] > 0.0)
    w = np.einsum("pki,pij->pkj", wi, frame)[wi[..., 2] > 0.0]
    mapped = map_samples(buffer, points.position[at], w)
    assert mapped.counts() == shade_counted(points, lobe, buffer, precision="double")[1]
    cube = shade_planar(points, lobe, buffer, fallback=fallback)
    assert np.any(np.abs(cube - edge) > 0.01)
    wider = buffer_of(World(FLOOR, ROOM), narrow, margin=2.0)
    whole, fewer = shade_counted(points, lobe, wider)
    assert fewer.missed < 0.1 * counts.missed
    # with the whole room in the buffer as the judge, the cube map is the better guess
    assert glossy.rms(cube, whole) < glossy.rms(edge, whole)


@given(
    st.floats(1e-5, 3.0), st.floats(1e-5, 3.0), st.sampled_from(["ellipse", "sample"]),
    st.integers(1, 20), st.floats(1.0, 170.0), st.integers(0, 100),
)  # fmt: skip
def test_whatever_is_asked_radiance_is_finite_and_within_bounds(
    mx: float, my: float, level: str, samples: int, fov: float, seed: int
) -> None:
    """Eq. 4.25 is a mean: at most twice the brightest light times F, see ``thesis``."""
    rng = np.random.default_rng(seed)
    eye = rng.uniform([-1.5, 0.02, -2.0], [1.5, 2.0, 2.0])
    camera = Camera(tuple(eye), tuple(eye - rng.uniform([-1, 0.1, -1], [1, 1, 1])), fov=fov,
                    width=9, height=7)  # fmt: skip
    buffer = buffer_of(World(FLOOR, CUBE), camera)
    place = np.column_stack([rng.uniform(-2, 2, 20), np.zeros(20), rng.uniform(-2.5, 2.5, 20)])
    up, side = np.broadcast_to([0.0, 1.0, 0.0], (20, 3)), np.broadcast_to([1.0, 0.0, 0.0], (20, 3))
    points = SurfacePoints(up, side, normalise(eye - place), position=place)
    found, counts = shade_counted(
        points, Lobe(mx, my), buffer, level=level, samples=samples, precision="double"
    )
    assert np.all(np.isfinite(found))
    assert found.min() >= 0.0
    assert found.max() <= 2.0 * max(buffer.radiance.max(), 1e-9) * (1.0 + 1e-9)
    assert 0 <= counts.missed <= counts.samples <= 20 * samples


def test_the_bits_do_not_depend_on_the_threads(room: MirrorBuffer) -> None:
    points = floor_points()
    threads = numba.get_num_threads()
    made = []
    for count in (1, threads):
        numba.set_num_threads(count)
        made.append(shade_planar(points, Lobe(0.1), room))
    np.testing.assert_array_equal(made[0], made[1])


def test_shading_refuses_what_it_cannot_do(room: MirrorBuffer) -> None:
    points = floor_points()
    bare = SurfacePoints(points.normal, points.tangent, points.view)
    glass = Material(reflection=[Lobe(0.1)], transmission=[Lobe(0.1)])
    cases: list[tuple[str, Any, Any, dict[str, Any]]] = [
        ("points: must have positions", bare, Lobe(0.1), {}),
        ("material: must have no transmission", points, glass, {}),
        ("level: must be one of none, ellipse", points, Lobe(0.1), {"level": "cell"}),
        ("kind: must be one of auto", points, Lobe(0.1), {"kind": "star"}),
        ("estimator: must be one of auto", points, Lobe(0.1), {"estimator": "4.26"}),
        ("intersections: must be from 1 to 2", points, Lobe(0.1), {"intersections": 3}),
    ]
    for message, p, material, options in cases:
        with pytest.raises(ValueError, match=message):
            shade_planar(p, material, room, **options)
