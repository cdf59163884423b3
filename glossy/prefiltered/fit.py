"""The lobes of one slice, one after the other; profiles of several lobes at once.

Lobe l is found in what lobes 0 .. l-1 leave of the slice. With ``finish="refit"`` the axes stay and
the profiles are solved for together: with hat_k the profile's nodes and a_lj the angle of sample j
to axis l ::

    min sum_j omega_j (v_j - sum_l sum_k p_lk hat_k(a_lj))^2 + eps^2 sum (p_lk - p_l,k-1)^2    (1)

over p >= 0, a convex problem. The samples are those of the slice and their mirror images below the
horizon, where v = 0: the filter sees that light. The second sum only holds together nodes that no
sample reaches.
"""

import math

import numpy as np
from scipy.optimize import nnls

from . import profiles
from .search import find_axis
from .slices import Float64Array, Slice
from .stack import ring_solid_angles

FINISHES = ("mean", "minimum", "rescale", "refit")
HOLD = 1e-3  # eps of eq. (1) over the root of the mean square of the other rows

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
    step = np.diff(np.eye(n), axis=0)
    hold = np.kron(np.eye(len(lobes)), step) * (HOLD * math.sqrt(float((matrix**2).sum(0).mean())))
    gram = matrix.T @ matrix + hold.T @ hold
    gram[np.diag_indices_from(gram)] += 1e-12 * np.trace(gram) / len(gram)
    upper = np.linalg.cholesky(gram).T
    right = np.linalg.solve(upper.T, matrix.T @ (value * root))
    solved = np.stack([nnls(upper, b)[0] for b in right.T], axis=-1)
    return [(axis, solved[k * n : (k + 1) * n]) for k, (axis, _) in enumerate(lobes)]
