"""Real-time methods by name: where each one lives, resolved when it is called.

A method is a function ``(points, material, prepared, *, precision, **its own options)`` that
returns the glossy radiance (..., 3); ``prepared`` is whatever it looks up (a Pyramid here). The
core imports none of them.

What makes ``prepared`` is named beside it: a function ``(cube, **its own options)``, with a
parameter ``material`` if it needs that. Methods without an entry look up a MIP pyramid.
"""

import importlib
import inspect
from collections.abc import Callable, Mapping
from typing import Any

from . import _check

SCENE = ("cube", "material")  # what a preparation takes from the scene

METHODS = {
    "regular": "glossy.shading:regular",
    "importance": "glossy.shading:importance",
    "thesis": "glossy.thesis:thesis",
    "split-sum": "glossy.splitsum.shade:split_sum",
    "bent": "glossy.splitsum.shade:bent",
    "axis-taps": "glossy.splitsum.shade:axis_taps",
    "lattice": "glossy.lattice.shade:lattice",
    "prefiltered": "glossy.prefiltered.shade:prefiltered",
    "pem": "glossy.pem.shade:pem",
    "auto": "glossy.planning.auto:auto",
}

PYRAMID = "glossy.pyramid:build_pyramid"
PREPARE = {
    **dict.fromkeys(("split-sum", "bent", "axis-taps"), "glossy.splitsum.shade:prepare"),
    "prefiltered": "glossy.prefiltered.shade:prepare",
    "pem": "glossy.pem.maps:partial_maps",
}
"""What a method looks up, where that is not a MIP pyramid."""

TAPS = {
    "axis-taps": "glossy.splitsum.shade:tap_count",
    "lattice": "glossy.lattice.table:tap_count",
}
"""How many taps a method takes for (lobe, samples), where that is not ``samples``."""


PLANNED = {"auto": "glossy.planning.auto:tap_counts"}
"""Taps of each lobe for (material, prepared, own options), where the method itself chooses them."""

PLANES = {
    **dict.fromkeys(("regular", "importance", "thesis"), "glossy.parallax:shade_table"),
    **dict.fromkeys(("split-sum", "bent", "axis-taps"), "glossy.splitsum.planes:shade_chain"),
    "lattice": "glossy.lattice.planes:shade_lattice",
    "prefiltered": "glossy.prefiltered.shade:shade_prefiltered",
    "pem": "glossy.pem.planes:shade_maps",
    "auto": "glossy.planning.auto:shade_plan",
}
"""What shades with bounding planes, ``(points, material, prepared, method, planes, precision,
options)``; ``parallax.shade_planes`` has checked these."""

TRACES = {
    "lattice": "glossy.lattice.trace:trace_lattice",
    "auto": "glossy.planning.trace:trace_plan",
}
"""What lists a method's samples, ``(point, material, pyramid, precision, **options)``, where
``trace`` itself does not."""


VIEWED = {"planar": "glossy.planar.objects:shade_reflector"}
"""Methods of an object in a view of its scene, which look up more than a cube map: functions
``(prepared, part, *, precision, **their own options)``, for scenes of objects alone."""

VIEWED_TRUTHS = {"planar": "glossy.planar.truth:reference_planar"}
"""Their ground truths, ``(prepared, part, estimator, samples, tolerance, seed)``."""

VIEWED_PASSES = {"planar": "glossy.planar.objects:refine_reflector"}
"""What refines them while the camera rests: states with ``radiance``, ``error`` and ``samples`` of
``(prepared, part, most, seed, **their own options)``, as many as ``reference_passes`` has."""

SHADOWS: dict[str, str] = {"pem": "glossy.pem.occlusion:self_shadows"}
"""What makes the shadows of an object on itself, ``(geometry, prepared, **options)``; its
``visibility(points)`` is the method's option of that name."""


def _load(place: str) -> Callable[..., Any]:
    module, _, function = place.partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), function)
    return found


def resolve(name: str) -> Callable[..., Any]:
    """The function of a method; an unknown name is a ``ValueError`` that lists them."""
    return _load(METHODS[_check.choice("method", name, METHODS)])


def viewed(name: str, table: Mapping[str, str] = VIEWED) -> Callable[..., Any]:
    """The function of a method of ``VIEWED``, or its truth or passes."""
    return _load(table[name])


def preparation(name: str) -> Callable[..., Any]:
    """What makes the third argument of ``shade`` for a method."""
    return _load(PREPARE.get(_check.choice("method", name, METHODS), PYRAMID))


def preparation_options(name: str) -> list[str]:
    """Names of the options of a method's preparation."""
    if name in VIEWED:
        return []
    return [p for p in inspect.signature(preparation(name)).parameters if p not in SCENE]


def bound_to_material(name: str) -> bool:
    """Whether what a method looks up depends on the material."""
    return "material" in inspect.signature(preparation(name)).parameters


def prepare(name: str, cube: Any, material: Any, **options: Any) -> Any:
    """The third argument of ``shade`` for a method, from a cube map and the material."""
    bound = {"material": material} if bound_to_material(name) else {}
    return preparation(name)(cube, **bound, **options)


def with_planes(name: str) -> Callable[..., Any]:
    """What shades a method of ``PLANES`` with bounding planes."""
    return _load(PLANES[name])


def shadows(name: str, geometry: Any, prepared: Any, **options: Any) -> Any:
    """Shadows of an object, alone in ``geometry``, on itself for a method of ``SHADOWS``."""
    return _load(SHADOWS[name])(geometry, prepared, **options)


def check_shadows(name: str, given: object) -> None:
    """Refuse a scene's ``shadows`` for a method: a switch, or a table of options."""
    if name not in SHADOWS:
        raise _check.fail("shadows", f"must be left out with method {name!r}", given)
    if isinstance(given, bool):
        return
    if not isinstance(given, Mapping):
        raise _check.fail("shadows", "must be true, false or a table of options", given)
    parameters = inspect.signature(_load(SHADOWS[name])).parameters.values()
    known = [p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY]
    for option in given:
        _check.choice("shadows", option, known)


def tracer(name: str) -> Callable[..., Any]:
    """What lists the samples of a method of ``TRACES``."""
    return _load(TRACES[name])


def tap_count(name: str, lobe: Any, samples: int) -> int:
    """Taps that a method takes for one lobe; a method without ``samples`` takes one."""
    if name in TAPS:
        return int(_load(TAPS[name])(lobe, samples))
    return samples if "samples" in options(name) else 1


def planned_counts(name: str, material: Any, prepared: Any, given: Mapping[str, Any]) -> list[int]:
    """Taps of each lobe by a method of ``PLANNED``."""
    own = {k: v for k, v in given.items() if k != "precision"}
    return list(_load(PLANNED[name])(material, prepared, **own))


def options(name: str) -> dict[str, Any]:
    """Options of a method with their defaults."""
    function = viewed(name) if name in VIEWED else resolve(name)
    parameters = inspect.signature(function).parameters.values()
    own = [p for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY]
    return {p.name: p.default for p in own if p.name != "precision"}


def check_options(name: str, given: Mapping[str, Any]) -> None:
    """Refuse options that the method does not have."""
    known = options(name)
    for option, value in given.items():
        if option not in known:
            rule = f"is no option of method {name!r} (it has {', '.join(known)})"
            raise _check.fail(option, rule, value)
