"""Pictures that plans are tested on: planes, half spheres, grazing bands, spheres, a teapot.

A picture is a set of surface points, drawn from a seed. ``pixels`` at most 1024 are measured whole
by a plan; the pictures of cameras, which have more, are sampled.
"""

import functools
import pathlib
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from figure_lacquer import teapot

import glossy
from glossy import frames

Float64Array = npt.NDArray[np.float64]
Rng = np.random.Generator
Picture = Callable[[Rng, int], glossy.SurfacePoints]

LOBES = ((0.05, 0.05), (0.1, 0.1), (0.2, 0.2), (0.4, 0.4), (0.2, 0.075))
STEEPEST = 80.0  # degrees


def direction(rng: Rng, count: int = 1) -> Float64Array:
    """Unit vectors (count, 3), even over the sphere."""
    return frames.normalise(rng.normal(size=(count, 3)))


def seen_at(normal: Float64Array, theta: Float64Array, phi: Float64Array) -> glossy.SurfacePoints:
    """Points of some normals (K, 3) seen at angles and azimuths (K,) in degrees."""
    tangent = frames.sphere_tangent(normal)
    local = frames.spherical(np.radians(theta), np.radians(phi))
    return glossy.SurfacePoints(normal, tangent, frames.to_world(local, tangent, normal))


def plane(rng: Rng, pixels: int, low: float = 0.0, high: float = STEEPEST) -> glossy.SurfacePoints:
    """One plane from all sides, at angles of ``low`` to ``high``."""
    normal = np.repeat(direction(rng), pixels, axis=0)
    return seen_at(normal, rng.uniform(low, high, pixels), rng.uniform(0.0, 360.0, pixels))


def plane_camera(rng: Rng, pixels: int) -> glossy.SurfacePoints:
    """One plane as a camera of some 20 by 40 degrees sees it, within 80 degrees."""
    normal = np.repeat(direction(rng), pixels, axis=0)
    theta = np.clip(rng.uniform(0.0, STEEPEST) + rng.uniform(-10.0, 10.0, pixels), 0.0, STEEPEST)
    across = rng.uniform(-20.0, 20.0, pixels) / np.sin(np.radians(np.maximum(theta, 1.0)))
    return seen_at(normal, theta, rng.uniform(0.0, 360.0) + np.clip(across, -180.0, 180.0))


def distant_plane(rng: Rng, pixels: int) -> glossy.SurfacePoints:
    """One plane, one view: every pixel the same."""
    point = seen_at(direction(rng), rng.uniform(0.0, STEEPEST, 1), rng.uniform(0.0, 360.0, 1))
    return point[np.zeros(pixels, dtype=int)]


def half_sphere(rng: Rng, pixels: int) -> glossy.SurfacePoints:
    """A sphere as an orthographic camera sees it, evenly over the disc."""
    v = direction(rng)
    x = frames.sphere_tangent(v)
    y = np.cross(v, x)
    radius = np.sqrt((np.arange(pixels) + rng.random(pixels)) / pixels)
    phi = 2.0 * np.pi * rng.random(pixels)
    across = (radius * np.cos(phi))[:, None] * x + (radius * np.sin(phi))[:, None] * y
    normal = frames.normalise(across + np.sqrt(1.0 - radius * radius)[:, None] * v)
    return glossy.SurfacePoints(normal, frames.sphere_tangent(normal), np.repeat(v, pixels, axis=0))


def sphere(rng: Rng, pixels: int, low: float = 0.0) -> glossy.SurfacePoints:
    """Normals in all directions, seen at ``low`` to 80 degrees."""
    theta = rng.uniform(low, STEEPEST, pixels)
    return seen_at(direction(rng, pixels), theta, rng.uniform(0.0, 360.0, pixels))


def camera(rng: Rng, pixels: int, flat: bool = False) -> glossy.SurfacePoints:
    """What a camera with forty times the pixels sees of a sphere or a plane from above."""
    width = round((40 * pixels) ** 0.5)
    eye = direction(rng)[0]
    eye[1] = abs(eye[1]) + 0.2
    view = glossy.Camera(position=tuple(4.0 * eye), width=width, height=width)
    return glossy.surface_points(view, glossy.Plane() if flat else glossy.Sphere())


def pictures(data: pathlib.Path | None) -> dict[str, tuple[Picture, int]]:
    """Kinds of picture, and how many of each."""
    found: dict[str, tuple[Picture, int]] = {
        "plane, one view": (distant_plane, 1),
        "plane, camera": (plane_camera, 2),
        "plane, all sides": (plane, 1),
        "plane, 60 to 80 degrees": (functools.partial(plane, low=60.0), 1),
        "half sphere": (half_sphere, 1),
        "sphere, 60 to 80 degrees": (functools.partial(sphere, low=60.0), 1),
        "sphere, all sides": (sphere, 1),
        "sphere, large": (camera, 1),
        "plane, large": (functools.partial(camera, flat=True), 1),
    }
    if data is not None:
        points = teapot(data / "mesh" / "teapot.ply", 40, 24)
        found["teapot"] = (lambda _rng, _pixels: points[points.coverage], 1)
    return found


def relative(picture: npt.ArrayLike, truth: Float64Array) -> float:
    """Relative RMS error."""
    difference = np.asarray(picture, dtype=np.float64) - truth
    power = float(np.mean(truth**2))
    return (
        float(np.sqrt(np.mean(difference**2) / power)) if power > 0.0 else float(difference.any())
    )
