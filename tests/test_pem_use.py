"""The method "pem" by its name: in a rendered scene and in a study."""

import numpy as np
import pytest

import glossy
from glossy.render import render_scene
from glossy.scene import EnvironmentSource, Scene, Sphere, default_camera
from glossy.study.bench import Bench
from glossy.study.settings import Plan, case_of, parse_method


def scene(**options: object) -> Scene:
    return Scene(
        environment=EnvironmentSource("studio", 16),
        material="mx=.2,my=.2",
        camera=default_camera(Sphere(), 12, 10),
        method="pem",
        options=dict(options),
    )


def test_a_rendered_scene_is_its_parts() -> None:
    own = scene(filter="pem5:cos", footprint="distance", bias=0.5)
    rendering = render_scene(own)
    maps = glossy.partial_maps(own.environment.load(), filter="pem5:cos")
    image = glossy.shade(
        own.points(), own.load_material(), maps, method="pem", footprint="distance", bias=0.5
    )
    assert np.array_equal(rendering.image[rendering.seen], image[rendering.seen])
    assert rendering.samples == [1]
    with pytest.raises(ValueError, match="samples: is no option"):
        glossy.shade(own.points(), own.load_material(), maps, method="pem", samples=3)


def test_study_methods_name_footprint_and_filter() -> None:
    """The filter is the method's own, not the plan's, unless its variant names one."""
    names = ["pem", "pem/view", "pem/constant/pem5:cos"]
    specs = [parse_method(name) for name in names]
    assert [spec.label for spec in specs] == names
    assert [spec.options for spec in specs] == [
        {}, {"footprint": "view"}, {"footprint": "constant"},
    ]  # fmt: skip
    for wrong in ("pem/paper", "pem/view/magic", "regular/view"):
        with pytest.raises(ValueError, match="must be one of"):
            parse_method(wrong)
    case = case_of(scene().load_material())
    plan = Plan(cases=[case], methods=specs, budgets=[7], filter="gauss6", storage="rgba16f")
    bench = Bench(plan, glossy.environment("studio", size=8), scene().points())
    maps = [bench.prepared(case, spec) for spec in specs]
    assert [m.filter for m in maps] == ["pem5:sqrtcos", "pem5:sqrtcos", "pem5:cos"]
    assert maps[0] is maps[1]
    assert {m.storage for m in maps} == {"rgba16f"}
    assert [budget for _, budget, _ in bench.wanted[case.name]] == [1] * 6
