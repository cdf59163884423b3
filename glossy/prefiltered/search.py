"""Where the axis of a lobe goes: at the peak, or where a radially symmetric lobe holds most.

* ``peak`` (M section 3): the brightest sample, then a search that zooms in on the function itself.
* ``candidates`` (M section 7): the peak, the reflected direction, the viewer, the normal.
* ``volume`` (M section 7): every cell of a coarse, filtered copy of the slice is tried; the best
  are moved by such a search at full resolution.

The last two take the axis whose minimum profile has the greatest volume (``profiles``).
Brightness is f cos theta_i, the mean of the channels: f itself may have its peak in the horizon,
where it sends nothing.
"""

import math
from collections.abc import Callable

import numpy as np

from .profiles import about, angle_to, tangents
from .slices import Float64Array, Function, Slice
from .stack import ring_solid_angles

SEARCHES = ("peak", "candidates", "volume")
ZOOM = 0.4  # of the neighbourhood from step to step
STEPS = (9, 4)  # such steps, of the peak and of a volume
SIDE = (7, 3)  # directions on a side of the neighbourhood
CURVES = 24  # profile curves while volumes are compared
RINGS = 16  # of the coarse search
COARSE = 640  # cells of the coarse search, about
TRIED = 3  # of the coarse search's best, moved at full resolution

Score = Callable[[Float64Array], Float64Array]
"""Axes (K, 3) to values (K,)."""


def find_axis(
    piece: Slice, rest: Function, value: Float64Array, angles: Float64Array, search: str
) -> Float64Array:
    """Axis (3,) of the next lobe of a slice.

    Parameters
    ----------
    piece : Slice
    rest : function
        What is left of it, wi (..., 3) to (..., C).
    value : (G, C) array
        The same at the samples of the slice.
    angles : (A,) array
        Nodes of the profiles [rad].
    search : "peak", "candidates" or "volume"
    """
    peak = _peak(piece, rest, value)
    if search == "peak":
        return peak

    def volume(axes: Float64Array) -> Float64Array:
        return _volumes(rest, axes, angles)

    mirror = piece.wo * [-1.0, -1.0, 1.0]
    if search == "candidates":
        tried = np.stack([peak, mirror, piece.wo, np.array([0.0, 0.0, 1.0])])
    else:
        found = _coarse(piece, value, angles)
        step = math.sqrt(2.0 * math.pi / COARSE) * min(1.0, 4.0 * piece.scale)
        tried = np.stack([peak, *(_climb(axis, volume, step, 1) for axis in found)])
    return np.asarray(tried[int(np.argmax(volume(tried)))])


def _peak(piece: Slice, rest: Function, value: Float64Array) -> Float64Array:
    """The brightest sample, moved to the nearest peak of the function."""

    def bright(wi: Float64Array, f: Float64Array) -> Float64Array:
        return np.asarray(f.mean(axis=-1) * (wi[:, 2] if piece.cosine_outside else 1.0))

    k = int(np.argmax(bright(piece.wi, value)))
    step = 1.5 * math.sqrt(float(piece.area[k]))
    return _climb(piece.wi[k], lambda wi: bright(wi, rest(wi)), step, 0)


def _climb(axis: Float64Array, score: Score, step: float, kind: int) -> Float64Array:
    """The best of a square of directions about the axis, and again in a smaller one about it."""
    side = SIDE[kind]
    grid = np.linspace(-1.0, 1.0, side)
    x, y = (g.reshape(-1, 1) for g in np.meshgrid(grid, grid))
    for _ in range(STEPS[kind]):
        u, v = tangents(axis)
        near = axis + step * (x * u + y * v)
        near[side * side // 2] = axis
        near /= np.linalg.norm(near, axis=-1, keepdims=True)
        scores = np.where(near[:, 2] > 0.0, score(near), -np.inf)
        # only a true gain moves, so that plateaus and rounding do not
        best = int(np.argmax(scores))
        if scores[best] > scores[side * side // 2] * (1.0 + 1e-9):
            axis = near[best]
        step *= ZOOM
    return axis


def _volumes(rest: Function, axes: Float64Array, angles: Float64Array) -> Float64Array:
    """Volumes (K,) of the least profiles about axes (K, 3), mean of the channels."""
    directions = np.stack([about(axis, angles, CURVES) for axis in axes])
    f = rest(directions).mean(axis=-1)
    up = directions[..., 2] > 0.0
    least = np.where(up, f, np.inf).min(axis=1)
    least = np.where(up.any(axis=1), least, 0.0)
    return np.asarray(least @ ring_solid_angles(angles))


def _coarse(piece: Slice, value: Float64Array, angles: Float64Array) -> list[Float64Array]:
    """The TRIED cells whose least profile on the filtered slice holds most."""
    cell = piece.coarse(COARSE)
    area = np.bincount(cell, piece.area)
    light = np.asarray(np.bincount(cell, piece.area * value.mean(axis=-1)), np.float64) / area
    sums = [np.bincount(cell, piece.area * x) for x in piece.wi.T]
    mean = np.stack(sums, axis=-1).astype(np.float64)
    mean /= np.linalg.norm(mean, axis=-1, keepdims=True)
    edges = np.interp(np.linspace(0.0, 1.0, RINGS + 1), np.linspace(0.0, 1.0, len(angles)), angles)
    rings = 2.0 * math.pi * (np.cos(edges[:-1]) - np.cos(edges[1:]))
    volumes = np.empty(len(mean))
    for k, axis in enumerate(mean):
        at = np.clip(np.searchsorted(edges, angle_to(axis, mean), side="right") - 1, 0, RINGS - 1)
        least = np.full(RINGS, np.inf)
        np.minimum.at(least, at, light)
        # a ring without a cell takes the value of the one inside it; the first has the axis' own
        filled = np.maximum.accumulate(np.where(np.isfinite(least), np.arange(RINGS), 0))
        volumes[k] = rings @ least[filled]
    return [mean[k] for k in np.argsort(-volumes, kind="stable")[:TRIED]]
