"""Ray-cast truth of planar reflectors against albedo, quadrature, mirror rays and other draws."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import pytest

from glossy import Lobe, Material
from glossy.camera import Camera
from glossy.planar import reference_planar, reference_planar_passes
from glossy.scene import EnvironmentSource
from glossy.scenes import prepare, view
from glossy.scenes.model import AreaLight, BakeSettings, ObjectScene, SceneObject
from glossy.scenes.prepared import PreparedScene
from glossy.scenes.render import Part
from glossy.scenes.shapes import Box, Rectangle, Shape, Torus, Transform
from glossy.truth import montecarlo

Array = npt.NDArray[np.float64]
Light = Callable[[Array, Array], npt.NDArray[Any]]

CHANCE = 5.0
"""Standard errors a mean of 16 replicates may be off (t with 15 degrees): 1 of 6000 is further."""


def floor(lobe: Lobe, shape: Shape | None = None) -> SceneObject:
    """A black reflector of 4 by 4 in the plane y = 0."""
    turned = Transform(rotation=(-90.0, 0.0, 0.0))
    return SceneObject(shape or Rectangle((4.0, 4.0), True), turned, Material(0.0, [lobe]))


def glowing(shape: Shape, emission: float, **place: object) -> SceneObject:
    """A black thing that shines."""
    where = Transform(**place)  # type: ignore[arg-type]
    return SceneObject(shape, where, Material(0.0), emission=emission)


def made(
    *objects: SceneObject, lights: tuple[AreaLight, ...] = (), sky: bool = False
) -> PreparedScene:
    """A scene, and a camera that sees its first object."""
    scene = ObjectScene(
        objects,
        Camera((0.0, 1.0, 2.0), (0.0, 0.0, 0.0), fov=20.0, width=4, height=3),
        lights=lights,
        environment=EnvironmentSource("white", 8) if sky else None,
        bake=BakeSettings(2.0, 16, 0),
        supersampling=1,
    )
    return prepare(scene, cache=False)


def first(prepared: PreparedScene, every: int = 1) -> Part:
    """The reflector's part of the view, thinned out."""
    (part,) = view(prepared).parts
    return dataclasses.replace(part, rays=part.rays[::every], points=part.points[::every])


def deviations(found: Array, truth: npt.NDArray[Any], error: Array) -> Array:
    """Deviations in standard errors; what has none must be exact to rounding."""
    return np.asarray(np.abs(found - truth) / np.maximum(error, 1e-9 * np.abs(truth)))


def over_grid(part: Part, lobe: Lobe, light: Light, cells: int = 200) -> Array:
    """Plain quadrature (K,) over the hemisphere, midpoints in cos(theta) and phi, float64."""
    z = (np.arange(cells) + 0.5) / cells
    phi = (np.arange(2 * cells) + 0.5) * (np.pi / cells)
    r = np.sqrt(1.0 - z * z)
    wi = np.stack(np.broadcast_arrays(r[:, None] * np.cos(phi), r[:, None] * np.sin(phi),
                                      z[:, None]), axis=-1)  # fmt: skip
    weight = z[:, None] * (2.0 * np.pi / phi.size / cells)
    p = part.points
    assert p.position is not None
    out = []
    for k in range(len(part.rays)):
        f = lobe.eval(wi, np.broadcast_to(p.local_view[k], wi.shape))
        axes = np.stack([p.tangent[k], p.bitangent[k], p.normal[k]])
        seen = light(p.position[k], wi @ axes)
        out.append(np.sum(f * weight * seen))
    return np.array(out)


@pytest.mark.parametrize("lobe", [Lobe(0.02), Lobe(0.3, 0.1, r0=0.5), Lobe(0.5, alpha=0.5)])
def test_white_surroundings_give_the_albedo(lobe: Lobe) -> None:
    prepared = made(floor(lobe), sky=True)
    part = first(prepared)
    truth = reference_planar(prepared, part, samples=2048)
    albedo, _ = part.material.albedo(part.points.local_view)
    assert np.all(deviations(truth.radiance[:, 0], albedo, truth.error[:, 0]) < CHANCE)
    assert np.all(truth.error < 2e-3 * truth.radiance)


def test_half_a_space_that_shines_against_quadrature() -> None:
    lobe = Lobe(0.4)
    wall = glowing(Rectangle((4e4, 4e4)), 1.0, position=(1.5, 0.0, 0.0), rotation=(0.0, -90.0, 0.0))
    prepared = made(floor(lobe), wall)
    part = first(prepared, 4)
    truth = reference_planar(prepared, part, samples=4096)
    exact = over_grid(part, lobe, lambda x, w: w[..., 0] > 0.0)
    away = np.abs(truth.radiance[:, 0] - exact)
    assert np.all(away < CHANCE * truth.error[:, 0] + 4e-3)  # the edge of the grid's cells
    assert truth.samples.max() == 4096  # no lights, so every evaluation is a draw of the lobe


@pytest.mark.parametrize("as_light", [False, True])
def test_a_panel_behind_a_box_against_quadrature(as_light: bool) -> None:
    lobe = Lobe(0.3)
    place = {"position": (0.0, 0.9, -1.5), "rotation": (20.0, 0.0, 0.0)}
    size = (1.6, 1.2)
    if as_light:
        light = AreaLight(size, 3.0, Transform(**place))
        shining: dict[str, object] = {"lights": (light,)}
        things = []
    else:
        shining = {}
        things = [glowing(Rectangle(size, True), 3.0, **place)]
    box = glowing(Box((0.3, 0.9, 0.2)), 0.0, position=(0.15, 0.45, -0.8))
    prepared = made(floor(lobe), *things, box, **shining)  # type: ignore[arg-type]
    part = first(prepared, 4)
    truth = reference_planar(prepared, part, samples=4096)
    low, high = np.array([0.0, 0.0, -0.9]), np.array([0.3, 0.9, -0.7])
    turn = np.deg2rad(20.0)
    up, out = np.array([0, np.cos(turn), np.sin(turn)]), np.array([0, -np.sin(turn), np.cos(turn)])
    centre = np.array(place["position"])

    def light_of(x: Array, w: Array) -> npt.NDArray[Any]:
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = np.sort(np.stack([(low - x) / w, (high - x) / w]), axis=0)
            enter, leave = sides[0].max(axis=-1), sides[1].min(axis=-1)
            t = (centre - x) @ out / (w @ out)
        hit = x + np.where(np.isfinite(t), t, 0.0)[..., None] * w - centre
        inside = (np.abs(hit[..., 0]) < 0.8) & (np.abs(hit @ up) < 0.6) & (t > 0) & (w @ out < 0)
        lit = inside & ~((enter < leave) & (leave > 0) & (enter < t))
        return np.where(lit, 3.0, 0.0)

    exact = over_grid(part, lobe, light_of)
    assert exact.max() > 0.1
    away = np.abs(truth.radiance[:, 0] - exact)
    assert np.all(away < CHANCE * truth.error[:, 0] + 0.01 * exact.max())  # edges across cells


def test_a_lobe_like_a_mirror_is_the_mirror_ray() -> None:
    wall = SceneObject(
        Rectangle((6.0, 6.0)), Transform((0.0, 0.0, -2.0)), Material(0.8), emission=0.5
    )
    box = glowing(Box((0.4, 0.5, 0.4)), 2.0, position=(0.2, 0.25, -0.7))
    lobe = Lobe(1e-5)
    prepared = made(floor(lobe), wall, box)
    part = first(prepared)
    truth = reference_planar(prepared, part, samples=256)
    p = part.points
    assert p.position is not None
    mirrored = 2.0 * p.local_view[:, 2:] * p.normal - p.view
    seen = prepared.world.along(p.position, mirrored, skip=0)
    assert len(np.unique(seen.round(3))) > 1  # both the wall and the box
    share = p.local_view[:, 2:]  # f cos / pdf of the mirror direction, for r0 = 1
    np.testing.assert_allclose(truth.radiance, share * seen, rtol=1e-4)


def test_a_small_lamp_is_found() -> None:
    """Draws of the lobe alone would meet one in 10^4 of its weight."""
    lamp = AreaLight((0.01, 0.01), 1000.0, Transform((0.0, 1.0, -1.0), rotation=(90.0, 0.0, 0.0)))
    prepared = made(floor(Lobe(0.3)), lights=(lamp,))
    part = first(prepared)
    truth = reference_planar(prepared, part, samples=256)
    p = part.points
    assert p.position is not None
    away = np.array([0.0, 1.0, -1.0]) - p.position
    square = np.sum(away**2, axis=-1)
    wi = away / np.sqrt(square)[:, None]
    local = np.stack([np.sum(wi * a, axis=-1) for a in (p.tangent, p.bitangent, p.normal)], -1)
    f = Lobe(0.3).eval(local, p.local_view)
    point = 1000.0 * 1e-4 * f * local[:, 2] * wi[:, 1] / square
    np.testing.assert_allclose(truth.radiance[:, 0], point, rtol=0.02)  # a point stands for it
    assert np.all(truth.error < 0.01 * truth.radiance)


@pytest.fixture(scope="module")
def mixed() -> PreparedScene:
    """Sky, two lights and a box about a wide lobe."""
    box = SceneObject(Box((0.4, 0.6, 0.4)), Transform((0.2, 0.3, -0.6)), Material(0.5))
    lights = (
        AreaLight((0.5, 0.5), 4.0, Transform((0.0, 2.0, -1.0), rotation=(90.0, 0.0, 0.0))),
        AreaLight((0.1, 0.4), 40.0, Transform((-1.0, 0.5, -1.5), rotation=(0.0, 30.0, 0.0))),
    )
    return made(floor(Lobe(0.2, 0.1)), box, lights=lights, sky=True)


def test_both_estimators_agree_within_their_errors(mixed: PreparedScene) -> None:
    part = first(mixed)
    a = reference_planar(mixed, part, samples=2048)
    b = reference_planar(mixed, part, "mc", samples=8192, seed=3)
    apart = np.abs(a.radiance - b.radiance) / np.hypot(a.error, b.error)
    assert apart.max() < CHANCE
    assert np.sqrt(np.mean(apart**2)) > 0.4  # the errors are not inflated


def test_a_tolerance_is_met_and_passes_end_at_the_truth(mixed: PreparedScene) -> None:
    part = first(mixed)
    truths = list(reference_planar_passes(mixed, part, tolerance=5e-3))
    used = [int(t.samples.max()) for t in truths]
    assert used == [64 * 2**k for k in range(1, len(used) + 1)]

    def relative(t: object) -> float:
        return float(np.sqrt(np.mean(t.error**2) / np.mean(t.radiance**2)))  # type: ignore[attr-defined]

    assert relative(truths[-1]) <= 5e-3 < relative(truths[-2])
    last = reference_planar(mixed, part, samples=used[-1])
    np.testing.assert_array_equal(truths[-1].radiance, last.radiance)


def test_a_point_has_its_bits_whatever_else_is_asked(
    mixed: PreparedScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = first(mixed)
    whole = reference_planar(mixed, part, samples=256)
    some = dataclasses.replace(part, rays=part.rays[:5], points=part.points[:5])
    monkeypatch.setattr(montecarlo, "CHUNK", 300)
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        few = reference_planar(mixed, some, samples=256)
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(few.radiance, whole.radiance[:5])
    np.testing.assert_array_equal(few.error, whole.error[:5])


def test_what_cannot_be_cast_is_refused(mixed: PreparedScene) -> None:
    part = first(mixed)
    with pytest.raises(ValueError, match="estimator: must be one of qmc, mc, got 'texels'"):
        reference_planar(mixed, part, "texels")
    with pytest.raises(ValueError, match="samples: must be at least 2"):
        reference_planar(mixed, part, samples=1)
    ring = made(floor(Lobe(0.2), Torus(0.5, 0.4)), sky=True)
    with pytest.raises(ValueError, match="part: must be of a convex shape, got 'Torus'"):
        reference_planar(ring, first(ring))
