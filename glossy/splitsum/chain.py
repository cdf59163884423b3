"""A chain of prefiltered cube maps: the environment convolved with the lobe seen head-on.

With N = V = R the lobe f cos of roughness m is radially symmetric about R. Level i holds ::

    L_i(R) = int L(wi) K(R.wi) dwi / int K dw,   K = exp(-x/m_i^2) c ((1 + c)/2)^(-5/2)      (1)
    c = R.wi = cos 2 theta_h,   x = tan^2 theta_h = (1 - c)/(1 + c)

that is D(wh)(wi.n)/(4 (wo.wh)) with F = 1 and alpha = 0, divided by its albedo. Widths grow by
2^(1/STEPS) from a texel's; level 0 is the map itself ::

    m_0 = 0,   m_i = 2^((i - 1)/STEPS) / N,   i >= 1                                         (2)

A lookup at m mixes the two levels around it so that the variance of slopes is that of m ::

    L(m) = (1 - f) L_i + f L_(i+1),   f = (m^2 - m_i^2)/(m_(i+1)^2 - m_i^2)                  (3)

The integral is a sum over the texels of a source as large as the level (averages over solid angle
of the map's texels), and a level's texels are as large as the lobe allows: its standard deviation
spans at least ``TEXELS`` of them. Averages and the bilinear lookup widen the lobe; so K is made
narrower by the variance they add to what the map's own lookup has, h^2 = solid angle ::

    m'^2 = m^2 - (h^2/6 + (h^2 - h_0^2)/12 - h_0^2/6)/2                                      (4)

Source: Karis 2013, "Real Shading in Unreal Engine 4", whose chain holds the GGX lobe; Kautz,
Vazquez, Heidrich and Seidel 2000 for prefiltered maps of any lobe. (3) and (4) are ours.
"""

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from .. import _check
from .._arguments import checked
from .._jit import kernel, row_kernel
from .._threads import in_rows
from ..cubemap import CubeMap, texel_solid_angles
from ..sampler import sample_chain
from ..seams import PAD, fold_table, k_fill_seams

STEPS = 8  # levels for each doubling of m
TEXELS = 2.5  # of a level in one standard deviation of its lobe, at least
SMALLEST = 16  # texels along a face's edge
REACH = 10.0  # exp(-REACH) of the peak ends the sum
PROFILE = 1025  # tabulated values of the lobe

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]


@kernel
def k_face_axes(face: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A direction along a face's columns, rows and axis."""
    if face == 0:
        return -z, -y, x
    if face == 1:
        return z, -y, -x
    if face == 2:
        return x, z, y
    if face == 3:
        return x, -z, -y
    if face == 4:
        return x, -y, z
    return -x, -y, -z


@kernel
def _span(across: float, axis: float, sine: float, n: int) -> tuple[int, int]:
    """Texels of a face's columns (or rows) that a cone of this sine may touch."""
    length = math.hypot(across, axis)
    if sine >= length:
        return 0, n
    middle, half = math.atan2(across, axis), math.asin(sine / length)
    low, high = max(middle - half, -0.25 * math.pi), min(middle + half, 0.25 * math.pi)
    if low > high:
        return 0, 0
    first = math.floor(0.5 * n * (math.tan(low) + 1.0))
    last = math.ceil(0.5 * n * (math.tan(high) + 1.0))
    return max(first, 0), min(last, n)


@kernel
def k_from_axes(face: int, s: float, t: float, axis: float) -> tuple[float, float, float]:
    """The direction that ``k_face_axes`` takes apart."""
    if face == 0:
        return axis, -t, -s
    if face == 1:
        return -axis, -t, s
    if face == 2:
        return s, axis, t
    if face == 3:
        return s, -axis, -t
    if face == 4:
        return s, -t, axis
    return -s, -t, -axis


@row_kernel
def _prefilter(
    begin: int,
    end: int,
    source: Float64Array,
    scale: Float64Array,
    narrow: Float64Array,
    profile: Float64Array,
    per_unit: float,
    out: Float32Array,
) -> None:
    # (6, n, n, 4) omega times radiance, omega; 1/|(s, t, 1)| (n, n); m^2/m'^2 (n, n);
    # K over (1 - c) per_unit, 0 at the end; level with its rings (6, n + 2 PAD, n + 2 PAD, 4)
    n, last = source.shape[1], profile.shape[0] - 1
    for k in range(begin, end):
        face, row, col = k // (n * n), (k // n) % n, k % n
        stretch = per_unit * narrow[row, col]
        least = max(1.0 - last / stretch, -1.0)
        sine = math.sqrt(1.0 - least * least) if least > 0.0 else 1.0
        length = scale[row, col]
        s, t = (2.0 * col + 1.0) / n - 1.0, (2.0 * row + 1.0) / n - 1.0
        x, y, z = k_from_axes(face, s * length, t * length, length)
        red = green = blue = total = 0.0
        for other in range(6):
            rs, rt, ra = k_face_axes(other, x, y, z)
            left, right = _span(rs, ra, sine, n)
            top, bottom = _span(rt, ra, sine, n)
            step, start = 2.0 * rs / n, rs * (1.0 / n - 1.0) + ra
            for i in range(top, bottom):
                base = start + rt * ((2.0 * i + 1.0) / n - 1.0)
                for j in range(left, right):
                    p = (1.0 - (base + step * j) * scale[i, j]) * stretch
                    if p < last:
                        at = int(max(p, 0.0))
                        weight = profile[at] + (p - at) * (profile[at + 1] - profile[at])
                        texel = source[other, i, j]
                        red += weight * texel[0]
                        green += weight * texel[1]
                        blue += weight * texel[2]
                        total += weight * texel[3]
        level = out[face, row + PAD, col + PAD]
        level[0], level[1], level[2], level[3] = red / total, green / total, blue / total, 0.0


def lobe_profile(m: float) -> tuple[Float64Array, float]:
    """K of eq. (1) at even steps of 1 - c, and steps per unit of it; it ends with a zero.

    It ends where K is ``exp(-REACH)`` of its peak, or at the horizon.
    """
    edge = min(REACH * m * m, 1.0)  # of x
    fall = np.linspace(0.0, 2.0 * edge / (1.0 + edge), PROFILE)
    c = 1.0 - fall
    values = np.exp(-fall / ((1.0 + c) * m * m)) * c * (0.5 + 0.5 * c) ** -2.5
    values[-1] = 0.0
    return values, (PROFILE - 1) / fall[-1]


def level_size(m: float, size: int) -> int:
    """Texels along an edge of a level of width ``m``: a power of two, at most ``size``."""
    n = SMALLEST
    while n < TEXELS * math.sqrt(2.0) / m:
        n *= 2
    return min(n, size)


class SplitSumChain:
    """The environment prefiltered with lobes of growing roughness, eqs. (1) and (2).

    Levels are made when a lookup first needs them, and kept; which were made before changes no
    result.

    Parameters
    ----------
    cube : CubeMap
        Its size must be a power of two.

    Raises
    ------
    ValueError
        For another size.
    """

    def __init__(self, cube: CubeMap) -> None:
        if cube.size & (cube.size - 1):
            raise _check.fail("cube size", "must be a power of two", cube.size)
        self.cube = cube
        self._levels: dict[int, Float32Array] = {}
        self._pairs: dict[int, tuple[Float32Array, Int64Array]] = {}

    @property
    def size(self) -> int:
        """Texels along a face's edge of level 0."""
        return self.cube.size

    def width(self, level: int) -> float:
        """Roughness of a level, eq. (2)."""
        return 0.0 if level == 0 else 2.0 ** ((level - 1) / STEPS) / self.size

    def locate(self, m: float) -> tuple[int, float]:
        """The finer of the two levels around ``m`` and the share of the other, eq. (3)."""
        ratio = _check.in_range("m", m, low=0.0) * self.size
        level = 0 if ratio < 1.0 else 1 + math.floor(STEPS * math.log2(ratio))
        low, high = self.width(level) ** 2, self.width(level + 1) ** 2
        return level, min(max((m * m - low) / (high - low), 0.0), 1.0)

    def level(self, index: int) -> Float32Array:
        """Prefiltered radiance of a level, (6, n, n, 3), read-only."""
        padded = self._padded(_check.count("index", index, low=0))
        view = padded[:, PAD:-PAD, PAD:-PAD, :3]
        view.flags.writeable = False
        return view

    def _padded(self, index: int) -> Float32Array:
        if index not in self._levels:
            m, size = self.width(index), self.size
            n = level_size(m, size) if index else size
            level = np.zeros((6, n + 2 * PAD, n + 2 * PAD, 4), dtype=np.float32)
            if index == 0:
                level[:, PAD:-PAD, PAD:-PAD, :3] = self.cube.faces
            else:
                self._prefilter(m, n, level)
            k_fill_seams(level, fold_table())
            self._levels[index] = level
        return self._levels[index]

    def _prefilter(self, m: float, n: int, level: Float32Array) -> None:
        source = self._source(n)
        h2 = texel_solid_angles(n)
        h2_map = h2 * (n / self.size) ** 2
        added = h2 / 6.0 + (h2 - h2_map) / 12.0 - h2_map / 6.0
        narrow = 1.0 / (1.0 - 0.5 * added / (m * m))
        edge = (np.arange(n) + 0.5) * (2.0 / n) - 1.0
        scale = 1.0 / np.sqrt(1.0 + edge[:, None] ** 2 + edge**2)
        profile, per_unit = lobe_profile(m)
        texels, scale, narrow, values = (_check.frozen(a) for a in (source, scale, narrow, profile))
        in_rows(_prefilter, 6 * n * n, texels, scale, narrow, values, per_unit, level)

    def _source(self, n: int) -> Float64Array:
        """Radiance times solid angle, and solid angle, of n texels an edge: (6, n, n, 4)."""
        omega, block = texel_solid_angles(self.size), self.size // n
        out = np.empty((6, n, n, 4))
        for face in range(6):  # a face at a time: the map in float64 is large
            weighted = self.cube.faces[face].astype(np.float64) * omega[..., None]
            out[face, ..., :3] = weighted.reshape(n, block, n, block, 3).sum(axis=(1, 3))
        out[..., 3] = texel_solid_angles(n)
        return out

    def pair(self, m: float) -> tuple[Float32Array, Int64Array, float]:
        """What a kernel looks ``m`` up in: buffer, chain of two levels, and the level in it."""
        index, share = self.locate(m)
        if index not in self._pairs:
            two = [self._padded(index), self._padded(index + 1)]
            starts = [0, two[0].size // 4]
            sizes = [level.shape[1] - 2 * PAD for level in two]
            chain = np.array([starts, sizes], dtype=np.int64).T
            joined = np.concatenate([level.reshape(-1) for level in two])
            self._pairs[index] = (
                np.asarray(_check.frozen(joined)),
                np.asarray(_check.frozen(chain)),
            )
        return *self._pairs[index], share

    def sample(self, directions: npt.ArrayLike, m: float, precision: str = "single") -> FloatArray:
        """Prefiltered radiance (..., 3) along directions (..., 3) of any length, eq. (3).

        Raises
        ------
        ValueError
            If a direction is zero or not finite, or ``m`` negative.
        """
        dtype = _check.dtype_of(precision)
        d = _check.vectors("directions", directions, dtype)
        buffer, chain, share = self.pair(_check.number("m", m))
        out = np.empty(d.shape, dtype=dtype)
        flat = _check.frozen(d.reshape(-1, 3))
        levels = _check.frozen(np.full(len(flat), share, dtype=dtype))
        steps = dtype(0.0)
        in_rows(
            sample_chain,
            len(flat),
            flat,
            levels,
            buffer,
            chain,
            4,
            steps,
            True,
            True,
            True,
            True,
            out.reshape(-1, 3),
            grain=512,
        )
        return out

    def __repr__(self) -> str:
        return f"SplitSumChain(size={self.size})"


@checked
def split_sum_chain(cube: CubeMap, widths: Iterable[float] = ()) -> SplitSumChain:
    """Prefiltered chain of an environment, for the methods "split-sum", "bent" and "axis-taps".

    Parameters
    ----------
    cube : CubeMap
        Its size must be a power of two.
    widths : roughnesses, optional
        The levels around these are made at once, others when they are first needed.

    Raises
    ------
    ValueError
        For a size that is not a power of two, or a negative roughness.
    """
    chain = SplitSumChain(cube)
    for m in [_check.in_range("widths", m, low=0.0) for m in widths]:
        chain.pair(m)
    return chain
