"""Environments: read from files of any usual layout, or built in.

The pixels of the source are checked before anything is resampled, so the counts that are warned
about are of values in the files.
"""

import dataclasses
import os
import pathlib
import warnings
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from . import _check, builtin, layouts
from ._arguments import checked, require
from .cubemap import MAX_SIZE, CubeMap
from .image import MAX_PIXELS, Image, read_image

Path = str | os.PathLike[str]
Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]

DEFAULT_SIZE = 256
BUILTIN = builtin.NAMES
CROPS = ("error", "black")
ENVMAPS = {"ENVMAP_LATLONG": "latlong", "ENVMAP_CUBE": "openexr-cube"}  # an EXR's attribute envmap


@dataclasses.dataclass(frozen=True, eq=False)
class Source:
    """What a file holds, before it becomes a cube map.

    Attributes
    ----------
    layout : str
        One of ``layouts.LAYOUTS``.
    pixels : float32
        Lat-long (H, W, 3), else faces (6, N, N, 3); after the policies.
    negative, nonfinite : int
        How many values of the file were negative, and NaN or infinite.
    orientation : str
        Convention of a lat-long picture where none is given: "openexr" if the file says so by its
        attribute envmap, else "glossy".
    """

    layout: str
    pixels: Float32Array
    negative: int
    nonfinite: int
    orientation: str = "glossy"

    @property
    def size(self) -> int:
        """Native cube size: texels of a face, or a quarter of a lat-long picture's width."""
        wide = int(self.pixels.shape[1])
        return max(wide // 4, 1) if self.layout == "latlong" else wide

    def power(self, orientation: str | npt.ArrayLike | None = None) -> Float64Array:
        """Integral over the sphere, (3,)."""
        from .latlong import latlong_power

        if self.layout == "latlong":
            return latlong_power(
                self.pixels, self.orientation if orientation is None else orientation
            )
        return CubeMap(self.pixels, negative="keep", nonfinite="keep").power()

    def to_cube(
        self, size: int | None = DEFAULT_SIZE, orientation: str | npt.ArrayLike | None = None
    ) -> CubeMap:
        """Cube map of ``size`` texels a face, or of the native size if None."""
        from .latlong import latlong_to_cube, orientation_of

        orientation = self.orientation if orientation is None else orientation
        n = self.size if size is None else _check.count("size", size, high=MAX_SIZE)
        orientation_of(orientation)
        turned = not isinstance(orientation, str) or orientation != "glossy"
        if self.layout != "latlong" and turned:
            raise _check.fail("orientation", f"applies to lat-long, not {self.layout}", orientation)
        if self.nonfinite and not np.isfinite(self.pixels).all():
            if self.layout == "latlong" or n != self.size:
                rule = "'keep' needs a cube layout at its own size (size=None)"
                raise _check.fail("nonfinite", rule, f"{self.layout} to {n}")
            return CubeMap(self.pixels, negative="keep", nonfinite="keep")
        if self.layout == "latlong":
            return CubeMap(latlong_to_cube(self.pixels, n, orientation), negative="keep")
        return CubeMap(layouts.resize(self.pixels, n), negative="keep")


def read_source(
    path: Path | Sequence[Path],
    layout: str | None = None,
    negative: str = "clamp",
    nonfinite: str = "error",
    encoding: str | None = None,
    crop: str = "error",
    max_pixels: int = MAX_PIXELS,
) -> Source:
    """The checked pixels of a file or six, with their layout; see ``read_environment``."""
    if layout is not None:
        _check.choice("layout", layout, layouts.LAYOUTS)
    _check.choice("crop", crop, CROPS)

    def read(file: Path) -> Image:
        window = "display" if crop == "error" else "black"
        return read_image(file, encoding, max_pixels, window)

    convention = "glossy"
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        if layouts.is_face_set(path):
            if layout not in (None, "faces"):
                raise _check.fail("layout", "must be 'faces' for a folder or six files", layout)
            kind, pixels, name = _read_faces(path, read)
        else:
            if not isinstance(path, str | os.PathLike):
                raise _check.fail("path", "must be a path or six paths", path)
            name = os.fspath(path)
            image = read(path)
            pixels = image.rgb(path)
            envmap = getattr(image.metadata.get("envmap"), "name", "")
            if envmap == "ENVMAP_LATLONG":
                convention = "openexr"
            layout = layout or ENVMAPS.get(envmap)
            kind = layouts.recognise(pixels.shape[1], pixels.shape[0], layout)
            if kind == "latlong" and pixels.shape[0] < 2:
                raise _check.fail("picture", "must have at least 2 rows", pixels.shape[0])
            if kind != "latlong":
                pixels = layouts.cut_faces(pixels, kind)
        bad = pixels.size - int(np.count_nonzero(np.isfinite(pixels)))
        below = int(np.count_nonzero(pixels < 0.0))
        pixels = _check.radiance(name, pixels, negative, nonfinite)
    texts = [str(message.message) for message in said]
    for text in {t.partition(": ")[2]: t for t in texts[::-1]}.values():  # once for six files
        warnings.warn(text, stacklevel=4)  # at the line of read_environment's caller
    return Source(kind, pixels, below, bad, convention)


def _read_faces(path: object, read: Callable[[Path], Image]) -> tuple[str, Float32Array, str]:
    if isinstance(path, str | os.PathLike):
        name, files = os.fspath(path), layouts.find_faces(path)
    else:
        for file in path:  # type: ignore[attr-defined]  # is_face_set
            require("path", file, pathlib.Path)
        files = [pathlib.Path(p) for p in path]  # type: ignore[attr-defined]
        name = "path"
        if len(files) != 6:
            raise _check.fail("path", "must be six files, +X -X +Y -Y +Z -Z", f"{len(files)}")
    faces: list[Float32Array] = []
    for file in files:
        pixels = read(file).rgb(file)
        if pixels.shape[0] != pixels.shape[1]:
            size = f"{pixels.shape[1]} x {pixels.shape[0]}"
            raise _check.fail(str(file), "must be square as a cube face", size)
        if faces and pixels.shape != faces[0].shape:
            rule = f"must be as large as {files[0].name} ({faces[0].shape[0]})"
            raise _check.fail(str(file), rule, pixels.shape[0])
        faces.append(pixels)
    return "faces", np.stack(faces), name


@checked
def read_environment(
    path: Path | Sequence[Path],
    size: int | None = DEFAULT_SIZE,
    layout: str | None = None,
    orientation: str | npt.ArrayLike | None = None,
    negative: str = "clamp",
    nonfinite: str = "error",
    encoding: str | None = None,
    crop: str = "error",
    max_pixels: int = MAX_PIXELS,
) -> CubeMap:
    """Read an environment map as a cube map of linear RGB radiance.

    Parameters
    ----------
    path : path or six paths
        OpenEXR, Radiance HDR or another image; a folder or pattern (``sky_*.exr``) of six face
        files named px, nx, ... posx ... +x ... right, left, top, bottom, front, back; or six
        paths in the order +X -X +Y -Y +Z -Z.
    size : int or None
        Texels along a face's edge; None keeps the file's own resolution (lat-long: W/4). Both
        kinds of source are averaged over solid angle when reduced and bilinear when enlarged.
    layout : str, optional
        "latlong", "cross-horizontal", "cross-vertical", "strip-horizontal", "strip-vertical",
        "openexr-cube" or "faces"; if not given, what an OpenEXR file's attribute envmap says, else
        recognised from the aspect ratio.
    orientation : str or (3, 3) array, optional
        Convention of a lat-long picture: "glossy", "mitsuba", "openexr", "godot", "three",
        "blender", "unity", "pbrt-v3", or the matrix from world directions to the picture's axes.
        If not given, "openexr" for a file whose attribute envmap is latlong, else "glossy".
    negative, nonfinite : "error", "clamp" or "keep"
        What to do with such values of the file, before resampling; a clamp is warned about once
        with its count.
    encoding : "linear" or "srgb", optional
        Meaning of 8 and 16-bit images, which are refused without it.
    crop : "error" or "black"
        An OpenEXR file that stores only part of its display window is refused, or black where it
        stores none. What it stores beyond that window is cut.
    max_pixels : int
        Largest width times height of a file.

    Raises
    ------
    ValueError
        For an unknown or ambiguous layout, an unknown convention, a crop, or values against a
        policy.
    OSError
        If a file cannot be read.
    """
    from .latlong import orientation_of

    if size is not None:
        _check.count("size", size, high=MAX_SIZE)
    if orientation is not None:
        orientation_of(orientation)
    source = read_source(path, layout, negative, nonfinite, encoding, crop, max_pixels)
    return source.to_cube(size, orientation)


def environment(name: str, size: int = DEFAULT_SIZE, seed: int = 0) -> CubeMap:
    """A built-in environment: the same function of direction at every size.

    Parameters
    ----------
    name : str
        "spots" (small bright discs up to 3000 times the background), "studio" (soft boxes in a
        dark room), "sky" (sun of 0.53 degrees, sky, ground), "white" (1 everywhere), "axes" (six
        coloured faces with their names).
    size : int
        Texels along a face's edge.
    seed : int
        Another arrangement of "spots"; the other maps have none.

    Raises
    ------
    ValueError
        For an unknown name or size.
    """
    return builtin.environment(name, size, seed)
