"""Shadows of an object of a scene on itself, for the regions of its own cube map.

The cube map of a glossy object is captured at its place and holds everything but the object: the
others are light in it, and what they hide is not in it. So the object itself is all that may still
stand between its surface and that light, and the only blocker. An object that is convex hides
nothing from itself, and nothing is made for it.
"""

from ..scenes.geometry import Geometry
from ..scenes.shapes import Shape, Transform
from .maps import PartialMaps
from .shadow import ShadowMaps, shadow_maps


def self_occluder(shape: Shape, transform: Transform) -> Geometry | None:
    """An object alone, ready for rays; None if it is convex."""
    alone = Geometry([(shape, transform)])
    return None if alone.convex(0) else alone


def self_shadows(
    shape: Shape,
    transform: Transform,
    maps: PartialMaps,
    *,
    size: int = 256,
    softness: float = 0.07,
    bias: float = 0.002,
    variance: float = 1e-5,
    bleeding: float = 0.1,
    storage: str = "rg32f",
    horizon: bool = False,
) -> ShadowMaps | None:
    """Shadow maps of one object, one for each region of ``maps``; None if it is convex.

    Options as for ``shadow_maps``.
    """
    alone = self_occluder(shape, transform)
    if alone is None:
        return None
    return shadow_maps(
        alone,
        maps.regions.direction,
        maps.regions.solid_angle,
        size=size,
        softness=softness,
        bias=bias,
        variance=variance,
        bleeding=bleeding,
        storage=storage,
        horizon=horizon,
    )
