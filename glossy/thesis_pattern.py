"""The thesis's patterns: a ring, a line or several rings of half vectors inside a lobe's border.

Points (xi1, xi2) of the unit square become half vectors by (xi0 is ``threshold``)::

    phi   = atan2(my sin 2 pi xi2, mx cos 2 pi xi2)                                       (1)
    theta = (1 - xi1) arctan sqrt( -ln xi0 / (cos^2 phi / mx^2 + sin^2 phi / my^2) )      (2)

so that xi1 = 1 is the pole and xi1 = 0 the border. n points are, with the longer axis of the lobe
at xi2 = a (0 along the tangent, 1/4 along the bitangent)::

    ring        (1, 0), then (radius, (k - 1) / (n - 1)),  k = 1 .. n - 1                  (3)
    multi-ring  (3) with 1 - xi1 = 2 (1 - radius) j / (rings + 1),  j = 1 .. rings in turn (4)
    line        ((2k + 1)/n, a),  2k < n - 1;   (2 - (2k + 1)/n, a + 1/2) for the others   (5)
    blend       w ring + (1 - w) line,  in the plane (1 - xi1) (cos 2 pi xi2, sin 2 pi xi2) (6)
    auto        line if the ratio of the widths is below ``anisotropy``, else ring

In (6) the points of both patterns are paired in their order along the longer axis, and w rises
smoothly from 0 to 1 while the ratio of the widths goes from half to twice ``anisotropy``.

Source: thesis, eqs. 4.10-4.13 and the text after them, and section 4.5.3. Departures: (1) is
quadrant-correct; the line's printed range of k contradicts its own example. Ours: the radii of (4),
whose mean is the ring's (the thesis names none), the blend, and the value of ``anisotropy``: about
where, at their best bias, line and ring err alike.
"""

import math

import numpy as np
import numpy.typing as npt

from . import _check
from .pattern import MAX_SAMPLES, Pattern, Widths, widths_of

KINDS = ("auto", "ring", "line", "multi-ring", "blend")
ANISOTROPY = 0.4
RADIUS = 0.6
RINGS = 3

Float64Array = npt.NDArray[np.float64]


def _ring(n: int, offsets: Float64Array) -> Float64Array:
    """The pole and n - 1 points (n, 2) of the unit disc at these distances, taken in turn."""
    turn = np.arange(n - 1) * (2.0 * math.pi / max(n - 1, 1))
    points = np.resize(offsets, n - 1)[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return np.concatenate([np.zeros((1, 2)), points])


def _line(n: int, axis: int) -> Float64Array:
    """Eq. (5) as points (n, 2) of the unit disc, from the positive end to the negative one."""
    points = np.zeros((n, 2))
    points[:, axis] = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    return points


def _disc(kind: str, n: int, ratio: float, axis: int, anisotropy: float, radius: float,
          rings: int) -> Float64Array:  # fmt: skip
    """Points (1 - xi1) (cos 2 pi xi2, sin 2 pi xi2), (n, 2)."""
    ring = _ring(n, np.array([1.0 - radius]))
    if kind == "ring":
        return ring
    if kind == "multi-ring":
        return _ring(n, 2.0 * (1.0 - radius) * np.arange(1, rings + 1) / (rings + 1))
    line = _line(n, axis)
    if kind == "line":
        return line
    order = np.lexsort((-ring[:, 1 - axis], -np.round(ring[:, axis], 12)))
    x = min(max(0.5 + 0.5 * math.log2(ratio / anisotropy), 0.0), 1.0)
    w = x * x * (3.0 - 2.0 * x)
    return w * ring[order] + (1.0 - w) * line


def thesis_pattern(
    lobe: Widths,
    samples: int = 7,
    kind: str = "auto",
    threshold: float = 0.01,
    anisotropy: float = ANISOTROPY,
    radius: float = RADIUS,
    rings: int = RINGS,
) -> Pattern:
    """Few half vectors evenly spaced inside the lobe's border, eqs. (1)-(6).

    Parameters
    ----------
    lobe : Lobe or (mx, my)
    samples : int >= 1
        n; the count is exact.
    kind : "auto", "ring", "line", "multi-ring" or "blend"
        "multi-ring" is meant for planar reflectors.
    threshold : float in (0, 1)
        xi0: the share of the lobe's peak at its border.
    anisotropy : float in (0, 1]
        Ratio of the smaller to the larger width below which "auto" takes the line, and about which
        "blend" passes from one to the other.
    radius : float in [0.5, 1)
        xi1 of the ring: 0.6 is 40 % of the way from the centre to the border.
    rings : int >= 1
        Radii of "multi-ring".

    Returns
    -------
    Pattern; ``spacing`` is the kind that was taken, ``circles`` the number of rings.

    Raises
    ------
    ValueError
        For an argument out of range.
    """
    mx, my = widths_of(lobe)
    n = _check.count("samples", samples, 1, MAX_SAMPLES)
    _check.choice("kind", kind, KINDS)
    xi0 = _check.in_range("threshold", threshold, 0.0, 1.0, open_low=True, open_high=True)
    limit = _check.in_range("anisotropy", anisotropy, 0.0, 1.0, open_low=True)
    xi1 = _check.in_range("radius", radius, 0.5, 1.0, open_high=True)
    count = _check.count("rings", rings)
    ratio, axis = min(mx, my) / max(mx, my), 0 if mx >= my else 1
    if kind == "auto":
        kind = "line" if ratio < limit else "ring"
    disc = _disc(kind, n, ratio, axis, limit, xi1, count)
    disc[np.abs(disc) < 1e-15] = 0.0  # samples on an axis lie on it
    phi = np.arctan2(my * disc[:, 1], mx * disc[:, 0])
    slope = math.sqrt(-math.log(xi0)) / np.hypot(np.cos(phi) / mx, np.sin(phi) / my)
    theta = np.hypot(disc[:, 0], disc[:, 1]) * np.arctan(slope)
    around = np.stack([mx * disc[:, 0], my * disc[:, 1]], axis=-1)
    length = np.hypot(around[:, 0], around[:, 1])[:, None]
    around = np.divide(around, length, out=np.zeros_like(around), where=length > 0.0)
    h = np.concatenate([np.sin(theta)[:, None] * around, np.cos(theta)[:, None]], axis=-1)
    circles = {"ring": 1, "multi-ring": count}.get(kind)
    return Pattern(h, lobe=(mx, my), method="thesis", spacing=kind, circles=circles, threshold=xi0)
