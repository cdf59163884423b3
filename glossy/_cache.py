"""Compiled kernels on disk: one file for each kernel and signature, in a folder of the user's own.

A file's name is a digest of everything the machine code depends on: the bytecode and constants of
the kernel and of every function it leads to, the argument types, the processor, the compile
options, the versions of Python, NumPy, Numba and LLVM. Paths, comments, docstrings and line
numbers are not part of it, so a checkout, an installed copy and every worker share their kernels,
and an edit recompiles only the kernels that lead to what was edited.

A file is code that will run, so it is loaded only if it is a regular file of this user that nobody
else can write, in a folder of which the same holds, and if its checksum is right. Whatever goes
wrong here (no folder, a full disk, a damaged file) costs a compilation and one warning; it never
stops a computation.
"""

import contextlib
import functools
import hashlib
import os
import pathlib
import pickle
import platform
import re
import secrets
import stat
import tempfile
import time
import types
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core import config
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

_rebuild: Any = CompileResult._rebuild
_dumps: Any = dumps

MAGIC = b"glossy kernel 1\n"
SUFFIX = ".kernel"
UNUSED_DAYS = 180  # a file that nobody loaded for so long is removed

_VERSIONS = (platform.python_version(), np.__version__, numba.__version__, llvmlite.__version__)
_LIBRARIES = {"builtins", "llvmlite", "math", "numba", "numpy", "operator", "typing"}
_OPTIONS = ("BOUNDSCHECK", "DEBUGINFO_DEFAULT", "LOOP_VECTORIZE", "OPT", "SLP_VECTORIZE")
_BINARY = getattr(os, "O_BINARY", 0)  # Windows
_ADDRESS = re.compile(r" at 0x[0-9a-f]+")


class CacheWarning(UserWarning):
    """Compiled kernels cannot be kept, or a kept one is damaged; results are not affected."""


@functools.cache
def _warn(reason: str) -> None:
    # once for each reason in a process
    warnings.warn(f"compiled kernels: {reason}; compiling goes on", CacheWarning, stacklevel=2)


# --- where ---------------------------------------------------------------------------------------


def _own(status: os.stat_result) -> bool:
    """Whether this user owns it and nobody else can write to it."""
    if not hasattr(os, "geteuid"):  # Windows: below the user's profile
        return True
    return status.st_uid == os.geteuid() and not status.st_mode & 0o022


def _places() -> Iterator[pathlib.Path]:
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    home = os.path.expanduser("~")  # stays "~" for a user without a home
    if base:
        yield pathlib.Path(base).absolute() / "glossy"
    elif os.path.isabs(home):
        yield pathlib.Path(home) / ".cache" / "glossy"
    try:
        shared = pathlib.Path(tempfile.gettempdir())
    except OSError:
        return
    yield shared / f"glossy-{os.geteuid() if hasattr(os, 'geteuid') else 'user'}"


@functools.cache
def _folder(place: pathlib.Path) -> tuple[pathlib.Path | None, str]:
    """The folder below a place, or None and why."""
    folder = place / "kernels"
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        for path in (place, folder):
            path.mkdir(mode=0o700, exist_ok=True)
        status = [os.lstat(path) for path in (place, folder)]
        if all(stat.S_ISDIR(s.st_mode) and _own(s) for s in status):
            with tempfile.TemporaryFile(dir=folder):
                return folder, ""
        return None, f"{folder} is not a folder that this user alone can write"
    except OSError as error:
        return None, f"{folder} cannot be used ({(error.strerror or 'failed').lower()})"


def folder() -> pathlib.Path | None:
    """Folder of the kept kernels, mode 0700; None if there is none that is this user's own.

    ``$NUMBA_CACHE_DIR/glossy/kernels``, else ``$XDG_CACHE_HOME/...``, else ``~/.cache/...``; if
    that cannot be used, a folder named by the user's number in the system's temporary folder.
    """
    reasons = []
    for place in _places():
        found, reason = _folder(place)
        if found is not None:
            return found
        reasons.append(reason)
    _warn("; ".join(reasons) or "there is no place to keep them")
    return None


# --- what a kernel's code depends on -------------------------------------------------------------


def dependencies(function: Any) -> Iterator[str]:
    """Everything that ``function`` compiles to, as text: code, constants, functions it calls.

    Globals are followed by name, attributes of modules too; what belongs to Numba, NumPy and LLVM
    is named, not followed.
    """
    met: set[int] = set()
    todo: list[Any] = [function]
    while todo:
        value = todo.pop()
        if id(value) in met:
            continue
        met.add(id(value))
        if hasattr(value, "py_func"):  # a kernel
            yield f"options {sorted(value.targetoptions.items())}"
            value = value.py_func
        value = getattr(value, "_defn", value)  # of an intrinsic
        names: list[str] = []
        yield f"def {value.__module__} {value.__qualname__} {value.__defaults__}"
        yield from _code(value.__code__, value.__doc__, names)
        cells = zip(value.__code__.co_freevars, value.__closure__ or (), strict=True)
        scope = [(name, cell.cell_contents) for name, cell in cells]
        for name, other in (*scope, *_globals(value.__globals__, names)):
            if _followed(other):
                todo.append(other)
                yield f"{name} is {other.__module__} {other.__qualname__}"
            else:
                yield f"{name} = {_constant(other)}"


def _followed(value: Any) -> bool:
    code = isinstance(value, types.FunctionType) or hasattr(value, "py_func")
    return (code or hasattr(value, "_defn")) and value.__module__.split(".")[0] not in _LIBRARIES


def _code(code: types.CodeType, doc: str | None, names: list[str]) -> Iterator[str]:
    names += code.co_names
    yield f"{code.co_code.hex()} {code.co_names} {code.co_varnames} {code.co_freevars}"
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _code(constant, None, names)
        elif doc is None or constant != doc:
            yield _constant(constant)


def _globals(scope: dict[str, Any], names: list[str]) -> Iterator[tuple[str, Any]]:
    for name in names:
        value = scope.get(name)
        if not isinstance(value, types.ModuleType):
            if name in scope:
                yield name, value
        elif value.__name__.split(".")[0] not in _LIBRARIES:
            yield from ((f"{name}.{n}", getattr(value, n)) for n in names if hasattr(value, n))


def _constant(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, frozenset):
        return f"set {sorted(map(_constant, value))}"
    if isinstance(value, tuple):
        return f"{type(value).__qualname__} {[_constant(item) for item in value]}"
    text = getattr(value, "__qualname__", None) or repr(value)
    fields = getattr(value, "_fields", "")
    return f"{type(value).__qualname__} {_ADDRESS.sub('', text)} {fields}"


# --- the cache of one kernel ---------------------------------------------------------------------


class KernelCache(NullCache):
    """What Numba's dispatcher asks before it compiles a signature, and tells afterwards."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self._function, self._options = function, options
        self._sources = ""

    @property
    def cache_path(self) -> str | None:
        """The folder, as text."""
        place = folder()
        return None if place is None else str(place)

    def file_name(self, signature: Any, codegen: Any) -> str:
        """Name of the file of one signature on one processor."""
        if not self._sources:
            digest = hashlib.sha256()
            for part in (*dependencies(self._function), repr(sorted(self._options.items()))):
                digest.update(part.encode() + b"\0")
            self._sources = digest.hexdigest()
        options = [getattr(config, name, None) for name in _OPTIONS]
        key = (self._sources, str(signature), codegen.magic_tuple(), _VERSIONS, options)
        name = re.sub(r"\W+", "-", self._function.__qualname__)[:60]
        return f"{name}-{hashlib.sha256(repr(key).encode()).hexdigest()[:32]}{SUFFIX}"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled signature, or None."""
        target_context.refresh()
        place = folder()
        if place is None:
            return None
        path = place / self.file_name(sig, target_context.codegen())
        try:
            payload = _read(path)
            if payload is not None:
                return _rebuild(target_context, *pickle.loads(payload))
        except Exception as error:  # whole, yet of another build
            _warn(f"{path} cannot be loaded ({type(error).__name__})")
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled signature, if Numba can store it and there is a place."""
        if any(not lifted.can_cache for lifted in data.lifted) or data.library.has_dynamic_globals:
            return
        place = folder()
        if place is None:
            return
        payload = _dumps(data._reduce())
        _write(place / self.file_name(sig, data.codegen), payload)


def _read(path: pathlib.Path) -> bytes | None:
    """What was kept, if the file is there, this user's own, and whole."""
    try:
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | _BINARY)
    except FileNotFoundError:
        return None
    except OSError as error:
        _warn(f"{path} cannot be read ({(error.strerror or 'failed').lower()})")
        return None
    with open(handle, "rb") as file:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode) or not _own(status):
            _warn(f"{path} is not a file that this user alone can write")
            return None
        data = file.read()
    payload = data[len(MAGIC) + 32 :]
    if data[: len(MAGIC) + 32] != MAGIC + hashlib.sha256(payload).digest():
        _warn(f"{path} is damaged and is replaced")
        return None
    if time.time() - status.st_mtime > 86400.0:
        with contextlib.suppress(OSError):
            os.utime(path)  # in use: not to be swept away
    return payload


def _write(path: pathlib.Path, payload: bytes) -> None:
    """Put the file at its place in one step; several processes may do so at once."""
    temporary = path.with_name(f".{secrets.token_hex(8)}.part")
    try:
        _sweep(path.parent)
        handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY, 0o600)
        with open(handle, "wb") as file:
            file.write(MAGIC + hashlib.sha256(payload).digest() + payload)
        os.replace(temporary, path)
    except OSError as error:
        _warn(f"{path.parent} cannot be written ({(error.strerror or 'failed').lower()})")
    finally:
        with contextlib.suppress(OSError):
            os.unlink(temporary)


@functools.cache
def _sweep(place: pathlib.Path) -> None:
    """Remove what nobody used for long, once in a process."""
    now = time.time()
    with os.scandir(place) as entries:
        for entry in entries:
            days = 1.0 if entry.name.endswith(".part") else UNUSED_DAYS
            if entry.stat(follow_symlinks=False).st_mtime < now - 86400.0 * days:
                os.unlink(entry.path)
