"""The fit's report, its pictures, and ``glossy fit``."""

import dataclasses
import json
import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import glossy
from glossy import cli
from glossy.image import read_image
from glossy.materials import parse_material
from glossy.measured.fit import Fit, fit_table
from glossy.measured.fit_report import angle_lines, material_line, material_text
from glossy.measured.solid_angle import solid_angles
from glossy.measured.synthetic import synthetic_table
from glossy.measured.table import MeasuredTable

FROSTED = glossy.Material(
    0.3, [glossy.Lobe(0.25, 0.15, ks=0.5, r0=0.3)], [glossy.Lobe(0.3, ks=0.6, r0=0.0)]
)
QUICK = ["--grid", "4", "--levels", "2", "--rounds", "1"]


@pytest.fixture(scope="module")
def table() -> MeasuredTable:
    return synthetic_table(FROSTED, theta=(0.0, 30.0, 60.0), phi=(0.0, 90.0), rows=24, columns=36)


@pytest.fixture(scope="module")
def fit(table: MeasuredTable) -> Fit:
    return fit_table(table, grid=4, levels=2)


def test_albedos_of_a_clean_table_are_those_of_its_material(table: MeasuredTable, fit: Fit) -> None:
    lines = angle_lines(table, fit)
    assert [(x.side, round(x.theta), x.directions) for x in lines] == [
        (side, theta, n)
        for side in ("reflection", "transmission")
        for theta, n in ((0, 1), (30, 2), (60, 2))
    ]
    wi = [glossy.frames.spherical(np.radians(30.0), phi) for phi in (0.0, 0.5 * np.pi)]
    up, down = FROSTED.albedo(wi)
    for line, exact in ((lines[1], up), (lines[4], down)):
        assert line.error < 1e-6
        assert line.model == pytest.approx(float(np.mean(exact)), rel=1e-4)
        # midpoint sums over cells of 3.75 by 10 degrees
        assert line.measured == pytest.approx(line.model, rel=5e-3)
        assert line.fitted == pytest.approx(line.measured, rel=1e-4)


def test_rows_that_were_not_measured_do_not_count_as_fitted() -> None:
    dark = synthetic_table(FROSTED, theta=(30.0,), phi=(0.0,), rows=24, columns=36, shadow=25.0)
    line = angle_lines(dark, fit_table(dark, grid=4, levels=2))[0]
    assert line.fitted == pytest.approx(line.measured, rel=1e-3)
    assert line.model > 1.05 * line.measured


def test_half_a_hemisphere_of_an_isotropic_surface_stands_for_the_whole() -> None:
    whole = synthetic_table(glossy.Material(0.5), theta=(40.0,), phi=(30.0,), rows=12, columns=24)
    turn = np.radians(30.0)
    across = whole.wo @ np.array([-np.sin(turn), np.cos(turn), 0.0])
    half = whole.select(across > -1e-9)
    one = MeasuredTable(half.wi, half.wo, half.f, isotropic=True)
    weight = solid_angles(one)
    assert weight.sum() == pytest.approx(2.0 * np.pi)
    inside = across[across > -1e-9] > 1e-6
    assert weight[inside] == pytest.approx(2.0 * half.weight[inside], rel=0.06, abs=2e-3)  # type: ignore[index]
    assert weight[~inside] == pytest.approx(half.weight[~inside], rel=0.06, abs=2e-3)  # type: ignore[index]


@pytest.mark.parametrize("suffix", [".toml", ".json"])
@pytest.mark.parametrize(
    "material",
    [
        FROSTED,
        glossy.Material((0.1, 0.2, 0.3), [glossy.Lobe(0.1, ks=(0.5, 0.25, 0.125))]),
        glossy.Material(0.25, diffuse_transmission=0.5),
    ],
)
def test_a_written_material_reads_back(
    material: glossy.Material, suffix: str, tmp_path: pathlib.Path
) -> None:
    path = tmp_path / f"m{suffix}"
    path.write_text(material_text(material, suffix))
    assert parse_material(path) == material


def _pixels(path: pathlib.Path) -> npt.NDArray[np.float32]:
    return np.asarray(read_image(path, encoding="srgb").pixels)


def test_the_command_writes_a_material_that_renders(
    table: MeasuredTable, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out, report = tmp_path / "t.txt", tmp_path / "m.toml", tmp_path / "report"
    table.write(source)
    arguments = ["fit", str(source), "-o", str(out), "--report", str(report), "--compare", "ward"]
    assert cli.main([*arguments, *QUICK, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert list(record["provenance"]["inputs"]) == [str(source)]
    said = f"largest directional albedo {record['fit']['energy']['largest']:.4g} at "
    assert said in out.read_text().splitlines()[0]
    assert record["schema"] == 1
    assert record["fit"]["error"] < 1e-6
    assert record["others"][0]["model"] == "ward"
    found = parse_material(out)
    assert found.reflection[0].my == pytest.approx(0.15, abs=1e-4)
    assert found.transmission[0].ks == pytest.approx(0.6, abs=1e-3)
    assert json.loads((report / "fit.json").read_text())["fit"]["error"] == record["fit"]["error"]
    text = (report / "report.md").read_text()
    assert said in text
    assert "| reflection | 30.0° | 2 |" in text
    assert "| ward |" in text
    for name in ("plane.png", "discs.png", "angles.png"):
        assert name in text
        assert _pixels(report / name).std() > 1e-3  # a picture with something in it
    small = ["--width", "16", "--height", "16", "--size", "16", "-o", str(tmp_path / "r.exr")]
    assert cli.main(["render", "--material", str(out), "--env", "white", *small]) == 0


def test_options_reach_the_fit(
    table: MeasuredTable, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = tmp_path / "t.txt", tmp_path / "m.json"
    table.write(source)
    held = ["--fix", "alpha=0", "--fix", "kd=.3", "--bound", "reflection[0].mx=.3:.5"]
    few = ["--rows", "500", "--transmission-lobes", "0", "--polish", "none"]
    assert cli.main(["fit", str(source), "-o", str(out), *QUICK, *held, *few]) == 0
    assert "500 rows" not in capsys.readouterr().out  # some of them are transmission
    found = parse_material(out)
    assert (found.kd, found.reflection[0].alpha, found.transmission) == (0.3, 0.0, ())
    assert 0.3 <= found.reflection[0].mx <= 0.5


def test_without_a_file_the_fit_is_printed(
    table: MeasuredTable, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "t.txt"
    table.write(source)
    rough = ["--rows", "100", "--polish", "none", *QUICK]
    assert cli.main(["fit", str(source), "--transmission-lobes", "0", *rough]) == 0
    text = capsys.readouterr().out
    assert "error (l1): " in text
    line = next(x for x in text.splitlines() if x.startswith("material: "))
    assert 0.05 < parse_material(line.removeprefix("material: ")).reflection[0].mx < 2.0
    assert cli.main(["fit", str(source), *rough]) == 0  # two sides do not fit on a line
    assert "[[transmission]]" in capsys.readouterr().out
    assert [p.name for p in tmp_path.iterdir()] == ["t.txt"]


@pytest.mark.parametrize("kd", [0.2, (0.1, 0.2, 0.3)])
def test_a_line_is_the_material_it_came_from(kd: Any) -> None:
    material = glossy.Material(
        kd, [glossy.Lobe(0.2, 0.1, ks=(0.1, 0.2, 1.0 / 3.0), r0=0.04, alpha=0.5)]
    )
    line = material_line(material)
    assert line is not None
    found = parse_material(line)
    assert found.reflection[0].ks == pytest.approx(material.reflection[0].ks, rel=1e-8)
    assert found.kd == pytest.approx(kd)
    assert dataclasses.replace(found, reflection=material.reflection, kd=kd) == material


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "m.txt"], "--output: must end in .toml, .json"),
        (["-o", "m.toml", "--fix", "mx"], "--fix: must be NAME=VALUE"),
        (["-o", "m.toml", "--fix", "mx=a"], "--fix: must have numbers"),
        (["-o", "m.toml", "--bound", "mx=.1"], "--bound: must be NAME=LOW:HIGH"),
        (["-o", "m.toml", "--bound", "m=.1:.2"], "bounds: name: must be one of"),
        (["-o", "m.toml", "--compare", "phong"], "model: must be one of"),
        (["-o", "m.toml", "--rows", "0"], "--rows: must be at least 1"),
    ],
)
def test_bad_options_are_one_line_and_write_nothing(
    options: list[str],
    message: str,
    tmp_path: pathlib.Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    synthetic_table(FROSTED, theta=(30.0,), rows=6).write("t.txt")
    assert cli.main(["fit", "t.txt", *options, *QUICK]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
    assert [p.name for p in tmp_path.iterdir()] == ["t.txt"]


def test_a_real_paint_is_met_to_a_few_percent_of_its_level(real_data: pathlib.Path) -> None:
    """Garnet red, medium gloss: a lobe and kd explain all but a few per cent of the light."""
    from glossy.measured.read import read_measured

    paint = read_measured(real_data / "brdf" / "cornell_garnet_red.brdf")
    found = fit_table(paint, grid=5, levels=3)
    assert found.material is not None
    assert 0.1 < found.material.reflection[0].mx < 0.3
    kd = np.asarray(found.material.kd)
    assert kd[0] > 5.0 * kd[1:].max()
    for line in angle_lines(paint, found)[:6]:
        assert line.fitted == pytest.approx(line.measured, rel=0.06)


def test_the_command_says_what_sends_out_too_much_and_bounds_it(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bright = glossy.Material(0.05, [glossy.Lobe(0.3, ks=0.9, r0=0.6, alpha=0.9)])
    source = tmp_path / "t.txt"
    synthetic_table(bright, theta=(10.0, 60.0), phi=(0.0,), isotropic=True, rows=16).write(source)
    assert cli.main(["fit", str(source), *QUICK]) == 0
    said = capsys.readouterr().out
    assert ": sends out more than it receives from 6" in said
    assert "--bound-energy keeps it at or below 1" in said
    held = tmp_path / "m.toml"
    assert cli.main(["fit", str(source), *QUICK, "--bound-to", "85"]) == 2
    assert "--bound-to: is of --bound-energy, which is not given" in capsys.readouterr().err
    bound = ["--bound-energy", "--bound-to", "85", "-o", str(held)]
    assert cli.main(["fit", str(source), *QUICK, *bound]) == 0
    said = capsys.readouterr().out
    assert "held at or below 1 to 85 degrees" in said
    assert "--bound-energy" not in said
    assert "held at or below 1 to 85 degrees" in held.read_text()
    assert glossy.energy(parse_material(held), [85.0]).largest <= 1.0
