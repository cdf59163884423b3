"""The bright texels of an environment, apart from the rest: what random rays find by chance.

Radiance is split texel by texel at c = ``CAP`` times the mean over the sphere, m the brightest
channel ::

    L = rest + bright,   bright = L max(0, 1 - c/m)                                         (1)

Rays over the hemisphere see the rest, of which no texel is far above the mean. Bright texels are
drawn with P_k ~ m_k omega_k, evenly over the texel in the face's plane, and met by shadow rays ::

    E = sum int bright cos V domega = mean of bright J (2/N)^2 cos V / P_k                   (2)

with J = (1 + s^2 + t^2)^(-3/2), N texels along an edge. For one small sun nothing is left to chance
but its visibility V. A bright part of less than ``LEAST`` of all light is left with the rest, and
costs no ray.
"""

import numpy as np
import numpy.typing as npt

from ..cubemap import CubeMap, face_directions, texel_solid_angles
from ..pyramid import Pyramid, build_pyramid

Float64Array = npt.NDArray[np.float64]

CAP = 8.0
LEAST = 1e-3


class BrightTexels:
    """Directions towards texels (face, row, column) of radiance (K, 3) in a map of ``size``."""

    def __init__(
        self, places: tuple[npt.NDArray[np.intp], ...], radiance: Float64Array, size: int
    ) -> None:
        self.places, self.radiance, self.size = places, radiance, size
        power = radiance.max(axis=1) * texel_solid_angles(size)[places[1], places[2]]
        ends = np.cumsum(power)
        self.ends, self.share = ends / ends[-1], power / ends[-1]

    def sample(self, u: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Unit directions (N, 3) for uniform numbers (N, 2), and bright J (2/N)^2 / P_k (N, 3)."""
        k = np.minimum(np.searchsorted(self.ends, u[:, 0], side="right"), len(self.ends) - 1)
        across = 1.0 - (self.ends[k] - u[:, 0]) / self.share[k]
        face, row, column = (place[k] for place in self.places)
        s = (column + np.clip(across, 0.0, 1.0)) * (2.0 / self.size) - 1.0
        t = (row + u[:, 1]) * (2.0 / self.size) - 1.0
        square = 1.0 + s * s + t * t
        area = (2.0 / self.size) ** 2 * square**-1.5 / self.share[k]
        d = face_directions(face, s, t) / np.sqrt(square)[:, None]
        return np.asarray(d), np.asarray(self.radiance[k] * area[:, None])


def split_bright(sky: Pyramid) -> tuple[Pyramid, BrightTexels | None]:
    """The rest and the bright texels of an environment, eq. (1); the same pyramid without any."""
    faces = sky.levels[0].astype(np.float64)
    brightest = faces.max(axis=-1)
    omega = texel_solid_angles(sky.size)
    total = float(np.sum(faces.mean(axis=-1) * omega))
    cap = CAP * total / (4.0 * np.pi)
    above = np.maximum(brightest - cap, 0.0)
    if total <= 0.0 or np.sum(above * omega) <= LEAST * total:
        return sky, None
    places = np.nonzero(above)
    bright = faces[places] * (1.0 - cap / brightest[places])[:, None]
    faces[places] -= bright
    rest = build_pyramid(CubeMap(faces, negative="keep"))
    return rest, BrightTexels(places, np.maximum(bright, 0.0), sky.size)
