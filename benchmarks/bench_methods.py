"""Every method against the same truth in the same scenes: error, time, preparation, memory.

    python benchmarks/bench_methods.py [--page docs/choosing.md] --json methods.json
    python benchmarks/bench_methods.py --env room.hdr --env sky --size 256

A sphere in each environment, against ``glossy.reference``; then a torus with a ball in its hole,
which hide the environment from each other and from themselves, against rays cast through the scene
(``glossy.pem.reference_occluded``). There only partial environment maps with shadow maps know what
is hidden; what the others cannot reach is the row of the truth without shadows.
Errors are RMS over the picture, relative to the RMS of the truth. Times are CPU times on one
thread, compiled: of a picture four times as high, over that of regular sampling in the same turn;
and of what a method makes anew when the map or the material changes
(``glossy.study.preparation``; what takes a second or more is made, and timed, only once).
"""

import dataclasses
import functools
import pathlib
import statistics
import sys
from collections.abc import Mapping
from typing import Any

import common
import numpy as np
from reproduce_thesis import fill

from glossy.metrics import relative_rms

ROUND = ("mx=.05", "mx=.15", "mx=.4")
LOBES = (*ROUND, "mx=.2,my=.075")
TOLERANCE = 2e-3  # of the truth
HIDDEN_TOLERANCE = 1e-2  # of the truth with shadows, a standard error
BASELINE = "regular, n = 14"
TIMED = 4  # pixels along a timed picture, over those of one that is judged
SLOW = 1.0  # CPU seconds of a preparation


@dataclasses.dataclass(frozen=True)
class Contender:
    """A method with its options for ``shade`` and for ``methods.prepare``."""

    method: str
    shade: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    prepare: Mapping[str, Any] = dataclasses.field(default_factory=dict)


JACOBIAN = {"footprint": "jacobian"}
MULTI = {"mode": "multi", "lobes": 3, "finish": "refit"}
CONTENDERS = {
    BASELINE: Contender("regular", {"samples": 14, "threshold": 0.2, **JACOBIAN}),
    "regular, n = 30": Contender("regular", {"samples": 30, "threshold": 0.1, **JACOBIAN}),
    "importance, n = 14": Contender("importance", {"samples": 14}),
    "importance, n = 30": Contender("importance", {"samples": 30}),
    "thesis, n = 7": Contender("thesis", {"samples": 7, "bias": -1.5}),
    "lattice, n = 14": Contender("lattice", {"samples": 14}),
    "lattice, n = 14, round": Contender("lattice", {"samples": 14}, {"filter": "round"}),
    "split-sum": Contender("split-sum"),
    "axis-taps, n = 8": Contender("axis-taps", {"samples": 8}),
    "prefiltered": Contender("prefiltered"),
    "prefiltered, flat": Contender("prefiltered", {}, {"mode": "flat"}),
    "prefiltered, 3 lobes": Contender("prefiltered", {}, MULTI),
    "pem": Contender("pem"),
    "pem, distance": Contender("pem", {"footprint": "distance"}),
}
ISOTROPIC = ("prefiltered",)  # methods for round lobes alone
REGIONS = 48
SHADOWED = f"pem, {REGIONS} shadow maps"
UNSHADOWED = "truth without shadows"


def picture(side: int) -> Any:
    """Surface points of a sphere that fills a square picture."""
    from glossy.scene import Sphere, default_camera, surface_points

    points = surface_points(default_camera(Sphere(), side, side), Sphere())
    return points[points.coverage]


class Stand:
    """A contender at one cube map and material, prepared."""

    def __init__(self, name: str, cube: Any, material: Any) -> None:
        from glossy import methods
        from glossy._threads import using
        from glossy.study import preparation

        self.name, self.contender, self.cube, self.material = name, CONTENDERS[name], cube, material
        self.bound = methods.bound_to_material(self.contender.method)
        with using(1):
            self.prepared, self.seconds = preparation.spent(lambda: self.prepare(material))

    def prepare(self, material: Any) -> Any:
        """What the method looks up."""
        from glossy import methods

        return methods.prepare(self.contender.method, self.cube, material, **self.contender.prepare)

    def shade(self, points: Any, material: Any = None, prepared: Any = None) -> Any:
        """The picture."""
        import glossy

        own = self.prepared if prepared is None else prepared
        lit = self.material if material is None else material
        c = self.contender
        return glossy.shade(points, lit, own, method=c.method, **c.shade)

    def preparation(self, points: Any) -> Any:
        """Its time and memory."""
        from glossy.study import preparation

        if self.bound and self.seconds > SLOW:
            held = preparation.held_bytes(self.prepared, self.cube)
            return preparation.Preparation("", self.name, self.seconds, self.seconds, held)
        one = points[:1]
        return preparation.measure(
            "",
            self.name,
            self.material,
            prepare=self.prepare,
            shade=lambda material, made: self.shade(one, material, made),
            bound=self.bound,
            given=self.cube,
        )


def stands(cube: Any, material: Any) -> list[Stand]:
    """The contenders that take the material."""
    lobes = [lobe.widths for lobe in material.lobes]
    round_ = all(mx == my for mx, my in lobes)
    named = [n for n, c in CONTENDERS.items() if round_ or c.method not in ISOTROPIC]
    return [Stand(name, cube, material) for name in named]


def judge(env: str, text: str, field: list[Stand], side: int, rounds: int) -> list[dict[str, Any]]:
    """A row for each method, for one environment and lobe."""
    import glossy
    from glossy._threads import using

    points, cube, material = picture(side), field[0].cube, field[0].material
    truth = glossy.reference(points, material, cube, tolerance=TOLERANCE, diffuse=False)
    level = float(np.sqrt(np.mean(np.square(truth.radiance))))
    with using(1):
        turns = {s.name: functools.partial(s.shade, picture(TIMED * side)) for s in field}
        times = common.interleaved(turns, rounds)
    rows = []
    for stand in field:
        made = stand.preparation(points)
        rows.append(
            {
                "environment": env,
                "lobe": text,
                "method": stand.name,
                "relative_rms": relative_rms(stand.shade(points), truth.radiance),
                "truth_error": float(np.sqrt(np.mean(np.square(truth.error)))) / level,
                "seconds": min(times[stand.name]),
                "over_regular": common.ratio(times, stand.name, BASELINE)[1],
                "new_map_seconds": made.new_map_seconds,
                "new_material_seconds": made.new_material_seconds,
                "bytes": made.bytes,
            }
        )
    return rows


def hidden_scene(side: int) -> tuple[Any, Any]:
    """Geometry of the torus and its ball, and what a camera sees of the torus."""
    import glossy
    from glossy.camera import Camera
    from glossy.scenes.geometry import Geometry
    from glossy.scenes.shapes import Sphere, Torus, Transform

    tilt = Transform(rotation=[25.0, 0.0, 0.0])
    geometry = Geometry([(Torus(1.0, 0.35), tilt), (Sphere(0.45), Transform())])
    camera = Camera(
        position=(0.0, 2.0, 4.5), target=(0.0, 0.0, 0.0), fov=35, width=side, height=side
    )
    hits = geometry.intersect(camera.position, camera.rays())
    on = hits.object == 0
    view = -camera.rays()[on]
    facing = np.sum(hits.normal[on] * view, axis=-1) > 0.0
    place, normal, tangent = (v[on][facing] for v in (hits.position, hits.normal, hits.tangent))
    return geometry, glossy.SurfacePoints(normal, tangent, view[facing], position=place)


def judge_hidden(env: str, text: str, field: list[Stand], side: int) -> list[dict[str, Any]]:
    """A row for each method where the scene hides part of the environment."""
    import glossy
    from glossy import pem
    from glossy.pem.maps import partial_maps

    cube, material = field[0].cube, field[0].material
    geometry, points = hidden_scene(side)
    truth = pem.reference_occluded(points, material, cube, geometry, tolerance=HIDDEN_TOLERANCE)
    level = float(np.sqrt(np.mean(np.square(truth.radiance))))
    maps = partial_maps(cube, REGIONS)
    cut = maps.regions
    shadows = pem.shadow_maps(geometry, cut.direction, cut.solid_angle)
    seen = shadows.visibility(points)
    images = {s.name: s.shade(points) for s in field}
    images[SHADOWED] = glossy.shade(points, material, maps, method="pem", visibility=seen)
    free = glossy.reference(points, material, cube, tolerance=TOLERANCE)
    images[UNSHADOWED] = free.radiance
    return [
        {
            "environment": env,
            "lobe": text,
            "method": name,
            "relative_rms": relative_rms(image, truth.radiance),
            "truth_error": float(np.sqrt(np.mean(np.square(truth.error)))) / level,
        }
        for name, image in images.items()
    ]


def _median(rows: list[dict[str, Any]], key: str) -> float:
    return float(statistics.median(row[key] for row in rows))


def error_table(rows: list[dict[str, Any]]) -> str:
    """Median of the relative RMS error over the environments [%], and the largest."""
    body: list[list[object]] = []
    lobes = list(dict.fromkeys(r["lobe"] for r in rows))
    for name in dict.fromkeys(r["method"] for r in rows):
        cells = []
        for lobe in lobes:
            own = [
                100.0 * r["relative_rms"] for r in rows if (r["method"], r["lobe"]) == (name, lobe)
            ]
            cells.append(f"{statistics.median(own):.1f} ({max(own):.1f})" if own else "–")
        body.append([name, *cells])
    return common.table(["method", *lobes], body)


def cost_table(rows: list[dict[str, Any]]) -> str:
    """Time of a picture over regular sampling's, preparation [ms], memory [MB]: medians."""
    body: list[list[object]] = []
    for name in CONTENDERS:
        own = [r for r in rows if r["method"] == name]
        if own:
            figures = [_median(own, "over_regular")]
            figures += [1e3 * _median(own, f"new_{k}_seconds") for k in ("map", "material")]
            figures += [1e-6 * _median(own, "bytes")]
            body.append([name, *(f"{value:.3g}" for value in figures)])
    head = ["method", "picture over regular", "new map [ms]", "new material [ms]", "memory [MB]"]
    return common.table(head, body)


def main() -> None:
    """Print the tables."""
    parser = common.arguments(__doc__)
    parser.add_argument("--env", action="append", help="a built-in name or a file; repeatable")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--page", type=pathlib.Path, help="fill the tables of this page")
    parser.add_argument("--side", type=int, default=96, help="pixels along the picture")
    args = parser.parse_args()
    from glossy import environment
    from glossy.materials import parse_material
    from glossy.scene import EnvironmentSource

    if args.quick:
        args.size, args.side, args.rounds, args.env = 16, 8, 1, ["spots"]
        del CONTENDERS["prefiltered, 3 lobes"]  # seconds to fit, whatever the map
    lobes = LOBES[1:2] if args.quick else LOBES
    for name in ("prefiltered", "pem"):  # compiles
        Stand(name, environment("studio", size=64), parse_material(LOBES[1]))
    rows: list[dict[str, Any]] = []
    hidden: list[dict[str, Any]] = []
    for env in args.env or ["spots", "studio", "sky"]:
        cube = EnvironmentSource(env, args.size).load()
        for text in lobes:
            field = stands(cube, parse_material(text))
            rows += judge(env, text, field, args.side, args.rounds)
            if text in ROUND:
                hidden += judge_hidden(env, text, field, args.side)
            print(f"{env}, {text}: done", file=sys.stderr)
    tables = {
        "errors": error_table(rows),
        "costs": cost_table(rows),
        "hidden": error_table(hidden),
    }
    print("Relative RMS error [%], median over the maps (largest)\n")
    print(tables["errors"] + "\n")
    print("Cost, medians over maps and lobes\n")
    print(tables["costs"] + "\n")
    print("The scene hides part of the map: error as above\n")
    print(tables["hidden"] + "\n")
    if args.page:
        fill(args.page, tables)
    common.write(args.json, "methods", rows + hidden)


if __name__ == "__main__":
    main()
