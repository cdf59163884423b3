"""Which views candidates are measured on: those of a picture, or any.

A picture of up to ``MOST`` points is measured whole. Of a larger one ``LOOKED_AT`` points, one from
each of as many equal runs, get a rough radiance q_i (``ROUGH`` lattice taps a lobe); ``MOST`` of
them are drawn, one from each equal part of the sum of p ::

    p_i = 1/2 1/n + 1/2 q_i^2 / sum_j q_j^2,   w_i = 1 / p_i                                  (1)

so that the errors of bright points, which count most, are sampled best and no point is left out of
reach. Where the views are not known, narrow ones stand for them: ``PLANES`` planes of any normal,
each seen under an angle of up to ``STEEPEST`` by a camera of a field of some 20 by 40 degrees, and
``AIMED`` more, of which each mirrors a bright texel of one of the levels of ``SIZES``. The squared
error of any picture over its power is a mean of that of its parts, so no picture made of such views
is worse than the worst of them.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from ..brdf import Material
from ..cubemap import face_directions
from ..frames import (
    SurfacePoints,
    normalise,
    reflect,
    sphere_tangent,
    spherical,
    to_local,
    to_world,
)
from ..pyramid import Pyramid
from .model import Candidate, run_candidate

Float64Array = npt.NDArray[np.float64]

MOST = 1024
LOOKED_AT = 1 << 14
ROUGH = 4
PLANES, AIMED, EACH = 256, 64, 4
STEEPEST = 80.0  # degrees
FIELD = (10.0, 20.0)  # degrees in polar angle and in azimuth (on the sphere), to each side
SIZES = (4, 16, 64, 256)  # of the levels whose bright texels are looked for
SEED = 20


@dataclasses.dataclass(frozen=True, eq=False)
class Views:
    """Points (P,) and their weights (P,).

    ``group``: how many consecutive points are one narrow view, 0 for those of a picture;
    ``complete``: whether every point of the picture is there.
    """

    points: SurfacePoints
    weight: Float64Array
    group: int = 0
    complete: bool = False


def looked_at(points: SurfacePoints) -> SurfacePoints:
    """The seen points, or one drawn from each of ``LOOKED_AT`` equal runs of them."""
    seen = np.flatnonzero(points.coverage)
    if len(seen) > LOOKED_AT:
        place = np.arange(LOOKED_AT) + np.random.default_rng(SEED).random(LOOKED_AT)
        seen = seen[(place * (len(seen) / LOOKED_AT)).astype(np.int64)]
    rows = (a.reshape(-1, 3)[seen] for a in (points.normal, points.tangent, points.view))
    return SurfacePoints(*rows)


def of_picture(points: SurfacePoints, material: Material, pyramid: Pyramid) -> Views:
    """The points of a picture that are measured, eq. (1)."""
    some = looked_at(points)
    n = len(some.normal)
    if n <= MOST:
        return Views(some, np.ones(n), complete=True)
    rough = run_candidate(Candidate("lattice", ROUGH), some, material, pyramid)
    square = np.sum(np.square(rough, dtype=np.float64), axis=-1)
    p = np.full(n, 1.0 / n)
    if square.any():
        p = 0.5 * p + 0.5 * square / square.sum()
    place = (np.arange(MOST) + np.random.default_rng(SEED).random(MOST)) / MOST
    pick = np.minimum(np.searchsorted(np.cumsum(p), place, side="right"), n - 1)
    return Views(some[pick], 1.0 / p[pick])


def _bright(pyramid: Pyramid, count: int, rng: np.random.Generator) -> Float64Array:
    """Directions (<= count, 3) of texels, drawn by squared radiance from each of several levels."""
    sizes = [level.shape[1] for level in pyramid.levels]
    levels = [k for k, n in enumerate(sizes) if n in SIZES or (k == 0 and n < SIZES[-1])]
    found = [np.zeros((0, 3))]
    for k in levels:
        share = np.sum(np.square(pyramid.levels[k], dtype=np.float64), axis=-1)
        if share.any():
            pick = rng.choice(share.size, count // len(levels), p=(share / share.sum()).reshape(-1))
            face, row, column = np.unravel_index(pick, share.shape)
            s, t = (2.0 * (i + rng.random(pick.shape)) / sizes[k] - 1.0 for i in (column, row))
            found.append(normalise(face_directions(face, s, t)))
    return np.concatenate(found)


def any_views(pyramid: Pyramid) -> Views:
    """Narrow views of planes; those of the first ``PLANES`` planes weigh 1, aimed ones 0."""
    rng = np.random.default_rng(SEED)
    light = _bright(pyramid, AIMED, rng)
    mirrored = np.concatenate([normalise(rng.normal(size=(PLANES, 3))), light])
    planes = len(mirrored)
    theta, turn = np.radians(STEEPEST) * rng.random(planes), 2.0 * np.pi * rng.random(planes)
    normal = normalise(to_world(spherical(theta, turn), sphere_tangent(mirrored), mirrored))
    tangent = sphere_tangent(normal)
    centre = to_local(reflect(mirrored, normal), tangent, normal)
    aside = np.radians(FIELD)[:, None, None] * rng.uniform(-1.0, 1.0, (2, planes, EACH))
    aside[:, :, 0] = 0.0  # the first view is the middle one
    polar = np.clip(theta[:, None] + aside[0], 0.0, np.radians(STEEPEST))
    across = np.clip(aside[1] / np.sin(np.maximum(polar, 1e-3)), -np.pi, np.pi)
    local = spherical(polar, np.arctan2(centre[:, 1], centre[:, 0])[:, None] + across)
    n, t = (np.repeat(v, EACH, axis=0) for v in (normal, tangent))
    view = to_world(local.reshape(-1, 3), t, n)
    weight = np.repeat(np.arange(planes) < PLANES, EACH).astype(np.float64)
    return Views(SurfacePoints(n, t, view), weight, group=EACH)
