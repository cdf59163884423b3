"""MERL's ``.binary``: isotropic RGB reflectance over half and difference angles.

Three 32-bit counts (90, 90, 180), then float64 values of red, green, blue, each over
(theta_h, theta_d, phi_d) with phi_d running fastest. Stored values times (1, 1.15, 1.66) / 1500 are
the BRDF [1/sr]. theta_h crowds at the mirror direction, and phi_d covers half a turn, the other
half being the same by reciprocity::

    k_h = 90 sqrt(theta_h / (pi/2)),   k_d = 90 theta_d / (pi/2),   k_phi = 180 phi_d / pi  (1)

A value belongs to the bin [k, k+1); between the centres of bins it is interpolated linearly.
Negative values mark what could not be measured; they count as 0.

The difference direction is ``wi`` in the frame whose pole is h: with z = h, x in the plane of h and
the normal. Source: Matusik et al. 2003, "A data-driven reflectance model"; Rusinkiewicz 1998.
"""

import pathlib
import struct

import numpy as np
import numpy.typing as npt

from .. import _check
from .._files import read_bytes
from .._jit import Scalar, row_kernel
from .._threads import in_rows
from ..frames import reflect, spherical
from .table import MeasuredTable

Float64Array = npt.NDArray[np.float64]

SHAPE = (90, 90, 180)
SCALE = np.array([1.0, 1.15, 1.66]) / 1500.0
HALF_PI = 0.5 * np.pi

INCIDENT = np.arange(0.0, 81.0, 5.0)  # degrees, of the table
HALF = 90  # half vectors from the normal to the rim, of the table
TURN = 48  # half vectors about it


def read_merl_data(path: str | pathlib.Path) -> Float64Array:
    """BRDF (3, 90, 90, 180) [1/sr] over the bins of eq. (1); unmeasured bins are negative.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If its counts are others, its length does not fit, or it holds NaN or infinities.
    """
    size = 12 + 24 * SHAPE[0] * SHAPE[1] * SHAPE[2]
    data = read_bytes(path)
    shape = struct.unpack_from("<3i", data) if len(data) >= 12 else ()
    if shape != SHAPE:
        said = " x ".join(str(n) for n in shape) or f"{len(data)} bytes"
        raise ValueError(f"{path}: is not a MERL file: {said}, not 90 x 90 x 180")
    if len(data) != size:
        raise ValueError(f"{path}: has {len(data)} bytes, not the {size} of a MERL file")
    values = np.frombuffer(data, "<f8", offset=12).reshape(3, *SHAPE)
    if not np.isfinite(values).all():
        raise ValueError(f"{path}: holds {int((~np.isfinite(values)).sum())} NaN or infinities")
    return np.asarray(values * SCALE[:, None, None, None])


@row_kernel
def _evaluate(
    begin: int,
    end: int,
    wi: Float64Array,
    wo: Float64Array,
    values: Float64Array,
    out: Float64Array,
) -> None:
    # trilinear lookup for wi, wo (K, 3) into out (K, 3); phi_d wraps, the others clamp
    n_h, n_d, n_phi = values.shape[1], values.shape[2], values.shape[3]
    for k in range(begin, end):
        if wi[k, 2] <= 0.0 or wo[k, 2] <= 0.0:
            continue
        hx, hy, hz = wi[k, 0] + wo[k, 0], wi[k, 1] + wo[k, 1], wi[k, 2] + wo[k, 2]
        length = np.sqrt(hx * hx + hy * hy + hz * hz)
        hx, hy, hz = hx / length, hy / length, hz / length
        across = np.sqrt(hx * hx + hy * hy)
        cp, sp = (hx / across, hy / across) if across > 0.0 else (1.0, 0.0)
        # wi turned by -phi_h about z, then by -theta_h about y
        ax = cp * wi[k, 0] + sp * wi[k, 1]
        dy = cp * wi[k, 1] - sp * wi[k, 0]
        dx = hz * ax - across * wi[k, 2]
        dz = across * ax + hz * wi[k, 2]
        a = n_h * np.sqrt(np.arctan2(across, hz) / HALF_PI) - 0.5
        b = n_d * np.arctan2(np.sqrt(dx * dx + dy * dy), dz) / HALF_PI - 0.5
        c = n_phi * np.arctan2(dy, dx) / np.pi - 0.5
        a, b = min(max(a, 0.0), n_h - 1.0), min(max(b, 0.0), n_d - 1.0)
        a0, b0, c0 = min(int(a), n_h - 2), min(int(b), n_d - 2), int(np.floor(c))
        fa, fb, fc = a - a0, b - b0, c - c0
        for channel in range(3):
            total: Scalar = 0.0
            for i in range(2):
                for j in range(2):
                    side = (fa if i else 1.0 - fa) * (fb if j else 1.0 - fb)
                    row = values[channel, a0 + i, b0 + j]
                    low, high = row[c0 % n_phi], row[(c0 + 1) % n_phi]
                    total += side * ((1.0 - fc) * max(low, 0.0) + fc * max(high, 0.0))
            out[k, channel] = total


def evaluate_merl(values: Float64Array, wi: Float64Array, wo: Float64Array) -> Float64Array:
    """BRDF (K, 3) for unit directions (K, 3); zero unless both are above the surface."""
    out = np.zeros((len(wi), 3))
    in_rows(
        _evaluate,
        len(wi),
        _check.frozen(wi),
        _check.frozen(wo),
        _check.frozen(values),
        out,
        grain=256,
    )
    return out


def read_merl(path: str | pathlib.Path) -> MeasuredTable:
    """Read a MERL file as a table of the usual kind; see `read_merl_data`.

    The 1.5 million bins of the file share no incident directions, so the table is looked up: every
    5 degrees of incidence from 0 to 80, at half vectors that crowd about the normal as the bins do.
    """
    return merl_table(read_merl_data(path), path)


def merl_table(values: Float64Array, path: str | pathlib.Path) -> MeasuredTable:
    """The rows looked up in a MERL file that was read, see `read_merl`."""
    edge = HALF_PI * (np.arange(HALF + 1) / HALF) ** 2
    theta_h = HALF_PI * ((np.arange(HALF) + 0.5) / HALF) ** 2
    phi_h = 2.0 * np.pi * (np.arange(TURN) + 0.5) / TURN
    h = spherical(*np.meshgrid(theta_h, phi_h, indexing="ij")).reshape(-1, 3)
    ring = 2.0 * np.pi * (np.cos(edge[:-1]) - np.cos(edge[1:])) / TURN
    wi = np.repeat(spherical(np.radians(INCIDENT), np.zeros(len(INCIDENT))), len(h), axis=0)
    h, area = np.tile(h, (len(INCIDENT), 1)), np.tile(np.repeat(ring, TURN), len(INCIDENT))
    cosine = np.einsum("ij,ij->i", wi, h)
    wo = reflect(wi, h)
    keep = (cosine > 0.0) & (wo[:, 2] > 1e-3)
    wi, wo, area = wi[keep], wo[keep], 4.0 * (cosine * area)[keep]
    return MeasuredTable(
        wi,
        wo,
        evaluate_merl(values, wi, wo),
        area,
        name=pathlib.Path(path).stem,
        source=str(path),
        isotropic=True,
    )
