"""Which files a command reads: what it must not overwrite, and what its results depend on."""

import argparse
import hashlib
import os
import pathlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

NAMES = ("scene", "env", "material", "gbuffer", "input", "table", "exposure")
"""Arguments that may name a file."""


def add_force_argument(parser: argparse.ArgumentParser) -> None:
    """--force, for commands that write files."""
    parser.add_argument(
        "--force", action="store_true", help="write even over a file that this command reads"
    )


def typed(args: argparse.Namespace, name: str) -> str | None:
    """The one text that an argument of ``NAMES`` has; None if it has none or several."""
    value = getattr(args, name, None)
    if isinstance(value, list) and len(value) == 1:
        value = value[0]
    if isinstance(value, str) and name == "exposure":
        return value.removeprefix("like:") if value.startswith("like:") else None
    return value if isinstance(value, str) else None


def input_files(args: argparse.Namespace) -> dict[str, pathlib.Path]:
    """The files that the arguments name, and those that a scene file among them names.

    By the name that was typed; six faces by their own. A built-in scene's files have the names
    they have in it, so that no name depends on where the package is.
    """
    found: dict[str, pathlib.Path] = {}
    for name in NAMES:
        value = typed(args, name)
        if value is None:
            continue
        found |= _files(value, pathlib.Path())
        if name == "scene":
            found |= _of_scene(value, getattr(args, "scene_folder", None))
    return found


def protect(args: argparse.Namespace, outputs: Mapping[str, str | os.PathLike[str] | None]) -> None:
    """Refuse outputs (option -> path) that are inputs, by whatever name, unless ``--force``.

    Raises
    ------
    ValueError
        For such an output, and for two outputs that are one file.
    OSError
        For one that is there and no regular file.
    """
    from .._output import existing

    places = {option: os.path.realpath(path) for option, path in outputs.items() if path}
    for option, place in places.items():
        for other, same in places.items():
            if other != option and same == place:
                raise ValueError(f"{option}, {other}: are the same file {str(outputs[option])!r}")
    there = {option: place for option, place in places.items() if os.path.exists(place)}
    for option, place in there.items():
        existing(os.fspath(outputs[option] or ""), place)
    if not there or args.force:
        return
    for file in input_files(args).values():
        for option, place in there.items():
            if os.path.samefile(file, place):
                name = os.fspath(outputs[option] or "")
                rule = "is read by this command; --force overwrites it"
                raise ValueError(f"{option}: {name!r} {rule}")


def digests(files: Mapping[str, pathlib.Path]) -> dict[str, str]:
    """SHA-256 of each file, in hexadecimal."""
    found = {}
    for name, path in files.items():
        with path.open("rb") as stream:
            found[name] = hashlib.file_digest(stream, "sha256").hexdigest()
    return found


def _files(text: str, folder: pathlib.Path) -> dict[str, pathlib.Path]:
    """The regular file of that name in a folder, or six faces."""
    path = folder / text
    if os.path.isfile(path):
        return {text: path}
    if os.path.isdir(path) or "*" in text:
        from ..layouts import find_faces

        try:
            faces = find_faces(path)
        except (ValueError, OSError, NotImplementedError):
            return {}
        place = pathlib.PurePath(text)
        parent = place.parent if "*" in place.name else place
        return {str(parent / face.name): face for face in faces}
    return {}


def _of_scene(text: str, folder: str | None) -> dict[str, pathlib.Path]:
    from .._files import read_toml
    from ..scenes.builtin import builtin_scene

    file = builtin_scene(text) or pathlib.Path(text)
    if not os.path.isfile(file):
        return {}
    found = {text: file}
    for value in _texts(read_toml(file)):
        beside = _files(value, file.parent if folder is None else pathlib.Path(folder))
        found |= beside or _files(value, pathlib.Path())
    return found


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    inside: Iterable[Any] = ()
    if isinstance(value, dict | list):
        inside = value.values() if isinstance(value, dict) else value
    for item in inside:
        yield from _texts(item)
