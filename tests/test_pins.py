"""Numbers that other tests let move: offsets, weights, thresholds, each by what depends on it."""

import pathlib

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import glossy
from glossy.cubemap import face_directions
from glossy.frames import normalise, sphere_tangent, spherical
from glossy.measured.merl import SHAPE, evaluate_merl
from glossy.pem.regions import LUMINANCE, regions

Array = npt.NDArray[np.float64]

ANGLES = 1e-9
"""Bins of the angles of directions that were made from angles: float64 through arctangents."""

SUMS = 1e-12
"""float64 sums of some hundred directions."""


def test_merl_bins_hold_their_centres() -> None:
    """Values that are the bins' numbers give back the place between the bins, less half a bin."""
    draw = np.random.default_rng(3)
    theta_h, theta_d = draw.uniform(0.05, 0.6, 200), draw.uniform(0.05, 0.6, 200)
    phi_d = draw.uniform(0.05, np.pi - 0.05, 200)
    d, c, s = spherical(theta_d, phi_d), np.cos(theta_h), np.sin(theta_h)

    def turned(v: Array) -> Array:
        return np.stack([c * v[:, 0] + s * v[:, 2], v[:, 1], c * v[:, 2] - s * v[:, 0]], axis=1)

    wi, wo = turned(d), turned(d * np.array([-1.0, -1.0, 1.0]))
    values = np.asarray(np.indices(SHAPE), dtype=np.float64)
    found = evaluate_merl(values, wi, wo)
    expected = np.stack(
        [90 * np.sqrt(theta_h / (np.pi / 2)), 90 * theta_d / (np.pi / 2), 180 * phi_d / np.pi]
    )
    np.testing.assert_allclose(found.T, expected - 0.5, atol=ANGLES * 180)


@given(st.integers(0, 2**31), st.sampled_from([0.0, 1.0, 30.0]), st.booleans())
def test_a_regions_direction_is_the_mean_of_its_texels_unit_directions(
    seed: int, contrast: float, black: bool
) -> None:
    """Weighed by importance, and by solid angle where it is black."""
    n = 6
    faces = np.random.default_rng(seed).random((6, n, n, 3)) ** contrast
    if black:
        faces[2] = 0.0
    cube = glossy.CubeMap(faces)
    found = regions(cube, 18)
    along = (np.arange(n) + 0.5) * (2.0 / n) - 1.0
    face, t, s = np.meshgrid(np.arange(6), along, along, indexing="ij")
    unit = normalise(face_directions(face, s, t))
    omega = np.broadcast_to(cube.solid_angles(), (6, n, n))
    weighed = (cube.faces.astype(np.float64) @ LUMINANCE) * omega
    for i in range(len(found)):
        here = found.labels == i
        weight = weighed[here] if weighed[here].any() else omega[here]
        mean = normalise(weight @ unit[here])
        np.testing.assert_allclose(found.direction[i], mean, atol=SUMS)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_tangent_of_a_pole_begins_where_the_normal_is_within_1e_12_of_the_axis(
    sign: float,
) -> None:
    for tilt, expected in ((1.5e-12, [0.0, 0.0, -1.0]), (0.7e-12, [1.0, 0.0, 0.0])):
        np.testing.assert_array_equal(sphere_tangent([tilt, sign, 0.0]), expected)


def test_a_gbuffers_mask_shows_what_is_above_one_half(tmp_path: pathlib.Path) -> None:
    """As in images whose filtered edges have values between."""
    mask = np.array([[0.0, 0.49, 0.5, np.nextafter(0.5, 1.0), 0.51, 1.0]])
    normal = np.broadcast_to([0.0, 0.0, 1.0], (1, 6, 3))
    np.savez(tmp_path / "g.npz", normal=normal, view=normal, mask=mask)
    seen = glossy.read_gbuffer(tmp_path / "g.npz").mask
    np.testing.assert_array_equal(seen, [[False, False, False, True, True, True]])
