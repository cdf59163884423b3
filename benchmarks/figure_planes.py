"""What bounding planes mend: a ball near a wall, against rays cast in the same room.

The walls are an exact procedure (tiles), so that rays can be cast without a cube map; the cube map
is captured at the ball's centre. Writes a picture (without planes, with them, rays cast) and prints
relative RMS errors of the lobe's integral over the ball.

    python benchmarks/figure_planes.py [--picture docs/images/planes.png]
"""

import argparse

import numpy as np
import numpy.typing as npt

import glossy
from glossy.cubemap import face_directions
from glossy.frames import normalise, to_world
from glossy.image_write import write_image

Array = npt.NDArray[np.float64]

LOW, HIGH = np.array([-3.0, 0.0, -3.0]), np.array([3.0, 3.0, 4.0])
CENTRE, RADIUS = np.array([0.0, 0.75, -2.2]), 0.6
COLOURS = np.array(
    [[0.9, 0.35, 0.2], [0.25, 0.5, 0.9], [0.75, 0.7, 0.6], [1.6, 1.6, 1.5], [0.4, 0.75, 0.4],
     [0.8, 0.75, 0.3]]
)  # fmt: skip
SIZE, FINE = 256, 4
SLOPES = 48


def ray_cast(origin: Array, w: Array) -> Array:
    """Radiance (..., 3) of the tiled room along ``w`` (..., 3) from ``origin`` (..., 3)."""
    with np.errstate(divide="ignore"):
        away = np.where(w > 0.0, HIGH - origin, LOW - origin) / np.where(w == 0.0, 1e-300, w)
    axis = np.argmin(away, axis=-1)
    hit = origin + np.min(away, axis=-1)[..., None] * w
    wall = 2 * axis + (np.take_along_axis(w, axis[..., None], -1)[..., 0] > 0.0)
    cells = np.floor(hit / 0.5 + 1e-9).astype(int)
    others = cells.sum(axis=-1) - np.take_along_axis(cells, axis[..., None], -1)[..., 0]
    return np.asarray(COLOURS[wall] * np.where(others % 2 == 0, 1.0, 0.35)[..., None])


def capture() -> glossy.CubeMap:
    """The room from the ball's centre, ``FINE`` squared rays a texel."""
    n = SIZE * FINE
    side = (np.arange(n) + 0.5) * (2.0 / n) - 1.0
    faces = []
    for face in range(6):
        d = normalise(face_directions(face, side[None, :], side[:, None]))
        light = ray_cast(np.broadcast_to(CENTRE, d.shape), d)
        faces.append(light.reshape(SIZE, FINE, SIZE, FINE, 3).mean(axis=(1, 3)))
    return glossy.CubeMap(np.array(faces))


def cast_lobe(p: glossy.SurfacePoints, m: float) -> Array:
    """The lobe's integral (K, 3) of ray-cast radiance, a midpoint sum over half-vector slopes."""
    x = (np.arange(SLOPES) + 0.5) * (7.0 / SLOPES) - 3.5
    a, b = np.meshgrid(x, x, indexing="ij")
    h = np.stack([m * a, m * b, np.ones_like(a)], axis=-1).reshape(-1, 3)
    hz = 1.0 / np.linalg.norm(h, axis=-1)
    h = h * hz[:, None]
    weight = np.exp(-(a**2) - b**2).reshape(-1) * (7.0 / SLOPES) ** 2 / np.pi
    out = np.zeros((*p.shape, 3))
    assert p.position is not None
    for k in range(p.shape[0]):
        wo = p.local_view[k]
        u = h @ wo
        wi = 2.0 * u[:, None] * h - wo
        light = ray_cast(p.position[k], to_world(wi, p.tangent[k], p.normal[k]))
        share = np.where((u > 0.0) & (wi[:, 2] > 0.0), weight * wi[:, 2] / hz, 0.0)
        out[k] = share @ light
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--picture", metavar="P.png")
    parser.add_argument("--pixels", type=int, default=96)
    args = parser.parse_args()
    cube = capture()
    pyramid = glossy.build_pyramid(cube)
    ball = glossy.Sphere(tuple(CENTRE), RADIUS)
    camera = glossy.Camera((1.2, 1.2, 0.8), tuple(CENTRE), fov=25.0, width=args.pixels,
                           height=args.pixels)  # fmt: skip
    whole = glossy.surface_points(camera, ball)
    seen = whole.coverage
    p = whole[seen]
    sides = {f: glossy.BoundingPlanes.box(LOW, HIGH, CENTRE, footprint=f) for f in
             ("thesis", "projected")}  # fmt: skip
    background = ray_cast(np.broadcast_to(camera.position, whole.view.shape), camera.rays())
    rows = []
    print("m, samples: relative RMS error without planes, with (thesis), with (projected)")
    for m, samples in ((0.02, 14), (0.15, 30)):
        lobe = glossy.Lobe(m)
        truth = cast_lobe(p, m)
        pictures = [
            glossy.shade(p, lobe, pyramid, samples=samples, footprint="jacobian", parallax=planes)
            for planes in (None, sides["thesis"], sides["projected"])
        ]
        errors = [glossy.relative_rms(x, truth) for x in pictures]
        print(f"{m}, {samples}: " + ", ".join(f"{e:.4f}" for e in errors))
        row = []
        for x in (pictures[0], pictures[1], truth):
            full = background.copy()
            full[seen] = x
            row.append(full)
        rows.append(np.concatenate(row, axis=1))
    if args.picture:
        image = np.concatenate(rows, axis=0).astype(np.float32)
        write_image(args.picture, image, exposure=0.0)


if __name__ == "__main__":
    main()
