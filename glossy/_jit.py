"""Compile options and the compile cache: the only module that decorates kernels.

Kernels compile lazily, on the first call with a precision, and are kept on disk by `_cache`, which
follows every function and constant a kernel leads to: Numba's own check looks at one file, so an
edited callee in another file would leave its callers stale.

``kernel`` compiles a function that other kernels call, or a serial loop; ``row_kernel`` one that
fills a range of rows, which `_threads.in_rows` shares among threads. There is no
``parallel=True``: it compiles a quarter longer, and its threads do not survive a fork.

``error_model="numpy"``: a division by zero gives inf or nan instead of an exception; the
callers validate first and the tests assert finite results.
"""

from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar, cast

from numba import njit

from ._cache import KernelCache

F = TypeVar("F", bound=Callable[..., Any])

Scalar: TypeAlias = Any
"""A number inside a kernel: float32 or float64 (or an index), as the kernel is compiled for."""


def _compile(func: F, **options: Any) -> F:
    options["error_model"] = "numpy"
    dispatcher: Any = njit(**options)(func)
    if hasattr(dispatcher, "_cache"):  # a plain function under NUMBA_DISABLE_JIT
        dispatcher._cache = KernelCache(func, options)
    return cast(F, dispatcher)


def kernel(func: F) -> F:
    """Compile ``func`` lazily: a helper of other kernels, or a serial loop."""
    return _compile(func)


def row_kernel(func: F) -> F:
    """Compile ``func(begin, end, ...)`` lazily for `_threads.in_rows`: without Python's lock."""
    return _compile(func, nogil=True)
