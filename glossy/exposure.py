"""Exposure of display pictures: one for all pictures of a scene, whatever made them.

The radiance of a surface point is estimated without any method or truth, from blurred maps alone ::

    L  ~  Kd E(n) / pi  +  sum over lobes of  ks F(n.wo) mean of L about the mirror direction  (1)

The mean is a lookup in the faces reduced to n texels along an edge, whose blur has the width of
the lobe (thin lobes keep the map's own texels); E sums an 8-texel map. So a picture, its truth, and
either with other samples, methods or seeds have the same exposure, which noise does not move.
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _check

if TYPE_CHECKING:
    from .brdf import Lobe, Material
    from .cubemap import CubeMap
    from .frames import SurfacePoints
    from .measured.material import MeasuredMaterial

Float64Array = npt.NDArray[np.float64]

BRIGHT = 99.0  # percentile of the surface's pixels that becomes white
MOST = 4096  # pixels of the estimate
DIFFUSE = 8  # texels along an edge for the diffuse term
WIDTH = 0.32  # of texels along an edge times roughness


KEY = "glossy:exposure"  # of the stops in a file's header


def recorded(metadata: Mapping[str, Any]) -> float | None:
    """Stops that a picture's header says it was exposed by, None if it does not say."""
    try:
        stops = float(metadata.get(KEY, math.nan))
    except (TypeError, ValueError):
        return None
    return stops if math.isfinite(stops) else None


def parse(text: str) -> float:
    """Stops as they are typed: a number, or ``like:FILE`` for those of another picture.

    A display picture says by what it was exposed; one of radiance gets what its own brightest
    hundredth needs.

    Raises
    ------
    ValueError, OSError
        Neither of both, a file that cannot be read, or one that says nothing.
    """
    from .image import read_image

    if not text.startswith("like:"):
        try:
            return _check.in_range("exposure", float(text), -1000.0, 1000.0)
        except ValueError:
            rule = "must be a number of stops within +-1000, or like:FILE"
            raise _check.fail("exposure", rule, text) from None
    image = read_image(text.removeprefix("like:"), "srgb")
    stops = recorded(image.metadata)
    if stops is None and str(image.metadata["sample_type"]).startswith("uint"):
        raise _check.fail(
            "exposure", "must be like a picture that says by what it is exposed", text
        )
    return stops_to_white(image.rgb()) if stops is None else stops


def stops_to_white(radiance: npt.NDArray[np.floating]) -> float:
    """Stops, in halves, that bring the brightest hundredth of pixels (..., C) to white."""
    if radiance.size == 0:
        return 0.0
    bright = float(np.percentile(np.max(radiance, axis=-1), BRIGHT))
    return float(np.round(-2.0 * np.log2(bright)) / 2.0) + 0.0 if bright > 0.0 else 0.0


def scene_exposure(
    points: "SurfacePoints", material: "Material | MeasuredMaterial", cube: "CubeMap"
) -> float | None:
    """Stops for the pictures of one shape, by at most ``MOST`` of its points.

    None for a file of measurements, which has no lobes to estimate by.
    """
    from .brdf import Material

    if not isinstance(material, Material):
        return None
    index = np.flatnonzero(points.coverage)
    index = index[:: max(-(-index.size // MOST), 1)]
    normal, view = (v.reshape(-1, 3)[index] for v in (points.normal, points.view))
    return stops_to_white(estimate(normal, view, material, cube))


def estimate(
    normal: Float64Array, view: Float64Array, material: "Material", cube: "CubeMap"
) -> Float64Array:
    """Radiance (K, 3) at points of such normals and views (K, 3), eq. (1)."""
    from .frames import dot

    n, v = normal, view
    cosine = dot(n, v)[:, None]
    out = np.zeros((len(n), 3))
    for lobe, side in material.sided_lobes():
        mirror = 2.0 * cosine * n - v
        towards = mirror if side > 0.0 else mirror - 2.0 * dot(mirror, n)[:, None] * n
        out += _reflectivity(lobe, cosine, side) * blurred(cube, lobe).lookup(towards)
    for colour, side in ((material.diffuse, 1.0), (material.diffuse_below, -1.0)):
        if colour.any():
            out += colour / np.pi * _irradiance(cube, side * n)
    out[cosine[:, 0] <= 0.0] = 0.0
    return out


def blurred(cube: "CubeMap", lobe: "Lobe") -> "CubeMap":
    """The map reduced to the width of a lobe."""
    return reduced(cube, round(WIDTH / float(np.sqrt(lobe.widths[0] * lobe.widths[1]))))


def reduced(cube: "CubeMap", size: int) -> "CubeMap":
    """Faces of at most ``size`` texels along an edge, each the mean of those it covers."""
    from .cubemap import CubeMap

    n = min(max(size, 1), cube.size)
    if n == cube.size:
        return cube
    starts = np.arange(n) * cube.size // n
    counts = np.diff(starts, append=cube.size).astype(np.float64)
    sums = np.add.reduceat(cube.faces.astype(np.float64), starts, axis=1)
    sums = np.add.reduceat(sums, starts, axis=2)
    return CubeMap(sums / (counts[:, None, None] * counts[:, None]), "keep", "keep")


def _reflectivity(lobe: "Lobe", cosine: Float64Array, side: float) -> Float64Array:
    r0, ks = np.asarray(lobe.r0, dtype=float), np.asarray(lobe.ks, dtype=float)
    fresnel = r0 + (1.0 - r0) * (1.0 - np.clip(cosine, 0.0, 1.0)) ** 5
    return np.asarray(ks * (fresnel if side > 0.0 else 1.0 - fresnel))


def _irradiance(cube: "CubeMap", normal: Float64Array) -> Float64Array:
    from .cubemap import texel_directions, texel_solid_angles
    from .frames import normalise

    small = reduced(cube, DIFFUSE)
    directions = normalise(texel_directions(small.size)).reshape(-1, 3)
    omega = np.broadcast_to(texel_solid_angles(small.size), (6, small.size, small.size))
    light = small.faces.reshape(-1, 3) * omega.reshape(-1, 1)
    return np.asarray(np.maximum(normal @ directions.T, 0.0) @ light)
