"""A lat-long picture to cube faces by exact overlap against one point sample a texel.

    python benchmarks/bench_latlong.py --json latlong.json

The opponent reads one place of the picture for each texel of the cube, nearest texel or bilinear:
as one would first write it in Numba, parallel over rows. It loses light; the conversion keeps the
power of every texel of the picture, so that the two results differ (shown: power over that of the
picture, largest error of a channel).
"""

import math
import statistics
from typing import Any

import common
import numba
import numpy as np
import numpy.typing as npt

from glossy.cubemap import texel_solid_angles
from glossy.latlong import latlong_power, latlong_to_cube

Array = npt.NDArray[np.float32]


@numba.njit(parallel=True, cache=True, fastmath=True, error_model="numpy")
def point_sampled(picture: Array, size: int, linear: bool) -> Array:
    """Cube faces (6, N, N, 3) with one look at the picture each."""
    height, width = picture.shape[0], picture.shape[1]
    out = np.empty((6, size, size, 3), dtype=np.float32)
    for i in numba.prange(6 * size):
        face, row = i // size, i % size
        t = np.float32((row + 0.5) * 2.0 / size - 1.0)
        for col in range(size):
            s = np.float32((col + 0.5) * 2.0 / size - 1.0)
            one = np.float32(1.0)
            if face == 0:
                x, y, z = one, -t, -s
            elif face == 1:
                x, y, z = -one, -t, s
            elif face == 2:
                x, y, z = s, one, t
            elif face == 3:
                x, y, z = s, -one, -t
            elif face == 4:
                x, y, z = s, -t, one
            else:
                x, y, z = -s, -t, -one
            phi = math.atan2(x, -z)
            theta = math.acos(y / math.sqrt(x * x + y * y + z * z))
            u = phi * np.float32(0.5 / math.pi) * width
            v = theta * np.float32(1.0 / math.pi) * height
            if u < np.float32(0.0):
                u += width
            if linear:
                u, v = u - np.float32(0.5), v - np.float32(0.5)
                j, k = math.floor(u), math.floor(v)
                a, b = u - np.float32(j), v - np.float32(k)
                j0, j1 = j % width, (j + 1) % width
                k0, k1 = max(k, 0), min(k + 1, height - 1)
                for c in range(3):
                    top = picture[k0, j0, c] * (one - a) + picture[k0, j1, c] * a
                    low = picture[k1, j0, c] * (one - a) + picture[k1, j1, c] * a
                    out[face, row, col, c] = top * (one - b) + low * b
            else:
                j, k = min(int(u), width - 1), min(int(v), height - 1)
                for c in range(3):
                    out[face, row, col, c] = picture[k, j, c]
    return out


def picture_of(height: int) -> Array:
    """A smooth sky with a sun of half a degree and fine noise."""
    theta = (np.arange(height, dtype=np.float32) + 0.5) * np.float32(np.pi / height)
    phi = (np.arange(2 * height, dtype=np.float32) + 0.5) * np.float32(np.pi / height)
    sky = (1.2 + np.cos(theta))[:, None] * (1.0 + 0.3 * np.sin(phi))[None, :]
    out = sky[..., None] * np.array([0.5, 0.7, 1.0], dtype=np.float32)
    out *= np.random.default_rng(0).uniform(0.5, 1.5, out.shape)
    middle = np.hypot(theta[:, None] - 0.9, (phi[None, :] - 2.0) * math.sin(0.9))
    out[middle < np.radians(0.25)] += 5e4
    picture: Array = out.astype(np.float32)
    return picture


def main() -> None:
    """Time both, and say what each does to the light."""
    parser = common.arguments(__doc__)
    parser.add_argument("--height", type=int, default=2048)
    parser.add_argument("--size", type=int, default=1024)
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    if args.quick:
        args.height, args.size, args.rounds = 64, 32, 1
    numba.set_num_threads(args.threads)
    picture = picture_of(args.height)
    made: dict[str, Any] = {}

    def exact() -> None:
        made["glossy"] = latlong_to_cube(picture, args.size)

    def nearest() -> None:
        made["nearest point"] = point_sampled(picture, args.size, False)

    def bilinear() -> None:
        made["bilinear point"] = point_sampled(picture, args.size, True)

    contenders = {"glossy": exact, "bilinear point": bilinear, "nearest point": nearest}
    times = common.interleaved(contenders, args.rounds)
    omega, power = texel_solid_angles(args.size), latlong_power(picture)
    rows, results = [], []
    for name in contenders:
        faces = made[name]
        got = np.einsum("frcx,rc->x", faces, omega) / power - 1.0
        error = float(np.abs(got).max())
        rows.append(
            [name, f"{statistics.median(times[name]) * 1e3:.0f}",
             common.median_ratio(times, "glossy", name), f"{error:.1e}"]
        )  # fmt: skip
        results.append({"name": name, "seconds": times[name], "power_error": error})
    size = f"{2 * args.height} x {args.height} to {args.size}"
    print(common.table([size, "CPU ms", "glossy over it", "error of power"], rows))
    common.write(args.json, "latlong", results)


if __name__ == "__main__":
    main()
