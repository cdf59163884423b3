"""Measured materials as the ground truth takes them: eval, sample, pdf, albedo.

A file keeps its own kind of evaluation: RGL's warp, MERL's bins; everything else is a table between
whose rows `interpolate` finds values. Negative measured values count as 0 here. Sampling is by
`importance` tables for all kinds.

Reflectivity and transmissivity (thesis eqs. 2.7, 2.8) are integrals of f |cos theta_o| over the
directions above and below, for light from ``wo``. They are summed over cells of half vectors,
which crowd where a lobe is; passing light counts as its mirror image at the surface::

    r(wo) = sum_h f(wo, w) |cos theta_w| 4 (wo.h) omega_h,      w = reflect(wo, h)          (1)
"""

import pathlib

import numpy as np
import numpy.typing as npt

from .. import _check
from .._arguments import checked
from .importance import Function, ImportanceTable, half_vector_cells
from .interpolate import TableFunction
from .merl import evaluate_merl, merl_table, read_merl_data
from .read import measured_format, naming, read_measured
from .rgl import evaluate_rgl, read_rgl_data, rgl_table
from .table import MeasuredTable

Float64Array = npt.NDArray[np.float64]

CELLS = (128, 64)  # of eq. (1)


class MeasuredMaterial:
    """A BSDF known by measurement, in the local frame (z the normal).

    Parameters
    ----------
    table : MeasuredTable
    interpolation : "half-vector" or "linear"
        How values between measured incident directions come about, see `interpolate`.
    quantity : "root", "p" or "f"
        What is interpolated: the BSDF by itself (f), or times a cosine (p, root).
    symmetry : "none", "mirror", "quadrant" or "isotropic", optional
        Of the incident azimuths; by default what the table suggests.
    function : callable, optional
        Evaluates the BSDF (K, C) instead, for directions (K, 3).

    Attributes
    ----------
    table : MeasuredTable
    kd : 0.0
        No part of it is set apart as diffuse.
    """

    kd = 0.0

    @checked
    def __init__(
        self,
        table: MeasuredTable,
        interpolation: str = "half-vector",
        quantity: str = "root",
        symmetry: str | None = None,
        function: Function | None = None,
    ) -> None:
        self.table = table
        self._function: Function = function or TableFunction(
            table, interpolation, quantity, symmetry
        )
        self._sampler: ImportanceTable | None = None

    @property
    def name(self) -> str:
        """Of the material, as its file has it."""
        return self.table.name

    def _clamped(self, wi: Float64Array, wo: Float64Array) -> Float64Array:
        return np.maximum(self._function(wi, wo), 0.0)

    @property
    def sampler(self) -> ImportanceTable:
        """The importance tables; made on the first use."""
        if self._sampler is None:
            self._sampler = ImportanceTable(self._clamped, self.table.isotropic)
        return self._sampler

    def eval(self, wi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
        """BSDF [1/sr] for light from ``wi`` seen from ``wo``, both (..., 3) unit.

        Returns
        -------
        (...) float64 for a single channel, else (..., 3); zero where nothing was measured.
        """
        i, o = _check.unit_vectors("wi", wi), _check.unit_vectors("wo", wo)
        i, o = np.broadcast_arrays(i, o)
        value = self._clamped(
            np.ascontiguousarray(i.reshape(-1, 3)), np.ascontiguousarray(o.reshape(-1, 3))
        )
        value = value.reshape(*i.shape[:-1], value.shape[-1])
        return value[..., 0] if value.shape[-1] == 1 else value

    def sample(self, xi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
        """Directions (..., 3) to the light for uniform numbers (..., 2) in [0, 1) and views.

        Some fall below the horizon, where they count with value zero.
        """
        o = _check.unit_vectors("wo", wo)
        u = np.asarray(_check.array("xi", xi), dtype=np.float64)
        if u.ndim == 0 or u.shape[-1] != 2 or not np.all((u >= 0.0) & (u <= 1.0)):
            raise _check.fail("xi", "must have shape (..., 2) and lie in [0, 1]", u.shape)
        shape = np.broadcast_shapes(u.shape[:-1], o.shape[:-1])
        u, o = np.broadcast_to(u, (*shape, 2)), np.broadcast_to(o, (*shape, 3))
        out = self.sampler.sample(u.reshape(-1, 2), o.reshape(-1, 3))
        return out.reshape(*shape, 3)

    def pdf(self, wi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
        """Density (...) [1/sr] of ``sample`` over all directions."""
        i, o = _check.unit_vectors("wi", wi), _check.unit_vectors("wo", wo)
        i, o = np.broadcast_arrays(i, o)
        return self.sampler.pdf(i.reshape(-1, 3), o.reshape(-1, 3)).reshape(i.shape[:-1])

    def albedo(self, wo: npt.ArrayLike) -> tuple[Float64Array, Float64Array]:
        """Reflectivity and transmissivity for light from ``wo`` (..., 3), eq. (1).

        Returns
        -------
        Two arrays of the shape of ``eval``. Measured data may exceed 1.
        """
        o = _check.unit_vectors("wo", wo)
        h, area = half_vector_cells(*CELLS)
        parts = [self._scattered(v, h, area) for v in o.reshape(-1, 3)]
        channels = len(self.table.channels)
        total = np.stack(parts, axis=1) if parts else np.zeros((2, 0, channels))
        total = total.reshape(2, *o.shape[:-1], channels)
        total = total[..., 0] if channels == 1 else total
        return total[0], total[1]

    def _scattered(self, wi: Float64Array, h: Float64Array, area: Float64Array) -> Float64Array:
        """Eq. (1) for one direction: (2, C)."""
        side = 1.0 if wi[2] > 0.0 else -1.0
        v = wi * [1.0, 1.0, side]
        cosine = h @ v
        w = 2.0 * cosine[:, None] * h - v
        up = (cosine > 0.0) & (w[:, 2] > 0.0)
        w, weight = w[up], (4.0 * w[:, 2] * cosine * area)[up]
        wi = np.broadcast_to(wi, w.shape)
        both = [self._clamped(wi, w * [1.0, 1.0, s]) for s in (side, -side)]
        return np.stack([weight @ f for f in both])


@checked
def measured_material(
    path: str | pathlib.Path,
    format: str | None = None,
    interpolation: str = "half-vector",
    quantity: str = "root",
    symmetry: str | None = None,
) -> MeasuredMaterial:
    """A material from a file of measurements, evaluated as its kind of file means it.

    Parameters
    ----------
    path, format
        As `read_measured` takes them.
    interpolation, quantity, symmetry
        Of the kinds that are tables (text, Cornell, Klems), see `MeasuredMaterial`.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        For an unknown format or option, or a damaged file.
    """
    kind = measured_format(path, format)
    if kind == "rgl":
        with naming(path):
            data = read_rgl_data(path)
            table = rgl_table(data, path)
        return MeasuredMaterial(table, function=lambda wi, wo: evaluate_rgl(data, wi, wo))
    if kind == "merl":
        values = read_merl_data(path)
        return MeasuredMaterial(
            merl_table(values, path), function=lambda wi, wo: evaluate_merl(values, wi, wo)
        )
    return MeasuredMaterial(read_measured(path, kind), interpolation, quantity, symmetry)
