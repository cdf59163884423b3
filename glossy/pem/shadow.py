"""Variance shadow maps of distant lights, softened by the size of what each light stands for.

A light's depth map z (``depth`` eq. (1)) is kept as its first two moments, blurred by a Gaussian::

    M1 = G * z,  M2 = G * z^2,    standard deviation of G  =  softness theta R             (1)
    Omega = 2 pi (1 - cos theta)                                                           (2)

theta is the angular radius of a disc of the region's solid angle Omega, R the radius of the scene's
bounding sphere: a disc of radius theta blurs the edge of a blocker a distance D away by theta D / 2
(standard deviation along an axis), so ``softness`` is half the distance, in radii, at which the
shadow is as soft as it should be. The width thus grows as the root of the region's area.

A receiver at depth t sees the share of the blurred texels that are no nearer to the light, of
which one-sided Chebyshev's inequality knows a bound::

    p = 1 if t - bias <= M1, else  var / (var + (t - bias - M1)^2)                         (3)
    var = max(M2 - M1^2, variance) + (texel tan(n, l))^2 / 4                               (4)
    lit = clamp((p - bleeding) / (1 - bleeding))                                           (5)

The last term of (4) is the spread of depths that the receiver's own slope has within a texel of the
map. (5) cuts the tail off, where light bleeds: behind two blockers one above the other the variance
is large and (3) is no longer tight. What of the light's disc is below the receiver's horizon is
hidden by the receiver itself; with e the elevation of its centre, h = clamp(e / theta, -1, 1) ::

    horizon = 1/2 + (h sqrt(1 - h^2) + asin h) / pi,    visibility = lit horizon           (6)

on request: visibility is then what rays over the region find, but a lobe whose reflectivity
already ends at the horizon loses that part twice.

Sources: Donnelly and Lauritzen 2006 (3); Lauritzen, GPU Gems 3, chapter 8 (4), (5); Knuth et al.
3.3 for the blur by the region's area, of which they give no constant. (2) and (6) are ours.
"""

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from ..frames import SurfacePoints
from ..scenes.geometry import Geometry
from .depth import LightSpace, depth_maps, light_space
from .truth import check_geometry, place

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
FloatArray = npt.NDArray[np.floating]
Int64Array = npt.NDArray[np.int64]

STORAGE = {"rg32f": 8, "rg16f": 4}  # bytes a texel
REACH = 3.0  # standard deviations at which the blur ends
MAX_SIZE = 4096
LIGHTS = 24  # lights whose maps are worked on at a time


@row_kernel
def _blur(
    begin: int,
    end: int,
    source: Float32Array,
    weights: Float32Array,
    reach: Int64Array,
    out: Float32Array,
) -> None:
    """Blur rows of (C, S, S) across and write them as columns; beyond the map is ``FAR``.

    ``weights`` (C, taps): from the middle outwards, ``reach`` (C,) of them beside the middle. Both
    powers of FAR are 1.
    """
    size = source.shape[1]
    for job in range(begin, end):
        c, row = job // size, job % size
        n = reach[c]
        line = np.ones(size + 2 * n, dtype=np.float32)
        line[n : n + size] = source[c, row]
        total = np.empty(size, dtype=np.float32)
        middle = weights[c, 0]
        for i in range(size):
            total[i] = middle * line[n + i]
        for k in range(1, n + 1):
            w = weights[c, k]
            for i in range(size):
                total[i] += w * (line[n + i - k] + line[n + i + k])
        for i in range(size):
            out[c, i, row] = total[i]


def gaussian(sigma: float) -> Float32Array:
    """Weights of a Gaussian of ``sigma`` texels, from its middle outwards; both sides sum to 1."""
    n = math.ceil(REACH * sigma)
    w = np.exp(-0.5 * np.square(np.arange(n + 1) / max(sigma, 1e-9)))
    return np.asarray(w / (2.0 * w.sum() - w[0]), dtype=np.float32)


def _stored(moments: Float32Array, storage: str) -> Float32Array:
    """Moments as a texture of the format holds them."""
    return moments.astype(np.float16).astype(np.float32) if storage == "rg16f" else moments


def blurred_moments(depth: Float32Array, sigma: Float64Array, storage: str) -> Float32Array:
    """Eq. (1): (R, 2, S, S) from depths (R, S, S) and widths (R,) in texels."""
    rows = [gaussian(s) for s in sigma]
    reach = np.array([len(w) - 1 for w in rows for _ in range(2)])
    weights = np.zeros((2 * len(rows), reach.max() + 1), dtype=np.float32)
    for j, w in enumerate(rows):
        weights[2 * j : 2 * j + 2, : len(w)] = w
    raw = _stored(np.stack([depth, np.square(depth)], axis=1), storage)
    count, _, size, _ = raw.shape
    flat, once = raw.reshape(2 * count, size, size), np.empty((2 * count, size, size), np.float32)
    frozen = _check.frozen(weights), _check.frozen(reach)
    lines = flat.shape[0] * flat.shape[1]
    in_rows(_blur, lines, _check.frozen(flat), *frozen, once, grain=16)
    twice = np.empty_like(once)
    in_rows(_blur, lines, _check.frozen(_stored(once, storage)), *frozen, twice, grain=16)
    return _stored(twice, storage).reshape(count, 2, size, size)


@kernel
def k_lit(
    m1: Scalar, m2: Scalar, t: Scalar, least: Scalar, slope: Scalar, bleeding: Scalar
) -> Scalar:
    """Eqs. (3)-(5) for a biased depth ``t``; ``slope`` is the last term of (4)."""
    away = t - m1
    if away <= 0.0:
        return 1.0
    var = max(m2 - m1 * m1, least) + slope
    p = var / (var + away * away)
    return max(p - bleeding, 0.0) / (1.0 - bleeding)


@kernel
def k_horizon(cosine: Scalar, theta: Scalar) -> Scalar:
    """Eq. (6): the share of a disc of angular radius ``theta`` above the horizon."""
    h = min(max(math.asin(min(max(cosine, -1.0), 1.0)) / theta, -1.0), 1.0)
    return 0.5 + (h * math.sqrt(1.0 - h * h) + math.asin(h)) / math.pi


@row_kernel
def _visibility(
    begin: int,
    end: int,
    places: Float64Array,
    normals: Float64Array,
    frames: Float64Array,
    thetas: Float64Array,
    moments: Float32Array,
    bias: Scalar,
    least: Scalar,
    bleeding: Scalar,
    horizon: bool,
    out: Float32Array,
) -> None:
    # (K, 3) in units of the light space, (K, 3), (R, 3, 3), (R,), (R, 2, S, S), ..., (K, R)
    size = moments.shape[2]
    texel = 2.0 / size
    for k in range(begin, end):
        x, y, z = places[k, 0], places[k, 1], places[k, 2]
        for r in range(frames.shape[0]):
            f = frames[r]
            cosine = f[2, 0] * normals[k, 0] + f[2, 1] * normals[k, 1] + f[2, 2] * normals[k, 2]
            share = k_horizon(cosine, thetas[r]) if horizon else 1.0
            if share <= 0.0:
                out[k, r] = 0.0
                continue
            a = (f[0, 0] * x + f[0, 1] * y + f[0, 2] * z + 1.0) / texel - 0.5
            b = (f[1, 0] * x + f[1, 1] * y + f[1, 2] * z + 1.0) / texel - 0.5
            if not (-1.0 < a < size and -1.0 < b < size):
                out[k, r] = share  # beside the scene
                continue
            t = min(-(f[2, 0] * x + f[2, 1] * y + f[2, 2] * z), 1.0)  # nothing is beyond FAR
            i = min(max(math.floor(a), 0), size - 2)
            j = min(max(math.floor(b), 0), size - 2)
            u = min(max(a - i, 0.0), 1.0)
            v = min(max(b - j, 0.0), 1.0)
            m = moments[r]
            m1 = (1.0 - v) * ((1.0 - u) * m[0, j, i] + u * m[0, j, i + 1])
            m1 += v * ((1.0 - u) * m[0, j + 1, i] + u * m[0, j + 1, i + 1])
            m2 = (1.0 - v) * ((1.0 - u) * m[1, j, i] + u * m[1, j, i + 1])
            m2 += v * ((1.0 - u) * m[1, j + 1, i] + u * m[1, j + 1, i + 1])
            square = max(cosine * cosine, 0.01)
            slope = 0.25 * texel * texel * (1.0 - square) / square
            out[k, r] = share * k_lit(m1, m2, t - bias, least, slope, bleeding)


@dataclasses.dataclass(frozen=True)
class ShadowMaps:
    """Blurred moments of the depths that distant lights see.

    Made by ``shadow_maps``. ``space``: coordinates; ``angles`` (R,): theta of eq. (2); ``moments``
    (R, 2, S, S); ``softness``, ``bias``, ``variance``, ``bleeding``, ``storage``, ``horizon`` as
    given.
    """

    space: LightSpace
    angles: Float64Array
    moments: Float32Array
    softness: float
    bias: float
    variance: float
    bleeding: float
    storage: str
    horizon: bool

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def size(self) -> int:
        """Texels along a map's edge."""
        return int(self.moments.shape[2])

    @property
    def nbytes(self) -> int:
        """Bytes the maps take as textures of their format, two channels a texel."""
        return len(self) * self.size**2 * STORAGE[self.storage]

    def visibility(self, points: SurfacePoints) -> Float32Array:
        """Visibility (..., R) of every light from the points, eq. (5) or (6); 0 where masked.

        Raises
        ------
        ValueError
            For points without positions.
        """
        x = (place(points) - self.space.centre) / self.space.radius
        seen = np.flatnonzero(points.coverage)
        normal = points.normal.reshape(-1, 3)[seen]
        part = np.empty((len(x), len(self)), dtype=np.float32)
        in_rows(
            _visibility,
            len(x),
            _check.frozen(x),
            _check.frozen(normal),
            _check.frozen(self.space.frames),
            _check.frozen(self.angles),
            _check.frozen(self.moments),
            self.bias,
            self.variance,
            self.bleeding,
            self.horizon,
            part,
            grain=256,
        )
        if points.mask is None:
            return part.reshape(*points.shape, len(self))
        out = np.zeros((points.coverage.size, len(self)), dtype=np.float32)
        out[seen] = part
        return out.reshape(*points.shape, len(self))


def disc_angles(solid_angles: npt.ArrayLike) -> Float64Array:
    """Angular radius [rad] (R,) of discs of solid angles (R,) [sr], eq. (2).

    Raises
    ------
    ValueError
        For solid angles outside (0, 2 pi].
    """
    omega = _check.array("solid_angles", solid_angles).astype(np.float64)
    if omega.ndim != 1 or not np.all((omega > 0.0) & (omega <= 2.0 * math.pi)):
        raise _check.fail("solid_angles", "must be one list in (0, 2 pi]", omega.tolist())
    return np.asarray(np.arccos(1.0 - omega / (2.0 * math.pi)))


def shadow_maps(
    geometry: Geometry,
    directions: npt.ArrayLike,
    solid_angles: npt.ArrayLike,
    size: int = 256,
    softness: float = 0.04,
    bias: float = 0.002,
    variance: float = 1e-5,
    bleeding: float = 0.2,
    storage: str = "rg32f",
    horizon: bool = False,
) -> ShadowMaps:
    """Variance shadow maps of lights infinitely far away, softened by the lights' size.

    Parameters
    ----------
    geometry : glossy.scenes.Geometry
        What casts shadows.
    directions : (R, 3) array
        Unit, towards the lights.
    solid_angles : (R,) array [sr]
        Of what each light stands for.
    size : int
        Texels along an edge of a map; the map spans the scene's bounding sphere.
    softness : float >= 0
        Of eq. (1); 0 does not blur.
    bias : float >= 0 [bounding radii]
        What a receiver is moved to the light.
    variance : float > 0 [bounding radii squared]
        Least variance of eq. (4).
    bleeding : float in [0, 1)
        Share of eq. (5) that counts as dark.
    storage : "rg32f" or "rg16f"
        Floats, or half floats: the moments are rounded when they are drawn and after each pass of
        the blur.
    horizon : bool
        Multiply by eq. (6), the share of the light above the receiver's horizon.

    Raises
    ------
    ValueError
        For values out of range, or a scene of nothing.
    """
    check_geometry(geometry)
    n = _check.count("size", size, low=2, high=MAX_SIZE)
    soft = _check.in_range("softness", softness, low=0.0)
    move = _check.in_range("bias", bias, low=0.0)
    least = _check.positive("variance", variance)
    tail = _check.in_range("bleeding", bleeding, 0.0, 1.0, open_high=True)
    _check.choice("storage", storage, STORAGE)
    if not isinstance(horizon, bool):
        raise _check.fail("horizon", "must be true or false", horizon)
    space = light_space(geometry, directions)
    theta = disc_angles(solid_angles)
    if len(theta) != len(space.frames):
        raise _check.fail("solid_angles", f"must be {len(space.frames)}", len(theta))
    sigma = 0.5 * n * soft * theta
    moments = np.empty((len(theta), 2, n, n), dtype=np.float32)
    for first in range(0, len(theta), LIGHTS):
        at = slice(first, first + LIGHTS)
        part = dataclasses.replace(space, frames=space.frames[at])
        moments[at] = blurred_moments(depth_maps(geometry, part, n), sigma[at], storage)
    return ShadowMaps(space, theta, moments, soft, move, least, tail, storage, horizon)
