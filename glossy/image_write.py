"""Writing images: OpenEXR, Radiance HDR and PNG, each file whole or not at all.

Files are written beside their place and renamed. A Radiance pixel shares the exponent E of its
largest channel; the mantissas m = value 2^(136 - E) are rounded to nearest, so that the file is
not darker than the image. PNG samples are sRGB: the inverse of `image`'s eq. (2).
"""

import contextlib
import os
import secrets
import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check
from ._quiet import c_messages

Plane = npt.NDArray[Any]
Path = str | os.PathLike[str]

_NAMES = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}
_RESERVED = (
    "channels", "compression", "dataWindow", "displayWindow", "lineOrder", "pixelAspectRatio",
    "screenWindowCenter", "screenWindowWidth", "tiles", "type", "name", "version", "chunkCount",
)  # fmt: skip


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[str]:
    """Name of a temporary file beside ``path`` that takes its place on success only.

    The name keeps the suffix. On an exception it is removed and what was at ``path`` stays.
    """
    place = os.path.realpath(os.fspath(path))
    folder, base = os.path.split(place)
    if os.path.isdir(place):
        raise IsADirectoryError(f"{os.fspath(path)}: is a directory")
    if not os.path.isdir(folder):
        raise FileNotFoundError(f"{os.fspath(path)}: its folder does not exist")
    stem, suffix = os.path.splitext(base)
    temporary = os.path.join(folder, f".{stem[:100]}-{secrets.token_hex(6)}{suffix}")
    try:
        yield temporary
        os.replace(temporary, place)
    except OSError as error:
        if error.errno is None:
            raise
        raise type(error)(f"{os.fspath(path)}: {(error.strerror or 'failed').lower()}") from None
    finally:
        with contextlib.suppress(OSError):
            os.unlink(temporary)


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
    with replacing(path) as temporary, c_messages() as said:
        try:
            OpenEXR.File(header, planes).write(temporary)
        except (RuntimeError, TypeError) as error:
            text = said(temporary) or str(error).replace(temporary, os.path.basename(path))
            reason = " ".join(text.split())
            raise OSError(f"{os.fspath(path)}: cannot be written: {reason}") from None


def _exr_planes(channels: Mapping[str, npt.ArrayLike], dtype: type) -> dict[str, Plane]:
    if not channels:
        raise _check.fail("channels", "must not be empty", channels)
    planes: dict[str, Plane] = {}
    for key, value in channels.items():
        if not isinstance(key, str) or not 0 < len(key) < 256 or "\0" in key:
            raise _check.fail("channels", "must be named by 1 to 255 characters", key)
        label = f"channels[{key!r}]"
        raw = _real(label, value)
        if raw.ndim != 2 or raw.size == 0:
            raise _check.fail(label, "must have shape (H, W) with pixels", raw.shape)
        if planes and raw.shape != next(iter(planes.values())).shape:
            raise _check.fail(label, "must have the shape of the other channels", raw.shape)
        planes[key] = _narrow(label, raw, dtype)
    return planes


def _real(name: str, value: npt.ArrayLike) -> Plane:
    raw = np.asarray(value)
    if raw.dtype.kind not in "fiub":
        raise _check.fail(name, "must be an array of real numbers", raw.dtype)
    return raw


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


def write_image(
    path: Path,
    pixels: npt.ArrayLike,
    *,
    exposure: float = 0.0,
    bits: int = 8,
    half: bool = False,
    metadata: Mapping[str, str | int | float] | None = None,
) -> None:
    """Write linear pixels in the format of the suffix: .exr, .hdr or .png.

    Parameters
    ----------
    path : path
        Replaced when all is written.
    pixels : (H, W), (H, W, 1), (H, W, 3) or, for .exr, (H, W, 4) array
        Linear values.
    exposure : float [stops]
        PNG: values are multiplied by 2^exposure, clipped to [0, 1] and encoded as sRGB.
    bits : 8 or 16
        PNG sample size.
    half, metadata
        OpenEXR: see `write_exr`.

    Raises
    ------
    ValueError
        Another suffix or shape, an option of another format, values the format cannot hold.
    OSError
        The file cannot be written.
    """
    suffix = os.path.splitext(os.fspath(path))[1].lower()
    _check.choice("path suffix", suffix, (".exr", ".hdr", ".png"))
    raw = _real("pixels", pixels)
    raw = raw[..., None] if raw.ndim == 2 else raw
    sizes = (1, 3, 4) if suffix == ".exr" else (1, 3)
    if raw.ndim != 3 or raw.size == 0 or raw.shape[2] not in sizes:
        raise _check.fail("pixels", f"must be (H, W) or (H, W, C) with C in {sizes}", raw.shape)
    stops = _check.in_range("exposure", exposure, -1000.0, 1000.0)
    if suffix != ".png" and (stops != 0.0 or bits != 8):
        raise _check.fail("exposure, bits", "are options of .png", suffix)
    if suffix != ".exr" and (half or metadata):
        raise _check.fail("half, metadata", "are options of .exr", suffix)
    if suffix == ".exr":
        names = _NAMES[raw.shape[2]]
        write_exr(path, {n: raw[..., i] for i, n in enumerate(names)}, half, metadata)
        return
    bad = raw.size - int(np.count_nonzero(np.isfinite(raw)))
    if bad:
        raise _check.fail("pixels", f"must be finite for {suffix}", f"{bad} NaN or inf values")
    if suffix == ".hdr":
        _write_hdr(path, raw)
    else:
        write_png(path, encode_srgb(raw, stops, bits))


def encode_srgb(pixels: Plane, exposure: float = 0.0, bits: int = 8) -> Plane:
    """Linear values times 2^exposure as sRGB integers, the inverse of eq. (2), clipped."""
    if bits not in (8, 16):
        raise _check.fail("bits", "must be 8 or 16", bits)
    v = np.clip(np.asarray(pixels, dtype=np.float64) * 2.0**exposure, 0.0, 1.0)
    v = np.where(v <= 0.04045 / 12.92, v * 12.92, 1.055 * v ** (1.0 / 2.4) - 0.055)
    samples: Plane = np.rint(v * (2**bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)
    return samples


def write_png(path: Path, samples: Plane) -> None:
    """Write sRGB integers (H, W, 1 or 3), uint8 or uint16, as PNG without further conversion."""
    height, width, channels = samples.shape
    header = struct.pack(
        ">IIBBBBB", width, height, 8 * samples.itemsize, 0 if channels == 1 else 2, 0, 0, 0
    )
    rows = zlib.compress(_png_rows(samples).tobytes(), 6)
    with replacing(path) as temporary, open(temporary, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for kind, data in ((b"IHDR", header), (b"sRGB", b"\0"), (b"IDAT", rows), (b"IEND", b"")):
            file.write(struct.pack(">I", len(data)) + kind + data)
            file.write(struct.pack(">I", zlib.crc32(data, zlib.crc32(kind))))


def _png_rows(samples: Plane) -> npt.NDArray[np.uint8]:
    # bytes of each row behind the number of its filter: as they are, less the pixel at the left,
    # or less the one above, whichever has the smallest sum
    big = samples.astype(samples.dtype.newbyteorder(">"))
    raw = np.ascontiguousarray(big).view(np.uint8).reshape(len(samples), -1)
    step = samples.shape[2] * samples.itemsize
    best = np.concatenate([np.zeros((len(raw), 1), np.uint8), raw], axis=1)
    cost = np.minimum(raw, -raw).sum(axis=1)  # modulo 256: the distance from 0
    for number, (down, right) in enumerate(((0, step), (1, 0)), start=1):
        less = raw.copy()
        less[down:, right:] -= raw[: len(raw) - down, : raw.shape[1] - right]
        total = np.minimum(less, -less).sum(axis=1)
        better = total < cost
        best[better, 0] = number
        best[better, 1:] = less[better]
        cost = np.minimum(cost, total)
    return best


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
    with replacing(path) as temporary, open(temporary, "wb") as file:
        file.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n")
        file.write(f"-Y {height} +X {width}\n".encode())
        file.write(out.tobytes())
