"""Cube maps in one picture or six files: crosses, strips, face files, and change of face size.

Each face is the face image of the OpenGL cube-map tables (``cubemap`` (1)), row 0 on top. In the
crosses the images are placed so that they continue each other::

    cross-horizontal            cross-vertical         strip-horizontal
         +Y                          +Y                +X -X +Y -Y +Z -Z
      -X +Z +X -Z                 -X +Z +X
         -Y                          -Y                strip-vertical: the same downwards
                                     -Z  (turned by 180 degrees)

These images show the cube from outside: seen from its centre with +y up, -x is to the right of +z.
In ``openexr-cube``, a vertical strip of OpenEXR files whose attribute envmap is cube, each shows it
from inside: mirrored, the side faces left to right, +Y and -Y top to bottom.
"""

import os
import pathlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from . import _check
from .cubemap import FACE_NAMES, CubeMap, texel_directions

Float32Array = npt.NDArray[np.float32]
Path = str | os.PathLike[str]

ASPECTS = {
    "latlong": (2, 1),
    "cross-horizontal": (4, 3),
    "cross-vertical": (3, 4),
    "strip-horizontal": (6, 1),
    "strip-vertical": (1, 6),
    "openexr-cube": (1, 6),
}
LAYOUTS = (*ASPECTS, "faces")

# (row, column) of +X -X +Y -Y +Z -Z, in faces
_CELLS = {
    "cross-horizontal": ((1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (1, 3)),
    "cross-vertical": ((1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (3, 1)),
    "strip-horizontal": tuple((0, i) for i in range(6)),
    "strip-vertical": tuple((i, 0) for i in range(6)),
    "openexr-cube": tuple((i, 0) for i in range(6)),
}

# steps along rows and columns of the faces that are not the OpenGL tables' as they lie there
_ACROSS, _DOWN = (1, -1), (-1, 1)
_TURNED: dict[str, dict[int, tuple[int, int]]] = {
    "cross-vertical": {5: (-1, -1)},
    "openexr-cube": {0: _ACROSS, 1: _ACROSS, 2: _DOWN, 3: _DOWN, 4: _ACROSS, 5: _ACROSS},
}

# spellings of each face at the end of a file's stem
_NAMES = (
    ("px", "posx", "+x", "xpos", "right", "rt", "0"),
    ("nx", "negx", "-x", "xneg", "left", "lf", "1"),
    ("py", "posy", "+y", "ypos", "top", "up", "2"),
    ("ny", "negy", "-y", "yneg", "bottom", "down", "dn", "3"),
    ("pz", "posz", "+z", "zpos", "front", "ft", "4"),
    ("nz", "negz", "-z", "zneg", "back", "bk", "5"),
)
_SUFFIXES = (".exr", ".hdr", ".png", ".tif", ".tiff", ".jpg", ".jpeg", ".pfm")


def recognise(width: int, height: int, layout: str | None = None) -> str:
    """The layout of a picture from its aspect ratio, or ``layout`` if the picture fits it.

    Raises
    ------
    ValueError
        If no layout has this aspect ratio, or the named one does not.
    """
    fits = [name for name, (a, b) in ASPECTS.items() if width * b == height * a]
    if layout is None:
        if not fits:
            known = ", ".join(f"{a}:{b} {name}" for name, (a, b) in ASPECTS.items())
            raise _check.fail(
                "picture",
                f"must have the aspect ratio of a layout ({known})",
                f"{width} x {height}",
            )
        layout = fits[0]
    else:
        _check.choice("layout", layout, LAYOUTS)
        if layout == "faces":
            raise _check.fail(
                "layout", "'faces' needs a folder or six files", f"{width} x {height}"
            )
        if layout not in fits:
            a, b = ASPECTS[layout]
            rule = f"must be {a}:{b} for layout {layout}"
            raise _check.fail("picture", rule, f"{width} x {height}")
    if width % ASPECTS[layout][0]:
        rule = f"must be {ASPECTS[layout][0]} whole faces wide for layout {layout}"
        raise _check.fail("picture", rule, f"{width} x {height}")
    return layout


def cut_faces(pixels: Float32Array, layout: str) -> Float32Array:
    """Faces (6, N, N, C) out of a cross or strip (H, W, C)."""
    n = pixels.shape[1] // ASPECTS[layout][0]
    faces = [pixels[r * n : (r + 1) * n, c * n : (c + 1) * n] for r, c in _CELLS[layout]]
    for i, (down, across) in _TURNED.get(layout, {}).items():
        faces[i] = faces[i][::down, ::across]
    return np.ascontiguousarray(np.stack(faces))


def place_faces(faces: Float32Array, layout: str) -> Float32Array:
    """Cross or strip (H, W, C) of faces (6, N, N, C), black where there is no face."""
    _check.choice("layout", layout, _CELLS)
    n = faces.shape[1]
    wide, high = ASPECTS[layout]
    out = np.zeros((high * n, wide * n, faces.shape[3]), dtype=faces.dtype)
    for i, (r, c) in enumerate(_CELLS[layout]):
        down, across = _TURNED.get(layout, {}).get(i, (1, 1))
        out[r * n : (r + 1) * n, c * n : (c + 1) * n] = faces[i, ::down, ::across]
    return out


def face_of_name(path: Path) -> int | None:
    """Which face 0..5 the end of a file's stem names (px, posx, +x, right, ...), or None."""
    stem = pathlib.Path(path).stem.lower()
    for face, names in enumerate(_NAMES):
        for name in names:
            if not stem.endswith(name):
                continue
            rest = stem[: len(stem) - len(name)]
            if not rest or name[0] in "+-" or not rest[-1].isalnum():
                return face
    return None


def find_faces(path: Path) -> list[pathlib.Path]:
    """Six files in the order +X -X +Y -Y +Z -Z from a folder, or a pattern such as ``sky_*.exr``.

    Raises
    ------
    ValueError
        If a face has no file or several.
    """
    place = pathlib.Path(path)
    found = place.iterdir() if place.is_dir() else place.parent.glob(place.name)
    files: dict[int, list[pathlib.Path]] = {i: [] for i in range(6)}
    for file in sorted(found):
        face = face_of_name(file)
        if face is not None and file.suffix.lower() in _SUFFIXES and file.is_file():
            files[face].append(file)
    for face, several in files.items():
        name = FACE_NAMES[face]
        if not several:
            raise _check.fail(str(path), f"must hold a file for face {name}", "none")
        if len(several) > 1:
            names = ", ".join(f.name for f in several)
            raise _check.fail(str(path), f"must hold one file for face {name}", names)
    return [files[i][0] for i in range(6)]


def is_face_set(path: object) -> bool:
    """True for what names six files: a folder, a pattern with ``*``, or a sequence of paths."""
    if isinstance(path, str | os.PathLike):
        return os.path.isdir(path) or ("*" in os.fspath(path) and not os.path.exists(path))
    return isinstance(path, Sequence)


def face_paths(path: Path) -> list[pathlib.Path]:
    """Where six faces are written: ``dir/env.exr`` gives ``dir/env_px.exr`` ... ``_nz``.

    A path without a suffix, or an existing folder, gives ``path/px.exr`` ... in it.
    """
    place = pathlib.Path(path)
    short = [names[0] for names in _NAMES]
    if place.is_dir() or not place.suffix:
        return [place / f"{name}.exr" for name in short]
    return [place.with_name(f"{place.stem}_{name}{place.suffix}") for name in short]


def _corner_integral(edge: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    product = edge[:, None] * edge[None, :]
    return np.asarray(np.arctan2(product, np.sqrt(edge[:, None] ** 2 + edge**2 + 1.0)))


def area_resize(faces: Float32Array, size: int) -> Float32Array:
    """Faces (6, N, N, 3) at another size, each new texel the mean over its own solid angle.

    The old texels are constant pieces, cut by the new borders exactly; power is kept to rounding.
    """
    n = faces.shape[1]
    size = _check.count("size", size)
    # every border of either grid as a fraction k / (n size): whole numbers, so no near-duplicates
    cut = np.union1d(np.arange(n + 1) * size, np.arange(size + 1) * n)
    edge = 2.0 * cut / (n * size) - 1.0
    corner = _corner_integral(edge)
    omega = corner[1:, 1:] - corner[:-1, 1:] - corner[1:, :-1] + corner[:-1, :-1]
    old, first = cut[:-1] // size, np.searchsorted(cut, np.arange(size) * n)
    whole = np.add.reduceat(np.add.reduceat(omega, first, axis=0), first, axis=1)
    out = np.empty((6, size, size, faces.shape[3]), dtype=np.float32)
    for f in range(6):
        part = faces[f][old][:, old] * omega[..., None]
        total = np.add.reduceat(np.add.reduceat(part, first, axis=0), first, axis=1)
        out[f] = total / whole[..., None]
    return out


def resize(faces: Float32Array, size: int) -> Float32Array:
    """Faces (6, N, N, 3) at ``size``: smaller by solid angle (exact), larger by bilinear lookup."""
    n = faces.shape[1]
    if size == n:
        return faces
    if size < n:
        return area_resize(faces, size)
    cube = CubeMap(faces, negative="keep", nonfinite="keep")
    return cube.lookup(texel_directions(size)).astype(np.float32)
