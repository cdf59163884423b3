"""Images in and out: OpenEXR, Radiance HDR, PNG and what else OpenImageIO reads.

An integer sample q of n bits is the fraction v = q / (2^n - 1), and where the file is sRGB ::

    linear = v / 12.92                       v <= 0.04045                                    (1)
             ((v + 0.055) / 1.055)^2.4       otherwise

Whether integers are linear or sRGB is never guessed: the caller names it. What a file claims is
held against the limits before it is decoded.

OpenEXR stores the pixels of a data window, which need not be the picture, the display window. The
rule of ``framed``: pixels beyond the display window are cut; where it has none, the picture is
refused, or black if the caller says so.

The writers are in `image_write`; they are public names of this module too.
"""

import dataclasses
import math
import os
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check, _exr_header, _formats, _memory, _radiance
from ._arguments import checked
from ._files import first_bytes
from ._quiet import c_messages
from .image_write import write_exr, write_image

__all__ = [
    "Image",
    "Planes",
    "colour_channels",
    "read_image",
    "read_planes",
    "write_exr",
    "write_image",
]

Float32Array = npt.NDArray[np.float32]
Plane = npt.NDArray[Any]
Path = str | os.PathLike[str]

MAX_PIXELS = 2**28
CHANNELS_PER_PIXEL = 16  # of the largest image admitted; smaller ones may have more
ENCODINGS = ("linear", "srgb")
WINDOWS = ("data", "display", "black")
REC_709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # red, green, blue, white: x, y
RADIANCE = (0.640, 0.330, 0.290, 0.600, 0.150, 0.060, 0.3333, 0.3333)  # what its files start from


class ImageError(ValueError):
    """A file that cannot be used as an image; one line that starts with its name."""

    def __init__(self, text: str) -> None:
        super().__init__(" ".join(text.splitlines()))  # it may quote a channel's name


@dataclasses.dataclass(frozen=True, eq=False)
class Planes:
    """The channels of an image file, each (H, W), in the sample type of the file.

    Half stays half: a comparison reads twice as little memory. ``metadata`` holds the file's own
    entries, and ``sample_type`` as stored ("half", "float", "uint8", ...).
    """

    name: str
    planes: Mapping[str, Plane]
    metadata: Mapping[str, Any]

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        height, width = next(iter(self.planes.values())).shape
        return int(height), int(width)

    def select(self, names: Sequence[str]) -> list[Plane]:
        """The named channels; ``ValueError`` lists what there is if one is missing."""
        missing = [n for n in names if n not in self.planes]
        if missing:
            raise ImageError(
                f"{self.name}: has no channel {', '.join(missing)}; it has {', '.join(self.planes)}"
            )
        return [self.planes[n] for n in names]


@dataclasses.dataclass(frozen=True, eq=False)
class Image:
    """An image of linear float32 values.

    Parameters
    ----------
    pixels : (H, W, C) float32
        Row 0 on top.
    channels : C names
        Such as R, G, B or Y.
    metadata : mapping
        The file's own entries.
    """

    pixels: Float32Array
    channels: tuple[str, ...]
    metadata: Mapping[str, Any]

    def rgb(self, name: str | os.PathLike[str] = "image") -> Float32Array:
        """Pixels (H, W, 3): channels R, G, B, or a lone Y three times.

        Else a ``ValueError`` that starts with ``name``.
        """
        names = colour_channels(self.channels)
        if names is None:
            raise ImageError(
                f"{os.fspath(name)}: has no R, G, B and no Y alone, only {', '.join(self.channels)}"
            )
        picked = self.pixels[..., [self.channels.index(n) for n in names]]
        return np.ascontiguousarray(np.broadcast_to(picked, (*picked.shape[:2], 3)))


def colour_channels(names: Sequence[str]) -> tuple[str, ...] | None:
    """The channels that are the picture: R, G, B, else Y alone or with A (grey), else None."""
    if {"R", "G", "B"} <= set(names):
        return ("R", "G", "B")
    return ("Y",) if "Y" in names and set(names) <= {"Y", "A"} else None


@checked
def read_image(
    path: Path,
    encoding: str | None = None,
    max_pixels: int = MAX_PIXELS,
    window: str = "data",
) -> Image:
    """Read an image as linear float32, all its channels.

    A header that says the values are not linear Rec. 709 (OpenEXR's chromaticities, Radiance's
    PRIMARIES and GAMMA) is warned of and not applied; EXPOSURE and COLORCORR are.

    Parameters
    ----------
    path : path
        OpenEXR (one flat part, any compression), Radiance HDR, PNG, TIFF, ...
    encoding : "linear" or "srgb", optional
        What 8 and 16-bit integers mean, eq. (1); alpha is always linear. Without it such a file
        is refused. Floating-point files are linear and do not look at it.
    max_pixels : int
        Largest width times height admitted.
    window : "data", "display" or "black"
        Pixels as stored, or those of OpenEXR's display window: a file that stores only part of it
        is refused, or black where it stores none.

    Raises
    ------
    OSError
        No such file, a directory, a device, no permission.
    ValueError
        Not an image, truncated, deep, in several parts, too large, integers of unnamed encoding, or
        a data window that does not cover the display window.
    """
    source = read_planes(path, encoding, max_pixels, window)
    said = " and ".join(unapplied(source.metadata))
    if said:
        rest = "not applied, values are taken as linear Rec. 709"
        warnings.warn(f"{source.name}: {said}: {rest}", stacklevel=3)  # 2 is ``checked``
    try:
        pixels = np.empty((*source.shape, len(source.planes)), dtype=np.float32)
    except MemoryError as error:
        raise ImageError(f"{source.name}: cannot be read: {error}") from None
    with np.errstate(over="ignore"):
        for i, plane in enumerate(source.planes.values()):
            pixels[..., i] = plane
    return Image(pixels, tuple(source.planes), source.metadata)


def unapplied(metadata: Mapping[str, Any]) -> list[str]:
    """Entries of a header that change what its values mean and are not applied, as text."""
    found = []
    for key, meant in (("chromaticities", (REC_709,)), ("PRIMARIES", (REC_709, RADIANCE))):
        try:
            value = metadata.get(key, ())
            words = value.split() if isinstance(value, str) else value
            numbers = [float(v) for v in words]
        except (TypeError, ValueError):
            numbers = [math.nan]
        known = any(
            np.allclose(numbers, m, rtol=0.0, atol=2e-3) for m in meant if len(numbers) == 8
        )
        if any(numbers) and not known:  # Photoshop writes zeros
            found.append(f"{key} {' '.join(f'{v:g}' for v in numbers[:8])}")
    gamma = str(metadata.get("GAMMA", "1"))
    try:
        is_one = float(gamma) == 1.0
    except ValueError:
        is_one = False
    return [*found, f"GAMMA {_check.shortened(gamma, 40)}"] if not is_one else found


def read_planes(
    path: Path,
    encoding: str | None = None,
    max_pixels: int = MAX_PIXELS,
    window: str = "data",
) -> Planes:
    """Read an image as separate channels in the file's sample type; see `read_image`.

    Nothing is warned of: ``unapplied(planes.metadata)`` names what a header says and is not done.
    """
    name = os.fspath(path)
    limit = _check.count("max_pixels", max_pixels)
    _check.choice("window", window, WINDOWS)
    if encoding is not None:
        _check.choice("encoding", encoding, ENCODINGS)
    first = _first_bytes(name)
    is_exr = first.startswith(_exr_header.MAGIC)
    if name.lower().endswith(".exr") and not is_exr:
        raise ImageError(f"{name}: is not an OpenEXR file")
    with c_messages() as said:
        try:
            if is_exr:
                return framed(_read_exr(name, limit), window, limit)
            if _radiance.is_radiance(first):
                return _read_radiance(name, limit)
            planes, metadata = _formats.read_planes(
                name, encoding, lambda w, h, c, size: _check_size(name, w, h, c, size, limit)
            )
            return Planes(name, planes, metadata)
        except ImageError:
            raise
        except _formats.FormatError as error:
            raise ImageError(f"{name}: {error}") from None
        except Exception as error:  # of a damaged file the libraries raise what they like
            text = str(error)
            if "Unable to open" in text:  # which is no news: it exists and was opened above
                text = "damaged or truncated header"
            reason = _check.shortened(said(name) or text or type(error).__name__)
            raise ImageError(f"{name}: cannot be read: {reason}") from None


def framed(source: Planes, window: str, limit: int = MAX_PIXELS) -> Planes:
    """The pixels of the display window, by the rule of the module's head.

    Parameters
    ----------
    source : Planes
        As stored; without windows in its metadata it is returned as it is.
    window : "data", "display" or "black"
        See `read_image`.
    limit : int
        Largest width times height admitted.

    Raises
    ------
    ValueError
        Naming both windows, if the data window does not cover the display window ("display") or
        they do not meet ("black").
    """
    name, metadata = source.name, source.metadata
    if window == "data" or not {"dataWindow", "displayWindow"} <= set(metadata):
        return source
    data, display = (
        np.asarray(metadata[key], dtype=np.int64) for key in ("dataWindow", "displayWindow")
    )
    if np.array_equal(data, display):
        return source
    low, high = np.maximum(data[0], display[0]), np.minimum(data[1], display[1])
    texts = [f"window ({x0}, {y0}) to ({x1}, {y1})" for (x0, y0), (x1, y1) in (data, display)]
    both = f"its data {texts[0]}, its display {texts[1]}"
    if (low > high).any():
        raise ImageError(f"{name}: stores no pixel of the picture: {both}")
    if window == "display" and ((display[0] < low).any() or (display[1] > high).any()):
        way = "window='black', for environments crop='black' or --crop black, makes the rest black"
        raise ImageError(f"{name}: stores only part of the picture: {both}; {way}")
    width, height = (int(n) for n in display[1] - display[0] + 1)
    size = sum(plane.itemsize for plane in source.planes.values()) / len(source.planes)
    _check_size(name, width, height, len(source.planes), size, limit)
    planes = {}
    into = tuple(slice(low[k] - display[0][k], high[k] - display[0][k] + 1) for k in (1, 0))
    out_of = tuple(slice(low[k] - data[0][k], high[k] - data[0][k] + 1) for k in (1, 0))
    for channel, plane in source.planes.items():
        planes[channel] = np.zeros((height, width), dtype=plane.dtype)
        planes[channel][into] = plane[out_of]
    return Planes(name, planes, {**metadata, "dataWindow": metadata["displayWindow"]})


def _first_bytes(name: str) -> bytes:
    first = first_bytes(name, 4096)
    if not first:
        raise ImageError(f"{name}: is empty")
    return first


def _check_size(
    name: str, width: int, height: int, channels: int, sample: float, limit: int
) -> None:
    # ``sample``: bytes of a channel of a pixel as stored; a float32 copy is made of each
    if width < 1 or height < 1 or channels < 1:
        raise ImageError(
            f"{name}: cannot be read: has no pixels ({width} x {height}, {channels} channels)"
        )
    if width * height > limit or width * height * channels > CHANNELS_PER_PIXEL * limit:
        raise ImageError(
            f"{name}: {width} x {height} with {channels} channels is more than the limit of "
            f"{limit} pixels (max_pixels); --max-pixels raises it"
        )
    try:
        _memory.check(name, int(width * height * channels * (sample + 4)))
    except ValueError as error:
        raise ImageError(str(error)) from None


def _read_exr(name: str, limit: int) -> Planes:
    import OpenEXR

    with open(name, "rb") as stream:
        header = _exr_header.read_header(stream)
    if header.parts != 1:
        raise ImageError(f"{name}: has {header.parts} parts; one image per file is read")
    if header.deep:
        raise ImageError(f"{name}: is a deep image; only flat ones are read")
    count = len(header.channels)
    width, height = header.size
    _check_size(name, width, height, count, header.pixel_bytes / max(count, 1), limit)
    header.check_capacity()
    for channel, _, across, down in header.channels:
        if across != 1 or down != 1:
            raise ImageError(f"{name}: channel {channel} is subsampled, which is not read")
    with _exr_header.readable(name, header) as path:
        file = OpenEXR.File(path, separate_channels=True)
    if not file.parts:  # the library's way to say that the pixels could not be read
        raise RuntimeError("damaged or truncated pixel data")
    entries = {k: v for k, v in file.header().items() if k != "channels"}
    found = {n: c.pixels for n, c in file.channels().items()}
    order = [n for n in "RGBA" if n in found]
    planes = {n: found[n] for n in [*order, *(n for n in found if n not in order)]}
    kinds = {"float16": "half", "float32": "float", "uint32": "uint32"}
    stored = [kinds.get(p.dtype.name, p.dtype.name) for p in planes.values()]
    return Planes(name, planes, {**entries, "sample_type": stored[0]})


def _read_radiance(name: str, limit: int) -> Planes:
    with open(name, "rb") as stream:
        data = stream.read(_radiance.MOST_HEADER)
        header = _radiance.read_header(data)
        width, height = header.size
        _check_size(name, width, height, 3, 8, limit)
        data += stream.read(max(_radiance.most_bytes(header) - len(data), 0))
    pixels = _radiance.read_pixels(data, header)
    planes = {c: pixels[..., i] for i, c in enumerate("RGB")}
    return Planes(name, planes, {**header.entries, "sample_type": "float"})
