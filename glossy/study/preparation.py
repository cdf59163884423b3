"""What a method needs before its first picture: time and memory.

Two changes make a renderer prepare again ::

    new map        another environment, the same material: all that ``prepare`` makes, and what the
                   first pixel makes because it is the first
    new material   the same environment and lobes ``WIDER`` times as wide: what ``prepare`` makes
                   again if it takes the material, and what the first pixel makes

Both are CPU times on one thread, of code that is compiled, less the time of a pixel that finds
everything made. Memory is what the arrays of the prepared object hold, without the map itself.
"""

import dataclasses
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .._threads import using

if TYPE_CHECKING:
    from ..brdf import Material

WIDER = 1.25


@dataclasses.dataclass(frozen=True)
class Preparation:
    """What one method needs for one case; field names are those of study.json.

    ``new_map_seconds``, ``new_material_seconds``: CPU time on one thread; ``bytes``: of the arrays
    that pictures are made from.
    """

    case: str
    method: str
    new_map_seconds: float
    new_material_seconds: float
    bytes: int


def wider(material: "Material") -> "Material":
    """The material with every lobe ``WIDER`` times as wide."""

    def lobes(found: Any) -> tuple[Any, ...]:
        return tuple(
            dataclasses.replace(lobe, mx=WIDER * lobe.mx, my=WIDER * lobe.my) for lobe in found
        )

    return dataclasses.replace(
        material, reflection=lobes(material.reflection), transmission=lobes(material.transmission)
    )


def held_bytes(prepared: Any, *given: Any) -> int:
    """Bytes of the arrays an object holds, each buffer once, without those ``given`` holds."""
    ours, others = _buffers(prepared), _buffers(list(given))
    return sum(size for key, size in ours.items() if key not in others)


def _buffers(start: Any) -> dict[int, int]:
    """Size of every array's memory that can be reached from an object, by its address."""
    found: dict[int, int] = {}
    seen: set[int] = set()
    waiting = [start]
    while waiting:
        item = waiting.pop()
        if id(item) in seen:
            continue
        seen.add(id(item))
        if isinstance(item, np.ndarray):
            while isinstance(item.base, np.ndarray):
                item = item.base
            found[item.__array_interface__["data"][0]] = item.nbytes
        elif isinstance(item, Mapping):
            waiting += item.values()
        elif isinstance(item, list | tuple | set | frozenset):
            waiting += item
        elif not isinstance(item, type) and not callable(item):
            waiting += getattr(item, "__dict__", {}).values()
            slots = getattr(type(item), "__slots__", ())
            waiting += [getattr(item, name) for name in slots if hasattr(item, name)]
    return found


def spent(run: Callable[[], Any]) -> tuple[Any, float]:
    """What a function returns and the CPU seconds it takes."""
    start = time.process_time()
    result = run()
    return result, time.process_time() - start


def measure(
    case: str,
    method: str,
    material: "Material",
    prepare: Callable[["Material"], Any],
    shade: Callable[["Material", Any], Any],
    bound: bool,
    given: Any,
) -> Preparation:
    """Time and memory of one method.

    Parameters
    ----------
    prepare : function of the material
        Makes what is looked up, anew at each call.
    shade : function of a material and what was prepared for it
        Shades one pixel.
    bound : bool
        ``prepare`` depends on the material.
    given : object
        Its arrays are not counted: the environment.
    """
    other = wider(material)
    with using(1):
        shade(material, prepare(material))  # compiles
        made, making = spent(lambda: prepare(material))
        _, first = spent(lambda: shade(material, made))
        _, again = spent(lambda: shade(material, made))
        held = held_bytes(made, given)
        remade, remaking = spent(lambda: prepare(other)) if bound else (made, 0.0)
        _, first_other = spent(lambda: shade(other, remade))
        _, again_other = spent(lambda: shade(other, remade))
    return Preparation(
        case=case,
        method=method,
        new_map_seconds=making + max(first - again, 0.0),
        new_material_seconds=remaking + max(first_other - again_other, 0.0),
        bytes=held,
    )
