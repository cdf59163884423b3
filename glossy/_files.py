"""Bytes of a file, with the refusals that all readers share."""

import codecs
import json
import os
import pathlib
import re
import stat
import tomllib
from collections.abc import Callable
from typing import Any, TypeGuard

from . import _check, _memory

MOST_BYTES = 1 << 30
MOST_TABLE = 1 << 24  # a scene or a material of more is none

LONGEST_NAME = 4096
MOST_PARTS = 64  # of a dotted key of TOML, whose parser takes the square of their number
_LONG_KEY = re.compile(
    rf"""(?:\.[ \t]*+(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+){{{MOST_PARTS}}}""", re.ASCII
)

WORD = 64  # bytes that a word of a text takes while it is read, its number included

Path = str | os.PathLike[str]


def is_name(value: object) -> TypeGuard[str]:
    """True for a text that may be a path and, quoted in a message, stays on its line."""
    if not isinstance(value, str) or not 0 < len(value) <= LONGEST_NAME or "\0" in value:
        return False
    return len(f"{value}.".splitlines()) == 1


def check_words(name: str, text: bytes | str) -> None:
    """Refuse a text whose words would take more memory than may be spent."""
    if isinstance(text, str):  # of which any other character may be a blank
        _memory.check(name, WORD // 2 * len(text))
    else:
        _memory.check(name, WORD * (1 + sum(map(text.count, (b" ", *b"\n\t\r\f\v")))))


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """All of a regular file that is neither empty nor longer than ``most``.

    Raises
    ------
    OSError
        As ``check_regular``, and for no permission.
    ValueError
        Empty, or too long.
    """
    data = _contents(path, most)
    if not data:
        raise ValueError(f"{os.fspath(path)}: is empty")
    return data


def check_regular(path: Path) -> int:
    """Size of a regular file. Devices, pipes and sockets are never opened: some have no end.

    Raises
    ------
    OSError
        No such file, a directory, no regular file.
    """
    name = os.fspath(path)
    try:
        status = os.stat(name)
    except OSError as error:
        raise type(error)(f"{name}: {(error.strerror or 'unreadable').lower()}") from None
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(f"{name}: is a directory, not a regular file")
    if not stat.S_ISREG(status.st_mode):
        raise OSError(f"{name}: is not a regular file")
    return status.st_size


def _contents(path: Path, most: int) -> bytes:
    name, size = os.fspath(path), check_regular(path)
    if size > most:
        raise ValueError(f"{name}: has {size} bytes, more than the limit of {most}")
    return first_bytes(name, size)  # room is made for as much as is asked


def first_bytes(path: Path, count: int) -> bytes:
    """The first bytes of a regular file; ``OSError`` as of ``check_regular``, or no permission."""
    name = os.fspath(path)
    check_regular(name)
    try:
        with open(name, "rb") as file:
            return file.read(count)
    except OSError as error:
        raise type(error)(f"{name}: {(error.strerror or 'unreadable').lower()}") from None


def read_text(path: Path) -> str:
    """All of a text file, UTF-8 or Latin-1; a file with zero bytes is not text."""
    data = read_bytes(path)
    if b"\0" in data:
        raise ValueError(f"{os.fspath(path)}: is not a text file")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def read_toml(path: Path) -> dict[str, Any]:
    """What a TOML file holds; UTF-8, a byte order mark is skipped.

    Raises
    ------
    OSError, ValueError
        As ``read_bytes`` but for empty files, and for text that is not TOML.
    """
    return dict(_parsed(path, "TOML", _toml))


def read_table(path: Path) -> Any:
    """What a file holds, JSON if its suffix says so and TOML otherwise; see ``read_toml``."""
    if pathlib.Path(path).suffix.lower() == ".json":
        return _parsed(path, "JSON", json.loads)
    return read_toml(path)


def _toml(text: str) -> dict[str, Any]:
    if _LONG_KEY.search(text):
        raise ValueError(f"a key of more than {MOST_PARTS} parts")
    return tomllib.loads(text)


def _parsed(path: Path, kind: str, parse: Callable[[str], Any]) -> Any:
    data = _contents(path, MOST_TABLE)
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) or b"\0" in data:
        raise ValueError(f"{os.fspath(path)}: must be {kind} in UTF-8, not in UTF-16 or binary")
    try:
        return parse(data.decode("utf-8-sig"))
    except RecursionError:
        reason = "tables nested too deeply"
    except ValueError as error:  # bad syntax, bad UTF-8, numbers of thousands of digits
        reason = str(error)
    raise ValueError(f"{os.fspath(path)}: must be {kind}, got {_check.shortened(reason)}")
