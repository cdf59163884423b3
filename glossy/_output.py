"""Output files: whole at their place, or what was there before.

A file is written under another name in the same folder, flushed to the disk, read back, and only
then renamed. An existing file keeps its mode and, where the system allows it, its owner. What is
not a regular file (a device, a FIFO, a socket) is never renamed over: it is refused.
"""

import contextlib
import io
import os
import secrets
import stat
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy.typing as npt

Path = str | os.PathLike[str]

READ_BACK = 2**26  # bytes; of larger files the size is checked


@contextlib.contextmanager
def replacing(path: Path, verify: Callable[[str], None] | None = None) -> Iterator[str]:
    """Name of a temporary file beside ``path`` that takes its place on success only.

    Parameters
    ----------
    path : path
        A link is followed. The temporary name keeps the suffix.
    verify : callable, optional
        Called with the temporary name before it is renamed; raises ``OSError`` if the file is not
        whole. An empty file is never accepted.

    Raises
    ------
    OSError
        One line that starts with ``path``: no such folder, a full disk, no permission, something
        that is not a regular file at the place. What was at ``path`` stays.
    """
    shown = os.fspath(path)
    place = os.path.realpath(shown)
    folder, base = os.path.split(place)
    if not os.path.isdir(folder):
        raise FileNotFoundError(f"{shown}: its folder does not exist")
    before = existing(shown, place)
    stem, suffix = os.path.splitext(base)
    stem = stem[:100].encode(errors="ignore").decode()  # libraries take UTF-8 only
    temporary = os.path.join(folder, f".{stem}-{secrets.token_hex(6)}{suffix}")
    try:
        yield temporary
        _settle(temporary, before)
        if verify is not None:
            verify(temporary)
        os.replace(temporary, place)
    except OSError as error:
        text = str(error) if error.errno is None else (error.strerror or "failed").lower()
        head = "" if text.startswith(shown) else f"{shown}: "
        raise type(error)(head + text) from None
    finally:
        with contextlib.suppress(OSError):
            os.unlink(temporary)


def write_bytes(path: Path, data: bytes) -> None:
    """Write ``data``, whole or not at all; ``OSError`` as of `replacing`."""

    def verify(name: str) -> None:
        size = os.stat(name).st_size
        with open(name, "rb") as file:
            whole = size == len(data) and (size > READ_BACK or file.read() == data)
        if not whole:
            raise OSError("what was written does not read back; is the disk full?")

    with replacing(path, verify) as temporary, open(temporary, "wb") as file:
        file.write(data)


def write_text(path: Path, text: str) -> None:
    """Write ``text`` as UTF-8, whole or not at all; ``OSError`` as of `replacing`."""
    write_bytes(path, text.encode())


def write_npz(
    path: Path, arrays: "Mapping[str, npt.NDArray[Any]]", compressed: bool = False
) -> None:
    """Write named number arrays as an npz file, whole or not at all."""
    import numpy as np

    stream = io.BytesIO()
    save: Any = np.savez_compressed if compressed else np.savez
    save(stream, allow_pickle=False, **arrays)
    write_bytes(path, stream.getvalue())


def write_figure(path: Path, figure: Any, **options: Any) -> None:
    """Write a matplotlib figure in the format of the suffix, whole or not at all."""
    stream = io.BytesIO()
    kind = os.path.splitext(os.fspath(path))[1][1:].lower() or "png"
    figure.savefig(stream, format=kind, **options)
    write_bytes(path, stream.getvalue())


def existing(shown: str, place: str) -> os.stat_result | None:
    """Status of the regular file at ``place``, None if there is nothing; else ``OSError``."""
    try:
        status = os.stat(place)
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(f"{shown}: is a directory")
    if not stat.S_ISREG(status.st_mode):
        raise OSError(f"{shown}: is not a regular file and is not replaced")
    return status


def _settle(temporary: str, before: os.stat_result | None) -> None:
    # on the disk, not empty, with the mode and the owner of what it replaces
    handle = os.open(temporary, os.O_RDWR)
    try:
        os.fsync(handle)
        if os.fstat(handle).st_size == 0:
            raise OSError("nothing was written; is the disk full?")
        if before is not None:
            os.chmod(temporary, stat.S_IMODE(before.st_mode))
            if hasattr(os, "fchown"):
                with contextlib.suppress(PermissionError):
                    os.fchown(handle, before.st_uid, before.st_gid)
    finally:
        os.close(handle)
