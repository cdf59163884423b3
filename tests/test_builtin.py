"""The built-in environments: the same map at every size, with the power they state."""

import itertools
import math

import numba
import numpy as np
import pytest
import tolerances

import glossy
from glossy import builtin
from glossy.cubemap import texel_directions, texel_solid_angles
from glossy.layouts import area_resize


@pytest.mark.parametrize("name", builtin.NAMES)
def test_every_size_shows_the_same_map(name: str) -> None:
    large = glossy.environment(name, size=240)
    for size in (1, 6, 48):
        small = glossy.environment(name, size=size)
        np.testing.assert_allclose(small.power(), large.power(), rtol=1e-5)
        expected = area_resize(large.faces, size)
        error = np.abs(small.faces - expected)
        assert error.max() < tolerances.COVERED_SHARE * expected.max()
        assert error.mean() < tolerances.COVERED_SHARE * expected.mean()


@pytest.mark.parametrize("name", builtin.NAMES)
def test_same_bits_again_and_for_any_number_of_threads(name: str) -> None:
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = glossy.environment(name, size=32)
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(one.faces, glossy.environment(name, size=32).faces)
    assert one.faces.min() > 0.0


@pytest.mark.parametrize("radius", [0.265, 1.0, 5.0, 30.0])
@pytest.mark.parametrize("size", [1, 3, 16, 100])
def test_a_disc_has_its_power_and_its_place(radius: float, size: int) -> None:
    """Centred on a face, an edge, a corner and between: L 2 pi (1 - cos r), nothing outside."""
    for d in ([0.0, 1, 0], [1.0, 1, 0], [1.0, 1, 1], [-0.3, 0.2, -1]):
        centre = np.array(d) / np.linalg.norm(d)
        disc = builtin.Disc(centre, math.radians(radius), np.array([1.0, 2.0, 3000.0]))
        faces = np.zeros((6, size, size, 3), dtype=np.float32)
        builtin.add_disc(faces, disc)
        power = np.einsum("frcx,rc->x", faces.astype(np.float64), texel_solid_angles(size))
        expected = disc.radiance * (2 * math.pi * (1 - math.cos(disc.radius)))
        np.testing.assert_allclose(power, expected, rtol=tolerances.CONVERTED_POWER)
        axes = texel_directions(size)
        cosine = axes @ centre / np.linalg.norm(axes, axis=-1)
        angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        reach = math.degrees(math.sqrt(2.0) / size)
        assert not faces[angle > radius + reach].any()
        inside = faces[angle < radius - reach] / disc.radiance
        assert np.abs(inside - 1.0).max(initial=0.0) < tolerances.COVERED_SHARE


def test_spots_are_the_demanding_case() -> None:
    discs = builtin.spot_discs()
    diameters = [math.degrees(2 * d.radius) for d in discs]
    levels = [float(d.radiance.max()) for d in discs]
    assert len(discs) == 48
    assert 2.0 <= min(diameters) < 3.0
    assert 7.0 < max(diameters) <= 10.0
    assert max(levels) == pytest.approx(3000.0)
    assert min(levels) >= 30.0
    assert len({tuple(np.round(d.radiance / d.radiance.max(), 3)) for d in discs}) == 48
    for a, b in itertools.combinations(discs, 2):
        assert math.acos(float(a.centre @ b.centre)) > a.radius + b.radius
    cube = glossy.environment("spots", size=256)
    dim = np.median(cube.faces)
    assert 0.1 < dim < 1.5
    assert cube.faces.max() > 1500.0 * dim
    assert np.ptp(cube.faces[cube.faces < 3.0]) > dim  # the background has structure


def test_another_seed_is_another_arrangement() -> None:
    assert [d.radius for d in builtin.spot_discs(1)] != [d.radius for d in builtin.spot_discs(2)]
    one, two = (glossy.environment("spots", size=16, seed=s).faces for s in (1, 2))
    assert np.abs(one - two).max() > 30.0


def test_the_sun_carries_its_power() -> None:
    sun = builtin.sun()
    assert math.degrees(2 * sun.radius) == pytest.approx(0.53)
    assert np.linalg.norm(sun.centre) == pytest.approx(1.0, abs=1e-12)
    for size in (4, 128):
        cube = glossy.environment("sky", size=size)
        d = texel_directions(size)
        at = np.unravel_index((d @ sun.centre / np.linalg.norm(d, axis=-1)).argmax(), d.shape[:3])
        assert cube.faces[at][1] > 20.0
    horizontal = np.maximum(d[..., 1] / np.linalg.norm(d, axis=-1), 0.0)
    omega = texel_solid_angles(size)
    below = np.minimum(cube.faces[..., 1], 5.0)  # without the sun
    sky = float((below * horizontal * omega).sum())
    direct = float(sun.radiance[1]) * 2 * math.pi * (1 - math.cos(sun.radius))
    assert 3.0 < direct / sky < 7.0


def test_white_is_exactly_one() -> None:
    assert np.array_equal(glossy.environment("white", size=3).faces, np.ones((6, 3, 3, 3)))


def test_axes_have_a_colour_and_a_direction_each() -> None:
    faces = glossy.environment("axes", size=48).faces
    colours = [tuple(np.round(f[30, 3], 3)) for f in faces]
    assert len(set(colours)) == 6
    for face, strongest in zip((0, 2, 4), (0, 1, 2), strict=True):  # +X red, +Y green, +Z blue
        assert faces[face].mean(axis=(0, 1)).argmax() == strongest
    for face in faces:
        white, black = (face > 0.97).all(axis=-1), (face < 0.05).all(axis=-1)
        rows, columns = np.nonzero(white)  # along the top, its head to the right
        assert rows.max() < 12
        assert columns.min() < 8
        assert columns.max() > 24
        rows, columns = np.nonzero(black)  # down the left side
        assert columns.max() < 12
        assert rows.max() > 16
        assert not np.array_equal(face, face[:, ::-1])


@pytest.mark.parametrize(
    ("name", "size", "seed", "said"),
    [
        ("cave", 16, 0, "name: must be one of spots, studio, sky, white, axes, got 'cave'"),
        ("sky", 0, 0, "size: must be"),
        ("sky", 2.5, 0, "size: must be a whole number"),
        ("spots", 4, -1, "seed: must be"),
    ],
)
def test_refusals(name: str, size: int, seed: int, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        glossy.environment(name, size=size, seed=seed)
