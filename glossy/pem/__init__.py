"""Partial environment maps: an environment cut into regions, each with its maps and its shadow.

``regions`` cuts the cube map, ``maps`` holds the masked pyramids and their sum under visibility.
``shadow`` has the visibility of regions as variance shadow maps know it, ``visibility`` as rays do,
``truth`` the radiance under ray-cast shadows. Names are loaded on first use.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .shadow import ShadowMaps, shadow_maps
    from .truth import reference_occluded
    from .visibility import region_visibility

_WHERE = {
    "ShadowMaps": "shadow",
    "reference_occluded": "truth",
    "region_visibility": "visibility",
    "shadow_maps": "shadow",
}

__all__ = ["ShadowMaps", "reference_occluded", "region_visibility", "shadow_maps"]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_WHERE[name]}", __name__), name)
