"""The converged mirror buffer: quasi-Monte Carlo samples blended in while the camera stands still.

Each sample is a direction w of the material's own density p, mapped into the buffer (``mapping``)
and read there unfiltered::

    L = (1/n) sum f(w) cos(w) / p(w)  L_buffer(map(w))                                      (1)

This converges, not to the truth, but to what the buffer and the mapping can say. The first tangent
plane that a sample meets is that of the point's own mirror hit (``planes="own"``), whose jumps show
as contours of perfectly mirrored things, or the mean of what the point's samples have found so far
(``"averaged"``, thesis Fig. 4.46)::

    N = normalise(sum N_k),   D = N.(mean of x_k - C')                                      (2)

over the pixels' normals N_k and places x_k; the sky has none and does not count. Before anything is
found the own plane is all there is.

Sixteen scrambled Sobol' sets take turns; their scatter gives the standard error. A point's samples
are taken one after the other, whatever passes they come in: the state after n samples is the same
to the bit.

Source: thesis sections 4.5.2 and 4.6.2. It leaves open what the sky does in (2).
"""

import dataclasses
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, row_kernel
from .._threads import in_rows
from ..brdf import Lobe, Material
from ..frames import SurfacePoints, to_local, to_world
from ..pyramid import Pyramid
from ..sampler import k_trilinear_rgb
from ..truth.random import sobol
from .levels import k_look_up
from .mapping import BEHIND, KINDS, MISSED, MappingCounts, k_map, k_own_pixel, k_pixel, k_turn
from .mirror import MirrorBuffer
from .shade import Fallback

FloatArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

PLANES = ("averaged", "own")
REPLICATES = 16
FIRST_PASS = 128  # samples; the total doubles from pass to pass
CHUNK = 1 << 18  # samples held at a time


@row_kernel
def _refine(
    begin: int,
    end: int,
    offset: Float64Array,
    direction: Float64Array,
    weight: Float64Array,
    matrix: Float64Array,
    planes: Float64Array,
    places: Float64Array,
    averaged: bool,
    twice: bool,
    picture: Float32Array,
    levels: Int64Array,
    cubed: bool,
    shift: Float64Array,
    cube: Float32Array,
    chain: Int64Array,
    stride: Scalar,
    found: Float64Array,
    total: Float64Array,
    tally: Int64Array,
) -> None:
    # offset (K, 3): P - C'; direction, weight (K, S, 3), replicates in turn;
    # places (H, W, 3): x - C';
    # shift as in ``shade``; state: found (K, 7) sums of N, x and their number, total (K, R, 3),
    # tally (K, 1 + KINDS)
    for p in range(begin, end):
        a = offset[p]
        ma = k_turn(matrix, a[0], a[1], a[2])
        row, column = k_own_pixel(ma, planes)
        first = np.empty(4)
        for i in range(4):
            first[i] = planes[row, column, i]
        for k in range(direction.shape[1]):
            if weight[p, k, 0] == 0.0 and weight[p, k, 1] == 0.0 and weight[p, k, 2] == 0.0:
                continue
            if averaged and found[p, 6] > 0.0:
                nx, ny, nz = found[p, 0], found[p, 1], found[p, 2]
                length = np.sqrt(nx * nx + ny * ny + nz * nz)
                if length > 0.0:
                    first[0], first[1], first[2] = nx / length, ny / length, nz / length
                    along = first[0] * found[p, 3] + first[1] * found[p, 4] + first[2] * found[p, 5]
                    first[3] = along / found[p, 6]
            w = (direction[p, k, 0], direction[p, k, 1], direction[p, k, 2])
            mw = k_turn(matrix, w[0], w[1], w[2])
            flags, x, y, _, s, c = k_map(w, mw, a, ma, first, planes, twice)
            tally[p, 0] += 1
            for b in range(len(KINDS)):
                tally[p, 1 + b] += (flags >> b) & 1
            if flags & MISSED != 0 and cubed:
                red, green, blue = k_trilinear_rgb(
                    s * w[0] + c * (a[0] + shift[0]),
                    s * w[1] + c * (a[1] + shift[1]),
                    s * w[2] + c * (a[2] + shift[2]),
                    0.0, cube, chain, stride, 0.0,
                )  # fmt: skip
            else:
                if flags & BEHIND != 0:
                    x, y = ma[0] / ma[2], ma[1] / ma[2]
                x = min(max(x, 0.0), float(planes.shape[1]))
                y = min(max(y, 0.0), float(planes.shape[0]))
                red, green, blue = k_look_up(x, y, 0.0, picture, levels)
                row, column = k_pixel(x, y, planes.shape[1], planes.shape[0])
                hit = planes[row, column]
                if hit[0] != 0.0 or hit[1] != 0.0 or hit[2] != 0.0:
                    for i in range(3):
                        found[p, i] += hit[i]
                        found[p, 3 + i] += places[row, column, i]
                    found[p, 6] += 1.0
            r = k % total.shape[1]
            total[p, r, 0] += weight[p, k, 0] * red
            total[p, r, 1] += weight[p, k, 1] * green
            total[p, r, 2] += weight[p, k, 2] * blue


@dataclasses.dataclass(frozen=True, eq=False)
class Refined:
    """What the buffer's samples have come to: ``radiance`` and its standard ``error`` (..., 3).

    ``samples``: of each point; ``counts``: what came in their way.
    """

    radiance: Float64Array
    error: Float64Array
    samples: int
    counts: MappingCounts


class Refinement:
    """Samples of a reflector's lobes in its mirror buffer, as they accumulate, eqs. (1) and (2).

    Parameters
    ----------
    points : SurfacePoints
        Points of the plane, with positions; ``view`` towards the camera of the mirror pass.
    material : Material, or a Lobe alone
        Its reflection lobes; kd is left out.
    buffer : MirrorBuffer
    planes : "averaged" or "own"
        The first tangent plane of a sample.
    intersections : 2 or 1, optional
        As for ``map_samples``; by default 1 with averaged planes and 2 with own ones, which comes
        closest to the truth.
    fallback : Fallback, optional
        Where missed samples are read; the buffer's edge without.
    seed : int
        A point's samples depend on it and on the point's flat index.

    Raises
    ------
    ValueError
        For points without positions, transmission lobes, or a value out of range.
    """

    def __init__(
        self,
        points: SurfacePoints,
        material: Material | Lobe,
        buffer: MirrorBuffer,
        *,
        planes: str = "averaged",
        intersections: int | None = None,
        fallback: Fallback | None = None,
        seed: int = 0,
    ) -> None:
        if isinstance(material, Lobe):
            material = Material(reflection=[material])
        if points.position is None:
            raise _check.fail("points", "must have positions for a planar reflector", None)
        if material.transmission:
            rule = "must have no transmission on a planar reflector"
            raise _check.fail("material", rule, f"{len(material.transmission)} lobes")
        self.averaged = _check.choice("planes", planes, PLANES) == "averaged"
        if intersections is None:
            intersections = 1 if self.averaged else 2
        self.twice = _check.count("intersections", intersections, low=1, high=2) == 2
        self.seed = _check.count("seed", seed, low=0, high=2**63 - 1)
        self.material = dataclasses.replace(material, kd=0.0, diffuse_transmission=0.0)
        self.points, self.buffer, self.fallback = points, buffer, fallback
        self.samples = 0
        self._seen = np.flatnonzero(points.coverage.reshape(-1))
        vectors = (points.normal, points.tangent, points.view, points.position)
        self._vectors = [v.reshape(-1, 3)[self._seen] for v in vectors]
        count = len(self._seen)
        self._found, self._total = np.zeros((count, 7)), np.zeros((count, REPLICATES, 3))
        self._tally = np.zeros((count, 1 + len(KINDS)), dtype=np.int64)

    def add(self, samples: int) -> None:
        """Take further samples of each point: at least as many, a multiple of 16."""
        step = -(-_check.count("samples", samples) // REPLICATES)
        first = self.samples // REPLICATES
        most = max(CHUNK // REPLICATES, 1)
        for start in range(first, first + step, most):
            self._take(start, min(most, first + step - start))
        self.samples += step * REPLICATES

    def _take(self, first: int, count: int) -> None:
        """Samples ``first`` to ``first + count`` of every replicate."""
        buffer, camera = self.buffer, self.buffer.camera
        spare = self.fallback
        if spare is None:
            spare = Fallback(Pyramid([np.zeros((6, 1, 1, 3), dtype=np.float32)]), np.zeros(3))
        made, f = buffer.pyramid("box"), _check.frozen
        places = f(np.where(buffer.hit[..., None], buffer.position - camera.position, 0.0))
        shift = f(camera.position - np.asarray(spare.centre, dtype=np.float64))
        cube, chain, stride = spare.pyramid.kernel_arguments
        step = max(CHUNK // (REPLICATES * count), 1)
        for start in range(0, len(self._seen), step):
            at = slice(start, start + step)
            direction, weight = self._draw(at, first, count)
            in_rows(
                _refine, len(self._vectors[3][at] - camera.position),
                f(self._vectors[3][at] - camera.position), f(direction), f(weight),
                f(camera.matrix), buffer.planes, places, self.averaged, self.twice,
                f(made.buffer), f(made.chain), self.fallback is not None, shift, cube, chain,
                stride, self._found[at], self._total[at], self._tally[at],
            )  # fmt: skip

    def _draw(self, at: slice, first: int, count: int) -> tuple[Float64Array, Float64Array]:
        """Directions and f cos / p (K, S, 3), the replicates' samples in turn."""
        normal, tangent, view = (v[at][:, None] for v in self._vectors[:3])
        xi = sobol(self.seed, self._seen[at], first, count, 2, REPLICATES)
        xi = np.swapaxes(xi, 1, 2).reshape(len(xi), -1, 2)
        wo = np.broadcast_to(to_local(view, tangent, normal), (*xi.shape[:2], 3))
        wi = np.asarray(self.material.sample(xi, wo))
        f = np.asarray(self.material.eval(wi, wo), dtype=np.float64)
        f = f[..., None] if f.ndim == 2 else f
        density = self.material.pdf(wi, wo)
        share = np.abs(wi[..., 2]) / np.where(density > 0.0, density, np.inf)
        weight = np.broadcast_to(f * share[..., None], wi.shape)
        return to_world(wi, tangent, normal), weight

    @property
    def state(self) -> Refined:
        """Where the accumulation stands; nothing is known before the first samples."""
        shape, size = self.points.shape, self.points.coverage.size
        radiance, error = np.zeros((size, 3)), np.zeros((size, 3))
        if self.samples:
            means = self._total * (REPLICATES / self.samples)
            mean = means.mean(axis=1)
            spread = np.square(means - mean[:, None]).sum(axis=1)
            radiance[self._seen] = mean
            error[self._seen] = np.sqrt(spread / (REPLICATES * (REPLICATES - 1)))
        else:
            error[self._seen] = np.inf
        whole = radiance.reshape(*shape, 3), error.reshape(*shape, 3)
        return Refined(*whole, self.samples, MappingCounts.of(self._tally))


def refine_planar(refinement: Refinement, samples: int = 4096) -> Iterator[Refined]:
    """Yield the state after each pass until every point has ``samples`` or a few more.

    The total doubles from pass to pass.
    """
    most = _check.count("samples", samples)
    goal = FIRST_PASS
    while refinement.samples < most:
        if (wanted := min(goal, most) - refinement.samples) > 0:
            refinement.add(wanted)
            yield refinement.state
        goal *= 2
