"""The data of a lobe stack: where its axis is, what it is worth, what it refuses."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glossy.frames import spherical
from glossy.prefiltered.stack import LobeStack, ring_solid_angles

ROUNDOFF = 1e-12  # a few hundred float64 roundings


def parts(**changes: Any) -> dict[str, Any]:
    angles = np.linspace(0.0, 1.0, 5)
    profile = np.stack([1.0 - angles, 2.0 - 2.0 * angles])[:, :, None]
    made = {
        "cosines": [0.5, 1.0],
        "angles": angles,
        "profiles": profile,
        "view_cosines": [0.5, 1.0],
        "weights": np.ones((2, 1)),
        "theta_offset": [0.1, 0.0],
        "phi_offset": [0.0, 0.0],
        "cosine_outside": False,
    }
    return {**made, **changes}


@given(st.lists(st.floats(1e-5, 1.0), min_size=1, max_size=40))
def test_rings_tile_the_cap(steps: list[float]) -> None:
    angles = np.concatenate([[0.0], np.cumsum(steps)])
    angles *= math.pi / angles[-1]
    rings = ring_solid_angles(angles)
    assert rings.min() >= 0.0
    assert rings.sum() == pytest.approx(4.0 * math.pi, rel=ROUNDOFF)


def test_rings_integrate_a_linear_profile() -> None:
    angles = np.array([0.0, 0.003, 0.2, 1.3])
    x = np.linspace(0.0, 1.3, 400001)
    values = np.array([3.0, 1.0, 2.0, 0.5])
    y = np.interp(x, angles, values) * np.sin(x)
    plain = 2.0 * math.pi * np.trapezoid(y, x)
    assert values @ ring_solid_angles(angles) == pytest.approx(plain, rel=1e-8)  # of 4e5 trapezoids


def test_zero_offsets_are_the_reflected_direction() -> None:
    stack = LobeStack(**parts(theta_offset=[0.0, 0.0]))
    wo = spherical([0.0, 0.7, 1.5], [0.0, 2.0, -1.0])
    assert stack.axis(wo) == pytest.approx(wo * [-1.0, -1.0, 1.0], abs=ROUNDOFF)


def test_offsets_turn_the_axis_and_are_linear_in_the_cosine() -> None:
    stack = LobeStack(**parts(phi_offset=[0.4, 0.0]))
    theta = math.acos(0.75)
    axis = stack.axis(spherical(theta, 0.3))
    assert axis == pytest.approx(spherical(theta + 0.05, 0.3 + math.pi + 0.2), abs=ROUNDOFF)


def test_slices_are_blended_by_the_cosine() -> None:
    stack = LobeStack(**parts(weights=np.full((2, 1), 3.0)))
    wo = spherical(math.acos(0.75), 0.0)
    axis = stack.axis(wo)
    assert stack.evaluate(axis, wo) == pytest.approx(3.0 * 1.5, rel=1e-7)  # an angle of rounding
    assert stack.evaluate(-axis, wo) == pytest.approx(0.0)
    assert stack.evaluate(axis, -wo) == pytest.approx(0.0)


@pytest.mark.parametrize("outside", [False, True])
def test_the_furnace_is_the_integral_of_what_is_evaluated(outside: bool) -> None:
    stack = LobeStack(**parts(cosine_outside=outside))
    wo = spherical(0.6, 0.2)
    n = 1500
    theta = math.pi * (np.arange(n) + 0.5) / n
    phi = 2.0 * math.pi * (np.arange(n) + 0.5) / n
    wi = spherical(*np.meshgrid(theta, phi, indexing="ij"))
    area = np.sin(theta)[:, None, None] * (math.pi / n) * (2.0 * math.pi / n)
    plain = stack.factor(wo) * np.sum(area * stack.evaluate(wi, wo))
    assert stack.furnace(wo) == pytest.approx(plain, rel=1e-4)  # of the midpoint rule


def test_one_shape_keeps_its_weights_at_their_own_nodes() -> None:
    made = parts(cosines=[1.0], profiles=np.ones((1, 5, 1)), weights=[[2.0], [4.0]])
    stack = LobeStack(**made)
    wo = spherical(np.arccos([0.2, 0.5, 0.75, 1.0]), np.zeros(4))
    assert stack.evaluate(stack.axis(wo), wo)[:, 0] == pytest.approx([2.0, 2.0, 3.0, 4.0])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"cosines": [1.0, 0.5]}, "cosines: must be a vector of rising"),
        ({"cosines": [0.0, 0.5]}, r"cosines: must lie in \(0, 1\]"),
        ({"view_cosines": [0.5, 1.5]}, r"view_cosines: must lie in \(0, 1\]"),
        ({"angles": [0.1, 0.2, 0.3, 0.4, 0.5]}, "angles: must rise from 0"),
        ({"angles": [0.0, 1.0, 2.0, 3.0, 4.0]}, "angles: must rise from 0"),
        ({"profiles": np.ones((2, 5, 2))}, r"profiles: must have shape \(2, 5, 1 or 3\)"),
        ({"profiles": -np.ones((2, 5, 1))}, "profiles: must not be negative"),
        ({"profiles": np.full((2, 5, 1), np.nan)}, "profiles: must be finite"),
        ({"weights": np.ones((2, 3))}, r"weights: must have shape \(2, 1\)"),
        ({"theta_offset": [0.0]}, r"theta_offset: must have shape \(2\)"),
        ({"phi_offset": ["a", "b"]}, "phi_offset: must be an array of real numbers"),
        ({"cosine_outside": 1}, "cosine_outside: must be True or False"),
    ],
)
def test_malformed_parts_are_one_line(change: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        LobeStack(**parts(**change))
