"""Refinement of a fit that never ends worse than it began.

Three searches, each beginning at the best so far; what is kept is the best of everything that was
evaluated with the metric itself:

* bounded, damped Gauss-Newton steps. Each metric is sum omega (T(y_meas) - T(y_model))^2 with
  omega = w, for l1 with the weights of iterative reweighting, omega = w / max(|difference|, eps)
  and a falling eps. A step solves the bounded linear least squares problem ::

      min | R d - R^-T J^T omega r |,   R^T R = J^T omega J + lambda D^2                 (1)

  (D^2 the diagonal of J^T omega J) of as many rows as there are parameters, so the table's
  length only costs sums over its rows;
* Nelder-Mead on the metric, which needs no derivatives where l1 has none;
* on request differential evolution over the whole box before both.

Sums run in a fixed order: the same input gives the same bits for any number of threads.
"""

import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy import linalg, optimize

from .fit_kernels import CUBIC_ROOT, L1, LOBE, LOG
from .fit_metrics import errors, model_values, shape_values, transform
from .fit_rows import Rows
from .fit_space import Space

Float64Array = npt.NDArray[np.float64]

SOFTENING = (0.3, 0.03, 3e-3, 3e-4)  # eps of the l1 weights, in units of the mean difference
STEPS = 25  # Gauss-Newton steps for each eps
STILL = 1e-8  # relative gain of a step at which the search stands still
SIMPLEX_CALLS = 150  # Nelder-Mead: evaluations for each free parameter
POPULATION = 12  # differential evolution: candidates for each free parameter

_Step = tuple[Float64Array, Float64Array]  # J^T omega J, J^T omega r


class TimeUpError(Exception):
    """The time limit is over; what was found so far counts."""


class Clock:
    """A time limit in seconds, or none."""

    def __init__(self, limit: float | None = None) -> None:
        self.start = time.perf_counter()
        self.limit = limit

    @property
    def seconds(self) -> float:
        """Time since the start."""
        return time.perf_counter() - self.start

    def check(self) -> None:
        """Raise ``TimeUpError`` when the limit is over."""
        if self.limit is not None and self.seconds > self.limit:
            raise TimeUpError


class Objective:
    """The metric of one side over its free parameters; remembers the best it has seen."""

    def __init__(
        self, rows: Rows, space: Space, code: int, start: Float64Array, clock: Clock
    ) -> None:
        self.rows, self.space, self.code, self.clock = rows, space, code, clock
        self.target = transform(rows.measured, code)
        self.best = space.decode(space.encode(start))
        self.best_sum = float(errors(rows, self.target, self.best[None], code)[0])
        self.count = 1

    def sums(self, parameters: Float64Array) -> Float64Array:
        """The metric's sums for sets (N, P)."""
        self.clock.check()
        out = errors(self.rows, self.target, parameters, self.code)
        out = np.where(np.isfinite(out), out, np.inf)
        self.count += len(out)
        k = int(np.argmin(out))
        if out[k] < self.best_sum:
            self.best_sum, self.best = float(out[k]), parameters[k].copy()
        return out

    def __call__(self, free: Float64Array) -> float:
        """The metric's sum for one set of free parameters (F,)."""
        return float(self.sums(self.space.decode(free)[None])[0])


def slope(y: Float64Array, code: int) -> Float64Array:
    """Derivative of what the metric compares; the cubic root's is cut off near zero."""
    if code == CUBIC_ROOT:
        return np.asarray(np.maximum(np.abs(y), 1e-9) ** (-2.0 / 3.0) / 3.0)
    return 1.0 / (1.0 + np.abs(y)) if code == LOG else np.ones_like(y)


def jacobian(rows: Rows, space: Space, parameters: Float64Array) -> Float64Array:
    """Derivatives (K, C, P) of y by every parameter, those of roughness by its logarithm."""
    c, f = rows.channels, rows.features
    out = np.zeros((f.shape[1], c, len(parameters)))
    for channel in range(c):
        out[:, channel, channel] = rows.diffuse
    for j in range(space.lobes):
        at = space.at(j)
        mx, my, alpha, r0 = parameters[at : at + LOBE]
        ks = parameters[at + LOBE : at + LOBE + c]
        p = shape_values(rows, mx, my, alpha)
        qx, qy = f[0] / mx**2, f[1] / my**2
        if rows.ggx:
            si = np.sqrt(1.0 + mx**2 * f[5] + my**2 * f[6])
            so = np.sqrt(1.0 + mx**2 * f[7] + my**2 * f[8])
            tail = 4.0 / (1.0 + qx + qy)
            dx = qx * tail - 1.0 - mx**2 * (f[5] / si + f[7] / so) / (si + so)
            dy = qy * tail - 1.0 - my**2 * (f[6] / si + f[8] / so) / (si + so)
        else:
            dx, dy = 2.0 * qx - 1.0, 2.0 * qy - 1.0
        fresnel = r0 + (1.0 - r0) * f[2]
        if rows.sign < 0.0:
            fresnel = 1.0 - fresnel
        unit = fresnel * p
        by_alpha = 0.0 * unit if rows.ggx else -unit * f[3]
        by_shape = (unit * dx, unit * dy, by_alpha, rows.sign * (1.0 - f[2]) * p)
        for k, column in enumerate(by_shape):
            out[:, :, at + k] = column[:, None] * ks
        for channel in range(c):
            out[:, channel, at + LOBE + channel] = unit
        if space.tied:
            out[:, :, at] += out[:, :, at + 1]
    return out


def _step(objective: Objective, parameters: Float64Array, eps: float) -> _Step:
    rows, code = objective.rows, objective.code
    seen = rows.weight > 0.0
    y = model_values(rows, parameters)
    rest = np.where(seen, objective.target - transform(y, code), 0.0)
    omega = rows.weight
    if code == L1:
        omega = omega / np.maximum(np.abs(rest), eps)
    j = jacobian(rows, objective.space, parameters)[:, :, objective.space.free]
    j *= slope(y, code)[:, :, None]
    j, rest, omega = j.reshape(-1, j.shape[2]), rest.reshape(-1), omega.reshape(-1)
    weighted = j * omega[:, None]
    return np.einsum("kf,kg->fg", weighted, j), np.einsum("kf,k->f", weighted, rest)


def gauss_newton(objective: Objective) -> None:
    """Damped bounded steps, eq. (1), from the best so far."""
    space = objective.space
    low, high = space.box
    mean = objective.best_sum / max(float(objective.rows.weight.sum()), 1e-300)
    for soft in SOFTENING if objective.code == L1 else (1.0,):
        u, value, damping = space.encode(objective.best), objective.best_sum, 1e-3
        for _ in range(STEPS):
            gram, gradient = _step(objective, space.decode(u), max(soft * mean, 1e-12))
            d = np.sqrt(np.maximum(np.diag(gram), 1e-20 * max(float(np.diag(gram).max()), 1e-280)))
            unit, slope_u = gram / np.outer(d, d), gradient / d
            gained = 0.0
            while damping < 1e6:
                r = linalg.cholesky(unit + damping * np.eye(len(d)))
                b = linalg.solve_triangular(r, slope_u, trans="T")
                box = ((low - u - 1e-12) * d, (high - u + 1e-12) * d)
                step = optimize.lsq_linear(r, b, box).x / d
                new = np.clip(u + step, low, high)
                trial = objective(new)
                if trial < value:
                    gained = (value - trial) / max(value, 1e-300)
                    u, value, damping = new, trial, max(damping / 5.0, 1e-9)
                    break
                damping *= 6.0
            if gained < STILL:
                break


def nelder_mead(objective: Objective, calls: int = SIMPLEX_CALLS) -> None:
    """The simplex search on the metric itself, from the best so far."""
    low, high = objective.space.box
    u = objective.space.encode(objective.best)
    reach = np.minimum(0.05, 0.25 * (high - low))
    simplex = np.vstack([u, u + np.diag(np.where(u + reach <= high, reach, -reach))])
    optimize.minimize(
        objective,
        u,
        method="Nelder-Mead",
        bounds=list(zip(low, high, strict=True)),
        options={
            "initial_simplex": np.clip(simplex, low, high),
            "maxfev": calls * len(u),
            "xatol": 1e-7,
            "fatol": 1e-10 * max(objective.best_sum, 1e-300),
            "adaptive": True,
        },
    )


def evolve(objective: Objective, seed: int, generations: int, tick: Callable[[], object]) -> None:
    """Differential evolution over the box, the best so far among the first generation."""
    space = objective.space
    low, high = space.box

    def many(free: Float64Array) -> Float64Array:
        return objective.sums(space.decode(np.ascontiguousarray(free.T)))

    optimize.differential_evolution(
        many,
        list(zip(low, high, strict=True)),
        x0=np.clip(space.encode(objective.best), low, high),
        rng=np.random.default_rng(seed),
        popsize=POPULATION,
        maxiter=generations,
        tol=1e-6,
        polish=False,
        init="sobol",
        vectorized=True,
        updating="deferred",
        callback=lambda *_, **__: tick(),
    )


def polish(
    objective: Objective,
    kind: str,
    seed: int = 0,
    generations: int = 150,
    tick: Callable[[], object] = lambda: None,
) -> None:
    """Improve ``objective.best``; "local", or "global" with differential evolution before it."""
    if not len(objective.space.free):
        return
    gauss_newton(objective)
    if kind == "global":
        evolve(objective, seed, generations, tick)
        gauss_newton(objective)
    nelder_mead(objective)
    gauss_newton(objective)
