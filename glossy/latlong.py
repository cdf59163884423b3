"""Latitude-longitude pictures and cube maps: conventions of other tools, and both conversions.

A picture of H rows and W = 2H columns; u and v grow along columns and rows, texel (i, j) has its
centre at v = (i + 1/2)/H, u = (j + 1/2)/W, and seen in the picture's own axes its direction is ::

    d = (sin(pi v) sin(2 pi u), cos(pi v), -sin(pi v) cos(2 pi u))                              (1)

The conventions of other tools differ by a rotation or a mirror, so a preset is the matrix M that
takes a world direction to the picture's axes, d = M w. Mitsuba's also has other rows: its first
and last row lie on the poles, theta_i = i pi/(H - 1). So do OpenEXR's, whose first and last column
are one meridian besides: phi_j = 2 pi j/(W - 1). That is a picture of W - 1 columns, the first of
them the mean of those two, turned by half a column.

What a picture is between its texel centres decides how much light it holds. With rows half a
texel from the poles each texel gives its radiance times its exact solid angle ::

    power = sum L (cos(theta_i) - cos(theta_{i+1})) 2 pi/W                                      (2)

and so does the cube map that comes out of it: when the cube's texels are the larger ones, the
picture is taken as constant on each texel, else as bilinear with the nodes of ``overlap`` (2).
A picture with rows on the poles is bilinear, always; its power is the integral of that.
"""

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from . import _check, overlap
from ._jit import row_kernel
from ._threads import in_rows
from .cubemap import CubeMap, face_directions, k_lookup_weights, texel_solid_angles

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]

MAX_HEIGHT = 16384


@dataclasses.dataclass(frozen=True)
class Orientation:
    """How a lat-long picture lies on the sphere.

    Attributes
    ----------
    matrix : (3, 3) float64
        Orthogonal; takes a world direction to the axes of eq. (1). Determinant -1: a mirror.
    poles : bool
        True where the first and last row lie on the poles.
    seam : bool
        True where the first and last column are one meridian, u = 0 and 1.
    """

    matrix: Float64Array
    poles: bool = False
    seam: bool = False

    def turned(self, columns: int) -> Float64Array:
        """The matrix of a picture of ``columns`` whose first column's centre is u = 0 if ``seam``.

        It turns by half a column, so that eq. (1) gives that column's direction.
        """
        if not self.seam:
            return self.matrix
        c, s = math.cos(math.pi / columns), math.sin(math.pi / columns)
        return np.asarray(np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) @ self.matrix)


def _axes(*rows: tuple[int, int, int], poles: bool = False, seam: bool = False) -> Orientation:
    matrix = np.array(rows, dtype=np.float64)
    matrix.flags.writeable = False
    return Orientation(matrix, poles, seam)


# The comment is the tool's own formula for u, in its own axes; v is theta/pi for all of them.
ORIENTATIONS = {
    "glossy": _axes((1, 0, 0), (0, 1, 0), (0, 0, 1)),  # u = atan2(x, -z)/2pi
    "mitsuba": _axes((1, 0, 0), (0, 1, 0), (0, 0, 1), poles=True),  # u = atan2(x, -z)/2pi
    "openexr": _axes(
        (1, 0, 0), (0, 1, 0), (0, 0, 1), poles=True, seam=True
    ),  # 1/2 - atan2(x, z)/2pi
    "godot": _axes((1, 0, 0), (0, 1, 0), (0, 0, 1)),  # u = atan2(x, -z)/2pi
    "three": _axes((0, 0, -1), (0, 1, 0), (1, 0, 0)),  # u = 1/2 + atan2(z, x)/2pi
    "blender": _axes((0, 0, -1), (0, 1, 0), (1, 0, 0)),  # u = 1/2 - atan2(y, x)/2pi, z up
    "unity": _axes((0, 0, 1), (0, 1, 0), (1, 0, 0)),  # u = 1/2 - atan2(z, x)/2pi
    "pbrt-v3": _axes((0, 0, -1), (0, 1, 0), (-1, 0, 0)),  # u = atan2(y, x)/2pi, z up
}


def orientation_of(orientation: str | npt.ArrayLike) -> Orientation:
    """The preset of a name, or a matrix taken as one with rows half a texel from the poles.

    Parameters
    ----------
    orientation : str or (3, 3) array
        A key of ``ORIENTATIONS``, or an orthogonal matrix from world to the axes of eq. (1).

    Raises
    ------
    ValueError
        For an unknown name, another shape, or a matrix that is not orthogonal within 1e-6.
    """
    if isinstance(orientation, str):
        return ORIENTATIONS[_check.choice("orientation", orientation, ORIENTATIONS)]
    matrix = np.array(_check.array("orientation", orientation), dtype=np.float64)
    if matrix.shape != (3, 3):
        raise _check.fail("orientation", "must be a name or a 3 x 3 matrix", matrix.shape)
    if not np.all(np.abs(matrix @ matrix.T - np.eye(3)) <= 1e-6):
        raise _check.fail("orientation", "must be orthogonal within 1e-6", matrix.tolist())
    if not np.array_equal(matrix @ matrix.T, np.eye(3)):
        left, _, right = np.linalg.svd(matrix)
        matrix = np.asarray(left @ right)  # the nearest orthogonal one
    matrix.flags.writeable = False
    return Orientation(matrix)


def _rows(height: int, poles: bool) -> Float64Array:
    i = np.arange(height)
    return np.asarray(i * (np.pi / (height - 1)) if poles else (i + 0.5) * (np.pi / height))


def latlong_directions(height: int, orientation: str | npt.ArrayLike = "glossy") -> Float64Array:
    """Unit world directions (H, 2H, 3) of the texel centres, eq. (1)."""
    n = _check.count("height", height, low=2, high=MAX_HEIGHT)
    how = orientation_of(orientation)
    theta = _rows(n, how.poles)[:, None]
    u = np.arange(2 * n) / (2 * n - 1) if how.seam else (np.arange(2 * n) + 0.5) / (2 * n)
    phi = (2.0 * np.pi * u)[None, :]
    y = np.broadcast_to(np.cos(theta), (n, 2 * n))
    d = np.stack([np.sin(theta) * np.sin(phi), y, -np.sin(theta) * np.cos(phi)], axis=-1)
    return np.asarray(d @ how.matrix)


def latlong_solid_angles(height: int, orientation: str | npt.ArrayLike = "glossy") -> Float64Array:
    """Solid angle (H,) [sr] that a texel of each row stands for; W of each sum to 4 pi.

    The texel's own, eq. (2); with rows on the poles the integral of its bilinear weight. Where two
    columns are one meridian W - 1 of each sum to 4 pi: those two stand for half of it each.
    """
    n = _check.count("height", height, low=2, high=MAX_HEIGHT)
    how = orientation_of(orientation)
    return _row_angles(n, 2 * n - how.seam, how.poles)


def _row_angles(height: int, columns: int, poles: bool) -> Float64Array:
    across = 2.0 * np.pi / columns
    if not poles:
        edge = np.cos(np.arange(height + 1) * (np.pi / height))
        return np.asarray((edge[:-1] - edge[1:]) * across)
    step = np.pi / (height - 1)
    rows = np.sin(_rows(height, True)) * (2.0 * (1.0 - np.cos(step)) / step)
    rows[0] = rows[-1] = 1.0 - np.sin(step) / step
    return np.asarray(rows * across)


def _picture(pixels: npt.ArrayLike, how: Orientation) -> Float32Array:
    # (H, W, 3) with every column of its own: W = 2H, or 2H - 1 where two are one meridian
    p = np.asarray(_check.array("pixels", pixels, np.float32), dtype=np.float32)
    if p.ndim != 3 or p.shape[2] != 3 or p.shape[1] != 2 * p.shape[0] or p.shape[0] < 2:
        raise _check.fail("pixels", "must have shape (H, 2H, 3) with H >= 2", p.shape)
    if not how.seam:
        return p
    first = 0.5 * (p[:, :1].astype(np.float64) + p[:, -1:])
    return np.ascontiguousarray(np.concatenate([first.astype(np.float32), p[:, 1:-1]], axis=1))


def latlong_power(
    pixels: npt.ArrayLike, orientation: str | npt.ArrayLike = "glossy"
) -> Float64Array:
    """Integral of a lat-long picture (H, 2H, 3) over the sphere, (3,), eq. (2)."""
    how = orientation_of(orientation)
    p = _picture(pixels, how)
    rows = p.sum(axis=1, dtype=np.float64)
    return np.asarray(_row_angles(p.shape[0], p.shape[1], how.poles) @ rows)


def latlong_to_cube(
    pixels: npt.ArrayLike, size: int, orientation: str | npt.ArrayLike = "glossy"
) -> Float32Array:
    """Faces (6, N, N, 3) float32 whose texels hold the picture's mean over their solid angle.

    Energy is kept: ``CubeMap(faces).power()`` equals ``latlong_power`` to single precision.

    Parameters
    ----------
    pixels : (H, 2H, 3) array
        Linear radiance; row 0 is the zenith.
    size : int
        N. Up to H/2 the picture is constant on its texels, above bilinear (module docstring).
    orientation : str or (3, 3) array
        The picture's convention: a key of ``ORIENTATIONS``, or the matrix from world directions
        to the axes of eq. (1).

    Raises
    ------
    ValueError
        For a wrong shape, values that are not finite, or an unknown orientation.
    """
    how = orientation_of(orientation)
    p = _picture(pixels, how)
    n = _check.count("size", size, high=MAX_HEIGHT)
    low = p.min(axis=0).min(axis=0).astype(np.float64)
    high = p.max(axis=0).max(axis=0).astype(np.float64)
    if not np.isfinite([low, high]).all():  # NaN is the least and the largest where there is one
        bad = p.size - int(np.count_nonzero(np.isfinite(p)))
        raise _check.fail("pixels", "must be finite", f"{bad} NaN or inf values")
    rule = overlap.POLES if how.poles else overlap.CENTRES
    if not how.poles and 4 * n <= p.shape[1]:
        rule = overlap.TEXELS
    face = np.arange(6)
    centre = face_directions(face, 0.0, 0.0)
    along = [face_directions(face, s, t) - centre for s, t in ((1.0, 0.0), (0.0, 1.0))]
    matrix = how.turned(p.shape[1])
    frames = np.stack([a @ matrix.T for a in (centre, *along)], axis=1)
    sign = 1.0 if np.linalg.det(how.matrix) > 0.0 else -1.0
    omega = texel_solid_angles(n)
    return overlap.resample(_check.frozen(p), rule, frames, omega, sign, low, high)


@row_kernel
def _sample_cube(
    begin: int,
    end: int,
    padded: Float32Array,
    top: Float64Array,
    bottom: Float64Array,
    across: npt.NDArray[np.int64],
    down: int,
    matrix: Float64Array,
    out: Float32Array,
) -> None:
    # mean of down x across[i] equal-area samples in each texel; rows from y = top to bottom
    width, size = out.shape[1], padded.shape[1] - 2
    for i in range(begin, end):
        for j in range(width):
            red, green, blue = 0.0, 0.0, 0.0
            for k in range(down):
                y = top[i] + (bottom[i] - top[i]) * (k + 0.5) / down
                sine = math.sqrt(max(1.0 - y * y, 0.0))
                for m in range(across[i]):
                    phi = (j + (m + 0.5) / across[i]) * (2.0 * math.pi / width)
                    x, z = sine * math.sin(phi), -sine * math.cos(phi)
                    wx = matrix[0, 0] * x + matrix[1, 0] * y + matrix[2, 0] * z
                    wy = matrix[0, 1] * x + matrix[1, 1] * y + matrix[2, 1] * z
                    wz = matrix[0, 2] * x + matrix[1, 2] * y + matrix[2, 2] * z
                    f, r, c, a, b = k_lookup_weights(wx, wy, wz, size)
                    w00, w01 = (1.0 - a) * (1.0 - b), a * (1.0 - b)
                    w10, w11 = (1.0 - a) * b, a * b
                    red += w00 * padded[f, r, c, 0] + w01 * padded[f, r, c + 1, 0]
                    red += w10 * padded[f, r + 1, c, 0] + w11 * padded[f, r + 1, c + 1, 0]
                    green += w00 * padded[f, r, c, 1] + w01 * padded[f, r, c + 1, 1]
                    green += w10 * padded[f, r + 1, c, 1] + w11 * padded[f, r + 1, c + 1, 1]
                    blue += w00 * padded[f, r, c, 2] + w01 * padded[f, r, c + 1, 2]
                    blue += w10 * padded[f, r + 1, c, 2] + w11 * padded[f, r + 1, c + 1, 2]
            count = down * across[i]
            out[i, j, 0] = red / count
            out[i, j, 1] = green / count
            out[i, j, 2] = blue / count


def cube_to_latlong(
    cube: CubeMap, height: int, orientation: str | npt.ArrayLike = "glossy"
) -> Float32Array:
    """Picture (H, 2H, 3) float32 of a cube map: the mean of its bilinear lookup over each texel.

    At least 2 x 2 samples a texel and two per cube texel in each direction, equal in solid angle.
    The texel of a row on a pole reaches half a row from it.

    Parameters
    ----------
    cube : CubeMap
    height : int >= 2
        H; 2N keeps the cube's resolution at the middle of its faces.
    orientation : str or (3, 3) array
        The convention of the tool that will read the picture, as in ``latlong_to_cube``.
    """
    n = _check.count("height", height, low=2, high=MAX_HEIGHT)
    how = orientation_of(orientation)
    k = np.arange(n + 1)
    edge = np.clip((k - 0.5) / (n - 1), 0.0, 1.0) * np.pi if how.poles else k * (np.pi / n)
    y = np.cos(edge)
    down = max(2, math.ceil(4 * cube.size / n))
    wide = np.sin(0.5 * (edge[1:] + edge[:-1])) * (4.0 * cube.size / n)
    across = np.maximum(2, np.ceil(wide)).astype(np.int64)
    columns = 2 * n - how.seam
    out = np.empty((n, columns, 3), dtype=np.float32)
    turned = how.turned(columns)
    top, bottom, across, matrix = map(_check.frozen, (y[:-1], y[1:], across, turned))
    in_rows(_sample_cube, len(out), cube.padded, top, bottom, across, down, matrix, out)
    return np.concatenate([out, out[:, :1]], axis=1) if how.seam else out
