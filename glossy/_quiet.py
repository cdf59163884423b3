"""Catching what the image libraries print while they read or write.

The C libraries explain a damaged file on the process's standard error or output, and OpenEXR's
binding prints a warning; they would break a command's one-line errors and its JSON.
Other threads that print meanwhile lose nothing: their lines are passed on afterwards.
"""

import contextlib
import ctypes
import io
import os
import re
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from typing import IO, TextIO

_lock = threading.Lock()
_users = 0
_files: dict[int, tuple[IO[bytes], int]] = {}  # by descriptor: what is caught, and where it led
_stdout: TextIO = sys.stdout
_text = io.StringIO()

_OURS = re.compile(
    r"\(EXR_ERR_\w+\)|^libpng (error|warning): |^ojph (info|warning|error) "
    r"|^/.*\.cpp:\d+: \w+: Assertion |^Warning: Exception raised reading pixel data"
)


def _begin() -> None:
    global _users, _stdout, _text
    with _lock:
        _users += 1
        if _users > 1:
            return
        _text, _stdout = io.StringIO(), sys.stdout
        sys.stdout = _text
        _flush()
        for number in (1, 2):
            with contextlib.suppress(OSError):  # closed, or no place for the file
                file = tempfile.TemporaryFile()  # noqa: SIM115 (closed in _end)
                _files[number] = file, os.dup(number)
                os.dup2(file.fileno(), number)


def _end() -> None:
    global _users
    with _lock:
        _users -= 1
        if _users:
            return
        sys.stdout = _stdout
        _flush()
        for number, (file, saved) in _files.items():
            text = _said(number)
            os.dup2(saved, number)
            with contextlib.suppress(OSError):
                os.close(saved)
            file.close()
            for said in text.splitlines(keepends=True):
                if not _OURS.search(said.decode("latin-1")):
                    os.write(number, said)
        _files.clear()
        for line in _text.getvalue().splitlines(keepends=True):
            if not _OURS.search(line):
                sys.stdout.write(line)


def _flush() -> None:
    """Let go of what C's ``printf`` holds back where standard output is no terminal."""
    with contextlib.suppress(OSError, AttributeError, TypeError):  # no such library by no name
        ctypes.CDLL(None).fflush(None)


def _said(number: int = 2) -> bytes:
    if number not in _files:
        return b""
    try:
        file = _files[number][0].fileno()
        return os.pread(file, os.fstat(file).st_size, 0)
    except OSError:
        return b""


def _reason(name: str) -> str:
    lines = [m for m in _said().decode(errors="replace").splitlines() if m.startswith(f"{name}: ")]
    return _OURS.sub("", lines[0][len(name) + 2 :]).strip() if lines else ""


@contextlib.contextmanager
def c_messages() -> Iterator[Callable[[str], str]]:
    """Catch the library's messages; gives a function from a file's name to its first one."""
    _begin()
    try:
        yield _reason
    finally:
        _end()
