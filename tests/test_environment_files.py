"""What an environment's file says of itself: windows, the attribute envmap, primaries."""

import importlib
import pathlib
import struct

import numpy as np
import pytest
from picture_files import attribute, rgb_exr
from test_environment import Float32Array, noise, six_files

import glossy
from glossy.latlong import latlong_power, latlong_to_cube


def exr_file(file: pathlib.Path, pixels: Float32Array, **more: object) -> pathlib.Path:
    file.write_bytes(rgb_exr(pixels, **more))
    return file


def test_a_crop_is_refused_or_black(tmp_path: pathlib.Path) -> None:
    whole = np.zeros((16, 32, 3), dtype=np.float32)
    whole[2:6, 4:12] = noise(4, 8)
    file = exr_file(
        tmp_path / "c.exr", whole[2:6, 4:12], data=(4, 2, 11, 5), display=(0, 0, 31, 15)
    )
    windows = r"c\.exr: .*window \(4, 2\) to \(11, 5\).*window \(0, 0\) to \(31, 15\)"
    with pytest.raises(ValueError, match=windows):
        glossy.read_environment(file)
    cube = glossy.read_environment(file, size=8, crop="black")
    assert np.array_equal(cube.faces, latlong_to_cube(whole, 8))


def test_overscan_is_cut(tmp_path: pathlib.Path) -> None:
    pixels = noise(10, 20)
    file = exr_file(tmp_path / "o.exr", pixels, data=(-2, -1, 17, 8), display=(0, 0, 15, 7))
    cube = glossy.read_environment(file, size=4)
    assert np.array_equal(cube.faces, latlong_to_cube(pixels[1:9, 2:18], 4))


def test_windows_of_face_files(tmp_path: pathlib.Path) -> None:
    faces = noise(6, 4, 4)
    files = six_files(tmp_path, ("px", "nx", "py", "ny", "pz", "nz"), faces)
    exr_file(files[2], faces[2], display=(1, 1, 3, 3))
    with pytest.raises(ValueError, match=r"py\.exr: must be as large as px\.exr \(4\), got 3"):
        glossy.read_environment(files)
    exr_file(files[2], faces[2][:3], display=(0, 0, 3, 3))
    with pytest.raises(ValueError, match=r"py\.exr: stores only part of the picture"):
        glossy.read_environment(files)
    black = glossy.read_environment(files, size=None, crop="black")
    assert np.array_equal(black.faces[2, :3], faces[2, :3])
    assert not black.faces[2, 3].any()


def envmap(kind: int) -> bytes:
    return attribute(b"envmap", b"envmap", bytes([kind]))


def test_the_attribute_envmap_says_how_a_strip_lies(tmp_path: pathlib.Path) -> None:
    """+Z, the fifth face, lit where OpenEXR has +x: on its left; an explicit layout wins."""
    strip = np.zeros((24, 4, 3), dtype=np.float32)
    strip[16:20, :2] = 1.0
    file = exr_file(tmp_path / "cube.exr", strip, extra=envmap(1))
    cube = glossy.read_environment(file, size=None)
    assert cube.lookup([[0.5, 0.0, 1.0], [-0.5, 0.0, 1.0]])[:, 0].tolist() == [1.0, 0.0]
    named = glossy.read_environment(file, size=None, layout="strip-vertical")
    assert named.lookup([[0.5, 0.0, 1.0], [-0.5, 0.0, 1.0]])[:, 0].tolist() == [0.0, 1.0]
    with pytest.raises(ValueError, match="must be 1:6 for layout openexr-cube, got '32 x 16'"):
        glossy.read_environment(exr_file(tmp_path / "w.exr", noise(16, 32), extra=envmap(1)))


def test_the_attribute_envmap_says_where_samples_lie(tmp_path: pathlib.Path) -> None:
    """Rows on the poles, two columns on the seam; an explicit orientation wins."""
    pixels = noise(8, 16)
    file = exr_file(tmp_path / "l.exr", pixels, extra=envmap(0))
    expected = latlong_to_cube(pixels, 4, "openexr")
    assert not np.array_equal(expected, latlong_to_cube(pixels, 4))
    assert np.array_equal(glossy.read_environment(file, size=4).faces, expected)
    for name in ("glossy", "three"):
        cube = glossy.read_environment(file, size=4, orientation=name)
        assert np.array_equal(cube.faces, latlong_to_cube(pixels, 4, name))
    read_source = importlib.import_module("glossy.environment").read_source
    np.testing.assert_array_equal(read_source(file).power(), latlong_power(pixels, "openexr"))


def test_six_files_of_other_primaries_are_one_warning(tmp_path: pathlib.Path) -> None:
    names = ("px", "nx", "py", "ny", "pz", "nz")
    p3 = struct.pack("<8f", 0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329)
    extra = attribute(b"chromaticities", b"chromaticities", p3)
    for name in names:
        exr_file(tmp_path / f"{name}.exr", noise(2, 2), extra=extra)
    with pytest.warns(UserWarning, match=r"px\.exr: chromaticities 0\.68 0\.32") as caught:
        glossy.read_environment(tmp_path, size=None)
    assert len(caught) == 1
    assert caught[0].filename == __file__
