"""Klems matrices in the XML of WINDOW, Radiance and LBNL's data base: reflection, transmission.

The hemisphere is cut into rings of patches; a matrix holds the BSDF [1/sr], averaged over patches,
for light from each patch (columns) into each (rows), for light from the front and from the back. A
row of the table has the centres of two patches, and the solid angle of the outgoing one. A patch's
own measure is its projected solid angle::

    Lambda = pi (sin^2 theta_high - sin^2 theta_low) / n_phi                                (1)

Directions: the front is +z. With a the azimuth of a patch, the light comes from
(cos a, -sin a, +-) and leaves into (-cos a, sin a, +-), so that equal patches are the mirror
direction in reflection and straight through in transmission. This is Radiance's reading (x to the
right and y up as seen from its front, which is the XML's back), turned half about y.

A basis that a file names and does not define is one of LBNL's: Full, Half or Quarter. Half has 77
patches in WINDOW and in today's Radiance and had 73 in Radiance's earlier table; the matrix tells.
"""

import dataclasses
import itertools
import pathlib
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _memory
from .._files import check_words, read_text
from .table import MeasuredTable

Float64Array = npt.NDArray[np.float64]
Element = ElementTree.Element

BLOCKS = {
    "transmission front": (1.0, -1.0),
    "transmission back": (-1.0, 1.0),
    "reflection front": (1.0, 1.0),
    "reflection back": (-1.0, -1.0),
}  # signs of wi.z and wo.z
MOST_PATCHES = 2048
MOST_CHARACTERS = 1 << 26
MOST_DEPTH = 16  # of elements within each other; the format has 8
ROW_BYTES = 400  # that a row of the table takes while it is made

STANDARD: dict[str, list[tuple[tuple[float, ...], tuple[int, ...]]]] = {
    "full": [((5, 15, 25, 35, 45, 55, 65, 75, 90), (1, 8, 16, 20, 24, 24, 24, 16, 12))],
    "half": [
        ((6.5, 19.5, 32.5, 45.5, 58.5, 71.5, 90), (1, 8, 12, 16, 20, 12, 8)),
        ((6.5, 19.5, 32.5, 46.5, 61.5, 76.5, 90), (1, 8, 12, 16, 20, 12, 4)),
    ],
    "quarter": [((9, 27, 45, 63, 90), (1, 8, 12, 12, 8))],
}  # upper bounds of the rings [degree], and their patches; the first is about the normal


@dataclasses.dataclass(frozen=True, eq=False)
class KlemsBasis:
    """Patches of a hemisphere: centres ``theta``, ``phi`` [rad] and bounds in theta, each (n,)."""

    name: str
    theta: Float64Array
    phi: Float64Array
    low: Float64Array
    high: Float64Array
    count: npt.NDArray[np.int64]

    @property
    def solid_angle(self) -> Float64Array:
        """Of each patch [sr]."""
        return np.asarray(2.0 * np.pi * (np.cos(self.low) - np.cos(self.high)) / self.count)

    @property
    def projected(self) -> Float64Array:
        """Projected solid angle of each patch [sr], eq. (1)."""
        return np.asarray(np.pi * (np.sin(self.high) ** 2 - np.sin(self.low) ** 2) / self.count)

    def incident(self, side: float) -> Float64Array:
        """Directions (n, 3) that light comes from."""
        s = np.sin(self.theta)
        x, y = s * np.cos(self.phi), -s * np.sin(self.phi)
        return np.stack([x, y, side * np.cos(self.theta)], axis=1)

    def outgoing(self, side: float) -> Float64Array:
        """Directions (n, 3) that light leaves into."""
        return np.asarray(self.incident(side) * np.array([-1.0, -1.0, 1.0]))


@dataclasses.dataclass(frozen=True, eq=False)
class KlemsData:
    """Matrices (rows: outgoing, columns: incident) by block name, with the bases of their axes."""

    name: str
    blocks: dict[str, Float64Array]
    outgoing: dict[str, KlemsBasis]
    incident: dict[str, KlemsBasis]

    def hemispherical(self, block: str) -> Float64Array:
        """Share of the light from each incident patch that the block sends out, sum f Lambda."""
        return np.asarray(self.outgoing[block].projected @ self.blocks[block])


def read_klems_data(path: str | pathlib.Path) -> KlemsData:
    """Read the visible matrices of a Klems BSDF XML file.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not such a file, is damaged, or holds a tensor tree instead of matrices.
    """
    text = read_text(path)
    if len(text) > MOST_CHARACTERS or "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError(f"{path}: is too long, or declares entities, which are not read")
    try:
        parser = ElementTree.XMLParser(target=_Shallow(), encoding="utf-8")
        root = ElementTree.fromstring(text.encode("utf-8"), parser)
    except (ElementTree.ParseError, ValueError) as error:
        raise ValueError(f"{path}: is not XML that is read: {error}") from None
    if _tag(root) != "windowelement":
        raise ValueError(f"{path}: is not a BSDF file: its root is {_tag(root)[:40]!r}")
    structure = _text(root, "incidentdatastructure").lower()
    if structure not in ("columns", "rows"):
        raise ValueError(f"{path}: holds {structure[:40] or 'no structure'!r}, not a Klems matrix")
    bases = {basis.name.lower(): [basis] for basis in _bases(path, root)}
    blocks: dict[str, Float64Array] = {}
    axes: list[dict[str, KlemsBasis]] = [{}, {}]
    for data in _all(root, "wavelengthdata"):
        if _text(data, "wavelength").lower() not in ("visible", ""):
            continue
        for block in _all(data, "wavelengthdatablock"):
            side = " ".join(_text(block, "wavelengthdatadirection").lower().split())
            if side not in BLOCKS:
                raise ValueError(f"{path}: has a block of unknown direction {side[:40]!r}")
            known = []
            for name in ("rowanglebasis", "columnanglebasis"):
                wanted = _text(block, name)
                known.append(bases.get(wanted.lower()) or standard_bases(wanted))
                if not known[-1]:
                    raise ValueError(f"{path}: has no angle basis {wanted[:40]!r}")
            matrix, pair = _matrix(path, side, _text(block, "scatteringdata"), known)
            if structure == "rows":
                matrix, pair = np.ascontiguousarray(matrix.T), pair[::-1]
            blocks[side] = matrix
            axes[0][side], axes[1][side] = pair
    if not blocks:
        raise ValueError(f"{path}: has no matrix of visible light")
    return KlemsData(_text(root, "name") or pathlib.Path(path).stem, blocks, axes[0], axes[1])


def read_klems(path: str | pathlib.Path) -> MeasuredTable:
    """Read a Klems BSDF XML file as a table of all its blocks; see `read_klems_data`."""
    data = read_klems_data(path)
    parts: list[list[Float64Array]] = [[], [], [], []]
    _memory.check(str(path), ROW_BYTES * sum(m.size for m in data.blocks.values()))
    for block, matrix in data.blocks.items():
        side_i, side_o = BLOCKS[block]
        wi, wo = data.incident[block].incident(side_i), data.outgoing[block].outgoing(side_o)
        parts[0].append(np.repeat(wi, len(wo), axis=0))
        parts[1].append(np.tile(wo, (len(wi), 1)))
        parts[2].append(matrix.T.reshape(-1, 1))
        parts[3].append(np.tile(data.outgoing[block].solid_angle, len(wi)))
    wi, wo, f, weight = (np.concatenate(p) for p in parts)
    return MeasuredTable(wi, wo, f, weight, name=data.name, source=str(path))


class _Shallow(ElementTree.TreeBuilder):
    """A tree without comments whose elements lie only so deep in each other."""

    depth = 0

    def start(self, tag: Any, attrs: dict[Any, Any], /) -> Element:
        self.depth += 1
        if self.depth > MOST_DEPTH:
            raise ValueError(f"its elements lie more than {MOST_DEPTH} deep in each other")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> Element:
        self.depth -= 1
        return super().end(tag)


def _tag(element: Element) -> str:
    return element.tag.rsplit("}", 1)[-1].lower()


def _all(root: Element, name: str) -> Iterator[Element]:
    return (e for e in root.iter() if _tag(e) == name)


def _text(root: Element, name: str) -> str:
    return next((" ".join((e.text or "").split()) for e in _all(root, name)), "")


def _number(path: str | pathlib.Path, root: Element, name: str) -> float:
    text = _text(root, name)
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ValueError(f"{path}: {name} must be a number, got {text[:40]!r}")
    return value


def _basis(name: str, rings: Sequence[tuple[float, float, float, int]]) -> KlemsBasis:
    """Rings of centre, lower and upper bound [degree], and number of patches."""
    repeats = [ring[3] for ring in rings]
    theta, low, high = (np.radians(np.repeat([r[k] for r in rings], repeats)) for k in range(3))
    phi = np.concatenate([2.0 * np.pi * np.arange(n) / n for n in repeats])
    return KlemsBasis(name, theta, phi, low, high, np.repeat(repeats, repeats))


def standard_bases(name: str) -> list[KlemsBasis]:
    """LBNL's basis of a name such as ``LBNL/Klems Full``; two for Half, none for other names."""
    words = name.lower().removeprefix("lbnl/").removeprefix("klems").strip()
    found = []
    for bounds, counts in STANDARD.get(words, []):
        low = (0.0, *bounds[:-1])
        centres = (0.0, *(0.5 * (a + b) for a, b in zip(low[1:], bounds[1:], strict=True)))
        rings = list(zip(centres, low, map(float, bounds), counts, strict=True))
        found.append(_basis(name, rings))
    return found


def _bases(path: str | pathlib.Path, root: Element) -> Iterator[KlemsBasis]:
    for basis in _all(root, "anglebasis"):
        rings: list[tuple[float, float, float, int]] = []
        total = 0
        for block in _all(basis, "anglebasisblock"):
            theta = _number(path, block, "theta")
            n = _number(path, block, "nphis")
            low = _number(path, block, "lowertheta")
            high = _number(path, block, "uppertheta")
            if not (0.0 <= low <= theta < high <= 90.0 and theta < 90.0 and 1 <= n <= 360):
                raise ValueError(f"{path}: a ring of {n:g} patches, {low:g} to {high:g} degrees")
            if n != int(n):
                raise ValueError(f"{path}: nphis must be a whole number, got {n:g}")
            rings.append((theta, low, high, int(n)))
            total += int(n)
            if total > MOST_PATCHES:
                raise ValueError(f"{path}: has more than {MOST_PATCHES} patches in a basis")
        if rings:
            yield _basis(_text(basis, "anglebasisname"), rings)


def _matrix(
    path: str | pathlib.Path, side: str, text: str, known: list[list[KlemsBasis]]
) -> tuple[Float64Array, list[KlemsBasis]]:
    """The numbers, and of the bases known by the names of rows and columns those that they fit."""
    check_words(str(path), text)
    try:
        values = np.array(text.replace(",", " ").split(), dtype=np.float64)
    except ValueError as error:
        reason = " ".join(str(error).split())[:100]
        raise ValueError(f"{path}: {side} holds what is not a number: {reason}") from None
    pairs = list(itertools.product(*known))
    if len(pairs) == 4:  # both of one name with two meanings have the same one
        pairs = [pairs[0], pairs[3], pairs[1], pairs[2]]
    sizes = [(len(rows.theta), len(columns.theta)) for rows, columns in pairs]
    fits = [k for k, (rows, columns) in enumerate(sizes) if rows * columns == len(values)]
    if not fits:
        wanted = " or ".join(f"{rows} x {columns}" for rows, columns in sizes)
        raise ValueError(f"{path}: {side} has {len(values)} numbers, not {wanted}")
    if not np.isfinite(values).all():
        raise ValueError(f"{path}: {side} holds numbers that are not finite")
    return values.reshape(sizes[fits[0]]), list(pairs[fits[0]])
