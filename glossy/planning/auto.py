"""``method="auto"``: plans for the accepted error, then shades by the plan.

Plans are kept with the pyramid, by material, error and the pyramid's coarse levels, so that a
renderer pays for one when its map or material changes and not for every picture. The choice depends
on nothing but these, so that pixels do not depend on which others are shaded with them.
"""

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
from .plan import Plan, groups, plan
from .probe import candidate_options, run_candidate

COARSE = 16  # levels up to this size tell whether a pyramid was refilled

_plans: "weakref.WeakKeyDictionary[Pyramid, dict[Any, Plan]]" = weakref.WeakKeyDictionary()


def planned(material: Material, pyramid: Pyramid, max_error: float = 0.05) -> Plan:
    """``plan`` for the pyramid as it is, from the store if it is there."""
    if not isinstance(pyramid, Pyramid):
        raise _check.fail("pyramid", "must be a Pyramid of three channels", pyramid)
    texels = b"".join(level.tobytes() for level in pyramid.levels if level.shape[1] <= COARSE)
    key = (material, max_error, texels)
    kept = _plans.setdefault(pyramid, {})
    if key not in kept:
        kept[key] = plan(material, pyramid, max_error=max_error, filters=())
    return kept[key]


def auto(
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    *,
    precision: str = "single",
    max_error: float = 0.05,
) -> npt.NDArray[np.floating]:
    """Shade with the fewest taps that keep an error.

    Parameters
    ----------
    max_error : float in (0, 1)
        As for ``plan``.
    precision : "single" or "double"
        Of the shading; the plan is the same.

    Returns
    -------
    (..., 3) radiance of the glossy lobes.
    """
    dtype = _check.dtype_of(precision)
    out: npt.NDArray[np.floating] = np.zeros((*points.shape, 3), dtype=dtype)
    for candidate, part in groups(material, planned(material, pyramid, max_error)):
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
    """``auto`` with bounding planes: the plan is that of the map as its centre sees it."""
    dtype = _check.dtype_of(precision)
    out: npt.NDArray[np.floating] = np.zeros((*points.shape, 3), dtype=dtype)
    for candidate, part in groups(material, planned(material, pyramid, **options)):
        own = candidate_options(candidate)
        out += shade_planes(points, part, pyramid, candidate.method, planes, precision, own)
    return out


def tap_counts(material: Material, pyramid: Pyramid, max_error: float = 0.05) -> list[int]:
    """Taps that each lobe gets."""
    return planned(material, pyramid, max_error).samples
