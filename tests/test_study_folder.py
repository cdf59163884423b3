"""A study's folder: damaged and foreign files, two processes, leftovers, and what may be added."""

import json
import math
import os
import pathlib
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from test_study import study
from test_study_keeping import small

from glossy._output import replacing
from glossy.cli import main
from glossy.materials import parse_material
from glossy.study import lock, sealed, store
from glossy.study.lock import Lock
from glossy.study.run import Study
from glossy.study.settings import Plan, case_of, parse_method, restored_case

# --- damaged files --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """A finished study whose folder the tests copy."""
    folder = tmp_path_factory.mktemp("kept")
    small(folder).run()
    return folder / "kept"


@pytest.fixture
def copy(kept: pathlib.Path, tmp_path: pathlib.Path) -> pathlib.Path:
    return pathlib.Path(shutil.copytree(kept, tmp_path / "kept"))


def resumed(folder: pathlib.Path) -> Study:
    """The study of that folder, run again."""
    again = small(folder.parent, resume=True)
    again.run()
    return again


def changed(**entries: Any) -> Callable[[pathlib.Path], None]:
    """Entries set to other values, or to functions of the old ones."""

    def apply(path: pathlib.Path) -> None:
        value = json.loads(path.read_text())
        for name, entry in entries.items():
            value[name] = entry(value[name]) if callable(entry) else entry
        path.write_text(json.dumps(value))

    return apply


def without(name: str) -> Callable[[pathlib.Path], None]:
    def apply(path: pathlib.Path) -> None:
        value = json.loads(path.read_text())
        del value[name]
        path.write_text(json.dumps(value))

    return apply


def replaced(old: str, new: str) -> Callable[[pathlib.Path], None]:
    def apply(path: pathlib.Path) -> None:
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))

    return apply


def content(data: bytes) -> Callable[[pathlib.Path], None]:
    def apply(path: pathlib.Path) -> None:
        path.write_bytes(data)

    return apply


def cut(path: pathlib.Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def resealed(**entries: Any) -> Callable[[pathlib.Path], None]:
    """With a right checksum: what another version, or a hand, may write."""

    def apply(path: pathlib.Path) -> None:
        value = {**json.loads(path.read_text()), **entries}
        del value["sha256"], value["schema"]
        path.write_text(json.dumps(sealed.sealed(value)))

    return apply


def directory(path: pathlib.Path) -> None:
    path.unlink()
    path.mkdir()


def fifo(path: pathlib.Path) -> None:
    path.unlink()
    os.mkfifo(path)


def link(path: pathlib.Path) -> None:
    elsewhere = path.with_name("elsewhere")
    path.rename(elsewhere)
    path.symlink_to(elsewhere)


def dangling(path: pathlib.Path) -> None:
    path.unlink()
    path.symlink_to(path.with_name("nowhere"))


def another_cell(path: pathlib.Path) -> None:
    other = next(p for p in sorted(path.parent.iterdir()) if p.name.endswith("_zero.json"))
    shutil.copy(other, path)


CELLS: dict[str, tuple[Callable[[pathlib.Path], None], str]] = {
    "empty": (content(b""), "is empty"),
    "cut": (cut, "line"),
    "binary": (content(bytes(range(256))), "can't decode"),
    "zero bytes": (content(bytes(100)), "Expecting value"),
    "byte order mark": (lambda p: content(b"\xef\xbb\xbf" + p.read_bytes())(p), "BOM"),
    "list": (content(b"[]"), "not a JSON object"),
    "number": (content(b"7"), "not a JSON object"),
    "deep": (content(b"[" * 100_000), "nested too deeply"),
    "deep figure": (
        replaced('"rms": ', '"rms": ' + "[" * 100_000 + "]" * 100_000 + ', "x": '),
        "deep",
    ),
    "a key twice": (replaced('"rms"', '"rms": 0.1, "rms"'), "a key occurs twice"),
    "NaN": (changed(rms=math.nan), "NaN is not a figure"),
    "infinite": (changed(rms=math.inf), "Infinity is not a figure"),
    "400 digits": (replaced('"rms": ', '"rms": ' + "9" * 400 + ', "y": '), "also holds y"),
    "too large": (replaced('"rms": 0', '"rms": ' + "9" * 400), "rms must be a finite number"),
    "9000 digits": (replaced('"samples": ', '"samples": ' + "9" * 9000), "digits"),
    "beyond floats": (replaced('"rms": 0', '"rms": 1e999, "peak2": 0'), "also holds peak2"),
    "text": (changed(rms="0.1"), 'rms must be a finite number, got "0.1"'),
    "null": (changed(rms=None), "rms must be a finite number, got null"),
    "true": (changed(samples=True), "samples must be a whole number, got true"),
    "fraction": (changed(samples=7.5), "samples must be a whole number, got 7.5"),
    "shape": (changed(taps=7), "taps must be of type"),
    "shape of pairs": (changed(search=[1.0]), "search must be of type"),
    "missing": (without("rms"), "misses rms"),
    "also": (changed(more=1), "also holds more"),
    "doubled": (changed(rms=lambda v: 2.0 * v), "changed since it was written"),
    "negative time": (changed(cpu_seconds=lambda v: -v), "changed since it was written"),
    "order": (changed(runs=lambda v: [*v, 1.0]), "changed since it was written"),
    "schema 99": (changed(schema=99), "of another version, schema 99"),
    "schema true": (changed(schema=True), "of another version, schema true"),
    "no schema": (without("schema"), "of another version, schema null"),
    "no checksum": (without("sha256"), "of another version, without a checksum"),
    "another mark": (resealed(study="0123456789abcdef"), "of a study with other settings"),
    "another session": (resealed(session=7), "of a session that is not on record"),
    "another cell": (another_cell, "of another"),
    "directory": (directory, "is a directory"),
    "pipe": (fifo, "is not a regular file"),
    "link": (link, "is a symbolic link"),
    "dangling link": (dangling, "is a symbolic link"),
}


@pytest.mark.parametrize("kind", CELLS)
def test_a_damaged_cell_is_one_line_with_its_file(copy: pathlib.Path, kind: str) -> None:
    damage, words = CELLS[kind]
    cell = next(p for p in sorted((copy / "cells").iterdir()) if p.name.endswith("_best.json"))
    damage(cell)
    with pytest.raises((ValueError, OSError)) as error:
        resumed(copy)
    text = str(error.value)
    assert text.startswith(f"{cell}: ")
    assert words in text
    assert "\n" not in text
    assert len(text) < len(str(cell)) + 250
    assert ("delete it to redo it" in text) == isinstance(error.value, ValueError) or "link" in kind


@pytest.mark.parametrize("kind", ["empty", "cut", "binary", "directory", "pipe", "link"])
@pytest.mark.parametrize("name", ["truth", "manifest", "preparation"])
def test_so_are_the_other_files(copy: pathlib.Path, name: str, kind: str) -> None:
    pattern = {"truth": "truth/*", "manifest": store.MANIFEST, "preparation": "*/*_preparation*"}
    file = next(copy.glob(pattern[name]))
    CELLS[kind][0](file)
    with pytest.raises((ValueError, OSError)) as error:
        resumed(copy)
    assert str(error.value).startswith(f"{file}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"methods": [1]}, r"methods must be of type list\[str\], got \[1\]"),
        ({"methods": "regular"}, "methods must be of type"),
        ({"budgets": [[7]]}, "budgets must be of type"),
        ({"budgets": None}, "budgets must be of type"),
        ({"cases": ["a"]}, "cases must be of type"),
        ({"cases": [{"name": {}, "material": {}}]}, "name must be text, got {}"),
        ({"cases": [{"name": "a", "material": 1}]}, "material must be of type dict, got 1"),
        ({"cases": [{"name": "a"}]}, "settings or sessions are missing"),
        ({"baseline": ["a", "b", 1]}, "baseline must be a case, a method and a budget"),
        ({"baseline": [1]}, "baseline must be"),
        ({"sessions": []}, "holds no session"),
        ({"sessions": [1]}, "sessions must be of type"),
        ({"sessions": [{"arguments": 1}]}, "arguments must be of type dict, got 1"),
        ({"sessions": [{"command": 1}]}, "command must be text, got 1"),
    ],
)
def test_a_record_of_entries_of_other_types_is_one_line(
    copy: pathlib.Path, entries: dict[str, Any], words: str
) -> None:
    """Whoever changes a record on purpose computes its checksum anew."""
    manifest = copy / store.MANIFEST
    value = sealed.read(manifest)
    for name, entry in entries.items():
        value["settings" if name != "sessions" else name] = (
            entry if name == "sessions" else {**value["settings"], name: entry}
        )
    manifest.write_text(json.dumps(sealed.sealed(value)))
    with pytest.raises(ValueError, match=words) as error:
        store.recorded(copy)
    assert str(error.value).startswith(f"{manifest}: not the record of a study: ")
    assert "\n" not in str(error.value)


def test_settings_that_others_lack_are_named_on_one_line(
    copy: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    manifest = copy / store.MANIFEST
    value = sealed.read(manifest)
    value["settings"]["methods"].append("a\n\x85b")
    value["settings"]["c\nd"] = 1
    manifest.write_text(json.dumps(sealed.sealed(value)))
    with pytest.raises(ValueError, match="methods without a b, c d") as error:
        small(tmp_path, resume=True)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    "entries",
    [
        {"seconds": np.zeros(2)},
        {"seconds": np.array("1")},
        {"kind": np.array(["bound"])},
        {"radiance": np.zeros((3, 3))},
        {"error": np.zeros((3, 3))},
        {"radiance": np.zeros(3)},
    ],
)
def test_a_truth_of_other_shapes_is_one_line(copy: pathlib.Path, entries: dict[str, Any]) -> None:
    file = next(copy.glob("truth/*"))
    with np.load(file) as found:
        whole = {name: value for name, value in {**found, **entries}.items() if name != "sha256"}
    np.savez(file, **whole, sha256=np.array(sealed.array_checksum(whole)))
    with pytest.raises(
        ValueError, match="its arrays are of other shapes or types; delete"
    ) as error:
        resumed(copy)
    assert str(error.value).startswith(f"{file}: ")


def arrays(path: pathlib.Path, **entries: Any) -> None:
    """The truth's file with other arrays."""
    with np.load(path) as found:
        whole = {**found, **entries}
    np.savez(path, allow_pickle=False, **whole)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda f: {"radiance": 2.0 * f["radiance"]}, "changed since it was written"),
        (lambda f: {"radiance": np.full_like(f["radiance"], np.nan)}, "changed since"),
        (lambda f: {"error": f["error"][:-1]}, "changed since it was written"),
        (lambda f: {"radiance": f["radiance"].T}, "changed since it was written"),
        (lambda f: {"radiance": f["radiance"].astype("f4")}, "changed since it was written"),
        (lambda f: {"study": np.array("0")}, "changed since it was written"),
        (lambda f: {"sha256": np.array("0")}, "changed since it was written"),
    ],
)
def test_a_changed_truth_is_refused(
    copy: pathlib.Path, make: Callable[[Any], dict[str, Any]], words: str
) -> None:
    truth = next(copy.glob("truth/*"))
    with np.load(truth) as found:
        entries = make(dict(found))
    arrays(truth, **entries)
    with pytest.raises(ValueError, match=words) as error:
        resumed(copy)
    assert str(error.value).startswith(f"{truth}: not a finished truth: ")


def test_files_of_another_study_are_refused(copy: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """A finer truth, asked of the same scene: the names are the same."""
    whole = study(tmp_path / "x")
    other = study(tmp_path / "finer", cases=whole.plan.cases[:1], budgets=(7,), tolerance=1e-2)
    other.run()
    for part in ("truth", "cells"):
        for file in (tmp_path / "finer" / part).iterdir():
            shutil.copy(file, copy / part / file.name)
    with pytest.raises(ValueError, match=r"of a study with other settings.*and 6 more such files"):
        resumed(copy)


def test_a_deleted_cell_is_measured_anew_and_no_other(copy: pathlib.Path) -> None:
    cells = sorted((copy / "cells").iterdir())
    first = next(path for path in cells if path.name.endswith("_best.json"))
    before = {path: path.read_bytes() for path in cells if path != first}
    first.unlink()
    assert [c.session for c in resumed(copy).cells].count(1) == 1
    assert all(path.read_bytes() == data for path, data in before.items())


# --- one process at a time ------------------------------------------------------------------------

HOLDER = """\
import pathlib, sys
from glossy.study.lock import Lock
with Lock(pathlib.Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_second_process_is_told_who_works_there_and_a_dead_ones_lock_is_taken(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["study", "--env", "studio", "--size", "8", "--width", "6", "--material", "mx=.2"]
    words += ["--methods", "regular/paper", "--samples", "7", "--repeats", "1"]
    out = tmp_path / "out"
    out.mkdir()
    command = [sys.executable, "-c", HOLDER, str(out)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        assert main([*words, "-o", str(out)]) == 2
        said = capsys.readouterr().err
        record = json.loads((out / lock.NAME).read_text())
        holder.send_signal(signal.SIGKILL)
    assert record["pid"] == holder.pid
    who = f"process {holder.pid} on {record['host']} since {record['started']}"
    assert said == f"glossy study: {out}: a study runs here already: {who}\n"
    assert (out / lock.NAME).exists()
    assert main([*words, "-o", str(out), "--json"]) == 0
    assert not (out / lock.NAME).exists()


def test_a_lock_may_be_entered_again_and_goes_when_it_is_left(tmp_path: pathlib.Path) -> None:
    own, other = Lock(tmp_path), Lock(tmp_path)
    with own, own, pytest.raises(ValueError, match=f"process {os.getpid()} on "):
        other.__enter__()
    assert not list(tmp_path.iterdir())
    with other:
        assert (tmp_path / lock.NAME).exists()


@pytest.mark.parametrize(
    ("record", "free"),
    [
        ({"pid": 1, "host": "elsewhere", "boot": "another", "started": "then"}, False),
        ({"pid": 1, "host": "elsewhere", "boot": "", "started": "then"}, False),
        ({"pid": 1, "host": "HERE", "boot": "another", "started": "then"}, True),
        ({"pid": 1, "host": "elsewhere", "boot": "HERE", "started": "then"}, True),
        ({"pid": 1}, True),
        ([], True),
    ],
    ids=["other machine", "unknown start", "rebooted", "other container", "cut", "no record"],
)
def test_a_lock_left_behind_is_taken_if_its_process_must_be_dead(
    tmp_path: pathlib.Path, record: Any, free: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lock, "_machine", lambda: {"host": "HERE", "boot": "HERE"})
    file = tmp_path / lock.NAME
    file.write_text(json.dumps(record))
    if free:
        with Lock(tmp_path):
            assert json.loads(file.read_text())["pid"] == os.getpid()
        return
    with pytest.raises(ValueError, match=f"on elsewhere since then; .* delete {file}"):
        Lock(tmp_path).__enter__()
    assert json.loads(file.read_text()) == record


def test_without_locks_in_the_file_system_the_file_itself_is_the_lock(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lock, "_locked", lambda _: None)
    with Lock(tmp_path), pytest.raises(ValueError, match="if that has ended, delete "):
        Lock(tmp_path).__enter__()
    with Lock(tmp_path):
        pass


@pytest.mark.parametrize("make", [os.mkfifo, pathlib.Path.mkdir, lambda p: p.symlink_to("x")])
def test_what_is_no_lock_is_refused(
    tmp_path: pathlib.Path, make: Callable[[pathlib.Path], None]
) -> None:
    make(tmp_path / lock.NAME)
    with pytest.raises(OSError, match=lock.NAME):
        Lock(tmp_path).__enter__()


def test_a_study_that_was_started_over_is_not_run(tmp_path: pathlib.Path) -> None:
    first = small(tmp_path)
    study(tmp_path / "kept", budgets=(14,))  # nothing is measured yet: the folder is free
    with pytest.raises(ValueError, match="another study was started here meanwhile"):
        first.run()


# --- leftovers ------------------------------------------------------------------------------------


def test_what_a_killed_process_had_begun_is_swept(copy: pathlib.Path) -> None:
    begun = []
    for name in ("cells/a_7_zero.json", "truth/a.npz", "report.md", "study.csv", "speed.png"):
        with pytest.raises(OSError, match=name), replacing(copy / name) as temporary:  # unwritten
            begun.append(pathlib.Path(temporary))
    mine = [copy / ".hidden.json", copy / "cells" / "note-0123456789ab.json"]
    for path in [*begun, *mine]:
        path.write_text("x")
    resumed(copy)
    assert not any(path.exists() for path in begun)
    assert all(path.exists() for path in mine)


# --- adding to a study ----------------------------------------------------------------------------

TINY = ["--env", "studio", "--size", "8", "--width", "6", "--repeats", "1"]


def command(capsys: pytest.CaptureFixture[str], folder: pathlib.Path, *words: str) -> Any:
    """What ``glossy study WORDS`` prints as JSON."""
    assert main(["study", *words, "-o", str(folder), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_budgets_methods_and_materials_may_be_added(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With as little said as possible; the sum is the study that had all of it from the start."""
    first = ["--material", "mx=.3", "--methods", "importance", "--samples", "14"]
    old = command(capsys, tmp_path, *TINY, *first)
    before = {path: path.read_bytes() for path in tmp_path.glob("*/*")}
    assert command(capsys, tmp_path, "--resume")["cells"] == old["cells"]
    more = ["--resume", "--samples", "7", "--methods", "regular/paper"]
    grown = command(capsys, tmp_path, *more)
    names = {(c["method"], c["budget"]) for c in grown["cells"]}
    assert names == {(m, n) for m in ("importance", "regular/paper") for n in (7, 14)}
    assert grown["baseline"] == "iso m=0.3, importance, budget 14, bias 0"
    both = command(capsys, tmp_path, "--resume", "--material", "mx=.3,my=.2")
    assert [c["name"] for c in both["settings"]["cases"]] == ["iso m=0.3", "aniso (0.3, 0.2)"]
    assert len(both["cells"]) == 16
    assert all(path.read_bytes() == data for path, data in before.items())
    report = (tmp_path / "report.md").read_text()
    assert "--material mx=.3 " in report
    assert "--material mx=.3,my=.2 --methods importance,regular/paper" in report
    assert f"--resume -o {tmp_path}" in report
    whole = command(capsys, tmp_path / "whole", *TINY, "--material", "mx=.3", "--samples", "7,14",
                    "--methods", "importance,regular/paper")  # fmt: skip
    figures = ("method", "budget", "bias_kind", "bias", "rms", "spread", "search")
    assert [[c[f] for f in figures] for c in whole["cells"]] == [
        [c[f] for f in figures] for c in grown["cells"]
    ]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--filter", "box"], "other settings (filter)"),
        (["--reference-tolerance", ".01"], "other settings (reference_tolerance)"),
        (["--repeats", "2"], "other settings (repeats)"),
        (["--env", "sky"], "other settings (environment, cube_sha256)"),
        (["--size", "16"], "other settings (cube_size, cube_sha256)"),
        (["--material", "mx=.3,r0=.5"], "other settings (cases without iso m=0.3)"),
        (["--samples", "x"], "samples: must be whole numbers"),
        (["--methods", "magic"], "must be one of"),
    ],
)
def test_what_would_change_measured_figures_is_refused(
    words: list[str], said: str, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start = [*TINY, "--material", "mx=.3", "--methods", "importance", "--samples", "7"]
    command(capsys, tmp_path, *start)
    before = {path: path.read_bytes() for path in tmp_path.glob("**/*") if path.is_file()}
    assert main(["study", "--resume", *words, "-o", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert {p: p.read_bytes() for p in tmp_path.glob("**/*") if p.is_file()} == before


def test_a_plan_that_leaves_out_what_was_measured_is_refused(copy: pathlib.Path) -> None:
    whole = study(copy.parent / "x")
    changes = {"cases": whole.plan.cases[:1], "budgets": (7,)}
    with pytest.raises(ValueError, match=r"other settings \(methods without importance\)"):
        study(copy, True, **changes, methods=[parse_method("regular/paper")])


@pytest.mark.parametrize("text", ["mx=.2", "mx=.3,my=.1,r0=.04,alpha=.5,ks=.7", "alanod-2000gs"])
def test_a_case_is_restored_from_its_description(text: str) -> None:
    case = case_of(parse_material(text))
    plan = Plan([case], [parse_method("importance")])
    [described] = json.loads(json.dumps(plan.describe()))["cases"]
    assert restored_case(described) == case
    described["material"]["kd"] = -1.0
    with pytest.raises(ValueError, match="kd"):
        restored_case(described)
    del described["material"]["reflection"]
    with pytest.raises(ValueError, match="must be named again"):
        restored_case(described)
