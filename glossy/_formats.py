"""JPEG through imageio, PNG, TIFF, PFM and more through OpenImageIO, sizes checked first.

OpenImageIO opens every file and says what it holds. It decodes PNG, too: imageio's decoder cuts 16
bits to 8 and takes a file that lost its end.

Some of its readers decode a picture while they open it, so those formats' sizes are looked up in
the first bytes of the file before.
"""

import struct
from collections.abc import Callable
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

Plane = npt.NDArray[Any]
Planes = dict[str, Plane]
CheckSize = Callable[[int, int, int, int], None]

KINDS = {"half": 2, "float": 4, "double": 8, "uint8": 1, "uint16": 2}
UNREAD = ("null", "term")  # pictures that no file holds
BIG_TILE = 1 << 22  # pixels that a tile may have where the picture has fewer
DEFLATE = 1032  # the largest ratio of a PNG's packing
MOST_CHUNK = 8_000_000  # bytes that libpng unpacks one text or profile to
MOST_TEXT = 1 << 28  # bytes that all of a file's may unpack to
MOST_HEAD = 1 << 16
SEVERAL = "holds several images; one image per file is read"
MOST_JPEG = 80_000_000  # pixels; imageio's decoder warns of bombs beyond


class FormatError(ValueError):
    """Why a file is not read, without its name."""


def _check_png(stream: BinaryIO) -> None:
    # refuse what the library would unpack without end, or leave out: all pictures but the first
    total, at = 0, 8
    while True:
        stream.seek(at)
        head = stream.read(8)
        if len(head) < 8 or head[4:] == b"IEND":
            break
        length, kind = struct.unpack(">I4s", head)
        if kind == b"acTL" and int.from_bytes(stream.read(4)) > 1:
            raise FormatError(SEVERAL)
        packed = kind in (b"zTXt", b"iCCP")
        if kind == b"iTXt":  # packed if the byte after its name says so
            start = stream.read(min(length, 82))
            packed = start[start.find(b"\0") + 1 :][:1] == b"\1"
        if packed:
            total += min(DEFLATE * length, MOST_CHUNK)
        at += 12 + length
    if total > MOST_TEXT:
        raise FormatError("its packed texts and profiles may unpack to more than 256 MiB")


def _jpeg_xl(head: bytes) -> tuple[int, int, int] | None:
    # the size is in the first bits after the signature, in a box of its own or at the start
    at = head.find(b"jxlc\xff\x0a") + 4 if head[4:8] == b"JXL " else 0
    if head[at : at + 2] != b"\xff\x0a":
        return None
    bits = int.from_bytes(head[at + 2 : at + 14], "little")

    def take(count: int) -> int:
        nonlocal bits
        value, bits = bits & ((1 << count) - 1), bits >> count
        return value

    small = take(1)

    def length() -> int:
        return 8 * (take(5) + 1) if small else take((9, 13, 18, 30)[take(2)]) + 1

    height = length()
    ratio = take(3)
    wide, high = ((1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1))[ratio - 1]
    return (height * wide // high if ratio else length()), height, 4


def claimed_size(head: bytes) -> tuple[int, int, int] | None:
    """Width, height and channels that a file's first bytes claim, where opening it decodes it."""
    if head[:4] == b"GIF8" and len(head) >= 10:
        width, height = struct.unpack_from("<HH", head, 6)
        return width, height, 4
    if head[:4] == b"RIFF" and head[8:16] == b"WEBPVP8X" and len(head) >= 30:
        width, height = (int.from_bytes(head[k : k + 3], "little") + 1 for k in (24, 27))
        return width, height, 4
    if head[:2] == b"\xff\x0a" or head[4:8] == b"JXL ":
        return _jpeg_xl(head)
    at = head.find(b"\xff\x4f\xff\x51") if head[4:8] == b"jP  " else 0  # JPEG 2000
    if head[at : at + 4] == b"\xff\x4f\xff\x51" and len(head) >= at + 42:
        right, bottom, left, top = struct.unpack_from(">4I", head, at + 8)
        (channels,) = struct.unpack_from(">H", head, at + 40)
        return max(right - left, 1), max(bottom - top, 1), max(channels, 1)
    return None


def _check_first(name: str, check_size: CheckSize) -> None:
    with open(name, "rb") as stream:
        head = stream.read(MOST_HEAD)
        size = claimed_size(head)
        if size:
            check_size(*size, 4)
        if head[:8] == b"\x89PNG\r\n\x1a\n":
            _check_png(stream)


def read_planes(
    name: str, encoding: str | None, check_size: CheckSize
) -> tuple[Planes, dict[str, Any]]:
    """Channels and metadata of a picture; ``check_size`` takes width, height, channels and bytes.

    Raises
    ------
    FormatError, ValueError
        For what is not read; of a damaged file the library raises what it likes.
    """
    import OpenImageIO as oiio  # noqa: N813

    _check_first(name, check_size)
    raw_alpha = oiio.ImageSpec()
    raw_alpha.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(name, raw_alpha)
    if source is None:
        raise RuntimeError(oiio.geterror() or "unknown format")
    try:
        spec = source.spec()
        kind = str(spec.format)
        _check_spec(source, spec, kind, check_size)
        if kind.startswith("uint") and encoding is None:
            raise FormatError(
                f"holds integers ({kind}); say whether they are linear or srgb (encoding)"
            )
        pixels = _jpeg_pixels(name, source.format_name(), spec)
        if pixels is None:
            pixels = source.read_image(0, 0, 0, spec.nchannels, kind)
        if pixels is None or source.has_error:
            raise RuntimeError(source.geterror() or "truncated")
        metadata = {entry.name: entry.value for entry in spec.extra_attribs}
    finally:
        source.close()
    pixels = _upright(
        pixels.reshape(spec.height, spec.width, -1), int(str(metadata.get("Orientation", 1)))
    )
    planes = {}
    for i, channel in enumerate(spec.channelnames):
        plane = pixels[..., i]
        if kind.startswith("uint"):
            plane = decode_table(kind, "linear" if channel == "A" else str(encoding))[plane]
        planes[channel] = plane
    return planes, {**metadata, "sample_type": kind}


def _jpeg_pixels(name: str, form: str, spec: Any) -> Plane | None:
    # None for other files, and where imageio's decoder gives other channels (CMYK)
    if form != "jpeg" or spec.width * spec.height > MOST_JPEG:
        return None
    import imageio.v3 as iio

    pixels = np.asarray(iio.imread(name, plugin="pillow"))
    shape = (spec.height, spec.width, spec.nchannels)
    same = pixels.dtype == np.uint8 and (*pixels.shape, 1)[:3] == shape
    return pixels if same else None


def _check_spec(source: Any, spec: Any, kind: str, check_size: CheckSize) -> None:
    form = source.format_name()
    if form in UNREAD:
        raise FormatError(f"is of the format {form}, which no file holds")
    size = KINDS.get(kind, 8)
    check_size(spec.width, spec.height * spec.depth, spec.nchannels, size)
    if spec.deep or spec.depth > 1:
        raise FormatError("is a deep or volume image; only flat ones are read")
    if spec.tile_width:
        tile = spec.tile_width * spec.tile_height * max(spec.tile_depth, 1)
        if tile > max(spec.width * spec.height, BIG_TILE):
            tiles = f"{spec.tile_width} x {spec.tile_height}"
            raise FormatError(
                f"its tiles of {tiles} are larger than its {spec.width} x {spec.height} pixels"
            )
    several = source.seek_subimage(1, 0)
    source.geterror()  # forget that there is no second one
    if several:
        raise FormatError(SEVERAL)
    source.seek_subimage(0, 0)
    if kind not in KINDS:
        raise FormatError(f"samples of type {kind} are not read")
    if kind == "double" and (spec.tile_width or spec.height == 1):
        # the library leaves the memory of such pixels as it was
        raise FormatError("64-bit samples in tiles or of one row are not read; write 32-bit ones")


def _upright(pixels: Plane, orientation: int) -> Plane:
    # (H, W, C) as stored -> row 0 on top, column 0 at the left; EXIF's numbering 1..8
    if orientation >= 5:
        pixels = pixels.swapaxes(0, 1)
    rows = -1 if orientation in (3, 4, 7, 8) else 1
    columns = -1 if orientation in (2, 3, 6, 7) else 1
    return pixels[::rows, ::columns]


def decode_table(kind: str, encoding: str) -> npt.NDArray[np.float32]:
    """Linear value of each sample of 8 or 16 bits: q/(2^n - 1), decoded if ``encoding`` is srgb."""
    top = np.iinfo(kind).max
    v = np.arange(top + 1) / top
    if encoding == "srgb":
        v = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    return np.asarray(v, dtype=np.float32)
