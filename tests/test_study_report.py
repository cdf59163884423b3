"""What a study shows: plots whose words fit, short lines, claims that say what they need."""

import dataclasses
import itertools
import pathlib
import re
from typing import Any

import pytest
from test_study import cell, table

from glossy.cli import build_parser
from glossy.study import claims, plots, report
from glossy.study.bench import Cell
from glossy.study.settings import parse_method

BASELINE = "regular/paper"
LONG = "a_very_long_name_of_a_panorama_of_the_old_town_hall_at_night_16k.hdr, cube map 512"


def timed(cells: list[Cell], **changes: Any) -> list[Cell]:
    """The cells with times, each method slower than the one before."""
    methods = list(dict.fromkeys(c.method for c in cells))
    return [
        dataclasses.replace(
            c,
            cpu_ratio=c.samples * (1.0 + 0.1 * methods.index(c.method)),
            cpu_seconds=1e-3 * c.samples,
            pixels=100,
            **changes,
        )
        for c in cells
    ]


def several(cases: int, methods: int) -> list[Cell]:
    return timed(
        [
            cell(f"iso {k}", f"method-{m}/footprint/variant", n, 0.1 / n + 0.01 * m, bias_kind=kind)
            for k in range(cases)
            for m in range(methods)
            for n, kind in itertools.product((7, 14, 30), ("zero", "best"))
        ]
    )


# --- plots ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("cases", "methods"), [(1, 1), (1, 4), (1, 12), (2, 4), (4, 2)])
def test_every_word_of_the_plot_is_inside_it(
    cases: int, methods: int, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(plots, "_save", lambda figure, path: drawn.append(figure))
    plots.speed_against_error(several(cases, methods), tmp_path / "speed.png", LONG)
    (figure,) = drawn
    figure.canvas.draw()
    (legend,) = figure.legends
    panels = [axes.get_tightbbox() for axes in figure.axes]
    shown = [text.get_window_extent() for text in figure.texts]
    for box in (legend.get_window_extent(), *shown, *panels):
        assert box.x0 >= 0.0
        assert box.y0 >= 0.0
        assert box.x1 <= figure.bbox.x1
        assert box.y1 <= figure.bbox.y1
    assert legend.get_window_extent().y1 <= min(box.y0 for box in panels)
    assert [t.get_text() for t in legend.get_texts()][-2:] == ["best bias", "bias 0"]


def test_no_two_methods_look_alike() -> None:
    looks = [tuple(plots._style(k).values()) for k in range(49)]
    assert len(set(looks)) == 49


def test_the_times_of_one_marker_are_not_spread_over_the_plot(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(plots, "_save", lambda figure, path: drawn.append(figure))
    both = [cell("iso", "split-sum", 1, 0.1, bias_kind=kind) for kind in ("zero", "best")]
    one = [dataclasses.replace(c, cpu_ratio=r) for c, r in zip(timed(both), (1, 1.01), strict=True)]
    plots.speed_against_error(one, tmp_path / "speed.png", "one")
    low, high = drawn[0].axes[0].get_xlim()
    assert high / low == pytest.approx(2.0)


# --- tables ---------------------------------------------------------------------------------------


def test_no_line_of_the_tables_is_longer_than_the_width() -> None:
    budgets = (7, 14, 20, 30, 50, 70, 100, 140, 200, 270, 400, 600, 1000)
    cells = timed(
        [
            cell("iso", method, n, 0.3 / n, bias_kind=kind)
            for method in ("regular/jacobian/projected", "importance")
            for n, kind in itertools.product(budgets, ("zero", "best"))
        ]
    )
    for text in (report.error_table(cells), report.time_table(cells)):
        assert max(len(line) for line in text.splitlines()) <= report.WIDTH
    rows = [x.split() for x in report.error_table(cells).splitlines() if "samples" in x]
    assert [int(n) for row in rows for n in row[1:]] == list(budgets)
    found = claims.evaluate(table(1.4, 2.0))
    lines = report.claim_lines(found).splitlines()
    assert max(map(len, lines)) <= report.WIDTH
    assert " ".join(" ".join(lines).split()) == " ".join(
        f"{c.verdict.upper()} {c.statement} [{c.source}] {c.numbers}" for c in found
    )


# --- claims ---------------------------------------------------------------------------------------


def upto(most: int, kind: str = "") -> dict[str, claims.Claim]:
    """The claims on budgets up to ``most``, of one kind of lobe."""
    cells = [c for c in table(1.4, 2.0) if c.budget <= most and c.case.startswith(kind)]
    return {c.id: c for c in claims.evaluate(cells)}


def test_claims_about_270_samples_are_not_tested_with_fewer() -> None:
    found = upto(14)
    for id in ("c1-zero", "c1-best", "c2-zero", "c2-best"):
        assert (found[id].verdict, found[id].numbers) == (
            claims.UNTESTED,
            "needs a budget of 270 or more",
        )
        assert "270" in found[id].statement
    assert found["d1"].numbers == found["d3"].numbers == "needs budgets of 14, 30 and 270"
    assert found["f-best"].numbers == "needs a budget of 20"
    assert found["a-iso-zero"].verdict == found["g"].verdict.replace("does not hold", "holds")
    whole = upto(270)
    assert claims.UNTESTED not in {c.verdict for c in whole.values()}
    assert upto(100)["d1"].verdict == claims.UNTESTED


def test_claims_without_their_lobes_say_which() -> None:
    found = upto(7, kind="iso")
    wanted = {
        "a-aniso-zero": "needs an anisotropic lobe",
        "b-best": "needs an anisotropic lobe",
        "c2-zero": "needs an anisotropic lobe and a budget of 270 or more",
        "e-importance-zero": "needs two budgets",
        "g": "needs a budget of 14",
    }
    for id, words in wanted.items():
        assert (found[id].verdict, found[id].numbers) == (claims.UNTESTED, words)


# --- help -----------------------------------------------------------------------------------------


def test_the_help_names_methods_that_are_read_and_defaults_that_are_used() -> None:
    commands = build_parser()._subparsers._group_actions[0].choices  # type: ignore[union-attr]
    text = commands["study"].format_help()  # type: ignore[index]
    lines = text.split("A method is ")[1].split("\n\n")[0].splitlines()[1:]
    named = [word for line in lines for word in line.split("    ")]
    for pattern in [word.split()[0] for word in named if re.match(r" *[a-z-]+(/|$)", word)]:
        parts = [part.split("|") for part in pattern.split("/")]
        for names in itertools.product(*parts):
            assert parse_method("/".join(names)).label == "/".join(names)
    assert "default 7,14,20,30,50,100,270" in " ".join(text.split())
    for name in ("material", "width", "height", "methods", "samples", "repeats", "resume"):
        assert f"--{name}" in text
