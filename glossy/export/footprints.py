"""The level of a sample of a pattern with a border: three footprints, as code of the loop."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from .. import _check
from ..footprint import FOOTPRINTS
from ..pattern import Float64Array, Pattern
from ..tap_table import cut_row
from .template import Constant, Equation, ShaderLobe

TEXELS: dict[str, Equation] = {
    "paper": ("texels = A N^2 / (4 n) d / (wi.wh)", "(6)", "paper eq. 16"),
    "thesis": ("texels = A N^2 / (4 n) d^3", "(6)", "thesis eqs. 4.14-4.17"),
    "jacobian": ("texels = 4 (wi.wh) cell N^2 / 4 d^3", "(6)", ""),
}
LEVEL: Equation = ("level = log2(texels) / 2 + bias", "(7)", "")
CODE = {
    "paper": "spread * d / cosH",
    "thesis": "spread * (d * d * d)",
    "jacobian": "CELL * size * size * cosH * (d * d * d)",
}
SIZE = "let size: f32 = ${name}FaceSize(env, envSampler);"
SPREAD = (
    "let area: f32 = ${name}LobeArea(${C}_BORDER, wo);",
    "let spread: f32 = area * size * size / (4.0 * f32(${C}_SIZE));",
)
LOOKUP = "let radiance: vec3<f32> = textureSampleLevel(env, envSampler, direction, level).rgb;"


def lookup(texels: str) -> list[str]:
    """Lines of the loop from the texels of a sample to its radiance."""
    return [
        f"let texels: f32 = {texels};  // (6)",
        "let level: f32 = 0.5 * log2(texels) + ${C}_BIAS;  // (7)",
        LOOKUP,
    ]


def bias_constant(bias: float) -> Constant:
    """What every level is shifted by."""
    return "BIAS", _check.number("bias", bias), "added to every level"


@dataclasses.dataclass(frozen=True)
class Level:
    """Constants, lines before the loop, and lines of the loop that end in ``radiance``."""

    constants: Sequence[Constant]
    before: Sequence[str]
    lookup: Sequence[str]


def level(
    lobe: ShaderLobe, pattern: Pattern, footprint: str, threshold: float, bias: float
) -> Level:
    """How a sample finds its level; ``threshold`` for a pattern that records none."""
    _check.choice("footprint", footprint, FOOTPRINTS)
    none: Float64Array = np.zeros(len(pattern))
    border = cut_row(lobe.lobe, pattern, none, footprint, threshold)[3]
    shift = bias_constant(bias)
    if footprint != "jacobian":
        xi = threshold if pattern.threshold is None else pattern.threshold
        sines: Constant = ("BORDER", np.array(border), f"sines of theta_u, theta_v at {xi:g}")
        return Level([sines, shift], [SIZE, *SPREAD], lookup(CODE[footprint]))
    cells, text = pattern.cell, "${C}_CELL"
    if isinstance(cells, np.ndarray):
        cells, text = cells[:, None], "${C}_CELL[k]"
    assert cells is not None
    solid: Constant = ("CELL", cells, "solid angle of half vectors per sample [sr]")
    return Level([solid, shift], [SIZE], lookup(CODE[footprint].replace("CELL", text)))
