"""How much of each region of an environment points see: rays cast over the whole region.

::

    V_i(x) = 1/Omega_i  integral over region i of V(x, w) dw                                (1)

with V = 1 where a ray leaves the scene, 0 where it meets something or starts below the surface's
horizon. This is what the shadow map of a region's light stands for, and what judges it.

A region is a rectangle on a face of the cube, drawn evenly in the face's plane by low-discrepancy
numbers, every point its own; J, the solid angle per area, weighs the draws.
"""

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from .. import _check
from ..cubemap import face_directions
from ..frames import SurfacePoints
from ..scenes.geometry import Geometry
from ..truth.random import sobol
from .regions import Regions
from .truth import check_geometry, open_rays, place

Float64Array = npt.NDArray[np.float64]

REPLICATES = 8
CHUNK = 1 << 18  # rays at a time


@dataclasses.dataclass(frozen=True, eq=False)
class RegionVisibility:
    """Eq. (1): ``share`` (..., R) and its standard ``error`` (..., R), float64."""

    share: Float64Array
    error: Float64Array


def _drawn(regions: Regions, index: int, u: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Unit directions (..., 3) into a region for numbers (..., 2), and J there (...)."""
    (top, bottom), (left, right) = regions.rows[index], regions.columns[index]
    s = (left + (right - left) * u[..., 0]) * (2.0 / regions.size) - 1.0
    t = (top + (bottom - top) * u[..., 1]) * (2.0 / regions.size) - 1.0
    away = np.sqrt(1.0 + s * s + t * t)
    d = face_directions(regions.face[index], s, t) / away[..., None]
    return d, away**-3.0


def region_visibility(
    points: SurfacePoints,
    geometry: Geometry,
    regions: Regions,
    samples: int = 256,
    seed: int = 0,
    offset: float | None = None,
) -> RegionVisibility:
    """Ray-cast visibility of every region from surface points, eq. (1).

    Parameters
    ----------
    points : SurfacePoints
        With positions; masked points see nothing.
    geometry : glossy.scenes.Geometry
        What is in the way.
    regions : Regions
        R parts of an environment, as ``glossy.pem.regions.regions`` makes them.
    samples : int
        Rays a point and region, rounded up to eight sets, whose scatter is the error.
    seed : int
    offset : float, optional [scene units]
        How far along the normal rays start, ``geometry.offset`` by default.

    Raises
    ------
    ValueError
        For points without positions, another geometry, or numbers out of range.
    """
    check_geometry(geometry)
    if not isinstance(regions, Regions):
        raise _check.fail("regions", "must be Regions", type(regions).__name__)
    rays = -(-_check.count("samples", samples) // REPLICATES)
    _check.count("seed", seed, low=0, high=2**32 - 1)
    lift = geometry.offset if offset is None else _check.in_range("offset", offset, low=0.0)
    x = place(points)
    seen = np.flatnonzero(points.coverage.reshape(-1))
    normal = points.normal.reshape(-1, 3)[seen]
    size, count = points.coverage.size, len(regions)
    share, error = np.zeros((size, count)), np.zeros((size, count))
    step = max(CHUNK // (rays * REPLICATES), 1)
    for first in range(0, len(x), step):
        at = slice(first, first + step)
        for i in range(count):
            u = sobol(seed * count + i, seen[at], 0, rays, 2, REPLICATES)
            w, weight = _drawn(regions, i, u)
            axis = np.broadcast_to(normal[at][:, None, None], w.shape)
            start = np.broadcast_to(x[at][:, None, None], w.shape)
            up = np.einsum("...x,...x->...", axis, w) > 0.0
            open_ = np.zeros(up.shape)
            open_[up] = open_rays(geometry, start[up], axis[up], w[up], lift)
            sets = (open_ * weight).sum(axis=-1) / weight.sum(axis=-1)
            share[seen[at], i] = sets.mean(axis=-1)
            error[seen[at], i] = sets.std(axis=-1, ddof=1) / math.sqrt(REPLICATES)
    shape = (*points.shape, count)
    return RegionVisibility(share.reshape(shape), error.reshape(shape))
