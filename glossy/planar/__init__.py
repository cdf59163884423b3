"""Planar reflectors: a mirrored camera's buffer as the light of floors, walls and table tops.

Built on the core and on ``glossy.scenes``; neither knows it. Names are loaded on first use.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .converge import Refined, Refinement, refine_planar
    from .levels import Levels, build_levels
    from .mapping import Mapping, MappingCounts, map_samples
    from .mirror import (
        MirrorBuffer,
        MirrorCamera,
        mirror_camera,
        reflector_plane,
        render_mirror,
    )
    from .objects import mirror_pass
    from .pattern import planar_pattern
    from .shade import Fallback, shade_planar
    from .truth import reference_planar, reference_planar_passes

_WHERE = {
    "Fallback": "shade",
    "Levels": "levels",
    "Mapping": "mapping",
    "MappingCounts": "mapping",
    "MirrorBuffer": "mirror",
    "MirrorCamera": "mirror",
    "Refined": "converge",
    "Refinement": "converge",
    "build_levels": "levels",
    "map_samples": "mapping",
    "mirror_camera": "mirror",
    "mirror_pass": "objects",
    "planar_pattern": "pattern",
    "reference_planar": "truth",
    "reference_planar_passes": "truth",
    "refine_planar": "converge",
    "reflector_plane": "mirror",
    "render_mirror": "mirror",
    "shade_planar": "shade",
}

__all__ = [
    "Fallback",
    "Levels",
    "Mapping",
    "MappingCounts",
    "MirrorBuffer",
    "MirrorCamera",
    "Refined",
    "Refinement",
    "build_levels",
    "map_samples",
    "mirror_camera",
    "mirror_pass",
    "planar_pattern",
    "reference_planar",
    "reference_planar_passes",
    "refine_planar",
    "reflector_plane",
    "render_mirror",
    "shade_planar",
]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_WHERE[name]}", __name__), name)
