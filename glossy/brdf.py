"""Kurt et al.'s glossy lobes: evaluation, sampling, density, albedo.

::

    f   = kd/pi + sum ks F(wo.h) D(h) / (4 (wo.h) ((wi.n)(wo.n))^alpha)      (1)
    F   = r0 + (1 - r0) (1 - wo.h)^5                                         (2)
    D   = exp(q) / (pi mx my cos^4 theta_h),  q = -((hx/hz/mx)^2 + (hy/hz/my)^2)   (3)
    pdf = exp(q) / (4 pi mx my cos^3 theta_h (wo.h))                         (4)

In slope space (hx/hz, hy/hz) the lobe is a Gaussian, so slopes are taken straight from H = wi + wo
without trigonometry: hx/hz = Hx/Hz, wo.h = |H|/2, cos theta_h = Hz/|H|. For the Fresnel term,
1 - wo.h = |wi - wo|^2 / (4 (1 + wo.h)) keeps its digits near the mirror direction.

Thin transmission (a lobe without refraction or thickness) evaluates (1) at wi mirrored in the
surface plane, with 1 - F for F. Surfaces are one-sided: wo below the horizon gives zero. kd and the
reflection lobes act above the horizon; the transmission lobes and a diffuse transmission, the
constant BTDF kt_d/pi that the thesis suggests for its foil, below it. With ``kd_falloff`` both
diffuse terms share what the lobes leave at wo (``energy``, eq. 2).

Source: Kurt, Szirmay-Kalos, Krivanek 2010, as in the regular sampling paper, eqs. 1-7, 10, with the
quadrant-correct azimuth. Sampling in slopes is its eqs. 6-7 without the detour over angles::

    (hx, hy)/hz = sqrt(-ln xi1) (mx cos 2 pi xi2, my sin 2 pi xi2)           (5)
"""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import cast

import numpy as np
import numpy.typing as npt

from . import _check, mixture
from ._arguments import require
from ._jit import kernel, row_kernel
from ._threads import in_rows

FloatArray = npt.NDArray[np.floating]
Float64Array = npt.NDArray[np.float64]

M_MIN, M_MAX = 1e-5, 10.0

# float32 constants are exact in both precisions and do not promote float32 arithmetic; exp(Q_MIN)
# is the last that is not subnormal in float32: beyond it the lobe is over. np.sqrt, not math.sqrt,
# whose result without the compiler would be a Python float, which a float32 constant demotes
ZERO, HALF, ONE, TWO, FOUR = (cast(float, np.float32(v)) for v in (0.0, 0.5, 1.0, 2.0, 4.0))
Q_MIN = cast(float, np.float32(-87.0))


@kernel
def k_schlick(
    wix: float, wiy: float, wiz: float, wox: float, woy: float, woz: float, u: float
) -> float:
    """(1 - u)^5 with u = wo.h, from the difference of the directions."""
    dx, dy, dz = wix - wox, wiy - woy, wiz - woz
    x = (dx * dx + dy * dy + dz * dz) / (FOUR * (ONE + u))
    x2 = x * x
    return x2 * x2 * x


@kernel
def k_schlick_rest(
    wix: float, wiy: float, wiz: float, wox: float, woy: float, woz: float, u: float
) -> float:
    """1 - (1 - u)^5 with u = wo.h, which keeps its digits where u is small."""
    dx, dy, dz = wix - wox, wiy - woy, wiz - woz
    x = (dx * dx + dy * dy + dz * dz) / (FOUR * (ONE + u))
    return u * (ONE + x * (ONE + x * (ONE + x * (ONE + x))))


@kernel
def k_lobe(
    wix: float, wiy: float, wiz: float, wox: float, woy: float, woz: float, lobe: FloatArray
) -> tuple[float, float]:
    """Eq. (1) without ks and F, and the Schlick weight; both directions above the surface.

    ``lobe``: 1/mx, 1/my, 1/(pi mx my), alpha, side.
    """
    hx, hy, hz = wix + wox, wiy + woy, wiz + woz
    sx, sy = hx / hz * lobe[0], hy / hz * lobe[1]
    q = -(sx * sx + sy * sy)
    if not q > Q_MIN:
        return ZERO * hz, ZERO * hz
    length2 = hx * hx + hy * hy + hz * hz
    length = np.sqrt(length2)
    u = HALF * length
    tilt = length2 / (hz * hz)  # 1 / cos^2 theta_h
    value = np.exp(q) * lobe[2] * tilt * tilt / (TWO * length)
    if lobe[3] != ZERO:
        value = value / (wiz * woz) ** lobe[3]
    return value, k_schlick(wix, wiy, wiz, wox, woy, woz, u)


@kernel
def k_bsdf(
    wix: float,
    wiy: float,
    wiz: float,
    wox: float,
    woy: float,
    woz: float,
    lobes: FloatArray,
    ks: FloatArray,
    r0: FloatArray,
    kd: FloatArray,
) -> tuple[float, float, float]:
    """The whole BSDF, RGB. Arrays as in ``PackedMaterial``."""
    f0 = f1 = f2 = ZERO * wix
    if not woz > ZERO or wiz == ZERO:
        return f0, f1, f2
    if wiz > ZERO:
        f0, f1, f2 = kd[0, 0], kd[0, 1], kd[0, 2]
    else:
        f0, f1, f2 = kd[1, 0], kd[1, 1], kd[1, 2]
    for j in range(lobes.shape[0]):
        z = wiz * lobes[j, 4]
        if z > ZERO:
            value, w = k_lobe(wix, wiy, z, wox, woy, woz, lobes[j])
            if value > ZERO:
                e0, e1, e2 = ONE - r0[j, 0], ONE - r0[j, 1], ONE - r0[j, 2]
                if lobes[j, 4] < ZERO:
                    hx, hy, hz = wix + wox, wiy + woy, z + woz
                    u = HALF * np.sqrt(hx * hx + hy * hy + hz * hz)
                    rest = k_schlick_rest(wix, wiy, z, wox, woy, woz, u)
                    e0, e1, e2 = e0 * rest, e1 * rest, e2 * rest
                else:
                    e0, e1, e2 = r0[j, 0] + e0 * w, r0[j, 1] + e1 * w, r0[j, 2] + e2 * w
                f0 += value * ks[j, 0] * e0
                f1 += value * ks[j, 1] * e1
                f2 += value * ks[j, 2] * e2
    return f0, f1, f2


@kernel
def k_pdf(
    wix: float, wiy: float, wiz: float, wox: float, woy: float, woz: float, lobe: FloatArray
) -> float:
    """Eq. (4), the density of wi per solid angle; it integrates to 1 over the whole sphere."""
    z = wiz * lobe[4]
    hx, hy, hz = wix + wox, wiy + woy, z + woz
    length2 = hx * hx + hy * hy + hz * hz
    if hz == ZERO or length2 == ZERO:
        return ZERO * wix
    sx, sy = hx / hz * lobe[0], hy / hz * lobe[1]
    q = -(sx * sx + sy * sy)
    if not q > Q_MIN:
        return ZERO * wix
    tilt = length2 / (hz * hz)
    value: float = np.exp(q) * lobe[2] * tilt * np.sqrt(tilt) / (TWO * np.sqrt(length2))
    return value


@row_kernel
def _eval(
    begin: int,
    end: int,
    wi: FloatArray,
    wo: FloatArray,
    lobes: FloatArray,
    ks: FloatArray,
    r0: FloatArray,
    kd: FloatArray,
    out: FloatArray,
) -> None:
    for k in range(begin, end):
        i, o = wi[k], wo[k]
        f = k_bsdf(i[0], i[1], i[2], o[0], o[1], o[2], lobes, ks, r0, kd)
        out[k, 0], out[k, 1], out[k, 2] = f


@row_kernel
def _pdf(
    begin: int, end: int, wi: Float64Array, wo: Float64Array, lobe: Float64Array, out: Float64Array
) -> None:
    for k in range(begin, end):
        i, o = wi[k], wo[k]
        out[k] = k_pdf(i[0], i[1], i[2], o[0], o[1], o[2], lobe)


@row_kernel
def _sample(
    begin: int,
    end: int,
    xi: Float64Array,
    wo: Float64Array,
    mx: float,
    my: float,
    out: Float64Array,
) -> None:
    for k in range(begin, end):
        radius = np.sqrt(-np.log(xi[k, 0]))
        sx = mx * radius * np.cos(2.0 * math.pi * xi[k, 1])
        sy = my * radius * np.sin(2.0 * math.pi * xi[k, 1])
        scale = 1.0 / (1.0 + sx * sx + sy * sy)  # 1 / |h|^2 with h = (sx, sy, 1)
        d = 2.0 * (wo[k, 0] * sx + wo[k, 1] * sy + wo[k, 2]) * scale
        out[k, 0] = d * sx - wo[k, 0]
        out[k, 1] = d * sy - wo[k, 1]
        out[k, 2] = d - wo[k, 2]


def _pair(wi: npt.ArrayLike, wo: npt.ArrayLike) -> tuple[Float64Array, Float64Array]:
    """Unit directions (..., 3) broadcast against each other."""
    i, o = _check.unit_vectors("wi", wi), _check.unit_vectors("wo", wo)
    shape = _broadcast("wi, wo", i.shape, o.shape)
    return np.broadcast_to(i, shape), np.broadcast_to(o, shape)


def _uniforms(xi: npt.ArrayLike, wo: npt.ArrayLike) -> tuple[Float64Array, Float64Array]:
    """``xi`` (..., 2) in (0, 1] x [0, 1] and unit ``wo`` (..., 3), broadcast."""
    x = np.asarray(_check.array("xi", xi), dtype=np.float64)
    if x.ndim == 0 or x.shape[-1] != 2:
        raise _check.fail("xi", "must have shape (..., 2)", x.shape)
    good = (x >= 0.0) & (x <= 1.0)  # false for NaN
    good[..., 0] &= x[..., 0] > 0.0
    if not good.all():
        raise _check.fail("xi", "must be in (0, 1] x [0, 1]", float(x[~good][0]))
    o = _check.unit_vectors("wo", wo)
    shape = _broadcast("xi, wo", x.shape[:-1], o.shape[:-1])
    return np.broadcast_to(x, (*shape, 2)), np.broadcast_to(o, (*shape, 3))


def _broadcast(names: str, *shapes: tuple[int, ...]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError:
        raise _check.fail(names, "must broadcast", shapes) from None


@dataclasses.dataclass(frozen=True)
class Lobe:
    """One glossy lobe, eqs. (1)-(5).

    Parameters
    ----------
    mx, my : float
        Roughness (Beckmann slope width) along tangent and bitangent, 1e-5 to 10; ``my=None``
        is an isotropic lobe.
    ks : float or RGB, >= 0
        Weight of the lobe.
    r0 : float or RGB in [0, 1]
        Reflectance at normal incidence, eq. (2).
    alpha : float in [0, 1]
        Exponent of (wi.n)(wo.n); 0 conserves energy, larger values need not.

    Raises
    ------
    ValueError
        If a parameter is out of range.
    """

    mx: float
    my: float | None = None
    ks: float | Sequence[float] = 1.0
    r0: float | Sequence[float] = 1.0
    alpha: float = 0.0

    def __post_init__(self) -> None:
        mx = _check.in_range("mx", self.mx, M_MIN, M_MAX)
        my = mx if self.my is None else _check.in_range("my", self.my, M_MIN, M_MAX)
        alpha = _check.in_range("alpha", self.alpha, 0.0, 1.0)
        values: dict[str, float | tuple[float, ...]] = {"mx": mx, "my": my, "alpha": alpha}
        for name, high in (("ks", math.inf), ("r0", 1.0)):
            value = getattr(self, name)
            channels = _check.rgb(name, value, 0.0, high)
            flat = np.ndim(value) == 0
            values[name] = float(channels[0]) if flat else tuple(channels.tolist())
        for name, item in values.items():
            object.__setattr__(self, name, item)

    @property
    def widths(self) -> tuple[float, float]:
        """(mx, my)."""
        assert self.my is not None
        return self.mx, self.my

    def pack(self, side: float = 1.0) -> Float64Array:
        """1/mx, 1/my, 1/(pi mx my), alpha, side: what the kernels take."""
        mx, my = self.widths
        row = np.array([1.0 / mx, 1.0 / my, 1.0 / (math.pi * mx * my), self.alpha, side])
        return _check.frozen(row)

    def sample(self, xi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
        """Directions wi (..., 3) of density ``pdf``, eq. (5).

        Parameters
        ----------
        xi : (..., 2) array
            Uniform numbers; the first in (0, 1], the second in [0, 1].
        wo : (..., 3) array
            Unit directions to the viewer in the frame (t, b, n).

        Returns
        -------
        (..., 3) float64; directions below the horizon carry no radiance but count as samples.
        """
        x, o = _uniforms(xi, wo)
        out = np.empty(o.shape)
        mx, my = self.widths
        flat = _check.frozen(x.reshape(-1, 2)), _check.frozen(o.reshape(-1, 3))
        in_rows(_sample, len(flat[0]), *flat, mx, my, out.reshape(-1, 3), grain=1024)
        return out

    def pdf(self, wi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
        """Density [1/sr] of ``sample``, eq. (4); shape (...) of the directions (..., 3).

        It integrates to 1 over the whole sphere: samples may fall below the horizon.
        """
        i, o = _pair(wi, wo)
        out = np.empty(i.shape[:-1])
        flat = _check.frozen(i.reshape(-1, 3)), _check.frozen(o.reshape(-1, 3))
        in_rows(_pdf, len(flat[0]), *flat, self.pack(), out.reshape(-1), grain=1024)
        return out

    def eval(self, wi: npt.ArrayLike, wo: npt.ArrayLike) -> FloatArray:
        """BRDF [1/sr] of this lobe alone, as ``Material.eval``."""
        return Material(reflection=[self]).eval(wi, wo)


@dataclasses.dataclass(frozen=True)
class PackedMaterial:
    """A material as the kernels take it; every array of one precision.

    ``lobes`` (L, 5): 1/mx, 1/my, 1/(pi mx my), alpha, side (+1 reflection, -1 transmission);
    ``ks``, ``r0`` (L, 3); ``kd`` (2, 3): diffuse reflection and transmission over pi, without the
    factor of ``kd_falloff``. Lobes with ks = 0 are left out.
    """

    lobes: FloatArray
    ks: FloatArray
    r0: FloatArray
    kd: FloatArray


@dataclasses.dataclass(frozen=True)
class Material:
    """Diffuse terms plus any number of reflection and thin transmission lobes, eq. (1).

    Parameters
    ----------
    kd : float or RGB, >= 0
        Diffuse reflectivity.
    reflection, transmission : sequence of Lobe
    diffuse_transmission : float or RGB, >= 0
        Diffuse transmissivity: light from below that leaves evenly in all directions.
    kd_falloff : bool
        Scale both diffuse terms by the energy that the lobes leave at the viewer's direction,
        ``energy`` eq. (2). The BSDF is then not reciprocal.
    """

    kd: float | Sequence[float] = 0.0
    reflection: Sequence[Lobe] = ()
    transmission: Sequence[Lobe] = ()
    diffuse_transmission: float | Sequence[float] = 0.0
    kd_falloff: bool = False

    def __post_init__(self) -> None:
        for name in ("kd", "diffuse_transmission"):
            value = getattr(self, name)
            channels = _check.rgb(name, value)
            flat = np.ndim(value) == 0
            object.__setattr__(self, name, float(channels[0]) if flat else tuple(channels.tolist()))
        if not isinstance(self.kd_falloff, bool | np.bool_):
            raise _check.fail("kd_falloff", "must be True or False", self.kd_falloff)
        for name in ("reflection", "transmission"):
            lobes = getattr(self, name)
            lobes = (lobes,) if isinstance(lobes, Lobe) else lobes
            require(name, lobes, Iterable)
            lobes = tuple(lobes)
            for lobe in lobes:
                if not isinstance(lobe, Lobe):
                    raise _check.fail(name, "must be a sequence of Lobe", lobe)
            object.__setattr__(self, name, lobes)

    @property
    def diffuse(self) -> Float64Array:
        """Kd as RGB, (3,)."""
        return _check.rgb("kd", self.kd)

    @property
    def diffuse_below(self) -> Float64Array:
        """``diffuse_transmission`` as RGB, (3,)."""
        return _check.rgb("diffuse_transmission", self.diffuse_transmission)

    @property
    def is_scalar(self) -> bool:
        """True when no parameter depends on the channel."""
        colours = [self.kd, self.diffuse_transmission]
        colours += [c for lobe in self.lobes for c in (lobe.ks, lobe.r0)]
        return all(np.ndim(c) == 0 for c in colours)

    @property
    def lobes(self) -> tuple[Lobe, ...]:
        """Reflection lobes, then transmission lobes."""
        return (*self.reflection, *self.transmission)

    def sided_lobes(self) -> list[tuple[Lobe, float]]:
        """(lobe, side) of the lobes with ks > 0; side is +1 for reflection, -1 for transmission."""
        sides = [1.0] * len(self.reflection) + [-1.0] * len(self.transmission)
        pairs = zip(self.lobes, sides, strict=True)
        return [(lobe, side) for lobe, side in pairs if _check.rgb("ks", lobe.ks).any()]

    def pack(self, dtype: type = np.float64) -> PackedMaterial:
        """The material as arrays of ``dtype``."""
        pairs = self.sided_lobes()
        lobes = np.array([lobe.pack(side) for lobe, side in pairs]).reshape(-1, 5)
        ks = np.array([_check.rgb("ks", lobe.ks) for lobe, _ in pairs]).reshape(-1, 3)
        r0 = np.array([_check.rgb("r0", lobe.r0) for lobe, _ in pairs]).reshape(-1, 3)
        kd = np.stack([self.diffuse, self.diffuse_below]) / math.pi
        return PackedMaterial(*(_check.frozen(a.astype(dtype)) for a in (lobes, ks, r0, kd)))

    def eval(self, wi: npt.ArrayLike, wo: npt.ArrayLike, precision: str = "double") -> FloatArray:
        """BSDF [1/sr] for unit directions (..., 3) in the frame (t, b, n), without the cosine.

        Returns
        -------
        (...) when every parameter is a number, else (..., 3); float64, or float32 with
        ``precision="single"`` (the GPU's arithmetic).

        Raises
        ------
        ValueError
            If a direction is not finite or not unit within 1e-3.
        """
        dtype = _check.dtype_of(precision)
        i, o = _pair(wi, wo)
        out = np.empty(i.shape, dtype=dtype)
        p = self.pack(dtype)
        a, b = (_check.frozen(v.astype(dtype).reshape(-1, 3)) for v in (i, o))
        kd = _check.frozen(np.zeros_like(p.kd)) if self.kd_falloff else p.kd
        in_rows(_eval, len(a), a, b, p.lobes, p.ks, p.r0, kd, out.reshape(-1, 3), grain=1024)
        share = self.diffuse_share(o)
        if share is not None:
            up, down = p.kd
            flat = np.where(i[..., 2:] > 0.0, up, np.where(i[..., 2:] < 0.0, down, 0.0))
            out += np.where(o[..., 2:] > 0.0, flat * share, 0.0).astype(dtype)
        return out[..., 0].copy() if self.is_scalar else out

    def diffuse_share(self, wo: npt.ArrayLike) -> Float64Array | None:
        """Factor (..., 3) of ``kd_falloff`` on the diffuse terms, for local wo (..., 3) above."""
        if not self.kd_falloff:
            return None
        from .energy import diffuse_share

        return diffuse_share(self, wo)

    def sample(self, xi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
        """Directions wi (..., 3) of density ``pdf``: a mixture of the lobes and a cosine.

        ``xi`` and ``wo`` as for ``Lobe.sample``; the first number of ``xi`` also picks the part.
        """
        return mixture.sample(self, *_uniforms(xi, wo))

    def pdf(self, wi: npt.ArrayLike, wo: npt.ArrayLike) -> Float64Array:
        """Density [1/sr] of ``sample``, shape (...)."""
        return mixture.pdf(self, *_pair(wi, wo))

    def albedo(self, wo: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Reflectivity and transmissivity: the integral of f |cos| over either hemisphere.

        Shapes as for ``eval``. See ``albedo.lobe_albedo`` for the quadrature and its accuracy.
        """
        from .albedo import lobe_albedo

        o = _check.unit_vectors("wo", wo)
        sides = []
        for lobes, transmitted in ((self.reflection, False), (self.transmission, True)):
            total = np.zeros(o.shape)
            for lobe in lobes:
                total += lobe_albedo(lobe, o, transmitted)
            sides.append(total)
        share = np.where(o[..., 2:] > 0.0, 1.0, 0.0)
        if self.kd_falloff:
            share = share * np.maximum(1.0 - sides[0] - sides[1], 0.0)
        up, down = sides[0] + share * self.diffuse, sides[1] + share * self.diffuse_below
        return (up[..., 0], down[..., 0]) if self.is_scalar else (up, down)
