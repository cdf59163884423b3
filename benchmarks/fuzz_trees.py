"""Mutations of values in trees: JSON, TOML and XML."""

import json
import random
import re
import tomllib
from typing import Any
from xml.etree import ElementTree

from fuzz_bytes import mutate_line


class Raw(str):
    """A word that is written as it is."""


ODD: tuple[Any, ...] = (
    Raw("9" * 400), Raw("-" + "9" * 400), Raw("9" * 5000), Raw("1e999"), Raw("-1e999"), Raw("nan"),
    Raw("NaN"), Raw("inf"), Raw("Infinity"), Raw("1979-05-27"), Raw("1979-05-27T07:32:00Z"),
    Raw("07:32:00"), Raw("0x7fffffffffffffff"), Raw("'''a\nb'''"), Raw("[" * 3000 + "]" * 3000),
    Raw('{"a":' * 900 + "1" + "}" * 900), True, False, None, "", "a\nb", "a\0b", "x" * 3000,
    "\u2028", "\x85", "..", "*", ".", "/dev/zero", "/etc/passwd", "nan", "1", "NaN", "sphere",
    "mesh", "plane", "box", "torus", "rectangle", "regular", "importance", "planar", "pem", "data:",
    [], {}, [[]], [{}], {"": 1}, 0, 1, 2, 3, 4, 7, 100, -1, 255, 256, 65536, 2**31 - 1, 2**31,
    2**53, 2**63 - 1, 2**63, 2**64, -(2**63), 10**30, 0.0, -0.0, 0.5, 1.0, 1.5, -1.0, 90.0, 180.0,
    1e-300, 5e-324, 1e-30, 1e30, 3.5e38, 1e150, 1e300, 1.7e308, 1e-9, [0, 0, 0], [1, 2], [0.1] * 3,
    [1e300] * 3, [True, False, True],
)  # fmt: skip


def _places(value: Any) -> list[tuple[Any, Any]]:
    found: list[tuple[Any, Any]] = []
    todo = [value]
    while todo and len(found) < 5000:
        node = todo.pop()
        keys = node.keys() if isinstance(node, dict) else range(len(node))
        for key in keys:
            found.append((node, key))
            if isinstance(node[key], dict | list):
                todo.append(node[key])
    return found


def _copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copy(item) for key, item in value.items()}
    return [_copy(item) for item in value] if isinstance(value, list) else value


def mutate_tree(tree: Any, draw: random.Random) -> Any:
    """One random change of a value, a key or a place in a tree of dictionaries and lists."""
    places = _places(tree) if isinstance(tree, dict | list) else []
    if not places or draw.random() < 0.005:
        return _copy(draw.choice(ODD))
    node, key = draw.choice(places)
    old = node[key]
    kind = draw.randrange(12)
    if kind == 0:
        del node[key]
    elif kind == 1:
        other, name = draw.choice(places)
        node[key] = _copy(other[name]) if name in other or isinstance(other, list) else old
    elif kind == 2 and isinstance(node, dict):
        node[draw.choice((draw.choice(places)[1], draw.choice(ODD), ""))] = _copy(old)
        node = {k: v for k, v in node.items() if isinstance(k, str)}
    elif kind == 3 and isinstance(node, list):
        node[key:key] = [_copy(old)] * draw.choice((1, 1, 2, 20))
    elif kind == 4:
        node[key] = draw.choice(([old], {"a": old}, [old, old, old]))
    elif kind == 5 and isinstance(old, int | float) and not isinstance(old, bool):
        node[key] = draw.choice((old + 1, old - 1, -old, old * 2, old + 0.5, old * 1e-9))
    elif kind == 6 and isinstance(old, str):
        node[key] = mutate_line(old.encode("utf-8", "replace"), draw).decode("utf-8", "replace")
    elif kind == 7 and isinstance(old, str):
        node[key] = draw.choice([v for o, k in places if isinstance(v := o[k], str)] or [old])
    else:
        node[key] = _copy(draw.choice(ODD))
    return tree


def dump(value: Any, equals: str = ":") -> str:
    """JSON, or with ``=`` a value of TOML."""
    if isinstance(value, Raw):
        return str(value)
    if isinstance(value, dict):
        rows = (f"{_key(k, equals)}{equals}{dump(v, equals)}" for k, v in value.items())
        return "{" + ",".join(rows) + "}"
    if isinstance(value, list):
        return "[" + ",".join(dump(v, equals) for v in value) + "]"
    if isinstance(value, float) and equals == "=":
        return repr(value)
    if value is None and equals == "=":
        return '""'
    return json.dumps(value) if isinstance(value, str | int | float | None) else f'"{value}"'


def _key(key: object, equals: str) -> str:
    bare = equals == "=" and re.fullmatch(r"[\w-]+", str(key), re.ASCII)
    return str(key) if bare else json.dumps(str(key))


def dump_toml(tree: Any) -> bytes:
    """TOML of one key a line, tables inline."""
    if not isinstance(tree, dict):
        return dump(tree, "=").encode("utf-8", "surrogatepass")
    text = "".join(f"{_key(k, '=')} = {dump(v, '=')}\n" for k, v in tree.items())
    return text.encode("utf-8", "surrogatepass")


def mutate_json(data: bytes, draw: random.Random) -> bytes:
    """JSON with one to three changes of its values."""
    tree = json.loads(data)
    for _ in range(draw.choice((1, 1, 2, 3))):
        tree = mutate_tree(tree, draw)
    return dump(tree).encode("utf-8", "surrogatepass")


def mutate_toml(data: bytes, draw: random.Random) -> bytes:
    """TOML with one to three changes of its values."""
    tree: Any = tomllib.loads(data.decode())
    for _ in range(draw.choice((1, 1, 2, 3))):
        tree = mutate_tree(tree, draw)
    return dump_toml(tree)


def mutate_xml(data: bytes, draw: random.Random) -> bytes:
    """XML with one to three changes: elements dropped, repeated, moved, nested, renamed, filled."""
    root = ElementTree.fromstring(data)
    for _ in range(draw.choice((1, 1, 2, 3))):
        parents = [(parent, child) for parent in root.iter() for child in parent]
        if not parents or len(parents) > 2000:
            break
        (parent, child), (other, place) = draw.choice(parents), draw.choice(parents)
        kind = draw.randrange(10)
        if kind == 0:
            parent.remove(child)
        elif kind == 1:
            parent.extend([child] * draw.choice((1, 1, 3, 10)))
        elif kind == 2 and place not in child.iter():
            place.append(child)
        elif kind == 3 and other not in child.iter():
            for _ in range(draw.choice((1, 15, 17, 200))):
                inner = ElementTree.Element(child.tag)
                inner.append(child)
                child = inner
            other.append(child)
        elif kind == 4:
            child.tag = draw.choice(("a", place.tag))
        else:
            words = (child.text or "").encode()
            child.text = mutate_line(words, draw).decode("latin-1").replace("\0", "")
    return ElementTree.tostring(root)
