"""The thesis's estimators: a plain twin, furnace figures, limits, horizon lines, trace."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import plain_truth
import pytest
import tolerances
from hypothesis import given, settings
from hypothesis import strategies as st
from test_shading import LOBES, bright_cube, random_points, smooth_cube

import glossy
from glossy import thesis
from glossy.frames import reflect, spherical, to_world

ESTIMATORS = thesis.ESTIMATORS
Float64Array = npt.NDArray[np.float64]

SINGLE_RMS = 1e-5
"""Relative RMS of float32 against float64: a level off by 1e-6 moves a bright texel's share."""

DENSE = 5e-3
"""Patterns of some ten thousand half vectors against their limit: cells cut by the horizon."""

MATERIAL = glossy.Material(
    reflection=[LOBES["fresnel"], LOBES["aniso"]], transmission=[glossy.Lobe(0.2, 0.1, r0=0.3)]
)


def alone(lobe: glossy.Lobe, side: float) -> glossy.Material:
    return glossy.Material(reflection=[lobe]) if side > 0 else glossy.Material(transmission=[lobe])


# --- the twin: eqs. 4.14-4.17 and 4.23-4.25 as they are printed, float64 --------------------------


def naive_thesis(
    points: glossy.SurfacePoints,
    material: glossy.Material,
    pyramid: glossy.Pyramid,
    estimator: str,
    samples: int = 15,
    threshold: float = 0.01,
    bias: float = 0.0,
    pattern: glossy.Pattern | None = None,
) -> Float64Array:
    """Sums over the samples above the horizon, with the material's own f and the lobe's own p."""
    out = np.zeros((*points.shape, 3))
    reach = math.sqrt(-math.log(threshold))
    for i in range(points.shape[0]):
        n, t, v = points.normal[i], points.tangent[i], points.view[i]
        b = np.cross(n, t)
        wo = np.array([v @ t, v @ b, v @ n])
        for lobe, side in material.sided_lobes():
            own = pattern or glossy.thesis_pattern(lobe, samples, threshold=threshold)
            tangents = []
            for m, azimuth in ((lobe.widths[0], 0.0), (lobe.widths[1], math.pi / 2)):
                border = reflect(wo, spherical(math.atan(reach * m), azimuth))
                cosine = float(np.clip(border @ reflect(wo, [0, 0, 1.0]), -1, 1))
                tangents.append(math.tan(math.acos(cosine)) if cosine > 0 else math.inf)
            area = min(math.pi * tangents[0] * tangents[1], 2 * math.pi)
            wi = reflect(wo, own.half_vectors)
            wi = wi[wi[:, 2] > 0]
            local = wi * [1.0, 1.0, side]
            world = local @ np.stack([t, b, n])
            d = 1.0 / np.abs(world).max(axis=-1)
            texels = area / len(own) * d**3 * pyramid.size**2 / 4
            light = pyramid.sample(world, 0.5 * np.log2(texels) + bias, precision="double")
            f = alone(lobe, side).eval(local, np.broadcast_to(wo, local.shape))
            f = f.reshape(len(wi), -1)
            p, cos = np.asarray(lobe.pdf(wi, wo))[:, None], wi[:, 2:]
            above, below = {
                "4.23": (light * cos * f, p),
                "4.24": (light * cos**2 * f, p * cos),
                "4.25": (light * cos**2 * f**2 / p, f * cos),
            }[estimator]
            whole = np.broadcast_to(below.sum(0), 3)
            out[i] += np.divide(above.sum(0), whole, out=np.zeros(3), where=whole > 0)
    return out


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_agrees_with_the_naive_twin(estimator: str) -> None:
    """Two coloured lobes and transmission; double to round-off, single to 1e-5."""
    points, pyramid = random_points(30), glossy.build_pyramid(bright_cube())
    exact = naive_thesis(points, MATERIAL, pyramid, estimator, bias=0.25)
    options: dict[str, Any] = {"samples": 15, "estimator": estimator, "bias": 0.25}
    double = glossy.shade(points, MATERIAL, pyramid, "thesis", "double", **options)
    assert np.allclose(double, exact, rtol=1e-9, atol=0)
    single = glossy.shade(points, MATERIAL, pyramid, "thesis", **options)
    assert single.dtype == np.float32
    scale = math.sqrt(np.mean(double**2))
    assert np.sqrt(np.mean((single - double) ** 2)) < SINGLE_RMS * scale


MIXED = {
    "coloured, grey": glossy.Material(
        reflection=[LOBES["fresnel"], LOBES["aniso"]],
        transmission=[glossy.Lobe(0.2, 0.1, r0=(0.3, 0.04, 0.3))],
    ),
    "metal": glossy.Material(reflection=[glossy.Lobe(0.15, ks=(0.9, 0.6, 0.2))]),
    "lacquer, foil": glossy.Material(
        reflection=[glossy.Lobe(0.2, 0.075, r0=0.05, alpha=0.5), glossy.Lobe(0.05, r0=0.3)],
        transmission=[glossy.Lobe(0.3, r0=0.05), glossy.Lobe(0.2, r0=1.0)],
    ),
    "alpha": glossy.Material(reflection=[glossy.Lobe(0.4, r0=0.2, alpha=0.3)]),
}


@pytest.mark.parametrize("name", MIXED)
@pytest.mark.parametrize("footprint", ["thesis", "paper", "jacobian"])
def test_vectorised_loop_agrees_with_the_plain_one(name: str, footprint: str) -> None:
    """Both to float32 rounding of double precision, by which the level moves a hot texel."""
    points, pyramid = random_points(500, low=0.001), glossy.build_pyramid(bright_cube())
    for estimator in ESTIMATORS:
        options: dict[str, Any] = {"footprint": footprint, "estimator": estimator, "samples": 12}
        double = glossy.shade(points, MIXED[name], pyramid, "thesis", "double", **options)
        scale = math.sqrt(np.mean(double**2))
        for kernel in ("auto", "plain"):
            value = glossy.shade(points, MIXED[name], pyramid, "thesis", kernel=kernel, **options)
            assert np.sqrt(np.mean((value - double) ** 2)) < SINGLE_RMS * scale


def test_the_plain_loop_is_taken_when_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    monkeypatch.setattr(thesis, "shade_mean_tiles", lambda *args: calls.append(len(args)))
    points, pyramid = random_points(3), glossy.build_pyramid(bright_cube(16))
    for material in (MATERIAL, MIXED["metal"]):
        assert glossy.shade(points, material, pyramid, "thesis", kernel="plain").all()
    assert not calls
    assert not glossy.shade(points, MATERIAL, pyramid, "thesis").any()
    assert len(calls) == 1


@pytest.mark.parametrize("name", LOBES)
@pytest.mark.parametrize("kind", ["regular", "importance"])
def test_takes_any_pattern(name: str, kind: str) -> None:
    """The densities are those of the lobe, wherever the half vectors come from."""
    points, pyramid = random_points(10, seed=3), glossy.build_pyramid(bright_cube(16))
    lobe = LOBES[name]
    own = (
        glossy.regular_pattern(lobe, 3, "s2", 0.01)
        if kind == "regular"
        else glossy.importance_pattern(lobe, 30)
    )
    material = glossy.Material(reflection=[lobe])
    for estimator in ESTIMATORS:
        exact = naive_thesis(points, material, pyramid, estimator, pattern=own)
        value = glossy.shade(
            points, material, pyramid, "thesis", "double", estimator=estimator, pattern=own
        )
        assert np.allclose(value, exact, rtol=1e-9, atol=0)
    bare = glossy.Pattern(own.half_vectors)
    with pytest.raises(ValueError, match="must have a cell for footprint 'jacobian'"):
        glossy.shade(points, material, pyramid, "thesis", pattern=bare, footprint="jacobian")
    value = glossy.shade(points, material, pyramid, "thesis", pattern=own, footprint="jacobian")
    assert np.all(np.isfinite(value))


def test_linear_in_ks_and_black_where_nothing_is_left() -> None:
    """f may include ks: 4.25 divides one ks of two away. No Fresnel term, no division by zero."""
    points, pyramid = random_points(20), glossy.build_pyramid(bright_cube(16))
    for estimator in ESTIMATORS:
        one, half = (
            glossy.shade(points, glossy.Lobe(0.2, ks=ks, r0=0.1), pyramid, "thesis", "double",
                         estimator=estimator)
            for ks in (1.0, (0.5, 0.25, 0.0))
        )  # fmt: skip
        assert np.allclose(half, one * [0.5, 0.25, 0.0], rtol=tolerances.ROUNDOFF, atol=0)
    mirror = glossy.SurfacePoints([0, 0, 1.0], [1.0, 0, 0], [0, 0, 1.0])
    dark = glossy.shade(mirror, glossy.Lobe(0.2, r0=0.0), pyramid, "thesis", samples=1)
    assert np.array_equal(dark, np.zeros(3))
    with pytest.warns(UserWarning, match="1 of 1 points look into the surface"):
        behind = glossy.SurfacePoints([0, 0, 1.0], [1.0, 0, 0], [0.6, 0, -0.8])
    assert np.array_equal(glossy.shade(behind, LOBES["iso"], pyramid, "thesis"), np.zeros(3))


# --- furnace --------------------------------------------------------------------------------------


def view_at(degrees: float) -> glossy.SurfacePoints:
    a = math.radians(degrees)
    return glossy.SurfacePoints([0, 0, 1.0], [1.0, 0, 0], [math.sin(a), 0.0, math.cos(a)])


WHITE = glossy.Pyramid([np.ones((6, 1, 1, 3), dtype=np.float32)])

PUBLISHED = [
    (0.15, 30, 0, (1.008, 1.009, 1.009)),
    (0.15, 30, 60, (0.953, 1.067, 1.067)),
    (0.15, 30, 80, (1.018, 1.429, 1.432)),
    (0.5, 30, 80, (1.327, 1.831, 1.864)),
    (0.15, 7, 80, (0.847, 1.309, 1.310)),
]
"""m, n, view angle: radiance over albedo of the three estimators, to three digits."""


@pytest.mark.parametrize(("m", "n", "angle", "ratios"), PUBLISHED)
def test_white_furnace(m: float, n: int, angle: float, ratios: tuple[float, ...]) -> None:
    lobe, points = glossy.Lobe(m), view_at(angle)
    own = glossy.thesis_pattern(lobe, 7) if n == 7 else glossy.regular_pattern(lobe, 3, "s2", 0.1)
    albedo = float(glossy.Material(reflection=[lobe]).albedo(points.local_view)[0])
    for estimator, ratio in zip(ESTIMATORS, ratios, strict=True):
        value = glossy.shade(points, lobe, WHITE, "thesis", "double", pattern=own,
                             estimator=estimator)  # fmt: skip
        assert value[0] / albedo == pytest.approx(ratio, abs=1.5e-3)  # seen at azimuth 0


@settings(max_examples=30)
@given(
    st.floats(0.01, 2.0), st.floats(0.01, 2.0), st.floats(0.001, 1.0), st.floats(0.0, 6.3),
    st.sampled_from(ESTIMATORS), st.integers(1, 40),
)  # fmt: skip
def test_never_brighter_than_twice_the_brightest_texel(
    mx: float, my: float, cosine: float, phi: float, estimator: str, samples: int
) -> None:
    """Eq. (4): X < 2 L for alpha = 0, and a mean of X is no larger than the largest."""
    wo = spherical(math.acos(cosine), phi)
    points = glossy.SurfacePoints([0, 0, 1.0], [1.0, 0, 0], wo)
    value = glossy.shade(points, glossy.Lobe(mx, my), WHITE, "thesis", "double",
                         estimator=estimator, samples=samples)  # fmt: skip
    assert np.all(value >= 0.0)
    assert np.all(value < 2.0)


# --- limits ---------------------------------------------------------------------------------------


def limit(
    points: glossy.SurfacePoints,
    lobe: glossy.Lobe,
    cube: glossy.CubeMap,
    estimator: str,
    density: str,
    reach: float = 4.0,
) -> Float64Array:
    """What a dense pattern tends to: integrals over slopes out to ``reach`` widths, midpoint rule.

    ``density`` of the half vectors: "uniform" in solid angle, or "importance" (D hz).
    """
    mx, my = lobe.widths
    r, turn = np.meshgrid((np.arange(400) + 0.5) / 400 * reach, np.arange(480) * (math.pi / 240))
    slopes = np.stack([mx * r * np.cos(turn), my * r * np.sin(turn)], axis=-1)
    h = plain_truth.unit(np.concatenate([slopes, np.ones((*r.shape, 1))], axis=-1))
    wo = np.broadcast_to(points.local_view.reshape(3), h.shape)
    wi = reflect(wo, h)
    keep = (wi[..., 2] > 0) & (np.sum(wo * h, -1) > 0)
    wi, wo, h, r = wi[keep], wo[keep], h[keep], r[keep]
    f = glossy.Material(reflection=[lobe]).eval(wi, wo)
    f = f[..., None] if f.ndim == 1 else f
    p = np.asarray(lobe.pdf(wi, wo))[:, None]
    cos = wi[:, 2:]
    light = cube.lookup(to_world(wi, points.tangent.reshape(3), points.normal.reshape(3)))
    q = h[:, 2] ** 3 * r  # solid angle of a cell of the grid over slopes
    if density == "importance":
        q = np.exp(-(r**2)) * r
    x = light * f * cos / p
    w = {"4.23": p, "4.24": p * cos, "4.25": f * cos}[estimator] * q[:, None]
    return np.asarray((w * x).sum(0) / w.sum(0))


LIMIT_LOBES = [glossy.Lobe(0.3), glossy.Lobe(0.25, 0.1, r0=(0.05, 0.3, 1.0), alpha=0.5)]


@pytest.mark.parametrize("lobe", LIMIT_LOBES, ids=["m=.3", "aniso, F, alpha"])
@pytest.mark.parametrize("density", ["uniform", "importance"])
@pytest.mark.parametrize("light", ["white", "smooth"])
def test_dense_patterns_tend_to_the_limit(lobe: glossy.Lobe, density: str, light: str) -> None:
    cube = glossy.CubeMap(np.ones((6, 1, 1, 3))) if light == "white" else smooth_cube(16)
    chain = glossy.build_pyramid(cube)
    own = glossy.importance_pattern(lobe, 20_000)
    if density == "uniform":  # over the part of a cap that lies within four widths
        k = np.arange(30_000) + 0.5
        z = 1.0 - k / len(k) * (1.0 - math.cos(math.atan(4.0 * max(lobe.widths))))
        h = spherical(np.arccos(z), k * (math.pi * (3.0 - math.sqrt(5.0))))
        slopes = h[:, :2] / h[:, 2:] / lobe.widths
        own = glossy.Pattern(h[np.hypot(*slopes.T) < 4.0])
    for cosine in (0.9, 0.2):
        points = plain_truth.point(5, cosine)
        for estimator in ESTIMATORS:
            value = glossy.shade(points, lobe, chain, "thesis", "double", estimator=estimator,
                                 pattern=own, bias=-60.0)  # fmt: skip
            assert np.allclose(value, limit(points, lobe, cube, estimator, density), rtol=DENSE)


def test_the_limit_is_the_truth_only_for_narrow_lobes_away_from_grazing() -> None:
    """Uniform half vectors: off by order m^2 at 45 degrees; not at all the truth at 85."""
    cube = smooth_cube(16)
    for estimator in ESTIMATORS:
        gaps = []
        for m, cosine in ((0.02, 0.7), (0.2, 0.7), (0.2, 0.087)):
            points, lobe = plain_truth.point(5, cosine), glossy.Lobe(m)
            truth = glossy.reference(points, lobe, cube).radiance
            gaps.append(np.abs(limit(points, lobe, cube, estimator, "uniform") / truth - 1).max())
        assert gaps[0] < 2e-3
        assert gaps[1] > 5e-3
        assert gaps[2] > 0.1


def test_importance_patterns_narrow_the_lobe() -> None:
    """Their density comes in twice: D^2 is a lobe of m/sqrt(2), and that is what is averaged."""
    rng = np.random.default_rng(3)
    cube = glossy.CubeMap(rng.random((6, 16, 16, 3)) ** 8)
    points = plain_truth.point(5, 0.95)
    lobe, narrow = glossy.Lobe(0.1), glossy.Lobe(0.1 / math.sqrt(2.0))
    value = limit(points, lobe, cube, "4.24", "importance")
    truth, other = (glossy.reference(points, x, cube).radiance for x in (lobe, narrow))
    assert np.abs(value / other - 1).max() < 0.02
    assert np.abs(value / truth - 1).max() > 0.05


# --- the horizon line of the thesis's Fig. 4.23 ---------------------------------------------------


FACES = np.full((6, 1, 1, 3), 0.1, dtype=np.float32)
FACES[4] = 1.0  # +z
SLOPED = glossy.Pyramid([FACES])


def steepest(estimator: str, alpha: float, steps: int, light: glossy.Pyramid = WHITE) -> float:
    """Largest change between neighbours on a line of views through a sample's horizon."""
    lobe = glossy.Lobe(0.3, alpha=alpha)
    angle = np.radians(np.linspace(60.0, 75.0, steps))
    view = np.stack([np.sin(angle), np.zeros(steps), np.cos(angle)], axis=-1)
    points = glossy.SurfacePoints(
        np.broadcast_to([0, 0, 1.0], view.shape), np.broadcast_to([1.0, 0, 0], view.shape), view
    )
    value = glossy.shade(points, lobe, light, "thesis", "double", samples=7, estimator=estimator)
    return float(np.abs(np.diff(value[:, 0])).max() / value[:, 0].mean())


def test_4_23_jumps_at_a_samples_horizon_and_the_others_do_not() -> None:
    """A jump stays however close the views are; a slope shrinks with their distance."""
    coarse, fine = steepest("4.23", 0.0, 400), steepest("4.23", 0.0, 40_000)
    assert fine > 0.05
    assert fine > 0.8 * coarse
    for estimator in ("4.24", "4.25"):
        assert steepest(estimator, 0.0, 40_000) < 0.03 * steepest(estimator, 0.0, 400)


def test_alpha_1_brings_the_line_back_for_4_25_only() -> None:
    """Its weight f (wi.n) goes as (wi.n)^(1 - alpha)."""
    assert steepest("4.25", 1.0, 40_000, SLOPED) > 0.05
    assert steepest("4.24", 1.0, 40_000, SLOPED) < 2e-3


# --- trace and refusals ---------------------------------------------------------------------------


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_trace_adds_up_and_states_its_shares(estimator: str) -> None:
    points, pyramid = random_points(4), glossy.build_pyramid(bright_cube(16))
    options: dict[str, Any] = {"estimator": estimator, "samples": 9}
    picture = glossy.shade(points, MATERIAL, pyramid, "thesis", "double", **options)
    for i in range(4):
        trace = glossy.trace(points[i], MATERIAL, pyramid, "thesis", "double", **options)
        assert np.array_equal(trace.radiance, picture[i])
        assert np.allclose(trace.tap_sum, picture[i], rtol=1e-12)
        for j, (lobe, side) in enumerate(MATERIAL.sided_lobes()):
            own = [tap for tap in trace.taps if tap.lobe == j and tap.kept]
            assert np.allclose(np.sum([tap.share for tap in own], axis=0), 1.0, rtol=1e-12)
            local = np.array([tap.wi_local for tap in own])
            wo = np.broadcast_to(trace.view_local, local.shape)
            values = alone(lobe, side).eval(local, wo).reshape(len(own), -1)
            for tap, f in zip(own, np.broadcast_to(values, (len(own), 3)), strict=True):
                assert np.allclose(tap.brdf, f, rtol=1e-9)
                mirrored = np.array(tap.wi_local) * [1.0, 1.0, side]
                assert tap.pdf_wi == pytest.approx(float(lobe.pdf(mirrored, trace.view_local)))
                term = {"4.23": tap.pdf_wi, "4.24": tap.pdf_wi * tap.cos_i, "4.25": f * tap.cos_i}
                assert np.allclose(tap.share, term[estimator] / np.array(trace.normaliser[j]))
                direct = np.array(tap.share) * f * tap.cos_i / tap.pdf_wi
                assert np.allclose(tap.weight, direct, rtol=1e-9)


def test_trace_table_says_that_dropped_samples_do_not_count() -> None:
    pyramid = glossy.build_pyramid(bright_cube(16))
    table = glossy.trace(view_at(85.0), glossy.Lobe(0.3), pyramid, "thesis").format_table()
    assert "below the horizon: adds nothing, is left out" in table
    assert "lobe 0 is divided by" in table


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"estimator": "4.26"}, "estimator: must be one of 4.23, 4.24, 4.25"),
        ({"normalisation": "paper"}, "normalisation: is no option of method 'thesis'"),
        ({"kind": "spiral"}, "kind: must be one of auto, ring"),
        ({"samples": 0}, "samples: "),
        ({"threshold": 1.0}, "threshold: "),
    ],
)
def test_bad_options_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        glossy.shade(random_points(1), LOBES["iso"], WHITE, "thesis", **options)
