"""Exact resampling of a lat-long picture onto cube faces, by line integrals.

With azimuth phi and y = cos(theta) the solid angle is d omega = d phi dy. Let f be the radiance of
the picture and G its integral from the pole down to y. The power that falls on a cube texel is then
a line integral around the texel's border (Green's theorem)::

    power = integral f d omega = closed integral of G(phi, y) d phi,   G = integral_y^1 f dy     (1)

Neighbouring texels share their border with opposite signs, so no power is lost or counted twice
whatever the accuracy along one edge (``arcs``).

``TEXELS``: f is constant on each texel of the picture. ``CENTRES``, ``POLES``: f is bilinear. The
rows of ``CENTRES`` are half a texel from the poles, and f is linear in y between the nodes ::

    y_i = cos((i + 1/2) pi/H) / cos(pi/2H)                                                      (2)

for which half the distance between a node's two neighbours is exactly the texel's own extent in y,
so that each source texel gives the power radiance x solid angle, at the poles too (the first node
is the pole). The rows of ``POLES`` lie at theta_i = i pi/(H-1) and f is linear in theta.
"""

import math

import numpy as np
import numpy.typing as npt

from . import _check
from ._jit import row_kernel
from ._threads import in_rows
from .arcs import CENTRES, POLES, STEP, TEXELS, k_partial, k_walk

__all__ = ["CENTRES", "POLES", "TEXELS", "resample", "row_nodes"]

STRIP = 32  # rows of a face that one task resamples: its edges stay in the cache
COLUMNS = 64  # columns of the picture that one task sums

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def row_nodes(rule: int, height: int) -> Float64Array:
    """The y = cos(theta) between which f has one formula: texel edges, or nodes of eq. (2)."""
    if rule == TEXELS:
        y = np.cos(np.arange(height + 1) * (np.pi / height))
    elif rule == CENTRES:
        y = np.cos((np.arange(height) + 0.5) * (np.pi / height)) / np.cos(0.5 * np.pi / height)
    else:
        y = np.cos(np.arange(height) * (np.pi / (height - 1)))
    y[0], y[-1] = 1.0, -1.0
    return np.asarray(y)


@row_kernel
def _cumulate(
    begin: int,
    end: int,
    rule: int,
    pixels: Float32Array,
    y: Float64Array,
    first: int,
    last: int,
    out: Float64Array,
) -> None:
    # G at the nodes y, (len(y), W, 3), from node first, where it is 0, to node last
    height, width = pixels.shape[0], pixels.shape[1]
    for task in range(begin, end):
        low, high = task * COLUMNS, min(width, (task + 1) * COLUMNS)
        for k in range(low, high):
            for c in range(3):
                out[first, k, c] = 0.0
        for i in range(abs(last - first)):
            r = first + i if last > first else first - 1 - i
            extent = y[r] - y[r + 1]
            second = 0.0
            if rule != TEXELS:
                second = k_partial(rule, y[r + 1], y[r], y[r + 1], math.pi / (height - 1.0))
            for k in range(low, high):
                for c in range(3):
                    part = pixels[r, k, c] * extent
                    if rule != TEXELS:
                        part += (pixels[r + 1, k, c] - np.float64(pixels[r, k, c])) * second
                    if last > first:
                        out[r + 1, k, c] = out[r, k, c] + part
                    else:
                        out[r, k, c] = out[r + 1, k, c] - part


@row_kernel
def _resample(
    begin: int,
    end: int,
    rule: int,
    pixels: Float32Array,
    cumulated: Float64Array,
    nodes: Float64Array,
    columns: Float64Array,
    frames: Float64Array,
    faces: IntArray,
    sign: float,
    omega: Float64Array,
    low: Float64Array,
    high: Float64Array,
    out: Float32Array,
) -> None:
    # frames (6, 3, 3): centre, direction of s and of t of each face in the picture's axes
    size = out.shape[1]
    strips = (size + STRIP - 1) // STRIP
    for task in range(begin, end):
        face = faces[task // strips]
        top = (task % strips) * STRIP
        rows = min(STRIP, size - top)
        centre = (frames[face, 0, 0], frames[face, 0, 1], frames[face, 0, 2])
        ds = (frames[face, 1, 0], frames[face, 1, 1], frames[face, 1, 2])
        dt = (frames[face, 2, 0], frames[face, 2, 1], frames[face, 2, 2])
        across = np.empty((rows + 1, size, 3))
        down = np.empty((size + 1, rows, 3))
        for i in range(rows + 1):
            t = (2.0 * (top + i) - size) / size
            base = (centre[0] + t * dt[0], centre[1] + t * dt[1], centre[2] + t * dt[2])
            k_walk(rule, pixels, cumulated, nodes, columns, base, ds, size, 0, across[i])
        for j in range(size + 1):
            s = (2.0 * j - size) / size
            base = (centre[0] + s * ds[0], centre[1] + s * ds[1], centre[2] + s * ds[2])
            k_walk(rule, pixels, cumulated, nodes, columns, base, dt, size, top, down[j])
        for i in range(rows):
            for j in range(size):
                for c in range(3):
                    loop = across[i, j, c] + down[j + 1, i, c] - across[i + 1, j, c] - down[j, i, c]
                    value = sign * loop / omega[top + i, j]
                    out[face, top + i, j, c] = min(max(value, low[c]), high[c])


def _refine(pixels: Float32Array, rule: int) -> tuple[Float32Array, int]:
    # the same function of direction with columns no wider than STEP, and how many per column
    height, width = pixels.shape[:2]
    m = math.ceil(2.0 * math.pi / (STEP * width))
    if m == 1:
        return pixels, 1
    if rule == TEXELS:
        return _check.frozen(np.repeat(pixels, m, axis=1)), m
    f = (np.arange(m) / m)[None, None, :, None]
    wide = pixels.astype(np.float64)[:, :, None]
    fine = wide * (1.0 - f) + np.roll(wide, -1, axis=1) * f
    return _check.frozen(fine.reshape(height, width * m, 3).astype(np.float32)), m


def resample(
    pixels: Float32Array,
    rule: int,
    frames: Float64Array,
    omega: Float64Array,
    sign: float,
    low: Float64Array,
    high: Float64Array,
) -> Float32Array:
    """Mean radiance over each cube texel of a lat-long picture, eq. (1).

    Parameters
    ----------
    pixels : (H, W, 3) float32, read-only
        Row 0 at theta = 0, column 0 from azimuth 0 on (its centre half a texel further).
    rule : TEXELS, CENTRES or POLES
        What the picture is between its texel centres.
    frames : (6, 3, 3) float64
        Centre, direction of s and direction of t of each face, in the picture's axes.
    omega : (N, N) float64
        Solid angles of a face's texels.
    sign : +1 or -1
        -1 where the picture's axes are mirrored against the cube's.
    low, high : (3,) float64
        Least and largest value of each channel: a mean stays between them.

    Returns
    -------
    (6, N, N, 3) float32: the mean, to single precision for TEXELS; a bilinear picture's is off by
    up to 1e-4 of the largest radiance in a texel's reach. All keep power to single precision.
    """
    height = pixels.shape[0]
    source, refined = _refine(pixels, rule)
    width = source.shape[1]
    nodes = row_nodes(rule, height)
    begin = 0.0 if rule == TEXELS else 0.5 * refined
    angle = (np.arange(width) + begin) * (2.0 * np.pi / width)
    columns = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    out = np.empty((6, *omega.shape, 3), dtype=np.float32)
    cumulated = np.empty((nodes.size, width, 3))
    reach = math.acos(1.0 / math.sqrt(3.0)) + 1e-6  # from a face's centre to its corner
    for south in (False, True):  # G = 0 at the pole that a face can hold
        faces = np.flatnonzero((frames[:, 0, 1] < 0.0) == south)
        polar = np.arccos(np.clip(frames[faces, 0, 1], -1.0, 1.0))
        if south:
            end = np.searchsorted(-nodes, -math.cos(max(polar.min() - reach, 0.0))) - 1
            ends = nodes.size - 1, max(int(end) - 1, 0)
        else:
            end = np.searchsorted(-nodes, -math.cos(min(polar.max() + reach, math.pi)))
            ends = 0, min(int(end) + 1, nodes.size - 1)
        strips = -(-source.shape[1] // COLUMNS)
        in_rows(_cumulate, strips, rule, source, nodes, *ends, cumulated)
        shared = (rule, source, cumulated, nodes, columns, frames, faces, sign, omega, low, high)
        in_rows(_resample, faces.size * -(-out.shape[1] // STRIP), *shared, out)
    return out
