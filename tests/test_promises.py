"""docs/promises.md: every promise names tests that exist; promises that span all commands."""

import ast
import os
import pathlib
import pickle
import re
import signal
import tomllib
from collections.abc import Iterator

import numpy as np
import pytest
from pages import ROOT
from picture_files import rgb_exr

from glossy._npz import load_npz
from glossy.cli import main

PAGE = (ROOT / "docs" / "promises.md").read_text(encoding="utf-8")
NAMED = re.compile(r"`(tests/test_\w+\.py)::(\w+)`")
PROMISED, NOT_PROMISED = PAGE.split("\n## What is not promised\n")


def test_every_named_test_exists() -> None:
    names = NAMED.findall(PAGE)
    assert len(names) >= 50
    defined: dict[str, set[str]] = {}
    for file, name in names:
        if file not in defined:
            tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
            defined[file] = {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}
        assert name in defined[file], f"{file}::{name}"


def test_every_promise_names_a_test() -> None:
    promises = re.split(r"^\* ", PROMISED, flags=re.MULTILINE)[1:]
    assert len(promises) >= 25
    assert [p[:60] for p in promises if not NAMED.search(p)] == []
    assert not NAMED.search(NOT_PROMISED.split("\n## ")[0])


def test_the_declared_minima_are_what_the_oldest_job_installs() -> None:
    """Each requirement has one lower bound, of three parts or more where releases have them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for text in (*project["dependencies"], *project["optional-dependencies"]["test"]):
        assert re.fullmatch(r"[\w.-]+(\[\w+\])?>=\d+(\.\d+)+(;.*)?", text.strip()), text
    for text in project["optional-dependencies"]["dev"]:
        assert text.startswith("glossy-envmap[") or re.fullmatch(r"\w+==\d+(\.\d+)+", text), text


# --- what has no end ------------------------------------------------------------------------------

READING = [
    *(["compare", *words] for words in (["X.exr", "good.exr"], ["good.exr", "X.hdr"])),
    ["compare", "good.exr", "good.exr", "--mask", "X.png"],
    *(["environment", f"X.{s}", "-o", "out.exr"] for s in ("exr", "hdr", "png")),
    *([c, "X.toml", *o] for c, o in (("trace", ["--pixel", "1,1"]), ("plan", []))),
    *([c, "X.toml", "-o", "out.exr"] for c in ("render", "reference", "study")),
    *([c, "--env", "X.hdr", "-o", "out.exr"] for c in ("render", "reference", "study")),
    *(["render", "--gbuffer", f"X.{s}", "-o", "out.exr"] for s in ("npz", "exr")),
    *(["render", "--material", f"X.{s}", "-o", "out.exr"] for s in ("toml", "json")),
    ["plan", "--material", "X.toml"],
    ["pattern", "--material", "X.toml"],
    ["material", "X.toml"],
    *(["fit", f"X.{s}", "-o", "out.toml"] for s in ("txt", "brdf", "binary", "xml", "bsdf")),
]
WRITING = [
    ["environment", "white", "--size", "4", "-o", "X.exr"],
    ["pattern", "--mx", ".1", "-o", "X.json"],
]


@pytest.fixture
def guarded() -> Iterator[None]:
    """A command that waits for a FIFO ends in an error, not in a test that never does."""
    signal.alarm(300)
    yield
    signal.alarm(0)


@pytest.mark.usefixtures("guarded")
@pytest.mark.parametrize("kind", ["fifo", "endless"])
@pytest.mark.parametrize("words", [*READING, *WRITING], ids=" ".join)
def test_what_has_no_end_is_refused_wherever_it_is_named(
    words: list[str],
    kind: str,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    pathlib.Path("good.exr").write_bytes(rgb_exr(np.ones((4, 4, 3), np.float32)))
    (name,) = (w for w in words if w.startswith("X."))
    if kind == "fifo":
        os.mkfifo(name)
    else:
        os.symlink("/dev/zero", name)
    before = sorted(os.listdir())
    assert main(words) == 2
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    assert f"{name}: is not a regular file" in said.err
    assert sorted(os.listdir()) == before


class Payload:
    """Pickled, it makes a folder when it is loaded."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (self.path,)


def test_no_input_is_unpickled(tmp_path: pathlib.Path) -> None:
    mark, file = tmp_path / "loaded", tmp_path / "a.npz"
    pickle.loads(pickle.dumps(Payload(str(mark))))
    mark.rmdir()  # it works
    held = np.empty(1, dtype=object)
    held[0] = Payload(str(mark))
    np.savez(file, normal=held)
    with pytest.raises(ValueError, match=r"a\.npz: "):
        load_npz(file)
    assert main(["-q", "trace", "--gbuffer", str(file), "--pixel", "0,0"]) == 2
    assert not mark.exists()
