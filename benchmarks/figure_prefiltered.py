"""Prefiltered maps against per-pixel filtering: the pictures of the source's Figs. 15 to 18.

Ward's model (kd = 0, ks = 0.8, alpha = 0.04) on a mesh or a sphere: the true reflection (the BRDF
integrated for every pixel), three lobes, one lobe for each elevation, one shape for all. Prints the
relative RMS errors over the object, and those of a Kurt lobe of the same roughness.

    python benchmarks/figure_prefiltered.py --mesh teapot.ply --env room.hdr \
        [--picture docs/images/prefiltered.png]
"""

import argparse
from typing import Any

import numpy as np

import glossy
from glossy.image_write import write_image
from glossy.prefiltered.approximate import approximate
from glossy.prefiltered.shade import prefiltered
from glossy.prefiltered.ward import Ward
from glossy.scene import EnvironmentSource, Sphere, default_camera
from glossy.scenes.geometry import Geometry
from glossy.scenes.shapes import Mesh, Transform

MODES: dict[str, dict[str, Any]] = {
    "three lobes": {"mode": "multi", "lobes": 3},
    "three lobes, refit": {"mode": "multi", "lobes": 3, "finish": "refit"},
    "one lobe": {"mode": "single"},
    "one shape": {"mode": "flat"},
}
UPRIGHT = (-90.0, 0.0, 0.0)  # meshes with z up
SHOWN = ("three lobes", "one lobe", "one shape")


def mesh_points(file: str, camera: Any) -> glossy.SurfacePoints:
    """What a camera sees of a mesh, normals bent to face it."""
    rays = camera.rays()
    flat = np.ascontiguousarray(rays.reshape(-1, 3))
    eye = np.broadcast_to(np.asarray(camera.position, float), flat.shape)
    hits = Geometry([(Mesh(file), Transform(rotation=UPRIGHT))]).cast(
        np.ascontiguousarray(eye), flat
    )
    normal, view = hits.normal.copy(), -flat
    below = np.minimum(np.sum(normal * view, axis=1) - 0.02, 0.0)
    normal -= below[:, None] * view
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal /= np.where(length > 0.0, length, 1.0)
    normal[~hits.found] = view[~hits.found]
    shape = rays.shape
    return glossy.SurfacePoints(
        normal.reshape(shape), None, view.reshape(shape), mask=hits.found.reshape(shape[:-1])
    )


def main() -> None:
    """Print the errors and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--picture", metavar="P.png")
    parser.add_argument("--mesh", metavar="FILE", help="a sphere if not given")
    parser.add_argument("--env", default="studio", help="a built-in name or a file")
    parser.add_argument("--size", type=int, default=128, help="of the cube map and the slices")
    parser.add_argument("--pixels", type=int, default=180)
    parser.add_argument("--samples", type=int, default=512, help="of the truth")
    args = parser.parse_args()
    cube = EnvironmentSource(args.env, args.size).load()
    if args.mesh:
        around = glossy.Camera(
            (2.0, 3.6, 5.4),
            (0.2, 1.45, 0.0),
            fov=38.0,
            width=args.pixels,
            height=args.pixels * 2 // 3,
        )
        whole = mesh_points(args.mesh, around)
    else:
        whole = glossy.surface_points(default_camera(Sphere(), args.pixels, args.pixels), Sphere())
    seen = whole.coverage
    p = whole[seen]
    kurt = glossy.Material(reflection=[glossy.Lobe(0.04, ks=0.8)])
    ward = Ward(kd=0.0, ks=0.8, alpha=0.04)
    panels: list[Any] = []
    contenders: tuple[tuple[str, Any, str, dict[str, Any]], ...] = (
        ("Ward", ward, "qmc", {"samples": args.samples}),
        ("Kurt", kurt, "texels", {}),
    )
    for name, material, estimator, options in contenders:
        truth = glossy.reference(p, material, cube, estimator, **options)
        level = np.sqrt(np.mean(truth.radiance**2))
        own = np.sqrt(np.mean(truth.error**2)) / level
        print(f"{name}: {len(p.normal)} pixels, error of the truth {own:.4f} ({truth.error_kind})")
        if name == "Ward":
            panels.append(truth.radiance)
        for mode, how in MODES.items():
            maps = glossy.prefilter(cube, approximate(material, **how), args.size)
            image = prefiltered(p, kurt, maps)
            error = np.sqrt(np.mean((image - truth.radiance) ** 2)) / level
            print(f"  {mode:<20} {error:.3f}   {maps.nbytes / 1e6:.0f} MB", flush=True)
            if name == "Ward" and mode in SHOWN:
                panels.append(image)
    if args.picture:
        rows = []
        for colours in panels:
            canvas = np.zeros((*seen.shape, 3), dtype=np.float32)
            canvas[seen] = colours
            rows.append(canvas)
        strip = np.concatenate([np.concatenate(rows[:2], axis=1), np.concatenate(rows[2:], axis=1)])
        bright = np.percentile(panels[0].max(axis=1), 97.0)
        write_image(args.picture, strip, exposure=float(-np.log2(bright)))


if __name__ == "__main__":
    main()
