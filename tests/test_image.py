"""Images in and out: what is read is what is stored, and every refusal is one line."""

import ctypes
import os
import pathlib
import struct
import subprocess
import sys
import zlib
from typing import Any

import matplotlib.image
import numpy as np
import OpenEXR
import OpenImageIO
import pytest
import tolerances
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from picture_files import exr_bytes

from glossy import _output, image, image_write

RNG = np.random.default_rng(5)
RGB = RNG.random((13, 21, 3)).astype(np.float32)
LOSSLESS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ")
LOSSY = ("PXR24", "B44", "B44A", "DWAA", "DWAB")
LATER = ("HTJ2K256", "HTJ2K32", "ZSTD")  # lossless; OpenEXR 3.4 and 3.5
AVAILABLE = [*LOSSLESS, *(name for name in LATER if hasattr(OpenEXR, f"{name}_COMPRESSION"))]


def raw_exr(path: pathlib.Path, channels: dict[str, Any], **header: Any) -> str:
    OpenEXR.File(header, dict(channels)).write(str(path))  # it changes what it is given
    return str(path)


def layout(tiled: bool) -> dict[str, Any]:
    if not tiled:
        return {"type": OpenEXR.scanlineimage}
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 8
    return {"type": OpenEXR.tiledimage, "tiles": tiles}


@pytest.mark.parametrize("tiled", [False, True])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("method", AVAILABLE)
def test_exr_of_every_lossless_compression_is_exact(
    tmp_path: pathlib.Path, method: str, dtype: type, tiled: bool
) -> None:
    stored: np.ndarray[Any, Any] = RGB.astype(dtype)
    compression = getattr(OpenEXR, f"{method}_COMPRESSION")
    path = raw_exr(tmp_path / "a.exr", {"RGB": stored}, compression=compression, **layout(tiled))
    read = image.read_image(path)
    assert read.channels == ("R", "G", "B")
    assert read.pixels.dtype == np.float32
    np.testing.assert_array_equal(read.pixels, stored.astype(np.float32))
    kind = "half" if dtype is np.float16 else "float"
    assert read.metadata["sample_type"] == kind


@pytest.mark.parametrize("tiled", [False, True])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("method", LOSSY)
def test_exr_of_lossy_compressions_is_close(
    tmp_path: pathlib.Path, method: str, dtype: type, tiled: bool
) -> None:
    y, x = np.mgrid[0:64, 0:96]
    smooth = np.stack([1 + np.sin(x / 20), 1 + np.cos(y / 15), 0.5 + x / 100], axis=-1)
    stored: np.ndarray[Any, Any] = smooth.astype(dtype)
    compression = getattr(OpenEXR, f"{method}_COMPRESSION")
    path = raw_exr(tmp_path / "a.exr", {"RGB": stored}, compression=compression, **layout(tiled))
    np.testing.assert_allclose(
        image.read_image(path).pixels, smooth, atol=tolerances.LOSSY_EXR, rtol=0
    )


@pytest.mark.parametrize("mipmap", [False, True])
def test_tiled_exr_is_read_at_full_size(tmp_path: pathlib.Path, mipmap: bool) -> None:
    spec = OpenImageIO.ImageSpec(21, 13, 3, "float")
    buffer = OpenImageIO.ImageBuf(spec)
    buffer.set_pixels(OpenImageIO.ROI(0, 21, 0, 13, 0, 1, 0, 3), RGB)
    path = str(tmp_path / "tiled.exr")
    if mipmap:
        config = OpenImageIO.ImageSpec()
        config.attribute("maketx:fixnan", "none")
        OpenImageIO.ImageBufAlgo.make_texture(OpenImageIO.MakeTxTexture, buffer, path, config)
    else:
        buffer.set_write_tiles(8, 8)
        buffer.write(path)
    assert OpenEXR.File(path, header_only=True).header()["type"] == OpenEXR.tiledimage
    read = image.read_image(path)
    assert read.pixels.shape == (13, 21, 3)
    np.testing.assert_array_equal(read.rgb(), RGB)


def test_exr_channels_keep_names_types_and_order(tmp_path: pathlib.Path) -> None:
    channels = {
        "error.R": RGB[..., 0].copy(),
        "A": RGB[..., 1].astype(np.float16),
        "B": RGB[..., 2].copy(),
        "G": RGB[..., 1].copy(),
        "R": RGB[..., 0].copy(),
        "id": np.arange(13 * 21, dtype=np.uint32).reshape(13, 21),
    }
    planes = image.read_planes(raw_exr(tmp_path / "a.exr", channels))
    assert list(planes.planes)[:4] == ["R", "G", "B", "A"]
    assert set(planes.planes) == set(channels)
    assert planes.planes["A"].dtype == np.float16
    for name, stored in channels.items():
        np.testing.assert_array_equal(planes.planes[name], stored)
    with pytest.raises(ValueError, match=r"a\.exr: has no channel Z; it has R, G, B, A"):
        planes.select(["R", "Z"])


def test_grey_images_are_broadcast_and_others_have_no_rgb(tmp_path: pathlib.Path) -> None:
    grey = image.read_image(raw_exr(tmp_path / "y.exr", {"Y": RGB[..., 0].copy()}))
    np.testing.assert_array_equal(grey.rgb(), np.repeat(RGB[..., :1], 3, axis=2))
    depth = image.read_image(raw_exr(tmp_path / "z.exr", {"Z": RGB[..., 0].copy()}))
    with pytest.raises(ValueError, match="only Z"):
        depth.rgb()


@pytest.mark.parametrize(
    ("names", "picture"),
    [
        ("RGB", "RGB"),
        ("ABGRXYZ", "RGB"),
        ("Y", "Y"),
        ("YA", "Y"),
        ("XYZ", None),
        ("UVY", None),
        (("Y", "RY", "BY"), None),
        ("YZ", None),
        ("RG", None),
        ((), None),
    ],
)
def test_which_channels_are_the_picture(names: Any, picture: str | None) -> None:
    assert image.colour_channels(names) == (None if picture is None else tuple(picture))


@pytest.mark.parametrize("half", [False, True])
def test_written_exr_reads_back(tmp_path: pathlib.Path, half: bool) -> None:
    path = tmp_path / "a.exr"
    channels: dict[str, Any] = {
        "R": RGB[..., 0],
        "error.R": RGB[..., 1].astype(np.float64),
        "Z": RGB[..., 2],
    }
    image.write_exr(path, channels, half=half, metadata={"method": "regular", "n": 20, "t": 0.5})
    read = image.read_planes(path)
    kind = np.float16 if half else np.float32
    for name, plane in channels.items():
        assert read.planes[name].dtype == kind
        np.testing.assert_array_equal(read.planes[name], plane.astype(kind))
    assert [read.metadata[k] for k in ("method", "n", "t")] == ["regular", 20, 0.5]
    first = path.read_bytes()
    image.write_exr(path, channels, half=half, metadata={"method": "regular", "n": 20, "t": 0.5})
    assert path.read_bytes() == first
    assert os.listdir(tmp_path) == ["a.exr"]


def test_exr_keeps_nan_and_infinity(tmp_path: pathlib.Path) -> None:
    values = np.array([[np.nan, np.inf, -np.inf, -0.0, 1e-42]], dtype=np.float32)
    image.write_exr(tmp_path / "a.exr", {"Y": values})
    got = image.read_planes(tmp_path / "a.exr").planes["Y"]
    np.testing.assert_array_equal(got.view(np.uint32), values.view(np.uint32))


@pytest.mark.parametrize(
    ("channels", "options", "message"),
    [
        ({}, {}, "channels: must not be empty"),
        ({"R": RGB}, {}, r"must have shape \(H, W\)"),
        ({"R": RGB[..., 0], "G": RGB[:-1, :, 0]}, {}, "shape of the other channels"),
        ({"R": np.full((2, 2), 7e4)}, {"half": True}, r"within \+-65504, got 70000"),
        ({"R": np.full((2, 2), 1e300)}, {}, "within"),
        ({"R": np.full((2, 2), 1j)}, {}, "real numbers"),
        ({"": RGB[..., 0]}, {}, "named"),
        ({"R": RGB[..., 0]}, {"metadata": {"dataWindow": "x"}}, "reserved"),
        ({"R": RGB[..., 0]}, {"metadata": {"x": [1]}}, "text or a number"),
        ({"R": RGB[..., 0]}, {"metadata": {"x": 2**40}}, "32 bits"),
    ],
)
def test_write_exr_refuses(
    tmp_path: pathlib.Path, channels: Any, options: Any, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        image.write_exr(tmp_path / "a.exr", channels, **options)
    assert os.listdir(tmp_path) == []


def radiance(pixels: bytes, size: bytes = b"-Y 2 +X 3", head: bytes = b"") -> bytes:
    return b"#?RADIANCE\n" + head + b"FORMAT=32-bit_rle_rgbe\n\n" + size + b"\n" + pixels


def test_radiance_values_are_mantissa_times_power_of_two(tmp_path: pathlib.Path) -> None:
    quads = np.zeros((256, 256, 4), dtype=np.uint8)  # all exponents, all mantissas
    quads[..., 3] = np.arange(256)[:, None]
    quads[..., 0] = np.arange(256)
    quads[..., 1:3] = 200, 1
    (tmp_path / "a.hdr").write_bytes(radiance(quads.tobytes(), b"-Y 256 +X 256", b"GAMMA=1\n"))
    exponents = quads[..., 3:].astype(float)
    expected = np.where(exponents > 0, quads[..., :3] * 2.0 ** (exponents - 136.0), 0.0)
    np.testing.assert_array_equal(image.read_image(tmp_path / "a.hdr").pixels, expected)


@pytest.mark.parametrize(
    ("size", "turn"),
    [
        (b"-Y 2 +X 3", lambda p: p),
        (b"+Y 2 +X 3", lambda p: p[::-1]),
        (b"-Y 2 -X 3", lambda p: p[:, ::-1]),
        (b"+X 2 -Y 3", lambda p: p.swapaxes(0, 1)),
    ],
)
def test_radiance_scan_orders_come_out_upright(
    tmp_path: pathlib.Path, size: bytes, turn: Any
) -> None:
    quads = np.full((2, 3, 4), 136, dtype=np.uint8)
    quads[..., 0] = np.arange(6).reshape(2, 3) + 128
    (tmp_path / "a.hdr").write_bytes(radiance(quads.tobytes(), size))
    np.testing.assert_array_equal(
        image.read_image(tmp_path / "a.hdr").pixels[..., 0], turn(quads[..., 0])
    )


def naive_rgbe(path: pathlib.Path) -> np.ndarray[Any, Any]:
    """Radiance reader written from the format's description: run-length and flat scanlines."""
    data = path.read_bytes()
    i = data.index(b"\n\n") + 2
    j = data.index(b"\n", i)
    height, width = (int(n) for n in data[i:j].split()[1::2])
    i = j + 1
    rows = []
    for _ in range(height):
        if data[i] == 2 and data[i + 1] == 2 and struct.unpack_from(">H", data, i + 2)[0] == width:
            i += 4
            planes = []
            for _ in range(4):
                line = bytearray()
                while len(line) < width:
                    n = data[i]
                    if n > 128:
                        line += data[i + 1 : i + 2] * (n - 128)
                        i += 2
                    else:
                        line += data[i + 1 : i + 1 + n]
                        i += 1 + n
                planes.append(np.frombuffer(bytes(line), np.uint8))
            rows.append(np.stack(planes, axis=-1))
        else:
            rows.append(np.frombuffer(data, np.uint8, width * 4, i).reshape(width, 4))
            i += width * 4
    quads = np.stack(rows)
    e = quads[..., 3:].astype(int)
    return np.where(e > 0, np.ldexp(quads[..., :3].astype(float), e - 136), 0.0)


def test_real_radiance_maps_are_bit_identical(real_data: pathlib.Path) -> None:
    for path in sorted((real_data / "env").glob("*.hdr")):
        np.testing.assert_array_equal(image.read_image(path).pixels, naive_rgbe(path))


def test_real_lossy_exr_maps(real_data: pathlib.Path) -> None:
    """Sizes, largest values and the negatives of the lossy DWAB files, as documented."""
    for name, shape, top, negative in (
        ("blender_interior.exr", (512, 1024), 3.222e4, 5053),
        ("pmndrs_studio_512.exr", (256, 512), 3482.0, 798),
    ):
        rgb = image.read_image(real_data / "env" / name).rgb()
        luminance = rgb @ np.array([0.2126, 0.7152, 0.0722])
        assert rgb.shape[:2] == shape
        assert luminance.max() == pytest.approx(top, rel=1e-3)
        assert int((rgb < 0).any(axis=-1).sum()) == negative


@given(st.floats(1e-30, 1e30), st.integers(0, 2**32 - 1))
def test_radiance_writer_rounds_to_nearest(
    tmp_path_factory: pytest.TempPathFactory, scale: float, seed: int
) -> None:
    pixels = np.random.default_rng(seed).random((5, 9, 3)) * scale
    path = tmp_path_factory.getbasetemp() / "written.hdr"
    image.write_image(path, pixels)
    read = image.read_image(path).pixels.astype(np.float64)
    np.testing.assert_array_equal(read, naive_rgbe(path))
    largest = np.maximum(pixels, read).max(axis=-1)  # rounding may reach the next power of two
    step = 2.0 ** (np.frexp(largest)[1] - 8)
    assert (np.abs(read - pixels) <= 0.5 * step[..., None]).all()


def test_radiance_writer_at_its_limits(tmp_path: pathlib.Path) -> None:
    edge = np.array([[[255.9 / 256, 0.5, 0.0], [1e-45, 0, 0], [0, 0, 0], [1.6e38, 1, 2.0**120]]])
    image.write_image(tmp_path / "a.hdr", edge)
    read = image.read_image(tmp_path / "a.hdr").pixels
    assert read[0, 0].tolist() == [1.0, 0.5, 0.0]
    assert not read[0, 1:3].any()
    np.testing.assert_allclose(read[0, 3], edge[0, 3], atol=2.0**118, rtol=0)
    for bad, message in ((-1.0, "negative"), (np.nan, "finite"), (2e38, "below 2")):
        with pytest.raises(ValueError, match=message):
            image.write_image(tmp_path / "b.hdr", np.full((2, 2, 3), bad))
    assert os.listdir(tmp_path) == ["a.hdr"]


def srgb_to_linear(v: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize(("bits", "dtype"), [(8, np.uint8), (16, np.uint16)])
def test_png_integers_need_an_encoding(tmp_path: pathlib.Path, bits: int, dtype: type) -> None:
    top = 2**bits - 1
    q: np.ndarray[Any, Any] = RNG.integers(0, top + 1, (6, 7, 3)).astype(dtype)
    q[0, 0], q[0, 1] = 0, top
    path = tmp_path / "a.png"
    image_write.write_png(path, q)
    with pytest.raises(ValueError, match=r"a\.png: holds integers .* linear or srgb"):
        image.read_image(path)
    linear = image.read_image(path, encoding="linear").pixels
    np.testing.assert_array_equal(linear, (q / top).astype(np.float32))
    srgb = image.read_image(path, encoding="srgb").pixels
    np.testing.assert_array_equal(srgb, srgb_to_linear(q / top).astype(np.float32))
    with pytest.raises(ValueError, match="encoding: must be one of linear, srgb"):
        image.read_image(path, encoding="gamma")


def test_alpha_is_linear_and_not_multiplied_in(tmp_path: pathlib.Path) -> None:
    q = RNG.integers(0, 256, (3, 4, 4)).astype(np.uint8)
    spec = OpenImageIO.ImageSpec(4, 3, 4, "uint8")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    out = OpenImageIO.ImageOutput.create("png")
    assert out is not None
    path = str(tmp_path / "a.png")
    assert out.open(path, spec)
    assert out.write_image(q)
    out.close()
    read = image.read_image(path, encoding="srgb")
    np.testing.assert_array_equal(read.pixels[..., 3], (q[..., 3] / 255).astype(np.float32))
    np.testing.assert_array_equal(read.rgb(), srgb_to_linear(q[..., :3] / 255).astype(np.float32))


def test_floating_point_tiff_is_linear(tmp_path: pathlib.Path) -> None:
    spec = OpenImageIO.ImageSpec(21, 13, 3, "float")
    out = OpenImageIO.ImageOutput.create("tiff")
    assert out is not None
    path = str(tmp_path / "a.tif")
    assert out.open(path, spec)
    assert out.write_image(RGB)
    out.close()
    np.testing.assert_array_equal(image.read_image(path).rgb(), RGB)


@pytest.mark.parametrize("shape", [(1, 9), (7, 9), (40, 3)])
@pytest.mark.parametrize("tile", [0, 16])
def test_tiff_of_64_bits_is_read_or_refused(
    tmp_path: pathlib.Path, shape: tuple[int, int], tile: int
) -> None:
    """Of one row, and of tiles, the library returns what was in the memory before."""
    height, width = shape
    pixels = np.random.default_rng(1).random((height, width, 3))
    spec = OpenImageIO.ImageSpec(width, height, 3, "double")
    spec.tile_width = spec.tile_height = tile
    out = OpenImageIO.ImageOutput.create("tiff")
    assert out is not None
    path = str(tmp_path / "a.tif")
    assert out.open(path, spec)
    assert out.write_image(pixels)
    out.close()
    if tile or height == 1:
        with pytest.raises(ValueError, match=r"a\.tif: 64-bit samples in tiles or of one row"):
            image.read_image(path)
        return
    planes = image.read_planes(path).planes
    np.testing.assert_array_equal(np.stack(list(planes.values()), axis=-1), pixels)


@pytest.mark.parametrize("bits", [8, 16])
@given(q=st.lists(st.integers(0, 255), min_size=3, max_size=30))
def test_srgb_encoding_inverts_decoding(bits: int, q: list[int]) -> None:
    step = (2**bits - 1) // 255
    samples = np.array(q)[None, :, None] * step
    coded = image_write.encode_srgb(srgb_to_linear(samples / (2**bits - 1)), 0.0, bits)
    np.testing.assert_array_equal(coded, samples)


def test_png_applies_exposure_and_clips(tmp_path: pathlib.Path) -> None:
    pixels = np.array([[0.25, 0.5, -1.0, 7.0, 0.0]])
    image.write_image(tmp_path / "a.png", pixels, exposure=1.0, bits=16)
    read = image.read_image(tmp_path / "a.png", encoding="srgb")
    assert read.channels == ("Y",)
    np.testing.assert_allclose(
        read.pixels[0, :, 0], [0.5, 1.0, 0.0, 1.0, 0.0], atol=tolerances.SIXTEEN_BITS, rtol=0
    )


@pytest.mark.parametrize(
    ("name", "pixels", "options", "message"),
    [
        ("a.bmp", RGB, {}, "path suffix"),
        ("a.png", RGB[..., :2], {}, "pixels: must be"),
        ("a.hdr", np.zeros((0, 3, 3)), {}, "pixels: must be"),
        ("a.png", RGB * np.nan, {}, "finite"),
        ("a.png", RGB, {"bits": 12}, "bits: must be 8 or 16"),
        ("a.png", RGB, {"half": True}, "option of .exr"),
        ("a.exr", RGB, {"exposure": 1.0}, "option of .png"),
    ],
)
def test_write_image_refuses(
    tmp_path: pathlib.Path, name: str, pixels: Any, options: Any, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        image.write_image(tmp_path / name, pixels, **options)
    assert os.listdir(tmp_path) == []


def test_a_failed_write_leaves_the_old_file(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "a.exr"
    path.write_bytes(b"old")

    def interrupted() -> None:
        with _output.replacing(path) as temporary:
            pathlib.Path(temporary).write_bytes(b"half of the n")
            raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        interrupted()
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.exr"]
    with pytest.raises(OSError, match=r"nowhere.*folder does not exist"):
        image.write_exr(tmp_path / "nowhere" / "a.exr", {"Y": RGB[..., 0]})
    with pytest.raises(OSError, match="is a directory"):
        image.write_exr(tmp_path, {"Y": RGB[..., 0]})


@pytest.mark.parametrize("name", ["a.exr", "a.hdr", "a.png"])
def test_every_shortened_file_is_refused(
    tmp_path: pathlib.Path, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    image.write_image(tmp_path / name, RNG.random((12, 16, 3)))
    whole = (tmp_path / name).read_bytes()
    end = len(whole) - (12 if name == "a.png" else 0)  # PNG ends in 12 bytes without pixels
    short = tmp_path / f"short-{name}"
    for size in {*range(1, end, 23), *range(1, 12), end - 1}:
        short.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=f"short-{name}: ") as caught:
            image.read_image(short, encoding="linear")
        assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", [".exr", ".hdr", ".png"])
def test_names_may_hold_any_characters(tmp_path: pathlib.Path, suffix: str) -> None:
    path = tmp_path / f"Glanz α☃ %s {{0}}{suffix}"
    image.write_image(path, np.ones((2, 3, 3)))
    np.testing.assert_array_equal(image.read_image(path, encoding="srgb").rgb(), 1.0)


@given(hnp.arrays(
    st.sampled_from([np.uint8, np.uint16]),
    st.tuples(st.integers(1, 9), st.integers(1, 9), st.sampled_from([1, 3])),
))  # fmt: skip
def test_png_writer_is_exact(
    tmp_path_factory: pytest.TempPathFactory, samples: np.ndarray[Any, Any]
) -> None:
    """Against two readers that have nothing in common with it; one sees eight bits only."""
    path = tmp_path_factory.getbasetemp() / "written.png"
    image_write.write_png(path, samples)
    buffer = OpenImageIO.ImageBuf(str(path))
    space = buffer.spec().get_string_attribute("oiio:ColorSpace").lower()
    assert space.startswith("srgb")
    np.testing.assert_array_equal(buffer.get_pixels(samples.dtype.name), samples)
    if samples.dtype == np.uint8:
        shown = np.atleast_3d(matplotlib.image.imread(path))
        np.testing.assert_array_equal(np.rint(shown * 255), samples)


def patched_window(path: pathlib.Path, box: tuple[int, int, int, int]) -> str:
    data = path.read_bytes()
    place = data.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    path.write_bytes(data[:place] + struct.pack("<4i", *box) + data[place + 16 :])
    return str(path)


def unusable(folder: pathlib.Path) -> dict[str, tuple[str, str]]:
    """File of each kind of trouble -> the words its refusal must hold."""
    good = folder / "good.exr"
    raw_exr(good, {"RGB": np.repeat(RGB, 8, axis=0)}, compression=OpenEXR.ZIP_COMPRESSION)
    whole = good.read_bytes()
    found = {"missing": (str(folder / "none.exr"), "no such file"), "folder": (str(folder), "dir")}
    contents = {
        "empty.exr": (b"", "is empty"),
        "text.exr": (b"hello world", "not an OpenEXR file"),
        "head.exr": (whole[:150], "truncated header"),
        "half.exr": (whole[: len(whole) // 2], "cannot be read"),
        "tail.exr": (whole[:-9], "cannot be read"),
        "text.png": (b"hello world", "PNG"),
        "text.dat": (b"hello world", "cannot be read"),
        "head.hdr": (b"#?RADIANCE\n", "cannot be read"),
        "half.hdr": (radiance(b"\x80\x80\x80\x80"), "cannot be read"),
        "xyz.hdr": (radiance(b"\x80" * 24).replace(b"rgbe", b"xyze"), "cannot be read"),
        "zero.hdr": (radiance(b"", b"-Y 0 +X 3"), "cannot be read"),
    }
    for name, (data, words) in contents.items():
        (folder / name).write_bytes(data)
        found[name] = (str(folder / name), words)
    part = OpenEXR.Part({}, {"Z": RGB[..., 0].copy()}, "a")
    other = OpenEXR.Part({}, {"Z": RGB[..., 0].copy()}, "b")
    OpenEXR.File([part, other]).write(str(folder / "parts.exr"))
    found["parts"] = (str(folder / "parts.exr"), "has 2 parts")
    (folder / "large.exr").write_bytes(whole)
    large = patched_window(folder / "large.exr", (0, 0, 99999, 99999))
    found["large"] = (large, "100000 x 100000 with 3 channels is more than the limit")
    found["deep"] = (deep_exr(folder / "deep.exr"), "deep")
    spec = OpenImageIO.ImageSpec(4, 3, 1, "uint")
    OpenImageIO.ImageBuf(spec).write(str(folder / "wide.tif"))
    found["wide"] = (str(folder / "wide.tif"), "type uint ")
    return found


def deep_exr(path: pathlib.Path) -> str:
    spec = OpenImageIO.ImageSpec(4, 3, 1, "float")
    spec.channelnames = ("Z",)
    spec.deep = True
    samples = OpenImageIO.DeepData()
    samples.init(12, 1, ("float",), ("Z",))
    for pixel in range(12):
        samples.set_samples(pixel, 1)
    out = OpenImageIO.ImageOutput.create(str(path))
    assert out is not None
    assert out.open(str(path), spec)
    assert out.write_deep_image(samples)
    out.close()
    return str(path)


def test_unusable_files_are_one_line_naming_them(
    tmp_path: pathlib.Path, capfd: pytest.CaptureFixture[str]
) -> None:
    cases = unusable(tmp_path)
    capfd.readouterr()
    for path, words in cases.values():
        with pytest.raises((ValueError, OSError)) as caught:
            image.read_image(path, encoding="linear")
        text = str(caught.value)
        assert text.startswith(f"{path}: "), text
        assert words in text
        assert "\n" not in text
    assert capfd.readouterr() == ("", "")  # the C libraries are silent too


def png_claiming(width: int, height: int) -> bytes:
    out = b"\x89PNG\r\n\x1a\n"
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    for kind, data in ((b"IHDR", header), (b"IDAT", zlib.compress(bytes(100))), (b"IEND", b"")):
        out += struct.pack(">I", len(data)) + kind + data
        out += struct.pack(">I", zlib.crc32(kind + data))
    return out


def test_sizes_that_headers_only_claim(
    tmp_path: pathlib.Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Nothing, less than nothing, and more than there is: refused before memory is taken."""
    paths = []
    boxes = [(0, 0, -1, -1), (5, 5, 0, 0), (-(2**31), -(2**31), 2**31 - 1, 2**31 - 1),
             (0, 0, 2**30, 0), (0, 0, 0, 2**30), (0, 0, 16000, 16000)]  # fmt: skip
    for i, box in enumerate(boxes):
        raw_exr(tmp_path / f"{i}.exr", {"Y": RGB[..., 0].copy()})
        paths.append(patched_window(tmp_path / f"{i}.exr", box))
    contents = {
        "wide.hdr": radiance(b"\x80" * 64, b"-Y 60000 +X 60000"),
        "below.hdr": radiance(b"\x80" * 64, b"-Y -5 +X 3"),
        "wide.png": png_claiming(100000, 100000),
        "none.png": png_claiming(0, 5),
        "short.png": png_claiming(4000, 4000),
        "wide.pfm": b"PF\n60000 60000\n-1\n" + bytes(50),
        "wild.bmp": b"BM" + b"\xff" * 60,
    }
    for name, data in contents.items():
        (tmp_path / name).write_bytes(data)
        paths.append(str(tmp_path / name))
    for path in paths:
        with pytest.raises(ValueError, match=r"cannot be read|limit") as caught:
            image.read_image(path, encoding="linear")
        assert str(caught.value).startswith(f"{path}: ")
        assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_pixel_limit_can_be_moved(tmp_path: pathlib.Path) -> None:
    path = raw_exr(tmp_path / "a.exr", {"RGB": RGB})
    with pytest.raises(ValueError, match=r"21 x 13 .* limit of 272 pixels \(max_pixels\)"):
        image.read_image(path, max_pixels=272)
    assert image.read_image(path, max_pixels=273).pixels.shape == (13, 21, 3)
    with pytest.raises(ValueError, match="max_pixels"):
        image.read_image(path, max_pixels=0)


def test_messages_of_others_are_passed_on(capfd: pytest.CaptureFixture[str]) -> None:
    from glossy._quiet import c_messages

    with c_messages() as said:
        os.write(2, b"another thread's line\nx.exr: (EXR_ERR_BAD) because\n")
        os.write(1, b"ojph warning 0x1 at a.cpp:1: odd\nbytes \xff\r\x00\n")
        ctypes.CDLL(None).printf(b"ojph info 0x2 at a.cpp:2: held back by C\n")
        print("printed meanwhile")
        assert said("x.exr") == "because"
    out = capfd.readouterr()
    assert out.err == "another thread's line\n"
    assert out.out.endswith("\x00\nprinted meanwhile\n")
    assert "ojph" not in out.out


def test_a_channel_whose_name_has_two_lines_is_named_on_one(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "a.exr"
    planes = {b"a\x0bb": np.zeros((2, 2), np.float32)}
    data = exr_bytes(planes)
    path.write_bytes(data)
    with pytest.raises(ValueError, match="it has a b") as error:
        image.read_planes(path).select(["R"])
    assert len(str(error.value).splitlines()) == 1
    at = data.index(b"a\x0bb\0") + 4 + 8
    path.write_bytes(data[:at] + struct.pack("<i", 2) + data[at + 4 :])
    with pytest.raises(ValueError, match="channel a b is subsampled") as error:
        image.read_planes(path)
    assert len(str(error.value).splitlines()) == 1


def test_no_module_of_the_comparison_loads_a_compiler() -> None:
    modules = "image, metrics, difference, _flip, commands.compare"
    code = (
        f"import sys, numpy, {', '.join('glossy.' + m for m in modules.split(', '))}\n"
        "numpy_only = numpy.ones((4, 4, 3))\n"
        "glossy.compare(numpy_only, numpy_only * 2)\n"
        "glossy.difference_picture(numpy_only, numpy_only * 2)\n"
        "loaded = [m for m in ('numba', 'llvmlite', 'scipy') if m in sys.modules]\n"
        "sys.exit(f'loaded {loaded}' if loaded else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
