"""What candidates cost, and how far the error of a picture may lie above that of the probe.

Cost: a pixel's time is, for each lobe, ``pixel + tap n`` of the method; a pyramid costs ``build`` a
texel of its finest level. The unit is a pixel of one lobe by ``regular`` with 20 samples.

Error: with e the error of a choice in the probe as a whole and e_q its ``QUANTILE`` over the
probe's cameras ::

    error = a e                                                                             (1)
    bound = b sqrt(max(e, e_q)^2 + f^2)                                                     (2)

a, b and f (the yardstick's own error) come from pictures of training maps:
``benchmarks/calibrate_plan.py`` writes them to ``constants.json``.
"""

import dataclasses
import functools
import importlib.resources
import json
from typing import Any

import numpy as np
import numpy.typing as npt

Float64Array = npt.NDArray[np.float64]

QUANTILE = 0.9
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


@functools.cache
def constants() -> dict[str, Any]:
    """The calibration: ``cost`` and ``error``."""
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


def predict(whole: Float64Array, cameras: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Expected error (M,) and its 90 % bound, eqs. (1), (2), from ``Probe.errors``."""
    c = constants()["error"]
    worst = np.maximum(np.quantile(cameras, QUANTILE, axis=1), whole)
    return c["scale"] * whole, c["bound"] * np.hypot(worst, c["floor"])
