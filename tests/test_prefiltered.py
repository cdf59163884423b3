"""Stacks of filtered maps, and the method that looks them up."""

import math
import pathlib
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import pytest
import tolerances

from glossy import (
    BoundingPlanes,
    CubeMap,
    Lobe,
    Material,
    SurfacePoints,
    environment,
    methods,
    reference,
    shade,
)  # fmt: skip
from glossy.frames import normalise, to_world
from glossy.prefiltered.exact import filter_directions
from glossy.prefiltered.maps import PrefilteredMaps, prefilter
from glossy.prefiltered.stack import LobeStack
from glossy.render import render_scene, trace_pixel
from glossy.scene import EnvironmentSource, Scene, Sphere, default_camera, load_scene
from glossy.scenes.model import ObjectScene
from glossy.scenes.prepared import PreparedScene
from glossy.scenes.render import render_objects
from glossy.study.settings import parse_method

Float64Array = npt.NDArray[np.float64]
SIZE = 16
OBJECTS = """
[camera]
position = [0, 0.5, 3]
target = [0, 0, 0]
width = 12
height = 8
supersampling = 1
[environment]
source = "sky"
size = 8
[method]
name = "prefiltered"
mode = "flat"
elevations = 3
map_size = 8
[capture]
size = 8
[[planes]]
point = [0, -2, 0]
normal = [0, 1, 0]
[[objects]]
shape = { kind = "sphere" }
material = "mx=.3"
"""
ROUND = Material(reflection=[Lobe(0.2, r0=(0.9, 0.5, 0.2), alpha=0.2)])


def lobe(
    channels: int = 3, turned: bool = True, slices: int = 3, outside: bool = True
) -> LobeStack:
    """A lobe whose width, colour, weight and place all change with the view."""
    rng = np.random.default_rng(9)
    cosines, views = np.linspace(0.3, 0.9, slices), np.array([0.1, 0.5, 0.8, 1.0])
    angles = np.linspace(0.0, 1.2, 40)
    widths = np.linspace(0.15, 0.35, slices)[:, None, None]
    colour = rng.uniform(0.2, 1.0, (slices, 1, channels))
    profiles = colour * np.maximum(1.0 - (angles[:, None] / widths / 3.0) ** 2, 0.0) ** 3
    weights = rng.uniform(0.2, 1.0, (4, channels))
    theta = np.array([0.3, -0.2, 0.1, -0.4]) if turned else np.zeros(4)
    phi = np.array([0.0, 0.5, -0.7, 0.2]) if turned else np.zeros(4)
    return LobeStack(cosines, angles, profiles, views, weights, theta, phi, outside)


@pytest.fixture(scope="module")
def cube() -> CubeMap:
    return environment("studio", SIZE)


@pytest.fixture(scope="module")
def stacks() -> tuple[LobeStack, ...]:
    return lobe(), lobe(channels=1, turned=False, outside=False), lobe(slices=1)


@pytest.fixture(scope="module")
def maps(cube: CubeMap, stacks: tuple[LobeStack, ...]) -> PrefilteredMaps:
    return prefilter(cube, stacks, 16)


def points(count: int = 80, angle: float | None = None) -> SurfacePoints:
    """Random frames; views from anywhere above, or at an angle [degrees] off the normal."""
    rng = np.random.default_rng(3)
    n, t = normalise(rng.normal(size=(2, count, 3)))
    t = normalise(t - np.sum(t * n, axis=1, keepdims=True) * n)
    phi = rng.uniform(0.0, 2.0 * math.pi, (count, 1))
    cos = rng.uniform(0.02, 1.0, (count, 1)) if angle is None else math.cos(math.radians(angle))
    sin = np.sqrt(1.0 - np.square(cos))
    return SurfacePoints(n, t, sin * (np.cos(phi) * t + np.sin(phi) * np.cross(n, t)) + cos * n)


def relative(image: Any, truth: Any) -> float:
    return float(np.sqrt(np.mean(np.square(image - truth)) / np.mean(np.square(truth))))


# --- stacks ---------------------------------------------------------------------------------------


def test_every_slice_is_the_map_filtered_with_its_profile(
    cube: CubeMap, stacks: tuple[LobeStack, ...], maps: PrefilteredMaps
) -> None:
    d = normalise(np.random.default_rng(1).normal(size=(40, 3)))
    whole = prefilter(cube, stacks[0], 16, tolerance=None).stacks[0]
    assert whole.slices.shape == (3, 6, 16, 16, 3)
    for stack, made in zip(stacks, maps.stacks, strict=True):
        for cosine, profile in zip(stack.cosines, stack.profiles, strict=True):
            exact = filter_directions(cube, stack.angles, profile, d)
            assert relative(made.sample(d, cosine), exact) < tolerances.PREFILTER_MAP
    assert relative(maps.stacks[0].slices, whole.slices) < 1e-3


def test_between_slices_maps_are_mixed_as_profiles_are(maps: PrefilteredMaps) -> None:
    made, d = maps.stacks[0], points(30).normal
    low, high = made.sample(d, 0.3), made.sample(d, 0.6)
    assert np.allclose(made.sample(d, 0.5), low / 3.0 + high * 2.0 / 3.0, rtol=1e-5, atol=0.0)
    assert np.array_equal(made.sample(d, 0.01), low)
    assert np.array_equal(made.sample(d, 1.0), made.sample(d, 0.9))


def test_memory_is_what_the_texels_take(maps: PrefilteredMaps) -> None:
    assert maps.nbytes == 7 * 6 * 20 * 20 * 16
    assert repr(maps) == "PrefilteredMaps(size=16, slices=[3, 3, 1])"


# --- shading --------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", ["single", "double"])
def test_shading_is_one_lookup_for_each_lobe(maps: PrefilteredMaps, precision: str) -> None:
    """Twin by ``LobeStack``'s own NumPy: axis, factor, weight."""
    p = points()
    expected = np.zeros((80, 3))
    for made in maps.stacks:
        wo = p.local_view
        axis = to_world(made.stack.axis(wo), p.tangent, p.normal)
        light = made.sample(axis, wo[:, 2], precision="double")
        expected += made.stack.factor(wo)[:, None] * made.stack.weight(wo[:, 2]) * light
    image = shade(p, ROUND, maps, method="prefiltered", precision=precision)
    limit = 2e-5 if precision == "single" else 1e-12
    assert image.dtype == (np.float32 if precision == "single" else np.float64)
    assert relative(image, expected) < limit


def test_seen_along_the_normal_the_tangent_gives_the_azimuth(maps: PrefilteredMaps) -> None:
    n, t = np.array([[0.0, 1.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    p = SurfacePoints(n, t, n)
    made = maps.stacks[0]
    axis = to_world(made.stack.axis([[0.0, 0.0, 1.0]]), t, n)
    only = PrefilteredMaps((made,), maps.size)
    image = shade(p, ROUND, only, method="prefiltered", precision="double")
    assert np.allclose(image, made.stack.weight(1.0) * made.sample(axis, 1.0), rtol=1e-5)


def test_a_constant_map_gives_the_furnace_of_the_lobes(stacks: tuple[LobeStack, ...]) -> None:
    p = points()
    white = prefilter(CubeMap(np.full((6, 8, 8, 3), 0.7)), stacks, 8)
    image = shade(p, ROUND, white, method="prefiltered", precision="double")
    expected = sum(s.furnace(p.local_view) * np.ones(3) for s in stacks)
    assert np.abs(image / expected / 0.7 - 1.0).max() < tolerances.PREFILTER_WHITE


def test_a_material_reflects_its_albedo_under_white_light() -> None:
    white = environment("white", 8)
    p = points(60, angle=40.0)
    for mode in ("single", "flat"):
        made = methods.prepare("prefiltered", white, ROUND, mode=mode, map_size=8)
        image = shade(p, ROUND, made, method="prefiltered")
        assert relative(image, ROUND.albedo(p.local_view)[0]) < tolerances.PREFILTER_ALBEDO


def test_closer_to_the_truth_than_the_split_sum_at_grazing_views(cube: CubeMap) -> None:
    p = points(150, angle=70.0)
    truth = reference(p, ROUND, cube).radiance
    errors = []
    for name, options in (("prefiltered", {"map_size": 32}), ("split-sum", {})):
        made = methods.prepare(name, cube, ROUND, **options)
        errors.append(relative(shade(p, ROUND, made, method=name), truth))
    assert errors[0] < 0.7 * errors[1]


def test_the_same_bits_on_one_thread_and_black_behind(maps: PrefilteredMaps) -> None:
    p = points()
    with pytest.warns(UserWarning, match="points look into the surface"):
        behind = SurfacePoints(-p.normal, p.tangent, p.view)
    assert not shade(behind, ROUND, maps, method="prefiltered").any()
    image = shade(p, ROUND, maps, method="prefiltered")
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        assert np.array_equal(image, shade(p, ROUND, maps, method="prefiltered"))
    finally:
        numba.set_num_threads(before)


def test_far_bounding_planes_change_nothing_and_near_ones_do(maps: PrefilteredMaps) -> None:
    p = points()
    placed = SurfacePoints(p.normal, p.tangent, p.view, position=0.1 * p.normal)
    sides = np.concatenate([np.eye(3), -np.eye(3)])
    plain = shade(p, ROUND, maps, method="prefiltered")

    def within(distance: float) -> Any:
        walls = [(distance * side, -side) for side in sides]
        planes = BoundingPlanes([0.0, 0.0, 0.0], walls)
        return shade(placed, ROUND, maps, method="prefiltered", parallax=planes)

    assert relative(within(1e6), plain) < 1e-5
    assert relative(within(0.5), plain) > 1e-3


def test_diffuse_light_is_added(cube: CubeMap) -> None:
    p = points(5)
    matt = Material(kd=0.5)
    none = methods.prepare("prefiltered", cube, matt)
    assert none.stacks == ()
    image = shade(p, matt, none, method="prefiltered", irradiance=np.ones(3))
    assert np.allclose(image, 0.5 / math.pi)


@pytest.mark.parametrize(
    ("material", "message"),
    [
        (Material(reflection=[Lobe(0.2, 0.1)]), "isotropic"),
        (Material(reflection=[Lobe(0.2)], transmission=[Lobe(0.1)]), "transmi"),
    ],
)
def test_a_material_it_cannot_hold_is_refused(
    cube: CubeMap, material: Material, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        methods.prepare("prefiltered", cube, material)


def test_foreign_options_and_maps_are_refused(cube: CubeMap, maps: PrefilteredMaps) -> None:
    with pytest.raises(ValueError, match="samples: is no option of method 'prefiltered'"):
        shade(points(), ROUND, maps, method="prefiltered", samples=3)
    with pytest.raises(ValueError, match="prepared: must come from prefilter"):
        shade(points(), ROUND, cube, method="prefiltered")
    with pytest.raises(ValueError, match="stacks: must be LobeStack"):
        prefilter(cube, ["x"])  # type: ignore[list-item]
    with pytest.raises(ValueError, match="size: must be"):
        prefilter(cube, lobe(), 0)


def test_a_scene_is_rendered_with_it() -> None:
    scene = Scene(
        environment=EnvironmentSource("spots", 16),
        material="mx=.2",
        camera=default_camera(Sphere(), 12, 12),
        method="prefiltered",
        options={"mode": "flat", "map_size": 8, "elevations": 4},
    )
    rendering = render_scene(scene)
    assert rendering.image[rendering.seen].max() > 0.0
    assert rendering.samples == [1]
    assert rendering.options["mode"] == "flat"


def test_its_taps_are_not_traced() -> None:
    scene = Scene(
        environment=EnvironmentSource("spots", 8),
        camera=default_camera(Sphere(), 8, 8),
        method="prefiltered",
        options={"mode": "flat"},
    )
    with pytest.raises(ValueError, match="method: must be one of regular"):
        trace_pixel(scene, 4, 4)


def test_an_object_of_a_scene_is_rendered_with_it(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(OBJECTS)
    scene = load_scene(str(file))
    assert isinstance(scene, ObjectScene)
    rendering = render_objects(PreparedScene(scene, cache=False))
    assert [o["method"] for o in rendering.objects] == ["prefiltered"]
    assert rendering.image[rendering.seen].max() > 0.0


def test_a_study_names_its_modes() -> None:
    assert parse_method("prefiltered/multi").preparation == {"mode": "multi"}
    with pytest.raises(ValueError, match="must be one of single, flat, multi"):
        parse_method("prefiltered/none")
