"""Radiance pictures: header, both run-length codings, and what the header does to the values.

A pixel of mantissas m and exponent E holds, as most programs read it, ::

    value = m 2^(E - 136)        (E = 0: black)                                              (1)

and the radiance is that divided by the product of all EXPOSURE lines and, for each channel, of all
COLORCORR lines. An entry is a name in capitals from the first column on: programs that put pictures
together indent the headers of their inputs, which no longer apply.

A scanline that starts with the bytes 2, 2 and its width holds each of the four components in turn,
with its own run lengths. Any other holds pixels as they are, and one of mantissas 1, 1, 1 repeats
the pixel before it, as often as its exponent says; several in a row are the digits of that count,
the lowest first, base 256.

Source: G. Ward, "Real Pixels", Graphics Gems II; the manual of the Radiance file formats.
"""

import dataclasses
import math
import re
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

Float32Array = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]

MOST_HEADER = 1 << 20  # bytes
FORMAT = "32-bit_rle_rgbe"
RUNS = range(8, 32768)  # widths that the newer coding has
HEADER = re.compile(rb"(?:(?:#|\w+[ \t]*=)[^\n]*\n)*FORMAT[ \t]*=[ \t]*32-bit_rle_")
RESOLUTION = re.compile(rb"([+-])([XY])[ \t]+(\d{1,9})[ \t]+([+-])([XY])[ \t]+(\d{1,9})[ \t\r]*\Z")
UNITS = np.ldexp(np.float32(1.0), np.arange(256) - 136)
UNITS[0] = 0.0
TEXTS = ("PRIMARIES", "GAMMA", "PIXASPECT", "VIEW", "SOFTWARE")


class RadianceError(ValueError):
    """Why a picture is not read, without the file's name."""


@dataclasses.dataclass(frozen=True)
class Header:
    """Lines of a picture as stored, and what their header says.

    ``scale`` (3,): what pixels are divided by. ``order``: sign and axis of the scanlines, then of
    the pixels along them. ``entries``: the header's other lines by name, the last of each.
    """

    start: int
    lines: int
    length: int
    order: tuple[str, str]
    scale: tuple[float, float, float]
    entries: Mapping[str, str]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture upright."""
        if self.order[0][1] == "Y":
            return self.length, self.lines
        return self.lines, self.length


def is_radiance(first: bytes) -> bool:
    """True for bytes that start as a picture, with its magic number or only a header like one."""
    return first.startswith(b"#?") or HEADER.match(first) is not None


def _numbers(key: str, text: str, count: int) -> list[float]:
    try:
        found = [float(word) for word in text.split()]
    except ValueError:
        found = []
    if len(found) != count or not all(math.isfinite(v) and v > 0.0 for v in found):
        many = "a positive number" if count == 1 else f"{count} positive numbers"
        raise RadianceError(f"{key} must be {many}, got {text[:40]!r}")
    return found


def read_header(data: bytes) -> Header:
    """Header of a picture from its first bytes.

    Raises
    ------
    RadianceError
        For CIE XYZ pixels, another format, no resolution line, or an exposure that is no number.
    """
    at, scale = 0, [1.0, 1.0, 1.0]
    entries: dict[str, str] = {}
    while True:
        end = data.find(b"\n", at, MOST_HEADER)
        if end < 0:
            raise RadianceError("damaged or truncated header")
        line, at = data[at:end].rstrip(b"\r"), end + 1
        if not line:
            break
        key, _, text = line.decode("latin-1").partition("=")
        key, text = key.rstrip(), text.strip()
        if key == "FORMAT" and text != FORMAT:
            what = "CIE XYZ (32-bit_rle_xyze)" if text == "32-bit_rle_xyze" else repr(text[:40])
            raise RadianceError(f"pixels are {what}, only {FORMAT} is read")
        if key in ("EXPOSURE", "COLORCORR"):
            factor = _numbers(key, text, 1 if key == "EXPOSURE" else 3)
            scale = [s * f for s, f in zip(scale, factor * (3 // len(factor)), strict=True)]
        elif key in TEXTS:
            entries[key] = text
    if not all(math.isfinite(s) and s > 0.0 for s in scale):
        raise RadianceError(f"the product of its EXPOSURE and COLORCORR lines is {max(scale):g}")
    end = data.find(b"\n", at, at + 200)
    found = RESOLUTION.match(data[at:end]) if end > 0 else None
    if not found or found[2] == found[5]:
        raise RadianceError("damaged or truncated header, without a line such as -Y 512 +X 1024")
    order = (found[1] + found[2]).decode(), (found[4] + found[5]).decode()
    lines, length = int(found[3]), int(found[6])
    return Header(end + 1, lines, length, order, (scale[0], scale[1], scale[2]), entries)


def most_bytes(header: Header) -> int:
    """Length of the longest file that the header can belong to."""
    return header.start + header.lines * (8 * header.length + 16)


def read_pixels(data: bytes, header: Header) -> Float32Array:
    """Radiance (H, W, 3) of a whole file, row 0 on top: eq. (1) over the header's scale.

    Raises
    ------
    RadianceError
        For data that end early, or runs that do not fit their scanline.
    """
    lines, length, at = header.lines, header.length, header.start
    if lines * min(8, 4 * length) > len(data) - at:  # before the pixels are allocated
        raise RadianceError("truncated pixel data")
    pixels = np.empty((lines, length, 3), dtype=np.float32)
    scale = np.array(header.scale)
    scaled = bool(np.any(scale != 1.0))
    for i in range(lines):
        quads, at = _scanline(data, at, length)
        row = quads[:, :3] * UNITS[quads[:, 3], None]
        with np.errstate(over="ignore"):
            pixels[i] = row / scale if scaled else row
    if header.order[0][1] == "X":
        pixels = pixels.swapaxes(0, 1)
    up = "+Y" in header.order
    left = "-X" in header.order
    return pixels[:: -1 if up else 1, :: -1 if left else 1]


def _scanline(data: bytes, at: int, length: int) -> tuple[Bytes, int]:
    # mantissas and exponents (length, 4), and where the next scanline starts
    if length in RUNS and data[at : at + 2] == b"\2\2" and data[at + 2 : at + 3] < b"\x80":
        if int.from_bytes(data[at + 2 : at + 4]) != length:
            raise RadianceError("damaged pixel data, a scanline of another width")
        row, at = _runs(data, at + 4, length)
        return np.frombuffer(row, np.uint8).reshape(4, length).T, at
    stored = min(2 * length + 4, (len(data) - at) // 4)
    quads = np.frombuffer(data, np.uint8, 4 * stored, at).reshape(-1, 4)
    repeat = (quads[:, :3] == 1).all(axis=1)
    if stored >= length and not repeat[:length].any():
        return quads[:length], at + 4 * length
    index = np.arange(stored)
    before = np.maximum.accumulate(np.where(repeat, -1, index))  # the pixel that is repeated
    digit = np.clip(index - before - 1, 0, 3)
    count = np.where(repeat, quads[:, 3].astype(np.int64) << (8 * digit), 1)
    total = np.cumsum(count)
    used = int(np.searchsorted(total, length)) + 1
    if used > stored:
        raise RadianceError("truncated pixel data")
    if repeat[0] or total[used - 1] != length:
        raise RadianceError("damaged pixel data, a run longer than its scanline")
    return np.repeat(quads[before[:used]], count[:used], axis=0), at + 4 * used


def _runs(data: bytes, at: int, length: int) -> tuple[bytearray, int]:
    # the four components of a scanline, one after the other
    row = bytearray()
    for component in range(1, 5):
        end = component * length
        while len(row) < end:
            n = data[at] if at < len(data) else 0
            if n > 128:
                row += data[at + 1 : at + 2] * (n - 128)
                at += 2
            elif n:
                row += data[at + 1 : at + 1 + n]
                at += 1 + n
            if not n or at > len(data):
                raise RadianceError("damaged or truncated pixel data")
        if len(row) != end:
            raise RadianceError("damaged pixel data, a run longer than its scanline")
    return row, at
