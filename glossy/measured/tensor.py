r"""Tensor files: named arrays of any shape in one little-endian file, as RGL's ``.bsdf`` are.

First ``tensor_file\0``, two bytes of version and the number of fields (u32); then for each field
the length of its name (u16), the name, the number of dimensions (u16), the type (u8), the offset
of its values in the file (u64) and the shape (u64 each).
"""

import math
import pathlib
import struct
from typing import Any

import numpy as np
import numpy.typing as npt

from .._files import read_bytes

MAGIC = b"tensor_file\0"
TYPES = {
    1: "u1",
    2: "i1",
    3: "<u2",
    4: "<i2",
    5: "<u4",
    6: "<i4",
    7: "<u8",
    8: "<i8",
    9: "<f2",
    10: "<f4",
    11: "<f8",
}
MOST_FIELDS = 1024
MOST_DIMENSIONS = 16


def read_tensors(path: str | pathlib.Path) -> dict[str, npt.NDArray[Any]]:
    """All fields of a tensor file, as read-only views of its bytes.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not a tensor file, or cut short, or says what cannot be.
    """
    data = read_bytes(path)
    if not data.startswith(MAGIC):
        raise ValueError(f"{path}: is not a tensor file")
    try:
        major, minor, count = struct.unpack_from("<BBI", data, len(MAGIC))
        if major != 1:
            raise ValueError(f"{path}: is a tensor file of version {major}.{minor}, not 1")
        if count > MOST_FIELDS:
            raise ValueError(f"{path}: names {count} fields, more than the limit of {MOST_FIELDS}")
        at = len(MAGIC) + 6
        fields: dict[str, npt.NDArray[Any]] = {}
        for _ in range(count):
            (length,) = struct.unpack_from("<H", data, at)
            name = data[at + 2 : at + 2 + length].decode("utf-8")
            at += 2 + length
            dimensions, kind, offset = struct.unpack_from("<HBQ", data, at)
            if dimensions > MOST_DIMENSIONS or kind not in TYPES:
                raise ValueError(f"{path}: field {name[:40]!r} has an unknown shape or type")
            shape = struct.unpack_from(f"<{dimensions}Q", data, at + 11)
            at += 11 + 8 * dimensions
            size = math.prod(shape)
            if offset + size * np.dtype(TYPES[kind]).itemsize > len(data):
                raise ValueError(f"{path}: is cut short: field {name[:40]!r} ends beyond it")
            fields[name] = np.frombuffer(data, TYPES[kind], size, offset).reshape(shape)
    except (struct.error, UnicodeDecodeError):
        raise ValueError(f"{path}: is cut short or damaged in its list of fields") from None
    return fields
