"""``method="auto"``: plans for the accepted error, then shades by the plan.

A plan is made for the points that are shaded, so that a pixel depends on which others are shaded
with it, by less than the error accepted; ``plan=`` shades parts of a picture, or several, by one.
The latest plans are kept with the pyramid, by material, error, points and the pyramid's coarse
levels, so that a picture shaded again is not planned again.
"""

import hashlib
import threading
import weakref
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from ..brdf import Material
from ..frames import SurfacePoints
from ..parallax import shade_planes
from ..planes import BoundingPlanes
from ..pyramid import Pyramid
from .model import candidate_options, run_candidate
from .plan import Plan, groups
from .plan import plan as make_plan
from .probe import state
from .views import looked_at

KEPT = 64  # plans of a pyramid

_lock = threading.Lock()

_plans: "weakref.WeakKeyDictionary[Pyramid, dict[Any, Plan]]" = weakref.WeakKeyDictionary()


def planned(
    material: Material,
    pyramid: Pyramid,
    max_error: float = 0.05,
    plan: Plan | None = None,
    points: SurfacePoints | None = None,
) -> Plan:
    """``plan`` of the arguments if there is one, else for the points, from the store if there."""
    if not isinstance(pyramid, Pyramid):
        raise _check.fail("pyramid", "must be a Pyramid of three channels", pyramid)
    if plan is not None:
        return _fitting(plan, material)
    key = (material, max_error, state(pyramid), None if points is None else _digest(points))
    with _lock:
        found = _plans.setdefault(pyramid, {}).get(key)
    if found is None:
        found = make_plan(material, pyramid, max_error=max_error, filters=(), points=points)
        with _lock:
            kept = _plans.setdefault(pyramid, {})
            kept[key] = found
            while len(kept) > KEPT:
                del kept[next(iter(kept))]
    return found


def _fitting(given: object, material: Material) -> Plan:
    """A plan as it is, if it is one for such lobes."""
    if not isinstance(given, Plan):
        raise _check.fail("plan", "must be a Plan", type(given).__name__)
    own = [(*lobe.widths, side > 0.0) for lobe, side in material.sided_lobes()]
    of = [(row.mx, row.my, row.side == "reflection") for row in given.lobes]
    if own != of:
        rule = f"must be for the material's lobes, which are {len(own)}"
        raise _check.fail("plan", rule, f"one for {of}")
    return given


def _digest(points: SurfacePoints) -> bytes:
    """Of what a plan looks at."""
    some, found = looked_at(points), hashlib.sha256(str(points.coverage.sum()).encode())
    for part in (some.normal, some.tangent, some.view):
        found.update(np.ascontiguousarray(part).data)
    return found.digest()


def auto(
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    *,
    precision: str = "single",
    max_error: float = 0.05,
    plan: Plan | None = None,
) -> npt.NDArray[np.floating]:
    """Shade with the fewest taps that keep an error.

    Parameters
    ----------
    max_error : float in (0, 1)
        As for ``plan``, for these points.
    plan : Plan, optional
        Shade by this one, and make none: for parts of a picture, or many pictures alike.
    precision : "single" or "double"
        Of the shading; the plan is the same.

    Returns
    -------
    (..., 3) radiance of the glossy lobes.

    Raises
    ------
    ValueError
        For a plan of other lobes, or as ``plan``.
    """
    dtype = _check.dtype_of(precision)
    out: npt.NDArray[np.floating] = np.zeros((*points.shape, 3), dtype=dtype)
    for candidate, part in groups(material, planned(material, pyramid, max_error, plan, points)):
        out += run_candidate(candidate, points, part, pyramid, precision)
    return out


def shade_plan(
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    _method: str,
    planes: BoundingPlanes,
    precision: str,
    options: Mapping[str, Any],
) -> npt.NDArray[np.floating]:
    """``auto`` with bounding planes: the plan is for the same points, uncorrected."""
    dtype = _check.dtype_of(precision)
    out: npt.NDArray[np.floating] = np.zeros((*points.shape, 3), dtype=dtype)
    for candidate, part in groups(material, planned(material, pyramid, points=points, **options)):
        own = candidate_options(candidate)
        out += shade_planes(points, part, pyramid, candidate.method, planes, precision, own)
    return out


def tap_counts(material: Material, pyramid: Pyramid, **options: Any) -> list[int]:
    """Taps that each lobe gets; options as for ``planned``."""
    return planned(material, pyramid, **options).samples
