"""Albedo of a lobe: the integral of f |cos theta_i| over a hemisphere, by quadrature in slopes.

With h along (rho mx cos phi, rho my sin phi, 1) the lobe's density of half vectors becomes
rho exp(-rho^2) / pi d rho d phi, and f cos theta_i / pdf(wi) = F (wi.n)^(1-alpha) (wo.n)^(-alpha)
/ cos theta_h. Writing a^2 = (mx cos phi)^2 + (my sin phi)^2, b = wo_x mx cos phi + wo_y my sin phi,
c = wo.n and S = sqrt(b^2 + a^2 c^2)::

    albedo  = ks / pi  int int F c^(-alpha) N^(1-alpha) (1 + a^2 rho^2)^(alpha - 1/2)
                               rho exp(-rho^2) d rho d phi                          (1)
    N       = (1 + a^2 rho^2) wi.n = c + 2 b rho - c a^2 rho^2
            = c a^2 (rho_h - rho) (rho + rho_n)                                     (2)
    rho_h   = (S + b) / (c a^2)   the horizon,     rho_n = (S - b) / (c a^2)        (3)

What makes (1) hard is divided out: the power (rho_h - rho)^(1-alpha) at the horizon is the weight
of a Gauss-Jacobi rule; rho = rho_n (e^t - 1) removes the branch point at -rho_n, which at grazing
views lies next to 0; and S has its least values, eps times its largest, at two opposite azimuths,
towards which phi = phi_S + eps sinh t crowds the nodes. Nodes are doubled until the result stands
still.

For alpha > 0 the model may reflect more than it receives, without bound at the horizon: reported,
not hidden.
"""

import functools
import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.special import roots_jacobi

from . import _check

if TYPE_CHECKING:
    from .brdf import Lobe

Float64Array = npt.NDArray[np.float64]

RHO_MAX = 6.5  # exp(-rho^2) is 4e-19 there
TOLERANCE = 1e-10  # relative change on doubling the nodes of each axis at which they suffice
NODES = (24, 48, 96, 192, 384)
CHUNK = 1 << 20  # integrand values held at once


@functools.lru_cache(maxsize=64)
def _rule(n: int, beta: float) -> tuple[Float64Array, Float64Array]:
    """Nodes and weights on [-1, 1] for integrands that end in (1 - x)^beta."""
    x, w = roots_jacobi(n, beta, 0.0)
    return x, w * (1.0 - x) ** -beta


def unit_integrals(wo: Float64Array, mx: float, my: float, alpha: float, n: int) -> Float64Array:
    """Eq. (1) over ks with 1, (1-u)^5 and 1 - (1-u)^5 for F: (k, 3) for wo (k, 3) with c > 0."""
    x, wx = _rule(n, 1.0 - alpha)
    y, wy = _rule(n, 0.0)
    c = wo[:, 2, None, None]
    # S^2 is a quadratic form in (cos phi, sin phi); phi_S is the direction of its small eigenvalue
    gx, gy = wo[:, 0] * mx, wo[:, 1] * my
    p, q, r = gx**2 + (wo[:, 2] * mx) ** 2, gx * gy, gy**2 + (wo[:, 2] * my) ** 2
    large = 0.5 * (p + r) + np.hypot(0.5 * (p - r), q)
    small = wo[:, 2] ** 2 * mx**2 * my**2 / large  # the product of both is det, here with |wo| = 1
    start = 0.5 * np.arctan2(2.0 * q, p - r) + 0.5 * math.pi
    eps = np.sqrt(np.maximum(small / large, 1e-24))[:, None]
    reach = np.arcsinh(0.5 * math.pi / eps)
    phi = start[:, None] + eps * np.sinh(reach * y)
    w_phi = wy * reach * eps * np.cosh(reach * y)
    phi = np.concatenate([phi, phi + math.pi], axis=1)[:, :, None]
    w_phi = np.concatenate([w_phi, w_phi], axis=1)

    ux, uy = mx * np.cos(phi), my * np.sin(phi)  # slopes per rho
    ca2 = c * (ux * ux + uy * uy)
    b = gx[:, None, None] * np.cos(phi) + gy[:, None, None] * np.sin(phi)
    s = np.sqrt(b * b + c * ca2)
    far = (s + np.abs(b)) / ca2
    near = c / (s + np.abs(b))
    rho_h, rho_n = np.where(b < 0.0, near, far), np.where(b < 0.0, far, near)
    end = np.log1p(np.minimum(rho_h, RHO_MAX) / rho_n)
    t = 0.5 * end * (1.0 + x)
    shifted = rho_n * np.exp(t)  # rho + rho_n, also d rho / dt
    rho = rho_n * np.expm1(t)
    beyond = np.maximum(rho_h - RHO_MAX, 0.0)
    top = ca2 * (beyond + shifted * np.expm1(end - t)) * shifted  # N
    sx, sy = ux * rho, uy * rho
    l2 = 1.0 + sx * sx + sy * sy
    core = top ** (1.0 - alpha) * l2 ** (alpha - 0.5) * rho * np.exp(-rho * rho) * shifted
    core *= c**-alpha * 0.5 / math.pi * end * wx * w_phi[:, :, None]
    # 1 - u from |wo x h|^2 = 1 - u^2, which keeps its digits near the mirror direction
    ox, oy = wo[:, 0, None, None], wo[:, 1, None, None]
    u = np.minimum((ox * sx + oy * sy + c) / np.sqrt(l2), 1.0)
    cross2 = (oy - c * sy) ** 2 + (c * sx - ox) ** 2 + (ox * sy - oy * sx) ** 2
    v = cross2 / (l2 * (1.0 + u))
    v5 = v * v * v * v * v
    rest = u * (1.0 + v * (1.0 + v * (1.0 + v * (1.0 + v))))  # 1 - v^5 with u = 1 - v
    return np.stack([core.sum((1, 2)), (core * v5).sum((1, 2)), (core * rest).sum((1, 2))], -1)


def lobe_albedo(lobe: "Lobe", wo: npt.ArrayLike, transmitted: bool = False) -> Float64Array:
    """Fraction of the light from ``wo`` that a lobe sends out, eq. (1).

    The reflectivity of a reflection lobe, thesis eq. 2.7; with ``transmitted`` the transmissivity
    of a thin transmission lobe, eq. 2.8, which has 1 - F for F.

    Parameters
    ----------
    lobe : Lobe
    wo : (..., 3) array
        Unit directions in the frame (t, b, n).
    transmitted : bool

    Returns
    -------
    (..., 3) float64, RGB; zero for ``wo`` at or below the horizon. The relative error is about
    1e-10 for roughness up to 2 and views from 1e-6 above the horizon.

    Raises
    ------
    ValueError
        If a direction is not finite or not unit within 1e-3.
    """
    o = _check.unit_vectors("wo", wo)
    flat = o.reshape(-1, 3)
    mx, my = lobe.widths
    totals = np.zeros((len(flat), 3))
    todo = np.flatnonzero(flat[:, 2] > 0.0)
    for step, n in enumerate(NODES):
        size = max(1, CHUNK // (2 * n * n))
        parts = [todo[k : k + size] for k in range(0, len(todo), size)]
        if not parts:
            break
        values = [unit_integrals(flat[part], mx, my, lobe.alpha, n) for part in parts]
        new = np.concatenate(values)
        moved = np.abs(new - totals[todo]) > TOLERANCE * np.abs(new)
        totals[todo] = new
        if step:
            todo = todo[moved.any(axis=1)]
    one, schlick, rest = totals[:, 0, None], totals[:, 1, None], totals[:, 2, None]
    r0, ks = _check.rgb("r0", lobe.r0), _check.rgb("ks", lobe.ks)
    fresnel = (1.0 - r0) * rest if transmitted else r0 * one + (1.0 - r0) * schlick
    return np.asarray(ks * fresnel).reshape(o.shape)
