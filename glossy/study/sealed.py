"""Records of a study: JSON with a schema and a checksum, read back whole or refused.

``sha256`` is the hash of the other entries in sorted order, so that a figure that was changed, cut
or lost by a disk is noticed. Whoever changes it on purpose can compute it anew: it is no signature.
"""

import hashlib
import json
import os
import pathlib
import sys
import types
from typing import Any, get_args, get_origin, get_type_hints

import numpy.typing as npt

from .. import _check
from .._files import read_bytes

SCHEMA = 1
MOST_BYTES = 1 << 24
WORDS = {float: "a finite number", int: "a whole number", str: "text", bool: "true or false"}


def sealed(value: dict[str, Any]) -> dict[str, Any]:
    """The entries with their schema and checksum."""
    whole = {"schema": SCHEMA, **value}
    return {**whole, "sha256": _checksum(whole)}


def _checksum(value: dict[str, Any]) -> str:
    text = json.dumps(value, sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def array_checksum(arrays: dict[str, npt.NDArray[Any]]) -> str:
    """Checksum of named arrays: names, types, shapes and values."""
    total = hashlib.sha256()
    for name, value in sorted(arrays.items()):
        total.update(f"{name} {value.dtype.str} {value.shape}\n".encode())
        total.update(value.tobytes())
    return total.hexdigest()


def is_there(path: pathlib.Path) -> bool:
    """Whether anything has this name.

    Raises
    ------
    ValueError
        For a symbolic link: what is written in its place would land elsewhere.
    """
    if path.is_symlink():
        raise ValueError(f"{path}: is a symbolic link, not a file of a study")
    return os.path.lexists(path)


def read(path: pathlib.Path, kind: type | None = None, extra: tuple[str, ...] = ()) -> Any:
    """The entries of a record without schema and checksum.

    Parameters
    ----------
    path : path
    kind : dataclass, optional
        Its fields and their types are what the record must hold, beside the text entries ``extra``.

    Raises
    ------
    OSError
        No regular file, or it cannot be read.
    ValueError
        What is wrong, in a few words without the name of the file.
    """
    try:
        return _checked(read_bytes(path, MOST_BYTES).decode(), kind, extra)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except ValueError as error:
        raise ValueError(_check.shortened(str(error).removeprefix(f"{path}: "), 120)) from None


def _checked(text: str, kind: type | None, extra: tuple[str, ...]) -> dict[str, Any]:
    value = json.loads(text, object_pairs_hook=_once, parse_constant=_refuse_constant)
    if not isinstance(value, dict):
        raise ValueError("not a JSON object")
    if "sha256" not in value:
        raise ValueError("of another version, without a checksum")
    schema, checksum = value.get("schema"), value.pop("sha256")
    if type(schema) is not int or schema != SCHEMA:
        raise ValueError(f"of another version, schema {_short(schema)}")
    found = {name: entry for name, entry in value.items() if name != "schema"}
    if kind is not None:
        _check_fields(found, {**get_type_hints(kind), **dict.fromkeys(extra, str)})
    if checksum != _checksum(value):
        raise ValueError("changed since it was written: its checksum is another")
    return found


def _short(value: Any) -> str:
    return _check.shortened(json.dumps(value)[:200], 40)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key occurs twice")
    return found


def _refuse_constant(text: str) -> None:
    raise ValueError(f"{text} is not a figure")


def _check_fields(found: dict[str, Any], hints: dict[str, Any]) -> None:
    for words, names in (("misses", hints.keys() - found), ("also holds", found.keys() - hints)):
        if names:
            raise ValueError(f"{words} {', '.join(sorted(names))}")
    for name, hint in hints.items():
        check_entry(name, found[name], hint)


def check_entry(name: str, value: Any, hint: Any) -> None:
    """Refuse a value of JSON that is not of the type of the hint, in one line with its name."""
    if not _fits(value, hint):
        kind = hint.__name__ if isinstance(hint, type) else hint
        words = WORDS.get(hint, f"of type {kind}")
        raise ValueError(f"{name} must be {words}, got {_short(value)}")


def _fits(value: Any, hint: Any) -> bool:
    if get_origin(hint) is list:
        return isinstance(value, list) and all(_fits(v, get_args(hint)[0]) for v in value)
    if get_origin(hint) is types.UnionType:
        return any(_fits(value, one) for one in get_args(hint))
    if hint is float:
        real = isinstance(value, int | float) and not isinstance(value, bool)
        return real and abs(value) <= sys.float_info.max
    return type(value) is (get_origin(hint) or hint)
