"""How much a command says: ``--quiet``, ``--verbose``, and that it compiles."""

import contextlib
import platform
import sys
import time
from collections.abc import Iterator, Sequence
from typing import Any

QUIET, NORMAL, VERBOSE = range(3)

WORDS = {"-q": QUIET, "--quiet": QUIET, "-v": VERBOSE, "--verbose": VERBOSE}
HELP = {
    "--quiet": "only errors, and what --json or a command without output files prints",
    "--verbose": "also versions, what is compiled and how long, and where an error arose",
}
WITHOUT_COMPILER = ("compare", "pattern")
"""Commands that start without the compiler and say nothing of it."""


def split_words(words: Sequence[str]) -> tuple[list[str], int]:
    """The words without ``--quiet`` and ``--verbose``, which may stand anywhere, and the level."""
    end = list(words).index("--") if "--" in words else len(words)
    levels = [WORDS[word] for word in words[:end] if word in WORDS]
    kept = [word for word in words[:end] if word not in WORDS]
    return [*kept, *words[end:]], levels[-1] if levels else NORMAL


@contextlib.contextmanager
def telling(command: str, level: int) -> Iterator[None]:
    """Say on standard error that kernels are compiled, and under ``--verbose`` how it went.

    The first is said once and on a terminal only: a first call may be silent for a minute else.
    """
    said = level == VERBOSE or (level == NORMAL and sys.stderr.isatty())
    start = time.perf_counter()
    with contextlib.ExitStack() as stack:
        if said and command not in WITHOUT_COMPILER:
            stack.enter_context(_compilation(level))
        yield
    if level == VERBOSE:
        _tell(f"{_versions()}; {time.perf_counter() - start:.2f} s")


def _tell(text: str) -> None:
    print(f"glossy: {text}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def _compilation(level: int) -> Iterator[None]:
    from numba.core import event

    class Listener(event.Listener):
        count, depth, since = 0, 0, 0.0

        def on_start(self, found: Any) -> None:
            if not self.count:
                _tell("compiling kernels, once on this machine; a first call may take a minute")
            self.count += 1
            self.depth += 1
            if self.depth == 1:
                self.since = time.perf_counter()

        def on_end(self, found: Any) -> None:
            self.depth -= 1
            if level == VERBOSE and not self.depth:
                name = found.data["dispatcher"].py_func.__name__
                _tell(f"compiled {name} in {time.perf_counter() - self.since:.2f} s")

    listener = Listener()
    event.register("numba:compile", listener)  # type: ignore[no-untyped-call]
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)  # type: ignore[no-untyped-call]


def _versions() -> str:
    from importlib.metadata import version

    from .._version import __version__

    others = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba"))
    return f"glossy {__version__}, Python {platform.python_version()}, {others}"
