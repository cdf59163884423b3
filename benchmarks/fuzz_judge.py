"""What is acceptable of a reader, and which lines of the package a run has reached."""

import functools
import pathlib
import sys
import types
import warnings
from typing import Any

from fuzz_targets import Read

TOOL = 4  # of ``sys.monitoring``: none of those with a name
LONGEST = 5000  # characters of a message, which may hold the names of files

READERS = [
    "_check",
    "_exr_header",
    "_files",
    "_formats",
    "_memory",
    "_npz",
    "_radiance",
    "camera",
    "environment",
    "frames",
    "gbuffer",
    "image",
    "latlong",
    "layouts",
    "materials",
    "scene",
    "measured/cornell",
    "measured/klems",
    "measured/merl",
    "measured/read",
    "measured/rgl",
    "measured/table",
    "measured/tensor",
    "measured/text",
    "measured/warp",
    "scenes/gltf",
    "scenes/load",
    "scenes/mesh",
    "scenes/mesh_files",
    "scenes/model",
    "scenes/shapes",
    "scenes/soup",
    "scenes/topology",
    "study/claims",
    "study/commandline",
    "study/lock",
    "study/report",
    "study/sealed",
    "study/settings",
    "study/store",
    "study/run",
]


def attempt(read: Read, folder: pathlib.Path) -> str:
    """What is wrong with how a reader took its files; empty if nothing is."""
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            read(folder)
    except (ValueError, OSError) as error:
        if type(error).__name__ in ("UnicodeDecodeError", "UnicodeEncodeError", "JSONDecodeError"):
            return f"{type(error).__name__}: {str(error)[:80]}"
        return _of_text(type(error).__name__, str(error))
    except BaseException as error:
        return f"{type(error).__name__}{_where(error)}: {str(error)[:80]}"
    for warning in said:
        text = str(warning.message)
        if not issubclass(warning.category, UserWarning):
            place = f"{pathlib.Path(warning.filename).name}:{warning.lineno}"
            return f"{warning.category.__name__} {place}: {text[:80]}"
        if found := _of_text("warning", text):
            return found
    return ""


def _where(error: BaseException) -> str:
    trace, place = error.__traceback__, ""
    while trace:
        code = trace.tb_frame.f_code
        if "glossy" in code.co_filename:
            place = f" {pathlib.Path(code.co_filename).name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return place


def _of_text(kind: str, text: str) -> str:
    lines = text.splitlines()
    if len(lines) != 1:
        return f"{kind} of {len(lines)} lines: {text[:80]!r}"
    if len(text) > LONGEST:
        return f"{kind} of {len(text)} characters: {text[:80]!r}"
    return ""


def fault_key(wrong: str) -> str:
    """Faults with the same key count as one."""
    return " ".join(wrong.split()[:3]).rstrip(":")[:60]


def reader_files() -> set[str]:
    """The modules of ``READERS``."""
    import glossy

    folder = pathlib.Path(glossy.__file__).parent
    return {str(folder / f"{name}.py") for name in READERS}


@functools.cache
def all_lines(file: str) -> frozenset[int]:
    """Lines of a module's functions that can be reached."""
    found: set[int] = set()
    todo = [compile(pathlib.Path(file).read_text(), file, "exec")]
    while todo:
        code = todo.pop()
        if code.co_flags & 2:  # a function
            found |= {line for *_, line in code.co_lines() if line and line > code.co_firstlineno}
        todo += [c for c in code.co_consts if isinstance(c, types.CodeType)]
    return frozenset(found)


class Coverage:
    """Lines of some modules that were reached; ``found`` counts the new ones.

    ``sys.monitoring`` where there is one; else ``sys.settrace``, which costs several times as much,
    so that not every input is traced.
    """

    monitoring: Any = getattr(sys, "monitoring", None)

    def __init__(self, files: set[str]) -> None:
        self.files, self.seen, self.found = files, set[tuple[str, int]](), 0
        self._left: dict[int, tuple[Any, set[int]]] = {}
        if self.monitoring:
            if self.monitoring.get_tool(TOOL) is None:
                self.monitoring.use_tool_id(TOOL, "fuzz")
            self.monitoring.register_callback(TOOL, self.monitoring.events.LINE, self._monitor)

    def start(self) -> None:
        """From here on lines count."""
        self.found = 0
        if self.monitoring:
            self.monitoring.set_events(TOOL, self.monitoring.events.LINE)
        else:
            sys.settrace(self._call)

    def stop(self) -> int:
        """New lines since ``start``."""
        if self.monitoring:
            self.monitoring.set_events(TOOL, 0)
        else:
            sys.settrace(None)
        return self.found

    def reached(self) -> int:
        """How many lines of functions were reached."""
        return sum((file, n) in self.seen for file in self.files for n in all_lines(file))

    def _monitor(self, code: Any, line: int) -> Any:
        self._reach(code.co_filename, line)
        return self.monitoring.DISABLE

    def _reach(self, file: str, line: int) -> None:
        if file in self.files and (file, line) not in self.seen:
            self.seen.add((file, line))
            self.found += 1

    def _call(self, frame: Any, _event: str, _arg: object) -> Any:
        code = frame.f_code
        if code.co_filename not in self.files:
            return None
        if id(code) not in self._left:
            lines = {line for *_, line in code.co_lines() if line}
            self._left[id(code)] = (code, lines)  # kept, so that its id stays its own
        return self._line if self._left[id(code)][1] else None

    def _line(self, frame: Any, event: str, _arg: object) -> Any:
        if event == "line":
            left = self._left[id(frame.f_code)][1]
            if frame.f_lineno in left:
                left.discard(frame.f_lineno)
                self._reach(frame.f_code.co_filename, frame.f_lineno)
        return self._line
