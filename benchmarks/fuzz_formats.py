"""File formats as lists of pieces: ``split`` takes a file apart, ``join`` puts it together.

``join`` works out what depends on other pieces (lengths, offsets, checksums, counts), so that a
change reaches the code behind the checks of those. Readers' own code is not used.
"""

import io
import itertools
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from fuzz_bytes import Pieces


class Format(NamedTuple):
    """``join(split(data))`` is a file that means what ``data`` means."""

    split: Callable[[bytes], Pieces]
    join: Callable[[Pieces], bytes]


# OpenEXR ------------------------------------------------------------------------------------------


def _split_exr(data: bytes) -> Pieces:
    pieces: Pieces = [("head", data[:8])]
    several = bool(struct.unpack_from("<I", data, 4)[0] & 0x1000)
    at = 8
    while True:
        while data[at]:
            end = data.index(b"\0", data.index(b"\0", at) + 1) + 1
            (size,) = struct.unpack_from("<i", data, end)
            pieces.append(("attr", data[at:end] + data[end + 4 : end + 4 + size]))
            at = end + 4 + size
        pieces.append(("end", b"\0"))
        at += 1
        if not several or not data[at]:
            break
    at += several
    first = struct.unpack_from("<Q", data, at)[0]
    table = struct.unpack_from(f"<{(first - at) // 8}Q", data, at)
    places = [*sorted(table), len(data)]
    starts = {a: data[a:b] for a, b in itertools.pairwise(places)}
    return [*pieces, *(("chunk", starts[a]) for a in table)]


def _join_exr(pieces: Pieces) -> bytes:
    head, several = b"", False
    for tag, data in pieces:
        if tag == "attr":
            end = data.find(b"\0", data.find(b"\0") + 1) + 1
            data = data[:end] + struct.pack("<i", len(data) - end) + data[end:]
        elif tag == "head":
            several = len(data) >= 8 and bool(data[5] & 0x10)
        head += data if tag != "chunk" else b""
    head += b"\0" if several else b""
    chunks = [data for tag, data in pieces if tag == "chunk"]
    at, table = len(head) + 8 * len(chunks), b""
    for data in chunks:
        table += struct.pack("<Q", at)
        at += len(data)
    return head + table + b"".join(chunks)


# Radiance -----------------------------------------------------------------------------------------


def _split_hdr(data: bytes) -> Pieces:
    end = data.index(b"\n", data.index(b"\n\n") + 2) + 1
    pieces: Pieces = [("line", line) for line in data[:end].splitlines(keepends=True)]
    width = int(data[:end].split()[-1])
    while end < len(data):
        if data[end : end + 4] == bytes([2, 2, width >> 8, width & 255]):
            pieces.append(("start", data[end : end + 4]))
            end, left = end + 4, 4 * width
            while left > 0 and end < len(data):
                count = data[end]
                size = 2 if count > 128 else 1 + count
                pieces.append(("run", data[end : end + size]))
                left -= count & 127 if count > 128 else count
                end += max(size, 1)
        else:
            pieces.append(("pixel", data[end : end + 4]))
            end += 4
    return pieces


# Files of chunks, segments, entries ---------------------------------------------------------------


def _split_png(data: bytes) -> Pieces:
    pieces, at = [("head", data[:8])], 8
    while at + 12 <= len(data):
        (size,) = struct.unpack_from(">I", data, at)
        body = data[at + 4 : at + 8 + size]
        pieces.append(("idat" if body[:4] == b"IDAT" else "chunks", body))
        at += 12 + size
    return pieces


def _join_png(pieces: Pieces) -> bytes:
    out = b""
    for tag, data in pieces:
        whole = struct.pack(">I", max(len(data) - 4, 0)) + data
        out += data if tag == "head" else whole + struct.pack(">I", zlib.crc32(data))
    return out


def _split_riff(data: bytes) -> Pieces:
    pieces, at = [("head", data[:12])], 12
    while at + 8 <= len(data):
        (size,) = struct.unpack_from("<I", data, at + 4)
        pieces.append(("body", data[at : at + 4] + data[at + 8 : at + 8 + size]))
        at += 8 + size + size % 2
    return pieces


def _join_riff(pieces: Pieces) -> bytes:
    out = b""
    for _, data in pieces[1:]:
        size = max(len(data) - 4, 0)
        out += data[:4] + struct.pack("<I", size) + data[4:] + b"\0" * (size % 2)
    return pieces[0][1][:4] + struct.pack("<I", len(out) + 4) + pieces[0][1][8:] + out


def _split_tiff(data: bytes) -> Pieces:
    order = "<" if data[:2] == b"II" else ">"
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, at)
    entries = [data[at + 2 + 12 * k : at + 14 + 12 * k] for k in range(count)]
    return [("head", data[:4]), ("body", data[8:]), *(("entry", e) for e in entries)]


def _join_tiff(pieces: Pieces) -> bytes:
    head = next((d for t, d in pieces if t == "head"), b"II*\0")
    body = b"".join(d for t, d in pieces if t == "body")
    entries = [d for t, d in pieces if t == "entry"]
    order = ">" if head[:2] == b"MM" else "<"
    table = struct.pack(f"{order}H", len(entries)) + b"".join(entries) + bytes(4)
    return head + struct.pack(f"{order}I", 8 + len(body)) + body + table


def _split_jpeg(data: bytes) -> Pieces:
    pieces, at = [("head", data[:2])], 2
    while data[at : at + 1] == b"\xff" and data[at + 1] != 0xDA:
        size = struct.unpack_from(">H", data, at + 2)[0]
        pieces.append(("segment", data[at : at + 2] + data[at + 4 : at + 2 + size]))
        at += 2 + size
    return [*pieces, ("scan", data[at:])]


def _join_jpeg(pieces: Pieces) -> bytes:
    return b"".join(
        d[:2] + struct.pack(">H", min(len(d), 65535)) + d[2:] if t == "segment" else d
        for t, d in pieces
    )


def _split_gif(data: bytes) -> Pieces:
    at = 13 + (3 << (data[10] & 7) + 1 if data[10] & 0x80 else 0)
    pieces: Pieces = [("head", data[:13]), ("colours", data[13:at])]
    while at < len(data):
        kind = data[at]
        size = {0x21: 2, 0x2C: 10}.get(kind, 1)
        if kind == 0x2C:
            size += (3 << (data[at + 9] & 7) + 1 if data[at + 9] & 0x80 else 0) + 1
        pieces.append(("block", data[at : at + size]))
        at += size
        while kind in (0x21, 0x2C) and at < len(data):
            size = data[at]
            pieces.append(("part", data[at + 1 : at + 1 + size]))
            at += 1 + size
            if not size:
                break
    return pieces


def _join_gif(pieces: Pieces) -> bytes:
    return b"".join(bytes([min(len(d), 255)]) + d[:255] if t == "part" else d for t, d in pieces)


def _split_boxes(data: bytes) -> Pieces:  # JPEG 2000
    pieces, at = [], 0
    while at + 8 <= len(data):
        size = struct.unpack_from(">I", data, at)[0] or len(data) - at
        body = data[at + 4 : at + size]
        if body[:4] == b"jp2c":
            parts = re.split(rb"(?=\xff[\x4f-\x93])", body[4:])
            pieces += [("stream", body[:4] + parts[0]), *(("marker", p) for p in parts[1:])]
        else:
            pieces.append(("box", body))
        at += max(size, 8)
    return pieces


def _join_boxes(pieces: Pieces) -> bytes:
    out = b""
    for tag, data in pieces:
        size = 0 if tag == "stream" else len(data) + 4
        out += data if tag == "marker" else struct.pack(">I", size) + data
    return out


# Meshes, tables, arrays ---------------------------------------------------------------------------


def _split_lines(data: bytes) -> Pieces:
    return [("line", line) for line in data.splitlines(keepends=True)]


def _join_plain(pieces: Pieces) -> bytes:
    return b"".join(data for _, data in pieces)


def _split_ply(data: bytes) -> Pieces:
    head, mark, body = data.partition(b"end_header\n")
    if b"ascii" in head:
        return _split_lines(data)
    return [*_split_lines(head + mark), ("body", body)]


def _split_stl(data: bytes) -> Pieces:
    if data.startswith(b"solid"):
        return _split_lines(data)
    rows = [data[k : k + 50] for k in range(84, len(data), 50)]
    return [("head", data[:80]), *(("row", r) for r in rows)]


def _join_stl(pieces: Pieces) -> bytes:
    rows = [data for tag, data in pieces if tag == "row"]
    if not rows:
        return _join_plain(pieces)
    return pieces[0][1][:80].ljust(80, b"\0") + struct.pack("<I", len(rows)) + b"".join(rows)


def _split_glb(data: bytes) -> Pieces:
    pieces, at = [("head", data[:8])], 12
    while at + 8 <= len(data):
        size, kind = struct.unpack_from("<I4s", data, at)
        pieces.append(("json" if kind == b"JSON" else "body", kind + data[at + 8 : at + 8 + size]))
        at += 8 + size
    return pieces


def _join_glb(pieces: Pieces) -> bytes:
    out = b""
    for _, data in pieces[1:]:
        pad = b" " * (-len(data) % 4)
        out += struct.pack("<I", len(data) + len(pad) - 4) + data + pad if len(data) > 3 else data
    return pieces[0][1] + struct.pack("<I", 12 + len(out)) + out


def _split_tensor(data: bytes) -> Pieces:
    pieces, at = [("head", data[:14])], 18
    for _ in range(struct.unpack_from("<I", data, 14)[0]):
        name = at + 2 + struct.unpack_from("<H", data, at)[0]
        dims, kind, offset = struct.unpack_from("<HBQ", data, name)
        shape = struct.unpack_from(f"<{dims}Q", data, name + 11)
        size = int(np.prod(shape)) * {1: 1, 10: 4}[kind]
        head = (
            data[at + 2 : name] + b"\0" + data[name : name + 3] + struct.pack(f"<{dims}Q", *shape)
        )
        pieces += [("field", head), ("values", data[offset : offset + size])]
        at = name + 11 + 8 * dims
    return pieces


def _join_tensor(pieces: Pieces) -> bytes:
    # heads: name, zero, dimensions and type, shape; each followed by its values
    fields = [data.partition(b"\0") for tag, data in pieces if tag == "field"]
    values = [data for tag, data in pieces if tag == "values"]
    head = pieces[0][1] + struct.pack("<I", len(fields))
    at = len(head) + sum(2 + len(name) + 8 + len(rest) for name, _, rest in fields)
    for (name, _, rest), data in zip(fields, [*values, *(b"" for _ in fields)], strict=False):
        head += struct.pack("<H", len(name)) + name + rest[:3] + struct.pack("<Q", at) + rest[3:]
        at += len(data)
    return head + b"".join(values)


def _split_npz(data: bytes) -> Pieces:
    pieces: Pieces = []
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        for entry in archive.infolist():
            body = archive.read(entry)
            size = 10 + struct.unpack_from("<H", body, 8)[0]
            method = bytes([entry.compress_type])
            pieces += [("line:name", method + entry.filename.encode()), ("line:magic", body[:8]),
                       ("line:npy", body[10:size]), ("values", body[size:])]  # fmt: skip
    return pieces


def _join_npz(pieces: Pieces) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for k, (tag, data) in enumerate(pieces):
            if tag != "line:name" or not data:
                continue
            body = b""
            for part, value in pieces[k + 1 : k + 4]:
                if part == "line:npy":
                    value = struct.pack("<H", len(value) % 65536) + value
                body += value if part != "line:name" else b""
            method = data[0] if data[0] in (0, 8, 12, 14) else 0
            name = data[1:].decode("utf-8", "replace").replace("\0", "") or "a"
            archive.writestr(zipfile.ZipInfo(name), body, method)
    return out.getvalue()


BINARY = Format(lambda data: [("body", data)], _join_plain)
LINES = Format(_split_lines, _join_plain)
FORMATS: dict[str, Format] = {
    ".exr": Format(_split_exr, _join_exr),
    ".hdr": Format(_split_hdr, _join_plain),
    ".png": Format(_split_png, _join_png),
    ".webp": Format(_split_riff, _join_riff),
    ".tif": Format(_split_tiff, _join_tiff),
    ".jpg": Format(_split_jpeg, _join_jpeg),
    ".gif": Format(_split_gif, _join_gif),
    ".jp2": Format(_split_boxes, _join_boxes),
    ".ply": Format(_split_ply, _join_plain),
    ".stl": Format(_split_stl, _join_stl),
    ".glb": Format(_split_glb, _join_glb),
    ".bsdf": Format(_split_tensor, _join_tensor),
    ".npz": Format(_split_npz, _join_npz),
    **dict.fromkeys((".obj", ".off", ".txt", ".brdf", ".pnm", ".pfm"), LINES),
}
"""What is not here is bytes, or a tree (``fuzz_mutate``). A reader of KTX2 or DDS gets
its entry here, and its pictures in ``fuzz_pictures``."""
