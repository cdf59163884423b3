"""Tables that a gonioreflectometer would give of a known material, with its faults.

To see what a fit can recover from so many directions, so much noise, such shadows.
"""

from collections.abc import Sequence

import numpy as np

from .. import _check
from ..brdf import Material
from ..frames import spherical
from .table import MeasuredTable


def synthetic_table(
    material: Material,
    theta: Sequence[float] = (0.0, 20.0, 40.0, 60.0),
    phi: Sequence[float] = (0.0, 45.0, 90.0),
    rows: int = 12,
    columns: int = 16,
    noise: float = 0.0,
    shadow: float = 0.0,
    seed: int = 0,
    isotropic: bool = False,
) -> MeasuredTable:
    """A grid of outgoing directions for each incident one; both sides if the material transmits.

    Parameters
    ----------
    material : Material
    theta, phi : sequences of float [deg]
        Incident directions, every combination.
    rows, columns : int
        Outgoing directions over theta (cell centres) and phi, on each side.
    noise : float
        Standard deviation relative to the value; a hundredth of it [1/sr] is added everywhere, the
        noise of the sensor.
    shadow : float [deg]
        Values within this angle of the light are 0: there the lamp stands before the sensor.
    seed : int
    isotropic : bool
        What the table says of itself.

    Raises
    ------
    ValueError
        For a number out of range.
    """
    n, m = _check.count("rows", rows), _check.count("columns", columns)
    spread = _check.in_range("noise", noise, 0.0)
    half = _check.in_range("shadow", shadow, 0.0, 180.0)
    lights = [(_check.in_range("theta", a, 0, 90, open_high=True), b) for a in theta for b in phi]
    both = bool(material.transmission) or bool(np.any(material.diffuse_below))
    t = np.radians((np.arange(n) + 0.5) * 90.0 / n)
    tt, pp = np.meshgrid(t, np.arange(m) * 2.0 * np.pi / m, indexing="ij")
    out = spherical(tt.ravel(), pp.ravel())
    out = np.concatenate([out, out * [1.0, 1.0, -1.0]]) if both else out
    lit = np.array([spherical(np.radians(a), np.radians(b)) for a, b in lights])
    wi, wo = np.repeat(lit, len(out), axis=0), np.tile(out, (len(lit), 1))
    f = np.asarray(material.eval(wo, wi), dtype=np.float64).reshape(len(wi), -1)  # lit from above
    rng = np.random.default_rng(_check.count("seed", seed, 0))
    if spread:
        f = f * (1.0 + spread * rng.standard_normal(f.shape))
        f += 0.01 * spread * rng.standard_normal(f.shape)
    if half:
        f[np.einsum("kc,kc->k", wi, wo) > np.cos(np.radians(half))] = 0.0
    weight = np.hypot(wo[:, 0], wo[:, 1]) * (0.5 * np.pi / n) * (2.0 * np.pi / m)
    return MeasuredTable(wi, wo, f, weight=weight, name="synthetic", isotropic=isotropic)
