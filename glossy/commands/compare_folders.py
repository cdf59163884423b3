"""Which files of two folders ``glossy compare`` puts side by side."""

import fnmatch
import os
from collections.abc import Iterator, Sequence
from typing import NamedTuple

SUFFIXES = (
    ".exr", ".hdr", ".rgbe", ".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".tga", ".pfm",
    ".dpx", ".ppm", ".pgm", ".pnm", ".sgi", ".tx", ".webp", ".jp2",
)  # fmt: skip
DROPPINGS = ("thumbs.db", "desktop.ini", "icon\r", "__macosx")  # other systems' start with a dot
MOST_FILES = 100_000


class Pair(NamedTuple):
    """Two files to compare, or why there is nothing to compare.

    ``name`` is relative to both folders, with slashes; ``trouble`` is empty for a pair.
    """

    name: str
    a: str
    reference: str
    trouble: str = ""


def pairs(a: str, reference: str, ignored: Sequence[str] = ()) -> list[Pair]:
    """Everything that two folders hold, by relative path, in its order.

    Left out are names that start with a dot, what systems drop into folders, and the ``ignored``
    patterns, of a relative path or a name. Suffixes may differ in case.

    Raises
    ------
    ValueError
        Nothing to compare, or more than ``MOST_FILES``.
    """
    found = []
    for folder in (a, reference):
        here = {}
        for name, trouble in _walk(folder, ignored):
            here[name] = trouble
            if len(here) > MOST_FILES:
                raise ValueError(f"{folder}: holds more than {MOST_FILES} files")
        found.append(here)
    if not found[0] and not found[1]:
        raise ValueError(f"{a}: holds no images, nor does {reference}")
    partner = _partners(*found)
    taken = set(partner.values())
    rows = []
    for name in sorted({*found[0], *(n for n in found[1] if n not in taken)}):
        names = name, partner.get(name, name)
        paths = os.path.join(a, names[0]), os.path.join(reference, names[1])
        words = {
            here[n]: f"{path}: {here[n]}"
            for path, here, n in reversed([*zip(paths, found, names, strict=True)])
            if here.get(n)
        }
        if name not in partner and not words:
            have, lack = (paths[0], reference) if name in found[0] else (paths[1], a)
            words = {"": f"{have}: has no counterpart in {lack}"}
        rows.append(Pair(name, *paths, "; ".join(words.values())))
    return rows


def _partners(a: dict[str, str], reference: dict[str, str]) -> dict[str, str]:
    # name in a -> name in the reference: the same, or the only one but for the suffix's case
    found = {name: name for name in a if name in reference}
    rest: list[dict[str, list[str]]] = [{}, {}]
    for by_key, names in zip(rest, (a, reference), strict=True):
        for name in names:
            if name not in found:
                by_key.setdefault(_plain(name), []).append(name)
    for key, own in rest[0].items():
        theirs = rest[1].get(key, [])
        if len(own) == len(theirs) == 1:
            found[own[0]] = theirs[0]
    return found


def _plain(name: str) -> str:
    stem, suffix = os.path.splitext(name)
    return stem + suffix.lower()


def _walk(folder: str, ignored: Sequence[str]) -> Iterator[tuple[str, str]]:
    # relative paths below a folder, and what is wrong with each
    todo: list[tuple[str, tuple[str, ...]]] = [("", ())]
    while todo:
        under, above = todo.pop()
        place = os.path.join(folder, under)
        real = os.path.realpath(place)
        if real in above:
            yield under, "is a link to a folder that it lies in"
            continue
        try:
            with os.scandir(place) as entries:
                listed = sorted(entries, key=lambda e: e.name)
        except OSError as error:
            if not under:
                raise
            yield under, (error.strerror or "cannot be listed").lower()
            continue
        for entry in listed:
            name = f"{under}/{entry.name}" if under else entry.name
            if entry.name.startswith(".") or entry.name.lower() in DROPPINGS:
                continue
            if any(fnmatch.fnmatchcase(text, p) for p in ignored for text in (name, entry.name)):
                continue
            if os.path.isdir(entry.path):
                todo.append((name, (*above, real)))
            elif entry.is_symlink() and not os.path.exists(entry.path):
                yield name, "is a link to nothing"
            elif os.path.splitext(entry.name)[1].lower() not in SUFFIXES:
                yield name, "has a suffix that is not read as an image (--ignore leaves it out)"
            else:
                yield name, ""
