"""Planar reflectors in scenes: the file, the pictures, and what is paid for them."""

import dataclasses
import pathlib
import re
from typing import Any

import numpy as np
import pytest

import glossy
from glossy.camera import Camera
from glossy.cli import main
from glossy.planar import mirror_pass, objects, render_mirror
from glossy.scenes import prepare, render_objects, view
from glossy.scenes.model import BakeSettings, CaptureSettings, ObjectScene, SceneObject
from glossy.scenes.prepared import PreparedScene
from glossy.scenes.render import shade_part
from glossy.scenes.shapes import Box, Rectangle, Sphere, Transform

PLANAR = {"name": "planar", "samples": 5, "precision": "double", "misses": "edge"}
SHINY = glossy.Material(0.2, [glossy.Lobe(0.05, r0=0.5, alpha=0.5)])


def rectangle(position: Any, rotation: Any, name: str, **method: Any) -> SceneObject:
    return SceneObject(
        Rectangle((3.0, 3.0), one_sided=True),
        Transform(position, rotation=rotation),
        SHINY,
        name,
        method={**PLANAR, **method},
    )


@pytest.fixture(scope="module")
def prepared() -> PreparedScene:
    """Three mirrors about a glowing box: floor, back wall, and a wall behind the camera."""
    scene = ObjectScene(
        (
            rectangle((0, 0, 0), (-90, 0, 0), "floor"),
            rectangle((0, 1.5, -1.5), (0, 0, 0), "back", samples=7),
            rectangle((0, 1.5, 1.5), (0, 180, 0), "front"),
            SceneObject(
                Box((0.5, 0.5, 0.5)), Transform((0.1, 0.5, -0.4)), emission=(3.0, 2.0, 1.0)
            ),
            SceneObject(Sphere(0.2), Transform((0.8, 0.3, -0.2)), SHINY, "ball"),
        ),
        Camera((0.0, 1.0, 1.4), (0.0, 0.4, -1.0), fov=60.0, width=24, height=16),
        samples=9,
        bake=BakeSettings(0.6, 16, 1),
        capture=CaptureSettings(16, 1),
        supersampling=1,
    )
    return prepare(scene, cache=False)


def test_each_reflector_is_paid_for_when_it_is_seen(
    prepared: PreparedScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    passes: list[int] = []

    def counted(world: Any, index: int, camera: Any) -> Any:
        passes.append(index)
        return render_mirror(world, index, camera)

    monkeypatch.setattr(objects, "render_mirror", counted)
    captured: list[int] = []
    cube = prepared.cube_map

    def capture(index: int, update: bool = False) -> Any:
        captured.append(index)
        return cube(index, update)

    monkeypatch.setattr(prepared, "cube_map", capture)
    rendering = render_objects(prepared)
    assert passes == [0, 1]  # not the one behind the camera
    assert set(captured) == {4}  # the ball's: nothing else needs a cube map
    assert [row["name"] for row in rendering.objects] == ["floor", "back", "ball"]
    assert rendering.objects[0]["mirror"] == {"width": 32, "height": 24}
    counts = [row["mapping"]["samples"] for row in rendering.objects[:2]]
    assert counts == [row["rays"] * n for row, n in zip(rendering.objects, (5, 7), strict=False)]
    assert "mapping" not in rendering.objects[2]
    assert rendering.seconds["mirror"] > 0.0
    away = dataclasses.replace(prepared.scene.camera, target=(0.0, 3.0, 1.4), up=(0.0, 0.0, 1.0))
    passes.clear()
    for part in view(prepared, away).parts:
        shade_part(prepared, part)
    assert 0 not in passes
    assert 1 not in passes


def test_the_picture_is_that_of_the_parts(prepared: PreparedScene) -> None:
    seen = view(prepared)
    picture = seen.picture([shade_part(prepared, part) for part in seen.parts])
    found = render_objects(prepared).image
    np.testing.assert_array_equal(found, picture.astype(np.float32))
    floor = seen.parts[0]
    buffer = mirror_pass(prepared, floor)
    at = buffer.camera.project(floor.points.position)  # type: ignore[arg-type]
    np.testing.assert_allclose(at - np.floor(at), 0.5, atol=1e-9)
    # the box glows in the floor: as bright as Fresnel lets it
    column, row = np.floor(at).astype(int).T
    glows = buffer.radiance[row, column, 0] > 2.0
    assert glows.sum() > 5
    lobes = shade_part(prepared, floor)
    assert 0.5 * 3.0 * 0.5 < lobes[glows, 0].max() < 3.0


def test_radiance_near_the_end_of_single_precision_is_scaled_or_refused() -> None:
    def picture(scale: float) -> Any:
        glow = (3.0 * scale, 2.0 * scale, scale)
        scene = ObjectScene(
            (
                rectangle((0, 0, 0), (-90, 0, 0), "floor", precision="single"),
                SceneObject(Box((0.5, 0.5, 0.5)), Transform((0.1, 0.5, -0.4)), emission=glow),
            ),
            Camera((0.0, 1.0, 1.4), (0.0, 0.4, -1.0), fov=60.0, width=12, height=8),
            bake=BakeSettings(0.6, 16, 1),
            capture=CaptureSettings(8, 1),
            supersampling=1,
        )
        return render_objects(prepare(scene, cache=False)).image.astype(np.float64)

    unit = picture(1.0)
    for scale in (1e-30, 1e30, 3e37):
        np.testing.assert_allclose(picture(scale) / scale, unit, rtol=0.0, atol=1e-6 * unit.max())
    with pytest.raises(ValueError, match="light maps: must be within single precision"):
        picture(1e39)


def test_missed_samples_take_the_objects_own_cube_map(prepared: PreparedScene) -> None:
    item = dataclasses.replace(
        prepared.scene.objects[0], method={**PLANAR, "misses": "cube", "margin": 0.0}
    )
    scene = dataclasses.replace(prepared.scene, objects=(item, *prepared.scene.objects[1:]))
    other = prepare(scene, cache=False)
    parts = [view(p).parts[0] for p in (prepared, other)]
    found = [shade_part(p, part) for p, part in zip((prepared, other), parts, strict=True)]
    assert np.any(found[0] != found[1])
    assert 0 in other._cubes
    assert 0 not in prepared._cubes


FILE = """
[camera]
position = [0, 1, 2]
target = [0, 0, -1]
width = 12
height = 8
supersampling = 1

[bake]
texel = 0.8
samples = 16
bounces = 0

[materials]
shiny = { reflection = [{ mx = 0.05, r0 = 0.5, alpha = 0.5 }] }

[[objects]]
name = "floor"
shape = { kind = "rectangle", size = [4, 4], one_sided = true }
rotation = [-90, 0, 0]
material = "shiny"
method = { name = "planar", samples = 5, level = "sample", misses = "edge", precision = "double" }

[[objects]]
shape = { kind = "box" }
position = [0, 0.5, -1]
emission = 1.0
"""


def write(folder: pathlib.Path, text: str) -> str:
    (folder / "scene.toml").write_text(text)
    return str(folder / "scene.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"rectangle", size = [4, 4], one_sided = true', '"box"',
         r"objects\[0\]\.method\.name: 'planar' is for rectangles, got 'box'"),
        ("{ reflection =", "{ transmission = [{ mx = 0.1 }], reflection =",
         r"objects\[0\]\.material: must have no transmission with the method 'planar'"),
        ('level = "sample"', 'levels = "sample"',
         r"objects\[0\]\.method\.levels: is no option of method 'planar' \(it has samples, kind"),
        ('"planar"', '"plane"', r"objects\[0\]\.method\.name: must be one of .*planar"),
    ],
)  # fmt: skip
def test_the_file_says_what_is_wrong(
    tmp_path: pathlib.Path, old: str, new: str, message: str
) -> None:
    assert old in FILE
    with pytest.raises(ValueError, match=message):
        glossy.load_scene(write(tmp_path, FILE.replace(old, new)))


def test_the_command_renders_it(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import json
    import os

    base = os.environ.get("XDG_CACHE_HOME") or str(pathlib.Path.home() / ".cache")
    monkeypatch.setenv("NUMBA_CACHE_DIR", os.environ.get("NUMBA_CACHE_DIR") or base)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    out = str(tmp_path / "out.exr")
    assert main(["render", write(tmp_path, FILE), "--samples", "3", "--json", "-o", out]) == 0
    (row,) = json.loads(capsys.readouterr().out)["objects"]
    assert row["method"] == "planar"
    assert row["options"]["samples"] == 3
    assert row["mapping"]["samples"] == 3 * row["rays"]
    assert (
        main(["render", out.replace("out.exr", "scene.toml"), "--footprint", "paper", "-o", out])
        == 2
    )
    assert re.search("footprint: is no option of method 'planar'", capsys.readouterr().err)


def test_a_plain_call_names_the_methods_it_knows() -> None:
    points = glossy.SurfacePoints([0, 0, 1], [1, 0, 0], [0, 0, 1])
    white = glossy.Pyramid([np.ones((6, 1, 1, 3))])
    with pytest.raises(ValueError, match="method: must be one of regular"):
        glossy.shade(points, glossy.Lobe(0.1), white, method="planar")
