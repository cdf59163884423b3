"""How close one trilinear tap is to a round Gaussian on the sphere, for every pyramid filter.

    python benchmarks/tap_quality.py --json taps.json

Taps are read off as they are: a map with one lit texel after the other gives what every lookup
takes from each texel of level 0. Directions: all over the sphere, near edges, near corners.
Against the Gaussian of the width that ``glossy.taps`` states, in the plane tangent at the lookup's
direction: offset of the centre, width, ratio of the axes, kurtosis (1 for a Gaussian: the mean
fourth power of the distance over 8 sigma^4) and half the integral of the absolute difference.
"""

from typing import Any

import common
import numpy as np
import numpy.typing as npt

import glossy
from glossy.cubemap import face_directions, texel_directions, texel_solid_angles
from glossy.pyramid import FILTERS
from glossy.taps import tap_width, texel_angle

Array = npt.NDArray[np.float64]
LEVELS = (2.0, 2.5, 3.0)


def unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def directions(count: int) -> dict[str, Array]:
    """Unit directions (count, 3) of the three regions."""
    rng = np.random.default_rng(0)
    anywhere = unit(rng.normal(size=(count, 3)))
    face, along = rng.integers(0, 6, count), rng.uniform(-1.0, 1.0, count)
    edge = face_directions(face, 1.0 - rng.uniform(0.0, 0.1, count), along)
    corner = face_directions(face, *(1.0 - rng.uniform(0.0, 0.15, (2, count))))
    return {"anywhere": anywhere, "edges": unit(edge), "corners": unit(corner)}


def responses(filter: str, size: int, d: Array) -> Array:
    """What lookups at ``LEVELS`` along d (K, 3) take of each texel, (levels, K, 6 size size)."""
    texels = 6 * size * size
    out = np.empty((len(LEVELS), d.shape[0], texels))
    faces = np.zeros((6, size, size, 3), dtype=np.float32)
    pyramid = glossy.build_pyramid(glossy.CubeMap(faces), filter=filter)
    for k in range(0, texels, 3):  # a texel a channel
        flat = faces.reshape(-1, 3)
        flat[[k, k + 1, k + 2], [0, 1, 2]] = 1.0
        pyramid.update(glossy.CubeMap(faces))
        flat[k : k + 3] = 0.0
        for i, level in enumerate(LEVELS):
            out[i, :, k : k + 3] = pyramid.sample(d, level, precision="double")
    return out


def measures(response: Array, p: Array, sigma: float, q: Array, area: Array) -> list[float]:
    """Offset / sigma, width / sigma, axis ratio, kurtosis and difference of one tap along p."""
    lit = np.flatnonzero(response)
    w = response[lit] / response[lit].sum()
    e1 = unit(np.cross(p, [0.3, 0.5, 0.8]))
    plane = q[lit] @ np.stack([e1, np.cross(p, e1)], axis=1)
    length = np.linalg.norm(plane, axis=1)
    angle = np.arctan2(length, q[lit] @ p)
    x = plane * (angle / np.maximum(length, 1e-12))[:, None]
    centre = w @ x
    x -= centre
    axes = np.linalg.eigvalsh(x.T @ (x * w[:, None]))
    kurtosis = w @ np.sum(x * x, axis=1) ** 2 / (8.0 * axes.mean() ** 2)
    gauss = np.exp(-0.5 * (np.arccos(np.clip(q @ p, -1.0, 1.0)) / sigma) ** 2) * area
    gauss /= gauss.sum()
    difference = 0.5 * (np.abs(gauss[lit] - w).sum() + 1.0 - gauss[lit].sum())
    return [
        float(np.linalg.norm(centre)) / sigma, float(np.sqrt(axes.mean())) / sigma,
        float(np.sqrt(axes[1] / axes[0])), float(kurtosis), float(difference),
    ]  # fmt: skip


def main() -> None:
    """Measure every filter; a row for each region and level."""
    parser = common.arguments(__doc__)
    parser.add_argument("--size", type=int, default=64, help="texels of a face's edge")
    parser.add_argument("--count", type=int, default=200, help="directions of each region")
    parser.add_argument("--filters", nargs="+", default=list(FILTERS))
    args = parser.parse_args()
    if args.quick:
        args.size, args.count = 16, 10
    regions = directions(args.count)
    q = unit(texel_directions(args.size).reshape(-1, 3))
    area = np.tile(texel_solid_angles(args.size).reshape(-1), 6)
    rows: list[list[str]] = []
    results: list[dict[str, Any]] = []
    for filter in args.filters:
        found = responses(filter, args.size, np.concatenate(list(regions.values())))
        for i, level in enumerate(LEVELS):
            for j, (region, d) in enumerate(regions.items()):
                sigma = tap_width(filter, level) * texel_angle(d, args.size)
                taps = found[i, j * args.count : (j + 1) * args.count]
                m = np.array(
                    [measures(*each, q, area) for each in zip(taps, d, sigma, strict=True)]
                )
                rows.append(
                    [filter, f"{level:g}", region, f"{np.sqrt(np.mean(m[:, 0] ** 2)):.3f}",
                     f"{m[:, 1].mean():.3f} ± {m[:, 1].std():.3f}",
                     f"{np.median(m[:, 2]):.2f}, {np.percentile(m[:, 2], 95):.2f}",
                     f"{m[:, 3].mean():.2f}", f"{m[:, 4].mean():.3f}"]
                )  # fmt: skip
                results.append(
                    {"filter": filter, "level": level, "region": region, "taps": m.tolist()}
                )
    header = ["filter", "level", "where", "offset / σ", "width / law", "axes: median, 95 %",
              "kurtosis", "difference"]  # fmt: skip
    print(common.table(header, rows))
    common.write(args.json, "tap_quality", results)


if __name__ == "__main__":
    main()
