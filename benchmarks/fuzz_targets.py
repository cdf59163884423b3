"""What is fuzzed: valid inputs of one or more files, each with what reads it."""

import argparse
import copy
import dataclasses
import io
import json
import pathlib
import struct
import unittest.mock
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from fuzz_pictures import pictures
from fuzz_texts import BUFFERED, JSON, MATERIAL, PLANE, ROOM, SCENE

Files = dict[str, bytes]
Read = Callable[[pathlib.Path], object]

MERL_SHAPE = (6, 5, 8)  # bins; a file of the full 90 x 90 x 180 has 35 MB


@dataclasses.dataclass(frozen=True)
class Target:
    """``read`` takes the folder in which ``files`` lie; ``group`` is for the figures.

    ``sealed``: files carry checksums, which a mutant may have put right. ``rewrites``: reading
    changes the folder. ``share``: how often it is drawn, against others.
    """

    name: str
    group: str
    files: Files
    read: Read
    sealed: bool = False
    rewrites: bool = False
    share: int = 4


def _file(read: Callable[[pathlib.Path], object], name: str, at: pathlib.Path) -> None:
    read(at / name)


def _npz(**arrays: Any) -> bytes:
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    return out.getvalue()


def _pictures(folder: pathlib.Path) -> list[Target]:
    import picture_files

    from glossy import read_environment
    from glossy.commands.compare_files import _read_mask
    from glossy.image import read_planes

    files = pictures(folder)
    image = read_planes(folder / "none.exr")
    found = []
    for name, data in files.items():

        def planes(at: pathlib.Path, name: str = name) -> None:
            read_planes(at / name, encoding="srgb", window="black")

        def lights(at: pathlib.Path, name: str = name) -> None:
            read_environment(at / name, size=4, encoding="srgb", nonfinite="clamp")

        kind = pathlib.Path(name).suffix[1:]
        group = {"exr": "OpenEXR", "hdr": "Radiance"}.get(kind, "other pictures")
        often = 9 if group != "other pictures" else 2
        found.append(
            Target(name, group, {name: data}, planes, share=2 * often if kind == "hdr" else often)
        )
        if name in ("zip.exr", "window.exr", "entries.exr", "mixed.hdr", "uint8.png", "float.pfm"):
            found.append(Target(f"env-{name}", "environments", {name: data}, lights, share=3))

    def mask(at: pathlib.Path, name: str) -> None:
        args = argparse.Namespace(mask=str(at / name), max_pixels=None)
        _read_mask(args, None, image)

    for name in ("uint8.png", "rle.exr"):
        found.append(
            Target(f"mask-{name}", "masks", {name: files[name]}, partial(mask, name=name), share=3)
        )
    rng = np.random.default_rng(1)
    quads = rng.integers(0, 256, (4, 4, 4), dtype=np.uint8)
    face = picture_files.radiance_bytes(quads, coding="old")
    small = picture_files.rgb_exr(rng.random((4, 4, 3), dtype=np.float32))
    names = ("px", "nx", "py", "ny", "pz", "nz")
    faces = {f"{n}.{'hdr' if k % 2 else 'exr'}": small if k % 2 == 0 else face
             for k, n in enumerate(names)}  # fmt: skip
    found.append(
        Target("faces", "face files", faces,
               lambda at: read_environment(at, size=4, encoding="srgb"), share=8)
    )  # fmt: skip
    return found


def _meshes() -> list[Target]:
    import mesh_files

    from glossy.scenes.mesh import TriangleMesh
    from glossy.scenes.shapes import Mesh

    points, triangles = mesh_files.box()
    found = []
    whole = {f"{kind.replace('.', '-')}": (kind, mesh_files.contents(kind, points, triangles))
             for kind in mesh_files.KINDS}  # fmt: skip
    normals = mesh_files.ply(points, triangles, "<", points)
    whole["normals"] = ("n.ply", normals)
    whole["obj-normals"] = ("n.obj", mesh_files.obj(points, triangles, points[triangles[:, 0]]))
    tree, data = mesh_files.gltf_tree(points, triangles, "buffer.bin")
    tree["nodes"] = [{"children": [1], "translation": [1, 2, 3]},
                     {"mesh": 0, "rotation": [0, 0, 0, 1], "scale": [1, 2, 3]}]  # fmt: skip
    whole["outside"] = ("o.gltf", json.dumps(tree).encode())
    for name, (kind, text) in whole.items():
        file = f"mesh{pathlib.Path('a.' + kind).suffix}"

        def read(at: pathlib.Path, file: str = file) -> None:
            TriangleMesh(Mesh(str(at / file)), np.eye(3, 4))

        files = {file: text, **({"buffer.bin": data} if name == "outside" else {})}
        found.append(Target(f"mesh-{name}", "meshes", files, read, share=15))
    return found


def _scenes(folder: pathlib.Path) -> list[Target]:
    import mesh_files

    from glossy import SurfacePoints
    from glossy.gbuffer import read_gbuffer, write_gbuffer
    from glossy.materials import parse_material
    from glossy.scene import Scene, load_scene

    up, side = (np.full((3, 4, 3), v) for v in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    points = SurfacePoints(up, side, up, np.eye(3, 4) > 0.0)
    found = []
    for name in ("points.npz", "points.exr"):
        write_gbuffer(folder / name, points)
        found.append(
            Target(name, "G-buffers", {name: (folder / name).read_bytes()},
                   partial(_file, read_gbuffer, name), share=15)
        )  # fmt: skip
    packed = _npz(n=up.astype(np.float16), view=np.full((3, 4, 3), 200, np.uint8))
    found.append(
        Target("packed.npz", "G-buffers", {"packed.npz": packed}, lambda at: read_gbuffer(
            at / "packed.npz", normal="n", encoded=["view"], normalise=True), share=15)
    )  # fmt: skip

    def load(at: pathlib.Path) -> None:
        scene = load_scene(at / "scene.toml")
        if isinstance(scene, Scene):
            if not scene.is_measured:
                scene.load_material()
            if scene.gbuffer is not None:
                scene.points()

    gbuffer = _npz(normal=up, view=(0.5 * up + 0.5))
    box = mesh_files.contents("obj", *mesh_files.box())
    for name, files in (
        ("scene", {"scene.toml": SCENE}),
        ("plane", {"scene.toml": PLANE}),
        ("buffered", {"scene.toml": BUFFERED, "points.npz": gbuffer}),
    ):
        found.append(Target(name, "single scenes", files, load, share=25))
    found.append(
        Target("room", "object scenes", {"scene.toml": ROOM, "mesh.obj": box}, load, share=30)
    )
    for name, text in (("m.toml", MATERIAL), ("m.json", JSON)):
        found.append(
            Target(f"material-{name}", "materials", {name: text},
                   partial(_file, parse_material, name), share=60)
        )  # fmt: skip
    return found


def _measured(folder: pathlib.Path) -> list[Target]:
    import measured_files

    from glossy import read_measured
    from glossy.measured import merl

    def read(at: pathlib.Path, name: str) -> None:
        with unittest.mock.patch.object(merl, "SHAPE", MERL_SHAPE):
            read_measured(at / name)

    measured_files.write_rgl(folder / "m.bsdf")
    measured_files.write_cornell(folder / "m.brdf")
    measured_files.write_klems(folder / "m.xml")
    read_measured(folder / "m.brdf").write(folder / "m.txt")
    bins = np.random.default_rng(0).random((3, *MERL_SHAPE)) - 0.1
    (folder / "m.binary").write_bytes(struct.pack("<3i", *MERL_SHAPE) + bins.tobytes())
    return [
        Target(name, "measured files", {name: (folder / name).read_bytes()},
               partial(read, name=name), share=share)
        for name, share in (("m.bsdf", 8), ("m.brdf", 5), ("m.xml", 12), ("m.txt", 20),
                            ("m.binary", 1))
    ]  # fmt: skip


def _studies(folder: pathlib.Path) -> list[Target]:
    from glossy.camera import default_camera, surface_points
    from glossy.cli import build_parser
    from glossy.commands import options
    from glossy.environment import environment
    from glossy.materials import parse_material
    from glossy.scene import Sphere
    from glossy.study import commandline, report, settings
    from glossy.study.bench import Cell
    from glossy.study.run import Study
    from glossy.study.store import Store, recorded

    shape = Sphere()
    points = surface_points(default_camera(shape, 6, 6), shape)
    methods = [settings.parse_method(name) for name in ("regular/paper", "importance")]
    case = settings.case_of(parse_material("mx=.2"))
    plan = settings.Plan([case], methods, (7,), repeats=1, subset=4)
    first = Study(plan, environment("white", 4), points, "white", folder / "study")
    first.arguments = {"env": "white", "size": 4, "methods": "regular,importance"}
    pixels = int(first.bench.seen.sum())
    first.keep_truth(case, {"radiance": np.ones((pixels, 3)), "error": np.zeros((pixels, 3)),
                            "kind": np.array("bound"), "seconds": np.array(1.0)})  # fmt: skip
    for one, method, budget, kind in first.wanted():
        given: dict[str, Any] = {
            "case": one.name, "kind": one.kind, "widths": one.widths, "method": method.label,
            "budget": budget, "taps": [7], "threshold": 0.2, "bias_kind": kind, "psnr": 40.0,
            "runs": [0.1], "calls": [3], "search": [[0.0, 0.1]], "cpu": "a", "loaded": False,
        }  # fmt: skip
        hints = {f.name: 1 if f.type == "int" else 0.5 for f in dataclasses.fields(Cell)}
        first.keep_cell(Cell(**{**hints, **given}))
    first.store.sessions[-1] = first._session()
    first.store.save_manifest()
    place = folder / "study"
    files = {str(p.relative_to(place)): p.read_bytes() for p in place.rglob("*") if p.is_file()}
    left = b'{"pid": 7, "started": "2026-01-01", "host": "", "boot": ""}'
    files["study.running.json"] = left

    parser = build_parser()

    def read(at: pathlib.Path) -> None:
        old = recorded(at)
        if old is None:
            return
        given = parser.parse_args(["study", "--resume", "-o", str(at)])
        args = commandline.continued(given, *old)
        alone = {"samples": None, "filter": None, "max_error": None}
        scene = options.scene_from(argparse.Namespace(**{**vars(args), **alone}))
        commandline.with_old_cases(commandline.plan_from(args, scene), old[0])
        again = copy.copy(first)
        again.store = Store(at, first.settings, first._session(), resume=True)
        again.truths, again._cells = {}, {}
        again._find_all()
        report.error_table(again.cells)
        report.time_table(again.cells)
        report.to_csv(again.cells)
        report.truth_table(again)
        report.dumps(report.to_dict(again, commandline.evaluate(again), []))

    return [Target("study", "study folders", files, read, sealed=True, rewrites=True, share=20)]


def targets(folder: pathlib.Path) -> list[Target]:
    """Every target, its files made in a folder."""
    return [
        *_pictures(folder),
        *_meshes(),
        *_scenes(folder),
        *_measured(folder),
        *_studies(folder),
    ]
