"""Layouts: where each face lies, names of face files, change of size."""

import pathlib

import numpy as np
import numpy.typing as npt
import pytest
import tolerances
from hypothesis import given
from hypothesis import strategies as st

from glossy import layouts
from glossy.cubemap import CubeMap, texel_directions, texel_solid_angles

Float32Array = npt.NDArray[np.float32]

SINGLE_PICTURES = tuple(layouts.ASPECTS)[1:]


def numbered(n: int = 2) -> Float32Array:
    """Faces whose texels all differ: 100 face + 10 row + column."""
    f, r, c = np.meshgrid(np.arange(6), np.arange(n), np.arange(n), indexing="ij")
    return np.repeat((100.0 * f + 10 * r + c)[..., None], 3, axis=-1).astype(np.float32)


def smooth(size: int) -> Float32Array:
    d = texel_directions(size)
    d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    return np.asarray(2.0 + d @ np.array([[1.0, 0, 0], [0, 1, 0], [0.3, 0, 1]]), np.float32)


@pytest.mark.parametrize("layout", SINGLE_PICTURES)
def test_placing_and_cutting_are_inverse(layout: str) -> None:
    picture = layouts.place_faces(numbered(3), layout)
    wide, high = layouts.ASPECTS[layout]
    assert picture.shape == (3 * high, 3 * wide, 3)
    assert np.array_equal(layouts.cut_faces(picture, layout), numbered(3))


def test_the_pictures_texel_by_texel() -> None:
    """Written out: the first texel of each face in the four pictures, and -Z's turned one."""
    first = (0, 100, 200, 300, 400, 500)
    at: dict[str, tuple[tuple[int, int], ...]] = {
        "cross-horizontal": ((2, 4), (2, 0), (0, 2), (4, 2), (2, 2), (2, 6)),
        "cross-vertical": ((2, 4), (2, 0), (0, 2), (4, 2), (2, 2), (7, 3)),
        "strip-horizontal": ((0, 0), (0, 2), (0, 4), (0, 6), (0, 8), (0, 10)),
        "strip-vertical": ((0, 0), (2, 0), (4, 0), (6, 0), (8, 0), (10, 0)),
    }
    for layout, texels in at.items():
        picture = layouts.place_faces(numbered(2), layout)
        for place, value in zip(texels, first, strict=True):
            assert picture[place][0] == value, (layout, place)


def imf_direction(face: int, column: float, row: float, last: int) -> tuple[float, float, float]:
    """Direction of a place in a face of OpenEXR's cube, ImfEnvmap.h, its corners at -1 and 1.

    There a face has coordinates of its own along two axes of the world, and each face's drawing
    says which pixel they are.
    """
    left, up = last - column, last - row
    x, y = [(up, column), (up, left), (column, up), (column, row), (left, up), (column, up)][face]
    a, b = 2.0 * x / last - 1.0, 2.0 * y / last - 1.0
    return [(1, a, b), (-1, a, b), (a, 1, b), (a, -1, b), (a, b, 1), (a, b, -1)][face]


@given(st.integers(0, 5), st.integers(1, 9), st.data())
def test_faces_of_openexr_s_cube_look_where_its_library_says(
    face: int, n: int, data: st.DataObject
) -> None:
    """One lit pixel: its texel's direction is that of the pixel's middle in the face."""
    row, column = (data.draw(st.integers(0, n - 1)) for _ in range(2))
    strip = np.zeros((6 * n, n, 3), dtype=np.float32)
    strip[face * n + row, column] = 1.0
    f, r, c = np.argwhere(layouts.cut_faces(strip, "openexr-cube")[..., 0])[0]
    expected = imf_direction(face, column + 0.5, row + 0.5, n)
    np.testing.assert_allclose(texel_directions(n)[f, r, c], expected, atol=tolerances.ROUNDOFF)


@pytest.mark.parametrize("layout", ["cross-horizontal", "cross-vertical"])
def test_crosses_continue_from_face_to_face(layout: str) -> None:
    """A smooth map has no step where two faces of the cross touch."""
    n = 32
    picture = layouts.place_faces(smooth(n), layout)
    lit = picture[..., 0] > 0.0
    touching = 0
    for axis in (0, 1):
        step = np.abs(np.diff(picture, axis=axis)).max(axis=-1)
        both = lit[1:] & lit[:-1] if axis == 0 else lit[:, 1:] & lit[:, :-1]
        borders = np.arange(n - 1, step.shape[axis], n)
        inside = np.delete(np.where(both, step, 0.0), borders, axis=axis).max()
        across, pairs = np.take(step, borders, axis=axis), np.take(both, borders, axis=axis)
        touching += int(pairs.sum())
        assert across[pairs].max() < 1.5 * inside
    assert touching == 5 * n


def test_recognition_by_aspect_ratio() -> None:
    sizes = {
        "latlong": (8, 4),
        "cross-horizontal": (12, 9),
        "cross-vertical": (9, 12),
        "strip-horizontal": (18, 3),
        "strip-vertical": (3, 18),
    }
    for name, (width, height) in sizes.items():
        assert layouts.recognise(width, height) == name
        assert layouts.recognise(width, height, name) == name


@pytest.mark.parametrize(
    ("width", "height", "layout", "said"),
    [
        (5, 5, None, "aspect ratio of a layout .*2:1 latlong.*5 x 5"),
        (16, 9, None, "aspect ratio"),
        (8, 4, "cross-horizontal", "must be 4:3 for layout cross-horizontal, got '8 x 4'"),
        (12, 9, "latlong", "must be 2:1"),
        (12, 9, "faces", "needs a folder or six files"),
        (12, 9, "dice", "must be one of latlong"),
    ],
)
def test_refused_aspect_ratios(width: int, height: int, layout: str | None, said: str) -> None:
    with pytest.raises(ValueError, match=said) as caught:
        layouts.recognise(width, height, layout)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "names",
    [
        ("px", "nx", "py", "ny", "pz", "nz"),
        ("sky_posx", "sky_negx", "sky_posy", "sky_negy", "sky_posz", "sky_negz"),
        ("a+x", "a-x", "a+y", "a-y", "a+z", "a-z"),
        ("Right", "Left", "Top", "Bottom", "Front", "Back"),
        ("env.rt", "env.lf", "env.up", "env.dn", "env.ft", "env.bk"),
        ("m_0", "m_1", "m_2", "m_3", "m_4", "m_5"),
    ],
)
def test_names_of_face_files(names: tuple[str, ...]) -> None:
    assert [layouts.face_of_name(f"/some/dir/{name}.exr") for name in names] == [*range(6)]


@pytest.mark.parametrize("name", ["sphinx", "backup", "matrix", "bright", "irradiance", "v10"])
def test_names_that_are_no_faces(name: str) -> None:
    assert layouts.face_of_name(f"{name}.hdr") is None


def test_a_folder_is_searched(tmp_path: pathlib.Path) -> None:
    for name in ("nz", "px", "pz", "ny", "py", "nx"):
        (tmp_path / f"{name}.hdr").write_bytes(b"")
    (tmp_path / "readme_px.txt").write_bytes(b"")
    found = [f.name for f in layouts.find_faces(tmp_path)]
    assert found == ["px.hdr", "nx.hdr", "py.hdr", "ny.hdr", "pz.hdr", "nz.hdr"]
    (tmp_path / "right.hdr").write_bytes(b"")
    with pytest.raises(ValueError, match=r"one file for face \+x, got 'px.hdr, right.hdr'"):
        layouts.find_faces(tmp_path)
    (tmp_path / "right.hdr").unlink()
    (tmp_path / "ny.hdr").unlink()
    with pytest.raises(ValueError, match="a file for face -y"):
        layouts.find_faces(tmp_path)


def test_names_of_written_faces_are_recognised(tmp_path: pathlib.Path) -> None:
    for path in (tmp_path / "env.hdr", tmp_path / "set"):
        assert [layouts.face_of_name(f) for f in layouts.face_paths(path)] == [*range(6)]


# change of size -----------------------------------------------------------------------------------


@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 99))
def test_area_resize_keeps_power_and_white(old: int, new: int, seed: int) -> None:
    faces = np.random.default_rng(seed).random((6, old, old, 3)).astype(np.float32)
    out = layouts.area_resize(faces, new)
    np.testing.assert_allclose(
        CubeMap(out).power(), CubeMap(faces).power(), rtol=tolerances.CONVERTED_POWER
    )
    assert np.array_equal(layouts.area_resize(np.ones_like(faces), new), np.ones_like(out))


def test_area_resize_by_a_whole_factor_is_the_weighted_mean_of_a_block() -> None:
    faces = np.random.default_rng(1).random((6, 8, 8, 3)).astype(np.float32)
    omega = texel_solid_angles(8)
    out = layouts.area_resize(faces, 2)
    block, weight = faces[3, 4:8, :4], omega[4:8, :4, None]
    expected = (block * weight).sum(axis=(0, 1)) / weight.sum()
    np.testing.assert_allclose(out[3, 1, 0], expected, rtol=tolerances.SINGLE)


def test_area_resize_cuts_texels() -> None:
    """3 texels to 2: the middle one is shared, weighted by the solid angles of its halves."""
    faces = np.zeros((6, 3, 3, 3), dtype=np.float32)
    faces[0, 1, 1] = 1.0
    out = layouts.area_resize(faces, 2)
    share = texel_solid_angles(3)[1, 1] / 4.0 / texel_solid_angles(2)[0, 0]
    np.testing.assert_allclose(out[0], share, rtol=tolerances.SINGLE)
    assert not out[1:].any()


def test_enlarging_is_the_bilinear_lookup() -> None:
    faces = np.random.default_rng(2).random((6, 4, 4, 3)).astype(np.float32)
    expected = CubeMap(faces).lookup(texel_directions(7))
    np.testing.assert_allclose(layouts.resize(faces, 7), expected, rtol=tolerances.SINGLE)
    assert layouts.resize(faces, 4) is faces
