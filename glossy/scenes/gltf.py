"""Triangles of glTF 2.0 files, text and binary: the meshes of a scene in their places.

Materials, skins, animation and morph targets are not read. Geometry that is stored as this reader
does not know (compressed, sparse, instanced) is refused, not left out. A buffer is in the file or
in a file of the folder that the mesh lies in, or below it. Source: Khronos, glTF 2.0 specification.
"""

import base64
import json
import os
import struct
import urllib.parse
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _memory
from .._files import MOST_BYTES, read_bytes
from .soup import Soup

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC3": 3}
TRIANGLES, STRIP, FAN = 4, 5, 6
HARMLESS = (
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "KHR_mesh_quantization",
)
REPEATS = "EXT_mesh_gpu_instancing"
BYTES = 200  # that a vertex or an index takes while the mesh is made
MOST_PARTS = 100_000


def read_gltf(data: bytes, folder: str) -> Soup:
    """All triangles of the file's scene; ``folder`` is where the names of its buffers lead.

    Raises
    ------
    Exception
        Of any kind, where the file is damaged.
    """
    text, binary = _chunks(data) if data.startswith(b"glTF") else (data, b"")
    _memory.check("reading it", 10 * len(text))
    tree = json.loads(text.decode("utf-8-sig"))
    if str(tree["asset"]["version"]).split(".")[0] != "2":
        raise ValueError(f"is glTF {tree['asset']['version']}, not 2")
    unknown = [e for e in tree.get("extensionsRequired", []) if not e.startswith(HARMLESS)]
    if REPEATS in tree.get("extensionsUsed", []):
        unknown.append(REPEATS)
    if unknown:
        raise ValueError(f"needs {', '.join(unknown)}, which is not read")
    reader = _Reader(tree, binary, folder)
    placed, size = [], 0
    for primitive, matrix in reader.placed():
        placed.append((primitive, matrix))
        size += BYTES * reader.size(primitive)
        _memory.check("reading it", size)
        if len(placed) > MOST_PARTS:
            raise ValueError(f"has more than {MOST_PARTS} parts")
    parts, first = [], 0
    for primitive, matrix in placed:
        points, triangles, normals = reader.primitive(primitive, matrix)
        parts.append((points, triangles + first, normals))
        first += len(points)
    if not parts:
        raise ValueError("has no triangles in its scene")
    points, triangles, normals = (np.concatenate(p) for p in zip(*parts, strict=True))
    return Soup(points, triangles, normals)


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """The JSON of a binary file, and the first chunk of bytes after it."""
    found: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= len(data):
        length, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + length > len(data):
            raise ValueError("is cut short")
        found.setdefault(kind, data[at + 8 : at + 8 + length])
        at += 8 + length
    return found[b"JSON"], found.get(b"BIN\0", b"")


class _Reader:
    def __init__(self, tree: dict[str, Any], binary: bytes, folder: str) -> None:
        self.tree, self.binary, self.folder = tree, binary, folder
        self.buffers: dict[int, bytes] = {}

    def buffer(self, index: int) -> bytes:
        """The bytes of a buffer, read once."""
        if index not in self.buffers:
            uri = self.tree["buffers"][index].get("uri")
            data = self.binary if uri is None and index == 0 else self._outside(uri)
            self.buffers[index] = data
            _memory.check("reading it", sum(map(len, self.buffers.values())))
        return self.buffers[index]

    def _outside(self, uri: str) -> bytes:
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2], validate=True)
        name = urllib.parse.unquote(uri)
        root = os.path.realpath(self.folder)
        path = os.path.realpath(os.path.join(root, name))
        if ":" in name or os.path.commonpath([root, path]) != root:
            raise ValueError(f"names a buffer outside its folder, {uri[:80]!r}")
        return read_bytes(path, min(MOST_BYTES, _memory.limit()))

    def accessor(self, index: int, width: str) -> npt.NDArray[Any]:
        """(count, width) numbers in a view of their bytes."""
        entry = self.tree["accessors"][_whole(index)]
        if "sparse" in entry or "bufferView" not in entry:
            raise ValueError("has sparse or empty accessors, which are not read")
        if entry["type"] != width:
            raise ValueError(f"has an accessor of {entry['type']}, not {width}")
        view = self.tree["bufferViews"][_whole(entry["bufferView"])]
        kind, count = np.dtype(TYPES[entry["componentType"]]), _whole(entry["count"])
        row = WIDTHS[width] * kind.itemsize
        stride = _whole(view.get("byteStride", row))
        start, inside = _whole(view.get("byteOffset", 0)), _whole(entry.get("byteOffset", 0))
        data = self.buffer(_whole(view["buffer"]))
        end = inside + (count - 1) * stride + row if count else 0
        if stride < row or end > _whole(view["byteLength"]) or start + end > len(data):
            raise ValueError("has an accessor that ends beyond its buffer")
        shape, strides = (count, WIDTHS[width]), (stride, kind.itemsize)
        values: npt.NDArray[Any] = np.ndarray(shape, kind, data, start + inside, strides)
        if entry.get("normalized") and kind.kind in "iu":
            return np.maximum(values / np.iinfo(kind).max, -1.0)
        return values

    def size(self, primitive: dict[str, Any]) -> int:
        """How many vertices and indices a primitive claims."""
        named = [primitive["attributes"]["POSITION"], primitive.get("indices")]
        entries = self.tree["accessors"]
        return sum(_whole(entries[_whole(k)]["count"]) for k in named if k is not None)

    def placed(self) -> Iterator[tuple[dict[str, Any], Float64Array]]:
        """Primitives of triangles, with the matrix (4, 4) to the world of each."""
        nodes, meshes = self.tree.get("nodes", []), self.tree.get("meshes", [])
        if "scenes" in self.tree:
            roots = self.tree["scenes"][_whole(self.tree.get("scene", 0))].get("nodes", [])
        else:
            roots = sorted(
                set(range(len(nodes))) - {c for n in nodes for c in n.get("children", [])}
            )
        todo, seen = [(k, np.eye(4)) for k in reversed(roots)], set()
        while todo:
            index, matrix = todo.pop()
            if _whole(index) in seen:
                raise ValueError(f"has two ways to node {index}")
            seen.add(index)
            node = nodes[index]
            matrix = matrix @ _local(node)
            todo += [(k, matrix) for k in reversed(node.get("children", []))]
            if "mesh" in node:
                for primitive in meshes[_whole(node["mesh"])]["primitives"]:
                    if primitive.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN):
                        yield primitive, matrix

    def primitive(
        self, primitive: dict[str, Any], matrix: Float64Array
    ) -> tuple[Float64Array, Int64Array, Float64Array]:
        """Points, triangles and normals (NaN for none) of a primitive in the world."""
        attributes = primitive["attributes"]
        local = self.accessor(attributes["POSITION"], "VEC3").astype(np.float64)
        if "indices" in primitive:
            flat = self.accessor(primitive["indices"], "SCALAR")[:, 0]
            if flat.dtype.kind != "u":
                raise ValueError("has indices that are no whole numbers")
            order = flat.astype(np.int64)
        else:
            order = np.arange(len(local))
        mode, n = primitive.get("mode", TRIANGLES), len(order)
        if mode == TRIANGLES and n % 3:
            raise ValueError(f"has {n} corners of triangles")
        k = np.arange(max(n - 2, 0))
        odd = k % 2
        corners = {STRIP: (k, k + 1 + odd, k + 2 - odd), FAN: (0 * k, k + 1, k + 2)}
        triangles = order[np.stack(corners[mode], axis=1)] if mode in corners else order
        triangles = triangles.reshape(-1, 3)
        linear = matrix[:3, :3]
        a, b, c = linear.T
        mirrored = float(np.dot(np.cross(a, b), c)) < 0.0
        points = local @ linear.T + matrix[:3, 3]
        if "NORMAL" in attributes:
            way = self.accessor(attributes["NORMAL"], "VEC3").astype(np.float64)
            across = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])  # cofactors
            normals = way @ across * (-1.0 if mirrored else 1.0)
            if len(normals) != len(points):
                raise ValueError(f"has {len(normals)} normals for {len(points)} vertices")
        else:
            normals = np.full(points.shape, np.nan)
        return points, triangles[:, ::-1] if mirrored else triangles, normals


def _whole(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"has {str(value)[:40]!r} for a whole number")
    return value


def _local(node: dict[str, Any]) -> Float64Array:
    """A node's matrix (4, 4): its own, or translation times rotation times scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = (float(v) for v in node.get("rotation", (0, 0, 0, 1)))
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= [float(v) for v in node.get("scale", (1, 1, 1))]
    matrix[:3, 3] = [float(v) for v in node.get("translation", (0, 0, 0))]
    return matrix
