"""Planar reflectors once more, plainly: NumPy in double precision, one sample at a time."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from glossy import Lobe, Pattern
from glossy.planar import Fallback, MirrorBuffer
from glossy.planar.levels import KERNELS

Array = npt.NDArray[np.float64]


def halve(picture: Array, filter: str) -> Array:
    """One level from the one before (h, w, 4): pad by repetition, then the separable kernel."""
    half = KERNELS[filter]
    kernel = np.array([*half, *half[::-1]])
    for axis in (0, 1):
        n = picture.shape[axis]
        out = []
        for i in range(-(-n // 2)):
            at = np.clip(2 * i + 1 - len(half) + np.arange(2 * len(half)), 0, n - 1)
            out.append(np.tensordot(kernel, np.take(picture, at, axis=axis), (0, axis)))
        picture = np.stack(out, axis=axis)
    return picture


def look_up(levels: list[Any], x: float, y: float, level: float) -> Array:
    """Trilinear, edges repeated, the coverage divided out."""
    level = min(max(level, 0.0), len(levels) - 1.0)
    first = min(int(level), len(levels) - 1)
    total = np.zeros(4)
    for at, share in (
        (first, 1.0 - level + first),
        (min(first + 1, len(levels) - 1), level - first),
    ):
        h, w = levels[at].shape[:2]
        px = min(max(x / 2**at - 0.5, 0.0), w - 1.0)
        py = min(max(y / 2**at - 0.5, 0.0), h - 1.0)
        for row, b in ((int(py), 1.0 - py + int(py)), (min(int(py) + 1, h - 1), py - int(py))):
            for column, a in (
                (int(px), 1.0 - px + int(px)),
                (min(int(px) + 1, w - 1), px - int(px)),
            ):
                total += share * a * b * levels[at][row, column]
    return total[:3] / total[3] if total[3] > 0.0 else np.zeros(3)


class Twin:
    """A buffer, its levels, and the pixel of a place."""

    def __init__(self, buffer: MirrorBuffer, filter: str) -> None:
        self.buffer = buffer
        self.levels = [level.astype(np.float64) for level in buffer.pyramid(filter).levels]
        self.size = np.array([buffer.camera.width, buffer.camera.height])
        self.diagonal = float(np.hypot(*self.size))

    def pixel(self, place: Array, far: bool) -> Array | None:
        """Pixel of a place, or of a direction if ``far``; None behind the camera."""
        camera = self.buffer.camera
        v = camera.matrix @ (place if far else place - camera.position)
        return None if v[2] <= 0.0 else np.asarray(v[:2] / v[2])

    def plane(self, pixel: Array) -> tuple[Array, Array] | None:
        """Point and normal seen at a pixel, None for the sky."""
        column, row = np.clip(np.floor(pixel), 0, self.size - 1).astype(int)
        if not self.buffer.hit[row, column]:
            return None
        return self.buffer.position[row, column], self.buffer.normal[row, column]

    @staticmethod
    def meet(x: Array, w: Array, plane: tuple[Array, Array] | None) -> float | None:
        """Distance to a plane in front, None otherwise."""
        if plane is None or plane[1] @ w == 0.0:
            return None
        t = float((plane[0] - x) @ plane[1] / (plane[1] @ w))
        return t if t > 0.0 else None

    def inside(self, pixel: Array) -> bool:
        return bool(np.all((pixel >= 0.0) & (pixel < self.size)))

    def solid_angle(self, x: Array, w: Array, t: float | None, plane: Any) -> float:
        """Pixels per steradian about ``w``, by the areas it passes through."""
        camera = self.buffer.camera
        axis = camera.matrix[2]
        if t is None:
            return camera.density / float(axis @ w) ** 3
        away = x + t * w - camera.position
        r = float(np.linalg.norm(away))
        area = t * t / abs(float(plane[1] @ w))
        seen = area * abs(float(plane[1] @ away)) / r**3
        return camera.density * seen / float(axis @ away / r) ** 3

    def find(self, x: Array, w: Array, twice: bool) -> tuple[str, Array | None, Array, bool, float]:
        """(miss or "", pixel, place or direction, whether far, pixels per steradian)."""
        own = self.pixel(x, False)
        assert own is not None
        plane = self.plane(own)
        t = self.meet(x, w, plane)
        place, far = (w, True) if t is None else (x + t * w, False)
        pixel = self.pixel(place, far)
        if pixel is None:
            return "behind", None, place, far, 0.0
        if twice and self.inside(pixel):
            second = self.plane(pixel)
            t2 = self.meet(x, w, second)
            if t2 is not None or second is None:
                t, plane = t2, second
                place, far = (w, True) if t is None else (x + t * w, False)
                pixel = self.pixel(place, far)
                if pixel is None:
                    return "behind", None, place, far, 0.0
        miss = "" if self.inside(pixel) else "outside"
        return miss, pixel, place, far, self.solid_angle(x, w, t, plane)


def ellipse(twin: Twin, x: Array, frame: Array, wo: Array, borders: tuple[float, float]) -> float:
    """Pixels of the lobe's ellipse; ``frame`` (3, 3): t, b, n in rows; ``borders``: sines."""
    own = twin.pixel(x, False)
    assert own is not None
    area = math.pi
    for axis, sine in enumerate(borders):
        ends = []
        for sign in (1.0, -1.0):
            h = np.array([0.0, 0.0, math.sqrt(1.0 - sine * sine)])
            h[axis] = sign * sine
            w = (2.0 * (wo @ h) * h - wo) @ frame
            t = twin.meet(x, w, twin.plane(own))
            ends.append(twin.pixel(w if t is None else x + t * w, t is None))
        a, b = ends
        if a is not None and b is not None:
            half = 0.5 * float(np.linalg.norm(a - b))
        elif a is None and b is None:
            half = twin.diagonal
        else:
            end = a if a is not None else b
            assert end is not None
            half = float(np.linalg.norm(end - own))
        area *= min(half, twin.diagonal)
    return area


def shade(
    twin: Twin,
    x: Array,
    frame: Array,
    view: Array,
    lobe: Lobe,
    pattern: Pattern,
    estimator: str,
    level: str,
    bias: float,
    twice: bool,
    borders: tuple[float, float],
    fallback: Fallback | None,
) -> Array:
    """Radiance (3,) of one lobe at one point."""
    wo = frame @ view
    h_all = pattern.half_vectors
    n = len(h_all)
    cells = np.broadcast_to(np.asarray(pattern.cell), (n,))
    area = ellipse(twin, x, frame, wo, borders)
    top, bottom = np.zeros(3), np.zeros(3)
    d = np.exp(-((h_all[:, 0] / h_all[:, 2] / lobe.widths[0]) ** 2
                 + (h_all[:, 1] / h_all[:, 2] / lobe.widths[1]) ** 2))  # fmt: skip
    d /= math.pi * lobe.widths[0] * lobe.widths[1] * h_all[:, 2] ** 4
    for k, h in enumerate(h_all):
        wi = 2.0 * (wo @ h) * h - wo
        if wi[2] <= 0.0:
            continue
        w = wi @ frame
        miss, pixel, place, far, density = twin.find(x, w, twice)
        if miss and fallback is not None:
            toward = place if far else place - np.asarray(fallback.centre)
            size = fallback.pyramid.size
            distance = 1.0 / np.abs(w).max()
            texels = (wo @ h) * cells[k] * size**2 * distance**3
            lod = 0.5 * math.log2(texels) + bias
            light = fallback.pyramid.sample(toward, lod, precision="double")
        else:
            if pixel is None:
                pixel = twin.pixel(x, False)
                axis = twin.buffer.camera.matrix[2] @ w
                density = twin.buffer.camera.density * (1.0 / axis**3 if axis > 0.0 else math.pi)
                assert pixel is not None
            lod = {
                "none": 0.0,
                "ellipse": 0.5 * math.log2(area / n) + bias,
                "sample": 0.5 * math.log2(4.0 * (wo @ h) * cells[k] * density) + bias,
            }[level]
            px, py = np.clip(pixel, 0.0, twin.size)
            light = look_up(twin.levels, px, py, lod)
        f = np.asarray(lobe.eval(wi, wo), dtype=np.float64)
        p = d[k] * h[2] / (4.0 * (wo @ h))
        if estimator == "4.25":
            top, bottom = top + light * f * f * wi[2] ** 2 / p, bottom + f * wi[2]
        elif estimator == "4.23":
            top, bottom = top + light * f * wi[2], bottom + p
        elif estimator == "paper":
            top = top + light * f * wi[2] * 4.0 * (wo @ h) / float(d.mean())
            bottom = np.full(3, float(n))
        else:
            top, bottom = top + light * f * wi[2] / p, np.full(3, float(n))
    return np.divide(top, bottom, out=np.zeros(3), where=bottom > 0.0)
