"""Split-sum shading and two anisotropic tricks in use on top of it.

The split sum replaces the integral of a product by a product of integrals: the lobe's albedo at
the view, from a table, times the environment blurred by the lobe as it is seen head-on ::

    L = ks (r0 A(cos_o) + (1 - r0) B(cos_o)) sum w_k L_m(reflect(wo, wh_k)) / sum w_k        (1)

A and B are the integrals of f cos with 1 and (1 - wo.wh)^5 for F (scale and bias), for an isotropic
lobe of roughness m; transmission lobes have 1 - F and look below the surface. Directions below the
horizon are left out of both sums. Where the view is not the normal the true lobe is no longer
round, and none of these methods knows it.

* ``split-sum``: one lookup, wh = n. Anisotropic lobes get m = sqrt(mx my), or (mx + my)/2.
* ``bent``: one lookup about a bent normal, with a = |mx - my|/(mx + my), m = (mx + my)/2,
  p = sqrt m, e the minor axis (b if mx > my, else t) ::

      wh = normalise((1 - s) n + s (wo - (wo.e) e))                                          (2)
      filament: s = a min(5 p, 1),           width m
      hdrp:     s = a min(1.5 sqrt p, 1),    width (p min(1.2 - a, 1))^2

* ``axis-taps``: n lookups at (or as near as they can cover the lobe to) the minor width, with half
  vectors along the major axis M > m_0: slopes x_k in the minor axis' plane, u_k even in +-REACH ::

      w_k = exp(-u_k^2/2),   x_k = u_k sqrt((M^2 - m^2)/2 / mean_w u^2)                      (3)
      m = max(m_0, M q / sqrt(1 + q^2)),   q = 2 REACH/(SPACING n)                           (4)

  so that lookups and width add up to the variance of the lobe, and lookups stand no further apart
  than SPACING of their own standard deviations.

Sources: (1) Karis 2013, "Real Shading in Unreal Engine 4"; (2) Revie 2011, "Implementing Fur Using
Deferred Shading" (GPU Pro 2), McAuley 2015, "Rendering the World of Far Cry 4", and the formulas of
google/filament and Unity's HDRP (``GetGGXAnisotropicModifiedNormalAndRoughness``); (3) the lines of
round lookups of McCormack et al. 1999, "Feline", applied to reflections as Kautz, Daubert and
Seidel 2004 do with the hardware's anisotropic filter. (3) and (4) in this form are ours.
"""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from ..albedo import unit_integrals
from ..brdf import Lobe, Material
from ..cubemap import CubeMap
from ..frames import SurfacePoints
from ..sampler import k_trilinear_rgb
from ..shading import chunks, k_frame
from .chain import SplitSumChain, split_sum_chain

EQUIVALENTS = ("geometric", "mean")
BENDS = ("filament", "hdrp")
ENTRIES = 256  # of the albedo table, even in sqrt(cos_o)
NODES = 48  # of the quadrature behind it, on each axis
REACH = 2.5  # of the lookups along the major axis, in standard deviations
SPACING = 2.5  # of theirs

FloatArray = npt.NDArray[np.floating]
Float64Array = npt.NDArray[np.float64]
Lookups = tuple[float, Float64Array, float, int]
"""Width, half vectors and weights (K, 4), bend s of eq. (2), index of the minor axis e."""

ZERO, ONE, TWO = (np.float32(v) for v in (0.0, 1.0, 2.0))
HEAD_ON = np.array([[0.0, 0.0, 1.0, 1.0]])


@kernel
def k_lookup(
    tap: FloatArray,
    bend: Scalar,
    minor: Scalar,
    side: Scalar,
    wo: tuple[Scalar, Scalar, Scalar],
    frame: tuple[Scalar, ...],
) -> tuple[bool, Scalar, Scalar, Scalar]:
    """Whether a lookup lies above the horizon, and its direction in world coordinates."""
    wox, woy, woz = wo
    hx, hy, hz = tap[0], tap[1], tap[2]
    if bend > ZERO:
        hx, hy = bend * wox, bend * woy
        if minor == 0:
            hx = ZERO * woz
        else:
            hy = ZERO * woz
        hz = (ONE - bend) + bend * woz
        length = np.sqrt(hx * hx + hy * hy + hz * hz)
        hx, hy, hz = hx / length, hy / length, hz / length
    cos_h = wox * hx + woy * hy + woz * hz
    ix, iy = TWO * cos_h * hx - wox, TWO * cos_h * hy - woy
    iz = TWO * cos_h * hz - woz
    up = iz * side
    x = frame[0] * ix + frame[3] * iy + frame[6] * up
    y = frame[1] * ix + frame[4] * iy + frame[7] * up
    z = frame[2] * ix + frame[5] * iy + frame[8] * up
    return cos_h > ZERO and iz > ZERO, x, y, z


@kernel
def k_albedo(albedo: FloatArray, alpha: Scalar, woz: Scalar) -> tuple[Scalar, Scalar]:
    """A and B of eq. (1) at the view."""
    last = albedo.shape[0] - 1
    at = np.sqrt(min(woz, ONE)) * type(woz)(last)
    i = min(np.int64(at), last - 1)
    f = at - type(woz)(i)
    scale = albedo[i, 0] + f * (albedo[i + 1, 0] - albedo[i, 0])
    bias = albedo[i, 1] + f * (albedo[i + 1, 1] - albedo[i, 1])
    if alpha != ZERO:
        power = woz**-alpha
        scale, bias = scale * power, bias * power
    return scale, bias


@row_kernel
def _shade_lobe(
    begin: int,
    end: int,
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    taps: FloatArray,
    bend: Scalar,
    minor: Scalar,
    side: Scalar,
    alpha: Scalar,
    albedo: FloatArray,
    colour: FloatArray,
    level: Scalar,
    buffer: npt.NDArray[np.float32],
    chain: npt.NDArray[np.int64],
    out: FloatArray,
) -> None:
    # (P, 3) x3; (K, 4); albedo (ENTRIES, 2) times cos_o^alpha; colour (2, 3); out (P, 3) added to
    for p in range(begin, end):
        frame, wo = k_frame(normal[p], tangent[p], view[p])
        woz = wo[2]
        if woz <= ZERO:
            continue
        red = green = blue = total = ZERO * woz
        for k in range(taps.shape[0]):
            kept, x, y, z = k_lookup(taps[k], bend, minor, side, wo, frame)
            if not kept:
                continue
            r, g, b = k_trilinear_rgb(x, y, z, level, buffer, chain, 4, ZERO * woz)
            weight = taps[k, 3]
            red, green, blue = red + weight * r, green + weight * g, blue + weight * b
            total += weight
        if total > ZERO:
            scale, bias = k_albedo(albedo, alpha, woz)
            out[p, 0] += (colour[0, 0] * scale + colour[1, 0] * bias) * (red / total)
            out[p, 1] += (colour[0, 1] * scale + colour[1, 1] * bias) * (green / total)
            out[p, 2] += (colour[0, 2] * scale + colour[1, 2] * bias) * (blue / total)


@functools.lru_cache(maxsize=128)
def albedo_table(m: float, alpha: float, transmitted: bool = False) -> Float64Array:
    """A and B of eq. (1) times cos_o^alpha, (ENTRIES, 2), at cos_o = (k/(ENTRIES - 1))^2.

    For a transmission lobe the first column is 0 and the second the integral with 1 - (1-u)^5.
    """
    c = np.maximum(np.linspace(0.0, 1.0, ENTRIES) ** 2, 1e-6)
    wo = np.stack([np.sqrt(1.0 - c * c), np.zeros(ENTRIES), c], axis=1)
    one, schlick, rest = unit_integrals(wo, m, m, alpha, NODES).T
    columns = [np.zeros(ENTRIES), rest] if transmitted else [one, schlick]
    return np.asarray(_check.frozen(np.stack(columns, axis=1) * c[:, None] ** alpha))


def equivalent_width(lobe: Lobe, equivalent: str = "geometric") -> float:
    """Roughness of the isotropic lobe that stands for an anisotropic one."""
    mx, my = lobe.widths
    if mx == my:
        return mx
    return math.sqrt(mx * my) if equivalent == "geometric" else 0.5 * (mx + my)


def bend_of(lobe: Lobe, bend: str) -> tuple[float, float]:
    """Bend s of eq. (2) and the width of the lookup."""
    mx, my = lobe.widths
    m, a = 0.5 * (mx + my), abs(mx - my) / (mx + my)
    p = math.sqrt(m)
    if bend == "filament":
        return a * min(5.0 * p, 1.0), m
    width = m if a == 0.0 else (p * min(1.2 - a, 1.0)) ** 2
    return a * min(1.5 * math.sqrt(p), 1.0), width


def axis_lookups(lobe: Lobe, samples: int) -> tuple[float, Float64Array]:
    """Width of the lookups along the major axis, and half vectors and weights (K, 4), eq. (3).

    An isotropic lobe has one, at the normal.
    """
    mx, my = lobe.widths
    major, minor = max(mx, my), min(mx, my)
    n = _check.count("samples", samples)
    if major == minor:
        return major, HEAD_ON
    q = 2.0 * REACH / (SPACING * n)
    m = max(minor, major * q / math.hypot(1.0, q)) if n > 1 else major
    u = REACH * ((2.0 * np.arange(n) + 1.0) / n - 1.0)
    w = np.exp(-0.5 * u * u)
    w /= w.sum()
    spread = math.sqrt(float(np.sum(w * u * u)))
    slope = u * (math.sqrt(0.5 * (major**2 - m**2)) / spread) if spread > 0.0 else u
    length = np.sqrt(1.0 + slope * slope)
    along, zero = slope / length, np.zeros(n)
    pair = (along, zero) if mx > my else (zero, along)
    return m, np.stack([*pair, 1.0 / length, w], axis=1)


def tap_count(lobe: Lobe, samples: int) -> int:
    """Lookups that ``axis-taps`` takes for a lobe."""
    return len(axis_lookups(lobe, samples)[1])


class LobeRow(NamedTuple):
    """What a kernel takes for one lobe, in its precision: as ``_shade_lobe`` says, from taps on."""

    taps: FloatArray
    bend: Scalar
    minor: int
    side: Scalar
    alpha: Scalar
    albedo: FloatArray
    colour: FloatArray
    level: Scalar
    buffer: npt.NDArray[np.float32]
    chain: npt.NDArray[np.int64]


def lobe_rows(
    material: Material,
    chain: SplitSumChain,
    lookups: Callable[[Lobe], Lookups],
    equivalent: str,
    bias: float,
    dtype: type,
) -> list[LobeRow]:
    """Eq. (1) of every lobe, each with its lookups."""
    if not isinstance(chain, SplitSumChain):
        raise _check.fail("prepared", "must come from split_sum_chain", chain)
    widening = 2.0 ** _check.in_range("bias", bias, -20.0, 20.0)
    rows = []
    for lobe, side in material.sided_lobes():
        m, taps, bend, minor = lookups(lobe)
        ks, r0 = _check.rgb("ks", lobe.ks), _check.rgb("r0", lobe.r0)
        table = albedo_table(equivalent_width(lobe, equivalent), lobe.alpha, side < 0.0)
        buffer, levels, level = chain.pair(m * widening)
        colour = np.stack([ks * r0, ks * (1.0 - r0)])
        taps, table, colour = (_check.frozen(a.astype(dtype)) for a in (taps, table, colour))
        bend, side, alpha, level = (dtype(v) for v in (bend, side, lobe.alpha, level))
        rows.append(LobeRow(taps, bend, minor, side, alpha, table, colour, level, buffer, levels))
    return rows


def _run(points: SurfacePoints, rows: list[LobeRow], dtype: type) -> FloatArray:
    """Sum of the lobes."""
    out: npt.NDArray[Any] = np.zeros((points.coverage.size, 3), dtype=dtype)
    for pick, (n, t, v) in chunks(points, np.flatnonzero(points.coverage), dtype):
        part: npt.NDArray[Any] = np.zeros((len(pick), 3), dtype=dtype)
        for row in rows:
            in_rows(_shade_lobe, len(n), n, t, v, *row, part, grain=64)
        out[pick] = part
    return out.reshape(*points.shape, 3)


def split_sum_lookups(equivalent: str = "geometric") -> tuple[Callable[[Lobe], Lookups], str]:
    """Lookups of ``split_sum``, and the stand-in whose albedo it takes."""
    _check.choice("equivalent", equivalent, EQUIVALENTS)
    return lambda lobe: (equivalent_width(lobe, equivalent), HEAD_ON, 0.0, 0), equivalent


def bent_lookups(bend: str = "filament") -> tuple[Callable[[Lobe], Lookups], str]:
    """The same of ``bent``."""
    _check.choice("bend", bend, BENDS)

    def lookups(lobe: Lobe) -> Lookups:
        s, width = bend_of(lobe, bend)
        return width, HEAD_ON, s, 1 if lobe.widths[0] > lobe.widths[1] else 0

    return lookups, "mean"


def axis_taps_lookups(samples: int = 8) -> tuple[Callable[[Lobe], Lookups], str]:
    """The same of ``axis_taps``."""
    return lambda lobe: (*axis_lookups(lobe, samples), 0.0, 0), "geometric"


LOOKUPS: dict[str, Callable[..., tuple[Callable[[Lobe], Lookups], str]]] = {
    "split-sum": split_sum_lookups,
    "bent": bent_lookups,
    "axis-taps": axis_taps_lookups,
}


def split_sum(
    points: SurfacePoints,
    material: Material,
    chain: SplitSumChain,
    *,
    precision: str = "single",
    equivalent: str = "geometric",
    bias: float = 0.0,
) -> FloatArray:
    """Karis's split sum with one lookup at the mirror direction, eq. (1).

    Parameters
    ----------
    chain : SplitSumChain
        From ``split_sum_chain``.
    equivalent : "geometric" or "mean"
        Isotropic stand-in of an anisotropic lobe: sqrt(mx my) or (mx + my)/2.
    bias : float
        The environment is blurred by 2^bias times the roughness.
    precision : "single" or "double"

    Returns
    -------
    (..., 3) radiance of the glossy lobes.
    """
    dtype = _check.dtype_of(precision)
    rows = lobe_rows(material, chain, *split_sum_lookups(equivalent), bias, dtype)
    return _run(points, rows, dtype)


def bent(
    points: SurfacePoints,
    material: Material,
    chain: SplitSumChain,
    *,
    precision: str = "single",
    bend: str = "filament",
    bias: float = 0.0,
) -> FloatArray:
    """Split sum with a reflection vector bent towards the plane of the major axis, eq. (2).

    The same as ``split-sum`` for isotropic lobes.

    Parameters
    ----------
    chain, bias, precision
        As for ``split_sum``.
    bend : "filament" or "hdrp"
        Whose formula.
    """
    dtype = _check.dtype_of(precision)
    return _run(points, lobe_rows(material, chain, *bent_lookups(bend), bias, dtype), dtype)


def axis_taps(
    points: SurfacePoints,
    material: Material,
    chain: SplitSumChain,
    *,
    precision: str = "single",
    samples: int = 8,
    bias: float = 0.0,
) -> FloatArray:
    """Split sum with several lookups along the major axis of each lobe, eqs. (3) and (4).

    The same as ``split-sum`` for isotropic lobes, with one lookup.

    Parameters
    ----------
    chain, bias, precision
        As for ``split_sum``.
    samples : int
        Lookups of an anisotropic lobe.
    """
    dtype = _check.dtype_of(precision)
    rows = lobe_rows(material, chain, *axis_taps_lookups(samples), bias, dtype)
    return _run(points, rows, dtype)


def prepare(cube: CubeMap, material: Material) -> SplitSumChain:
    """A chain with the levels that the three methods look up for this material without bias."""
    widths = set()
    for lobe, _ in material.sided_lobes():
        widths |= {equivalent_width(lobe), equivalent_width(lobe, "mean"), min(lobe.widths)}
    return split_sum_chain(cube, widths)
