"""The source files a module leads to: what a result kept on disk depends on."""

import functools
import pathlib
import re

_PACKAGE = pathlib.Path(__file__).parent
_IMPORT = re.compile(r"^[ \t]*from[ \t]+(\.+)([\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n#]+)", re.M)


def _imports(source: pathlib.Path, text: str) -> set[pathlib.Path]:
    """Files of the package that a module's relative imports may name."""
    found = set()
    for dots, dotted, names in _IMPORT.findall(text):
        base = source.parents[len(dots) - 1].joinpath(*filter(None, dotted.split(".")))
        found |= {base.with_suffix(".py"), base / "__init__.py"}
        found |= {base / f"{name}.py" for name in re.findall(r"\w+", names)}
    return {path for path in found if path.is_file() and path != _PACKAGE / "__init__.py"}


@functools.cache
def sources_of(module: pathlib.Path) -> tuple[pathlib.Path, ...]:
    """The module's file and every file of the package that it leads to, sorted."""
    seen: set[pathlib.Path] = set()
    todo = {module}
    while todo:
        source = todo.pop()
        seen.add(source)
        todo |= _imports(source, source.read_text(encoding="utf-8")) - seen
    return tuple(sorted(seen))
