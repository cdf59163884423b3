"""The fuzzer of the readers: what it takes apart, what it notices, and what it finds in them."""

import importlib
import json
import os
import pathlib
import random
import signal
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

FOLDER = pathlib.Path(__file__).parent.parent / "benchmarks"
KEPT = pathlib.Path(__file__).parent / "data" / "fuzz"


@pytest.fixture(name="fuzz", scope="module")
def _fuzz() -> Iterator[Any]:
    """The fuzzer's modules by name."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        yield lambda name: importlib.import_module(f"fuzz_{name}")


@pytest.fixture(name="made", scope="module")
def _made(fuzz: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    return fuzz("targets").targets(tmp_path_factory.mktemp("made"))


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(FOLDER / "fuzz_readers.py"), *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONWARNINGS": "ignore"},
    )


def test_some_hundred_damaged_inputs_of_all_readers(tmp_path: pathlib.Path, made: Any) -> None:
    figures = tmp_path / "figures.json"
    done = run("--inputs", "600", "--seed", "3", "--json", str(figures))
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(figures.read_text())
    assert sum(found["inputs"].values()) == 600
    assert set(found["inputs"]) == {target.group for target in made}
    assert all(found["inputs"].values())
    assert found["faults"] == {}
    assert 0.4 * found["lines"][1] < found["lines"][0] < found["lines"][1]


def test_what_was_found_stays_mended(made: Any) -> None:
    names = {target.name for target in made}
    assert {p.name for p in KEPT.iterdir() if p.is_dir()} <= names
    done = run("--replay", str(KEPT))
    assert done.returncode == 0, done.stdout + done.stderr
    assert (done.stdout, done.stderr) == ("no fault\n", "")  # libraries print nothing past it


def test_files_come_apart_and_together_again(fuzz: Any, made: Any, tmp_path: pathlib.Path) -> None:
    """What has no other form is the same bytes; a reader takes either alike."""
    formats, other = fuzz("formats").FORMATS, set()
    for k, target in enumerate(made):
        joined = dict(target.files)
        for name, data in target.files.items():
            form = formats.get(pathlib.Path(name).suffix)
            if form is not None:
                pieces = form.split(data)
                assert len(pieces) > 1, name
                joined[name] = form.join(pieces)
                if joined[name] != data:
                    other.add(pathlib.Path(name).suffix)
        place = tmp_path / str(k)
        fuzz("work").put(place, joined, {})
        assert not fuzz("judge").attempt(target.read, place)
    assert other <= {".tif", ".npz", ".jp2"}  # whose tables lie elsewhere, or lengths are open


def test_mutants_are_a_function_of_the_seed(fuzz: Any, made: Any) -> None:
    work = fuzz("work")
    for target in made:
        one, again = (
            [work.mutant(target, [target.files], random.Random(f"7 {k}")) for k in range(3)]
            for _ in range(2)
        )
        assert one == again
        assert any(files != target.files for files in one)


def noisy(_folder: pathlib.Path) -> None:
    os.write(2, b"a library\n")


def busy(_folder: pathlib.Path) -> None:
    while True:
        pass


def greedy(_folder: pathlib.Path) -> None:
    raise ValueError(f"too long by {len(b'x' * (56 << 20))}")


def crashed(_folder: pathlib.Path) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def lines(_folder: pathlib.Path) -> None:
    raise ValueError("one\x0btwo")


def missing(_folder: pathlib.Path) -> None:
    raise KeyError("a")


def refused(_folder: pathlib.Path) -> None:
    raise OSError("a: is no file")


@pytest.mark.parametrize(
    ("read", "words"),
    [
        (noisy, "wrote past Python: a library"),
        (busy, "killed by SIGPROF"),
        (greedy, "memory: took "),
        (crashed, "killed by SIGKILL"),
        (lines, "ValueError of 2 lines"),
        (missing, "KeyError: 'a'"),
        (refused, None),
    ],
)
def test_what_is_no_plain_refusal_is_found(
    fuzz: Any, read: Any, words: str | None, tmp_path: pathlib.Path, monkeypatch: Any
) -> None:
    """The first input is taken, the second is not, whatever it does to its process."""
    work, targets = fuzz("work"), fuzz("targets")
    monkeypatch.setattr(work, "CPU_SECONDS", 0.2)
    monkeypatch.setattr(work, "MEMORY", 16 << 20)

    def sometimes(folder: pathlib.Path) -> None:
        if (folder / "a").read_bytes() != b"good":
            read(folder)

    target = targets.Target("planted", "planted", {"a": b"good"}, sometimes)
    board = work.Board(1)
    job = work.Job(seed=1, number=0, jobs=1, inputs=4, traced=0.0)
    found = list(work.run_job(job, tmp_path / "job", [target], board))
    assert board.counts.tolist() == [4]
    if words is None:
        assert not found
    else:
        assert {fault.target for fault in found} == {"planted"}
        assert all(fault.wrong.startswith(words) for fault in found)
        assert found[0].files["a"] != b"good"


def test_a_finding_is_cut_down(fuzz: Any, tmp_path: pathlib.Path) -> None:
    work, targets = fuzz("work"), fuzz("targets")

    def read(folder: pathlib.Path) -> None:
        if b"x" in (folder / "a").read_bytes():
            raise KeyError

    target = targets.Target("planted", "planted", {"a": b"good"}, read)
    worker = work.Worker(tmp_path, [target], trace=False)
    files = {"a": bytes(1000) + b"x" + bytes(1000)}
    wrong, _ = worker.judge(target, files)
    assert worker.minimised(target, files, wrong) == {"a": b"x"}


def test_new_lines_are_counted_once(fuzz: Any) -> None:
    judge = fuzz("judge")
    coverage = judge.Coverage({__file__})
    counts = []
    for _ in range(2):
        coverage.start()
        with pytest.raises(OSError, match="is no file"):
            refused(pathlib.Path())
        counts.append(coverage.stop())
    assert counts[0] > 0
    assert counts[1] == 0
    assert (__file__, refused.__code__.co_firstlineno + 1) in coverage.seen
    assert coverage.reached() == len(coverage.seen)
