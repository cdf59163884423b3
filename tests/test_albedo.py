"""Albedo against brute-force integration, energy conservation, and its hard cases."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glossy import albedo
from glossy.albedo import lobe_albedo
from glossy.brdf import Lobe, Material
from glossy.frames import spherical

Array = npt.NDArray[np.float64]

CONVERGED = 1e-9
"""Ten times the change on doubling the nodes at which the quadrature stops."""


def grazing(c: float, phi: float = 0.7) -> Array:
    """A unit direction of elevation sine c."""
    s = math.sqrt(1.0 - c * c)
    return np.array([s * math.cos(phi), s * math.sin(phi), c])


def brute(material: Material, wo: Array, n: int = 400) -> tuple[Any, Any]:
    """Integral of f |cos| over either hemisphere: tanh-sinh in cos theta, trapezoid in phi.

    Crowds nodes towards horizon and pole, where the integrand has its powers.
    """
    t = np.linspace(-3.2, 3.2, n)
    u = 0.5 * math.pi * np.sinh(t)
    z = 1.0 / (1.0 + np.exp(-2.0 * u))
    w = (t[1] - t[0]) * 0.5 * math.pi * np.cosh(t) / (2.0 * np.cosh(u) ** 2)
    theta, phi = np.arccos(z)[:, None], np.arange(2 * n) * math.pi / n
    both = []
    for side in (1.0, -1.0):
        wi = spherical(theta, phi) * [1.0, 1.0, side]
        f = np.asarray(material.eval(wi, wo), dtype=np.float64)
        weights = (w * z * math.pi / n)[:, None]
        both.append(np.tensordot(np.broadcast_to(weights, f.shape[:2]), f, 2))
    return both[0], both[1]


@pytest.mark.parametrize("m", [(0.5, 0.5), (0.3, 0.6), (2.0, 1.0)])
@pytest.mark.parametrize("alpha", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("theta", [0.0, 0.8, 1.4])
def test_albedo_is_the_integral(m: tuple[float, float], alpha: float, theta: float) -> None:
    """1e-6 relative: what the brute-force rule reaches at the horizon for alpha = 1."""
    lobe = Lobe(*m, ks=[1.0, 0.5, 0.1], r0=[0.9, 0.3, 0.04], alpha=alpha)
    wo = spherical(theta, 0.6)
    up, down = brute(Material(0.0, [lobe], [lobe]), wo)
    np.testing.assert_allclose(lobe_albedo(lobe, wo), up, rtol=1e-6)
    np.testing.assert_allclose(lobe_albedo(lobe, wo, transmitted=True), down, rtol=1e-6)


@given(st.floats(1e-4, 2.0), st.floats(1e-4, 2.0), st.floats(0.0, 1.0), st.floats(0.0, 6.3))
def test_a_lobe_with_alpha_zero_gives_out_no_more_than_it_gets(
    mx: float, my: float, z: float, phi: float
) -> None:
    """The white furnace, eq. T2.7 with r0 = 1; ROUNDOFF of the sum."""
    value = lobe_albedo(Lobe(mx, my), grazing(z, phi))[0]
    assert 0.0 <= value <= 1.0 + 1e-10
    assert (value > 0.0) == (z > 0.0)


@given(st.floats(1e-4, 2.0), st.floats(0.0, 1.0), st.floats(0.01, 1.0), st.floats(0.0, 1.0))
def test_what_is_not_reflected_is_transmitted(m: float, alpha: float, z: float, r0: float) -> None:
    """F and 1 - F add up to the lobe with F = 1."""
    wo = grazing(z)
    lobe = Lobe(m, r0=r0, alpha=alpha)
    sides = lobe_albedo(lobe, wo) + lobe_albedo(lobe, wo, transmitted=True)
    np.testing.assert_allclose(sides, lobe_albedo(Lobe(m, alpha=alpha), wo), rtol=CONVERGED)


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.5, 1.0])
@pytest.mark.parametrize("m", [1e-4, 1e-3])
def test_mirrors_have_the_albedo_of_the_mirror_direction(m: float, alpha: float) -> None:
    """f cos / pdf is F (wo.n)^(1 - 2 alpha) there; the lobe's width adds (m / wo.n)^2."""
    for theta in (0.0, 0.5, 1.2):
        wo = spherical(theta, 0.3)
        fresnel = 0.04 + 0.96 * (1.0 - wo[2]) ** 5
        value = lobe_albedo(Lobe(m, r0=0.04, alpha=alpha), wo)[0]
        expected = fresnel * wo[2] ** (1.0 - 2.0 * alpha)
        assert value == pytest.approx(expected, rel=20 * (m / wo[2]) ** 2 + CONVERGED)


@pytest.mark.parametrize("m", [(1e-4, 1e-4), (0.02, 0.02), (0.2, 0.075), (2.0, 2.0), (1.0, 1e-3)])
@pytest.mark.parametrize("alpha", [0.0, 0.5, 0.95, 1.0])
@pytest.mark.parametrize("z", [1.0, 0.5, 0.01, 1e-3, 1e-6])
def test_the_quadrature_has_converged(m: tuple[float, float], alpha: float, z: float) -> None:
    """Against the largest rule, every term by itself."""
    wo = grazing(z)
    finest = albedo.unit_integrals(wo[None], *m, alpha, albedo.NODES[-1])[0]
    terms = {1.0: finest[0], 0.0: finest[1]}
    for r0, expected in terms.items():
        value = lobe_albedo(Lobe(*m, r0=r0, alpha=alpha), wo)[0]
        assert value == pytest.approx(expected, rel=CONVERGED)
    value = lobe_albedo(Lobe(*m, r0=0.0, alpha=alpha), wo, transmitted=True)[0]
    assert value == pytest.approx(finest[2], rel=CONVERGED)


@pytest.mark.parametrize(("m", "below", "above"), [(0.3, 82, 84), (0.1, 86, 88), (0.02, 89, 89.9)])
def test_more_than_all_is_reported_not_hidden(m: float, below: float, above: float) -> None:
    """With alpha = 1/2 lobes give out more than they get from some angle on."""
    wo = spherical(np.radians([below, above]), 0.0)
    under, over = lobe_albedo(Lobe(m, alpha=0.5), wo)[:, 0]
    assert under < 1.0 < over


def test_alpha_darkens_or_brightens_towards_the_rim() -> None:
    """Like cos theta for alpha = 0 and like 1/cos theta for alpha = 1; 1 % for m = 0.02."""
    wo = spherical(math.radians(60), 0.0)
    assert lobe_albedo(Lobe(0.02), wo)[0] == pytest.approx(0.5, rel=0.01)
    assert lobe_albedo(Lobe(0.02, alpha=1.0), wo)[0] == pytest.approx(2.0, rel=0.01)


def test_hundreds_at_the_horizon() -> None:
    value = lobe_albedo(Lobe(0.02, alpha=1.0), spherical(math.radians(89.9), 0.0))[0]
    assert 100.0 < value < 1000.0


def test_shapes_and_the_dark_side() -> None:
    wo = spherical(np.linspace(0.0, math.pi, 12).reshape(3, 4), 0.3)
    lobe = Lobe(0.3, ks=[0.2, 0.4, 0.6], alpha=0.7)
    values = lobe_albedo(lobe, wo)
    assert values.shape == (3, 4, 3)
    np.testing.assert_array_equal(values[wo[..., 2] <= 0], 0.0)
    np.testing.assert_allclose(values[0, 1], lobe_albedo(lobe, wo[0, 1]), rtol=1e-13)
    assert lobe_albedo(lobe, np.empty((0, 3))).shape == (0, 3)
    with pytest.raises(ValueError, match="wo: must be unit"):
        lobe_albedo(lobe, [0, 0, 2])


def test_a_material_adds_its_parts() -> None:
    wo = spherical(np.array([0.2, 1.0, 2.0]), 0.3)
    a, b, c = Lobe(0.3, ks=0.4), Lobe(0.1, ks=0.2), Lobe(0.2, r0=0.5)
    up, down = Material(0.1, [a, b], [c]).albedo(wo)
    lit = wo[:, 2] > 0
    np.testing.assert_allclose(
        up, 0.1 * lit + lobe_albedo(a, wo)[:, 0] + lobe_albedo(b, wo)[:, 0], rtol=1e-14
    )
    np.testing.assert_array_equal(down, lobe_albedo(c, wo, transmitted=True)[:, 0])
    assert Material([0.1, 0.2, 0.3]).albedo(wo[0])[0].tolist() == [0.1, 0.2, 0.3]
