"""Where a result comes from: version, command line, method, options, and digests of what was read.

No times and no names of the machine: the same command on the same files writes the same bits.
"""

import argparse
import contextvars
import hashlib
import json
import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from .._version import __version__
from .inputs import digests, input_files

if TYPE_CHECKING:
    from ..cubemap import CubeMap

COMMAND_LINE: contextvars.ContextVar[tuple[str, ...]] = contextvars.ContextVar(
    "command_line", default=()
)
"""The words after ``glossy``, as typed."""


def provenance(
    args: argparse.Namespace,
    *,
    method: str = "",
    options: Mapping[str, Any] | None = None,
    environment: tuple[str, "CubeMap"] | None = None,
    material: Any = None,
) -> dict[str, Any]:
    """What a command's JSON has under ``provenance`` and its EXR files have as attributes.

    ``software``; ``command_line``; ``method`` (or estimator) and its ``options``; ``environment``:
    source, size, and the SHA-256 of the cube map's float32 values in the order of its array;
    ``material`` as it was given; ``inputs``: file name -> SHA-256 of its bytes.
    """
    line = shlex.join(("glossy", *COMMAND_LINE.get()))
    found: dict[str, Any] = {
        "software": f"glossy {__version__}",
        "command_line": line.encode("utf-8", "backslashreplace").decode(),
    }
    if method:
        found |= {"method": method, "options": dict(options or {})}
    if environment is not None:
        source, cube = environment
        digest = hashlib.sha256(cube.faces.tobytes()).hexdigest()
        found["environment"] = {"source": source, "size": cube.size, "sha256": digest}
    if material is not None:
        found["material"] = material
    found["inputs"] = digests(input_files(args))
    text = json.dumps(found)
    for name, typed in getattr(args, "stands_for", {}).items():
        text = text.replace(json.dumps(name)[1:-1], typed)
    return dict(json.loads(text))


def attributes(found: Mapping[str, Any]) -> dict[str, str]:
    """Provenance as string attributes of an EXR header; tables are JSON with sorted keys."""
    names = {"command_line": "commandLine"}
    return {
        names.get(name, name): value
        if isinstance(value, str)
        else json.dumps(value, sort_keys=True)
        for name, value in found.items()
    }
