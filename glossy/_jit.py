"""Compile options and the compile cache: the only module that decorates kernels.

Kernels compile lazily, on the first call with a precision, and are kept on disk in a folder
named by a digest of the sources that the kernel's module leads to, its own and every module of the
package it imports, directly or not: Numba's own check looks at one file, so an edited callee in
another file would leave its callers stale.

``kernel`` compiles a function that other kernels call, or a serial loop; ``parallel_kernel``
one whose outer loop is a ``prange`` over pixels. A serial and a parallel build of one function
would share a cache entry, so each decorated function has exactly one of the two.

``error_model="numpy"``: a division by zero gives inf or nan instead of an exception; the
callers validate first and the tests assert finite results.
"""

import functools
import hashlib
import os
import pathlib
import re
import tempfile
from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar, cast

import numba
from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

Scalar: TypeAlias = Any
"""A number inside a kernel: float32 or float64 (or an index), as the kernel is compiled for."""


_PACKAGE = pathlib.Path(__file__).parent
_IMPORT = re.compile(r"^[ \t]*from[ \t]+(\.+)([\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n#]+)", re.M)


def _imports(source: pathlib.Path, text: str) -> set[pathlib.Path]:
    """Files of the package that a module's relative imports may name."""
    found = set()
    for dots, dotted, names in _IMPORT.findall(text):
        base = source.parents[len(dots) - 1].joinpath(*filter(None, dotted.split(".")))
        found |= {base.with_suffix(".py"), base / "__init__.py"}
        found |= {base / f"{name}.py" for name in re.findall(r"\w+", names)}
    return {path for path in found if path.is_file() and path != _PACKAGE / "__init__.py"}


@functools.cache
def sources_of(module: pathlib.Path) -> tuple[pathlib.Path, ...]:
    """The module's file, this one, and every file of the package that they lead to, sorted."""
    seen: set[pathlib.Path] = set()
    todo = {module, pathlib.Path(__file__)}
    while todo:
        source = todo.pop()
        seen.add(source)
        todo |= _imports(source, source.read_text(encoding="utf-8")) - seen
    return tuple(sorted(seen))


@functools.cache
def cache_folder(module: pathlib.Path) -> pathlib.Path:
    """Folder of the compiled kernels of one source file, for exactly the sources it leads to.

    Below ``NUMBA_CACHE_DIR`` if that is set, else ``XDG_CACHE_HOME``, else ``~/.cache``; below
    the system's temporary folder if none of these can be written.
    """
    digest = hashlib.sha256()
    for source in sources_of(module):
        digest.update(os.path.relpath(source, _PACKAGE).encode())
        digest.update(source.read_bytes())
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    root = pathlib.Path(base) if base else pathlib.Path.home() / ".cache"
    name = pathlib.Path("glossy") / digest.hexdigest()[:16]
    try:
        (root / name).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=root / name):
            pass
    except OSError:
        root = pathlib.Path(tempfile.gettempdir())
        (root / name).mkdir(parents=True, exist_ok=True)
    return root / name


def _compile(func: F, **options: Any) -> F:
    config: Any = numba.config
    saved = config.CACHE_DIR
    config.CACHE_DIR = str(cache_folder(pathlib.Path(func.__code__.co_filename)))
    try:
        return cast(F, njit(cache=True, error_model="numpy", **options)(func))
    finally:
        config.CACHE_DIR = saved


def kernel(func: F) -> F:
    """Compile ``func`` lazily: a helper of other kernels, or a serial loop."""
    return _compile(func)


def parallel_kernel(func: F) -> F:
    """Compile ``func`` lazily with its ``prange`` loops spread over the threads."""
    return _compile(func, parallel=True)
