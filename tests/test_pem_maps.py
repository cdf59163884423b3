"""Partial environment maps: sums, layouts, lookups."""

import numba
import numpy as np
import numpy.typing as npt
import pytest

import glossy
from glossy.pem.maps import LAYOUTS, PartialMaps, partial_maps
from glossy.pem.memory import memory

FloatArray = npt.NDArray[np.floating]

FILTERS = ["box", "pem5:gauss", "pem5:sqrtcos"]
SUM = 4e-6
"""float32: filters of R maps and their sum, relative to the brightest texel."""


def random_cube(size: int = 16, seed: int = 0, contrast: float = 8.0) -> glossy.CubeMap:
    rng = np.random.default_rng(seed)
    return glossy.CubeMap(rng.random((6, size, size, 3)) ** contrast)


def lookups(count: int, seed: int = 1) -> tuple[FloatArray, FloatArray]:
    """Directions everywhere, some of them on edges and corners, and levels off the chain too."""
    rng = np.random.default_rng(seed)
    d = rng.normal(size=(count, 3))
    d[: count // 4] = np.sign(d[: count // 4])
    d[count // 4 : count // 2, 0] = d[count // 4 : count // 2, 1]
    level = rng.uniform(-1.0, 6.0, count)
    level[::5] = np.round(level[::5])
    return d, level


@pytest.mark.parametrize("filter", FILTERS)
def test_maps_sum_to_the_pyramid(filter: str) -> None:
    """Linearity, level by level; level 0 without any rounding."""
    cube = random_cube()
    maps = partial_maps(cube, 24, filter=filter)
    each = [maps.region_pyramid(i).levels for i in range(24)]
    for level, whole in enumerate(glossy.build_pyramid(cube, filter=filter).levels):
        total = sum(one[level].astype(np.float64) for one in each)
        assert np.abs(total - whole).max() <= (SUM if level else 0.0)


@pytest.mark.parametrize(
    ("filter", "storage"),
    [("box", "rgba16f"), ("pem5:cos", "rgba32f"), ("pem5:sqrtcos", "rgba16f")],
)
def test_lookup_under_visibility_is_the_sum_over_regions(filter: str, storage: str) -> None:
    """Eq. (1) against R whole pyramids, looked up one after another and summed in float64."""
    maps = partial_maps(random_cube(), 12, filter=filter, storage=storage)
    d, level = lookups(500)
    seen = np.random.default_rng(2).random((500, 12))
    seen[:, ::3] = 0.0
    twin = np.zeros((500, 3))
    for i in range(12):
        one = maps.region_pyramid(i).sample(d, level, precision="double")
        twin += seen[:, i : i + 1] * one
    exact = maps.sample(d, level, seen, precision="double")
    assert np.abs(exact - twin).max() < 1e-12
    assert np.abs(maps.sample(d, level, seen) - twin).max() < SUM
    assert np.all(maps.sample(d, level, np.zeros(12)) == 0.0)


@pytest.mark.parametrize("count", [6, 48])
def test_cropped_is_whole_bit_for_bit_and_smaller(count: int) -> None:
    cube = random_cube(32)
    maps = {layout: partial_maps(cube, count, layout=layout) for layout in LAYOUTS}
    d, level = lookups(3000)
    seen = np.random.default_rng(2).random((3000, count))
    for precision in ("single", "double"):
        a, b = (m.sample(d, level, seen, precision=precision) for m in maps.values())
        assert np.array_equal(a, b)
    assert maps["cropped"].texels < maps["whole"].texels / (2 if count == 6 else 3)


def test_all_seen_is_one_lookup_in_the_whole() -> None:
    cube = random_cube()
    maps = partial_maps(cube, 48)
    d, level = lookups(500)
    whole = glossy.build_pyramid(cube, filter="pem5:sqrtcos").sample(d, level)
    assert np.array_equal(maps.sample(d, level), whole)
    assert "kernel_arguments" not in vars(maps)
    assert "regions" not in vars(maps)
    assert np.abs(maps.sample(d, level, np.ones(48)) - whole).max() < SUM


def test_same_bits_for_any_number_of_threads() -> None:
    maps = partial_maps(random_cube(), 24)
    d, level = lookups(2000)
    seen = np.random.default_rng(3).random((2000, 24))
    many = maps.sample(d, level, seen)
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        assert np.array_equal(maps.sample(d, level, seen), many)
    finally:
        numba.set_num_threads(before)


def test_refusals() -> None:
    cube = random_cube(8)
    for options, name in (
        ({"count": 7}, "count"),
        ({"filter": "pem5"}, "filter"),
        ({"storage": "rgb8"}, "storage"),
        ({"layout": "parabolic"}, "layout"),
    ):
        with pytest.raises(ValueError, match=f"^{name}: must"):
            partial_maps(cube, **options)
    with pytest.raises(ValueError, match="power of two"):
        partial_maps(glossy.CubeMap(np.ones((6, 12, 12, 3))))
    maps: PartialMaps = partial_maps(cube, 6)
    with pytest.raises(ValueError, match="level: must not be NaN"):
        maps.sample([0, 0, 1], np.nan, np.ones(6))
    for seen in (np.ones(5), np.full(6, np.nan), 1.0):
        with pytest.raises(ValueError, match="visibility: must"):
            maps.sample([0, 0, 1], 0.0, seen)
    with pytest.raises(ValueError, match="must broadcast"):
        maps.sample(np.ones((2, 3)), 0.0, np.ones((3, 6)))


def test_memory_in_closed_form() -> None:
    """R cube maps with levels, R shadow maps."""
    maps = partial_maps(random_cube(16), 12, storage="rgba16f")
    found = memory(maps, shadow_size=128)
    pyramid = 8 * 6 * (4**5 - 1) // 3
    assert (found.pyramid, found.whole) == (pyramid, 12 * pyramid)
    assert found.shadows == 12 * 128 * 128 * 4
    assert found.held == 8 * maps.texels < found.whole
    single = memory(partial_maps(random_cube(16), 12, layout="whole"))
    assert single.whole == 2 * found.whole < single.held  # with rings
    with pytest.raises(ValueError, match=r"^shadow_size: must be at least 1"):
        memory(maps, shadow_size=0)
