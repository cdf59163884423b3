"""Low-discrepancy points: the radical inverse in base 2 and the Hammersley set.

::

    radical_inverse(k) = sum_j bit_j(k) 2^(-j-1)                                   (1)
    hammersley(n)[k]   = ((k + 1/2) / n, radical_inverse(k)),   k = 0 .. n-1       (2)

Departure: the textbook set starts at k/n, whose first point is 0 and has no logarithm. Half a step
further every first number lies in (0, 1), and n points average -ln(xi1), the squared slope of a
Beckmann lobe, to 1 - ln(2)/(2n) where k/n counted from 1 to n gives 1 - ln(2 pi n)/(2n).
"""

import numpy as np
import numpy.typing as npt

from . import _check

Float64Array = npt.NDArray[np.float64]


def radical_inverse(index: npt.ArrayLike) -> Float64Array:
    """Bits of ``index`` mirrored at the binary point, eq. (1).

    Parameters
    ----------
    index : (...) array of int, 0 to 2^53 - 1

    Returns
    -------
    (...) float64 in [0, 1), exact.

    Raises
    ------
    ValueError
        If an index is not a whole number in that range.
    """
    k = np.asarray(index)
    if k.dtype.kind not in "iu" or np.any(k < 0) or np.any(k > 2**53 - 1):
        raise _check.fail("index", "must be whole numbers from 0 to 2^53 - 1", index)
    bits = k.astype(np.uint64)
    result = np.zeros(bits.shape)
    scale = 0.5
    while bits.any():
        result += scale * (bits & np.uint64(1))
        bits = bits >> np.uint64(1)
        scale *= 0.5
    return result


def hammersley(n: int) -> Float64Array:
    """The ``n`` points of eq. (2), (n, 2) float64; the first numbers are in (0, 1).

    Raises
    ------
    ValueError
        If ``n`` is below 1.
    """
    k = np.arange(_check.count("n", n))
    return np.stack([(k + 0.5) / n, radical_inverse(k)], axis=-1)
