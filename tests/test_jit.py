"""The compile cache: what a kernel's file is named by, whose files are run, what may go wrong."""

import importlib.util
import os
import pathlib
import resource
import shutil
import subprocess
import sys
import tempfile
from typing import Any

import pytest

import glossy
from glossy import _cache, _sources

PACKAGE = pathlib.Path(glossy.__file__).parent

CALLEE = """
from glossy._jit import kernel

SCALE = 3.0

@kernel
def twice(x):
    '''Two.'''
    return 2.0 * x
"""
CALLER = """
from glossy._jit import kernel
import callee_{n} as callee
from callee_{n} import twice

@kernel
def top(x):
    return twice(x) + callee.SCALE
"""


@pytest.fixture(autouse=True)
def _place(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A compile cache of its own, and warnings as in a new process."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    caches = (_cache._warn, _cache._folder, _cache._sweep)
    for cached in caches:
        cached.cache_clear()
    yield
    for cached in caches:
        cached.cache_clear()


def load(folder: pathlib.Path, callee: str = CALLEE, caller: str = CALLER, n: int = 0) -> Any:
    """The kernel ``top`` of two fresh modules that stand in ``folder``."""
    folder.mkdir(exist_ok=True)
    for name, text in ((f"callee_{n}", callee), (f"caller_{n}", caller.format(n=n))):
        path = folder / f"{name}.py"
        path.write_text(text)
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return module.top


def key(top: Any) -> list[str]:
    return list(_cache.dependencies(top))


def kept(tmp_path: pathlib.Path) -> list[pathlib.Path]:
    return sorted((tmp_path / "cache" / "glossy" / "kernels").glob("top-*"))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        pytest.param("2.0 * x", "2.5 * x", id="callee's code"),
        pytest.param("SCALE = 3.0", "SCALE = 4.0", id="callee's constant"),
        pytest.param("@kernel", "@__import__('numba').njit", id="callee's options"),
    ],
)
def test_an_edit_that_reaches_the_kernel_changes_its_file(
    tmp_path: pathlib.Path, old: str, new: str
) -> None:
    assert old in CALLEE
    before, after = load(tmp_path / "a"), load(tmp_path / "b", CALLEE.replace(old, new))
    assert key(before) != key(after)


def test_words_places_and_strangers_do_not(tmp_path: pathlib.Path) -> None:
    """Comments, docstrings, line numbers, other functions and the folder do not count."""
    callee = "# a line\n\nSTRANGER = 1\n" + CALLEE.replace("Two.", "Twice.")
    assert key(load(tmp_path / "a")) == key(load(tmp_path / "b", callee))


def test_constants_that_change_places_change_the_key(tmp_path: pathlib.Path) -> None:
    texts = [
        f"A = {a}\nB = {b}\nC = {c}\n{CALLEE}" for a, b, c in ((1, 2, 1), (2, 2, 1), (1, 1, 2))
    ]
    caller = CALLER.replace("callee.SCALE", "callee.A + 10 * callee.B + 100 * callee.C")
    keys = [key(load(tmp_path / str(i), text, caller)) for i, text in enumerate(texts)]
    assert keys[0] != keys[1]
    assert keys[0] != keys[2]


def test_an_intrinsics_helper_is_part_of_the_key() -> None:
    from glossy.tiles import shade_tiles

    text = " ".join(key(shade_tiles))
    for part in ("glossy._lanes _trilinear", "glossy._lanes splat", "FLOAT8"):
        assert part in text


def test_a_second_place_of_the_same_sources_loads_what_the_first_compiled(
    tmp_path: pathlib.Path,
) -> None:
    first = load(tmp_path / "a")
    assert first(1.5) == 6.0
    second = load(tmp_path / "b")
    assert second(1.5) == 6.0
    assert sum(first.stats.cache_hits.values()) == 0
    assert sum(second.stats.cache_hits.values()) == 1
    assert len(kept(tmp_path)) == 1


@pytest.mark.parametrize("damage", ["flipped", "cut", "empty", "other"])
def test_a_damaged_file_costs_one_compilation_and_one_warning(
    tmp_path: pathlib.Path, damage: str
) -> None:
    load(tmp_path / "a")(1.5)
    (file,) = kept(tmp_path)
    whole = file.read_bytes()
    data = bytearray(whole)
    data[len(data) // 2] ^= 1
    broken = {"flipped": bytes(data), "cut": whole[:-7], "empty": b"", "other": b"no kernel" * 99}
    file.write_bytes(broken[damage])
    with pytest.warns(_cache.CacheWarning, match="damaged") as said:
        assert load(tmp_path / "b")(1.5) == 6.0
    assert len(said) == 1
    assert file.read_bytes()[: len(_cache.MAGIC)] == _cache.MAGIC
    third = load(tmp_path / "c")
    assert third(1.5) == 6.0
    assert sum(third.stats.cache_hits.values()) == 1


def test_a_file_of_another_user_or_that_others_may_write_is_not_run(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load(tmp_path / "a")(1.5)
    (file,) = kept(tmp_path)
    file.chmod(0o666)
    with pytest.warns(_cache.CacheWarning, match="this user alone"):
        assert _cache._read(file) is None
    file.chmod(0o600)
    assert _cache._read(file) is not None
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    _cache._warn.cache_clear()
    with pytest.warns(_cache.CacheWarning, match="this user alone"):
        assert _cache._read(file) is None


def test_a_link_is_not_followed(tmp_path: pathlib.Path) -> None:
    load(tmp_path / "a")(1.5)
    (file,) = kept(tmp_path)
    link = tmp_path / "link.kernel"
    link.symlink_to(file)
    with pytest.warns(_cache.CacheWarning, match="cannot be read"):
        assert _cache._read(link) is None


@pytest.mark.parametrize("fault", ["link", "writeable", "file", "stranger"])
def test_a_folder_that_is_not_the_users_own_is_not_used(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    """Every place is refused, the shared one too: kernels compile and nothing is kept."""
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path / "cache"))
    shared = f"glossy-{os.geteuid()}"
    for name in ("glossy", shared):
        place = tmp_path / "cache" / name / "kernels"
        if fault == "link":
            place.parent.mkdir(parents=True)
            (tmp_path / "elsewhere").mkdir(exist_ok=True)
            place.symlink_to(tmp_path / "elsewhere")
        elif fault == "file":
            place.parent.mkdir(parents=True)
            place.write_text("")
        else:
            place.mkdir(parents=True)
            place.chmod(0o777 if fault == "writeable" else 0o700)
    if fault == "stranger":
        monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
        (tmp_path / "cache" / f"glossy-{os.getuid() + 1}" / "kernels").mkdir(parents=True)
    top = load(tmp_path / "a")
    with pytest.warns(_cache.CacheWarning, match="compiling goes on") as said:
        assert top(1.5) == 6.0
    assert _cache.folder() is None
    assert len(said) == 1
    assert not list((tmp_path / "cache").rglob("*.kernel"))
    assert not list(tmp_path.glob("elsewhere/*"))


def test_the_folder_is_for_its_user_alone(tmp_path: pathlib.Path) -> None:
    before = os.umask(0)
    try:
        load(tmp_path / "a")(1.5)
    finally:
        os.umask(before)
    folder = tmp_path / "cache" / "glossy" / "kernels"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert {f.stat().st_mode & 0o777 for f in folder.iterdir()} == {0o600}


RUN = """
import os, pathlib, sys
sys.path.insert(0, {tests!r})
import test_jit
print(test_jit.load(pathlib.Path({folder!r}), n=9)(1.5))
"""


def run(
    tmp_path: pathlib.Path, env: dict[str, str] | None = None, name: str = "child", **options: Any
) -> Any:
    code = RUN.format(tests=os.path.dirname(__file__), folder=str(tmp_path / name))
    command = [sys.executable, "-c", code]
    keep = {**os.environ, "PYTHONPATH": os.fspath(PACKAGE.parent)}
    full = {k: v for k, v in {**keep, **(env or {})}.items() if v != "-"}
    return subprocess.Popen(
        command, env=full, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )


def test_a_full_disk_costs_one_warning(tmp_path: pathlib.Path) -> None:
    """A limit on file size stands for the full disk: a write fails in the middle of a file."""
    import signal

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    (tmp_path / "child").mkdir()
    child = run(tmp_path, preexec_fn=limit)
    out, err = child.communicate()
    assert (child.returncode, out) == (0, "6.0\n"), err
    assert err.count("CacheWarning") == 1
    assert not list((tmp_path / "cache").rglob("*.kernel"))
    assert not list((tmp_path / "cache").rglob("*.part"))


def test_without_a_home_and_with_an_unknown_user_it_computes(tmp_path: pathlib.Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir(mode=0o1777)
    env = {"NUMBA_CACHE_DIR": "-", "XDG_CACHE_HOME": "-", "HOME": "-", "TMPDIR": str(shared)}
    options: dict[str, Any] = {"user": 54321} if os.geteuid() == 0 else {}
    if options:
        for path in (tmp_path, *tmp_path.parents):
            if not path.stat().st_mode & 0o001:
                options = {}  # an unknown user cannot reach the folder: the missing home is tested
    child = run(tmp_path, env, **options)
    out, err = child.communicate()
    assert (child.returncode, out) == (0, "6.0\n"), err


def test_processes_that_start_cold_at_once_agree_and_leave_whole_files(
    tmp_path: pathlib.Path,
) -> None:
    children = [run(tmp_path, name=f"child-{i}") for i in range(4)]
    results = [(*child.communicate(), child.returncode) for child in children]
    assert results == [("6.0\n", "", 0)] * 4
    (file,) = kept(tmp_path)
    assert _cache._read(file) is not None
    assert not list(file.parent.glob("*.part"))


def test_what_nobody_loads_for_long_is_removed(tmp_path: pathlib.Path) -> None:
    load(tmp_path / "a")(1.5)
    (file,) = kept(tmp_path)
    old = file.with_name(f"old{_cache.SUFFIX}")
    shutil.copy(file, old)
    past = file.stat().st_mtime - 86400.0 * (_cache.UNUSED_DAYS + 1)
    os.utime(old, (past, past))
    _cache._sweep.cache_clear()
    _cache._sweep(file.parent)
    assert file.exists()
    assert not old.exists()


def test_a_modules_sources_are_all_it_leads_to() -> None:
    module = PACKAGE / "tiles.py"
    names = {p.relative_to(PACKAGE).as_posix() for p in _sources.sources_of(module)}
    assert {"tiles.py", "_jit.py", "_lanes.py", "footprint.py", "_check.py"} <= names
    assert not names & {"__init__.py", "cli.py", "render.py"}
