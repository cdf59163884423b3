"""Measured materials from files, whatever their kind."""

import contextlib
import pathlib
from collections.abc import Iterator

from .. import _check
from .._arguments import checked
from .cornell import read_cornell
from .klems import read_klems
from .merl import read_merl
from .rgl import read_rgl
from .table import MeasuredTable
from .text import read_text_table

FORMATS = {
    ".txt": "text",
    ".dat": "text",
    ".brdf": "cornell",
    ".bsdf": "rgl",
    ".xml": "klems",
    ".binary": "merl",
}
READERS = {
    "text": read_text_table,
    "cornell": read_cornell,
    "rgl": read_rgl,
    "klems": read_klems,
    "merl": read_merl,
}


@checked
def read_measured(path: str | pathlib.Path, format: str | None = None) -> MeasuredTable:
    """Read a file of measurements as a table.

    Parameters
    ----------
    path : path
    format : str, optional
        ``text`` (``.txt``, ``.dat``): the thesis's kind of table; ``cornell`` (``.brdf``):
        gonioreflectometer spectra; ``rgl`` (``.bsdf``); ``klems`` (``.xml``); ``merl``
        (``.binary``). Without it the suffix decides.

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
    reader = READERS[measured_format(path, format)]
    with naming(path):
        return reader(path)


@contextlib.contextmanager
def naming(path: str | pathlib.Path) -> Iterator[None]:
    """What is wrong with the file's values, by the file's name; the readers name it themselves."""
    try:
        yield
    except (ValueError, OverflowError) as error:
        text = _check.shortened(str(error))
        raise ValueError(text if text.startswith(str(path)) else f"{path}: {text}") from None


def measured_format(path: str | pathlib.Path, format: str | None = None) -> str:
    """Name of the format, or that of the file's suffix; see `read_measured`."""
    kind = FORMATS.get(pathlib.Path(path).suffix.lower()) if format is None else format
    if kind is None:
        suffixes = ", ".join(FORMATS)
        raise ValueError(f"{path}: must end in {suffixes}, or its format must be named (format)")
    return _check.choice("format", kind, READERS)
