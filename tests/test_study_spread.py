"""A study on Dask: the same numbers as in one process, kept as they arrive."""

import contextlib
import importlib.util
import os
import pathlib
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from processes import interruptible
from test_study import errors, study
from test_study_keeping import small

from glossy.cli import main
from glossy.study import commandline, plots, report, spread
from glossy.study.bench import Cell, comparable
from glossy.study.run import Study

needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None,
    reason="Dask is not here: pip install 'dask[distributed]'",
)
METHODS = ("regular/paper", "split-sum")


def planned(folder: pathlib.Path, resume: bool = False) -> Study:
    """Two cases, two methods, one budget: two truths and eight cells."""
    from glossy.study.settings import parse_method

    named = [parse_method(name) for name in METHODS]
    return study(folder, resume, methods=named, budgets=(7,))


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> Study:
    result = planned(tmp_path_factory.mktemp("serial"))
    result.run()
    return result


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """Two workers, while somebody else has the port that Dask takes by itself."""
    with socket.socket() as taken:
        with contextlib.suppress(OSError):  # then it is taken already
            taken.bind(("0.0.0.0", 8787))
            taken.listen()
        with spread.connect(workers=2) as found:
            yield found


@needs_dask
def test_the_same_bits_as_in_one_process(
    tmp_path: pathlib.Path, serial: Study, client: Any
) -> None:
    """Interrupted after a few arrivals, resumed on Dask, and then read by a serial run."""

    def cut(steps: Any) -> Iterator[Callable[[], None]]:
        assert len(steps) == 10
        for count, step in enumerate(steps):
            if count == 4:
                raise KeyboardInterrupt
            yield step

    with pytest.raises(KeyboardInterrupt):
        planned(tmp_path).run(cut, client)
    kept = {p: p.read_bytes() for p in [*tmp_path.glob("cells/*"), *tmp_path.glob("truth/*")]}
    assert len(kept) == 4
    resumed = planned(tmp_path, resume=True)
    resumed.run(client=client)
    assert errors(resumed.cells) == errors(serial.cells)
    assert all(path.read_bytes() == content for path, content in kept.items())
    assert {c.loaded for c in resumed.cells} == {True}
    assert {c.cpu for c in resumed.cells} == {serial.cells[0].cpu}
    assert resumed.store.sessions[-1]["workers"] == "2 Dask workers on 1 host"
    again = planned(tmp_path, resume=True)
    assert again.run() == resumed.cells


@needs_dask
def test_an_error_on_a_worker_is_the_users(tmp_path: pathlib.Path, client: Any) -> None:
    from glossy import CubeMap

    dark = small(tmp_path)
    dark.bench.cube = CubeMap(0.0 * dark.bench.cube.faces)
    with pytest.raises(ValueError, match="environment: must light the surface"):
        dark.run(client=client)


@needs_dask
def test_the_interrupt_key_keeps_what_is_finished(tmp_path: pathlib.Path) -> None:
    """As from a terminal: every process of the group gets the signal."""
    out = tmp_path / "out"
    words = "study --env studio --size 16 --width 16 --samples 7,14,20,30 --repeats 1 --workers 1"
    command = interruptible(*words.split(), "-o", str(out))
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    cells, deadline = out / "cells", time.monotonic() + 120.0
    while not (cells.is_dir() and any(cells.glob("[!.]*.json"))):
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.strip().splitlines()[-1] == "glossy study: interrupted"
    assert "Traceback" not in said
    assert 0 < len(list(cells.iterdir())) < 96


@needs_dask
def test_a_scheduler_that_does_not_answer_is_one_line(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import distributed

    def silent(*_: object, **__: object) -> None:
        raise OSError("Timed out trying to connect")

    monkeypatch.setattr(distributed, "Client", silent)
    words = ["study", "--size", "16", "--width", "8", "-o", str(tmp_path / "out")]
    assert main([*words, "--scheduler", "tcp://127.0.0.1:1"]) == 2
    assert "scheduler: must be the address of a Dask scheduler" in capsys.readouterr().err


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(ValueError, match=r"pip install 'glossy-envmap\[dask\]'"),
        spread.connect(workers=2),
    ):
        pass


# --- times and processors -------------------------------------------------------------------------


def changed(cells: list[Cell], **values: list[Any]) -> list[Cell]:
    """The cells with other values of some fields."""
    return [
        Cell(**{**vars(c), **{name: v[k] for name, v in values.items()}})
        for k, c in enumerate(cells)
    ]


def test_times_under_load_are_not_shown_beside_quiet_ones(
    tmp_path: pathlib.Path, serial: Study
) -> None:
    count = len(serial.cells)
    mixed = changed(serial.cells, loaded=[k < 3 for k in range(count)])
    assert comparable(mixed) == mixed[3:]
    assert f"{count - (count - 3)} of {count} cells are left out" in report.time_table(mixed)
    loaded = changed(serial.cells, loaded=[True] * count)
    assert comparable(loaded) == loaded
    assert "while other cells ran" in report.time_table(loaded)
    assert report.time_note(serial.cells) == ""
    plots.speed_against_error(mixed, tmp_path / "speed.png", "mixed")
    assert (tmp_path / "speed.png").exists()


def test_several_processors_are_said_with_their_tolerance(serial: Study) -> None:
    count = len(serial.cells)
    mixed = changed(serial.cells, cpu=["new" if k < 2 else "old" for k in range(count)])
    assert report.processor_note(serial.cells) == ""
    assert "2 models of processor (new, old)" in report.processor_note(mixed)
    assert comparable(mixed) == mixed[2:]


def test_methods_of_one_tap_are_measured_once(serial: Study) -> None:
    own = [c for c in serial.cells if c.method == "split-sum"]
    assert [(c.budget, c.samples, c.bias_kind) for c in own] == [
        (1, 1, "zero"), (1, 1, "best"), (1, 1, "zero"), (1, 1, "best"),
    ]  # fmt: skip
    lines = report.error_table(serial.cells).splitlines()
    header, row = (next(x for x in lines if word in x) for word in ("samples", "split-sum"))
    assert header.split()[-2:] == ["1", str(serial.cells[0].samples)]
    assert len(row) == len(header)
    names = commandline.finish(serial, commandline.evaluate(serial))
    assert len(names) == 4


# --- workers that die -----------------------------------------------------------------------------


@needs_dask
@pytest.mark.parametrize("dead", [1, 2])
def test_what_dead_workers_were_doing_is_done_again(
    dead: int, tmp_path: pathlib.Path, serial: Study, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With new workers, to the same bits; the truths that are kept are not computed again."""
    truths: list[int] = []
    submit = client.submit

    def counted(function: Any, *args: Any, **options: Any) -> Any:
        if function is spread._truth:
            truths.append(args[1])
        return submit(function, *args, **options)

    def killing(steps: Any) -> Iterator[Callable[[], None]]:
        alive = True
        for step in steps:
            yield step
            if alive and len(broken.truths) == 2:  # the cells of one are all to come
                alive = False
                for pid in list(client.run(os.getpid).values())[:dead]:
                    os.kill(pid, signal.SIGKILL)

    monkeypatch.setattr(client, "submit", counted)
    broken = planned(tmp_path)
    broken.run(killing, client)
    assert errors(broken.cells) == errors(serial.cells)
    assert truths == [0, 1]


def test_workers_that_always_die_end_the_study_with_one_line(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arrivals = spread.Arrivals(planned(tmp_path), FakeClient())
    monkeypatch.setattr(arrivals, "_result", lambda future: None)
    with pytest.raises(OSError, match="the workers die again and again; what is finished is kept"):
        list(arrivals)
    assert arrivals.client.submitted == 2 * (1 + spread.TRIES)


class FakeFuture:
    """A task that has ended already."""

    status = "cancelled"

    def add_done_callback(self, call: Callable[[Any], None]) -> None:
        call(self)


class FakeClient:
    """Takes tasks and loses them; or has no workers, or no scheduler."""

    status = "running"

    def __init__(self, silent: bool = False, workers: int = 1) -> None:
        self.submitted, self.silent, self.workers = 0, silent, workers

    def scatter(self, values: list[Any], **_: Any) -> list[Any]:
        return [FakeFuture() for _ in values]

    def submit(self, *_: Any, **__: Any) -> FakeFuture:
        self.submitted += 1
        future = FakeFuture()
        if self.silent:
            future.add_done_callback = lambda call: None  # type: ignore[method-assign]
        return future

    def scheduler_info(self, n_workers: int) -> dict[str, Any]:
        return {"workers": dict.fromkeys(range(self.workers))}

    def cancel(self, futures: list[Any]) -> None:
        raise OSError("gone")


@pytest.mark.parametrize(
    ("client", "status", "words"),
    [
        (FakeClient(silent=True, workers=0), "running", "no Dask worker is left"),
        (FakeClient(silent=True), "closed", "the Dask scheduler is gone"),
    ],
)
def test_nobody_left_to_work_is_one_line(
    client: FakeClient,
    status: str,
    words: str,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(spread, "PATIENCE", 0.0)
    monkeypatch.setattr(client, "status", status)
    with pytest.raises(OSError, match=f"^{words}; what is finished is kept, --resume"):
        list(spread.Arrivals(planned(tmp_path), client))


def test_a_scheduler_that_goes_while_tasks_are_sent_is_one_line(tmp_path: pathlib.Path) -> None:
    client = FakeClient()
    client.status = "connecting"
    client.scatter = lambda *_, **__: client.cancel([])  # type: ignore[assignment, method-assign]
    with pytest.raises(OSError, match=r"^the Dask scheduler is gone \(gone\); what is"):
        list(spread.Arrivals(planned(tmp_path), client))


@needs_dask
def test_a_worker_of_another_version_is_refused(
    tmp_path: pathlib.Path, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spread, "versions", lambda: {"glossy": "99", "NumPy": "0.1"})
    with pytest.raises(ValueError, match=r"^worker tcp://.* has other versions: glossy ") as e:
        small(tmp_path).run(client=client)
    assert "for 99, NumPy " in str(e.value)
    assert "\n" not in str(e.value)
