"""Triangles of mesh files: PLY, STL, OFF and OBJ here, glTF in ``gltf``.

A mesh is what its file says, or is refused: an index that names no vertex, a number that is none, a
body shorter than its header claims. Only shape and normals are read; no other file is opened but
the buffers of a glTF. What reading takes grows with the file's length, whatever the file claims.
"""

import os
import pathlib
import re
import struct
from array import array
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from .._files import check_words, read_bytes
from .gltf import read_gltf
from .soup import Soup, cut

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_mesh(file: str) -> Soup:
    """Triangles of a mesh file; its suffix says of what kind it is.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        One line that names the file, for an unknown suffix and whatever is wrong in it.
    """
    reader = READERS.get(pathlib.Path(file).suffix.lower())
    if reader is None:
        raise _check.fail("file", f"a mesh must end in {', '.join(READERS)}", file)
    data = read_bytes(file)
    try:
        with np.errstate(all="ignore"):  # what overflows is refused where it is used
            return reader(data, os.path.dirname(os.path.abspath(file)))
    except Exception as error:  # damage shows anywhere: keys, shapes, numbers, recursion
        told = isinstance(error, ValueError)
        reason = str(error) if told else f"damaged ({type(error).__name__}: {error})"
        raise ValueError(f"file: {file!r} is no mesh: {_check.shortened(reason, 200)}") from None


# PLY --------------------------------------------------------------------------------------------

TYPES = {
    **{"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I"},
    **{"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I"},
    **{"float": "f", "double": "d", "float32": "f", "float64": "d"},
}  # letters of ``struct``, which with a byte order are NumPy's too
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
INDICES = ("vertex_indices", "vertex_index")

Property = tuple[str, str, str]  # name, type, and the type of the count before a list


def _ply(data: bytes, _folder: str) -> Soup:
    head, mark, body = data.partition(b"end_header")
    if not head.startswith(b"ply") or not mark:
        raise ValueError("has no PLY header")
    order, elements = _ply_header(head)
    body = body[2:] if body.startswith(b"\r\n") else body.lstrip(b" ")[1:]
    if not order:  # text is read as if it were a body of doubles
        check_words("reading it", body)
        body, order = np.array(body.split(), dtype="<f8").tobytes(), "<"
    table: npt.NDArray[Any] | None = None
    polygons = (np.empty(0, dtype=np.int64),) * 2
    at = 0
    for name, rows, properties in elements:
        if any(count for *_, count in properties):
            at, *found = _ply_lists(body, at, rows, properties, order)
            polygons = (found[0], found[1]) if name == "face" else polygons
        else:
            record = np.dtype([(key, order + kind) for key, kind, _ in properties])
            if at + rows * record.itemsize > len(body):
                raise ValueError(f"is cut short: it has no {rows} rows of {name!r}")
            if name == "vertex":
                table = np.frombuffer(body, record, rows if record.itemsize else 0, at)
            at += rows * record.itemsize
        if table is not None and polygons[1].size:
            break
    if table is None or not {*"xyz"} <= {*(table.dtype.names or ())}:
        raise ValueError("has no vertices with x, y and z")
    points = _columns(table, ["x", "y", "z"])
    directed = {"nx", "ny", "nz"} <= {*(table.dtype.names or ())}
    triangles = cut(points, *polygons)
    return Soup(points, triangles, _columns(table, ["nx", "ny", "nz"]) if directed else None)


def _columns(table: npt.NDArray[Any], names: list[str]) -> Float64Array:
    return np.stack([table[name].astype(np.float64) for name in names], axis=1)


def _ply_header(head: bytes) -> tuple[str, list[tuple[str, int, list[Property]]]]:
    """Byte order (none for text), and the name, rows and properties of each element."""
    order: str | None = None
    elements: list[tuple[str, int, list[Property]]] = []
    for line in head.decode("latin-1").splitlines():
        words = line.split()
        key = words[0] if words else ""
        if key == "format":
            order = ORDERS[words[1]]
        elif key == "element":
            elements.append((words[1], _check.count(words[1], int(words[2]), 0), []))
        elif key == "property":
            listed = words[1] == "list"
            kind, count = TYPES[words[-2]], TYPES[words[2]] if listed else ""
            if order == "":
                kind, count = "d", "d" if listed else ""
            elements[-1][2].append((words[-1], kind, count))
    if order is None:
        raise ValueError("names no format")
    return order, elements


def _ply_lists(
    body: bytes, at: int, rows: int, properties: list[Property], order: str
) -> tuple[int, Int64Array, Int64Array]:
    """Where the rows of an element with lists end, and its polygons as ``cut`` takes them."""
    steps = [
        (name in INDICES, struct.Struct(order + count) if count else None, order + kind)
        for name, kind, count in properties
    ]
    lengths, places, wanted = array("q"), array("q"), "<d"
    for _ in range(rows):
        for is_index, code, kind in steps:
            size = SIZES[kind[-1]]
            if code is None:
                at += size
                continue
            (n,) = code.unpack_from(body, at)
            at += code.size
            if n != int(n) or n < 0 or at + n * size > len(body):
                raise ValueError(f"is cut short, or a list has {n:g} entries")
            if is_index:
                lengths.append(int(n))
                places.append(at)
                wanted = kind
            at += int(n) * size
    counts, start = np.array(lengths, dtype=np.int64), np.array(places, dtype=np.int64)
    size = SIZES[wanted[-1]]
    before = np.repeat(np.cumsum(counts) - counts, counts)
    where = np.repeat(start, counts) + size * (np.arange(int(counts.sum())) - before)
    raw = np.frombuffer(body, np.uint8)[where[:, None] + np.arange(size)]
    values = raw.view(wanted).reshape(-1).astype(np.float64)
    if np.any(values != np.floor(values)) or not np.all(np.abs(values) < 2.0**53):
        raise ValueError("an index of a face is not a whole number")
    return at, counts, values.astype(np.int64)


SIZES = {letter: struct.calcsize(f"<{letter}") for letter in "bBhHiIfd"}


# STL, OFF, OBJ ----------------------------------------------------------------------------------


def _stl(data: bytes, _folder: str) -> Soup:
    """Without the normals, which are those of its triangles or wrong."""
    claimed = int.from_bytes(data[80:84], "little")
    if len(data) == 84 + claimed * STL_RECORD.itemsize and claimed:
        corners = np.frombuffer(data, STL_RECORD, offset=84)["corners"].astype(np.float64)
    else:
        check_words("reading it", data)
        found = re.findall(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", data, re.IGNORECASE)
        if not found or len(found) % 3:
            raise ValueError("is neither a text of triangles nor of the length that it claims")
        corners = np.array(found, dtype=np.float64)
    points = corners.reshape(-1, 3)
    return Soup(points, np.arange(len(points)).reshape(-1, 3))


def _off(data: bytes, _folder: str) -> Soup:
    check_words("reading it", data)
    rows = [words for line in data.splitlines() if (words := line.partition(b"#")[0].split())]
    kind = re.fullmatch(rb"(ST)?(C)?(N)?OFF", rows[0].pop(0))
    if kind is None:
        raise ValueError("has no OFF header")
    if not rows[0]:
        rows.pop(0)
    count, faces = (_check.count("count", int(word), 0) for word in rows[0][:2])
    if len(rows) < 1 + count + faces:
        raise ValueError(f"is cut short: it has no {count} vertices and {faces} faces")
    table = np.array([row[: 6 if kind[3] else 3] for row in rows[1 : 1 + count]], dtype=np.float64)
    lengths, corners = array("q"), array("q")
    for row in rows[1 + count : 1 + count + faces]:
        lengths.append(int(row[0]))
        named = row[1 : 1 + lengths[-1]]
        if lengths[-1] < 1 or len(named) < lengths[-1]:
            raise ValueError(f"a face has {len(named)} corners, and claims {lengths[-1]}")
        corners.extend(map(int, named))
    table = table.reshape(count, -1)
    polygons = (np.array(a, dtype=np.int64) for a in (lengths, corners))
    triangles = cut(table[:, :3], *polygons)
    return Soup(table[:, :3], triangles, table[:, 3:6] if kind[3] else None)


def _obj(data: bytes, _folder: str) -> Soup:
    """Vertices, normals and faces; a negative index counts back from what stands before it."""
    check_words("reading it", data)
    places, directions = array("d"), array("d")
    lengths, corners, turned = array("q"), array("q"), array("q")
    joined = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    for number, line in enumerate(joined.splitlines(), 1):
        words = line.partition(b"#")[0].split()
        key = words[0] if words else b""
        try:
            if key in (b"v", b"vn"):
                x, y, z = map(float, words[1:4])
                (places if key == b"v" else directions).extend((x, y, z))
            elif key == b"f":
                lengths.append(len(words) - 1)
                for word in words[1:]:
                    vertex, _, others = word.partition(b"/")
                    corners.append(_obj_index(vertex, len(places) // 3))
                    normal = others.partition(b"/")[2]
                    turned.append(_obj_index(normal, len(directions) // 3) if normal else -1)
        except (ValueError, OverflowError) as error:
            raise ValueError(f"line {number}: {error}") from None
    points = np.array(places).reshape(-1, 3)
    normals = np.concatenate([np.full((1, 3), np.nan), np.array(directions).reshape(-1, 3)])
    named, way = (np.array(a, dtype=np.int64) for a in (corners, turned))
    for what, index, most in (("vertex", named, len(points)), ("normal", way, len(normals) - 1)):
        if index.size and index.max() >= most:
            raise ValueError(f"a face names {what} {index.max() + 1}, of {most}")
    pairs, label = np.unique(np.stack([named, way]), axis=1, return_inverse=True)
    points, label = points[pairs[0]], label.reshape(-1).astype(np.int64)
    triangles = cut(points, np.array(lengths, dtype=np.int64), label)
    return Soup(points, triangles, normals[pairs[1] + 1])


def _obj_index(word: bytes, before: int) -> int:
    """Index from 0 of a word that counts from 1, or back from -1."""
    n = int(word)
    if n == 0 or n < -before:
        raise ValueError(f"a face names number {n}, of {before} before it")
    return n - 1 if n > 0 else before + n


READERS: dict[str, Callable[[bytes, str], Soup]] = {
    ".ply": _ply,
    ".obj": _obj,
    ".stl": _stl,
    ".off": _off,
    ".glb": read_gltf,
    ".gltf": read_gltf,
}
