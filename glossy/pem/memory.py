"""Memory of partial environment maps on a GPU, with the shadow maps they go with.

A texel is RGBA, of 8 bytes in half floats (RGBA16F) or 16 in single; a variance shadow map has two
half floats a texel (RG16F). R complete cube maps of size N with their levels take R 6 N^2 4/3
texels. Source: Knuth et al., Fig. 8 and section 5.
"""

import dataclasses

from .. import _check
from .maps import PartialMaps

TEXEL_BYTES = {"rgba32f": 16, "rgba16f": 8}
SHADOW_BYTES = 4


@dataclasses.dataclass(frozen=True)
class Memory:
    """Bytes on the GPU.

    ``held``: the regions' maps in their layout, with the ring of texels their lookups need;
    ``whole``: the same as complete cube maps; ``shadows``: the shadow maps; ``pyramid``: the one
    that serves where nothing is in the way.
    """

    held: int
    whole: int
    shadows: int
    pyramid: int


def memory(maps: PartialMaps, shadow_size: int = 512) -> Memory:
    """What the maps of an environment take on a GPU, in their own storage.

    Parameters
    ----------
    maps : PartialMaps
    shadow_size : int
        Texels along the edge of each region's square shadow map, without levels.

    Raises
    ------
    ValueError
        For a size below 1.
    """
    side = _check.count("shadow_size", shadow_size)
    texel, count = TEXEL_BYTES[maps.storage], len(maps.regions)
    pyramid = texel * sum(level[..., 0].size for level in maps.pyramid.levels)
    return Memory(
        held=texel * maps.texels,
        whole=count * pyramid,
        shadows=count * side * side * SHADOW_BYTES,
        pyramid=pyramid,
    )
