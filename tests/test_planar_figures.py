"""The figures of planar reflectors in small: the page has every row, and more samples help."""

from typing import Any

import pages
import pytest

SAMPLES = 128  # of converged buffer and truth: their noise is far below what is measured


@pytest.fixture(name="study", scope="module")
def _study() -> Any:
    with pages.benchmark("reproduce_planar") as script:
        yield script


@pytest.fixture(name="gallery", scope="module")
def _gallery(study: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The hall's floor, baked coarsely, away from the user's cache."""
    with pages.own_scenes(tmp_path_factory.mktemp("cache")):
        yield study.Gallery(study.Place(18, scale=4.0, coarse=True), SAMPLES)


def test_the_page_has_every_row(study: Any) -> None:
    figures = [row.figure[:4] for row in study.ROWS]
    assert {f: figures.count(f) for f in figures} == {"4.34": 2, "4.35": 2, "4.45": 6, "4.46": 1}
    printed = ["" if r.published is None else f"{r.published:.2f}" for r in study.ROWS]
    expected = [
        [r.figure, r.subject, str(r.samples), r.note, p]
        for r, p in zip(study.ROWS, printed, strict=True)
    ]
    assert [row[:5] for row in pages.rows_of("planar.md", "rows")] == expected
    assert [row[0] for row in pages.rows_of("planar.md", "limits")] == list(study.MATERIALS)
    times = [row[0] for row in pages.rows_of("planar.md", "times")]
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
