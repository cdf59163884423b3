"""Split sum, bent reflection and taps along the axis: what they promise, and their twins."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import tolerances
from hypothesis import given
from hypothesis import strategies as st
from symmetry import rotations, turn_faces

from glossy import CubeMap, Lobe, Material, SurfacePoints, environment, reference, shade
from glossy import split_sum_chain as make_chain
from glossy.albedo import lobe_albedo
from glossy.cubemap import texel_directions, texel_solid_angles
from glossy.frames import normalise, reflect
from glossy.render import actual_samples, render_scene
from glossy.scene import EnvironmentSource, Scene, Sphere, default_camera
from glossy.splitsum import shade as methods
from glossy.splitsum.chain import SplitSumChain, level_size

Float64Array = npt.NDArray[np.float64]
SIZE = 32
NAMES = ("split-sum", "bent", "axis-taps")
BRUSHED = Lobe(mx=0.3, my=0.1, ks=(0.9, 0.5, 0.2), r0=(0.9, 0.3, 0.04), alpha=0.4)
THIN = Lobe(mx=0.1, my=0.2, ks=0.5, r0=(0.1, 0.2, 0.3))
MATERIAL = Material(reflection=[BRUSHED, Lobe(0.2, r0=0.5)], transmission=[THIN])


@pytest.fixture(scope="module")
def cube() -> CubeMap:
    return environment("spots", SIZE)


@pytest.fixture(scope="module")
def chain(cube: CubeMap) -> SplitSumChain:
    return make_chain(cube)


def points(angle: float | None = None, count: int = 60, seed: int = 3) -> SurfacePoints:
    """Random frames seen from ``angle`` degrees off the normal, or from anywhere above."""
    rng = np.random.default_rng(seed)
    n, t = normalise(rng.normal(size=(2, count, 3)))
    t = normalise(t - np.sum(t * n, axis=1, keepdims=True) * n)
    b, phi = np.cross(n, t), rng.uniform(0.0, 2.0 * math.pi, (count, 1))
    cos = rng.uniform(0.03, 1.0, (count, 1)) if angle is None else math.cos(math.radians(angle))
    sin = np.sqrt(1.0 - np.square(cos))
    return SurfacePoints(n, t, sin * (np.cos(phi) * t + np.sin(phi) * b) + cos * n)


def relative(image: Any, truth: Any) -> float:
    """RMS error over the RMS of the truth."""
    return float(np.sqrt(np.mean(np.square(image - truth)) / np.mean(np.square(truth))))


# --- the chain ------------------------------------------------------------------------------------


@pytest.mark.parametrize("m", [0.04, 0.09, 0.3, 0.9])
def test_a_level_is_the_sum_over_all_texels(cube: CubeMap, chain: SplitSumChain, m: float) -> None:
    """Twin without table, cone or early end, all pairs of texels at once."""
    index = chain.locate(m)[0]
    level, width = chain.level(index), chain.width(index)
    n, block = level.shape[1], SIZE // level.shape[1]
    omega, fine = texel_solid_angles(n), texel_solid_angles(SIZE)
    light = np.einsum("fiajbc,iajb->fijc", cube.faces.astype(np.float64).reshape(
        6, n, block, n, block, 3), fine.reshape(n, block, n, block))  # fmt: skip
    d = normalise(texel_directions(n)).reshape(-1, 3)
    h2 = np.broadcast_to(omega, (6, n, n)).reshape(-1)
    added = h2 / 6.0 + (h2 - h2 / block**2) / 12.0 - h2 / block**2 / 6.0
    m2 = width**2 - 0.5 * added
    pick = np.random.default_rng(4).integers(0, len(d), 80)
    c = d[pick] @ d.T
    c = np.clip(c, 0.0, 1.0)
    k = np.exp(-(1.0 - c) / (1.0 + c) / m2[pick, None]) * c / ((1.0 + c) / 2.0) ** 2.5
    expected = (k @ light.reshape(-1, 3)) / (k @ h2)[:, None]
    assert relative(level.reshape(-1, 3)[pick], expected) < tolerances.LOBE_PROFILE


def test_level_zero_is_the_map_and_widths_grow_by_steps(
    cube: CubeMap, chain: SplitSumChain
) -> None:
    assert np.array_equal(chain.level(0), cube.faces)
    assert chain.width(0) == 0.0
    assert chain.width(1) == 1.0 / SIZE
    assert chain.width(9) == pytest.approx(2.0 / SIZE)
    assert [level_size(m, 256) for m in (0.001, 0.02, 0.05, 0.15, 0.5, 9.0)] == [
        256, 256, 128, 32, 16, 16,
    ]  # fmt: skip


@given(st.floats(0.0, 8.0))
def test_a_mix_of_two_levels_has_the_variance_of_the_lobe(m: float) -> None:
    chain = SplitSumChain(CubeMap(np.ones((6, 4, 4, 3))))
    index, share = chain.locate(m)
    low, high = chain.width(index), chain.width(index + 1)
    assert 0.0 <= share <= 1.0
    variance = (1.0 - share) * low**2 + share * high**2
    assert variance == pytest.approx(m * m, rel=1e-9, abs=1e-30)


def test_a_constant_map_stays_constant_and_the_chain_turns_with_the_cube() -> None:
    white = make_chain(CubeMap(np.full((6, 16, 16, 3), 0.7)))
    assert np.abs(white.level(white.locate(0.3)[0]) - np.float32(0.7)).max() < 1e-7
    rng = np.random.default_rng(6)
    faces = rng.uniform(0.1, 1.0, (6, 16, 16, 3)).astype(np.float32)
    index = white.locate(0.2)[0]
    level = make_chain(CubeMap(faces)).level(index)
    for rotation in rotations()[5:24:6]:
        turned = make_chain(CubeMap(turn_faces(faces, rotation))).level(index)
        assert np.abs(turned - turn_faces(level, rotation)).max() < tolerances.SINGLE


def test_levels_made_before_change_no_result(cube: CubeMap, chain: SplitSumChain) -> None:
    d = points().normal
    fresh = make_chain(cube, [0.4])
    assert np.array_equal(fresh.sample(d, 0.17), chain.sample(d, 0.17))
    again = chain.sample(d, 0.17)
    assert np.array_equal(again, chain.sample(d, 0.17))


# --- what the split sum promises ------------------------------------------------------------------


@pytest.mark.parametrize("m", [0.01, 0.05, 0.11, 0.15, 0.3, 0.6])
@pytest.mark.parametrize("name", ["spots", "studio"])
def test_exact_where_view_and_normal_agree(name: str, m: float) -> None:
    """N = V = R in any environment; a lobe narrower than a texel is a mix with the map itself."""
    cube = environment(name, SIZE)
    p = points(0.0)
    truth = reference(p, Lobe(m, r0=0.3), cube, tolerance=1e-4).radiance
    image = shade(p, Lobe(m, r0=0.3), make_chain(cube), method="split-sum")
    limit = tolerances.SPLIT_SUM_HEAD_ON if m * SIZE > 3.0 else tolerances.SPLIT_SUM_SHARP
    assert relative(image, truth) < limit


@pytest.mark.parametrize("name", NAMES)
def test_exact_under_white_light(name: str) -> None:
    """Isotropic lobes, reflection and transmission, any view: the material's albedo."""
    white = make_chain(environment("white", 16))
    lobes = [Lobe(0.15, ks=(0.9, 0.5, 0.2), r0=(0.9, 0.3, 0.04)), Lobe(0.5, ks=0.3, alpha=1.0)]
    material = Material(reflection=lobes, transmission=[Lobe(0.1, ks=0.4, r0=0.2)])
    p = points()
    albedo = np.add(*material.albedo(p.local_view))
    image = shade(p, material, white, method=name, precision="double")
    assert np.abs(image / albedo - 1.0).max() < tolerances.ALBEDO_TABLE


def test_the_error_grows_with_the_angle(cube: CubeMap, chain: SplitSumChain) -> None:
    """Where the assumption fails: the figures of docs/methods.md in small."""
    errors = []
    for angle in (0.0, 40.0, 70.0):
        p = points(angle, 200)
        truth = reference(p, Lobe(0.15), cube, tolerance=1e-3).radiance
        errors.append(relative(shade(p, Lobe(0.15), chain, method="split-sum"), truth))
    assert errors[0] < 0.01 < 0.1 < errors[1] < 0.3 < errors[2] < 1.0


def test_taps_along_the_axis_render_an_elongated_lobe_head_on(
    cube: CubeMap, chain: SplitSumChain
) -> None:
    p, lobe = points(0.0, 200), Lobe(0.3, 0.06)
    truth = reference(p, lobe, cube, tolerance=1e-3).radiance

    def error(method: str, **options: Any) -> float:
        return relative(shade(p, lobe, chain, method=method, **options), truth)

    one, five, sixteen = error("split-sum"), *(error("axis-taps", samples=n) for n in (5, 16))
    assert sixteen < 0.15 < 0.3 < one
    assert sixteen < five < one


# --- the methods ----------------------------------------------------------------------------------


def twin(
    p: SurfacePoints, material: Material, chain: SplitSumChain, method: str, samples: int
) -> Float64Array:
    """Eq. (1) of ``splitsum.shade`` in plain NumPy, the albedo from its quadrature."""
    wo, total = p.local_view, np.zeros((*p.shape, 3))
    for lobe, side in material.sided_lobes():
        mx, my = lobe.widths
        mean, a = 0.5 * (mx + my), abs(mx - my) / (mx + my)
        m, flat = math.sqrt(mx * my), Lobe(math.sqrt(mx * my), None, lobe.ks, lobe.r0, lobe.alpha)
        slopes, weights = np.zeros(1), np.ones(1)
        if method == "bent":
            m, flat = mean, Lobe(mean, None, lobe.ks, lobe.r0, lobe.alpha)
        if method == "axis-taps" and mx != my:
            q = 2.0 / samples
            m = max(min(mx, my), max(mx, my) * q / math.sqrt(1.0 + q * q))
            u = np.linspace(-2.5, 2.5, 2 * samples + 1)[1::2]
            weights = np.exp(-0.5 * u**2)
            u /= math.sqrt(np.average(u**2, weights=weights))
            slopes = u * math.sqrt((max(mx, my) ** 2 - m * m) / 2.0)
        light, norm = np.zeros_like(total), np.zeros((*p.shape, 1))
        for slope, weight in zip(slopes, weights, strict=True):
            h = np.zeros_like(wo)
            h[..., 0 if mx > my else 1], h[..., 2] = slope, 1.0
            if method == "bent":
                plane = wo * np.array([1.0, 0.0, 1.0] if mx > my else [0.0, 1.0, 1.0])
                s = a * min(5.0 * math.sqrt(mean), 1.0)
                h = (1.0 - s) * h + s * plane
            wi = np.asarray(reflect(wo, normalise(h)))
            up = (wi[..., 2:] > 0.0) * weight
            wi = wi * np.array([1.0, 1.0, side])
            world = wi[..., :1] * p.tangent + wi[..., 1:2] * p.bitangent + wi[..., 2:] * p.normal
            light += up * chain.sample(world, m, precision="double")
            norm += up
        total += lobe_albedo(flat, wo, side < 0.0) * light / norm
    return total


@pytest.mark.parametrize("name", NAMES)
def test_methods_are_their_twins(chain: SplitSumChain, name: str) -> None:
    p = points()
    own: dict[str, Any] = {"samples": 6} if name == "axis-taps" else {}
    expected = twin(p, MATERIAL, chain, name, 6)
    double = shade(p, MATERIAL, chain, method=name, precision="double", **own)
    assert relative(double, expected) < tolerances.ALBEDO_TABLE
    single = shade(p, MATERIAL, chain, method=name, **own)
    assert single.dtype == np.float32
    assert relative(single, double) < 10.0 * tolerances.SINGLE  # texels of contrast 3000


def test_isotropic_lobes_make_all_three_the_same(chain: SplitSumChain) -> None:
    p = points()
    images = [shade(p, Lobe(0.2), chain, method=name) for name in NAMES]
    assert np.array_equal(images[0], images[1])
    assert np.array_equal(images[0], images[2])
    hdrp = shade(p, Lobe(0.2), chain, method="bent", bend="hdrp")
    assert np.array_equal(images[0], hdrp)


@pytest.mark.parametrize("name", NAMES)
def test_turning_the_frame_swaps_the_axes(chain: SplitSumChain, name: str) -> None:
    p = points()
    turned = SurfacePoints(p.normal, p.bitangent, p.view)
    one = shade(p, Lobe(0.3, 0.1), chain, method=name, precision="double")
    other = shade(turned, Lobe(0.1, 0.3), chain, method=name, precision="double")
    assert relative(one, other) < tolerances.ROUNDOFF


def test_bending_follows_the_published_formulas() -> None:
    a, m = 0.5, 0.2
    lobe = Lobe(m * (1.0 + a), m * (1.0 - a))
    assert methods.bend_of(lobe, "filament") == pytest.approx((a, m))
    narrow = Lobe(1e-2 * (1.0 + a), 1e-2 * (1.0 - a))
    assert methods.bend_of(narrow, "filament") == pytest.approx((a * 5.0 * 0.1, 1e-2))
    s, width = methods.bend_of(narrow, "hdrp")
    assert s == pytest.approx(a * 1.5 * 1e-2**0.25)
    assert width == pytest.approx(1e-2 * 0.7**2)


@given(st.floats(0.01, 1.0), st.floats(0.01, 1.0), st.integers(1, 40))
def test_taps_and_their_width_add_up_to_the_lobe(mx: float, my: float, samples: int) -> None:
    m, taps = methods.axis_lookups(Lobe(mx, my), samples)
    slope = taps[:, 0] / taps[:, 2] if mx > my else taps[:, 1] / taps[:, 2]
    weights = taps[:, 3] / taps[:, 3].sum()
    assert np.sum(weights * slope) == pytest.approx(0.0, abs=tolerances.ROUNDOFF)
    variance = float(np.sum(weights * slope**2)) + 0.5 * m * m
    assert variance == pytest.approx(0.5 * max(mx, my) ** 2)
    assert min(mx, my) <= m <= max(mx, my)
    if len(taps) > 1:
        assert np.diff(slope).max() <= 3.5 * m / math.sqrt(2.0)  # SPACING, and the scale of u
    assert len(taps) == methods.tap_count(Lobe(mx, my), samples) == (samples if mx != my else 1)


def test_bias_is_octaves_of_blur(cube: CubeMap, chain: SplitSumChain) -> None:
    p = points()
    wide = shade(p, Lobe(0.1), chain, method="split-sum", bias=1.0, precision="double")
    ratio = lobe_albedo(Lobe(0.1), p.local_view) / lobe_albedo(Lobe(0.2), p.local_view)
    twice = shade(p, Lobe(0.2), chain, method="split-sum", precision="double")
    assert relative(wide, twice * ratio) < tolerances.ALBEDO_TABLE


def test_backs_and_unseen_points_are_black(chain: SplitSumChain) -> None:
    p = points()
    seen = np.arange(60) % 3 > 0
    with pytest.warns(UserWarning, match="60 of 60 points look into the surface"):
        back = SurfacePoints(p.normal, p.tangent, -p.view)
    masked = SurfacePoints(p.normal, p.tangent, p.view, seen)
    for name in NAMES:
        assert not shade(back, MATERIAL, chain, method=name).any()
        image = shade(masked, MATERIAL, chain, method=name)
        assert not image[~seen].any()
        assert np.array_equal(image[seen], shade(p, MATERIAL, chain, method=name)[seen])


@pytest.mark.parametrize(
    ("method", "options", "words"),
    [
        ("split-sum", {"samples": 3}, "samples: is no option"),
        ("split-sum", {"equivalent": "x"}, "equivalent: must be one of geometric, mean"),
        ("bent", {"bend": "x"}, "bend: must be one of filament, hdrp"),
        ("axis-taps", {"samples": 0}, "samples: must be at least 1"),
        ("split-sum", {"bias": np.nan}, "bias: must be finite"),
    ],
)
def test_bad_options_are_refused(
    chain: SplitSumChain, method: str, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        shade(points(), THIN, chain, method=method, **options)


def test_what_is_no_chain_and_odd_sizes_are_refused(cube: CubeMap) -> None:
    with pytest.raises(ValueError, match="prepared: must come from split_sum_chain"):
        shade(points(), THIN, cube, method="split-sum")
    with pytest.raises(ValueError, match="cube size: must be a power of two"):
        make_chain(CubeMap(np.ones((6, 3, 3, 3))))


def test_a_scene_prepares_its_own_chain(cube: CubeMap, chain: SplitSumChain) -> None:
    scene = Scene(
        environment=EnvironmentSource("spots", SIZE),
        material="mx=.3,my=.1",
        camera=default_camera(Sphere(), 8, 8),
        background="black",
        method="axis-taps",
        samples=5,
    )
    rendering = render_scene(scene)
    expected = shade(scene.points(), Lobe(0.3, 0.1), chain, method="axis-taps", samples=5)
    assert np.array_equal(rendering.image, expected)
    assert rendering.samples == [5]
    assert actual_samples(MATERIAL, "axis-taps", 5, 0.1) == [5, 1, 5]
    assert actual_samples(MATERIAL, "split-sum", 5, 0.1) == [1, 1, 1]
