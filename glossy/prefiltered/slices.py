"""One slice of a BRDF: seen from a fixed elevation, sampled where it is large.

Samples are cells of half vectors about the normal: even in azimuth, and in polar angle as

    theta_h = s sinh(u asinh(pi/(2 s))),   u in [0, 1]                                      (1)

which is even near the normal and geometric beyond s, the angle at which the BRDF falls to half of
its peak. In half vectors even the long thin lobes of glancing views are (nearly) round. A cell
stands for the solid angle 4 (wo.h) dw_h of directions wi = reflect(wo, h) ::

    albedo(wo) = sum_h f(wi, wo) cos theta_i 4 (wo.h) dw_h                                  (2)

What is approximated is ``value``: f, or f cos theta_i. The diffuse part kd is left out: it is the
irradiance's part of the picture.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from ..brdf import Lobe, Material
from ..frames import dot, reflect, spherical

Float64Array = npt.NDArray[np.float64]
Function = Callable[[Float64Array], Float64Array]
"""Directions wi (..., 3) to values (..., C)."""

CELLS = (160, 64)  # polar, azimuth
ISOTROPY = 1e-3  # largest change of f with the azimuth of the surface, of its peak
FLOOR = 1e-3  # cos theta_i below which f is held: some models have no bound at the horizon


@dataclasses.dataclass(frozen=True, eq=False)
class Slice:
    """A BRDF for one ``wo`` in the plane of incidence, sampled in half vectors.

    ``wi`` (G, 3) above the horizon, ``area`` (G,) [sr], ``value`` (G, C) of ``function``, which
    gives f or f cos theta_i for any wi and 0 below the horizon; ``albedo`` (C,), eq. (2); ``cell``
    (G,) the place of each sample on the grid of half vectors, azimuth running fastest.
    """

    wo: Float64Array
    wi: Float64Array
    area: Float64Array
    value: Float64Array
    function: Function
    albedo: Float64Array
    scale: float
    cosine_outside: bool
    cells: tuple[int, int]
    cell: npt.NDArray[np.intp]

    def coarse(self, count: int) -> npt.NDArray[np.intp]:
        """Number (G,) of the coarse cell of each sample; about ``count`` of them, none empty."""
        n, turns = self.cells
        block = max(1, round(math.sqrt(n * turns / count)))
        row, column = np.divmod(self.cell, turns)
        place = (row // block) * turns + column // block
        return np.unique(place, return_inverse=True)[1]


def glossy_part(material: Any) -> Any:
    """The material without kd.

    Raises
    ------
    ValueError
        If it has no ``eval``, or transmits.
    """
    if isinstance(material, Lobe):
        return Material(reflection=[material])
    if isinstance(material, Material) and (material.transmission or material.diffuse_below.any()):
        raise _check.fail("material", "must not transmit", "a transmission lobe or kt_d")
    if not callable(getattr(material, "eval", None)):
        raise _check.fail("material", "must have eval", type(material).__name__)
    if dataclasses.is_dataclass(material) and np.any(getattr(material, "kd", 0.0)):
        return dataclasses.replace(material, kd=0.0)  # type: ignore[type-var]
    return material


def channels_of(value: npt.NDArray[np.floating], wi: Float64Array) -> Float64Array:
    """What ``eval`` gave, always with a channel axis."""
    v = np.asarray(value, dtype=np.float64)
    return v[..., None] if v.shape == wi.shape[:-1] else v


def half_width(material: Any) -> float:
    """Angle of the half vector [rad] beyond which f stays below half of its peak.

    Looked for along a line of half vectors across the plane of incidence, at 45 degrees.
    """
    wo = spherical(0.25 * math.pi, 0.0)
    angle = np.geomspace(1e-6, 0.5 * math.pi, 400, endpoint=False)
    h = spherical(angle, np.full(len(angle), 0.5 * math.pi))
    wi = reflect(wo, h)
    f = channels_of(material.eval(wi, np.broadcast_to(wo, wi.shape)), wi).mean(axis=-1)
    if not f.max() > 0.0:
        return 0.5 * math.pi
    return float(angle[np.flatnonzero(f >= 0.5 * f.max())[-1]])


def half_vector_grid(
    scale: float, cells: tuple[int, int] = CELLS
) -> tuple[Float64Array, Float64Array]:
    """Half vectors (G, 3) of eq. (1) and their solid angles (G,) [sr], which sum to 2 pi."""
    n, turns = cells
    u = np.linspace(0.0, 1.0, 2 * n + 1)
    theta = scale * np.sinh(u * math.asinh(0.5 * math.pi / scale))
    edge, middle = theta[::2], theta[1::2]
    # 2 sin sin for a difference of cosines: no cancellation
    ring = 2.0 * np.sin(0.5 * (edge[1:] + edge[:-1])) * np.sin(0.5 * np.diff(edge))
    phi = 2.0 * math.pi * (np.arange(turns) + 0.5) / turns
    h = spherical(*np.meshgrid(middle, phi, indexing="ij")).reshape(-1, 3)
    return h, np.repeat(ring * (2.0 * math.pi / turns), turns)


def make_function(material: Any, wo: Float64Array, cosine_outside: bool) -> Function:
    """F or f cos theta_i for wi (..., 3), (..., C); zero below the horizon."""

    def function(wi: Float64Array) -> Float64Array:
        z = wi[..., 2]
        up = z > 0.0
        safe = np.where(up[..., None], wi, wo)
        if cosine_outside:
            low = up & (z < FLOOR)
            if low.any():
                flat = np.hypot(wi[..., 0], wi[..., 1])
                side = math.sqrt(1.0 - FLOOR**2) / np.maximum(flat, FLOOR)
                held = np.stack([wi[..., 0] * side, wi[..., 1] * side, 0.0 * z + FLOOR], axis=-1)
                safe = np.where(low[..., None], held, safe)
        f = channels_of(material.eval(safe, np.broadcast_to(wo, safe.shape)), safe)
        weight = np.where(up, 1.0 if cosine_outside else z, 0.0)
        return np.maximum(f, 0.0) * weight[..., None]

    return function


def make_slice(
    material: Any,
    cosine: float,
    scale: float,
    cosine_outside: bool,
    cells: tuple[int, int] = CELLS,
) -> Slice:
    """The slice at cos theta_o = ``cosine``, wo in the plane of x and z."""
    wo = spherical(math.acos(cosine), 0.0)
    h, area = half_vector_grid(scale, cells)
    cosine_h = dot(h, np.broadcast_to(wo, h.shape))
    wi = reflect(wo, h)
    keep = (cosine_h > 0.0) & (wi[:, 2] > 0.0)
    wi, area = wi[keep], (4.0 * cosine_h * area)[keep]
    function = make_function(material, wo, cosine_outside)
    value = function(wi)
    bright = value * (wi[:, 2:] if cosine_outside else 1.0)
    cell = np.flatnonzero(keep)
    return Slice(wo, wi, area, value, function, area @ bright, scale, cosine_outside, cells, cell)


def check_isotropic(material: Any, scale: float) -> None:
    """Refuse a material that changes when the surface turns about its normal.

    Raises
    ------
    ValueError
        If f changes by more than ISOTROPY of its peak.
    """
    wo = spherical(0.25 * math.pi, 0.0)
    h, _ = half_vector_grid(scale, (24, 16))
    wi = reflect(wo, h)
    wi = wi[wi[:, 2] > FLOOR]
    values = []
    for turn in (0.0, 0.7, 0.5 * math.pi):
        c, s = math.cos(turn), math.sin(turn)
        m = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        i = wi @ m
        values.append(channels_of(material.eval(i, np.broadcast_to(wo @ m, i.shape)), i))
    worst = max(float(np.abs(v - values[0]).max()) for v in values[1:])
    if worst > ISOTROPY * float(values[0].max()):
        raise _check.fail("material", "must be isotropic", f"f differs by {worst:.3g} as it turns")
