"""Plain twins of the ground truth: midpoint sums in float64 NumPy, no adaptivity.

Two coordinates, each sharp where the other is blunt: texels cut into equal cells (any lobe wider
than a cell), and slopes of the half vector (any radiance smoother than a cell there).
"""

import numpy as np
import numpy.typing as npt

from glossy import CubeMap, Lobe, Material, SurfacePoints
from glossy.cubemap import face_directions
from glossy.frames import reflect, to_local, to_world

Array = npt.NDArray[np.float64]
RADIUS = 6.5  # exp(-RADIUS^2) is 4e-19


def unit(v: npt.ArrayLike) -> Array:
    a = np.asarray(v, dtype=np.float64)
    return np.asarray(a / np.linalg.norm(a, axis=-1, keepdims=True))


def point(seed: int, cos_o: float) -> SurfacePoints:
    """A surface point of random orientation seen at a given cosine."""
    rng = np.random.default_rng(seed)
    n = unit(rng.normal(size=3))
    t = unit(np.cross(n, rng.normal(size=3)))
    phi = rng.uniform(0.0, 2.0 * np.pi)
    side = np.cos(phi) * t + np.sin(phi) * np.cross(n, t)
    return SurfacePoints(n, t, np.sqrt(1.0 - cos_o**2) * side + cos_o * n)


def points(seed: int, count: int, lowest: float = 0.05) -> SurfacePoints:
    """Random surface points, (count,)."""
    rng = np.random.default_rng(seed)
    all_ = [point(int(rng.integers(2**31)), rng.uniform(lowest, 1.0)) for _ in range(count)]
    parts = [np.stack([getattr(p, k) for p in all_]) for k in ("normal", "tangent", "view")]
    return SurfacePoints(*parts)


def over_texels(p: SurfacePoints, material: Material, cube: CubeMap, cells: int) -> Array:
    """Sum over ``cells`` by ``cells`` equal cells of every face, (3,)."""
    c = (np.arange(cells) + 0.5) * (2.0 / cells) - 1.0
    s, t = np.meshgrid(c, c)
    area = (2.0 / cells) ** 2 * (1.0 + s**2 + t**2) ** -1.5
    total = np.zeros(3)
    for face in range(6):
        d = unit(face_directions(face, s, t))
        local = to_local(d, p.tangent, p.normal)
        f = material.eval(local, np.broadcast_to(p.local_view, local.shape))
        f = f[..., None] if f.ndim == 2 else f
        weight = f * (area * np.abs(local[..., 2]))[..., None]
        total += np.sum(cube.lookup(d) * weight, axis=(0, 1))
    return total


def over_slopes(
    p: SurfacePoints, lobe: Lobe, cube: CubeMap, cells: int, side: float = 1.0
) -> Array:
    """Sum over ``cells`` by ``cells`` half-vector slopes within 6.5 lobe widths, (3,)."""
    material = Material(reflection=[lobe]) if side > 0.0 else Material(transmission=[lobe])
    mx, my = lobe.widths
    wo = p.local_view
    mirror = np.array([1.0, 1.0, side])
    x = (np.arange(cells) + 0.5) * (2.0 * RADIUS / cells) - RADIUS
    total = np.zeros(3)
    for part in np.array_split(x, max(1, cells // 128)):
        a, b = np.meshgrid(part, x, indexing="ij")
        h = np.stack([a * mx, b * my, np.ones_like(a)], axis=-1)
        square = np.sum(h**2, axis=-1)
        h /= np.sqrt(square)[..., None]
        u = h @ wo
        wi = reflect(np.broadcast_to(wo, h.shape), h)
        good = (u > 0.0) & (wi[..., 2] > 0.0)
        wi, u, square = unit(wi[good]), u[good], square[good]
        f = material.eval(wi * mirror, np.broadcast_to(wo, wi.shape))
        f = f[..., None] if f.ndim == 1 else f
        area = mx * my * (2.0 * RADIUS / cells) ** 2 * square**-1.5
        light = cube.lookup(to_world(wi * mirror, p.tangent, p.normal))
        total += np.sum(light * f * (4.0 * u * wi[:, 2] * area)[:, None], axis=0)
    return total
