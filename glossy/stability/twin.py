"""The estimators once more, in extended precision and without the kernels' rearrangements.

``numpy.longdouble`` (64 bits of mantissa on x86, 53 elsewhere) for directions, densities,
footprints and weights, as the equations of ``shading`` and ``footprint`` are printed, with angles
from atan2; lookups in each level by the cube map's own float64 bilinear lookup.
"""

import functools
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..brdf import Lobe, Material
from ..cubemap import CubeMap
from ..frames import SurfacePoints
from ..pattern import importance_pattern, pattern_for_budget
from ..pyramid import Pyramid
from ..thesis_pattern import thesis_pattern

Extended = npt.NDArray[np.longdouble]
Float64Array = npt.NDArray[np.float64]


def extended(value: npt.ArrayLike) -> Extended:
    """As an array of extended precision."""
    return np.asarray(value, dtype=np.longdouble)


def _unit(v: Extended) -> Extended:
    return np.asarray(v / np.sqrt((v * v).sum(axis=-1, keepdims=True)))


def _angle(a: Extended, b: Extended) -> Extended:
    c = np.cross(a, b)
    return np.asarray(np.arctan2(np.sqrt((c * c).sum(axis=-1)), (a * b).sum(axis=-1)))


def lobe_value(wi: npt.ArrayLike, wo: npt.ArrayLike, lobe: Lobe, transmitted: bool) -> Extended:
    """The value ks f of one lobe, (...), by eqs. (1)-(3) of ``brdf``; for scalar ks and r0."""
    i, o = (_unit(extended(v)) for v in (wi, wo))
    if transmitted:
        i = i * [1.0, 1.0, -1.0]
    h = i + o
    good = (i[..., 2] > 0) & (o[..., 2] > 0)
    h = _unit(np.where(good[..., None], h, extended([0.0, 0.0, 1.0])))
    mx, my = (extended(m) for m in lobe.widths)
    q = (h[..., 0] / h[..., 2] / mx) ** 2 + (h[..., 1] / h[..., 2] / my) ** 2
    d = np.exp(-q) / (extended(np.pi) * mx * my * h[..., 2] ** 4)
    u = (o * h).sum(axis=-1)
    r0 = extended(lobe.r0)
    fresnel = r0 + (1 - r0) * (1 - u) ** 5
    fresnel = 1 - fresnel if transmitted else fresnel
    z = np.where(good, i[..., 2] * o[..., 2], 1)
    value = extended(lobe.ks) * fresnel * d / (4 * np.where(good, u, 1) * z ** extended(lobe.alpha))
    return np.asarray(np.where(good, value, 0))


def _texels(
    wo: Extended, wi: Extended, cos_h: Extended, d: Extended, lobe: Lobe, n: int, xi: float,
    footprint: str, cell: Extended, size: int,
) -> Extended:  # fmt: skip
    if footprint == "jacobian":
        return 4 * cos_h * cell * size**2 / 4 * d**3
    reach = math.sqrt(-math.log(xi))
    centre = wo * [-1.0, -1.0, 1.0]
    tangent = extended(1)
    for axis, m in enumerate(lobe.widths):
        h = np.zeros(3, dtype=np.longdouble)
        h[axis], h[2] = extended(reach) * m, 1
        h = _unit(h)
        border = 2 * (wo * h).sum(axis=-1)[..., None] * h - wo
        angle = _angle(centre, border)
        tangent = tangent * np.where(angle < extended(np.pi) / 2, np.tan(angle), np.inf)
    area = np.minimum(extended(np.pi) * tangent, 2 * extended(np.pi))[:, None]
    if footprint == "paper":
        return np.asarray(area * size**2 / (4 * n) * d / cos_h)
    return np.asarray(area * size**2 / (4 * n) * d**3)


@functools.lru_cache(maxsize=4)
def _cubes(pyramid: Pyramid) -> list[CubeMap]:
    return [CubeMap(faces) for faces in pyramid.levels]


def lookup(pyramid: Pyramid, directions: Extended, level: Extended) -> Float64Array:
    """Trilinear radiance (..., 3) from the levels as separate cube maps."""
    top = len(_cubes(pyramid)) - 1
    clamped = np.clip(level, 0, top)
    first = np.minimum(np.floor(clamped).astype(int), top)
    f = np.asarray(clamped - first, dtype=np.float64)
    out = np.zeros(directions.shape)
    d = np.asarray(directions, dtype=np.float64)
    for k, cube in enumerate(_cubes(pyramid)):
        weight = np.where(first == k, 1.0 - f, np.where(first == k - 1, f, 0.0))
        use = weight > 0.0
        if use.any():
            out[use] += weight[use, None] * cube.lookup(d[use])
    return out


def shade(
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    method: str = "regular",
    samples: int | None = None,
    threshold: float | None = None,
    footprint: str | None = None,
    bias: float = 0.0,
    normalisation: str = "paper",
    estimator: str = "4.25",
) -> Float64Array:
    """``glossy.shade`` for points (P,) and lobes of scalar ks and r0, (P, 3) float64.

    Samples, threshold or footprint of None are the method's own.
    """
    from . import lattice_twin

    variant = estimator if method == "thesis" else normalisation
    count = samples or (14 if method == "lattice" else 20)
    xi = threshold or (0.01 if method == "thesis" else 0.1)
    model = footprint or {"regular": "paper", "thesis": "thesis"}.get(method, "jacobian")
    normal, tangent, view = (extended(a) for a in (points.normal, points.tangent, points.view))
    bitangent = np.cross(normal, tangent)
    wo = np.stack([(view * a).sum(axis=-1) for a in (tangent, bitangent, normal)], axis=-1)
    total = np.zeros((*points.shape, 3), dtype=np.longdouble)
    for lobe, side in material.sided_lobes():
        if method == "lattice":
            total += lattice_twin.shade_lobe(
                wo, (tangent, bitangent, normal), lobe, side, pyramid, count, bias
            )
            continue
        total += _lobe(wo, (tangent, bitangent, normal), lobe, side, pyramid, method, variant,
                       count, xi, model, bias)  # fmt: skip
    return np.asarray(total, dtype=np.float64)


def _lobe(
    wo: Extended, frame: tuple[Extended, Extended, Extended], lobe: Lobe, side: float,
    pyramid: Pyramid, method: str, variant: str, samples: int, xi: float, footprint: str,
    bias: float,
) -> Extended:  # fmt: skip
    if method == "regular":
        own = pattern_for_budget(lobe, samples=samples, threshold=xi)
    elif method == "thesis":
        own = thesis_pattern(lobe, samples, threshold=xi)
    else:
        own = importance_pattern(lobe, samples=samples)
    h, n = extended(own.half_vectors), len(own)
    mx, my = (extended(m) for m in lobe.widths)
    q = (h[:, 0] / h[:, 2] / mx) ** 2 + (h[:, 1] / h[:, 2] / my) ** 2
    density = np.exp(-q) / (extended(np.pi) * mx * my * h[:, 2] ** 4)
    cos_h = wo @ h.T
    wi = 2 * cos_h[..., None] * h - wo[:, None, :]
    kept = (cos_h > 0) & (wi[..., 2] > 0) & (wo[:, None, 2] > 0)
    world: Any = sum(
        wi[..., k, None] * (side if k == 2 else 1.0) * frame[k][:, None] for k in range(3)
    )
    d = np.sqrt((world * world).sum(axis=-1)) / np.abs(world).max(axis=-1)
    cos, z = np.where(kept, cos_h, 1), np.where(kept, wi[..., 2], 1)
    p_h = density * h[:, 2]
    if method == "regular":
        p_h = np.mean(density if variant == "paper" else p_h) * np.ones(n)
    cell = 1 / (n * p_h)
    if method == "regular" and own.cell is not None:
        cell = extended(own.cell) * np.ones(n)
    texels = _texels(wo, wi, cos, d, lobe, n, xi, footprint, cell, pyramid.size)
    radiance: Any = lookup(pyramid, world, extended(np.log2(texels) / 2 + bias))
    fresnel = extended(lobe.r0) + (1 - extended(lobe.r0)) * (1 - cos) ** 5
    fresnel = fresnel if side > 0 else 1 - fresnel
    oz = np.where(wo[:, 2:] > 0, wo[:, 2:], 1)
    f = fresnel * density / (4 * cos * (z * oz) ** extended(lobe.alpha))
    p = p_h / (4 * cos)
    share: Any = {"4.23": p, "4.24": p * z, "4.25": f * z}.get(variant, np.ones_like(z))
    share = np.where(kept, share, 0)
    total = share.sum(axis=-1, keepdims=True) if method == "thesis" else extended(n)
    share = share / np.where(total > 0, total, 1)
    weight = np.where(kept, share * f * z / p, 0)
    return np.asarray(extended(lobe.ks) * (weight[..., None] * radiance).sum(axis=1))
