"""Plans: what they promise is kept, on whatever is shaded."""

import concurrent.futures
import dataclasses
import json
import sys
from typing import Any

import numpy as np
import pytest

import glossy
from glossy import cli, frames, methods
from glossy._threads import using
from glossy.planning import auto as planning_auto
from glossy.planning import views
from glossy.planning.plan import Plan

SIZE = 64


@pytest.fixture(scope="module")
def pyramid() -> glossy.Pyramid:
    return glossy.build_pyramid(glossy.environment("spots", size=SIZE), filter="round")


def relative(a: Any, b: Any) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2)))


def seen_at(normal: Any, theta: Any, phi: Any) -> glossy.SurfacePoints:
    """Points of normals (K, 3) seen at angles and azimuths (K,) in degrees."""
    tangent = frames.sphere_tangent(normal)
    local = frames.spherical(np.radians(theta), np.radians(phi))
    return glossy.SurfacePoints(normal, tangent, frames.to_world(local, tangent, normal))


def plane(
    seed: int, count: int = 100, low: float = 0.0, high: float = 80.0, across: float = 360.0
) -> glossy.SurfacePoints:
    """A plane seen at angles of ``low`` to ``high`` degrees."""
    rng = np.random.default_rng(seed)
    normal = np.repeat(frames.normalise(rng.normal(size=(1, 3))), count, axis=0)
    azimuth = rng.uniform(0.0, 360.0) + rng.uniform(0.0, across, count)
    return seen_at(normal, rng.uniform(low, high, count), azimuth)


def ball(seed: int, count: int = 100, low: float = 0.0) -> glossy.SurfacePoints:
    """Normals in all directions seen at angles of ``low`` to 80 degrees."""
    rng = np.random.default_rng(seed)
    normal = frames.normalise(rng.normal(size=(count, 3)))
    return seen_at(normal, rng.uniform(low, 80.0, count), rng.uniform(0.0, 360.0, count))


def half_sphere(seed: int, count: int = 100) -> glossy.SurfacePoints:
    """The half of a sphere that a distant camera sees, within 80 degrees."""
    rng = np.random.default_rng(seed)
    view = frames.normalise(rng.normal(size=(1, 3)))
    normal = frames.normalise(rng.normal(size=(8 * count, 3)))
    normal = normal[normal @ view[0] > np.cos(np.radians(80.0))][:count]
    return glossy.SurfacePoints(normal, view=np.repeat(view, len(normal), axis=0))


def pictures() -> list[glossy.SurfacePoints]:
    """Planes seen from all sides, by a camera, from afar and at a grazing angle; spheres."""
    return [
        *(plane(seed) for seed in range(3)),
        *(plane(seed, low=30.0 + 10.0 * seed, high=50.0 + 10.0 * seed, across=40.0)
          for seed in range(3)),
        plane(7, low=45.0, high=45.0, across=0.0),
        plane(8, low=60.0), ball(9, low=60.0), ball(10), half_sphere(11),
    ]  # fmt: skip


def case(name: str, lobe: glossy.Lobe) -> tuple[glossy.CubeMap, glossy.Pyramid, glossy.Material]:
    cube = glossy.environment(name, size=SIZE)
    pyramid = glossy.build_pyramid(cube, filter="round")
    return cube, pyramid, glossy.Material(reflection=[lobe])


@pytest.mark.parametrize(
    ("name", "lobe"),
    [
        ("studio", glossy.Lobe(0.1)),
        ("spots", glossy.Lobe(0.2, 0.075)),
        ("sky", glossy.Lobe(0.4)),
    ],
)
def test_errors_asked_for_are_kept_on_every_picture(name: str, lobe: glossy.Lobe) -> None:
    """Each picture's own points are measured, so that the bound is one."""
    cube, pyramid, material = case(name, lobe)
    promised = 0
    for points in pictures():
        truth = glossy.reference(points, material, cube).radiance
        for goal in (0.05, 0.1):
            found = glossy.plan(material, pyramid, max_error=goal, filters=(), points=points)
            picture = glossy.shade(points, material, pyramid, method="auto", max_error=goal)
            assert (found.bound_kind, found.points) == ("bound", len(points.normal))
            assert found.reached == (found.bound <= goal)
            assert relative(picture, truth) <= found.bound
            assert found.error == pytest.approx(relative(picture, truth), abs=1e-3)
            promised += found.reached
    assert promised >= 10


@pytest.mark.parametrize("name", ["studio", "spots"])
def test_without_points_the_bound_covers_planes_and_spheres(name: str) -> None:
    cube, pyramid, material = case(name, glossy.Lobe(0.1))
    found = glossy.plan(material, pyramid, max_error=0.1, filters=())
    assert found.bound_kind == "estimate"
    assert found.error < found.bound
    for points in pictures():
        truth = glossy.reference(points, material, cube).radiance
        picture = glossy.shade(points, material, pyramid, method="auto", plan=found)
        assert relative(picture, truth) <= found.bound


def test_of_a_large_picture_points_are_drawn() -> None:
    """Small bright parts count most, and are drawn most."""
    cube, pyramid, material = case("spots", glossy.Lobe(0.05))
    camera = glossy.Camera(position=(0.0, 0.0, 3.0), width=64, height=64)
    points = glossy.surface_points(camera, glossy.Sphere())
    seen = int(points.coverage.sum())
    assert seen > views.MOST
    truth = glossy.reference(points, material, cube, tolerance=3e-3).radiance
    for goal in (0.05, 0.1):
        found = glossy.plan(material, pyramid, max_error=goal, filters=(), points=points)
        assert (found.bound_kind, found.points) == ("estimate", views.MOST)
        picture = glossy.shade(points, material, pyramid, method="auto", max_error=goal)
        assert relative(picture[points.coverage], truth[points.coverage]) <= found.bound <= goal
        assert found.bound < 1.5 * found.error + 0.005


def test_drawn_points_weigh_what_they_stand_for(
    pyramid: glossy.Pyramid, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = ball(1, 3000)
    material = glossy.Material(reflection=[glossy.Lobe(0.2)])
    whole = views.of_picture(points, material, pyramid)
    assert not whole.complete
    assert whole.weight.mean() == pytest.approx(3000.0, rel=0.05)  # E(1/p) is the number of points
    means = [whole.weight @ np.abs(v.normal[:, 1]) / whole.weight.sum() for v in [whole.points]]
    assert means[0] == pytest.approx(np.abs(points.normal[:, 1]).mean(), abs=0.05)
    monkeypatch.setattr(views, "LOOKED_AT", 1000)
    some = views.looked_at(points)
    assert some.shape == (1000,)
    index = np.argmax(some.normal @ points.normal.T, axis=1)
    np.testing.assert_array_equal(index // 3, np.arange(1000))  # one of each run of three


def test_views_that_are_not_known_are_narrow_and_within_80_degrees(
    pyramid: glossy.Pyramid,
) -> None:
    found = views.any_views(pyramid)
    n, v = (a.reshape(-1, views.EACH, 3) for a in (found.points.normal, found.points.view))
    cosine = np.sum(n * v, axis=-1)
    assert np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).max() <= 80.0 + 1e-6
    assert cosine.min() < np.cos(np.radians(75.0))
    assert np.all(n == n[:, :1])
    between = np.sum(v * v[:, :1], axis=-1)
    assert np.degrees(np.arccos(np.clip(between, -1.0, 1.0))).max() < 30.0
    aimed = frames.reflect(v, n)[views.PLANES :, 0]
    bright = pyramid.sample(aimed, np.zeros(len(aimed))).sum(axis=-1)
    even = pyramid.sample(frames.reflect(v, n)[: views.PLANES, 0], np.zeros(views.PLANES))
    assert bright.mean() > 5.0 * even.sum(axis=-1).mean()


def test_plans_are_the_same_for_any_number_of_threads(pyramid: glossy.Pyramid) -> None:
    points = ball(2, 1500)
    found = []
    for threads in (1, 3):
        with using(threads):
            for known in (None, points):
                found.append(glossy.plan(glossy.Lobe(0.2), pyramid, filters=(), points=known))
    assert found[:2] == found[2:]


def test_a_mirror_takes_one_tap(pyramid: glossy.Pyramid) -> None:
    found = glossy.plan(glossy.Lobe(1e-4), pyramid, max_error=0.02, points=ball(4))
    assert found.samples == [1]
    assert "1 tap of lattice leaves an error" in found.reasons[0]
    assert found.reached


def test_a_lobe_that_cannot_matter_takes_none(pyramid: glossy.Pyramid) -> None:
    strong, weak = glossy.Lobe(0.3), glossy.Lobe(0.02, ks=1e-3)
    material = glossy.Material(reflection=[strong, weak])
    found = glossy.plan(material, pyramid, max_error=0.1, points=ball(4))
    assert found.samples[0] > 0
    assert found.samples[1] == 0
    assert any("left out" in reason for reason in found.reasons)


def test_a_smaller_error_never_costs_less(pyramid: glossy.Pyramid) -> None:
    material = glossy.Material(
        reflection=[glossy.Lobe(0.2, 0.05)], transmission=[glossy.Lobe(0.1, ks=0.4, r0=0.04)]
    )
    goals = (0.02, 0.05, 0.1, 0.2, 0.4)
    points = ball(3)
    plans = [
        glossy.plan(material, pyramid, max_error=goal, filters=(), points=points) for goal in goals
    ]
    costs = [found.cost for found in plans if found.reached]
    assert len(costs) >= 3
    assert costs == sorted(costs, reverse=True)
    assert costs[0] > costs[-1]
    truth = glossy.reference(points, material, glossy.environment("spots", size=SIZE)).radiance
    for found in plans:  # errors of several lobes add with their signs
        picture = glossy.shade(points, material, pyramid, method="auto", plan=found)
        assert relative(picture, truth) <= found.bound
        assert found.error == pytest.approx(relative(picture, truth), abs=1e-3)


def test_auto_shades_by_the_plan(pyramid: glossy.Pyramid) -> None:
    """Two lobes: the sum of what the planned methods give, to float32's rounding of a sum."""
    a, b = glossy.Lobe(0.3, 0.1), glossy.Lobe(0.05, ks=0.5)
    material = glossy.Material(reflection=[a, b])
    points = ball(3, 50)
    found = glossy.plan(material, pyramid, max_error=0.1, filters=(), points=points)
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


def test_parts_of_a_picture_are_shaded_by_one_plan(pyramid: glossy.Pyramid) -> None:
    lobe, points = glossy.Lobe(0.2), plane(5)
    found = glossy.plan(lobe, pyramid, max_error=0.1, filters=(), points=points)
    whole = glossy.shade(points, lobe, pyramid, method="auto", max_error=0.1)
    parts = [
        glossy.shade(points[k : k + 7], lobe, pyramid, method="auto", plan=found)
        for k in range(0, 100, 7)
    ]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    with pytest.raises(ValueError, match="plan: must be for the material's lobes"):
        glossy.shade(points, glossy.Lobe(0.1), pyramid, method="auto", plan=found)
    with pytest.raises(ValueError, match="plan: must be a Plan, got 'str'"):
        glossy.shade(points, lobe, pyramid, method="auto", plan="regular")


def test_a_plan_is_kept_until_the_map_or_the_points_change(monkeypatch: pytest.MonkeyPatch) -> None:
    pyramid = glossy.build_pyramid(glossy.environment("white", size=16))
    lobe = glossy.Material(reflection=[glossy.Lobe(0.2)])
    made = []
    plan = glossy.plan

    def counted(*args: Any, **options: Any) -> Any:
        made.append(args)
        return plan(*args, **options)

    monkeypatch.setattr(planning_auto, "make_plan", counted)
    first = planning_auto.planned(lobe, pyramid, 0.1, points=ball(1))
    assert planning_auto.planned(lobe, pyramid, 0.1, points=ball(1)) is first
    assert len(made) == 1
    pyramid.update(glossy.environment("axes", size=16))
    found = planning_auto.planned(lobe, pyramid, 0.1, points=ball(1))
    assert len(made) == 2
    assert found == plan(lobe, pyramid, max_error=0.1, filters=(), points=ball(1))
    planning_auto.planned(lobe, pyramid, 0.1, points=ball(2))
    planning_auto.planned(lobe, pyramid, 0.1)
    assert len(made) == 4
    monkeypatch.setattr(planning_auto, "KEPT", 2)
    planning_auto.planned(lobe, pyramid, 0.1, points=ball(3, 5))
    planning_auto.planned(lobe, pyramid, 0.1, points=ball(4, 5))
    planning_auto.planned(lobe, pyramid, 0.1, points=ball(1))
    assert len(made) == 7


def test_plans_are_made_from_any_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning_auto, "KEPT", 1)
    lobe = glossy.Material(reflection=[glossy.Lobe(0.2)])
    maps = [glossy.build_pyramid(glossy.environment(n, size=16)) for n in ("spots", "studio")]
    work = [(pyramid, ball(seed, 5)) for seed in range(3) for pyramid in maps]

    def found(item: tuple[glossy.Pyramid, glossy.SurfacePoints]) -> Plan:
        return planning_auto.planned(lobe, item[0], 0.1, points=item[1])

    with concurrent.futures.ThreadPoolExecutor(3) as pool:
        assert list(pool.map(found, work)) == [found(item) for item in work]


def test_a_filter_is_chosen_and_building_it_counts() -> None:
    pyramid = glossy.build_pyramid(glossy.environment("spots", size=SIZE), filter="box")
    points = ball(6)
    free = glossy.plan(glossy.Lobe(0.15), pyramid, max_error=0.1, points=points)
    assert free.filter != "box"  # its taps are the least round
    few = glossy.plan(glossy.Lobe(0.15), pyramid, max_error=0.1, pixels=100, points=points)
    assert few.cost > free.cost
    chain = glossy.Pyramid(pyramid.levels)
    assert glossy.plan(glossy.Lobe(0.15), chain, max_error=0.1).filter == "as given"


def test_nothing_to_see_takes_nothing(pyramid: glossy.Pyramid) -> None:
    assert glossy.plan(glossy.Material(kd=0.5), pyramid).method == "none"
    black = glossy.build_pyramid(glossy.CubeMap(np.zeros((6, 8, 8, 3))))
    assert glossy.plan(glossy.Lobe(0.1), black).samples == [0]
    assert glossy.plan(glossy.Lobe(0.1), black, points=ball(1, 5)).samples == [0]
    seen = ball(1, 5)
    hidden = glossy.SurfacePoints(seen.normal, view=seen.view, mask=np.zeros(5, dtype=bool))
    found = glossy.plan(glossy.Lobe(0.1), pyramid, points=hidden)
    assert (found.samples, found.bound, found.bound_kind) == ([0], 0.0, "bound")
    assert not glossy.shade(hidden, glossy.Lobe(0.1), pyramid, method="auto").any()


@pytest.mark.parametrize("ks", [3.0, (0.0, 1.0, 1.0)])
def test_a_candidate_beyond_single_precision_is_not_taken_for_right(ks: Any) -> None:
    """Their NaN compared as no error at all: a bound of .003 for what cannot be shaded."""
    faces = 3e38 * np.random.default_rng(0).random((6, 8, 8, 3))
    near = glossy.build_pyramid(glossy.CubeMap(faces.astype(np.float32)))
    lobe, points = glossy.Lobe(0.2, ks=ks), ball(1, 4)
    for seen in (points, None):
        found = glossy.plan(lobe, near, max_error=0.03, points=seen, filters=())
        if found.reached:
            image = glossy.shade(points, lobe, near, method="auto", plan=found).astype(np.float64)
            truth = glossy.reference(points, lobe, glossy.CubeMap(faces.astype(np.float32)))
            assert relative(image, truth.radiance) <= found.bound
        else:
            assert found.bound > 0.03


def test_bounding_planes_leave_an_estimate(pyramid: glossy.Pyramid) -> None:
    points, lobe = ball(1, 5), glossy.Lobe(0.1)
    planes = glossy.BoundingPlanes.box((-1, -1, -1), (1, 1, 1))
    given: dict[str, Any] = {"points": points, "filters": ()}
    free = glossy.plan(lobe, pyramid, **given)
    found = glossy.plan(lobe, pyramid, parallax=planes, **given)
    assert (free.bound_kind, found.bound_kind) == ("bound", "estimate")
    assert "bounding planes" in found.reasons[-1]
    assert (found.samples, found.bound) == (free.samples, free.bound)


def test_a_bound_without_end_is_null_in_json(pyramid: glossy.Pyramid) -> None:
    found = dataclasses.replace(glossy.plan(glossy.Lobe(0.1), pyramid, filters=()), bound=np.inf)
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["bound"] is None


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
        ({"points": [0.0, 0.0, 1.0]}, "points: must be SurfacePoints"),
    ],
)
def test_errors_are_one_line(
    pyramid: glossy.Pyramid, arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message) as stop:
        glossy.plan(glossy.Lobe(0.1), pyramid, **arguments)
    assert "\n" not in str(stop.value)


def test_auto_refuses_what_it_does_not_have(pyramid: glossy.Pyramid) -> None:
    points = ball(1, 4)
    with pytest.raises(ValueError, match="samples: is no option of method 'auto'"):
        glossy.shade(points, glossy.Lobe(0.1), pyramid, method="auto", samples=3)
    with pytest.raises(ValueError, match="must be a Pyramid"):
        glossy.shade(points, glossy.Lobe(0.1), None, method="auto")
    assert methods.options("auto") == {"max_error": 0.05, "plan": None}


def test_the_commands(
    capsys: pytest.CaptureFixture[str], tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``plan`` plans for the picture that ``render`` makes; ``trace`` traces by its plan."""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False)
    words = ["--env", "studio", "--size", "32", "--material", "mx=.2", "--shape", "plane"]
    words += ["--max-error", ".1", "--width", "16", "--height", "16"]
    assert cli.main(["plan", *words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["schema"] == 1
    assert found["bound_kind"] == "bound"
    assert found["lobes"][0]["samples"] == found["samples"][0]
    assert cli.main(["plan", *words, "--any-view", "--json"]) == 0
    wary = json.loads(capsys.readouterr().out)
    assert wary["bound_kind"] == "estimate"
    assert wary["samples"] > found["samples"]
    assert cli.main(["plan", *words]) == 0
    assert "- lobe 0" in capsys.readouterr().out
    picture = str(tmp_path / "out.exr")
    words += ["--filter", found["filter"], "--method", "auto", "--json"]
    assert cli.main(["render", *words, "-o", picture]) == 0
    assert json.loads(capsys.readouterr().out)["samples"] == found["samples"]
    assert cli.main(["trace", *words, "--pixel", "8,12"]) == 0
    traced = json.loads(capsys.readouterr().out)
    assert traced["plan"]["samples"] == found["samples"]
    np.testing.assert_array_equal(
        np.float32(traced["radiance"]), glossy.read_image(picture).pixels[12, 8]
    )
    assert cli.main(["plan", "--max-error", "2"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
