"""``-`` where a command reads one file: what is piped in, as a file that can be read twice."""

import contextlib
import os
import sys
import tempfile
from collections.abc import Iterator

MOST_BYTES = 2**32


@contextlib.contextmanager
def spooled(label: str) -> Iterator[str]:
    """Name of a temporary file with all of standard input, removed in the end.

    Raises
    ------
    ValueError
        If it is empty, closed, longer than ``MOST_BYTES``, or a terminal; names ``label``.
    """
    if sys.stdin is None:
        raise ValueError(f"{label}: standard input is closed")
    if sys.stdin.isatty():
        raise ValueError(f"{label}: standard input is a terminal, and nothing is piped in")
    descriptor, name = tempfile.mkstemp(prefix="glossy-")
    try:
        with os.fdopen(descriptor, "wb") as file:
            size = 0
            while block := sys.stdin.buffer.read(2**20):
                size += len(block)
                if size > MOST_BYTES:
                    raise ValueError(f"{label}: standard input is longer than {MOST_BYTES} bytes")
                file.write(block)
        if not size:
            raise ValueError(f"{label}: standard input is empty")
        yield name
    finally:
        os.unlink(name)
