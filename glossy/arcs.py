"""Line integrals along great circles over a lat-long picture: the edges of ``overlap``.

An edge of a cube texel is an arc of a great circle, base + w step with w from one grid point to the
next. With azimuth phi = atan2(x, -z) and the circle's constants kx, kz ::

    tan(lat) = T(phi) = kx sin(phi) + kz cos(phi),   y = T / sqrt(1 + T^2)                      (1)
    dy/dphi = T' / (1 + T^2)^(3/2),                  T' = kx cos(phi) - kz sin(phi)             (2)

What is integrated is G(phi, y), the picture's radiance summed in y from a pole (``overlap`` (1)).

``TEXELS``: G is linear in y along an edge but for kinks where it enters another row; T being a
sinusoid, those are found by a quadratic equation, and the integral of y is that of the cubic
through its ends and slopes. ``CENTRES``, ``POLES``: G is smooth but for the rows' nodes; two Gauss
points a piece, at least two pieces for each row crossed.
"""

import math

import numpy as np
import numpy.typing as npt

from ._jit import kernel

TEXELS, CENTRES, POLES = 0, 1, 2  # what a picture is: constant on texels, or bilinear (overlap)
STEP = 1.0 / 64.0  # widest column [rad]
GAUSS = 0.5 / math.sqrt(3.0)  # the two-point rule: this far from the middle, of the length

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]


@kernel
def k_partial(rule: int, y: float, y0: float, y1: float, step: float) -> float:
    """Integral from y to y0 of the weight that grows from 0 at node y0 to 1 at node y1."""
    if rule != POLES:
        return 0.5 * (y0 - y) ** 2 / (y0 - y1)
    t, t0 = math.acos(y), math.acos(y0)
    return (math.sin(t) - math.sin(t0) - (t - t0) * y) / step


@kernel
def _texel_piece(
    pixels: Float32Array,
    cumulated: Float64Array,
    nodes: Float64Array,
    k: int,
    r: int,
    h: float,
    a: tuple[float, float],
    b: tuple[float, float],
    t: float,
    derivative: float,
) -> tuple[int, float, float, float]:
    # integral of G d phi over a piece of length h inside column k that starts in row r; a, b: y,
    # its slope and sin(theta) at the ends; t, derivative: T and dT/dphi at b
    # -> row of its end, RGB
    integral = h * (0.5 * (a[0] + b[0]) + h * (a[1] - b[1]) * (1.0 / 12.0))
    below = nodes[r] * h - integral
    red = cumulated[r, k, 0] * h + pixels[r, k, 0] * below
    green = cumulated[r, k, 1] * h + pixels[r, k, 1] * below
    blue = cumulated[r, k, 2] * h + pixels[r, k, 2] * below
    last = pixels.shape[0] - 1
    while (r < last and b[0] < nodes[r + 1]) or (r > 0 and b[0] > nodes[r]):
        down = b[0] < nodes[r]
        m = r + 1 if down else r
        y = nodes[m]
        sine = math.sqrt(1.0 - y * y)
        # the last part of the piece, beyond the row's border: T there is a sinusoid to d^3
        gap = y / sine - t
        root = math.sqrt(max(derivative * derivative - 2.0 * t * gap, 0.0))
        d = -2.0 * gap / (derivative + (root if derivative >= 0.0 else -root))
        d = min(max(d, 0.0), h) if h > 0.0 else max(min(d, 0.0), h)
        slope = (derivative * (1.0 - 0.5 * d * d) + t * d) * sine * sine * sine
        kink = d * (0.5 * (y - b[0]) - d * (slope - b[1]) * (1.0 / 12.0))
        if not down:
            kink = -kink
        red += (np.float64(pixels[m, k, 0]) - pixels[m - 1, k, 0]) * kink
        green += (np.float64(pixels[m, k, 1]) - pixels[m - 1, k, 1]) * kink
        blue += (np.float64(pixels[m, k, 2]) - pixels[m - 1, k, 2]) * kink
        r += 1 if down else -1
    return r, red, green, blue


@kernel
def _bilinear_point(
    rule: int,
    pixels: Float32Array,
    cumulated: Float64Array,
    nodes: Float64Array,
    k: int,
    t: float,
    fraction: float,
) -> tuple[float, float, float]:
    # G at tan(lat) = t, the fraction of the way from column k's centre to the next -> RGB
    height, width = pixels.shape[0], pixels.shape[1]
    y = t / math.sqrt(1.0 + t * t)
    theta = math.atan2(1.0, t)
    step = math.pi / (height - 1.0) if rule == POLES else math.pi / height
    r = int(theta / step - (0.0 if rule == POLES else 0.5))
    r = min(max(r, 0), height - 2)
    while r < height - 2 and y < nodes[r + 1]:
        r += 1
    while r > 0 and y > nodes[r]:
        r -= 1
    second = k_partial(rule, y, nodes[r], nodes[r + 1], step)
    first = nodes[r] - y - second
    n = k + 1 if k + 1 < width else 0
    w00, w01 = (1.0 - fraction) * first, fraction * first
    w10, w11 = (1.0 - fraction) * second, fraction * second
    return (
        (1.0 - fraction) * cumulated[r, k, 0]
        + fraction * cumulated[r, n, 0]
        + w00 * pixels[r, k, 0]
        + w01 * pixels[r, n, 0]
        + w10 * pixels[r + 1, k, 0]
        + w11 * pixels[r + 1, n, 0],
        (1.0 - fraction) * cumulated[r, k, 1]
        + fraction * cumulated[r, n, 1]
        + w00 * pixels[r, k, 1]
        + w01 * pixels[r, n, 1]
        + w10 * pixels[r + 1, k, 1]
        + w11 * pixels[r + 1, n, 1],
        (1.0 - fraction) * cumulated[r, k, 2]
        + fraction * cumulated[r, n, 2]
        + w00 * pixels[r, k, 2]
        + w01 * pixels[r, n, 2]
        + w10 * pixels[r + 1, k, 2]
        + w11 * pixels[r + 1, n, 2],
    )


@kernel
def _first_row(y: float, nodes: Float64Array) -> int:
    # the row of texels that holds y
    last = nodes.size - 2
    r = min(max(int(math.acos(y) * (last + 1) / math.pi), 0), last)
    while r < last and y < nodes[r + 1]:
        r += 1
    while r > 0 and y > nodes[r]:
        r -= 1
    return r


@kernel
def _circle(
    base: tuple[float, float, float], step: tuple[float, float, float]
) -> tuple[int, float, float]:
    # sense of phi along the line base + w step (0: a meridian, d phi = 0), kx, kz of eq. (2)
    ny = base[2] * step[0] - base[0] * step[2]
    if abs(ny) < 1e-14:
        return 0, 0.0, 0.0
    kx = -(base[1] * step[2] - base[2] * step[1]) / ny
    kz = (base[0] * step[1] - base[1] * step[0]) / ny
    return (1 if ny < 0.0 else -1), kx, kz


@kernel
def _azimuth(
    base: tuple[float, float, float], step: tuple[float, float, float], j: int, size: int
) -> tuple[float, float]:
    # sin and cos of the azimuth of grid point j on the line
    w = (2.0 * j - size) / size
    x, z = base[0] + w * step[0], -(base[2] + w * step[2])
    scale = 1.0 / math.sqrt(x * x + z * z)
    return x * scale, z * scale


@kernel
def _angle(sine: float) -> float:
    # asin of at most STEP, to 1e-16
    square = sine * sine
    return sine + sine * square * (1.0 / 6.0 + square * (3.0 / 40.0 + square * (15.0 / 336.0)))


@kernel
def _border(column: int, sense: int, width: int) -> int:
    # index of the azimuth where a walk along a column in this sense leaves it
    return column if sense < 0 else (column + 1) % width


@kernel
def _cross(
    columns: Float64Array, border: int, sv: float, cv: float, sense: int
) -> tuple[float, float, bool]:
    # sin and cos of where the walk goes next: the border or, if first, the end (sv, cv)
    sb, cb = columns[border, 0], columns[border, 1]
    if (sv * cb - cv * sb) * sense <= 0.0 and sv * sb + cv * cb > 0.0:
        return sv, cv, True
    return sb, cb, False


@kernel
def _walk_texels(
    pixels: Float32Array,
    cumulated: Float64Array,
    nodes: Float64Array,
    columns: Float64Array,
    base: tuple[float, float, float],
    step: tuple[float, float, float],
    size: int,
    first: int,
    out: Float64Array,
) -> None:
    # integral of G d phi over each of len(out) edges of the line base + w step, w = 2j/size - 1,
    # from j = first on; columns (W, 2): sin and cos of the azimuths where columns begin
    sense, kx, kz = _circle(base, step)
    if sense == 0:
        out[:, :] = 0.0
        return
    width = pixels.shape[1]
    curved = math.sqrt(kx * kx + kz * kz)
    sa, ca = _azimuth(base, step, first, size)
    ta, da = kx * sa + kz * ca, kx * ca - kz * sa
    q = 1.0 / math.sqrt(1.0 + ta * ta)
    a = (ta * q, da * q * q * q)
    row = _first_row(a[0], nodes)
    p = math.atan2(sa, ca) * (width / (2.0 * math.pi))
    column = (math.floor(p) if sense > 0 else math.ceil(p) - 1) % width
    border = _border(column, sense, width)

    for j in range(out.shape[0]):
        sv, cv = _azimuth(base, step, first + j + 1, size)
        red, green, blue = 0.0, 0.0, 0.0
        ends_here = False
        while not ends_here:
            sb, cb, ends_here = _cross(columns, border, sv, cv, sense)
            h = _angle(sb * ca - cb * sa)
            tb, db = kx * sb + kz * cb, kx * cb - kz * sb
            parts, sine, cosine = 1, 0.0, 1.0
            bend, flat = 16.0 * abs(h) * curved, 1.0 + min(abs(ta), abs(tb))
            if bend > flat or da * db < 0.0:
                parts = min(4 + int(bend / flat), 256)
                h /= parts
                sine, cosine = math.sin(h), math.cos(h)
            for part in range(1, parts + 1):
                t, d = (
                    (tb, db)
                    if part == parts
                    else (ta * cosine + da * sine, da * cosine - ta * sine)
                )
                q = 1.0 / math.sqrt(1.0 + t * t)
                b = (t * q, d * q * q * q)
                row, x, y, z = _texel_piece(pixels, cumulated, nodes, column, row, h, a, b, t, d)
                red, green, blue = red + x, green + y, blue + z
                a, ta, da = b, t, d
            sa, ca = sb, cb
            if not ends_here:
                column = (column + sense) % width
                border = _border(column, sense, width)
        out[j, 0], out[j, 1], out[j, 2] = red, green, blue


@kernel
def _walk_bilinear(
    rule: int,
    pixels: Float32Array,
    cumulated: Float64Array,
    nodes: Float64Array,
    columns: Float64Array,
    base: tuple[float, float, float],
    step: tuple[float, float, float],
    size: int,
    first: int,
    out: Float64Array,
) -> None:
    # as _walk_texels, for a picture that is bilinear; columns (W, 2): sin and cos of the centres
    sense, kx, kz = _circle(base, step)
    if sense == 0:
        out[:, :] = 0.0
        return
    width = pixels.shape[1]
    per_radian = width / (2.0 * math.pi)
    per_row = pixels.shape[0] / math.pi
    curved = math.sqrt(kx * kx + kz * kz)
    sa, ca = _azimuth(base, step, first, size)
    ta = kx * sa + kz * ca
    p = (math.atan2(sa, ca) - math.atan2(columns[0, 0], columns[0, 1])) * per_radian
    cell = math.floor(p) if sense > 0 else math.ceil(p) - 1
    fraction = p - cell
    column = cell % width
    border = _border(column, sense, width)

    for j in range(out.shape[0]):
        sv, cv = _azimuth(base, step, first + j + 1, size)
        red, green, blue = 0.0, 0.0, 0.0
        ends_here = False
        while not ends_here:
            sb, cb, ends_here = _cross(columns, border, sv, cv, sense)
            h = _angle(sb * ca - cb * sa)
            t = kx * sb + kz * cb
            rows = abs(math.atan2((ta - t), 1.0 + ta * t)) * per_row
            flat = 1.0 + min(abs(ta), abs(t))
            parts = min(1 + int(max(2.0 * rows, 16.0 * abs(h) * curved / flat)), 4096)
            part = h / parts
            for i in range(2 * parts):
                d = part * (i // 2 + 0.5 + (GAUSS if i % 2 else -GAUSS))
                square = d * d
                sine = d * (1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0)))
                cosine = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0)))
                t = kx * (sa * cosine + ca * sine) + kz * (ca * cosine - sa * sine)
                along = min(max(fraction + d * per_radian, 0.0), 1.0)
                r, g, b = _bilinear_point(rule, pixels, cumulated, nodes, column, t, along)
                red += 0.5 * part * r
                green += 0.5 * part * g
                blue += 0.5 * part * b
            sa, ca, ta = sb, cb, kx * sb + kz * cb
            fraction += h * per_radian
            if not ends_here:
                fraction = 0.0 if sense > 0 else 1.0
                column = (column + sense) % width
                border = _border(column, sense, width)
        out[j, 0], out[j, 1], out[j, 2] = red, green, blue


@kernel
def k_walk(
    rule: int,
    pixels: Float32Array,
    cumulated: Float64Array,
    nodes: Float64Array,
    columns: Float64Array,
    base: tuple[float, float, float],
    step: tuple[float, float, float],
    size: int,
    first: int,
    out: Float64Array,
) -> None:
    """Integral of G d phi over each of len(out) edges of base + w step, w = 2j/size - 1.

    From j = ``first`` on, into ``out`` (K, 3). ``columns`` (W, 2): sin and cos of the azimuths
    where the picture's formula changes, texel borders or centres. ``cumulated``: G at the nodes.
    """
    if rule == TEXELS:
        _walk_texels(pixels, cumulated, nodes, columns, base, step, size, first, out)
    else:
        _walk_bilinear(rule, pixels, cumulated, nodes, columns, base, step, size, first, out)
