"""Rendering from a G-buffer on the command line, and damaged G-buffers."""

import json
import pathlib
from typing import Any

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
    given = [trace.pop("provenance")["inputs"] for trace in traced]
    assert [list(inputs) for inputs in given] == [[file], []]
    assert traced[0] == traced[1]
    assert main(["trace", *SIZE, "--gbuffer", file, "--pixel", "0,0"]) == 2
    assert "pixel: must see the surface" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", ["exr", "npz"])
def test_a_mask_says_of_every_pixel(
    points: SurfacePoints, tmp_path: pathlib.Path, suffix: str
) -> None:
    """NaN is neither seen nor hidden."""
    mask = points.coverage.astype(np.float32)
    mask[1, 2] = np.nan
    file = tmp_path / f"p.{suffix}"
    stored = {"normal": points.normal, "view": points.view}
    if suffix == "npz":
        np.savez(file, mask=mask, normal=points.normal, view=points.view)
    else:
        planes = {f"{k}.{c}": v[..., i] for k, v in stored.items() for i, c in enumerate("XYZ")}
        write_exr(file, {**planes, "mask": mask})
    with pytest.raises(ValueError, match=rf"p\.{suffix}: mask: must be numbers, got .*pixel 2,1"):
        read_gbuffer(file)


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


# --- how vectors are stored, and what they are called ---------------------------------------------


def arrays(points: SurfacePoints) -> dict[str, Any]:
    """Normal and view, zero where nothing is seen."""
    seen = points.coverage[..., None]
    return {name: np.where(seen, getattr(points, name), 0.0) for name in ("normal", "view")}


def eight_bits(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(np.round((vectors * 0.5 + 0.5) * 255.0), dtype=np.uint8)


def test_encoded_normals_of_eight_bits(points: SurfacePoints, tmp_path: pathlib.Path) -> None:
    """Grey, as a cleared buffer decodes, and black are no surface; lengths need normalise."""
    stored = arrays(points)
    file = tmp_path / "p.npz"
    for empty in (0, 127, 128):
        normal = np.where(points.coverage[..., None], eight_bits(stored["normal"]), empty)
        np.savez(file, normal=normal.astype(np.uint8), view=stored["view"])
        back = read_gbuffer(file, encoded=["normal"], normalise=True)
        assert np.array_equal(back.coverage, points.coverage)
        assert np.abs(back.normal - points.normal)[points.coverage].max() < 1.0 / 127.0
    x, y = np.argwhere(points.coverage)[0][::-1]
    with pytest.raises(ValueError, match=rf"p\.npz: normal: must be unit .*pixel {x},{y}.*length"):
        read_gbuffer(file, encoded="normal")
    with pytest.raises(ValueError, match="normalise takes any length"):
        read_gbuffer(file)


def test_ten_bit_normals_in_an_exr(
    points: SurfacePoints, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the command line, under names of the file's own."""
    stored = arrays(points)
    coarse = np.floor((stored["normal"] * 0.5 + 0.5) * 1023.0) / 1023.0
    coarse[~points.coverage] = 0.0
    both = {"Ns": coarse, "cam.I": stored["view"]}
    channels = {
        f"{prefix}.{axis}": np.ascontiguousarray(v[..., k], np.float32)
        for prefix, v in both.items()
        for k, axis in enumerate("XYZ" if prefix == "Ns" else "RGB")
    }
    file, out = str(tmp_path / "p.exr"), str(tmp_path / "o.exr")
    write_exr(file, channels)
    named = ("--gbuffer", file, "--gbuffer-normal", "Ns", "--gbuffer-view", "cam.I")
    encoded = ("--gbuffer-encoded", "normal")
    assert main(["render", *SIZE, *named, *encoded, "-o", out]) == 2
    assert "normalise takes any length" in capsys.readouterr().err
    assert main(["render", *SIZE, *named, *encoded, "--normalise", "--json", "-o", out]) == 0
    done = capsys.readouterr()
    assert json.loads(done.out)["covered"] == int(points.coverage.sum())
    assert done.err == ""
    assert main(["render", *SIZE, *named[:4], "--gbuffer-view", "J", "-o", out]) == 2
    assert "p.exr: misses channels J.X, J.Y, J.Z" in capsys.readouterr().err


def test_a_scene_file_says_how_its_gbuffer_is_read(
    points: SurfacePoints, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = arrays(points)
    np.savez(tmp_path / "p.npz", Ns=3.0 * stored["normal"], view=stored["view"])
    table = '[gbuffer]\nfile = "p.npz"\nnormal = "Ns"\n'
    scene, out = tmp_path / "s.toml", str(tmp_path / "o.exr")
    for text, code in ((table, 2), (table + "normalise = true\n", 0), (table + "size = 1\n", 2)):
        scene.write_text(text)
        assert main(["render", str(scene), *SIZE, "-o", out]) == code
    assert "gbuffer.size: unknown key" in capsys.readouterr().err
    scene.write_text(table)
    assert main(["render", str(scene), *SIZE, "--normalise", "-o", out]) == 0


@pytest.mark.parametrize("option", [("--normalise",), ("--gbuffer-view", "I")])
@pytest.mark.parametrize("scene", [(), ("room",)])
def test_options_of_a_gbuffer_need_one(
    option: tuple[str, ...],
    scene: tuple[str, ...],
    tmp_path: pathlib.Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["render", *scene, *option, "-o", str(tmp_path / "o.exr")]) == 2
    assert f"{option[0]}: has a meaning with --gbuffer only" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"encoded": ["position"]}, "encoded: must be one of normal, view, tangent"),
        ({"encoded": 3}, "encoded: must be a sequence"),
        ({"normalise": "yes"}, "normalise: must be True or False"),
        ({"normal": 3}, "normal: must be what the file calls it"),
        ({"mask": "alpha"}, "p.npz: misses array alpha"),
        ({"mask": "a\n\x85b"}, "p.npz: misses array a b$"),
    ],
)
def test_bad_options_are_named(
    options: dict[str, object], message: str, points: SurfacePoints, tmp_path: pathlib.Path
) -> None:
    write_gbuffer(tmp_path / "p.npz", points)
    with pytest.raises(ValueError, match=message):
        read_gbuffer(tmp_path / "p.npz", **options)  # type: ignore[arg-type]


# --- what is not looked at, and what is warned of ------------------------------------------------


@pytest.mark.parametrize("suffix", ["npz", "exr"])
def test_nothing_that_the_mask_hides_is_looked_at(
    suffix: str, points: SurfacePoints, tmp_path: pathlib.Path
) -> None:
    stored = arrays(points)
    hidden = ~points.coverage
    stored["normal"][hidden], stored["view"][hidden] = np.nan, np.inf
    file = tmp_path / f"p.{suffix}"

    def write(mask: np.ndarray) -> None:
        if suffix == "npz":
            np.savez(file, mask=mask, **stored)
        else:
            channels = {
                f"{name}.{axis}": v[..., k].astype(np.float32)
                for name, v in stored.items()
                for k, axis in enumerate("XYZ")
            }
            write_exr(file, {**channels, "A": mask.astype(np.float32)})

    write(points.coverage)
    assert np.array_equal(read_gbuffer(file).coverage, points.coverage)
    mask = points.coverage.copy()
    mask[1, 2] = True
    write(mask)
    with pytest.raises(ValueError, match=r"normal: must be finite \(pixel 2,1\)"):
        read_gbuffer(file)


@pytest.mark.filterwarnings("default:view:UserWarning")
def test_views_into_the_surface_are_counted(
    points: SurfacePoints, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A buffer of the opposite convention is all black; a shape seen from outside is not told."""
    stored = arrays(points)
    file, out = tmp_path / "p.npz", str(tmp_path / "o.exr")
    np.savez(file, normal=stored["normal"], view=-stored["view"])
    assert main(["render", *SIZE, "--gbuffer", str(file), "-o", out]) == 0
    err = capsys.readouterr().err
    count = int(points.coverage.sum())
    x, y = np.argwhere(points.coverage)[0][::-1]
    assert err.count("\n") == 1
    assert f"view: {count} of {count} points look into the surface (pixel {x},{y})" in err
    for command in ("render", "reference"):
        write_gbuffer(file, points)
        assert main([command, *SIZE, "--gbuffer", str(file), "-o", out]) == 0
        assert capsys.readouterr().err == ""


def test_points_that_are_no_picture_are_not_written(tmp_path: pathlib.Path) -> None:
    one = SurfacePoints([0, 0, 1.0], [1.0, 0, 0], [0, 0, 1.0])
    with pytest.raises(ValueError, match=r"points must have shape \(H, W\)"):
        write_gbuffer(tmp_path / "p.npz", one)
    with pytest.raises(ValueError, match=r"must be \.npz or \.exr"):
        write_gbuffer(tmp_path / "p.tif", surface_points(default_camera(Sphere(), 4, 4), Sphere()))
    assert not list(tmp_path.iterdir())
