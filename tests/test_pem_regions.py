"""Median cut of a cube map into regions."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import glossy
from glossy.pem.regions import LINES, LUMINANCE, Regions, regions

FloatArray = npt.NDArray[np.floating]

SUMS = 1e-9
"""float64 sums of some thousand texels, differences of sums over a whole face."""


def weighed(cube: glossy.CubeMap) -> FloatArray:
    return np.asarray(np.maximum(cube.faces @ LUMINANCE, 0.0) * cube.solid_angles())


def random_cube(seed: int, size: int, contrast: float) -> glossy.CubeMap:
    rng = np.random.default_rng(seed)
    return glossy.CubeMap(rng.random((6, size, size, 3)) ** contrast)


def check_partition(found: Regions, cube: glossy.CubeMap, count: int) -> None:
    """Every texel in exactly one region, and what each region says of itself, by its label."""
    assert len(found) == count
    assert np.all(np.bincount(found.face) == count // 6)
    cover = np.zeros_like(found.labels)
    for i in range(count):
        cover[found.box(i)] += 1
        assert np.all(found.labels[found.box(i)] == i)
    assert np.all(cover == 1)
    omega = np.broadcast_to(cube.solid_angles(), found.labels.shape)
    for name, value in (("solid_angle", omega), ("importance", weighed(cube))):
        sums = np.bincount(found.labels.ravel(), value.ravel())
        assert np.allclose(sums, getattr(found, name), rtol=SUMS, atol=SUMS * sums.max())
    for c in range(3):
        light = cube.faces[..., c] * omega
        sums = np.bincount(found.labels.ravel(), light.ravel())
        assert np.allclose(sums, found.power[:, c], rtol=SUMS, atol=SUMS * abs(sums).max())
    assert found.solid_angle.sum() == pytest.approx(4.0 * np.pi)


@given(
    st.integers(0, 2**31),
    st.integers(1, 20),
    st.integers(1, 40),
    st.sampled_from([0.0, 1.0, 8.0, 100.0]),
)
def test_regions_are_a_partition_of_equal_importance(
    seed: int, size: int, parts: int, contrast: float
) -> None:
    """On flat maps, on noise and on lamps; the bound is that of the module."""
    cube, per_face = random_cube(seed, size, contrast), min(parts, size * size)
    found = regions(cube, 6 * per_face)
    check_partition(found, cube, 6 * per_face)
    for face, light in enumerate(weighed(cube)):
        heaviest = max(light.sum(axis=0).max(), light.sum(axis=1).max())
        miss = np.abs(found.importance[found.face == face] - light.sum() / per_face)
        assert miss.max() <= LINES * heaviest + SUMS


@pytest.mark.parametrize("name", ["spots", "sky", "white"])
@pytest.mark.parametrize("count", [6, 12, 48, 192])
def test_halving_leaves_less_than_a_line(name: str, count: int) -> None:
    """Powers of two: halves of a line, over one, two, four, ... regions, are less than one."""
    cube = glossy.environment(name, size=64)
    found = regions(cube, count)
    for face, light in enumerate(weighed(cube)):
        heaviest = max(light.sum(axis=0).max(), light.sum(axis=1).max())
        miss = np.abs(found.importance[found.face == face] - 6.0 * light.sum() / count)
        assert miss.max() < heaviest


def test_black_regions_are_cut_in_the_middle_and_point_to_their_centre() -> None:
    faces = np.zeros((6, 8, 8, 3))
    faces[4, 2, 5] = 1.0
    cube = glossy.CubeMap(faces)
    found = regions(cube, 24)
    check_partition(found, cube, 24)
    black = found.face != 4
    assert np.all(np.diff(found.rows[black]) == 4)
    assert np.all(np.diff(found.columns[black]) == 4)
    assert np.all(found.power[black] == 0.0)
    centre = found.direction[0]  # the quarter of +x with y > 0 and z > 0
    assert centre[1] == pytest.approx(centre[2])
    assert 0.4 < centre[1] / centre[0] < 0.5
    lit = np.flatnonzero(found.importance > 0.0)
    assert len(lit) == 1
    texel = np.array([3.0 / 8.0, 3.0 / 8.0, 1.0])
    assert np.allclose(found.direction[lit[0]], texel / np.linalg.norm(texel))


def test_a_lamp_gets_small_regions_and_the_dark_a_few_large_ones() -> None:
    cube = glossy.environment("spots", size=64)
    found = regions(cube, 96)
    bright = found.power.sum(axis=1) / found.solid_angle
    order = np.argsort(bright)
    assert found.solid_angle[order[-10:]].max() < found.solid_angle[order[:10]].min()
    assert np.allclose(np.linalg.norm(found.direction, axis=1), 1.0)


@pytest.mark.parametrize("count", [0, 5, 20, 6 * 16 + 6, 6.0])
def test_refused_counts(count: int) -> None:
    cube = glossy.environment("white", size=4)
    with pytest.raises(ValueError, match=r"^count: must"):
        regions(cube, count)
