"""The hard cases hold, faults are seen and reported; damaged files end in one short line."""

import dataclasses
import io
import itertools
import json
import math
import pathlib
import zipfile
from typing import Any

import numpy as np
import pytest

import glossy
from glossy import cli
from glossy.frames import normalise
from glossy.gbuffer import read_gbuffer
from glossy.pyramid import FILTERS
from glossy.scene import load_scene
from glossy.stability import cases, checks, report, twin

GROUPS = sorted({case.group for case in cases.SHADE})


def broken(results: Any) -> list[str]:
    return [f"{r.group}: {r.name}: {r.broken}" for r in results if not r.holds]


@pytest.mark.parametrize("group", GROUPS)
def test_real_time_methods_hold(group: str) -> None:
    mine = [case for case in cases.SHADE if case.group == group]
    assert not broken(checks.check_shade(case) for case in mine)


def test_reflectivities_hold() -> None:
    results = list(checks.check_reflectivity())
    assert not broken(results)
    long = next(r for r in results if "m = 1 0.001" in r.name)
    assert long.measured["r0 = 1"] > 1e-4  # views do meet the table's worst places


def test_bsdf_holds() -> None:
    results = list(checks.check_eval())
    assert not broken(results)
    assert len(results) == 2 * len(cases.pairs())


def test_lookups_hold() -> None:
    assert not broken(checks.check_lookup((1, 2, 3, 16)))
    assert not broken([checks.check_large(256)])


def test_truth_holds_at_the_hardest_lobes(monkeypatch: pytest.MonkeyPatch) -> None:
    hardest = [t for t in cases.TRUTH if t[1] <= 0.05 and t[0] != (1.0, 1e-3)]
    monkeypatch.setattr(cases, "TRUTH", tuple(hardest))
    results = list(checks.check_truth())
    assert not broken(results)
    thin = [r for r in results if "0.0001" in r.name]
    assert max(r.measured["bound"] for r in thin) > 1.0  # out of work, and it says so


def test_what_means_nothing_is_refused() -> None:
    assert not broken(checks.refusals())


def test_the_truths_give_the_albedo_in_a_white_map(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases, "FURNACE_WIDTHS", (0.05, 0.5))
    rows = checks.furnace()
    assert not broken(checks.check_furnace(rows))
    assert {(row["m"], row["angle"]) for row in rows} == {
        (m, a) for m in (0.05, 0.5) for a in cases.FURNACE_ANGLES
    }
    wide = next(row for row in rows if row["m"] == 0.5 and row["angle"] == 80.0)
    assert wide["regular/paper"] == pytest.approx(0.880, abs=3e-3)  # over azimuths
    assert {f"thesis/{e}" for e in ("4.23", "4.24", "4.25")} <= set(wide)


@pytest.mark.parametrize("figure", ["plain", "auto", "double"])
def test_a_limit_that_is_passed_is_seen(figure: str) -> None:
    case = next(c for c in cases.SHADE if c.group == "samples")
    tight = dataclasses.replace(case, single=0.0) if figure != "double" else case
    tight = dataclasses.replace(tight, double=0.0) if figure == "double" else tight
    result = checks.check_shade(tight)
    assert any(text.startswith(f"{figure} =") for text in result.broken)


def test_a_twin_that_disagrees_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    right = twin.shade
    monkeypatch.setattr(twin, "shade", lambda *a, **k: right(*a, **k) * (1.0 + 1e-9))
    assert not checks.check_shade(cases.SHADE[0]).holds


@pytest.mark.parametrize("filter", FILTERS)
@pytest.mark.parametrize("size", [1, 2, 8, 32])
def test_the_end_of_float32_is_not_passed_while_filtering(filter: str, size: int) -> None:
    """Texels are added before they are scaled: up to 1024 of them, and three beyond a corner."""
    huge = float(np.finfo(np.float32).max)
    constant = glossy.build_pyramid(glossy.CubeMap(np.full((6, size, size, 3), huge)), filter)
    for level in constant.levels:
        assert np.allclose(level / np.float32(huge), 1.0, atol=1e-6)
    corners = normalise(np.array(list(itertools.product((-1.0, 1.0), repeat=3))))
    seen = constant.sample(corners, np.arange(8) * 0.5)
    assert np.all(np.isfinite(seen))
    faces = np.random.default_rng(1).random((6, size, size, 3)) * huge
    faces[0, 0, 0] = 1e-30
    mixed, small = (glossy.build_pyramid(glossy.CubeMap(f), filter) for f in (faces, faces / 1e30))
    assert np.array_equal(mixed.levels[0], faces.astype(np.float32))
    for a, b in zip(mixed.levels[1:], small.levels[1:], strict=True):
        assert np.allclose(a / np.float32(1e30), b, rtol=2e-6)
    mixed.update(glossy.CubeMap(faces / 1e30))
    assert all(np.array_equal(a, b) for a, b in zip(mixed.levels, small.levels, strict=True))


def test_nan_passes_no_limit() -> None:
    assert not checks.judge("g", "n", {"x": math.nan}, {"x": 1.0}).holds
    assert checks.judge("g", "n", {"x": 1.0}, {"x": 1.0}).holds
    assert not checks.judge("g", "n", {}, {}, {"finite": False}).holds


def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases, "SHADE", cases.SHADE[::60])
    monkeypatch.setattr(cases, "TRUTH", cases.TRUTH[-3:])
    monkeypatch.setattr(cases, "LEVELS", (0.5,))
    monkeypatch.setattr(cases, "EVAL_WIDTHS", ((0.1, 0.1),))
    monkeypatch.setattr(cases, "FURNACE_WIDTHS", (0.15,))
    monkeypatch.setattr(checks, "LARGE", 64)


def test_command_reports_and_exits_0(
    monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small(monkeypatch)
    page, picture = tmp_path / "r.md", tmp_path / "r.png"
    arguments = ["stability", "--json", "-o", str(page), "--plot", str(picture)]
    assert cli.main(arguments) == 0
    value = json.loads(capsys.readouterr().out)
    assert (value["schema"], value["command"], value["holds"]) == (1, "stability", True)
    fields = {f.name for f in dataclasses.fields(checks.Result)} | {"holds"}
    assert all(set(row) == fields for row in value["results"])
    assert len(value["furnace"]) == len(cases.FURNACE_ANGLES)
    text = page.read_text()
    assert f"{len(value['results'])} hard cases, 0 of them" in text
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r.md", "r.png"]


def test_command_exits_1_when_a_guarantee_is_broken(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small(monkeypatch)
    monkeypatch.setattr(checks, "EVAL_DOUBLE", 0.0)
    assert cli.main(["stability"]) == 1
    assert "## Failed" in capsys.readouterr().out


def test_command_refuses_a_strange_output(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["stability", "-o", "report.pdf"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_worst_figures_are_the_largest() -> None:
    results = [checks.judge("g", str(k), {"x": float(k)}, {}) for k in (1, 3, 2)]
    assert report.worst(results) == {"x": 3.0}


# --- damaged files --------------------------------------------------------------------------------


def one_line(error: pytest.ExceptionInfo[ValueError], path: pathlib.Path) -> bool:
    text = str(error.value)
    return text.startswith(str(path)) and "\n" not in text and len(text) < 500 + len(str(path))


@pytest.mark.parametrize(
    "text", ["a = " + "[" * 100_000, '"' + "k" * 100_000 + '" = 1', "width = " + "9" * 5000]
)
def test_scenes_without_end_are_one_short_line(tmp_path: pathlib.Path, text: str) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"scene\.toml: ") as error:
        load_scene(path)
    assert one_line(error, path)


def test_a_gbuffer_that_claims_more_than_there_is(tmp_path: pathlib.Path) -> None:
    header: dict[str, Any] = {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6, 3)}
    claimed = io.BytesIO()
    np.lib.format.write_array_header_1_0(claimed, header)
    path = tmp_path / "g.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("normal.npy", "view.npy"):
            archive.writestr(name, claimed.getvalue())
    with pytest.raises(ValueError, match=r"g\.npz: not an npz") as error:
        read_gbuffer(path)
    assert one_line(error, path)


def test_a_library_that_complains_at_length_is_cut_short(tmp_path: pathlib.Path) -> None:
    path = pathlib.Path(__file__).parent / "data" / "fuzz" / "image.tiff"
    with pytest.raises(ValueError, match=r"image\.tiff: cannot be read") as error:
        glossy.read_image(path)
    assert one_line(error, path)
