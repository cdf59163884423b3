"""Writing images: OpenEXR, Radiance HDR, PNG and JPEG, each file whole or not at all.

A Radiance pixel shares the exponent E of its largest channel; the mantissas m = value 2^(136 - E)
are rounded to nearest, so that the file is not darker than the image. Display pictures hold sRGB
samples: the inverse of `image`'s eq. (2).
"""

import os
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check, _exr_header
from ._arguments import checked
from ._output import READ_BACK, replacing, write_bytes
from ._quiet import c_messages

Plane = npt.NDArray[Any]
Path = str | os.PathLike[str]

_NAMES = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}
_RESERVED = (
    "channels", "compression", "dataWindow", "displayWindow", "lineOrder", "pixelAspectRatio",
    "screenWindowCenter", "screenWindowWidth", "tiles", "type", "name", "version", "chunkCount",
)  # fmt: skip
_PNG_END = b"\0\0\0\0IEND\xaeB`\x82"


@checked
def write_exr(
    path: Path,
    channels: Mapping[str, npt.ArrayLike],
    half: bool = False,
    metadata: Mapping[str, str | int | float] | None = None,
) -> None:
    """Write named channels as a ZIP-compressed scanline OpenEXR file.

    Parameters
    ----------
    path : path
        Replaced when all is written.
    channels : name -> (H, W) array
        Stored as float32, or half; NaN and infinity are kept.
    half : bool
        16-bit samples; a finite value beyond 65504 is refused.
    metadata : name -> str, int or float, optional
        Further header entries.

    Raises
    ------
    ValueError
        No channel, differing shapes, a value out of range, a reserved or unsuited header entry.
    OSError
        The file cannot be written.
    """
    import OpenEXR

    planes = _exr_planes(channels, np.float16 if half else np.float32)
    header: dict[str, Any] = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
    }
    for key, value in (metadata or {}).items():
        if not isinstance(key, str) or not key or key in _RESERVED:
            raise _check.fail("metadata", "must not use a reserved name", key)
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise _check.fail(f"metadata[{key!r}]", "must be text or a number", value)
        if isinstance(value, int) and not -(2**31) <= value < 2**31:
            raise _check.fail(f"metadata[{key!r}]", "must fit 32 bits", value)
        header[key] = value
    with (
        replacing(path, lambda name: _verify_exr(name, planes)) as temporary,
        c_messages() as said,
    ):
        try:
            OpenEXR.File(header, dict(planes)).write(temporary)  # which changes the mapping
        except (RuntimeError, TypeError) as error:
            text = said(temporary) or str(error).replace(temporary, os.path.basename(path))
            reason = " ".join(text.split())
            raise OSError(f"{os.fspath(path)}: cannot be written: {reason}") from None


def _verify_exr(name: str, planes: Mapping[str, Plane]) -> None:
    # the library does not report every failed write: is each block of rows there, to the last
    # byte, and (unless the file is large) the same bits when read
    import OpenEXR

    try:
        with open(name, "rb") as file:
            header = _exr_header.read_header(file)
            file.seek(header.end)
            ends = []
            for (place,) in struct.iter_unpack("<Q", file.read(8 * header.chunks)):
                file.seek(place + 4)
                ends.append(place + 8 + int.from_bytes(file.read(4), "little"))
        whole = len(ends) == header.chunks and max(ends) == header.length
    except (_exr_header.HeaderError, struct.error):
        whole = False
    if not whole:
        raise OSError("what was written is not whole; is the disk full?")
    if header.length <= READ_BACK:
        try:
            read = OpenEXR.File(name, separate_channels=True).channels()
            same = all(read[k].pixels.tobytes() == v.tobytes() for k, v in planes.items())
        except (RuntimeError, KeyError):
            same = False
        if not same:
            raise OSError("what was written does not read back; is the disk full?")


def _exr_planes(channels: Mapping[str, npt.ArrayLike], dtype: type) -> dict[str, Plane]:
    if not channels:
        raise _check.fail("channels", "must not be empty", channels)
    planes: dict[str, Plane] = {}
    for key, value in channels.items():
        if not isinstance(key, str) or not 0 < len(key) < 256 or "\0" in key:
            raise _check.fail("channels", "must be named by 1 to 255 characters", key)
        label = f"channels[{key!r}]"
        raw = _check.real(label, value)
        if raw.ndim != 2 or raw.size == 0:
            raise _check.fail(label, "must have shape (H, W) with pixels", raw.shape)
        if planes and raw.shape != next(iter(planes.values())).shape:
            raise _check.fail(label, "must have the shape of the other channels", raw.shape)
        planes[key] = _narrow(label, raw, dtype)
    return planes


def _narrow(name: str, raw: Plane, dtype: type) -> Plane:
    with np.errstate(over="ignore"):
        out: Plane = np.ascontiguousarray(raw, dtype=dtype)
    lost = np.isinf(out)
    if lost.any() and raw.dtype != out.dtype:
        lost &= np.isfinite(raw)
        if lost.any():
            top = float(np.finfo(dtype).max)
            raise _check.fail(name, f"must be within +-{top:g}", float(raw[lost][0]))
    return out


@checked
def write_image(
    path: Path,
    pixels: npt.ArrayLike,
    *,
    exposure: float = 0.0,
    bits: int = 8,
    half: bool = False,
    metadata: Mapping[str, str | int | float] | None = None,
) -> None:
    """Write linear pixels in the format of the suffix: .exr, .hdr, .png or .jpg.

    Parameters
    ----------
    path : path
        Replaced when all is written.
    pixels : (H, W), (H, W, 1), (H, W, 3) or, for .exr, (H, W, 4) array
        Linear values.
    exposure : float [stops]
        PNG, JPEG: values are multiplied by 2^exposure, clipped to [0, 1] and encoded as sRGB.
    bits : 8 or 16
        PNG sample size.
    half
        OpenEXR: see `write_exr`.
    metadata : name -> str, int or float, optional
        OpenEXR: header entries, see `write_exr`. PNG: entries of text.

    Raises
    ------
    ValueError
        Another suffix or shape, an option of another format, values the format cannot hold.
    OSError
        The file cannot be written.
    """
    suffix = os.path.splitext(os.fspath(path))[1].lower()
    _check.choice("path suffix", suffix, (".exr", ".hdr", ".png", ".jpg", ".jpeg"))
    raw = _check.real("pixels", pixels)
    raw = raw[..., None] if raw.ndim == 2 else raw
    sizes = (1, 3, 4) if suffix == ".exr" else (1, 3)
    if raw.ndim != 3 or raw.size == 0 or raw.shape[2] not in sizes:
        raise _check.fail("pixels", f"must be (H, W) or (H, W, C) with C in {sizes}", raw.shape)
    stops = _check.in_range("exposure", exposure, -1000.0, 1000.0)
    if suffix in (".exr", ".hdr") and stops != 0.0:
        raise _check.fail("exposure", "is an option of .png and .jpg", suffix)
    if suffix != ".png" and _check.count("bits", bits) != 8:
        raise _check.fail("bits", "is an option of .png", suffix)
    if suffix != ".exr" and half:
        raise _check.fail("half", "is an option of .exr", suffix)
    if suffix not in (".exr", ".png") and metadata:
        raise _check.fail("metadata", "is an option of .exr and .png", suffix)
    if suffix == ".exr":
        names = _NAMES[raw.shape[2]]
        write_exr(path, {n: raw[..., i] for i, n in enumerate(names)}, half, metadata)
        return
    bad = raw.size - int(np.count_nonzero(np.isfinite(raw)))
    if bad:
        raise _check.fail("pixels", f"must be finite for {suffix}", f"{bad} NaN or inf values")
    if suffix == ".hdr":
        _write_hdr(path, raw)
    elif suffix == ".png":
        texts = {key: str(value) for key, value in (metadata or {}).items()}
        write_png(path, encode_srgb(raw, stops, bits), texts)
    else:
        samples = encode_srgb(raw, stops)
        flat = samples[..., 0] if samples.shape[2] == 1 else samples
        write_bytes(path, encoded(flat, ".jpg", quality=95, subsampling=0))


def encode_srgb(pixels: Plane, exposure: float = 0.0, bits: int = 8) -> Plane:
    """Linear values times 2^exposure as sRGB integers, the inverse of eq. (2), clipped."""
    if _check.count("bits", bits) not in (8, 16):
        raise _check.fail("bits", "must be 8 or 16", bits)
    v = np.clip(np.asarray(pixels, dtype=np.float64) * 2.0**exposure, 0.0, 1.0)
    v = np.where(v <= 0.04045 / 12.92, v * 12.92, 1.055 * v ** (1.0 / 2.4) - 0.055)
    samples: Plane = np.rint(v * (2**bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)
    return samples


def write_png(path: Path, samples: Plane, metadata: Mapping[str, str] | None = None) -> None:
    """Write sRGB integers (H, W, 1 or 3), uint8 or uint16, as PNG without further conversion.

    ``metadata`` becomes text entries of the file.
    """
    flat = samples[..., 0] if samples.shape[2] == 1 else samples
    if samples.dtype == np.uint16:  # what imageio's writer would cut to 8 bits
        _write_deep_png(path, samples, metadata or {})
        return
    from PIL.PngImagePlugin import PngInfo

    entries = PngInfo()
    entries.add(b"sRGB", b"\0")
    for key, text in (metadata or {}).items():
        entries.add_text(key, text)
    write_bytes(path, encoded(flat, ".png", pnginfo=entries))


def encoded(samples: Plane, suffix: str, **options: Any) -> bytes:
    """A display picture, or frames (F, H, W, 3) of one, as the bytes of a file."""
    import imageio.v3 as iio

    data = iio.imwrite("<bytes>", samples, extension=suffix, plugin="pillow", **options)
    assert isinstance(data, bytes)
    return data


def _write_deep_png(path: Path, samples: Plane, metadata: Mapping[str, str]) -> None:
    import OpenImageIO as oiio  # noqa: N813

    height, width, channels = samples.shape
    spec = oiio.ImageSpec(width, height, channels, "uint16")
    spec.attribute("oiio:ColorSpace", "sRGB")
    for key, text in metadata.items():
        spec.attribute(f"png:{key}", text)

    def verify(name: str) -> None:
        source = oiio.ImageInput.open(name)
        read = None if source is None else source.read_image("uint16")
        oiio.geterror()  # what is wrong is said below
        with open(name, "rb") as file:
            file.seek(-len(_PNG_END), os.SEEK_END)
            ended = file.read() == _PNG_END
        same = read is not None and np.array_equal(np.reshape(read, samples.shape), samples)
        if not (ended and same):
            raise OSError("what was written does not read back; is the disk full?")

    with replacing(path, verify) as temporary:
        out = oiio.ImageOutput.create(temporary)
        if out is None or not (out.open(temporary, spec) and out.write_image(samples)):
            reason = " ".join(str(oiio.geterror() if out is None else out.geterror()).split())
            raise OSError(f"cannot be written: {reason or 'unknown reason'}")
        out.close()


def _write_hdr(path: Path, pixels: Plane) -> None:
    low = int(np.count_nonzero(pixels < 0))
    if low:
        raise _check.fail("pixels", "must not be negative for .hdr", f"{low} negative values")
    v = np.broadcast_to(pixels, (*pixels.shape[:2], 3)).astype(np.float64)
    largest = v.max(axis=-1)
    exponent = np.frexp(largest)[1]  # largest in [2^(e-1), 2^e)
    exponent += np.rint(np.ldexp(largest, 8 - exponent)) > 255  # rounding may reach 256
    if exponent.max() > 127:
        raise _check.fail("pixels", "must be below 2^127 for .hdr", float(largest.max()))
    seen = (largest > 0.0) & (exponent > -128)
    out = np.zeros((*seen.shape, 4), dtype=np.uint8)
    mantissa = np.rint(np.ldexp(v, 8 - exponent[..., None]))
    out[..., :3] = np.where(seen[..., None], mantissa, 0.0)
    out[..., 3] = np.where(seen, exponent + 128, 0)
    height, width = seen.shape
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    write_bytes(path, head.encode() + out.tobytes())
