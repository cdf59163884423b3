"""The lobes against their printed equations, their symmetries, their sampler and their digits."""

import decimal
import math
import os
from collections.abc import Callable
from typing import Any

import chi2
import numba
import numpy as np
import numpy.typing as npt
import pytest
import tolerances
from hypothesis import given
from hypothesis import strategies as st

import glossy
from glossy import _check, brdf
from glossy.brdf import Lobe, Material
from glossy.frames import spherical

Array = npt.NDArray[np.floating]
Float64Array = npt.NDArray[np.float64]

WIDTHS = st.floats(0.05, 2.0)
UNIT = st.floats(0.0, 1.0)
ANGLES = st.tuples(st.floats(0.0, 1.5), st.floats(-math.pi, math.pi))
LOBES = st.builds(Lobe, WIDTHS, WIDTHS, st.floats(0.1, 2.0), UNIT, UNIT)
UP = np.array([0.0, 0.0, 1.0])
DOWN = np.array([1.0, 1.0, -1.0])


def uniforms(n: int, seed: int) -> Float64Array:
    """(n, 2) in (0, 1] x [0, 1)."""
    xi = np.random.default_rng(seed).random((n, 2))
    xi[:, 0] = 1.0 - xi[:, 0]
    return xi


def naive(wi: Float64Array, wo: Float64Array, lobe: Lobe, transmitted: bool = False) -> Any:
    """Eqs. P2-P5 in angles: (f, pdf by P10), for wi and wo (..., 3) on the lobe's side."""
    mx, my = lobe.widths
    wi = wi * DOWN if transmitted else wi
    h = wi + wo
    h = h / np.linalg.norm(h, axis=-1, keepdims=True)
    theta = np.arctan2(np.hypot(h[..., 0], h[..., 1]), h[..., 2])
    phi = np.arctan2(h[..., 1], h[..., 0])
    q = -(np.tan(theta) ** 2) * (np.cos(phi) ** 2 / mx**2 + np.sin(phi) ** 2 / my**2)
    u = np.sum(wo * h, axis=-1)
    fresnel = np.multiply(lobe.r0, 1.0) + (1.0 - np.multiply(lobe.r0, 1.0)) * (1.0 - u) ** 5
    fresnel = 1.0 - fresnel if transmitted else fresnel
    d = np.exp(q) / (math.pi * mx * my * np.cos(theta) ** 4)
    f = lobe.ks * fresnel * d / (4.0 * u * (wi[..., 2] * wo[..., 2]) ** lobe.alpha)
    return f, np.exp(q) / (4.0 * math.pi * mx * my * np.cos(theta) ** 3 * u)


@given(LOBES, ANGLES, ANGLES, st.booleans())
def test_lobes_equal_the_printed_equations(
    lobe: Lobe, a: tuple[float, float], b: tuple[float, float], transmitted: bool
) -> None:
    """1e-9: the twin's 1 - u loses digits near the mirror direction, ours does not."""
    wi, wo = spherical(*a), spherical(*b)
    material = Material(0.0, [], [lobe]) if transmitted else Material(0.0, [lobe])
    wi = wi * DOWN if transmitted else wi
    f, pdf = naive(wi, wo, lobe, transmitted)
    assert material.eval(wi, wo) == pytest.approx(f, rel=1e-9, abs=1e-30)
    assert material.pdf(wi, wo) == pytest.approx(pdf, rel=1e-9, abs=1e-30)


@given(LOBES, ANGLES, ANGLES)
def test_reflection_is_reciprocal(
    lobe: Lobe, a: tuple[float, float], b: tuple[float, float]
) -> None:
    wi, wo = spherical(*a), spherical(*b)
    material = Material(0.2, [lobe])
    assert material.eval(wi, wo) == pytest.approx(material.eval(wo, wi), rel=tolerances.ROUNDOFF)


@given(st.floats(1e-3, 2.0), st.floats(1e-3, 2.0), ANGLES, ANGLES, st.floats(-3.0, 3.0))
def test_isotropic_lobes_do_not_feel_a_turn_and_axes_swap(
    mx: float, my: float, a: tuple[float, float], b: tuple[float, float], turn: float
) -> None:
    wi, wo = (spherical(t, p) for t, p in (a, b))
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    there, back = Lobe(mx, my, alpha=0.3), Lobe(my, mx, alpha=0.3)
    assert there.eval(wi, wo) == pytest.approx(back.eval(wi @ swap, wo @ swap), rel=1e-10)
    wide = Lobe(max(mx, 0.05), alpha=0.3)
    turned = [spherical(t, p + turn) for t, p in (a, b)]
    assert wide.eval(*turned) == pytest.approx(wide.eval(wi, wo), rel=1e-9, abs=1e-30)


def test_colours_shapes_and_sums_of_lobes() -> None:
    plain, tinted = Lobe(0.3, ks=0.5), Lobe(0.3, ks=[0.5, 0.25, 0.0], r0=[1.0, 0.5, 0.1])
    wi, wo = spherical(0.4, 0.1), spherical(np.linspace(0, 1.4, 6), -2.0)
    assert plain.eval(wi, wo).shape == (6,)
    assert plain.eval(wi, wo[0]).shape == ()
    assert tinted.eval(wi, wo).shape == (6, 3)
    assert plain.pdf(wi, wo[:, None] + np.zeros((6, 4, 3))).shape == (6, 4)
    assert plain.eval(np.empty((0, 3)), wo[0]).shape == (0,)
    both = Material([0.1, 0.2, 0.3], [plain, tinted])
    parts = plain.eval(wi, wo)[:, None] + tinted.eval(wi, wo) + np.array([0.1, 0.2, 0.3]) / math.pi
    np.testing.assert_allclose(both.eval(wi, wo), parts, rtol=1e-14)
    np.testing.assert_array_equal(tinted.eval(wi, wo)[:, 2], 0.0)
    assert both.eval(wi, wo, precision="single").dtype == np.float32
    single: Any = Lobe(0.1)
    assert Material(0.5, single).reflection == (Lobe(0.1),)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_each_term_acts_on_its_side_only(precision: str) -> None:
    lobe = Lobe(0.5, r0=0.4, alpha=1.0)
    material = Material(0.3, [lobe], [lobe])
    up, low = spherical(0.3, 0.2), spherical(math.pi - 0.3, 0.2)
    opposite = -spherical(0.7, 0.2)
    reflected, sent = Material(0.3, [lobe]), Material(0, [], [lobe])
    for wi, wo, expected in (
        (up, up, reflected),
        (low, up, sent),
        (opposite, spherical(0.7, 0.2), sent),
    ):
        value = material.eval(wi, wo, precision)
        assert value == expected.eval(wi, wo, precision)
        assert np.isfinite(value)
        assert (value > 0) == (wo[2] > 0)
    flat = np.array([1.0, 0.0, 0.0])
    for wi, wo in ((up, low), (low, low), (up, flat), (flat, up), (flat, -flat), (flat, flat)):
        assert material.eval(wi, wo, precision) == 0.0
    assert sent.eval(up, up, precision) == 0.0
    assert reflected.eval(low, up, precision) == 0.0


def test_opposite_directions_are_finite_everywhere() -> None:
    wo = spherical(np.linspace(0.0, math.pi, 50), 0.7)
    material = Material(0.1, [Lobe(0.1), Lobe(1e-5)], [Lobe(10.0, alpha=1)])
    for values in (material.eval(-wo, wo), material.pdf(-wo, wo), material.eval(wo, wo)):
        assert np.all(np.isfinite(values))


LEVEL = chi2.sidak(0.01, 15)


@pytest.mark.parametrize("theta", [0, 45, 80, 89])
@pytest.mark.parametrize("m", [(0.15, 0.15), (0.3, 0.1), (1.0, 1.0)])
def test_samples_have_their_density_and_it_integrates_to_one(
    m: tuple[float, float], theta: float
) -> None:
    """Bins about the viewer: where wi = -wo the density has a pole, integrable, at the bins' own.

    1e-6: what the bins' quadrature reaches.
    """
    lobe, wo = Lobe(*m), spherical(math.radians(theta), 0.6)
    probability = chi2.expected(lambda wi: lobe.pdf(wi, wo), wo, 0.3)
    assert probability.sum() == pytest.approx(1.0, abs=1e-6)
    samples = lobe.sample(uniforms(100_000, 11), wo)
    assert chi2.p_value(chi2.counts(samples, wo, 0.3), probability) > LEVEL


@pytest.mark.parametrize("m", [1e-4, 1e-3, 0.02])
def test_samples_of_sharp_lobes_have_their_density(m: float) -> None:
    """Bins about the mirror direction, as wide as the lobe."""
    lobe, wo = Lobe(m), spherical(0.7, 0.6)
    mirror = wo * [-1, -1, 1]
    probability = chi2.expected(lambda wi: lobe.pdf(wi, wo), mirror, m)
    assert probability.sum() == pytest.approx(1.0, abs=1e-6)
    samples = lobe.sample(uniforms(100_000, 12), wo)
    assert chi2.p_value(chi2.counts(samples, mirror, m), probability) > LEVEL


MIXTURES = [
    Material(0.4, [Lobe(0.2, ks=0.3), Lobe(0.3, 0.15, ks=0.2)]),
    Material(0.1, [Lobe(0.2, ks=[0.3, 0.1, 0.2])], [Lobe(0.25, 0.17, ks=0.6)]),
    Material([0.2, 0.5, 0.9]),
    Material(),
]


@pytest.mark.parametrize("material", MIXTURES)
def test_samples_of_a_mixture_have_its_density(material: Material) -> None:
    """Bins about the normal: the diffuse part bends at the horizon, a border between bins."""
    wo = spherical(0.5, 0.6)
    probability = chi2.expected(lambda wi: material.pdf(wi, wo), UP, 0.5)
    assert probability.sum() == pytest.approx(1.0, abs=1e-4)
    samples = material.sample(uniforms(100_000, 13), wo)
    np.testing.assert_allclose(np.linalg.norm(samples, axis=1), 1.0, atol=1e-12)
    level = chi2.sidak(0.01, len(MIXTURES))
    assert chi2.p_value(chi2.counts(samples, UP, 0.5), probability) > level


def test_the_goodness_of_fit_test_sees_a_wrong_sampler() -> None:
    """Five percent of roughness, or a swapped axis pair, is far beyond the level."""
    wo = spherical(0.7, 0.6)
    lobe = Lobe(0.3, 0.2)
    probability = chi2.expected(lambda wi: lobe.pdf(wi, wo), wo, 0.3)
    for wrong in (Lobe(0.315, 0.2), Lobe(0.2, 0.3)):
        samples = wrong.sample(uniforms(100_000, 14), wo)
        assert chi2.p_value(chi2.counts(samples, wo, 0.3), probability) < 1e-6


def invert(wi: Float64Array, wo: Float64Array, lobe: Lobe) -> Float64Array:
    """The random numbers that made wi: eq. 5 of the module, read backwards."""
    h = wi + wo
    s = h[..., :2] / h[..., 2:] / np.array(lobe.widths)
    turn = np.arctan2(s[..., 1], s[..., 0]) / (2.0 * math.pi)
    return np.stack([np.exp(-(s * s).sum(axis=-1)), turn % 1.0], axis=-1)


@pytest.mark.parametrize("m", [(1.0, 1.0), (0.2, 0.075), (1e-3, 1e-3), (1e-4, 0.1)])
def test_samples_give_their_random_numbers_back(m: tuple[float, float]) -> None:
    """Directions hold H = wi + wo to 1e-16, so slopes, in units of m, to 1e-16 (1 + s)/(m Hz).

    A hundred times that for the chain of operations.
    """
    lobe, wo = Lobe(*m), spherical(np.linspace(0.0, 1.4, 2000), 0.5)
    xi = uniforms(2000, 15)
    wi = lobe.sample(xi, wo)
    again = invert(wi, wo, lobe)
    away = np.abs(again - xi)
    away[:, 1] = np.minimum(away[:, 1], 1.0 - away[:, 1])
    radius = np.sqrt(-np.log(xi[:, 0]))
    h = np.abs(wi + wo)
    bound = 100 * 2.2e-16 * (1 + h[:, :2].max(axis=1) / h[:, 2]) / (min(m) * h[:, 2])
    assert np.all(away[:, 0] < bound)
    assert np.all(away[:, 1] * radius < bound)


@given(ANGLES, st.floats(1e-300, 1.0), UNIT, st.booleans())
def test_extreme_uniforms_sample_unit_directions(
    view: tuple[float, float], first: float, second: float, material: bool
) -> None:
    thing: Any = MIXTURES[1] if material else Lobe(10.0, 1e-5)
    wi = thing.sample([first, second], spherical(*view))
    assert np.linalg.norm(wi) == pytest.approx(1.0, abs=1e-10)


def run(material: Material, wi: Array, wo: Array, dtype: type) -> Array:
    """The kernel itself on directions of exactly these digits."""
    p = material.pack(dtype)
    out: Array = np.empty(wi.shape, dtype)
    i, o = (_check.frozen(v.astype(dtype)) for v in (wi, wo))
    brdf._eval(0, len(i), i, o, p.lobes, p.ks, p.r0, p.kd, out)
    return out


@pytest.mark.parametrize("m", [1.0, 0.15, 1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_single_precision_keeps_its_digits_at_every_roughness(m: float, alpha: float) -> None:
    """Same float32 directions in either arithmetic; q of up to -12 amplifies its round-off.

    What is lost is lost before: a direction rounded to float32 moves the slope, in units of m, by
    3e-8/m, so f changes by about 2e-8/m (median; 2e-5 at m = 1e-3).
    """
    rng = np.random.default_rng(16)
    lobe = Lobe(m, max(0.5 * m, 1e-5), r0=0.04, alpha=alpha)
    material = Material(reflection=[lobe])
    wo = spherical(np.arccos(rng.uniform(0.1, 1.0, 4000)), rng.uniform(-3.0, 3.0, 4000))
    wi = lobe.sample(uniforms(4000, 17), wo)
    wi, wo = (v[wi[:, 2] > 0.02].astype(np.float32).astype(np.float64) for v in (wi, wo))
    single, double = (run(material, wi, wo, t)[:, 0] for t in (np.float32, np.float64))
    lit = double > 1e-4 * double.max()
    assert np.abs(single / double - 1.0)[lit].max() < tolerances.SINGLE


def test_rounding_of_directions_is_what_single_precision_costs() -> None:
    """The figure of the test above, measured: median relative change 2e-8/m."""
    rng = np.random.default_rng(18)
    for m in (1e-2, 1e-3, 1e-4):
        material = Material(reflection=[Lobe(m)])
        wo = spherical(np.arccos(rng.uniform(0.1, 1.0, 4000)), rng.uniform(-3.0, 3.0, 4000))
        wi = Lobe(m).sample(uniforms(4000, 19), wo)
        true, single = material.eval(wi, wo), material.eval(wi, wo, precision="single")
        lit = true > 0
        change = np.median(np.abs(single[lit] / true[lit] - 1.0))
        assert 0.5e-8 / m < change < 8e-8 / m


@pytest.mark.parametrize("m", [1e-3, 1e-4, 1e-5])
def test_double_precision_keeps_its_digits_near_the_mirror_direction(m: float) -> None:
    """Against 50 decimal digits on the same doubles.

    1e-10: the doubles are unit to 1e-16 only, which leaves |H|/2 and wo.h that far apart; H and
    with it the slopes come out exact.
    """
    number = decimal.Decimal
    lobe = Lobe(m, r0=0.5)
    wo = spherical(np.linspace(0.0, 1.3, 25), 0.4)
    wi = lobe.sample(uniforms(25, 20), wo)
    values = run(Material(reflection=[lobe]), wi, wo, np.float64)[:, 0]
    with decimal.localcontext(prec=50):
        for i, o, value in zip(wi.tolist(), wo.tolist(), values.tolist(), strict=True):
            x, y, z = (number(a) + number(b) for a, b in zip(i, o, strict=True))
            length = (x * x + y * y + z * z).sqrt()
            q = -(((x / z) / number(m)) ** 2) - ((y / z) / number(m)) ** 2
            cosine, u = z / length, length / 2
            d = q.exp() / (number(math.pi) * number(m) ** 2 * cosine**4)
            fresnel = number("0.5") * (1 + (1 - u) ** 5)
            assert value == pytest.approx(float(fresnel * d / (4 * u)), rel=1e-10)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_schlick_keeps_its_digits_near_normal_incidence(dtype: type) -> None:
    """Directions an angle g either side of the normal: u = cos g, sin g = s, a power of two."""
    for power in range(1, 11):
        s = 2.0**-power
        wi: Array = np.array([s, 0.0, math.sqrt(1.0 - s * s)], dtype)
        wo = wi * np.array([-1, 1, 1], dtype)
        u = dtype(wi[2])
        expected = (s * s / (1.0 + math.sqrt(1.0 - s * s))) ** 5
        value = brdf.k_schlick(wi[0], wi[1], wi[2], wo[0], wo[1], wo[2], u)
        assert value == pytest.approx(expected, rel=10 * float(np.finfo(dtype).eps))


def test_kernels_compile_once_for_each_precision() -> None:
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        pytest.skip("the compiler is switched off: kernels have no signatures")
    material = Material(0.1, [Lobe(0.2, alpha=0.5)], [Lobe(0.3)])
    wi, wo = spherical(np.full((8, 6), 0.4), 0.1), spherical(np.full((8, 6), 0.6), 2.0)
    locked = wi.copy()
    locked.flags.writeable = False
    forms = (
        wi,
        wi[::2],
        locked,
        np.asfortranarray(wi),
        wi.astype(np.float32),
        wi.tolist(),
        wi[0, 0],
    )
    for precision in ("single", "double"):
        for form in forms:
            view = wo[::2] if np.shape(form) == (4, 6, 3) else wo
            material.eval(form, view, precision)
            material.pdf(form, view)
            material.sample(np.full((*np.shape(form)[:-1], 2), 0.5), view)
    kernels: list[tuple[Any, int]] = [(brdf._eval, 2), (brdf._pdf, 1), (brdf._sample, 1)]
    for kernel, precisions in kernels:
        assert len(kernel.signatures) == precisions


def test_results_do_not_depend_on_the_number_of_threads() -> None:
    wo = spherical(np.linspace(0.0, 1.5, 5000), 0.3)
    material = MIXTURES[1]
    wi = material.sample(uniforms(5000, 21), wo)
    results = []
    many = numba.get_num_threads()
    try:
        for n in (1, many):
            numba.set_num_threads(n)
            parts = (
                material.eval(wi, wo),
                material.pdf(wi, wo),
                Lobe(0.2).sample(wo[:, 1:] * 0 + 0.5, wo),
            )
            results.append([p.tobytes() for p in parts])
    finally:
        numba.set_num_threads(many)
    assert results[0] == results[1]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Lobe(0.0), "mx: must be in"),
        (lambda: Lobe(0.1, 11.0), "my: must be in"),
        (lambda: Lobe(math.nan), "mx: must be finite"),
        (lambda: Lobe(0.1, alpha=1.5), "alpha: must be in"),
        (lambda: Lobe(0.1, r0=1.5), "r0: must be in"),
        (lambda: Lobe(0.1, r0=[0.1, 0.2]), "r0: must be a number or three"),
        (lambda: Lobe(0.1, ks=-1.0), "ks: must be finite and >= 0"),
        (lambda: Material(math.inf), "kd: must be finite"),
        (lambda: Material(0.0, [0.1]), "reflection: must be a sequence of Lobe"),  # type: ignore[list-item]
        (lambda: Lobe(0.1).eval([0, 0, 2], UP), "wi: must be unit"),
        (lambda: Lobe(0.1).eval(UP, [0, 0, math.nan]), "wo: must be finite"),
        (lambda: Lobe(0.1).eval([0, 0, 0], UP), "wi: must not contain a zero"),
        (lambda: Lobe(0.1).eval([1, 2], UP), "wi: must have shape"),
        (lambda: Lobe(0.1).eval([UP] * 2, [UP] * 3), "wi, wo: must broadcast"),
        (lambda: Lobe(0.1).sample([0.0, 0.5], UP), r"xi: must be in \(0, 1\]"),
        (lambda: Lobe(0.1).sample([0.5, 1.5], UP), r"xi: must be in \(0, 1\]"),
        (lambda: Lobe(0.1).sample([math.nan, 0.5], UP), r"xi: must be in \(0, 1\]"),
        (lambda: Lobe(0.1).sample([0.5], UP), "xi: must have shape"),
        (lambda: Material().sample([0.0, 0.5], UP), r"xi: must be in \(0, 1\]"),
        (lambda: Lobe(0.1).sample([[0.5, 0.5]] * 2, [UP] * 3), "xi, wo: must broadcast"),
        (lambda: Material().eval(UP, UP, "half"), "precision: must be one of"),
    ],
)
def test_refusals(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message) as error:
        call()
    assert "\n" not in str(error.value)


def test_public_names_are_these() -> None:
    assert glossy.Lobe is Lobe
    assert glossy.Material is Material
