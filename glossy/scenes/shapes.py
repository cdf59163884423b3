"""Shapes of a scene: what they are locally, where they stand, and how their surfaces are charted.

Every analytic shape is a unit shape under one affine map: its own size, then ``scale``, then
``rotation``, then ``position`` ::

    x_world = position + Rz Ry Rx (scale * size * x_unit)                                  (1)

    kind       unit shape                       tangent (mx along it)     parts and uv
    sphere     |x| = 1                          cross(+y, n)              1: azimuth, polar
    box        |x|, |y|, |z| <= 1               cross(+y, n); +x on +-y   6: a cube map's faces
    rectangle  z = 0, |x|, |y| <= 1, normal +z  +x                        2: front, back
    torus      about the y axis, ring radius 1  along the ring            1: azimuth, around tube
    mesh       triangles                        cross(+y, n)              triangles, barycentric

A part's (u, v) in [0, 1] grow along columns and rows, row 0 on top. The azimuth is the lat-long
convention's: (sin 2 pi u, ., -cos 2 pi u). A rectangle shows the same (u, v) from both sides.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .. import _check
from .._files import check_regular

Float64Array = npt.NDArray[np.float64]

KINDS = ("sphere", "box", "rectangle", "torus", "mesh")
SPHERE, BOX, RECTANGLE, TORUS, MESH = range(5)
PARTS = {SPHERE: 1, BOX: 6, RECTANGLE: 2, TORUS: 1}


def _numbers(name: str, value: object, count: int, positive: bool = False) -> tuple[float, ...]:
    """``count`` finite numbers."""
    v = _check.array(name, value)  # type: ignore[arg-type]
    words = {2: "two", 3: "three"}[count]
    if v.shape != (count,) or not np.all(np.isfinite(v)) or (positive and np.any(v <= 0.0)):
        rule = f"must be {words} finite numbers" + (" above 0" if positive else "")
        raise _check.fail(name, rule, value)
    return tuple(float(x) for x in v)


@dataclasses.dataclass(frozen=True)
class Sphere:
    """A sphere about the origin."""

    radius: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _check.positive("radius", self.radius))


@dataclasses.dataclass(frozen=True)
class Box:
    """A box about the origin; ``size`` are its three edges."""

    size: Sequence[float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", _numbers("size", self.size, 3, positive=True))


@dataclasses.dataclass(frozen=True)
class Rectangle:
    """A rectangle in the xy plane that faces +z; ``size`` along x and y.

    ``one_sided``: the back is black and costs no light map.
    """

    size: Sequence[float] = (1.0, 1.0)
    one_sided: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.one_sided, bool):
            raise _check.fail("one_sided", "must be true or false", self.one_sided)
        object.__setattr__(self, "size", _numbers("size", self.size, 2, positive=True))


@dataclasses.dataclass(frozen=True)
class Torus:
    """A ring about the y axis: ``radius`` to the middle of the tube, ``tube`` the tube's own."""

    radius: float = 1.0
    tube: float = 0.25

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _check.positive("radius", self.radius))
        tube = _check.in_range("tube", self.tube, 0.0, self.radius, open_low=True, open_high=True)
        object.__setattr__(self, "tube", tube)


@dataclasses.dataclass(frozen=True)
class Mesh:
    """Triangles of a file: PLY, OBJ, STL, OFF or glTF.

    ``smooth``: vertex normals, interpolated; those of the file, or the mean about each vertex.
    """

    file: str = ""
    smooth: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.file, str) or not self.file or "\0" in self.file:
            raise _check.fail("file", "must be a path", self.file)
        if not isinstance(self.smooth, bool):
            raise _check.fail("smooth", "must be true or false", self.smooth)
        try:
            check_regular(self.file)
        except FileNotFoundError:
            raise FileNotFoundError(f"file: no such mesh file {self.file!r}") from None
        except OSError as error:
            raise type(error)(f"file: {error}") from None


Shape = Sphere | Box | Rectangle | Torus | Mesh
SHAPES: dict[str, type[Shape]] = dict(
    zip(KINDS, (Sphere, Box, Rectangle, Torus, Mesh), strict=True)
)


def kind_of(shape: Shape) -> int:
    """Index of the shape's kind in ``KINDS``."""
    return list(SHAPES.values()).index(type(shape))


def extent(shape: Shape) -> Float64Array:
    """(3,) size of eq. (1): what the unit shape is stretched by before anything else."""
    if isinstance(shape, Sphere | Torus):
        return np.full(3, shape.radius)
    if isinstance(shape, Box | Rectangle):
        return np.array([*shape.size, 2.0])[:3] / 2.0
    return np.ones(3)


@dataclasses.dataclass(frozen=True)
class Transform:
    """Where a shape stands, eq. (1).

    Parameters
    ----------
    position : three numbers
    scale : float > 0, or three
        Along the local axes, before the rotation.
    rotation : three numbers [degree]
        About x, then y, then z: the world's axes, each in turn, counter-clockwise.
    """

    position: Sequence[float] = (0.0, 0.0, 0.0)
    scale: float | Sequence[float] = 1.0
    rotation: Sequence[float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _numbers("position", self.position, 3))
        object.__setattr__(self, "rotation", _numbers("rotation", self.rotation, 3))
        scale = self.scale if isinstance(self.scale, Sequence) else [self.scale] * 3
        object.__setattr__(self, "scale", _numbers("scale", scale, 3, positive=True))

    def matrix(self, size: npt.ArrayLike = 1.0) -> Float64Array:
        """(3, 4): linear part and translation of eq. (1)."""
        turned = np.eye(3)
        for axis, degrees in enumerate(self.rotation):
            quarter, rest = divmod(degrees, 90.0)  # quarter turns without rounding
            c, s = math.cos(math.radians(rest)), math.sin(math.radians(rest))
            for _ in range(int(quarter) % 4):
                c, s = -s, c
            i, j = (axis + 1) % 3, (axis + 2) % 3
            step = np.eye(3)
            step[i, i], step[i, j], step[j, i], step[j, j] = c, -s, s, c
            turned = step @ turned
        linear = turned * (np.asarray(self.scale) * np.asarray(size))
        return np.column_stack([linear, self.position])


def inverse(matrix: Float64Array) -> Float64Array:
    """(3, 4): the inverse of an affine map (3, 4)."""
    linear = np.linalg.inv(matrix[:, :3])
    return np.column_stack([linear, -linear @ matrix[:, 3]])


def unit_bounds(kind: int, ratio: float) -> Float64Array:
    """(2, 3) corners of the unit shape's bounding box; ``ratio`` is the torus's tube / radius."""
    half = {
        SPHERE: (1.0, 1.0, 1.0),
        BOX: (1.0, 1.0, 1.0),
        RECTANGLE: (1.0, 1.0, 0.0),
        TORUS: (1.0 + ratio, ratio, 1.0 + ratio),
    }[kind]
    return np.array([-np.array(half), half])


def world_bounds(matrix: Float64Array, kind: int, ratio: float) -> Float64Array:
    """(2, 3) lowest and highest coordinates of an analytic shape in the world, tight."""
    centre = matrix[:, 3]
    rows = matrix[:, :3]
    if kind == SPHERE:
        reach = np.linalg.norm(rows, axis=1)
    elif kind == TORUS:  # the ring's circle in the local xz plane, and the tube about it
        reach = np.hypot(rows[:, 0], rows[:, 2]) + ratio * np.linalg.norm(rows, axis=1)
    else:
        reach = np.abs(rows) @ unit_bounds(kind, ratio)[1]
    return np.stack([centre - reach, centre + reach])
