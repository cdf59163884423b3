"""The figures of planar reflectors in small: the page has every row, and more samples help."""

import importlib
import os
import pathlib
import re
from typing import Any

import pytest

ROOT = pathlib.Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "planar.md").read_text(encoding="utf-8")
SAMPLES = 128  # of converged buffer and truth: their noise is far below what is measured


def rows_of(name: str) -> list[list[str]]:
    found = re.search(rf"<!-- {name} -->\n(.*?)\n<!-- end -->", PAGE, re.S)
    assert found, name
    lines = found[1].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


@pytest.fixture(name="study", scope="module")
def _study() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        yield importlib.import_module("reproduce_planar")


@pytest.fixture(name="gallery", scope="module")
def _gallery(study: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The hall's floor, baked coarsely, away from the user's cache."""
    base = os.environ.get("XDG_CACHE_HOME") or str(pathlib.Path.home() / ".cache")
    with pytest.MonkeyPatch.context() as patch:  # kernels stay where they are
        patch.setenv("NUMBA_CACHE_DIR", os.environ.get("NUMBA_CACHE_DIR") or base)
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield study.Gallery(study.Place(18, scale=4.0, coarse=True), SAMPLES)


def test_the_page_has_every_row(study: Any) -> None:
    figures = [row.figure[:4] for row in study.ROWS]
    assert {f: figures.count(f) for f in figures} == {"4.34": 2, "4.35": 2, "4.45": 6, "4.46": 1}
    printed = ["" if r.published is None else f"{r.published:.2f}" for r in study.ROWS]
    expected = [
        [r.figure, r.subject, str(r.samples), r.note, p]
        for r, p in zip(study.ROWS, printed, strict=True)
    ]
    assert [row[:5] for row in rows_of("rows")] == expected
    assert [row[0] for row in rows_of("limits")] == list(study.MATERIALS)
    times = [row[0] for row in rows_of("times")]
    assert times == [*map(str, study.TABLE_4_2), "mirror pass", "pyramid"]


def test_more_samples_come_closer_to_the_converged_buffer(study: Any, gallery: Any) -> None:
    """As published, and to the truth by less: what the buffer lacks does not go away."""
    few, more = (study.measure(gallery, row) for row in study.ROWS[4:6])  # polished, 5 and 13
    assert more["converged"] > few["converged"] + 0.5
    assert more["truth"] - few["truth"] < more["converged"] - few["converged"]
    assert few["± truth"] > more["truth"] + 3.0


def test_pictures_show_the_floor_in_every_material(study: Any, gallery: Any) -> None:
    found = study.pictures(gallery)
    assert set(found) == {"planar", "planar-rings", "planar-averaged"}
    for image in found.values():
        assert image.min() >= 0.0
        assert image.max() > 0.5
    assert found["planar"].shape == (4 * 13 + 3 * 2, 4 * 32 + 3 * 2, 3)
    assert found["planar-averaged"].shape == (2 * 13, 4 * 40 + 3 * 2, 3)
