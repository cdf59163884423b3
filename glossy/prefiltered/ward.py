"""Ward's isotropic Gaussian reflection, the example of the source.

::

    f = kd/pi + ks exp(-tan^2 delta / alpha^2) / (4 pi alpha^2 sqrt((wi.n)(wo.n)))           (1)

delta is the angle between the half vector and the normal. f has no bound where wi or wo reaches
the horizon; f cos theta_i has one for every wo above it.

Source: Ward 1992, "Measuring and modeling anisotropic reflection", eq. 5, as Kautz and McCool 2000
use it. Half vectors are drawn as those of a Kurt lobe with m = alpha, whose slopes have the same
exponential.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .. import _check
from ..brdf import M_MAX, M_MIN, Lobe, Material

Float64Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Ward:
    """Eq. (1) in the local frame, z the normal.

    Parameters
    ----------
    kd, ks : float or RGB, >= 0
        Diffuse and glossy weights; ks is close to the glossy albedo for small alpha.
    alpha : float
        Standard deviation of the surface slope (times sqrt 2), 1e-5 to 10.

    Raises
    ------
    ValueError
        If a parameter is out of range.
    """

    kd: float | Sequence[float] = 0.0
    ks: float | Sequence[float] = 1.0
    alpha: float = 0.1

    def __post_init__(self) -> None:
        for name in ("kd", "ks"):
            value = getattr(self, name)
            channels = _check.rgb(name, value)
            flat = np.ndim(value) == 0
            object.__setattr__(self, name, float(channels[0]) if flat else tuple(channels.tolist()))
        object.__setattr__(self, "alpha", _check.in_range("alpha", self.alpha, M_MIN, M_MAX))

    def eval(self, wi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
        """Eq. (1) [1/sr] for unit directions (..., 3); zero unless both are above the surface.

        Returns
        -------
        (...) float64 when kd and ks are numbers, else (..., 3).
        """
        i, o = _check.unit_vectors("wi", wi), _check.unit_vectors("wo", wo)
        i, o = np.broadcast_arrays(i, o)
        h = i + o
        up = (i[..., 2] > 0.0) & (o[..., 2] > 0.0)
        z = np.where(up, h[..., 2], 1.0)
        slope = (h[..., 0] ** 2 + h[..., 1] ** 2) / (z * self.alpha) ** 2
        cosines = np.where(up, i[..., 2] * o[..., 2], 1.0)
        glossy = np.exp(-slope) / (4.0 * math.pi * self.alpha**2 * np.sqrt(cosines))
        kd, ks = _check.rgb("kd", self.kd), _check.rgb("ks", self.ks)
        f = np.where(up[..., None], kd / math.pi + ks * glossy[..., None], 0.0)
        return f[..., 0] if np.ndim(self.kd) == np.ndim(self.ks) == 0 else f

    def sample(self, xi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
        """Directions (..., 3) of density ``pdf`` for uniform ``xi`` (..., 2), see `Lobe.sample`."""
        return self._kurt.sample(xi, wo)

    def pdf(self, wi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
        """Density [1/sr] of ``sample``, shape (...)."""
        return self._kurt.pdf(wi, wo)

    @property
    def _kurt(self) -> Material:
        return Material(kd=self.kd, reflection=[Lobe(mx=self.alpha, ks=self.ks)])
