"""Cube maps filtered with radial profiles: exactly, fast, and as stacks."""

import math
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import pytest
import tolerances
from symmetry import rotations, turn_faces

from glossy import CubeMap, environment
from glossy.cubemap import face_directions, texel_directions, texel_solid_angles
from glossy.frames import normalise
from glossy.prefiltered.exact import filter_directions, nodes, parts_for, volume
from glossy.prefiltered.filter import MapFilter, filter_map
from glossy.prefiltered.harmonics import zonal_factors

Float64Array = npt.NDArray[np.float64]
SIZE = 16
TEXEL = 2.0 / SIZE


def gauss(width: float) -> tuple[Float64Array, Float64Array]:
    angles = np.linspace(0.0, min(6.0 * width, math.pi), 97)
    return angles, np.exp(-0.5 * (angles / width) ** 2)


def peak_and_skirt(width: float) -> tuple[Float64Array, Float64Array]:
    """Three channels: a peak, a peak on a broad skirt, the skirt."""
    angles = 0.5 * width * np.sinh(np.linspace(0.0, 1.0, 64) * math.asinh(2.0 * math.pi / width))
    angles[-1] = math.pi
    peak, skirt = np.exp(-0.5 * (angles / width) ** 2), np.exp(-0.5 * (angles / 0.5) ** 2)
    return angles, np.stack([peak, peak + 0.02 * skirt, skirt], axis=1)


def cone(width: float) -> tuple[Float64Array, Float64Array]:
    return np.array([0.0, 2.0 * width]), np.array([1.0, 0.0])


def disc(width: float) -> tuple[Float64Array, Float64Array]:
    return np.array([0.0, width, width + 1e-9]), np.array([1.0, 1.0, 0.0])


PROFILES = {f.__name__: f for f in (gauss, peak_and_skirt, cone, disc)}


def noise(seed: int = 5) -> CubeMap:
    return CubeMap(np.random.default_rng(seed).uniform(0.1, 2.0, (6, SIZE, SIZE, 3)))


def sun() -> CubeMap:
    """One texel a million times as bright as the rest, next to an edge."""
    faces = np.full((6, SIZE, SIZE, 3), 1e-3)
    faces[2, 0, 5] = 1e3
    return CubeMap(faces)


def directions(count: int = 200, seed: int = 1) -> Float64Array:
    return normalise(np.random.default_rng(seed).normal(size=(count, 3)))


def relative(image: Any, truth: Any) -> float:
    return float(np.sqrt(np.mean(np.square(image - truth)) / np.mean(np.square(truth))))


# --- the sum over texels --------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["gauss", "peak_and_skirt", "cone"])
def test_the_sum_is_the_integral_over_the_plain_lookup(name: str) -> None:
    """Twin: all of 6 x 320^2 midpoints of ``cube.lookup``, no cone, no table, no normalisation."""
    cube, d, n = noise(), directions(12), 320
    angles, profile = PROFILES[name](1.5 * TEXEL)
    towards = texel_directions(n)
    light = cube.lookup(towards) * texel_solid_angles(n)[..., None]
    towards = normalise(towards).reshape(-1, 3)
    expected = np.empty((len(d), 3))
    for k, r in enumerate(d):
        angle = np.arctan2(np.linalg.norm(np.cross(towards, r), axis=1), towards @ r)
        columns = [np.interp(angle, angles, p, right=0.0) for p in np.atleast_2d(profile.T)]
        p = np.broadcast_to(np.stack(columns, axis=1), (len(towards), 3))
        expected[k] = np.sum(p * light.reshape(-1, 3), axis=0)
    found = filter_directions(cube, angles, profile, d)
    assert relative(found, expected) < tolerances.PREFILTER_MIDPOINT


@pytest.mark.parametrize("width", [0.02, 0.3, 2.0])
def test_dividing_the_texels_further_changes_little(width: float) -> None:
    """Lobes from a fiftieth of a texel to three of them, a sun among texels: nothing aliases."""
    cube = sun()
    towards = normalise(face_directions(2, 11.0 / SIZE - 1.0, 1.0 / SIZE - 1.0))
    d = normalise(towards + 2.5 * (width + 1.0) * TEXEL * directions(60))
    angles, profile = gauss(width * TEXEL)
    parts = parts_for(SIZE, angles, profile[:, None])
    found = filter_directions(cube, angles, profile, d)
    finer = filter_directions(cube, angles, profile, d, parts=2 * parts)
    assert relative(found, finer) < tolerances.PREFILTER_PARTS


def test_a_lobe_much_narrower_than_a_texel_is_the_plain_lookup() -> None:
    cube, d = noise(), directions()
    angles, profile = gauss(0.01 * TEXEL)
    found = filter_directions(cube, angles, profile, d) / volume(angles, profile[:, None])
    assert relative(found, cube.lookup(d)) < tolerances.PREFILTER_NARROW


def test_nodes_are_exact_for_cubics_on_every_piece() -> None:
    for size, parts in ((1, 1), (4, 1), (5, 3)):
        at, weight = nodes(size, parts)
        assert np.all(np.diff(at) > 0.0)
        assert np.sum(weight) == pytest.approx(2.0)
        kink = (2.0 * (size // 2) + 1.0) / size - 1.0  # a texel's centre
        cut = np.maximum(at - kink, 0.0) ** 3
        assert np.sum(weight * cut) == pytest.approx((1.0 - kink) ** 4 / 4.0)


# --- both filters ---------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [None, 1e-3])
@pytest.mark.parametrize("name", PROFILES)
def test_a_constant_map_stays_constant_times_the_volume(name: str, tolerance: float | None) -> None:
    angles, profile = PROFILES[name](0.7 * TEXEL)
    columns = profile.reshape(len(angles), -1)
    white = CubeMap(np.full((6, SIZE, SIZE, 3), 0.7))
    found = filter_map(white, angles, profile, 4, tolerance)
    expected = np.float32(0.7) * volume(angles, columns)
    assert np.abs(found / expected - 1.0).max() < tolerances.PREFILTER_WHITE


@pytest.mark.parametrize("tolerance", [None, 1e-4])
def test_it_is_linear_in_the_map_and_in_the_profile(tolerance: float | None) -> None:
    a, b = noise(5), noise(6)
    both = CubeMap(2.0 * a.faces + 3.0 * b.faces)
    angles, profile = peak_and_skirt(1.2 * TEXEL)
    one, two = (filter_map(c, angles, profile, 4, tolerance) for c in (a, b))
    limit = tolerances.SINGLE if tolerance is None else 3.0 * tolerance
    assert relative(filter_map(both, angles, profile, 4, tolerance), 2.0 * one + 3.0 * two) < limit
    parts = [filter_map(a, angles, p, 4, tolerance) for p in profile.T]
    channels = np.stack([part[..., c] for c, part in enumerate(parts)], axis=-1)
    assert relative(channels, one) < max(limit, tolerances.PREFILTER_PARTS)


@pytest.mark.parametrize("tolerance", [None, 1e-3])
def test_turning_the_cube_turns_the_result(tolerance: float | None) -> None:
    cube = noise()
    angles, profile = gauss(1.5 * TEXEL)
    found = filter_map(cube, angles, profile, 4, tolerance)
    limit = tolerances.SINGLE if tolerance is None else 2.0 * tolerance
    for rotation in rotations()[5:24:9]:
        turned = filter_map(
            CubeMap(turn_faces(cube.faces, rotation)), angles, profile, 4, tolerance
        )
        expected = turn_faces(found.astype(np.float32), rotation)
        assert relative(turned, expected) < limit


@pytest.mark.parametrize("tolerance", [None, 1e-3])
def test_the_same_bits_on_one_thread(tolerance: float | None) -> None:
    angles, profile = peak_and_skirt(0.5 * TEXEL)
    found = filter_map(noise(), angles, profile, 4, tolerance)
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        assert np.array_equal(found, filter_map(noise(), angles, profile, 4, tolerance))
    finally:
        numba.set_num_threads(before)


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [("gauss", 1e-2), ("gauss", 1e-3), ("peak_and_skirt", 1e-3), ("cone", 1e-2)],
)
@pytest.mark.parametrize("make", [noise, sun, lambda: environment("studio", SIZE)])
def test_the_tolerance_is_kept(make: Any, name: str, tolerance: float) -> None:
    """Against the sum over texels, RMS over the whole sphere of each channel, two widths."""
    cube, size = make(), 8
    weight = np.broadcast_to(texel_solid_angles(size)[..., None], (6, size, size, 3))
    fast = MapFilter(cube, tolerance)
    for width in (0.5, 2.0):
        angles, profile = PROFILES[name](width * TEXEL)
        d = texel_directions(size)
        exact = filter_directions(cube, angles, profile, d)
        found = fast.filtered(angles, profile, d)
        assert found.min() >= 0.0
        wrong, level = (np.sum(weight * x * x, axis=(0, 1, 2)) for x in (found - exact, exact))
        assert np.sqrt(wrong / level).max() <= tolerance


def test_where_the_degrees_do_not_suffice_the_profile_is_split(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("glossy.prefiltered.filter.DEGREES", 32)
    cube, d = noise(), directions(300)
    angles, profile = peak_and_skirt(0.5 * TEXEL)
    fast = MapFilter(cube, 1e-3)
    assert fast.degrees(zonal_factors(angles, profile, 4 * 32)) is None
    exact = filter_directions(cube, angles, profile, d)
    assert relative(fast.filtered(angles, profile, d), exact) < 1e-3


@pytest.mark.parametrize(
    ("angles", "profile", "message"),
    [
        ([0.0, 0.0], [1.0, 1.0], "angles: must rise from 0"),
        ([0.1, 1.0], [1.0, 1.0], "angles: must rise from 0"),
        ([0.0, 4.0], [1.0, 1.0], "angles: must rise from 0"),
        ([0.0, 1.0], [1.0, -1.0], "profile: must be finite and not negative"),
        ([0.0, 1.0], [1.0, np.nan], "profile: must be finite"),
        ([0.0, 1.0], [[1.0, 1.0], [0.0, 0.0]], "profile: must have shape"),
    ],
)
def test_a_bad_profile_is_refused(angles: Any, profile: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        filter_map(noise(), angles, profile, 4)


def test_a_bad_tolerance_or_map_is_refused() -> None:
    with pytest.raises(ValueError, match="tolerance: must be in"):
        MapFilter(noise(), 1e-9)
    faces = np.ones((6, 4, 4, 3))
    faces[0, 0, 0] = np.inf
    with pytest.raises(ValueError, match="cube: must be finite"):
        MapFilter(CubeMap(faces, nonfinite="keep"))
