"""Three shading languages from one text: constants, arrays, and translation of WGSL.

The templates are WGSL that keeps to what the three languages share: declarations with their type
(``let x: f32 = ...``, ``var x: f32 = ...``), ``fn``, ``for``, ``if``, ``continue``, vectors
built from all their components, and functions spelt alike everywhere (dot, cross, sqrt, log2, ...).
Translation then means the order of name and type, the names of types, and the texture, which GLSL
joins with its sampler. Comments stay as they are.

Numbers are single precision: the shortest decimal that reads back as the same float32, always with
a point or an exponent, so that no compiler takes it for an integer.
"""

import dataclasses
import re
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from .. import _check

TYPES = ("vec2<f32>", "vec3<f32>", "vec4<f32>", "f32", "i32")


@dataclasses.dataclass(frozen=True)
class Language:
    """How a shading language writes a constant, an array of constants, types and the texture."""

    name: str
    constant: str  # takes type, name, value
    array: str  # takes type, name, count
    close: str
    types: tuple[str, ...]  # in the order of TYPES
    parameters: str  # the cube map, as a function takes it
    arguments: str  # and hands it on
    lookup: str  # takes direction and level
    size: str  # function: texels along an edge of the base level

    def type_of(self, type_: str) -> str:
        """The language's name of a WGSL type."""
        return self.types[TYPES.index(type_)]

    def number(self, value: float) -> str:
        """The shortest decimal of a float32, with a point or an exponent."""
        with np.errstate(over="ignore"):
            number = np.float32(value)
        if not np.isfinite(number):
            raise _check.fail("shader", "must hold numbers of single precision", value)
        if number == 0.0 or 1e-4 <= abs(number) < 1e7:
            return np.format_float_positional(number, unique=True, trim="0")
        return np.format_float_scientific(number, unique=True, trim="0", exp_digits=1)

    def vector(self, values: Iterable[float]) -> str:
        """A vector of two to four numbers."""
        items = [self.number(v) for v in values]
        return f"{self.type_of(f'vec{len(items)}<f32>')}({', '.join(items)})"

    def declare(self, name: str, value: int | float | npt.NDArray[np.floating]) -> str:
        """A constant: int, float, vector (2 to 4,), or array (n, 1 to 4) of floats or vectors."""
        if isinstance(value, int):
            return self.constant.format(self.type_of("i32"), name, value)
        if np.ndim(value) == 0:
            return self.constant.format(self.type_of("f32"), name, self.number(float(value)))
        rows = np.asarray(value)
        if rows.ndim == 1:
            type_ = self.type_of(f"vec{len(rows)}<f32>")
            return self.constant.format(type_, name, self.vector(rows.tolist()))
        width = rows.shape[1]
        type_ = self.type_of("f32" if width == 1 else f"vec{width}<f32>")
        items = (self.number(r[0]) if width == 1 else self.vector(r) for r in rows.tolist())
        body = ",\n".join(f"    {item}" for item in items)
        return f"{self.array.format(type_, name, len(rows))}\n{body}\n{self.close}"

    def translate(self, text: str) -> str:
        """WGSL as the module describes it, in this language."""
        if self.name == "wgsl":
            return text
        lines = text.split("\n")
        code = "\n".join(line.partition("//")[0] for line in lines)
        for pattern, replacement in self._rules():
            code = re.sub(pattern, replacement, code)
        parts = zip(code.split("\n"), lines, strict=True)
        return "\n".join(c + "".join(line.partition("//")[1:]) for c, line in parts)

    def _rules(self) -> list[tuple[str, str]]:
        name, type_ = r"([A-Za-z]\w*)", rf"({'|'.join(map(re.escape, TYPES))})"
        types = zip(map(re.escape, TYPES), self.types, strict=True)
        lookup = self.lookup.format(r"\1", r"\2")
        return [
            (r"textureSampleLevel\(env, envSampler, (\w+), (\w+)\)\.rgb", lookup),
            (re.escape(WGSL.parameters), self.parameters),
            (re.escape(WGSL.arguments), self.arguments),
            (rf"\bfn {name}\(([^)]*)\) -> {type_} ", r"\3 \1(\2) "),
            (rf"\b(?:let|var) {name}: {type_}", r"\2 \1"),
            (rf"\b{name}: {type_}", r"\2 \1"),
            *((rf"(?<!\w){wgsl}", own) for wgsl, own in types),
        ]


WGSL = Language(
    name="wgsl",
    constant="const {1}: {0} = {2};",
    array="const {1}: array<{0}, {2}> = array<{0}, {2}>(",
    close=");",
    types=TYPES,
    parameters="env: texture_cube<f32>, envSampler: sampler",
    arguments="env, envSampler",
    lookup="textureSampleLevel(env, envSampler, {0}, {1}).rgb",
    size="    return f32(textureDimensions(env).x);",
)
GLSL = Language(
    name="glsl",
    constant="const {0} {1} = {2};",
    array="const {0} {1}[{2}] = {0}[{2}](",
    close=");",
    types=("vec2", "vec3", "vec4", "float", "int"),
    parameters="samplerCube env",
    arguments="env",
    lookup="textureLod(env, {0}, {1}).rgb",
    size="    return float(textureSize(env, 0).x);",
)
HLSL = Language(
    name="hlsl",
    constant="static const {0} {1} = {2};",
    array="static const {0} {1}[{2}] = {{",
    close="};",
    types=("float2", "float3", "float4", "float", "int"),
    parameters="TextureCube<float4> env, SamplerState envSampler",
    arguments="env, envSampler",
    lookup="env.SampleLevel(envSampler, {0}, {1}).rgb",
    size="    float width, height;\n    env.GetDimensions(width, height);\n    return width;",
)
LANGUAGES = {language.name: language for language in (GLSL, HLSL, WGSL)}
