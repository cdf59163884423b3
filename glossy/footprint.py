"""Texels that one sample covers, and the MIP level that averages as many.

The lobe's border at the threshold xi0 lies at the half-vector angles theta_u, theta_v along the
tangent and the bitangent; its images span alpha_u, alpha_v about the mirror direction, and the
cross-section of the lobe at unit distance is an ellipse::

    tan theta_u = sqrt(-ln xi0) mx,   sin(alpha_u / 2) = sin theta_u sqrt(1 - (wo.b)^2)    (1)
    tan theta_v = sqrt(-ln xi0) my,   sin(alpha_v / 2) = sin theta_v sqrt(1 - (wo.t)^2)
    A = min(pi tan(alpha_u) tan(alpha_v), 2 pi), and 2 pi when an angle reaches 90 degrees (2)

With N^2 texels on a face, n samples and d = |wi| / |wi|_inf, the distance to the cube::

    paper     texels = A N^2 / (4 n) d / (wi.wh)                                           (3)
    thesis    texels = A N^2 / (4 n) d^3                                                   (4)
    jacobian  texels = 4 (wi.wh) cell N^2 / 4 d^3                                          (5)
    level     = log2(texels) / 2 + bias                                                    (6)

Source: (1)-(3) the regular sampling paper, eqs. 14-16 (closed form of its arccos, and its words for
the garbled exponent); (4) the thesis, eqs. 4.14-4.17. (5) is ours: ``cell`` is the half-vector
solid angle of the sample, without a lobe ellipse. The bound in (2) is ours: the tangent of an angle
beyond 90 degrees is no length. Importance sampling's Omega_s = 1/(n p) is (5) with
cell = 1/(n p_h).
"""

import math

import numpy as np
import numpy.typing as npt

from . import _check
from ._jit import Scalar, kernel

FOOTPRINTS = ("paper", "thesis", "jacobian")
PAPER, THESIS, JACOBIAN = range(3)

ZERO, HALF, ONE, TWO, FOUR = (np.float32(v) for v in (0.0, 0.5, 1.0, 2.0, 4.0))


@kernel
def k_lobe_area(
    sin_u: Scalar, sin_v: Scalar, wo: tuple[Scalar, Scalar, Scalar], pi: Scalar
) -> Scalar:
    """Eq. (2) [area at unit distance] for local ``wo``; ``pi`` brings the precision."""
    u = sin_u * sin_u * (wo[0] * wo[0] + wo[2] * wo[2])  # 1 - (wo.b)^2 without cancellation
    v = sin_v * sin_v * (wo[1] * wo[1] + wo[2] * wo[2])
    cos_u, cos_v = ONE - TWO * u, ONE - TWO * v
    tangents = FOUR * np.sqrt(u * v * ((ONE - u) * (ONE - v))) / (cos_u * cos_v)
    wide = (cos_u <= ZERO) | (cos_v <= ZERO)
    area = min(pi * tangents, TWO * pi)
    return TWO * pi if wide else area


@kernel
def k_texels(footprint: Scalar, spread: Scalar, area: Scalar, cos_ih: Scalar, d: Scalar) -> Scalar:
    """Eqs. (3)-(5); ``spread`` is N^2/(4n), or cell N^2 for the jacobian footprint."""
    if footprint == PAPER:
        return spread * area * d / cos_ih
    if footprint == THESIS:
        return spread * area * (d * d * d)
    return spread * cos_ih * (d * d * d)


@kernel
def k_level(texels: Scalar, bias: Scalar) -> Scalar:
    """Eq. (6)."""
    return HALF * np.log2(texels) + bias


def border_sines(mx: float, my: float, threshold: float) -> tuple[float, float]:
    """Return sin theta_u and sin theta_v of eq. (1) for a threshold in (0, 1)."""
    xi = _check.in_range("threshold", threshold, 0.0, 1.0, open_low=True, open_high=True)
    reach = math.sqrt(-math.log(xi))
    return math.sin(math.atan(reach * mx)), math.sin(math.atan(reach * my))


def lobe_area(
    mx: float, my: float, wo: npt.ArrayLike, threshold: float = 0.1
) -> npt.NDArray[np.float64]:
    """Area (...) of the lobe's cross-section at unit distance, eq. (2), for local wo (..., 3).

    Raises
    ------
    ValueError
        For a roughness or threshold out of range, or directions that are not unit.
    """
    o = _check.unit_vectors("wo", wo)
    su, sv = border_sines(_check.positive("mx", mx), _check.positive("my", my), threshold)
    half_u = su * np.hypot(o[..., 0], o[..., 2])
    half_v = sv * np.hypot(o[..., 1], o[..., 2])
    alpha_u, alpha_v = 2.0 * np.arcsin(half_u), 2.0 * np.arcsin(half_v)
    wide = (alpha_u >= 0.5 * np.pi) | (alpha_v >= 0.5 * np.pi)
    tangents = np.tan(np.where(wide, 0.0, alpha_u)) * np.tan(np.where(wide, 0.0, alpha_v))
    return np.where(wide, 2.0 * np.pi, np.minimum(np.pi * tangents, 2.0 * np.pi))
