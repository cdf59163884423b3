"""What a study keeps on disk and refuses to mix, and how it takes times."""

import importlib
import json
import pathlib
import shlex
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import tolerances
from test_study import errors, study

from glossy import CubeMap, _threads
from glossy.cli import build_parser
from glossy.scene import load_scene
from glossy.study import bench as measuring
from glossy.study import commandline, measure, plots
from glossy.study.bench import Bench, Cell
from glossy.study.run import Study

ELSEWHERE = {
    "command", "run", "scene", "output", "resume", "json", "workers", "scheduler", "quiet",
    "verbose", "version", "max_memory",
}  # fmt: skip
"""Arguments that do not change what is measured, and SCENE, which has no name."""


def small(folder: pathlib.Path, resume: bool = False) -> Study:
    """One case, two methods, one budget: four cells."""
    whole = study(folder / "unused")
    return study(folder / "kept", resume, cases=whole.plan.cases[:1], budgets=(7,))


@pytest.fixture
def finished(tmp_path: pathlib.Path) -> Study:
    result = small(tmp_path)
    result.run()
    return result


# --- times ----------------------------------------------------------------------------------------


class Clock:
    """A clock that only the timed functions move."""

    def __init__(self) -> None:
        self.cpu = self.wall = 0.0
        self.calls: list[str] = []

    def spend(self, name: str, cpu: float, wall: float) -> Callable[[], str]:
        """A function that takes this long."""

        def call() -> str:
            assert _threads.threads() == 1
            self.calls.append(name)
            self.cpu += cpu
            self.wall += wall
            return name

        return call


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    result = Clock()
    monkeypatch.setattr(time, "process_time", lambda: result.cpu)
    monkeypatch.setattr(time, "perf_counter", lambda: result.wall)
    return result


def test_short_pictures_are_repeated_until_a_block_is_long_enough(clock: Clock) -> None:
    """3 ms a call: seven calls make 21 ms, the first count beyond 20."""
    run, baseline = clock.spend("run", 0.003, 0.006), clock.spend("base", 0.001, 0.001)
    result, timing = measure.timed(run, baseline, repeats=2)
    assert result == "run"
    assert clock.calls == 2 * (7 * ["run"] + 7 * ["base"])
    assert timing.calls == [7, 7]
    assert timing.cpu_seconds == pytest.approx(0.003, rel=tolerances.ROUNDOFF)
    assert timing.runs == pytest.approx([0.006, 0.006], rel=tolerances.ROUNDOFF)
    assert timing.seconds == pytest.approx(0.006, rel=tolerances.ROUNDOFF)
    assert timing.cpu_ratio == pytest.approx(3.0, rel=tolerances.ROUNDOFF)


def test_a_long_picture_is_called_once_in_a_block(clock: Clock) -> None:
    _, timing = measure.timed(clock.spend("run", 1.0, 1.0), clock.spend("base", 0.5, 0.5), 3)
    assert timing.calls == [1, 1, 1]
    assert timing.cpu_ratio == 2.0


def test_the_threads_come_back_after_an_error() -> None:
    before = _threads.threads()

    def fail() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure.timed(fail, fail, 1)
    assert _threads.threads() == before


def test_the_plot_measures_time_in_units_of_the_baseline(finished: Study) -> None:
    """A machine that slows down alike for a cell and its baseline moves no marker."""
    unit = plots.baseline_microseconds(finished.cells)
    slow = [
        Cell(**{**vars(c), "cpu_seconds": c.cpu_seconds * k})
        for c, k in zip(finished.cells, (1.0, 3.0, 7.0, 2.0), strict=True)
    ]
    least = min(c.cpu_seconds / c.cpu_ratio / c.pixels for c in finished.cells)
    assert unit == pytest.approx(1e6 * least, rel=tolerances.ROUNDOFF)
    assert plots.baseline_microseconds(slow) >= unit


# --- resume ---------------------------------------------------------------------------------------


def test_a_finished_study_computes_nothing_again(
    tmp_path: pathlib.Path, finished: Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError("computed again")

    for name in ("measure", "image"):
        monkeypatch.setattr(Bench, name, forbidden)
    monkeypatch.setattr(importlib.import_module("glossy.reference"), "reference", forbidden)
    again = small(tmp_path, resume=True)
    again.run()
    assert again.cells == finished.cells
    for name, truth in finished.truths.items():
        assert np.array_equal(again.truths[name].radiance, truth.radiance)


def test_an_interruption_inside_a_measurement_keeps_the_finished_ones(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = study(tmp_path / "whole", cases=study(tmp_path / "x").plan.cases[:1], budgets=(7,))
    whole.run()
    real, count = measure.timed, 0

    def cut(*args: Any) -> Any:
        nonlocal count
        count += 1
        if count == 3:
            raise KeyboardInterrupt
        return real(*args)

    monkeypatch.setattr(measuring, "timed", cut)
    with pytest.raises(KeyboardInterrupt):
        small(tmp_path).run()
    kept = sorted(p.name for p in (tmp_path / "kept" / "cells").iterdir())
    assert len(kept) == 2
    assert not [name for name in kept if name.startswith(".")]
    resumed = small(tmp_path, resume=True)
    resumed.run()
    assert errors(resumed.cells) == errors(whole.cells)


def test_a_truth_alone_is_not_taken_for_another_study(tmp_path: pathlib.Path) -> None:
    """Cut off after the truth, before the first cell: the folder is not free."""
    first = small(tmp_path)
    first.steps()[0]()
    with pytest.raises(ValueError, match="holds a study already"):
        small(tmp_path)
    resumed = small(tmp_path, resume=True)
    resumed.steps()[0]()
    assert list(resumed.truths) == ["iso m=0.2"]


def test_damaged_folders_are_refused_by_the_file(tmp_path: pathlib.Path, finished: Study) -> None:
    folder = finished.store.folder
    cell, truth = (sorted((folder / name).iterdir())[0] for name in ("cells", "truth"))
    manifest = folder / "study.lock.json"

    def refused(path: pathlib.Path, content: bytes | None, words: str) -> None:
        before = path.read_bytes()
        if content is None:
            path.unlink()
        else:
            path.write_bytes(content)
        with pytest.raises(ValueError, match=words) as error:
            small(tmp_path, resume=True).run()
        assert str(error.value).startswith(str(path))
        path.write_bytes(before)

    refused(cell, b"{", "not a finished measurement")
    refused(cell, b"7", "not a finished measurement")
    refused(cell, json.dumps({"rms": 1}).encode(), "of another version")
    refused(truth, b"PK\x03\x04", "not a finished truth")
    refused(manifest, b"[]", "not the record of a study")
    refused(manifest, None, "not the record of a study")
    again = small(tmp_path, resume=True)
    again.run()
    assert again.cells == finished.cells


def test_a_black_environment_is_refused(tmp_path: pathlib.Path) -> None:
    dark = small(tmp_path)
    dark.bench.cube = CubeMap(np.zeros((6, 4, 4, 3), np.float32))
    with pytest.raises(ValueError, match="environment: must light the surface"):
        dark.run()
    assert not list((tmp_path / "kept" / "truth").iterdir())


# --- the record -----------------------------------------------------------------------------------


def test_the_recorded_command_starts_the_same_study() -> None:
    words = shlex.split(
        "study 'a b.toml' --env 'my room.hdr' --size 32 --methods regular/paper,importance "
        "--samples 7,14 --reference-tolerance 0.01 --repeats 2 --filter box -o 'the out'"
    )
    args = build_parser().parse_args([*words, "--resume", "--json"])
    command = shlex.split(commandline.command_line(args))
    again = build_parser().parse_args(command[1:])
    assert command[0] == "glossy"
    assert vars(again) == {**vars(args), "resume": False, "json": False}
    assert vars(args).keys() - {*commandline.SAID} <= ELSEWHERE


def test_the_pyramids_storage_comes_from_the_scene_file(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text('[method]\nstorage = "rgba16f"\nfilter = "box"\n')
    args = build_parser().parse_args(["study", str(file), "-o", "out"])
    plan = commandline.plan_from(args, load_scene(file))
    assert plan.preparation == {"filter": "box", "storage": "rgba16f"}
    kept = study(tmp_path / "kept", filter="box", storage="rgba16f")
    pyramid = kept.bench.prepared(kept.plan.cases[0], kept.plan.methods[0])
    assert (pyramid.filter, pyramid.storage) == ("box", "rgba16f")
    assert kept.settings["storage"] == "rgba16f"


def test_the_report_says_how_to_repeat_it_and_how_well_the_truth_is_known(
    tmp_path: pathlib.Path,
) -> None:
    done = small(tmp_path)
    done.command = "glossy study -o out"
    done.run()
    commandline.finish(done, commandline.evaluate(done))
    text = (done.store.folder / "report.md").read_text()
    session = done.store.sessions[-1]
    assert session["command"] == "glossy study -o out"
    for words in ("glossy study -o out", session["cpu"], f"NumPy {np.__version__}", "CPU ns/tap"):
        assert words in text
    truth = done.truths["iso m=0.2"]
    level = float(np.sqrt(np.mean(truth.radiance**2)))
    row = next(line for line in text.splitlines() if line.startswith("| iso m=0.2 |"))
    assert f"| {level:.5g} | {truth.rms_error:.2g} |" in row
    assert "| bound |" in row
