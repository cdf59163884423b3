"""Kurt's lobes fitted to a table of measurements.

Thesis section 3.4.1, step by step: kd from the fullest bin of a histogram; a hierarchical grid
search for one lobe (``fit_grid``); more lobes by turns (``fit_search``). Then a search over all
parameters at once (``fit_polish``), which the thesis does not have and which never ends worse.

Colour: the grid search sees the mean of the channels. kd and ks of every channel then follow with
the shapes held, a linear problem (iteratively reweighted for metrics other than l2); the polish
varies everything. Reflection and transmission share no parameter: each side is fitted to its own
rows, and the error of the whole is over all rows.

Departures: thin transmission has 1 - F = (1 - r0) (1 - S), so of ks and r0 only ks (1 - r0) can be
found; r0 = 0 is taken unless it is fixed otherwise.
"""

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from .. import _check
from .._arguments import checked
from ..brdf import Lobe, Material
from ..energy import energy
from .fit_energy import bounded
from .fit_kernels import LOBE
from .fit_metrics import METRICS, errors, finish, metric_code, model_values, transform
from .fit_polish import Clock
from .fit_rows import MODELS, WEIGHTS, Rows, diffuse_mode, features, lit_from, rows_of
from .fit_search import Search, Stage
from .fit_space import DIFFUSE, SPACINGS, Bounds, Fixed, Space, check_names, make_space
from .table import MeasuredTable

Float64Array = npt.NDArray[np.float64]

SIDES = ("reflection", "transmission")
POLISHES = ("none", "local", "global")
FROZEN = {  # what the baselines do not have
    "ward": {"alpha": 0.0, "r0": 1.0},
    "beckmann": {"alpha": 0.0},
    "ggx": {"alpha": 0.0},
}


@dataclasses.dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model and how it was found.

    ``material`` is None for the baselines, which can be evaluated but not rendered.
    ``parameters``: side -> kd (transmission: diffuse_transmission) of every channel, then mx, my,
    alpha, r0 and ks of every channel for each lobe. ``error`` is over all rows, ``errors`` by side,
    ``stages`` in order. ``at_bounds`` names the parameters that ended on a bound. ``stopped``: the
    time limit was reached. ``energy``, of a material: the ``largest`` share of the light that is
    sent out (reflected and transmitted), where (``worst``, theta and phi in degrees), the angle
    from which it is more than 1 (``exceeds_from``, or None), and the angle that it was held below
    1 to (``limit``, or None).
    """

    model: str
    metric: str
    weights: str
    channels: int
    material: Material | None
    parameters: Mapping[str, Float64Array]
    error: float
    errors: Mapping[str, float]
    stages: Sequence[Stage]
    at_bounds: Sequence[str]
    rows: int
    evaluations: int
    seconds: float
    stopped: bool
    energy: Mapping[str, Any] | None

    def eval(self, wi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
        """BSDF [1/sr] (..., C) of the fitted model for unit directions (..., 3), either side."""
        i, o = _check.unit_vectors("wi", wi), _check.unit_vectors("wo", wo)
        i, o = np.broadcast_arrays(i, o)
        shape, i, o = i.shape[:-1], i.reshape(-1, 3), o.reshape(-1, 3)
        out = np.zeros((len(i), self.channels))
        for side, p in self.parameters.items():
            sign = 1.0 if side == "reflection" else -1.0
            own = np.flatnonzero(sign * i[:, 2] * o[:, 2] > 0.0)
            c = np.abs(i[own, 2] * o[own, 2])
            none = np.zeros((len(own), self.channels))
            rows = Rows(
                features(i[own], o[own], self.model), c / np.pi, none, none, self.is_ggx, sign
            )
            out[own] = model_values(rows, p) / c[:, None]
        return out.reshape(*shape, self.channels)

    @property
    def is_ggx(self) -> bool:
        """True for the model that is not an exponential."""
        return self.model == "ggx"

    def to_dict(self) -> dict[str, Any]:
        """Plain values, fit for JSON."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        values["parameters"] = {k: v.tolist() for k, v in self.parameters.items()}
        values["errors"] = dict(self.errors)
        values["stages"] = [dataclasses.asdict(s) for s in self.stages]
        values["at_bounds"] = list(self.at_bounds)
        values["energy"] = None if self.energy is None else dict(self.energy)
        values["material"] = None if self.material is None else dataclasses.asdict(self.material)
        return values


@checked
def fit_table(
    table: MeasuredTable,
    reflection: int = 1,
    transmission: int | None = None,
    *,
    model: str = "kurt",
    metric: str = "l1",
    weights: str = "auto",
    light: str = "above",
    bounds: Bounds | None = None,
    fixed: Fixed | None = None,
    kd: str = "free",
    isotropic: bool | None = None,
    grid: int = 9,
    levels: int = 4,
    spacing: str = "log",
    rounds: int = 3,
    polish: str = "local",
    seed: int = 0,
    time_limit: float | None = None,
    energy_limit: float | None = None,
    progress: bool = False,
) -> Fit:
    """Fit a material to a table of measurements.

    Parameters
    ----------
    table : MeasuredTable
    reflection, transmission : int
        Lobes of each side; ``None`` is one transmission lobe if the table has such rows.
    model : str
        "kurt", or a baseline: "ward", "beckmann" (Cook-Torrance), "ggx".
    metric : str
        "l1" (thesis eq. 3.7), "l2", "cubic-root", "log".
    weights : str
        "sine" (sin theta_o, eq. 3.7, for directions even in angle), "table" (its solid angles),
        "equal", or "auto": the table's if it has them, else sine.
    light : str
        Rows with the light "above" the surface, "below" it (seen from there), or "both".
    bounds, fixed : mapping
        Name -> (low, high), name -> value (``ks`` and ``kd`` may have one a channel). A name is
        ``mx``, ``my``, ``alpha``, ``r0``, ``ks``, ``kd`` or ``diffuse_transmission``, or one
        lobe's: ``reflection[1].mx``.
    kd : str
        "free": the histogram's mode is where the polish starts; "mode": it stays. Both diffuse
        terms.
    isotropic : bool, optional
        Whether my equals mx; what the table says by default.
    grid, levels, rounds : int
        Values on each axis, refinements, turns through all lobes.
    spacing : str
        "log" or "linear" (the thesis): in what the grid's values are equidistant; see
        ``fit_grid``.
    polish : str
        "none", "local", or "global" (differential evolution over the whole box as well).
    seed : int
        Of the differential evolution.
    time_limit : float, optional
        Seconds after which the best so far is returned; compilation counts.
    energy_limit : float, optional [degrees]
        Hold the directional albedo at or below 1 to this angle from the normal (``fit_energy``).
        Without it the fit may send out more than it receives; ``Fit.energy`` says how much.
    progress : bool
        A bar on stderr, if that is a terminal.

    Raises
    ------
    ValueError
        For a name or value out of range, or a table without rows for the lobes asked for.
    """
    code = metric_code(metric)
    _check.choice("model", model, MODELS)
    _check.choice("weights", weights, WEIGHTS)
    _check.choice("kd", kd, ("free", "mode"))
    _check.choice("spacing", spacing, SPACINGS)
    _check.choice("polish", polish, POLISHES)
    limit = None if time_limit is None else _check.positive("time_limit", time_limit)
    counts = {"reflection": _check.count("reflection", reflection, 0)}
    table = lit_from(table, light)
    rows = {side: rows_of(table, side, model, weights) for side in SIDES}
    asked = int(rows["transmission"] is not None) if transmission is None else transmission
    counts["transmission"] = _check.count("transmission", asked, 0)
    bounds, fixed, frozen = dict(bounds or {}), dict(fixed or {}), FROZEN.get(model, {})
    check_names(bounds, fixed, counts)
    fixed = {k: v for k, v in fixed.items() if k.rpartition(".")[2] not in frozen} | frozen
    search = Search(
        code=code,
        grid=_check.count("grid", grid, 2),
        levels=_check.count("levels", levels),
        spacing=spacing,
        rounds=_check.count("rounds", rounds),
        polish=polish,
        seed=_check.count("seed", seed, 0),
        clock=Clock(limit),
    )
    tied = bool(table.isotropic) if isotropic is None else bool(isotropic)
    jobs: list[tuple[Rows, Space, Float64Array]] = []
    for side in SIDES:
        r = rows[side]
        if counts[side] == 0 and (side == "transmission" or r is None):
            continue
        if r is None:
            raise _check.fail(side, f"the table has no {side} rows, so it must be 0", counts[side])
        own = dict(fixed)
        if side == "transmission" and not any(k in own for k in ("r0", "transmission.r0")):
            own["transmission.r0"] = 0.0
        space = make_space(side, counts[side], r.channels, bounds, own, tied)
        part = table.reflection if side == "reflection" else table.transmission
        c = slice(0, r.channels)
        modes = np.array([diffuse_mode(v) for v in part.f.T])
        modes = np.clip(modes, space.low[c], space.high[c])
        if kd == "mode":
            space.low[c] = space.high[c] = modes
        jobs.append((r, space, modes))
    if not jobs:
        raise _check.fail("reflection, transmission", "at least one lobe is needed", counts)
    with tqdm(
        total=sum(search.work(space) for _, space, _ in jobs),
        desc="fit",
        disable=not (progress and sys.stderr.isatty()),
        leave=False,
    ) as bar:
        found = [search.run(r, space, modes, bar.update) for r, space, modes in jobs]
    if energy_limit is not None:
        if model != "kurt":
            raise _check.fail("energy_limit", "is for model 'kurt'", energy_limit)
        found = bounded(jobs, found, search, energy_limit, _material)
    return _result(jobs, found, search, model, metric, weights, energy_limit)


def _lobes(space: Space, parameters: Float64Array) -> list[Lobe]:
    """The lobes of one side, the sharpest first."""
    c = space.channels
    out = []
    for mx, my, alpha, r0, *ks in parameters[c:].reshape(-1, LOBE + c).tolist():
        out.append(Lobe(mx, my, ks=ks[0] if c == 1 else ks, r0=r0, alpha=alpha))
    return out


def _material(
    jobs: Sequence[tuple[Rows, Space, Float64Array]], found: Sequence[Float64Array]
) -> Material:
    """The material of parameters of every side."""
    parts: dict[str, Any] = {"kd": 0.0, "reflection": [], "transmission": []}
    for (_, space, _), p in zip(jobs, found, strict=True):
        parts[space.side] = _lobes(space, p)
        diffuse = p[: space.channels].tolist()
        parts[DIFFUSE[space.side]] = diffuse[0] if space.channels == 1 else diffuse
    return Material(**parts)


def _result(
    jobs: Sequence[tuple[Rows, Space, Float64Array]],
    found: Sequence[Float64Array],
    search: Search,
    model: str,
    metric: str,
    weights: str,
    energy_limit: float | None,
) -> Fit:
    code = METRICS.index(metric)
    sums, totals, by_side, on = [], [], {}, []
    for (rows, space, _), p in zip(jobs, found, strict=True):
        target = transform(rows.measured, code)
        sums.append(float(errors(rows, target, p[None], code)[0]))
        totals.append(float(rows.weight.sum()))
        by_side[space.side] = finish(sums[-1], totals[-1], code)
        on += space.at_bounds(p)
    material = _material(jobs, found) if model == "kurt" else None
    return Fit(
        model=model,
        metric=metric,
        weights=weights,
        channels=jobs[0][0].channels,
        material=material,
        parameters={space.side: p for (_, space, _), p in zip(jobs, found, strict=True)},
        error=finish(sum(sums), sum(totals), code),
        errors=by_side,
        stages=tuple(search.stages),
        at_bounds=tuple(on),
        rows=sum(len(rows.measured) for rows, _, _ in jobs),
        evaluations=search.evaluations,
        seconds=search.clock.seconds,
        stopped=search.stopped,
        energy=None if material is None else _energy(material, energy_limit),
    )


def _energy(material: Material, limit: float | None) -> dict[str, Any]:
    """``Fit.energy``."""
    found = energy(material).to_dict()
    kept = {name: found[name] for name in ("largest", "worst", "exceeds_from")}
    return {**kept, "limit": limit}
