"""Surface points from a file: another renderer's G-buffer.

``.npz`` holds arrays ``normal``, ``view`` (H, W, 3) and optionally ``tangent`` (H, W, 3) and
``mask`` (H, W). ``.exr`` holds the same as channels, each vector under any of these spellings
(upper or lower case), or under a prefix that is given ::

    normal    normal.X normal.Y normal.Z    N.X N.Y N.Z    Normal.R ...
    view      view.X ...                    V.X ...        wo.X ...
    tangent   tangent.X ...                 T.X ...        (optional)
    mask      mask, or mask.Y               A              (optional, seen where > 0.5)

World coordinates, +y up; ``view`` leaves the surface. A pixel whose normal is zero saw nothing, and
so did what lies outside the data window of an EXR; other pixels are not looked at where the mask
hides them. Vectors are unit within 1e-3, half floats included, and renormalised.
"""

import os
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check
from ._arguments import checked
from ._npz import load_npz
from ._output import write_npz
from .frames import SurfacePoints
from .image_write import write_exr

Arrays = dict[str, npt.NDArray[Any]]

VECTORS = {
    "normal": ("normal", "n", "normals"),
    "view": ("view", "v", "wo"),
    "tangent": ("tangent", "t", "tangents"),
}
AXES = (("x", "y", "z"), ("r", "g", "b"))
MASKS = ("mask", "mask.y", "mask.a", "a")
GREY = (
    0.01  # an encoded vector of components below this is the grey of no surface: 127 or 128 of 255
)


def _from_npz(path: pathlib.Path, names: Mapping[str, str]) -> Arrays:
    chosen = {name: names.get(name) or name for name in (*VECTORS, "mask")}
    stored = load_npz(path, set(chosen.values()))
    found = {name: stored[own] for name, own in chosen.items() if own in stored}
    if any(value.dtype.kind not in "biuf" for value in found.values()):
        raise ValueError(f"{path}: not an npz file of number arrays")
    return found


def pick_channels(
    channels: Mapping[str, npt.NDArray[Any]], names: Mapping[str, str] | None = None
) -> Arrays:
    """The vectors and the mask among an image's named channels, (H, W) each.

    ``names``: prefixes of vectors, or a channel for the mask, to take instead of those above.
    """
    lower = {name.lower(): value for name, value in channels.items()}
    own = {name: (given.lower(),) for name, given in (names or {}).items()}
    found: Arrays = {}
    for vector, spellings in VECTORS.items():
        for prefix in own.get(vector, spellings):
            for axes in AXES:
                wanted = [f"{prefix}.{axis}" for axis in axes]
                if vector not in found and all(name in lower for name in wanted):
                    found[vector] = np.stack([lower[n] for n in wanted], axis=-1)
    for name in own.get("mask", MASKS):
        if name in lower and "mask" not in found:
            found["mask"] = np.asarray(lower[name])
    return found


def _from_exr(path: pathlib.Path, names: Mapping[str, str]) -> Arrays:
    from .image import read_planes

    return pick_channels(read_planes(path, window="black").planes, names)


@checked
def read_gbuffer(
    path: str | os.PathLike[str],
    *,
    normalise: bool = False,
    encoded: Sequence[str] = (),
    normal: str | None = None,
    view: str | None = None,
    tangent: str | None = None,
    mask: str | None = None,
) -> SurfacePoints:
    """Surface points (H, W) from a G-buffer file, ``.npz`` or ``.exr``.

    Parameters
    ----------
    normalise : bool
        Take vectors of any length but zero: those of 8 or 10 bits, or interpolated ones.
    encoded : names of vectors
        Which of "normal", "view", "tangent" are stored as v/2 + 1/2, in [0, 1] or, as unsigned
        integers, up to their largest value. Pixels whose normal is then black, or grey within the
        rounding of 8 bits, saw nothing.
    normal, view, tangent, mask : str, optional
        What the file calls them: the prefix of a vector's channels (``Ns`` for Ns.X, Ns.Y, Ns.Z or
        Ns.R, Ns.G, Ns.B) and the mask's channel, or the arrays of an npz file. They must be there.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        One line naming the file and what is missing or wrong, with the first such pixel.
    """
    file = pathlib.Path(path)
    given = {"normal": normal, "view": view, "tangent": tangent, "mask": mask}
    names = {key: _text(key, name) for key, name in given.items() if name is not None}
    coded = (encoded,) if isinstance(encoded, str) else tuple(encoded)
    for vector in coded:
        _check.choice("encoded", vector, VECTORS)
    suffix = file.suffix.lower()
    if suffix not in (".npz", ".exr"):
        raise ValueError(f"{file}: a G-buffer must be .npz or .exr")
    found = _from_npz(file, names) if suffix == ".npz" else _from_exr(file, names)
    for name in dict.fromkeys(("normal", "view", *names)):
        if name not in found:
            called = _check.shortened(names.get(name, name))
            several = name != "mask" and suffix == ".exr"
            where = f"channels {called}.X, {called}.Y, {called}.Z" if several else called
            raise ValueError(f"{file}: misses {where if suffix == '.exr' else 'array ' + called}")
    try:
        return _points(found, coded, normalise)
    except ValueError as error:
        hint = (
            "; normalise takes any length, encoded takes v/2 + 1/2"
            if "must be unit vectors" in str(error)
            else ""
        )
        raise ValueError(f"{file}: {error}{hint}") from None


def _text(name: str, value: object) -> str:
    if not isinstance(value, str) or not value:
        raise _check.fail(name, "must be what the file calls it", value)
    return value


def _decoded(value: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    top = np.iinfo(value.dtype).max if value.dtype.kind == "u" else 1.0
    return value.astype(np.float64) * (2.0 / top) - 1.0


def _points(found: Arrays, encoded: Sequence[str], normalise: bool) -> SurfacePoints:
    normal = found["normal"]
    if normal.ndim < 2 or normal.shape[-1] != 3:
        raise _check.fail("normal", "must have shape (H, W, 3)", normal.shape)
    seen = normal.any(axis=-1)
    vectors = {
        name: _decoded(found[name]) if name in encoded else found[name]
        for name in VECTORS
        if name in found
    }
    if "normal" in encoded:
        seen &= ~np.all(np.abs(vectors["normal"]) <= GREY, axis=-1)
    if "mask" in found:
        if found["mask"].shape != seen.shape:
            raise _check.fail("mask", f"must have shape {seen.shape}", found["mask"].shape)
        if np.isnan(found["mask"]).any():
            row, column = np.argwhere(np.isnan(found["mask"]))[0]
            raise _check.fail("mask", "must be numbers", f"NaN at pixel {column},{row}")
        seen &= found["mask"] > 0.5
    return SurfacePoints(**vectors, mask=seen, normalise=normalise)


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
