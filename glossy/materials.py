"""Materials by name, from a file, or from a line of text.

The names are the published fits of three measured surfaces, thesis Tables 3.1-3.3, and the
materials of our choice (``chosen``); ``describe`` says which is which. The albedos of
those tables stand beside what their printed parameters give: the directional-hemispherical
reflectivity (thesis eq. 2.7) and transmissivity (2.8), averaged plainly over the measured incident
directions. Rounding of the printed parameters alone moves the average by 0.005 to 0.017, which is
less than the gap of two rows and of a misprint (docs/materials.md).

A file is TOML or JSON; a line is ``mx=.2,my=.075,ks=1,r0=1,alpha=0,kd=0``. docs/materials.md has
the formats.
"""

import dataclasses
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from . import _check
from ._files import read_table
from .brdf import Lobe, Material
from .chosen import CHOSEN
from .frames import spherical

LOBE_KEYS = tuple(f.name for f in dataclasses.fields(Lobe))
MATERIAL_KEYS = tuple(f.name for f in dataclasses.fields(Material))
FLAT_KEYS = tuple(key for key in MATERIAL_KEYS if key not in ("reflection", "transmission"))


@dataclasses.dataclass(frozen=True)
class PublishedMaterial:
    """A published fit, and its albedo as printed and as its parameters give it.

    ``published``, ``recomputed``: (reflectivity, transmissivity), None where none is printed.
    ``theta``, ``phi``: measured incident angles [deg]; the isotropic foil has one azimuth.
    """

    name: str
    material: Material
    source: str
    surface: str
    published: tuple[float | None, float | None]
    recomputed: tuple[float | None, float | None]
    theta: tuple[float, ...]
    phi: tuple[float, ...]
    note: str = ""

    def average_albedo(self) -> tuple[float, float]:
        """(reflectivity, transmissivity), the plain mean over the measured directions."""
        theta, phi = np.meshgrid(np.radians(self.theta), np.radians(self.phi))
        up, down = self.material.albedo(spherical(theta, phi))
        return float(up.mean()), float(down.mean())


_ALANOD = "slightly anisotropic scattering aluminium, Alanod 2000 GS"
_FOIL = "isotropic white foil, partly transmissive"
_MIRO = "strongly anisotropic brushed aluminium, Alanod Miro 5"
_METAL = ((0.0, 5.0, 20.0, 35.0, 50.0, 65.0), (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0))
_WHITE = ((0.0, 5.0, 19.0, 33.0, 47.0, 61.0, 75.0), (0.0,))
_MISPRINT = (
    "The printed transmissivity contradicts the printed parameters of the transmission lobe under "
    "every definition tried. mx, my and alpha of that row equal the second lobe's of Table 3.1 "
    "though the foil is isotropic: taken for a misprint, and kept as printed."
)
_FOIL_UP = Lobe(0.124, 0.136, ks=0.78, r0=0.029, alpha=0.5)
_FOIL_DOWN = Lobe(0.25, 0.17, ks=0.67, r0=0.75, alpha=0.6)

PUBLISHED = {
    p.name: p
    for p in (
        PublishedMaterial(
            "alanod-2000gs",
            Material(0.003, [Lobe(0.11, 0.072, ks=0.9, r0=0.89, alpha=0.43)]),
            "thesis Table 3.1, one lobe", _ALANOD, (0.787, None), (0.771, None), *_METAL,
        ),
        PublishedMaterial(
            "alanod-2000gs-two-lobes",
            Material(0.003, [Lobe(0.11, 0.07, ks=0.9, r0=0.87, alpha=0.45),
                             Lobe(0.25, 0.17, ks=0.12, r0=0.89, alpha=0.6)]),
            "thesis Table 3.1, two lobes", _ALANOD, (0.878, None), (0.871, None), *_METAL,
        ),
        PublishedMaterial(
            "white-foil", Material(0.76, [_FOIL_UP], [_FOIL_DOWN]),
            "thesis Table 3.2, both lobes", _FOIL, (0.807, 0.093), (0.807, 0.167), *_WHITE,
            _MISPRINT,
        ),
        PublishedMaterial(
            "white-foil-reflection", Material(0.76, [_FOIL_UP]),
            "thesis Table 3.2, reflection lobe", _FOIL, (0.807, None), (0.807, None), *_WHITE,
        ),
        PublishedMaterial(
            "white-foil-transmission", Material(0.0, [], [_FOIL_DOWN]),
            "thesis Table 3.2, transmission lobe", _FOIL, (None, 0.093), (None, 0.167),
            *_WHITE, _MISPRINT,
        ),
        PublishedMaterial(
            "miro-5",
            Material(0.003, [Lobe(0.0068, 0.0297, ks=0.98, r0=0.84, alpha=0.49)]),
            "thesis Table 3.3, one lobe", _MIRO, (0.815, None), (0.823, None), *_METAL,
        ),
        PublishedMaterial(
            "miro-5-two-lobes",
            Material(0.003, [Lobe(0.0046, 0.0267, ks=0.57, r0=0.94, alpha=0.5),
                             Lobe(0.013, 0.1199, ks=0.54, r0=0.84, alpha=0.38)]),
            "thesis Table 3.3, two lobes", _MIRO, (0.944, None), (0.964, None), *_METAL,
        ),
    )
}  # fmt: skip


def material_names() -> list[str]:
    """Names that ``material`` knows: the published tables in their order, then our choices."""
    return [*PUBLISHED, *CHOSEN]


def published_material(name: str) -> PublishedMaterial:
    """A published fit with its source and albedos.

    Raises
    ------
    ValueError
        If the name is unknown; the message lists the names.
    """
    return PUBLISHED[_check.choice("material", name, PUBLISHED)]


def material(name: str) -> Material:
    """A material by name, as ``material_names`` lists them.

    Raises
    ------
    ValueError
        If the name is unknown; the message lists the names.
    """
    _check.choice("material", name, material_names())
    return PUBLISHED[name].material if name in PUBLISHED else CHOSEN[name].material


def describe(name: str) -> tuple[str, str]:
    """Where a named material comes from, "published" or "chosen by us", and its source or reason.

    Raises
    ------
    ValueError
        If the name is unknown; the message lists the names.
    """
    _check.choice("material", name, material_names())
    if name in PUBLISHED:
        entry = PUBLISHED[name]
        return "published", " ".join(f"{entry.source}: {entry.surface}. {entry.note}".split())
    return "chosen by us", CHOSEN[name].reason


def parse_material(text: str | pathlib.Path) -> Material:
    """A material from a name, a ``.toml`` or ``.json`` file, or a line ``key=value,...``.

    Parameters
    ----------
    text : str or Path
        A line describes one reflection lobe (``mx``, ``my``, ``ks``, ``r0``, ``alpha``; needs
        ``mx``), ``kd`` and ``diffuse_transmission``, and ``kd_falloff=1``; the lobe may be left
        out. An RGB value is ``r/g/b``.

    Raises
    ------
    ValueError
        With one line naming the file, the key, the rule and the value.
    OSError
        If the file cannot be read.
    """
    path = pathlib.Path(text)
    if path.suffix.lower() in (".toml", ".json"):
        return material_from_dict(read_table(path), str(path))
    if "=" in str(text):
        return _from_line(str(text))
    if str(text) not in material_names():
        names = ", ".join(material_names())
        rule = f"must be a .toml or .json file, key=value,... or one of {names}"
        raise _check.fail("material", rule, str(text))
    return material(str(text))


def _from_line(text: str) -> Material:
    values: dict[str, Any] = {}
    for item in text.split(","):
        key, equals, value = (part.strip() for part in item.partition("="))
        if not equals:
            rule = "must be key=value,... (on the command line in quotes if it has blanks)"
            raise _check.fail("material", rule, item)
        if key in values:
            raise _check.fail(f"material: {key}", "must be given once", text)
        try:
            channels = [float(part) for part in value.split("/")]
        except ValueError:
            raise _check.fail(f"material: {key}", "must be a number or r/g/b", value) from None
        values[key] = channels[0] if len(channels) == 1 else channels
    for key in values:
        _check.choice("material: key", key, (*FLAT_KEYS, *LOBE_KEYS))
    if "kd_falloff" in values:
        if values["kd_falloff"] not in (0.0, 1.0):
            raise _check.fail("material: kd_falloff", "must be 0 or 1", text)
        values["kd_falloff"] = bool(values["kd_falloff"])
    flat = {key: value for key, value in values.items() if key in FLAT_KEYS}
    lobe = {key: value for key, value in values.items() if key not in FLAT_KEYS}
    return material_from_dict({**flat, "reflection": [lobe] if lobe else []}, "material")


def material_from_dict(value: object, where: str = "material") -> Material:
    """A material from the contents of a file: numbers, lists ``reflection`` and ``transmission``.

    Raises
    ------
    ValueError
        With ``where``, the key, the rule and the value.
    """
    table = _table(value, where, MATERIAL_KEYS)
    parts: dict[str, Any] = {
        key: table[key] if key == "kd_falloff" else _value(table[key], f"{where}: {key}")
        for key in FLAT_KEYS
        if key in table
    }
    for side in ("reflection", "transmission"):
        lobes = table.get(side, [])
        if not isinstance(lobes, list):
            raise _check.fail(f"{where}: {side}", "must be a list of lobes", lobes)
        parts[side] = [_lobe(lobe, f"{where}: {side}[{k}]") for k, lobe in enumerate(lobes)]
    try:
        return Material(**parts)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _lobe(value: object, where: str) -> Lobe:
    table = _table(value, where, LOBE_KEYS)
    if "mx" not in table:
        raise _check.fail(f"{where}: mx", "is required", dict(table))
    parts: dict[str, Any] = {k: _value(item, f"{where}: {k}") for k, item in table.items()}
    try:
        return Lobe(**parts)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _table(value: object, where: str, keys: Sequence[str]) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise _check.fail(where, f"must be a table with keys {', '.join(keys)}", value)
    for key in value:
        _check.choice(f"{where}: key", key, keys)
    return value


def _value(value: object, where: str) -> Any:
    """A number, or a list of numbers."""
    try:
        for item in value if isinstance(value, list) else [value]:
            _check.number(where, item)
    except ValueError:
        raise _check.fail(where, "must be a finite number or three (RGB)", value) from None
    return value


def material_to_dict(value: Material) -> dict[str, Any]:
    """The inverse of ``material_from_dict``, fit for JSON."""
    return dataclasses.asdict(value)
