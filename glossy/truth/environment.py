"""Sampling directions in proportion to an environment's radiance.

The density is constant over each texel in the face's plane, in proportion to the integral of the
bilinear radiance over the texel: along an axis a texel weighs itself with 6/8 and either neighbour
with 1/8. So a direction of radiance above 0 always has a density above 0::

    p(wi) = P_k N^2 / (4 J),   J = (1 + s^2 + t^2)^(-3/2) the solid angle per area           (1)
"""

import numpy as np
import numpy.typing as npt

from ..cubemap import CubeMap, face_directions, locate, texel_solid_angles

Float64Array = npt.NDArray[np.float64]


class EnvironmentSampler:
    """Directions drawn with density (1) from the mean of the channels' magnitude.

    A black map is sampled in proportion to solid angle.
    """

    def __init__(self, cube: CubeMap) -> None:
        self.size = cube.size
        light = np.abs(cube.padded).mean(axis=3, dtype=np.float64)
        light = (light[:, :-2] + 6.0 * light[:, 1:-1] + light[:, 2:]) / 8.0
        light = (light[:, :, :-2] + 6.0 * light[:, :, 1:-1] + light[:, :, 2:]) / 8.0
        if not light.any():
            light[...] = 1.0
        light *= texel_solid_angles(self.size)
        ends = np.cumsum(light.reshape(-1))
        self._ends = ends / ends[-1]
        self._share = np.diff(self._ends, prepend=0.0)

    def sample(self, u: Float64Array) -> Float64Array:
        """Unit directions (..., 3), world coordinates, for uniform numbers (..., 2) in (0, 1)."""
        n, ends, share = self.size, self._ends, self._share
        row_ends = ends[n - 1 :: n]
        row = np.searchsorted(row_ends[:-1], u[..., 0], side="right")
        start = np.where(row > 0, row_ends[row - 1], 0.0)
        mass = row_ends[row] - start
        down = (u[..., 0] - start) / mass
        target = start + u[..., 1] * mass
        texel = np.clip(np.searchsorted(ends, target, side="right"), row * n, row * n + n - 1)
        across = 1.0 - (ends[texel] - target) / np.maximum(share[texel], np.finfo(float).tiny)
        s = (texel % n + np.clip(across, 0.0, 1.0)) * (2.0 / n) - 1.0
        t = (row % n + np.clip(down, 0.0, 1.0)) * (2.0 / n) - 1.0
        d = face_directions(row // n, s, t)
        return np.asarray(d / np.sqrt(1.0 + s * s + t * t)[..., None])

    def pdf(self, wi: Float64Array) -> Float64Array:
        """Density [1/sr] (...) of world directions (..., 3), eq. (1)."""
        n = self.size
        face, s, t = locate(wi)
        col = np.clip(((s + 1.0) * (0.5 * n)).astype(np.intp), 0, n - 1)
        row = np.clip(((t + 1.0) * (0.5 * n)).astype(np.intp), 0, n - 1)
        square = 1.0 + s * s + t * t
        share = self._share[(face * n + row) * n + col]
        return np.asarray(share * (0.25 * n * n) * square * np.sqrt(square))
