"""Monte Carlo and quasi-Monte Carlo truth: multiple importance sampling of material and light.

Each draw takes one direction from the material's own sampling (density p_m) and one from the
environment (p_e), combined by the balance heuristic, so that neither a sharp lobe nor a tiny lamp
is left to chance::

    X = F(w_m) / (p_m(w_m) + p_e(w_m)) + F(w_e) / (p_m(w_e) + p_e(w_e)),   F = L f abs(cos)   (1)

``mc``: independent draws, standard error from their variance. ``qmc``: sixteen replicates of
randomised Sobol' points, standard error from the spread of their means (fifteen degrees of
freedom).

Draws are made in blocks of fixed size and added in a fixed order, so a point's result depends on
its flat index, the seed and the number of samples alone.
"""

from collections.abc import Iterator
from typing import Any

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


def pair_values(
    material: Any,
    cube: CubeMap | PlaneLight,
    sampler: EnvironmentSampler | PlaneLight,
    frames: Float64Array,
    views: Float64Array,
    u: Float64Array,
) -> Float64Array:
    """Values X (K, S, 3) of eq. (1) for uniform numbers (K, S, 4).

    ``frames`` (K, 3, 3): tangent, bitangent, normal; ``views`` (K, 3): local directions.
    """
    wo = np.broadcast_to(views[:, None, :], (*u.shape[:2], 3))
    axes = frames[:, None]
    local_m = np.asarray(material.sample(np.ascontiguousarray(u[..., :2]), wo), dtype=np.float64)
    world_m = (
        local_m[..., :1] * axes[..., 0, :]
        + local_m[..., 1:2] * axes[..., 1, :]
        + local_m[..., 2:] * axes[..., 2, :]
    )
    world_e = sampler.sample(u[..., 2:])
    local_e = np.stack([dot(world_e, axes[..., k, :]) for k in range(3)], axis=-1)
    total = np.zeros((*u.shape[:2], 3))
    for local, world in ((local_m, world_m), (local_e, world_e)):
        f = np.asarray(material.eval(local, wo), dtype=np.float64)
        f = f[..., None] if f.ndim == 2 else f
        density = np.asarray(material.pdf(local, wo)) + sampler.pdf(world)
        weight = np.abs(local[..., 2]) / np.where(density > 0.0, density, np.inf)
        total += cube.lookup(world) * f * weight[..., None]
    return total


def _row_sums(x: Float64Array) -> Float64Array:
    """Sum over the axis before the last, in an order that does not depend on the rest."""
    return np.asarray(np.ascontiguousarray(np.moveaxis(x, -2, -1)).sum(axis=-1))


def _passes(samples: int, draws: int) -> Iterator[tuple[int, int]]:
    """(first, last) draw of each pass: the total doubles, and ends at samples / 2 draws."""
    last = -(-samples // (2 * draws))
    first, end = 0, min(max(FIRST_PASS // draws, 1), last)
    while first < last:
        yield first, end
        first, end = end, min(2 * end, last)


def monte_carlo(
    material: Any,
    cube: CubeMap,
    frames: Float64Array,
    views: Float64Array,
    index: IntArray,
    samples: int,
    seed: int,
    planes: PlaneLight | None = None,
) -> Iterator[Pass]:
    """Yield radiance (K, 3), standard error (K, 3) and samples per point after each pass.

    ``planes`` stands for the cube map where light depends on the place.
    """
    sampler = EnvironmentSampler(cube)
    mean, spread = np.zeros((len(views), 3)), np.zeros((len(views), 3))
    for start, stop in _passes(samples, 1):
        for first in range(start, stop, BLOCK):
            count = min(BLOCK, stop - first)
            for at in _chunks(len(views), count):
                u = uniform(seed, index[at], first, count, 4)
                light, source = (cube, sampler) if planes is None else (planes.at(at),) * 2
                x = pair_values(material, light, source, frames[at], views[at], u)
                own = _row_sums(x) / count
                square = _row_sums((x - own[:, None, :]) ** 2)
                gap = own - mean[at]  # means and squares of two sets joined
                mean[at] += gap * (count / (first + count))
                spread[at] += square + gap**2 * (first * count / (first + count))
        variance = spread / max(stop - 1, 1)
        error = np.sqrt(variance / stop) if stop > 1 else np.full_like(mean, np.inf)
        yield mean.copy(), error, 2 * stop


def quasi_monte_carlo(
    material: Any,
    cube: CubeMap,
    frames: Float64Array,
    views: Float64Array,
    index: IntArray,
    samples: int,
    seed: int,
    planes: PlaneLight | None = None,
) -> Iterator[Pass]:
    """As ``monte_carlo``, with randomised low-discrepancy points."""
    sampler = EnvironmentSampler(cube)
    total = np.zeros((len(views), REPLICATES, 3))
    block = BLOCK // REPLICATES
    for start, stop in _passes(samples, REPLICATES):
        for first in range(start, stop, block):
            count = min(block, stop - first)
            for at in _chunks(len(views), REPLICATES * count):
                u = sobol(seed, index[at], first, count, 4, REPLICATES)
                flat = u.reshape(len(u), -1, 4)
                light, source = (cube, sampler) if planes is None else (planes.at(at),) * 2
                x = pair_values(material, light, source, frames[at], views[at], flat)
                total[at] += _row_sums(x.reshape(len(u), REPLICATES, count, 3))
        means = total / stop
        mean = _row_sums(means) / REPLICATES
        spread = _row_sums((means - mean[:, None, :]) ** 2)
        yield mean, np.sqrt(spread / (REPLICATES * (REPLICATES - 1))), 2 * REPLICATES * stop


def _chunks(points: int, draws: int) -> Iterator[slice]:
    """Slices of the points that fit the memory set aside."""
    step = max(1, CHUNK // draws)
    for first in range(0, points, step):
        yield slice(first, first + step)
