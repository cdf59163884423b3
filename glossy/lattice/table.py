"""The taps of a lobe of any elongation, and the reflectivity that their weights are scaled to.

In units of the lobe's standard deviations s1 >= s2 a tap has place z = (z1, z2) and weight w; all
have the width tau s2. For n taps each of z1, z2, log w and log2 tau is a polynomial of degree 4
in ::

    t = min(log2(s1 / s2), 4) / 4                                                         (1)

(beyond 2^4 tau grows with s1/s2). Taps come in pairs z, -z. The coefficients minimise how much a
sum of round Gaussians as a pyramid's trilinear lookups make them differs from the lobe, for
elongations of 1 to 16, on the plane; no environment map had a part in it
(``benchmarks/optimise_lattice.py``).
"""

import dataclasses
import functools
import importlib.resources
import math

import numpy as np
import numpy.typing as npt

from .. import _check
from ..albedo import unit_integrals
from ..brdf import Lobe

Float64Array = npt.NDArray[np.float64]

DEGREE = 4
NODES = 32  # a side of the quadrature: its error is below that of reading the table
ROWS, COLUMNS = 65, 49  # nodes of the reflectivity over the view's elevation and azimuth


@functools.cache
def _coefficients() -> dict[int, Float64Array]:
    """For each count n the polynomials (DEGREE + 1, P), constant term first."""
    file = importlib.resources.files("glossy.lattice").joinpath("taps.npz")
    with file.open("rb") as stream, np.load(stream) as stored:
        return {int(name[1:]): stored[name].astype(np.float64) for name in stored.files}


def counts() -> tuple[int, ...]:
    """Numbers of taps there are tables for, ascending."""
    return tuple(sorted(_coefficients()))


def nearest_count(samples: int) -> int:
    """The number of taps closest to a budget; of two as close, the smaller.

    Raises
    ------
    ValueError
        If ``samples`` is not a whole number above 0.
    """
    budget = _check.count("samples", samples)
    return min(counts(), key=lambda n: (abs(n - budget), n))


def tap_count(_lobe: Lobe, samples: int) -> int:
    """Taps of the method for a lobe and a budget."""
    return nearest_count(samples)


@dataclasses.dataclass(frozen=True, eq=False)
class LatticeTaps:
    """Taps for every elongation: ``place`` (n, 2, 5), ``log_weight`` (n, 5), ``log2_width`` (5,).

    Polynomials in t of eq. (1), constant term first. The tap in the middle, if n is odd, then the
    pairs, z before -z.
    """

    place: Float64Array
    log_weight: Float64Array
    log2_width: Float64Array

    def __len__(self) -> int:
        return len(self.place)

    @property
    def rows(self) -> Float64Array:
        """(n, 15): z1, z2, log w, five coefficients each."""
        flat = self.place.reshape(len(self), -1)
        return np.concatenate([flat, self.log_weight], axis=1)

    def at(self, elongation: float) -> tuple[Float64Array, Float64Array, float]:
        """Places (n, 2) in units of (s1, s2), weights (n,) of sum 1, width in units of s2.

        Raises
        ------
        ValueError
            If ``elongation`` = s1/s2 is below 1 or not finite.
        """
        ratio = _check.in_range("elongation", elongation, 1.0, 1e12)
        octaves = math.log2(ratio)
        t = min(octaves, 4.0) / 4.0
        powers = t ** np.arange(DEGREE + 1)
        w = np.exp(self.log_weight @ powers)
        width = 2.0 ** (float(self.log2_width @ powers) + max(octaves - 4.0, 0.0))
        return self.place @ powers, w / w.sum(), width


def lattice_taps(samples: int) -> LatticeTaps:
    """The taps for a budget: the nearest number there is a table for (``len``).

    Raises
    ------
    ValueError
        If ``samples`` is not a whole number above 0.
    """
    n = nearest_count(samples)
    stored = _coefficients()[n]
    half, odd = n // 2, n % 2
    logits = stored[:, : half + odd].T
    pairs = stored[:, half + odd : -1].T.reshape(half, 2, DEGREE + 1)
    centre = np.zeros((odd, 2, DEGREE + 1))
    both = np.stack([pairs, -pairs], axis=1).reshape(-1, 2, DEGREE + 1)
    place = np.concatenate([centre, both])
    log_weight = np.concatenate([logits[:odd], np.repeat(logits[odd:], 2, axis=0)])
    return LatticeTaps(place, log_weight, stored[:, -1].copy())


@functools.lru_cache(maxsize=64)
def reflectivity_table(mx: float, my: float, alpha: float) -> Float64Array:
    """Reflectivities over a scale, (ROWS, C, 3): of r0 = 1, fifth root of Schlick's term, its rest.

    With c = wo.n and k^2 = (mx^2 x^2 + my^2 y^2)/(x^2 + y^2) of the view's azimuth, rows are even
    in (c + c (1 + k)/(c + k)) / 2, columns in v/(u + v), u^2 = sqrt(mx) |x|, v^2 = sqrt(my) |y|
    (C = 1 for an isotropic lobe), so that they crowd where a long lobe turns; read bilinearly. The
    scale, (c + k)^(1 - alpha) / c^alpha, is how a sharp lobe reflects; its Schlick term is near
    (1 - c)^5.
    """
    columns = 1 if mx == my else COLUMNS
    part = np.linspace(0.0, 1.0, columns)
    phi = np.arctan2(part**2 * math.sqrt(mx), (1.0 - part) ** 2 * math.sqrt(my))
    k = np.hypot(mx * np.cos(phi), my * np.sin(phi))
    x = np.linspace(0.0, 1.0, ROWS)[:, None]
    b = 1.0 + 2.0 * k - 2.0 * x
    c = np.clip(0.5 * (np.sqrt(b * b + 8.0 * x * k) - b), 1e-6, 1.0)
    s = np.sqrt((1.0 - c) * (1.0 + c))
    wo = np.stack([s * np.cos(phi), s * np.sin(phi), c], axis=-1)
    parts = unit_integrals(wo.reshape(-1, 3), mx, my, alpha, NODES).reshape(ROWS, columns, 3)
    scale = (c + k) ** (1.0 - alpha) * c**-alpha
    parts = np.maximum(parts, 0.0) / scale[..., None]
    parts[..., 1] **= 0.2
    return np.asarray(parts)
