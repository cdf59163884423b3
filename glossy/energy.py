"""What a material sends out of what it receives: energy checks, and kd that yields to the lobes.

With r_l(w) and t_l(w) the albedos of the reflection and transmission lobes, kd and kt_d the diffuse
coefficients of either side ::

    r(w) = s(w) kd + r_l(w),   t(w) = s(w) kt_d + t_l(w),   r + t <= 1                      (1)
    s(w) = 1                                       as printed
    s(w) = max(0, 1 - r_l(w) - t_l(w))             with kd_falloff                          (2)

Source: thesis eqs. 2.7, 2.8, and the limitation it states at the end of its chapter 3: the diffuse
part of a material with a strong Fresnel effect falls where the lobes rise. (2) is the simplest form
with that property: the diffuse terms share the energy that the lobes leave, so that kd + kt_d <= 1
keeps (1) wherever the lobes do. w is the direction to the viewer, as a light map holds irradiance
without directions: f(wi, wo) then is not reciprocal. A reciprocal form needs s(wi) inside the
irradiance.

The lobes' albedos are integrals at nodes in log(w.n) and, for anisotropic lobes, in azimuth, with
cubic splines between them.
"""

import dataclasses
import functools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline, RectBivariateSpline

from . import _check
from ._arguments import checked
from .albedo import unit_integrals
from .frames import spherical

if TYPE_CHECKING:
    from .brdf import Lobe, Material

Float64Array = npt.NDArray[np.float64]

COS_MIN = 1e-3  # views closer to the horizon take this one's value
NODES = 129  # in log(cos): steps of 5.5 %
AZIMUTHS = 25  # over a quarter turn
QUADRATURE = 48  # nodes along each axis of the albedo's integral
SLACK = 1e-9  # what the quadrature may miss of 1 without an excess being reported


@functools.lru_cache(maxsize=32)
def _splines(mx: float, my: float, alpha: float) -> tuple[Any, ...]:
    """Splines over the three integrals of ``albedo``: with 1, (1-u)^5 and 1 - (1-u)^5 for F."""
    log_cos = np.linspace(math.log(COS_MIN), 0.0, NODES)
    phi = np.zeros(1) if mx == my else np.linspace(0.0, 0.5 * math.pi, AZIMUTHS)
    wo = spherical(np.arccos(np.exp(log_cos))[:, None], phi).reshape(-1, 3)
    parts = [unit_integrals(part, mx, my, alpha, QUADRATURE) for part in np.array_split(wo, 16)]
    values = np.concatenate(parts).reshape(NODES, len(phi), 3)
    if mx == my:
        return tuple(CubicSpline(log_cos, values[:, 0, k]) for k in range(3))
    # mirrored at both ends of the quarter turn, so that the splines are level there
    turn = np.concatenate([-phi[4:0:-1], phi, math.pi - phi[-2:-6:-1]])
    spread = np.concatenate([values[:, 4:0:-1], values, values[:, -2:-6:-1]], axis=1)
    return tuple(RectBivariateSpline(log_cos, turn, spread[..., k]) for k in range(3))


def interpolated_albedo(lobe: "Lobe", wo: Float64Array, transmitted: bool) -> Float64Array:
    """``albedo.lobe_albedo`` (..., 3) for unit ``wo`` (..., 3) above the surface, by splines."""
    mx, my = lobe.widths
    log_cos = np.log(np.clip(wo[..., 2], COS_MIN, 1.0))
    splines = _splines(mx, my, lobe.alpha)
    if mx == my:
        one, schlick, rest = (spline(log_cos)[..., None] for spline in splines)
    else:
        phi = np.arctan2(np.abs(wo[..., 1]), np.abs(wo[..., 0]))
        one, schlick, rest = (spline.ev(log_cos, phi)[..., None] for spline in splines)
    r0, ks = _check.rgb("r0", lobe.r0), _check.rgb("ks", lobe.ks)
    return np.asarray(ks * ((1.0 - r0) * rest if transmitted else r0 * one + (1.0 - r0) * schlick))


def diffuse_share(material: "Material", wo: npt.ArrayLike) -> Float64Array | None:
    """Factor s (..., 3) on the diffuse terms for local ``wo`` (..., 3), eq. (2); None without.

    Within 5e-6 of the exact integrals for isotropic lobes, 1e-5 for anisotropic ones of an aspect
    up to 5, for views from 0.1 degrees above the horizon and where no lobe exceeds albedo 1.
    """
    if not material.kd_falloff:
        return None
    o = np.asarray(_check.array("wo", wo), dtype=np.float64)
    left = np.ones(o.shape)
    for lobe, side in material.sided_lobes():
        left -= interpolated_albedo(lobe, o, side < 0.0)
    return np.maximum(left, 0.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Energy:
    """What a material sends out over a set of directions, eq. (1).

    ``theta`` (A,), ``phi`` (B,) [degrees]; ``reflectivity``, ``transmissivity`` (A, B, 3);
    ``largest``: the largest r + t of any channel, at ``worst`` (theta, phi) [degrees];
    ``exceeds_from``: the smallest theta from which r + t > 1, None if nowhere.
    """

    theta: Float64Array
    phi: Float64Array
    reflectivity: Float64Array
    transmissivity: Float64Array
    largest: float
    worst: tuple[float, float]
    exceeds_from: float | None

    @property
    def conserved(self) -> bool:
        """Whether r + t <= 1 at every direction looked at."""
        return self.exceeds_from is None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: the fields, and ``conserved``."""
        fields = dataclasses.asdict(self)
        plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in fields.items()}
        return {**plain, "conserved": self.conserved}


@checked
def energy(material: "Material", theta: npt.ArrayLike | None = None) -> Energy:
    """Reflectivity and transmissivity of a material over its directions, and where r + t > 1.

    Parameters
    ----------
    material : Material
    theta : (A,) array [degrees], optional
        Angles from the normal, 0 to below 90; by default every 5 degrees to 85, then 87, 89, 89.9.
        The azimuth runs over a quarter turn by 15 degrees, or is 0 for isotropic materials.

    Raises
    ------
    ValueError
        For angles out of range.
    """
    if theta is None:
        theta = np.array([*range(0, 90, 5), 87.0, 89.0, 89.9])
    angles = np.atleast_1d(np.asarray(_check.array("theta", theta), dtype=np.float64))
    if angles.ndim != 1 or not angles.size or not np.all((angles >= 0.0) & (angles < 90.0)):
        raise _check.fail("theta", "must be angles in [0, 90)", angles.tolist())
    isotropic = all(lobe.mx == lobe.my for lobe in material.lobes)
    phi = np.zeros(1) if isotropic else np.arange(0.0, 91.0, 15.0)
    wo = spherical(np.radians(angles)[:, None], np.radians(phi))
    up, down = (np.broadcast_to(_with_channels(a, wo), wo.shape) for a in material.albedo(wo))
    total = (up + down).max(axis=2)
    i, j = np.unravel_index(int(np.argmax(total)), total.shape)
    beyond = (total > 1.0 + SLACK).any(axis=1)
    first = float(angles[beyond].min()) if beyond.any() else None
    worst = float(angles[i]), float(phi[j])
    return Energy(angles, phi, up, down, float(total[i, j]), worst, first)


def _with_channels(a: npt.NDArray[Any], wo: Float64Array) -> npt.NDArray[Any]:
    return a[..., None] if a.ndim == wo.ndim - 1 else a
