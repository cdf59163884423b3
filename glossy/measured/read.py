"""Measured materials from files, whatever their kind."""

import pathlib

from .. import _check
from .table import MeasuredTable
from .text import read_text_table

FORMATS = {".txt": "text", ".dat": "text"}
READERS = {"text": read_text_table}


def read_measured(path: str | pathlib.Path, format: str | None = None) -> MeasuredTable:
    """Read a file of measurements as a table.

    Parameters
    ----------
    path : path
    format : str, optional
        ``text``: the thesis's kind of table. Without it the suffix decides (``.txt``, ``.dat``).

    Returns
    -------
    MeasuredTable

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        For an unknown format, or a file that is damaged; one line that names the file.
    """
    kind = FORMATS.get(pathlib.Path(path).suffix.lower()) if format is None else format
    if kind is None:
        suffixes = ", ".join(FORMATS)
        raise ValueError(f"{path}: must end in {suffixes}, or its format must be named (format)")
    return READERS[_check.choice("format", kind, READERS)](path)
