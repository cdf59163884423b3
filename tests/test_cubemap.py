"""Orientation, solid angles and the plain lookup that the ground truth integrates."""

import math
import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from symmetry import rotations, turn_faces

import glossy
from glossy.cubemap import face_directions, locate, texel_directions, texel_solid_angles

AXES = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]

numbers = st.floats(-1.0, 1.0, allow_subnormal=False)
directions = st.tuples(numbers, numbers, numbers).filter(lambda d: max(map(abs, d)) > 1e-6)


def random_map(size: int, seed: int = 0) -> glossy.CubeMap:
    rng = np.random.default_rng(seed)
    return glossy.CubeMap(rng.random((6, size, size, 3), dtype=np.float32))


def test_six_colours_lie_where_the_axes_point() -> None:
    colours = np.arange(18, dtype=np.float32).reshape(6, 1, 1, 3)
    cube = glossy.CubeMap(np.broadcast_to(colours, (6, 8, 8, 3)))
    assert np.array_equal(cube.lookup(AXES), colours.reshape(6, 3))


@pytest.mark.parametrize(
    ("face", "corner"),
    [(0, (1, 1, 1)), (1, (-1, 1, -1)), (2, (-1, 1, -1)), (3, (-1, -1, 1)), (4, (-1, 1, 1)),
     (5, (1, 1, -1))],
)  # fmt: skip
def test_first_texel_of_each_face_is_at_the_corner_of_the_opengl_tables(
    face: int, corner: tuple[int, int, int]
) -> None:
    assert np.allclose(texel_directions(256)[face, 0, 0], corner, atol=1.0 / 128)


@given(st.integers(0, 5), numbers, numbers)
def test_locate_inverts_face_directions(face: int, s: float, t: float) -> None:
    if max(abs(s), abs(t)) < 1.0:
        f, u, v = locate(3.7 * face_directions(face, s, t))
        assert int(f) == face
        assert math.isclose(float(u), s, abs_tol=1e-15)
        assert math.isclose(float(v), t, abs_tol=1e-15)


def test_ties_go_to_z_then_y_then_x() -> None:
    tied = [(1, 1, 1), (1, 1, 0), (1, 0, -1), (-1, -1, 0), (0, 1, 1), (-1, -1, -1)]
    assert locate(tied)[0].tolist() == [4, 2, 5, 3, 4, 5]


@pytest.mark.parametrize("size", [1, 2, 3, 17, 256])
def test_solid_angles_sum_to_the_sphere(size: int) -> None:
    omega = texel_solid_angles(size)
    assert omega.sum() * 6 == pytest.approx(4.0 * math.pi, rel=1e-13)
    assert np.allclose(omega, omega.T, rtol=1e-9)
    assert np.all(omega > 0.0)


def test_solid_angle_is_the_integral_of_the_jacobian() -> None:
    """Gauss-Legendre over a texel of (1 + s^2 + t^2)^(-3/2), an independent formula."""
    x, w = np.polynomial.legendre.leggauss(12)
    n, row, col = 4, 0, 1
    s = -1.0 + (2.0 * col + 1.0 + x) / n
    t = -1.0 + (2.0 * row + 1.0 + x) / n
    value = np.einsum("i,j,ij->", w, w, (1 + s[None] ** 2 + t[:, None] ** 2) ** -1.5) / n**2
    assert texel_solid_angles(n)[row, col] == pytest.approx(value, rel=1e-12)


def test_lookup_at_texel_centres_returns_the_texels() -> None:
    cube = random_map(16)
    assert np.allclose(cube.lookup(texel_directions(16)), cube.faces, rtol=1e-12, atol=1e-14)


def naive_lookup(cube: glossy.CubeMap, d: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The four texels by folding each one by hand, no padding: twin of the compiled lookup."""
    n = cube.size
    found = locate(d)
    face, s, t = int(found[0]), float(found[1]), float(found[2])
    p, q = (s + 1.0) * 0.5 * n - 0.5, (t + 1.0) * 0.5 * n - 0.5
    col, row = math.floor(p), math.floor(q)
    faces = cube.faces.astype(np.float64)

    def texel(r: int, c: int) -> npt.NDArray[Any]:
        inside_r, inside_c = min(max(r, 0), n - 1), min(max(c, 0), n - 1)
        if r != inside_r and c != inside_c:
            three = faces[face, inside_r, inside_c] + texel(inside_r, c) + texel(r, inside_c)
            return np.asarray(three / 3.0)
        if (r, c) == (inside_r, inside_c):
            return np.asarray(faces[face, r, c])
        edge = face_directions(
            face,
            np.clip((c + 0.5) * 2.0 / n - 1.0, -1.0, 1.0),
            np.clip((r + 0.5) * 2.0 / n - 1.0, -1.0, 1.0),
        )
        f, u, v = locate(edge - face_directions(face, 0.0, 0.0) / n)
        return np.asarray(faces[f, int((v + 1.0) * 0.5 * n), int((u + 1.0) * 0.5 * n)])

    a, b = p - col, q - row
    top = (1 - a) * texel(row, col) + a * texel(row, col + 1)
    low = (1 - a) * texel(row + 1, col) + a * texel(row + 1, col + 1)
    return np.asarray((1 - b) * top + b * low)


@given(directions, st.sampled_from([1, 2, 3, 8]), st.floats(1e-30, 1e30))
def test_lookup_agrees_with_its_naive_twin(
    d: tuple[float, float, float], size: int, length: float
) -> None:
    """Any length of the direction. The mean at a cube corner is kept as float32: half an ulp."""
    cube = random_map(size)
    v = np.array(d)
    assert np.allclose(cube.lookup(v * length), naive_lookup(cube, v), rtol=0, atol=2.0**-25)


@given(directions)
def test_lookup_turns_with_the_cube(d: tuple[float, float, float]) -> None:
    """Away from ties, where the stated order z, y, x picks a side of a seam."""
    cube = random_map(5)
    v = np.array(d)
    magnitude = np.sort(np.abs(v))
    if magnitude[2] - magnitude[1] > 1e-9 * magnitude[2]:
        for r in rotations(mirrors=True)[::7]:
            turned = glossy.CubeMap(turn_faces(cube.faces, r))
            assert np.allclose(turned.lookup(r @ v), cube.lookup(v), rtol=0, atol=1e-12)


def test_lookup_is_continuous_across_every_edge() -> None:
    """The two sides of a seam differ by no more than the slope allows, except near corners."""
    cube = random_map(8)
    t = np.linspace(-0.85, 0.85, 401)
    eps = 1e-9
    for a in rotations():
        left = np.stack([np.ones_like(t), np.full_like(t, 1.0 - eps), t], axis=-1) @ a.T
        right = np.stack([np.full_like(t, 1.0 - eps), np.ones_like(t), t], axis=-1) @ a.T
        assert np.abs(cube.lookup(left) - cube.lookup(right)).max() < 1e-7


@pytest.mark.parametrize("name", ["random1", "random16", "smooth64"])
def test_lookup_agrees_with_a_gpu_sampler(conformance: pathlib.Path, name: str) -> None:
    """Level 0 of the answers of Mesa's sampler; tolerance as stated with them for double."""
    with np.load(conformance / f"cubemap_{name}.npz") as z:
        base = z["lod"] <= 0.0
        expected = z["out_linear_mipmap_linear"][base][:, :3]
        cube = glossy.CubeMap(z["level0"][..., :3])
        got = cube.lookup(z["dirs"][base])
    tolerance = max(3e-7, 1e-7 * cube.size)
    assert base.sum() > 1000
    assert np.abs(got - expected).max() <= tolerance


def test_power_of_white_is_four_pi() -> None:
    cube = glossy.CubeMap(np.ones((6, 8, 8, 3)))
    assert np.allclose(cube.power(), 4.0 * math.pi, rtol=1e-12)


def test_faces_are_kept_from_later_changes() -> None:
    faces = np.ones((6, 2, 2, 3), dtype=np.float32)
    cube = glossy.CubeMap(faces)
    faces[:] = 5.0
    assert cube.faces.max() == 1.0
    with pytest.raises(ValueError, match="read-only"):
        cube.faces[0, 0, 0, 0] = 2.0


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        (np.ones((6, 4, 4)), r"faces: must have shape \(6, N, N, 3\), got \(6, 4, 4\)"),
        (np.ones((6, 4, 5, 3)), "faces: must have shape"),
        (np.full((6, 1, 1, 3), -1.0), "faces: must not be negative .* got '18 negative values"),
        (np.full((6, 1, 1, 3), np.nan), "faces: must be finite .* got '18 NaN or inf values"),
        (np.ones((6, 0, 0, 3)), "faces size: must be from 1"),
        ("six", "faces: must be an array of real numbers, got 'six'"),
    ],
)
def test_bad_faces_are_refused_with_the_rule(faces: object, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        glossy.CubeMap(faces)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_policies_count_what_they_change() -> None:
    faces = np.ones((6, 1, 1, 3))
    faces[0, 0, 0] = [-2.0, np.inf, np.nan]
    with pytest.warns(UserWarning, match="faces: ") as caught:
        cube = glossy.CubeMap(faces, negative="clamp", nonfinite="clamp")
    text = " ".join(str(w.message) for w in caught)
    assert "2 NaN or infinite values" in text
    assert "1 negative values clamped to 0 (lowest -2)" in text
    assert cube.faces[0, 0, 0].tolist() == [0.0, 1.0, 0.0]
    kept = glossy.CubeMap(faces, negative="keep", nonfinite="keep").faces[0, 0, 0]
    assert kept[0] == -2.0
    assert np.isinf(kept[1])


@pytest.mark.parametrize("bad", [(0.0, 0.0, 0.0), (np.nan, 0.0, 1.0), (1.0, 2.0)])
def test_bad_directions_are_refused(bad: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="directions: must"):
        random_map(2).lookup(bad)
