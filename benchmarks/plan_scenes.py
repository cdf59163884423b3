"""Scenes of the planner's calibration and of its test: materials, pictures and their truth.

A scene is a map, a material and a picture: a sphere seen by a camera nobody chose, or views of up
to 80 degrees of surfaces in all directions. Everything is drawn from a seed.
"""

import dataclasses
from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

import glossy
from glossy import frames
from glossy.planning.model import CANDIDATES
from glossy.planning.probe import one_thread, probe, run_candidate, sphere_views

Float64Array = npt.NDArray[np.float64]
Row = tuple[Float64Array, Float64Array, Float64Array]
TOLERANCE = 3e-3  # of the truth's bound; its error is some hundred times less
PIXELS = 900


@dataclasses.dataclass(frozen=True)
class Scene:
    """A map by name, a material, and the points of a picture."""

    name: str
    material: glossy.Material
    points: glossy.SurfacePoints
    truth: Float64Array


def lobe(rng: np.random.Generator) -> glossy.Lobe:
    """Roughness .02 to .5 and mx/my up to 10, even in their logarithms; half are isotropic."""
    m = 0.02 * 25.0 ** rng.random()
    ratio = 10.0 ** rng.random() if rng.random() < 0.5 else 1.0
    mx, my = min(m * ratio**0.5, 0.6), max(m / ratio**0.5, 0.01)
    r0 = float(rng.choice([1.0, 0.04, 0.6]))
    return glossy.Lobe(mx, my, ks=float(rng.uniform(0.2, 1.0)), r0=r0)


def all_round(count: int, rng: np.random.Generator) -> glossy.SurfacePoints:
    """Normals in all directions, tangents of any azimuth, views of up to 80 degrees."""
    axes = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    n, t = axes[:, 0], axes[:, 1]
    theta = np.radians(80.0) * rng.random(count)
    phi = 2.0 * np.pi * rng.random(count)
    local = frames.spherical(theta, phi)
    return glossy.SurfacePoints(n, t, frames.to_world(local, t, n))


def scenes(
    maps: Mapping[str, glossy.CubeMap], count: int, seed: int, lobes: int = 1
) -> Iterator[Scene]:
    """``count`` scenes of each map."""
    for index, (name, cube) in enumerate(maps.items()):
        rng = np.random.default_rng([seed, index])
        for k in range(count):
            material = glossy.Material(reflection=[lobe(rng) for _ in range(lobes)])
            if k % 2:
                points = sphere_views(1, PIXELS, int(rng.integers(1 << 30)))
            else:
                points = all_round(PIXELS, rng)
            truth = glossy.reference(points, material, cube, tolerance=TOLERANCE).radiance
            yield Scene(name, material, points, truth)


def relative(picture: npt.ArrayLike, truth: Float64Array) -> float:
    """Relative RMS error."""
    difference = np.asarray(picture, dtype=np.float64) - truth
    return float(np.sqrt(np.mean(difference**2) / np.mean(truth**2)))


def measure(scene: Scene, pyramid: glossy.Pyramid) -> Row:
    """For each candidate of a one-lobe scene: probe's error, its cameras' (K, C), the picture's."""
    found = probe(scene.material, pyramid)
    choice = np.arange(len(CANDIDATES))[:, None]
    whole, cameras = found.errors(choice)
    with one_thread():
        true = [
            1.0
            if c.samples == 0
            else relative(run_candidate(c, scene.points, scene.material, pyramid), scene.truth)
            for c in CANDIDATES
        ]
    return whole, cameras, np.array(true)
