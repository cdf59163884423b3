"""The converged mirror buffer: same bits in any grouping, a plain twin, where it is the truth."""

import dataclasses
import json
import os
import pathlib
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import pytest
from planar_twin import Twin, look_up

import glossy
from glossy import Lobe, Material
from glossy.camera import Camera
from glossy.cli import main
from glossy.converge import Limits
from glossy.planar import Fallback, mirror_pass, reference_planar
from glossy.planar import converge as refining
from glossy.planar.converge import Refinement, refine_planar
from glossy.pyramid import Pyramid
from glossy.scene import EnvironmentSource
from glossy.scenes import prepare, reference_objects, render_objects, view
from glossy.scenes.converge import converge_objects
from glossy.scenes.model import (
    AreaLight,
    BakeSettings,
    CaptureSettings,
    Checker,
    ObjectScene,
    SceneObject,
)
from glossy.scenes.prepared import PreparedScene
from glossy.scenes.render import Part
from glossy.scenes.shapes import Box, Rectangle, Sphere, Transform

Array = npt.NDArray[np.float64]

LOBE = Lobe(0.08, 0.05)
FLOOR = SceneObject(
    Rectangle((4.0, 4.0), True), Transform(rotation=(-90.0, 0.0, 0.0)), Material(0.0, [LOBE])
)
CAMERA = Camera((0.0, 1.0, 2.0), (0.0, 0.0, 0.0), fov=20.0, width=5, height=4)


def made(*objects: SceneObject, lights: tuple[AreaLight, ...] = (), sky: bool = False) -> Any:
    """A scene about the floor, prepared, and the floor's part of the view."""
    scene = ObjectScene(
        (FLOOR, *objects),
        CAMERA,
        lights=lights,
        environment=EnvironmentSource("white", 8) if sky else None,
        bake=BakeSettings(0.25, 64, 1),
        supersampling=1,
    )
    prepared = prepare(scene, cache=False)
    (part,) = view(prepared).parts
    return prepared, part


@pytest.fixture(scope="module")
def boxed() -> tuple[PreparedScene, Part]:
    """A checkered box under a white sky, in the lobes' way."""
    box = SceneObject(
        Box((0.5, 0.6, 0.3)), Transform((0.15, 0.31, -0.6)), Material(0.6), checker=Checker(0.1)
    )
    made_: tuple[PreparedScene, Part] = made(box, sky=True)
    return made_


def refinement(boxed: tuple[PreparedScene, Part], **options: Any) -> Refinement:
    prepared, part = boxed
    buffer = mirror_pass(prepared, part, scale=8.0)
    return Refinement(part.points, part.material, buffer, **options)


@pytest.mark.parametrize("planes", ["averaged", "own"])
def test_passes_may_be_grouped_in_any_way(
    boxed: tuple[PreparedScene, Part], planes: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = refinement(boxed, planes=planes)
    whole.add(192)
    pieces = refinement(boxed, planes=planes)
    monkeypatch.setattr(refining, "CHUNK", 100)  # two points and a few samples at a time
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        for count in (16, 1, 100, 48):  # 1 becomes 16, 100 becomes 112
            pieces.add(count)
    finally:
        numba.set_num_threads(threads)
    assert pieces.samples == whole.samples == 192
    np.testing.assert_array_equal(pieces.state.radiance, whole.state.radiance)
    np.testing.assert_array_equal(pieces.state.error, whole.state.error)
    assert pieces.state.counts == whole.state.counts
    *_, last = refine_planar(refinement(boxed, planes=planes), 192)
    np.testing.assert_array_equal(last.radiance, whole.state.radiance)


def test_passes_double_and_end_at_the_samples_asked_for(boxed: tuple[PreparedScene, Part]) -> None:
    used = [state.samples for state in refine_planar(refinement(boxed), 1000)]
    assert used == [128, 256, 512, 1008]


@pytest.mark.parametrize(
    ("planes", "intersections"), [("averaged", 2), ("averaged", 1), ("own", 2)]
)
def test_a_plain_twin_finds_the_same(
    boxed: tuple[PreparedScene, Part], planes: str, intersections: int
) -> None:
    """The recurrence of the averaged planes once more, a sample at a time."""
    run = refinement(boxed, planes=planes, intersections=intersections)
    run.add(48)
    twin = Twin(run.buffer, "box")
    position = boxed[1].points.position
    assert position is not None
    direction, weight = run._draw(slice(None), 0, 3)
    for p in range(0, len(position), 3):
        total = np.zeros(3)
        normals: list[Array] = []
        places: list[Array] = []
        own = twin.pixel(position[p], False)
        assert own is not None
        for w, share in zip(direction[p], weight[p], strict=True):
            if not share.any():
                continue
            plane = twin.plane(own)
            if planes == "averaged" and normals:
                n = np.sum(normals, axis=0)
                plane = np.mean(places, axis=0), n / np.linalg.norm(n)
            pixel = found(twin, position[p], w, plane, intersections)
            total += share * look_up(twin.levels, pixel[0], pixel[1], 0.0)
            hit = twin.plane(pixel)
            if hit is not None:
                places.append(hit[0])
                normals.append(hit[1])
        np.testing.assert_allclose(run.state.radiance[p], total / 48, rtol=1e-9)


def found(twin: Twin, x: Array, w: Array, plane: Any, intersections: int) -> Array:
    """Where a direction is looked up: the place on ``plane``, then on what is seen there."""
    pixel = np.zeros(2)
    for k in range(intersections):
        t = twin.meet(x, w, plane)
        if k and t is None and plane is not None:
            return pixel  # the second plane is not met in front: the first pixel stays
        where = twin.pixel(w if t is None else x + t * w, t is None)
        assert where is not None
        pixel = where
        if not twin.inside(pixel):
            break
        plane = twin.plane(pixel)
    return np.clip(pixel, 0.0, twin.size)


def test_white_surroundings_give_the_albedo() -> None:
    prepared, part = made(sky=True)
    run = Refinement(part.points, part.material, mirror_pass(prepared, part))
    run.add(2048)
    albedo, _ = part.material.albedo(part.points.local_view)
    away = np.abs(run.state.radiance[:, 0] - albedo)
    assert np.all(away < 5.0 * run.state.error[:, 0] + 1e-6)  # 16 replicates; float32 light
    assert run.state.error.max() < 2e-3


@pytest.mark.parametrize("planes", ["averaged", "own"])
def test_one_plane_in_view_is_no_approximation(planes: str) -> None:
    """A lit wall alone: every tangent plane is the wall's, so the buffer holds the truth."""
    wall = SceneObject(Rectangle((9.0, 9.0)), Transform((0.0, 0.0, -1.5)), Material(0.8))
    lamp = AreaLight((1.0, 1.0), 9.0, Transform((0.6, 0.9, 1.0), rotation=(0.0, 180.0, 0.0)))
    prepared, part = made(wall, lights=(lamp,))
    buffer = mirror_pass(prepared, part, scale=16.0, margin=3.0)
    run = Refinement(part.points, part.material, buffer, planes=planes)
    run.add(2048)
    truth = reference_planar(prepared, part, samples=4096)
    assert run.state.counts.missed == 0
    away = np.abs(run.state.radiance - truth.radiance)
    assert truth.radiance.min() > 0.02
    assert np.all(away < 5.0 * np.hypot(run.state.error, truth.error) + 2e-3 * truth.radiance)


def test_misses_are_read_from_the_cube_map(boxed: tuple[PreparedScene, Part]) -> None:
    cube = Fallback(Pyramid([np.full((6, 1, 1, 3), 7.0, dtype=np.float32)]), np.zeros(3))
    prepared, part = boxed
    wide = dataclasses.replace(part, material=Material(0.0, [Lobe(0.5)]))
    buffer = mirror_pass(prepared, wide)
    runs = [
        Refinement(part.points, wide.material, buffer, fallback=spare, planes="own")
        for spare in (None, cube)
    ]
    for run in runs:
        run.add(256)
    edge, missed = (run.state for run in runs)
    assert edge.counts == missed.counts
    assert missed.counts.missed > 0.1 * missed.counts.samples
    assert missed.radiance.mean() > edge.radiance.mean() + 0.5


def test_what_cannot_be_refined_is_refused(boxed: tuple[PreparedScene, Part]) -> None:
    prepared, part = boxed
    buffer = mirror_pass(prepared, part)
    with pytest.raises(ValueError, match="planes: must be one of averaged, own, got 'mean'"):
        Refinement(part.points, part.material, buffer, planes="mean")
    glass = Material(0.0, [], [Lobe(0.1)])
    with pytest.raises(ValueError, match="material: must have no transmission"):
        Refinement(part.points, glass, buffer)
    with pytest.raises(ValueError, match="samples: must be at least 1, got 0"):
        Refinement(part.points, part.material, buffer).add(0)


@pytest.fixture(scope="module")
def scene() -> PreparedScene:
    """A planar floor, and a ball with a cube map, under a white sky."""
    floor = dataclasses.replace(
        FLOOR, method={"name": "planar", "samples": 5, "margin": 0.5, "level": "sample"}
    )
    ball = SceneObject(Sphere(0.2), Transform((0.1, 0.25, -0.1)), Material(0.1, [Lobe(0.1)]))
    whole = ObjectScene(
        (floor, ball),
        dataclasses.replace(CAMERA, fov=30.0),
        environment=EnvironmentSource("white", 8),
        bake=BakeSettings(0.5, 16, 0),
        capture=CaptureSettings(16, 1),
        supersampling=1,
    )
    return prepare(whole, cache=False)


def test_the_truth_of_a_scene_casts_rays_for_its_reflectors(scene: PreparedScene) -> None:
    seen = view(scene)
    assert [part.index for part in seen.parts] == [0, 1]
    truth = reference_objects(scene, samples=256, seed=4)
    assert truth.estimator == "qmc"  # "texels" knows cube maps alone
    rays = reference_planar(scene, seen.parts[0], samples=256, seed=4)
    ball = glossy.reference(
        seen.parts[1].points, seen.parts[1].material, scene.cube_map(1), "qmc", 256, seed=4,
        diffuse=False,
    )  # fmt: skip
    np.testing.assert_array_equal(truth.image, seen.picture([rays.radiance, ball.radiance]))
    np.testing.assert_array_equal(truth.error, seen.errors([rays.error, ball.error], "standard"))


def test_a_scene_at_rest_converges_to_the_buffer(scene: PreparedScene) -> None:
    found = converge_objects(scene, Limits(passes=3), seed=4)
    states = list(found.states)
    assert [state.samples for state in states] == [0, 128, 256, 512]
    np.testing.assert_allclose(states[0].display, render_objects(scene).image, rtol=1e-6)
    floor, ball = found.view.parts
    buffer = mirror_pass(scene, floor, margin=0.5)
    spare = Fallback(scene.lookup(0, "regular"), scene.geometry.center(0))
    run = Refinement(floor.points, floor.material, buffer, fallback=spare, seed=4)
    run.add(512)
    lobes = glossy.reference(
        ball.points, ball.material, scene.cube_map(1), "qmc", 512, seed=4, diffuse=False
    )
    expected = found.view.picture([run.state.radiance, lobes.radiance])
    np.testing.assert_array_equal(states[-1].estimate, expected)


FILE = """
[camera]
position = [0, 1, 2]
target = [0, 0, -1]
width = 8
height = 6
supersampling = 1

[bake]
texel = 0.8
samples = 16
bounces = 0

[materials]
shiny = { reflection = [{ mx = 0.05, r0 = 0.5, alpha = 0.5 }] }

[[objects]]
shape = { kind = "rectangle", size = [4, 4], one_sided = true }
rotation = [-90, 0, 0]
material = "shiny"
method = { name = "planar", misses = "edge" }

[[objects]]
shape = { kind = "box" }
position = [0, 0.5, -1]
emission = 1.0
"""


def test_the_commands_cast_rays_and_refine(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    base = os.environ.get("XDG_CACHE_HOME") or str(pathlib.Path.home() / ".cache")
    monkeypatch.setenv("NUMBA_CACHE_DIR", os.environ.get("NUMBA_CACHE_DIR") or base)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    file, out = tmp_path / "scene.toml", str(tmp_path / "out.exr")
    file.write_text(FILE)
    assert main(["reference", str(file), "--samples", "64", "--json", "-o", out]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["estimator"] == "qmc"
    assert record["error_kind"] == "standard"
    assert 0.0 < record["rms_error"] < 0.1
    channels = glossy.image.read_image(out).channels
    assert {"R", "G", "B", "error.R", "error.G", "error.B"} <= set(channels)
    command = ["render", str(file), "--converge", "--passes", "2", "--json", "-o", out]
    assert main(command) == 0
    assert [s["samples"] for s in json.loads(capsys.readouterr().out)["states"]] == [0, 128, 256]
