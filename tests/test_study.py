"""The study: its figures, its bias search, what it keeps when interrupted, and the claims."""

import csv
import dataclasses
import itertools
import json
import math
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import tolerances
from hypothesis import given
from hypothesis import strategies as st

from glossy import metrics, shade
from glossy.cli import build_parser
from glossy.environment import environment
from glossy.materials import parse_material
from glossy.pattern import pattern_for_budget
from glossy.planning.auto import planned
from glossy.pyramid import build_pyramid
from glossy.reference import reference
from glossy.scene import Sphere, default_camera, surface_points
from glossy.study import claims, commandline
from glossy.study.bench import Cell
from glossy.study.commandline import with_errors
from glossy.study.measure import COARSE, Judge, best_bias
from glossy.study.run import Study
from glossy.study.settings import Plan, case_of, default_cases, parse_method, threshold_for

# --- settings -------------------------------------------------------------------------------------


def test_thresholds_are_the_papers_at_its_counts() -> None:
    assert [threshold_for(n) for n in (7, 14, 17, 20)] == [0.2] * 4
    assert [threshold_for(n) for n in (21, 30, 50)] == [0.1] * 3
    assert [threshold_for(n) for n in (100, 270)] == [0.01] * 2


@pytest.mark.parametrize(
    "text",
    [
        "regular",
        "regular/thesis",
        "regular/jacobian/projected",
        "importance",
        "thesis/paper/4.24",
        "auto/.1",
    ],
)
def test_methods_are_read_as_they_are_written(text: str) -> None:
    assert parse_method(text).label == text


@pytest.mark.parametrize("text", ["magic", "regular/x", "regular/paper/x", "regular/paper/4.24",
                                  "thesis/thesis/paper", "a/b/c/d", "", "auto/2",
                                  "auto/x"])  # fmt: skip
def test_unknown_methods_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="must be"):
        parse_method(text)


def test_the_default_cases_are_the_papers() -> None:
    cases = default_cases()
    assert [c.widths for c in cases] == [[0.1, 0.1], [0.15, 0.15], [0.2, 0.075]]
    assert [c.kind for c in cases] == ["iso", "iso", "aniso"]
    assert len({c.slug for c in cases}) == 3


def test_a_case_leaves_the_diffuse_part_out() -> None:
    case = case_of(parse_material("kd=.5,mx=.1"))
    assert case.material.kd == 0.0
    assert case.material.reflection[0].widths == (0.1, 0.1)


# --- measure --------------------------------------------------------------------------------------


@pytest.fixture
def judge() -> Judge:
    seen = np.ones((8, 10), dtype=bool)
    seen[0, :3] = False
    rng = np.random.default_rng(5)
    return Judge(rng.uniform(0.1, 3.0, (int(seen.sum()), 3)), seen)


def test_figures_are_those_of_the_metrics(judge: Judge) -> None:
    image = judge.truth + np.random.default_rng(6).normal(0.0, 0.2, judge.truth.shape)
    figures = judge.figures(image)
    expected = metrics.compare(image[None], judge.truth[None], peak=judge.peak)
    for name in ("rms", "relative_rms", "psnr", "peak"):
        value = pytest.approx(getattr(expected, name), rel=tolerances.ROUNDOFF)
        assert getattr(figures, name) == value
    assert figures.max_error == pytest.approx(expected.max_abs, rel=tolerances.ROUNDOFF)


def test_spread_is_the_share_of_the_pixels_that_carry_the_error(judge: Judge) -> None:
    count = len(judge.truth)
    for bad in (1, 7, count):
        image = judge.truth.copy()
        image[:bad] += 0.5
        share = judge.figures(image).spread
        assert share == pytest.approx(bad / count, rel=tolerances.ROUNDOFF)


def test_roughness_tells_smooth_errors_from_noise() -> None:
    seen = np.ones((120, 120), dtype=bool)
    truth = np.ones((seen.size, 3))
    judge = Judge(truth, seen)
    noise = np.random.default_rng(7).normal(size=truth.shape)
    assert judge.figures(truth + 0.3).roughness == pytest.approx(0.0, abs=tolerances.ROUNDOFF)
    assert judge.figures(truth + noise).roughness == pytest.approx(1.0, abs=0.02)  # 5 sigma
    sign = (-1.0) ** np.add.outer(np.arange(120), np.arange(120)).ravel()
    assert judge.figures(truth + sign[:, None]).roughness == pytest.approx(math.sqrt(2.0))


def test_dark_bias_is_the_excess_over_the_darker_half() -> None:
    seen = np.ones((1, 4), dtype=bool)
    judge = Judge(np.array([[1.0] * 3, [2.0] * 3, [8.0] * 3, [9.0] * 3]), seen)
    image = judge.truth + np.array([[0.3], [0.3], [-5.0], [5.0]])
    assert judge.figures(image).dark_bias == pytest.approx(0.6 / 3.0)


def test_a_perfect_image_has_no_psnr(judge: Judge) -> None:
    figures = judge.figures(judge.truth)
    assert (figures.rms, figures.psnr, figures.spread, figures.roughness) == (0.0, None, 0.0, 0.0)


@given(st.floats(-4.0, 3.0), st.floats(0.1, 5.0), st.floats(0.0, 1.0))
def test_the_best_bias_is_found_within_a_fiftieth(low: float, steep: float, floor: float) -> None:
    """Also beyond the coarse grid, and where the two sides rise differently."""

    def error(b: float) -> float:
        return floor + steep * (b - low) ** 2 * (1.0 if b < low else 1.6)

    bias, tried = best_bias(error)
    assert abs(bias - low) < 0.05
    assert (bias, error(bias)) in tried
    assert error(bias) == min(value for _, value in tried)
    assert len(tried) <= len(COARSE) + 12


def test_the_lowest_of_several_valleys_is_taken() -> None:
    bias, _ = best_bias(lambda b: min((b + 2.0) ** 2 + 0.1, (b - 1.0) ** 2))
    assert abs(bias - 1.0) < 0.05


# --- run and resume -------------------------------------------------------------------------------


def study(folder: pathlib.Path, resume: bool = False, **changes: Any) -> Study:
    """Two lobes, two methods, two budgets on a picture of 12 x 12."""
    values: dict[str, Any] = {
        "cases": [case_of(parse_material(text)) for text in ("mx=.2", "mx=.3,my=.15")],
        "methods": [parse_method("regular/paper"), parse_method("importance")],
        "budgets": (7, 14),
        "repeats": 1,
        "subset": 30,
        **changes,
    }
    points = surface_points(default_camera(Sphere(), 12, 12), Sphere())
    return Study(Plan(**values), environment("studio", 16), points, "studio", folder, resume)


ERRORS = (
    "case", "method", "budget", "samples", "bias_kind", "bias", "rms", "relative_rms", "psnr",
    "max_error", "spread", "roughness", "dark_bias", "truth_error", "search",
)  # fmt: skip


def errors(cells: list[Cell]) -> list[list[Any]]:
    """What does not depend on time."""
    return [[getattr(cell, name) for name in ERRORS] for cell in cells]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Study:
    result = study(tmp_path_factory.mktemp("study"))
    result.run()
    return result


def test_every_cell_is_measured(finished: Study) -> None:
    names = ["iso m=0.2", "aniso (0.3, 0.15)"], ["regular/paper", "importance"]
    wanted = list(itertools.product(*names, (7, 14), ("zero", "best")))
    assert [(c.case, c.method, c.budget, c.bias_kind) for c in finished.cells] == wanted
    for cell in finished.cells:
        assert min(cell.seconds, cell.cpu_seconds, cell.ns_per_sample, cell.cpu_ratio) > 0.0
        assert cell.bias == 0.0 or cell.bias_kind == "best"


def test_auto_is_measured_once_for_each_error_with_the_taps_it_takes(
    tmp_path: pathlib.Path,
) -> None:
    arguments = ["study", "-o", "x", "--methods", "importance, auto", "--max-error", ".3, .03"]
    args = build_parser().parse_args(arguments)
    specs = [parse_method(name) for name in with_errors(args.methods.split(","), args)]
    assert [spec.label for spec in specs] == ["importance", "auto/.3", "auto/.03"]
    lobe = case_of(parse_material("mx=.3,my=.15"))
    made = study(tmp_path / "s", cases=[lobe], methods=specs[1:])
    rough, fine = made.run()
    pyramid = made.bench.prepared(lobe, specs[2])
    assert fine.taps == planned(lobe.material, pyramid, 0.03, points=made.bench.points).samples
    assert (rough.budget, rough.bias_kind, rough.samples) == (1, "zero", sum(rough.taps))
    assert rough.samples < fine.samples
    assert fine.relative_rms < min(rough.relative_rms, 0.03)
    args.methods = "importance"
    with pytest.raises(ValueError, match="--max-error: is for auto among --methods"):
        with_errors(["importance"], args)


def test_a_cell_is_shade_against_reference(finished: Study) -> None:
    cell = next(c for c in finished.cells if c.method == "importance" and c.budget == 14)
    material = parse_material("mx=.2")
    cube, points = finished.bench.cube, finished.bench.points
    truth = reference(points, material, cube, tolerance=finished.plan.tolerance)
    count = len(pattern_for_budget(material.reflection[0], 14, 0.2))
    image = shade(points, material, build_pyramid(cube), method="importance", samples=count)
    assert cell.samples == count
    assert cell.rms == pytest.approx(metrics.rms(image[None], truth.radiance[None]), rel=1e-6)
    bound = float(np.sqrt(np.mean(truth.error**2)))
    assert cell.truth_error == pytest.approx(bound, rel=tolerances.ROUNDOFF)


def test_the_best_bias_is_never_worse_than_none(finished: Study) -> None:
    for zero, best in zip(finished.cells[::2], finished.cells[1::2], strict=True):
        assert best.rms <= zero.rms


def test_all_methods_of_a_budget_take_the_same_count(finished: Study) -> None:
    for case, budget in itertools.product({c.case for c in finished.cells}, (7, 14)):
        counts = {c.samples for c in finished.cells if (c.case, c.budget) == (case, budget)}
        assert len(counts) == 1


def test_an_interrupted_study_continues_to_the_same_numbers(
    tmp_path: pathlib.Path, finished: Study
) -> None:
    def cut(steps: list[Any]) -> Iterator[Any]:
        yield from steps[:7]
        raise KeyboardInterrupt

    broken = study(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        broken.run(cut)
    kept = {p: p.read_bytes() for p in (tmp_path / "cells").iterdir()}
    assert len(kept) == 6  # one step was a truth
    resumed = study(tmp_path, resume=True)
    resumed.run()
    assert errors(resumed.cells) == errors(finished.cells)
    assert all(path.read_bytes() == content for path, content in kept.items())
    assert [c.session for c in resumed.cells] == [0] * 6 + [1] * 10


def test_a_study_is_not_overwritten_nor_mixed_with_another(finished: Study) -> None:
    folder = finished.store.folder
    with pytest.raises(ValueError, match="--resume continues it"):
        study(folder)
    with pytest.raises(ValueError, match=r"other settings \(.*budgets"):
        study(folder, resume=True, budgets=(7, 20))


def test_a_failed_write_leaves_nothing(finished: Study, tmp_path: pathlib.Path) -> None:
    store = study(tmp_path).store
    with pytest.raises(ValueError, match="JSON"):
        store.put("cell", {"value": math.inf})
    assert not list((tmp_path / "cells").iterdir())


def test_what_is_written(finished: Study) -> None:
    folder = finished.store.folder
    variants = commandline.evaluate(finished)
    names = commandline.finish(finished, variants)
    value = json.loads((folder / "study.json").read_text())
    assert (value["schema"], value["command"]) == (1, "study")
    assert value["cells"] == [dataclasses.asdict(c) for c in finished.cells]
    assert value["sessions"][0]["numpy"] == np.__version__
    assert set(value["claims"]) == {"regular/paper"}
    with (folder / "study.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [float(r["rms"]) for r in rows] == [c.rms for c in finished.cells]
    report = (folder / "report.md").read_text()
    for name in [*names, "speed.png"]:
        assert (folder / name).read_bytes().startswith(b"\x89PNG")
        assert f"({name})" in report
    assert len(names) == 4
    for claim in variants["regular/paper"]:
        assert claim.statement in report
    assert not [p for p in folder.iterdir() if p.name.startswith(".")]


# --- claims ---------------------------------------------------------------------------------------


def cell(case: str, method: str, budget: int, rms: float, **changes: Any) -> Cell:
    """A made-up cell; ``kind`` follows from the first letter of the case."""
    values: dict[str, Any] = {f.name: 0.0 for f in dataclasses.fields(Cell)}
    values |= {
        "case": case,
        "kind": "aniso" if case.startswith("a") else "iso",
        "widths": [0.15, 0.15],
        "method": method,
        "budget": budget,
        "samples": budget,
        "taps": [budget],
        "bias_kind": "zero",
        "rms": rms,
        "relative_rms": rms,
        "truth_level": 1.0,
        **changes,
    }
    return Cell(**values)


def table(iso: float, aniso: float, truth_error: float = 0.0, fall: float = 0.5) -> list[Cell]:
    """Regular has error n^-fall, importance that times ``iso`` or ``aniso``."""
    cells = []
    for case, factor in (("iso", iso), ("aniso", aniso)):
        for n, kind in itertools.product((7, 14, 20, 30, 50, 100, 270), ("zero", "best")):
            common = {"bias_kind": kind, "truth_error": truth_error}
            cells.append(cell(case, "regular/paper", n, n**-fall, **common))
            cells.append(cell(case, "importance", n, factor * n**-fall, **common))
    return cells


def verdicts(cells: list[Cell]) -> dict[str, str]:
    """Verdict by the claim's id."""
    return {c.id: c.verdict for c in claims.evaluate(cells)}


def test_claims_hold_where_the_paper_would_be_right() -> None:
    found = verdicts(table(iso=1.4, aniso=2.0))
    for id, kind in itertools.product(("a-iso", "a-aniso", "b", "c1", "c2", "f"), ("zero", "best")):
        assert found[f"{id}-{kind}"] == "holds"
    assert found["d1"] == "holds"
    assert found["e-regular/paper-zero"] == found["e-importance-best"] == "holds"


def test_claims_do_not_hold_where_it_would_be_wrong() -> None:
    found = verdicts(table(iso=0.5, aniso=0.4, fall=-0.1))
    for id in ("a-iso-zero", "a-aniso-best", "b-zero", "c1-best", "c2-zero", "d1", "f-best"):
        assert found[id] == "does not hold"
    assert found["e-regular/paper-zero"] == "does not hold"


def test_a_difference_below_the_truths_error_is_uncertain() -> None:
    found = verdicts(table(iso=1.01, aniso=1.02, truth_error=0.01))
    for id in ("a-iso-zero", "a-aniso-zero", "b-zero", "c2-best", "d1", "f-zero"):
        assert found[id] == "within uncertainty"


def test_one_failure_fails_a_claim() -> None:
    cells = [
        dataclasses.replace(c, rms=0.1 * c.rms)
        if (c.case, c.method, c.budget, c.bias_kind) == ("iso", "importance", 30, "zero")
        else c
        for c in table(iso=1.4, aniso=2.0)
    ]
    found = {c.id: c for c in claims.evaluate(cells)}
    assert found["a-iso-zero"].verdict == "does not hold"
    assert found["a-iso-zero"].numbers.startswith("lower in 3 of 4 ")
    assert found["a-iso-best"].verdict == "holds"


def test_claims_without_cells_are_not_tested() -> None:
    assert set(verdicts([])) == set(verdicts(table(1.4, 2.0)))
    only_iso = [c for c in table(1.4, 2.0) if c.kind == "iso"]
    found = verdicts(only_iso)
    assert found["a-aniso-zero"] == found["b-best"] == found["c2-zero"] == "not tested"
    assert found["a-iso-zero"] == "holds"


def test_the_shape_of_the_error_is_judged() -> None:
    cells = [
        dataclasses.replace(
            c,
            spread=0.4 if c.method == "importance" else 0.2,
            roughness=0.3 if c.method == "importance" else 0.6,
            dark_bias=0.5 if c.method == "importance" else 0.1,
        )
        for c in table(1.4, 2.0)
    ]
    found = verdicts(cells)
    assert found["d2"] == found["d3"] == found["g"] == "holds"
    swapped = [
        dataclasses.replace(c, spread=-c.spread, roughness=-c.roughness, dark_bias=-c.dark_bias)
        for c in cells
    ]
    found = verdicts(swapped)
    assert found["d2"] == found["d3"] == found["g"] == "does not hold"


@given(st.floats(0.2, 1.5), st.floats(7.5, 260.0))
def test_samples_needed_inverts_a_power_law(fall: float, count: float) -> None:
    line = [cell("iso", "importance", n, n**-fall) for n in (7, 14, 30, 270)]
    assert claims.samples_needed(line, count**-fall) == pytest.approx(count)
    assert claims.samples_needed(line, 2.0) == 7.0
    assert claims.samples_needed(line, 1e-9) is None
