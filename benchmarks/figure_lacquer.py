"""Pictures like Kautz and McCool's Figs. 9 to 14: a teapot of lacquer and of copper.

Rows are materials, columns the truth (every pixel's BRDF against the map), one lobe for each of 16
elevations, one shape for all, three lobes with profiles fitted together. The table has the relative
RMS error over the teapot, over the pixels seen within 60 degrees of the normal, and of the truth.

    python benchmarks/figure_lacquer.py --data DIR [--picture FILE.png] [--json FILE] [--quick]

DIR has env/ (a map, ``--map``), mesh/teapot.ply and brdf/cornell_cayman.brdf.
"""

import pathlib
from typing import Any

import numpy as np
from common import arguments, table, write
from reproduce_prefiltered import COPPER

import glossy
from glossy.image_write import write_image
from glossy.prefiltered.approximate import approximate
from glossy.prefiltered.maps import prefilter
from glossy.prefiltered.shade import prefiltered
from glossy.scenes.mesh import TriangleMesh
from glossy.scenes.shapes import Mesh

METHODS: dict[str, dict[str, Any]] = {
    "3-D": {"mode": "single"},
    "2-D": {"mode": "flat"},
    "3 lobes": {"mode": "multi", "lobes": 3, "finish": "refit"},
}
UPRIGHT = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0]])  # z up to y


def teapot(file: pathlib.Path, width: int, height: int) -> glossy.SurfacePoints:
    """What a camera before the teapot sees of it, (H, W)."""
    mesh = TriangleMesh(Mesh(str(file)), UPRIGHT)
    low, high = mesh.bounds
    middle, reach = 0.5 * (low + high), float(np.linalg.norm(high - low))
    eye = middle + reach * np.array([0.3, 0.45, 1.1])
    camera = glossy.Camera(tuple(eye), tuple(middle), fov=34.0, width=width, height=height)
    rays = camera.rays().reshape(-1, 3)
    hit, _, triangle, uv = mesh.closest(np.broadcast_to(eye, rays.shape).copy(), rays, 1e-6)
    normal, tangent, _ = mesh.frame(triangle, uv, rays[hit])
    # a smooth normal may turn away from the eye at the rim: such pixels are not judged
    seen = np.zeros(len(rays), dtype=bool)
    seen[hit] = np.einsum("ij,ij->i", normal, rays[hit]) < -0.02
    full = [np.zeros_like(rays) for _ in range(2)]
    full[0][hit], full[1][hit] = normal, tangent
    shape = (height, width, 3)
    n, t, v = (a.reshape(shape) for a in (*full, -rays))
    return glossy.SurfacePoints(n, t, v, mask=seen.reshape(height, width))


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--data", type=pathlib.Path, required=True, help="folder of real data")
    parser.add_argument("--map", default="brown_photostudio_02_1k.hdr", help="file in env/")
    parser.add_argument("--picture", type=pathlib.Path, help="write the pictures here")
    args = parser.parse_args()
    width, height, samples, size = (48, 36, 64, 16) if args.quick else (160, 110, 512, 64)
    cube = glossy.read_environment(args.data / "env" / args.map, size=64 if args.quick else 128)
    points = teapot(args.data / "mesh" / "teapot.ply", width, height)
    seen = points.coverage
    near = seen & (np.einsum("...i,...i->...", points.normal, points.view) > 0.5)
    cayman = glossy.measured_material(args.data / "brdf" / "cornell_cayman.brdf")
    rows, strips = [], []
    materials: dict[str, Any] = {"Cayman": cayman, "copper": COPPER}
    for name, material in materials.items():
        exact = isinstance(material, glossy.Material)
        how: dict[str, Any] = (
            {"estimator": "texels", "tolerance": 0.003}
            if exact
            else {"estimator": "qmc", "samples": samples}
        )
        truth = glossy.reference(points, material, cube, **how)
        shown = [truth.radiance]
        noise = float(np.sqrt(np.mean(truth.error[seen] ** 2) / np.mean(truth.radiance[seen] ** 2)))
        for method, options in METHODS.items():
            maps = prefilter(cube, approximate(material, **options), size)
            radiance = prefiltered(points, material, maps).astype(np.float64)
            rows.append((
                name,
                method,
                f"{glossy.relative_rms(radiance, truth.radiance, seen):.3f}",
                f"{glossy.relative_rms(radiance, truth.radiance, near):.3f}",
                f"{noise:.4f}",
            ))  # fmt: skip
            shown.append(radiance)
        scale = 0.7 / float(np.quantile(truth.radiance[seen].max(axis=-1), 0.97))
        strips.append(np.concatenate(shown, axis=1) * scale)
    header = ("material", "method", "rms", "rms, views to 60°", "error of the truth")
    print(table(header, rows))
    write(args.json, "lacquer", [dict(zip(header, r, strict=True)) for r in rows])
    if args.picture is not None:
        write_image(args.picture, np.concatenate(strips, axis=0).astype(np.float32))


if __name__ == "__main__":
    main()
