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

from ..gbuffer import load_npz
from ..image_write import replacing

MANIFEST = "study.lock.json"
TRUTH = ("radiance", "error", "kind", "seconds")
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
        kept = ("cells/*.json", "truth/*.npz")
        if any(any(self.folder.glob(pattern)) for pattern in kept):
            if not resume:
                raise ValueError(
                    f"{self.folder}: holds a study already; --resume continues it, "
                    "or choose another folder"
                )
            self._continue(self.folder / MANIFEST)
        self.sessions.append(machine)
        self.save_manifest()

    def _continue(self, manifest: pathlib.Path) -> None:
        try:
            old = json.loads(manifest.read_text(encoding="utf-8"))
            settings, sessions = dict(old["settings"]), list(old["sessions"])
        except (OSError, ValueError, KeyError, TypeError):
            raise ValueError(f"{manifest}: not the record of a study") from None
        if settings != self.settings:
            keys = dict.fromkeys([*self.settings, *settings])
            changed = [k for k in keys if settings.get(k) != self.settings.get(k)]
            raise ValueError(
                f"{self.folder}: holds a study with other settings ({', '.join(changed)})"
            )
        self.sessions = sessions

    @property
    def session(self) -> int:
        """Index of this run among the sessions."""
        return len(self.sessions) - 1

    def save_manifest(self) -> None:
        """Write settings and sessions."""
        value = {"schema": 1, "settings": self.settings, "sessions": self.sessions}
        write_json(self.folder / MANIFEST, value)

    def cell_path(self, key: str) -> pathlib.Path:
        """Where a finished measurement is kept."""
        return self.folder / "cells" / f"{key}.json"

    def get(self, key: str) -> dict[str, Any] | None:
        """A finished measurement, or None."""
        path = self.cell_path(key)
        if not path.exists():
            return None
        try:
            return dict(json.loads(path.read_text(encoding="utf-8")))
        except (ValueError, TypeError):
            raise ValueError(f"{path}: not a finished measurement; delete it to redo it") from None

    def put(self, key: str, value: dict[str, Any]) -> None:
        """Keep a finished measurement."""
        write_json(self.cell_path(key), value)

    def get_truth(self, key: str) -> dict[str, Array] | None:
        """Arrays of a finished ground truth, or None."""
        path = self.folder / "truth" / f"{key}.npz"
        if not path.exists():
            return None
        try:
            found = load_npz(path, TRUTH)
            return {name: found[name] for name in TRUTH}
        except (ValueError, KeyError):
            raise ValueError(f"{path}: not a finished truth; delete it to redo it") from None

    def put_truth(self, key: str, arrays: dict[str, Any]) -> None:
        """Keep a finished ground truth."""
        path = self.folder / "truth" / f"{key}.npz"
        with replacing(path) as temporary:
            np.savez(temporary, allow_pickle=False, **arrays)
