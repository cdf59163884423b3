"""A box room with walls of a smooth procedural colour, ray cast: no cube map, no planes."""

import numpy as np
import numpy.typing as npt

from glossy import BoundingPlanes, CubeMap, SurfacePoints
from glossy.cubemap import texel_directions
from glossy.frames import normalise

Array = npt.NDArray[np.float64]

LOW, HIGH = np.array([-2.0, 0.0, -2.5]), np.array([2.0, 2.5, 2.5])
CENTRE = np.array([1.2, 0.9, 0.2])
PLANES = [(corner, axis) for axis in np.eye(3) for corner in (LOW, HIGH)]


def wall_colour(x: Array) -> Array:
    """Radiance (..., 3) of places (..., 3) on the walls: soft waves, continuous round the edges."""
    a = np.sin(2.1 * x[..., 0] + 0.4) * np.cos(1.7 * x[..., 2])
    b = np.cos(1.9 * x[..., 1] - 1.3 * x[..., 0])
    c = np.sin(1.4 * x[..., 2] + 2.3 * x[..., 1])
    return np.stack([1.2 + a, 1.1 + 0.5 * a + 0.5 * b, 1.3 + c], axis=-1)


def ray_cast(origin: Array, w: Array) -> Array:
    """Radiance (..., 3) that arrives at ``origin`` from directions ``w``: the slabs' far side."""
    away = np.where(w > 0.0, HIGH - origin, LOW - origin) / np.where(w == 0.0, 1e-300, w)
    return wall_colour(origin + away.min(axis=-1)[..., None] * w)


def capture(size: int) -> CubeMap:
    """The room as a cube map at ``CENTRE`` holds it."""
    d = normalise(texel_directions(size))
    return CubeMap(ray_cast(np.broadcast_to(CENTRE, d.shape), d))


def planes(**options: object) -> BoundingPlanes:
    """The room's six sides."""
    return BoundingPlanes(CENTRE, PLANES, **options)  # type: ignore[arg-type]


def sphere_points(
    count: int, seed: int, radius: float = 0.5, lowest: float = 0.25
) -> SurfacePoints:
    """Random points of a sphere about ``CENTRE``, seen from random sides."""
    rng = np.random.default_rng(seed)
    n = normalise(rng.normal(size=(count, 3)))
    side = normalise(np.cross(n, rng.normal(size=(count, 3))))
    cos = rng.uniform(lowest, 1.0, (count, 1))
    view = cos * n + np.sqrt(1.0 - cos**2) * side
    return SurfacePoints(n, None, view, position=CENTRE + radius * n)
