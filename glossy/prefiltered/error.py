"""How far a sum of lobe stacks is from the BRDF it stands for, view by view.

With v what is approximated (f, or f cos theta_i) and q the lobes, over the directions above the
horizon::

    rms     = sqrt( int (q - v)^2 dw / int v^2 dw )                                        (1)
    furnace = (factor sum_l k int p_l dw - albedo) / mean albedo of the channels            (2)

(1) is M's measure, of the BRDF without the cosine of the estimate; M does not say how the views are
weighed, so each view has its own figure here. (2) is the error of the brightness under an even sky,
whose light below the horizon counts as well.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from ..frames import spherical
from .slices import Float64Array, glossy_part, half_width, make_slice
from .stack import LobeStack

CELLS = (211, 90)  # of the quadrature: not those of the fit


@dataclasses.dataclass(frozen=True, eq=False)
class LobeError:
    """Errors by view: ``cosines`` (V,), ``rms`` (V,) eq. (1), ``furnace`` (V, C) eq. (2)."""

    cosines: Float64Array
    rms: Float64Array
    furnace: Float64Array


def lobe_error(
    material: Any, stacks: Sequence[LobeStack], cosines: npt.ArrayLike = (0.1, 0.3, 0.5, 0.7, 0.9)
) -> LobeError:
    """Errors of stacks at views of elevation cos theta_o (V,), all channels together in eq. (1).

    Raises
    ------
    ValueError
        If there is no stack, stacks of both kinds of cosine, or a cosine outside (0, 1].
    """
    kinds = {s.cosine_outside for s in stacks}
    if len(kinds) != 1:
        raise _check.fail("stacks", "must be some, of one kind of cosine", len(stacks))
    (outside,) = kinds
    views = np.atleast_1d(_check.array("cosines", cosines)).astype(np.float64)
    if views.ndim != 1 or not np.all((views > 0.0) & (views <= 1.0)):
        raise _check.fail("cosines", "must be a vector within (0, 1]", cosines)
    glossy = glossy_part(material)
    scale = half_width(glossy)
    rms, furnace = [], []
    for c in views:
        piece = make_slice(glossy, float(c), scale, bool(outside), CELLS)
        wo = spherical(math.acos(float(c)), 0.0)
        lobes = np.asarray(sum(s.evaluate(piece.wi, wo) for s in stacks))
        apart = np.sum(piece.area @ (lobes - piece.value) ** 2)
        whole = np.sum(piece.area @ piece.value**2)
        rms.append(math.sqrt(float(apart / whole)))
        light = sum(s.furnace(wo) for s in stacks)
        furnace.append((light - piece.albedo) / piece.albedo.mean())
    return LobeError(views, np.array(rms), np.array(furnace))
