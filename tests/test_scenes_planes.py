"""Scenes of objects look up their bounding planes and refine towards their own truth."""

import copy
import dataclasses

import numpy as np
import pytest

import glossy
from glossy import Lobe, Material, methods
from glossy.camera import Camera
from glossy.converge import Limits
from glossy.scene import EnvironmentSource
from glossy.scenes.bounds import bounding_planes
from glossy.scenes.converge import converge_objects
from glossy.scenes.model import (
    BakeSettings,
    BoundingPlane,
    CaptureSettings,
    Checker,
    ObjectScene,
    SceneObject,
)
from glossy.scenes.prepared import PreparedScene, prepare
from glossy.scenes.render import reference_objects, render_objects
from glossy.scenes.shapes import Box, Sphere, Transform

CHECKER = Checker(0.05, (6.0, 6.0))


@pytest.fixture(scope="module")
def prepared() -> PreparedScene:
    """A glossy ball just above a tiled floor, under a white sky."""
    floor = SceneObject(
        Box((4.0, 0.2, 4.0)), Transform((0.0, -0.1, 0.0)), Material(0.8), checker=CHECKER
    )
    ball = SceneObject(Sphere(), Transform((0.0, 0.5, 0.0), 0.4), Material(0.1, [Lobe(0.08)]))
    scene = ObjectScene(
        (floor, ball),
        Camera((0.0, 1.0, 3.0), (0.0, 0.4, 0.0), width=12, height=12),
        environment=EnvironmentSource("white", 16),
        planes=(BoundingPlane(),),
        samples=12,
        bake=BakeSettings(0.5, 16, 1),
        capture=CaptureSettings(64, 1),
        supersampling=1,
    )
    return prepare(scene, cache=False)


def test_planes_are_about_the_place_of_capture(prepared: PreparedScene) -> None:
    planes = bounding_planes(prepared, 1)
    assert planes is not None
    np.testing.assert_allclose(planes.centre, [0.0, 0.5, 0.0], atol=1e-9)
    assert planes.planes == (((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),)


def test_the_last_estimate_is_the_one_shot_reference(prepared: PreparedScene) -> None:
    found = converge_objects(prepared, Limits(passes=3), seed=2)
    states = list(found.states)
    shown = render_objects(prepared)
    np.testing.assert_allclose(states[0].display, shown.image, rtol=1e-6)
    truth = reference_objects(prepared, "qmc", samples=states[-1].samples, seed=2)
    np.testing.assert_array_equal(states[-1].estimate, truth.image)
    np.testing.assert_array_equal(states[-1].error, truth.error)
    glossy_pixels = found.view.glossy
    assert glossy_pixels.sum() > 5
    assert np.all(states[-1].error[glossy_pixels] > 0.0)
    assert states[-1].relative_error < states[1].relative_error


def test_planes_change_the_picture_and_its_truth_alike(prepared: PreparedScene) -> None:
    open_ = prepare(dataclasses.replace(prepared.scene, planes=()), cache=False)
    shown = render_objects(prepared).image - render_objects(open_).image
    truth = reference_objects(prepared, samples=2048)
    assert truth.estimator == "qmc"  # texels cannot follow lookups that depend on the place
    change = truth.image - reference_objects(open_, "qmc", samples=2048).image
    assert glossy.rms(change, 0.0 * change) > 0.02
    assert glossy.rms(shown, change) < 0.5 * glossy.rms(change, 0.0 * change)


@pytest.mark.parametrize("method", sorted(methods.PLANES))
def test_every_method_shows_the_ball_on_its_floor(prepared: PreparedScene, method: str) -> None:
    """All of them are nearer to the truth over the planes than they are without."""
    scene = prepared.scene
    truth = reference_objects(prepared, samples=512).image
    errors = []
    for planes in (scene.planes, ()):
        shown = copy.copy(prepared)
        shown.scene = dataclasses.replace(scene, planes=planes, method=method, samples=20)
        pictured = render_objects(shown).image
        errors.append(glossy.relative_rms(pictured, truth))
    assert errors[0] < 0.5 * errors[1]
