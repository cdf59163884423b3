"""Arrays of npz files: what a file claims is checked before memory is spent on it.

An archive of a few bytes can claim arrays of any size, and NumPy raises a dozen kinds of error for
damaged ones. Headers are read first, their sizes added up and held against the limit of
``_memory``; then the arrays are read.
"""

import math
import os
import zipfile
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _memory
from ._files import check_regular

Array = npt.NDArray[Any]
HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def load_npz(path: str | os.PathLike[str], names: Iterable[str] | None = None) -> dict[str, Array]:
    """Those of the named arrays that an npz file has, or all of them.

    Raises
    ------
    OSError
        If the file cannot be opened, or is no regular file.
    ValueError
        If it is no npz file of number arrays, a damaged one, or one whose arrays would take more
        memory than the limit; one line with the path.
    """
    name = os.fspath(path)
    check_regular(name)
    with open(name, "rb") as stream:
        try:
            archive = zipfile.ZipFile(stream)
            held = [entry.removesuffix(".npy") for entry in archive.namelist()]
            wanted = held if names is None else [n for n in names if n in held]
            need = sum(_claimed(archive, entry) for entry in wanted)
        except Exception:  # whatever zipfile and NumPy's parser of headers raise
            raise _damaged(name) from None
        _memory.check(name, need)
        try:
            return {entry: _array(archive, entry) for entry in wanted}
        except Exception:
            raise _damaged(name) from None


def _damaged(name: str) -> ValueError:
    return ValueError(f"{name}: not an npz file of number arrays")


def _claimed(archive: zipfile.ZipFile, name: str) -> int:
    """Bytes of an array by its header, as float64 at least; refused if its entry has fewer."""
    entry = f"{name}.npy"
    with archive.open(entry) as stream:
        shape, _, dtype = HEADERS[np.lib.format.read_magic(stream)](stream)
    count = math.prod(shape)
    if dtype.hasobject or count * dtype.itemsize > archive.getinfo(entry).file_size:
        raise ValueError
    return int(count * max(dtype.itemsize, 8))  # they will be float64


def _array(archive: zipfile.ZipFile, name: str) -> Array:
    with archive.open(f"{name}.npy") as stream:
        found: Array = np.lib.format.read_array(stream, allow_pickle=False)
    return found
