"""Light maps by baking: direct light of area lights, the environment, and diffuse bounces.

A texel's irradiance is its mean over points of the texel; from each point one ray is shot, cosine
weighted, so that ::

    E = E_lights + E_bright + pi mean(L_sky + L_emission) + mean(rho E) over what the rays hit  (1)

E_lights is Lambert's formula times the visible share (``arealight``); E_bright comes from texels of
the environment far above its mean, by rays of their own (``sun``), L_sky from the rest. What each
ray hit is kept, so a further bounce of (1) costs a gather, not rays. Rays that meet a closed object
from within say that the point lies inside it: such points do not count, and texels that are wholly
inside take the mean of their neighbours. Points and directions are scrambled Sobol numbers in four
independent sets, whose scatter gives the standard error.
"""

from collections.abc import Callable, Iterable

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from .. import _check
from .._jit import row_kernel
from .._threads import in_rows
from ..pyramid import Pyramid
from .arealight import towards
from .geometry import Geometry, Hits
from .lightmaps import Layout, LightMaps, layout, nearest_texel, surface_points
from .model import ObjectScene
from .shapes import BOX, MESH, PARTS, RECTANGLE, Rectangle
from .sun import BrightTexels, split_bright

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]
Int64Array = npt.NDArray[np.int64]
Progress = Callable[[Iterable[int]], Iterable[int]]

REPLICATES = 4
CHUNK = 1 << 18  # rays at a time
MAX_RAYS = 1 << 29
SUBTEXEL = 4  # a checker is averaged over this many points a side of a texel


@row_kernel
def _hemisphere(
    begin: int, end: int, normals: Float64Array, xi: Float64Array, out: Float64Array
) -> None:
    # (K, 3), (N, 2) -> (K, 3): cosine-weighted directions; normal k takes xi[k % N]
    for k in range(begin, end):
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        sign = np.copysign(1.0, nz)
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        i = k % xi.shape[0]
        turn = xi[i, 1] + 0.6180339887498949 * (k // xi.shape[0])  # texels turn their sets
        angle = 2.0 * np.pi * (turn - np.floor(turn))
        r, z = np.sqrt(xi[i, 0]), np.sqrt(1.0 - xi[i, 0])
        x, y = r * np.cos(angle), r * np.sin(angle)
        out[k, 0] = x * (1.0 + sign * nx * nx * a) + y * b + z * nx
        out[k, 1] = x * sign * b + y * (sign + ny * ny * a) + z * ny
        out[k, 2] = -x * sign * nx - y * ny + z * nz


@row_kernel
def _gather(
    begin: int,
    end: int,
    met: Int32Array,
    outgoing: Float64Array,
    replicates: int,
    out: Float64Array,
) -> None:
    # met (B, N): texel each ray hit or -1; outgoing (T, 3) -> out (R, B, 3): sums of replicates
    share = met.shape[1] // replicates
    for t in range(begin, end):
        for r in range(replicates):
            red, green, blue = 0.0, 0.0, 0.0
            for k in range(r * share, (r + 1) * share):
                i = met[t, k]
                if i >= 0:
                    red += outgoing[i, 0]
                    green += outgoing[i, 1]
                    blue += outgoing[i, 2]
            out[r, t, 0], out[r, t, 1], out[r, t, 2] = red, green, blue


def texel_albedo(scene: ObjectScene, geometry: Geometry, plan: Layout) -> Float64Array:
    """Diffuse reflectivity (T, 3) of every texel; checkers are averaged over it."""
    rho = np.zeros((plan.count, 3))
    for j, item in enumerate(scene.objects):
        albedo = item.albedo()
        if geometry.kinds[j] == MESH:
            start = plan.meshes[j]
            rho[start : start + len(geometry.meshes[j].vertices)] = albedo
            continue
        for start, h, w in plan.charts[plan.first[j] :][: PARTS[int(geometry.kinds[j])], :3]:
            share = 0.0
            if item.checker is not None:
                u = (np.arange(w * SUBTEXEL) + 0.5) / (w * SUBTEXEL) * item.checker.repeat[0]
                v = (np.arange(h * SUBTEXEL) + 0.5) / (h * SUBTEXEL) * item.checker.repeat[1]
                odd = (np.floor(u)[None, :] + np.floor(v)[:, None]) % 2.0
                share = odd.reshape(h, SUBTEXEL, w, SUBTEXEL).mean(axis=(1, 3)).reshape(-1, 1)
                albedo_here = share * np.asarray(item.checker.kd) + (1.0 - share) * albedo
            else:
                albedo_here = albedo
            rho[start : start + h * w] = albedo_here
    return rho


class _Texels:
    """The texels to bake, in the order of the layout: points on them, for any of them."""

    def __init__(self, scene: ObjectScene, geometry: Geometry, plan: Layout, given: set[int]):
        self.geometry = geometry
        self.rows: list[tuple[int, int, int, int, int]] = []  # object, part, first, rows, columns
        for j, item in enumerate(scene.objects):
            if j in given:
                continue
            if geometry.kinds[j] == MESH:
                self.rows.append((j, -1, plan.meshes[j], 1, len(geometry.meshes[j].vertices)))
                continue
            black = isinstance(item.shape, Rectangle) and item.shape.one_sided
            for part in range(1 if black else PARTS[int(geometry.kinds[j])]):
                start, h, w = (int(v) for v in plan.charts[plan.first[j] + part][:3])
                self.rows.append((j, part, start, h, w))

    def chunks(self, samples: int) -> list[tuple[int, int, int]]:
        """(row, first, last) of pieces of at most ``CHUNK`` rays."""
        step = max(CHUNK // samples, 1)
        out = []
        for k, (_, _, _, h, w) in enumerate(self.rows):
            out += [(k, a, min(a + step, h * w)) for a in range(0, h * w, step)]
        return out

    def points(
        self, row: int, first: int, last: int, xi: Float64Array
    ) -> tuple[Float64Array, Float64Array]:
        """Points and normals ((last - first) * N, 3), N points in each texel at ``xi`` (N, 2)."""
        j, part, _, h, w = self.rows[row]
        index = np.arange(first, last)
        if part < 0:
            mesh = self.geometry.meshes[j]
            both = (mesh.vertices[index], mesh.normals[index])
            point, normal = (np.repeat(a, len(xi), axis=0) for a in both)
            return point, normal
        if self.geometry.kinds[j] in (BOX, RECTANGLE):  # flat: three corners say it all
            corners, up = surface_points(
                self.geometry, j, part, *np.array([[0, 1, 0], [0, 0, 1.0]])
            )
            steps = (corners[1] - corners[0]) / w, (corners[2] - corners[0]) / h
            origin = corners[0] + (index % w)[:, None] * steps[0] + (index // w)[:, None] * steps[1]
            inside = xi[:, :1] * steps[0] + xi[:, 1:] * steps[1]
            point = (origin[:, None] + inside).reshape(-1, 3)
            return point, np.broadcast_to(up[0], point.shape)
        u = ((index % w)[:, None] + xi[:, 0]) / w
        v = ((index // w)[:, None] + xi[:, 1]) / h
        point, normal = surface_points(self.geometry, j, part, u, v)
        return point.reshape(-1, 3), normal.reshape(-1, 3)


def _fill(values: Float64Array, good: npt.NDArray[np.bool_], h: int, w: int, wraps: bool) -> None:
    """Give texels that are not ``good`` the mean of their good neighbours, ring by ring."""
    grid, known = values.reshape(h, w, 3), good.reshape(h, w).copy()
    while not known.all() and known.any():
        total, count = np.zeros((h, w, 3)), np.zeros((h, w))
        for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            move = np.roll(known, (dy, dx), (0, 1))
            value = np.roll(grid, (dy, dx), (0, 1))
            if not wraps:  # what came round the edge is no neighbour
                edge = move.T if dx else move
                edge[0 if (dx or dy) > 0 else -1] = False
            total += np.where(move[..., None], value, 0.0)
            count += move
        new = ~known & (count > 0)
        grid[new] = total[new] / count[new][:, None]
        known |= new


def _numbers(samples: int) -> Float64Array:
    """(N, 6): ``REPLICATES`` independent scrambles of the Sobol set, one after the other."""
    share = samples // REPLICATES
    parts = [qmc.Sobol(6, scramble=True, rng=seed).random(share) for seed in range(REPLICATES)]
    return np.concatenate(parts)


def _remapped(hits: Hits, index: Int64Array) -> Hits:
    """Hits with objects renumbered by ``index``."""
    fields = (hits.distance, hits.position, hits.normal, hits.tangent, hits.uv, hits.part)
    return Hits(np.where(hits.found, index[hits.object], -1), *fields, hits.front)


def _given_maps(scene: ObjectScene, geometry: Geometry) -> dict[int, list[Float32Array]]:
    """The light maps that come as images: one array (h, w, 3) for each part."""
    from ..image import read_image

    maps = {}
    for j, item in enumerate(scene.objects):
        if item.light_map is None:
            continue
        where = f"objects[{j}].light_map"
        if geometry.kinds[j] == MESH:
            raise _check.fail(where, "is for shapes with a chart, not for a mesh", item.light_map)
        pixels = read_image(item.light_map, window="display").rgb(item.light_map)
        parts = PARTS[int(geometry.kinds[j])]
        if parts == 6 and pixels.shape[1] % 6:
            raise _check.fail(where, "must have six faces side by side", pixels.shape)
        pieces = np.split(pixels, 6, axis=1) if parts == 6 else [pixels] * parts
        if not np.all(np.isfinite(pixels)) or np.any(pixels < 0.0):
            raise _check.fail(where, "must be finite and not negative", item.light_map)
        maps[j] = [np.ascontiguousarray(p, dtype=np.float32) for p in pieces]
    return maps


def bake(
    scene: ObjectScene,
    geometry: Geometry,
    sky: Pyramid | None,
    progress: Progress | None = None,
) -> LightMaps:
    """Light maps of all objects, eq. (1), with the settings of ``scene.bake``.

    Parameters
    ----------
    geometry : Geometry
        Of the scene's objects, then its lights.
    sky : Pyramid, optional
        The environment, scaled; read at the level of a ray's share of the hemisphere.
    progress : callable, optional
        Wraps the loop over pieces of work (``tqdm`` for instance).

    Raises
    ------
    ValueError
        If there are too many texels or rays for memory, or a given image does not fit.
    """
    maps = _given_maps(scene, geometry)
    texel = scene.bake.texel or max(geometry.diagonal / 150.0, 1e-9)
    sides = {j: [(p.shape[0], p.shape[1]) for p in parts] for j, parts in maps.items()}
    plan = layout(geometry, texel, sides)
    values = np.zeros((plan.count, 3))
    for j, parts in maps.items():
        for k, piece in enumerate(parts):
            start = plan.charts[plan.first[j] + k, 0]
            values[start : start + piece.shape[0] * piece.shape[1]] = piece.reshape(-1, 3)
    texels = _Texels(scene, geometry, plan, set(maps))
    samples = scene.bake.samples
    where = np.concatenate(
        [np.arange(start, start + h * w) for _, _, start, h, w in texels.rows] or [np.arange(0)]
    )
    if len(where) * samples > MAX_RAYS:
        rule = f"must give at most {MAX_RAYS} rays with samples"
        raise _check.fail("bake.texel", rule, f"{len(where)} x {samples}")
    first_light = _FirstLight(scene, geometry, plan, sky, samples)
    total = np.zeros((REPLICATES, len(where), 3))
    count = np.zeros((REPLICATES, len(where)))
    met = np.full((len(where), samples), -1, dtype=np.int32)
    starts = np.cumsum([0, *(h * w for *_, h, w in texels.rows)])
    work = texels.chunks(samples)
    for k in (progress or iter)(range(len(work))):
        row, first, last = work[k]
        here = slice(starts[row] + first, starts[row] + last)
        points, normals = texels.points(row, first, last, first_light.numbers[:, :2])
        total[:, here], count[:, here], met[here] = first_light(points, normals)
    error = 0.0
    good = count.sum(axis=0) > 0.0
    rho = texel_albedo(scene, geometry, plan)
    sums = np.zeros_like(total)
    for _ in range(scene.bake.bounces + 1):
        mean = (total + sums).sum(axis=0) / np.maximum(count.sum(axis=0), 1.0)[:, None]
        for (j, part, _, h, w), a, b in zip(texels.rows, starts[:-1], starts[1:], strict=True):
            if part >= 0:
                wraps = bool(plan.charts[plan.first[j] + part, 3])
                _fill(mean[a:b], good[a:b], h, w, wraps)
        values[where] = mean
        in_rows(
            _gather,
            len(met),
            _check.frozen(met),
            _check.frozen(rho * values),
            REPLICATES,
            sums,
            grain=256,
        )
    if len(where) and values[where].any():
        each = (total + sums) / np.maximum(count, 1.0)[..., None]
        spread = each[:, good].var(axis=0, ddof=1) / REPLICATES
        error = float(np.sqrt(spread.mean() / np.mean(np.square(values[where]))))
    if not (values <= np.finfo(np.float32).max).all():
        rule = "must be within single precision"
        raise _check.fail("light maps", rule, float(np.max(values)))
    return LightMaps(scene, geometry, plan, values.astype(np.float32), error)


class _FirstLight:
    """What arrives at points without a bounce, and which texels their rays meet."""

    def __init__(
        self,
        scene: ObjectScene,
        geometry: Geometry,
        plan: Layout,
        sky: Pyramid | None,
        samples: int,
    ) -> None:
        self.scene, self.geometry, self.plan = scene, geometry, plan
        self.sky: Pyramid | None = None
        self.bright: BrightTexels | None = None
        if sky is not None:
            self.sky, self.bright = split_bright(sky)
        self.numbers = _numbers(samples)
        casting = [j for j, item in enumerate(scene.objects) if item.casts_shadow]
        placed = [(scene.objects[j].shape, scene.objects[j].transform) for j in casting]
        placed += [(Rectangle(light.size), light.transform) for light in scene.lights]
        self.world = Geometry(placed)
        lights = np.arange(len(scene.lights)) + len(scene.objects)
        self.index = np.array([*casting, *lights], dtype=np.int64)
        closed = [self.world.closed(k) for k in range(len(placed))]
        self.closed = np.array([*closed, False])
        self.glow = np.zeros((len(scene.objects) + len(scene.lights) + 1, 3))
        self.glow[: len(scene.objects)] = [o.emission for o in scene.objects]

    def __call__(
        self, points: Float64Array, normals: Float64Array
    ) -> tuple[Float64Array, Float64Array, Int32Array]:
        """Sums (R, B, 3) and counts (R, B) by replicate, and what was met (B, N)."""
        n = len(self.numbers)
        start = points + self.geometry.offset * normals
        along = np.empty_like(start)
        in_rows(
            _hemisphere,
            len(normals),
            _check.frozen(normals),
            _check.frozen(self.numbers[:, 2:4]),
            along,
            grain=512,
        )
        hits = self.world.cast(_check.frozen(start), _check.frozen(along))
        inside = self.closed[hits.object] & ~hits.front & hits.found
        hits = _remapped(hits, self.index)
        value = np.zeros_like(start)
        if self.glow.any():
            value += np.pi * self.glow[hits.object]
        if self.sky is not None:
            free = ~hits.found
            share = 2.0 * np.pi / n * (6.0 * self.sky.size**2) / (4.0 * np.pi)  # texels a ray
            level = max(0.5 * np.log2(share), 0.0)
            value[free] += np.pi * self.sky.sample(along[free], level)
        texel = nearest_texel(self.geometry, self.plan, hits, len(self.scene.objects))
        texel[inside] = -1
        value[inside] = 0.0
        value = value.reshape(-1, n, 3)
        valid = ~inside.reshape(-1, n)
        parts = self._by_replicate(value), self._by_replicate(valid[..., None])[..., 0]
        direct = self._direct(start, normals, valid)
        direct += self._sun(start, normals, valid)
        return parts[0] + direct, parts[1], texel.reshape(-1, n).astype(np.int32)

    @staticmethod
    def _by_replicate(value: npt.NDArray[np.generic]) -> Float64Array:
        """(B, N, C) -> sums (R, B, C)."""
        b, n, c = value.shape
        grouped = value.reshape(b, REPLICATES, n // REPLICATES, c).sum(axis=2, dtype=np.float64)
        return np.moveaxis(grouped, 1, 0)

    def _direct(
        self, start: Float64Array, normals: Float64Array, valid: npt.NDArray[np.bool_]
    ) -> Float64Array:
        """Sums (R, B, 3) of the lights: eq. (2) of ``arealight`` over each replicate."""
        b, n = valid.shape
        out = np.zeros((REPLICATES, b, 3))
        for light in self.scene.lights:
            along, distance, weight, whole = towards(
                start, normals, light.corners(), self.numbers[:, 4:6]
            )
            seen = np.zeros(len(start), dtype=bool)
            ask = np.flatnonzero((weight > 0.0) & valid.reshape(-1))
            far = distance[ask] - 2.0 * self.geometry.offset
            seen[ask] = ~self.world.blocked(
                _check.frozen(start[ask]), _check.frozen(along[ask]), far
            )
            weight = np.where(valid, weight.reshape(b, n), 0.0)
            total = self._by_replicate(weight[..., None])[..., 0]
            clear = self._by_replicate((weight * seen.reshape(b, n))[..., None])[..., 0]
            whole_sum = self._by_replicate((whole.reshape(b, n) * valid)[..., None])[..., 0]
            share = np.divide(clear, total, out=np.zeros_like(clear), where=total > 0.0)
            out += (whole_sum * share)[..., None] * np.asarray(light.radiance)
        return out

    def _sun(
        self, start: Float64Array, normals: Float64Array, valid: npt.NDArray[np.bool_]
    ) -> Float64Array:
        """Sums (R, B, 3) of the bright texels of the environment, eq. (2) of ``sun``."""
        b, n = valid.shape
        if self.bright is None:
            return np.zeros((REPLICATES, b, 3))
        directions, radiance = self.bright.sample(self.numbers[:, 4:6])
        along = np.broadcast_to(directions, (b, n, 3)).reshape(-1, 3)
        cosine = np.sum(along * normals, axis=-1)
        ask = np.flatnonzero((cosine > 0.0) & valid.reshape(-1))
        clear = ~self.world.blocked(_check.frozen(start[ask]), _check.frozen(along[ask]))
        weight = np.zeros(b * n)
        weight[ask] = cosine[ask] * clear
        return self._by_replicate(weight.reshape(b, n, 1) * radiance)
