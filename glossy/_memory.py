"""One limit on the memory that reading an input may take, checked before it is taken.

A small file can claim any size: readers work out what they are about to allocate from the claimed
sizes and ask here first. The limit is ``set_limit``'s, else that of the environment variable
``GLOSSY_MAX_MEMORY``, else half of the memory of the machine or, if less, of its control group.
"""

import contextlib
import functools
import os
import pathlib
import re
from collections.abc import Iterator

VARIABLE = "GLOSSY_MAX_MEMORY"
SHARE = 0.5  # of the machine's: a reader's estimate leaves out what its library takes beside it
UNKNOWN = 4 << 30  # where the system does not say how much it has
UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}
GROUPS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")

_chosen: int | None = None


def parse(name: str, value: object) -> int:
    """Bytes of a whole number, or of text such as ``512M`` or ``1.5G`` (powers of 1024)."""
    found = re.fullmatch(r"(\d{1,18}(?:\.\d{1,9})?) ?([KMGT]?)(?:i?B)?", str(value).strip(), re.I)
    size = int(float(found[1]) * UNITS[found[2].upper()]) if found else 0
    if size < 1:
        text = str(value)[:40]
        raise ValueError(f"{name}: must be a size in bytes such as 512M or 4G, got {text!r}")
    return size


@functools.cache
def _machine() -> int:
    known = []
    for file in GROUPS:
        try:
            known.append(int(pathlib.Path(file).read_text()))
        except (OSError, ValueError):  # no such group, or "max"
            continue
    with contextlib.suppress(AttributeError, OSError, ValueError):  # not on this system
        known.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    return int(SHARE * min(known)) if known else UNKNOWN


def limit() -> int:
    """The limit in force, in bytes."""
    if _chosen is not None:
        return _chosen
    text = os.environ.get(VARIABLE)
    return parse(VARIABLE, text) if text else _machine()


def set_limit(value: object) -> None:
    """Set the limit of this process, as ``parse`` takes it; None returns to the default."""
    global _chosen
    _chosen = None if value is None else parse("max_memory", value)


@contextlib.contextmanager
def limited(value: str | None) -> Iterator[None]:
    """The limit of a command line's ``--max-memory`` while it lasts; None changes nothing."""
    global _chosen
    before = _chosen
    if value is not None:
        _chosen = parse("--max-memory", value)
    try:
        yield
    finally:
        _chosen = before


def check(name: str, need: int) -> None:
    """Refuse to spend ``need`` bytes on the input ``name`` if that is more than the limit.

    Raises
    ------
    ValueError
        One line with the name, the need, the limit and how to raise it.
    """
    most = limit()
    if need > most:
        raise ValueError(
            f"{name}: would take {_text(need)} of memory, more than the limit of {_text(most)} "
            f"(--max-memory, {VARIABLE})"
        )


def _text(size: int) -> str:
    unit = next((u for u in "TGMK" if size >= UNITS[u]), "")
    return f"{size / UNITS[unit]:.3g} {unit}iB" if unit else f"{size} B"
