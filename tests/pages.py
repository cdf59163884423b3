"""Pages whose tables a benchmark fills, that benchmark, and a folder of its own for its scenes."""

import contextlib
import importlib
import os
import pathlib
import re
from collections.abc import Iterator
from typing import Any

import pytest

ROOT = pathlib.Path(__file__).parent.parent


def rows_of(page: str, table: str) -> list[list[str]]:
    """Cells of a marked table of ``docs/page``, without its head."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    found = re.search(rf"<!-- {table} -->\n(.*?)\n<!-- end -->", text, re.S)
    assert found, table
    lines = found[1].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


@contextlib.contextmanager
def benchmark(name: str) -> Iterator[Any]:
    """A script of ``benchmarks`` as a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        yield importlib.import_module(name)


@contextlib.contextmanager
def own_scenes(folder: pathlib.Path) -> Iterator[None]:
    """Scenes are baked into ``folder``, away from the user's cache; kernels stay where they are."""
    base = os.environ.get("XDG_CACHE_HOME") or str(pathlib.Path.home() / ".cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NUMBA_CACHE_DIR", os.environ.get("NUMBA_CACHE_DIR") or base)
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield
