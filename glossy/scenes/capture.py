"""Environment capture: the scene seen from an object's place, without the object, as a cube map.

One ray bundle per texel from the centre of the object's bounding box through the light-mapped scene
(thesis section 4.4.1): diffuse objects as their light maps light them, lights, and the sky.
"""

import numpy as np
import numpy.typing as npt

from .. import _check
from ..cubemap import CubeMap, face_directions
from .geometry import Geometry, Hits
from .lightmaps import LightMaps
from .model import ObjectScene

Float64Array = npt.NDArray[np.float64]


class Radiance:
    """What a ray sees of the diffuse world: objects, lights, sky.

    Parameters
    ----------
    sky : CubeMap, optional
        The environment, scaled; black without.
    """

    def __init__(
        self, scene: ObjectScene, geometry: Geometry, maps: LightMaps, sky: CubeMap | None
    ) -> None:
        self.scene, self.geometry, self.maps, self.sky = scene, geometry, maps, sky
        rows = [light.radiance for light in scene.lights]
        self._lights = np.array(rows, dtype=np.float64).reshape(-1, 3)

    def of_hits(self, hits: Hits, directions: Float64Array) -> Float64Array:
        """Radiance (..., 3) along rays whose hits are known; ``directions`` (..., 3)."""
        out = self.maps.radiance(hits)
        light = hits.object - len(self.scene.objects)
        on = (light >= 0) & hits.front
        out[on] = self._lights[light[on]]
        if self.sky is not None:
            miss = ~hits.found
            out[miss] = self.sky.lookup(directions[miss])
        return out

    def along(
        self, origins: npt.ArrayLike, directions: Float64Array, skip: int = -1
    ) -> Float64Array:
        """Radiance (..., 3) along rays; object ``skip`` is not there."""
        return self.of_hits(self.geometry.intersect(origins, directions, skip=skip), directions)


def capture(world: Radiance, index: int, size: int = 256, supersampling: int = 2) -> CubeMap:
    """The cube map of object ``index``, from its bounding box's centre and without it.

    Parameters
    ----------
    size : int
        Texels along a face's edge.
    supersampling : int
        Rays along each axis of a texel; the texel is their mean.

    Raises
    ------
    ValueError
        For an object that is not there, or a size out of range.
    """
    count = len(world.scene.objects)
    _check.count("object", index, low=0, high=count - 1)
    n, k = _check.count("size", size, high=4096), _check.count("supersampling", supersampling)
    side = (np.arange(n * k) + 0.5) * (2.0 / (n * k)) - 1.0
    centre = world.geometry.center(index)
    faces = np.empty((6, n, n, 3), dtype=np.float32)
    band = max((1 << 20) // (n * k * k), 1)  # rows of texels at a time
    for face in range(6):
        for row in range(0, n, band):
            t = side[row * k : (row + band) * k]
            rays = face_directions(np.intp(face), side[None, :], t[:, None])
            value = world.along(centre, rays, skip=index)
            faces[face, row : row + band] = value.reshape(-1, k, n, k, 3).mean(axis=(1, 3))
    return CubeMap(faces)
