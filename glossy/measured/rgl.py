"""RGL's ``.bsdf``: reflectance in the coordinates of a warp that follows the material.

With the half vector h and its place in the unit square, ::

    u(theta) = sqrt(2 theta / pi),   u(phi) = (phi + pi) / 2 pi                             (1)

the warp takes (theta_h, phi_h) to uniform numbers x by the density of visible normals for ``wi``;
the values are tabulated over x and the direction of ``wi``::

    p(wo | wi) = f cos(theta_o) = rgb(x; wi) ndf(h) / (4 sigma(wi))                         (2)

(without the factor behind rgb where the file says so). An isotropic file has one azimuth of
``wi``, and phi_h is taken relative to it. Where an anisotropic file covers only a part of the
turn, symmetry supplies the rest: half a turn about the normal, or mirrors in x and in y.

The table of such a file has the nodes of the grid over x, which crowd where the material reflects;
each stands for its share of the grid, in solid angle.

Source: Dupuy & Jakob 2018, ACM TOG 37(6).
"""

import dataclasses
import math
import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check, _memory
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from .table import MeasuredTable
from .tensor import read_tensors
from .warp import ALONE, FIRST, Slices, Warp, Weights, k_bilinear, k_invert, k_sample

Float64Array = npt.NDArray[np.float64]

NEEDED = ("phi_i", "theta_i", "ndf", "sigma", "vndf", "rgb", "jacobian")
VALUE_BYTES = 100  # that a value of the file takes while the table is made
HALF_PI = 0.5 * math.pi
TWO_PI = 2.0 * math.pi


@dataclasses.dataclass(frozen=True, eq=False)
class RglData:
    """The fields of the file: angles (P,), (T,), tables (1, H, W), warp and rgb (P T, 3, N, N).

    ``fold``: how many times the azimuths of ``wi`` cover the turn by symmetry: 1, 2 or 4.
    """

    phi_i: Float64Array
    theta_i: Float64Array
    ndf: Float64Array
    sigma: Float64Array
    warp: Warp
    rgb: Float64Array
    jacobian: bool
    fold: int
    description: str

    @property
    def isotropic(self) -> bool:
        """Whether the file has one azimuth of ``wi``."""
        return len(self.phi_i) <= 2

    def arguments(self) -> tuple[Any, ...]:
        """What the kernels take."""
        w = self.warp
        tables = (w.values, w.conditional, w.marginal, self.rgb, self.ndf, self.sigma)
        return (self.phi_i, self.theta_i, *tables, self.jacobian, self.fold, self.isotropic)


def read_rgl_data(path: str | pathlib.Path) -> RglData:
    """Read an RGL file; see `read_rgl`."""
    fields = read_tensors(path)
    sizes = [fields[name].size for name in NEEDED if name in fields]
    _memory.check(str(path), VALUE_BYTES * sum(sizes))
    if "rgb" not in fields and "spectra" in fields:
        raise ValueError(f"{path}: holds spectra; the RGB variant of the file is what is read")
    missing = [name for name in NEEDED if name not in fields]
    if missing:
        raise ValueError(f"{path}: has no field {', '.join(missing)}: not an RGL material")
    real = {}
    for name in NEEDED[:-1]:
        if fields[name].dtype.kind != "f" or not np.isfinite(fields[name]).all():
            raise ValueError(f"{path}: field {name} must hold finite numbers")
        real[name] = np.asarray(fields[name], dtype=np.float64)
    phi, theta = real["phi_i"], real["theta_i"]
    lead = (*phi.shape, *theta.shape)
    rgb, vndf = real["rgb"], real["vndf"]
    fits = (
        phi.ndim == theta.ndim == 1
        and len(phi) > 0
        and len(theta) > 1
        and rgb.ndim == 5
        and rgb.shape[:3] == (*lead, 3)
        and vndf.ndim == 4
        and vndf.shape[:2] == lead
        and real["ndf"].ndim == real["sigma"].ndim == 2
        and all(min(real[k].shape[-2:]) > 1 for k in ("ndf", "sigma", "vndf", "rgb"))
        and fields["jacobian"].size == 1
    )
    if not fits:
        shapes = ", ".join(f"{k} {fields[k].shape}" for k in NEEDED)
        raise ValueError(f"{path}: the shapes of its fields do not fit: {shapes}")
    ascending = all(np.all(np.diff(a) > 0.0) for a in (phi, theta))
    if not ascending or theta[0] < 0.0 or theta[-1] > HALF_PI + 1e-3:
        raise ValueError(f"{path}: the incident angles must rise, theta_i from 0 to pi/2")
    if real["ndf"].min() < 0.0 or real["sigma"].min() <= 0.0:
        raise ValueError(f"{path}: ndf must be >= 0 and sigma > 0")
    try:
        warp = Warp.build(vndf.reshape(-1, *vndf.shape[2:]))
    except ValueError as error:
        raise ValueError(f"{path}: vndf: {error}") from None
    spread = float(phi[-1] - phi[0])
    fold = 1 if len(phi) <= 2 else round(TWO_PI / spread)
    if fold not in (1, 2, 4):
        raise ValueError(f"{path}: phi_i covers {spread:g} rad, not a turn, its half or quarter")
    text = fields.get("description", np.zeros(0, dtype="u1"))
    words = text.tobytes()[:200].decode("utf-8", "replace") if text.dtype.kind in "ui" else ""
    return RglData(
        phi_i=_check.frozen(phi),
        theta_i=_check.frozen(theta),
        ndf=_check.frozen(real["ndf"][None]),
        sigma=_check.frozen(real["sigma"][None]),
        warp=warp,
        rgb=_check.frozen(rgb.reshape(-1, *rgb.shape[2:])),
        jacobian=bool(fields["jacobian"].reshape(-1)[0]),
        fold=fold,
        description=" ".join(words.replace("\0", " ").split()),
    )


@kernel
def k_interval(grid: Float64Array, x: float) -> tuple[int, Scalar]:
    """Index k and share of the way from ``grid[k]`` to ``grid[k + 1]``, clamped to the grid."""
    if len(grid) == 1 or x <= grid[0]:
        return 0, 0.0
    low, high = 0, len(grid) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if grid[middle] <= x:
            low = middle
        else:
            high = middle
    return low, min((x - grid[low]) / (grid[low + 1] - grid[low]), 1.0)


@kernel
def k_slices(
    phi_i: Float64Array, theta_i: Float64Array, theta: float, phi: float, isotropic: bool
) -> tuple[Slices, Weights]:
    """The four slices about an incident direction, and their weights."""
    t, ft = k_interval(theta_i, theta)
    p, fp = (0, 0.0) if isotropic else k_interval(phi_i, phi)
    n = len(theta_i)
    t1, p1 = min(t + 1, n - 1), min(p + 1, len(phi_i) - 1)
    slices = (p * n + t, p * n + t1, p1 * n + t, p1 * n + t1)
    low, high = 1.0 - fp, fp
    return slices, (low * (1.0 - ft), low * ft, high * (1.0 - ft), high * ft)


@kernel
def k_elevation(x: float, y: float, z: float) -> Scalar:
    """Angle to the normal of a unit vector, exact near the pole."""
    return 2.0 * np.arcsin(min(0.5 * np.sqrt(x * x + y * y + (z - 1.0) * (z - 1.0)), 1.0))


@row_kernel
def _evaluate(
    begin: int,
    end: int,
    wi: Float64Array,
    wo: Float64Array,
    out: Float64Array,
    phi_i: Float64Array,
    theta_i: Float64Array,
    values: Float64Array,
    conditional: Float64Array,
    marginal: Float64Array,
    rgb: Float64Array,
    ndf: Float64Array,
    sigma: Float64Array,
    jacobian: bool,
    fold: int,
    isotropic: bool,
) -> None:
    # eq. (2) for wi, wo (K, 3) into out (K, 3)
    for k in range(begin, end):
        ix, iy, iz = wi[k, 0], wi[k, 1], wi[k, 2]
        ox, oy, oz = wo[k, 0], wo[k, 1], wo[k, 2]
        if iz <= 0.0 or oz <= 0.0:
            continue
        if fold >= 2:  # the stored azimuths start at -pi
            sy = iy
            sx = ix if fold == 4 else sy
            if sx > 0.0:
                ix, ox = -ix, -ox
            if sy > 0.0:
                iy, oy = -iy, -oy
        hx, hy, hz = ix + ox, iy + oy, iz + oz
        length = np.sqrt(hx * hx + hy * hy + hz * hz)
        hx, hy, hz = hx / length, hy / length, hz / length
        phi = np.arctan2(iy, ix)
        phi_h = np.arctan2(hy, hx)
        theta = k_elevation(ix, iy, iz)
        u = np.sqrt(k_elevation(hx, hy, hz) / HALF_PI)
        v = ((phi_h - phi if isotropic else phi_h) + np.pi) / TWO_PI
        v -= np.floor(v)
        s, w = k_slices(phi_i, theta_i, theta, phi, isotropic)
        x, y, _ = k_invert(values, conditional, marginal, u, v, s, w)
        factor = 1.0 / oz
        if jacobian:
            across = (phi + np.pi) / TWO_PI
            shadow = k_bilinear(sigma, np.sqrt(theta / HALF_PI), across, FIRST, ALONE)
            factor *= k_bilinear(ndf, u, v, FIRST, ALONE) / (4.0 * shadow)
        for c in range(3):
            out[k, c] = k_bilinear(rgb[:, c], x, y, s, w) * factor


@kernel
def _nodes(
    phi_i: Float64Array,
    theta_i: Float64Array,
    values: Float64Array,
    conditional: Float64Array,
    marginal: Float64Array,
    size: int,
    isotropic: bool,
    wi: Float64Array,
    wo: Float64Array,
    area: Float64Array,
) -> None:
    # directions (S, N, N, 3) of the nodes of the grid over x, and the solid angle of each
    for slice_ in range(wi.shape[0]):
        theta, phi = theta_i[slice_ % len(theta_i)], phi_i[slice_ // len(theta_i)]
        ix, iy, iz = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
        for row in range(size):
            for column in range(size):
                u, v, density = k_sample(
                    values,
                    conditional,
                    marginal,
                    column / (size - 1.0),
                    row / (size - 1.0),
                    (slice_, slice_, slice_, slice_),
                    ALONE,
                )
                theta_h, phi_h = HALF_PI * u * u, TWO_PI * v - np.pi
                if isotropic:
                    phi_h += phi
                hx, hy = np.sin(theta_h) * np.cos(phi_h), np.sin(theta_h) * np.sin(phi_h)
                hz = np.cos(theta_h)
                cosine = ix * hx + iy * hy + iz * hz
                wi[slice_, row, column] = (ix, iy, iz)
                wo[slice_, row, column, 0] = 2.0 * cosine * hx - ix
                wo[slice_, row, column, 1] = 2.0 * cosine * hy - iy
                wo[slice_, row, column, 2] = 2.0 * cosine * hz - iz
                # d wo = 4 (wi.h) sin(theta_h) (d theta_h / du) (d phi_h / dv) du dv
                turn = 4.0 * max(cosine, 0.0) * np.sin(theta_h) * np.pi * u * TWO_PI
                share = (0.5 if column in (0, size - 1) else 1.0) / (size - 1.0)
                share *= (0.5 if row in (0, size - 1) else 1.0) / (size - 1.0)
                area[slice_, row, column] = turn * share / density if density > 0.0 else 0.0


def evaluate_rgl(data: RglData, wi: Float64Array, wo: Float64Array) -> Float64Array:
    """BRDF (K, 3) for unit directions (K, 3), eq. (2); zero unless both are above the surface."""
    out = np.zeros((len(wi), 3))
    in_rows(
        _evaluate, len(wi), _check.frozen(wi), _check.frozen(wo), out, *data.arguments(), grain=256
    )
    return out


def read_rgl(path: str | pathlib.Path) -> MeasuredTable:
    """Read an RGL ``.bsdf`` file as a table: the nodes of its grid that lie above the surface.

    Nodes without solid angle and the incident direction in the horizon are left out. Negative
    values, which colours outside the RGB gamut have, stay.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not such a file, is damaged, or holds spectra instead of RGB.
    """
    return rgl_table(read_rgl_data(path), path)


def rgl_table(data: RglData, path: str | pathlib.Path) -> MeasuredTable:
    """The rows of an RGL file that was read, see `read_rgl`."""
    size = data.rgb.shape[-1]
    if data.rgb.shape[-2] != size:
        raise ValueError(f"{path}: the grid of rgb must be square, got {data.rgb.shape[-2:]}")
    shape = (len(data.rgb), size, size)
    wi, wo, area = np.empty((*shape, 3)), np.empty((*shape, 3)), np.empty(shape)
    w = data.warp
    tables = (data.phi_i, data.theta_i, w.values, w.conditional, w.marginal)
    _nodes(*tables, size, data.isotropic, wi, wo, area)
    keep = (wi[..., 2] > 1e-3) & (wo[..., 2] > 1e-3) & (area > 0.0)
    if not keep.any():
        raise ValueError(f"{path}: has no measured direction above the surface")
    wi, wo = wi[keep], wo[keep]
    wi /= np.linalg.norm(wi, axis=1, keepdims=True)
    wo /= np.linalg.norm(wo, axis=1, keepdims=True)
    return MeasuredTable(
        wi,
        wo,
        evaluate_rgl(data, wi, wo),
        area[keep],
        name=data.description or pathlib.Path(path).stem,
        source=str(path),
        isotropic=data.isotropic,
    )
