"""What ``glossy compare`` calls identical, which channels it looks at, and its limits."""

import io
import json
import pathlib
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import glossy
from glossy import cli, image, image_write

Array = np.ndarray[Any, Any]
Captured = pytest.CaptureFixture[str]
pytestmark = pytest.mark.filterwarnings("always")  # as on the command line
RNG = np.random.default_rng(5)
B = RNG.random((20, 30, 3)).astype(np.float32)
A = (B + 0.01 * RNG.standard_normal(B.shape)).astype(np.float32)
MISSED = np.abs(A.astype(float) - B).max(axis=2)


@pytest.fixture(autouse=True)
def folder(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> pathlib.Path:
    """A working folder with a test image and its reference."""
    monkeypatch.chdir(tmp_path)
    image.write_image("a.exr", A)
    image.write_image("b.exr", B)
    return tmp_path


def compare(*arguments: str) -> int:
    return cli.main(["compare", *arguments])


def figures(capsys: Captured, *arguments: str, code: int = 0) -> dict[str, Any]:
    assert compare(*arguments, "--json") == code
    out: dict[str, Any] = json.loads(capsys.readouterr().out)
    return out


def text(capsys: Captured, *arguments: str, code: int = 0) -> str:
    assert compare(*arguments) == code
    return capsys.readouterr().out


def refusal(capsys: Captured, *arguments: str) -> str:
    assert compare(*arguments) == 2
    out = capsys.readouterr()
    assert out.out == ""
    assert out.err.count("\n") == 1
    return out.err


# channels -----------------------------------------------------------------------------------------


def layers(names: str, change: float = 0.0, first: Array = B) -> dict[str, Array]:
    """Channels of these names; all but Y change."""
    words = names.split()
    return {n: first[..., i % 3] + (0 if n == "Y" else change) for i, n in enumerate(words)}


@pytest.mark.parametrize("names", ["X Y Z", "U V Y", "Y RY BY", "X Y Z A", "R Y", "N.X N.Y N.Z Y"])
def test_y_is_grey_only_alone_or_with_alpha(capsys: Captured, names: str) -> None:
    image.write_exr("n.exr", layers(names))
    image.write_exr("m.exr", layers(names, 1.0))
    out = figures(capsys, "m.exr", "n.exr", "--max-rms", "0", code=1)
    assert sorted(out["channels"]) == sorted(names.split())
    changed = len(names.split()) - 1
    assert out["rms"] == pytest.approx(np.sqrt(changed / (changed + 1)))
    assert not out["identical"]
    assert figures(capsys, "n.exr", "n.exr")["identical"]


def test_grey_with_alpha_is_grey(capsys: Captured) -> None:
    image.write_exr("n.exr", layers("Y A"))
    image.write_exr("m.exr", layers("Y A", 1.0))
    out = figures(capsys, "m.exr", "n.exr")
    assert (out["channels"], out["identical"]) == (["Y"], False)
    assert out["channels_left_out"] == {"a": ["A"], "reference": ["A"]}


def test_a_mask_of_several_channels_is_not_grey(capsys: Captured) -> None:
    kept = np.zeros((20, 30), dtype=np.float32)
    kept[3, 4:9] = 1.0
    image.write_exr("mask.exr", {"X": kept, "Y": 0 * kept, "Z": 0 * kept})
    assert figures(capsys, "a.exr", "b.exr", "--mask", "mask.exr")["pixels"] == 5


def test_what_is_left_out_is_named_and_not_called_identical(capsys: Captured) -> None:
    rgb = layers("R G B")
    image.write_exr("one.exr", {**rgb, "A": A[..., 0], "depth.Z": A[..., 1]})
    image.write_exr("two.exr", {**rgb, "A": A[..., 1], "error.R": A[..., 1]})
    said = text(capsys, "one.exr", "two.exr", "--max-rms", "0")
    assert "identical" not in said
    line = "not compared  A, depth.Z (of one.exr only), error.R (of two.exr only)"
    assert line in said
    out = figures(capsys, "one.exr", "two.exr")
    assert (out["identical"], out["rms"], out["psnr"]) == (False, 0.0, None)
    assert out["channels_left_out"] == {"a": ["A", "depth.Z"], "reference": ["A", "error.R"]}
    assert "identical" not in text(capsys, "one.exr", "one.exr")
    assert "identical     yes" in text(capsys, "one.exr", "one.exr", "--channels", "all")
    assert "identical" not in text(capsys, "b.exr", "b.exr", "--channels", "R,G")


def test_every_channel_on_request(capsys: Captured) -> None:
    names = "R G B A diffuse.R diffuse.G diffuse.B Z"
    image.write_exr("one.exr", layers(names))
    image.write_exr("two.exr", layers(names, 0.5))
    out = figures(capsys, "two.exr", "one.exr", "--channels", "all", "--max-abs", "0.1", code=1)
    assert sorted(out["channels"]) == sorted(names.split())
    assert len(out["channel_rms"]) == 8
    assert out["channels_left_out"] == {"a": [], "reference": []}
    image.write_exr("more.exr", {**layers(names), "crypto": A[..., 0]})
    del_z = {n: v for n, v in layers(names).items() if n != "Z"}
    image.write_exr("less.exr", del_z)
    said = refusal(capsys, "more.exr", "less.exr", "--channels", "all")
    assert "differ in channels, Z, crypto only in more.exr" in said
    assert "only in less.exr" not in said
    assert compare("two.exr", "one.exr", "--channels", "all", "--diff", "d.png") == 0


# headers ------------------------------------------------------------------------------------------

WIDE = (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329)
REC709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)


def window(*corners: int) -> tuple[Array, Array]:
    c = np.array(corners, dtype=np.int32)
    return c[:2], c[2:]


def write(name: str, header: dict[str, Any]) -> None:
    import OpenEXR

    OpenEXR.File(header, {"RGB": B.copy()}).write(name)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ({"displayWindow": window(0, 0, 59, 39)},
         "display window, (0, 0) to (59, 39) and (0, 0) to (29, 19)"),
        ({"chromaticities": WIDE}, "chromaticities, 0.708 0.292 0.17"),
        ({"pixelAspectRatio": 2.0}, "pixelAspectRatio, 2 and 1"),
        ({"whiteLuminance": 80.0}, "whiteLuminance, 80.0 and none"),
    ],
)  # fmt: skip
def test_headers_that_differ_are_not_identical(
    capsys: Captured, header: dict[str, Any], words: str
) -> None:
    write("c.exr", header)
    assert compare("c.exr", "b.exr", "--max-rms", "0") == 0
    said = capsys.readouterr()
    assert f"differ in     {words}" in said.out
    assert "identical" not in said.out
    assert f"glossy: warning: c.exr: differ in {words}" in said.err
    out = figures(capsys, "c.exr", "b.exr")
    assert (out["identical"], out["within_limits"], out["rms"]) == (False, True, 0.0)
    assert words in out["unlike"][0]
    assert words in out["warnings"][0]
    assert figures(capsys, "c.exr", "c.exr")["identical"]


def test_defaults_of_a_header_are_what_they_stand_for(capsys: Captured) -> None:
    write("c.exr", {"chromaticities": REC709})
    assert figures(capsys, "c.exr", "b.exr")["identical"]
    image.write_image("b.hdr", np.ones_like(B))
    image.write_image("one.exr", np.ones_like(B))
    assert figures(capsys, "b.hdr", "one.exr")["identical"]
    import OpenEXR

    moved = {"dataWindow": window(1, 0, 30, 19), "displayWindow": window(0, 0, 30, 19)}
    OpenEXR.File(moved, {"RGB": np.ones_like(B)}).write("moved.exr")
    out = figures(capsys, "moved.exr", "b.hdr")
    assert not out["identical"]
    assert ["data window" in text for text in out["unlike"]] == [True, False]


def test_headers_of_radiance_files_count(capsys: Captured, folder: pathlib.Path) -> None:
    image.write_image("b.hdr", B)
    plain = (folder / "b.hdr").read_bytes()
    for line in (b"PRIMARIES= .708 .292 .17 .797 .131 .046 .3127 .329", b"GAMMA= 2.2"):
        (folder / "c.hdr").write_bytes(plain.replace(b"\nFORMAT", b"\n" + line + b"\nFORMAT", 1))
        out = figures(capsys, "c.hdr", "b.hdr")
        assert (out["identical"], out["rms"]) == (False, 0.0)
        assert line.split(b"=")[0].decode() in out["unlike"][0]
        assert figures(capsys, "c.hdr", "c.hdr")["identical"]


def test_quiet_prints_no_warning(capsys: Captured) -> None:
    assert compare("a.exr", "b.exr", "--warn-rms", "0", "--quiet") == 0
    assert capsys.readouterr().err == ""


# limits -------------------------------------------------------------------------------------------

LIMITS: dict[str, Callable[[], float]] = {
    "rms": lambda: glossy.rms(A, B),
    "relative-rms": lambda: glossy.relative_rms(A, B),
    "abs": lambda: float(MISSED.max()),
    "flip": lambda: float(glossy.compare(A, B, flip="hdr").flip or 0.0),
}


@pytest.mark.parametrize("figure", LIMITS)
def test_levels_that_fail_and_that_warn(capsys: Captured, figure: str) -> None:
    value = LIMITS[figure]()
    for factor, code in ((1.0, 0), (0.99, 1)):
        assert compare("a.exr", "b.exr", f"--max-{figure}", repr(value * factor)) == code
        err = capsys.readouterr().err
        assert err.count("\n") == code
        assert (f"is above --max-{figure}" in err) is bool(code)
        out = figures(capsys, "a.exr", "b.exr", f"--warn-{figure}", repr(value * factor))
        assert (len(out["warnings"]), out["failures"]) == (code, [])
        assert out["within_limits"]
    both = (f"--max-{figure}", repr(2 * value), f"--warn-{figure}", repr(value / 2))
    assert compare("a.exr", "b.exr", *both) == 0
    err = capsys.readouterr().err
    assert err.startswith("glossy: warning: a.exr: ")
    assert f"is above --warn-{figure}" in err


def test_psnr_warns_below(capsys: Captured) -> None:
    assert compare("a.exr", "b.exr", "--min-psnr", "30", "--warn-psnr", "200") == 0
    assert "is below --warn-psnr 200" in capsys.readouterr().err


@pytest.mark.parametrize("budget", ["{share}", "{percent}%", "{count}px"])
def test_a_budget_of_outliers(capsys: Captured, budget: str) -> None:
    count = int((MISSED > 0.02).sum())
    assert 20 < count < 500
    for admitted, code in ((count, 0), (count - 1, 1)):
        share = admitted / MISSED.size
        given = budget.format(share=share, percent=100 * share, count=admitted)
        arguments = ("--max-difference", "0.02", "--max-outliers", given)
        out = figures(capsys, "a.exr", "b.exr", *arguments, code=code)
        assert (out["outliers"], out["outlier_share"]) == (count, count / MISSED.size)
        assert out["limits"]["max_outliers"] == given
        if code:
            assert f"{count} pixels (" in out["failures"][0]
            assert f"above --max-outliers {given}" in out["failures"][0]
        warned = ("--warn-difference", "0.02", "--warn-outliers", given)
        assert len(figures(capsys, "a.exr", "b.exr", *warned)["warnings"]) == code
    assert f"outliers      {count} (" in text(capsys, "a.exr", "b.exr", *arguments, code=1)


def test_a_tolerance_alone_admits_no_outlier_and_warnings_take_it_over(capsys: Captured) -> None:
    top = float(MISSED.max())
    assert compare("a.exr", "b.exr", "--max-difference", repr(top)) == 0
    assert compare("a.exr", "b.exr", "--max-difference", repr(0.999 * top)) == 1
    assert "above --max-outliers 0" in capsys.readouterr().err
    levels = ("--max-difference", "0.02", "--max-outliers", "90%", "--warn-outliers", "1px")
    out = figures(capsys, "a.exr", "b.exr", *levels)
    assert f"{out['outliers']} pixels" in out["warnings"][0]
    out = figures(capsys, "a.exr", "b.exr", *levels, "--warn-difference", "0.03")
    assert f"{int((MISSED > 0.03).sum())} pixels" in out["warnings"][0]
    assert out["outliers"] == int((MISSED > 0.02).sum())
    assert figures(capsys, "a.exr", "b.exr", "--max-outliers", "0", code=1)["outliers"] == 600


def test_a_tolerance_relative_to_the_reference(capsys: Captured) -> None:
    arguments = ("--max-difference", "0.005", "--max-relative-difference", "0.02")
    out = figures(capsys, "a.exr", "b.exr", *arguments, "--max-outliers", "1")
    close = np.isclose(A.astype(float), B.astype(float), rtol=0.02, atol=0.005).all(axis=2)
    assert out["outliers"] == int((~close).sum())
    assert "0.02 |b|" in text(capsys, "a.exr", "b.exr", *arguments, code=1)


def test_percentiles_are_values_that_so_many_pixels_do_not_exceed(capsys: Captured) -> None:
    out = figures(capsys, "a.exr", "b.exr", "--percentiles", "0,50,99.5,100")
    values = np.sort(MISSED, axis=None)
    assert out["percentiles"] == {
        "0": values[0], "50": values[299], "99.5": values[596], "100": values[-1],
    }  # fmt: skip
    assert out["percentiles"]["100"] == out["max_abs"]
    assert f"99.5: {values[596]:.6g}" in text(capsys, "a.exr", "b.exr", "--percentiles", "99.5")
    limit = f"50={float(values[299])!r},90={float(values[100])!r}"
    out = figures(capsys, "a.exr", "b.exr", "--max-percentile", limit, code=1)
    assert out["percentiles"].keys() == {"50", "90"}
    assert len(out["failures"]) == 1
    assert out["failures"][0].startswith(f"percentile 90, {values[539]:.6g}, is above")
    assert len(figures(capsys, "a.exr", "b.exr", "--warn-percentile", limit)["warnings"]) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--max-outliers", "5"], "must be a share such as .001 or 0.1%"),
        (["--max-outliers", "101%"], "must be a share"),
        (["--warn-outliers", "-1px"], "--warn-outliers: must be a share"),
        (["--max-outliers", "nan"], "must be a share"),
        (["--max-percentile", "99"], "--max-percentile: must be P=X with commas"),
        (["--max-percentile", "101=1"], "--max-percentile: must be in [0, 100]"),
        (["--max-percentile", "99=-1"], "--max-percentile: must be in [0, inf)"),
        (["--percentiles", "50,,90"], "--percentiles: must be a number"),
        (["--max-difference", "-1"], "--max-difference: must be in"),
        (["--warn-relative-difference", "inf"], "--warn-relative-difference: must be finite"),
        (["--warn-psnr", "nan"], "--warn-psnr: must be finite"),
        (["--max-flip", "0.1", "--mask", "b.exr"], "--flip: is a figure of whole images"),
        (["--max-flip", "0.1", "--channels", "R,G"], "flip: takes one or three channels"),
    ],
)
def test_unusable_limits(capsys: Captured, arguments: list[str], words: str) -> None:
    assert words in refusal(capsys, "a.exr", "b.exr", *arguments)


# standard input -----------------------------------------------------------------------------------


def piped(monkeypatch: pytest.MonkeyPatch, data: bytes) -> None:
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))


@pytest.mark.parametrize("name", ["a.exr", "a.hdr", "a.png"])
def test_one_of_the_files_may_be_piped_in(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    if name != "a.exr":
        image.write_image(name, np.abs(A))
    data = pathlib.Path(name).read_bytes()
    plain = figures(capsys, name, "b.exr", "--encoding", "srgb")
    piped(monkeypatch, data)
    out = figures(capsys, "-", "b.exr", "--encoding", "srgb")
    assert (out.pop("a"), plain.pop("a")) == ("-", name)
    assert out == plain
    piped(monkeypatch, data)
    assert figures(capsys, "b.exr", "-", "--encoding", "srgb")["reference"] == "-"


def test_what_is_piped_in_is_refused_by_its_name(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    piped(monkeypatch, b"no image")
    assert refusal(capsys, "-", "b.exr").startswith("glossy compare: -: cannot be read")
    piped(monkeypatch, b"")
    assert "-: standard input is empty" in refusal(capsys, "-", "b.exr")
    monkeypatch.setattr(sys, "stdin", None)
    assert "-: standard input is closed" in refusal(capsys, "-", "b.exr")
    from glossy.commands import standard_input

    monkeypatch.setattr(standard_input, "MOST_BYTES", 5)
    piped(monkeypatch, b"123456")
    assert "-: standard input is longer than 5 bytes" in refusal(capsys, "b.exr", "-")


def test_pictures_of_differences_are_masked(capsys: Captured) -> None:
    mask = np.zeros((20, 30, 1), dtype=np.uint8)
    mask[3:9] = 1
    image_write.write_png("mask.png", mask)
    arguments = ("--mask", "mask.png", "--max-difference", "0.02", "--percentiles", "50")
    out = figures(capsys, "a.exr", "b.exr", *arguments, "--diff", "d.png", code=1)
    assert out["outliers"] == int((MISSED[3:9] > 0.02).sum())
    assert out["percentiles"]["50"] == np.sort(MISSED[3:9], axis=None)[89]
    assert "in the 180 pixels compared" in text(capsys, "b.exr", "b.exr", "--mask", "mask.png")
