"""Reflection, half vectors, spherical coordinates, tangents and surface points."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import tolerances
from hypothesis import given
from hypothesis import strategies as st

from glossy import frames
from glossy.frames import SurfacePoints

Array = npt.NDArray[np.float64]
UNIT = st.tuples(st.floats(0.0, math.pi), st.floats(-math.pi, math.pi)).map(
    lambda a: frames.spherical(*a)
)


@given(UNIT, UNIT)
def test_reflection_keeps_length_and_angle_and_undoes_itself(wo: Array, wh: Array) -> None:
    wi = frames.reflect(wo, wh)
    assert np.linalg.norm(wi) == pytest.approx(1.0, abs=tolerances.ROUNDOFF)
    assert wi @ wh == pytest.approx(wo @ wh, abs=tolerances.ROUNDOFF)
    np.testing.assert_allclose(frames.reflect(wi, wh), wo, atol=tolerances.ROUNDOFF)
    np.testing.assert_allclose(wi + wo, 2 * (wo @ wh) * wh, atol=tolerances.ROUNDOFF)


@given(UNIT, UNIT.filter(lambda h: h[2] > 0.1))
def test_the_half_vector_undoes_reflection(wo: Array, wh: Array) -> None:
    """Up to the side; H is 2 wo.h long, which divides the round-off."""
    u = float(wo @ wh)
    if abs(u) < 1e-6:
        wh = wo  # a half vector across the view has no reflection to speak of
        u = 1.0
    half = frames.half_vector(frames.reflect(wo, wh), wo)
    np.testing.assert_allclose(half, math.copysign(1.0, u) * wh, atol=1e-15 / abs(u) + 1e-14)


def test_half_vectors_of_opposite_directions_are_refused() -> None:
    with pytest.raises(ValueError, match="must not contain a zero vector"):
        frames.half_vector([[0, 0, 1], [1, 0, 0]], [[0, 0, 1], [-1, 0, 0]])


def test_spherical_coordinates() -> None:
    axes = frames.spherical([0, 90 * math.pi / 180, math.pi / 2, math.pi], [1, 0, math.pi / 2, 2])
    expected = [[0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, -1]]
    np.testing.assert_allclose(axes, expected, atol=tolerances.ROUNDOFF)
    assert frames.spherical(np.zeros((3, 1)), np.zeros(4)).shape == (3, 4, 3)


@given(UNIT, UNIT, UNIT)
def test_local_and_world_are_inverse_and_keep_angles(n: Array, v: Array, w: Array) -> None:
    t = frames.sphere_tangent(n)
    local = frames.to_local(v, t, n)
    assert local[2] == pytest.approx(n @ v, abs=tolerances.ROUNDOFF)
    assert local @ frames.to_local(w, t, n) == pytest.approx(v @ w, abs=tolerances.ROUNDOFF)
    np.testing.assert_allclose(frames.to_world(local, t, n), v, atol=tolerances.ROUNDOFF)
    b = frames.to_world([0.0, 1.0, 0.0], t, n)
    np.testing.assert_allclose(np.cross(t, b), n, atol=tolerances.ROUNDOFF)


@given(UNIT)
def test_the_spheres_tangents_run_east(n: Array) -> None:
    """normalise(cross(+y, n)): level, unit, across the normal."""
    t = frames.sphere_tangent(n)
    assert t[1] == 0.0
    assert np.linalg.norm(t) == pytest.approx(1.0, abs=tolerances.ROUNDOFF)
    assert abs(t @ n) < tolerances.ROUNDOFF


def test_the_spheres_tangents_at_known_places() -> None:
    n = [[0, 0, 1], [1, 0, 0], [0, 1, 0], [0, -1, 0]]
    expected = [[1, 0, 0], [0, 0, -1], [1, 0, 0], [1, 0, 0]]
    np.testing.assert_allclose(frames.sphere_tangent(n), expected, atol=0)


@pytest.mark.parametrize("scale", [1e-300, 1.0, 1e300])
def test_normalise_does_not_overflow(scale: float) -> None:
    v = np.array([[3.0, 4.0, 0.0], [1.0, 1.0, 1.0]]) * scale
    expected = [[0.6, 0.8, 0.0], [3**-0.5] * 3]
    np.testing.assert_allclose(frames.normalise(v), expected, rtol=1e-15)


def points(**change: Any) -> SurfacePoints:
    values: dict[str, Any] = {
        "normal": [[0, 0, 1.0005], [0, 1, 0]],
        "tangent": [[1, 0, 0], [0, 0, 1]],
        "view": [0, 0.6, 0.8],
    }
    return SurfacePoints(**{**values, **change})


def test_surface_points_are_orthonormal_read_only_and_broadcast() -> None:
    p = points(tangent=frames.normalise([[1, 0, 0.5], [0.2, 0.3, 1]]))
    assert p.shape == (2,)
    assert p.view.shape == (2, 3)
    for v in (p.normal, p.tangent, p.view):
        np.testing.assert_allclose(np.linalg.norm(v, axis=-1), 1.0, atol=tolerances.ROUNDOFF)
        assert v.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            v[0] = 0.0
    np.testing.assert_allclose(frames.dot(p.tangent, p.normal), 0.0, atol=tolerances.ROUNDOFF)
    np.testing.assert_allclose(p.tangent[0], [1, 0, 0], atol=tolerances.ROUNDOFF)
    default = points(tangent=None)
    np.testing.assert_array_equal(default.tangent, frames.sphere_tangent(default.normal))


def test_points_that_see_nothing_are_not_looked_at() -> None:
    bad = [[0, 0, 1], [math.nan, 0, 0]]
    p = points(normal=bad, view=bad, mask=[True, False])
    assert p.mask is not None
    assert p.mask.tolist() == [True, False]
    assert np.all(np.isfinite(p.normal))
    with pytest.raises(ValueError, match="normal: must be finite"):
        points(normal=bad)


def test_positions_broadcast_follow_an_index_and_are_not_looked_at_where_masked() -> None:
    x = np.array([[0.0, 0.0, 0.0], [math.inf, 0.0, 0.0]])
    p = points(position=x, mask=[True, False])
    assert p.position is not None
    np.testing.assert_array_equal(p.position, np.zeros((2, 3)))
    spread = SurfacePoints([0, 0, 1], None, [0, 0, 1], position=np.arange(12.0).reshape(4, 3))
    assert spread.shape == (4,)
    assert spread.position is not None
    np.testing.assert_array_equal(spread[1:3].position, [[3, 4, 5], [6, 7, 8]])
    with pytest.raises(ValueError, match="read-only"):
        spread.position[0] = 1.0
    assert points().position is None
    x[0] = 5.0  # a copy was taken
    assert not p.position.any()


def test_the_callers_arrays_stay_writeable() -> None:
    given = {"normal": np.eye(3)[[2, 2]], "tangent": np.eye(3)[[0, 0]], "view": np.eye(3)[[2, 2]]}
    mask = np.array([True, False])
    points(**given, mask=mask)
    assert all(a.flags.writeable for a in (*given.values(), mask))


def test_views_into_the_surface_are_warned_of_once_and_named() -> None:
    """Parts of such points, and views at the horizon within the rounding of 8 bits, are not."""
    normal, view = np.zeros((2, 3, 3)), np.zeros((2, 3, 3))
    normal[..., 2] = view[..., 2] = 1.0
    view[1, 0] = view[1, 2] = [0.0, 0.6, -0.8]
    with pytest.warns(UserWarning, match=r"2 of 6 points look into the surface \(pixel 0,1\)"):
        turned = SurfacePoints(normal, view=view)
    assert turned[1].shape == (3,)
    hidden = np.ones((2, 3), dtype=bool)
    hidden[1] = False
    SurfacePoints(normal, view=view, mask=hidden)
    level = SurfacePoints([0, 0, 1.0], view=frames.normalise([1.0, 0.0, -0.005]))
    assert level.local_view[2] < 0.0
    with pytest.warns(UserWarning, match=r"1 of 1 points look into the surface and come out"):
        SurfacePoints([0, 0, 1.0], view=[0, 0, -1.0])


def test_vectors_of_any_length_on_request() -> None:
    long = {"normal": [0.0, 0.0, 1e200], "view": [0.0, 3e-9, 4e-9], "tangent": [5.0, 0.0, 0.0]}
    p = SurfacePoints(**long, normalise=True)
    assert [v.tolist() for v in (p.normal, p.view, p.tangent)] == [
        [0, 0, 1],
        [0, 0.6, 0.8],
        [1, 0, 0],
    ]
    with pytest.raises(ValueError, match="view: must not contain a zero vector"):
        SurfacePoints([0, 0, 2.0], view=[0, 0, 0], normalise=True)


def test_a_bad_vector_is_named_by_its_place() -> None:
    many = np.zeros((4, 5, 3))
    many[..., 2] = 1.0
    many[3, 1] = [0.0, 0.0, 0.5]
    with pytest.raises(ValueError, match=r"normal: .*\(pixel 1,3\), got 'length 0.5'"):
        SurfacePoints(many, view=[0, 0, 1.0])
    with pytest.raises(ValueError, match=r"normal: .*\(index 1\)"):
        SurfacePoints(many[3], view=[0, 0, 1.0])
    with pytest.raises(ValueError, match=r"tangent: must not lie along the normal \(pixel 0,0\)"):
        SurfacePoints(many[:3], [0, 0, 1.0], [0, 0, 1.0])


@pytest.mark.parametrize("mask", ["yes", None, object(), [math.nan, 1.0], [[True], [True, False]]])
def test_a_mask_is_truth_values(mask: Any) -> None:
    if mask is None:
        mask = np.array([None, True])
    with pytest.raises(ValueError, match="mask: must be an array of truth values"):
        points(mask=mask)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"view": None}, "view: is required"),
        ({"normal": [0, 0, 1.1]}, "normal: must be unit vectors within 0.001"),
        ({"view": [0, 0, 0]}, "view: must not contain a zero"),
        ({"normal": [[0, 0, 1]] * 3}, "normal, tangent, view: must broadcast"),
        ({"normal": 3.0, "tangent": None, "view": 1.0}, "must have shape"),
        ({"tangent": [[0, 0, 1], [0, 0, 1]]}, "tangent: must not lie along the normal"),
        ({"tangent": "east"}, "tangent: must be an array of real numbers"),
        ({"mask": [True]}, r"mask: must have shape \(2,\)"),
        ({"position": [[0, 0, 0]] * 3}, "normal, tangent, view, position: must broadcast"),
        ({"position": [0, math.nan, 0]}, "position: must be finite"),
    ],
)
def test_refusals(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message) as error:
        points(**change)
    assert "\n" not in str(error.value)
