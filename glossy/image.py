"""Images in and out: OpenEXR, Radiance HDR, PNG and what else OpenImageIO reads.

A Radiance pixel of mantissas m and exponent E holds, as most programs read it, ::

    value = m 2^(E - 136)        (E = 0: black)                                              (1)

An integer sample q of n bits is the fraction v = q / (2^n - 1), and where the file is sRGB ::

    linear = v / 12.92                       v <= 0.04045                                    (2)
             ((v + 0.055) / 1.055)^2.4       otherwise

Whether integers are linear or sRGB is never guessed: the caller names it. The writers are in
`image_write`; they are public names of this module too.
"""

import dataclasses
import os
import stat
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check
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
EXR_MAGIC = b"\x76\x2f\x31\x01"


class ImageError(ValueError):
    """A file that cannot be used as an image; one line that starts with its name."""


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
            raise ValueError(
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

    def rgb(self) -> Float32Array:
        """Pixels (H, W, 3): channels R, G, B, or Y three times; else a ``ValueError``."""
        names = colour_channels(self.channels)
        if names is None:
            raise ValueError(f"image: has no R, G, B and no Y, only {', '.join(self.channels)}")
        picked = self.pixels[..., [self.channels.index(n) for n in names]]
        return np.ascontiguousarray(np.broadcast_to(picked, (*picked.shape[:2], 3)))


def colour_channels(names: Sequence[str]) -> tuple[str, ...] | None:
    """The channels that are the picture: R, G, B, else Y, else None."""
    for wanted in (("R", "G", "B"), ("Y",)):
        if all(n in names for n in wanted):
            return wanted
    return None


def read_image(path: Path, encoding: str | None = None, max_pixels: int = MAX_PIXELS) -> Image:
    """Read an image as linear float32, all its channels.

    Parameters
    ----------
    path : path
        OpenEXR (one flat part, any compression), Radiance HDR, PNG, TIFF, ...
    encoding : "linear" or "srgb", optional
        What 8 and 16-bit integers mean, eq. (2); alpha is always linear. Without it such a file
        is refused. Floating-point files are linear and do not look at it.
    max_pixels : int
        Largest width times height admitted.

    Raises
    ------
    OSError
        No such file, a directory, no permission.
    ValueError
        Not an image, truncated, deep, in several parts, too large, or integers of unnamed encoding.
    """
    source = read_planes(path, encoding, max_pixels)
    pixels = np.empty((*source.shape, len(source.planes)), dtype=np.float32)
    with np.errstate(over="ignore"):
        for i, plane in enumerate(source.planes.values()):
            pixels[..., i] = plane
    return Image(pixels, tuple(source.planes), source.metadata)


def read_planes(path: Path, encoding: str | None = None, max_pixels: int = MAX_PIXELS) -> Planes:
    """Read an image as separate channels in the file's sample type; see `read_image`."""
    name = os.fspath(path)
    limit = _check.count("max_pixels", max_pixels)
    if encoding is not None:
        _check.choice("encoding", encoding, ENCODINGS)
    is_exr = _first_bytes(name) == EXR_MAGIC
    if name.lower().endswith(".exr") and not is_exr:
        raise ImageError(f"{name}: is not an OpenEXR file")
    with c_messages() as said:
        try:
            return _read_exr(name, limit) if is_exr else _read_other(name, encoding, limit)
        except ImageError:
            raise
        except Exception as error:  # of a damaged file the libraries raise what they like
            text = str(error)
            if "Unable to open" in text:  # which is no news: it exists and was opened above
                text = "damaged or truncated header"
            reason = _check.shortened(said(name) or text or type(error).__name__)
            raise ImageError(f"{name}: cannot be read: {reason}") from None


def _first_bytes(name: str) -> bytes:
    try:
        mode = os.stat(name).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(f"{name}: is a directory, not an image")
        if not stat.S_ISREG(mode):
            raise OSError(f"{name}: is not a regular file")
        with open(name, "rb") as file:
            first = file.read(len(EXR_MAGIC))
    except OSError as error:
        if error.errno is None:
            raise
        raise type(error)(f"{name}: {(error.strerror or 'unreadable').lower()}") from None
    if not first:
        raise ImageError(f"{name}: is empty")
    return first


def _check_size(name: str, width: int, height: int, channels: int, limit: int) -> None:
    if width < 1 or height < 1 or channels < 1:
        raise ImageError(f"{name}: has no pixels ({width} x {height}, {channels} channels)")
    if width * height > limit or width * height * channels > CHANNELS_PER_PIXEL * limit:
        raise ImageError(
            f"{name}: {width} x {height} with {channels} channels is more than the limit of "
            f"{limit} pixels (max_pixels)"
        )


def _read_exr(name: str, limit: int) -> Planes:
    import OpenEXR

    _check_exr_header(name, OpenEXR.File(name, header_only=True), limit)
    file = OpenEXR.File(name, separate_channels=True)
    if not file.parts:  # the library's way to say that the pixels could not be read
        raise RuntimeError("damaged or truncated pixel data")
    header = {k: v for k, v in file.header().items() if k != "channels"}
    found = {n: c.pixels for n, c in file.channels().items()}
    order = [n for n in "RGBA" if n in found]
    planes = {n: found[n] for n in [*order, *(n for n in found if n not in order)]}
    kinds = {"float16": "half", "float32": "float", "uint32": "uint32"}
    stored = [kinds.get(p.dtype.name, p.dtype.name) for p in planes.values()]
    return Planes(name, planes, {**header, "sample_type": stored[0]})


def _check_exr_header(name: str, file: Any, limit: int) -> None:
    import OpenEXR

    if len(file.parts) != 1:
        raise ImageError(f"{name}: has {len(file.parts)} parts; one image per file is read")
    header = file.header()
    if header.get("type") in (OpenEXR.deepscanline, OpenEXR.deeptile):
        raise ImageError(f"{name}: is a deep image; only flat ones are read")
    low, high = (np.asarray(corner, dtype=np.int64) for corner in header["dataWindow"])
    width, height = (int(n) for n in high - low + 1)
    _check_size(name, width, height, len(header["channels"]), limit)
    for channel in header["channels"]:
        if channel.xSampling != 1 or channel.ySampling != 1:
            raise ImageError(f"{name}: channel {channel.name} is subsampled, which is not read")


def _read_other(name: str, encoding: str | None, limit: int) -> Planes:
    import OpenImageIO as oiio  # noqa: N813

    raw_alpha = oiio.ImageSpec()
    raw_alpha.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(name, raw_alpha)
    if source is None:
        raise RuntimeError(oiio.geterror() or "unknown format")
    try:
        spec = source.spec()
        kind = str(spec.format)
        _check_size(name, spec.width, spec.height * spec.depth, spec.nchannels, limit)
        if spec.deep or spec.depth > 1:
            raise ImageError(f"{name}: is a deep or volume image; only flat ones are read")
        several = source.seek_subimage(1, 0)
        source.geterror()  # forget that there is no second one
        if several:
            raise ImageError(f"{name}: holds several images; one image per file is read")
        source.seek_subimage(0, 0)
        if kind not in ("half", "float", "double", "uint8", "uint16"):
            raise ImageError(f"{name}: samples of type {kind} are not read")
        if kind.startswith("uint") and encoding is None:
            raise ImageError(
                f"{name}: holds integers ({kind}); say whether they are linear or srgb (encoding)"
            )
        pixels = source.read_image(0, 0, 0, spec.nchannels, kind)
        if pixels is None or source.has_error:
            raise RuntimeError(source.geterror() or "truncated")
        metadata = {entry.name: entry.value for entry in spec.extra_attribs}
        if source.format_name() == "hdr":
            pixels = _eight_bits(pixels)
    finally:
        source.close()
    pixels = _upright(
        pixels.reshape(spec.height, spec.width, -1), int(str(metadata.get("Orientation", 1)))
    )
    planes = {}
    for i, channel in enumerate(spec.channelnames):
        plane = pixels[..., i]
        if kind.startswith("uint"):
            plane = _decode_table(kind, "linear" if channel == "A" else str(encoding))[plane]
        planes[channel] = plane
    return Planes(name, planes, {**metadata, "sample_type": kind})


def _eight_bits(pixels: Float32Array) -> Float32Array:
    # eq. (1) exactly: the reader's powers of two are off by a last bit for three exponents, and a
    # mantissa has at most 8 significant bits (below the normal range the reader is exact)
    bits = pixels.view(np.uint32)
    rounded = (bits + np.uint32(0x8000)) & np.uint32(0xFFFF0000)
    return np.where(bits >= 0x00800000, rounded, bits).view(np.float32)


def _upright(pixels: Plane, orientation: int) -> Plane:
    # (H, W, C) as stored -> row 0 on top, column 0 at the left; EXIF's numbering 1..8
    if orientation >= 5:
        pixels = pixels.swapaxes(0, 1)
    rows = -1 if orientation in (3, 4, 7, 8) else 1
    columns = -1 if orientation in (2, 3, 6, 7) else 1
    return pixels[::rows, ::columns]


def _decode_table(kind: str, encoding: str) -> Float32Array:
    top = np.iinfo(kind).max
    v = np.arange(top + 1) / top
    if encoding == "srgb":
        v = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    return np.asarray(v, dtype=np.float32)
