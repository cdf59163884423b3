"""Glossiness, cosine lobes, and the level that stands for them."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import glossy
from glossy.cubemap import texel_directions, texel_solid_angles
from glossy.frames import normalise
from glossy.pem.cosine import cosine_radiance
from glossy.pem.glossiness import (
    Impulses,
    calibrate,
    circles,
    exponent,
    glossiness,
    lobe_volume,
    places,
)
from glossy.pem.lobe_error import lobe_error

FloatArray = npt.NDArray[np.floating]

FILTERS = ["box", "pem5:box", "pem5:gauss", "pem5:sqrtcos"]
MIDPOINT = 2e-3
"""Midpoint sums over texels of a lobe a few texels wide."""
VOLUME = 0.02
"""Sums over 64 circles of a bilinear bump some texels wide, and over another grid of it."""


@given(st.floats(0.0, 1.0, exclude_max=True))
def test_glossiness_and_exponent_are_inverse(g: float) -> None:
    assert glossiness(exponent(g)) == pytest.approx(g, abs=1e-15)
    assert exponent([0.0, 0.5, 1.0]).tolist() == [1.0, 2.0, np.inf]
    assert glossiness(np.inf) == 1.0


def test_refusals() -> None:
    for call in (exponent, glossiness):
        with pytest.raises(ValueError, match="must be"):
            call(-0.1)
    with pytest.raises(ValueError, match=r"^exponent: must be above -1"):
        calibrate("box", 4).level(-1.0)
    with pytest.raises(ValueError, match=r"^size: must be a power of two"):
        calibrate("box", 12)
    with pytest.raises(ValueError, match=r"^filter: must be one of"):
        calibrate("cos", 8)
    white = glossy.environment("white", size=4)
    for direction, power, refine in (([0, 0, 0], 1.0, 1), ([0, 0, 1], 0.0, 1), ([0, 0, 1], 1.0, 0)):
        with pytest.raises(ValueError, match="must"):
            cosine_radiance(white, direction, power, refine=refine)


@given(st.floats(1.0, 300.0), st.integers(0, 99))
def test_quadrature_about_an_axis(s: float, seed: int) -> None:
    """The volume 2 pi/(s + 1) of eq. (1), about any axis."""
    axis = normalise(np.random.default_rng(seed).normal(size=(1, 3)))
    angle, directions, weights = circles(axis, np.pi, 200, 4)
    assert np.allclose(directions[0] @ axis[0], np.cos(angle))
    lobe = np.maximum(np.cos(angle), 0.0) ** s
    assert lobe @ weights == pytest.approx(float(lobe_volume(s)), rel=MIDPOINT)


def test_cosine_lobe_in_closed_form() -> None:
    """A constant map, one white texel, linearity, and refinement's own sum."""
    rng = np.random.default_rng(0)
    d = rng.normal(size=(7, 3))
    constant = glossy.CubeMap(np.full((6, 64, 64, 3), 0.5))
    for s in (1.0, 4.5, 60.0):
        value = cosine_radiance(constant, d, s)
        assert np.allclose(value, 0.5 * lobe_volume(s), rtol=MIDPOINT)
    faces = np.zeros((6, 8, 8, 3))
    faces[2, 3, 5] = 1.0, 2.0, 3.0
    white = normalise(texel_directions(8)[2, 3, 5])
    expected = np.maximum(normalise(d) @ white, 0.0)[:, None] ** 3.0 * [1.0, 2.0, 3.0]
    expected *= texel_solid_angles(8)[3, 5]
    assert np.allclose(cosine_radiance(glossy.CubeMap(faces), d, 3.0), expected, atol=1e-12)
    other = rng.random((6, 8, 8, 3))
    parts = [cosine_radiance(glossy.CubeMap(f), d, 3.0) for f in (faces, other, faces + other)]
    assert np.allclose(parts[0] + parts[1], parts[2], rtol=1e-6)  # the sum's texels are float32
    once = cosine_radiance(glossy.CubeMap(other), d, 2.0, refine=2)
    fine = glossy.CubeMap(glossy.CubeMap(other).lookup(texel_directions(16)))
    assert np.allclose(once, cosine_radiance(fine, d, 2.0), rtol=1e-6)


def test_lobe_of_exponent_one_is_the_irradiance() -> None:
    cube = glossy.environment("studio", size=32)
    n = normalise(np.random.default_rng(1).normal(size=(6, 3)))
    found = cosine_radiance(cube, n, 1.0, refine=2)
    assert np.allclose(found, glossy.irradiance(cube, n), rtol=MIDPOINT)


@pytest.mark.parametrize("filter", FILTERS)
def test_volume_of_a_filtered_texel(filter: str) -> None:
    """Eq. (2) against sums over a grid of directions on the cube that shares nothing with it."""
    size, texels = 16, np.array([[4, 7, 9], [0, 2, 15], [3, 0, 0]])
    levels, volumes = Impulses(filter, size, texels).table()
    directions = texel_directions(256)
    omega = np.broadcast_to(texel_solid_angles(256), directions.shape[:-1])
    for i, texel in enumerate(texels):
        faces = np.zeros((6, size, size, 3))
        faces[tuple(texel)] = 1.0
        pyramid = glossy.build_pyramid(glossy.CubeMap(faces), filter=filter)
        for level in (0.0, 1.0, 1.75, 3.0, 4.0):
            h = pyramid.sample(directions, level)[..., 0].astype(np.float64)
            ends = {int(np.floor(level)), int(np.ceil(level))}
            tops = [pyramid.sample(texel_directions(size >> k), level).max() for k in ends]
            twin = float((h * omega).sum() / max(h.max(), *tops))
            found = float(volumes[levels == level, i][0])
            assert found == pytest.approx(twin, rel=VOLUME)


@pytest.mark.parametrize("filter", FILTERS)
def test_calibration(filter: str) -> None:
    table = calibrate(filter, 32)
    low, high = table.range
    assert np.all(np.diff(table.volumes) >= 0.0)
    assert table.level(np.inf) == 0.0
    assert table.level(2.0 * high) == 0.0
    s = np.geomspace(max(low, 0.5) * 1.01, high * 0.99, 20)
    assert np.allclose(table.exponent(table.level(s)), s, rtol=1e-6)
    assert np.all(np.diff(table.level(s)) < 0.0)
    white = places(32)
    omega = texel_solid_angles(32)[white[:, 1], white[:, 2]]
    level0 = 2.0 * np.pi / (high + 1.0)  # an unfiltered texel's bump holds its solid angle
    assert level0 == pytest.approx(np.average(omega, weights=omega), rel=2.0 * VOLUME)


def test_the_filters_reach_the_diffuse_lobe_and_box_alone_does_not() -> None:
    for filter in FILTERS[1:]:
        assert calibrate(filter, 32).range[0] < 1.0
    assert calibrate("box", 32).range[0] == pytest.approx(2.0, abs=0.02)
    assert calibrate("box", 32).level(1.0) == 5.0


@pytest.mark.parametrize("filter", ["pem5:sqrtcos"])
def test_levels_counted_from_the_top_do_not_depend_on_the_size(filter: str) -> None:
    s = np.array([1.0, 2.0, 5.0, 15.0])
    small, large = (np.log2(n) - calibrate(filter, n).level(s) for n in (32, 128))
    assert np.abs(small - large).max() < 0.06


def test_error_of_a_lobe() -> None:
    """Against sums over a grid on the cube; nothing where the chain has no such lobe."""
    size, texel = 16, [[4, 7, 9]]
    found = lobe_error("pem5:sqrtcos", size, [1.0, 8.0, 1e9], texel)
    assert found.shape == (3, 1)
    assert np.isnan(found[2, 0])
    faces = np.zeros((6, size, size, 3))
    faces[4, 7, 9] = 1.0
    pyramid = glossy.build_pyramid(glossy.CubeMap(faces), filter="pem5:sqrtcos")
    directions = texel_directions(128)
    omega = np.broadcast_to(texel_solid_angles(128), directions.shape[:-1])
    cosine = normalise(directions) @ normalise(texel_directions(size)[4, 7, 9])
    levels = np.linspace(0.0, 4.0, 41)
    for s, error in zip((1.0, 8.0), found[:, 0], strict=False):
        lobe = np.maximum(cosine, 0.0) ** s
        near = np.argmin([abs(volume(pyramid, k) - lobe_volume(s)) for k in levels])
        h = pyramid.sample(directions, levels[near])[..., 0].astype(np.float64)
        h *= float(lobe_volume(s)) / (h * omega).sum()
        twin = float((np.abs(h - lobe) * omega).sum() / lobe_volume(s))
        assert error == pytest.approx(twin, abs=0.03)  # the level is searched in steps of .1


def volume(pyramid: glossy.Pyramid, level: float) -> float:
    directions = texel_directions(64)
    h = pyramid.sample(directions, level)[..., 0].astype(np.float64)
    return float((h * texel_solid_angles(64)).sum() / h.max())
