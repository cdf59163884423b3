"""The limit on memory: where it comes from, and the one line that refuses."""

import pathlib
import tracemalloc
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from picture_files import rgb_exr

from glossy import _files, _memory, cli


@pytest.fixture(autouse=True)
def _no_limit_of_the_caller(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv(_memory.VARIABLE, raising=False)
    yield
    _memory.set_limit(None)
    _memory._machine.cache_clear()


@pytest.mark.parametrize("text", [b"", b"a = 1\n"])
def test_reading_a_file_makes_room_for_its_size_alone(tmp_path: pathlib.Path, text: bytes) -> None:
    path = tmp_path / "small.obj"
    path.write_bytes(text)
    tracemalloc.start()
    try:
        if text:
            assert _files.read_bytes(path) == text
        else:
            assert _files.read_table(path) == {}
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


@given(st.integers(1, 2**50))
def test_a_number_of_bytes_is_itself(size: int) -> None:
    assert _memory.parse("max_memory", size) == size
    assert _memory.parse("max_memory", str(size)) == size


@pytest.mark.parametrize(
    ("text", "size"),
    [("512M", 2**29), ("4G", 2**32), ("4 GiB", 2**32), ("1.5k", 1536), ("2TB", 2**41)],
)
def test_units_are_powers_of_1024(text: str, size: int) -> None:
    assert _memory.parse("max_memory", text) == size


@pytest.mark.parametrize("bad", ["", "0", "-1", "many", "1e9", "9" * 400, True, None, "nan"])
def test_what_is_no_size_is_refused(bad: object) -> None:
    with pytest.raises(ValueError, match=r"^max_memory: must be a size in bytes") as caught:
        _memory.parse("max_memory", bad)
    assert len(str(caught.value)) < 120


def test_the_setter_wins_over_the_environment_and_that_over_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine = _memory.limit()
    assert machine > 2**20
    monkeypatch.setenv(_memory.VARIABLE, "3M")
    assert _memory.limit() == 3 << 20
    _memory.set_limit("2M")
    assert _memory.limit() == 2 << 20
    _memory.set_limit(None)
    assert _memory.limit() == 3 << 20
    monkeypatch.setenv(_memory.VARIABLE, "lots")
    with pytest.raises(ValueError, match=r"^GLOSSY_MAX_MEMORY: must be a size"):
        _memory.limit()


def test_a_control_group_below_the_machine_counts(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_memory, "GROUPS", (str(tmp_path / "memory.max"),))
    found = []
    for text in ("4096\n", "max\n"):
        (tmp_path / "memory.max").write_text(text)
        _memory._machine.cache_clear()
        found.append(_memory.limit())
    assert found[0] == 2048
    assert found[1] > 2**20


def test_commands_take_the_limit(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, "COMMANDS", ("compare",))
    path = tmp_path / "a.exr"
    path.write_bytes(rgb_exr(np.ones((60, 60, 3), np.float32)))
    line = ["compare", str(path), str(path)]
    assert cli.main(line) == 0
    capsys.readouterr()
    for size, said in (("64K", "more than the limit of 64 KiB"), ("some", "--max-memory: must be")):
        assert cli.main([*line, "--max-memory", size]) == 2
        text = capsys.readouterr().err
        assert said in text
        assert text.count("\n") == 1
    assert cli.main(line) == 0  # the limit ends with its command


def test_more_than_the_limit_is_refused_in_one_line() -> None:
    _memory.set_limit("1M")
    _memory.check("a.exr", 1 << 20)
    with pytest.raises(
        ValueError,
        match=r"^a\.exr: would take 2 GiB of memory, more than the limit of 1 MiB "
        r"\(--max-memory, GLOSSY_MAX_MEMORY\)$",
    ):
        _memory.check("a.exr", 2 << 30)
