"""A table of measurements: pairs of directions with the BSDF found there.

What is measured is the transfer probability density of thesis section 2.3::

    p(wo | wi) = f(wi, wo) |cos theta_o|      [1/sr]                                        (1)

A table keeps f, because the kinds of file differ in which of the two they hold. Directions leave
the surface; z is the normal. Rows with both on one side of the surface are reflection, the others
transmission; a table may have light from above, from below, or both.
"""

import dataclasses
import io
import math
import os
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from .. import _check, _memory
from .._arguments import checked

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

SAME_DIRECTION = 1e-4  # chord [rad] below which two incident directions are one
PAIR_BYTES = 32  # that two directions that count as one take, each way
HORIZON = 1e-6  # |cos theta_o| below which p does not tell f


@dataclasses.dataclass(frozen=True, init=False, eq=False)
class MeasuredTable:
    """Rows of measured values, all arrays read-only float64.

    Parameters
    ----------
    wi, wo : (K, 3) array
        Unit within 1e-3, then renormalised: to the light and to the sensor, in the frame of the
        surface (x the tangent, z the normal). ``wo.z`` and ``wi.z`` of opposite signs mean
        transmission.
    f : (K, C) or (K,) array [1/sr]
        BSDF, not multiplied by the cosine; C is 1 or 3. Zeros and negative values stay as measured.
    weight : (K,) array >= 0 [sr], optional
        Solid angle that the outgoing direction of a row stands for among those of its ``wi``.
    name, source : str
        Of the material; file that the rows came from.
    isotropic : bool
        True if turning both directions about the normal changes nothing.
    channels : C names
        ``("Y",)`` for a single intensity, ``("R", "G", "B")``; by default after C.

    Raises
    ------
    ValueError
        For a wrong shape, a direction that is not unit, values that are not finite.
    """

    wi: Float64Array
    wo: Float64Array
    f: Float64Array
    weight: Float64Array | None
    name: str
    source: str
    isotropic: bool
    channels: tuple[str, ...]

    @checked
    def __init__(
        self,
        wi: npt.ArrayLike,
        wo: npt.ArrayLike,
        f: npt.ArrayLike,
        weight: npt.ArrayLike | None = None,
        name: str = "",
        source: str = "",
        isotropic: bool = False,
        channels: Sequence[str] = (),
    ) -> None:
        i, o = _check.unit_vectors("wi", wi), _check.unit_vectors("wo", wo)
        value = np.array(_check.array("f", f), dtype=np.float64)
        value = value[:, None] if value.ndim == 1 else value
        if i.ndim != 2 or o.shape != i.shape or value.ndim != 2 or len(value) != len(i):
            shapes = (i.shape, o.shape, value.shape)
            raise _check.fail("wi, wo, f", "must have shapes (K, 3), (K, 3), (K, C)", shapes)
        if not len(value):
            raise _check.fail("f", "must have rows", value.shape)
        if value.shape[1] not in (1, 3):
            raise _check.fail("f", "must have one channel or three", value.shape[1])
        if not np.isfinite(value).all():
            bad = f"{int((~np.isfinite(value)).sum())} values that are not"
            raise _check.fail("f", "must be finite", bad)
        areas = None if weight is None else np.array(_check.array("weight", weight))
        if areas is not None and (
            areas.shape != (len(value),) or not np.all(np.isfinite(areas) & (areas >= 0.0))
        ):
            rule = "must be finite and >= 0, one for each row"
            raise _check.fail("weight", rule, areas.shape)
        names = tuple(channels) or (("Y",) if value.shape[1] == 1 else ("R", "G", "B"))
        if len(names) != value.shape[1]:
            raise _check.fail("channels", f"must be {value.shape[1]} names", names)
        for key, rows in (("wi", i), ("wo", o), ("f", value), ("weight", areas)):
            if rows is not None:
                rows.flags.writeable = False
            object.__setattr__(self, key, rows)
        for key, item in (("name", name), ("source", source), ("isotropic", bool(isotropic))):
            object.__setattr__(self, key, item)
        object.__setattr__(self, "channels", names)

    def __len__(self) -> int:
        return len(self.f)

    @property
    def transfer(self) -> Float64Array:
        """Transfer probability densities p, eq. (1), (K, C)."""
        return self.f * np.abs(self.wo[:, 2:])

    @property
    def reflection(self) -> "MeasuredTable":
        """The rows with both directions on one side of the surface; may be none."""
        return self.select(self.wi[:, 2] * self.wo[:, 2] > 0.0)

    @property
    def transmission(self) -> "MeasuredTable":
        """The rows with the directions on two sides of the surface; may be none."""
        return self.select(self.wi[:, 2] * self.wo[:, 2] < 0.0)

    def select(self, rows: npt.ArrayLike) -> "MeasuredTable":
        """The rows that a mask or an index array picks; none is a table of length 0."""
        pick = np.asarray(rows)
        part = object.__new__(MeasuredTable)
        for field in dataclasses.fields(self):
            object.__setattr__(part, field.name, getattr(self, field.name))
        for key in ("wi", "wo", "f", "weight"):
            value = getattr(self, key)
            if value is not None:
                value = value[pick]
                value.flags.writeable = False
                object.__setattr__(part, key, value)
        return part

    def incident_directions(
        self, tolerance: float = SAME_DIRECTION
    ) -> tuple[Float64Array, list[IntArray]]:
        """The distinct incident directions (M, 3), and for each the indices of its rows.

        Directions nearer to each other than ``tolerance`` [rad] count as one. They come in the
        order of their first row.
        """
        if not len(self):
            return np.empty((0, 3)), []
        grid = np.round(self.wi / (0.1 * tolerance)).astype(np.int64)
        _, first, group = np.unique(grid, axis=0, return_index=True, return_inverse=True)
        tree = cKDTree(self.wi[first])
        _memory.check("wi", PAIR_BYTES * int(tree.count_neighbors(tree, tolerance)))
        pairs = tree.query_pairs(tolerance, output_type="ndarray")
        links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(first), len(first)))
        label = connected_components(links, directed=False)[1][group.reshape(-1)]
        _, first, label = np.unique(label, return_index=True, return_inverse=True)
        rank = np.argsort(np.argsort(first))[label]
        order = np.argsort(rank, kind="stable")
        rows = np.split(order, np.cumsum(np.bincount(rank))[:-1])
        return self.wi[np.sort(first)], rows

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the rows as text: angles in degrees and p, eq. (1), as ``read_measured`` takes it.

        Angles and values have twelve digits. Where ``|cos theta_o|`` is below 1e-6, p does not tell
        f, and reading gives f = 0. Weights are written too.
        """
        from .._output import write_text

        theta_i, phi_i = angles(self.wi)
        theta_o, phi_o = angles(self.wo)
        columns = [theta_i, phi_i, theta_o, phi_o, *self.transfer.T]
        names = ["theta_i", "phi_i", "theta_o", "phi_o"]
        names += ["p"] if len(self.channels) == 1 else [f"p_{c.lower()}" for c in self.channels]
        if self.weight is not None:
            columns.append(self.weight)
            names.append("weight")
        header = f"name: {' '.join(self.name.split())}\nangles: degrees\n"
        header += f"isotropic: {'yes' if self.isotropic else 'no'}\ncolumns: {' '.join(names)}"
        text = io.StringIO()
        np.savetxt(text, np.stack(columns, axis=1), fmt="%.12g", header=header)
        write_text(path, text.getvalue())


def angles(v: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Polar angle and azimuth [deg] of unit vectors (..., 3); the azimuth of a pole is 0."""
    across = np.hypot(v[..., 0], v[..., 1])
    theta = np.degrees(np.arctan2(across, v[..., 2]))
    phi = np.degrees(np.arctan2(v[..., 1], v[..., 0])) % 360.0
    return theta, np.where(across > math.ulp(1.0), phi, 0.0)
