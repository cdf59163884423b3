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
"""

import dataclasses
import pathlib
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from .._files import read_text
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
        root = ElementTree.fromstring(text.encode("utf-8"), ElementTree.XMLParser(encoding="utf-8"))
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: is not XML: {error}") from None
    if _tag(root) != "windowelement":
        raise ValueError(f"{path}: is not a BSDF file: its root is {_tag(root)[:40]!r}")
    structure = _text(root, "incidentdatastructure").lower()
    if structure not in ("columns", "rows"):
        raise ValueError(f"{path}: holds {structure[:40] or 'no structure'!r}, not a Klems matrix")
    bases = {basis.name.lower(): basis for basis in _bases(path, root)}
    blocks: dict[str, Float64Array] = {}
    axes: list[dict[str, KlemsBasis]] = [{}, {}]
    for data in _all(root, "wavelengthdata"):
        if _text(data, "wavelength").lower() not in ("visible", ""):
            continue
        for block in _all(data, "wavelengthdatablock"):
            side = " ".join(_text(block, "wavelengthdatadirection").lower().split())
            if side not in BLOCKS:
                raise ValueError(f"{path}: has a block of unknown direction {side[:40]!r}")
            pair = []
            for name in ("rowanglebasis", "columnanglebasis"):
                wanted = _text(block, name)
                if wanted.lower() not in bases:
                    raise ValueError(f"{path}: has no angle basis {wanted[:40]!r}")
                pair.append(bases[wanted.lower()])
            matrix = _matrix(path, side, _text(block, "scatteringdata"), pair)
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
    for block, matrix in data.blocks.items():
        side_i, side_o = BLOCKS[block]
        wi, wo = data.incident[block].incident(side_i), data.outgoing[block].outgoing(side_o)
        parts[0].append(np.repeat(wi, len(wo), axis=0))
        parts[1].append(np.tile(wo, (len(wi), 1)))
        parts[2].append(matrix.T.reshape(-1, 1))
        parts[3].append(np.tile(data.outgoing[block].solid_angle, len(wi)))
    wi, wo, f, weight = (np.concatenate(p) for p in parts)
    return MeasuredTable(wi, wo, f, weight, name=data.name, source=str(path))


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


def _bases(path: str | pathlib.Path, root: Element) -> Iterator[KlemsBasis]:
    for basis in _all(root, "anglebasis"):
        rings = []
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
            if sum(r[3] for r in rings) > MOST_PATCHES:
                raise ValueError(f"{path}: has more than {MOST_PATCHES} patches in a basis")
        if not rings:
            raise ValueError(f"{path}: has an angle basis without rings")
        count = np.concatenate([np.full(n, n) for *_, n in rings])
        theta, low, high = (np.radians(np.repeat([r[k] for r in rings], [r[3] for r in rings]))
                            for k in range(3))  # fmt: skip
        phi = np.concatenate([2.0 * np.pi * np.arange(n) / n for *_, n in rings])
        yield KlemsBasis(_text(basis, "anglebasisname"), theta, phi, low, high, count)


def _matrix(path: str | pathlib.Path, side: str, text: str, axes: list[KlemsBasis]) -> Float64Array:
    try:
        values = np.array(text.replace(",", " ").split(), dtype=np.float64)
    except ValueError as error:
        reason = " ".join(str(error).split())[:100]
        raise ValueError(f"{path}: {side} holds what is not a number: {reason}") from None
    rows, columns = (len(axis.theta) for axis in axes)
    if len(values) != rows * columns:
        raise ValueError(f"{path}: {side} has {len(values)} numbers, not {rows} x {columns}")
    if not np.isfinite(values).all():
        raise ValueError(f"{path}: {side} holds numbers that are not finite")
    return values.reshape(rows, columns)
