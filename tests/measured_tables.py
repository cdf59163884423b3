"""Synthetic tables of measurements of a known material, with the faults that real ones have."""

import numpy as np

import glossy
from glossy.frames import spherical
from glossy.measured.table import MeasuredTable


def synthetic_table(
    material: glossy.Material,
    theta: tuple[float, ...] = (0.0, 20.0, 40.0, 60.0),
    phi: tuple[float, ...] = (0.0, 45.0, 90.0),
    rows: int = 12,
    columns: int = 16,
    noise: float = 0.0,
    shadow: float = 0.0,
    seed: int = 0,
    isotropic: bool = False,
) -> MeasuredTable:
    """A grid of outgoing directions for each incident one, both sides if the material transmits.

    ``noise``: relative, normal, plus a floor of a hundredth of it; ``shadow``: values within this
    angle [deg] of the light are 0, as where the lamp stands before the sensor.
    """
    both = bool(material.transmission) or bool(np.any(material.diffuse_below))
    t = (np.arange(rows) + 0.5) * 90.0 / rows
    tt, pp = np.meshgrid(np.radians(t), np.arange(columns) * 2.0 * np.pi / columns, indexing="ij")
    out = spherical(tt.ravel(), pp.ravel())
    out = np.concatenate([out, out * [1.0, 1.0, -1.0]]) if both else out
    lights = [spherical(np.radians(a), np.radians(b)) for a in theta for b in phi]
    wi = np.repeat(np.array(lights), len(out), axis=0)
    wo = np.tile(out, (len(lights), 1))
    f = np.asarray(material.eval(wo, wi), dtype=np.float64).reshape(len(wi), -1)  # lit from above
    rng = np.random.default_rng(seed)
    f = f * (1.0 + noise * rng.standard_normal(f.shape))
    f += 0.01 * noise * rng.standard_normal(f.shape)
    if shadow:
        f[np.einsum("kc,kc->k", wi, wo) > np.cos(np.radians(shadow))] = 0.0
    weight = np.hypot(wo[:, 0], wo[:, 1]) * (np.pi / 2 / rows) * (2 * np.pi / columns)
    return MeasuredTable(wi, wo, f, weight=weight, name="synthetic", isotropic=isotropic)
