"""The folder of a study: one file per finished measurement, written whole or not at all.

::

    DIR/study.lock.json     what is measured, and the sessions that measured it
    DIR/study.running.json  the process that works there (``lock``)
    DIR/cells/*.json        one finished measurement each
    DIR/truth/*.npz         ground truth of each case

A study that is resumed takes the finished files as they are, so its numbers stay the same. It may
have more cases, methods and budgets than before. Each file carries a checksum (``sealed``) and the
mark of what it was measured with; one that does not fit is refused and stays where it is.
"""

import contextlib
import itertools
import json
import os
import pathlib
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check
from .._npz import load_npz
from .._output import write_npz, write_text
from . import sealed
from .lock import Lock
from .settings import digest

MANIFEST = "study.lock.json"
TRUTH = ("radiance", "error", "kind", "seconds", "study")
GROWING = ("cases", "methods", "budgets", "thresholds")  # settings that may become more
CASE: dict[str, Any] = {"name": str, "material": dict}
SETTINGS: dict[str, Any] = {
    "cases": list[dict[str, Any]], "methods": list[str], "budgets": list[int], "thresholds": dict,
    "baseline": list,
}  # fmt: skip
"""Entries of a record that are read again, beside the sessions; others are only compared."""
LEFT_OVER = re.compile(r"\..+-[0-9a-f]{12}\.(json|npz|csv|md|png)")
"""Name of a file that was being written when its process ended."""
Array = npt.NDArray[np.float64]


def write_json(path: pathlib.Path, value: Any) -> None:
    """Write JSON, whole or not at all; NaN and infinity are refused."""
    write_text(path, json.dumps(value, indent=1, allow_nan=False) + "\n")


def recorded(folder: str | os.PathLike[str]) -> tuple[dict[str, Any], list[Any]] | None:
    """Settings and sessions of the study in a folder; None if there is none.

    Raises
    ------
    OSError, ValueError
        If its record cannot be read.
    """
    manifest = pathlib.Path(folder) / MANIFEST
    if not sealed.is_there(manifest):
        return None
    with _naming(manifest, "the record of a study"):
        found = sealed.read(manifest)
        try:
            settings, sessions = found["settings"], found["sessions"]
            _check_entries(settings, SETTINGS)
            sealed.check_entry("sessions", sessions, list[dict[str, Any]])
            for case in settings["cases"]:
                _check_entries(case, CASE)
            for session in sessions:
                sealed.check_entry("arguments", session.get("arguments", {}), dict)
                sealed.check_entry("command", session.get("command", ""), str)
            names = [case["name"] for case in settings["cases"]]
            whole = itertools.product(names, settings["methods"], settings["budgets"])
        except KeyError:
            raise ValueError("settings or sessions are missing") from None
        if not sessions:
            raise ValueError("holds no session")
        if tuple(settings["baseline"]) not in list(whole):
            raise ValueError("baseline must be a case, a method and a budget of the study")
    return settings, sessions


def _check_entries(value: Any, kinds: dict[str, Any]) -> None:
    sealed.check_entry("settings", value, dict)
    for name, kind in kinds.items():
        sealed.check_entry(name, value[name], kind)


@contextlib.contextmanager
def _naming(path: pathlib.Path, what: str, advice: str = "") -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{path}: not {what}: {error}{advice}") from None


class Store:
    """The finished measurements of one study.

    Parameters
    ----------
    folder : path
        Made if it is not there.
    settings : JSON value
        What the study measures. A folder holding other settings is refused.
    machine : JSON value
        Recorded as a new session.
    resume : bool
        Keep what is finished; without it, a folder that holds measurements is refused.

    Raises
    ------
    ValueError
        If the folder holds a study that cannot be continued or must not be overwritten, or another
        process works there.
    """

    def __init__(
        self, folder: str | os.PathLike[str], settings: Any, machine: Any, resume: bool = False
    ) -> None:
        self.folder = pathlib.Path(folder)
        self.settings = json.loads(json.dumps(settings))
        (self.folder / "cells").mkdir(parents=True, exist_ok=True)
        (self.folder / "truth").mkdir(exist_ok=True)
        self.sessions: list[Any] = []
        self.lock = Lock(self.folder)
        with self.lock:
            kept = ("cells/[!.]*.json", "truth/[!.]*.npz")
            if any(any(self.folder.glob(pattern)) for pattern in kept):
                if not resume:
                    raise ValueError(
                        f"{self.folder}: holds a study already; --resume continues it, "
                        "or choose another folder"
                    )
                self._continue()
            self._sweep()
            self.sessions.append(machine)
            self.save_manifest()

    def _continue(self) -> None:
        old = recorded(self.folder)
        if old is None:
            raise ValueError(f"{self.folder / MANIFEST}: not the record of a study: is missing")
        settings, self.sessions = old
        changed = _check.shortened(", ".join(_changes(settings, self.settings)))
        if changed:
            raise ValueError(f"{self.folder}: holds a study with other settings ({changed})")

    def _sweep(self) -> None:
        """Remove what processes that were killed had begun to write."""
        for folder in (self.folder, self.folder / "cells", self.folder / "truth"):
            for path in folder.iterdir():
                if LEFT_OVER.fullmatch(path.name) and path.is_file():
                    path.unlink()

    @property
    def session(self) -> int:
        """Index of this run among the sessions."""
        return len(self.sessions) - 1

    def save_manifest(self) -> None:
        """Write settings and sessions."""
        value = sealed.sealed({"settings": self.settings, "sessions": self.sessions})
        write_json(self.folder / MANIFEST, value)

    def check_mine(self) -> None:
        """Refuse if another process has taken the folder since this study was made."""
        if recorded(self.folder) != (self.settings, self.sessions):
            raise ValueError(f"{self.folder}: another study was started here meanwhile")

    def mark(self, case: str) -> str:
        """What figures of a case depend on beside method and budget, in a few digits."""
        fixed = {name: v for name, v in self.settings.items() if name not in GROWING}
        return digest(fixed, *(c for c in self.settings["cases"] if c["name"] == case))

    def cell_path(self, key: str) -> pathlib.Path:
        """Where a finished measurement is kept."""
        return self.folder / "cells" / f"{key}.json"

    def get(self, key: str, case: str, kind: type) -> dict[str, Any] | None:
        """The fields of a finished measurement of type ``kind``, or None."""
        path = self.cell_path(key)
        if not sealed.is_there(path):
            return None
        with self.naming(path):
            found: dict[str, Any] = sealed.read(path, kind, ("study",))
            self._check_mark(found.pop("study"), case)
        return found

    @contextlib.contextmanager
    def naming(self, path: pathlib.Path, what: str = "a finished measurement") -> Iterator[None]:
        """Faults that are raised inside name the file and the way out."""
        with _naming(path, what, "; delete it to redo it"):
            yield

    def _check_mark(self, mark: object, case: str) -> None:
        if mark != self.mark(case):
            raise ValueError("of a study with other settings")

    def put(self, key: str, value: dict[str, Any]) -> None:
        """Keep a finished measurement; its entry ``case`` names the case."""
        whole = {"study": self.mark(value.get("case", "")), **value}
        write_json(self.cell_path(key), sealed.sealed(whole))

    def get_truth(self, key: str, case: str) -> dict[str, Array] | None:
        """Arrays of a finished ground truth, or None."""
        path = self.folder / "truth" / f"{key}.npz"
        if not sealed.is_there(path):
            return None
        with self.naming(path, "a finished truth"):
            try:
                found = load_npz(path, (*TRUTH, "sha256"))
            except ValueError as error:
                raise ValueError(str(error).removeprefix(f"{path}: ")) from None
            checksum = found.pop("sha256", None)
            if checksum is None or set(found) != set(TRUTH):
                raise ValueError("of another version, without a checksum")
            if str(checksum) != sealed.array_checksum(found):
                raise ValueError("changed since it was written: its checksum is another")
            self._check_mark(str(found.pop("study")), case)
            shapes = [found[name].shape for name in ("radiance", "error", "kind", "seconds")]
            kinds = "".join(found[name].dtype.kind for name in ("radiance", "error", "seconds"))
            pixels = (self.settings["pixels"], 3)
            if shapes != [pixels, pixels, (), ()] or kinds != "fff":
                raise ValueError("its arrays are of other shapes or types")
        return found

    def put_truth(self, key: str, case: str, arrays: dict[str, Any]) -> None:
        """Keep a finished ground truth."""
        whole = {**arrays, "study": np.array(self.mark(case))}
        path = self.folder / "truth" / f"{key}.npz"
        write_npz(path, {**whole, "sha256": np.array(sealed.array_checksum(whole))})


def _changes(old: dict[str, Any], new: dict[str, Any]) -> Iterator[str]:
    """Settings that make measured cells differ, or that leave some out."""
    for name in dict.fromkeys([*new, *old]):
        before, now = old.get(name), new.get(name)
        if name == "thresholds" or before == now:
            continue  # which follow from the budgets
        if name not in GROWING:
            yield name
            continue
        lost = [one for one in list(before or []) if one not in (now or [])]
        if lost:
            words = [one["name"] if isinstance(one, dict) else str(one) for one in lost]
            yield f"{name} without {' '.join(words)}"
