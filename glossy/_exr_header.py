"""The header of an OpenEXR file, read before the library allocates what it claims.

A file is a magic number, a version, headers of attributes (name, type, size, data), a table of
8-byte offsets of its chunks, and the chunks. The library's binding refuses names and texts that
are not UTF-8 and some types of attribute, none of which change a pixel: such files are read
through a copy whose header holds what the binding takes.
"""

import contextlib
import dataclasses
import math
import os
import shutil
import struct
import tempfile
from collections.abc import Iterator
from typing import BinaryIO

MAGIC = b"\x76\x2f\x31\x01"
MOST = 1 << 26  # bytes of a header; previews are the largest attributes
TILED, LONG_NAMES, DEEP, PARTS = 0x200, 0x400, 0x800, 0x1000
PIXEL_BYTES = (4, 2, 4)  # unsigned, half, float
LINES = (1, 1, 1, 16, 32, 16, 32, 32, 32, 256, 256, 32, 256, 1)  # of a chunk, by compression
# bytes of pixels to a byte of file, by compression: none, run lengths, deflate (2, 3, 5), Huffman
# codes of runs of 256, 16 halves in 14 and in 3 bytes, deflate of blocks of 64 (8, 9), Zstandard
LARGEST_RATIO = {
    0: 1.0, 1: 65.0, 2: 1040.0, 3: 1040.0, 4: 420.0, 5: 1390.0, 6: 2.3, 7: 10.7, 8: 7e4, 9: 7e4,
    13: 4e4,
}  # fmt: skip
BIG_TILE = 1 << 24  # bytes from which a tile larger than the picture is cut to it

# what the binding takes, with the size of its data; the rest is left out of the copy
TYPES = {
    "box2f": 16, "box2i": 16, "chlist": None, "chromaticities": 32, "compression": 1, "double": 8,
    "envmap": 1, "float": 4, "int": 4, "lineOrder": 1, "m33d": 72, "m33f": 36, "m44d": 128,
    "m44f": 64, "rational": 8, "string": None, "tiledesc": 9, "v2d": 16, "v2f": 8, "v2i": 8,
    "v3d": 24, "v3f": 12, "v3i": 12,
}  # fmt: skip

Window = tuple[int, int, int, int]


class HeaderError(ValueError):
    """What is wrong with a header, without the file's name."""


@dataclasses.dataclass(frozen=True)
class Attribute:
    """One entry of a header, as stored."""

    name: bytes
    kind: bytes
    data: bytes

    @property
    def taken(self) -> bool:
        """True if the binding takes it as it is."""
        kind = self.kind.decode("latin-1")
        if kind not in TYPES or not _is_utf8(self.name):
            return False
        if kind in ("string", "chlist"):
            return _is_utf8(self.data)
        if len(self.data) != TYPES[kind] or (kind == "envmap" and self.data[0] > 1):
            return False
        return kind != "rational" or self.data[4:] != bytes(4)  # a fraction over zero

    def encoded(self) -> "Attribute | None":
        """The same with names and texts in UTF-8; None if the binding takes no such type."""
        kind = self.kind.decode("latin-1")
        if kind == "chlist":
            entries = _channels(self.data)
            data = b"".join(_utf8(c) + b"\0" + rest for c, rest in entries) + b"\0"
            return Attribute(_utf8(self.name), self.kind, data)
        found = Attribute(_utf8(self.name), self.kind, self.data)
        if kind == "string":
            found = dataclasses.replace(found, data=_utf8(self.data))
        return found if found.taken else None


@dataclasses.dataclass(frozen=True)
class Header:
    """What decides how much a file of one part takes.

    ``channels``: name, bytes of a sample, subsampling along x and y. Windows are
    (left, top, right, bottom), the last two included. ``end``: where the table of chunks starts;
    ``length``: of the file.
    """

    version: int
    attributes: list[Attribute]
    end: int
    parts: int
    deep: bool
    channels: list[tuple[str, int, int, int]]
    data_window: Window
    tile: tuple[int, int, int] | None
    chunks: int
    compression: int
    length: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pixels stored."""
        left, top, right, bottom = self.data_window
        return right - left + 1, bottom - top + 1

    @property
    def pixel_bytes(self) -> int:
        """Bytes of one pixel, all channels."""
        return sum(size for _, size, _, _ in self.channels)

    def check_capacity(self) -> None:
        """Refuse more chunks or pixels than the file's length can hold.

        Raises
        ------
        HeaderError
            With the length and the size.
        """
        width, height = self.size
        ratio = LARGEST_RATIO.get(self.compression, math.inf)
        pixels = sum(
            s * (width // max(x, 1)) * (height // max(y, 1)) for _, s, x, y in self.channels
        )
        if self.end + 8 * self.chunks + pixels / ratio > self.length:
            raise HeaderError(
                f"truncated, or a damaged header: {self.length} bytes cannot hold "
                f"{width} x {height} pixels in {self.chunks} chunks"
            )


def _is_utf8(text: bytes) -> bool:
    try:
        text.decode()
    except UnicodeDecodeError:
        return False
    return True


def _utf8(text: bytes) -> bytes:
    # OpenEXR's texts have no encoding: what is not UTF-8 is Latin-1, as Windows writes
    return text if _is_utf8(text) else text.decode("latin-1").encode()


def _channels(data: bytes) -> list[tuple[bytes, bytes]]:
    # name and the 16 bytes after it: type, linearity, 3 reserved, x and y sampling
    found, at = [], 0
    while data[at : at + 1] not in (b"\0", b""):
        end = data.find(b"\0", at)
        if end < 0 or end + 17 > len(data):
            raise HeaderError("damaged list of channels")
        found.append((data[at:end], data[end + 1 : end + 17]))
        at = end + 17
    return found


def _attributes(data: bytes, at: int) -> tuple[list[Attribute], int]:
    found = []
    while data[at : at + 1] != b"\0":
        name_end = data.find(b"\0", at, at + 257)
        kind_end = data.find(b"\0", name_end + 1, name_end + 258)
        if name_end < 0 or kind_end < 0 or kind_end + 5 > len(data):
            raise HeaderError("damaged or truncated header")
        (size,) = struct.unpack_from("<i", data, kind_end + 1)
        start = kind_end + 5
        if size < 0 or start + size > len(data):
            raise HeaderError("damaged or truncated header")
        found.append(
            Attribute(data[at:name_end], data[name_end + 1 : kind_end], data[start : start + size])
        )
        at = start + size
    return found, at + 1


def _levels(size: int, up: bool) -> int:
    # of a chain that halves down to one texel
    return (size - 1).bit_length() + 1 if up else size.bit_length()


def _count_chunks(size: tuple[int, int], compression: int, tile: bytes | None) -> int:
    width, height = size
    if tile is None:
        return -(-height // LINES[compression])
    across, down, mode = struct.unpack("<IIB", tile)
    if across < 1 or down < 1 or mode & 15 > 2 or mode >> 4 > 1:
        raise HeaderError("damaged description of tiles")
    up = bool(mode >> 4)

    def tiles(length: int, step: int, level: int) -> int:
        halved = -(-length >> level) if up else length >> level
        return -(-max(halved, 1) // step)

    if mode & 15 == 0:
        return tiles(width, across, 0) * tiles(height, down, 0)
    if mode & 15 == 1:
        levels = _levels(max(size), up)
        return sum(tiles(width, across, k) * tiles(height, down, k) for k in range(levels))
    columns = sum(tiles(width, across, k) for k in range(_levels(width, up)))
    return columns * sum(tiles(height, down, k) for k in range(_levels(height, up)))


def _box(data: bytes) -> Window:
    left, top, right, bottom = struct.unpack("<4i", data)
    return left, top, right, bottom


def read_header(stream: BinaryIO) -> Header:
    """The header of an open file, checked against the file's length.

    Raises
    ------
    HeaderError
        For a header that is damaged, or that claims more than the file can hold.
    """
    length = os.fstat(stream.fileno()).st_size
    data = stream.read(min(MOST, length))
    if len(data) < 9:
        raise HeaderError("damaged or truncated header")
    (version,) = struct.unpack_from("<I", data, 4)
    if version & 0xFF != 2:
        raise HeaderError(f"version {version & 0xFF} of the format, only 2 is read")
    attributes, end = _attributes(data, 8)
    parts = 1
    if version & PARTS:
        while data[end : end + 1] not in (b"\0", b""):
            end = _attributes(data, end)[1]
            parts += 1
        end += 1
    byname = {a.name: a.data for a in attributes}
    kind = byname.get(b"type", b"")
    deep = bool(version & DEEP) or kind.startswith(b"deep")
    try:
        channels = [
            (n.decode("utf-8", "replace"), PIXEL_BYTES[struct.unpack_from("<I", rest)[0]],
             *struct.unpack_from("<2i", rest, 8))
            for n, rest in _channels(byname[b"channels"])
        ]  # fmt: skip
        windows = [_box(byname[n]) for n in (b"dataWindow", b"displayWindow")]
        compression = byname[b"compression"][0]
        tiled = bool(version & TILED) or kind == b"tiledimage"
        tile = byname[b"tiles"] if tiled else None
        left, top, right, bottom = windows[0]
        size = right - left + 1, bottom - top + 1
        empty = min(size) < 1
        chunks = 0 if empty else _count_chunks(size, compression, tile)
    except (KeyError, IndexError, struct.error):  # an unknown compression too
        raise HeaderError("damaged header, or one that lacks what is required") from None
    return Header(
        version=version,
        attributes=attributes,
        end=end,
        parts=parts,
        deep=deep,
        channels=channels,
        data_window=windows[0],
        tile=struct.unpack("<IIB", tile) if tile else None,
        chunks=chunks,
        compression=compression,
        length=length,
    )


def _for_the_binding(header: Header) -> list[Attribute]:
    kept = []
    for attribute in header.attributes:
        found = attribute.encoded()
        if found is not None and attribute.name == b"tiles" and header.tile:
            (across, down, mode), (width, height) = header.tile, header.size
            data = struct.pack("<IIB", min(across, width), min(down, height), mode)
            found = dataclasses.replace(found, data=data)  # the same tiles, as each ends there
        if found is not None:
            kept.append(found)
    return kept


@contextlib.contextmanager
def readable(name: str, header: Header) -> Iterator[str]:
    """A path that the binding reads: the file, or a temporary copy with a header it takes."""
    across, down, _ = header.tile or (1, 1, 0)
    taken = all(a.taken for a in header.attributes) and _is_utf8(os.fsencode(name))
    if taken and across * down * header.pixel_bytes <= BIG_TILE:
        yield name
        return
    kept = _for_the_binding(header)
    version = header.version
    if any(len(a.name) > 31 or len(a.kind) > 31 for a in kept):
        version |= LONG_NAMES
    head = MAGIC + struct.pack("<I", version)
    for a in kept:
        head += a.name + b"\0" + a.kind + b"\0" + struct.pack("<i", len(a.data)) + a.data
    head += b"\0\0" if version & PARTS else b"\0"
    with open(name, "rb") as source, tempfile.NamedTemporaryFile(suffix=".exr") as copy:
        source.seek(header.end)
        table = source.read(8 * header.chunks)
        shift = len(head) - header.end
        offsets = (v + shift if v else 0 for (v,) in struct.iter_unpack("<Q", table))
        copy.write(head + b"".join(struct.pack("<Q", v % 2**64) for v in offsets))
        shutil.copyfileobj(source, copy)
        copy.flush()
        yield copy.name
