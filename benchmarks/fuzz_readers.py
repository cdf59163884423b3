"""Feed damaged files to every reader for a bounded time and report what is not a plain refusal.

    python benchmarks/fuzz_readers.py --seconds 60 --seed 1 --keep found

A reader may return, or raise ``ValueError`` or ``OSError`` with one line: the command line turns
those into one line and exit code 2. Anything else is a finding: another exception, several lines,
a crash, more than ``SECONDS`` for one file, more than ``MEMORY`` of address space, or text written
past Python to the terminal. Mutations are a function of the seed, so a run can be repeated; a
finding's file is kept with ``--keep`` for ``tests/data/fuzz``. Needs ``fork`` (Linux, macOS).
"""

import argparse
import os
import pathlib
import random
import resource
import runpy
import signal
import struct
import sys
import tempfile
import time
import unittest.mock
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from glossy import SurfacePoints, read_environment, read_measured
from glossy.gbuffer import read_gbuffer, write_gbuffer
from glossy.image import read_planes
from glossy.image_write import write_exr, write_image
from glossy.materials import parse_material
from glossy.measured import merl
from glossy.scene import Scene, load_scene

MEMORY = 6 << 30  # address space of the process that reads
SECONDS = 20  # for one file
BATCH = 200  # files for one process
MERL_SHAPE = (6, 5, 8)  # bins; a file of the full 90 x 90 x 180 has 35 MB
LONGEST = 2000  # characters of a message, which may quote the file

SCENE = b"""material = "mx=.2,my=.075"
background = "black"
[environment]
source = "studio"
size = 64
[shape]
kind = "sphere"
radius = 2
[camera]
position = [0, 1, 9]
fov = 45
width = 30
[method]
name = "importance"
samples = 40
"""
MATERIAL = b"""kd = [0.1, 0.2, 0.3]
[[reflection]]
mx = 0.2
my = 0.075
r0 = [0.04, 0.5, 1]
[[transmission]]
mx = 0.25
alpha = 0.5
"""
JSON = (
    b'{"kd": 0.1, "reflection": [{"mx": 0.2, "my": 0.1, "ks": [1, 0.5, 0.2]}], "transmission": []}'
)
WORDS = (b"nan", b"inf", b"1e999", b"-1", b"[", b"{", b'"', b"\n", b"\x00", b"\xff\xfe", b"9" * 400)

Reader = Callable[[pathlib.Path], Any]


def seeds(folder: pathlib.Path) -> list[tuple[Reader, pathlib.Path]]:
    """Small valid files, each with its reader."""
    rng = np.random.default_rng(0)
    pixels = rng.random((6, 12, 3), dtype=np.float32)
    images = [folder / f"image.{kind}" for kind in ("exr", "hdr", "png", "tiff", "pfm")]
    for path in images[:3]:
        write_image(path, pixels)
    import OpenImageIO as oiio  # noqa: N813

    for path in images[3:]:
        out: Any = oiio.ImageOutput.create(str(path))
        out.open(str(path), oiio.ImageSpec(12, 6, 3, "float"))
        out.write_image(pixels)
        out.close()
    half = folder / "half.exr"
    write_exr(half, {"R": pixels[..., 0], "G": pixels[..., 1], "B": pixels[..., 2]})
    up, side = (np.full((3, 4, 3), v) for v in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    points = SurfacePoints(up, side, up, np.eye(3, 4) > 0.0)
    found: list[tuple[Reader, pathlib.Path]] = []
    for path in (*images, half):
        found += [(_planes, path), (_environment, path)]
    for name in ("points.npz", "points.exr"):
        write_gbuffer(folder / name, points)
        found.append((read_gbuffer, folder / name))
    np.savez_compressed(folder / "packed.npz", normal=up, view=up)
    found.append((read_gbuffer, folder / "packed.npz"))
    for name, text, reader in (
        ("scene.toml", SCENE, _scene),
        ("material.toml", MATERIAL, parse_material),
        ("material.json", JSON, parse_material),
    ):
        (folder / name).write_bytes(text)
        found.append((reader, folder / name))
    made = runpy.run_path(str(pathlib.Path(__file__).parents[1] / "tests" / "measured_files.py"))
    for name, kind in (("m.bsdf", "rgl"), ("m.brdf", "cornell"), ("m.xml", "klems")):
        made[f"write_{kind}"](folder / name)
        found.append((read_measured, folder / name))
    read_measured(folder / "m.brdf").write(folder / "m.txt")
    found.append((read_measured, folder / "m.txt"))
    bins = rng.random((3, *MERL_SHAPE)) - 0.1  # negative where nothing was measured
    (folder / "m.binary").write_bytes(struct.pack("<3i", *MERL_SHAPE) + bins.tobytes())
    found.append((_merl, folder / "m.binary"))
    return found


def _planes(path: pathlib.Path) -> object:
    return read_planes(path, encoding="srgb")


def _environment(path: pathlib.Path) -> object:
    return read_environment(path, size=4, encoding="srgb", nonfinite="clamp")


def _merl(path: pathlib.Path) -> object:
    with unittest.mock.patch.object(merl, "SHAPE", MERL_SHAPE):
        return read_measured(path)


def _scene(path: pathlib.Path) -> object:
    scene = load_scene(path)
    return scene.load_material() if isinstance(scene, Scene) else scene


def mutate(data: bytes, draw: random.Random) -> bytes:
    """One to four random changes: bits, bytes, 32-bit numbers, cuts, copies, words."""
    b = bytearray(data)
    for _ in range(draw.choice((1, 1, 2, 4))):
        at = draw.randrange(len(b)) if b else 0
        head = draw.randrange(min(len(b), 400)) if b else 0
        kind = draw.randrange(8)
        if kind == 0 and b:
            b[at] ^= 1 << draw.randrange(8)
        elif kind == 1 and b:
            b[head] = draw.choice((0, 1, 0x7F, 0x80, 0xFF))
        elif kind == 2:
            number = draw.choice((0, 1, 2**31 - 1, 2**31, 2**32 - 1, 65536, draw.getrandbits(32)))
            b[head : head + 4] = number.to_bytes(4, draw.choice(("little", "big")))
        elif kind == 3:
            del b[at:]
        elif kind == 4:
            del b[at : at + draw.randrange(1, 32)]
        elif kind == 5:
            end = at + draw.randrange(1, 64)
            b[at:at] = b[at:end] * draw.choice((1, 1, 50))
        elif kind == 6:
            b[at:at] = draw.choice(WORDS) * draw.choice((1, 1, 1, 300))
        elif b:
            other = draw.randrange(len(b))
            b[at : at + 8] = b[other : other + 8]
    return bytes(b)


def attempt(reader: Reader, path: pathlib.Path) -> str:
    """What is wrong with how the reader took the file; empty if nothing is."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reader(path)
    except (ValueError, OSError) as error:
        lines = str(error).splitlines()
        if len(lines) > 1:
            return f"{type(error).__name__} of {len(lines)} lines: {lines[0][:60]}"
        if not lines or len(lines[0]) > LONGEST:
            return f"{type(error).__name__} with a message of {len(str(error))} characters"
    except BaseException as error:
        return f"{type(error).__name__}: {str(error)[:80]}"
    return ""


def _child(
    cases: list[tuple[Reader, pathlib.Path, bytes]], first: int, report: int, limit: int
) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    noise = os.open(cases[0][1].parent / "noise", os.O_RDWR | os.O_CREAT | os.O_TRUNC)
    os.dup2(noise, 1)
    os.dup2(noise, 2)
    for k in range(first, len(cases)):
        reader, path, data = cases[k]
        target = path.parent / f"mutant{path.suffix}"
        target.write_bytes(data)
        os.write(report, b"%d\n" % k)
        signal.alarm(limit)
        wrong = attempt(reader, target)
        signal.alarm(0)
        if os.fstat(noise).st_size:
            wrong = wrong or "wrote past Python: " + os.pread(noise, 80, 0).decode("latin-1")
            os.ftruncate(noise, 0)
            os.lseek(noise, 0, os.SEEK_SET)
        if wrong:
            os.write(report, b"%d %s\n" % (k, " ".join(wrong.split()).encode()))
    os._exit(0)


def run_batch(
    cases: list[tuple[Reader, pathlib.Path, bytes]], limit: int = SECONDS
) -> list[tuple[int, str]]:
    """Read each case in another process, and start a new one after each crash: (case, fault)."""
    found: list[tuple[int, str]] = []
    first = 0
    while first < len(cases):
        source, sink = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(source)
            _child(cases, first, sink, limit)
        os.close(sink)
        last = first
        with os.fdopen(source, "rb") as lines:
            for line in lines:
                number, _, wrong = line.decode(errors="replace").strip().partition(" ")
                last = int(number)
                if wrong:
                    found.append((last, wrong))
        status = os.waitpid(child, 0)[1]
        if not status:
            break
        died = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else "exit"
        found.append((last, f"killed by {died}"))
        first = last + 1
    return found


def main() -> int:
    """Fuzz until the time is up; exit 1 when anything was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=pathlib.Path, help="folder for the files found")
    args = parser.parse_args()
    draw = random.Random(args.seed)
    count = 0
    faults: dict[tuple[str, str, str], int] = {}
    end = time.monotonic() + args.seconds
    with tempfile.TemporaryDirectory() as name:
        originals = seeds(pathlib.Path(name))
        # in another process too: a fork after the compiler's threads have started would end badly;
        # without a limit, because this is where the kernels are compiled
        valid = [(reader, path, path.read_bytes()) for reader, path in originals]
        for k, wrong in run_batch(valid, limit=0):
            raise SystemExit(f"{originals[k][1].name} is a valid file, but: {wrong}")
        while time.monotonic() < end:
            batch = []
            for _ in range(BATCH):
                reader, path = draw.choice(originals)
                batch.append((reader, path, mutate(path.read_bytes(), draw)))
            count += len(batch)
            for k, wrong in run_batch(batch):
                reader, path, data = batch[k]
                key = (reader.__name__, path.name, wrong[:40])
                if key in faults:
                    faults[key] += 1
                    continue
                faults[key] = 1
                print(f"{reader.__name__} {path.name}: {wrong}", flush=True)
                if args.keep:
                    args.keep.mkdir(parents=True, exist_ok=True)
                    kept = args.keep / f"{path.stem}-{len(faults)}{path.suffix}"
                    kept.write_bytes(data)
    print(f"{count} files, {len(faults)} kinds of fault")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
