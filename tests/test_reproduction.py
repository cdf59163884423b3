"""The thesis's figures in small: its orders hold, and the page has every row."""

import dataclasses
import pathlib
from typing import Any

import numpy as np
import pages
import pytest

import glossy

TRUTH = 128  # samples: its own error is then well below what is measured


@pytest.fixture(name="study", scope="module")
def _study() -> Any:
    with pages.benchmark("reproduce_thesis") as script:
        yield script


@pytest.fixture(name="place", scope="module")
def _place(study: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The test object in a room baked coarsely, away from the user's cache."""
    with pages.own_scenes(tmp_path_factory.mktemp("cache")):
        yield study.Place(20, coarse=True)


def test_no_row_is_forgotten(study: Any) -> None:
    """Figs. 4.24 (8 pictures), 4.39 to 4.41 (6 each), 4.42 (2), as printed in the page."""
    figures = [row.figure[:4] for row in study.ROWS]
    assert {f: figures.count(f) for f in set(figures)} == {
        "4.24": 8, "4.39": 6, "4.40": 6, "4.41": 6, "4.42": 2,
    }  # fmt: skip
    expected = [
        [r.figure, r.subject, r.estimator, r.printed, f"{r.published:.2f}"] for r in study.ROWS
    ]
    assert [row[:5] for row in pages.rows_of("thesis.md", "rows")] == expected


def test_the_page_names_every_material_and_where_it_comes_from(study: Any) -> None:
    cells = {row[1].strip("`"): row[2] for row in pages.rows_of("thesis.md", "materials")}
    assert list(cells) == list(study.MATERIALS)
    assert {n for n, origin in cells.items() if origin == "published"} == {
        "alanod-2000gs", "miro-5", "white-foil",
    }  # fmt: skip


def test_samples_are_shared_among_the_lobes(study: Any) -> None:
    for row in study.ROWS:
        material = study.find(row.material)
        lobes = len(material.reflection) + len(material.transmission)
        printed = sum(int(part) for part in row.printed.split("+"))
        assert printed == lobes * row.samples


def test_the_orders_of_the_page_are_those_of_its_rows(study: Any) -> None:
    """Every pair and its displayed gain, to the rounding of two figures of one digit."""
    rows = [
        {**dataclasses.asdict(r), **dict.fromkeys(study.MEASURES, 0.0), "display": float(cells[5])}
        for r, cells in zip(study.ROWS, pages.rows_of("thesis.md", "rows"), strict=True)
    ]
    found, printed = study.orders(rows), pages.rows_of("thesis.md", "orders")
    assert [(p["pair"], p["claim"]) for p in found] == [(c[0], c[1]) for c in printed]
    for pair, cells in zip(found, printed, strict=True):
        assert pair["published"] > 0.0
        assert float(cells[3].strip("*")) == pytest.approx(pair["display"], abs=0.151)


def test_more_samples_err_less_and_4_25_is_ahead_of_4_24(study: Any, place: Any) -> None:
    """The brushed metal: of its figure, the pair with the clearest lead."""
    pick = [r for r in study.ROWS if r.subject == "anisotropic"]
    few = dataclasses.replace(pick[1], samples=7, printed="7", published=0.0)
    by_24, by_25, fewer = (study.measure(place, r, TRUTH) for r in (*pick, few))
    for measure in ("display", "clipped", "clipped_linear"):
        assert by_25[measure] > by_24[measure]
        assert by_25[measure] > fewer[measure]
    assert by_25["biased"] >= by_25["display"]
    assert by_25["truth_display"] > by_25["display"] + 6.0


def test_a_sharp_coat_needs_fewer_samples_than_a_wide_metal(study: Any, place: Any) -> None:
    rows = {r.subject: r for r in study.ROWS if r.estimator == "4.25"}
    coat = dataclasses.replace(rows["lacquer"], samples=3)
    metal = dataclasses.replace(rows["chrome"], samples=19)
    values = [study.measure(place, row, TRUTH)["display"] for row in (coat, metal)]
    assert values[0] > values[1]


def test_display_is_what_a_png_holds(study: Any, tmp_path: pathlib.Path) -> None:
    values = np.linspace(-0.2, 1.3, 301).astype(np.float32).reshape(1, 301, 1).repeat(3, axis=2)
    glossy.write_image(tmp_path / "ramp.png", values)
    shown = glossy.read_image(tmp_path / "ramp.png", encoding="srgb").pixels[..., :3]
    again = study.display(shown)
    assert np.max(np.abs(study.display(values) - again)) < 1e-9


def test_a_line_is_found_again(study: Any) -> None:
    slope, start, r2 = study.line([1, 2, 5], [2.5, 4.0, 8.5])
    assert (slope, start, r2) == pytest.approx((1.5, 1.0, 1.0))


def test_a_page_without_a_place_for_a_table_is_an_error(study: Any, tmp_path: pathlib.Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- rows -->\nold\n<!-- end -->\n", encoding="utf-8")
    study.fill(page, {"rows": "new"})
    assert page.read_text(encoding="utf-8") == "<!-- rows -->\nnew\n<!-- end -->\n"
    with pytest.raises(SystemExit, match="no place for the table 'times'"):
        study.fill(page, {"times": "new"})
