"""Pyramids made anew in place, and the filters at sizes where their wide loops run."""

import itertools

import numba
import numpy as np
import numpy.typing as npt
import pytest

import glossy
from glossy.pyramid import FILTERS, STORAGES

FloatArray = npt.NDArray[np.floating]

TAPS = {"box": [1, 1], "gauss4": [1, 3, 3, 1], "gauss6": [1, 5, 10, 10, 5, 1]}
ROUNDING = 6 * 2.0**-24
"""Two sums of up to six float32 terms in [0, 1]."""


def random_cube(size: int, seed: int = 0) -> glossy.CubeMap:
    rng = np.random.default_rng(seed)
    return glossy.CubeMap(rng.random((6, size, size, 3), dtype=np.float32))


def halved(level: FloatArray, taps: list[int]) -> FloatArray:
    """float64 twin away from the seams: texels whose filter stays on the face."""
    weights = np.array(taps, dtype=np.float64) / sum(taps)
    reach = len(taps) // 2 - 1
    first = (reach + 1) // 2  # the first output that reaches no other face
    n = level.shape[1] // 2 - 2 * first
    start = 2 * first - reach
    x = sum(w * level[:, :, start + k :][:, :, : 2 * n : 2] for k, w in enumerate(weights))
    assert isinstance(x, np.ndarray)
    y = sum(w * x[:, start + k :][:, : 2 * n : 2] for k, w in enumerate(weights))
    return np.asarray(y)


@pytest.mark.parametrize("size", [16, 32, 256])
@pytest.mark.parametrize("filter", TAPS)
def test_wide_loops_agree_with_their_twin(filter: str, size: int) -> None:
    levels = glossy.build_pyramid(random_cube(size), filter=filter).levels
    for fine, coarse in itertools.pairwise(levels):
        expected = halved(fine.astype(np.float64), TAPS[filter])
        edge = (coarse.shape[1] - expected.shape[1]) // 2
        inner = slice(edge, coarse.shape[1] - edge)
        if expected.size:
            assert np.abs(coarse[:, inner, inner] - expected).max() <= ROUNDING


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("filter", FILTERS)
def test_update_gives_the_bits_of_a_new_pyramid(filter: str, storage: str) -> None:
    pyramid = glossy.build_pyramid(random_cube(64, 1), filter=filter, storage=storage)
    views = pyramid.levels
    pyramid.update(random_cube(64, 2))
    fresh = glossy.build_pyramid(random_cube(64, 2), filter=filter, storage=storage)
    for a, b, view in zip(pyramid._padded, fresh._padded, views, strict=True):
        assert np.array_equal(a, b)
        assert np.array_equal(view, b[:, 2:-2, 2:-2, :3])


def test_update_refuses_another_size_and_levels_of_unknown_filter() -> None:
    with pytest.raises(ValueError, match=r"^cube size: must be 8, got 16$"):
        glossy.build_pyramid(random_cube(8)).update(random_cube(16))
    with pytest.raises(ValueError, match=r"^pyramid: must come from build_pyramid, got Pyramid"):
        glossy.Pyramid([random_cube(8).faces]).update(random_cube(8))


@pytest.mark.parametrize("filter", FILTERS)
def test_same_bits_for_any_number_of_threads(filter: str) -> None:
    cube = random_cube(128)
    many = numba.get_num_threads()
    wide = glossy.build_pyramid(cube, filter=filter)._buffer
    numba.set_num_threads(1)
    try:
        assert np.array_equal(glossy.build_pyramid(cube, filter=filter)._buffer, wide)
    finally:
        numba.set_num_threads(many)


def test_the_box_filter_is_the_same_however_the_texels_lie_in_memory() -> None:
    """Its fast pass needs cache lines; without them levels 1 and 2 come from the general one."""
    cube = random_cube(64)
    pyramid = glossy.build_pyramid(cube, filter="box")
    fast = [level.copy() for level in pyramid.levels]
    raw = np.zeros(pyramid._buffer.size + 64, dtype=np.float32)
    offset = (-raw.ctypes.data % 64) // 4 + 4
    pyramid._buffer = raw[offset : offset + pyramid._buffer.size]
    pyramid._padded = [
        pyramid._buffer[4 * o : 4 * (o + 6 * (n + 4) ** 2)].reshape(6, n + 4, n + 4, 4)
        for o, n in pyramid._chain
    ]
    pyramid.update(cube)
    for a, b in zip(pyramid.levels, fast, strict=True):
        assert np.abs(a - b).max() <= ROUNDING
