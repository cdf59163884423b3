"""Samples of a planar reflector's lobes: several rings or a line, and what they weigh.

The thesis's multi-ring pattern for round lobes, its line for strongly anisotropic ones
(``thesis_pattern``); regular and importance patterns beside them. Samples are weighed by an
estimator of ``thesis`` (4.23, 4.24, 4.25), or summed as ``shading`` does, with the density of the
regular pattern (``paper``, ``projected``) or of the lobe (``importance``).

Source: thesis section 4.5.3, which names no weights of its own; eq. 4.25 is the one it evaluates.
"""

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from ..brdf import Lobe, Material
from ..footprint import border_sines
from ..pattern import Pattern, importance_pattern, pattern_for_budget
from ..pyramid import Pyramid
from ..shading import importance_table, regular_table
from ..tap_table import Patterns, TapTable, patterns_of
from ..thesis import ESTIMATORS as MEANS
from ..thesis import MeanTable, thesis_table
from ..thesis_pattern import ANISOTROPY, thesis_pattern

Float64Array = npt.NDArray[np.float64]

KINDS = ("auto", "multi-ring", "ring", "line", "blend", "regular", "importance")
ESTIMATORS = ("auto", *MEANS, "paper", "projected", "importance")
SUM = -1  # no mean: the weights hold 1/n


def planar_pattern(
    lobe: Lobe,
    samples: int = 10,
    kind: str = "auto",
    threshold: float = 0.01,
    anisotropy: float = ANISOTROPY,
) -> Pattern:
    """Half vectors for one lobe of a planar reflector.

    Parameters
    ----------
    lobe : Lobe
    samples : int >= 1
        Exact, but for "regular": the nearest count.
    kind : "auto", "multi-ring", "ring", "line", "blend", "regular" or "importance"
        "auto" is the line if the ratio of the widths is below ``anisotropy``, else several rings.
    threshold : float in (0, 1)
        Share of the lobe's peak at its border; no matter for "importance".
    anisotropy : float in (0, 1]

    Raises
    ------
    ValueError
        For an argument out of range.
    """
    _check.choice("kind", kind, KINDS)
    if kind == "importance":
        return importance_pattern(lobe, samples)
    if kind == "regular":
        return pattern_for_budget(lobe, samples, threshold)
    if kind == "auto":
        limit = _check.in_range("anisotropy", anisotropy, 0.0, 1.0, open_low=True)
        kind = "line" if min(lobe.widths) < limit * max(lobe.widths) else "multi-ring"
    return thesis_pattern(lobe, samples, kind, threshold, anisotropy)


def planar_table(
    material: Material,
    pyramid: Pyramid,
    samples: int = 10,
    kind: str = "auto",
    threshold: float = 0.01,
    anisotropy: float = ANISOTROPY,
    estimator: str = "auto",
    bias: float = 0.0,
    pattern: Patterns = None,
) -> tuple[TapTable, int]:
    """The samples of all lobes, and the estimator's code (``SUM`` or an index of the means).

    Footprints are those of the samples' cells; ``borders`` (L, 2) the sines of the lobe's border.

    Raises
    ------
    ValueError
        For an argument out of range, or transmission, which a mirror does not show.
    """
    if material.transmission:
        rule = "must have no transmission on a planar reflector"
        raise _check.fail("material", rule, f"{len(material.transmission)} lobes")
    _check.choice("estimator", estimator, ESTIMATORS)
    lobes = [lobe for lobe, _ in material.sided_lobes()]
    given = patterns_of(pattern, len(lobes))
    own = [
        p or planar_pattern(lobe, samples, kind, threshold, anisotropy)
        for p, lobe in zip(given, lobes, strict=True)
    ]
    if estimator == "auto":
        summed = {"regular": "paper", "importance": "importance"}
        estimator = "4.25" if pattern is not None else summed.get(kind, "4.25")
    common: dict[str, Any] = {"bias": bias, "pattern": own}
    table: TapTable
    if estimator in MEANS:
        table = thesis_table(
            material,
            pyramid,
            threshold=threshold,
            estimator=estimator,
            footprint="jacobian",
            **common,
        )
    elif estimator == "importance":
        table = importance_table(material, pyramid, **common)
    else:
        table = regular_table(
            material,
            pyramid,
            threshold=threshold,
            normalisation=estimator,
            footprint="jacobian",
            **common,
        )
    borders = [border_sines(*lobe.widths, threshold) for lobe in lobes]
    table = dataclasses.replace(table, borders=np.array(borders).reshape(-1, 2))
    return table, table.estimator if isinstance(table, MeanTable) else SUM


def border_vectors(table: TapTable) -> Float64Array:
    """(L, 4, 3) half vectors at each lobe's border: both ways along the tangent, the bitangent."""
    out = np.zeros((len(table.borders), 4, 3))
    for j, sines in enumerate(table.borders):
        for axis, sine in enumerate(sines):
            for k, sign in enumerate((1.0, -1.0)):
                out[j, 2 * axis + k, axis] = sign * sine
                out[j, 2 * axis + k, 2] = math.sqrt(1.0 - sine * sine)
    return out
