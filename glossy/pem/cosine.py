"""The cosine lobes themselves: integrals over the cube map, without any pyramid.

::

    f(r, s) = integral L(w) max(0, r.w)^s dw                                                (1)

as a sum over texels, each at its centre with its exact solid angle; ``refine`` cuts every texel
into smaller ones with bilinear radiance for lobes not much wider than a texel. What the lookups of
partial environment maps are judged by.

Source: Knuth et al., eq. 4.
"""

import math

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import row_kernel
from .._threads import in_rows
from ..cubemap import CubeMap, texel_directions, texel_solid_angles
from ..frames import normalise

SMALL = 1e-13  # of the peak: what is below adds nothing

Float64Array = npt.NDArray[np.float64]


@row_kernel
def _integrate(
    begin: int,
    end: int,
    directions: Float64Array,
    exponent: float,
    least: float,
    texels: Float64Array,
    light: Float64Array,
    out: Float64Array,
) -> None:
    # (K, 3), s, smallest cosine, (M, 3) unit, (M, 3) radiance times solid angle, (K, 3)
    for k in range(begin, end):
        x, y, z = directions[k, 0], directions[k, 1], directions[k, 2]
        red = green = blue = 0.0
        for i in range(texels.shape[0]):
            c = x * texels[i, 0] + y * texels[i, 1] + z * texels[i, 2]
            if c > least:
                weight = c**exponent
                red += weight * light[i, 0]
                green += weight * light[i, 1]
                blue += weight * light[i, 2]
        out[k, 0], out[k, 1], out[k, 2] = red, green, blue


def cosine_radiance(
    cube: CubeMap, directions: npt.ArrayLike, exponent: float, refine: int = 1
) -> Float64Array:
    """Light that cosine lobes collect, eq. (1), (..., 3) float64; not divided by their volume.

    Exact up to the midpoint rule: the lobe's width, 1/sqrt(s), should span some (refined) texels.

    Parameters
    ----------
    cube : CubeMap
    directions : (..., 3) array
        Axes r of the lobes, of any length.
    exponent : float > 0
        s; 1 for the irradiance of a surface with normal r.
    refine : int
        Cut texels into this many along each edge.

    Raises
    ------
    ValueError
        If a direction is zero or not finite, or a number out of range.
    """
    d = normalise(directions)
    s, k = _check.positive("exponent", exponent), _check.count("refine", refine)
    n = k * cube.size
    texels = texel_directions(n)
    radiance = cube.faces.astype(np.float64) if k == 1 else cube.lookup(texels)
    light = radiance * texel_solid_angles(n)[:, :, None]
    flat = [_check.frozen(a.reshape(-1, 3)) for a in (d, normalise(texels), light)]
    out = np.empty(flat[0].shape)
    in_rows(
        _integrate, len(flat[0]), flat[0], s, math.exp(math.log(SMALL) / s), flat[1], flat[2], out
    )
    return out.reshape(d.shape)
