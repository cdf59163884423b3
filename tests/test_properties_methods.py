"""What holds for the few-tap methods whatever the numbers: turns, light added up, order, energy."""

import functools

import numpy as np
import plain_truth
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_truth import Array
from symmetry import rotations, turn_faces

import glossy
from glossy import CubeMap, Lobe, Material, SurfacePoints
from glossy.pem.maps import PartialMaps, partial_maps
from glossy.pem.regions import regions
from glossy.prefiltered.maps import PrefilteredMaps, prefilter
from glossy.prefiltered.stack import LobeStack

SUMS = 2e-6
"""Of the brightest texel: levels are float32 sums of the same texels, in another order."""

TABLE = 1e-2
"""Reading the lattice's reflectivity: the largest figure of its page, for narrow lobes."""

AXES = 0.02
"""The lattice's axes are nudged towards the tangent by a thousandth of the smaller variance."""

FILTERED = 2e-3
"""A filtered slice of few texels, looked up between their centres: turns meet it elsewhere."""

SIZE = 8
SEEDS = st.integers(0, 1000)
WIDTHS = st.floats(0.02, 1.0)
ALPHAS = st.sampled_from([0.0, 0.3, 0.5, 1.0])
TAPPED = st.sampled_from(["lattice", "thesis", "pem"])
ROUND = LobeStack(
    np.array([0.2, 0.9]),
    np.linspace(0.0, 1.2, 30),
    np.maximum(1.0 - (np.linspace(0.0, 1.2, 30)[:, None] / [[[0.6]], [[1.0]]]) ** 2, 0.0) ** 3,
    np.array([0.1, 1.0]),
    np.array([[0.5], [0.9]]),
    np.array([0.2, 0.1]),
    np.array([0.3, -0.2]),
    True,
)


def noise(seed: int) -> CubeMap:
    return CubeMap(np.random.default_rng(seed).random((6, SIZE, SIZE, 3)) ** 4)


def prepared(cube: CubeMap, method: str) -> glossy.Pyramid | PartialMaps | PrefilteredMaps:
    if method == "pem":
        return partial_maps(cube, 6, filter="box")
    if method == "prefiltered":
        return prefilter(cube, (ROUND,), SIZE, tolerance=None)
    return glossy.build_pyramid(cube, filter="box")


def shade(p: SurfacePoints, lobe: Lobe, cube: CubeMap, method: str) -> Array:
    options = {"samples": 7} if method in ("lattice", "thesis") else {}
    light = prepared(cube, method)
    return np.asarray(glossy.shade(p, lobe, light, method, "double", **options))


def turned(p: SurfacePoints, r: Array) -> SurfacePoints:
    return SurfacePoints(p.normal @ r.T, p.tangent @ r.T, p.view @ r.T)


@settings(max_examples=8)
@given(WIDTHS, WIDTHS, ALPHAS, TAPPED, st.integers(1, 23), SEEDS)
def test_a_picture_turns_with_its_map(
    mx: float, my: float, alpha: float, method: str, turn: int, seed: int
) -> None:
    """Turns of the cube carry texels onto texels, and taps onto taps."""
    r, lobe, cube = rotations()[turn], Lobe(mx, my, r0=0.3, alpha=alpha), noise(seed)
    p = plain_truth.points(seed, 6, 0.1)
    a = shade(p, lobe, cube, method)
    b = shade(turned(p, r), lobe, CubeMap(turn_faces(cube.faces, r)), method)
    white = np.maximum(glossy.Material(reflection=[lobe]).albedo(p.local_view)[0], 1.0)
    assert np.all(np.abs(a - b) <= 5.0 * SUMS * np.reshape(white, (6, -1)))


@settings(max_examples=3)
@given(st.integers(1, 23), st.floats(0.1, 4.0), SEEDS)
def test_prefiltered_maps_turn_and_add_up(turn: int, share: float, seed: int) -> None:
    r, p = rotations()[turn], plain_truth.points(seed, 20, 0.1)
    first, second = noise(seed), noise(seed + 1)
    both = CubeMap(first.faces + np.float32(share) * second.faces)
    a, b, c = (shade(p, Lobe(0.3), cube, "prefiltered") for cube in (first, second, both))
    assert np.all(np.abs(a + share * b - c) <= 4.0 * SUMS * both.faces.max())
    assert np.all(a >= 0.0)
    assert np.all(c >= a)
    d = shade(turned(p, r), Lobe(0.3), CubeMap(turn_faces(first.faces, r)), "prefiltered")
    assert np.all(np.abs(a - d) <= FILTERED)


@settings(max_examples=8)
@given(WIDTHS, WIDTHS, TAPPED, st.floats(0.1, 4.0), SEEDS)
def test_light_adds_up(mx: float, my: float, method: str, share: float, seed: int) -> None:
    first, second, p = noise(seed), noise(seed + 1), plain_truth.points(seed, 6, 0.1)
    both, lobe = CubeMap(first.faces + np.float32(share) * second.faces), Lobe(mx, my)
    a, b, c = (shade(p, lobe, cube, method) for cube in (first, second, both))
    assert np.all(np.abs(a + share * b - c) <= 4.0 * SUMS * both.faces.max())


@settings(max_examples=8)
@given(WIDTHS, WIDTHS, ALPHAS, st.sampled_from(["lattice", "pem"]), SEEDS)
def test_more_light_is_never_darker(
    mx: float, my: float, alpha: float, method: str, seed: int
) -> None:
    """And no light at all is black."""
    dim, p, lobe = noise(seed), plain_truth.points(seed, 6, 0.05), Lobe(mx, my, alpha=alpha)
    faces = dim.faces.copy()
    faces[np.random.default_rng(seed).integers(6)] += 1.0
    a, b = (shade(p, lobe, cube, method) for cube in (dim, CubeMap(faces)))
    assert np.all(a >= 0.0)
    assert np.all(b >= a - SUMS * np.abs(a))
    assert not shade(p, lobe, CubeMap(np.zeros_like(faces)), method).any()


@settings(max_examples=8)
@given(st.floats(1e-3, 2.0), st.floats(1e-3, 2.0), ALPHAS, st.integers(1, 64), SEEDS)
def test_the_lattice_stays_between_the_darkest_and_the_brightest_texel(
    mx: float, my: float, alpha: float, samples: int, seed: int
) -> None:
    """Times the lobe's own reflectivity: no tap is lost at the horizon, none counts twice."""
    cube, p = noise(seed), plain_truth.points(seed, 6, 0.02)
    lobe = Lobe(mx, my, ks=0.7, alpha=alpha)
    pyramid = glossy.build_pyramid(cube, filter="box")
    light = glossy.shade(p, lobe, pyramid, "lattice", "double", samples=samples)
    white = np.asarray(lobe_albedo(lobe, p))
    low, high = cube.faces.min(axis=(0, 1, 2)), cube.faces.max(axis=(0, 1, 2))
    assert np.all(light >= (1.0 - TABLE) * white * low)
    assert np.all(light <= (1.0 + TABLE) * white * high)
    if alpha == 0.0:
        assert np.all(light <= (1.0 + TABLE) * 0.7 * high)


def lobe_albedo(lobe: Lobe, p: SurfacePoints) -> Array:
    return np.reshape(Material(reflection=[lobe]).albedo(p.local_view)[0], (-1, 1))


@settings(max_examples=10)
@given(WIDTHS, WIDTHS, ALPHAS, st.sampled_from(["lattice", "pem"]), SEEDS)
def test_a_lobe_has_no_front_and_back(
    mx: float, my: float, alpha: float, method: str, seed: int
) -> None:
    """The tangent reversed: taps come in pairs, and the lobe is even in x and in y."""
    p, cube, lobe = plain_truth.points(seed, 6, 0.1), noise(seed), Lobe(mx, my, alpha=alpha)
    other = SurfacePoints(p.normal, -p.tangent, p.view)
    np.testing.assert_allclose(
        shade(other, lobe, cube, method), shade(p, lobe, cube, method), rtol=1e-7, atol=1e-9
    )


@settings(max_examples=3)
@given(st.floats(0.1, 0.5), st.floats(3.0, 6.0), SEEDS)
def test_swapped_widths_are_a_tangent_turned_by_90_degrees(
    m: float, aspect: float, seed: int
) -> None:
    p, cube = plain_truth.points(seed, 6, 0.3), noise(seed)
    across = SurfacePoints(p.normal, p.bitangent, p.view)
    lobes = Lobe(m, m / aspect), Lobe(m / aspect, m)
    a, b = (glossy.reference(q, o, cube) for q, o in zip((p, across), lobes, strict=True))
    assert np.all(np.abs(a.radiance - b.radiance) <= a.error + b.error)
    c, d = (shade(q, o, cube, "lattice") for q, o in zip((p, across), lobes, strict=True))
    assert np.all(np.abs(c - d) <= AXES * np.maximum(c, d))


# --- partial environment maps ---------------------------------------------------------------------


@settings(max_examples=10)
@given(st.integers(1, 8), st.floats(0.0, 8.0), SEEDS)
def test_regions_are_the_whole_map_once(count: int, contrast: float, seed: int) -> None:
    texels = np.random.default_rng(seed).random((6, SIZE, SIZE, 3)) ** contrast
    cube = CubeMap(texels)
    found = regions(cube, 6 * count)
    total = sum(found.masked(cube, k).faces.astype(np.float64) for k in range(len(found)))
    assert np.array_equal(total, cube.faces)


@functools.cache
def parts() -> PartialMaps:
    return partial_maps(noise(1), 12, filter="box")


@settings(max_examples=20)
@given(SEEDS, st.floats(-1.0, 4.0))
def test_what_is_seen_adds_up_region_by_region(seed: int, level: float) -> None:
    rng = np.random.default_rng(seed)
    directions, seen = rng.normal(size=(20, 3)), rng.random((20, 12))
    levels = np.full(20, level)
    some, rest, whole = (
        parts().sample(directions, levels, v, precision="double")
        for v in (seen, 1.0 - seen, np.ones((20, 12)))
    )
    plain = parts().pyramid.sample(directions, levels, precision="double")
    assert np.all(np.abs(some + rest - whole) <= SUMS)
    assert np.all(np.abs(whole - plain) <= SUMS)
    assert np.all(some <= whole + SUMS)


def test_prefiltered_white_is_the_furnace() -> None:
    """Of the lobe that the properties above are held with: none of them is trivially zero."""
    p = plain_truth.points(1, 5, 0.2)
    light = shade(p, Lobe(0.3), CubeMap(np.ones((6, SIZE, SIZE, 3))), "prefiltered")
    assert light == pytest.approx(ROUND.furnace(p.local_view) * np.ones(3), rel=1e-5)
    assert light.min() > 0.01
