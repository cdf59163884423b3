"""OpenEXR and Radiance files written byte by byte, so that a test says exactly what they hold."""

import struct
from collections.abc import Callable, Iterable, Mapping

import numpy as np
import numpy.typing as npt

Window = tuple[int, int, int, int]


def attribute(name: bytes, kind: bytes, data: bytes) -> bytes:
    """One entry of an OpenEXR header."""
    return name + b"\0" + kind + b"\0" + struct.pack("<i", len(data)) + data


def exr_bytes(
    channels: Mapping[bytes, npt.NDArray[np.float32]],
    data: Window | None = None,
    display: Window | None = None,
    extra: bytes = b"",
) -> bytes:
    """A flat OpenEXR file without compression, one scanline a chunk, of (H, W) float32 channels."""
    planes = [(name, channels[name]) for name in sorted(channels)]
    height, width = planes[0][1].shape
    data = data or (0, 0, width - 1, height - 1)
    listed = b"".join(n + b"\0" + struct.pack("<i4xii", 2, 1, 1) for n, _ in planes) + b"\0"
    head = b"\x76\x2f\x31\x01" + struct.pack("<i", 2)
    head += attribute(b"channels", b"chlist", listed)
    head += attribute(b"compression", b"compression", b"\0")
    head += attribute(b"dataWindow", b"box2i", struct.pack("<4i", *data))
    head += attribute(b"displayWindow", b"box2i", struct.pack("<4i", *(display or data)))
    head += attribute(b"lineOrder", b"lineOrder", b"\0")
    head += attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1.0))
    head += attribute(b"screenWindowCenter", b"v2f", bytes(8))
    head += attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1.0))
    head += extra + b"\0"
    chunk = 8 + 4 * width * len(planes)
    first = len(head) + 8 * height
    table = struct.pack(f"<{height}Q", *(first + chunk * y for y in range(height)))
    rows = b"".join(
        struct.pack("<ii", data[1] + y, chunk - 8)
        + b"".join(np.asarray(plane[y], "<f4").tobytes() for _, plane in planes)
        for y in range(height)
    )
    return head + table + rows


def rgb_exr(pixels: npt.NDArray[np.float32], **more: object) -> bytes:
    """The same of pixels (H, W, 3)."""
    planes = {name: pixels[..., k] for k, name in enumerate((b"R", b"G", b"B"))}
    return exr_bytes(planes, **more)  # type: ignore[arg-type]


def with_attribute(file: bytes, chunks: int, entry: bytes) -> bytes:
    """An OpenEXR file of one part with one more attribute; its table of chunks is moved along."""
    at = 8
    while file[at]:
        at = file.index(b"\0", file.index(b"\0", at) + 1) + 1
        at += 4 + struct.unpack_from("<i", file, at)[0]
    table = struct.unpack_from(f"<{chunks}Q", file, at + 1)
    moved = struct.pack(f"<{chunks}Q", *(v + len(entry) for v in table))
    return file[:at] + entry + b"\0" + moved + file[at + 1 + 8 * chunks :]


def radiance_bytes(
    quads: npt.NDArray[np.uint8],
    lines: Iterable[str] = ("FORMAT=32-bit_rle_rgbe",),
    coding: str = "flat",
    size: str = "-Y {} +X {}",
    magic: str = "#?RADIANCE\n",
    end: str = "\n",
) -> bytes:
    """A Radiance file of scanlines (lines, length, 4): flat, old, new, or each in turn (mixed)."""
    kinds = ("new", "old", "flat") if coding == "mixed" else (coding,)
    head = magic + "".join(line + end for line in lines) + end
    head += size.format(*quads.shape[:2]) + end
    write: dict[str, Callable[[npt.NDArray[np.uint8]], bytes]] = {
        "flat": lambda row: row.tobytes(),
        "old": _old_line,
        "new": _new_line,
    }
    rows = (write[kinds[i % len(kinds)]](row) for i, row in enumerate(quads))
    return head.encode("latin-1") + b"".join(rows)


def _lengths(values: npt.NDArray[np.uint8]) -> list[tuple[int, bytes]]:
    # runs of equal entries along the first axis
    found: list[tuple[int, bytes]] = []
    for value in values:
        data = value.tobytes()
        if found and found[-1][1] == data:
            found[-1] = (found[-1][0] + 1, data)
        else:
            found.append((1, data))
    return found


def _old_line(row: npt.NDArray[np.uint8]) -> bytes:
    out = b""
    for count, quad in _lengths(row):
        out += quad
        count -= 1
        while count:
            out += bytes([1, 1, 1, count & 255])
            count >>= 8
    return out


def _new_line(row: npt.NDArray[np.uint8]) -> bytes:
    out = bytes([2, 2, len(row) >> 8, len(row) & 255])
    for component in range(4):
        for count, value in _lengths(row[:, component]):
            while count > 2:
                out += bytes([128 + min(count, 127)]) + value
                count -= min(count, 127)
            out += bytes([count]) + value * count if count else b""
    return out


def rgbe_values(quads: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    """m 2^(E - 136), and black where E is 0."""
    e = quads[..., 3:].astype(int)
    return np.where(e > 0, np.ldexp(quads[..., :3].astype(float), e - 136), 0.0)
