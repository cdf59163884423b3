"""A cube map filtered with a smooth profile through spherical harmonics.

The harmonics of a filtered map are those of the map times a factor that depends on the degree alone
(Funk and Hecke)::

    I_lm = lambda_l L_lm,   lambda_l = 2 pi int p(a) P_l(cos a) sin a da                    (1)

L_lm is the sum over the quadrature nodes of ``exact`` (mostly one part a piece), moved to a grid of
colatitudes and longitudes by the transpose of the interpolation that reads a filtered map back
off such a grid: six points along each axis, degree five. Longitudes by FFT, colatitudes by the
recurrence of the normalised Legendre functions, one order m after another.

Left out above degree l_max, relative to the result, both as mean squares over the sphere::

    sum_(l > l_max) lambda_l^2 power_l / sum_l lambda_l^2 power_l,   power_l = sum_m |L_lm|^2  (2)

The power above the last degree that is known is the map's own mean square less the sum.

Source of (1): the theorem of Funk and Hecke, as in Ramamoorthi and Hanrahan 2001, "An Efficient
Representation for Irradiance Environment Maps". The grid, the bound and its use are ours.
"""

import itertools
import math

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import kernel, row_kernel
from .._threads import in_rows
from ..cubemap import CubeMap, face_directions
from ..frames import normalise
from .exact import at_angles, nodes

GHOSTS = 3  # rows and columns around the grid: the interpolation's reach
OVERSAMPLING = 3  # rows of the grid for each degree
FINE = 32  # parts along a face's edge, at least: the texels' solid angle is no polynomial

ComplexArray = npt.NDArray[np.complex128]
Float64Array = npt.NDArray[np.float64]


@kernel
def k_six(f: float) -> tuple[float, float, float, float, float, float]:
    """Lagrange weights of the points -2 .. 3 at ``f`` in [0, 1]."""
    a, b, c, d, e, g = f + 2.0, f + 1.0, f, f - 1.0, f - 2.0, f - 3.0
    return (
        -b * c * d * e * g / 120.0,
        a * c * d * e * g / 24.0,
        -a * b * d * e * g / 12.0,
        a * b * c * e * g / 12.0,
        -a * b * c * d * g / 24.0,
        a * b * c * d * e / 120.0,
    )


@kernel
def k_place(x: float, y: float, z: float, rows: int) -> tuple[int, float, int, float]:
    """Row and column of the grid (with its ghosts) left of a unit direction, and fractions.

    Colatitude from +z, rows at (i + 1/2) pi/rows; longitude from +x, columns at j pi/rows.
    """
    v = math.atan2(math.hypot(x, y), z) * (rows / math.pi) - 0.5
    u = math.atan2(y, x) * (rows / math.pi)
    u = u + 2.0 * rows if u < 0.0 else u
    row, col = math.floor(v), min(math.floor(u), 2 * rows - 1)
    return row + GHOSTS, v - row, col + GHOSTS, u - col


@kernel
def _spread(directions: Float64Array, mass: Float64Array, grid: Float64Array) -> None:
    """Add masses (K, 3) at directions (K, 3) to a grid with ghosts (rows, cols, 3)."""
    rows = grid.shape[0] - 2 * GHOSTS
    for k in range(directions.shape[0]):
        row, b, col, a = k_place(directions[k, 0], directions[k, 1], directions[k, 2], rows)
        across, down = k_six(a), k_six(b)
        for i in range(6):
            for j in range(6):
                w = down[i] * across[j]
                cell = grid[row + i - 2, col + j - 2]
                cell[0] += w * mass[k, 0]
                cell[1] += w * mass[k, 1]
                cell[2] += w * mass[k, 2]


@row_kernel
def _read(
    begin: int, end: int, directions: Float64Array, grid: Float64Array, out: Float64Array
) -> None:
    """Interpolate a grid with ghosts (rows, cols, 3) at directions (K, 3)."""
    rows = grid.shape[0] - 2 * GHOSTS
    for k in range(begin, end):
        row, b, col, a = k_place(directions[k, 0], directions[k, 1], directions[k, 2], rows)
        across, down = k_six(a), k_six(b)
        r0 = r1 = r2 = 0.0
        for i in range(6):
            for j in range(6):
                w = down[i] * across[j]
                cell = grid[row + i - 2, col + j - 2]
                r0, r1, r2 = r0 + w * cell[0], r1 + w * cell[1], r2 + w * cell[2]
        out[k, 0], out[k, 1], out[k, 2] = r0, r1, r2


def with_ghosts(inner: Float64Array) -> Float64Array:
    """A grid (rows, 2 rows, C) with the rows beyond the poles and the columns beyond 2 pi."""
    turned = np.roll(inner, inner.shape[1] // 2, axis=1)
    over, under = turned[:GHOSTS][::-1], turned[-GHOSTS:][::-1]
    tall = np.concatenate([over, inner, under])
    return np.concatenate([tall[:, -GHOSTS:], tall, tall[:, :GHOSTS]], axis=1)


def fold_ghosts(grid: Float64Array) -> Float64Array:
    """The transpose of ``with_ghosts``: what the ghosts hold is added where they come from."""
    g = GHOSTS
    tall = grid[:, g:-g].copy()
    tall[:, -g:] += grid[:, :g]
    tall[:, :g] += grid[:, -g:]
    inner = tall[g:-g].copy()
    half = inner.shape[1] // 2
    inner[:g] += np.roll(tall[:g][::-1], -half, axis=1)
    inner[-g:] += np.roll(tall[-g:][::-1], -half, axis=1)
    return inner


@kernel
def k_start(m: int, sines: Float64Array, before: Float64Array, now: Float64Array) -> None:
    """Normalised Legendre functions of degree m and order m; ``before`` becomes zero."""
    for i in range(sines.shape[0]):
        value = math.sqrt(0.25 / math.pi)
        for k in range(1, m + 1):
            value *= -math.sqrt((2.0 * k + 1.0) / (2.0 * k)) * sines[i]
        before[i], now[i] = 0.0, value


@kernel
def k_next(
    degree: int, m: int, cosines: Float64Array, before: Float64Array, now: Float64Array
) -> None:
    """From degrees (d - 1, d) to (d, d + 1), in place."""
    n = degree + 1.0
    a = math.sqrt((4.0 * n * n - 1.0) / (n * n - m * m))
    b = math.sqrt(((n - 1.0) ** 2 - m * m) / (4.0 * (n - 1.0) ** 2 - 1.0)) if degree > m else 0.0
    for i in range(cosines.shape[0]):
        value = a * (cosines[i] * now[i] - b * before[i])
        before[i], now[i] = now[i], value


@row_kernel
def _analyse(
    begin: int, end: int, cosines: Float64Array, sums: Float64Array, out: Float64Array
) -> None:
    # (H,) of the northern rows; (M, 2, H, 6) even and odd sums of north and south; (L, M, 6)
    sines = np.sqrt(1.0 - cosines * cosines)
    for m in range(begin, end):
        before, now = np.empty(cosines.shape[0]), np.empty(cosines.shape[0])
        k_start(m, sines, before, now)
        for degree in range(m, out.shape[0]):
            half = sums[m, (degree + m) % 2]
            a0 = a1 = a2 = a3 = a4 = a5 = 0.0
            for i in range(cosines.shape[0]):
                p = now[i]
                a0, a1, a2 = a0 + p * half[i, 0], a1 + p * half[i, 1], a2 + p * half[i, 2]
                a3, a4, a5 = a3 + p * half[i, 3], a4 + p * half[i, 4], a5 + p * half[i, 5]
            o = out[degree, m]
            o[0], o[1], o[2], o[3], o[4], o[5] = a0, a1, a2, a3, a4, a5
            k_next(degree, m, cosines, before, now)


@row_kernel
def _synthesise(
    begin: int,
    end: int,
    cosines: Float64Array,
    coefficients: Float64Array,
    factors: Float64Array,
    out: Float64Array,
) -> None:
    # (H,); (L, M, 6); lambda (l_max + 1, 6); even and odd parts (M, 2, H, 6), added to
    sines = np.sqrt(1.0 - cosines * cosines)
    for m in range(begin, end):
        before, now = np.empty(cosines.shape[0]), np.empty(cosines.shape[0])
        k_start(m, sines, before, now)
        for degree in range(m, factors.shape[0]):
            half, c, f = out[m, (degree + m) % 2], coefficients[degree, m], factors[degree]
            c0, c1, c2 = c[0] * f[0], c[1] * f[1], c[2] * f[2]
            c3, c4, c5 = c[3] * f[3], c[4] * f[4], c[5] * f[5]
            for i in range(cosines.shape[0]):
                p = now[i]
                half[i, 0] += p * c0
                half[i, 1] += p * c1
                half[i, 2] += p * c2
                half[i, 3] += p * c3
                half[i, 4] += p * c4
                half[i, 5] += p * c5
            k_next(degree, m, cosines, before, now)


@row_kernel
def _zonal(
    begin: int, end: int, cosines: Float64Array, weighted: Float64Array, out: Float64Array
) -> None:
    # (Q,); p times weights (B, Q, C); lambda (B, L, C): one block of nodes each, added up later
    for block in range(begin, end):
        for i in range(weighted.shape[1]):
            x, before, now = cosines[block, i], 0.0, 1.0
            for degree in range(out.shape[1]):
                for c in range(out.shape[2]):
                    out[block, degree, c] += now * weighted[block, i, c]
                before, now = (
                    now,
                    ((2.0 * degree + 1.0) * x * now - degree * before) / (degree + 1.0),
                )


def zonal_factors(angles: Float64Array, profile: Float64Array, count: int) -> Float64Array:
    """lambda_l (count, C) of eq. (1): Gauss-Legendre nodes between the nodes of the profile."""
    longest = math.pi / (2.0 * count)
    bounds = [angles[:1]]
    for a, b in itertools.pairwise(angles):
        bounds.append(np.linspace(a, b, max(math.ceil((b - a) / longest), 1) + 1)[1:])
    edge = np.concatenate(bounds)
    x, w = np.polynomial.legendre.leggauss(3)
    middle, radius = 0.5 * (edge[1:] + edge[:-1]), 0.5 * np.diff(edge)
    at = middle[:, None] + radius[:, None] * x
    weight = 2.0 * math.pi * radius[:, None] * w * np.sin(at)
    values = at_angles(angles, profile, at.reshape(-1)) * weight.reshape(-1, 1)
    blocks = 16
    spare = -len(values) % blocks
    values = np.pad(values, ((0, spare), (0, 0))).reshape(blocks, -1, profile.shape[1])
    cosines = np.pad(np.cos(at.reshape(-1)), (0, spare)).reshape(blocks, -1)
    out = np.zeros((blocks, count, profile.shape[1]))
    in_rows(_zonal, len(values), _check.frozen(cosines), _check.frozen(values), out)
    return np.asarray(out.sum(axis=0))


class MapHarmonics:
    """The harmonics of a cube map up to degree ``count - 1``.

    Attributes
    ----------
    coefficients : (count, count, 6) float64
        By degree and order; real parts of the channels, then imaginary parts.
    power : (count + 1, 3) float64
        power_l of eq. (2), the last entry for all degrees beyond.
    """

    def __init__(self, cube: CubeMap, count: int) -> None:
        self.count = count
        rows = OVERSAMPLING * count + OVERSAMPLING * count % 2
        at, weight = nodes(cube.size, -(-FINE // cube.size))
        grid = np.zeros((rows + 2 * GHOSTS, 2 * (rows + GHOSTS), 3))
        square = np.zeros(3)
        for face in range(6):
            d = face_directions(face, at[None, :], at[:, None])
            j = np.sum(d * d, axis=-1) ** -1.5 * weight * weight[:, None]
            light = cube.lookup(d)
            square += np.einsum("ij,ijc->c", j, light * light)
            mass = (light * j[..., None]).reshape(-1, 3)
            _spread(_check.frozen(normalise(d).reshape(-1, 3)), _check.frozen(mass), grid)
        f = np.fft.rfft(fold_ghosts(grid), axis=1)[:, :count]
        north, south = f[: rows // 2], f[::-1][: rows // 2]
        sums = np.stack([north + south, north - south]).transpose(2, 0, 1, 3)
        parts = _check.frozen(np.concatenate([sums.real, sums.imag], axis=-1))
        self.coefficients = np.zeros((count, count, 6))
        in_rows(_analyse, self.coefficients.shape[1], self._cosines(rows), parts, self.coefficients)
        each = np.square(self.coefficients)
        each[:, 1:] *= 2.0  # orders -m
        own = each.sum(axis=1)
        own = own[:, :3] + own[:, 3:]
        rest = np.maximum(square - own.sum(axis=0), 0.0)
        self.power = np.concatenate([own, rest[None]])

    @staticmethod
    def _cosines(rows: int) -> Float64Array:
        theta = (np.arange(rows // 2) + 0.5) * (math.pi / rows)
        return np.asarray(_check.frozen(np.cos(theta)))

    def filtered(self, factors: Float64Array, directions: Float64Array) -> Float64Array:
        """The filtered map (K, 3) at unit directions (K, 3), from lambda_l (l_max + 1, C)."""
        degrees = len(factors)
        rows = OVERSAMPLING * degrees + OVERSAMPLING * degrees % 2
        rows = max(rows, 2 * GHOSTS)
        both = np.broadcast_to(factors, (degrees, 3))
        parts = np.zeros((degrees, 2, rows // 2, 6))
        own, six = _check.frozen(self.coefficients), _check.frozen(np.hstack([both, both]))
        in_rows(_synthesise, len(six), self._cosines(rows), own, six, parts)
        even, odd = (parts[..., :3] + 1j * parts[..., 3:]).transpose(1, 2, 0, 3)
        spectrum = np.concatenate([even + odd, (even - odd)[::-1]])
        full = np.zeros((rows, rows + 1, 3), dtype=np.complex128)
        full[:, :degrees] = spectrum
        grid = np.fft.irfft(full, n=2 * rows, axis=1) * (2.0 * rows)
        out = np.empty(directions.shape)
        in_rows(
            _read,
            len(directions),
            _check.frozen(directions),
            _check.frozen(with_ghosts(grid)),
            out,
            grain=512,
        )
        return out
