"""Scenes of objects: geometry, ray casting, baked light, captured cube maps, pictures.

Built on the core, which does not know it: an object is shaded by the core's methods, with a cube
map captured at its place in the scene. Names are loaded on first use.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .geometry import Geometry, Hits
    from .model import ObjectScene
    from .prepared import PreparedScene, prepare
    from .render import View, reference_objects, render_objects, shade_part, view

_WHERE = {
    "Geometry": "geometry",
    "Hits": "geometry",
    "ObjectScene": "model",
    "PreparedScene": "prepared",
    "View": "render",
    "prepare": "prepared",
    "reference_objects": "render",
    "render_objects": "render",
    "shade_part": "render",
    "view": "render",
}

__all__ = [
    "Geometry",
    "Hits",
    "ObjectScene",
    "PreparedScene",
    "View",
    "prepare",
    "reference_objects",
    "render_objects",
    "shade_part",
    "view",
]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_WHERE[name]}", __name__), name)
