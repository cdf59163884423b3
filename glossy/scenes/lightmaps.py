"""Light maps: irradiance over the surfaces of a scene, and the radiance that leaves them.

An analytic shape has one grid of texels for each of its parts (``shapes``), read bilinearly; grids
that close on themselves wrap. A mesh has one texel at each vertex, read by barycentric weights.
What
leaves a diffuse surface is ::

    L = emission + rho / pi * E(x)                                            (thesis eq. 4.1)
"""

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows
from ..frames import normalise
from .geometry import Geometry, Hits
from .model import ObjectScene
from .shapes import BOX, MESH, RECTANGLE, SPHERE, TORUS

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

MAX_SIDE = 512
MAX_TEXELS = 4_000_000
WRAPS = {SPHERE: (1, 0), TORUS: (1, 1), BOX: (0, 0), RECTANGLE: (0, 0)}


@dataclasses.dataclass(frozen=True)
class Layout:
    """Where each surface's texels are in one flat array of ``count``.

    ``first`` (M,): an object's first chart; ``charts`` (C, 5): first texel, rows, columns, and
    whether columns and rows wrap; ``meshes``: an object's first vertex in the array.
    """

    first: Int64Array
    charts: Int64Array
    meshes: dict[int, int]
    count: int


def grid_lengths(geometry: Geometry, index: int) -> list[tuple[float, float]]:
    """Lengths in the world along u and v of each part of an analytic shape."""
    x, y, z = (float(v) for v in np.linalg.norm(geometry.forwards[index][:, :3], axis=0))
    kind = int(geometry.kinds[index])
    if kind == BOX:
        return [(2 * z, 2 * y)] * 2 + [(2 * x, 2 * z)] * 2 + [(2 * x, 2 * y)] * 2
    if kind == RECTANGLE:
        return [(2 * x, 2 * y)] * 2
    if kind == SPHERE:
        return [(2.0 * math.pi * max(x, z), math.pi * max(x, y, z))]
    tube = 2.0 * math.pi * float(geometry.ratios[index]) * max(x, y, z)
    return [(2.0 * math.pi * max(x, z), tube)]


def _side(texels: float, low: int) -> int:
    return min(max(math.ceil(texels), low), MAX_SIDE)


def layout(geometry: Geometry, texel: float, sides: dict[int, list[tuple[int, int]]]) -> Layout:
    """Charts with texels ``texel`` apart; ``sides`` fixes (rows, columns) of some objects' parts.

    Raises
    ------
    ValueError
        If that takes more than ``MAX_TEXELS``.
    """
    first: list[int] = []
    charts: list[list[int]] = []
    meshes: dict[int, int] = {}
    count = 0
    for j, kind in enumerate(geometry.kinds):
        first.append(len(charts))
        if kind == MESH:
            meshes[j] = count
            count += len(geometry.meshes[j].vertices)
            continue
        low = 8 if kind in (SPHERE, TORUS) else 2
        parts = sides.get(j) or [
            (_side(v / texel, low), _side(u / texel, low)) for u, v in grid_lengths(geometry, j)
        ]
        for rows, columns in parts:
            charts.append([count, rows, columns, *WRAPS[int(kind)]])
            count += rows * columns
    if count > MAX_TEXELS:
        raise _check.fail("bake.texel", f"must give at most {MAX_TEXELS} texels", f"{count}")
    table = np.array(charts, dtype=np.int64).reshape(-1, 5)
    return Layout(np.array(first, dtype=np.int64), table, meshes, count)


def chart_points(
    kind: int, part: int, ratio: float, u: Float64Array, v: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Local point and normal (..., 3) of a unit shape at (u, v) of a part: the inverse of hits."""
    u, v = np.broadcast_arrays(u, v)
    if kind == BOX:
        from ..cubemap import face_directions

        point = face_directions(np.intp(part), 2.0 * u - 1.0, 2.0 * v - 1.0)
        normal = face_directions(np.intp(part), 0.0 * u, 0.0 * v)
        return point, normal
    zero, one = np.zeros_like(u), np.ones_like(u)
    if kind == RECTANGLE:
        side = one if part == 0 else -one
        return np.stack([2.0 * u - 1.0, 1.0 - 2.0 * v, zero], -1), np.stack([zero, zero, side], -1)
    around = np.stack([np.sin(2.0 * np.pi * u), zero, -np.cos(2.0 * np.pi * u)], axis=-1)
    if kind == SPHERE:
        up = np.stack([zero, np.cos(np.pi * v), zero], axis=-1)
        point = np.sin(np.pi * v)[..., None] * around + up
        return point, point
    normal = np.cos(2.0 * np.pi * v)[..., None] * around
    normal = normal + np.stack([zero, np.sin(2.0 * np.pi * v), zero], axis=-1)
    return around + ratio * normal, normal


@kernel
def _corners(position: Scalar, size: Scalar, wraps: Scalar) -> tuple[int, int, Scalar]:
    """The two texels about a coordinate in [0, 1], and the second one's weight."""
    p = position * size - 0.5
    low = math.floor(p)
    weight = p - low
    if wraps:
        return low % size, (low + 1) % size, weight
    return max(low, 0), min(low + 1, size - 1), weight


@row_kernel
def _leaving(
    begin: int,
    end: int,
    found: Int64Array,
    part: Int64Array,
    uv: Float64Array,
    kinds: Int64Array,
    first: Int64Array,
    charts: Int64Array,
    values: Float32Array,
    factor: Float64Array,
    glow: Float64Array,
    checkers: Float64Array,
    out: Float64Array,
) -> None:
    # (K,), (K,), (K, 2), (M,), (M,), (C, 5), (T, 3), factor and glow (O, 3), checkers (O, 5):
    # repeats (0 for none) and its factor -> glow + factor E (K, 3); meshes and misses are left
    for k in range(begin, end):
        j = found[k]
        if j < 0 or j >= factor.shape[0] or kinds[j] == MESH:
            continue
        c = charts[first[j] + part[k]]
        col0, col1, a = _corners(uv[k, 0], c[2], c[3])
        row0, row1, b = _corners(uv[k, 1], c[1], c[4])
        base = c[0]
        odd = False
        if checkers[j, 0] > 0.0:
            cells = math.floor(uv[k, 0] * checkers[j, 0]) + math.floor(uv[k, 1] * checkers[j, 1])
            odd = cells % 2 == 1
        for x in range(3):
            top = values[base + row0 * c[2] + col0, x] * (1.0 - a)
            top += values[base + row0 * c[2] + col1, x] * a
            low = values[base + row1 * c[2] + col0, x] * (1.0 - a)
            low += values[base + row1 * c[2] + col1, x] * a
            share = checkers[j, 2 + x] if odd else factor[j, x]
            out[k, x] = glow[j, x] + share * (top * (1.0 - b) + low * b)


@row_kernel
def _nearest(
    begin: int,
    end: int,
    found: Int64Array,
    part: Int64Array,
    uv: Float64Array,
    kinds: Int64Array,
    first: Int64Array,
    charts: Int64Array,
    objects: int,
    out: Int64Array,
) -> None:
    # texel (K,) nearest to each hit on one of the first ``objects``, -1 elsewhere and on meshes
    for k in range(begin, end):
        j = found[k]
        out[k] = -1
        if j >= 0 and j < objects and kinds[j] != MESH:
            c = charts[first[j] + part[k]]
            col = min(int(uv[k, 0] * c[2]), c[2] - 1)
            row = min(int(uv[k, 1] * c[1]), c[1] - 1)
            out[k] = c[0] + row * c[2] + col


def nearest_texel(geometry: Geometry, plan: Layout, hits: Hits, objects: int) -> Int64Array:
    """Index (K,) of the texel nearest to each hit on the first ``objects``, else -1."""
    out = np.empty(len(hits.object), dtype=np.int64)
    f = _check.frozen
    in_rows(
        _nearest, len(hits.object), f(hits.object), f(hits.part), f(hits.uv), f(geometry.kinds),
        f(plan.first), f(plan.charts),
        objects, out, grain=512,
    )  # fmt: skip
    for j, start in plan.meshes.items():
        on = np.flatnonzero(hits.object == j)
        uv = hits.uv[on]
        weights = np.column_stack([1.0 - uv.sum(axis=-1), uv])
        corner = geometry.meshes[j].triangles[hits.part[on], np.argmax(weights, axis=1)]
        out[on] = start + corner
    return out


class LightMaps:
    """Irradiance of a scene's objects: ``values`` (T, 3) float32 in the order of ``plan``.

    ``error``: relative RMS standard error over the baked texels, 0 if there were none.
    """

    def __init__(
        self,
        scene: ObjectScene,
        geometry: Geometry,
        plan: Layout,
        values: Float32Array,
        error: float = 0.0,
    ) -> None:
        self.scene, self.geometry, self.plan = scene, geometry, plan
        self.values: Float32Array = np.ascontiguousarray(values, dtype=np.float32)
        self.error = error
        self._albedo = np.array([o.albedo() for o in scene.objects]).reshape(-1, 3)
        self._kd = np.array([o.material.diffuse for o in scene.objects]).reshape(-1, 3)
        self._emission = np.array([o.emission for o in scene.objects]).reshape(-1, 3)
        self._checkers = np.zeros((len(scene.objects), 5))
        for j, item in enumerate(scene.objects):
            if item.checker is not None:
                self._checkers[j, :2] = item.checker.repeat
                self._checkers[j, 2:] = np.asarray(item.checker.kd) / np.pi

    def _evaluate(self, hits: Hits, factor: Float64Array, glow: bool) -> Float64Array:
        """Glow + factor E at hits on objects (..., 3), checkers laid over; 0 elsewhere."""
        shape = hits.object.shape
        found, part = hits.object.reshape(-1), hits.part.reshape(-1)
        uv = hits.uv.reshape(-1, 2)
        out = np.zeros((found.size, 3))
        emission = self._emission if glow else np.zeros_like(self._emission)
        checkers = self._checkers if glow else np.zeros_like(self._checkers)
        f = _check.frozen
        in_rows(
            _leaving, len(found), f(found), f(part), f(uv), f(self.geometry.kinds),
            f(self.plan.first), f(self.plan.charts), f(self.values), f(factor), f(emission),
            f(checkers), out, grain=512,
        )  # fmt: skip
        for j, start in self.plan.meshes.items():
            on = np.flatnonzero(found == j)
            corners = self.values[start + self.geometry.meshes[j].triangles[part[on]]]
            weights = np.column_stack([1.0 - uv[on].sum(axis=-1), uv[on]])
            out[on] = emission[j] + factor[j] * np.einsum("kc,kcx->kx", weights, corners)
        return out.reshape(*shape, 3)

    def irradiance(self, hits: Hits) -> Float64Array:
        """Irradiance (..., 3) at hits on objects; 0 elsewhere."""
        return self._evaluate(hits, np.ones_like(self._albedo), glow=False)

    def radiance(self, hits: Hits) -> Float64Array:
        """What leaves the diffuse world at hits on objects, (..., 3); 0 elsewhere."""
        return self._evaluate(hits, self._albedo / np.pi, glow=True)

    def diffuse(self, hits: Hits) -> Float64Array:
        """The same with the diffuse terms of the materials alone, without what lobes reflect."""
        return self._evaluate(hits, self._kd / np.pi, glow=True)

    def below(self, hits: Hits) -> Float64Array:
        """Irradiance (..., 3) on the other side of the rectangles that were hit."""
        return self.irradiance(dataclasses.replace(hits, part=1 - hits.part))


def surface_points(
    geometry: Geometry, index: int, part: int, u: Float64Array, v: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """World point and unit normal (..., 3) at (u, v) of a part of an analytic object."""
    kind, ratio = int(geometry.kinds[index]), float(geometry.ratios[index])
    point, normal = chart_points(kind, part, ratio, u, v)
    forward, back = geometry.forwards[index], geometry.inverses[index]
    return point @ forward[:, :3].T + forward[:, 3], normalise(normal @ back[:, :3])
