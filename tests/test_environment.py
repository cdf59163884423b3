"""Reading environments, and the command that converts them."""

import importlib
import json
import os
import pathlib
import warnings
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import pytest
import tolerances
from picture_files import attribute, rgb_exr

import glossy
from glossy import cli, layouts
from glossy.image import read_image, write_exr, write_image
from glossy.latlong import latlong_power, latlong_to_cube

Float32Array = npt.NDArray[np.float32]


def noise(*shape: int) -> Float32Array:
    return np.random.default_rng(5).random((*shape, 3)).astype(np.float32)


def test_public_names() -> None:
    """The module's name is the function's: importing it must not hide the function."""
    module = importlib.import_module("glossy.environment")
    assert glossy.environment is module.environment
    assert glossy.read_environment is module.read_environment
    assert glossy.environment("white", size=2).size == 2


@pytest.mark.parametrize("suffix", [".exr", ".hdr"])
def test_a_latlong_file(tmp_path: pathlib.Path, suffix: str) -> None:
    pixels, file = noise(16, 32), tmp_path / f"map{suffix}"
    write_image(file, pixels)
    stored = read_image(file).rgb()
    assert np.array_equal(glossy.read_environment(file, size=4).faces, latlong_to_cube(stored, 4))
    turned = glossy.read_environment(file, size=4, orientation="three").faces
    assert np.array_equal(turned, latlong_to_cube(stored, 4, "three"))
    assert glossy.read_environment(file, size=None).size == 8
    assert glossy.read_environment(file).size == 256


@pytest.mark.parametrize(
    "layout", ["cross-horizontal", "cross-vertical", "strip-horizontal", "strip-vertical"]
)
def test_axes_through_each_picture(tmp_path: pathlib.Path, layout: str) -> None:
    axes = glossy.environment("axes", size=24)
    file = tmp_path / "axes.exr"
    write_image(file, layouts.place_faces(axes.faces, layout))
    for named in (None, layout):
        cube = glossy.read_environment(file, size=None, layout=named)
        assert np.array_equal(cube.faces, axes.faces)
    small = glossy.read_environment(file, size=9)
    np.testing.assert_allclose(small.power(), axes.power(), rtol=tolerances.CONVERTED_POWER)


def six_files(
    folder: pathlib.Path, names: Sequence[str], faces: Float32Array
) -> list[pathlib.Path]:
    files = [folder / f"{name}.exr" for name in names]
    for file, face in zip(files, faces, strict=True):
        write_image(file, face)
    return files


def test_six_files_as_folder_pattern_and_list(tmp_path: pathlib.Path) -> None:
    faces = noise(6, 4, 4)
    names = ("s_px", "s_nx", "s_py", "s_ny", "s_pz", "s_nz")
    files = six_files(tmp_path, names, faces)
    for source in (tmp_path, str(tmp_path), tmp_path / "s_*.exr", files):
        cube = glossy.read_environment(source, size=None)
        assert np.array_equal(cube.faces, faces)
    turned = glossy.read_environment(files[::-1], size=None, layout="faces")
    assert np.array_equal(turned.faces, faces[::-1])


def test_one_channel_is_grey(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "y.exr"
    write_exr(file, {"Y": np.full((4, 8), 0.25)})
    assert np.array_equal(glossy.read_environment(file, size=2).faces, np.full((6, 2, 2, 3), 0.25))


@pytest.mark.parametrize("names", ["XYZ", "UVY", ("Y", "RY", "BY"), "YZ"])
def test_y_among_others_is_no_grey(tmp_path: pathlib.Path, names: Sequence[str]) -> None:
    file = tmp_path / "v.exr"
    write_exr(file, {name: np.full((4, 8), 0.25) for name in names})
    with pytest.raises(ValueError, match=r"\.exr: has no R, G, B and no Y alone, only "):
        glossy.read_environment(file)


# policies -----------------------------------------------------------------------------------------


def test_negative_values_are_counted_in_the_file(tmp_path: pathlib.Path) -> None:
    pixels = noise(8, 16)
    pixels[2, 3] = (-1.0, -2.0, 0.5)
    file = tmp_path / "n.exr"
    write_image(file, pixels)
    with pytest.warns(UserWarning, match=r"n\.exr: 2 negative values clamped.*lowest -2") as caught:
        cube = glossy.read_environment(file, size=64)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    assert np.array_equal(cube.faces, latlong_to_cube(np.maximum(pixels, 0.0), 64))
    with pytest.raises(ValueError, match="2 negative values"):
        glossy.read_environment(file, negative="error")
    kept = glossy.read_environment(file, size=64, negative="keep")
    assert kept.faces.min() < 0.0
    np.testing.assert_allclose(kept.power(), latlong_power(pixels), rtol=tolerances.CONVERTED_POWER)


def test_values_that_are_not_finite(tmp_path: pathlib.Path) -> None:
    pixels = noise(8, 16)
    pixels[1, 1, 0], pixels[5, 0, 2] = np.nan, np.inf
    file = tmp_path / "f.exr"
    write_image(file, pixels)
    with pytest.raises(ValueError, match="2 NaN or inf values"):
        glossy.read_environment(file)
    with pytest.warns(UserWarning, match="2 NaN or infinite") as caught:
        cube = glossy.read_environment(file, size=2, nonfinite="clamp")
    assert len(caught) == 1
    assert np.isfinite(cube.faces).all()
    with pytest.raises(ValueError, match="nonfinite: 'keep' needs a cube layout at its own size"):
        glossy.read_environment(file, size=2, nonfinite="keep")
    strip = tmp_path / "strip.exr"
    write_image(strip, np.full((1, 6, 3), np.inf))
    assert np.isinf(glossy.read_environment(strip, size=None, nonfinite="keep").faces).all()


def test_eight_bits_need_an_encoding(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "a.png"
    write_image(file, noise(4, 8))
    with pytest.raises(ValueError, match="encoding"):
        glossy.read_environment(file)
    linear = glossy.read_environment(file, size=2, encoding="linear").power()
    assert np.all(linear > glossy.read_environment(file, size=2, encoding="srgb").power())


# refusals -----------------------------------------------------------------------------------------


def test_refusals(tmp_path: pathlib.Path) -> None:
    odd, cross = tmp_path / "odd.exr", tmp_path / "cross.exr"
    write_image(odd, noise(5, 8))
    write_image(cross, noise(6, 8))
    cases: list[tuple[object, dict[str, object], str]] = [
        (odd, {}, "aspect ratio"),
        (cross, {"layout": "latlong"}, "must be 2:1 for layout latlong, got '8 x 6'"),
        (cross, {"orientation": "three"}, "orientation: applies to lat-long"),
        (cross, {"orientation": "maya"}, "orientation: must be one of"),
        (cross, {"size": 0}, "size: must be"),
        (cross, {"layout": "octahedral"}, "layout: must be one of"),
        (cross, {"negative": "ignore"}, "negative: must be one of"),
        ([odd] * 5, {}, "six files"),
        ([odd] * 6, {}, "square"),
        (tmp_path, {"layout": "latlong"}, "must be 'faces'"),
        (tmp_path, {}, r"a file for face \+x"),
        (3, {}, "path: must be a path"),
    ]
    for path, options, said in cases:
        with pytest.raises(ValueError, match=said) as caught:
            glossy.read_environment(path, **options)  # type: ignore[arg-type]
        assert "\n" not in str(caught.value)
    with pytest.raises(OSError, match="no such file"):
        glossy.read_environment(tmp_path / "none.exr")


def test_six_files_of_one_size(tmp_path: pathlib.Path) -> None:
    files = six_files(tmp_path, ("px", "nx", "py", "ny", "pz", "nz"), noise(6, 4, 4))
    write_image(files[4], noise(2, 2))
    with pytest.raises(ValueError, match=r"pz\.exr: must be as large as px\.exr"):
        glossy.read_environment(files)


# real maps ----------------------------------------------------------------------------------------


def test_real_files_read_with_their_counts(real_data: pathlib.Path) -> None:
    read_source = importlib.import_module("glossy.environment").read_source
    for file in sorted((real_data / "env").iterdir()):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            source = read_source(file)
        assert source.layout == "latlong"
        assert len(said) == (1 if source.negative else 0)
        assert bool(source.negative) == (file.suffix == ".exr")  # lossy files ring
        cube = source.to_cube(128)
        np.testing.assert_allclose(
            cube.power(), source.power(), rtol=tolerances.CONVERTED_POWER, err_msg=file.name
        )


# the command --------------------------------------------------------------------------------------

Run = Callable[..., int]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path) -> Run:
    monkeypatch.setattr(cli, "COMMANDS", ("environment",))
    monkeypatch.chdir(tmp_path)
    return lambda *args: cli.main(["environment", *map(str, args)])


@pytest.mark.filterwarnings("always")
def test_the_command_reports_what_it_recognised(
    run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    pixels = noise(16, 32)
    pixels[0, 0, 0] = -1.0
    write_image("in.exr", pixels)
    assert run("in.exr", "-o", "out.exr", "--size", 8, "--json") == 0
    text = capsys.readouterr()
    assert text.err == "glossy: warning: in.exr: 1 negative values clamped to 0 (lowest -1)\n"
    report = json.loads(text.out)
    expected = latlong_to_cube(np.maximum(pixels, 0.0), 8)
    wanted = {
        "schema": 1,
        "input": "in.exr",
        "layout": "latlong",
        "width": 32,
        "height": 16,
        "source_size": 8,
        "size": 8,
        "orientation": "glossy",
        "negative": 1,
        "nonfinite": 0,
        "output_layout": "cross",
        "files": ["out.exr"],
    }
    assert {k: report[k] for k in wanted} == wanted
    np.testing.assert_allclose(
        report["power"], report["source_power"], rtol=tolerances.CONVERTED_POWER
    )
    assert np.array_equal(glossy.read_environment("out.exr", size=None).faces, expected)
    assert run("in.exr", "-o", "out.exr", "--size", 8, "--negative", "error") == 2
    assert "1 negative values" in capsys.readouterr().err
    assert run("in.exr", "-o", "out.exr", "--size", 8) == 0
    shown = capsys.readouterr().out
    assert "latlong, 32 x 16, orientation glossy; cube map of 8" in shown
    assert "values negative: 1, NaN or inf: 0" in shown


@pytest.mark.parametrize("output", ["set", "sky.hdr", "sky.exr"])
def test_the_command_writes_six_faces(run: Run, output: str, tmp_path: pathlib.Path) -> None:
    assert run("axes", "-o", output, "--layout", "faces", "--size", 16) == 0
    again = "set" if output == "set" else f"sky_*{pathlib.Path(output).suffix}"
    cube = glossy.read_environment(again, size=None)
    stored = tolerances.RGBE if output.endswith("hdr") else tolerances.SINGLE
    np.testing.assert_allclose(cube.faces, glossy.environment("axes", 16).faces, atol=stored)
    assert not [f for f in tmp_path.rglob("*") if f.name.startswith(".")]


def test_the_command_converts_between_conventions(run: Run) -> None:
    """Written for three.js and read as such: the same cube; read as Unity's: another one."""
    options = ("--layout", "latlong", "--size", 16, "--output-orientation", "three")
    assert run("axes", "-o", "t.exr", *options) == 0
    assert read_image("t.exr").pixels.shape == (32, 64, 3)
    right = glossy.read_environment("t.exr", size=16, orientation="three")
    wrong = glossy.read_environment("t.exr", size=16, orientation="unity")
    flat = glossy.environment("axes", 16).faces.mean(axis=(1, 2))
    assert np.abs(right.faces.mean(axis=(1, 2)) - flat).max() < 0.03  # bilinear at the borders
    assert np.abs(wrong.faces.mean(axis=(1, 2)) - flat).max() > 0.3


def test_the_command_refuses(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    write_image("a.png", noise(4, 8))
    cases = [
        (("a.png", "-o", "b.exr"), "encoding"),
        (("missing.exr", "-o", "b.exr"), "no such file"),
        (("sky", "-o", "b.exr", "--orientation", "three"), "--orientation: has no meaning"),
        (("sky", "-o", "b.exr", "--seed", "3"), "--seed: has no meaning"),
        (("a.png", "-o", "b.exr", "--seed", "3"), "--seed: has no meaning"),
        (("white", "-o", "b.tga"), "suffix"),
        (("white", "-o", "b.exr", "--size", "0"), "size"),
        (("white", "-o", "b.exr", "--output-orientation", "three"), "needs --layout latlong"),
        (("white", "-o", "no/b.exr"), "folder does not exist"),
    ]
    for args, said in cases:
        assert run(*args) == 2
        text = capsys.readouterr()
        assert said in text.err
        assert text.err.count("\n") == 1
        assert not pathlib.Path("b.exr").exists()


def test_the_command_s_limits_and_crops(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    pathlib.Path("c.exr").write_bytes(rgb_exr(noise(4, 4), display=(0, 0, 7, 3)))
    assert run("c.exr", "-o", "b.exr", "--size", 2) == 2
    text = capsys.readouterr().err
    assert "--crop black" in text
    assert text.count("\n") == 1
    assert run("c.exr", "-o", "b.exr", "--size", 2, "--crop", "black") == 0
    capsys.readouterr()
    assert run("c.exr", "-o", "b.exr", "--crop", "black", "--max-pixels", 31) == 2
    assert "limit of 31 pixels (max_pixels); --max-pixels raises it" in capsys.readouterr().err
    envmap = attribute(b"envmap", b"envmap", b"\0")
    pathlib.Path("l.exr").write_bytes(rgb_exr(noise(8, 16), extra=envmap))
    assert run("l.exr", "-o", "b.exr", "--size", 2, "--json") == 0
    assert json.loads(capsys.readouterr().out)["orientation"] == "openexr"


def test_pictures_take_the_same_options(
    monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, "COMMANDS", ("render",))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c.exr").write_bytes(rgb_exr(noise(4, 4), display=(0, 0, 7, 3)))
    line = ["render", "--env", "c.exr", "--material", "mx=.2", "-o", "o.exr"]
    for more, said in (
        ([], "stores only part of the picture"),
        (["--crop", "black", "--max-pixels", "31"], "limit of 31 pixels"),
    ):
        assert cli.main([*line, *more]) == 2
        text = capsys.readouterr().err
        assert said in text
        assert text.count("\n") == 1
    (tmp_path / "s.toml").write_text('[environment]\nsource = "c.exr"\ncrop = "black"\nsize = 2\n')
    scene = glossy.load_scene(tmp_path / "s.toml")
    assert scene.environment is not None
    read = scene.environment.load()
    assert np.array_equal(read.faces, glossy.read_environment("c.exr", size=2, crop="black").faces)


@pytest.mark.parametrize("place", ["map.exr", "faces/px.exr", "map.hdr"])
def test_pipes_are_refused_at_once(
    run: Run, capsys: pytest.CaptureFixture[str], place: str
) -> None:
    pathlib.Path("faces").mkdir()
    six_files(pathlib.Path("faces"), ("nx", "py", "ny", "pz", "nz"), noise(6, 2, 2)[1:])
    os.mkfifo(place)
    source = "faces" if place.startswith("faces") else place
    assert run(source, "-o", "b.exr") == 2
    text = capsys.readouterr().err
    assert "is not a regular file" in text or "must hold a file for face +x" in text
    assert text.count("\n") == 1


def test_the_command_makes_a_picture(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("spots", "-o", "s.png", "--size", 16, "--seed", 4, "--exposure", -2) == 0
    assert "spots: built-in, cube map of 16" in capsys.readouterr().out
    assert read_image("s.png", encoding="srgb").pixels.shape == (48, 64, 3)
