"""Plans: what they promise is kept on maps that had no part in the calibration."""

import json
import sys
from typing import Any

import numpy as np
import pytest

import glossy
from glossy import cli, methods
from glossy.planning import auto as planning_auto
from glossy.planning.probe import sphere_views

SIZE = 64


@pytest.fixture(scope="module")
def pyramid() -> glossy.Pyramid:
    return glossy.build_pyramid(glossy.environment("spots", size=SIZE), filter="round")


def relative(a: Any, b: Any) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2)))


def test_errors_asked_for_are_kept_on_unseen_maps() -> None:
    """Nine of ten is the promise; of 24 cases three may miss (more has a chance of 0.2)."""
    rng = np.random.default_rng(5)
    missed, cases = [], 0
    for name in ("spots", "studio"):
        cube = glossy.environment(name, size=SIZE)
        pyramid = glossy.build_pyramid(cube, filter="round")
        for k in range(4):
            m, ratio = 0.05 * 8.0 ** rng.random(), 4.0 ** rng.random()
            lobe = glossy.Lobe(m * ratio**0.5, m / ratio**0.5)
            points = sphere_views(1, 200, 100 + k)
            truth = glossy.reference(points, lobe, cube, tolerance=3e-3).radiance
            for goal in (0.05, 0.1, 0.2):
                found = glossy.plan(lobe, pyramid, max_error=goal, filters=())
                assert found.reached
                assert found.bound <= goal
                picture = glossy.shade(points, lobe, pyramid, method="auto", max_error=goal)
                cases += 1
                if relative(picture, truth) > goal:
                    missed.append((name, lobe, goal))
    assert cases == 24
    assert len(missed) <= 3, missed


def test_a_mirror_takes_one_tap(pyramid: glossy.Pyramid) -> None:
    found = glossy.plan(glossy.Lobe(1e-4), pyramid, max_error=0.02)
    assert found.samples == [1]
    assert found.reached


def test_a_lobe_that_cannot_matter_takes_none(pyramid: glossy.Pyramid) -> None:
    strong, weak = glossy.Lobe(0.3), glossy.Lobe(0.02, ks=1e-3)
    found = glossy.plan(glossy.Material(reflection=[strong, weak]), pyramid, max_error=0.1)
    assert found.samples[0] > 0
    assert found.samples[1] == 0
    assert any("left out" in reason for reason in found.reasons)


def test_a_smaller_error_never_costs_less(pyramid: glossy.Pyramid) -> None:
    material = glossy.Material(
        reflection=[glossy.Lobe(0.2, 0.05)], transmission=[glossy.Lobe(0.1, ks=0.4, r0=0.04)]
    )
    goals = (0.02, 0.05, 0.1, 0.2, 0.4)
    plans = [glossy.plan(material, pyramid, max_error=goal, filters=()) for goal in goals]
    costs = [found.cost for found in plans if found.reached]
    assert len(costs) >= 3
    assert costs == sorted(costs, reverse=True)
    assert costs[0] > costs[-1]


def test_auto_shades_by_the_plan(pyramid: glossy.Pyramid) -> None:
    """Two lobes: the sum of what the planned methods give, to float32's rounding of a sum."""
    a, b = glossy.Lobe(0.3, 0.1), glossy.Lobe(0.05, ks=0.5)
    material = glossy.Material(reflection=[a, b])
    points = sphere_views(1, 50, 3)
    found = glossy.plan(material, pyramid, max_error=0.1, filters=())
    assert {row.method for row in found.lobes} == {"lattice"}
    parts = [
        glossy.shade(points, lobe, pyramid, method="lattice", samples=row.samples)
        for lobe, row in zip((a, b), found.lobes, strict=True)
    ]
    shown = glossy.shade(points, material, pyramid, method="auto", max_error=0.1)
    np.testing.assert_allclose(shown, sum(parts), rtol=1e-6)
    double = glossy.shade(
        points, material, pyramid, method="auto", max_error=0.1, precision="double"
    )
    assert double.dtype == np.float64
    np.testing.assert_allclose(shown, double, rtol=1e-3, atol=1e-5)


def test_a_plan_is_kept_until_the_map_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    pyramid = glossy.build_pyramid(glossy.environment("white", size=16))
    lobe = glossy.Material(reflection=[glossy.Lobe(0.2)])
    made = []
    plan = glossy.plan

    def counted(*args: Any, **options: Any) -> Any:
        made.append(args)
        return plan(*args, **options)

    monkeypatch.setattr(planning_auto, "plan", counted)
    first = planning_auto.planned(lobe, pyramid, 0.1)
    assert planning_auto.planned(lobe, pyramid, 0.1) is first
    assert len(made) == 1
    pyramid.update(glossy.environment("axes", size=16))
    planning_auto.planned(lobe, pyramid, 0.1)
    assert len(made) == 2


def test_a_filter_is_chosen_and_building_it_counts() -> None:
    pyramid = glossy.build_pyramid(glossy.environment("spots", size=SIZE), filter="box")
    free = glossy.plan(glossy.Lobe(0.15), pyramid, max_error=0.1)
    assert free.filter != "box"  # its taps are the least round
    few = glossy.plan(glossy.Lobe(0.15), pyramid, max_error=0.1, pixels=100)
    assert few.cost > free.cost
    chain = glossy.Pyramid(pyramid.levels)
    assert glossy.plan(glossy.Lobe(0.15), chain, max_error=0.1).filter == "as given"


def test_nothing_to_see_takes_nothing(pyramid: glossy.Pyramid) -> None:
    assert glossy.plan(glossy.Material(kd=0.5), pyramid).method == "none"
    black = glossy.build_pyramid(glossy.CubeMap(np.zeros((6, 8, 8, 3))))
    assert glossy.plan(glossy.Lobe(0.1), black).samples == [0]


def test_what_cannot_be_reached_is_said(pyramid: glossy.Pyramid) -> None:
    found = glossy.plan(glossy.Lobe(0.4), pyramid, max_error=1e-6, filters=())
    assert not found.reached
    assert found.bound > found.max_error
    assert "least bound" in found.reasons[-1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"max_error": 0.0}, "max_error: must be in"),
        ({"max_error": 1.0}, "max_error: must be in"),
        ({"max_error": "x"}, "max_error: must be a number"),
        ({"filters": ["sharp"]}, "filters: must be one of"),
        ({"pixels": 0}, "pixels: must be at least 1"),
    ],
)
def test_errors_are_one_line(
    pyramid: glossy.Pyramid, arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message) as stop:
        glossy.plan(glossy.Lobe(0.1), pyramid, **arguments)
    assert "\n" not in str(stop.value)


def test_auto_refuses_what_it_does_not_have(pyramid: glossy.Pyramid) -> None:
    points = sphere_views(1, 4, 1)
    with pytest.raises(ValueError, match="samples: is no option of method 'auto'"):
        glossy.shade(points, glossy.Lobe(0.1), pyramid, method="auto", samples=3)
    with pytest.raises(ValueError, match="pyramid: must be a Pyramid"):
        glossy.shade(points, glossy.Lobe(0.1), None, method="auto")
    assert methods.options("auto") == {"max_error": 0.05}


def test_the_commands(
    capsys: pytest.CaptureFixture[str], tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False)
    words = ["--env", "studio", "--size", "32", "--material", "mx=.2", "--max-error", ".1"]
    assert cli.main(["plan", *words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["schema"] == 1
    assert found["lobes"][0]["samples"] == found["samples"][0]
    assert cli.main(["plan", *words]) == 0
    assert "- lobe 0" in capsys.readouterr().out
    picture = str(tmp_path / "out.exr")
    words += ["--width", "16", "--height", "16", "--filter", found["filter"]]
    assert cli.main(["render", *words, "--method", "auto", "--json", "-o", picture]) == 0
    assert json.loads(capsys.readouterr().out)["samples"] == found["samples"]
    assert cli.main(["plan", "--max-error", "2"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
