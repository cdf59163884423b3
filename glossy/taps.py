"""How wide a pyramid's tap is, and the level whose tap has a given width.

A tap is one trilinear lookup: what it averages of level 0. Its variance per axis, in texels of
level 0, averaged over where the lookup falls between texels, is ::

    sigma^2(0) = 1/6,  sigma^2(l) = a 4^l - b  for l = 1, 2, ...                               (1)
    sigma^2(l + f) = (1 - f) sigma^2(l) + f sigma^2(l + 1)                                     (2)

Each level adds its kernel's variance k (box 1/4, gauss4 3/4, gauss6 5/4 texels of the level above;
pem5 the box's and 4 times that of its five taps), the lookup 1/6 of its own texels: a = k/3 + 1/6,
b = k/3. ``round`` is built to have a = 1, b = 0. On the sphere a texel of level 0 spans ::

    angle = 2 / N d^(-3/2),  d = |w| / |w|_inf                                                 (3)

the square root of its solid angle. For ``round`` this holds for every axis, up to where between
texels the lookup falls (a few percent); for the others it is the geometric mean of axes that
differ by up to 1.4 at the middle of edges and 1.7 at corners. Wide taps: the variance of the heat
kernel, whose mean direction has length exp(-sigma^2).

To look up a Gaussian ``s`` radians wide along w in a kernel: ``k_tap_level(s s N N / 4 d^3, a, b)``
with ``a, b = tap_constants(filter)``.
"""

import numpy as np
import numpy.typing as npt

from . import _check
from ._jit import Scalar, kernel
from .pem_filter import PEM_TAPS

Float64Array = npt.NDArray[np.float64]

_KERNEL_VARIANCE = {
    "box": 0.25,
    "gauss4": 0.75,
    "gauss6": 1.25,
    **{name: 0.25 + 4.0 * (2.0 * b + 8.0 * c) for name, (_, b, c) in PEM_TAPS.items()},
}

BASE = np.float32(1.0 / 6.0)
ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
THIRD, FOUR = np.float32(1.0 / 3.0), np.float32(4.0)


def tap_constants(filter: str) -> tuple[float, float]:
    """Return a and b of eq. (1), in squared texels of level 0.

    Raises
    ------
    ValueError
        For an unknown filter.
    """
    _check.choice("filter", filter, (*_KERNEL_VARIANCE, "round"))
    if filter == "round":
        return 1.0, 0.0
    k = _KERNEL_VARIANCE[filter]
    return k / 3.0 + 1.0 / 6.0, k / 3.0


def tap_width(filter: str, level: npt.ArrayLike) -> Float64Array:
    """Standard deviation (...) of a tap at ``level`` (...), in texels of level 0; eqs. (1), (2).

    Times ``texel_angle`` it is in radians. Levels below 0 count as 0; the chain's end is not known
    here.

    Raises
    ------
    ValueError
        For an unknown filter, or a level that is not finite.
    """
    a, b = tap_constants(filter)
    lod = np.maximum(_check.array("level", level), 0.0)
    if not np.all(np.isfinite(lod)):
        raise _check.fail("level", "must be finite", "NaN or inf")
    first = np.floor(lod)
    f = lod - first
    low, high = (np.where(k > 0.0, a * 4.0**k - b, 1.0 / 6.0) for k in (first, first + 1.0))
    return np.asarray(np.sqrt((1.0 - f) * low + f * high))


def tap_level(filter: str, width: npt.ArrayLike) -> Float64Array:
    """Level (...) whose tap has the standard deviation ``width`` (...), in texels of level 0.

    The inverse of ``tap_width``; 0 for anything narrower than a tap of level 0.

    Raises
    ------
    ValueError
        For an unknown filter, or a width that is not finite or negative.
    """
    a, b = tap_constants(filter)
    w = _check.array("width", width)
    if not np.all(np.isfinite(w)) or np.any(w < 0.0):
        raise _check.fail("width", "must be finite and not negative", width)
    v = w * w
    scaled = np.maximum((v + b) / a, 1.0)
    first = np.floor(0.5 * np.log2(scaled))
    coarse = first + (scaled * 4.0**-first - 1.0) / 3.0
    one = 4.0 * a - b
    fine = np.maximum((v - 1.0 / 6.0) / (one - 1.0 / 6.0), 0.0)
    return np.asarray(np.where(v < one, fine, coarse))


def texel_angle(directions: npt.ArrayLike, size: int) -> Float64Array:
    """What a texel of level 0 spans [rad] along directions (..., 3) of any length, eq. (3)."""
    v = _check.vectors("directions", directions)
    n = _check.count("size", size)
    largest = np.abs(v).max(axis=-1)
    return np.asarray((2.0 / n) * (np.linalg.norm(v, axis=-1) / largest) ** -1.5)


@kernel
def k_tap_level(variance: Scalar, a: Scalar, b: Scalar) -> Scalar:
    """``tap_level`` of a variance in squared texels of level 0, with ``tap_constants``."""
    one = FOUR * a - b
    if variance < one:
        return max((variance - BASE) / (one - BASE), ZERO)
    scaled = (variance + b) / a
    first = np.floor(HALF * np.log2(scaled))
    return first + (scaled * np.exp2(-(first + first)) - ONE) * THIRD
