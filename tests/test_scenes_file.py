"""Scenes of objects: the file and its errors, a small picture from end to end, the cache."""

import dataclasses
import json
import pathlib
import re
from typing import Any

import numpy as np
import pytest

import glossy
from glossy import methods
from glossy.cli import main
from glossy.scene import load_scene
from glossy.scenes.builtin import BUILTIN_SCENES
from glossy.scenes.model import ObjectScene
from glossy.scenes.prepared import cache_root, prepare
from glossy.scenes.render import reference_objects, render_objects, shade_part, view
from glossy.scenes.shapes import Rectangle, Torus

ROOM = """
[camera]
position = [0, 1, 3]
target = [0, 0.6, 0]
fov = 40
width = 32
height = 20
supersampling = 1

[environment]
source = "sky"
size = 16
scale = 0.5

[method]
samples = 12
threshold = 0.1

[bake]
texel = 0.4
samples = 16
bounces = 2

[capture]
size = 16

[[planes]]
point = [0, 0, 0]
normal = [0, 2, 0]

[materials]
grey = "kd=.5"
shiny = { kd = 0.2, reflection = [{ mx = 0.2, r0 = 0.5, alpha = 0.5 }] }

[[objects]]
name = "floor"
shape = { kind = "rectangle", size = [4, 4], one_sided = true }
rotation = [-90, 0, 0]
material = "grey"
checker = { kd = 0.1, repeat = [4, 4] }

[[objects]]
name = "ball"
shape = { kind = "sphere", radius = 0.5 }
position = [-0.6, 0.5, 0]
material = "shiny"
method = { name = "importance", samples = 9 }

[[objects]]
name = "ring"
shape = { kind = "torus", radius = 0.4, tube = 0.2 }
position = [0.6, 0.2, 0]
scale = [1, 2, 1]
material = "shiny"
capture_size = 8

[[lights]]
size = [1, 1]
position = [0, 2.5, 0]
rotation = [90, 0, 0]
radiance = [5, 4, 3]
"""


@pytest.fixture(autouse=True)
def own_cache(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels stay where they are; scenes are kept in the test's folder."""
    import os

    base = os.environ.get("XDG_CACHE_HOME") or str(pathlib.Path.home() / ".cache")
    monkeypatch.setenv("NUMBA_CACHE_DIR", os.environ.get("NUMBA_CACHE_DIR") or base)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def write(folder: pathlib.Path, text: str = ROOM) -> pathlib.Path:
    path = folder / "scene.toml"
    path.write_text(text)
    return path


def load(folder: pathlib.Path, text: str = ROOM) -> ObjectScene:
    scene = load_scene(write(folder, text))
    assert isinstance(scene, ObjectScene)
    return scene


def test_a_file_is_what_it_says(tmp_path: pathlib.Path) -> None:
    scene = load(tmp_path)
    assert [o.name for o in scene.objects] == ["floor", "ball", "ring"]
    assert scene.objects[0].shape == Rectangle((4, 4), one_sided=True)
    assert scene.objects[2].shape == Torus(0.4, 0.2)
    assert scene.objects[2].transform.scale == (1.0, 2.0, 1.0)
    assert scene.objects[1].material == scene.objects[2].material
    assert scene.supersampling == 1
    assert scene.environment_scale == (0.5, 0.5, 0.5)
    np.testing.assert_array_equal(scene.bounding_planes(), [[[0, 0, 0], [0, 1, 0]]])
    assert scene.method_of(scene.objects[1]) == ("importance", {"samples": 9})
    assert scene.method_of(scene.objects[2]) == ("regular", {"samples": 12, "threshold": 0.1})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("radius = 0.5", "radius = -1", r"objects\[1\]\.shape\.radius: must be in \(0, inf\)"),
        ("radius = 0.5", "radios = 1", r"objects\[1\]\.shape\.radios: unknown key, known are kind"),
        ("tube = 0.2", "tube = 0.5", r"objects\[2\]\.shape\.tube: must be in \(0, 0\.4\)"),
        ('"sphere"', '"ball"', r"objects\[1\]\.shape\.kind: must be one of sphere, box"),
        ("size = [4, 4]", "size = [4]", r"objects\[0\]\.shape\.size: must be two finite"),
        ("scale = [1, 2, 1]", "scale = 0", r"objects\[2\]\.scale: must be three finite numbers"),
        ("scale = [1, 2, 1]", "spin = 0", r"objects\[2\]\.spin: unknown key"),
        ('material = "grey"', 'material = "gray"',
         r"objects\[0\]\.material: no material 'gray'; .*\(grey, shiny\)"),
        ('kind = "rectangle", size = [4, 4], one_sided = true',
         'kind = "mesh", file = "scene.toml"',
         r"objects\[0\]\.checker: is not for a mesh"),
        ("mx = 0.2, r0", "mx = -0.2, r0", r"materials\.shiny: reflection\[0\]: mx: must be"),
        ("samples = 9", "bend = 9", r"objects\[1\]\.method\.bend: is no option of method"),
        ('name = "importance"', 'name = "magic"', r"objects\[1\]\.method\.name: must be one of"),
        ("threshold = 0.1", "treshold = 0.1", r"method\.treshold: is no option"),
        ("normal = [0, 2, 0]", "normal = [0, 0, 0]", r"planes\[0\]\.normal: must not be zero"),
        ("radiance = [5, 4, 3]", "radiance = -1", r"lights\[0\]\.radiance: must be"),
        ("radiance = [5, 4, 3]", "power = 1", r"lights\[0\]\.power: unknown key"),
        ("texel = 0.4", "texel = -1", r"bake\.texel: must be"),
        ("samples = 16\nb", "samples = 17\nb", r"bake\.samples: must be a power of two, got 17"),
        ("capture_size = 8", "capture_size = 9", r"objects\[2\]\.capture_size: must be a power"),
        ("[capture]\nsize = 16", "[capture]\nsize = 0", r"capture\.size: must be from 1"),
        ("fov = 40", "fov = 200", r"camera\.fov: must be in"),
        ("supersampling = 1", "supersampling = 0", r"camera\.supersampling: must be from 1 to 16"),
        ("scale = 0.5", "scale = [1, 2]", r"environment\.scale: must be"),
        ("[capture]", "[captures]", r"captures: unknown key"),
        ("repeat = [4, 4]", "repeat = [4, 0]", r"objects\[0\]\.checker\.repeat: must be two"),
        ("width = 32", "width = 32\nwidth = 4", r"line 7"),
        ("[[lights]]", "[lights]", r"lights: must be a list of tables"),
    ],
)  # fmt: skip
def test_errors_are_one_line_with_the_dotted_key(
    tmp_path: pathlib.Path, old: str, new: str, message: str
) -> None:
    assert old in ROOM
    path = write(tmp_path, ROOM.replace(old, new, 1))
    with pytest.raises(ValueError, match=message) as error:
        load_scene(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('material = "grey"', 'material = "no.toml"', r"objects\[0\]\.material: no such file"),
        ('material = "grey"', 'light_map = "no.exr"', r"objects\[0\]\.light_map: no such file"),
        ('source = "sky"', 'source = "no.hdr"', r"environment\.source: no such file.*no\.hdr"),
        (
            'kind = "sphere", radius = 0.5',
            'kind = "mesh", file = "no.ply"',
            r"objects\[1\]\.shape\.file: no such file",
        ),
    ],
)
def test_missing_files_are_named_by_their_key(
    tmp_path: pathlib.Path, old: str, new: str, message: str
) -> None:
    path = write(tmp_path, ROOM.replace(old, new, 1))
    with pytest.raises(FileNotFoundError, match=message) as error:
        load_scene(path)
    assert str(error.value).startswith(str(path))


def test_a_picture_from_end_to_end(tmp_path: pathlib.Path) -> None:
    """Finite and lit; the ball brighter where it sees the light; truth and method agree."""
    scene = load(tmp_path)
    prepared = prepare(scene)
    picture = render_objects(prepared)
    assert picture.image.shape == (20, 32, 3)
    assert np.all(np.isfinite(picture.image))
    assert picture.image.min() >= 0.0
    assert {row["name"] for row in picture.objects} == {"ball", "ring"}
    looked = view(prepared)
    assert [p.index for p in looked.parts] == [1, 2]
    for part in looked.parts:
        assert part.points.position is not None
        again = prepared.geometry.intersect(scene.camera.position, -part.points.view)
        np.testing.assert_allclose(again.position, part.points.position, atol=1e-12)
        assert np.all(again.object == part.index)
    assert prepared.cube_map(1).size == 16
    assert prepared.cube_map(2).size == 8
    # what the method gave is what the picture holds over the base
    lobes = [shade_part(prepared, p) for p in looked.parts]
    np.testing.assert_array_equal(looked.picture(lobes).astype(np.float32), picture.image)
    dark = looked.picture([0.0 * x for x in lobes])
    part = looked.parts[0]
    row, column = np.unravel_index(part.rays, (20, 32))
    np.testing.assert_allclose(picture.image[row, column] - dark[row, column], lobes[0], atol=1e-6)
    truth = reference_objects(prepared, "qmc", samples=1024)
    seen = looked.glossy
    off = np.sqrt(np.mean((truth.image - picture.image)[seen] ** 2))
    assert off < 0.25 * np.sqrt(np.mean(truth.image[seen] ** 2))
    np.testing.assert_allclose(truth.image[~seen], picture.image[~seen], rtol=1e-6)
    assert truth.error[~seen].max() == 0.0
    assert 0.0 < truth.to_dict()["rms_error"] < 0.02


def test_supersampling_averages_the_rays_of_a_pixel(tmp_path: pathlib.Path) -> None:
    prepared = prepare(load(tmp_path), cache=False)
    fine = dataclasses.replace(prepared.scene.camera, width=64, height=40)
    one, four = view(prepared, fine, grid=1), view(prepared, grid=2)
    a = one.picture([shade_part(prepared, p) for p in one.parts])
    b = four.picture([shade_part(prepared, p) for p in four.parts])
    np.testing.assert_allclose(a.reshape(20, 2, 32, 2, 3).mean(axis=(1, 3)), b, rtol=1e-12)


def test_light_is_baked_once_and_found_again(tmp_path: pathlib.Path) -> None:
    scene = load(tmp_path)
    first = render_objects(scene)
    assert first.cached == {"bake": False, "capture": False}
    moved = dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, fov=30.0))
    again = render_objects(moved)
    assert again.cached == {"bake": True, "capture": True}
    np.testing.assert_array_equal(render_objects(scene).image, first.image)
    lights = (dataclasses.replace(scene.lights[0], radiance=(1.0, 1.0, 1.0)),)
    assert not render_objects(dataclasses.replace(scene, lights=lights)).cached["bake"]
    assert render_objects(scene, update=True).cached == {"bake": False, "capture": False}
    for file in cache_root().glob("*.npz"):  # damaged files are made again
        file.write_bytes(file.read_bytes()[:50])
    mended = render_objects(scene)
    assert mended.cached == {"bake": False, "capture": False}
    np.testing.assert_array_equal(mended.image, first.image)


def test_a_cube_map_changes_only_when_asked(tmp_path: pathlib.Path) -> None:
    prepared = prepare(load(tmp_path), cache=False)
    cube = prepared.cube_map(1)
    prepared.maps.values *= 2.0  # brighter light maps
    assert prepared.cube_map(1) is cube
    updated = prepared.cube_map(1, update=True)
    assert updated is not cube
    assert updated.faces[3].mean() > 1.5 * cube.faces[3].mean()  # the floor


def test_what_comes_through_a_rectangle_is_lit_from_behind(tmp_path: pathlib.Path) -> None:
    """A screen of diffuse transmissivity 1/2 between the eye and a light: E_back / 2 pi."""
    text = """
    [camera]
    position = [0, 0, 3]
    width = 8
    height = 8
    fov = 10
    supersampling = 1
    [bake]
    texel = 0.25
    samples = 64
    [[objects]]
    shape = { kind = "rectangle", size = [2, 2] }
    material = { diffuse_transmission = 0.5 }
    [[lights]]
    position = [0, 0, -1]
    """
    prepared = prepare(load(tmp_path, text), cache=False)
    picture = render_objects(prepared)
    hits = prepared.geometry.intersect([0.0, 0.0, 3.0], prepared.scene.camera.rays())
    expected = prepared.maps.below(hits) * 0.5 / np.pi
    np.testing.assert_allclose(picture.image, expected, rtol=1e-6)
    assert picture.image[4, 4, 0] == pytest.approx(0.239 * 0.5, rel=0.05)  # F of a unit square


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(list(arguments))
    said = capsys.readouterr()
    return code, said.out, said.err


def test_commands_take_scenes_of_objects(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = str(write(tmp_path)), str(tmp_path / "out.exr")
    code, said, _ = run(capsys, "render", path, "-o", out, "--json", "--width", "16")
    result: dict[str, Any] = json.loads(said)
    assert code == 0
    assert (result["width"], result["height"], result["schema"]) == (16, 20, 1)
    assert [o["method"] for o in result["objects"]] == ["importance", "regular"]
    assert glossy.read_image(out).pixels.shape == (20, 16, 3)
    code, said, _ = run(
        capsys, "render", path, "-o", out, "--json", "--method", "regular", "--samples", "14"
    )
    rows = json.loads(said)["objects"]
    assert {(o["method"], o["options"]["samples"]) for o in rows} == {("regular", 14)}
    code, said, _ = run(
        capsys, "reference", path, "-o", out, "--estimator", "qmc", "--samples", "64", "--json"
    )
    assert code == 0
    assert json.loads(said)["error_kind"] == "standard"
    names = glossy.read_image(out).channels
    assert "error.R" in names
    for arguments, message in (
        (["render", path, "-o", out, "--material", "mx=.1"], "--material: has no meaning"),
        (["trace", path, "--pixel", "1,1"], "a scene of objects"),
        (["render", "no.toml", "-o", out], "no such scene file"),
    ):
        code, _, err = run(capsys, *arguments)
        assert code == 2
        assert message in err
        assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize("name", BUILTIN_SCENES)
def test_the_scenes_that_come_along_load(name: str) -> None:
    scene = load_scene(name)
    assert isinstance(scene, ObjectScene)
    assert (scene.camera.width, scene.camera.height) == (640, 360)
    names = [o.name for o in scene.objects if o.glossy]
    assert all(names)
    assert name == "hall" or len(scene.planes) >= 2
    if name == "room":
        wanted = {"chrome", "lacquer", "plastic", "porcelain", "white foil", "frosted glass"}
        assert wanted <= set(names)
        assert any(re.search("alumin", n) for n in names)


def test_planes_refuse_a_method_that_cannot_use_them_before_anything_is_baked(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(methods.PLANES, "importance")
    scene = load(tmp_path, ROOM)
    with pytest.raises(ValueError, match=r"method\.name: must be one of .* with \[\[planes\]\]"):
        render_objects(scene)
    assert not (tmp_path / "cache").exists()


@pytest.mark.parametrize("key", ["planes", "lights"])
def test_a_picture_of_one_shape_has_no_parts_of_a_scene(tmp_path: pathlib.Path, key: str) -> None:
    path = write(tmp_path, f"[[{key}]]\n")
    with pytest.raises(ValueError, match=rf"{key}: is for a scene of objects"):
        load_scene(path)
