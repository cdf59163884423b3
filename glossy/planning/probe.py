"""What candidates of a lobe do wrong under a given environment, measured on a few pictures.

The map itself is asked, not a model of it: a sphere is seen by orthographic cameras from
``CAMERAS`` directions, ``POINTS`` points in each, drawn once from a fixed seed. With L_j the
radiance of lobe j by many importance samples and L_jk that of its candidate k ::

    e_jk = L_jk - L_j,   G_c[jk, il] = sum over points and channels of camera c  e_jk e_il     (1)

Errors of lobes that look at the same lights add with their signs, so that the squared error of any
choice k(j) in camera c is the sum of G_c over its pairs; its share is of sum (sum_j L_j)^2. The
candidate that leaves a lobe out has e = -L_j.

Against the quadrature of ``reference`` the yardstick is off by less than 1 % of the RMS radiance
(``docs/planning.md``). It shares the pyramid, so that what a filter does wrong at the finest
levels is not seen.
"""

import contextlib
import dataclasses
import functools
from collections.abc import Iterator

import numba
import numpy as np
import numpy.typing as npt

from ..brdf import Lobe, Material
from ..frames import SurfacePoints, sphere_tangent
from ..pyramid import Pyramid
from ..shading import importance, regular
from .model import CANDIDATES, Candidate

Float64Array = npt.NDArray[np.float64]

CAMERAS, POINTS = 16, 96
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


@functools.cache
def probe_points() -> SurfacePoints:
    """The points of every probe."""
    return sphere_views(CAMERAS, POINTS, SEED)


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


def run_candidate(
    candidate: Candidate,
    points: SurfacePoints,
    material: Material,
    pyramid: Pyramid,
    precision: str = "single",
) -> npt.NDArray[np.floating]:
    """Radiance (..., 3) of a material's lobes, each with the same candidate."""
    if candidate.method == "regular":
        return regular(
            points, material, pyramid, precision=precision, samples=candidate.samples,
            footprint="jacobian",
        )  # fmt: skip
    if candidate.method == "importance":
        return importance(points, material, pyramid, precision=precision, samples=candidate.samples)
    from ..lattice.shade import lattice

    return lattice(points, material, pyramid, precision=precision, samples=candidate.samples)


@dataclasses.dataclass(frozen=True, eq=False)
class Probe:
    """Eq. (1): ``gram`` (C, K, K) over the candidates of all lobes, ``power`` (C,) of the whole.

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
        least = np.finfo(np.float64).tiny
        whole = np.sqrt(square.sum(axis=1) / max(float(self.power.sum()), least))
        return whole, np.sqrt(square / np.maximum(self.power, least))


def probe(material: Material, pyramid: Pyramid) -> Probe:
    """Measure every candidate of every lobe of a material."""
    with one_thread():
        return _probe(material, pyramid)


def _probe(material: Material, pyramid: Pyramid) -> Probe:
    points = probe_points()
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
    stacked = np.stack(errors, axis=1).reshape(CAMERAS, len(errors), -1)
    return Probe(
        gram=stacked @ stacked.transpose(0, 2, 1),
        power=np.sum(total * total, axis=(1, 2)),
        first=tuple(first),
    )
