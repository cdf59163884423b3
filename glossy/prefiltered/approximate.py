"""Radially symmetric lobes for any isotropic BRDF, followed over the elevations of the view.

Every slice of the BRDF, one for each of a few view elevations, is approximated by itself:

* ``single``: one lobe, the mean of the profile curves about its axis.
* ``flat``: one profile for all elevations, the mean of the slices' profiles (each of volume 1), or
  that of one slice; its factor k(theta_o) and its axis still follow the view.
* ``multi``: lobes one after the other, each the minimum of the profile curves of what the ones
  before it leave (never below 0). The stacks are put in order by ``track``.

Where a slice sends its light is kept: the lobes are scaled, channel by channel, so that a radiance
of 1 from everywhere gives the albedo of the slice ::

    factor(wo) sum_l k int p_l dw = albedo(wo)                                             (1)

M scales the hemispherical reflectivity of p to that of f, which is (1) but for the cosine and
the horizon that the filter does not know. For ``multi`` it leaves open what becomes of the light
that minimum profiles leave over (half of it, for Ward's model at 78 degrees). ``finish`` says it:

* ``mean``: the last lobe is the mean of what is left, clamped at 0, instead of its minimum, then
  (1), which by then changes little. One lobe is the single lobe of above.
* ``minimum``: nothing, the lobes stay below the BRDF.
* ``rescale``: (1) for minimum profiles.
* ``refit``: all profiles anew for the axes found, least squares with values >= 0, then (1).

Sources: M sections 3 and 7; ``mean`` and ``refit`` are ours.
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from . import track
from .fit import FINISHES, Found, fit_slice
from .search import SEARCHES
from .slices import Float64Array, check_isotropic, glossy_part, half_width, make_slice
from .stack import LobeStack, ring_solid_angles

MODES = ("single", "flat", "multi")
NODES = 64  # of a profile
LOWEST = 0.05  # cos theta_o of the lowest slice: 87 degrees
MOST_LOBES = 16
TAIL = 1e-6  # share of a stack's volume that its profiles may lose at their far end


def default_angles(material: Any, count: int = NODES) -> Float64Array:
    """Nodes (count,) [rad] from 0 to pi, even near 0 and geometric beyond half the lobe's width."""
    n = _check.count("count", count, 2)
    scale = 0.5 * half_width(glossy_part(material))
    nodes = scale * np.sinh(np.linspace(0.0, 1.0, n) * math.asinh(math.pi / scale))
    nodes[-1] = math.pi
    return np.asarray(nodes)


def default_cosines(count: int) -> Float64Array:
    """Elevations cos theta_o (count,) of the slices, rising to 1, even in the cosine."""
    return np.linspace(LOWEST, 1.0, count) if count > 1 else np.ones(1)


def approximate(
    material: Any,
    mode: str = "single",
    lobes: int = 1,
    elevations: int | npt.ArrayLike = 16,
    angles: int | npt.ArrayLike = NODES,
    cosine: str = "inside",
    search: str = "peak",
    finish: str = "mean",
    characteristic: float | None = None,
) -> tuple[LobeStack, ...]:
    """Stacks of radially symmetric lobes whose sum stands for an isotropic BRDF.

    Parameters
    ----------
    material : Lobe, Material, Ward, MeasuredMaterial, or anything with ``eval(wi, wo)``
        Isotropic, without transmission. Its kd is left out: the irradiance covers it.
    mode : "single", "flat" or "multi"
    lobes : int
        Stacks of ``multi``, up to 16; 1 for the other modes.
    elevations : int or (E,) array
        Count of slices, even in cos theta_o from 0.05 to 1, or their cosines, rising.
    angles : int or (A,) array
        Count of a profile's nodes, crowded where the lobe is, or the nodes [rad] from 0.
    cosine : "inside" or "outside"
        Approximate f cos theta_i, or f, with (n.r) as a factor of the estimate (M eq. 2), which is
        worse for wide lobes seen at a glance.
    search : "peak", "candidates" or "volume"
        Where axes are looked for, see ``search``.
    finish : "mean", "minimum", "rescale" or "refit"
        Of ``multi``: what becomes of the light that minimum profiles leave over, see the module.
    characteristic : float, optional
        Of ``flat``: cos theta_o of the slice whose profile is taken, instead of the mean.

    Returns
    -------
    tuple of LobeStack
        One, or ``lobes`` of them; the one that holds most first.

    Raises
    ------
    ValueError
        For an anisotropic or transmitting material, one that reflects nothing, an unknown option.
    """
    _check.choice("mode", mode, MODES)
    _check.choice("search", search, SEARCHES)
    _check.choice("finish", finish, FINISHES)
    outside = _check.choice("cosine", cosine, ("outside", "inside")) == "outside"
    count = _check.count("lobes", lobes, 1, MOST_LOBES)
    if mode != "multi" and count != 1:
        raise _check.fail("lobes", f"must be 1 for mode {mode!r}", lobes)
    if mode != "flat" and characteristic is not None:
        raise _check.fail("characteristic", "belongs to mode 'flat'", characteristic)
    glossy = glossy_part(material)
    scale = half_width(glossy)
    check_isotropic(glossy, scale)
    nodes = (
        default_angles(glossy, _check.count("angles", angles, 2))
        if np.ndim(angles) == 0
        else _check.array("angles", angles).astype(np.float64)
    )
    cosines = (
        default_cosines(_check.count("elevations", elevations))
        if np.ndim(elevations) == 0
        else _check.array("elevations", elevations).astype(np.float64)
    )
    template = LobeStack(  # refuses nodes that do not rise
        cosines, nodes, np.zeros((len(cosines), len(nodes), 1)), cosines,
        np.ones((len(cosines), 1)), np.zeros(len(cosines)), np.zeros(len(cosines)), outside,
    )  # fmt: skip
    cosines, nodes = template.cosines, template.angles
    pieces = [make_slice(glossy, float(c), scale, outside) for c in cosines]
    if not any(piece.albedo.any() for piece in pieces):
        raise _check.fail("material", "must reflect besides kd", material)
    how = finish if mode == "multi" else "mean"
    found = [fit_slice(piece, nodes, count, search, how) for piece in pieces]
    if mode != "flat":
        return _stacks(found, cosines, nodes, outside)
    shapes = found
    if characteristic is not None:
        at = _check.in_range("characteristic", characteristic, 0.0, 1.0, open_low=True)
        shapes = [fit_slice(make_slice(glossy, at, scale, outside), nodes, 1, search)]
    return (_flat(found, shapes, cosines, nodes, outside),)


def _stacks(
    found: list[Found], cosines: Float64Array, angles: Float64Array, outside: bool
) -> tuple[LobeStack, ...]:
    """The lobes of all slices as stacks, in order, the greatest volume first."""
    theta_o = np.arccos(cosines)
    axes = np.array([[axis for axis, _ in lobes] for lobes in found])
    values = np.array([[profile for _, profile in lobes] for lobes in found])
    held = np.einsum("elac,a->el", values, ring_solid_angles(angles))
    share = held / np.maximum(held.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    chosen = track.order(axes, share, theta_o)
    rows = np.arange(len(cosines))
    made = []
    for stack in range(axes.shape[1]):
        pick = [c[stack] for c in chosen]
        theta, phi = _offsets(axes[rows, pick], theta_o)
        track.hold_faint(theta, phi, share[rows, pick], cosines)
        ones, own = np.ones((len(cosines), values.shape[-1])), values[rows, pick]
        made.append(_trimmed(cosines, angles, own, cosines, ones, theta, phi, outside))
    return tuple(sorted(made, key=lambda s: -float(s.volumes().sum())))


def _flat(
    found: list[Found],
    shapes: list[Found],
    cosines: Float64Array,
    angles: Float64Array,
    outside: bool,
) -> LobeStack:
    """One profile, the mean of ``shapes`` with volume 1, and k(theta_o) from eq. (1)."""
    omega = ring_solid_angles(angles)
    held = np.array([omega @ lobes[0][1] for lobes in shapes])
    each = np.array([lobes[0][1] for lobes in shapes])
    safe = np.where(held > 0.0, held, 1.0)[:, None]
    mean = (each / safe).mean(axis=0)
    total = omega @ mean
    mean /= np.where(total > 0.0, total, 1.0)
    weights = np.array([omega @ lobes[0][1] for lobes in found])
    theta, phi = _offsets(np.array([lobes[0][0] for lobes in found]), np.arccos(cosines))
    return _trimmed(cosines[-1:], angles, mean[None], cosines, weights, theta, phi, outside)


def _offsets(axes: Float64Array, theta_o: Float64Array) -> tuple[Float64Array, Float64Array]:
    pairs = [track.offsets(a, float(t)) for a, t in zip(axes, theta_o, strict=True)]
    theta, phi = np.array(pairs).T.copy()
    track.continuous(theta, phi, theta_o)
    return theta, phi


def _trimmed(
    cosines: Float64Array,
    angles: Float64Array,
    values: Float64Array,
    views: Float64Array,
    weights: Float64Array,
    theta: Float64Array,
    phi: Float64Array,
    outside: bool,
) -> LobeStack:
    """The stack without the far nodes that hold next to nothing; every slice keeps its volume."""
    part = np.cumsum((values * ring_solid_angles(angles)[:, None])[:, ::-1], axis=1)[:, ::-1]
    spare = (part <= TAIL * part[:, :1]).all(axis=(0, 2))
    last = int(np.argmax(spare)) if spare.any() else len(angles) - 1
    last = min(max(last, 1), len(angles) - 1)
    cut = values[:, : last + 1].copy()
    if last < len(angles) - 1:
        cut[:, last] = 0.0
    held = np.einsum("eac,a->ec", cut, ring_solid_angles(angles[: last + 1]))
    cut *= np.where(held > 0.0, part[:, 0] / np.where(held > 0.0, held, 1.0), 1.0)[:, None]
    return LobeStack(cosines, angles[: last + 1], cut, views, weights, theta, phi, outside)
