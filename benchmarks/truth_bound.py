"""How much of its bound the quadrature's error takes: random lobes, views and maps of hot texels.

Each case is integrated to 1e-7, then to coarser tolerances; printed are the largest shares
``|coarse - fine| / bound`` with what they were found at. A share above 1 would be a bound that does
not hold. ``python benchmarks/truth_bound.py --cases 400 --seed 1``
"""

import argparse
import sys

import numpy as np

import glossy
from glossy.cubemap import CubeMap
from glossy.frames import normalise

TOLERANCES = (0.5, 0.2, 0.1, 0.03, 0.01, 1e-3, 1e-4)


def draw(rng: np.random.Generator) -> tuple[glossy.SurfacePoints, glossy.Material, CubeMap, str]:
    """A point, a material, a map, and what they are in words."""
    size = int(rng.choice([1, 2, 3, 5, 8, 16, 33, 64]))
    faces = np.full((6, size, size, 3), rng.choice([0.0, 0.0, 1e-3, 0.05, 1.0]))
    for texel in rng.integers(6 * size * size, size=int(rng.integers(1, 4))):
        faces.reshape(-1, 3)[texel] = 10.0 ** rng.uniform(0.0, 4.0) * np.array([1.0, 0.5, 0.2])
    m = 10.0 ** rng.uniform(-2.5, 0.3)
    my = max(m / float(rng.choice([1.0, 10.0 ** rng.uniform(0.0, 1.3)])), 1e-4)
    alpha = float(rng.choice([0.0, rng.random(), 0.01, 0.5, 0.99, 1.0]))
    lobe = glossy.Lobe(m, my, 1.0, float(rng.choice([0.0, 0.04, 0.9])), alpha)
    below = rng.random() < 0.3
    material = glossy.Material(transmission=[lobe]) if below else glossy.Material(reflection=[lobe])
    cosine = float(rng.choice([1.0, rng.uniform(1e-6, 1.0), 10.0 ** rng.uniform(-4.0, -1.0)]))
    normal = normalise(rng.normal(size=3))
    tangent = normalise(np.cross(normal, rng.normal(size=3)))
    phi = rng.uniform(0.0, 2.0 * np.pi)
    side = np.cos(phi) * tangent + np.sin(phi) * np.cross(normal, tangent)
    view = np.sqrt(1.0 - cosine**2) * side + cosine * normal
    words = f"N={size} wo.n={cosine:.3g} {'below' if below else 'above'} {lobe}"
    return glossy.SurfacePoints(normal, tangent, view), material, CubeMap(faces), words


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    found: list[tuple[float, float, str]] = []
    for _ in range(args.cases):
        points, material, cube, words = draw(rng)
        fine = glossy.reference(points, material, cube, tolerance=1e-7, samples=4_000_000)
        for tolerance in TOLERANCES:
            coarse = glossy.reference(points, material, cube, tolerance=tolerance)
            gap = np.abs(coarse.radiance - fine.radiance)
            known = (coarse.error > 0.0) & (fine.error < 0.05 * coarse.error)
            share = np.where(known, gap / np.where(known, coarse.error, 1.0), 0.0)
            found.append((float(share.max()), tolerance, words))
    found.sort(reverse=True)
    shares = np.array([f[0] for f in found])
    print(
        f"{args.cases} cases, {len(found)} comparisons; 99 % below {np.quantile(shares, 0.99):.3f}"
    )
    for worst, tolerance, words in found[:5]:
        print(f"{worst:.3f} at tolerance {tolerance:g}: {words}")
    return int(shares.max() > 1.0)


if __name__ == "__main__":
    sys.exit(main())
