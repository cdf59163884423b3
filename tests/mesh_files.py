"""Mesh files of every kind, written from corners and triangles; and what is wrong in some."""

import base64
import json
import pathlib
import struct
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

KINDS = (
    "ascii.ply",
    "binary.ply",
    "big.ply",
    "obj",
    "text.stl",
    "binary.stl",
    "off",
    "gltf",
    "glb",
)


def box() -> tuple[Array, Ints]:
    """A closed box of edge 1, outside out: eight corners and twelve triangles."""
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])


def text(rows: npt.NDArray[Any], before: str = "") -> str:
    return "".join(before + " ".join(f"{x:.12g}" for x in row) + "\n" for row in rows.tolist())


def ply(points: Array, triangles: Ints, order: str = "", normals: Array | None = None) -> bytes:
    """``order``: none for text, "<" or ">"."""
    names = "xyz" if normals is None else ("x", "y", "z", "nx", "ny", "nz")
    table = points if normals is None else np.hstack([points, normals])
    kind = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = f"ply\nformat {kind} 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property double {name}\n" for name in names)
    head += f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    if not order:
        return (head + text(table) + text(triangles, "3 ")).encode()
    faces = np.zeros(len(triangles), dtype=[("n", "u1"), ("i", f"{order}i4", 3)])
    faces["n"], faces["i"] = 3, triangles
    return head.encode() + table.astype(f"{order}f8").tobytes() + faces.tobytes()


def obj(points: Array, triangles: Ints, normals: Array | None = None) -> bytes:
    """With ``normals`` (T, 3), one a triangle."""
    if normals is None:
        return (text(points, "v ") + text(triangles + 1, "f ")).encode()
    rows = [f"f {a}//{k} {b}//{k} {c}//{k}\n" for k, (a, b, c) in enumerate(triangles + 1, 1)]
    return (text(points, "v ") + text(normals, "vn ") + "".join(rows)).encode()


def stl(points: Array, triangles: Ints, binary: bool = True) -> bytes:
    if binary:
        rows = [struct.pack("<12fH", 0, 0, 0, *points[t].ravel(), 0) for t in triangles]
        return b"\0" * 80 + struct.pack("<I", len(rows)) + b"".join(rows)
    facets = [f"facet normal 0 0 0\nouter loop\n{text(points[t], 'vertex ')}endloop\nendfacet\n"
              for t in triangles]  # fmt: skip
    return ("solid a\n" + "".join(facets) + "endsolid a\n").encode()


def off(points: Array, triangles: Ints) -> bytes:
    head = f"OFF # corners\n{len(points)} {len(triangles)} 0\n"
    return (head + text(points) + text(triangles, "3 ")).encode()


def gltf_tree(
    points: Array, triangles: Ints, uri: str | None = None
) -> tuple[dict[str, Any], bytes]:
    """The JSON of a mesh in float32, and its buffer."""
    data = points.astype("<f4").tobytes() + triangles.astype("<u4").tobytes()
    split = points.size * 4
    buffer: dict[str, Any] = {"byteLength": len(data)}
    if uri is not None:
        buffer["uri"] = uri
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": triangles.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": split},
            {"buffer": 0, "byteOffset": split, "byteLength": len(data) - split},
        ],
        "buffers": [buffer],
    }, data


def gltf(points: Array, triangles: Ints) -> bytes:
    tree, data = gltf_tree(points, triangles, "")
    tree["buffers"][0]["uri"] = (
        "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    )
    return json.dumps(tree).encode()


def glb(tree: dict[str, Any], data: bytes) -> bytes:
    head = json.dumps(tree).encode()
    head += b" " * (-len(head) % 4)
    body = struct.pack("<I4s", len(head), b"JSON") + head
    body += struct.pack("<I4s", len(data), b"BIN\0") + data
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def contents(kind: str, points: Array, triangles: Ints) -> bytes:
    """A file of one of ``KINDS``."""
    return {
        "ascii.ply": lambda: ply(points, triangles),
        "binary.ply": lambda: ply(points, triangles, "<"),
        "big.ply": lambda: ply(points, triangles, ">"),
        "obj": lambda: obj(points, triangles),
        "text.stl": lambda: stl(points, triangles, binary=False),
        "binary.stl": lambda: stl(points, triangles),
        "off": lambda: off(points, triangles),
        "gltf": lambda: gltf(points, triangles),
        "glb": lambda: glb(*gltf_tree(points, triangles)),
    }[kind]()


def write(folder: pathlib.Path, kind: str, points: Array, triangles: Ints) -> str:
    """The path of a file of one of ``KINDS``."""
    path = folder / f"mesh.{kind}"
    path.write_bytes(contents(kind, points, triangles))
    return str(path)
