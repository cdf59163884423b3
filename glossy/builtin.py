"""Built-in environments: functions of direction, averaged over each texel's solid angle.

``spots`` and ``sky`` add discs of constant radiance L. The share of a texel that a disc covers is
integrated over lines across it, and the shares of each disc are then scaled (by about 1e-5) so
that its power is exactly ::

    L 2 pi (1 - cos(radius))                                                                    (1)

at every size; a sun smaller than a texel keeps its energy. The smooth parts are averaged on a grid
of at least 512 samples along a face's edge, so that every size shows the same map.
"""

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from . import _check
from ._jit import kernel, row_kernel
from ._threads import in_rows
from .cubemap import CubeMap, face_directions, texel_solid_angles
from .layouts import area_resize

NAMES = ("spots", "studio", "sky", "white", "axes")
MAX_SIZE = 8192
SAMPLES = 512  # along a face's edge, at least
LINES = 64  # across a texel that a disc covers in part

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Colour = tuple[float, float, float]

_SPOTS, _STUDIO, _SKY = 0, 1, 2


@dataclasses.dataclass(frozen=True, eq=False)
class Disc:
    """Constant radiance within ``radius`` [rad] of a unit direction (3,)."""

    centre: Float64Array
    radius: float
    radiance: Float64Array


@kernel
def _smooth(x: float) -> float:
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@kernel
def _panel(
    x: float, y: float, z: float, yaw: float, pitch: float, wide: float, high: float, soft: float
) -> float:
    # 1 inside a rectangle on the tangent plane at (yaw from +z towards +x, pitch up), soft borders
    cy, sy, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    depth = (x * sy + z * cy) * cp + y * sp
    if depth <= 0.05:
        return 0.0
    across = abs(x * cy - z * sy) / depth
    up = abs(y * cp - (x * sy + z * cy) * sp) / depth
    return _smooth((wide - across) / soft + 0.5) * _smooth((high - up) / soft + 0.5)


@kernel
def _spots(x: float, y: float, z: float) -> Colour:
    # dim background between about 0.2 and 2: broad colour, bands, a grid of lines
    broad = 0.5 + 0.3 * x - 0.2 * y + 0.15 * math.sin(2.3 * z + 0.7)
    bands = 0.5 + 0.5 * math.sin(9.0 * y + 2.0 * math.sin(3.0 * x))
    cells = math.sin(17.0 * x + 1.0) * math.sin(17.0 * y + 2.0) * math.sin(17.0 * z + 3.0)
    light = 0.25 + 0.7 * bands + 0.5 * _smooth(6.0 * cells)
    return (
        light * (0.6 + 0.6 * broad),
        light * (0.75 + 0.25 * math.sin(2.0 * x + y)),
        light * (1.2 - 0.6 * broad),
    )


@kernel
def _studio(x: float, y: float, z: float) -> Colour:
    # dark room, floor brighter towards the front; two soft boxes, an overhead box, a rim light
    floor = _smooth(-1.6 * y - 0.1)
    room = 0.02 + 0.02 * (0.5 + 0.5 * y) + 0.05 * floor * (1.3 + z)
    red, green, blue = room, 0.96 * room, 0.92 * room
    key = 14.0 * _panel(x, y, z, 0.75, 0.45, 0.42, 0.30, 0.03)
    fill = 4.0 * _panel(x, y, z, -1.05, 0.25, 0.30, 0.55, 0.06)
    top = 7.0 * _panel(x, y, z, 0.0, 1.35, 0.55, 0.22, 0.04)
    rim = 60.0 * _panel(x, y, z, 2.75, 0.15, 0.05, 0.60, 0.015)
    red += 1.0 * key + 0.82 * fill + 0.95 * top + 0.9 * rim
    green += 0.94 * key + 0.92 * fill + 1.0 * top + 0.95 * rim
    blue += 0.82 * key + 1.0 * fill + 1.0 * top + 1.0 * rim
    return red, green, blue


@kernel
def _sky(x: float, y: float, z: float) -> Colour:
    # blue gradient with a bright horizon and a glow about the sun; ground below, a soft horizon
    towards = x * 0.5 + y * 0.7 + z * 0.509901951359278
    up = max(y, 0.0)
    haze = math.exp(-6.0 * up)
    glow = 2.5 * math.exp(-14.0 * (1.0 - towards))
    above = _smooth(y / 0.02 + 0.5)
    shade = 0.16 + 0.04 * math.sin(7.0 * x) * math.sin(7.0 * z)
    return (
        above * (0.22 + 0.75 * haze + 1.0 * glow) + (1.0 - above) * 1.1 * shade,
        above * (0.42 + 0.60 * haze + 0.85 * glow) + (1.0 - above) * 0.9 * shade,
        above * (0.95 + 0.25 * haze + 0.60 * glow) + (1.0 - above) * 0.65 * shade,
    )


@row_kernel
def _average(
    begin: int, end: int, kind: int, frames: Float64Array, sub: int, out: Float32Array
) -> None:
    # mean of the function over each texel, sub x sub samples weighted by solid angle
    size = out.shape[1]
    for line in range(begin, end):
        face, row = line // size, line % size
        for col in range(size):
            red, green, blue, total = 0.0, 0.0, 0.0, 0.0
            for i in range(sub):
                t = (2.0 * row + (2.0 * i + 1.0) / sub) / size - 1.0
                for j in range(sub):
                    s = (2.0 * col + (2.0 * j + 1.0) / sub) / size - 1.0
                    q = 1.0 / math.sqrt(1.0 + s * s + t * t)
                    x = (frames[face, 0, 0] + s * frames[face, 1, 0] + t * frames[face, 2, 0]) * q
                    y = (frames[face, 0, 1] + s * frames[face, 1, 1] + t * frames[face, 2, 1]) * q
                    z = (frames[face, 0, 2] + s * frames[face, 1, 2] + t * frames[face, 2, 2]) * q
                    if kind == _SPOTS:
                        r, g, b = _spots(x, y, z)
                    elif kind == _STUDIO:
                        r, g, b = _studio(x, y, z)
                    else:
                        r, g, b = _sky(x, y, z)
                    w = q * q * q
                    red, green, blue, total = red + w * r, green + w * g, blue + w * b, total + w
            out[face, row, col, 0] = red / total
            out[face, row, col, 1] = green / total
            out[face, row, col, 2] = blue / total


def _frames() -> Float64Array:
    face = np.arange(6)
    centre = face_directions(face, 0.0, 0.0)
    along = [face_directions(face, s, t) - centre for s, t in ((1.0, 0.0), (0.0, 1.0))]
    return np.stack([centre, *along], axis=1)


def _reach(major: float, minor: float, radius: float) -> tuple[float, float]:
    # range in [-1, 1] of a cone's s (or t) on a face: axis (minor, major), major along the face's
    length = math.hypot(major, minor)
    if length <= math.sin(radius):
        return -1.0, 1.0
    angle, half = math.atan2(minor, major), math.asin(math.sin(radius) / length)
    low, high = max(angle - half, -0.25 * math.pi), min(angle + half, 0.25 * math.pi)
    return (math.tan(low), math.tan(high)) if low < high else (1.0, -1.0)


def add_disc(faces: Float32Array, disc: Disc) -> None:
    """Add a disc to faces (6, N, N, 3) in place: covered share of each texel, power as eq. (1).

    The disc's radius is below pi/2.
    """
    size = faces.shape[1]
    omega = texel_solid_angles(size)
    shares = []
    for face, frame in enumerate(_frames()):
        depth, s, t = (frame @ disc.centre).tolist()
        span_s, span_t = _reach(depth, s, disc.radius), _reach(depth, t, disc.radius)
        if span_s[0] > span_s[1] or span_t[0] > span_t[1]:
            continue
        c, r = (
            slice(
                max(math.floor((low + 1.0) * 0.5 * size) - 1, 0),
                min(math.ceil((high + 1.0) * 0.5 * size) + 1, size),
            )
            for low, high in (span_s, span_t)
        )
        shares.append((face, r, c, _covered(frame, disc, r, c, size, span_t)))
    power = math.fsum(float((share * omega[r, c]).sum()) for _, r, c, share in shares)
    scale = 2.0 * math.pi * (1.0 - math.cos(disc.radius)) / power
    for face, r, c, share in shares:
        faces[face, r, c] += (share * scale)[..., None] * disc.radiance


def _covered(
    frame: Float64Array, disc: Disc, r: slice, c: slice, size: int, span: tuple[float, float]
) -> Float64Array:
    # share of each texel of a window that lies in the disc: 0 or 1 by the distance of its centre,
    # near the rim by the integral over t of what a line t = const has in the disc
    s = (np.arange(c.start, c.stop) + 0.5) * (2.0 / size) - 1.0
    t = (np.arange(r.start, r.stop) + 0.5) * (2.0 / size) - 1.0
    d = frame[0] + s[None, :, None] * frame[1] + t[:, None, None] * frame[2]
    angle = np.arccos(np.clip(d @ disc.centre / np.linalg.norm(d, axis=-1), -1.0, 1.0))
    share: Float64Array = (angle < disc.radius).astype(np.float64)
    rows, cols = np.nonzero(np.abs(angle - disc.radius) <= math.sqrt(2.0) / size)

    u = (np.arange(LINES) + 0.5) * (np.pi / LINES)  # lines dense at the ends, as Chebyshev's
    low = np.maximum(t[rows] - 1.0 / size, span[0])[:, None]
    high = np.maximum(np.minimum(t[rows] + 1.0 / size, span[1])[:, None], low)
    tt = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(u)
    weight = (high - low) * np.sin(u) / np.sin(u).sum()
    # a line is in the disc where (p + q s)^2 >= k (1 + s^2 + t^2) and p + q s >= 0
    p = disc.centre @ frame[0] + tt * (disc.centre @ frame[2])
    q, k = float(disc.centre @ frame[1]), math.cos(disc.radius) ** 2
    square = q * q - k
    root = np.sqrt(np.maximum(p * p * k + square * k * (1.0 + tt * tt), 0.0))
    left, right = (s[cols] - 1.0 / size)[:, None], (s[cols] + 1.0 / size)[:, None]
    if square < 0.0:
        begin, end = (p * q - root) / -square, (p * q + root) / -square
    elif q > 0.0:
        begin, end = (root - p * q) / square, np.full_like(p, np.inf)
    else:
        begin, end = np.full_like(p, -np.inf), (-p * q - root) / square
    begin, end = np.clip(begin, left, right), np.clip(end, left, right)
    inside = _along(end, tt) - _along(begin, tt)
    omega = texel_solid_angles(size)[r, c][rows, cols]
    share[rows, cols] = np.clip((inside * weight).sum(axis=1) / omega, 0.0, 1.0)
    return share


def _along(s: Float64Array, t: Float64Array) -> Float64Array:
    # integral from 0 to s of (1 + s^2 + t^2)^(-3/2), the solid angle on the face's plane
    return np.asarray(s / ((1.0 + t * t) * np.sqrt(1.0 + s * s + t * t)))


def spot_discs(seed: int = 0) -> list[Disc]:
    """The discs of "spots": 48, diameter 2 to 10 degrees, radiance 30 to 3000, apart from another.

    Small ones are the more frequent (uniform in the logarithm), the brightest is exactly 3000.
    """
    rng = np.random.default_rng(seed)
    discs: list[Disc] = []
    while len(discs) < 48:
        z, phi, size, level, hue = rng.random(5).tolist()
        y, side = 2.0 * z - 1.0, math.sqrt(1.0 - (2.0 * z - 1.0) ** 2)
        phi *= 2.0 * math.pi
        centre = np.array([side * math.sin(phi), y, side * math.cos(phi)])
        radius = math.radians(math.exp(math.log(2.0) + size * math.log(5.0)) / 2.0)
        gap = math.radians(1.0)
        if any(
            math.acos(min(float(d.centre @ centre), 1.0)) < d.radius + radius + gap for d in discs
        ):
            continue
        bright = 3000.0 if not discs else 30.0 * 100.0**level
        wave = [0.625 + 0.375 * math.cos(2.0 * math.pi * (hue - k / 3.0)) for k in range(3)]
        discs.append(Disc(centre, radius, np.array(wave) * (bright / max(wave))))
    return discs


def sun() -> Disc:
    """The sun of "sky": 0.53 degrees across, about five times the sky's horizontal irradiance."""
    centre = np.array([0.5, 0.7, 0.509901951359278])
    return Disc(centre, math.radians(0.265), np.array([1.7e5, 1.6e5, 1.4e5]))


_GLYPHS = {
    "+": (0b00000, 0b00100, 0b00100, 0b11111, 0b00100, 0b00100, 0b00000),
    "-": (0b00000, 0b00000, 0b00000, 0b11111, 0b00000, 0b00000, 0b00000),
    "X": (0b10001, 0b10001, 0b01010, 0b00100, 0b01010, 0b10001, 0b10001),
    "Y": (0b10001, 0b10001, 0b01010, 0b00100, 0b00100, 0b00100, 0b00100),
    "Z": (0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b10000, 0b11111),
}
_PAINT = {
    "+X": (0.80, 0.10, 0.10),
    "-X": (0.10, 0.65, 0.65),
    "+Y": (0.12, 0.60, 0.15),
    "-Y": (0.62, 0.15, 0.62),
    "+Z": (0.15, 0.25, 0.85),
    "-Z": (0.75, 0.65, 0.10),
}


def _axes_faces() -> Float32Array:
    # 48 x 48: colour and name; along the top the columns' direction, down the left the rows'
    grid = 48
    faces = np.empty((6, grid, grid, 3), dtype=np.float32)
    for face, (name, paint) in zip(faces, _PAINT.items(), strict=True):
        face[:] = paint
        face[:2], face[-2:], face[:, :2], face[:, -2:] = ([0.4 * c for c in paint],) * 4
        face[4:6, 4:28] = 1.0  # columns: a white bar, from the left, with a head
        for i in range(4):
            face[4 - i + 0 : 6 + i, 31 - i] = 1.0
        face[4:20, 4:6] = 0.02  # rows: a black bar, from the top, with a head
        for i in range(4):
            face[23 - i, 4 - i + 0 : 6 + i] = 0.02
        for k, letter in enumerate(name):
            bits = [[(line >> (4 - x)) & 1 for x in range(5)] for line in _GLYPHS[letter]]
            mask = np.kron(np.array(bits), np.ones((3, 3))) > 0.0
            left = 8 + 17 * k
            face[16 : 16 + 21, left : left + 15][mask] = 0.95
    return faces


def environment(name: str, size: int = 256, seed: int = 0) -> CubeMap:
    """A built-in environment as a cube map; see ``glossy.environment``."""
    _check.choice("name", name, NAMES)
    n = _check.count("size", size, high=MAX_SIZE)
    _check.count("seed", seed, low=0)
    if name == "white":
        return CubeMap(np.ones((6, n, n, 3), dtype=np.float32))
    if name == "axes":
        return CubeMap(area_resize(_axes_faces(), n))
    kind = {"spots": _SPOTS, "studio": _STUDIO, "sky": _SKY}[name]
    faces = np.empty((6, n, n, 3), dtype=np.float32)
    in_rows(_average, 6 * n, kind, _check.frozen(_frames()), math.ceil(SAMPLES / n), faces)
    for disc in {"spots": spot_discs(seed), "sky": [sun()]}.get(name, []):
        add_disc(faces, disc)
    return CubeMap(faces)
