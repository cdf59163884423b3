"""Pictures of scenes: the glue gives what its parts give, and nothing else."""

import dataclasses
import math
import pathlib

import numpy as np
import pytest
import tolerances

from glossy import shade
from glossy.brdf import Material
from glossy.gbuffer import write_gbuffer
from glossy.irradiance import irradiance
from glossy.pyramid import build_pyramid
from glossy.reference import reference
from glossy.render import render_reference, render_scene, trace_pixel
from glossy.scene import EnvironmentSource, Scene, Sphere, default_camera

SIZE = 16


def small(width: int = 12, height: int = 10, **changes: object) -> Scene:
    """A scene of a few pixels."""
    values: dict[str, object] = {
        "environment": EnvironmentSource("studio", SIZE),
        "camera": default_camera(Sphere(), width, height),
        "samples": 7,
        **changes,
    }
    return Scene(**values)  # type: ignore[arg-type]


def test_a_scene_is_its_parts() -> None:
    scene = small(options={"threshold": 0.2, "filter": "box", "bias": -0.5})
    pyramid = build_pyramid(scene.environment.load(), filter="box")
    points, material = scene.points(), scene.load_material()
    expected = shade(points, material, pyramid, samples=7, threshold=0.2, bias=-0.5)
    rendering = render_scene(scene)
    seen = points.coverage
    assert np.array_equal(rendering.image[seen], expected[seen])
    assert rendering.covered == seen.sum()
    assert rendering.samples == [7]


def test_the_thesis_method_with_its_own_options() -> None:
    scene = small(method="thesis", samples=9, options={"estimator": "4.24", "kind": "ring"})
    pyramid = build_pyramid(scene.environment.load())
    points, material = scene.points(), scene.load_material()
    expected = shade(points, material, pyramid, "thesis", samples=9, estimator="4.24", kind="ring")
    rendering = render_scene(scene)
    assert np.array_equal(rendering.image[points.coverage], expected[points.coverage])
    assert rendering.samples == [9]
    found = trace_pixel(scene, 6, 4)
    assert found.difference <= tolerances.SINGLE * max(found.trace.radiance)


def test_background_is_the_environment_at_level_0_or_black() -> None:
    scene = small()
    camera, seen = scene.view(), scene.points().coverage
    assert camera is not None
    there = scene.environment.load().lookup(camera.rays()[~seen])
    assert np.array_equal(render_scene(scene).image[~seen], there.astype(np.float32))
    black = render_scene(dataclasses.replace(scene, background="black")).image
    assert not black[~seen].any()
    assert np.array_equal(black[seen], render_scene(scene).image[seen])


def test_the_diffuse_term_is_kd_over_pi_times_irradiance() -> None:
    without, with_kd = (
        render_scene(small(background="black", material=f"mx=.3,kd={kd}")).image for kd in (0, 0.6)
    )
    scene = small()
    points, cube = scene.points(), scene.environment.load()
    expected = 0.6 / math.pi * irradiance(cube, points.normal)
    seen = points.coverage
    error = np.abs(with_kd - without - expected)[seen].max()
    assert error < tolerances.IRRADIANCE_MAP * expected[seen].max()


def test_a_gbuffer_stands_for_shape_and_camera(tmp_path: pathlib.Path) -> None:
    scene = small(background="black")
    write_gbuffer(tmp_path / "points.npz", scene.points())
    again = dataclasses.replace(scene, gbuffer=str(tmp_path / "points.npz"), camera=None)
    assert np.array_equal(render_scene(again).image, render_scene(scene).image)


def test_a_foreign_option_is_refused_before_any_work() -> None:
    with pytest.raises(ValueError, match=r"^footprint: is no option of method 'importance'"):
        render_scene(small(method="importance", options={"footprint": "paper"}))


def test_reference_of_a_scene_carries_its_error() -> None:
    scene = small(8, 8, background="black")
    rendering = render_reference(scene, tolerance=1e-2)
    points = scene.points()
    truth = reference(points, scene.load_material(), scene.environment.load(), tolerance=1e-2)
    seen = points.coverage
    assert np.array_equal(rendering.image[seen], truth.radiance[seen])
    assert not rendering.error[~seen].any()
    assert rendering.error_kind == "bound"
    rms = float(np.sqrt(np.mean(np.square(truth.error[seen]))))
    assert rendering.rms_error == pytest.approx(rms, rel=tolerances.ROUNDOFF)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_a_traced_pixel_is_the_rendered_one(precision: str) -> None:
    scene = small(options={"precision": precision}, material="mx=.2,my=.075")
    traced = trace_pixel(scene, 4, 3)
    pixel = render_scene(scene).image[3, 4]
    tolerance = tolerances.SINGLE if precision == "single" else tolerances.ROUNDOFF
    assert np.abs(np.array(traced.trace.radiance) - pixel).max() <= tolerance * pixel.max()
    assert traced.difference <= tolerance * pixel.max()
    text = traced.format()
    assert text.startswith("pixel 4, 3\n")
    assert len([line for line in text.splitlines() if line.startswith("   0")]) == len(
        traced.trace.taps
    )


def test_trace_leaves_the_diffuse_part_out_without_a_warning() -> None:
    plain, diffuse = (trace_pixel(small(material=f"mx=.1,kd={kd}"), 4, 3) for kd in (0, 0.5))
    assert plain.trace.radiance == diffuse.trace.radiance


@pytest.mark.parametrize(("pixel", "words"), [((12, 0), "inside 12 x 10"), ((0, 0), "surface")])
def test_pixels_without_a_surface_are_refused(pixel: tuple[int, int], words: str) -> None:
    with pytest.raises(ValueError, match=f"^pixel: must .*{words}"):
        trace_pixel(small(), *pixel)


def test_a_material_without_lobes_is_only_diffuse(tmp_path: pathlib.Path) -> None:
    scene = small(material="kd=.5", background="black")
    assert scene.load_material() == Material(kd=0.5)
    rendering = render_scene(scene)
    assert rendering.samples == []
    assert rendering.image[scene.points().coverage].min() > 0.0
