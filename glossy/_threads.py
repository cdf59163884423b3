"""Work over rows, shared among a few threads of our own.

A kernel that fills rows independently takes the range of them, ``(begin, end, ...)``, and lets go
of Python's lock (`_jit.row_kernel`). `in_rows` cuts the rows into the same chunks whatever the
number of threads, so that no result depends on it, and lets the caller and its helpers take one
chunk after the other. Any number of Python threads may call at once, a fork is safe at any time,
and an interruption is answered after the running chunks.
"""

import itertools
import os
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

CHUNKS = 64  # at most, of one call: enough to even out rows of unlike cost

_lock = threading.Lock()
_pool: ThreadPoolExecutor | None = None
_asked = threading.local()


def available() -> int:
    """Processors this process may use; ``NUMBA_NUM_THREADS`` if that is set to less."""
    try:
        processors = len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        processors = os.cpu_count() or 1
    wanted = os.environ.get("NUMBA_NUM_THREADS", "")
    return min(int(wanted) or processors, processors) if wanted.isdigit() else processors


def threads() -> int:
    """How many threads a call uses now: what `using` or ``numba.set_num_threads`` say, or all."""
    asked: int | None = getattr(_asked, "count", None)
    if asked is not None:
        return asked
    numbas: Any = sys.modules.get("numba.np.ufunc.parallel")
    if numbas is not None and numbas._is_initialized:
        return min(int(numbas.get_num_threads()), available())
    return available()


@contextmanager
def using(count: int) -> Iterator[None]:
    """Within this context the calls of this thread use ``count`` threads."""
    before, _asked.count = getattr(_asked, "count", None), count
    try:
        yield
    finally:
        _asked.count = before


def in_rows(kernel: Callable[..., Any], count: int, *args: Any, grain: int = 1) -> None:
    """Call ``kernel(begin, end, *args)`` for consecutive ranges of ``count`` rows.

    Parameters
    ----------
    kernel : row kernel
        Fills rows ``begin`` to ``end`` (excluded); ranges do not touch each other's.
    count : int
        Rows in all.
    grain : int
        Rows that a range has at least: as many as are worth handing over (some 50 microseconds).
    """
    step = max(grain, -(-count // CHUNKS), 1)
    helpers = min(threads(), -(-count // step)) - 1
    if helpers < 1:
        if count > 0:
            kernel(0, count, *args)
        return
    starts = itertools.count(0, step)  # its next() is one step of the interpreter
    stop = threading.Event()

    def work() -> None:
        while not stop.is_set():
            begin = next(starts)
            if begin >= count:
                return
            kernel(begin, min(begin + step, count), *args)

    pool = _threads()
    jobs: list[Future[None]] = [pool.submit(work) for _ in range(helpers)]
    try:
        work()
    finally:  # an error or an interruption ends the others after their chunk
        stop.set()
        waiting = [job for job in jobs if not job.cancel()]
        for job in waiting:
            job.exception()
    for job in waiting:
        job.result()


def _threads() -> ThreadPoolExecutor:
    global _pool
    with _lock:
        if _pool is None:
            _pool = ThreadPoolExecutor(max(available() - 1, 1), thread_name_prefix="glossy")
        return _pool


def _forget() -> None:
    # a child of a fork has none of its parent's threads
    global _pool, _lock
    _pool, _lock = None, threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
