"""Shadows of an object of a scene on itself, for the regions of its own cube map.

The cube map of a glossy object is captured at its place and holds everything but the object: the
others are light in it, and what they hide is not in it. So the object itself is all that may still
stand between its surface and that light, and the only blocker.
"""

from ..scenes.geometry import Geometry
from .maps import PartialMaps
from .shadow import ShadowMaps, shadow_maps


def self_shadows(
    alone: Geometry,
    maps: PartialMaps,
    *,
    size: int = 256,
    softness: float = 0.04,
    bias: float = 0.002,
    variance: float = 1e-5,
    bleeding: float = 0.2,
    storage: str = "rg32f",
    horizon: bool = False,
) -> ShadowMaps:
    """Shadow maps of one object ``alone``, one for each region of ``maps``.

    The regions' own maps, which only shadows ask for, are made here too, and not in the first
    picture. Options as for ``shadow_maps``.
    """
    _ = maps.kernel_arguments
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
