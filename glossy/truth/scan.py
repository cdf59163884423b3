"""Where an unknown material may hide a lobe: a scan of the sphere that climbs what it finds.

Directions are tried evenly over the sphere; in rings of half vectors about the normal, from 1e-5 of
slope on, whose reflections a lobe of microfacets cannot miss, above the surface and mirrored below
it; and in rings about the view and its opposite. From the highest of them, each in a neighbourhood
of its own, steps go uphill and shrink by ``SHRINK``, until a lobe as narrow as ``FINEST`` has been
followed to its top and tried on all scales around it. What no step meets stays unknown.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..frames import normalise, reflect
from ..lowdiscrepancy import hammersley

Float64Array = npt.NDArray[np.float64]

EVEN = 2048  # directions over the sphere, .08 apart
RINGS = np.concatenate([[0.0], np.geomspace(1e-5, 3.0, 16)])
SPOKES = np.arange(8) * (np.pi / 4.0)
CLIMBERS, APART = 16, 0.2
WIDEST, FINEST, SHRINK = 0.1, 1e-5, 0.6


def _sphere() -> Float64Array:
    """(EVEN, 3) directions of equal solid angle."""
    u = hammersley(EVEN)
    z, phi = 2.0 * u[:, 0] - 1.0, 2.0 * np.pi * u[:, 1]
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)


def _slopes() -> Float64Array:
    """(n, 3) vectors (x, y, 1), x and y on rings and spokes."""
    x, y = np.multiply.outer(RINGS, np.cos(SPOKES)), np.multiply.outer(RINGS, np.sin(SPOKES))
    return np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)


_EVEN, _SLOPES = _sphere(), _slopes()


def _around(axis: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Two unit vectors (..., 3) across unit axes (..., 3)."""
    least = np.eye(3)[np.argmin(np.abs(axis), axis=-1)]
    first = normalise(np.cross(axis, least))
    return first, np.cross(axis, first)


def _starts(wo: Float64Array) -> Float64Array:
    """(n, 3) directions: even, and where lobes of the usual kinds are."""
    glossy = reflect(np.broadcast_to(wo, _SLOPES.shape), normalise(_SLOPES))
    first, second = _around(wo)
    back = normalise(_SLOPES @ np.stack([first, second, wo]))
    return np.concatenate([_EVEN, glossy, glossy * [1.0, 1.0, -1.0], back, -back])


def _highest(directions: Float64Array, height: Float64Array) -> Float64Array:
    """The ``CLIMBERS`` directions of most height above 0, no two closer than ``APART``."""
    order = np.argsort(-height, kind="stable")
    left = directions[order[height[order] > 0.0]]
    found: list[Float64Array] = []
    while len(left) and len(found) < CLIMBERS:
        found.append(left[0])
        left = left[left @ left[0] < np.cos(APART)]
    return np.array(found).reshape(-1, 3)


def scan(
    lobe: Callable[[Float64Array], Float64Array], wo: Float64Array, own: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Directions (n, 3) that were tried and what ``lobe`` is there, (n, 3) of RGB.

    ``lobe`` takes local directions (..., 3); ``wo`` (3,) is the view; ``own`` (m, 3) the directions
    that the material's own sampling draws.
    """
    tried = [np.concatenate([own, _starts(wo)])]
    values = [lobe(tried[0])]
    height = np.abs(values[0]).sum(axis=-1)
    top = _highest(tried[0], height)
    best = np.abs(lobe(top)).sum(axis=-1) if len(top) else np.zeros(0)
    step, turn = WIDEST, 0.0
    while len(top) and step > FINEST:
        first, second = _around(top)
        angle = (SPOKES + turn)[:, None, None]
        near = normalise(top + step * (np.cos(angle) * first + np.sin(angle) * second))
        value = lobe(near)
        tried.append(near.reshape(-1, 3))
        values.append(value.reshape(-1, 3))
        rise = np.abs(value).sum(axis=-1)
        pick = rise.argmax(axis=0), np.arange(len(top))
        better = rise[pick] > best
        top = np.where(better[:, None], near[pick], top)
        best = np.maximum(best, rise[pick])
        step, turn = step * SHRINK, turn + 1.0
    return np.concatenate(tried), np.concatenate(values)
