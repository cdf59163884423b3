"""Bounding planes: where a ray that leaves a surface point meets the room, seen from the cube map.

A cube map holds what arrives at its centre c. A ray from x along w meets plane i (point p, normal
n, either side) at the inverse distance q_i, and the nearest of them is looked up from the centre::

    q_i = (w.n) / ((p - x).n)  where positive,  q = max(0, q_1, q_2, ...)                   (1)
    w'  = (x + w/q) - c, or along it:  w' = w + q (x - c)                                   (2)

A ray that meets nothing has q = 0 and keeps its direction. ``blend`` replaces the maximum, taken
plane by plane, by one whose slope is continuous too, within k = blend / (least distance from c to
a plane)::

    smax(a, b) = max(a, b) + max(0, k - |a - b|)^2 / (4 k)                                  (3)

Source: thesis section 4.4.1 and its Fig. 4.5. It takes transitions between the planes from Popescu
et al. 2006 as an idea without a formula: (3) is ours.
"""

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check
from ._arguments import checked

Float64Array = npt.NDArray[np.float64]

FOOTPRINTS = ("thesis", "projected")


def _vector(name: str, value: Any) -> tuple[float, float, float]:
    v = _check.array(name, value)
    if v.shape != (3,) or not np.all(np.isfinite(v)):
        raise _check.fail(name, "must be three finite numbers", value)
    return float(v[0]), float(v[1]), float(v[2])


@dataclasses.dataclass(frozen=True, init=False)
class BoundingPlanes:
    """The planes that bound an object's surroundings, and where its cube map was taken.

    Parameters
    ----------
    centre : three numbers
        Where the cube map was captured, world coordinates.
    planes : sequence of (point, normal) or of ``glossy.Plane``
        Any number, in any order; normals of any length, either side is met.
    blend : float in [0, 1]
        Width of the transition between planes, eq. (3); 0 is the nearest hit.
    footprint : "thesis" or "projected"
        "thesis": a sample keeps its solid angle and takes the cube's distance and tilt along w'.
        "projected" (ours) also takes the solid angle as it is seen from the centre.

    Raises
    ------
    ValueError
        For vectors that are not finite, a zero normal, or values out of range.
    """

    centre: tuple[float, float, float]
    planes: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...]
    blend: float
    footprint: str

    @checked
    def __init__(
        self, centre: Any, planes: Iterable[Any], blend: float = 0.0, footprint: str = "thesis"
    ) -> None:
        rows = []
        for k, plane in enumerate(planes):
            pair = plane
            if hasattr(plane, "point") and hasattr(plane, "normal"):
                pair = (plane.point, plane.normal)
            if not isinstance(pair, list | tuple | np.ndarray) or len(pair) != 2:
                raise _check.fail(f"planes[{k}]", "must be a point and a normal", plane)
            point = _vector(f"planes[{k}] point", pair[0])
            normal = np.array(_vector(f"planes[{k}] normal", pair[1]))
            if not normal.any():
                raise _check.fail(f"planes[{k}] normal", "must not be zero", pair[1])
            normal /= np.abs(normal).max()
            x, y, z = (normal / np.linalg.norm(normal)).tolist()
            rows.append((point, (x, y, z)))
        object.__setattr__(self, "centre", _vector("centre", centre))
        object.__setattr__(self, "planes", tuple(rows))
        object.__setattr__(self, "blend", _check.in_range("blend", blend, 0.0, 1.0))
        object.__setattr__(self, "footprint", _check.choice("footprint", footprint, FOOTPRINTS))

    @property
    def points(self) -> Float64Array:
        """A point of each plane, (M, 3)."""
        return np.array([point for point, _ in self.planes]).reshape(-1, 3)

    @property
    def normals(self) -> Float64Array:
        """Unit normals, (M, 3)."""
        return np.array([normal for _, normal in self.planes]).reshape(-1, 3)

    @property
    def width(self) -> float:
        """K of eq. (3) [1/length]; 0 where nothing is blended."""
        away = np.abs(np.sum((self.points - self.centre) * self.normals, axis=1))
        away = away[away > 0.0]
        return self.blend / float(away.min()) if away.size else 0.0

    @classmethod
    def box(cls, low: Any, high: Any, centre: Any = None, **options: Any) -> "BoundingPlanes":
        """The six sides of the box from corner ``low`` to ``high``, centre in its middle."""
        a, b = np.array(_vector("low", low)), np.array(_vector("high", high))
        if not np.all(a < b):
            raise _check.fail("high", f"must lie above low {a.tolist()}", b.tolist())
        axes = np.eye(3)
        planes = [(corner, axis) for axis in axes for corner in (a, b)]
        return cls((a + b) / 2.0 if centre is None else centre, planes, **options)
