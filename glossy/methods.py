"""Real-time methods by name: where each one lives, resolved when it is called.

A method is a function ``(points, material, prepared, *, precision, **its own options)`` that
returns the glossy radiance (..., 3); ``prepared`` is whatever it looks up (a Pyramid here). The
core imports none of them.
"""

import importlib
import inspect
from collections.abc import Callable, Mapping
from typing import Any

from . import _check

METHODS = {
    "regular": "glossy.shading:regular",
    "importance": "glossy.shading:importance",
}


def resolve(name: str) -> Callable[..., Any]:
    """The function of a method; an unknown name is a ``ValueError`` that lists them."""
    module, _, function = METHODS[_check.choice("method", name, METHODS)].partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), function)
    return found


def options(name: str) -> dict[str, Any]:
    """Options of a method with their defaults."""
    parameters = inspect.signature(resolve(name)).parameters.values()
    own = [p for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY]
    return {p.name: p.default for p in own if p.name != "precision"}


def check_options(name: str, given: Mapping[str, Any]) -> None:
    """Refuse options that the method does not have."""
    known = options(name)
    for option, value in given.items():
        if option not in known:
            rule = f"is no option of method {name!r} (it has {', '.join(known)})"
            raise _check.fail(option, rule, value)
