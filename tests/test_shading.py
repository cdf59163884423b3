"""The real-time estimators against a plain float64 twin, their limits, and their contract."""

import math
import warnings
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import glossy
from glossy import methods, shading, tiles
from glossy.frames import normalise, reflect, sphere_tangent, spherical, to_world

Float64Array = npt.NDArray[np.float64]

SINGLE_RMS = 1e-5
"""Relative RMS of float32 against float64: a level off by 1e-6 moves a bright texel's share."""

LOBES = {
    "iso": glossy.Lobe(0.15),
    "aniso": glossy.Lobe(0.2, 0.075),
    "fresnel": glossy.Lobe(0.1, ks=(0.9, 0.5, 0.2), r0=(0.04, 0.3, 1.0), alpha=0.5),
    "rough": glossy.Lobe(0.6, alpha=1.0),
}


def smooth_cube(size: int = 32) -> glossy.CubeMap:
    """Bright and dark, but of low order: what a pyramid represents well."""
    d = normalise(glossy.cubemap.texel_directions(size))
    return glossy.CubeMap(
        np.stack([1.0 + d[..., 0], 1.5 + d[..., 1] * d[..., 2], d[..., 2] ** 2], -1)
    )


def bright_cube(size: int = 64) -> glossy.CubeMap:
    """A few hot texels on noise."""
    rng = np.random.default_rng(4)
    faces = rng.random((6, size, size, 3)) * 0.2
    hot = rng.integers(0, [6, size, size], (40, 3))
    faces[hot[:, 0], hot[:, 1], hot[:, 2]] = rng.uniform(10, 3000, (40, 3))
    return glossy.CubeMap(faces)


def random_points(count: int, seed: int = 0, low: float = 0.05) -> glossy.SurfacePoints:
    """Random frames and views, cos theta_o from ``low`` to 1."""
    rng = np.random.default_rng(seed)
    n = normalise(rng.normal(size=(count, 3)))
    t = normalise(np.cross(n, rng.normal(size=(count, 3))))
    local = spherical(np.arccos(rng.uniform(low, 1.0, count)), rng.uniform(0, 2 * math.pi, count))
    return glossy.SurfacePoints(n, t, to_world(local, t, n))


# --- the twin: the paper's shader, line by line, float64 ------------------------------------------


def naive_shade(
    points: glossy.SurfacePoints,
    material: glossy.Material,
    pyramid: glossy.Pyramid,
    method: str,
    footprint: str = "paper",
    normalisation: str = "paper",
    threshold: float = 0.1,
    samples: int = 20,
    bias: float = 0.0,
) -> Float64Array:
    """``EvaluateSpecularLobe`` with f, pdf and angles computed as the equations are printed."""
    out = np.zeros((*points.shape, 3))
    for i in range(points.shape[0]):
        n, t, v = points.normal[i], points.tangent[i], points.view[i]
        b = np.cross(n, t)
        wo = np.array([v @ t, v @ b, v @ n])
        for lobe, side in material.sided_lobes():
            mx, my = lobe.widths
            if method == "regular":
                pattern = glossy.pattern_for_budget(lobe, samples=samples, threshold=threshold)
            else:
                pattern = glossy.importance_pattern(lobe, samples=samples)
            h = pattern.half_vectors
            theta, phi = np.arccos(h[:, 2]), np.arctan2(h[:, 1], h[:, 0])
            slope = (np.cos(phi) / mx) ** 2 + (np.sin(phi) / my) ** 2
            D = np.exp(-(np.tan(theta) ** 2) * slope) / (math.pi * mx * my * np.cos(theta) ** 4)
            reach = math.sqrt(-math.log(threshold))
            tangents = []
            for m, azimuth in ((mx, 0.0), (my, math.pi / 2)):
                border = reflect(wo, spherical(math.atan(reach * m), azimuth))
                cosine = float(np.clip(border @ reflect(wo, [0, 0, 1.0]), -1, 1))
                tangents.append(math.tan(math.acos(cosine)) if cosine > 0 else math.inf)
            A = min(math.pi * tangents[0] * tangents[1], 2 * math.pi)
            for k in range(len(h)):
                cos_h = float(wo @ h[k])
                wi = 2 * cos_h * h[k] - wo
                if wi[2] <= 0:
                    continue
                world = wi[0] * t + wi[1] * b + side * wi[2] * n
                d = 1.0 / np.abs(world).max()
                if method == "importance":
                    p = D[k] * h[k, 2] / (4 * cos_h)
                    texels = pyramid.size**2 / 4 * d**3 / (len(h) * p)
                else:
                    p_h = np.mean(D) if normalisation == "paper" else np.mean(D * h[:, 2])
                    p = p_h / (4 * cos_h)
                    cell = np.asarray(pattern.cell, dtype=np.float64)
                    texels = {
                        "paper": A * pyramid.size**2 / (4 * len(h)) * d / cos_h,
                        "thesis": A * pyramid.size**2 / (4 * len(h)) * d**3,
                        "jacobian": 4 * cos_h * cell * pyramid.size**2 / 4 * d**3,
                    }[footprint]
                L = pyramid.sample(world, 0.5 * math.log2(texels) + bias, precision="double")
                r0 = np.broadcast_to(lobe.r0, 3)
                F = r0 + (1 - r0) * (1 - cos_h) ** 5
                F = F if side > 0 else 1 - F
                f = F * D[k] / (4 * cos_h * (wi[2] * wo[2]) ** lobe.alpha)
                out[i] += np.broadcast_to(lobe.ks, 3) * L * f * wi[2] / p / len(h)
    return out


CASES = [
    ("regular", {"footprint": f, "normalisation": n, "bias": b})
    for f, n, b in (
        ("paper", "paper", 0.0),
        ("thesis", "projected", 0.5),
        ("jacobian", "paper", -1),
    )
] + [("importance", {"bias": 0.25})]


@pytest.mark.parametrize("method_options", CASES, ids=str)
@pytest.mark.parametrize("name", LOBES)
def test_agrees_with_the_naive_twin(
    name: str, method_options: tuple[str, dict[str, float]]
) -> None:
    """Double to round-off (the twin's arccos costs digits at the lobe's border), single to 1e-5."""
    method, options = method_options
    points, pyramid = random_points(40), glossy.build_pyramid(bright_cube())
    material = glossy.Material(reflection=[LOBES[name]])
    expected = naive_shade(points, material, pyramid, method, samples=14, **options)  # type: ignore[arg-type]
    double, single, plain = (
        glossy.shade(
            points, material, pyramid, method, precision=p, kernel=k, samples=14, **options
        )
        for p, k in (("double", "auto"), ("single", "auto"), ("single", "plain"))
    )
    scale = math.sqrt(np.mean(expected**2))
    assert double.dtype == np.float64
    assert single.dtype == plain.dtype == np.float32
    assert math.sqrt(np.mean((double - expected) ** 2)) <= 1e-9 * scale
    assert math.sqrt(np.mean((single - double) ** 2)) <= SINGLE_RMS * scale
    assert math.sqrt(np.mean((plain - double) ** 2)) <= SINGLE_RMS * scale


@pytest.mark.parametrize("count", [1, 63, 64, 65, 200])
@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.5, 1.0])
def test_vectorised_loop_agrees_with_the_plain_one(count: int, alpha: float) -> None:
    """Both float32; they differ in the logarithm and the order of the eight texels."""
    points, pyramid = random_points(count, low=1e-3), glossy.build_pyramid(bright_cube())
    lobe = glossy.Lobe(0.3, 0.1, ks=(1.0, 0.5, 0.0), r0=(0.0, 0.5, 1.0), alpha=alpha)
    material = glossy.Material(reflection=[lobe, LOBES["iso"]], transmission=[lobe])
    for footprint in ("paper", "thesis", "jacobian"):
        tiled, plain = (
            glossy.shade(points, material, pyramid, footprint=footprint, kernel=k)
            for k in ("auto", "plain")
        )
        assert np.all(np.isfinite(tiled))
        scale = math.sqrt(np.mean(plain.astype(float) ** 2))
        assert math.sqrt(np.mean((tiled - plain) ** 2.0)) <= SINGLE_RMS * scale


def test_vectorised_loop_is_left_where_it_does_not_apply() -> None:
    full = glossy.build_pyramid(bright_cube(16))
    odd = glossy.Pyramid([np.ones((6, n, n, 3)) for n in (12, 6, 3)])
    short = glossy.Pyramid(full.levels[:3])
    config: Any = numba.config
    compiled = not config.DISABLE_JIT
    assert [tiles.fits(p, np.float32, 0.0) for p in (full, odd, short)] == [compiled, False, False]
    assert not tiles.fits(full, np.float64, 0.0)
    assert not tiles.fits(full, np.float32, 256.0)
    for pyramid in (odd, short):
        assert np.all(glossy.shade(random_points(5), LOBES["iso"], pyramid) > 0.0)


def test_transmission_looks_through_the_surface() -> None:
    points, pyramid = random_points(30), glossy.build_pyramid(bright_cube())
    material = glossy.Material(
        reflection=[LOBES["fresnel"]], transmission=[glossy.Lobe(0.2, 0.1, r0=0.3)]
    )
    expected = naive_shade(points, material, pyramid, "regular")
    got = glossy.shade(points, material, pyramid, precision="double")
    assert np.allclose(got, expected, rtol=1e-8)
    alone = glossy.Material(transmission=[glossy.Lobe(0.2, r0=0.0)])
    through = glossy.shade(points, alone, pyramid, precision="double")
    flipped = glossy.SurfacePoints(
        -points.normal, points.tangent, 2 * (points.view - points.normal * np.sum(
            points.view * points.normal, axis=-1, keepdims=True)) - points.view)  # fmt: skip
    mirrored = glossy.shade(flipped, glossy.Lobe(0.2, r0=1.0), pyramid, precision="double")
    assert through.shape == mirrored.shape == (30, 3)
    assert np.all(through >= 0.0)


def test_lobes_add_up() -> None:
    points, pyramid = random_points(50), glossy.build_pyramid(bright_cube())
    lobes = [LOBES["iso"], LOBES["aniso"], glossy.Lobe(0.3, ks=0.0)]
    both = glossy.shade(points, glossy.Material(reflection=lobes), pyramid, precision="double")
    parts = [glossy.shade(points, lobe, pyramid, precision="double") for lobe in lobes]
    assert np.allclose(both, sum(parts), rtol=1e-13)
    assert np.all(parts[2] == 0.0)


# --- limits ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["iso", "aniso", "fresnel"])
def test_importance_in_a_white_map_gives_the_albedo(name: str) -> None:
    """The white furnace; Hammersley points with 4000 samples integrate smooth f to 0.2 %."""
    points = random_points(12, low=0.3)
    pyramid = glossy.build_pyramid(glossy.CubeMap(np.ones((6, 8, 8, 3))))
    material = glossy.Material(reflection=[LOBES[name]])
    got = glossy.shade(points, material, pyramid, "importance", samples=4000, precision="double")
    albedo = np.broadcast_to(material.albedo(points.local_view)[0].reshape(12, -1), (12, 3))
    assert np.allclose(got, albedo, rtol=2e-3)


def test_dense_regular_patterns_tend_to_the_stated_limits() -> None:
    """projected: the albedo; paper: albedo over the integral of D (mean of D, not D cos)."""
    pyramid = glossy.build_pyramid(glossy.CubeMap(np.ones((6, 8, 8, 3))))
    point = glossy.SurfacePoints([0, 0, 1.0], [1.0, 0, 0], [0, 0, 1.0])
    for m, printed in ((0.1, -0.005), (0.15, -0.011), (0.3, -0.041), (0.5, -0.102)):
        lobe = glossy.Lobe(m)
        albedo = float(glossy.Material(reflection=[lobe]).albedo([0, 0, 1.0])[0])
        ratio = {}
        for normalisation in ("paper", "projected"):
            white = glossy.shade(
                point, lobe, pyramid, samples=90000, threshold=1e-6, normalisation=normalisation,
                precision="double")  # fmt: skip
            ratio[normalisation] = float(white[0]) / albedo - 1.0
        assert ratio["projected"] == pytest.approx(0.0, abs=2e-4)
        assert ratio["paper"] == pytest.approx(printed, abs=6e-4)


@pytest.mark.parametrize("method", ["importance", "regular"])
def test_unfiltered_samples_converge_to_the_truth(method: str) -> None:
    """At level 0 nothing but the sample count separates the estimate from the integral."""
    cube = smooth_cube()
    points = random_points(20, low=0.3)
    truth = glossy.reference(points, glossy.Material(reflection=[LOBES["aniso"]]), cube).radiance
    options: dict[str, Any] = {}
    if method == "regular":
        options = {"normalisation": "projected", "threshold": 1e-6}
    errors = []
    for samples in (100, 10000):
        got = glossy.shade(
            points, LOBES["aniso"], glossy.build_pyramid(cube), method, samples=samples,
            bias=-50.0, precision="double", **options)  # fmt: skip
        errors.append(math.sqrt(np.mean((got - truth) ** 2) / np.mean(truth**2)))
    assert errors[1] < 1e-3
    assert errors[1] < 0.2 * errors[0]


@settings(max_examples=10)
@given(st.floats(0.01, 100.0), st.sampled_from(["regular", "importance", "thesis"]))
def test_linear_in_radiance(scale: float, method: str) -> None:
    points, cube = random_points(8), bright_cube(16)
    scaled = glossy.CubeMap(cube.faces * np.float32(scale))
    a, b = (
        glossy.shade(points, LOBES["iso"], glossy.build_pyramid(c), method, precision="double")
        for c in (cube, scaled)
    )
    assert np.allclose(b, a * float(np.float32(scale)), rtol=3e-6)


@pytest.mark.parametrize("method", ["regular", "importance", "thesis"])
def test_turning_scene_and_map_together_changes_nothing(method: str) -> None:
    from symmetry import rotations, turn_faces

    points, cube = random_points(25), bright_cube(32)
    expected = glossy.shade(
        points, LOBES["aniso"], glossy.build_pyramid(cube), method, precision="double"
    )
    for r in rotations()[::5]:
        turned = glossy.SurfacePoints(points.normal @ r.T, points.tangent @ r.T, points.view @ r.T)
        pyramid = glossy.build_pyramid(glossy.CubeMap(turn_faces(cube.faces, r)))
        got = glossy.shade(turned, LOBES["aniso"], pyramid, method, precision="double")
        assert np.allclose(got, expected, rtol=2e-5, atol=1e-5)


# --- what is not seen costs nothing ---------------------------------------------------------------


def test_masked_and_back_facing_points_are_black() -> None:
    pyramid = glossy.build_pyramid(bright_cube(16))
    n = np.array([[0, 0, 1.0], [0, 0, 1.0], [np.nan, 0, 0]])
    v = np.array([[0, 0, 1.0], [0, 0.6, -0.8], [0, 0, 0]])
    with pytest.warns(UserWarning, match="1 of 2 points look into the surface"):
        points = glossy.SurfacePoints(n, view=v, mask=[True, True, False])
    for method in ("regular", "importance"):
        out = glossy.shade(points, LOBES["iso"], pyramid, method)
        assert np.all(out[0] > 0.0)
        assert np.all(out[1:] == 0.0)


def test_diffuse_term_is_added_when_the_irradiance_is_given() -> None:
    pyramid = glossy.build_pyramid(bright_cube(16))
    points = random_points(5)
    matt = glossy.Material(kd=(0.3, 0.2, 0.1))
    out = glossy.shade(points, matt, pyramid, irradiance=np.full((5, 3), math.pi))
    assert np.allclose(out, [0.3, 0.2, 0.1], rtol=1e-6)
    with pytest.warns(UserWarning, match="kd > 0 but no irradiance"):
        assert np.all(glossy.shade(points, matt, pyramid) == 0.0)


# --- the ends of single precision -----------------------------------------------------------------

METHODS = ["regular", "importance", "thesis", "lattice", "split-sum", "bent", "axis-taps"]


@pytest.mark.parametrize("method", METHODS)
def test_methods_are_linear_up_to_1e37_and_refuse_what_passes_the_end(method: str) -> None:
    """From 1e-36 up; a lobe that amplifies makes infinity of 3e38, which is one line."""
    points = random_points(40)
    relative = np.random.default_rng(3).uniform(0.7, 1.0, (6, 8, 8, 3)).astype(np.float32)
    lobe = glossy.Lobe(0.2, 0.1, r0=0.5, alpha=1.0)
    material = glossy.Material(reflection=[lobe])

    def shaded(scale: float) -> Float64Array:
        cube = glossy.CubeMap(relative * np.float32(scale))
        prepared = methods.prepare(method, cube, material)
        return np.asarray(glossy.shade(points, lobe, prepared, method) / np.float64(scale))

    base = shaded(1.0)
    for scale in (1e-36, 1e30, 1e37):
        np.testing.assert_allclose(shaded(scale), base, rtol=2e-6)
    assert base.max() > 1.2
    with pytest.raises(ValueError, match=r"^prepared: must not make .*3\.4e\+38 \(index \d+\); .*"):
        shaded(3.3e38)


def test_kept_infinities_are_no_overflow() -> None:
    faces = np.ones((6, 4, 4, 3), np.float32)
    faces[4] = np.inf
    pyramid = glossy.build_pyramid(glossy.CubeMap(faces, nonfinite="keep"))
    point = glossy.SurfacePoints([0, 0, 1.0], view=[0, 0, 1.0])
    assert not np.isfinite(glossy.shade(point, LOBES["iso"], pyramid)).any()


# --- contract -------------------------------------------------------------------------------------


def test_a_users_own_pattern_is_used_as_given() -> None:
    points, pyramid = random_points(10), glossy.build_pyramid(bright_cube())
    lobe = LOBES["aniso"]
    own = glossy.regular_pattern(lobe, circles=3, spacing="s2", threshold=0.2)
    table = glossy.Pattern(own.half_vectors, cell=own.cell, pdf_constant=own.pdf_constant)
    for footprint in ("paper", "jacobian"):
        options = {"footprint": footprint, "precision": "double"}
        expected = glossy.shade(points, lobe, pyramid, pattern=own, **options)
        got = glossy.shade(points, lobe, pyramid, pattern=table, threshold=0.2, **options)
        assert np.allclose(got, expected, rtol=1e-12)
    two = glossy.Material(reflection=[lobe, lobe])
    twice = glossy.shade(points, two, pyramid, pattern=[own, own], precision="double")
    once = glossy.shade(points, lobe, pyramid, pattern=own, precision="double")
    assert np.allclose(twice, 2.0 * once, rtol=1e-12)


def test_a_pattern_may_have_a_cell_for_each_sample() -> None:
    points, pyramid = random_points(6), glossy.build_pyramid(bright_cube())
    lobe = LOBES["aniso"]
    own = glossy.importance_pattern(lobe, samples=12)
    assert np.asarray(own.cell).shape == (12,)
    got = glossy.shade(points, lobe, pyramid, pattern=own, footprint="jacobian")
    assert np.all(np.isfinite(got))
    assert np.all(got > 0.0)


def test_fixed_point_sampler_changes_little_and_only_when_asked() -> None:
    points, pyramid = random_points(200), glossy.build_pyramid(smooth_cube(64))
    exact = glossy.shade(points, LOBES["iso"], pyramid)
    coarse = glossy.shade(points, LOBES["iso"], pyramid, subtexel_bits=8)
    difference = np.abs(coarse / exact - 1.0)
    assert 0.0 < difference.max() < 2e-3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "irregular"}, "method: must be one of regular, importance"),
        (
            {"method": "importance", "threshold": 0.1},
            "threshold: is no option of method 'importance'",
        ),
        ({"sample": 20}, "sample: is no option of method 'regular'"),
        ({"samples": 0}, "samples: must be from 1"),
        ({"footprint": "round"}, "footprint: must be one of paper, thesis, jacobian"),
        ({"normalisation": "none"}, "normalisation: must be one of"),
        ({"precision": "half"}, "precision: must be one of single, double"),
        ({"bias": math.inf}, "bias: must be finite"),
        ({"threshold": 1.0}, "threshold: must be"),
        ({"pattern": [1, 2]}, "pattern: must be a Pattern or 1"),
        ({"irradiance": np.ones((4, 3)), "material": glossy.Material(kd=1.0)}, "irradiance: must"),
    ],
)
def test_bad_options_are_refused(options: dict[str, object], message: str) -> None:
    pyramid = glossy.build_pyramid(bright_cube(8))
    material = options.pop("material", LOBES["iso"])
    with pytest.raises(ValueError, match=message) as caught:
        glossy.shade(random_points(3), material, pyramid, **options)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_same_bits_for_any_number_of_threads() -> None:
    points, pyramid = random_points(3000), glossy.build_pyramid(bright_cube())
    most = numba.get_num_threads()
    results = []
    for threads in {1, most}:
        numba.set_num_threads(threads)
        results.append(glossy.shade(points, LOBES["fresnel"], pyramid))
    numba.set_num_threads(most)
    results.append(glossy.shade(points, LOBES["fresnel"], pyramid))
    assert all(np.array_equal(results[0], r) for r in results[1:])


def test_pixels_do_not_depend_on_their_neighbours() -> None:
    points, pyramid = random_points(64), glossy.build_pyramid(bright_cube())
    whole = glossy.shade(points, LOBES["aniso"], pyramid)
    alone = np.stack([glossy.shade(points[i], LOBES["aniso"], pyramid) for i in range(64)])
    assert np.array_equal(whole, alone)


def test_kernel_compiles_once_per_precision() -> None:
    if not hasattr(shading._shade, "signatures"):
        pytest.skip("kernels run uncompiled (NUMBA_DISABLE_JIT)")
    pyramid = glossy.build_pyramid(bright_cube(8))
    for points in (random_points(4), random_points(9)[::2], random_points(6)[2]):
        for lobe in LOBES.values():
            for precision in ("single", "double"):
                glossy.shade(points, lobe, pyramid, precision=precision)
                glossy.shade(
                    points, lobe, pyramid, "importance", precision=precision, subtexel_bits=8
                )
    assert len(shading._shade.signatures) <= 2


def test_tangent_defaults_to_the_spheres_field() -> None:
    points = random_points(7)
    plain = glossy.SurfacePoints(points.normal, view=points.view)
    assert np.allclose(plain.tangent, sphere_tangent(points.normal))


def test_no_warning_for_an_ordinary_call() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        glossy.shade(random_points(3), LOBES["iso"], glossy.build_pyramid(bright_cube(8)))
