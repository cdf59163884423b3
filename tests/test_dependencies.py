"""What the package imports is what its distribution asks for."""

import ast
import pathlib
import re
import sys
import tomllib

import glossy

PACKAGE = pathlib.Path(glossy.__file__).parent
PROJECT = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text())["project"]
DISTRIBUTION = {"PIL": "pillow", "flip_evaluator": "flip-evaluator"}
"""Of modules that are not named like their distribution."""


def imported() -> set[str]:
    found = set()
    for file in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.split(".")[0])
    return found - set(sys.stdlib_module_names)


def declared(requirements: list[str]) -> set[str]:
    """Names of the distributions, and of the extras that bring further ones."""
    names = set()
    for requirement in requirements:
        name, extra = re.match(r"([\w-]+)(\[\w+\])?", requirement).groups()  # type: ignore[union-attr]
        names |= {name.lower(), *(extra[1:-1].split() if extra else [])}
    return names


def test_what_is_imported_is_declared_and_the_other_way_round() -> None:
    needed = declared(PROJECT["dependencies"])
    optional = declared(
        [r for name, group in PROJECT["optional-dependencies"].items() for r in group]
    )
    names = {DISTRIBUTION.get(module, module).lower() for module in imported()}
    assert names <= needed | optional
    assert needed <= names
