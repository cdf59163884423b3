"""The five-tap filters of partial environment maps."""

import itertools
import math

import numpy as np
import numpy.typing as npt
import pytest
from symmetry import rotations, turn_faces

import glossy
from glossy.pem_filter import PEM_TAPS
from glossy.seams import PAD

FloatArray = npt.NDArray[np.floating]

COSINES = [math.cos(math.radians(a)) for a in (-60, -30, 0, 30, 60)]
TAPS = {
    "pem5:box": [1.0] * 5,
    "pem5:gauss": [math.exp(-0.5 * k * k) for k in range(-2, 3)],
    "pem5:cos": COSINES,
    "pem5:sqrtcos": [math.sqrt(c) for c in COSINES],
}
ROUNDING = 14 * 2.0**-24
"""A mean of four and two sums of five float32 terms in [0, 1]."""


def random_cube(size: int) -> glossy.CubeMap:
    rng = np.random.default_rng(size)
    return glossy.CubeMap(rng.random((6, size, size, 3), dtype=np.float32))


def naive(fine: FloatArray, taps: list[float]) -> FloatArray:
    """float64 twin: 2 x 2 means, then 25 terms; the rings are those of every level."""
    n = fine.shape[1] // 2
    half = fine.astype(np.float64).reshape(6, n, 2, n, 2, 3).mean(axis=(2, 4))
    wide = glossy.Pyramid([half])._padded[0][..., :3].astype(np.float64)
    weights = np.array(taps) / sum(taps)
    out: FloatArray = np.zeros_like(half)
    for i, j in itertools.product(range(2 * PAD + 1), repeat=2):
        out += weights[i] * weights[j] * wide[:, i : i + n, j : j + n]
    return np.asarray(out)


@pytest.mark.parametrize("size", [2, 16, 128])
@pytest.mark.parametrize("filter", PEM_TAPS)
def test_each_level_is_the_smoothed_mean_of_the_level_above(filter: str, size: int) -> None:
    cube = random_cube(size)
    levels = glossy.build_pyramid(cube, filter=filter).levels
    assert np.array_equal(levels[0], cube.faces)
    for fine, coarse in itertools.pairwise(levels):
        assert np.abs(coarse - naive(fine, TAPS[filter])).max() <= ROUNDING


@pytest.mark.parametrize("filter", PEM_TAPS)
def test_constant_map_stays_constant_and_turns_with_the_cube(filter: str) -> None:
    ones = glossy.build_pyramid(glossy.CubeMap(np.full((6, 16, 16, 3), 0.1)), filter=filter)
    for level in ones.levels:
        assert np.abs(level / np.float32(0.1) - 1.0).max() <= ROUNDING
    cube = random_cube(8)
    levels = glossy.build_pyramid(cube, filter=filter).levels
    for r in rotations(mirrors=True)[::7]:
        turned = glossy.build_pyramid(glossy.CubeMap(turn_faces(cube.faces, r)), filter=filter)
        for a, b in zip(turned.levels, levels, strict=True):
            assert np.abs(a - turn_faces(np.ascontiguousarray(b), r)).max() <= ROUNDING
