"""Fits that send out no more than they receive, up to an angle.

A fit answers for the angles that were measured. Beyond them its lobes rise with
(wi.n wo.n)^(-alpha), and near the horizon many send out several times what they receive. The
bound::

    kd + kt_d + s sum_l a_l(w) <= 1   for all w with theta <= theta_max                     (1)

holds for each channel with the scale s on every ks that (1) leaves room for; a_l are the lobes'
directional albedos. Scaling alone dims the whole lobe for the sake of its grazing end, so the fit
is polished again with alpha held below a ceiling, which is halved towards the highest that needs no
scaling; every result is scaled by (1), and that of the least error is taken.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from .. import _check
from ..brdf import Material
from ..energy import energy
from .fit_kernels import LOBE
from .fit_metrics import errors, transform
from .fit_polish import Objective, TimeUpError, polish
from .fit_rows import Rows
from .fit_search import Search
from .fit_space import Space

Float64Array = npt.NDArray[np.float64]
Jobs = Sequence[tuple[Rows, Space, Float64Array]]

ANGLE = 80.0  # degrees: what views of a picture mostly stay under
STEP = 2.5  # degrees between the angles at which (1) is held
ROOM = 1.0 - 1e-6  # what is aimed at, so that rounding does not end above 1
HALVINGS = 6  # of the interval that holds the highest ceiling for alpha without scaling


def bounded(
    jobs: Jobs,
    found: Sequence[Float64Array],
    search: Search,
    angle: float,
    make: Callable[[Jobs, Sequence[Float64Array]], Material],
) -> list[Float64Array]:
    """The parameters of every side, held to (1) up to ``angle`` degrees.

    ``make`` gives the material of a list of parameters.

    Raises
    ------
    ValueError
        For an angle out of range, or where bounds and fixed values leave no room for (1).
    """
    limit = _check.in_range("energy_limit", angle, 0.0, 90.0, open_high=True)
    theta = np.unique(np.append(np.arange(0.0, limit, STEP), limit))

    def total(trial: Sequence[Float64Array]) -> float:
        sums = 0.0
        for (rows, space, _), p in zip(jobs, trial, strict=True):
            if (p < space.low).any():
                return np.inf
            target = transform(rows.measured, search.code)
            sums += float(errors(rows, target, p[None], search.code)[0])
        return sums

    best = _scaled(jobs, found, make, theta)
    if all(np.array_equal(a, b) for a, b in zip(best, found, strict=True)):
        return best
    least = total(best)
    low, high = 0.0, 1.0
    for _ in range(HALVINGS if search.polish != "none" else 0):
        ceiling = 0.5 * (low + high)
        trial = [
            _polished(rows, _below(space, ceiling), p, search)
            for (rows, space, _), p in zip(jobs, found, strict=True)
        ]
        held = _scaled(jobs, trial, make, theta)
        fits = all(np.array_equal(a, b) for a, b in zip(held, trial, strict=True))
        low, high = (ceiling, high) if fits else (low, ceiling)
        if (error := total(held)) < least:
            best, least = held, error
    if least == np.inf:
        rule = "cannot be held within the bounds and fixed values of ks and kd"
        raise _check.fail("energy_limit", rule, angle)
    return best


def _below(space: Space, ceiling: float) -> Space:
    """The space with alpha of every lobe at most ``ceiling``, or its lower bound."""
    high = space.high.copy()
    at = [space.at(j) + 2 for j in range(space.lobes)]
    high[at] = np.maximum(space.low[at], np.minimum(high[at], ceiling))
    return dataclasses.replace(space, high=high)


def _polished(rows: Rows, space: Space, start: Float64Array, search: Search) -> Float64Array:
    objective = Objective(rows, space, search.code, start, search.clock)
    try:
        polish(objective, "local")
    except TimeUpError:
        search.stopped = True
    search.evaluations += objective.count
    return objective.best


def _scaled(
    jobs: Jobs,
    found: Sequence[Float64Array],
    make: Callable[[Jobs, Sequence[Float64Array]], Material],
    theta: Float64Array,
) -> list[Float64Array]:
    """Parameters with every ks scaled by (1); unchanged where (1) holds."""
    channels = jobs[0][1].channels
    diffuse = np.sum([p[:channels] for p in found], axis=0)
    sent = energy(make(jobs, found), theta)
    total = (sent.reflectivity + sent.transmissivity).max(axis=(0, 1))[:channels]
    if (total <= 1.0).all():
        return list(found)
    out = []
    for p in found:
        p = p.copy()
        p[:channels] *= np.minimum(1.0, ROOM / np.maximum(diffuse, ROOM))
        lobes = np.maximum(total - diffuse, 1e-300)
        scale = np.clip((ROOM - diffuse) / lobes, 0.0, 1.0)
        p[channels:].reshape(-1, LOBE + channels)[:, LOBE:] *= scale
        out.append(p)
    return out
