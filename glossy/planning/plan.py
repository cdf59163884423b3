"""Choose methods, sample counts and filter for an error that is accepted.

Every lobe has its candidates (``model.CANDIDATES``, none among them); the choice is the cheapest
combination whose bound, ``probe`` eqs. (2), (3), is within the error asked for. Candidates that
another one beats in cost, error and bound alike are left out; then all combinations are tried.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from .._arguments import checked
from ..brdf import Lobe, Material
from ..frames import SurfacePoints
from ..planes import BoundingPlanes
from ..pyramid import FILTERS as ALL_FILTERS
from ..pyramid import Pyramid, build_pyramid
from .model import CANDIDATES, FILTERS, Candidate, build_cost, lobe_cost
from .probe import Probe, Truths, alone, finest, probe, truths
from .views import Views, any_views, of_picture

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

MOST_COMBINATIONS = 20_000
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
        Relative RMS error of the picture's glossy radiance: asked for, expected, and what it stays
        under. Without points ``error`` is that of views in all directions and ``bound`` that of
        the worst narrow view of a plane, under up to 80 degrees.
    reached : bool
        Whether ``bound`` is within ``max_error``. If not, this is the least bound there is.
    cost : float
        Time of a pixel over that of ``regular`` with 20 samples for the same lobes, with the
        pyramid's share if ``pixels`` was given.
    reasons : tuple of str
    bound_kind : "bound" or "estimate"
        A "bound" holds for the picture of these points, looked up without bounding planes: all of
        them were measured. An "estimate" is of points drawn, of views that are not known, or made
        without the planes that there will be.
    points : int
        How many were measured.
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
    bound_kind: str = "estimate"
    points: int = 0

    @property
    def samples(self) -> list[int]:
        """Taps of each lobe."""
        return [lobe.samples for lobe in self.lobes]

    def to_dict(self) -> dict[str, Any]:
        """Everything, fit for JSON."""
        found = dataclasses.asdict(self)
        return {
            **found,
            "bound": self.bound if math.isfinite(self.bound) else None,
            "lobes": list(found["lobes"]),
            "samples": self.samples,
            "reasons": list(self.reasons),
        }


@checked
def plan(
    material: Material | Lobe,
    pyramid: Pyramid,
    *,
    max_error: float = 0.05,
    filters: Sequence[str] | None = None,
    pixels: int | None = None,
    points: SurfacePoints | None = None,
    parallax: BoundingPlanes | None = None,
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
    points : SurfacePoints, optional
        What will be shaded. Left out, the bound has to cover views of up to 80 degrees of any
        surface, however narrow, which takes more taps and often cannot be had.
    parallax : BoundingPlanes, optional
        What lookups will be turned by. The plan is measured without, so that its bound is an
        estimate.

    Returns
    -------
    Plan

    Raises
    ------
    ValueError
        For a pyramid of other than three channels, points of another type, an unknown filter, or a
        value out of range.
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
    own, lobes = pyramid.filter or OWN, material.sided_lobes()
    if not lobes or (points is not None and not points.coverage.any()):
        why = "nothing is seen" if lobes else "no glossy lobe"
        rows = _rows(material, [CANDIDATES[0]] * len(lobes))
        return Plan("none", rows, own, goal, 0.0, 0.0, True, 0.0, (why,), "bound")
    cube = finest(pyramid)
    views = any_views(pyramid) if points is None else of_picture(points, material, pyramid)
    truth = truths(material, cube, views)
    choose = functools.partial(_plan_one, material, views, truth, goal, shared)
    found = [choose(pyramid, own)]
    for name in dict.fromkeys(names if pyramid.filter is not None else ()):
        if name != pyramid.filter:
            other = build_pyramid(cube, filter=name, storage=pyramid.storage)
            found.append(choose(other, name))
    best = min(found, key=_rank)
    if parallax is not None:
        why = "measured without the bounding planes: the bound is an estimate"
        best = dataclasses.replace(best, bound_kind="estimate", reasons=(*best.reasons, why))
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
    material: Material,
    views: Views,
    truth: Truths,
    goal: float,
    pixels: int | None,
    pyramid: Pyramid,
    filter: str,
) -> Plan:
    """The plan for one pyramid."""
    measured = probe(material, pyramid, views, truth)
    costs = np.array([lobe_cost(c.method, c.samples) for c in CANDIDATES])
    choice = _combinations([_front(measured, j, costs) for j in range(len(truth.radiance))])
    price = costs[choice].sum(axis=1)
    error, bound = measured.measure(choice)
    fits = bound <= goal
    order = np.lexsort((bound, price)) if fits.any() else np.lexsort((price, bound))
    best = int(order[np.argmax(fits[order])]) if fits.any() else int(order[0])
    rows = _rows(material, [CANDIDATES[k] for k in choice[best]])
    used = {row.method for row in rows if row.samples}
    share = 0.0
    if pixels is not None and pyramid.filter is not None:
        share = build_cost(pyramid.filter, pyramid.size) / pixels
    return Plan(
        method=used.pop() if len(used) == 1 else "mixed" if used else "none",
        lobes=rows,
        filter=filter,
        max_error=goal,
        error=float(error[best]),
        bound=float(bound[best]),
        reached=bool(fits.any()),
        cost=float(price[best]) / len(rows) + share,
        reasons=_reasons(measured, choice[best], rows, bool(fits.any())),
        bound_kind="bound" if views.complete else "estimate",
        points=len(views.weight),
    )


def _rows(material: Material, picked: Sequence[Candidate]) -> tuple[LobePlan, ...]:
    return tuple(
        LobePlan(*lobe.widths, "reflection" if side > 0.0 else "transmission", c.method, c.samples)
        for (lobe, side), c in zip(material.sided_lobes(), picked, strict=True)
    )


def _front(measured: Probe, lobe: int, costs: Float64Array) -> Int64Array:
    """Candidates of one lobe that no cheaper one beats, alone, in both error and bound."""
    error, bound = measured.alone(lobe)
    least = np.full(2, np.inf)
    kept: list[int] = []
    for k in np.lexsort((error, costs)):
        if not kept or error[k] < least[0] or bound[k] < least[1]:
            kept.append(int(k))
            least = np.minimum(least, (error[k], bound[k]))
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
    said = []
    for j, (row, k) in enumerate(zip(rows, choice, strict=True)):
        error = measured.alone(j)[0]
        whole, wrong = error[0], error[k]  # without a tap a lobe is wrong by all of itself
        text = f"lobe {j} (m = {row.mx:g}, {row.my:g}) is {whole:.3g} of the radiance: "
        if row.samples == 0:
            said.append(text + "left out")
        else:
            one = row.samples == 1
            taps, left = ("1 tap", "leaves") if one else (f"{row.samples} taps", "leave")
            said.append(f"{text}{taps} of {row.method} {left} an error of {wrong:.3g}")
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
