"""Planar reflectors: floors, walls and table tops, which no single cube map can light.

Built on the scenes of objects, which name it only where a scene has such a reflector. Names are
loaded on first use.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .truth import reference_planar, reference_planar_passes

_WHERE = {
    "reference_planar": "truth",
    "reference_planar_passes": "truth",
}

__all__ = ["reference_planar", "reference_planar_passes"]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_WHERE[name]}", __name__), name)
