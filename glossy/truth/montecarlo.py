"""Monte Carlo and quasi-Monte Carlo truth: multiple importance sampling of material and light.

Each draw takes one direction from the material's own sampling (density p_m) and one from the
environment (p_e), combined by the balance heuristic, so that neither a sharp lobe nor a tiny lamp
is left to chance::

    X = F(w_m) / (p_m(w_m) + p_e(w_m)) + F(w_e) / (p_m(w_e) + p_e(w_e)),   F = L f abs(cos)   (1)

What is drawn and what light it finds is a ``Draws``: here that of a cube map, in ``rays`` that of
rays cast into a scene.

``mc``: independent draws, standard error from their variance. ``qmc``: sixteen replicates of
randomised Sobol' points, standard error from the spread of their means (fifteen degrees of
freedom).

Draws are made in blocks of fixed size and added in a fixed order, so a point's result depends on
its flat index, the seed and the number of samples alone.
"""

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ..cubemap import CubeMap
from ..frames import dot
from .environment import EnvironmentSampler
from .planes import PlaneLight
from .random import sobol, uniform

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Pass = tuple[Float64Array, Float64Array, int]

REPLICATES = 16
BLOCK = 4096  # draws of a point added at a time
CHUNK = 1 << 18  # draws held at a time
FIRST_PASS = 64  # draws (of both estimators) in the first pass; the total doubles from pass to pass


class Draws(Protocol):
    """Draws at points (K,): ``dimensions`` uniform numbers and ``evaluations`` of the BSDF each."""

    dimensions: int
    evaluations: int

    def values(self, at: slice, u: Float64Array) -> Float64Array:
        """X (k, S, 3) of eq. (1) at the points ``at`` for uniform numbers (k, S, dimensions)."""
        ...


def material_directions(
    material: Any, frames: Float64Array, wo: Float64Array, u: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Directions (K, S, 3) that the material draws, local and world.

    ``frames`` (K, 3, 3): tangent, bitangent, normal; ``wo`` (K, S, 3) local; ``u`` (K, S, 2).
    """
    axes = frames[:, None]
    local = np.asarray(material.sample(np.ascontiguousarray(u), wo), dtype=np.float64)
    world = (
        local[..., :1] * axes[..., 0, :]
        + local[..., 1:2] * axes[..., 1, :]
        + local[..., 2:] * axes[..., 2, :]
    )
    return local, world


def local_directions(frames: Float64Array, world: Float64Array) -> Float64Array:
    """World directions (K, S, 3) in the frames (K, 3, 3) of their points."""
    return np.stack([dot(world, frames[:, None, k, :]) for k in range(3)], axis=-1)


def weighted_bsdf(
    material: Any, local: Float64Array, wo: Float64Array, light_pdf: Float64Array
) -> Float64Array:
    """F / (L (p_m + p_e)) of eq. (1) for local directions (K, S, 3): (K, S, 1 or 3)."""
    f = np.asarray(material.eval(local, wo), dtype=np.float64)
    f = f[..., None] if f.ndim == 2 else f
    density = np.asarray(material.pdf(local, wo)) + light_pdf
    weight = np.abs(local[..., 2]) / np.where(density > 0.0, density, np.inf)
    return np.asarray(f * weight[..., None])


class CubeDraws:
    """Draws under a cube map, or under one that is looked up by place: ``planes``."""

    dimensions, evaluations = 4, 2

    def __init__(
        self,
        material: Any,
        cube: CubeMap,
        frames: Float64Array,
        views: Float64Array,
        planes: PlaneLight | None = None,
    ) -> None:
        self.material, self.frames, self.views = material, frames, views
        self.cube, self.planes, self.sampler = cube, planes, EnvironmentSampler(cube)

    def values(self, at: slice, u: Float64Array) -> Float64Array:
        """As ``Draws``."""
        light: CubeMap | PlaneLight = self.cube
        source: EnvironmentSampler | PlaneLight = self.sampler
        if self.planes is not None:
            light = source = self.planes.at(at)
        frames = self.frames[at]
        wo = np.broadcast_to(self.views[at][:, None, :], (*u.shape[:2], 3))
        local_m, world_m = material_directions(self.material, frames, wo, u[..., :2])
        world_e = source.sample(u[..., 2:])
        local_e = local_directions(frames, world_e)
        total = np.zeros((*u.shape[:2], 3))
        for local, world in ((local_m, world_m), (local_e, world_e)):
            factor = weighted_bsdf(self.material, local, wo, source.pdf(world))
            total += light.lookup(world) * factor
        return total


def _row_sums(x: Float64Array) -> Float64Array:
    """Sum over the axis before the last, in an order that does not depend on the rest."""
    return np.asarray(np.ascontiguousarray(np.moveaxis(x, -2, -1)).sum(axis=-1))


def _passes(draws: int, step: int) -> Iterator[tuple[int, int]]:
    """(first, last) of each pass in units of ``step`` draws: the total doubles, and ends at all."""
    last = -(-draws // step)
    first, end = 0, min(max(FIRST_PASS // step, 1), last)
    while first < last:
        yield first, end
        first, end = end, min(2 * end, last)


def monte_carlo(draws: Draws, index: IntArray, samples: int, seed: int) -> Iterator[Pass]:
    """Yield radiance (K, 3), standard error (K, 3) and samples per point after each pass.

    ``index`` (K,): the points' flat indices. ``samples``: evaluations of the BSDF per point.
    """
    size, cost = len(index), draws.evaluations
    mean, spread = np.zeros((size, 3)), np.zeros((size, 3))
    for start, stop in _passes(-(-samples // cost), 1):
        for first in range(start, stop, BLOCK):
            count = min(BLOCK, stop - first)
            for at in _chunks(size, count):
                x = draws.values(at, uniform(seed, index[at], first, count, draws.dimensions))
                own = _row_sums(x) / count
                square = _row_sums((x - own[:, None, :]) ** 2)
                gap = own - mean[at]  # means and squares of two sets joined
                mean[at] += gap * (count / (first + count))
                spread[at] += square + gap**2 * (first * count / (first + count))
        variance = spread / max(stop - 1, 1)
        error = np.sqrt(variance / stop) if stop > 1 else np.full_like(mean, np.inf)
        yield mean.copy(), error, cost * stop


def quasi_monte_carlo(draws: Draws, index: IntArray, samples: int, seed: int) -> Iterator[Pass]:
    """As ``monte_carlo``, with randomised low-discrepancy points."""
    size, cost = len(index), draws.evaluations
    total = np.zeros((size, REPLICATES, 3))
    block = BLOCK // REPLICATES
    for start, stop in _passes(-(-samples // cost), REPLICATES):
        for first in range(start, stop, block):
            count = min(block, stop - first)
            for at in _chunks(size, REPLICATES * count):
                u = sobol(seed, index[at], first, count, draws.dimensions, REPLICATES)
                x = draws.values(at, u.reshape(len(u), -1, draws.dimensions))
                total[at] += _row_sums(x.reshape(len(u), REPLICATES, count, 3))
        means = total / stop
        mean = _row_sums(means) / REPLICATES
        spread = _row_sums((means - mean[:, None, :]) ** 2)
        error = np.sqrt(spread / (REPLICATES * (REPLICATES - 1)))
        yield mean, error, cost * REPLICATES * stop


def _chunks(points: int, draws: int) -> Iterator[slice]:
    """Slices of the points that fit the memory set aside."""
    step = max(1, CHUNK // draws)
    for first in range(0, points, step):
        yield slice(first, first + step)
