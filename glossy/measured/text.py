"""Tables as text: ``theta_i phi_i theta_o phi_o p``, one pair of directions a line.

Five columns hold one intensity, seven hold RGB, and a last column may hold the solid angle of the
row. Values are transfer probability densities p = f |cos theta_o| [1/sr], thesis section 2.3, and
angles degrees; directions below the surface have polar angles above 90. Comments start with ``#``;
these are heeded, before the first row::

    # angles: degrees          or radians
    # quantity: p              or f
    # columns: theta_i phi_i theta_o phi_o p_r p_g p_b weight       (any order)
    # isotropic: yes           or no; default: yes if all incident light has one azimuth
    # name: white foil
"""

import io
import pathlib

import numpy as np

from .._files import check_words, read_text
from ..frames import spherical
from .table import HORIZON, MeasuredTable

ANGLES = ("theta_i", "phi_i", "theta_o", "phi_o")
COLUMNS = {
    5: (*ANGLES, "p"),
    6: (*ANGLES, "p", "weight"),
    7: (*ANGLES, "p_r", "p_g", "p_b"),
    8: (*ANGLES, "p_r", "p_g", "p_b", "weight"),
}
KEYS = ("angles", "quantity", "columns", "isotropic", "name")
MOST_VALUES = 1 << 27


def read_text_table(path: str | pathlib.Path) -> MeasuredTable:
    """Read a table of measurements in the thesis's form; see the top of this module.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        For a line that is not numbers, a wrong number of columns, angles or values out of range.
    """
    text = read_text(path)
    check_words(str(path), text)
    options = _options(path, text)
    lines = [line.split("#")[0].replace(",", " ").replace(";", " ") for line in text.splitlines()]
    lines = [line for line in lines if line.strip()]
    if lines and lines[0].split()[0] in ANGLES:
        options.setdefault("columns", lines.pop(0))
    if not lines:
        raise ValueError(f"{path}: has no rows of numbers")
    width = len(lines[0].split())
    names = tuple(options["columns"].split()) if "columns" in options else COLUMNS.get(width, ())
    allowed = {frozenset(c) for c in COLUMNS.values()}
    if len(names) != width or frozenset(names) not in allowed:
        raise ValueError(
            f"{path}: has {width} columns, not theta_i phi_i theta_o phi_o p (or p_r p_g p_b), "
            "with or without weight"
        )
    if len(lines) * width > MOST_VALUES:
        raise ValueError(f"{path}: has more than {MOST_VALUES} numbers")
    try:
        rows = np.loadtxt(io.StringIO("\n".join(lines)), ndmin=2, comments=None)
    except ValueError as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())[:200]}") from None
    if not np.isfinite(rows).all():
        bad = int(np.flatnonzero(~np.isfinite(rows).all(axis=1))[0])
        raise ValueError(f"{path}: row {bad + 1} of {len(rows)} is not finite")
    column = {name: rows[:, k] for k, name in enumerate(names)}
    unit = 1.0 if options.get("angles") == "radians" else np.pi / 180.0
    theta_i, phi_i, theta_o, phi_o = (column[name] * unit for name in ANGLES)
    for label, theta in (("theta_i", theta_i), ("theta_o", theta_o)):
        if theta.min() < -1e-9 or theta.max() > np.pi + 1e-6:
            worst = float(column[label][np.argmax(np.abs(theta - 0.5 * np.pi))])
            raise ValueError(f"{path}: {label} must be from 0 to 180 degrees, got {worst:g}")
    wi, wo = spherical(theta_i, phi_i), spherical(theta_o, phi_o)
    values = [column[n] for n in ("p", "p_r", "p_g", "p_b") if n in column]
    f = np.stack(values, axis=1)
    cosine = np.abs(wo[:, 2:])
    if options.get("quantity", "p") == "p":
        f = np.where(cosine > HORIZON, f / np.maximum(cosine, HORIZON), 0.0)
    lit = np.abs(wi[:, 2]) > HORIZON
    if not lit.any():
        raise ValueError(f"{path}: all incident directions lie in the horizon")
    wi, wo, f = wi[lit], wo[lit], f[lit]
    weight = column["weight"][lit] if "weight" in column else None
    return MeasuredTable(
        wi,
        wo,
        f,
        weight,
        name=options.get("name", pathlib.Path(path).stem),
        source=str(path),
        isotropic=_isotropic(options.get("isotropic"), theta_i[lit], phi_i[lit]),
    )


def _isotropic(said: str | None, theta: np.ndarray, phi: np.ndarray) -> bool:
    if said is not None:
        return said == "yes"
    away = np.abs(np.sin(theta)) > 1e-3
    turned = np.angle(np.exp(1j * (phi[away] - phi[away][:1])))
    return bool(np.all(np.abs(turned) < 1e-3))


def _options(path: str | pathlib.Path, text: str) -> dict[str, str]:
    """The heeded comments ``# key: value`` that stand before the first row."""
    found: dict[str, str] = {}
    for line in text.splitlines():
        line = line.strip()
        if line and not line.startswith("#"):
            break
        key, colon, value = line.lstrip("# ").partition(":")
        key, value = key.strip().lower(), value.strip()
        if colon and key in KEYS:
            found[key] = value if key == "name" else value.lower()
    for key, allowed in (
        ("angles", ("degrees", "radians")),
        ("quantity", ("p", "f")),
        ("isotropic", ("yes", "no")),
    ):
        if key in found and found[key] not in allowed:
            said = found[key][:40]
            raise ValueError(f"{path}: {key} must be {' or '.join(allowed)}, got {said!r}")
    return found
