"""The ``round`` filter: its taps' moments, its gather, and the law of a tap's width."""

import functools

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from symmetry import rotations, turn_faces

import glossy
from glossy._gather import TAPS
from glossy._jit import kernel
from glossy.cubemap import face_directions, texel_directions, texel_solid_angles
from glossy.pyramid import FILTERS
from glossy.round_filter import EXACT
from glossy.round_shares import RING, mean, share, spread
from glossy.round_weights import DENSE, LARGEST, dense_weights, shares, window_weights
from glossy.seams import fold_table
from glossy.taps import k_tap_level, tap_constants, tap_level, tap_width, texel_angle

FloatArray = npt.NDArray[np.floating]

ROUNDING = 64 * 2.0**-24
"""64 float32 terms in [0, 1] whose weights sum to 1 within a rounding of each."""
DESIGN = 4e-3
"""Of a tap's variance: float32 texels, and moments of the level above to second order."""
SHARED_TABLE = 1e-2
"""The same where the weights come from a neighbouring place, of a table for a smaller level."""


def random_cube(size: int, seed: int = 0) -> glossy.CubeMap:
    rng = np.random.default_rng(seed)
    return glossy.CubeMap(rng.random((6, size, size, 3), dtype=np.float32))


@functools.lru_cache(maxsize=16)
def moment_pyramids(size: int, filter: str) -> list[glossy.Pyramid]:
    """Maps that hold their own directions and products of those: a tap reads off its moments."""
    d = texel_directions(size)
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    maps = [d, d * d, d * np.roll(d, -1, axis=-1)]
    cubes = [glossy.CubeMap(m, negative="keep") for m in maps]
    return [glossy.build_pyramid(cube, filter=filter) for cube in cubes]


def tap_moments(
    size: int, filter: str, directions: FloatArray, level: float
) -> tuple[FloatArray, FloatArray]:
    """Mean (K, 2) and covariance (K, 2, 2) of taps in the plane tangent to ``directions``."""
    p = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    mean, square, mixed = (
        q.sample(p, level, precision="double") for q in moment_pyramids(size, filter)
    )
    xx, yy, zz = np.moveaxis(square, -1, 0)
    xy, yz, zx = np.moveaxis(mixed, -1, 0)
    second = np.stack([xx, xy, zx, xy, yy, yz, zx, yz, zz], -1).reshape(-1, 3, 3)
    e1 = np.cross(p, np.roll(p, 1, axis=-1) * [1, -1, 1] + [0.3, 0.1, 0.7])
    e1 /= np.linalg.norm(e1, axis=-1, keepdims=True)
    tangents = np.stack([e1, np.cross(p, e1)], axis=1)
    centre = np.einsum("kij,kj->ki", tangents, mean)
    spread = np.einsum("kai,kij,kbj->kab", tangents, second, tangents)
    return centre, spread - centre[:, :, None] * centre[:, None, :]


def random_directions(count: int, seed: int = 0) -> FloatArray:
    v = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


# --- what the taps are ----------------------------------------------------------------------------


@pytest.mark.parametrize(("size", "level"), [(64, 1), (64, 2), (64, 3), (64, 4), (512, 1), (8, 1)])
def test_texels_are_centred_with_the_stated_covariance(size: int, level: int) -> None:
    """Eq. (2) of round_weights, by numerical differences of the texel grid."""
    n = size >> level
    along = (np.arange(n) + 0.5) * 2.0 / n - 1.0
    s, t = (a.reshape(-1) for a in np.meshgrid(along, along))
    step = 1e-5
    p = face_directions(4, s, t)
    centre, covariance = tap_moments(size, "round", p, level)
    unit = [v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (
        p, face_directions(4, s + step, t), face_directions(4, s, t + step)
    )]  # fmt: skip
    jacobian = np.stack([unit[1] - unit[0], unit[2] - unit[0]], axis=-1) * (2.0 / n / step)
    d = np.linalg.norm(p, axis=-1)
    variance = 4.0 / n**2 / d**3
    texels = np.einsum("kij,kij->k", jacobian, jacobian) / 12.0
    v = variance - texels
    expected = (1.0 - np.exp(-3.0 * v)) / 3.0
    got = 0.5 * np.trace(covariance, axis1=1, axis2=2)
    tolerance = SHARED_TABLE if n > LARGEST else DESIGN
    assert np.abs(got / expected - 1.0).max() <= tolerance
    assert np.abs(centre).max() <= tolerance * np.sqrt(variance.max())


@pytest.mark.parametrize("level", [1, 2, 3])
def test_lookups_are_rounder_and_steadier_than_with_other_filters(level: int) -> None:
    """Away from texel centres, all over the sphere: axes, width against the law, and centre."""
    d = random_directions(3000)
    angle = texel_angle(d, 64)
    found = {}
    for filter in ("gauss6", "round"):
        centre, covariance = tap_moments(64, filter, d, level)
        axes = np.sqrt(np.linalg.eigvalsh(covariance))
        width = np.sqrt(0.5 * np.sum(axes**2, axis=1)) / angle / tap_width(filter, level)
        found[filter] = (
            np.median(axes[:, 1] / axes[:, 0]) - 1.0,
            width.std(),
            np.median(np.linalg.norm(centre, axis=1) / angle),
        )
    assert found["round"][0] < 0.35 * found["gauss6"][0]
    assert found["round"][1] < 0.75 * found["gauss6"][1]
    assert found["round"][0] < 0.06


@pytest.mark.parametrize("filter", FILTERS)
@pytest.mark.parametrize("level", [0.0, 0.5, 1.0, 1.7])
def test_width_law(filter: str, level: float) -> None:
    """Against the taps themselves near face centres, where all filters are round; N = 128."""
    rng = np.random.default_rng(1)
    d = face_directions(rng.integers(0, 6, 2000), *rng.uniform(-0.1, 0.1, (2, 2000)))
    _, covariance = tap_moments(128, filter, d, level)
    tangent = 0.5 * np.trace(covariance, axis1=1, axis2=2).mean()
    got = np.sqrt(-np.log1p(-3.0 * tangent) / 3.0)  # the heat kernel's variance
    expected = float(tap_width(filter, level)) * texel_angle(d, 128).mean()
    assert got == pytest.approx(expected, rel=0.02)


# --- the gather -----------------------------------------------------------------------------------


def padded(level: FloatArray) -> FloatArray:
    """A level (6, n, n, C) with ``RING`` rings of its neighbours' texels, zero beyond corners."""
    n = level.shape[1]
    out = np.zeros((6, n + 2 * RING, n + 2 * RING, level.shape[3]))
    inner = slice(RING, -RING)
    out[:, inner, inner] = level
    i = np.arange(n)
    for face in range(6):
        for edge in range(4):
            other, far0, i0, d0, far1, i1, d1 = fold_table()[face, edge]
            for d in range(RING):
                row, col = far0 * (n - 1) + i0 * i + d0 * d, far1 * (n - 1) + i1 * i + d1 * d
                at = (RING - 1 - d, RING + n + d)[edge % 2]
                place = (inner, at) if edge < 2 else (at, inner)
                out[(face, *place)] = level[other, row, col]
    return out


def naive_level(fine: FloatArray, deltas: bool) -> FloatArray:
    """float64 twin: texel by texel from the level above (6, m, m, C)."""
    n = fine.shape[1] // 2
    out = np.zeros((6, n, n, fine.shape[3]))
    if n <= DENSE:
        weights = dense_weights(n, deltas).astype(np.float64)
        return np.asarray((weights @ fine.reshape(-1, fine.shape[3])).reshape(out.shape))
    source = padded(fine)
    weights = window_weights(min(n, LARGEST), deltas).astype(np.float64)
    entries = weights.shape[0]
    for row in range(n):
        for col in range(n):
            r, c = min(row, n - 1 - row), min(col, n - 1 - col)
            i, j = (k if k < EXACT else max(k * entries // (n // 2), EXACT) for k in (r, c))
            w = weights[i, j, :: 1 if row == r else -1, :: 1 if col == c else -1]
            window = source[:, 2 * row : 2 * row + TAPS, 2 * col : 2 * col + TAPS]
            out[:, row, col] = np.einsum("ij,fijc->fc", w, window)
    return out


@pytest.mark.parametrize("size", [2, 8, 16, 64, 512])
def test_levels_agree_with_their_twin(size: int) -> None:
    pyramid = glossy.build_pyramid(random_cube(size), filter="round")
    for i in range(1, min(len(pyramid.levels), 6 if size < 512 else 2)):
        expected = naive_level(pyramid.levels[i - 1].astype(np.float64), i == 1)
        assert np.abs(pyramid.levels[i] - expected).max() <= ROUNDING


@pytest.mark.parametrize("value", [1.0, 0.1, 3.3e-30, 7.7e30])
@pytest.mark.parametrize("size", [1, 2, 64])
def test_constant_map_stays_constant_within_rounding(size: int, value: float) -> None:
    cube = glossy.CubeMap(np.full((6, size, size, 3), value))
    for level in glossy.build_pyramid(cube, filter="round").levels:
        assert np.abs(level / cube.faces[0, 0, 0, 0] - 1.0).max() <= ROUNDING


def test_turning_the_cube_turns_every_level() -> None:
    """All 48 symmetries at a size with windows, borders and dense levels."""
    cube = random_cube(32)
    levels = glossy.build_pyramid(cube, filter="round").levels
    for r in rotations(mirrors=True):
        turned = glossy.build_pyramid(glossy.CubeMap(turn_faces(cube.faces, r)), filter="round")
        for a, b in zip(turned.levels, levels, strict=True):
            assert np.abs(a - turn_faces(np.ascontiguousarray(b), r)).max() <= ROUNDING


def test_weights_are_not_negative_and_sum_to_one() -> None:
    for n in (16, 32):
        for deltas in (True, False):
            weights = window_weights(n, deltas)
            assert weights.min() >= 0.0
            assert np.abs(weights.sum(axis=(2, 3), dtype=np.float64) - 1.0).max() <= 1e-6


# --- how much of level 0 the texels stand for -----------------------------------------------------


@pytest.mark.parametrize(("level", "most"), [(1, 1.08), (2, 1.16), (3, 1.24)])
def test_edges_are_not_counted_much_more_than_once(level: int, most: float) -> None:
    """Integral over a level of a map that is lit along all edges, over that of the map.

    Not 1: the crease of the law's width alone gives the Gaussians themselves 1.04, 1.08, 1.11.
    """
    lit = np.zeros((6, 64, 64, 3), dtype=np.float32)
    lit[:, [0, -1]] = lit[:, :, [0, -1]] = 1.0
    levels = glossy.build_pyramid(glossy.CubeMap(lit), filter="round").levels
    total = [np.sum(a[..., 0] * texel_solid_angles(a.shape[1])) for a in (levels[0], levels[level])]
    assert 0.95 <= total[1] / total[0] <= most


def test_spread_is_the_transpose_of_mean() -> None:
    weights = window_weights(16, False).astype(np.float64)
    x, a = np.random.default_rng(3).random((16, 16)), np.random.default_rng(4).random((8, 8))
    assert np.sum(a * mean(weights, x)) == pytest.approx(np.sum(spread(weights, a) * x), rel=1e-12)


def test_mean_of_windows_is_that_of_the_pyramid() -> None:
    """On a map with all symmetries of the cube."""
    quarter = np.random.default_rng(5).random((16, 16))
    quarter += quarter.T
    face = np.block([[quarter, quarter[:, ::-1]], [quarter[::-1], quarter[::-1, ::-1]]])
    cube = glossy.CubeMap(np.broadcast_to(face[..., None], (6, 32, 32, 3)))
    level = glossy.build_pyramid(cube, filter="round").levels[1][4, :8, :8, 0]
    got = mean(window_weights(16, True).astype(np.float64), quarter)
    assert np.abs(got / level - 1.0).max() <= ROUNDING


def test_shares_cover_a_line_evenly() -> None:
    """Kernels on a circle whose width varies: column sums come out even."""
    x = np.arange(64)
    width = 3.0 + np.abs(x / 32.0 - 1.0)
    distance = np.minimum(abs(x - x[:, None]), 64 - abs(x - x[:, None]))
    kernels = np.exp(-0.5 * (distance / width[:, None]) ** 2)
    kernels /= kernels.sum(axis=1, keepdims=True)
    one = np.ones(64)
    found = share(lambda a: a @ kernels, lambda v: kernels @ v, one, one)
    assert np.abs(found @ kernels - 1.0).max() < 0.5 * np.abs(one @ kernels - 1.0).max()
    assert found.sum() == pytest.approx(64.0, rel=1e-12)


@pytest.mark.parametrize("n", [1, 4, 16, 128])
def test_shares_add_up_to_the_sphere(n: int) -> None:
    assert 6.0 * shares(n).sum() * 4.0 / n**2 == pytest.approx(4.0 * np.pi, rel=1e-5)
    assert shares(n).min() > 0.0


# --- the law's inverse ----------------------------------------------------------------------------


@given(st.sampled_from(FILTERS), st.floats(0.0, 13.0))
def test_level_of_a_width_is_the_inverse(filter: str, level: float) -> None:
    assert float(tap_level(filter, tap_width(filter, level))) == pytest.approx(level, abs=1e-7)


@kernel
def _levels(variances: FloatArray, a: float, b: float, out: FloatArray) -> None:
    for i in range(variances.size):
        out[i] = k_tap_level(variances[i], a, b)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("filter", FILTERS)
def test_kernel_agrees_with_tap_level(filter: str, dtype: type) -> None:
    widths = np.linspace(0.0, 300.0, 5000)
    out: FloatArray = np.empty(widths.size, dtype=dtype)
    a, b = tap_constants(filter)
    _levels((widths**2).astype(dtype), dtype(a), dtype(b), out)
    tolerance = 1e-6 if dtype == np.float32 else 1e-7  # 1/6 and 1/3 are float32 in the kernel
    assert np.abs(out - tap_level(filter, widths)).max() <= tolerance


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tap_width("kaiser", 1), "filter: must be one of"),
        (lambda: tap_width("box", np.nan), "level: must be finite"),
        (lambda: tap_level("box", -1.0), "width: must be finite and not negative"),
        (lambda: texel_angle([0, 0, 0], 4), "directions: must not contain a zero vector"),
    ],
)
def test_bad_arguments(call: object, message: str) -> None:
    assert callable(call)
    with pytest.raises(ValueError, match=message):
        call()
