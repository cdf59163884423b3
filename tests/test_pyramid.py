"""The MIP filters and the GPU's sampler."""

import itertools
import pathlib
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from symmetry import rotations, turn_faces

import glossy
from glossy.cubemap import face_directions, locate, pad_faces, texel_directions
from glossy.pyramid import HALF_MAX
from glossy.sampler import sample_chain
from glossy.seams import PAD

FloatArray = npt.NDArray[np.floating]
TAPS = {"box": [1, 1], "gauss4": [1, 3, 3, 1], "gauss6": [1, 5, 10, 10, 5, 1]}
ULP = 2.0**-23
FILTER_ROUNDING = 6 * 2.0**-24
"""Two passes of six float32 terms: a handful of roundings relative to the largest texel."""

MODES: dict[str, dict[str, Any]] = {
    "out_linear_mipmap_linear": {},
    "out_nearest_mipmap_nearest": {"filter": "nearest", "mip": "nearest"},
    "out_linear_mipmap_nearest": {"mip": "nearest"},
    "out_linear_mipmap_linear_noseam": {"seamless": False},
}

numbers = st.floats(-1.0, 1.0, allow_subnormal=False)
directions = st.tuples(numbers, numbers, numbers).filter(lambda d: max(map(abs, d)) > 1e-6)


def random_cube(size: int, seed: int = 0) -> glossy.CubeMap:
    rng = np.random.default_rng(seed)
    return glossy.CubeMap(rng.random((6, size, size, 3), dtype=np.float32))


def random_pyramid(size: int, channels: int = 3) -> glossy.Pyramid:
    """Independent texels on every level, so that a wrong level shows."""
    rng = np.random.default_rng(size)
    sizes = [max(1, size >> i) for i in range(size.bit_length())]
    return glossy.Pyramid([rng.random((6, n, n, channels), dtype=np.float32) for n in sizes])


# --- agreement with another implementation --------------------------------------------------------


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", ["random1", "random16", "smooth64"])
def test_agrees_with_a_gpu_sampler(
    conformance: pathlib.Path, name: str, mode: str, precision: str
) -> None:
    """Mesa's answers: linear within the tolerance stated with them, nearest exactly."""
    with np.load(conformance / f"cubemap_{name}.npz") as z:
        count = sum(k.startswith("level") for k in z.files)
        pyramid = glossy.Pyramid([z[f"level{i}"] for i in range(count)])
        got = pyramid.sample(z["dirs"], z["lod"], precision=precision, **MODES[mode])
        error = np.abs(got - z[mode]).max()
    tolerance = max(3e-7, 1e-7 * pyramid.size) * (2.0 if precision == "single" else 1.0)
    assert error <= (0.0 if "nearest_mipmap" in mode else tolerance)


# --- the filters ----------------------------------------------------------------------------------


def naive_reduce(level: FloatArray, taps: list[int]) -> FloatArray:
    """float64 twin: every texel beyond an edge is looked up by folding, then a plain double sum."""
    n = level.shape[1]
    weights = np.array(taps, dtype=np.float64) / sum(taps)
    reach = len(taps) // 2 - 1
    faces = np.arange(6)[:, None, None]

    def beyond(rows: FloatArray, cols: FloatArray) -> FloatArray:
        """Texels (6, R, C, 3) with indices that may run over at most one edge."""
        r, c = np.meshgrid(rows, cols, indexing="ij")
        s, t = (c + 0.5) * 2.0 / n - 1.0, (r + 0.5) * 2.0 / n - 1.0
        over = np.maximum(np.maximum(abs(s), abs(t)) - 1.0, 0.0)
        d = face_directions(faces, np.clip(s, -1, 1)[None], np.clip(t, -1, 1)[None])
        f, u, v = locate(d - over[None, ..., None] * face_directions(faces, 0.0, 0.0))
        row, col = ((x + 1.0) * 0.5 * n for x in (v, u))
        return np.asarray(level[f, row.astype(int), col.astype(int)], dtype=np.float64)

    index = np.arange(-reach, n + reach)
    inside = np.clip(index, 0, n - 1)
    wide = np.zeros((6, n + 2 * reach, n + 2 * reach, 3))
    for i, r in enumerate(index):
        for j, c in enumerate(index):
            if r != inside[i] and c != inside[j]:
                mirror_r = -1 - r if r < 0 else 2 * n - 1 - r
                mirror_c = -1 - c if c < 0 else 2 * n - 1 - c
                three = [(mirror_r, mirror_c), (mirror_r, c), (r, mirror_c)]
            else:
                three = [(r, c)]
            texels = [beyond(np.array([a]), np.array([b]))[:, 0, 0] for a, b in three]
            wide[:, i, j] = np.mean(texels, axis=0)
    out = np.zeros((6, n // 2, n // 2, 3))
    for a, wa in enumerate(weights):
        for b, wb in enumerate(weights):
            out += wa * wb * wide[:, a : a + n : 2, b : b + n : 2][:, : n // 2, : n // 2]
    return out


@pytest.mark.parametrize("filter", TAPS)
def test_each_level_is_the_filtered_level_above(filter: str) -> None:
    levels = glossy.build_pyramid(random_cube(16), filter=filter).levels
    assert [level.shape[1] for level in levels] == [16, 8, 4, 2, 1]
    for fine, coarse in itertools.pairwise(levels):
        expected = naive_reduce(fine, TAPS[filter])
        assert np.abs(coarse - expected).max() <= FILTER_ROUNDING * fine.max()


@pytest.mark.parametrize("filter", TAPS)
@pytest.mark.parametrize("value", [1.0, 0.1, 3.3e-30, 7.7e30])
def test_constant_map_stays_constant_within_one_ulp(filter: str, value: float) -> None:
    cube = glossy.CubeMap(np.full((6, 64, 64, 3), value))
    base = cube.faces[0, 0, 0, 0]
    for level in glossy.build_pyramid(cube, filter=filter).levels:
        assert np.abs(level / base - 1.0).max() <= ULP


@pytest.mark.parametrize("filter", TAPS)
def test_turning_the_cube_turns_every_level(filter: str) -> None:
    """All 48 symmetries; the separable passes add in another order, hence rounding."""
    cube = random_cube(8)
    levels = glossy.build_pyramid(cube, filter=filter).levels
    for r in rotations(mirrors=True):
        turned = glossy.build_pyramid(glossy.CubeMap(turn_faces(cube.faces, r)), filter=filter)
        for a, b in zip(turned.levels, levels, strict=True):
            assert np.abs(a - turn_faces(np.ascontiguousarray(b), r)).max() <= FILTER_ROUNDING


@pytest.mark.parametrize("filter", TAPS)
def test_a_bright_texel_keeps_its_weight_through_the_levels(filter: str) -> None:
    """Away from corners each filter's weights sum to 1 over a level: a quarter per level."""
    faces = np.zeros((6, 32, 32, 3))
    faces[4, 13, 30] = 1.0
    levels = glossy.build_pyramid(glossy.CubeMap(faces), filter=filter).levels
    sums = [float(level[..., 0].sum(dtype=np.float64)) for level in levels[:3]]
    assert sums == pytest.approx([1.0, 0.25, 0.0625], rel=1e-6)


def test_seam_rings_agree_with_the_plain_padding() -> None:
    """Two codes for the same rule: the pyramid's table and the cube map's folding."""
    for size in (1, 2, 5, 16):
        cube = random_cube(size)
        ring = glossy.Pyramid([cube.faces])._padded[0][:, PAD - 1 : 1 - PAD, PAD - 1 : 1 - PAD, :3]
        assert np.array_equal(ring, pad_faces(cube.faces))


# --- the lookup -----------------------------------------------------------------------------------


def naive_sample(pyramid: glossy.Pyramid, d: FloatArray, level: float) -> FloatArray:
    """float64 twin of the trilinear lookup, through the cube map's own lookup per level."""
    levels = pyramid.levels
    clamped = min(max(level, 0.0), len(levels) - 1.0)
    first = int(clamped)
    f = clamped - first
    values = [glossy.CubeMap(a).lookup(d) for a in levels[first : first + 2]]
    return np.asarray((1.0 - f) * values[0] + (f * values[-1] if f else 0.0))


@given(directions, st.floats(-2.0, 9.0), st.sampled_from([1, 2, 8, 32]))
def test_lookup_agrees_with_its_twin_in_both_precisions(
    d: tuple[float, float, float], level: float, size: int
) -> None:
    pyramid = random_pyramid(size)
    v = np.array(d, dtype=np.float32)
    lod = float(np.float32(level))
    expected = naive_sample(pyramid, v, lod)
    double = pyramid.sample(v, lod, precision="double")
    single = pyramid.sample(v, lod)
    assert double.dtype == np.float64
    assert single.dtype == np.float32
    assert np.abs(double - expected).max() <= 1e-13
    assert np.abs(single - expected).max() <= max(6e-7, 2e-7 * size)


@given(directions, st.floats(1e-30, 1e30))
def test_length_of_the_direction_does_not_matter(
    d: tuple[float, float, float], length: float
) -> None:
    pyramid = random_pyramid(8)
    v = np.array(d)
    a = pyramid.sample(v, 1.3, precision="double")
    b = pyramid.sample(v * length, 1.3, precision="double")
    assert np.allclose(a, b, rtol=0, atol=1e-13)


@pytest.mark.parametrize("length", [1e-45, 1e-38, 1e38])
def test_denormal_and_huge_directions_in_single_precision(length: float) -> None:
    pyramid = random_pyramid(8)
    v = np.array([[length, 0, 0], [0, -length, 0], [0, 0, length]], dtype=np.float32)
    assert np.array_equal(pyramid.sample(v, 0.0), pyramid.sample(np.sign(v), 0.0))


def test_levels_clamp_to_the_chain() -> None:
    pyramid = random_pyramid(8)
    d = np.random.default_rng(1).normal(size=(50, 3))
    assert np.array_equal(pyramid.sample(d, -np.inf), pyramid.sample(d, 0.0))
    assert np.array_equal(pyramid.sample(d, -3.0), pyramid.sample(d, 0.0))
    assert np.array_equal(pyramid.sample(d, np.inf), pyramid.sample(d, 3.0))
    assert np.array_equal(pyramid.sample(d, 99.5), pyramid.sample(d, 3.0))


@pytest.mark.parametrize(("rounding", "levels"), [("even", [0, 2, 2]), ("opengl", [0, 1, 2])])
def test_half_way_between_levels_goes_where_asked(rounding: str, levels: list[int]) -> None:
    chain = [np.full((6, n, n, 1), float(i)) for i, n in enumerate((8, 4, 2, 1))]
    pyramid = glossy.Pyramid(chain)
    got = pyramid.sample([0, 0, 1.0], [0.5, 1.5, 2.5], mip="nearest", level_rounding=rounding)
    assert got[:, 0].tolist() == levels


def test_fixed_point_fractions_quantise_coordinates_and_level() -> None:
    """With b bits only multiples of 2^-b can weigh two texels, and two levels, of 0 and 1."""
    columns = np.zeros((6, 8, 8, 1))
    columns[:, :, 1::2] = 1.0
    one_level = glossy.Pyramid([columns])
    s = np.linspace(-0.6, 0.6, 501)
    d = np.stack([s, np.zeros_like(s), np.ones_like(s)], axis=-1)
    coarse = one_level.sample(d, 0.0, subtexel_bits=4, precision="double")[:, 0] * 16
    assert np.abs(coarse - np.round(coarse)).max() == 0.0
    exact = one_level.sample(d, 0.0, precision="double")[:, 0] * 16
    assert 0.0 < np.abs(coarse - exact).max() <= 0.5 + 1e-9
    chain = glossy.Pyramid([np.zeros((6, 2, 2, 1)), np.ones((6, 1, 1, 1))])
    lod = np.linspace(0.0, 1.0, 997)
    levels = chain.sample(np.broadcast_to([0, 0, 1.0], (997, 3)), lod, subtexel_bits=8)
    assert np.array_equal(levels[:, 0], np.floor(lod.astype(np.float32) * 256 + 0.5) / 256)


def test_half_float_storage_rounds_every_level() -> None:
    cube = random_cube(16)
    exact, half = (glossy.build_pyramid(cube, storage=s) for s in ("rgba32f", "rgba16f"))
    for a, b in zip(exact.levels, half.levels, strict=True):
        assert np.array_equal(b, b.astype(np.float16).astype(np.float32))
        assert 0.0 < np.abs(a - b).max() < 2e-3
    stored = glossy.Pyramid(exact.levels, storage="rgba16f").levels[0]
    assert np.array_equal(stored, exact.levels[0].astype(np.float16))


def test_half_float_storage_clamps_with_a_count() -> None:
    faces = np.ones((6, 4, 4, 3))
    faces[1, 2, 3, 0] = 1e6
    with pytest.warns(UserWarning, match="1 values beyond 65504 clamped"):
        pyramid = glossy.build_pyramid(glossy.CubeMap(faces), storage="rgba16f")
    assert pyramid.levels[0].max() == HALF_MAX


@pytest.mark.parametrize("channels", [1, 2, 3, 4, 5])
def test_any_channel_count(channels: int) -> None:
    pyramid = random_pyramid(4, channels)
    got = pyramid.sample(texel_directions(4), 0.0)
    assert got.shape == (6, 4, 4, channels)
    assert np.allclose(got, pyramid.levels[0], atol=3e-7)


def test_sizes_that_are_no_power_of_two_and_short_chains() -> None:
    rng = np.random.default_rng(2)
    pyramid = glossy.Pyramid([rng.random((6, n, n, 3)) for n in (12, 6, 3)])
    d = rng.normal(size=(200, 3))
    expected = [naive_sample(pyramid, v, 1.7) for v in d]
    assert np.abs(pyramid.sample(d, 1.7, precision="double") - expected).max() < 1e-13


def test_size_4096() -> None:
    """A ramp along the columns of one channel: the largest size keeps its place."""
    n = 4096
    ramp = np.broadcast_to(np.arange(n, dtype=np.float32)[None, None, :, None], (6, n, n, 1))
    pyramid = glossy.Pyramid([ramp])
    s = np.linspace(-0.99, 0.99, 1001)
    d = np.stack([s, 0.3 * s, np.ones_like(s)], axis=-1)
    got = pyramid.sample(d, 0.0, precision="double")[:, 0]
    assert np.abs(got - ((s + 1.0) * 0.5 * n - 0.5)).max() < 1e-9
    single = pyramid.sample(d, 0.0)[:, 0]
    assert np.abs(single - got).max() <= 1e-7 * n * 2 * 4


# --- contract -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: p.sample([0, 0, 0], 0.0), "directions: must not contain a zero vector"),
        (lambda p: p.sample([0, np.inf, 0], 0.0), "directions: must be finite"),
        (lambda p: p.sample([0, 0, 1], np.nan), "level: must not be NaN"),
        (lambda p: p.sample(np.ones((2, 3)), np.ones(3)), "directions, level: must broadcast"),
        (lambda p: p.sample([0, 0, 1], 0, filter="cubic"), "filter: must be one of linear, near"),
        (lambda p: p.sample([0, 0, 1], 0, mip="none"), "mip: must be one of"),
        (lambda p: p.sample([0, 0, 1], 0, subtexel_bits=0), "subtexel_bits: must be from 1 to 20"),
        (lambda p: glossy.Pyramid([]), "levels: must hold at least one level"),
        (lambda p: glossy.Pyramid([np.ones((6, 4, 4, 3)), np.ones((6, 3, 3, 3))]), r"levels\[1\]"),
        (lambda p: glossy.Pyramid([np.full((6, 1, 1, 3), np.nan)]), r"levels\[0\]: must be finite"),
        (lambda p: glossy.build_pyramid(random_cube(6)), "cube size: must be a power of two"),
        (lambda p: glossy.build_pyramid(random_cube(4), filter="kaiser"), "filter: must be one of"),
        (lambda p: glossy.build_pyramid(random_cube(4), storage="rgb9e5"), "storage: must be one"),
    ],
)
def test_bad_arguments_name_the_argument_and_the_rule(
    call: Callable[[glossy.Pyramid], object], message: str
) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        call(random_pyramid(4))
    assert "\n" not in str(caught.value)


def test_lookup_compiles_once_per_precision() -> None:
    """C order, strided, transposed, read-only and integer input all reach the same two builds."""
    pyramid = random_pyramid(4)
    d = np.random.default_rng(3).normal(size=(8, 3))
    frozen = d.copy()
    frozen.flags.writeable = False
    for v in (d, d[::2], np.asfortranarray(d), frozen, d.astype(np.float32), [[0, 0, 1]]):
        pyramid.sample(v, 1)
        pyramid.sample(v, np.float32(1.5), precision="double")
    signatures = getattr(sample_chain, "signatures", None)
    if signatures is None:
        pytest.skip("kernels run uncompiled (NUMBA_DISABLE_JIT)")
    assert len(signatures) <= 2


def test_warnings_are_not_raised_for_ordinary_maps() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        glossy.build_pyramid(random_cube(8))
