"""A material's method as shader functions: constants, one function per lobe, and their sum.

The text is complete but for the cube map, which the caller passes: ``{name}Radiance(env, normal,
tangent, view)`` returns what ``glossy.shade`` returns for the glossy lobes.
"""

import math
import pathlib
import re
import string
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np

from .. import _check
from .._arguments import checked
from .._version import __version__
from ..brdf import Lobe, Material
from ..methods import METHODS
from ..planes import BoundingPlanes
from ..tap_table import Patterns, patterns_of
from . import importance, lattice, regular, thesis
from .languages import LANGUAGES, Language
from .tables import write
from .template import (
    BLENDED,
    FACE_SIZE,
    HELPERS,
    NEAREST,
    POSITION,
    RADIANCE,
    Equation,
    Part,
    ShaderLobe,
    lines,
)

SHARED = ("estimator", "footprint", "normalisation", "bias", "filter")
"""Options of a method that are the same for every lobe and no part of its pattern."""

EXPORTS: Mapping[str, ModuleType] = {
    "regular": regular,
    "importance": importance,
    "thesis": thesis,
    "lattice": lattice,
}
"""Methods that can be a shader. A module has ``part`` and ``equations``."""

HEAD = """\
glossy {version}, method {method}: {options}

Radiance towards the viewer from the glossy lobes of a material{diffuse}.
In the comments, "paper" is Real-time Rendering of Glossy Materials with Regular Sampling.

normal, tangent, view: unit vectors in world coordinates. tangent is the direction of mx and
perpendicular to the normal, view points to the eye, bitangent = cross(normal, tangent).
wo, wi, wh: to the viewer, to the light, half way between, along (tangent, bitangent, normal).
env: cube map of linear radiance with N texels along an edge; faces as OpenGL and Vulkan place
them, levels as glossy.build_pyramid makes them, linear filter within and between the levels,
seamless across the faces.

{equations}

n: samples of the pattern, kept or not; d = 1 / max(|wi.x|, |wi.y|, |wi.z|) in world coordinates.
"""
EQUATIONS: list[Equation] = [
    ("wi = 2 (wo.wh) wh - wo", "(1)", ""),
    ("f = ks F D(wh) / (4 (wo.wh) ((wi.n) (wo.n))^alpha)", "(2)", "paper eq. 2"),
    ("F = r0 + (1 - r0) (1 - wo.wh)^5", "(3)", "paper eq. 3"),
]
MIRRORED: Equation = (
    "transmission: 1 - F for F, wi below the surface mirrored in it",
    "",
    "thesis eq. 3.5",
)


@checked
def export_shader(
    material: Material | Lobe,
    language: str = "glsl",
    method: str = "regular",
    *,
    name: str = "glossy",
    path: str | pathlib.Path | None = None,
    pattern: Patterns = None,
    parallax: BoundingPlanes | None = None,
    **options: Any,
) -> str:
    """Shader functions that compute what ``glossy.shade`` computes, with their constants.

    Parameters
    ----------
    material : Material, or a Lobe alone
        Its glossy lobes; the diffuse term needs no pattern and is left to the shader.
    language : "glsl" (3.30 and later, ES 3.00), "hlsl" (Shader Model 4 and later) or "wgsl"
    method : "regular", "importance", "thesis" or "lattice"
    name : str
        First part of every name in the text, so that several can stand in one shader.
    path : str or Path, optional
        Where to write the text, whole or not at all.
    pattern : Pattern or one for each lobe, optional
    parallax : BoundingPlanes, optional
        As in ``glossy.shade``, with the footprint "thesis"; ``{name}Radiance`` then takes the
        position too, world coordinates, as its last argument.
    **options
        The method's own, as in ``glossy.shade``; those of the emulated sampler and of the
        arithmetic have no meaning here. ``lattice`` also takes ``filter``, the name of the filter
        that the levels are made with (default "gauss6").

    Returns
    -------
    str; its last function is ``{name}Radiance``.

    Raises
    ------
    ValueError
        For a method that is no shader, a foreign option, a value out of range, a material without
        a glossy lobe, or numbers beyond single precision.
    """
    target = LANGUAGES[_check.choice("language", language, LANGUAGES)]
    if _check.choice("method", method, METHODS) not in EXPORTS:
        raise _check.fail(
            "method", f"must be one that a shader can be: {', '.join(EXPORTS)}", method
        )
    module = EXPORTS[method]
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z][A-Za-z0-9]*", name):
        raise _check.fail("name", "must be letters and digits, a letter first", name)
    known = module.part.__kwdefaults__
    for option, value in options.items():
        if option not in known:
            rule = f"is no option of method {method!r} as a shader (it has {', '.join(known)})"
            raise _check.fail(option, rule, value)
    whole = Material(reflection=[material]) if isinstance(material, Lobe) else material
    lobes = _lobes(whole)
    if not lobes:
        raise _check.fail("material", "must have a glossy lobe with ks > 0", whole)
    if parallax is not None and parallax.footprint != "thesis":
        raise _check.fail("parallax", "must have footprint 'thesis' as a shader", parallax)
    given: list[dict[str, Any]] = [{} for _ in lobes]
    if pattern is not None:
        if "pattern" not in known:
            raise _check.fail("pattern", f"is no option of method {method!r} as a shader", pattern)
        given = [{"pattern": own} for own in patterns_of(pattern, len(lobes))]
    made = [module.part(lobe, **own, **options) for lobe, own in zip(lobes, given, strict=True)]
    mirrored = [MIRRORED] if whole.transmission else []
    head = HEAD.format(
        version=__version__,
        diffuse=", its diffuse part left out" if whole.diffuse.any() else "",
        method=method,
        options=", ".join(f"{k} {v}" for k, v in {**known, **options}.items() if k in SHARED),
        equations=_equations([*EQUATIONS, *mirrored, *module.equations(**options)]),
    )
    text = "\n".join([*_comment(head), *_body(target, name, lobes, made, parallax)])
    write(text, path)
    return text


def _lobes(material: Material) -> list[ShaderLobe]:
    packed = material.pack()
    return [
        ShaderLobe(lobe, ks, r0, side)
        for (lobe, side), ks, r0 in zip(material.sided_lobes(), packed.ks, packed.r0, strict=True)
    ]


def _equations(items: list[Equation]) -> str:
    return "\n".join(f"{text:<68} {number:<4}{source}".rstrip() for text, number, source in items)


def _comment(text: str) -> list[str]:
    return [f"// {line}".rstrip() for line in text.splitlines()]


def _body(
    language: Language,
    name: str,
    lobes: list[ShaderLobe],
    made: list[Part],
    planes: BoundingPlanes | None,
) -> list[str]:
    """Constants, helpers and functions, in the order in which they must be declared."""
    constants, functions, calls = [], [], []
    last = "" if planes is None else ", position"
    nearest: Sequence[str] = NEAREST
    if planes is not None:
        if not planes.planes:
            raise _check.fail("parallax", "must have planes to become a shader", planes)
        distances = np.sum(planes.points * planes.normals, axis=1)
        constants = [
            "",
            "// Bounding planes: unit normal n, p.n; where the cube map was taken.",
            language.declare(f"{name.upper()}_PLANE_COUNT", len(distances)),
            language.declare(
                f"{name.upper()}_PLANES", np.column_stack([planes.normals, distances])
            ),
            language.declare(f"{name.upper()}_CENTRE", np.array(planes.centre)),
        ]
        if planes.width:
            constants.append(language.declare(f"{name.upper()}_BLEND", planes.width))
            nearest = BLENDED
    for index, (lobe, part) in enumerate(zip(lobes, made, strict=True), start=1):
        prefix = f"{name.upper()}{index}"
        side = "transmission" if lobe.side < 0.0 else "reflection"
        title = f"// Lobe {index}: {side}, mx = {lobe.lobe.mx:g}, my = {lobe.lobe.my:g}."
        constants += ["", title, f"// Pattern: {part.origin}."]
        constants.append(language.declare(f"{prefix}_SIZE", part.size) + "  // n")
        for key, value, meaning in [*lobe.constants(), *part.constants]:
            line = language.declare(f"{prefix}_{key}", value)
            beside = f"{line}  // {meaning}"
            above = "\n" in line or len(beside) > 100
            constants.append(f"// {meaning}\n{line}" if above else beside)
        text = string.Template(part.function(lobe.side, planes is not None))
        functions.append(f"{title}\n{text.substitute(name=name, index=index, C=prefix)}")
        calls.append(f"{name}Lobe{index}(env, envSampler, normal, tangent, bitangent, wo{last})")
    code = "\n".join(functions)
    helpers = [text for key, text in HELPERS.items() if f"{name}{key}(" in code]
    sum_ = "\n        + ".join(calls)
    position = POSITION if planes is not None else ""
    radiance = string.Template(RADIANCE).safe_substitute(sum=sum_, position=position)
    wgsl = "\n".join([FACE_SIZE, *helpers, code, radiance])
    wgsl = string.Template(wgsl).safe_substitute(nearest=lines(nearest, 3))
    named = string.Template(wgsl).safe_substitute(name=name, C=name.upper())
    final = string.Template(language.translate(named)).substitute(size=language.size)
    if "LobeArea(" in code:
        constants = ["", language.declare(f"{name.upper()}_PI", math.pi), *constants]
    return [*constants, "", final]
