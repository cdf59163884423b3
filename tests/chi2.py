"""Goodness of fit of a direction sampler against its density, over bins of the sphere.

The sphere is cut into rings and sectors about a pole; a bin's expectation is the density integrated
by Gauss-Legendre quadrature. Bins that expect fewer than five samples are pooled. Several tests
of one family share a significance level by Sidak's rule.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy import stats

Array = npt.NDArray[np.float64]
Density = Callable[[Array], Array]

RINGS, SECTORS, NODES = 40, 48, 6


def frame(pole: Array) -> Array:
    """Rows t, b, n with n the pole."""
    side = np.eye(3)[int(np.argmin(np.abs(pole)))]
    t = np.cross(side, pole)
    t /= np.linalg.norm(t)
    return np.stack([t, np.cross(pole, t), pole])


def edges(width: float) -> Array:
    """Ring borders in theta [rad], crowded about the pole within ``width``; pi/2 is one of them."""
    half = np.geomspace(1.0, 1.0 + 0.5 * np.pi / width, RINGS // 2 + 1) - 1.0
    upper = half * width
    return np.concatenate([upper, np.pi - upper[-2::-1]])


def expected(density: Density, pole: Array, width: float) -> Array:
    """Integral of the density over each bin, (RINGS, SECTORS)."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    ring = edges(width)
    theta = ring[:-1, None] + np.diff(ring)[:, None] * x
    w_theta = np.diff(ring)[:, None] * w * np.sin(theta)
    step = 2.0 * np.pi / SECTORS
    phi = step * (np.arange(SECTORS)[:, None] + x)
    t, p = theta[:, None, :, None], phi[None, :, None, :]
    local = np.stack(
        np.broadcast_arrays(np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)), axis=-1
    )
    values = density((local @ frame(pole)).reshape(-1, 3)).reshape(local.shape[:-1])
    return np.asarray(np.einsum("rsij,ri,j->rs", values, w_theta, w * step))


def counts(directions: Array, pole: Array, width: float) -> Array:
    """Samples in each bin, (RINGS, SECTORS)."""
    local = directions @ frame(pole).T
    theta = np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
    phi = np.arctan2(local[:, 1], local[:, 0]) % (2.0 * np.pi)
    bins = (edges(width), np.linspace(0.0, 2.0 * np.pi, SECTORS + 1))
    return np.asarray(np.histogram2d(theta, phi, bins)[0])


def p_value(observed: Array, probability: Array) -> float:
    """Probability of a worse fit, bins that expect fewer than five samples pooled."""
    total = observed.sum()
    e, o = (probability * total).ravel(), observed.ravel()
    order = np.argsort(e)
    small = np.cumsum(e[order]) <= 5.0
    small[: int(np.sum(e < 5.0))] = True
    e = np.concatenate([[e[order][small].sum()], e[order][~small]])
    o = np.concatenate([[o[order][small].sum()], o[order][~small]])
    if e[0] < 5.0:
        e, o = np.concatenate([[e[0] + e[1]], e[2:]]), np.concatenate([[o[0] + o[1]], o[2:]])
    return float(stats.chi2.sf(np.sum((o - e) ** 2 / e), len(e) - 1))


def sidak(alpha: float, tests: int) -> float:
    """Level of each of ``tests`` independent tests for one false alarm in 1/alpha families."""
    return float(1.0 - (1.0 - alpha) ** (1.0 / tests))
