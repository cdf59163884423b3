"""Shading frames: spherical coordinates, reflection, half vectors, surface points.

The frame (t, b, n) is right-handed with b = n x t and z = n. Every direction leaves the surface
and has unit length: ``wo`` to the viewer, ``wi`` to the light, ``wh`` half way between them.
"""

import dataclasses
import functools
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check
from ._arguments import require

Float64Array = npt.NDArray[np.float64]

AWAY = 0.01  # a view may lie below the horizon by this cosine: normals of 8 bits do at silhouettes


def normalise(v: npt.ArrayLike) -> Float64Array:
    """Unit vectors (..., 3) along ``v`` (..., 3); extreme lengths do not overflow."""
    return _normalised("v", v)


def _normalised(name: str, v: npt.ArrayLike) -> Float64Array:
    a = _check.vectors(name, v).astype(np.float64, copy=False)
    a = a / np.abs(a).max(axis=-1, keepdims=True)
    return np.asarray(a / np.linalg.norm(a, axis=-1, keepdims=True))


def dot(a: Float64Array, b: Float64Array) -> Float64Array:
    """Inner product over the last axis."""
    return np.asarray(np.einsum("...i,...i->...", a, b))


def reflect(wo: npt.ArrayLike, wh: npt.ArrayLike) -> Float64Array:
    """Mirror ``wo`` (..., 3) about ``wh`` (..., 3): 2 (wo.wh) wh - wo, unit when both are."""
    o, h = _check.vectors("wo", wo), _check.vectors("wh", wh)
    return np.asarray(2.0 * dot(o, h)[..., None] * h - o)  # type: ignore[arg-type]


def half_vector(wi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
    """Unit half vector (wi + wo) / |wi + wo|, (..., 3); opposite directions are an error."""
    i, o = _check.vectors("wi", wi), _check.vectors("wo", wo)
    return normalise(i + o)


def spherical(theta: npt.ArrayLike, phi: npt.ArrayLike) -> Float64Array:
    """Unit vectors (..., 3) from polar angle ``theta`` and azimuth ``phi`` [rad], z the pole."""
    t, p = np.broadcast_arrays(_check.array("theta", theta), _check.array("phi", phi))
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)


def sphere_tangent(normal: npt.ArrayLike) -> Float64Array:
    """The sphere's tangent field (..., 3): normalise(cross(+y, n)), and +x at the poles."""
    n = _check.unit_vectors("normal", normal)
    t = np.stack([n[..., 2], np.zeros_like(n[..., 0]), -n[..., 0]], axis=-1)
    length = np.hypot(n[..., 0], n[..., 2])
    pole = length < 1e-12
    t = t / np.where(pole, 1.0, length)[..., None]
    return np.where(pole[..., None], np.array([1.0, 0.0, 0.0]), t)


def to_world(v: npt.ArrayLike, tangent: Float64Array, normal: Float64Array) -> Float64Array:
    """Vectors (..., 3) from the frame (t, b, n) to world coordinates."""
    a = _check.array("v", v)
    b = np.cross(normal, tangent)
    return np.asarray(a[..., :1] * tangent + a[..., 1:2] * b + a[..., 2:] * normal)


def to_local(v: npt.ArrayLike, tangent: Float64Array, normal: Float64Array) -> Float64Array:
    """Vectors (..., 3) from world coordinates to the frame (t, b, n)."""
    a = np.asarray(_check.array("v", v), dtype=np.float64)
    b = np.cross(normal, tangent)
    return np.stack([dot(a, tangent), dot(a, b), dot(a, normal)], axis=-1)


@dataclasses.dataclass(frozen=True, init=False, eq=False)
class SurfacePoints:
    """What a pixel knows of the surface it sees: the shading frame and the direction to the eye.

    Parameters
    ----------
    normal, view : (..., 3) array
        Unit within 1e-3, then renormalised. World coordinates; ``view`` leaves the surface: points
        whose view lies below their horizon come out black, and are warned of if it is by more than
        ``AWAY``.
    tangent : (..., 3) array, optional
        Direction of ``mx``. Made perpendicular to the normal; the sphere's field by default.
    mask : (...) array of bool, optional
        False where no surface is seen: such pixels cost nothing and come out black. Their
        vectors are not looked at.
    position : (..., 3) array, optional
        Where the points are, world coordinates. Only lookups that depend on the place
        (``BoundingPlanes``) need it; without them light is infinitely far away.
    normalise : bool
        Take vectors of any length but zero, as integers of 8 or 10 bits decode to.

    Raises
    ------
    ValueError
        For a wrong shape, a vector that is not unit (with its pixel), a tangent along the normal,
        or a position that is not finite.
    """

    normal: Float64Array
    tangent: Float64Array
    view: Float64Array
    mask: npt.NDArray[np.bool_] | None
    position: Float64Array | None

    def __init__(
        self,
        normal: npt.ArrayLike,
        tangent: npt.ArrayLike | None = None,
        view: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
        position: npt.ArrayLike | None = None,
        *,
        normalise: bool = False,
    ) -> None:
        require("normalise", normalise, bool)
        self._fill(normal, tangent, view, mask, position, normalise)
        self._warn_of_views()

    def _fill(
        self,
        normal: npt.ArrayLike,
        tangent: npt.ArrayLike | None,
        view: npt.ArrayLike | None,
        mask: npt.ArrayLike | None,
        position: npt.ArrayLike | None,
        normalise: bool = False,
    ) -> None:
        if view is None:
            raise _check.fail("view", "is required", None)
        n = _check.array("normal", normal)
        v = _check.array("view", view)
        t = None if tangent is None else _check.array("tangent", tangent)
        x = None if position is None else _check.array("position", position)
        given = [a.shape for a in (n, v, t, x) if a is not None]
        try:
            shape = np.broadcast_shapes(*given)
        except ValueError:
            names = "normal, tangent, view" if x is None else "normal, tangent, view, position"
            raise _check.fail(names, "must broadcast", given) from None
        n, v = np.broadcast_to(n, shape), np.broadcast_to(v, shape)
        t = None if t is None else np.broadcast_to(t, shape)
        seen = None
        if mask is not None:
            seen = _check.truth_values("mask", mask)  # a copy: it is made read-only
            if seen.shape != shape[:-1]:
                raise _check.fail("mask", f"must have shape {shape[:-1]}", seen.shape)
            up, side = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
            n, v = np.where(seen[..., None], n, up), np.where(seen[..., None], v, up)
            t = None if t is None else np.where(seen[..., None], t, side)
        unit = _normalised if normalise else _check.unit_vectors
        n, v = unit("normal", n), unit("view", v)
        if t is None:
            t = sphere_tangent(n)
        else:
            t = unit("tangent", t)
            t = t - dot(t, n)[..., None] * n
            length = np.linalg.norm(t, axis=-1)
            along = length < 1e-3
            if np.any(along):
                rule = f"must not lie along the normal{_check.first_place(along)}"
                raise _check.fail("tangent", rule, "a parallel pair")
            t = t / length[..., None]
        where = None if x is None else _positions(x, shape, seen)
        parts = {"normal": n, "tangent": t, "view": v, "mask": seen, "position": where}
        for name, value in parts.items():
            if value is not None:
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    def _warn_of_views(self) -> None:
        away = (dot(self.normal, self.view) < -AWAY) & self.coverage
        if away.any():
            text = f"view: {int(away.sum())} of {int(self.coverage.sum())} points look into the "
            text += f"surface{_check.first_place(away)} and come out black; views must leave it"
            warnings.warn(text, stacklevel=3)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the set of points, without the vector axis."""
        return self.normal.shape[:-1]

    @property
    def bitangent(self) -> Float64Array:
        """B = n x t, (..., 3)."""
        return np.cross(self.normal, self.tangent)

    @property
    def local_view(self) -> Float64Array:
        """The direction to the viewer in the frame (t, b, n), (..., 3)."""
        return to_local(self.view, self.tangent, self.normal)

    @property
    def coverage(self) -> npt.NDArray[np.bool_]:
        """The mask, or all True where none was given, shape (...)."""
        return np.ones(self.shape, dtype=bool) if self.mask is None else self.mask

    @functools.cached_property
    def packed(self) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.float32]]:
        """Flat indices (K,) of the seen points, and their vectors as float32 rows (9, K).

        Rows: normal, tangent, view, x y z each. Made once, on the first use: 36 bytes a point.
        """
        seen = np.flatnonzero(self.coverage)
        rows = np.empty((9, len(seen)), dtype=np.float32)
        for k, v in enumerate((self.normal, self.tangent, self.view)):
            flat = v.reshape(-1, 3)
            rows[3 * k : 3 * k + 3] = (flat if len(seen) == len(flat) else flat[seen]).T
        seen.flags.writeable = rows.flags.writeable = False
        return seen, rows

    def __getitem__(self, key: Any) -> "SurfacePoints":
        """The points selected by a NumPy index over ``shape``."""
        pick = None if self.mask is None else self.mask[key]
        where = None if self.position is None else self.position[key]
        part = object.__new__(SurfacePoints)
        part._fill(self.normal[key], self.tangent[key], self.view[key], pick, where)
        return part


def _positions(
    x: npt.NDArray[np.floating], shape: tuple[int, ...], seen: npt.NDArray[np.bool_] | None
) -> Float64Array:
    """Positions as ``shape``, a copy; 0 where nothing is seen."""
    if not shape or shape[-1] != 3:
        raise _check.fail("position", "must have shape (..., 3)", x.shape)
    out = np.array(np.broadcast_to(x, shape), dtype=np.float64, order="C")
    if seen is not None:
        out[~seen] = 0.0
    if not np.all(np.isfinite(out)):
        bad = out[~np.isfinite(out).all(axis=-1)][0].tolist()
        raise _check.fail("position", "must be finite", bad)
    return out
