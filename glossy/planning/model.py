"""Candidates, and what they cost.

A pixel's time is, for each lobe, ``pixel + tap n`` of the method; a pyramid costs ``build`` a texel
of its finest level. The unit is a pixel of one lobe by ``regular`` with 20 samples.
``benchmarks/calibrate_plan.py`` measures the constants and writes ``constants.json``.
"""

import dataclasses
import functools
import importlib.resources
import json
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import methods
from ..brdf import Material
from ..frames import SurfacePoints
from ..pyramid import Pyramid

BASELINE = 20  # samples of ``regular`` that make the unit of cost


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One way to do a lobe: a method with its number of samples; 0 leaves the lobe out."""

    method: str
    samples: int


CANDIDATES = (
    Candidate("none", 0),
    *(Candidate("lattice", n) for n in (*range(1, 13), 14, 16, 18, 20, 24, 28, 32, 40, 48, 64)),
    *(Candidate("regular", n) for n in (14, 20, 30, 50)),
    *(Candidate("importance", n) for n in (64, 100, 150, 200, 300, 400, 512)),
)
"""``regular`` has the ``jacobian`` footprint; everything else is at its defaults."""

FILTERS = ("box", "gauss6", "round")


def candidate_options(candidate: Candidate) -> dict[str, Any]:
    """Options of a candidate's method."""
    footprint = {"footprint": "jacobian"} if candidate.method == "regular" else {}
    return {"samples": candidate.samples, **footprint}


def run_candidate(
    candidate: Candidate,
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    precision: str = "single",
) -> npt.NDArray[np.floating]:
    """Radiance (..., 3) of a material's lobes, each with the same candidate."""
    run, own = methods.resolve(candidate.method), candidate_options(candidate)
    out: npt.NDArray[np.floating] = run(points, material, pyramid, precision=precision, **own)
    return out


@functools.cache
def constants() -> dict[str, Any]:
    """The calibration, ``cost``."""
    file = importlib.resources.files("glossy.planning").joinpath("constants.json")
    found: dict[str, Any] = json.loads(file.read_text())
    return found


def lobe_cost(method: str, samples: int) -> float:
    """Time of one lobe of a pixel, in units of ``regular`` with 20 samples."""
    if samples == 0:
        return 0.0
    table = constants()["cost"]
    pixel, tap = table[method]
    base_pixel, base_tap = table["regular"]
    return float((pixel + tap * samples) / (base_pixel + base_tap * BASELINE))


def build_cost(filter: str, size: int) -> float:
    """Time of making a pyramid of a map of ``size``, in the same unit."""
    return 6.0 * size * size * float(constants()["cost"]["build"][filter])
