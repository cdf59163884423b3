"""From a point of the reflector and a direction to a place in the mirror buffer.

The buffer knows what a point P of the plane sees along the mirror direction: the pixel P falls on,
with its tangent plane (N, D), D = N.(x_R - C') for what the mirrored eye C' sees there. For another
direction w of the lobe, with a = P - C'::

    s = D - N.a,   c = N.w          the ray meets the plane at P + w s/c, if s c > 0        (1)
    v = |s| M w + |c| M a           that place before the mirrored camera; pixel = v / v_z   (2)

Then the tangent plane of what is seen at that pixel takes the place of (N, D), and (1) and (2) are
done once more: ``intersections=2``. With 1 the first pixel is kept, which is the scheme before the
thesis's improvement. Nearest pixels, since planes do not mix. Along the way pixels and solid angle
at P stand in the ratio ::

    d pixels / d w = Fx Fy s^2 |D| / v_z^3                                                  (3)

whatever the plane, without a division by its slant. For the sky, and wherever s c <= 0 in the first
step, the place is taken at infinity along w: v = M w, ratio Fx Fy / v_z^3, the limit of the above.
A second plane that the ray does not meet in front leaves the first pixel; the sky as second plane
is met at infinity.

Of each sample it is known what came in the way (``KINDS``). Two are misses, which have no pixel:
``behind`` (v_z <= 0) and ``outside`` of the buffer.

Source: thesis section 4.5.2. What is done where it leaves a case open is ours.
"""

import dataclasses
from typing import Self

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from .mirror import MirrorBuffer

FloatArray = npt.NDArray[np.floating]
Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

Vector = tuple[Scalar, Scalar, Scalar]

KINDS = ("sky", "unmet", "unmet_second", "behind", "outside")
SKY, UNMET, UNMET_SECOND, BEHIND, OUTSIDE = (1 << k for k in range(len(KINDS)))
MISSED = BEHIND | OUTSIDE

ZERO, ONE = np.float32(0.0), np.float32(1.0)


@dataclasses.dataclass(frozen=True)
class MappingCounts:
    """What came in the way of samples on their way into the buffer.

    ``samples``: all above the horizon; ``sky``: the sky was seen along the mirror direction;
    ``unmet``, ``unmet_second``: the ray did not meet the first, or the second, tangent plane in
    front of it; ``behind`` the mirrored camera and ``outside`` the buffer: looked up elsewhere.
    """

    samples: int = 0
    sky: int = 0
    unmet: int = 0
    unmet_second: int = 0
    behind: int = 0
    outside: int = 0

    @property
    def missed(self) -> int:
        """Samples that found no pixel."""
        return self.behind + self.outside

    @classmethod
    def of(cls, tally: Int64Array) -> Self:
        """From the columns samples and ``KINDS`` of (..., 6) counts."""
        return cls(*(int(n) for n in tally.reshape(-1, len(KINDS) + 1).sum(axis=0)))


@kernel
def k_turn(matrix: FloatArray, x: Scalar, y: Scalar, z: Scalar) -> Vector:
    """M v."""
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z,
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z,
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z,
    )


@kernel
def k_pixel(px: Scalar, py: Scalar, width: Scalar, height: Scalar) -> tuple[int, int]:
    """Row and column of the pixel at a position, the nearest one for a position outside."""
    column = np.int64(min(max(px, ZERO), type(px)(width)))
    row = np.int64(min(max(py, ZERO), type(py)(height)))
    return min(row, height - 1), min(column, width - 1)


@kernel
def k_own_pixel(ma: Vector, planes: FloatArray) -> tuple[int, int]:
    """Row and column of the pixel that a point of the reflector falls on; ``ma``: M a."""
    if ma[2] <= ZERO:
        return 0, 0
    return k_pixel(ma[0] / ma[2], ma[1] / ma[2], planes.shape[1], planes.shape[0])


@kernel
def k_meet(
    plane: FloatArray, a: FloatArray, ma: Vector, w: Vector, mw: Vector
) -> tuple[bool, Vector, Scalar, Scalar]:
    """Eqs. (1) and (2): whether the plane is met, v, and |s|, |c| of the place |s| w + |c| P.

    At infinity: M w and 1, 0.
    """
    s = plane[3] - (plane[0] * a[0] + plane[1] * a[1] + plane[2] * a[2])
    c = plane[0] * w[0] + plane[1] * w[1] + plane[2] * w[2]
    met = (s > ZERO and c > ZERO) or (s < ZERO and c < ZERO)
    if not met:
        return False, mw, ONE + ZERO * s, ZERO * s
    s, c = abs(s), abs(c)
    return True, (s * mw[0] + c * ma[0], s * mw[1] + c * ma[1], s * mw[2] + c * ma[2]), s, c


@kernel
def k_map(
    w: Vector,
    mw: Vector,
    a: FloatArray,
    ma: Vector,
    own: FloatArray,
    planes: FloatArray,
    twice: bool,
) -> tuple[int, Scalar, Scalar, Scalar, Scalar, Scalar]:
    """Where a direction is looked up: flags, pixel x and y, ratio (3) over Fx Fy, |s| and |c|.

    ``own`` (4,): the tangent plane at P's own pixel. A sample behind the camera has x, y = 0.
    """
    flags = 0
    met, v, s, c = k_meet(own, a, ma, w, mw)
    far = ONE + ZERO * s  # s^2 |D|, or 1 at infinity
    if met:
        far = s * s * abs(own[3])
    elif own[0] == ZERO and own[1] == ZERO and own[2] == ZERO:
        flags = SKY
    else:
        flags = UNMET
    if v[2] <= ZERO:
        return flags | BEHIND, ZERO * s, ZERO * s, far, s, c
    x, y = v[0] / v[2], v[1] / v[2]
    inside = x >= ZERO and y >= ZERO and x < planes.shape[1] and y < planes.shape[0]
    if twice and inside:
        row, column = k_pixel(x, y, planes.shape[1], planes.shape[0])
        second = planes[row, column]
        met, v2, s2, c2 = k_meet(second, a, ma, w, mw)
        sky = second[0] == ZERO and second[1] == ZERO and second[2] == ZERO
        if met or sky:
            v, s, c = v2, s2, c2
            far = s * s * abs(second[3]) if met else ONE + ZERO * s
            if v[2] <= ZERO:
                return flags | BEHIND, ZERO * s, ZERO * s, far, s, c
            x, y = v[0] / v[2], v[1] / v[2]
            inside = x >= ZERO and y >= ZERO and x < planes.shape[1] and y < planes.shape[0]
        else:
            flags |= UNMET_SECOND
    if not inside:
        flags |= OUTSIDE
    return flags, x, y, far / (v[2] * v[2] * v[2]), s, c


@row_kernel
def _map(
    begin: int,
    end: int,
    offset: FloatArray,
    direction: FloatArray,
    matrix: FloatArray,
    planes: FloatArray,
    twice: bool,
    flags: Int64Array,
    out: FloatArray,
) -> None:
    for k in range(begin, end):
        w = (direction[k, 0], direction[k, 1], direction[k, 2])
        ma = k_turn(matrix, offset[k, 0], offset[k, 1], offset[k, 2])
        mw = k_turn(matrix, w[0], w[1], w[2])
        row, column = k_own_pixel(ma, planes)
        flags[k], x, y, ratio, s, c = k_map(
            w, mw, offset[k], ma, planes[row, column], planes, twice
        )
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4] = x, y, ratio, s, c


@dataclasses.dataclass(frozen=True, eq=False)
class Mapping:
    """Where samples are looked up; arrays (...).

    ``x``, ``y`` [pixel]: position in the buffer, NaN for a sample behind the mirrored camera;
    ``density`` [pixel/sr]: eq. (3); ``distance``: to the place that was found, inf for the sky and
    what is taken at infinity; ``flags``: bits in the order of ``KINDS``.
    """

    x: Float64Array
    y: Float64Array
    density: Float64Array
    distance: Float64Array
    flags: Int64Array

    def kind(self, name: str) -> npt.NDArray[np.bool_]:
        """Samples (...) of one of ``KINDS``."""
        bit = 1 << KINDS.index(_check.choice("kind", name, KINDS))
        return np.asarray(self.flags & bit != 0)

    @property
    def missed(self) -> npt.NDArray[np.bool_]:
        """Samples (...) without a pixel."""
        return np.asarray(self.flags & MISSED != 0)

    def counts(self) -> MappingCounts:
        """How many of each kind."""
        kinds = {name: int(self.kind(name).sum()) for name in KINDS}
        return MappingCounts(samples=self.flags.size, **kinds)


def map_samples(
    buffer: MirrorBuffer,
    positions: npt.ArrayLike,
    directions: npt.ArrayLike,
    intersections: int = 2,
) -> Mapping:
    """Where in the buffer the light is looked up that reaches points of the plane.

    Parameters
    ----------
    buffer : MirrorBuffer
    positions : (..., 3) array
        Points of the reflector.
    directions : (..., 3) array
        Where the light comes from, any length; both broadcast.
    intersections : 2 or 1
        Tangent planes that each ray meets in turn.

    Raises
    ------
    ValueError
        For shapes that do not broadcast, a zero direction, or another count.
    """
    x = _check.array("positions", positions).astype(np.float64)
    w = _check.vectors("directions", directions).astype(np.float64)
    _check.count("intersections", intersections, low=1, high=2)
    try:
        shape = np.broadcast_shapes(x.shape, w.shape)
    except ValueError:
        raise _check.fail("positions, directions", "must broadcast", (x.shape, w.shape)) from None
    if shape[-1] != 3 or not np.all(np.isfinite(x)):
        raise _check.fail("positions", "must be finite, shape (..., 3)", x.shape)
    w = w / np.linalg.norm(w, axis=-1, keepdims=True)
    camera = buffer.camera
    offset, along = (
        _check.frozen(np.broadcast_to(v, shape).reshape(-1, 3)) for v in (x - camera.position, w)
    )
    flags, out = np.empty(len(offset), dtype=np.int64), np.empty((len(offset), 5))
    in_rows(
        _map,
        len(offset),
        offset,
        along,
        _check.frozen(camera.matrix),
        buffer.planes,
        intersections == 2,
        flags,
        out,
        grain=256,
    )
    lost = flags & BEHIND != 0
    out[lost, :2] = np.nan
    distance = np.divide(out[:, 3], out[:, 4], out=np.full(len(out), np.inf), where=out[:, 4] > 0.0)
    density = np.where(lost, np.nan, camera.density * out[:, 2])
    x, y, density, distance = (
        v.reshape(shape[:-1]) for v in (out[:, 0], out[:, 1], density, distance)
    )
    return Mapping(x, y, density, distance, flags.reshape(shape[:-1]))
