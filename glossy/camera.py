"""Cameras and shapes: what each pixel of a picture sees.

World coordinates are right-handed with +y up. A pixel (column i, row j, row 0 on top) of a
camera looking along ``f`` with ``r = f x up`` and ``u = r x f`` sees along ::

    d = f + tan(fov/2) ( (2 (i + 1/2) - W)/H r + (1 - 2 (j + 1/2)/H) u )               (1)

so ``fov`` is the vertical field of view and pixels are square. What the ray meets first gives the
shading frame: the outward normal, the tangent (the sphere's field ``cross(+y, n)`` unless a plane
names its own) and ``view = -d / |d|``. Pixels that meet nothing are masked out.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from . import _check
from ._arguments import checked
from .frames import SurfacePoints, dot, normalise, sphere_tangent

Float64Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

MAX_PIXELS = 65536
FAR = 1e50  # of coordinates and, inverted, of a radius: squares of their quotient fit float64
FRAME_TAN = math.tan(math.radians(15.0))  # the unit sphere seen from 4 fills 96 % of this


def _vector(name: str, value: object) -> tuple[float, float, float]:
    v = _check.array(name, value)  # type: ignore[arg-type]
    if v.shape != (3,) or not np.all(np.isfinite(v)):
        raise _check.fail(name, "must be three finite numbers", value)
    if np.abs(v).max() > FAR:
        raise _check.fail(name, f"must be within +-{FAR:g}", value)
    return float(v[0]), float(v[1]), float(v[2])


@dataclasses.dataclass(frozen=True)
class Camera:
    """Perspective camera, eq. (1).

    Parameters
    ----------
    position, target : three numbers
        Where the eye is and what is in the middle of the picture.
    up : three numbers
        Not along the line of sight.
    fov : float in (0, 180) [degree]
        Vertical field of view.
    width, height : int >= 1
        Pixels.

    Raises
    ------
    ValueError
        For values out of range, or an ``up`` along the line of sight.
    """

    position: Sequence[float] = (0.0, 0.0, 4.0)
    target: Sequence[float] = (0.0, 0.0, 0.0)
    up: Sequence[float] = (0.0, 1.0, 0.0)
    fov: float = 30.0
    width: int = 256
    height: int = 256

    def __post_init__(self) -> None:
        for name in ("position", "target", "up"):
            object.__setattr__(self, name, _vector(name, getattr(self, name)))
        fov = _check.in_range("fov", self.fov, 0.0, 180.0, open_low=True, open_high=True)
        object.__setattr__(self, "fov", fov)
        for name in ("width", "height"):
            _check.count(name, getattr(self, name), high=MAX_PIXELS)
        self.axes()

    def axes(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Right, up and forward unit vectors, (3,) each."""
        along = np.subtract(self.target, self.position)
        if not along.any():
            raise _check.fail("target", "must differ from position", self.target)
        forward = normalise(along)
        if not np.any(self.up):
            raise _check.fail("up", "must not be zero", self.up)
        right = np.cross(forward, normalise(self.up))
        if np.linalg.norm(right) < 1e-6:
            raise _check.fail("up", "must not lie along the line of sight", self.up)
        right = normalise(right)
        return right, np.cross(right, forward), forward

    def rays(self) -> Float64Array:
        """Unit directions (H, W, 3) through the pixel centres, away from the eye."""
        right, up, forward = self.axes()
        scale = math.tan(math.radians(self.fov) / 2.0)
        x = (2.0 * (np.arange(self.width) + 0.5) - self.width) / self.height * scale
        y = (1.0 - 2.0 * (np.arange(self.height) + 0.5) / self.height) * scale
        d = forward + x[None, :, None] * right + y[:, None, None] * up
        return normalise(d)


@dataclasses.dataclass(frozen=True)
class Sphere:
    """A sphere seen from outside; a camera within it sees nothing."""

    center: Sequence[float] = (0.0, 0.0, 0.0)
    radius: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", _vector("center", self.center))
        object.__setattr__(self, "radius", _check.in_range("radius", self.radius, 1 / FAR, FAR))

    def intersect(
        self, origin: Float64Array, rays: Float64Array
    ) -> tuple[Float64Array, BoolArray, Float64Array]:
        """Normals (H, W, 3) where unit ``rays`` meet it first, whether, and how far away (H, W)."""
        to_eye = (origin - np.asarray(self.center)) / self.radius
        outside = float(to_eye @ to_eye) > 1.0
        b = rays @ to_eye
        # the squared distance of the ray from the centre, without the cancellation of b^2 - c
        off = to_eye - b[..., None] * rays
        under = 1.0 - dot(off, off)
        hit = (under > 0.0) & (b < 0.0) & outside
        distance = -b - np.sqrt(np.maximum(under, 0.0))
        return to_eye + distance[..., None] * rays, hit, distance * self.radius


@dataclasses.dataclass(frozen=True)
class Plane:
    """An infinite plane, seen from the side its normal points to; above its horizon is nothing.

    ``tangent`` is the direction of ``mx``; by default cross(+y, normal), or +x where that is zero.
    """

    point: Sequence[float] = (0.0, 0.0, 0.0)
    normal: Sequence[float] = (0.0, 1.0, 0.0)
    tangent: Sequence[float] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _vector("point", self.point))
        normal = _vector("normal", self.normal)
        if not any(normal):
            raise _check.fail("normal", "must not be zero", self.normal)
        object.__setattr__(self, "normal", tuple(normalise(normal).tolist()))
        if self.tangent is not None:
            tangent = _vector("tangent", self.tangent)
            if np.linalg.norm(np.cross(tangent, self.normal)) < 1e-3 * np.linalg.norm(tangent):
                raise _check.fail("tangent", "must not lie along the normal", self.tangent)
            object.__setattr__(self, "tangent", tuple(normalise(tangent).tolist()))

    def intersect(
        self, origin: Float64Array, rays: Float64Array
    ) -> tuple[Float64Array, BoolArray, Float64Array]:
        """Normals (H, W, 3), where ``rays`` meet the plane's front, and how far away (H, W)."""
        n = np.asarray(self.normal)
        height = float((origin - np.asarray(self.point)) @ n)
        down = -(rays @ n)
        hit = (down > 0.0) & (height > 0.0)
        return np.broadcast_to(n, rays.shape), hit, height / np.where(hit, down, 1.0)


Shape = Sphere | Plane


@checked
def surface_points(camera: Camera, shape: Shape) -> SurfacePoints:
    """What each pixel of ``camera`` sees of ``shape``.

    Returns
    -------
    SurfacePoints of shape (H, W) with positions; their mask is False where the shape is not seen.
    """
    rays = camera.rays()
    eye = np.asarray(camera.position)
    normal, hit, distance = shape.intersect(eye, rays)
    up = np.array([0.0, 0.0, 1.0])
    normal = np.where(hit[..., None], normal, up)
    tangent = shape.tangent if isinstance(shape, Plane) else None
    position = eye + np.where(hit, distance, 0.0)[..., None] * rays
    return SurfacePoints(normalise(normal), tangent, -rays, hit, position)


@checked
def default_camera(shape: Shape, width: int = 256, height: int = 256) -> Camera:
    """A camera that shows ``shape``: a sphere fills 96 % of the shorter side; a plane's horizon."""
    for name, pixels in (("width", width), ("height", height)):
        _check.count(name, pixels, high=MAX_PIXELS)
    if isinstance(shape, Sphere):
        fit = max(1.0, height / width)
        fov = math.degrees(2.0 * math.atan(FRAME_TAN * fit))
        position = np.add(shape.center, (0.0, 0.0, 4.0 * shape.radius))
        return Camera(tuple(position), shape.center, fov=fov, width=width, height=height)
    n = np.asarray(shape.normal)
    side = np.asarray(shape.tangent if shape.tangent is not None else sphere_tangent(n))
    back = np.cross(side, n)
    position = np.asarray(shape.point) + 1.5 * n + 4.0 * back
    target = np.asarray(shape.point) + 0.6 * n
    return Camera(tuple(position), tuple(target), tuple(n), 40.0, width, height)
