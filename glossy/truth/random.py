"""Random numbers as a function of (seed, point, sample, dimension), for any order of evaluation.

A chain of 64-bit finalisers (Stafford's variant 13 of the MurmurHash3 mixer, as in SplitMix64)
turns the four counters into 53 random bits, so that every number is known without those before it:
results depend neither on chunks nor on threads. All 53 bits are used: with 24, the tail of a lobe
beyond exp(-16.6) would never be sampled.

Sobol' points are randomised per (point, replicate) by nested uniform scrambling, computed as a hash
of the bit-reversed number (Laine and Karras 2011; constants of N. Vegdahl), then by a random
digital shift, and their bits below 2^-32 are filled at random.
"""

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from .. import _check
from .._jit import kernel, row_kernel
from .._threads import in_rows

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_STEP = np.uint64(0x9E3779B97F4A7C15)
_M1, _M2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11, _S32 = (np.uint64(v) for v in (30, 27, 31, 11, 32))
_LOW = np.uint64(0xFFFFFFFF)
_SCALE = 2.0**-53


@kernel
def k_mix(state: np.uint64, word: np.uint64) -> np.uint64:
    """The next state of the chain: 64 well mixed bits of ``state`` and ``word``."""
    x = np.uint64(state) + _STEP * (np.uint64(word) + np.uint64(1))
    x = (x ^ (x >> _S30)) * _M1
    x = (x ^ (x >> _S27)) * _M2
    return x ^ (x >> _S31)


@kernel
def k_unit(bits: np.uint64) -> float:
    """Uniform in (0, 1), from the upper 53 of 64 bits."""
    return (float(np.uint64(bits) >> _S11) + 0.5) * _SCALE


@kernel
def _reverse(x: np.uint64) -> np.uint64:
    # the order of 32 bits
    x = ((x & np.uint64(0x55555555)) << np.uint64(1)) | (
        (x >> np.uint64(1)) & np.uint64(0x55555555)
    )
    x = ((x & np.uint64(0x33333333)) << np.uint64(2)) | (
        (x >> np.uint64(2)) & np.uint64(0x33333333)
    )
    x = ((x & np.uint64(0x0F0F0F0F)) << np.uint64(4)) | (
        (x >> np.uint64(4)) & np.uint64(0x0F0F0F0F)
    )
    x = ((x & np.uint64(0x00FF00FF)) << np.uint64(8)) | (
        (x >> np.uint64(8)) & np.uint64(0x00FF00FF)
    )
    return ((x << np.uint64(16)) | (x >> np.uint64(16))) & _LOW


@kernel
def _scramble(x: np.uint64, seed: np.uint64) -> np.uint64:
    # nested uniform scrambling of 32 bits
    x = _reverse(x)
    x ^= (x * np.uint64(0x3D20ADEA)) & _LOW
    x = (x + seed) & _LOW
    x = (x * ((seed >> np.uint64(16)) | np.uint64(1))) & _LOW
    x ^= (x * np.uint64(0x05526C56)) & _LOW
    x ^= (x * np.uint64(0x53A22864)) & _LOW
    return _reverse(x)


@row_kernel
def _uniform(
    begin: int, end: int, seed: int, points: IntArray, first: int, out: Float64Array
) -> None:
    for i in range(begin, end):
        start = k_mix(k_mix(np.uint64(0), np.uint64(seed)), np.uint64(points[i]))
        for j in range(out.shape[1]):
            state = k_mix(start, np.uint64(first + j))
            for d in range(out.shape[2]):
                out[i, j, d] = k_unit(k_mix(state, np.uint64(d)))


@row_kernel
def _sobol(
    begin: int,
    end: int,
    seed: int,
    points: IntArray,
    first: int,
    base: npt.NDArray[np.uint64],
    out: Float64Array,
) -> None:
    # base (S, D): 32-bit integers; out (K, replicates, S, D)
    for i in range(begin, end):
        start = k_mix(k_mix(np.uint64(1), np.uint64(seed)), np.uint64(points[i]))
        for r in range(out.shape[1]):
            own = k_mix(start, np.uint64(r))
            for d in range(out.shape[3]):
                key = k_mix(own, np.uint64(d))
                for j in range(out.shape[2]):
                    x = _scramble(base[j, d], key & _LOW) ^ (key >> _S32)
                    low = k_unit(k_mix(key, np.uint64(first + j)))
                    value = (float(x) + low) * 2.0**-32
                    out[i, r, j, d] = min(max(value, _SCALE), 1.0 - _SCALE)


def uniform(seed: int, points: IntArray, first: int, count: int, dimensions: int) -> Float64Array:
    """Independent uniform numbers in (0, 1): (K, count, dimensions).

    ``points`` (K,) are the flat indices of the points, ``first`` that of the first sample.
    """
    out = np.empty((len(points), count, dimensions))
    with np.errstate(over="ignore"):  # uncompiled, NumPy warns of the wrap-around that is meant
        in_rows(_uniform, len(points), seed, _check.frozen(points), first, out, grain=1024)
    return out


def sobol(
    seed: int,
    points: IntArray,
    first: int,
    count: int,
    dimensions: int,
    replicates: int,
) -> Float64Array:
    """Scrambled Sobol' points from ``first`` on: (K, replicates, count, dimensions)."""
    engine = qmc.Sobol(dimensions, scramble=False, bits=32)
    if first:
        engine.fast_forward(first)
        plain = engine.random(count)
    else:  # a power of two, as the engine asks of its first points
        plain = engine.random(1 << (count - 1).bit_length())[:count]
    base = _check.frozen((plain * 2.0**32).astype(np.uint64))
    out = np.empty((len(points), replicates, count, dimensions))
    with np.errstate(over="ignore"):
        in_rows(_sobol, len(points), seed, _check.frozen(points), first, base, out, grain=1024)
    return out
