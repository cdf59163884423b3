"""What every method's shader shares: the function of one lobe, its frame and its lookup, in WGSL.

A method fills the slots of ``LOBE`` (``string.Template``; no language here uses ``$``); helpers are
written out only where a lobe calls them.
"""

import dataclasses
import string
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from ..brdf import Lobe

Float64Array = npt.NDArray[np.float64]
Constant = tuple[str, int | float | npt.NDArray[np.floating], str]
"""Name without prefix, value, meaning."""
Equation = tuple[str, str, str]
"""Text, number (empty for a step on the way), source."""

LOBE = """\
fn ${name}Lobe${index}(
    env: texture_cube<f32>, envSampler: sampler,
    normal: vec3<f32>, tangent: vec3<f32>, bitangent: vec3<f32>, wo: vec3<f32>${position}
) -> vec3<f32> {
${before}
    for (var k: i32 = 0; k < ${C}_SIZE; k++) {
${place}
        let cosH: f32 = dot(wo, wh);
        let wi: vec3<f32> = 2.0 * cosH * wh - wo;  // (1)
        if (cosH <= 0.0 || wi.z <= 0.0) {
            continue;  // below the horizon: ${horizon}
        }
${direction}
        let d: f32 = 1.0 / max(abs(direction.x), max(abs(direction.y), abs(direction.z)));
${tap}
    }
${after}
}
"""

POSITION = ",\n    position: vec3<f32>"

RADIANCE = """\
// Radiance towards the viewer from the glossy lobes.
fn ${name}Radiance(
    env: texture_cube<f32>, envSampler: sampler,
    normal: vec3<f32>, tangent: vec3<f32>, view: vec3<f32>${position}
) -> vec3<f32> {
    let bitangent: vec3<f32> = cross(normal, tangent);
    let wo: vec3<f32> = vec3<f32>(dot(view, tangent), dot(view, bitangent), dot(view, normal));
    if (wo.z <= 0.0) {
        return vec3<f32>(0.0, 0.0, 0.0);  // one-sided: black from behind
    }
    return ${sum};
}
"""

FACE_SIZE = """\
// N: texels along an edge of the base level.
fn ${name}FaceSize(env: texture_cube<f32>, envSampler: sampler) -> f32 {
${size}
}
"""

LOBE_AREA = """\
// Area of the lobe's cross-section at unit distance (paper eqs. 14 and 15, without arc functions):
//     sin(alpha_u / 2) = sin(theta_u) sqrt(1 - (wo.b)^2),  sin(alpha_v / 2) likewise with wo.t
//     A = min(pi tan(alpha_u) tan(alpha_v), 2 pi), and 2 pi when an angle reaches 90 degrees
// sines: of the lobe's border angles theta_u, theta_v along tangent and bitangent.
fn ${name}LobeArea(sines: vec2<f32>, wo: vec3<f32>) -> f32 {
    let u: f32 = sines.x * sines.x * (wo.x * wo.x + wo.z * wo.z);
    let v: f32 = sines.y * sines.y * (wo.y * wo.y + wo.z * wo.z);
    let cosU: f32 = 1.0 - 2.0 * u;
    let cosV: f32 = 1.0 - 2.0 * v;
    if (cosU <= 0.0 || cosV <= 0.0) {
        return 2.0 * ${C}_PI;
    }
    let tangents: f32 = 4.0 * sqrt(u * v * ((1.0 - u) * (1.0 - v))) / (cosU * cosV);
    return min(${C}_PI * tangents, 2.0 * ${C}_PI);
}
"""

FRESNEL = """\
// Schlick's F = r0 + (1 - r0) (1 - wo.wh)^5 (paper eq. 3), where
// 1 - wo.wh = |wi - wo|^2 / (4 (1 + wo.wh)) keeps its digits near the mirror direction.
fn ${name}Fresnel(r0: vec3<f32>, wi: vec3<f32>, wo: vec3<f32>, cosH: f32) -> vec3<f32> {
    let e: vec3<f32> = wi - wo;
    let x: f32 = dot(e, e) / (4.0 * (1.0 + cosH));
    return r0 + (1.0 - r0) * (x * x * x * x * x);
}
"""

FRESNEL_REST = """\
// 1 - F with Schlick's F (thesis eq. 3.5), as (1 - r0) (1 - x^5) with x = 1 - wo.wh and
// 1 - x^5 = (1 - x) (1 + x + x^2 + x^3 + x^4), which keeps its digits where wo.wh is small.
fn ${name}FresnelRest(r0: vec3<f32>, wi: vec3<f32>, wo: vec3<f32>, cosH: f32) -> vec3<f32> {
    let e: vec3<f32> = wi - wo;
    let x: f32 = dot(e, e) / (4.0 * (1.0 + cosH));
    return (1.0 - r0) * (cosH * (1.0 + x * (1.0 + x * (1.0 + x * (1.0 + x)))));
}
"""

GAUSS_LEVEL = """\
// Level whose trilinear tap is closest to a round Gaussian of variance v, in texels of level 0
// squared. A tap of level l > 0 has the variance a 4^l - b, of level 0 1/6; the mixture of two
// levels nearest (least squares) to it has a little more of the coarser one than equal variance.
fn ${name}GaussLevel(v: f32, a: f32, b: f32, bend: f32) -> f32 {
    let one: f32 = 4.0 * a - b;
    if (v < one) {
        let knee: f32 = bend * one;
        let share: f32 = (v - 1.0 / 6.0) / (one - 1.0 / 6.0);
        return max(share * (one + knee) / (v + knee), 0.0);
    }
    let scaled: f32 = (v + b) / a;
    let first: f32 = floor(0.5 * log2(scaled));
    let u: f32 = scaled * exp2(-2.0 * first);
    return first + (0.3 - 3.0 / ((u + 4.0) * (u + 1.0))) * (40.0 / 9.0);
}
"""

REDIRECT = """\
// A ray w from the surface point x as it is looked up from the centre c of the cube map: it meets
// the bounding plane through p with normal n at the distance 1 / q (thesis section 4.4.1),
//     q = max(0, (w.n) / ((p - x).n) of every plane),  w' = w + q (x - c)
fn ${name}Redirect(ray: vec3<f32>, position: vec3<f32>) -> vec3<f32> {
    var q: f32 = 0.0;
    for (var i: i32 = 0; i < ${C}_PLANE_COUNT; i++) {
        let away: f32 = ${C}_PLANES[i].w - dot(position, ${C}_PLANES[i].xyz);
        if (away != 0.0) {
            let met: f32 = dot(ray, ${C}_PLANES[i].xyz) * clamp(1.0 / away, -1e12, 1e12);
${nearest}
        }
    }
    return normalize(ray + q * (position - ${C}_CENTRE));
}
"""
NEAREST = ("q = max(q, met);",)
BLENDED = (
    "let near: f32 = max(${C}_BLEND - abs(met - q), 0.0);  // max with a smooth transition",
    "q = max(q, met) + near * near / (4.0 * ${C}_BLEND);",
)

HELPERS = {
    "LobeArea": LOBE_AREA,
    "Fresnel": FRESNEL,
    "FresnelRest": FRESNEL_REST,
    "GaussLevel": GAUSS_LEVEL,
    "Redirect": REDIRECT,
}


@dataclasses.dataclass(frozen=True)
class ShaderLobe:
    """A lobe, its colours, its side (+1 reflection, -1 transmission), and its share of the code."""

    lobe: "Lobe"
    ks: Float64Array
    r0: Float64Array
    side: float

    @property
    def fresnel(self) -> bool:
        """Whether F is anything but 1."""
        return self.side < 0.0 or bool(np.any(self.r0 != 1.0))

    def constants(self) -> list[Constant]:
        """The material's share of the constants; what multiplies by 1 has none."""
        out: list[Constant] = [("KS", self.ks, "weight of the lobe")]
        if self.fresnel:
            out.append(("R0", self.r0, "reflectance at normal incidence"))
        if self.lobe.alpha:
            out.append(("ALPHA", self.lobe.alpha, "exponent of (wi.n) (wo.n)"))
        return out

    @property
    def cosines(self) -> str:
        """(wi.n) / ((wi.n) (wo.n))^alpha."""
        return "wi.z / pow(wi.z * wo.z, ${C}_ALPHA)" if self.lobe.alpha else "wi.z"

    @property
    def fresnel_line(self) -> list[str]:
        """The line that computes ``fresnel``, where it is not 1."""
        if not self.fresnel:
            return []
        call, what = ("FresnelRest", "1 - F") if self.side < 0.0 else ("Fresnel", "F")
        return [f"let fresnel: vec3<f32> = ${{name}}{call}(${{C}}_R0, wi, wo, cosH);  // {what}"]

    @property
    def fresnel_factor(self) -> str:
        """``fresnel`` as a factor of a product that goes on, where it is not 1."""
        return "fresnel * " if self.fresnel else ""


@dataclasses.dataclass(frozen=True)
class Part:
    """One lobe as a method writes it: its constants, and the slots of ``LOBE``.

    ``origin`` says where its ``size`` samples come from, ``horizon`` what becomes of those below
    it; ``before`` the loop over the samples, ``place`` (which ends in ``wh``) and ``tap`` in it,
    ``after`` it.
    """

    origin: str
    size: int
    constants: list[Constant]
    horizon: str
    before: Sequence[str]
    tap: Sequence[str]
    after: Sequence[str]
    place: Sequence[str] = ("let wh: vec3<f32> = ${C}_TAPS[k].xyz;",)

    def function(self, side: float, parallax: bool) -> str:
        """The lobe's function, its names still open."""
        world = f"tangent * wi.x + bitangent * wi.y {'-' if side < 0.0 else '+'} normal * wi.z"
        direction = [f"let direction: vec3<f32> = {world};"]
        if parallax:
            direction = [
                f"let ray: vec3<f32> = {world};",
                "let direction: vec3<f32> = ${name}Redirect(ray, position);",
            ]
        return string.Template(LOBE).safe_substitute(
            horizon=self.horizon,
            place=lines(self.place, 2),
            direction=lines(direction, 2),
            position=POSITION if parallax else "",
            before=lines(self.before, 1),
            tap=lines(self.tap, 2),
            after=lines(self.after, 1),
        )


def lines(items: Sequence[str], depth: int) -> str:
    """Lines of code, indented ``depth`` times."""
    return "\n".join(f"{'    ' * depth}{item}".rstrip() for item in items)
