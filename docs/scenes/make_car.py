"""Make the meshes of the showroom's car: a body and a cabin, lofted along its length.

Every cross section is a superellipse |z/w|^p + |y/h|^p = 1 between a lower and an upper profile,
which are smooth curves through a few points. Run it from the repository's root ::

    python docs/scenes/make_car.py

The car points to +x and stands on y = 0; metres.
"""

import pathlib

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

Array = npt.NDArray[np.float64]

FOLDER = pathlib.Path(__file__).parents[2] / "glossy" / "scenes" / "data"

# x, bottom, top, half width
BODY = [
    (-2.10, 0.50, 0.66, 0.55),
    (-2.00, 0.34, 0.82, 0.76),
    (-1.60, 0.24, 0.90, 0.87),
    (-0.60, 0.22, 0.90, 0.90),
    (0.60, 0.22, 0.87, 0.90),
    (1.50, 0.24, 0.76, 0.87),
    (1.95, 0.30, 0.64, 0.74),
    (2.12, 0.42, 0.54, 0.50),
]
CABIN = [
    (-1.70, 0.66, 0.72, 0.40),
    (-1.50, 0.64, 0.95, 0.64),
    (-0.90, 0.64, 1.24, 0.70),
    (-0.25, 0.64, 1.33, 0.71),
    (0.30, 0.64, 1.23, 0.71),
    (0.85, 0.64, 0.95, 0.68),
    (1.15, 0.66, 0.72, 0.50),
]


def loft(
    rows: list[tuple[float, ...]], power: float, around: int, along: int
) -> tuple[Array, Array]:
    """Vertices (V, 3) and triangles (T, 3), wound outwards."""
    table = np.array(rows)
    curves = PchipInterpolator(table[:, 0], table[:, 1:])
    share = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, along)))  # dense at both ends
    x = table[0, 0] + (table[-1, 0] - table[0, 0]) * share
    low, high, width = curves(x).T
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    c, s = np.cos(angle), np.sin(angle)
    a, b = np.sign(c) * np.abs(c) ** (2.0 / power), np.sign(s) * np.abs(s) ** (2.0 / power)
    y = 0.5 * (high + low)[:, None] + 0.5 * (high - low)[:, None] * b
    z = width[:, None] * a
    rings = np.stack([np.broadcast_to(x[:, None], y.shape), y, z], axis=-1).reshape(-1, 3)
    ends = rings.reshape(along, around, 3)[[0, -1]].mean(axis=1)
    k, j = np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij")
    p, q = k * around + j, k * around + (j + 1) % around
    sides = np.stack([p, p + around, q, q, p + around, q + around], axis=-1).reshape(-1, 3)
    j = np.arange(around)
    first, last = along * around, along * around + 1
    start = np.stack([np.full(around, first), j, (j + 1) % around], axis=-1)
    base = (along - 1) * around
    end = np.stack([np.full(around, last), base + (j + 1) % around, base + j], axis=-1)
    return np.concatenate([rings, ends]), np.concatenate([sides, start, end])


def write_ply(path: pathlib.Path, vertices: Array, triangles: Array) -> None:
    """A binary PLY."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.zeros(len(triangles), dtype=[("n", "u1"), ("v", "<i4", 3)])
    faces["n"], faces["v"] = 3, triangles
    path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + faces.tobytes())


if __name__ == "__main__":
    for name, rows, power in (("body", BODY, 3.2), ("cabin", CABIN, 2.6)):
        write_ply(FOLDER / f"car_{name}.ply", *loft(rows, power, 48, 40))
