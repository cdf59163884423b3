"""Bytes of a file, with the refusals that all readers share."""

import os
import pathlib
import stat

MOST_BYTES = 1 << 30


def read_bytes(path: str | pathlib.Path, most: int = MOST_BYTES) -> bytes:
    """All of a regular file that is neither empty nor longer than ``most``.

    Raises
    ------
    OSError
        No such file, a directory, no permission.
    ValueError
        Empty, or too long.
    """
    name = os.fspath(path)
    try:
        status = os.stat(name)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(f"{name}: is not a regular file")
        if status.st_size > most:
            raise ValueError(f"{name}: has {status.st_size} bytes, more than the limit of {most}")
        with open(name, "rb") as file:
            data = file.read(most)
    except OSError as error:
        if error.errno is None:
            raise
        raise type(error)(f"{name}: {(error.strerror or 'unreadable').lower()}") from None
    if not data:
        raise ValueError(f"{name}: is empty")
    return data


def read_text(path: str | pathlib.Path) -> str:
    """All of a text file, UTF-8 or Latin-1; a file with zero bytes is not text."""
    data = read_bytes(path)
    if b"\0" in data:
        raise ValueError(f"{os.fspath(path)}: is not a text file")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")
