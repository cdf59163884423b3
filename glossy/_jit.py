"""Compile options and the compile cache: the only module that decorates kernels.

Kernels compile lazily, on the first call with a precision, and are kept on disk in a folder
named by a digest of the package's sources: Numba's own check looks at one file, so an edited
callee in another file would leave its callers stale.

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
import tempfile
from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar, cast

import numba
from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

Scalar: TypeAlias = Any
"""A number inside a kernel: float32 or float64 (or an index), as the kernel is compiled for."""


@functools.cache
def cache_folder() -> pathlib.Path:
    """Folder of the compiled kernels for exactly these sources.

    Below ``NUMBA_CACHE_DIR`` if that is set, else ``XDG_CACHE_HOME``, else ``~/.cache``; below
    the system's temporary folder if none of these can be written.
    """
    package = pathlib.Path(__file__).parent
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        digest.update(source.relative_to(package).as_posix().encode())
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
    config.CACHE_DIR = str(cache_folder())
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
