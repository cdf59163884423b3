"""The ground truth against plain sums, known answers, itself, and its own error bars."""

import dataclasses
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import plain_truth
import pytest
import tolerances
from hypothesis import given, settings
from hypothesis import strategies as st

import glossy
from glossy import CubeMap, Lobe, Material, SurfacePoints
from glossy.truth import cells, environment, montecarlo, random
from glossy.truth import nodes as block_nodes

Array = npt.NDArray[np.float64]

LOBES = {
    "iso": Material(reflection=[Lobe(0.15)]),
    "aniso": Material(reflection=[Lobe(0.2, 0.075)]),
    "coloured": Material((0.1, 0.2, 0.3), [Lobe(0.3, ks=(0.5, 0.4, 0.3), r0=(0.04, 0.5, 0.9))]),
    "grazing": Material(reflection=[Lobe(0.2, r0=0.3, alpha=0.5)]),
    "jump": Material(reflection=[Lobe(0.4, alpha=1.0)]),
    "frosted": Material(0.1, [Lobe(0.12, ks=0.8, r0=0.08)], [Lobe(0.25, 0.17, 0.7, 0.2, 0.6)]),
}


def spots(size: int, seed: int = 0, background: float = 0.05, spots: int = 1) -> CubeMap:
    """A dim map with single hot texels."""
    rng = np.random.default_rng(seed)
    faces = np.full((6, size, size, 3), background)
    for index in rng.integers(6 * size * size, size=spots):
        faces.reshape(-1, 3)[index] = rng.uniform(10.0, 500.0, size=3)
    return CubeMap(faces)


def noise(size: int, seed: int = 0) -> CubeMap:
    return CubeMap(np.random.default_rng(seed).random((6, size, size, 3)))


def white(size: int = 4) -> CubeMap:
    return CubeMap(np.ones((6, size, size, 3)))


class Foreign:
    """A material known by its three methods only."""

    def __init__(self, material: Material) -> None:
        self._own = material

    def eval(self, wi: Array, wo: Array) -> Array:
        return np.asarray(self._own.eval(wi, wo))

    def sample(self, xi: Array, wo: Array) -> Array:
        return self._own.sample(xi, wo)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return self._own.pdf(wi, wo)


class Unaware(Foreign):
    """The same with a sampler that knows nothing of its lobes: the cosine's."""

    def sample(self, xi: Array, wo: Array) -> Array:
        s, phi = np.sqrt(1.0 - xi[..., 0]), 2.0 * np.pi * xi[..., 1]
        return np.stack([s * np.cos(phi), s * np.sin(phi), np.sqrt(xi[..., 0])], axis=-1)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return np.asarray(np.maximum(wi[..., 2], 0.0) / np.pi)


class Highlight(Unaware):
    """Light from around one direction, away from the mirror's, and a diffuse tenth; albedo 1.1."""

    def eval(self, wi: Array, wo: Array) -> Array:
        axis = np.array([0.6, -0.3, 0.74]) / np.linalg.norm([0.6, -0.3, 0.74])
        lobe = np.exp(-2.0 * (1.0 - wi @ axis) / 0.02**2) / (np.pi * 0.02**2)
        lit = wi[..., 2] > 0.0
        return np.asarray(np.where(lit, 0.1 / np.pi + lobe / np.where(lit, wi[..., 2], 1.0), 0.0))


class Black(Unaware):
    def eval(self, wi: Array, wo: Array) -> Array:
        return np.zeros(np.broadcast_shapes(wi.shape, wo.shape)[:-1])


def same(a: glossy.Truth, b: glossy.Truth) -> bool:
    pairs = ((a.radiance, b.radiance), (a.error, b.error), (a.samples, b.samples))
    return all(np.array_equal(x, y) for x, y in pairs)


def test_what_a_material_returns_is_held_to_what_it_must_be() -> None:
    """NaN went into radiance and error; samples five units long five times the light."""
    wrong: list[tuple[str, Any, str]] = [
        ("eval", lambda wi, wo: np.where(wi[..., 2] > 0.9, np.nan, 1.0), "finite numbers, got nan"),
        ("eval", lambda wi, wo: np.full(wi.shape, np.inf), "finite numbers, got inf"),
        ("eval", lambda wi, wo: "much", "an array of real numbers"),
        ("eval", lambda wi, wo: np.ones(5), "an array of shape"),
        ("sample", lambda xi, wo: np.full((*xi.shape[:-1], 3), 5.0), "unit vectors"),
        ("sample", lambda xi, wo: np.zeros((*xi.shape[:-1], 3)), "unit vectors"),
        ("sample", lambda xi, wo: xi, "an array of shape"),
        ("pdf", lambda wi, wo: np.full(wi.shape[:-1], -1.0), "densities of at least 0"),
        ("pdf", lambda wi, wo: np.full(wi.shape[:-1], np.nan), "finite numbers"),
    ]
    point = SurfacePoints([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.6, 0.0, 0.8])
    for name, method, rule in wrong:
        paint = Unaware(Material(kd=0.5))
        setattr(paint, name, method)
        for estimator in ("mc",) if name == "pdf" else ("texels", "mc"):
            with pytest.raises(ValueError, match=f"^material: {name} must return {rule}") as stop:
                glossy.reference(point, paint, white(), estimator, samples=64)
            assert "\n" not in str(stop.value)


@pytest.mark.parametrize("flat", [0.2, [0.1, 0.2, 0.3]])
def test_a_material_may_return_what_broadcasts(flat: Any) -> None:
    paint = Unaware(Material(kd=0.5))
    paint.eval = lambda wi, wo: np.asarray(flat)  # type: ignore[method-assign]
    point = SurfacePoints([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.6, 0.0, 0.8])
    truth = glossy.reference(point, paint, white())  # both hemispheres, whose cosines are 2 pi
    want = 2.0 * np.pi * np.asarray(flat)
    assert np.all(np.abs(truth.radiance - want) <= truth.error + 1e-12)


# ------------------------------------------------------------------------- the bound holds


@settings(max_examples=25)
@given(
    size=st.sampled_from([1, 2, 3, 8, 13]),
    seed=st.integers(0, 2**31 - 1),
    cos_o=st.floats(0.02, 1.0),
    m=st.floats(0.1, 2.0),
    aspect=st.floats(1.0, 4.0),
    alpha=st.sampled_from([0.0, 0.3, 0.5, 1.0]),
    r0=st.sampled_from([1.0, 0.04]),
    transmitted=st.booleans(),
    tolerance=st.sampled_from([0.3, 0.03, 0.003]),
)
def test_wide_lobes_stay_within_the_bound(
    size: int,
    seed: int,
    cos_o: float,
    m: float,
    aspect: float,
    alpha: float,
    r0: float,
    transmitted: bool,
    tolerance: float,
) -> None:
    lobe = Lobe(m, max(m / aspect, 0.1), 0.8, r0, alpha)
    material = Material(transmission=[lobe]) if transmitted else Material(0.2, [lobe])
    p, cube = plain_truth.point(seed, cos_o), spots(size, seed, spots=2)
    truth = glossy.reference(p, material, cube, tolerance=tolerance)
    coarse, plain = (plain_truth.over_texels(p, material, cube, n) for n in (80, 160))
    slack = np.abs(plain - coarse).max() + tolerances.ROUNDOFF
    assert np.all(np.abs(truth.radiance - plain) <= truth.error + slack)


@settings(max_examples=25)
@given(
    size=st.sampled_from([1, 2, 5, 16]),
    seed=st.integers(0, 2**31 - 1),
    cos_o=st.one_of(st.just(1.0), st.floats(1e-3, 1.0)),
    m=st.floats(1e-4, 0.1),
    aspect=st.floats(1.0, 5.0),
    alpha=st.sampled_from([0.0, 0.5]),
    side=st.sampled_from([1.0, -1.0]),
    tolerance=st.sampled_from([0.1, 0.01]),
)
def test_narrow_lobes_stay_within_the_bound(
    size: int,
    seed: int,
    cos_o: float,
    m: float,
    aspect: float,
    alpha: float,
    side: float,
    tolerance: float,
) -> None:
    lobe = Lobe(m, max(m / aspect, 1e-4), 1.0, 0.5, alpha)
    material = Material(reflection=[lobe]) if side > 0.0 else Material(transmission=[lobe])
    p, cube = plain_truth.point(seed, cos_o), spots(size, seed)
    truth = glossy.reference(p, material, cube, tolerance=tolerance, samples=200_000)
    coarse, plain = (plain_truth.over_slopes(p, lobe, cube, n, side) for n in (200, 400))
    slack = np.abs(plain - coarse).max() + tolerances.ROUNDOFF
    assert np.all(np.abs(truth.radiance - plain) <= truth.error + slack)


@pytest.mark.parametrize("name", LOBES)
@pytest.mark.parametrize("tolerance", [0.1, 1e-3])
def test_the_tolerance_is_met_and_holds_on_a_rough_map(name: str, tolerance: float) -> None:
    cube, p = noise(32), plain_truth.points(1, 12)
    best = glossy.reference(p, LOBES[name], cube, tolerance=1e-6)
    truth = glossy.reference(p, LOBES[name], cube, tolerance=tolerance)
    assert np.all(truth.error.sum(axis=-1) <= 1.0001 * tolerance * truth.radiance.sum(axis=-1))
    assert np.all(np.abs(truth.radiance - best.radiance) <= truth.error + best.error)


@pytest.mark.parametrize("cos_o", [1e-6, 1e-3, 0.05])
@pytest.mark.parametrize("widths", [(1e-4, 1e-4), (0.1, 1e-4), (5e-4, 0.5), (2.0, 2.0)])
@pytest.mark.parametrize("alpha", [0.0, 0.5])
def test_extreme_lobes_are_finite_and_honest(
    cos_o: float, widths: tuple[float, float], alpha: float
) -> None:
    lobe = Lobe(*widths, alpha=alpha)
    p, cube = plain_truth.point(5, cos_o), noise(8)
    truth = glossy.reference(p, Material(reflection=[lobe]), cube, samples=30_000)
    coarse, plain = (plain_truth.over_slopes(p, lobe, cube, n) for n in (400, 800))
    assert np.all(np.isfinite(truth.radiance))
    assert np.all(np.isfinite(truth.error))
    slack = 2.0 * np.abs(plain - coarse).max()
    assert np.all(np.abs(truth.radiance - plain) <= truth.error + slack)


def test_too_little_work_gives_a_larger_bound_that_holds() -> None:
    cube, p = spots(16, 3), plain_truth.points(3, 8)
    material = LOBES["coloured"]
    best = glossy.reference(p, material, cube, tolerance=1e-6)
    cheap = glossy.reference(p, material, cube, tolerance=1e-6, samples=1000)
    assert np.all(cheap.samples < 3 * 1000)
    assert np.all(cheap.error.sum(axis=-1) > best.error.sum(axis=-1))
    assert np.all(np.abs(cheap.radiance - best.radiance) <= cheap.error + best.error)


def test_negative_radiance_is_carried_through() -> None:
    faces = np.random.default_rng(0).normal(size=(6, 8, 8, 3))
    p = plain_truth.point(8, 0.7)
    truth = glossy.reference(p, LOBES["iso"], CubeMap(faces, negative="keep"))
    parts = [CubeMap(np.maximum(sign * faces, 0.0)) for sign in (1.0, -1.0)]
    # the lookup is linear, so the two halves of the map add up to it
    plus, minus = (plain_truth.over_texels(p, LOBES["iso"], c, 512) for c in parts)
    assert np.all(np.abs(truth.radiance - (plus - minus)) <= truth.error + 1e-5)


# ------------------------------------------------------------------------- known answers


@pytest.mark.parametrize("name", LOBES)
def test_a_white_map_returns_the_albedo(name: str) -> None:
    p = plain_truth.points(2, 6, lowest=0.2)
    truth = glossy.reference(p, LOBES[name], white(), tolerance=1e-6)
    reflected, transmitted = (
        a[..., None] if a.ndim == 1 else a for a in LOBES[name].albedo(p.local_view)
    )
    assert truth.radiance == pytest.approx(
        np.broadcast_to(reflected + transmitted, (6, 3)), rel=tolerances.FURNACE
    )


def test_radiance_is_linear_in_the_map() -> None:
    a, b = noise(16, 1), spots(16, 2)
    both = CubeMap(2.0 * a.faces + 0.5 * b.faces)
    p, material = plain_truth.points(4, 10), LOBES["frosted"]
    x, y, z = (glossy.reference(p, material, c) for c in (a, b, both))
    gap = np.abs(2.0 * x.radiance + 0.5 * y.radiance - z.radiance)
    assert np.all(gap <= 2.0 * x.error + 0.5 * y.error + z.error + tolerances.SINGLE)


def test_lobes_and_diffuse_part_add_up() -> None:
    p, cube, material = plain_truth.points(6, 5), noise(8), LOBES["frosted"]
    parts = [
        Material(material.kd),
        Material(reflection=material.reflection),
        Material(transmission=material.transmission),
    ]
    whole = glossy.reference(p, material, cube)
    several = [glossy.reference(p, part, cube) for part in parts]
    total = np.sum([t.radiance for t in several], axis=0)
    assert whole.radiance == pytest.approx(total, rel=tolerances.ROUNDOFF)
    assert np.array_equal(whole.samples, np.sum([t.samples for t in several], axis=0))
    bare = glossy.reference(p, material, cube, diffuse=False)
    assert bare.radiance == pytest.approx(total - several[0].radiance, rel=1e-9)


@pytest.mark.parametrize("estimator", ["texels", "mc", "qmc"])
def test_masked_points_and_points_seen_from_below_give_zero(estimator: str) -> None:
    p = plain_truth.points(7, 6)
    mask = np.array([True, False, True, True, False, True])
    view = p.view.copy()
    view[0] *= -1.0
    with pytest.warns(UserWarning, match="1 of 4 points look into the surface"):
        q = SurfacePoints(p.normal, p.tangent, view, mask)
    truth = glossy.reference(q, LOBES["coloured"], noise(4), estimator, samples=128)
    assert not truth.radiance[0].any()
    assert not truth.error[0].any()
    assert not truth.radiance[~mask].any()
    assert not truth.samples[~mask].any()
    assert truth.radiance[2:4].all()


def test_the_shape_of_the_points_is_kept() -> None:
    p = plain_truth.points(9, 6)
    grid = SurfacePoints(*(a.reshape(2, 3, 3) for a in (p.normal, p.tangent, p.view)))
    flat, shaped = (glossy.reference(q, LOBES["iso"], noise(4)) for q in (p, grid))
    assert shaped.radiance.shape == shaped.error.shape == (2, 3, 3)
    assert np.array_equal(flat.radiance.reshape(2, 3, 3), shaped.radiance)
    none = SurfacePoints(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3)))
    for estimator in ("texels", "mc", "qmc"):
        truth = glossy.reference(none, LOBES["iso"], noise(4), estimator, samples=64)
        assert truth.radiance.shape == (0, 3)
    alone = glossy.reference(p[2], LOBES["iso"], noise(4))
    assert alone.radiance.shape == (3,)
    assert np.array_equal(alone.radiance, flat.radiance[2])


# ------------------------------------------------------------------------- estimators


@pytest.mark.parametrize("name", ["iso", "coloured", "frosted", "jump"])
@pytest.mark.parametrize("estimator", ["mc", "qmc"])
def test_standard_errors_are_standard_errors(name: str, estimator: str) -> None:
    """The rms of the z-scores over points and seeds is near 1."""
    cube, p, material = spots(16, 1, 0.3, spots=4), plain_truth.points(10, 24, 0.2), LOBES[name]
    best = glossy.reference(p, material, cube, tolerance=1e-5)
    z = []
    for seed in range(6):
        truth = glossy.reference(p, material, cube, estimator, samples=2048, seed=seed)
        z.append((truth.radiance - best.radiance) / truth.error)
    low, high = tolerances.Z_RMS[estimator]
    assert low < np.sqrt(np.mean(np.square(z))) < high


@pytest.mark.parametrize("name", ["frosted", "jump"])
@pytest.mark.parametrize("estimator", ["mc", "qmc"])
def test_estimators_are_unbiased(name: str, estimator: str) -> None:
    """The mean over 60 seeds misses the quadrature by its own scatter and no more."""
    cube, p, material = spots(16, 1, 0.3, spots=4), plain_truth.points(10, 24, 0.2), LOBES[name]
    best = glossy.reference(p, material, cube, tolerance=1e-5).radiance
    runs = [
        glossy.reference(p, material, cube, estimator, samples=256, seed=100 + seed).radiance
        for seed in range(60)
    ]
    mean, scatter = np.mean(runs, axis=0), np.std(runs, axis=0, ddof=1) / np.sqrt(60.0)
    assert np.sqrt(np.mean(((mean - best) / scatter) ** 2)) < 1.35


def test_errors_fall_as_they_should() -> None:
    """mc as N^-1/2: a factor of 4 from 512 to 8192 samples; qmc faster."""
    cube, p, material = noise(8), plain_truth.points(11, 30, 0.2), LOBES["coloured"]
    best = glossy.reference(p, material, cube, tolerance=1e-5).radiance

    def rms(estimator: str, samples: int) -> float:
        truth = glossy.reference(p, material, cube, estimator, samples=samples)
        return float(np.sqrt(np.mean((truth.radiance - best) ** 2)))

    assert rms("mc", 512) / rms("mc", 8192) == pytest.approx(4.0, rel=0.3)
    assert rms("qmc", 512) / rms("qmc", 8192) > 6.0
    assert rms("qmc", 8192) < 0.5 * rms("mc", 8192)


@pytest.mark.parametrize("estimator", ["mc", "qmc"])
def test_passes_accumulate_to_the_same_bits(estimator: str) -> None:
    p, cube, material = plain_truth.points(12, 5), noise(8), LOBES["frosted"]
    passes = list(glossy.reference_passes(p, material, cube, estimator, samples=1000, seed=3))
    counts = [int(t.samples[0]) for t in passes]
    assert counts == sorted(set(counts))
    assert 1000 <= counts[-1] < 1000 + 32
    assert same(passes[-1], glossy.reference(p, material, cube, estimator, samples=1000, seed=3))
    assert passes[-1].error.mean() < passes[0].error.mean()
    earlier = glossy.reference(p, material, cube, estimator, samples=counts[1], seed=3)
    assert same(passes[1], earlier)


@pytest.mark.parametrize("estimator", ["mc", "qmc"])
def test_a_tolerance_adds_passes(estimator: str) -> None:
    p, cube = plain_truth.points(13, 8), noise(8)
    truth = glossy.reference(p, LOBES["iso"], cube, estimator, tolerance=0.01)
    level = np.sqrt(np.mean(truth.error**2)) / np.sqrt(np.mean(truth.radiance**2))
    assert 0.001 < level <= 0.01
    capped = glossy.reference(p, LOBES["iso"], cube, estimator, tolerance=1e-9, samples=256)
    assert np.all(capped.samples == 256)


@pytest.mark.parametrize("estimator", ["texels", "mc", "qmc"])
def test_bits_do_not_depend_on_threads_chunks_or_other_points(
    estimator: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    p, cube, material = plain_truth.points(14, 9), noise(8), LOBES["frosted"]
    first = glossy.reference(p, material, cube, estimator, samples=1024, seed=5)
    assert same(first, glossy.reference(p, material, cube, estimator, samples=1024, seed=5))
    threads = numba.get_num_threads()
    monkeypatch.setattr(montecarlo, "CHUNK", 2048)
    try:
        numba.set_num_threads(1)
        assert same(first, glossy.reference(p, material, cube, estimator, samples=1024, seed=5))
    finally:
        numba.set_num_threads(threads)
    some = glossy.reference(p[:2], material, cube, estimator, samples=1024, seed=5)
    assert np.array_equal(some.radiance, first.radiance[:2])
    if estimator != "texels":
        other = glossy.reference(p, material, cube, estimator, samples=1024, seed=6)
        assert np.all(other.radiance != first.radiance)


@pytest.mark.parametrize("name", ["iso", "coloured", "frosted"])
def test_any_object_with_the_three_methods_is_a_material(name: str) -> None:
    p, cube, material = plain_truth.points(15, 3, 0.2), spots(5, 4, 0.5), LOBES[name]
    best = glossy.reference(p, material, cube, tolerance=1e-5)
    truth = glossy.reference(p, Foreign(material), cube)
    assert truth.error_kind == "estimate"
    assert np.all(np.abs(truth.radiance - best.radiance) <= truth.error + best.error)
    assert np.all(truth.error.sum(axis=-1) <= 1e-3 * truth.radiance.sum(axis=-1))
    for estimator in ("mc", "qmc"):
        own, foreign = (
            glossy.reference(p, m, cube, estimator, samples=256)
            for m in (material, Foreign(material))
        )
        assert same(own, foreign)


def test_a_narrow_lobe_of_a_foreign_material_is_found() -> None:
    p, cube, material = plain_truth.points(16, 3, 0.2), noise(8), Material(reflection=[Lobe(2e-3)])
    best = glossy.reference(p, material, cube)
    truth = glossy.reference(p, Foreign(material), cube)
    assert np.all(np.abs(truth.radiance - best.radiance) <= truth.error + best.error)


@pytest.mark.parametrize(
    ("m", "cos_o", "transmitted"),
    [
        ((0.026, 0.026), 0.05, False),
        ((0.026, 0.026), 1.0, True),
        ((1e-4, 1e-4), 0.5, False),
        ((1e-4, 1e-4), 0.05, True),
        ((0.01, 0.002), 0.003, False),
    ],
)
def test_a_lobe_that_its_own_sampler_misses_is_found(
    m: tuple[float, float], cos_o: float, transmitted: bool
) -> None:
    lobe, p = Lobe(*m, r0=0.3), plain_truth.point(17, cos_o)
    material = Material(transmission=[lobe]) if transmitted else Material(reflection=[lobe])
    cube = CubeMap(noise(16).faces ** 8)
    best = glossy.reference(p, material, cube, tolerance=1e-5)
    truth = glossy.reference(p, Unaware(material), cube, tolerance=0.03)
    assert truth.radiance.sum() > 0.0
    assert np.all(np.abs(truth.radiance - best.radiance) <= truth.error + best.error)


def test_a_highlight_away_from_the_mirror_direction_is_found() -> None:
    truth = glossy.reference(plain_truth.point(4, 0.5), Highlight(Material()), white())
    assert np.all(np.abs(truth.radiance - 1.1) <= truth.error)


def test_where_nothing_is_found_the_error_is_all_the_light_there_is() -> None:
    cube = spots(4, 1)
    truth = glossy.reference(plain_truth.point(4, 0.5), Black(Material()), cube)
    assert truth.error_kind == "estimate"
    assert not truth.radiance.any()
    assert np.array_equal(truth.error, cube.faces.max(axis=(0, 1, 2)))


# ------------------------------------------------------------------------- parts


def test_weights_integrate_polynomials_times_radiance_on_every_level() -> None:
    """Eq. (2) of truth.cells is exact, and parents agree with their children."""
    cube = spots(7, 2)
    tree = cells.build_tree(cube)
    n = 700
    c = (np.arange(n) + 0.5) * (2.0 / n) - 1.0
    s, t = np.meshgrid(c, c)
    light = cube.lookup(glossy.cubemap.face_directions(2, s, t))
    plain = light * ((2.0 / n) ** 2 * (1.0 + s**2 + t**2) ** -1.5 * s**5 * t**4)[..., None]
    for level in range(tree.level + 1):
        side = 1 << level
        total = np.zeros(3)
        for row in range(side):
            for col in range(side):
                edge = [tree.edge[i * len(tree.texel) >> level] for i in (row, row + 1)]
                edge += [tree.edge[i * len(tree.texel) >> level] for i in (col, col + 1)]
                y = 0.5 * (edge[0] + edge[1]) + 0.5 * (edge[1] - edge[0]) * cells.NODES
                x = 0.5 * (edge[2] + edge[3]) + 0.5 * (edge[3] - edge[2]) * cells.NODES
                g = (y[:, None] ** 4 * x**5).reshape(-1, 1)
                block = cells.k_block_index(level, 2, row, col)
                total += np.sum(tree.weights[block] * g, axis=0)
        if level == 0:
            first = total
            assert total == pytest.approx(plain.sum(axis=(0, 1)), rel=1e-3)
        assert total == pytest.approx(first, rel=1e-9)


def test_tree_holds_the_power_of_the_bilinear_map() -> None:
    for size in (1, 3, 16):
        tree = cells.build_tree(white(size))
        assert tree.mass[:6].sum(axis=0) == pytest.approx([4.0 * np.pi] * 3, rel=1e-10)
        assert tree.weights[:6].sum(axis=(0, 1)) == pytest.approx([4.0 * np.pi] * 3, rel=1e-10)


def test_a_tree_is_built_once_per_map_and_freed_with_it() -> None:
    cube = white()
    assert cells.radiance_tree(cube) is cells.radiance_tree(cube)
    before = len(cells._trees)
    del cube
    assert len(cells._trees) == before - 1


def test_environment_density_integrates_to_one_and_covers_the_light() -> None:
    cube = spots(6, 5, background=0.0)
    sampler = environment.EnvironmentSampler(cube)
    c = (np.arange(300) + 0.5) / 150.0 - 1.0
    s, t = np.meshgrid(c, c)
    total = 0.0
    for face in range(6):
        d = glossy.cubemap.face_directions(face, s, t)
        density = sampler.pdf(d)
        total += float(np.sum(density * (1.0 + s**2 + t**2) ** -1.5) / 150.0**2)
        assert np.all(density[cube.lookup(d).any(axis=-1)] > 0.0)
    assert total == pytest.approx(1.0, rel=1e-10)


def test_environment_samples_follow_their_density() -> None:
    cube = spots(5, 6, background=1.0, spots=3)
    sampler = environment.EnvironmentSampler(cube)
    u = random.uniform(1, np.array([0]), 0, 200_000, 2)[0]
    d = sampler.sample(u)
    assert np.linalg.norm(d, axis=-1) == pytest.approx(1.0, abs=tolerances.ROUNDOFF)
    face, s, t = glossy.cubemap.locate(d)
    cell = np.clip(((np.stack([t, s]) + 1.0) * 5.0).astype(int), 0, 9)  # quarters of texels
    observed = np.bincount(face * 100 + cell[0] * 10 + cell[1], minlength=600)
    c = np.arange(10) / 5.0 - 0.9
    gs, gt = np.meshgrid(c, c)
    middle = [glossy.cubemap.face_directions(f, gs, gt) for f in range(6)]
    chance = np.concatenate(
        [(sampler.pdf(m) * (1.0 + gs**2 + gt**2) ** -1.5 * 0.04).ravel() for m in middle]
    )
    expected = 200_000 * chance
    chi2 = np.sum((observed - expected) ** 2 / expected)
    assert chi2 < 600 + 4.0 * np.sqrt(2.0 * 600)


def test_black_maps_are_sampled_too() -> None:
    black = CubeMap(np.zeros((6, 4, 4, 3)))
    for estimator in ("texels", "mc", "qmc"):
        truth = glossy.reference(plain_truth.points(1, 2), LOBES["iso"], black, estimator)
        assert not truth.radiance.any()
        assert not truth.error.any()


def test_uniform_numbers_are_uniform_fine_and_a_function_of_their_counters() -> None:
    index = np.array([0, 1, 7, 10**9])
    u = random.uniform(3, index, 0, 5000, 4)
    assert np.array_equal(u[2:, 1000:1010], random.uniform(3, index[2:], 1000, 10, 4))
    assert len(np.unique(u)) == u.size
    assert 0.0 < u.min() < u.max() < 1.0
    counts = np.histogramdd(u.reshape(-1, 4), bins=[6] * 4, range=[(0.0, 1.0)] * 4)[0]
    mean = len(u) * 5000 / 6**4
    chi2 = np.sum((counts - mean) ** 2) / mean
    assert abs(chi2 - 6**4) < 4.0 * np.sqrt(2.0 * 6**4)
    scaled = u.ravel() * 2.0**24
    assert np.mean(scaled == np.floor(scaled)) < 1e-3  # finer than float32's 24 bits
    near = random.uniform(4, index, 0, 5000, 4)
    assert abs(np.corrcoef(u.ravel(), near.ravel())[0, 1]) < 0.02


def test_scrambled_points_keep_their_strata() -> None:
    """Any 256 Sobol' points put one into each 1/256 of every axis, scrambled or not."""
    index = np.arange(3)
    u = random.sobol(1, index, 0, 256, 4, 2)
    cells_hit = np.sort((u * 256.0).astype(int), axis=2)
    assert np.array_equal(cells_hit, np.broadcast_to(np.arange(256)[:, None], u.shape))
    late = random.sobol(1, index[1:], 128, 128, 4, 2)
    assert np.array_equal(u[1:, :, 128:], late)
    assert np.mean(u[0] == u[1]) == 0.0
    assert abs(u.mean() - 0.5) < 0.01


# ------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"estimator": "path"}, "estimator"),
        ({"samples": 0}, "samples"),
        ({"samples": 2.5}, "samples"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"tolerance": np.nan}, "tolerance"),
        ({"seed": -1}, "seed"),
        ({"points": 3}, "points"),
        ({"cube": np.zeros((6, 2, 2, 3))}, "cube"),
        ({"material": object()}, "material"),
        ({"material": Foreign(Material(0.5)), "diffuse": False}, "diffuse"),
        ({"cube": CubeMap(np.full((6, 2, 2, 3), np.nan), nonfinite="keep")}, "cube"),
    ],
)
@pytest.mark.parametrize("call", [glossy.reference, glossy.reference_passes])
def test_bad_arguments_are_named(change: dict[str, object], name: str, call: object) -> None:
    given_ = {"points": plain_truth.points(1, 2), "material": LOBES["iso"], "cube": white()}
    with pytest.raises(ValueError, match=f"^{name}: "):
        list(call(**{**given_, **change}) or ())  # type: ignore[operator]


def test_truth_is_a_frozen_record() -> None:
    truth = glossy.reference(plain_truth.points(1, 1), LOBES["iso"], white(), "mc", samples=64)
    assert (truth.estimator, truth.error_kind) == ("mc", "standard")
    assert truth.samples.tolist() == [64]
    with pytest.raises(dataclasses.FrozenInstanceError):
        truth.estimator = "qmc"  # type: ignore[misc]


@pytest.mark.parametrize("estimator", ["texels", "mc"])
def test_a_lobe_alone_is_a_material_of_one(estimator: str) -> None:
    lobe, cube = Lobe(0.2, 0.1), noise(8)
    point = SurfacePoints([0, 0, 1.0], [1.0, 0, 0], [0.6, 0, 0.8])
    alone, whole = (
        glossy.reference(point, m, cube, estimator, samples=512)
        for m in (lobe, Material(reflection=[lobe]))
    )
    assert np.array_equal(alone.radiance, whole.radiance)


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.5, 1.0])
def test_the_lobe_at_the_nodes_is_the_brdf_times_the_cosine(alpha: float) -> None:
    """The quadrature's own loop against ``Material.eval``; its exponential is good to 1e-12."""
    rng = np.random.default_rng(5)
    nodes = np.stack([block_nodes.NODES_S, block_nodes.NODES_T, np.ones(36)], axis=-1)
    for m in (0.5, 0.1, 0.02):
        lobe = Lobe(m, 0.5 * m, r0=0.3, alpha=alpha)
        for _ in range(20):
            frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            wo = glossy.frames.normalise([*rng.normal(size=2), rng.uniform(0.1, 2.0)])
            size, centre = rng.uniform(0.01, 0.3), rng.uniform(-0.7, 0.7, size=2)
            basis = np.stack([frame[:, 2], frame[:, 0], frame[:, 1]])
            v, w = np.empty(36), np.empty(36)
            block_nodes.k_lobe_at_nodes(
                centre[0], centre[1], size, size, basis, wo, lobe.pack(), v, w
            )
            local = (nodes * [size, size, 1.0] + [*centre, 0.0]) @ np.roll(basis, -1, axis=0)
            local /= np.linalg.norm(local, axis=-1, keepdims=True)
            cosine = np.maximum(local[:, 2], 0.0)
            expected = lobe.eval(local, wo) * cosine
            assert np.allclose(0.3 * v + 0.7 * w, expected, rtol=1e-10, atol=1e-30)
