"""What arrives at surface points of a scene: rays cast along draws of the material and the lights.

Light depends on the place, L(x, w) is what leaves the first thing that the ray from x along w
meets, and nothing stands between ray and scene: no cube map, no buffer. Beside the material's own
directions (density p_m, ``montecarlo`` eq. 1), directions towards the scene's M lights are drawn:
points y spread evenly over rectangles of area A, normal l, and the sky by its map ::

    p_e(w) = (1/M) (sum |y - x|^2 / (A |w.l|) over the rectangles that w meets + p_sky(w))  (1)

whatever is in the way, and from behind too, since that is how they are drawn. p_sky follows what
the sky has above its mean, since the lobe's own draws serve the rest better (Karlik et al. 2019,
"MIS compensation"); an even sky is no light in this sense. Without lights the material's
directions are all. Directions for which the BSDF is 0 cost no ray.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..cubemap import CubeMap
from ..frames import dot
from .environment import EnvironmentSampler
from .montecarlo import local_directions, material_directions, weighted_bsdf

Float64Array = npt.NDArray[np.float64]
Trace = Callable[[Float64Array, Float64Array], Float64Array]


class LightSampler:
    """Directions towards lights with density (1).

    Parameters
    ----------
    corners : (M, 4, 3) array
        Rectangles, their corners in turn.
    sky : CubeMap, optional
    """

    def __init__(self, corners: Float64Array, sky: CubeMap | None = None) -> None:
        self.corner = corners[:, 0]
        self.edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]], 1)
        across = np.cross(self.edges[:, 0], self.edges[:, 1])
        self.area = np.linalg.norm(across, axis=-1)
        self.normal = across / self.area[:, None]
        self.sky = None if sky is None else _above_mean(sky)
        self.count = len(corners) + (self.sky is not None)

    def sample(self, x: Float64Array, u: Float64Array) -> Float64Array:
        """Unit directions (K, S, 3) from points (K, 3), for uniform numbers (K, S, 2) in (0, 1).

        The first number also picks the light.
        """
        scaled = u[..., 0] * self.count
        which = np.minimum(scaled.astype(np.intp), self.count - 1)
        first = np.clip(scaled - which, np.finfo(float).tiny, 1.0 - 2.0**-53)
        out = np.empty((*u.shape[:2], 3))
        for j in range(len(self.corner)):
            point, draw = np.nonzero(which == j)
            a, b = first[point, draw], u[point, draw, 1]
            y = self.corner[j] + a[:, None] * self.edges[j, 0] + b[:, None] * self.edges[j, 1]
            out[point, draw] = _unit(y - x[point], self.normal[j])
        if self.sky is not None:
            here = which == self.count - 1
            out[here] = self.sky.sample(np.stack([first[here], u[here][:, 1]], axis=-1))
        return out

    def pdf(self, x: Float64Array, w: Float64Array) -> Float64Array:
        """Eq. (1) [1/sr], (K, S), of unit directions (K, S, 3) from points (K, 3)."""
        total = np.zeros(w.shape[:2])
        for corner, edges, normal, area in zip(
            self.corner, self.edges, self.normal, self.area, strict=True
        ):
            slope = w @ normal
            away = ((corner - x) @ normal)[:, None]
            with np.errstate(divide="ignore", invalid="ignore"):
                t = away / slope
                y = x[:, None] + t[..., None] * w - corner
                a, b = (y @ e / (e @ e) for e in edges)
                inside = (t > 0.0) & (np.abs(a - 0.5) <= 0.5) & (np.abs(b - 0.5) <= 0.5)
                total += np.where(inside, t * t / (area * np.abs(slope)), 0.0)
        if self.sky is not None:
            total += self.sky.pdf(w)
        return total / self.count


def _above_mean(sky: CubeMap) -> EnvironmentSampler | None:
    """Sampler of what is brighter than the mean over the sphere; None for an even sky."""
    light = sky.faces.mean(axis=3, dtype=np.float64)
    weight = sky.solid_angles() / (4.0 * np.pi)
    above = light - np.sum(light * weight)
    above[above < 1e-6 * light] = 0.0
    faces = np.repeat(np.maximum(above, 0.0)[..., None], 3, axis=3)
    return EnvironmentSampler(CubeMap(faces.astype(np.float32))) if above.any() else None


def _unit(v: Float64Array, other: Float64Array) -> Float64Array:
    """Unit vectors along ``v`` (K, 3); ``other`` where that is 0."""
    length = np.sqrt(dot(v, v))[:, None]
    return np.where(length > 0.0, v / np.where(length > 0.0, length, 1.0), other)


class RayDraws:
    """``montecarlo.Draws`` of rays cast into a scene.

    Parameters
    ----------
    material
        With ``eval``, ``sample`` and ``pdf``.
    trace : callable
        Radiance (R, 3) that arrives at origins (R, 3) from unit directions (R, 3).
    lights : LightSampler
    frames, views, position : (K, 3, 3), (K, 3), (K, 3)
        Tangent, bitangent, normal; the local direction to the eye; the point.
    """

    def __init__(
        self,
        material: Any,
        trace: Trace,
        lights: LightSampler,
        frames: Float64Array,
        views: Float64Array,
        position: Float64Array,
    ) -> None:
        self.material, self.trace, self.lights = material, trace, lights
        self.frames, self.views, self.position = frames, views, position
        self.evaluations = 2 if lights.count else 1
        self.dimensions = 2 * self.evaluations

    def values(self, at: slice, u: Float64Array) -> Float64Array:
        """As ``Draws``."""
        frames, x = self.frames[at], self.position[at]
        wo = np.broadcast_to(self.views[at][:, None, :], (*u.shape[:2], 3))
        drawn = [material_directions(self.material, frames, wo, u[..., :2])]
        if self.lights.count:
            world = self.lights.sample(x, u[..., 2:])
            drawn.append((local_directions(frames, world), world))
        total = np.zeros((*u.shape[:2], 3))
        for local, world in drawn:
            light_pdf = self.lights.pdf(x, world) if self.lights.count else np.zeros(u.shape[:2])
            factor = weighted_bsdf(self.material, local, wo, light_pdf)
            point, draw = np.nonzero(factor.any(axis=-1))
            total[point, draw] += self.trace(x[point], world[point, draw]) * factor[point, draw]
        return total
