"""Display pictures that belong together have one exposure, and say which."""

import json
import pathlib
import shutil
from typing import Any

import numpy as np
import pytest

import glossy
from glossy import cli, exposure, image, scene
from glossy.commands import compare

pytestmark = pytest.mark.filterwarnings("always")  # as on the command line
SMALL = ("--size", "32", "--width", "16", "--height", "16")


@pytest.fixture(autouse=True)
def folder(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> pathlib.Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def sphere() -> glossy.SurfacePoints:
    return scene.Scene(camera=scene.default_camera(scene.Sphere(), 64, 64)).points()


def stops(capsys: pytest.CaptureFixture[str], *arguments: str) -> float:
    """What a command says, which its file records."""
    output = arguments[-1]
    assert cli.main([*arguments, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)["exposure"]
    assert isinstance(said, float)
    assert exposure.recorded(image.read_image(output, "srgb").metadata) == said
    return said


def test_a_picture_and_its_truth_have_one_exposure(capsys: pytest.CaptureFixture[str]) -> None:
    shape = (*SMALL, "--env", "studio", "--material", "mx=.15")
    found = {
        stops(capsys, "render", *shape, "-o", "a.png"),
        stops(capsys, "render", *shape, "--samples", "3", "-o", "b.png"),
        stops(capsys, "render", *shape, "--method", "importance", "-o", "c.png"),
        stops(capsys, "render", *shape, "--supersampling", "2", "-o", "d.png"),
        stops(capsys, "reference", *shape, "-o", "t.png"),
        stops(capsys, "reference", *shape, "--estimator", "qmc", "--samples", "4", "-o", "q.png"),
        stops(capsys, "render", *shape, "--converge", "--passes", "1", "-o", "e.png"),
    }
    assert len(found) == 1
    for name in "abcdeq":
        assert cli.main(["compare", f"{name}.png", "t.png", "--encoding", "srgb"]) == 0
    assert capsys.readouterr().err == ""
    assert stops(capsys, "render", *shape, "--exposure", "-2", "-o", "x.png") == -2.0


@pytest.mark.parametrize(
    "material", ["mx=.02", "mx=.15", "mx=.2,my=.075", "kd=.5", "mx=.4,kd=.2,ks=.3"]
)
@pytest.mark.parametrize("name", ["spots", "studio", "white"])
def test_the_estimate_is_near_what_the_truth_needs(name: str, material: str) -> None:
    from glossy.materials import parse_material

    cube, points = glossy.environment(name, size=64), sphere()
    truth = glossy.reference(points, parse_material(material), cube, tolerance=1e-2)
    needed = exposure.stops_to_white(truth.radiance[points.coverage])
    found = exposure.scene_exposure(points, parse_material(material), cube)
    assert found is not None
    assert abs(found - needed) <= 1.0


def test_stops_follow_the_light() -> None:
    cube, points = glossy.environment("studio", size=32), sphere()
    material = glossy.Material(kd=0.2, reflection=[glossy.Lobe(mx=0.1)])
    bright = glossy.CubeMap(cube.faces * 8.0)
    first, second = (exposure.scene_exposure(points, material, c) for c in (cube, bright))
    assert first is not None
    assert second == first - 3.0
    dark = glossy.CubeMap(np.zeros((6, 4, 4, 3)))
    assert exposure.scene_exposure(points, material, dark) == 0.0
    through = glossy.Material(transmission=[glossy.Lobe(mx=0.1, r0=0.5)], diffuse_transmission=0.25)
    white = glossy.CubeMap(np.ones((6, 4, 4, 3)))
    assert exposure.scene_exposure(points, through, white) == 0.5


def test_faces_are_reduced_to_means_of_what_they_cover() -> None:
    faces = np.random.default_rng(3).random((6, 7, 7, 3)).astype(np.float32)
    small = exposure.reduced(glossy.CubeMap(faces), 3).faces
    assert small.shape == (6, 3, 3, 3)
    np.testing.assert_allclose(small[:, 0, 1], faces[:, 0:2, 2:4].mean(axis=(1, 2)), rtol=1e-6)
    np.testing.assert_allclose(small[:, 2, 2], faces[:, 4:, 4:].mean(axis=(1, 2)), rtol=1e-6)


def test_scenes_of_objects_have_one_exposure(
    folder: pathlib.Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    (folder / "s.toml").write_text(
        """
[environment]
source = "studio"
size = 8
[camera]
position = [0, 0, 3]
width = 8
height = 8
[bake]
samples = 16
[capture]
size = 8
[[objects]]
shape = {kind = "sphere"}
material = "mx=.2"
"""
    )
    truth = stops(capsys, "reference", "s.toml", "--supersampling", "1", "-o", "t.png")
    assert stops(capsys, "render", "s.toml", "--supersampling", "1", "-o", "r.png") == truth
    assert stops(capsys, "render", "s.toml", "--samples", "3", "--supersampling", "1",
                 "--converge", "--passes", "1", "-o", "c.png") == truth  # fmt: skip
    assert -4.0 <= truth < 0.0


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert cli.main([*arguments]) == 2
    out = capsys.readouterr()
    assert out.err.count("\n") == 1
    return out.err


def test_exposure_of_another_picture(capsys: pytest.CaptureFixture[str]) -> None:
    pixels = np.full((4, 5, 3), 0.25)
    image.write_image("plain.png", pixels)
    image.write_image("said.png", pixels, metadata={exposure.KEY: "-1.5"})
    image.write_image("radiance.exr", pixels)
    render = ("render", *SMALL, "--env", "white", "--material", "mx=.2")
    for like, value in (("said.png", -1.5), ("radiance.exr", 2.0)):
        assert stops(capsys, *render, "--exposure", f"like:{like}", "-o", "a.png") == value
    for text, words in (
        ("like:plain.png", "must be like a picture that says by what it is exposed"),
        ("like:none.png", "none.png: no such file"),
        ("like:", "no such file"),
        ("bright", "must be a number of stops within +-1000, or like:FILE"),
        ("nan", "must be a number of stops"),
        ("1001", "must be a number of stops"),
    ):
        assert words in refusal(capsys, *render, "--exposure", text, "-o", "a.png"), text
    assert "exposure: is for PNG" in refusal(capsys, *render, "--exposure", "1", "-o", "a.exr")


def test_pictures_of_unlike_exposures_are_not_compared(capsys: pytest.CaptureFixture[str]) -> None:
    pixels = np.full((4, 5, 3), 0.25)
    for name, said in (("a", -1.0), ("b", -1.5), ("zero", 0.0)):
        image.write_image(f"{name}.png", pixels, metadata={exposure.KEY: repr(said)})
    image.write_image("plain.png", pixels)
    image.write_image("bad.png", pixels, metadata={exposure.KEY: "much"})
    image.write_image("c.exr", image.read_image("plain.png", "srgb").pixels)
    srgb = ("--encoding", "srgb")
    error = refusal(capsys, "compare", "a.png", "b.png", *srgb)
    assert "a.png, b.png: differ in exposure, -1 and -1.5 stops" in error

    def row(*arguments: str) -> dict[str, Any]:
        assert cli.main(["compare", *arguments, *srgb, "--json"]) == 0
        out: dict[str, Any] = json.loads(capsys.readouterr().out)
        return out

    assert row("a.png", "a.png")["identical"]
    assert row("a.png", "plain.png")["identical"]  # which does not say
    assert row("bad.png", "c.exr")["identical"]
    assert row("zero.png", "c.exr")["identical"]
    out = row("a.png", "c.exr")
    assert (out["identical"], out["rms"]) == (False, 0.0)
    assert out["warnings"] == ["differ in exposure, -1 stops and radiance"]
    assert row("c.exr", "a.png")["unlike"] == ["exposure, -1 stops and radiance"]


def test_the_examples_of_help_run_as_printed(
    folder: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = compare._EPILOG.split("examples:\n")[1].splitlines()
    assert len(lines) == 9
    for name in "ab":
        image.write_image(f"{name}.exr", np.full((4, 5, 3), 0.25))
        place = folder / ("renders" if name == "a" else "references") / "sub"
        place.mkdir(parents=True)
        shutil.copy(f"{name}.exr", place / "one.exr")
        (place / "notes.json").write_text("{}")
    for line in lines:
        program, *words = line.replace('"', "").split()
        assert program == "glossy"
        small = SMALL if words[0] in ("render", "reference") else ()
        assert cli.main([*words, *small]) == 0, line + capsys.readouterr().err
    assert (folder / "difference.png").exists()
