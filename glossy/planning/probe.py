"""What candidates of a lobe do wrong under a given environment, measured on a few pictures.

The map itself is asked, not a model of it: a sphere is seen by orthographic cameras from
``CAMERAS`` directions. Such a picture shows the mirror directions evenly, 1/(4 pi) each. Half of
its points are drawn so, the others with mirror directions towards bright texels of the levels of
``SIZES``, lest a small light is missed (density q ~ squared radiance), all from a fixed seed ::

    w = 1/(4 pi) / (POINTS_EVEN/(4 pi) + POINTS_BRIGHT sum_l q_l)                             (1)

is the weight of a point. With L_j the radiance of lobe j by many importance samples and L_jk that
of its candidate k ::

    e_jk = L_jk - L_j,   G[jk, il] = sum over points and channels  w e_jk e_il                 (2)

Errors of lobes that look at the same lights add with their signs, so that the squared error of any
choice k(j) is the sum of G over its pairs; its share is of sum w (sum_j L_j)^2. G_c is the same for
the even points of camera c alone, w = 1: a small picture, which may miss the light or catch it. The
candidate that leaves a lobe out has e = -L_j.

Against the quadrature of ``reference`` the yardstick is off by less than 1 % of the RMS radiance
(``docs/planning.md``). It shares the pyramid, so that what a filter does wrong at the finest
levels is not seen.
"""

import contextlib
import dataclasses
from collections.abc import Iterator
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from .. import methods
from ..brdf import Lobe, Material
from ..cubemap import face_directions, locate
from ..frames import SurfacePoints, reflect, sphere_tangent
from ..pyramid import Pyramid
from ..shading import importance
from .model import CANDIDATES, Candidate

Float64Array = npt.NDArray[np.float64]

CAMERAS, POINTS_EVEN, POINTS_BRIGHT = 16, 64, 12
SIZES = (4, 16, 64, 256)  # of the levels whose bright texels are looked for
YARDSTICK = 2048  # importance samples
SEED = 20


def sphere_views(cameras: int, points: int, seed: int) -> SurfacePoints:
    """Points (cameras, points) of a sphere as orthographic cameras see it, evenly over the disc."""
    rng = np.random.default_rng(seed)
    v = rng.normal(size=(cameras, 1, 3))
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    x = sphere_tangent(v)
    y = np.cross(v, x)
    radius = np.sqrt((np.arange(points) + rng.random((cameras, points))) / points)
    phi = 2.0 * np.pi * rng.random((cameras, points))
    flat = (radius * np.cos(phi))[..., None] * x + (radius * np.sin(phi))[..., None] * y
    normal = flat + np.sqrt(1.0 - radius * radius)[..., None] * v
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    view = np.broadcast_to(v, normal.shape)
    return SurfacePoints(normal=normal, tangent=sphere_tangent(normal), view=view)


def texel_at(directions: Float64Array, size: int) -> tuple[npt.NDArray[np.int64], ...]:
    """Face, row and column (...) of the texels that directions (..., 3) fall into."""
    face, s, t = locate(directions)
    column, row = (np.clip((0.5 * size * (x + 1.0)).astype(np.int64), 0, size - 1) for x in (s, t))
    return face, row, column


def probe_points(pyramid: Pyramid) -> tuple[SurfacePoints, Float64Array]:
    """Points (C, P) of a probe, and their weights (C, P), eq. (1)."""
    even = sphere_views(CAMERAS, POINTS_EVEN, SEED)
    v = even.view[:, :1]
    mirrored = [reflect(even.view, even.normal)]
    rng = np.random.default_rng(SEED)
    sizes = [level.shape[1] for level in pyramid.levels]
    levels = [k for k, n in enumerate(sizes) if n in SIZES or (k == 0 and n < SIZES[-1])]
    squares = [np.sum(np.square(pyramid.levels[k], dtype=np.float64), axis=-1) for k in levels]
    bright = [(k, s / s.sum()) for k, s in zip(levels, squares, strict=True) if s.any()]
    for k, share in bright:
        pick = rng.choice(share.size, size=(CAMERAS, POINTS_BRIGHT), p=share.reshape(-1))
        face, row, column = np.unravel_index(pick, share.shape)
        s, t = (2.0 * (i + rng.random(pick.shape)) / sizes[k] - 1.0 for i in (column, row))
        mirrored.append(face_directions(face, s, t))
    r = np.concatenate(mirrored, axis=1)
    stretch = (np.linalg.norm(r, axis=-1) / np.abs(r).max(axis=-1)) ** 3
    r /= np.linalg.norm(r, axis=-1, keepdims=True)
    density = np.full(r.shape[:2], POINTS_EVEN / (4.0 * np.pi))
    for k, share in bright:
        density += POINTS_BRIGHT * share[texel_at(r, sizes[k])] * stretch * sizes[k] ** 2 / 4.0
    normal = v + r
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.where(length > 1e-6, normal / np.maximum(length, 1e-6), sphere_tangent(v))
    view = np.broadcast_to(v, normal.shape)
    points = SurfacePoints(normal=normal, tangent=sphere_tangent(normal), view=view)
    return points, 1.0 / (4.0 * np.pi) / density


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Run kernels on one thread meanwhile: calls this short would mostly wait."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def alone(lobe: Lobe, side: float) -> Material:
    """A material of one lobe: side +1 reflects, -1 transmits."""
    return Material(reflection=[lobe]) if side > 0.0 else Material(transmission=[lobe])


def candidate_options(candidate: Candidate) -> dict[str, Any]:
    """Options of a candidate's method."""
    footprint = {"footprint": "jacobian"} if candidate.method == "regular" else {}
    return {"samples": candidate.samples, **footprint}


def run_candidate(
    candidate: Candidate,
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    precision: str = "single",
) -> npt.NDArray[np.floating]:
    """Radiance (..., 3) of a material's lobes, each with the same candidate."""
    run, own = methods.resolve(candidate.method), candidate_options(candidate)
    out: npt.NDArray[np.floating] = run(points, material, pyramid, precision=precision, **own)
    return out


@dataclasses.dataclass(frozen=True, eq=False)
class Probe:
    """Eq. (2): ``gram`` (1 + C, K, K) over the candidates of all lobes, ``power`` (1 + C,).

    First over all points, then over the even ones of each camera.

    ``first`` (L + 1,): where each lobe's candidates begin; the order is that of ``CANDIDATES``.
    """

    gram: Float64Array
    power: Float64Array
    first: tuple[int, ...]

    def errors(self, choice: npt.NDArray[np.int64]) -> tuple[Float64Array, Float64Array]:
        """Relative RMS error of choices (M, L): over all cameras (M,), and of each (M, C)."""
        index = choice + np.asarray(self.first[:-1])
        square = np.zeros((len(choice), len(self.power)))
        for j in range(index.shape[1]):
            for i in range(index.shape[1]):
                square += self.gram[:, index[:, j], index[:, i]].T
        square = np.maximum(square, 0.0)
        relative = np.sqrt(square / np.maximum(self.power, np.finfo(np.float64).tiny))
        return relative[:, 0], relative[:, 1:]


def probe(material: Material, pyramid: Pyramid) -> Probe:
    """Measure every candidate of every lobe of a material."""
    with one_thread():
        return _probe(material, pyramid)


def _probe(material: Material, pyramid: Pyramid) -> Probe:
    points, weights = probe_points(pyramid)
    errors: list[Float64Array] = []
    first = [0]
    total = np.zeros((*points.shape, 3))
    for lobe, side in material.sided_lobes():
        single = alone(lobe, side)
        truth = importance(points, single, pyramid, samples=YARDSTICK).astype(np.float64)
        total += truth
        for candidate in CANDIDATES:
            if candidate.samples == 0:
                errors.append(-truth)
            else:
                errors.append(run_candidate(candidate, points, single, pyramid) - truth)
        first.append(len(errors))
    whole = np.stack(errors) * np.sqrt(weights)[..., None]
    flat = whole.reshape(len(errors), -1)
    even = np.stack(errors, axis=1)[:, :, :POINTS_EVEN].reshape(CAMERAS, len(errors), -1)
    square = np.sum(total * total, axis=-1)
    return Probe(
        gram=np.concatenate([(flat @ flat.T)[None], even @ even.transpose(0, 2, 1)]),
        power=np.concatenate([[np.sum(weights * square)], square[:, :POINTS_EVEN].sum(axis=1)]),
        first=tuple(first),
    )
