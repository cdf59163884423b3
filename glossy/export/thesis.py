"""The thesis's estimators as a shader: a mean of the samples above the horizon."""

import numpy as np

from .. import _check
from ..pattern import Pattern, distribution
from ..thesis import ESTIMATORS
from ..thesis_pattern import thesis_pattern
from .footprints import LEVEL, TEXELS, level
from .tables import made_by
from .template import Equation, Part, ShaderLobe

MEAN: tuple[Equation, ...] = (
    ("p = D(wh) (wh.n) / (4 (wo.wh))", "(4)", "paper eq. 10"),
    ("X = f (wi.n) / (ks p) = F (wi.n) / (wh.n) / ((wi.n) (wo.n))^alpha", "", ""),
)
WEIGHTS: dict[str, Equation] = {
    "4.23": ("L = ks sum w L_mip X / sum w, w = p", "(5)", "thesis eq. 4.23"),
    "4.24": ("L = ks sum w L_mip X / sum w, w = p (wi.n)", "(5)", "thesis eq. 4.24"),
    "4.25": ("L = ks sum w L_mip X / sum w, w = p X", "(5)", "thesis eq. 4.25"),
}
SHARES = {"4.23": "density", "4.24": "density * wi.z", "4.25": "density * weight"}


def equations(*, footprint: str = "thesis", estimator: str = "4.25", **_: object) -> list[Equation]:
    """What the head of the shader says of the estimate and of the level."""
    return [*MEAN, WEIGHTS[estimator], TEXELS[footprint], LEVEL]


def part(
    lobe: ShaderLobe,
    *,
    samples: int = 20,
    kind: str = "auto",
    threshold: float = 0.01,
    estimator: str = "4.25",
    footprint: str = "thesis",
    bias: float = 0.0,
    pattern: Pattern | None = None,
) -> Part:
    """The function of one lobe; options as in ``glossy.shade``.

    The weights w are scaled by factors of the pattern and of the pixel, which cancel, so that
    single precision holds them.
    """
    _check.choice("estimator", estimator, ESTIMATORS)
    own = pattern or thesis_pattern(lobe.lobe, samples, kind, threshold)
    how = level(lobe, own, footprint, threshold, bias)
    p_h = distribution(own.half_vectors, *lobe.lobe.widths) * own.half_vectors[:, 2]
    taps = np.column_stack([own.half_vectors, p_h / max(float(p_h.max()), 1e-300)])
    share, before = SHARES[estimator], ["var sum: vec3<f32> = vec3<f32>(0.0, 0.0, 0.0);"]
    if estimator == "4.25" and lobe.lobe.alpha:
        before.append("let scale: f32 = pow(wo.z, ${C}_ALPHA);  // cancels, keeps w near 1")
        share += " * scale"
    if estimator == "4.25" and lobe.fresnel:
        type_, share = "vec3<f32>", f"{share} * fresnel"
        before.append("var norm: vec3<f32> = vec3<f32>(0.0, 0.0, 0.0);")
        result = "max(norm, vec3<f32>(1e-30, 1e-30, 1e-30))"
    else:
        type_, result = "f32", "max(norm, 1e-30)"
        before.append("var norm: f32 = 0.0;")
    return Part(
        made_by(own),
        len(own),
        [("TAPS", taps, "wh (t, b, n), D(wh) (wh.n) over its largest"), *how.constants],
        horizon="left out of both sums",
        before=[*how.before, *before],
        tap=[
            *how.lookup,
            *lobe.fresnel_line,
            f"let weight: f32 = {lobe.cosines} / wh.z;  // X without F",
            "let density: f32 = ${C}_TAPS[k].w * wo.z / cosH;  // (4), scaled",
            f"let share: {type_} = {share};  // w, scaled",
            f"sum += share * weight * {lobe.fresnel_factor}radiance;",
            "norm += share;",
        ],
        after=[f"return ${{C}}_KS * sum / {result};  // (5)"],
    )
