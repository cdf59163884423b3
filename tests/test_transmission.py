"""Light from below: transmission lobes in every method, diffuse transmission, kd that falls off."""

import json
import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import tolerances
from plain_truth import over_texels, points

import glossy
from glossy import CubeMap, Lobe, Material, SurfacePoints, methods
from glossy.albedo import lobe_albedo
from glossy.cubemap import texel_directions
from glossy.energy import energy, interpolated_albedo
from glossy.frames import spherical
from glossy.materials import material_from_dict, material_to_dict, parse_material

Array = npt.NDArray[np.float64]

FROSTED = Material(
    reflection=[Lobe(0.2, r0=0.04)], transmission=[Lobe(0.25, 0.15, ks=0.8, r0=0.04)]
)
FOIL = Material(
    0.5, [Lobe(0.2, r0=0.1, ks=0.6)], diffuse_transmission=[0.2, 0.3, 0.1], kd_falloff=True
)
DENSE: dict[str, tuple[dict[str, Any], float]] = {
    "regular": (
        {"samples": 600, "threshold": 1e-4, "normalisation": "projected"},
        tolerances.DENSE_TRANSMISSION,
    ),
    "importance": ({"samples": 600}, tolerances.DENSE_TRANSMISSION),
    "thesis": ({"samples": 21}, tolerances.THESIS_TRANSMISSION),
}
"""Options under which a method comes closest to the truth, and how close that is."""


def soft_map(size: int = 16) -> CubeMap:
    """Radiance that changes slowly and differs on all sides."""
    d = texel_directions(size)
    d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    return CubeMap(1.5 + d @ np.array([[0.5, -0.4, 0.3], [0.6, 0.5, -0.2], [-0.3, 0.4, 0.6]]))


@pytest.mark.parametrize("method", DENSE)
@pytest.mark.parametrize("side", ["transmission", "both"])
def test_dense_samples_tend_to_the_truth_below_the_surface(method: str, side: str) -> None:
    cube = soft_map()
    pyramid = glossy.build_pyramid(cube, filter="box")
    material = FROSTED if side == "both" else Material(transmission=FROSTED.transmission)
    p = points(3, 12, lowest=0.3)
    options, limit = DENSE[method]
    shaded = glossy.shade(p, material, pyramid, method=method, precision="double", **options)
    truth = glossy.reference(p, material, cube).radiance
    assert glossy.relative_rms(shaded, truth) < limit
    mirrored = SurfacePoints(-p.normal, p.tangent, p.view - 2.0 * _up(p))
    other_side = glossy.reference(mirrored, material, cube).radiance
    assert glossy.relative_rms(shaded, other_side) > 1.5 * limit


def _up(p: SurfacePoints) -> Array:
    return np.asarray(np.sum(p.view * p.normal, axis=-1, keepdims=True) * p.normal)


@pytest.mark.parametrize("method", ["regular", "importance"])
def test_vectorised_and_plain_loop_agree_on_transmission(method: str) -> None:
    cube = soft_map()
    pyramid = glossy.build_pyramid(cube)
    p = points(4, 40)
    fast, plain = (
        glossy.shade(p, FROSTED, pyramid, method=method, kernel=k) for k in ("auto", "plain")
    )
    np.testing.assert_allclose(fast, plain, rtol=20.0 * tolerances.SINGLE)


# --- diffuse transmission -------------------------------------------------------------------------


def test_diffuse_transmission_is_the_diffuse_reflection_of_the_other_side() -> None:
    cube = glossy.environment("spots", size=16)
    p = points(5, 8)
    below = SurfacePoints(-p.normal, p.tangent, p.view - 2.0 * _up(p))
    through = glossy.reference(p, Material(diffuse_transmission=0.4), cube, tolerance=1e-6)
    back = glossy.reference(below, Material(0.4), cube, tolerance=1e-6)
    np.testing.assert_allclose(through.radiance, back.radiance, rtol=tolerances.IRRADIANCE)
    e = glossy.irradiance(cube, -p.normal)
    np.testing.assert_allclose(through.radiance, 0.4 / math.pi * e, rtol=1e-4)  # its bound


@pytest.mark.parametrize("falloff", [False, True])
def test_every_estimator_and_a_plain_sum_agree_on_the_foil(falloff: bool) -> None:
    material = Material(
        0.5, FOIL.reflection, diffuse_transmission=FOIL.diffuse_transmission, kd_falloff=falloff
    )
    cube = soft_map(8)
    p = points(6, 4, lowest=0.15)
    texels = glossy.reference(p, material, cube, tolerance=1e-5)
    for k in range(4):
        plain = over_texels(p[k], material, cube, 400)
        np.testing.assert_allclose(plain, texels.radiance[k], rtol=tolerances.MIDPOINT_400)
    for estimator in ("mc", "qmc"):
        drawn = glossy.reference(p, material, cube, estimator, samples=8192, seed=2)
        z = (drawn.radiance - texels.radiance) / drawn.error
        assert np.abs(z).max() < tolerances.Z_MAX


@pytest.mark.parametrize("falloff", [False, True])
def test_shading_adds_the_diffuse_light_of_both_sides(falloff: bool) -> None:
    cube = soft_map()
    material = Material(
        [0.5, 0.4, 0.3],
        [Lobe(0.2, r0=0.1, ks=0.6)],
        diffuse_transmission=0.2,
        kd_falloff=falloff,
    )
    p = points(7, 12)
    light: dict[str, Any] = {
        "irradiance": glossy.irradiance(cube, p.normal),
        "irradiance_below": glossy.irradiance(cube, -p.normal),
    }
    pyramid = glossy.build_pyramid(cube)
    both = glossy.shade(p, material, pyramid, precision="double", **light)
    lobes = Material(reflection=material.reflection)
    glossy_part = glossy.shade(p, lobes, pyramid, precision="double")
    truth = glossy.reference(p, material, cube).radiance - glossy.reference(p, lobes, cube).radiance
    np.testing.assert_allclose(both - glossy_part, truth, rtol=2e-3)
    with pytest.warns(UserWarning, match="no irradiance_below was given"):
        glossy.shade(p, material, pyramid, irradiance=light["irradiance"])


def test_a_picture_takes_the_light_of_both_sides(tmp_path: Any) -> None:
    from glossy.render import render_reference, render_scene
    from glossy.scene import Camera, EnvironmentSource, Scene

    camera = Camera(width=12, height=12)
    scene = Scene(EnvironmentSource("sky", 16), "kd=.3,diffuse_transmission=.4", camera=camera)
    shown, truth = render_scene(scene), render_reference(scene)
    assert glossy.relative_rms(shown.image[shown.seen], truth.image[shown.seen]) < 0.01
    one_sided = Scene(EnvironmentSource("sky", 16), "kd=.3", camera=camera)
    assert glossy.rms(render_scene(one_sided).image, truth.image) > 0.05


def test_sampling_a_foil_has_the_density_it_says() -> None:
    """The pdf integrates to 1, and draws fall below as often as it says."""
    wo = spherical(0.8, 0.3)
    theta = (np.arange(400) + 0.5) * math.pi / 400
    phi = (np.arange(400) + 0.5) * 2.0 * math.pi / 400
    t, f = np.meshgrid(theta, phi, indexing="ij")
    area = np.sin(t) * (math.pi / 400) * (2.0 * math.pi / 400)
    pdf = FOIL.pdf(spherical(t, f), wo)
    assert np.sum(pdf * area) == pytest.approx(1.0, abs=1e-3)
    xi = np.random.default_rng(0).uniform(1e-9, 1.0, (20000, 2))
    below = np.mean(FOIL.sample(xi, wo)[:, 2] < 0.0)
    expected = float(np.sum((pdf * area)[theta > 0.5 * math.pi]))
    assert below == pytest.approx(expected, abs=4.0 * math.sqrt(0.25 / 20000))


# --- kd that falls off ----------------------------------------------------------------------------


@pytest.mark.parametrize("falloff", [False, True])
def test_albedo_is_the_integral_of_the_bsdf_over_either_side(falloff: bool) -> None:
    material = Material(
        0.6,
        [Lobe(0.3, 0.4, r0=0.1)],
        [Lobe(0.5, ks=0.3, r0=0.1)],
        diffuse_transmission=0.2,
        kd_falloff=falloff,
    )
    cells = 500
    theta = (np.arange(2 * cells) + 0.5) * math.pi / (2 * cells)
    phi = (np.arange(cells) + 0.5) * 2.0 * math.pi / cells
    t, f = np.meshgrid(theta, phi, indexing="ij")
    area = np.sin(t) * np.abs(np.cos(t)) * (math.pi / (2 * cells)) * (2.0 * math.pi / cells)
    for view in (spherical(0.2, 1.0), spherical(1.2, 0.4)):
        sums = material.eval(spherical(t, f), view) * area
        up, down = material.albedo(view)
        assert sums[:cells].sum() == pytest.approx(float(up), rel=1e-4)
        assert sums[cells:].sum() == pytest.approx(float(down), rel=1e-4)


def test_with_falloff_diffuse_and_lobes_never_send_out_more_than_arrives() -> None:
    lobes = ([Lobe(0.2, r0=0.3)], [Lobe(0.3, ks=0.8, r0=0.3)])
    given = energy(Material(0.7, *lobes, diffuse_transmission=0.3))
    shared = energy(Material(0.7, *lobes, diffuse_transmission=0.3, kd_falloff=True))
    assert not given.conserved
    assert given.largest > 1.5
    assert shared.conserved
    assert shared.largest <= 1.0


@pytest.mark.parametrize(
    ("lobe", "limit"),
    [(Lobe(0.02), 5e-6), (Lobe(0.5, r0=0.04), 5e-6), (Lobe(0.2, 0.05, r0=0.1, alpha=0.5), 1e-5)],
)
@pytest.mark.parametrize("transmitted", [False, True])
def test_interpolated_albedos_are_the_exact_ones(
    lobe: Lobe, limit: float, transmitted: bool
) -> None:
    rng = np.random.default_rng(1)
    cos = np.exp(rng.uniform(math.log(0.01), 0.0, 40))
    wo = spherical(np.arccos(cos), rng.uniform(-math.pi, math.pi, 40))
    exact = lobe_albedo(lobe, wo, transmitted)
    np.testing.assert_allclose(interpolated_albedo(lobe, wo, transmitted), exact, atol=limit)


def test_falloff_darkens_the_rim_and_leaves_the_middle() -> None:
    falling = Material(0.76, [Lobe(0.13, r0=0.03, alpha=0.5)], kd_falloff=True)
    share = falling.diffuse_share(spherical([0.0, math.radians(80.0)], 0.0))
    assert share is not None
    assert share[0, 0] == pytest.approx(0.97, abs=0.002)
    assert share[1, 0] < 0.75
    assert Material(0.76).diffuse_share([0.0, 0.0, 1.0]) is None


# --- parameters -----------------------------------------------------------------------------------


def test_a_line_and_a_table_describe_the_foil() -> None:
    line = parse_material("mx=.2,ks=.6,r0=.1,kd=.5,diffuse_transmission=.2/.3/.1,kd_falloff=1")
    assert line == Material(0.5, [Lobe(0.2, ks=0.6, r0=0.1)], (), [0.2, 0.3, 0.1], kd_falloff=True)
    alone = parse_material("diffuse_transmission=.2")
    assert alone == Material(diffuse_transmission=0.2)
    plain = json.loads(json.dumps(material_to_dict(line)))
    assert material_from_dict(plain) == line


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("kd_falloff=2", "kd_falloff: must be 0 or 1"),
        ("diffuse_transmission=-1", "diffuse_transmission: must be finite and >= 0"),
    ],
)
def test_bad_lines_are_refused(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_material(text)


def test_bad_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match="kd_falloff: must be True or False"):
        Material(kd_falloff=1)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"theta: must be angles in \[0, 90\)"):
        energy(Material(0.5), [90.0])


def test_the_list_of_dense_methods_is_complete() -> None:
    """A method of sample tables that is added must be verified here too."""
    from glossy.trace import TABLES

    assert set(TABLES) <= set(DENSE)
    assert set(DENSE) <= set(methods.METHODS)
