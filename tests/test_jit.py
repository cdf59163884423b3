"""The compile cache: its folder changes with every source a kernel depends on, and no other."""

import pathlib

import pytest

import glossy
from glossy import _jit

PACKAGE = pathlib.Path(glossy.__file__).parent


def test_a_kernels_folder_covers_everything_its_module_leads_to() -> None:
    names = {path.relative_to(PACKAGE).as_posix() for path in _jit.sources_of(PACKAGE / "tiles.py")}
    assert {"tiles.py", "_jit.py", "_lanes.py", "footprint.py", "_check.py"} <= names
    assert not names & {"__init__.py", "cli.py", "render.py"}


def test_an_edited_callee_in_another_file_changes_the_folder(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A chain of two files; only what the caller leads to counts."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    for name, text in (
        ("caller", "from . import (\n    callee,\n)\n"),
        ("callee", "X = 1\n"),
        ("stranger", "X = 1\n"),
    ):
        (tmp_path / f"{name}.py").write_text(text)

    def folder() -> pathlib.Path:
        _jit.sources_of.cache_clear()
        _jit.cache_folder.cache_clear()
        return _jit.cache_folder(tmp_path / "caller.py")

    before = folder()
    (tmp_path / "stranger.py").write_text("X = 2\n")
    assert folder() == before
    (tmp_path / "callee.py").write_text("X = 2\n")
    assert folder() != before
