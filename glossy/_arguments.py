"""What annotations promise, held to at the public functions: one rule for every argument.

``checked`` reads a function's annotations on its first call. An argument that must be an object of
the package, a path, a switch or a collection is refused if it is none, before anything touches it.
Numbers, arrays and names have rules of their own in ``_check``.
"""

import functools
import importlib
import inspect
import os
import pathlib
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar, cast

import numpy as np

from . import _check

F = TypeVar("F", bound=Callable[..., Any])

COLLECTIONS = {
    Mapping: "a mapping of names to values",
    dict: "a mapping of names to values",
    Sequence: "a sequence",
    Iterable: "a sequence",
    os.PathLike: "a path",
    bool: "True or False",
    type(None): "None",
}
PACKAGE = __name__.partition(".")[0]


class _Names(dict[str, Any]):
    """Public classes by name, for annotations that are only imported for type checkers."""

    def __missing__(self, name: str) -> Any:
        package = importlib.import_module(PACKAGE)
        if name not in package.__all__:
            raise KeyError(name)
        return getattr(package, name)


def _classes(hint: Any) -> tuple[type, ...]:
    """Classes that an annotation admits; none where it admits what has a rule of its own."""
    united = typing.get_origin(hint) in (typing.Union, types.UnionType)
    found = []
    for part in typing.get_args(hint) if united else (hint,):
        plain = typing.get_origin(part) or part
        plain = os.PathLike if plain is pathlib.Path else plain
        ours = isinstance(plain, type) and plain.__module__.partition(".")[0] == PACKAGE
        if not (plain in (*COLLECTIONS, str) or ours) or getattr(plain, "_is_protocol", False):
            return ()
        found.append(plain)
    return () if found in ([str], [str, type(None)]) else tuple(found)


def _name(kind: type) -> str:
    return COLLECTIONS.get(kind) or ("a " * (not kind.__name__.endswith("s")) + kind.__name__)


def _rule(kinds: tuple[type, ...]) -> str:
    named = dict.fromkeys(_name(k) for k in kinds if not (k is str and os.PathLike in kinds))
    return f"must be {' or '.join('a string' if n == 'a str' else n for n in named)}"


def require(name: str, value: object, hint: Any) -> None:
    """Refuse a value that is not what an annotation promises.

    Raises
    ------
    ValueError
        One line with the argument, the rule, and the value or what it is an object of.
    """
    kinds = _classes(hint)
    single = isinstance(value, np.ndarray) and value.ndim == 0  # which cannot be gone through
    if (
        not kinds
        or (isinstance(value, kinds) and not single)
        or (bool in kinds and isinstance(value, np.bool_))
    ):
        if os.PathLike in kinds and isinstance(value, str) and "\0" in value:
            raise _check.fail(name, "must not hold a zero character", value)
        return
    plain = value is None or isinstance(value, str | bytes | int | float | list | tuple | dict)
    raise _check.fail(name, _rule(kinds), value if plain else type(value))


@functools.cache
def hints(function: Callable[..., Any]) -> dict[str, Any]:
    """Annotations of a function's parameters, in order."""
    names = _Names()
    found = {}
    for parameter in inspect.signature(function).parameters.values():
        given = parameter.annotation
        variadic = parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL)
        if isinstance(given, str) and not variadic:
            given = eval(given, function.__globals__, names)
        found[parameter.name] = Any if variadic else given
    return found


def checked(function: F) -> F:
    """``function``, which refuses arguments that are not what its annotations promise.

    A message of several lines (a path may hold line breaks) is raised again as one.
    """

    @functools.wraps(function)
    def call(*args: Any, **given: Any) -> Any:
        known = hints(function)
        for name, value in (*zip(known, args, strict=False), *given.items()):
            require(name, value, known.get(name, Any))
        try:
            return function(*args, **given)
        except (ValueError, OSError) as error:
            words = str(error)
            if len(words.splitlines()) < 2:
                raise
            kind = type(error) if isinstance(error, OSError) else ValueError
            raise kind(" ".join(words.split())) from None

    return cast(F, call)
