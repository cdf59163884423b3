"""Animated pictures, GIF and PNG, through imageio: frames of linear radiance in and out."""

import os
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check, _memory
from ._arguments import checked
from ._files import check_regular
from ._formats import decode_table
from ._output import write_bytes
from .image import ENCODINGS, MAX_PIXELS, ImageError
from .image_write import encode_srgb, encoded

Path = str | os.PathLike[str]
Plane = npt.NDArray[Any]


@checked
def write_animation(
    path: Path,
    frames: Iterable[npt.ArrayLike],
    *,
    exposure: float = 0.0,
    seconds: float = 1.0 / 24.0,
) -> None:
    """Write linear frames as an animation that repeats: .gif (256 colours) or .png (all of them).

    Parameters
    ----------
    path : path
        Replaced when all is written.
    frames : (H, W, 3) arrays
        Linear values, of one size.
    exposure : float [stops]
        Values are multiplied by 2^exposure, clipped to [0, 1] and encoded as sRGB.
    seconds : float
        Each frame's; .gif rounds to hundredths.

    Raises
    ------
    ValueError
        Another suffix, no frame, frames of unlike or other shapes, NaN or infinity.
    OSError
        The file cannot be written.
    """
    suffix = _check.choice(
        "path suffix", os.path.splitext(os.fspath(path))[1].lower(), (".gif", ".png")
    )
    stops = _check.in_range("exposure", exposure, -1000.0, 1000.0)
    milliseconds = max(round(1000.0 * _check.positive("seconds", seconds)), 1)
    stack: list[Plane] = []
    for i, frame in enumerate(frames):
        raw = _check.real(f"frames[{i}]", frame)
        if raw.ndim != 3 or raw.shape[2] != 3 or raw.size == 0:
            raise _check.fail(f"frames[{i}]", "must have shape (H, W, 3)", raw.shape)
        if stack and raw.shape != stack[0].shape:
            raise _check.fail(f"frames[{i}]", "must have the shape of the first", raw.shape)
        if not np.isfinite(raw).all():
            raise _check.fail(f"frames[{i}]", "must be finite", "NaN or inf values")
        stack.append(encode_srgb(raw, stops))
    if not stack:
        raise _check.fail("frames", "must not be empty", "none")
    write_bytes(path, encoded(np.stack(stack), suffix, duration=milliseconds, loop=0))


@checked
def read_animation(
    path: Path, encoding: str = "srgb", max_pixels: int = MAX_PIXELS
) -> npt.NDArray[np.float32]:
    """Frames of an animated picture, or the one of a still, as linear float32.

    Parameters
    ----------
    path : path
        GIF, animated PNG, WebP; alpha is left out.
    encoding : "srgb" or "linear"
        What the samples mean.
    max_pixels : int
        Largest width times height admitted, of all frames together.

    Returns
    -------
    (F, H, W, 3) float32

    Raises
    ------
    OSError
        No such file, a directory, a device, no permission.
    ValueError
        Not a picture, truncated, too large, or deeper than 8 bits.
    """
    import imageio.v3 as iio

    name = os.fspath(path)
    _check.choice("encoding", encoding, ENCODINGS)
    limit = _check.count("max_pixels", max_pixels)
    check_regular(name)
    try:
        with iio.imopen(name, "r", plugin="pillow") as file:
            every: Any = ...
            shape = file.properties(index=every).shape
    except Exception as error:  # of a damaged file the library raises what it likes
        raise _unreadable(name, error) from None
    count = int(np.prod(shape[:3]))
    if count > limit:
        sizes = " x ".join(str(n) for n in shape[:3])
        raise ImageError(f"{name}: {sizes} is more than the limit of {limit} pixels (max_pixels)")
    _memory.check(name, 16 * count)
    try:
        frames = np.asarray(iio.imread(name, index=every, plugin="pillow", mode="RGB"))
    except Exception as error:
        raise _unreadable(name, error) from None
    if frames.dtype != np.uint8 or frames.ndim != 4:
        raise ImageError(f"{name}: holds {frames.dtype} samples; animations of 8 bits are read")
    table: npt.NDArray[np.float32] = decode_table("uint8", encoding)
    return np.asarray(table[frames])


def _unreadable(name: str, error: Exception) -> ImageError:
    reason = _check.shortened(str(error) or type(error).__name__)
    return ImageError(f"{name}: cannot be read: {reason}")
