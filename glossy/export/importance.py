"""Filtered importance sampling as a shader: each sample has its own density."""

import numpy as np

from ..pattern import Pattern, distribution, importance_pattern
from .footprints import LEVEL, SIZE, bias_constant, lookup
from .tables import made_by
from .template import Equation, Part, ShaderLobe

EQUATIONS: list[Equation] = [
    ("p_h = D(wh) (wh.n), p = p_h / (4 (wi.wh))", "(4)", "paper eqs. 10, 17"),
    ("L = 1/n sum L_mip(wi, level) f (wi.n) / p", "", "paper eq. 9"),
    ("  = ks / n sum L_mip F (wi.n) / (wh.n) / ((wi.n) (wo.n))^alpha", "(5)", ""),
    ("texels = N^2 / 4 d^3 / (n p) = (wi.wh) cell N^2 d^3", "(6)", "Colbert, Krivanek 2007"),
    LEVEL,
]


def equations(**_: object) -> list[Equation]:
    """What the head of the shader says of the estimate and of the level."""
    return EQUATIONS


def part(
    lobe: ShaderLobe, *, samples: int = 20, bias: float = 0.0, pattern: Pattern | None = None
) -> Part:
    """The function of one lobe; options as in ``glossy.shade``."""
    own = pattern or importance_pattern(lobe.lobe, samples=samples)
    h = own.half_vectors
    with np.errstate(divide="ignore"):
        cell = 1.0 / (len(h) * distribution(h, *lobe.lobe.widths) * h[:, 2])
    taps = np.column_stack([h, cell])
    return Part(
        made_by(own),
        len(own),
        [("TAPS", taps, "wh (t, b, n), cell = 1 / (n p_h) [sr]"), bias_constant(bias)],
        horizon="adds nothing, counts in n",
        before=[SIZE, "var sum: vec3<f32> = vec3<f32>(0.0, 0.0, 0.0);"],
        tap=[
            *lookup("${C}_TAPS[k].w * size * size * cosH * (d * d * d)"),
            *lobe.fresnel_line,
            f"let weight: f32 = {lobe.cosines} / wh.z;",
            f"sum += weight * {lobe.fresnel_factor}radiance;  // (5)",
        ],
        after=["return ${C}_KS / f32(${C}_SIZE) * sum;"],
    )
