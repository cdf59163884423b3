"""The lobes of one slice, one after the other; profiles of several lobes at once.

Lobe l is found in what lobes 0 .. l-1 leave of the slice. With ``finish="refit"`` the axes stay and
the profiles are solved for together: with hat_k the profile's nodes, omega_k their solid angles and
a_lj the angle of sample j to axis l ::

    min   sum_j omega_j (v_j - sum_l sum_k p_lk hat_k(a_lj))^2
        + s (int v dw - sum_lk omega_k p_lk)^2,   s = int v^2 dw / (int v dw)^2
        + eps^2 sum_lk min(omega_k, omega_k-1) (p_lk - p_l,k-1)^2                           (1)

over p >= 0, a convex problem; no profile may pass the largest value around its axis. The samples
are those of the slice and their mirror images below the horizon, where v = 0: the filter sees that
light. Squares say little of a faint wide tail, which may hold much light: hence the second term.
The third only holds together nodes that no sample reaches.
"""

import numpy as np
from scipy.optimize import nnls

from . import profiles
from .search import find_axis
from .slices import Float64Array, Slice
from .stack import ring_solid_angles

FINISHES = ("mean", "minimum", "rescale", "refit")
HOLD = 1e-2  # eps of eq. (1)

Found = list[tuple[Float64Array, Float64Array]]
"""Lobes of a slice: axis (3,) and profile (A, C)."""


def fit_slice(
    piece: Slice, angles: Float64Array, count: int, search: str = "peak", finish: str = "mean"
) -> Found:
    """``count`` lobes of a slice; see ``approximate`` for the options.

    A lobe that finds nothing left has the reflected direction for its axis and a profile of zeros.
    """
    lobes: Found = []
    value = piece.value
    for k in range(count):
        rest = profiles.residual(piece.function, lobes, angles)
        if not value.any():
            mirror = piece.wo * [-1.0, -1.0, 1.0]
            lobes.append((mirror, np.zeros((len(angles), value.shape[-1]))))
            continue
        axis = find_axis(piece, rest, value, angles, search)
        if finish == "mean" and k == count - 1:
            profile = profiles.mean_profile(rest, axis, angles)
        else:
            profile = profiles.minimum_profile(rest, axis, angles, piece.wi, value)
        lobes.append((axis, profile))
        at = profiles.angle_to(axis, piece.wi)
        value = np.maximum(value - profiles.evaluate(angles, profile, at), 0.0)
    if finish == "refit":
        lobes = _refit(piece, angles, lobes)
    return lobes if finish == "minimum" else rescaled(piece, angles, lobes)


def rescaled(piece: Slice, angles: Float64Array, lobes: Found) -> Found:
    """The lobes, scaled channel by channel to the albedo of the slice."""
    omega = ring_solid_angles(angles)
    factor = piece.wo[2] if piece.cosine_outside else 1.0
    held = np.asarray(factor * sum(omega @ p for _, p in lobes))
    gain = np.where(held > 0.0, piece.albedo / np.where(held > 0.0, held, 1.0), 1.0)
    return [(axis, profile * gain) for axis, profile in lobes]


def _hats(angles: Float64Array, at: Float64Array) -> Float64Array:
    """Hat functions (G, A) of the nodes at the angles ``at`` (G,)."""
    place = np.interp(at, angles, np.arange(len(angles)))
    low = np.minimum(place.astype(np.intp), len(angles) - 2)
    out = np.zeros((len(at), len(angles)))
    row = np.arange(len(at))
    out[row, low], out[row, low + 1] = 1.0 - (place - low), place - low
    return np.where((at <= angles[-1])[:, None], out, 0.0)


def _refit(piece: Slice, angles: Float64Array, lobes: Found) -> Found:
    """Eq. (1) for every channel."""
    n = len(angles)
    root = np.sqrt(np.tile(piece.area, 2))[:, None]
    wi = np.concatenate([piece.wi, piece.wi * [1.0, 1.0, -1.0]])
    value = np.concatenate([piece.value, np.zeros_like(piece.value)])
    sides = [_hats(angles, profiles.angle_to(axis, wi)) for axis, _ in lobes]
    matrix = np.hstack(sides) * root
    omega = ring_solid_angles(angles)
    step = np.diff(np.eye(n), axis=0) * np.sqrt(np.minimum(omega[1:], omega[:-1]))[:, None]
    hold = np.kron(np.eye(len(lobes)), HOLD * step)
    gram = matrix.T @ matrix + hold.T @ hold
    right = matrix.T @ (value * root)
    rings = np.tile(omega, len(lobes))
    most = np.concatenate(
        [piece.function(profiles.about(axis, angles)).max(axis=0) for axis, _ in lobes]
    )
    factor = piece.wo[2] if piece.cosine_outside else 1.0
    solved = np.zeros((len(rings), value.shape[-1]))
    for c, light in enumerate(piece.albedo / factor):
        if light > 0.0:
            weight = float(piece.area @ piece.value[:, c] ** 2) / light**2
            x = _not_negative(
                gram + weight * np.outer(rings, rings), right[:, c] + weight * light * rings
            )
            solved[:, c] = np.minimum(x, most[:, c])
    return [(axis, solved[k * n : (k + 1) * n]) for k, (axis, _) in enumerate(lobes)]


def _not_negative(gram: Float64Array, right: Float64Array) -> Float64Array:
    """X >= 0 that minimises x.gram.x - 2 x.right, for a positive definite matrix."""
    # every unknown scaled to a diagonal of 1: a core of 1e-10 sr stands beside a tail of 1 sr
    unit = 1.0 / np.sqrt(np.diag(gram))
    scaled = gram * unit * unit[:, None]
    scaled[np.diag_indices_from(scaled)] += 1e-12
    upper = np.linalg.cholesky(scaled).T
    return np.asarray(nnls(upper, np.linalg.solve(upper.T, right * unit))[0] * unit)
