"""Every writer: whole at its place, or what was there before, whichever step fails."""

import ast
import os
import pathlib
import stat
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import glossy
from glossy import _output
from glossy.animation import read_animation, write_animation
from glossy.camera import Sphere, default_camera
from glossy.commands.pattern import plot as plot_pattern
from glossy.gbuffer import read_gbuffer, write_gbuffer
from glossy.lattice import pattern as lattice_pattern
from glossy.measured.read import read_measured
from glossy.measured.synthetic import synthetic_table
from glossy.measured.table import MeasuredTable
from glossy.stability import checks, report

Writer = Callable[[pathlib.Path], object]

PACKAGE = pathlib.Path(glossy.__file__).parent
RGB = np.random.default_rng(4).random((21, 40, 3)).astype(np.float32)


def _table() -> MeasuredTable:
    return synthetic_table(glossy.material("white-foil"), [30.0])


def _report(path: pathlib.Path) -> None:
    rows: list[dict[str, float]] = []
    results = [checks.judge("a, frame axes", "wo.n = 1, x", {"auto": 1.0}, {"auto": 1.0})]
    report.plot(results, rows, path)


CAMERA = default_camera(Sphere(), 12, 10)
PATTERN = glossy.regular_pattern(glossy.Lobe(0.1), 4)

WRITERS: dict[str, Writer] = {
    "a.exr": lambda path: glossy.write_image(path, RGB),
    "half.exr": lambda path: glossy.write_image(path, RGB, half=True),
    "a.hdr": lambda path: glossy.write_image(path, RGB),
    "a.png": lambda path: glossy.write_image(path, RGB),
    "deep.png": lambda path: glossy.write_image(path, RGB, bits=16),
    "a.jpg": lambda path: glossy.write_image(path, RGB),
    "a.gif": lambda path: write_animation(path, [RGB, 1.0 - RGB]),
    "moving.png": lambda path: write_animation(path, [RGB, 1.0 - RGB]),
    "g.npz": lambda path: write_gbuffer(path, glossy.surface_points(CAMERA, Sphere())),
    "g.exr": lambda path: write_gbuffer(path, glossy.surface_points(CAMERA, Sphere())),
    "p.json": lambda path: PATTERN.export("json", path),
    "p.csv": lambda path: PATTERN.export("csv", path),
    "p.glsl": lambda path: PATTERN.export("glsl", path),
    "plot.png": lambda path: plot_pattern(PATTERN, path),
    "plot.svg": lambda path: plot_pattern(PATTERN, path),
    "lattice.png": lambda path: lattice_pattern.plot(12, 2.0, path),
    "report.png": _report,
    "table.txt": lambda path: _table().write(path),
}


@pytest.fixture(scope="module")
def sizes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, int]:
    """Bytes of each writer's file; by then nothing else needs a file (fonts, kernels)."""
    folder = tmp_path_factory.mktemp("sizes")
    for name, write in WRITERS.items():
        write(folder / name)
    return {name: (folder / name).stat().st_size for name in WRITERS}


@pytest.fixture
def at_most() -> Iterator[Callable[[int], None]]:
    """Sets the size at which every write of this process fails, as on a full disk."""
    resource = pytest.importorskip("resource", reason="file sizes cannot be limited here")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("name", WRITERS)
def test_wherever_a_write_fails_the_old_file_stays(
    tmp_path: pathlib.Path, name: str, sizes: dict[str, int], at_most: Callable[[int], None]
) -> None:
    """The write that crosses byte 0, 1, ..., the last: none leaves a broken or a stray file."""
    write, path, size = WRITERS[name], tmp_path / name, sizes[name]
    path.write_bytes(b"old")
    places = {0, 1, 8, 40, size // 3, size // 2, size - 2, size - 1}
    for place in sorted(p for p in places if 0 <= p < size):
        at_most(place)
        try:
            with pytest.raises(OSError, match=rf"^{path}: ") as error:
                write(path)
        finally:
            at_most(2**40)
        assert "\n" not in str(error.value)
        assert path.read_bytes() == b"old"
        assert os.listdir(tmp_path) == [name]
    write(path)
    assert path.stat().st_size == size


@pytest.mark.parametrize("step", ["fsync", "fstat", "chmod", "replace", "open", "close"])
@pytest.mark.parametrize("name", ["a.exr", "a.png", "deep.png", "p.json"])
def test_whichever_step_fails_the_old_file_stays(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, name: str, step: str
) -> None:
    path = tmp_path / name
    path.write_bytes(b"old")
    real = getattr(os, step)

    def failing(*args: Any, **kwargs: Any) -> Any:
        if step == "close":
            real(*args)  # the error of a close comes after the descriptor is gone
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, step, failing)
    with pytest.raises(OSError, match="input/output error") as error:
        WRITERS[name](path)
    monkeypatch.undo()
    assert str(error.value).startswith(f"{path}: ")
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize("name", ["a.exr", "deep.png", "a.png"])
def test_what_is_damaged_on_its_way_is_noticed(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """A byte that turns between writing and reading back, and a file that loses its end."""
    settle = _output._settle

    for damage in ("turned", "cut"):

        def damaging(temporary: str, before: Any, damage: str = damage) -> None:
            data = bytearray(pathlib.Path(temporary).read_bytes())
            data[-30] ^= 255
            whole = len(data) if damage == "turned" else len(data) - 20
            pathlib.Path(temporary).write_bytes(data[:whole])
            settle(temporary, before)

        monkeypatch.setattr(_output, "_settle", damaging)
        with pytest.raises(OSError, match="what was written"):
            WRITERS[name](tmp_path / name)
        assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("kind", ["fifo", "device", "socket", "folder", "link"])
def test_only_regular_files_are_replaced(tmp_path: pathlib.Path, kind: str) -> None:
    import socket

    path, pixels = tmp_path / "a.png", np.zeros((2, 2, 3))
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/null")
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as bound:
            bound.bind(os.path.relpath(path))
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to(tmp_path / "real.png")
        glossy.write_image(path, pixels)
        assert path.is_symlink()
        assert (tmp_path / "real.png").is_file()
        return
    before = os.stat(path)
    with pytest.raises(OSError, match=r"a\.png: is (not a regular file|a directory)"):
        glossy.write_image(path, pixels)
    after = os.stat(path)
    assert stat.S_IFMT(after.st_mode) == stat.S_IFMT(before.st_mode)
    assert after.st_ino == before.st_ino


def test_an_empty_file_is_none(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with (
        pytest.raises(OSError, match=r"a\.txt: nothing was written"),
        _output.replacing(path) as temporary,
    ):
        pathlib.Path(temporary).touch()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_writers_of_one_file_at_once_leave_one_of_theirs_whole(tmp_path: pathlib.Path) -> None:
    path, texts = tmp_path / "a.txt", [letter * 70_000 for letter in "abcdefgh"]
    with ThreadPoolExecutor(8) as pool:
        for _ in range(5):
            list(pool.map(lambda text: _output.write_text(path, text), texts))
            assert path.read_text() in texts
    assert os.listdir(tmp_path) == ["a.txt"]


def test_mode_and_owner_of_a_replaced_file_are_kept(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "a.exr"
    path.write_bytes(b"old")
    path.chmod(0o640)
    if os.geteuid() == 0:
        os.chown(path, 1234, 2345)
    before = path.stat()
    glossy.write_image(path, RGB)
    after = path.stat()
    assert stat.S_IMODE(after.st_mode) == 0o640
    assert (after.st_uid, after.st_gid) == (before.st_uid, before.st_gid)


def test_a_new_file_has_the_mode_that_the_umask_leaves(tmp_path: pathlib.Path) -> None:
    before = os.umask(0o027)
    try:
        for name in ("a.exr", "a.png", "deep.png"):
            WRITERS[name](tmp_path / name)
    finally:
        os.umask(before)
    assert {stat.S_IMODE(p.stat().st_mode) for p in tmp_path.iterdir()} == {0o640}


def test_what_the_writers_wrote_reads_back(tmp_path: pathlib.Path) -> None:
    for name in ("a.exr", "g.npz", "table.txt"):
        WRITERS[name](tmp_path / name)
    np.testing.assert_array_equal(glossy.read_image(tmp_path / "a.exr").pixels, RGB)
    assert read_gbuffer(tmp_path / "g.npz").shape == (10, 12)
    assert len(read_measured(tmp_path / "table.txt")) == len(_table())


WRITING = {"write_text", "write_bytes", "savez", "savez_compressed", "save", "savefig", "savetxt"}


def _stray_writes(path: pathlib.Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        modes = [*node.args[1:2], *(k.value for k in node.keywords if k.arg == "mode")]
        opens = name in ("open", "fdopen") and any(
            isinstance(m, ast.Constant) and isinstance(m.value, str) and set(m.value) & set("wax+")
            for m in modes
        )
        if opens or (name in WRITING and isinstance(node.func, ast.Attribute)):
            yield f"{path.relative_to(PACKAGE)}:{node.lineno} {name}"


@pytest.mark.skipif(os.name != "posix", reason="names are bytes on POSIX")
def test_a_name_that_is_not_utf8_is_written(tmp_path: pathlib.Path) -> None:
    path = pathlib.Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9.exr"))
    pixels = np.ones((2, 3, 3), np.float32)
    glossy.write_image(path, pixels)
    np.testing.assert_array_equal(glossy.read_image(path).pixels, pixels)
    assert os.listdir(tmp_path) == [path.name]


def test_every_file_is_written_by_the_one_helper() -> None:
    """Whoever opens a file for writing elsewhere has a reason that is named here."""
    allowed = {
        "_output.py",  # the helper
        "_cache.py",  # compiled kernels: one warning, never an error
        "commands/standard_input.py",  # a temporary copy of what came in
        "commands/streams.py",  # the same
    }
    stray = [
        place
        for path in sorted(PACKAGE.rglob("*.py"))
        if path.relative_to(PACKAGE).as_posix() not in allowed
        for place in _stray_writes(path)
    ]
    assert [s for s in stray if "savetxt" not in s] == []  # into a text in memory


def test_animations_read_back(tmp_path: pathlib.Path) -> None:
    """Animated PNG to the last bit of its 8; GIF within its 256 colours; both keep the order."""
    frames = [np.full((6, 8, 3), v, np.float32) for v in (0.0, 0.2, 1.0)]
    for name in ("a.png", "a.gif"):
        write_animation(tmp_path / name, frames)
        read = read_animation(tmp_path / name)
        assert read.shape == (3, 6, 8, 3)
        np.testing.assert_allclose(read, frames, atol=0.004)
    with pytest.raises(ValueError, match=r"a\.gif: 3 x 6 x 8 is more than the limit of 100 pixels"):
        read_animation(tmp_path / "a.gif", max_pixels=100)
    (tmp_path / "cut.gif").write_bytes((tmp_path / "a.gif").read_bytes()[:20])
    with pytest.raises(ValueError, match=r"cut\.gif: cannot be read"):
        read_animation(tmp_path / "cut.gif")
    with pytest.raises(ValueError, match=r"frames\[1\]: must have the shape of the first"):
        write_animation(tmp_path / "b.gif", [frames[0], frames[1][:3]])


def test_imageio_and_openimageio_decode_display_pictures_alike(tmp_path: pathlib.Path) -> None:
    import OpenImageIO as oiio  # noqa: N813

    for name in ("a.png", "a.jpg"):
        glossy.write_image(tmp_path / name, RGB)
        q = oiio.ImageBuf(str(tmp_path / name)).get_pixels("uint8")
        read = glossy.read_image(tmp_path / name, encoding="linear").pixels
        np.testing.assert_array_equal(np.rint(read * 255), q)
