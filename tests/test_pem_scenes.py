"""Partial environment maps in scenes of objects: who shadows itself, and against its truth."""

import json
import os
import pathlib
from typing import Any

import numpy as np
import pytest
import test_scenes_file

from glossy.cli import main
from glossy.scene import load_scene
from glossy.scenes import Geometry, PreparedScene, prepare
from glossy.scenes.model import ObjectScene
from glossy.scenes.render import reference_objects, render_objects
from glossy.scenes.shapes import Box, Mesh, Rectangle, Sphere, Torus, Transform

ROOM = test_scenes_file.ROOM.replace("[[planes]]\npoint = [0, 0, 0]\nnormal = [0, 2, 0]\n", "")
METHOD = 'name = "pem"\ncount = 24\nshadows = { size = 64, softness = 0.05 }\n'
ROOM = ROOM.replace("samples = 12\nthreshold = 0.1\n", METHOD)


@pytest.fixture(autouse=True)
def own_cache(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels stay where they are; scenes are kept in the test's folder."""
    base = os.environ.get("XDG_CACHE_HOME") or str(pathlib.Path.home() / ".cache")
    monkeypatch.setenv("NUMBA_CACHE_DIR", os.environ.get("NUMBA_CACHE_DIR") or base)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def load(folder: pathlib.Path, text: str = ROOM) -> ObjectScene:
    (folder / "scene.toml").write_text(text)
    scene = load_scene(folder / "scene.toml")
    assert isinstance(scene, ObjectScene)
    return scene


@pytest.fixture
def ready(tmp_path: pathlib.Path) -> PreparedScene:
    return prepare(load(tmp_path))


def test_only_what_can_shadow_itself_has_shadow_maps(ready: PreparedScene) -> None:
    """The ring does, once; the ball, by another method here, and a ball by this one do not."""
    picture = render_objects(ready)
    rows = {row["name"]: row for row in picture.objects}
    assert rows["ring"]["shadow_maps"] == 24
    assert "shadow_maps" not in rows["ball"]
    spent = picture.seconds["shadows"]
    again = render_objects(ready)
    assert again.seconds["shadows"] == spent
    np.testing.assert_array_equal(again.image, picture.image)
    assert ready.shadows(1, "pem", {"count": 24}, True) is None
    assert ready.shadows(2, "regular", {}, True) is None
    maps = ready.shadows(2, "pem", {"count": 24}, {"size": 64, "softness": 0.05})
    assert (maps.size, maps.softness) == (64, 0.05)
    ready.cube_map(2, update=True)
    assert ready.shadows(2, "pem", {"count": 24}, {"size": 64, "softness": 0.05}) is not maps


def test_nothing_is_made_for_a_lone_convex_object(tmp_path: pathlib.Path) -> None:
    ring = ROOM.index('[[objects]]\nname = "ring"')
    alone = ROOM[:ring] + ROOM[ROOM.index("[[lights]]") :]
    alone = alone.replace('method = { name = "importance", samples = 9 }\n', "")
    scene = prepare(load(tmp_path, alone))
    picture = render_objects(scene)
    assert [row["method"] for row in picture.objects] == ["pem"]
    assert "shadows" not in picture.seconds
    assert not scene._shadows


CAMERA = "position = [0, 1, 3]\ntarget = [0, 0.6, 0]"
INTO_THE_RING = "position = [0.6, 1.4, 0.9]\ntarget = [0.6, 0.2, 0]"


def test_shadow_maps_take_what_the_truth_takes(tmp_path: pathlib.Path) -> None:
    """In the hole of the ring shadow maps take the light that rays say is not there."""
    ready = prepare(load(tmp_path, ROOM.replace(CAMERA, INTO_THE_RING)))
    truth = reference_objects(ready, samples=256, occlusion=True)
    free = reference_objects(ready, "qmc", samples=256)
    assert truth.error_kind == "standard"
    shadowed = render_objects(ready).image.astype(np.float64)
    ready.scene.options["shadows"] = False  # type: ignore[index]
    bare = render_objects(ready)
    assert all("shadow_maps" not in row for row in bare.objects)
    hidden, taken = free.image - truth.image, bare.image - shadowed
    assert hidden.max() > 0.1  # light that the ring takes from itself
    assert np.sqrt(np.mean((taken - hidden) ** 2)) < 0.6 * np.sqrt(np.mean(hidden**2))


def test_convex_is_what_no_ray_can_leave_and_meet_again(tmp_path: pathlib.Path) -> None:
    trimesh: Any = pytest.importorskip("trimesh")
    solids = {
        "icosahedron": (trimesh.creation.icosphere(subdivisions=1), True),
        "annulus": (trimesh.creation.annulus(0.5, 1.0, 0.3), False),
    }
    bowl = trimesh.creation.icosphere(subdivisions=1)
    bowl.update_faces(bowl.triangles_center[:, 2] > 0.0)
    solids["bowl"] = (bowl, False)  # open: its inside is seen
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    solids["sheet"] = (flat, True)
    for name, (solid, convex) in solids.items():
        file = tmp_path / f"{name}.ply"
        solid.export(file)
        stand = Transform((1.0, 2.0, 3.0), (1.0, 2.0, 0.5), (10.0, 20.0, 30.0))
        assert Geometry([(Mesh(str(file)), stand)]).convex(0) is convex, name
    shapes = (Sphere(), Box(), Rectangle(), Torus())
    found = Geometry([(shape, Transform()) for shape in shapes])
    assert [found.convex(k) for k in range(4)] == [True, True, True, False]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("softness = 0.05", "width = 1"), r"method\.shadows: must be one of size, softness"),
        (("softness = 0.05 }", 'storage = "r8" }'), r"storage: must be one of rg32f"),
        (("{ size = 64, softness = 0.05 }", "3"), r"method\.shadows: must be true, false or"),
        (('"importance", samples', '"importance", shadows = true, samples'), "must be left out"),
    ],
)
def test_errors_are_one_line(tmp_path: pathlib.Path, change: tuple[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        render_objects(load(tmp_path, ROOM.replace(*change)))
    assert "\n" not in str(caught.value)


def test_commands(tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    load(tmp_path)
    file, out = str(tmp_path / "scene.toml"), str(tmp_path / "out.exr")
    assert main(["render", file, "-o", out, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["seconds"]["shadows"] > 0.0
    assert {row.get("shadow_maps") for row in found["objects"]} == {None, 24}
    assert main(["reference", file, "--occlusion", "--samples", "32", "-o", out, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["estimator"] == "qmc"
    assert main(["reference", "--env", "white", "--occlusion", "-o", out]) == 2
    assert "--occlusion: has a meaning for a scene of objects only" in capsys.readouterr().err
