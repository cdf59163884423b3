"""Surface points from a file: another renderer's G-buffer.

``.npz`` holds arrays ``normal``, ``view`` (H, W, 3) and optionally ``tangent`` (H, W, 3) and
``mask`` (H, W). ``.exr`` holds the same as channels, each vector under any of these spellings
(upper or lower case) ::

    normal    normal.X normal.Y normal.Z    N.X N.Y N.Z    Normal.R ...
    view      view.X ...                    V.X ...        wo.X ...
    tangent   tangent.X ...                 T.X ...        (optional)
    mask      mask, or mask.Y               A              (optional, seen where > 0.5)

World coordinates, +y up; ``view`` leaves the surface. A pixel whose normal is zero saw nothing.
Vectors are unit within 1e-3, half floats included, and renormalised.
"""

import os
import pathlib
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ._arguments import checked
from ._files import check_regular
from ._output import write_npz
from .frames import SurfacePoints
from .image_write import write_exr

Arrays = dict[str, npt.NDArray[np.float64]]

VECTORS = {
    "normal": ("normal", "n", "normals"),
    "view": ("view", "v", "wo"),
    "tangent": ("tangent", "t", "tangents"),
}
AXES = (("x", "y", "z"), ("r", "g", "b"))
NPZ_FAULTS = (
    zipfile.BadZipFile,
    zlib.error,
    ValueError,
    KeyError,
    EOFError,
    AttributeError,
    RuntimeError,
    OSError,
    MemoryError,
)  # what NumPy and zipfile raise for damaged archives, and for sizes that only a header claims
MASKS = ("mask", "mask.y", "mask.a", "a")


def load_npz(path: pathlib.Path, names: Iterable[str]) -> dict[str, npt.NDArray[Any]]:
    """Those of the named arrays that an npz file has.

    Raises
    ------
    OSError
        If the file cannot be opened.
    ValueError
        If it is no npz file, or a damaged one.
    """
    with path.open("rb") as stream:
        try:
            with np.load(stream, allow_pickle=False) as data:
                return {name: np.asarray(data[name]) for name in names if name in data}
        except NPZ_FAULTS:
            raise ValueError(f"{path}: not an npz file of number arrays") from None


def _from_npz(path: pathlib.Path) -> Arrays:
    found = load_npz(path, (*VECTORS, "mask"))
    try:
        return {name: value.astype(np.float64) for name, value in found.items()}
    except (ValueError, TypeError):
        raise ValueError(f"{path}: not an npz file of number arrays") from None


def pick_channels(channels: Mapping[str, npt.NDArray[np.floating]]) -> Arrays:
    """The vectors and the mask among an image's named channels, (H, W) each."""
    lower = {name.lower(): np.asarray(value, np.float64) for name, value in channels.items()}
    found: Arrays = {}
    for vector, spellings in VECTORS.items():
        for prefix in spellings:
            for axes in AXES:
                names = [f"{prefix}.{axis}" for axis in axes]
                if vector not in found and all(name in lower for name in names):
                    found[vector] = np.stack([lower[name] for name in names], axis=-1)
    for name in MASKS:
        if name in lower and "mask" not in found:
            found["mask"] = lower[name]
    return found


def _from_exr(path: pathlib.Path) -> Arrays:
    from .image import read_planes

    return pick_channels(read_planes(path).planes)


@checked
def read_gbuffer(path: str | os.PathLike[str]) -> SurfacePoints:
    """Surface points (H, W) from a G-buffer file, ``.npz`` or ``.exr``.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        One line naming the file and what is missing or wrong.
    """
    file = pathlib.Path(path)
    if not file.exists():
        raise FileNotFoundError(f"{file}: no such file")
    suffix = file.suffix.lower()
    if suffix not in (".npz", ".exr"):
        raise ValueError(f"{file}: a G-buffer must be .npz or .exr")
    check_regular(file)
    found = _from_npz(file) if suffix == ".npz" else _from_exr(file)
    for name in ("normal", "view"):
        if name not in found:
            where = "array" if suffix == ".npz" else f"channels {name}.X, {name}.Y, {name}.Z"
            raise ValueError(f"{file}: misses {where}{' ' + name if suffix == '.npz' else ''}")
    normal = found["normal"]
    if normal.ndim < 2 or normal.shape[-1] != 3:
        raise ValueError(f"{file}: normal must have shape (H, W, 3), got {normal.shape}")
    seen = normal.any(axis=-1)
    try:
        if "mask" in found:
            if found["mask"].shape != seen.shape:
                got = found["mask"].shape
                raise ValueError(f"mask: must have shape {seen.shape}, got {got}")
            seen &= found["mask"] > 0.5
        return SurfacePoints(normal, found.get("tangent"), found["view"], seen)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None


@checked
def write_gbuffer(path: str | os.PathLike[str], points: SurfacePoints) -> None:
    """Write points (H, W) as ``.npz`` (float64) or ``.exr`` (float32); unseen pixels are zero.

    Raises
    ------
    ValueError
        For another suffix, or points that are not (H, W).
    """
    file = pathlib.Path(path)
    if len(points.shape) != 2:
        raise ValueError(f"{file}: points must have shape (H, W), got {points.shape}")
    seen = points.coverage
    arrays: dict[str, npt.NDArray[Any]] = {
        name: np.where(seen[..., None], getattr(points, name), 0.0)
        for name in ("normal", "tangent", "view")
    }
    if file.suffix.lower() == ".npz":
        write_npz(file, {"mask": seen, **arrays}, compressed=True)
    elif file.suffix.lower() == ".exr":
        channels = {
            f"{name}.{axis}": np.ascontiguousarray(value[..., k], dtype=np.float32)
            for name, value in arrays.items()
            for k, axis in enumerate("XYZ")
        }
        channels["mask"] = seen.astype(np.float32)
        write_exr(file, channels)
    else:
        raise ValueError(f"{file}: a G-buffer must be .npz or .exr")
