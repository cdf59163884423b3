"""Irradiance against plain sums, closed forms and the diffuse truth."""

import numpy as np
import numpy.typing as npt
import plain_truth
import pytest
import tolerances

import glossy
from glossy import CubeMap, Material
from glossy.cubemap import texel_directions


def normals(count: int, seed: int = 0) -> npt.NDArray[np.float64]:
    return plain_truth.unit(np.random.default_rng(seed).normal(size=(count, 3)))


@pytest.mark.parametrize("size", [1, 2, 5, 32])
def test_a_white_map_gives_pi(size: int) -> None:
    e = glossy.irradiance(CubeMap(np.ones((6, size, size, 3))), normals(20))
    assert e == pytest.approx(np.full((20, 3), np.pi), rel=tolerances.IRRADIANCE)


def test_a_linear_sky_gives_its_closed_form() -> None:
    """L = 1 + a.w has E = pi + 2 pi/3 a.n; texels of 1/64 follow it to 1e-4."""
    a = np.array([0.3, -0.5, 0.2])
    d = plain_truth.unit(texel_directions(128))
    cube = CubeMap(np.repeat((1.0 + d @ a)[..., None], 3, axis=-1))
    n = normals(20)
    expected = np.pi + 2.0 * np.pi / 3.0 * (n @ a)
    assert glossy.irradiance(cube, n)[:, 0] == pytest.approx(expected, rel=1e-4)


def test_one_hot_texel_against_a_plain_sum() -> None:
    faces = np.zeros((6, 8, 8, 3))
    faces[2, 3, 5] = [100.0, 10.0, 1.0]
    cube = CubeMap(faces)
    for n in normals(4):
        p = glossy.SurfacePoints(n, view=n)
        plain = plain_truth.over_texels(p, Material(kd=np.pi), cube, 256)
        e = glossy.irradiance(cube, n)
        assert e.shape == (3,)
        assert e == pytest.approx(plain, rel=1e-3, abs=1e-4)


def test_it_is_pi_times_the_truth_of_a_white_diffuse_surface() -> None:
    cube = CubeMap(np.random.default_rng(1).random((6, 16, 16, 3)))
    n = normals(10)
    truth = glossy.reference(glossy.SurfacePoints(n, view=n), Material(kd=1.0), cube)
    e = glossy.irradiance(cube, n)
    assert np.all(np.abs(np.pi * truth.radiance - e) <= np.pi * truth.error + 1e-4 * e)


@pytest.mark.parametrize(("size", "limit"), [(16, 8e-3), (32, 2e-3)])
def test_the_map_interpolates_even_a_single_lamp(size: int, limit: float) -> None:
    """The hardest case: all light from one texel, E has the cosine's kink; error over the RMS."""
    faces = np.zeros((6, 16, 16, 3))
    faces[1, 7, 4] = 1000.0
    cube = CubeMap(faces)
    n = normals(400)
    small = glossy.irradiance_map(cube, size)
    assert small.size == size
    e, from_map = glossy.irradiance(cube, n), small.lookup(n)
    assert np.sqrt(np.mean((from_map - e) ** 2) / np.mean(e**2)) < limit


def test_negative_light_and_refusals() -> None:
    cube = CubeMap(np.full((6, 4, 4, 3), -1.0), negative="keep")
    assert glossy.irradiance_map(cube, 4).faces == pytest.approx(-np.pi, rel=tolerances.SINGLE)
    with pytest.raises(ValueError, match=r"^size: "):
        glossy.irradiance_map(cube, 0)
    with pytest.raises(ValueError, match=r"^normal: "):
        glossy.irradiance(cube, [2.0, 0.0, 0.0])
