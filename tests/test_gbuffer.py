"""Rendering from a G-buffer on the command line, and damaged G-buffers."""

import json
import pathlib

import numpy as np
import pytest
import tolerances

from glossy.cli import main
from glossy.frames import SurfacePoints
from glossy.gbuffer import pick_channels, read_gbuffer, write_gbuffer
from glossy.image import read_image
from glossy.image_write import write_exr
from glossy.scene import Sphere, default_camera, surface_points

SIZE = ("--env", "studio", "--size", "16", "--material", "mx=.2,my=.1")


@pytest.fixture
def points() -> SurfacePoints:
    return surface_points(default_camera(Sphere(), 14, 10), Sphere())


@pytest.mark.parametrize("command", ["render", "reference"])
@pytest.mark.parametrize("suffix", ["npz", "exr"])
def test_a_picture_from_a_gbuffer_is_the_picture_of_the_shape(
    command: str,
    suffix: str,
    points: SurfacePoints,
    tmp_path: pathlib.Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The same bits from float64; float32 vectors move a bilinear lookup by their rounding."""
    file, shape, again = (str(tmp_path / name) for name in (f"p.{suffix}", "s.exr", "g.exr"))
    write_gbuffer(file, points)
    picture = ("--width", "14", "--height", "10", "--background", "black")
    assert main([command, *SIZE, *picture, "-o", shape]) == 0
    capsys.readouterr()
    assert main([command, *SIZE, "--gbuffer", file, "--json", "-o", again]) == 0
    value = json.loads(capsys.readouterr().out)
    assert (value["width"], value["height"]) == (14, 10)
    assert value["covered"] == int(points.coverage.sum())
    a, b = read_image(shape).rgb(), read_image(again).rgb()
    assert not b[~points.coverage].any()
    assert b[points.coverage].min() > 0.0
    if suffix == "npz":
        assert np.array_equal(a, b)
    else:
        assert np.abs(a - b).max() < tolerances.GBUFFER_SINGLE * a.max()


def test_trace_takes_a_gbuffer(
    points: SurfacePoints, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(tmp_path / "p.npz")
    write_gbuffer(file, points)
    traced = []
    for where in (["--gbuffer", file], ["--width", "14", "--height", "10"]):
        assert main(["trace", *SIZE, *where, "--pixel", "7,5", "--json"]) == 0
        traced.append(json.loads(capsys.readouterr().out))
    assert traced[0] == traced[1]
    assert main(["trace", *SIZE, "--gbuffer", file, "--pixel", "0,0"]) == 2
    assert "pixel: must see the surface" in capsys.readouterr().err


def test_a_mask_in_an_exr_hides_pixels(points: SurfacePoints, tmp_path: pathlib.Path) -> None:
    channels = {
        f"{prefix}.{axis}": np.ascontiguousarray(vector[..., k], np.float32)
        for prefix, vector in (("N", points.normal), ("V", points.view))
        for k, axis in enumerate("XYZ")
    }
    alpha = np.zeros(points.shape, np.float32)
    alpha[5, 4:9] = 1.0
    write_exr(tmp_path / "p.exr", {**channels, "A": alpha})
    back = read_gbuffer(tmp_path / "p.exr")
    assert np.array_equal(back.coverage, points.coverage & (alpha > 0.5))
    assert np.abs(back.normal - points.normal)[5, 4:9].max() < tolerances.SINGLE


@pytest.mark.parametrize("missing", ["N.Y", "V.X"])
def test_a_missing_channel_is_named(
    missing: str, points: SurfacePoints, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ("N.X", "N.Y", "N.Z", "V.X", "V.Y", "V.Z")
    stack = np.concatenate([points.normal, points.view], axis=-1).astype(np.float32)
    channels = {n: np.ascontiguousarray(stack[..., k]) for k, n in enumerate(names) if n != missing}
    write_exr(tmp_path / "p.exr", channels)
    out = tmp_path / "o.exr"
    assert main(["render", *SIZE, "--gbuffer", str(tmp_path / "p.exr"), "-o", str(out)]) == 2
    vector = {"N": "normal", "V": "view"}[missing[0]]
    words = f"p.exr: misses channels {vector}.X, {vector}.Y, {vector}.Z\n"
    assert capsys.readouterr().err.endswith(words)
    assert not out.exists()


def test_longer_names_win_over_single_letters(points: SurfacePoints) -> None:
    """A file with normal.X and N.X is read by the spelled-out name."""
    right = {f"normal.{a}": points.normal[..., k] for k, a in enumerate("XYZ")}
    wrong = {f"N.{a}": np.zeros(points.shape) for a in "XYZ"}
    assert np.array_equal(pick_channels({**wrong, **right})["normal"], points.normal)


@pytest.mark.parametrize("suffix", ["npz", "exr"])
def test_damaged_files_are_one_line_naming_the_file(
    suffix: str, points: SurfacePoints, tmp_path: pathlib.Path
) -> None:
    """Cut anywhere, and with bytes changed: read as numbers, or refused by name."""
    path = tmp_path / f"p.{suffix}"
    write_gbuffer(path, points)
    whole = path.read_bytes()
    random = np.random.default_rng(5)
    damaged = [whole[: len(whole) * k // 12] for k in range(12)]
    for _ in range(60):
        data = bytearray(whole)
        for place in random.integers(len(data), size=4):
            data[place] = random.integers(256)
        damaged.append(bytes(data))
    refusals = []
    for content in damaged:
        path.write_bytes(content)
        try:
            read_gbuffer(path)
        except ValueError as error:
            refusals.append(str(error))
    assert len(refusals) >= 12
    assert all(text.startswith(str(path)) and "\n" not in text for text in refusals)


def test_points_that_are_no_picture_are_not_written(tmp_path: pathlib.Path) -> None:
    one = SurfacePoints([0, 0, 1.0], [1.0, 0, 0], [0, 0, 1.0])
    with pytest.raises(ValueError, match=r"points must have shape \(H, W\)"):
        write_gbuffer(tmp_path / "p.npz", one)
    with pytest.raises(ValueError, match=r"must be \.npz or \.exr"):
        write_gbuffer(tmp_path / "p.tif", surface_points(default_camera(Sphere(), 4, 4), Sphere()))
    assert not list(tmp_path.iterdir())
