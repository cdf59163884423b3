"""Choose methods, sample counts and filter for an error that is accepted.

Every lobe has its candidates (``model.CANDIDATES``, none among them); the choice is the cheapest
combination whose bound, ``model`` eq. (2), is within the error asked for. Candidates that another
one beats in cost and error alike are left out first; then all combinations are tried.
"""

import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from ..brdf import Lobe, Material
from ..cubemap import CubeMap
from ..pyramid import FILTERS as ALL_FILTERS
from ..pyramid import Pyramid, build_pyramid
from .model import CANDIDATES, FILTERS, Candidate, build_cost, lobe_cost, predict
from .probe import Probe, alone, probe

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

MOST_COMBINATIONS = 100_000
OWN = "as given"  # the filter of an explicit chain, which is not known


@dataclasses.dataclass(frozen=True)
class LobePlan:
    """How one lobe is done: ``method`` with ``samples`` taps; "none" with 0 leaves it out."""

    mx: float
    my: float
    side: str
    method: str
    samples: int


@dataclasses.dataclass(frozen=True)
class Plan:
    """What ``plan`` chose and what it expects.

    Attributes
    ----------
    method : str
        The one of the lobes; "mixed" if they differ, "none" if no lobe is worth a tap.
    lobes : tuple of LobePlan
        Reflection lobes, then transmission lobes; those with ks = 0 are left out.
    filter : str
        Of the pyramid the plan is for.
    max_error, error, bound : float
        Relative RMS error of the picture's glossy radiance: asked for, expected, and what nine
        pictures of ten stay under.
    reached : bool
        Whether ``bound`` is within ``max_error``. If not, this is the least bound there is.
    cost : float
        Time of a pixel over that of ``regular`` with 20 samples for the same lobes, with the
        pyramid's share if ``pixels`` was given.
    reasons : tuple of str
    """

    method: str
    lobes: tuple[LobePlan, ...]
    filter: str
    max_error: float
    error: float
    bound: float
    reached: bool
    cost: float
    reasons: tuple[str, ...]

    @property
    def samples(self) -> list[int]:
        """Taps of each lobe."""
        return [lobe.samples for lobe in self.lobes]

    def to_dict(self) -> dict[str, Any]:
        """Everything, fit for JSON."""
        found = dataclasses.asdict(self)
        return {
            **found,
            "lobes": list(found["lobes"]),
            "samples": self.samples,
            "reasons": list(self.reasons),
        }


def plan(
    material: Material | Lobe,
    pyramid: Pyramid,
    *,
    max_error: float = 0.05,
    filters: Sequence[str] | None = None,
    pixels: int | None = None,
) -> Plan:
    """Choose method and samples of every lobe, and the pyramid's filter.

    Parameters
    ----------
    material : Material, or a Lobe alone
    pyramid : Pyramid
        Of three channels.
    max_error : float in (0, 1)
        Accepted relative RMS error of the picture's glossy radiance: root of the mean squared
        error over the mean squared radiance, against the exact integral over the same map.
    filters : sequence of str, optional
        Filters to choose among besides the pyramid's own: box, gauss6 and round unless given.
        None is tried for an explicit chain of levels, whose map is not known.
    pixels : int, optional
        Pixels shaded each time the map changes, so that building counts; left out, the map stays.

    Returns
    -------
    Plan

    Raises
    ------
    ValueError
        For a pyramid of other than three channels, an unknown filter, or a value out of range.
    """
    if isinstance(material, Lobe):
        material = Material(reflection=[material])
    if not isinstance(material, Material):
        raise _check.fail("material", "must be a Material or a Lobe", material)
    if not isinstance(pyramid, Pyramid) or pyramid.channels != 3:
        raise _check.fail("pyramid", "must be a Pyramid of three channels", pyramid)
    goal = _check.in_range("max_error", max_error, 0.0, 1.0, open_low=True, open_high=True)
    shared = None if pixels is None else _check.count("pixels", pixels)
    names = FILTERS if filters is None else filters
    for name in names:
        _check.choice("filters", name, ALL_FILTERS)
    found = [_plan_one(material, pyramid, pyramid.filter or OWN, goal, shared)]
    if pyramid.filter is not None and material.sided_lobes():
        cube = CubeMap(pyramid.levels[0])
        for name in dict.fromkeys(names):
            if name != pyramid.filter:
                other = build_pyramid(cube, filter=name, storage=pyramid.storage)
                found.append(_plan_one(material, other, name, goal, shared))
    best = min(found, key=_rank)
    if len(found) > 1:
        rest = ", ".join(f"{p.filter} {_figures(p)}" for p in found if p is not best)
        best = dataclasses.replace(
            best, reasons=(*best.reasons, f"filter {best.filter} {_figures(best)}; others: {rest}")
        )
    return best


def _figures(found: Plan) -> str:
    return f"costs {found.cost:.2f} for a bound of {found.bound:.3g}"


def _rank(found: Plan) -> tuple[bool, float, float]:
    """Within the error first, then cheap; out of reach, the least bound."""
    second = found.cost if found.reached else found.bound
    return not found.reached, second, found.bound


def _plan_one(
    material: Material, pyramid: Pyramid, filter: str, goal: float, pixels: int | None
) -> Plan:
    """The plan for one pyramid."""
    lobes = material.sided_lobes()
    share = 0.0
    if pixels is not None and pyramid.filter is not None:
        share = build_cost(pyramid.filter, pyramid.size) / pixels
    if not lobes:
        return Plan("none", (), filter, goal, 0.0, 0.0, True, share, ("no glossy lobe",))
    measured = probe(material, pyramid)
    costs = np.array([lobe_cost(c.method, c.samples) for c in CANDIDATES])
    fronts = [_front(measured, j, costs) for j in range(len(lobes))]
    choice = _combinations(fronts)
    price = costs[choice].sum(axis=1)
    error, bound = predict(*measured.errors(choice))
    fits = bound <= goal
    order = np.lexsort((bound, price)) if fits.any() else np.lexsort((price, bound))
    best = int(order[np.argmax(fits[order])]) if fits.any() else int(order[0])
    picked = [CANDIDATES[k] for k in choice[best]]
    rows = tuple(
        LobePlan(*lobe.widths, "reflection" if side > 0.0 else "transmission", c.method, c.samples)
        for (lobe, side), c in zip(lobes, picked, strict=True)
    )
    used = {row.method for row in rows if row.samples}
    return Plan(
        method=used.pop() if len(used) == 1 else "mixed" if used else "none",
        lobes=rows,
        filter=filter,
        max_error=goal,
        error=float(error[best]),
        bound=float(bound[best]),
        reached=bool(fits.any()),
        cost=float(price[best]) / len(lobes) + share,
        reasons=_reasons(measured, choice[best], rows, bool(fits.any())),
    )


def _front(measured: Probe, lobe: int, costs: Float64Array) -> Int64Array:
    """Candidates of one lobe that none beats both in cost and, alone, in error."""
    own = slice(measured.first[lobe], measured.first[lobe + 1])
    square = np.diagonal(measured.gram[0])[own]
    kept: list[int] = []
    for k in np.lexsort((square, costs)):
        if not kept or square[k] < square[kept[-1]]:
            kept.append(int(k))
    return np.array(kept, dtype=np.int64)


def _combinations(fronts: Sequence[Int64Array]) -> Int64Array:
    """(M, L) every choice of one candidate a lobe; with many lobes, of fewer candidates each."""
    most = max(int(MOST_COMBINATIONS ** (1.0 / len(fronts))), 2)
    thin = []
    for front in fronts:
        pick = np.unique(np.linspace(0, len(front) - 1, min(len(front), most)).round().astype(int))
        thin.append(front[pick].tolist())
    return np.array(list(itertools.product(*thin)), dtype=np.int64)


def _reasons(
    measured: Probe, choice: Int64Array, rows: Sequence[LobePlan], reached: bool
) -> tuple[str, ...]:
    power = max(float(measured.power[0]), np.finfo(np.float64).tiny)
    diagonal = np.diagonal(measured.gram[0])
    said = []
    for j, (row, k) in enumerate(zip(rows, choice, strict=True)):
        own = diagonal[measured.first[j] : measured.first[j + 1]]
        whole, wrong = math.sqrt(own[0] / power), math.sqrt(own[k] / power)
        text = f"lobe {j} (m = {row.mx:g}, {row.my:g}) is {whole:.3g} of the radiance: "
        if row.samples == 0:
            said.append(text + "left out")
        else:
            taps = "1 tap" if row.samples == 1 else f"{row.samples} taps"
            said.append(f"{text}{taps} of {row.method} leave an error of {wrong:.3g}")
    if not reached:
        said.append("no candidate is good enough: this is the least bound there is")
    return tuple(said)


def groups(material: Material, found: Plan) -> list[tuple[Candidate, Material]]:
    """The lobes that share a candidate, as one material each; lobes without taps are in none."""
    order: dict[Candidate, list[tuple[Lobe, float]]] = {}
    for pair, row in zip(material.sided_lobes(), found.lobes, strict=True):
        if row.samples:
            order.setdefault(Candidate(row.method, row.samples), []).append(pair)
    return [(c, _material(pairs)) for c, pairs in order.items()]


def _material(pairs: Sequence[tuple[Lobe, float]]) -> Material:
    if len(pairs) == 1:
        return alone(*pairs[0])
    return Material(
        reflection=[lobe for lobe, side in pairs if side > 0.0],
        transmission=[lobe for lobe, side in pairs if side < 0.0],
    )
