"""One side of a fit: grid searches by turns, colours, polish.

More lobes are fitted by turns, thesis section 3.4.1, each to what the others leave::

    target_j = max(measured, kd / pi + sum of the other lobes)                           (1)

which is the remainder clamped at zero, with what was subtracted put back on both sides, so that
metrics other than differences make sense as well. The turns end when all lobes together get no
better; the best turn counts.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from .fit_grid import search_lobe
from .fit_kernels import LOBE
from .fit_metrics import errors, finish, lobe_values, transform
from .fit_polish import Clock, Objective, TimeUpError, gauss_newton, polish
from .fit_rows import Rows
from .fit_space import Space

Float64Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Stage:
    """What one step of the fit reached: its name, the error of its side, the time it took [s]."""

    name: str
    error: float
    seconds: float


@dataclasses.dataclass
class Search:
    """The settings of a fit, and what it counts."""

    code: int
    grid: int
    levels: int
    spacing: str
    rounds: int
    polish: str
    seed: int
    clock: Clock
    generations: int = 150
    stopped: bool = False
    evaluations: int = 0
    stages: list[Stage] = dataclasses.field(default_factory=list)

    def work(self, space: Space) -> int:
        """Ticks of the progress bar for one side."""
        turns = self.rounds if space.lobes > 1 else 1
        return turns * space.lobes + 2 + self.generations * (self.polish == "global")

    def run(
        self, rows: Rows, space: Space, modes: Float64Array, tick: Callable[[], object]
    ) -> Float64Array:
        """The parameters of one side."""
        began = self.clock.seconds
        start = self._by_turns(rows.mean_channel(), space, modes, tick)
        held = start.copy()
        objective = Objective(rows, space, self.code, start, self.clock)
        try:
            if rows.channels > 1:
                linear = dataclasses.replace(space, low=space.low.copy(), high=space.high.copy())
                for j in range(space.lobes):
                    at = space.at(j)
                    shape = slice(at, at + LOBE)
                    linear.low[shape] = linear.high[shape] = held[shape]
                colours = Objective(rows, linear, self.code, start, self.clock)
                gauss_newton(colours)
                objective.sums(colours.best[None])
            self._stage(f"{space.side}: grid", rows, objective.best_sum, began)
            tick()
            began = self.clock.seconds
            if self.polish != "none":
                polish(objective, self.polish, self.seed, self.generations, tick)
                self._stage(f"{space.side}: polish", rows, objective.best_sum, began)
        except TimeUpError:
            self.stopped = True
            self._stage(f"{space.side}: stopped", rows, objective.best_sum, began)
        self.evaluations += objective.count
        tick()
        return objective.best

    def _stage(self, name: str, rows: Rows, total: float, began: float) -> None:
        error = finish(total, float(rows.weight.sum()), self.code)
        self.stages.append(Stage(name, error, self.clock.seconds - began))

    def _by_turns(
        self, rows: Rows, space: Space, modes: Float64Array, tick: Callable[[], object]
    ) -> Float64Array:
        """Grid searches by turns over rows of one channel, eq. (1); parameters of all channels."""
        one = _one_channel(space)
        kd = float(modes.mean())
        y, lobes = rows.measured[:, 0], np.zeros((space.lobes, LOBE + 1))
        values = np.zeros((space.lobes, len(y)))
        target = transform(rows.measured, self.code)
        best, best_sum = lobes.copy(), np.inf
        lobes[:, :LOBE] = one.low[1:].reshape(-1, LOBE + 1)[:, :LOBE]
        try:
            for _ in range(self.rounds if space.lobes > 1 else 1):
                for j in range(space.lobes):
                    self.clock.check()
                    base = kd * rows.diffuse + values.sum(axis=0) - values[j]
                    lobes[j], _, count = search_lobe(
                        rows,
                        one.only(j),
                        np.maximum(y, base),
                        base,
                        self.code,
                        self.grid,
                        self.levels,
                        self.spacing,
                    )
                    values[j] = lobes[j, LOBE] * lobe_values(rows, *lobes[j, :LOBE])
                    self.evaluations += count
                    tick()
                full = np.concatenate([[kd], lobes.ravel()])
                total = float(errors(rows, target, full[None], self.code)[0])
                if total >= best_sum:
                    break
                best, best_sum = lobes.copy(), total
        except TimeUpError:
            self.stopped = True
            best = lobes if best_sum == np.inf else best
        colours = np.repeat(best[:, LOBE:], space.channels, axis=1)
        return np.concatenate([modes, np.hstack([best[:, :LOBE], colours]).ravel()])


def _one_channel(space: Space) -> Space:
    """The space with the mean of the channels' bounds for kd and ks."""
    if space.channels == 1:
        return space
    c = space.channels

    def mean(values: Float64Array) -> Float64Array:
        lobes = values[c:].reshape(-1, LOBE + c)
        ks = lobes[:, LOBE:].mean(axis=1, keepdims=True)
        return np.concatenate([[values[:c].mean()], np.hstack([lobes[:, :LOBE], ks]).ravel()])

    logarithmic = mean(space.logarithmic.astype(np.float64)) > 0.5
    return dataclasses.replace(
        space,
        channels=1,
        low=mean(space.low),
        high=mean(space.high),
        logarithmic=logarithmic,
    )
