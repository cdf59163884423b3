"""Shadows of partial environment maps against rays: error and time by the number of regions.

    python benchmarks/pem_shadows.py [--quick] [--data DIR] [--picture P.png] [--json FILE]

1. How soft: RMS error of the visibility of regions, shadow maps against rays, by ``softness``.
2. Regions (their Fig. 7): relative RMS error of the pixels against the truth with ray-cast shadows,
   without and with shadow maps, and with the regions' visibility by rays; CPU time of what a
   frame makes anew.

``--data``: folder of real maps and meshes; adds the teapot (their scene) under real light.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import common
import numpy as np
import numpy.typing as npt

import glossy
from glossy import SurfacePoints
from glossy.camera import Camera
from glossy.frames import dot
from glossy.image_write import write_image
from glossy.pem import reference_occluded, region_visibility, shadow_maps
from glossy.scenes import Geometry
from glossy.scenes.shapes import Mesh, Rectangle, Sphere, Torus, Transform

Array = npt.NDArray[Any]
Scene = tuple[Geometry, Camera, glossy.CubeMap]

COUNTS = (6, 12, 24, 48, 96, 192)
SOFTNESS = (0.0, 0.02, 0.04, 0.07, 0.1, 0.2, 0.4)
LOBE = glossy.Lobe(0.1)
TIMED = 20_000  # points


def shapes() -> Geometry:
    """A ball in a ring and a ball beside it, on a ground."""
    return Geometry(
        [
            (Rectangle((6.0, 6.0)), Transform(rotation=(-90.0, 0.0, 0.0))),
            (Torus(0.9, 0.3), Transform((0.2, 0.3, 0.0))),
            (Sphere(0.55), Transform((0.2, 0.85, 0.0))),
            (Sphere(0.4), Transform((-1.2, 0.4, 0.9))),
        ]
    )


def scenes(data: str | None, size: int, width: int) -> dict[str, Scene]:
    """Scenes by name, with their cameras and environments."""
    picture = {"fov": 40.0, "width": width, "height": width * 3 // 4}
    near = Camera((2.5, 3.0, 4.5), (0.0, 0.3, 0.0), **picture)  # type: ignore[arg-type]
    found: dict[str, Scene] = {
        "shapes, built-in studio": (shapes(), near, glossy.environment("studio", size))
    }
    if data is not None:
        city, photo = (
            glossy.read_environment(f"{data}/env/{name}_1k.hdr", size)
            for name in ("potsdamer_platz", "brown_photostudio_02")
        )
        stand = Transform(rotation=(-90.0, 0.0, 0.0))
        pot = Geometry([(Mesh(f"{data}/mesh/teapot.ply"), stand)])
        above = Camera((4.0, 4.5, -6.5), (0.2, 1.4, 0.0), **picture)  # type: ignore[arg-type]
        found["shapes, city"] = (shapes(), near, city)
        found["teapot, city"] = (pot, above, city)
        found["teapot, studio"] = (pot, above, photo)
    return found


def seen(geometry: Geometry, camera: Camera) -> tuple[SurfacePoints, Array]:
    """The points that a camera's pixels see, and which pixels (H, W) see any."""
    rays = camera.rays()
    hits = geometry.intersect(camera.position, rays)
    view = -rays[hits.found]
    normal = hits.normal[hits.found]
    normal = normal + np.maximum(1e-3 - dot(normal, view), 0.0)[:, None] * view
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    points = SurfacePoints(
        normal, hits.tangent[hits.found], view, position=hits.position[hits.found]
    )
    return points, hits.found


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def seconds(run: Callable[[], Any], rounds: int) -> float:
    """Least CPU time of a call, all threads together, after a first one."""
    run()
    spent = []
    for _ in range(rounds):
        start = time.process_time()
        run()
        spent.append(time.process_time() - start)
    return min(spent)


def softness(scene: Scene, counts: tuple[int, ...], points: SurfacePoints) -> list[list[object]]:
    """Part 1: a row for each number of regions."""
    geometry, _, cube = scene
    rows: list[list[object]] = []
    for count in counts:
        cut = glossy.regions(cube, count)
        rays = region_visibility(points, geometry, cut, samples=64).share
        lights = (geometry, cut.direction, cut.solid_angle)
        errors = [
            rms(shadow_maps(*lights, softness=s, horizon=True).visibility(points) - rays)
            for s in SOFTNESS
        ]
        rows.append([count, *(f"{e:.3f}" for e in errors)])
    return rows


def by_regions(
    scene: Scene, counts: tuple[int, ...], samples: int, size: int, rounds: int
) -> tuple[list[list[object]], str]:
    """Part 2: a row for each number of regions, and the truth's own error."""
    geometry, camera, cube = scene
    points, _ = seen(geometry, camera)
    truth = reference_occluded(points, LOBE, cube, geometry, samples=samples)
    scale = rms(truth.radiance)
    many = points[np.resize(np.arange(len(points.normal)), TIMED if rounds > 1 else 100)]
    rows: list[list[object]] = []
    for count in counts:
        maps = glossy.partial_maps(cube, count)
        cut = maps.regions
        lights = (geometry, cut.direction, cut.solid_angle, size)
        shadows = shadow_maps(*lights)
        lit = shadows.visibility(points)
        rays = region_visibility(points, geometry, cut, samples=16).share
        images = {
            "none": glossy.shade(points, LOBE, maps, method="pem"),
            "maps": glossy.shade(points, LOBE, maps, method="pem", visibility=lit),
            "rays": glossy.shade(points, LOBE, maps, method="pem", visibility=rays),
        }
        errors = [rms(image - truth.radiance) / scale for image in images.values()]
        draw = seconds(lambda lights=lights: shadow_maps(*lights), rounds)  # type: ignore[misc]
        shade = seconds(
            lambda shadows=shadows, maps=maps: glossy.shade(  # type: ignore[misc]
                many, LOBE, maps, method="pem", visibility=shadows.visibility(many)
            ),
            rounds,
        )
        one = seconds(
            lambda maps=maps: glossy.shade(many, LOBE, maps, method="pem"),  # type: ignore[misc]
            rounds,
        )
        each = 1e9 / len(many.normal)
        rows.append(
            [count, *(f"{e:.3f}" for e in errors), f"{1e3 * draw:.0f}", f"{shade * each:.0f}",
             f"{one * each:.0f}", f"{shadows.nbytes / 2**20:.1f}"]
        )  # fmt: skip
    return rows, f"{rms(truth.error) / scale:.3f}"


def picture(path: str, scene: Scene, count: int, samples: int) -> None:
    """Without shadows, with shadow maps, the truth; the environment behind."""
    geometry, camera, cube = scene
    points, found = seen(geometry, camera)
    maps = glossy.partial_maps(cube, count)
    cut = maps.regions
    lit = shadow_maps(geometry, cut.direction, cut.solid_angle).visibility(points)
    images = [
        glossy.shade(points, LOBE, maps, method="pem"),
        glossy.shade(points, LOBE, maps, method="pem", visibility=lit),
        reference_occluded(points, LOBE, cube, geometry, samples=samples).radiance,
    ]
    wide = np.full((camera.height, 3 * camera.width, 3), 0.6, dtype=np.float32)
    for k, image in enumerate(images):
        wide[:, k * camera.width : (k + 1) * camera.width][found] = image
    stops = -np.log2(np.percentile(images[2], 98.0))
    write_image(path, wide, exposure=float(np.round(2.0 * stops) / 2.0))


def main() -> None:
    parser = common.arguments(__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--data", help="folder with env/ and mesh/")
    parser.add_argument("--picture", help="write the last scene's picture to this file")
    args = parser.parse_args()
    counts = (6, 24) if args.quick else COUNTS
    width, samples, size, rounds = (12, 32, 32, 1) if args.quick else (64, 512, 256, 3)
    results: dict[str, Any] = {}
    found = scenes(args.data, 16 if args.quick else 128, width)
    for name, scene in found.items():
        points, _ = seen(scene[0], scene[1])
        rng = np.random.default_rng(1)
        few = points[rng.choice(len(points.normal), min(300, len(points.normal)), False)]
        soft = softness(scene, counts[:1] if args.quick else (6, 24, 96), few)
        print(f"\n{name}: RMS error of the regions' visibility by softness\n")
        print(common.table(["regions", *map(str, SOFTNESS)], soft))
        rows, own = by_regions(scene, counts, samples, size, rounds)
        header = ["regions", "no shadows", "shadow maps", "rays", "draw ms", "shade ns a point",
                  "without ns", "MiB"]  # fmt: skip
        print(f"\n{name}: relative RMS error of the pixels (truth: {own}), time, memory\n")
        print(common.table(header, rows))
        results[name] = {"softness": soft, "regions": rows, "truth error": own}
    if args.picture:
        last = scenes(args.data, 16 if args.quick else 128, 24 if args.quick else 240)
        picture(args.picture, list(last.values())[-1], 48, 64 if args.quick else 1024)
    common.write(args.json, "pem_shadows", results)


if __name__ == "__main__":
    main()
