"""Glossy rendering from environment maps: the real-time methods and their ground truth.

Public names are loaded on first use, so that ``import glossy`` stays cheap and image comparison
never loads a compiler.
"""

import importlib
from typing import TYPE_CHECKING, Any

from ._version import __version__

if TYPE_CHECKING:
    from .brdf import Lobe, Material
    from .cubemap import CubeMap
    from .frames import SurfacePoints

_WHERE = {
    "Lobe": "brdf",
    "Material": "brdf",
    "CubeMap": "cubemap",
    "SurfacePoints": "frames",
}

__all__ = ["CubeMap", "Lobe", "Material", "SurfacePoints", "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'glossy' has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_WHERE[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_WHERE])
