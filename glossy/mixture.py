"""Sampling a whole material: a mixture of its lobes' densities and cosines for the diffuse parts.

::

    pdf(wi) = sum_j share_j pdf_j(wi),   share_j = mean weight_j / (sum of all)              (1)

with ks of a lobe, kd and the diffuse transmission as weights.
The first random number also picks the part: within the part's share it is stretched to (0, 1].
Transmission parts sample as reflection parts, then mirror wi in the surface plane.
"""

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from .brdf import Lobe, Material

Float64Array = npt.NDArray[np.float64]


def parts(material: "Material") -> list[tuple[float, "Lobe | None", float]]:
    """(share, lobe, side) of eq. (1); None is a diffuse part, alone for a black material."""
    weighed: list[tuple[float, Lobe | None, float]]
    weighed = [(float(np.mean(lobe.ks)), lobe, side) for lobe, side in material.sided_lobes()]
    for diffuse, side in ((material.diffuse, 1.0), (material.diffuse_below, -1.0)):
        if diffuse.any():
            weighed.append((float(diffuse.mean()), None, side))
    if not weighed:
        weighed.append((1.0, None, 1.0))
    total = sum(weight for weight, _, _ in weighed)
    return [(weight / total, lobe, side) for weight, lobe, side in weighed]


def sample(material: "Material", xi: Float64Array, wo: Float64Array) -> Float64Array:
    """Directions wi (..., 3) of density ``pdf`` for valid ``xi`` (..., 2), unit ``wo`` (..., 3)."""
    mixed = parts(material)
    out = np.empty(wo.shape)
    edges = np.concatenate([[0.0], np.cumsum([share for share, _, _ in mixed])])
    part = np.clip(np.searchsorted(edges, xi[..., 0], side="left") - 1, 0, len(mixed) - 1)
    for k, (share, lobe, side) in enumerate(mixed):
        here = part == k
        if not here.any():
            continue
        u = xi[here]
        u[:, 0] = np.clip((u[:, 0] - edges[k]) / share, np.finfo(float).tiny, 1.0)
        if lobe is None:
            r, phi = np.sqrt(1.0 - u[:, 0]), 2.0 * math.pi * u[:, 1]
            z = side * np.sqrt(u[:, 0])
            out[here] = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)
        else:
            out[here] = lobe.sample(u, wo[here]) * np.array([1.0, 1.0, side])
    return out


def pdf(material: "Material", wi: Float64Array, wo: Float64Array) -> Float64Array:
    """Eq. (1) [1/sr] for unit directions (..., 3), shape (...)."""
    total = np.zeros(wi.shape[:-1])
    for share, lobe, side in parts(material):
        if lobe is None:
            total += share * np.maximum(side * wi[..., 2], 0.0) / math.pi
        else:
            total += share * lobe.pdf(wi * np.array([1.0, 1.0, side]), wo)
    return total
