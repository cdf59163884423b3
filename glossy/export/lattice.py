"""The lattice method as a shader: taps as polynomials, the lobe's frame, its table of reflectivity.

The lines follow ``lattice.frame`` and ``lattice.tap``; what a lobe does not need is left out: the
view's azimuth for a round lobe, the parts of the table that its Fresnel term does not read.
"""

import numpy as np

from ..lattice.frame import B1, B2, B3, B4, B5, FAR, GRAZING, INV_SQRT_2PI, NUDGE, P
from ..lattice.table import COLUMNS, DEGREE, ROWS, lattice_taps, reflectivity_table
from ..lattice.tap import KNEE
from ..taps import tap_constants
from .footprints import LOOKUP, SIZE, bias_constant
from .template import Constant, Equation, Part, ShaderLobe

TERMS = DEGREE + 1
PARTS = {"white": [0], "fresnel": [0, 1], "rest": [2]}
"""What is read of ``reflectivity_table``: R for F = 1, with F, with 1 - F."""

EQUATIONS: list[Equation] = [
    ("s = mean + z1 g1 + z2 g2, wh = (s, 1) / |(s, 1)|", "(4)", ""),
    ("w = w_k exp(|z|^2 / 2 - (sx/mx)^2 - (sy/my)^2) (wi.n) / (wh.n)", "", ""),
    ("  / max(wi.n, tau s2)^alpha: a ramp within a tap's width of the horizon", "", ""),
    ("L = ks R sum w F L_mip / sum w F, R: the lobe's albedo for ks = 1", "(5)", ""),
    ("texels = (tau s2)^2 a / a0 N^2 / 4 d^3, a = (wo.wh) (wh.n)^3: variance", "(6)", ""),
    ("level = the one whose tap is closest to a Gaussian of that variance", "(7)", ""),
]


def equations(**_: object) -> list[Equation]:
    """What the head of the shader says of the estimate and of the level."""
    return EQUATIONS


def _number(value: np.floating) -> str:
    return np.format_float_positional(value, unique=True, trim="0")


FRAME = f"""\
// Mean and covariance (xx, xy, yy) of the lobe's slopes: a Gaussian of variance m^2 / 2 times a
// ramp along the view, for (wi.n)^(1 - alpha); density, below: the normal distribution at reach.
let up: f32 = max(wo.z, {GRAZING:.6f});
let skew: vec2<f32> = ${{C}}_VARIANCE * wo.xy;
let along: f32 = max(dot(skew, wo.xy), 1e-30);
let root: f32 = sqrt(along);
let reach: f32 = min(up / (2.0 * root), {FAR:.1f});
let density: f32 = {_number(INV_SQRT_2PI)} * exp(-0.5 * reach * reach);
let q: f32 = 1.0 / (1.0 + {_number(P)} * reach);
let below: f32 = 1.0 - density * q * ({_number(B1)}
    + q * ({_number(B2)} + q * ({_number(B3)} + q * ({_number(B4)} + q * {_number(B5)}))));
let ramp: f32 = 2.0 * root / up;
let total: f32 = 1.0 / (below + ramp * density);
let shift: f32 = ramp * below * total;
let mean: vec2<f32> = ${{C}}_BETA * shift / root * skew;
let less: f32 = ${{C}}_BETA * (shift * shift - ramp * density * total) / along;
let own: vec3<f32> = vec3<f32>(${{C}}_VARIANCE.x, 0.0, ${{C}}_VARIANCE.y);
let cut: vec3<f32> = own - less * vec3<f32>(skew.x * skew.x, skew.x * skew.y, skew.y * skew.y);
let cutDet: f32 = own.x * own.z * (1.0 - less * along);
// Curvature of the cosines: the inverse grows by bend = max(4 (1 - alpha) - 1, 0).
let bend: f32 = max(4.0 * ${{C}}_BETA - 1.0, 0.0);
let scale: f32 = 1.0 / (1.0 + bend * (cut.x + cut.z) + bend * bend * cutDet);
let c: vec3<f32> = scale * (cut + bend * cutDet * vec3<f32>(1.0, 0.0, 1.0));
let det: f32 = cutDet * scale;

// J = [[j11, j12], [0, j22]]: how wi moves with the slope, at the mean; a0: its area factor / 4.
let hz: f32 = 1.0 / sqrt(1.0 + dot(mean, mean));
let h: vec2<f32> = mean * hz;
let cosMean: f32 = dot(wo.xy, h) + up * hz;
let p: vec2<f32> = hz * (wo.xy - cosMean * h);
let a0: f32 = cosMean * hz * hz * hz;
let j11: f32 = 2.0 * sqrt(p.x * p.x + cosMean * cosMean * hz * hz * (1.0 - h.x * h.x));
let j12: f32 = 4.0 * (p.x * p.y - cosMean * cosMean * hz * hz * h.x * h.y) / j11;
let j22: f32 = 4.0 * a0 / j11;

// Axes of J C J^T, of variances major = s1^2 >= minor = s2^2, and back in slopes: g1, g2.
let s11: f32 = j11 * j11 * c.x + 2.0 * j11 * j12 * c.y + j12 * j12 * c.z;
let s12: f32 = j22 * (j11 * c.y + j12 * c.z);
let s22: f32 = j22 * j22 * c.z;
// The nudge keeps rounding from turning the axes of a round lobe.
let square: f32 = j11 * j22 * j11 * j22 * det;
let longer: f32 = s11 - s22 + {NUDGE:.3f} * square / (s11 + s22);
let gap: f32 = sqrt(longer * longer + 4.0 * s12 * s12);
let major: f32 = 0.5 * (s11 + s22 + gap);
let minor: f32 = square / major;
var axis: vec2<f32> = vec2<f32>(1.0, 0.0);
if (gap > 0.0) {{
    axis = vec2<f32>(gap + longer, 2.0 * s12);
    if (longer < 0.0) {{
        axis = vec2<f32>(2.0 * s12, gap - longer);
    }}
    axis = axis / length(axis);
}}
let shear: f32 = j12 / j22;
let g1: vec2<f32> = sqrt(major) * vec2<f32>((axis.x - shear * axis.y) / j11, axis.y / j22);
let g2: vec2<f32> = sqrt(minor) * vec2<f32>((-axis.y - shear * axis.x) / j11, axis.x / j22);

// t: place of the elongation s1 / s2 in the tables; beyond 2^4 the width tau grows with it.
let octaves: f32 = max(0.5 * log2(major / minor), 0.0);
let t: f32 = min(octaves, 4.0) / 4.0;
let tau: f32 = exp2(${{C}}_WIDTH[0] + t * (${{C}}_WIDTH[1] + t * (${{C}}_WIDTH[2]
    + t * (${{C}}_WIDTH[3] + t * ${{C}}_WIDTH[4]))) + max(octaves - 4.0, 0.0));
let spread: f32 = tau * tau * minor / a0 * size * size / 4.0;
""".splitlines()

SOFT = ["let soft: f32 = tau * sqrt(max(minor, 1e-30));  // width of a tap"]

PLACE = f"""\
let at: i32 = {TERMS} * k;
let tap: vec3<f32> = ${{C}}_TAPS[at] + t * (${{C}}_TAPS[at + 1] + t * (${{C}}_TAPS[at + 2]
    + t * (${{C}}_TAPS[at + 3] + t * ${{C}}_TAPS[at + 4])));  // z1, z2, log w_k
let slope: vec2<f32> = mean + tap.x * g1 + tap.y * g2;  // (4)
let stretch: f32 = sqrt(1.0 + dot(slope, slope));
let wh: vec3<f32> = vec3<f32>(slope.x, slope.y, 1.0) / stretch;
""".splitlines()

TAP = [
    "let texels: f32 = spread * cosH * wh.z * wh.z * wh.z * (d * d * d);  // (6)",
    "let tapLevel: vec3<f32> = ${C}_LEVEL;",
    "let nearest: f32 = ${name}GaussLevel(texels, tapLevel.x, tapLevel.y, tapLevel.z);  // (7)",
    "let level: f32 = nearest + ${C}_BIAS;",
    LOOKUP,
    "let away: vec2<f32> = slope / ${C}_M;",
    "let power: f32 = tap.z + 0.5 * dot(tap.xy, tap.xy) - dot(away, away);",
]

ROUND = ["let k: f32 = ${C}_M.x;  // width of the lobe towards the view"]
LONG = """\
// k: width of the lobe towards the view; column: its azimuth among the columns of the table.
var k: f32 = ${C}_M.x;
var column: f32 = 0.0;
let side: f32 = dot(wo.xy, wo.xy);
if (side > 1e-30) {
    let part: vec2<f32> = sqrt(${C}_M) * abs(wo.xy);
    k = sqrt(dot(${C}_M, part * part) / side);
    let roots: vec2<f32> = sqrt(part);
    column = roots.y / (roots.x + roots.y) * f32(${C}_COLUMNS - 1);
}
""".splitlines()
ROW = [
    "let row: f32 = 0.5 * wo.z * (1.0 + (1.0 + k) / (wo.z + k)) * f32(${C}_ROWS - 1);",
    "let i: i32 = min(i32(row), ${C}_ROWS - 2);",
    "let u: f32 = row - f32(i);",
]
ONE = "let white: {type} = (1.0 - u) * ${{C}}_WHITE[i] + u * ${{C}}_WHITE[i + 1];"
TWO = """\
let j: i32 = min(i32(column), ${{C}}_COLUMNS - 2);
let v: f32 = column - f32(j);
let first: i32 = i * ${{C}}_COLUMNS + j;
let next: i32 = first + ${{C}}_COLUMNS;
let near: {type} = (1.0 - u) * ${{C}}_WHITE[first] + u * ${{C}}_WHITE[next];
let far: {type} = (1.0 - u) * ${{C}}_WHITE[first + 1] + u * ${{C}}_WHITE[next + 1];
let white: {type} = (1.0 - v) * near + v * far;
"""
RESULT = {
    "white": ["let reflectivity: f32 = white;"],
    "fresnel": [
        "let edge: f32 = white.y * white.y * white.y * white.y * white.y;",
        "let reflectivity: vec3<f32> = ${C}_R0 * white.x + (1.0 - ${C}_R0) * edge;",
    ],
    "rest": ["let reflectivity: vec3<f32> = (1.0 - ${C}_R0) * white;"],
}


def part(lobe: ShaderLobe, *, samples: int = 14, bias: float = 0.0, filter: str = "gauss6") -> Part:
    """The function of one lobe; options as in ``glossy.shade``, and the pyramid's ``filter``."""
    taps = lattice_taps(samples)
    mx, my = lobe.lobe.widths
    beta = 1.0 - lobe.lobe.alpha
    kind = "rest" if lobe.side < 0.0 else "fresnel" if lobe.fresnel else "white"
    white = reflectivity_table(mx, my, lobe.lobe.alpha)[..., PARTS[kind]]
    rows = taps.rows.reshape(len(taps), 3, TERMS).transpose(0, 2, 1).reshape(-1, 3)
    constants: list[Constant] = [
        ("M", np.array([mx, my]), "mx, my"),
        ("VARIANCE", 0.5 * np.array([mx, my]) ** 2, "of the slopes"),
        ("BETA", beta, "1 - alpha"),
        ("TAPS", rows, f"z1, z2, log w_k of each tap: {TERMS} coefficients in t, constant first"),
        ("WIDTH", taps.log2_width[:, None], "log2 tau: coefficients in t"),
        ("LEVEL", np.array([*tap_constants(filter), KNEE]), f"a, b of (7), filter {filter}; bend"),
        bias_constant(bias),
        ("ROWS", ROWS, "of the table of reflectivity"),
    ]
    if white.shape[1] > 1:
        constants.append(("COLUMNS", COLUMNS, "of the table of reflectivity"))
    parts = {"white": "R", "fresnel": "R and the fifth root of Schlick's term", "rest": "1 - F"}
    constants.append(("WHITE", white.reshape(-1, white.shape[2]), f"{parts[kind]}, over a scale"))
    return Part(
        origin=f"method = lattice, {len(taps)} taps for every elongation of the lobe",
        size=len(taps),
        constants=constants,
        horizon="left out of both sums",
        before=[SIZE, *FRAME, *(SOFT if beta < 1.0 else []), *_sums(lobe)],
        place=PLACE,
        tap=[*TAP, *_weigh(lobe, beta)],
        after=_scaled(lobe, kind, beta, long=white.shape[1] > 1),
    )


def _sums(lobe: ShaderLobe) -> list[str]:
    zero = "vec3<f32>(0.0, 0.0, 0.0)"
    norm = f"vec3<f32> = {zero}" if lobe.fresnel else "f32 = 0.0"
    return ["", f"var sum: vec3<f32> = {zero};", f"var norm: {norm};"]


def _weigh(lobe: ShaderLobe, beta: float) -> list[str]:
    """The lines of the loop that add a sample to both sums."""
    held = "max(wi.z, soft)"
    power = f"1.0 / {held}" if beta == 0.0 else f"pow({held}, ${{C}}_BETA - 1.0)"
    lines = [] if beta == 1.0 else [f"let horizon: f32 = {power};"]
    weight = f"exp(power) * stretch * wi.z{' * horizon' if lines else ''}"
    if not lobe.fresnel:
        return [
            *lines,
            f"let weight: f32 = {weight};",
            "sum += weight * radiance;",
            "norm += weight;",
        ]
    return [
        *lines,
        *lobe.fresnel_line,
        f"let weight: vec3<f32> = {weight} * fresnel;",
        "sum += weight * radiance;",
        "norm += weight;",
    ]


def _scaled(lobe: ShaderLobe, kind: str, beta: float, long: bool) -> list[str]:
    """The lines behind the loop: the mean of the samples times the lobe's reflectivity."""
    type_ = "vec2<f32>" if kind == "fresnel" else "f32"
    read = TWO.format(type=type_).splitlines() if long else [ONE.format(type=type_)]
    size = "wo.z + k" if beta == 1.0 else "pow(wo.z + k, ${C}_BETA) / pow(up, ${C}_ALPHA)"
    least = "vec3<f32>(1e-30, 1e-30, 1e-30)" if lobe.fresnel else "1e-30"
    return [
        *(LONG if long else ROUND),
        *ROW,
        *read,
        *RESULT[kind],
        f"let light: vec3<f32> = sum / max(norm, {least});",
        f"let strength: f32 = {size};",
        "return ${C}_KS * strength * reflectivity * light;  // (5)",
    ]
