"""Regular sampling as a shader: one density constant per pattern, three footprints."""

import numpy as np

from .. import _check
from ..pattern import Float64Array, Pattern, distribution, pattern_for_budget
from ..shading import NORMALISATIONS
from .footprints import LEVEL, TEXELS, level
from .tables import made_by
from .template import Constant, Equation, Part, ShaderLobe

MEANS: dict[str, Equation] = {
    "paper": ("p_h = mean of D(wh) over the pattern", "(4)", "paper eq. 18"),
    "projected": ("p_h = mean of D(wh) (wh.n) over the pattern", "(4)", ""),
}
ESTIMATE: tuple[Equation, ...] = (
    ("L = 1/n sum L_mip(wi, level) f (wi.n) / p, p = p_h / (4 (wi.wh))", "", "paper eqs. 9, 17"),
    ("  = ks / (n p_h) sum L_mip D(wh) F (wi.n) / ((wi.n) (wo.n))^alpha", "(5)", ""),
)


def equations(
    *, footprint: str = "paper", normalisation: str = "paper", **_: object
) -> list[Equation]:
    """What the head of the shader says of the estimate and of the level."""
    return [MEANS[normalisation], *ESTIMATE, TEXELS[footprint], LEVEL]


def part(
    lobe: ShaderLobe,
    *,
    samples: int = 20,
    threshold: float = 0.1,
    footprint: str = "paper",
    normalisation: str = "paper",
    bias: float = 0.0,
    pattern: Pattern | None = None,
) -> Part:
    """The function of one lobe; options as in ``glossy.shade``."""
    _check.choice("normalisation", normalisation, NORMALISATIONS)
    own = pattern or pattern_for_budget(lobe.lobe, samples=samples, threshold=threshold)
    how = level(lobe, own, footprint, threshold, bias)
    d = distribution(own.half_vectors, *lobe.lobe.widths)
    density, constants = _densities(own, d, normalisation)
    taps = np.column_stack([own.half_vectors, d])
    return Part(
        made_by(own),
        len(own),
        [*constants, ("TAPS", taps, "wh (t, b, n), D(wh) [1/sr]"), *how.constants],
        horizon="adds nothing, counts in n",
        before=[*how.before, "var sum: vec3<f32> = vec3<f32>(0.0, 0.0, 0.0);"],
        tap=[
            *how.lookup,
            *lobe.fresnel_line,
            f"let weight: f32 = ${{C}}_TAPS[k].w * {lobe.cosines};",
            f"sum += weight * {lobe.fresnel_factor}radiance;  // (5)",
        ],
        after=[f"return ${{C}}_KS / (f32(${{C}}_SIZE) * ${{C}}_{density}) * sum;"],
    )


def _densities(own: Pattern, d: Float64Array, normalisation: str) -> tuple[str, list[Constant]]:
    """Both density constants, and the name of the one in use."""
    projected = d * own.half_vectors[:, 2]
    both = {
        "paper": ("PDF", own.pdf_constant, d, "D(wh)"),
        "projected": ("PDF_PROJECTED", own.projected_pdf_constant, projected, "D(wh) (wh.n)"),
    }
    constants: list[Constant] = []
    for kind, (name, given, values, text) in both.items():
        mean = float(values.mean()) if given is None else given
        use = ": p_h of (4)" if kind == normalisation else ""
        constants.append((name, mean, f"mean of {text} [1/sr]{use}"))
        if kind == normalisation and not np.float32(mean) > 0.0:
            raise _check.fail("pattern", "must have a density that single precision holds", mean)
    return both[normalisation][0], constants
