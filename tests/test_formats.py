"""Sizes that files of other formats only claim: refused before a library decodes them."""

import pathlib
import struct
import zlib

import numpy as np
import OpenImageIO
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glossy import _formats, image


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(*more: bytes) -> bytes:
    """A black picture of 2 x 2 with more chunks."""
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 2, 2, 8, 0, 0, 0, 0))
    pixels = chunk(b"IDAT", zlib.compress(bytes(6)))
    return b"\x89PNG\r\n\x1a\n" + head + b"".join(more) + pixels + chunk(b"IEND", b"")


def test_packed_texts_of_a_png_are_bounded(tmp_path: pathlib.Path) -> None:
    """Texts of 8 MB each from 8 KB: a few are read past, many refused; plain ones do not count."""
    packed = zlib.compress(bytes(7_900_000), 9)
    bomb = chunk(b"zTXt", b"k\0\0" + packed)
    path = tmp_path / "a.png"
    for more in ([bomb], [chunk(b"iTXt", b"k\0\0\0\0\0" + b"x" * 9000)] * 40):
        path.write_bytes(png(*more))
        assert image.read_image(path, "linear").pixels.shape == (2, 2, 1)
    for more in ([bomb] * 40, [chunk(b"iTXt", b"k\0\1\0\0\0" + packed)] * 40):
        path.write_bytes(png(*more))
        with pytest.raises(ValueError, match=r"a\.png: its packed texts .* more than 256 MiB"):
            image.read_image(path, "linear")


def test_animated_pictures_are_refused(tmp_path: pathlib.Path) -> None:
    """Their first frame is not all that they show; one frame is."""
    path = tmp_path / "a.png"
    path.write_bytes(png(chunk(b"acTL", struct.pack(">II", 1, 0))))
    assert image.read_image(path, "linear").pixels.shape == (2, 2, 1)
    path.write_bytes(png(chunk(b"acTL", struct.pack(">II", 2, 0))))
    with pytest.raises(ValueError, match=r"a\.png: holds several images"):
        image.read_image(path, "linear")


@given(st.integers(1, 2**16 - 1), st.integers(1, 2**16 - 1))
def test_sizes_are_looked_up_where_opening_decodes(width: int, height: int) -> None:
    gif = b"GIF89a" + struct.pack("<HH", width, height)
    assert _formats.claimed_size(gif) == (width, height, 4)
    webp = b"RIFF1234WEBPVP8X" + bytes(8)
    webp += (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
    assert _formats.claimed_size(webp) == (width, height, 4)
    code = b"\xff\x4f\xff\x51" + bytes(4) + struct.pack(">4I", width + 3, height + 5, 3, 5)
    code += bytes(16) + struct.pack(">H", 2)
    for data in (code, b"1234jP  " + bytes(20) + code):
        assert _formats.claimed_size(data) == (width, height, 2)
    # JPEG XL, bit by bit from the lowest: not small, 18-bit height, no ratio, 18-bit width
    bits = 2 << 1 | height - 1 << 3 | 0 << 21 | 2 << 24 | width - 1 << 26
    for data in (b"\xff\x0a", b"1234JXL " + bytes(9) + b"jxlc\xff\x0a"):
        assert _formats.claimed_size(data + bits.to_bytes(12, "little")) == (width, height, 4)
    small = 1 | 3 << 1 | 5 << 6  # height 8 (3 + 1), ratio 16 : 9
    assert _formats.claimed_size(b"\xff\x0a" + small.to_bytes(12, "little")) == (56, 32, 4)


@pytest.mark.parametrize("head", [b"", b"GIF8", b"RIFF1234WEBPVP8 ", b"1234jP  ", b"1234JXL "])
def test_other_first_bytes_claim_nothing(head: bytes) -> None:
    assert _formats.claimed_size(head) is None


@pytest.mark.parametrize("suffix", ["gif", "jp2"])
def test_giant_claims_are_one_line(tmp_path: pathlib.Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    out = OpenImageIO.ImageOutput.create(str(path))
    assert out is not None
    assert out.open(str(path), OpenImageIO.ImageSpec(64, 64, 3, "uint8"))
    assert out.write_image(np.zeros((64, 64, 3), np.uint8))
    out.close()
    assert image.read_image(path, "linear").pixels.shape[:2] == (64, 64)
    data = bytearray(path.read_bytes())
    if suffix == "gif":
        struct.pack_into("<HH", data, 6, 60000, 60000)
    else:
        at = data.index(b"\xff\x4f\xff\x51") + 8
        struct.pack_into(">2I", data, at, 60000, 60000)
    path.write_bytes(data)
    with pytest.raises(ValueError, match=rf"a\.{suffix}: 60000 x 60000 .* limit of 268435456"):
        image.read_image(path, "linear")


def test_tiles_larger_than_the_picture_are_refused(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "a.tif"
    spec = OpenImageIO.ImageSpec(64, 64, 1, "float")
    spec.tile_width = spec.tile_height = 16
    out = OpenImageIO.ImageOutput.create(str(path))
    assert out is not None
    assert out.open(str(path), spec)
    assert out.write_image(np.zeros((64, 64, 1), np.float32))
    out.close()
    assert image.read_image(path).pixels.shape == (64, 64, 1)
    data = bytearray(path.read_bytes())
    (at,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, at)
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        if struct.unpack_from("<H", data, entry)[0] in (322, 323):  # width and length of a tile
            struct.pack_into("<HII", data, entry + 2, 4, 1, 2**15)
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"a\.tif: its tiles of 32768 x 32768 are larger"):
        image.read_image(path)


def test_pictures_that_no_file_holds_are_refused(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "a.null"
    path.write_bytes(b"anything")
    with pytest.raises(ValueError, match=r"a\.null: is of the format null"):
        image.read_image(path, "linear")
