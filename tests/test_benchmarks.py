"""Every benchmark runs with tiny settings, and what it writes can be read."""

import importlib
import json
import os
import pathlib
import subprocess
import sys
from typing import Any

import pages
import pytest

FOLDER = pathlib.Path(__file__).parent.parent / "benchmarks"
SCRIPTS = sorted(p.stem for p in FOLDER.glob("bench_*.py"))
HEADINGS = {
    "bench_baselines": "relative RMS error",
    "bench_compare": "compare over it",
    "bench_fit": "over NumPy",
    "bench_latlong": "error of power",
    "bench_lattice": "lattice over regular",
    "bench_methods": "picture over regular",
    "bench_prefiltered": "sum over texels",
    "bench_pyramid": "over a copy",
    "bench_reference": "mitsuba over glossy",
    "bench_shade": "x llvmpipe",
    "bench_startup": "elapsed s",
    "bench_truth": "tolerance",
    "bench_work": "time over without",
}


def run(script: str, *arguments: str, path: pathlib.Path | None = None) -> str:
    """Standard output of a benchmark in a process of its own; modules in ``path`` come first."""
    done = subprocess.run(
        [sys.executable, str(FOLDER / f"{script}.py"), *arguments],
        capture_output=True,
        text=True,
        env={
            **os.environ,
            "MPLBACKEND": "Agg",
            **({} if path is None else {"PYTHONPATH": str(path)}),
        },
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_script_is_known() -> None:
    assert sorted(HEADINGS) == SCRIPTS


@pytest.mark.parametrize("script", SCRIPTS)
def test_runs_and_writes_its_figures(script: str, tmp_path: pathlib.Path) -> None:
    file = tmp_path / "figures.json"
    printed = run(script, "--quick", "--json", str(file))
    assert HEADINGS[script] in printed
    record = json.loads(file.read_text())
    assert record["schema"] == 1
    assert f"bench_{record['benchmark']}" == script
    assert record["machine"]["versions"]["glossy-envmap"] != "absent"
    assert record["results"]


@pytest.mark.parametrize(
    ("script", "peer"), [("bench_pyramid", "cv2"), ("bench_reference", "mitsuba")]
)
def test_a_peer_that_is_not_installed_is_reported_absent(
    script: str, peer: str, tmp_path: pathlib.Path
) -> None:
    (tmp_path / f"{peer}.py").write_text("raise ImportError('not here')\n")
    assert "absent" in run(script, "--quick", path=tmp_path)


def test_work_draws_its_plot(tmp_path: pathlib.Path) -> None:
    place = tmp_path / "work.png"
    run("bench_work", "--quick", "--plot", str(place))
    assert place.read_bytes()[1:4] == b"PNG"


def test_prefiltered_lobes_print_and_plot(tmp_path: pathlib.Path) -> None:
    place, file = tmp_path / "figure.png", tmp_path / "figures.json"
    options = ("--quick", "--part", "figure7", "--plot", str(place), "--json", str(file))
    assert "RMS error by number of lobes" in run("reproduce_prefiltered", *options)
    assert place.read_bytes()[1:4] == b"PNG"
    rows = json.loads(file.read_text())["results"]["figure7"]
    assert rows[1]["minimum"] < rows[0]["minimum"]


def test_partial_maps_print_and_plot(tmp_path: pathlib.Path) -> None:
    place = tmp_path / "filters.png"
    printed = run("reproduce_pem", "--quick", "--plot", str(place))
    assert "Relative RMS error" in printed
    assert "pem5:sqrtcos" in printed
    assert place.read_bytes()[1:4] == b"PNG"


def test_shadows_of_partial_maps_print_and_draw(tmp_path: pathlib.Path) -> None:
    place, file = tmp_path / "shadows.png", tmp_path / "figures.json"
    options = ("--quick", "--picture", str(place), "--json", str(file))
    assert "visibility by softness" in run("pem_shadows", *options)
    assert place.read_bytes()[1:4] == b"PNG"
    rows = json.loads(file.read_text())["results"]["shapes, built-in studio"]["regions"]
    assert [row[0] for row in rows] == [6, 24]
    assert all(float(row[2]) < float(row[1]) for row in rows)  # with shadow maps, without


@pytest.fixture(name="common")
def _common(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module("common")


def test_table_has_columns_of_one_width(common: Any) -> None:
    assert common.table(["a", "long name"], [[1, "x"], [1000, "y"]]).split("\n") == [
        "| a    | long name |",
        "|------|-----------|",
        "| 1    | x         |",
        "| 1000 | y         |",
    ]


def test_ratios_are_of_the_same_round_and_a_missing_peer_is_absent(common: Any) -> None:
    times = {"ours": [1.0, 4.0, 3.0], "theirs": [2.0, 2.0, 3.0]}
    assert common.ratio(times, "ours", "theirs") == (0.5, 1.0, 2.0)
    assert common.median_ratio(times, "ours", "theirs") == "1.00 (0.50 to 2.00)"
    assert common.median_ratio(times, "ours", "opencv") == "absent"


def test_a_power_law_gives_back_its_own_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """error = seconds^-0.8: a tenth of the error takes 10^1.25 of the time."""
    monkeypatch.syspath_prepend(str(FOLDER))
    reference: Any = importlib.import_module("bench_reference")
    rows = [{"error": s**-0.8, "seconds": s} for s in (1.0, 4.0, 16.0)]
    seconds, extrapolated = reference.time_to(rows, 0.1 * rows[-1]["error"])
    assert seconds == pytest.approx(16.0 * 10.0**1.25)
    assert extrapolated
    assert reference.time_to(rows, rows[1]["error"]) == (pytest.approx(4.0), False)


def test_the_page_of_all_methods_has_every_contender() -> None:
    with pages.benchmark("bench_methods") as script:
        for table in ("errors", "costs"):
            names = [row[0] for row in pages.rows_of("choosing.md", table)]
            assert names == list(script.CONTENDERS)
        names = [row[0] for row in pages.rows_of("choosing.md", "hidden")]
        assert names == [*script.CONTENDERS, script.SHADOWED, script.UNSHADOWED]
