"""How well a level stands for a cosine lobe: the filtered impulse against it.

::

    error(s) = integral |h(w)/max h - max(0, c.w)^s| dw / (2 pi/(s + 1))                    (1)

with h the lookup of a white texel in direction c, at the level where both lobes have the same
volume (``glossiness``). Half of it is the part of the volume that is in the wrong place.

Source: Knuth et al., section 5 and Figs. 4 and 5, "the difference between the target lobe and the
approximated lobe when both have the same volume"; (1) is our reading.
"""

import numpy as np
import numpy.typing as npt

from .. import _check
from .glossiness import Impulses, circles, lobe_volume, places

RINGS, AZIMUTHS = 192, 32

Float64Array = npt.NDArray[np.float64]


def lobe_error(
    filter: str,
    size: int,
    exponents: npt.ArrayLike,
    texels: npt.ArrayLike | None = None,
) -> Float64Array:
    """Error of eq. (1), (S, P), for exponents (S,) and white texels (P, 3) of face, row, column.

    Parameters
    ----------
    filter, size : str, int
        Of the pyramid, as for ``calibrate``.
    exponents : (S,) array
    texels : (P, 3) array of int, optional
        Default: the places of the calibration. Each texel's levels are those of its own volume.

    Returns
    -------
    (S, P) float64; NaN where no level has the volume.

    Raises
    ------
    ValueError
        As ``calibrate``, or for an exponent that is not positive.
    """
    s = np.atleast_1d(_check.array("exponents", exponents))
    if not np.all(s > 0.0):
        raise _check.fail("exponents", "must be positive", exponents)
    where = places(size) if texels is None else np.asarray(texels, dtype=np.intp)
    white = Impulses(filter, size, where)
    steps, volumes = white.table()
    wanted = lobe_volume(s)
    angle, directions, weights = circles(white.axes, np.pi, RINGS, AZIMUTHS)
    lobes = np.maximum(np.cos(angle), 0.0) ** s[:, None]
    out = np.full((len(s), len(where)), np.nan)
    for p in range(len(where)):
        table = np.maximum.accumulate(volumes[:, p])
        inside = (wanted >= table[0]) & (wanted <= table[-1])
        level = np.interp(np.log(wanted[inside]), np.log(table), steps)
        h = white.lookup(p, directions[p], level[:, None])
        h *= (wanted[inside] / (h @ weights))[:, None]  # the peak becomes 1: the volumes are equal
        out[inside, p] = np.abs(h - lobes[inside]) @ weights / wanted[inside]
    return out
