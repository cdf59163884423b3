"""``glossy compare``: what it prints, its exit codes, and that bad input is one line."""

import json
import os
import pathlib
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import glossy
from glossy import cli, image, image_write

RNG = np.random.default_rng(11)
REFERENCE = RNG.random((20, 30, 3)).astype(np.float32)
TEST = (REFERENCE + 0.01 * RNG.standard_normal(REFERENCE.shape)).astype(np.float32)


@pytest.fixture
def folder(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> pathlib.Path:
    """A working folder with a test image, its reference and a mask."""
    monkeypatch.chdir(tmp_path)
    image.write_image("a.exr", TEST)
    image.write_image("b.exr", REFERENCE)
    mask = np.zeros((20, 30), dtype=np.uint8)
    mask[5:9, 7:20] = 1
    image_write.write_png("mask.png", mask[..., None])
    return tmp_path


def compare(*arguments: str) -> int:
    return cli.main(["compare", *arguments])


def figures(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert compare(*arguments, "--json") in (0, 1)
    out = json.loads(capsys.readouterr().out)
    assert isinstance(out, dict)
    return out


def refusal(capfd: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line that exit code 2 comes with."""
    assert compare(*arguments) == 2
    out = capfd.readouterr()
    assert out.out == ""
    assert out.err.startswith("glossy compare: ")
    assert out.err.count("\n") == 1
    return out.err


@pytest.mark.usefixtures("folder")
def test_figures_are_those_of_the_library(capsys: pytest.CaptureFixture[str]) -> None:
    out = figures(capsys, "a.exr", "b.exr", "--peak", "2")
    expected = glossy.compare(TEST, REFERENCE, peak=2.0).to_dict()
    assert {k: out[k] for k in expected} == expected
    assert (out["a"], out["reference"], out["within_limits"]) == ("a.exr", "b.exr", True)


@pytest.mark.usefixtures("folder")
def test_text_names_the_peak_and_the_worst_pixel(capsys: pytest.CaptureFixture[str]) -> None:
    assert compare("a.exr", "b.exr", "--peak", "3") == 0
    out = capsys.readouterr().out
    got = glossy.compare(TEST, REFERENCE, peak=3.0)
    assert f"{got.psnr:.4f} dB (peak 3)" in out
    assert f"at x={got.max_at[0]}, y={got.max_at[1]} in {got.max_channel}" in out


@pytest.mark.usefixtures("folder")
def test_identical_images(capsys: pytest.CaptureFixture[str]) -> None:
    assert compare("b.exr", "b.exr", "--max-rms", "0", "--min-psnr", "300") == 0
    assert "psnr          infinite (peak 1)" in capsys.readouterr().out
    out = figures(capsys, "b.exr", "b.exr")
    assert (out["psnr"], out["identical"], out["rms"]) == (None, True, 0.0)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("option", "figure", "inside", "outside"),
    [
        ("--max-rms", "rms", 1.01, 0.99),
        ("--max-relative-rms", "relative_rms", 1.01, 0.99),
        ("--min-psnr", "psnr", 0.99, 1.01),
    ],
)
def test_limits_decide_the_exit_code(
    capsys: pytest.CaptureFixture[str], option: str, figure: str, inside: float, outside: float
) -> None:
    value = getattr(glossy.compare(TEST, REFERENCE), figure)
    assert compare("a.exr", "b.exr", option, str(value * inside)) == 0
    assert capsys.readouterr().err == ""
    assert compare("a.exr", "b.exr", option, str(value * outside)) == 1
    err = capsys.readouterr().err
    assert f"{option} {value * outside:g}" in err
    assert err.startswith("glossy compare: a.exr: ")
    assert err.count("\n") == 1
    out = figures(capsys, "a.exr", "b.exr", option, str(value * outside))
    assert out["within_limits"] is False
    assert out["limits"][option[2:].replace("-", "_")] == value * outside
    assert len(out["failures"]) == 1


@pytest.mark.usefixtures("folder")
def test_mask(capsys: pytest.CaptureFixture[str]) -> None:
    out = figures(capsys, "a.exr", "b.exr", "--mask", "mask.png")
    assert out["pixels"] == 4 * 13
    assert out["rms"] == glossy.rms(TEST[5:9, 7:20], REFERENCE[5:9, 7:20])


@pytest.mark.usefixtures("folder")
def test_integers_need_their_encoding(capfd: pytest.CaptureFixture[str]) -> None:
    image.write_image("a.png", TEST)
    image.write_image("b.png", REFERENCE, bits=16)
    assert "say whether they are linear or srgb" in refusal(capfd, "a.png", "b.png")
    rms = {}
    for encoding in ("linear", "srgb"):
        rms[encoding] = figures(capfd, "a.png", "b.png", "--encoding", encoding)["rms"]
        planes = [image.read_image(n, encoding).rgb() for n in ("a.png", "b.png")]
        assert rms[encoding] == glossy.rms(*planes)
    assert rms["linear"] != rms["srgb"]
    clipped = np.clip(TEST, 0.0, 1.0)
    assert rms["srgb"] == pytest.approx(glossy.rms(clipped, REFERENCE), rel=0.02)


@pytest.mark.usefixtures("folder")
def test_extra_channels_wait_to_be_named(capfd: pytest.CaptureFixture[str]) -> None:
    rgb = {n: REFERENCE[..., i] for i, n in enumerate("RGB")}
    image.write_exr("truth.exr", {**rgb, "error.R": TEST[..., 1], "A": TEST[..., 2]})
    assert figures(capfd, "a.exr", "truth.exr")["rms"] == glossy.rms(TEST, REFERENCE)
    back = figures(capfd, "truth.exr", "a.exr")
    assert (back["rms"], back["channels"]) == (glossy.rms(TEST, REFERENCE), ["R", "G", "B"])
    out = figures(capfd, "truth.exr", "truth.exr", "--channels", "error.R,A")
    assert out["channels"] == ["error.R", "A"]
    text = refusal(capfd, "a.exr", "truth.exr", "--channels", "error.R")
    assert "a.exr: has no channel error.R; it has R, G, B" in text


@pytest.mark.usefixtures("folder")
def test_channels_must_correspond(capfd: pytest.CaptureFixture[str]) -> None:
    image.write_image("grey.exr", REFERENCE[..., 0])
    image.write_exr("depth.exr", {"Z": REFERENCE[..., 0]})
    image.write_exr("other.exr", {"W": REFERENCE[..., 0]})
    assert "differ in channels, R, G, B and Y" in refusal(capfd, "a.exr", "grey.exr")
    assert "differ in channels, Z and W" in refusal(capfd, "depth.exr", "other.exr")
    assert figures(capfd, "grey.exr", "grey.exr")["channels"] == ["Y"]
    assert figures(capfd, "depth.exr", "depth.exr")["channels"] == ["Z"]


@pytest.mark.usefixtures("folder")
def test_flip_by_the_kind_of_the_files(capsys: pytest.CaptureFixture[str]) -> None:
    out = figures(capsys, "a.exr", "b.exr", "--flip")
    assert out["flip_kind"] == "hdr"
    assert out["flip"] == glossy.compare(TEST, REFERENCE, flip="hdr").flip
    for name, pixels in (("a.png", TEST), ("b.png", REFERENCE)):
        image.write_image(name, pixels)
    assert figures(capsys, "a.png", "b.png", "--encoding", "srgb", "--flip")["flip_kind"] == "ldr"
    assert compare("a.exr", "b.exr", "--flip") == 0
    assert "HDR-FLIP" in capsys.readouterr().out


def test_difference_picture(folder: pathlib.Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert compare("a.exr", "b.exr", "--diff", "d.png", "--diff-limit", "0.05") == 0
    written = image.read_image("d.png", encoding="linear").pixels
    expected = glossy.difference_picture(TEST, REFERENCE, limit=0.05)
    np.testing.assert_array_equal(np.rint(written * 255), expected)
    assert compare("a.exr", "b.exr", "--diff", "s.png", "--signed") == 0
    signed = glossy.difference_picture(TEST, REFERENCE, signed=True)
    written = image.read_image("s.png", encoding="linear").pixels
    np.testing.assert_array_equal(np.rint(written * 255), signed)
    assert (folder / "d.png").exists()
    capfd.readouterr()
    assert "must end in .png" in refusal(capfd, "a.exr", "b.exr", "--diff", "d.exr")
    assert "options of --diff" in refusal(capfd, "a.exr", "b.exr", "--signed")
    before = (folder / "mask.png").read_bytes()
    text = refusal(capfd, "a.exr", "b.exr", "--mask", "mask.png", "--diff", "mask.png")
    assert "is one of the inputs" in text
    assert (folder / "mask.png").read_bytes() == before


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["none.exr", "b.exr"], "none.exr: no such file"),
        (["a.exr", "none.exr"], "none.exr: no such file"),
        (["a.exr", "small.exr"], "a.exr, small.exr: differ in size, 30 x 20 and 29 x 20"),
        (["a.exr", "nan.exr"], "nan.exr: must be finite, got 1 NaN or inf values, the first at "
         "x=4, y=3, channel G"),
        (["a.exr", "b.exr", "--mask", "small.exr"], "small.exr: differs in size"),
        (["a.exr", "b.exr", "--mask", "black.exr"], "black.exr: is black"),
        (["a.exr", "b.exr", "--mask", "nan.exr"], "nan.exr: holds NaN"),
        (["a.exr", "b.exr", "--mask", "a.exr", "--flip"], "--flip: is a figure of whole images"),
        (["a.exr", "b.exr", "--peak", "0"], "--peak: must be in (0, inf), got 0.0"),
        (["a.exr", "b.exr", "--max-rms", "nan"], "--max-rms: must be finite"),
        (["a.exr", "b.exr", "--max-relative-rms", "-1"], "--max-relative-rms"),
        (["a.exr", "b.exr", "--max-pixels", "599"], "limit of 599 pixels"),
        (["a.exr", "b.exr", "--max-pixels", "0"], "--max-pixels"),
        (["a.exr", "b.exr", "--diff", "nowhere/d.png"], "its folder does not exist"),
        (["a.exr", "moved.exr"], "differ in data window, (0, 0) to (29, 19) and (1, 0)"),
        (["a.exr", "b.exr", "--mask", "moved.exr"], "moved.exr, a.exr: differ in data window"),
        (["-", "-"], "only one of them can be standard input"),
        (["a.exr", "b.exr", "--ignore", "*.txt"], "--ignore: is an option of folders"),
        (["a.exr", "b.exr", "--diff", "b.exr"], "b.exr: is one of the inputs"),
        (["a.exr", "b.exr", "--diff", "hard.png"], "hard.png: is one of the inputs"),
        (["a.exr", "b.exr", "--signed"], "options of --diff"),
        (["a.exr", "b.exr", "--channels", "R,R"], "--channels: must be different"),
        (["a.exr", "b.exr", "--diff", "./b.exr"], "b.exr: is one of the inputs"),
        (["a.exr", "b.exr", "--channels", "R,Q"], "a.exr: has no channel Q; it has R, G, B"),
        (["a.exr", "black.exr", "--flip"], "black.exr: is black"),
    ],
)  # fmt: skip
def test_unusable_input(
    capfd: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    import OpenEXR

    os.link("b.exr", "hard.png")
    image.write_image("small.exr", REFERENCE[:, :29])
    image.write_image("black.exr", 0 * REFERENCE)
    broken = REFERENCE.copy()
    broken[3, 4, 1] = np.nan
    image.write_image("nan.exr", broken)
    window = (np.array([1, 0], np.int32), np.array([30, 19], np.int32))
    OpenEXR.File({"dataWindow": window}, {"RGB": REFERENCE.copy()}).write("moved.exr")
    assert words in refusal(capfd, *arguments)


def test_help_shows_an_example_and_needs_no_image_library() -> None:
    code = (
        "import sys; from glossy import cli\n"
        "try: cli.main(['compare', '--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'numba', 'OpenEXR', 'OpenImageIO', 'matplotlib', 'scipy'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "glossy compare render.exr truth.exr" in done.stdout
    assert done.stdout.splitlines()[-1] == "[]"


def test_comparing_loads_neither_compiler_nor_plotting(folder: pathlib.Path) -> None:
    code = (
        "import sys; from glossy import cli\n"
        "code = cli.main(['compare', 'a.exr', 'b.exr'])\n"
        "heavy = {'numba', 'OpenImageIO', 'matplotlib', 'scipy', 'flip_evaluator'}\n"
        "print(code, sorted(heavy & set(sys.modules)))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=folder
    )
    assert done.stdout.splitlines()[-1] == "0 []"


def test_pixels_outside_the_mask_may_hold_anything(
    folder: pathlib.Path, capfd: pytest.CaptureFixture[str]
) -> None:
    wild = np.full_like(TEST, np.nan)
    wild[0] = np.inf
    wild[5:9, 7:20] = TEST[5:9, 7:20]
    image.write_image("wild.exr", wild)
    arguments = ("wild.exr", "b.exr", "--mask", "mask.png", "--diff", "d.png")
    assert figures(capfd, *arguments)["rms"] == glossy.rms(TEST[5:9, 7:20], REFERENCE[5:9, 7:20])
    assert (folder / "d.png").exists()
    assert capfd.readouterr() == ("", "")
    assert "wild.exr: must be finite" in refusal(capfd, "wild.exr", "b.exr")


@pytest.mark.usefixtures("folder")
def test_the_mask_goes_by_its_colours(capfd: pytest.CaptureFixture[str]) -> None:
    """Alpha and the further channels of a mask are not looked at, if it has colours."""
    kept = np.zeros((20, 30), dtype=np.float32)
    kept[3, 4:9] = 0.5
    other = np.full_like(kept, np.nan)
    image.write_exr(
        "m.exr", {"R": 0 * kept, "G": kept, "B": 0 * kept, "A": 0 * kept + 1, "Z": other}
    )
    assert figures(capfd, "a.exr", "b.exr", "--mask", "m.exr")["pixels"] == 5
    image.write_exr("z.exr", {"Z": kept})
    assert figures(capfd, "a.exr", "b.exr", "--mask", "z.exr")["pixels"] == 5
    image.write_exr("nan.exr", {"Z": other})
    assert "nan.exr: holds NaN" in refusal(capfd, "a.exr", "b.exr", "--mask", "nan.exr")
    assert "none.png: no such file" in refusal(capfd, "a.exr", "b.exr", "--mask", "none.png")


@pytest.mark.usefixtures("folder")
def test_json_fields(capsys: pytest.CaptureFixture[str]) -> None:
    """The fields of a Comparison, what was compared, and the verdict."""
    library = list(glossy.compare(TEST, REFERENCE).to_dict())
    extra = ["channels_left_out", "unlike", "a", "reference", "within_limits", "failures"]
    single = figures(capsys, "a.exr", "b.exr", "--min-psnr", "10")
    assert list(single) == ["schema", "command", *library[1:], *extra, "warnings", "limits"]
    given = {k: v for k, v in single["limits"].items() if v is not None}
    assert given == {"min_psnr": 10.0}
    assert {"max_rms", "max_relative_rms", "max_outliers", "warn_psnr"} < set(single["limits"])


@pytest.mark.usefixtures("folder")
def test_all_limits_are_judged_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    limits = ("--max-rms", "1e-6", "--max-relative-rms", "1e-6", "--min-psnr", "200")
    assert compare("a.exr", "b.exr", *limits) == 1
    assert capsys.readouterr().err.count("\n") == 3
    image.write_image("black.exr", 0 * REFERENCE)
    out = figures(capsys, "a.exr", "black.exr", "--max-relative-rms", "1e300")
    assert (out["relative_rms"], out["within_limits"]) == (None, False)


@pytest.mark.usefixtures("folder")
def test_flip_not_installed_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    assert "pip install glossy-envmap[flip]" in refusal(capfd, "a.exr", "b.exr", "--flip")


@pytest.mark.usefixtures("folder")
def test_the_place_of_pictures_is_checked_first(capfd: pytest.CaptureFixture[str]) -> None:
    os.mkdir("p.png")
    assert "is a directory" in refusal(capfd, "a.exr", "b.exr", "--diff", "p.png")


def test_half_files_and_larger_ranges(
    folder: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert folder.is_dir()
    image.write_image("half.exr", TEST, half=True)
    got = figures(capsys, "half.exr", "b.exr")
    assert got["rms"] == glossy.rms(TEST.astype(np.float16), REFERENCE)
    for name, pixels in (("big.exr", TEST), ("bigger.exr", REFERENCE)):
        image.write_image(name, pixels * np.float32(1e30))
    got = figures(capsys, "big.exr", "bigger.exr", "--peak", "1e30")
    expected = glossy.compare(TEST * np.float32(1e30), REFERENCE * np.float32(1e30), peak=1e30)
    assert got["psnr"] == expected.psnr
    assert got["psnr"] == pytest.approx(glossy.psnr(TEST, REFERENCE), abs=1e-4)
