"""A mutation of a file, by what its suffix says it consists of."""

import io
import json
import random
from collections.abc import Sequence

import numpy as np
from fuzz_bytes import INNER, LONGEST, mutate_bytes, mutate_line, mutate_pieces
from fuzz_formats import BINARY, FORMATS, LINES
from fuzz_trees import mutate_json, mutate_toml, mutate_xml

TREES = {".json": mutate_json, ".gltf": mutate_json, ".toml": mutate_toml, ".xml": mutate_xml}


def _mutate_glb_json(data: bytes, draw: random.Random) -> bytes:
    try:
        return data[:4] + mutate_json(data[4:], draw)
    except (ValueError, RecursionError):
        return mutate_bytes(data, draw)


def _mutate_idat(data: bytes, draw: random.Random) -> bytes:
    return data[:4] + INNER["zlib"](data[4:], draw)


INNER["json"], INNER["idat"] = _mutate_glb_json, _mutate_idat


def mutate_file(
    suffix: str, data: bytes, draw: random.Random, others: Sequence[bytes] = ()
) -> bytes:
    """A file with one to four random changes, of its structure or now and then of its bytes.

    ``others``: files of the same kind, pieces of which may be taken.
    """
    times = draw.choice((1, 1, 2, 4))
    how = draw.random()
    if how < 0.85:
        try:
            if suffix in TREES:
                data = TREES[suffix](data, draw)
            else:
                form = FORMATS.get(suffix, BINARY)
                pieces = form.split(data)
                rest = form.split(draw.choice(others)) if others and draw.random() < 0.3 else []
                for _ in range(times):
                    mutate_pieces(pieces, draw, rest)
                data = form.join(pieces)
        except Exception:  # damaged before, by an earlier mutation
            how = 1.0
    if how > 0.8:
        text = suffix in TREES or FORMATS.get(suffix) is LINES
        for _ in range(times):
            lines = data.splitlines(keepends=True) if text and draw.random() < 0.5 else []
            if lines:
                k = draw.randrange(len(lines))
                lines[k] = mutate_line(lines[k], draw)
                data = b"".join(lines)
            else:
                data = mutate_bytes(data, draw)
    return data[: 4 * LONGEST]


def resealed(suffix: str, data: bytes) -> bytes:
    """A record of a study whose checksum is that of what it holds; as it is where it has none."""
    from glossy.study import sealed

    try:
        if suffix == ".json":
            value = json.loads(data)
            del value["sha256"]
            return json.dumps({**value, "sha256": sealed._checksum(value)}).encode()
        with np.load(io.BytesIO(data)) as found:
            arrays = {name: found[name] for name in found.files if name != "sha256"}
        out = io.BytesIO()
        np.savez(out, **arrays, sha256=np.array(sealed.array_checksum(arrays)))
        return out.getvalue()
    except Exception:
        return data
