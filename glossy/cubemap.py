"""Cube maps: directions and texels, exact solid angles, and the plain float64 lookup.

With s, t in [-1, 1] growing along columns and rows, the texel direction on each face is ::

    +X (1,-t,-s)  -X (-1,-t,s)  +Y (s,1,t)  -Y (s,-1,-t)  +Z (s,-t,1)  -Z (-s,-t,-1)      (1)

the orientation of the OpenGL and Vulkan cube-map tables. A direction belongs to the face of its
largest component; ties go to z before y before x. The solid angle of a rectangle on the plane
z = 1 follows from its corners::

    omega = A(s1,t1) - A(s0,t1) - A(s1,t0) + A(s0,t0),  A(s,t) = atan2(s t, sqrt(s^2+t^2+1))  (2)

Radiance between texel centres is bilinear in (s, t), across face edges too: the neighbour face is
folded flat about the edge, and at a cube corner the missing fourth texel is the mean of the three
that meet. This lookup is what the ground truth integrates; the pyramid has a kernel of its own.
"""

import functools

import numpy as np
import numpy.typing as npt

from . import _check
from ._jit import Scalar, kernel, row_kernel
from ._threads import in_rows

FACE_NAMES = ("+x", "-x", "+y", "-y", "+z", "-z")
MAX_SIZE = 16384

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


def face_directions(face: npt.ArrayLike, s: npt.ArrayLike, t: npt.ArrayLike) -> Float64Array:
    """Directions (..., 3) on the cube's surface, eq. (1): the major component is +-1.

    ``face`` (...) holds 0..5 in the order of ``FACE_NAMES``; ``s``, ``t`` (...) are columns and
    rows in [-1, 1].
    """
    f, a, b = np.broadcast_arrays(np.asarray(face), np.asarray(s, float), np.asarray(t, float))
    one = np.ones_like(a)
    table = np.array(
        [[one, -b, -a], [-one, -b, a], [a, one, b], [a, -one, -b], [a, -b, one], [-a, -b, -one]]
    )
    picked = np.take_along_axis(table, f[None, None].astype(np.intp), axis=0)[0]
    return np.ascontiguousarray(np.moveaxis(picked, 0, -1))


def locate(directions: npt.ArrayLike) -> tuple[IntArray, Float64Array, Float64Array]:
    """Face 0..5 and coordinates s, t in [-1, 1] of directions (..., 3) of any length; eq. (1).

    Raises
    ------
    ValueError
        If a direction is zero or not finite.
    """
    d = np.asarray(_check.vectors("directions", directions), dtype=np.float64)
    x, y, z = d[..., 0], d[..., 1], d[..., 2]
    ax, ay, az = np.abs(x), np.abs(y), np.abs(z)
    on_z = (az >= ay) & (az >= ax)
    on_y = ~on_z & (ay >= ax)
    major = np.where(on_z, z, np.where(on_y, y, x))
    face = np.where(on_z, 4, np.where(on_y, 2, 0)) + (major < 0.0)
    s = np.choose(face, [-z, z, x, x, x, -x])
    t = np.choose(face, [-y, -y, z, -z, -y, -y])
    size = np.abs(major)
    return face, s / size, t / size


def texel_directions(size: int) -> Float64Array:
    """Directions (6, N, N, 3) of the texel centres, on the cube's surface (not normalised)."""
    n = _check.count("size", size, high=MAX_SIZE)
    c = (np.arange(n) + 0.5) * (2.0 / n) - 1.0
    return face_directions(np.arange(6)[:, None, None], c[None, None, :], c[None, :, None])


@functools.lru_cache(maxsize=4)
def texel_solid_angles(size: int) -> Float64Array:
    """Solid angles (N, N) [sr] of the texels of one face, eq. (2); six faces sum to 4 pi."""
    n = _check.count("size", size, high=MAX_SIZE)
    edge = np.arange(n + 1) * (2.0 / n) - 1.0
    area = np.arctan2(edge[:, None] * edge[None, :], np.sqrt(edge[:, None] ** 2 + edge**2 + 1.0))
    omega = area[1:, 1:] - area[:-1, 1:] - area[1:, :-1] + area[:-1, :-1]
    omega.flags.writeable = False
    return np.asarray(omega)


def pad_faces(faces: Float32Array) -> Float32Array:
    """Faces (6, N, N, C) with one ring of neighbours around each: (6, N+2, N+2, C).

    A texel beyond an edge is found by folding the neighbour about that edge: it lies on the cube at
    the edge point moved inwards by its distance from the edge. Corners: mean of the three texels.
    """
    n = faces.shape[1]
    out = np.zeros((6, n + 2, n + 2, faces.shape[3]), dtype=faces.dtype)
    out[:, 1:-1, 1:-1] = faces
    along = (np.arange(n) + 0.5) * (2.0 / n) - 1.0
    depth = 1.0 / n
    face = np.arange(6)[:, None]
    normal = face_directions(face, 0.0, 0.0)
    for s, t, rows, cols in (
        (along, -1.0, 0, slice(1, -1)),
        (along, 1.0, -1, slice(1, -1)),
        (-1.0, along, slice(1, -1), 0),
        (1.0, along, slice(1, -1), -1),
    ):
        f, u, v = locate(face_directions(face, s, t) - depth * normal)
        col = np.clip(((u + 1.0) * (0.5 * n)).astype(int), 0, n - 1)
        row = np.clip(((v + 1.0) * (0.5 * n)).astype(int), 0, n - 1)
        out[:, rows, cols] = faces[f, row, col]
    for i, j in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        i1, j1 = (1 if i == 0 else -2), (1 if j == 0 else -2)
        three = (out[:, i1, j1], out[:, i, j1], out[:, i1, j])
        total = np.sum([a.astype(np.float64) for a in three], axis=0)
        out[:, i, j] = (total / 3.0).astype(faces.dtype)
    return out


@kernel
def k_lookup_weights(
    x: Scalar, y: Scalar, z: Scalar, size: Scalar
) -> tuple[Scalar, Scalar, Scalar, Scalar, Scalar]:
    """Face, padded row and column of the first of the four texels, fractions across and down."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if az >= ay and az >= ax:
        face = 4 if z >= 0.0 else 5
        m, s, t = az, (x if z >= 0.0 else -x), -y
    elif ay >= ax:
        face = 2 if y >= 0.0 else 3
        m, s, t = ay, x, (z if y >= 0.0 else -z)
    else:
        face = 0 if x >= 0.0 else 1
        m, s, t = ax, (-z if x >= 0.0 else z), -y
    u = (s / m + 1.0) * (0.5 * size) + 0.5
    v = (t / m + 1.0) * (0.5 * size) + 0.5
    col = min(max(int(u), 0), size)
    row = min(max(int(v), 0), size)
    return face, row, col, u - col, v - row


@row_kernel
def _lookup(
    begin: int, end: int, directions: Float64Array, padded: Float32Array, out: Float64Array
) -> None:
    # (K, 3), (6, N+2, N+2, 3), (K, 3)
    size = padded.shape[1] - 2
    for k in range(begin, end):
        d = directions[k]
        face, row, col, a, b = k_lookup_weights(d[0], d[1], d[2], size)
        for c in range(3):
            top = padded[face, row, col, c] * (1.0 - a) + padded[face, row, col + 1, c] * a
            low = padded[face, row + 1, col, c] * (1.0 - a) + padded[face, row + 1, col + 1, c] * a
            out[k, c] = top * (1.0 - b) + low * b


class CubeMap:
    """Radiance from every direction: six square faces, linear RGB, float32.

    Parameters
    ----------
    faces : (6, N, N, 3) array
        Radiance in the orientation of eq. (1), row 0 first, any N >= 1.
    negative, nonfinite : "error", "clamp" or "keep"
        What to do with such values; a clamp is warned about with its count.

    Raises
    ------
    ValueError
        For a wrong shape, or values against the policy.
    """

    def __init__(
        self, faces: npt.ArrayLike, negative: str = "error", nonfinite: str = "error"
    ) -> None:
        raw = np.asarray(_check.array("faces", faces, np.float32), dtype=np.float32)
        if raw.ndim != 4 or raw.shape[0] != 6 or raw.shape[1] != raw.shape[2] or raw.shape[3] != 3:
            raise _check.fail("faces", "must have shape (6, N, N, 3)", raw.shape)
        _check.count("faces size", raw.shape[1], high=MAX_SIZE)
        checked = _check.radiance("faces", raw, negative, nonfinite)
        self._faces = checked.copy() if np.may_share_memory(checked, faces) else checked
        self._faces.flags.writeable = False

    @property
    def faces(self) -> Float32Array:
        """Radiance (6, N, N, 3), read-only."""
        return self._faces

    @property
    def size(self) -> int:
        """Texels along a face's edge, N."""
        return int(self._faces.shape[1])

    @functools.cached_property
    def padded(self) -> Float32Array:
        """Faces with one ring of neighbours, (6, N+2, N+2, 3): what the lookup reads."""
        return _check.frozen(pad_faces(self._faces))

    def solid_angles(self) -> Float64Array:
        """Solid angles (N, N) [sr] of the texels of a face; six faces sum to 4 pi."""
        return texel_solid_angles(self.size)

    def lookup(self, directions: npt.ArrayLike) -> Float64Array:
        """Radiance (..., 3) float64 along directions (..., 3) of any length, seamless bilinear.

        Raises
        ------
        ValueError
            If a direction is zero or not finite.
        """
        d = np.asarray(_check.vectors("directions", directions), dtype=np.float64)
        out = np.empty(d.shape, dtype=np.float64)
        in_rows(
            _lookup,
            len(d.reshape(-1, 3)),
            _check.frozen(d.reshape(-1, 3)),
            self.padded,
            out.reshape(-1, 3),
            grain=1024,
        )
        return out

    def power(self) -> Float64Array:
        """Integral of the texels' radiance over the sphere, (3,): sum of L omega."""
        return np.asarray(np.einsum("frcx,rc->x", self._faces, self.solid_angles()))

    def __repr__(self) -> str:
        return f"CubeMap(size={self.size})"
