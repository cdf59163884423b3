"""The folder of a study: one file per finished measurement, written whole or not at all.

::

    DIR/study.lock.json    what is measured, and the sessions that measured it
    DIR/cells/*.json       one finished measurement each
    DIR/truth/*.npz        ground truth of each case

A study that is resumed takes the finished files as they are, so its numbers stay the same.
"""

import json
import os
import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt

from ..image_write import replacing

MANIFEST = "study.lock.json"
Array = npt.NDArray[np.float64]


def write_text(path: pathlib.Path, text: str) -> None:
    """Write UTF-8 text, whole or not at all."""
    with replacing(path) as temporary:
        pathlib.Path(temporary).write_text(text, encoding="utf-8")


def write_json(path: pathlib.Path, value: Any) -> None:
    """Write JSON, whole or not at all; NaN and infinity are refused."""
    write_text(path, json.dumps(value, indent=1, allow_nan=False) + "\n")


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
        If the folder holds a study that cannot be continued or must not be overwritten.
    """

    def __init__(
        self, folder: str | os.PathLike[str], settings: Any, machine: Any, resume: bool = False
    ) -> None:
        self.folder = pathlib.Path(folder)
        self.settings = json.loads(json.dumps(settings))
        (self.folder / "cells").mkdir(parents=True, exist_ok=True)
        (self.folder / "truth").mkdir(exist_ok=True)
        self.sessions: list[Any] = []
        manifest = self.folder / MANIFEST
        if manifest.exists():
            self._continue(manifest, resume)
        self.sessions.append(machine)
        self.save_manifest()

    def _continue(self, manifest: pathlib.Path, resume: bool) -> None:
        if not resume and any((self.folder / "cells").iterdir()):
            raise ValueError(
                f"{self.folder}: holds a study already; --resume continues it, "
                "or choose another folder"
            )
        try:
            old = json.loads(manifest.read_text())
            settings, sessions = old["settings"], old["sessions"]
        except (ValueError, KeyError, TypeError):
            raise ValueError(f"{manifest}: not the record of a study") from None
        if resume and settings != self.settings:
            changed = [k for k in self.settings if settings.get(k) != self.settings[k]]
            names = ", ".join(changed or ["their number"])
            raise ValueError(f"{self.folder}: holds a study with other settings ({names})")
        self.sessions = sessions if resume else []

    @property
    def session(self) -> int:
        """Index of this run among the sessions."""
        return len(self.sessions) - 1

    def save_manifest(self) -> None:
        """Write settings and sessions."""
        value = {"schema": 1, "settings": self.settings, "sessions": self.sessions}
        write_json(self.folder / MANIFEST, value)

    def get(self, key: str) -> dict[str, Any] | None:
        """A finished measurement, or None."""
        path = self.folder / "cells" / f"{key}.json"
        if not path.exists():
            return None
        try:
            value: dict[str, Any] = json.loads(path.read_text())
            return value
        except ValueError:
            raise ValueError(f"{path}: not a finished measurement; delete it to redo it") from None

    def put(self, key: str, value: dict[str, Any]) -> None:
        """Keep a finished measurement."""
        write_json(self.folder / "cells" / f"{key}.json", value)

    def get_truth(self, key: str) -> dict[str, Array] | None:
        """Arrays of a finished ground truth, or None."""
        path = self.folder / "truth" / f"{key}.npz"
        if not path.exists():
            return None
        with np.load(path, allow_pickle=False) as data:
            return {name: data[name] for name in data.files}

    def put_truth(self, key: str, arrays: dict[str, Any]) -> None:
        """Keep a finished ground truth."""
        path = self.folder / "truth" / f"{key}.npz"
        with replacing(path) as temporary:
            np.savez(temporary, allow_pickle=False, **arrays)
