"""Small files of measured materials, made from known functions."""

import pathlib
import struct
from typing import Any

import numpy as np
import numpy.typing as npt

from glossy.frames import spherical

Array = npt.NDArray[np.float64]

COLOUR = np.array([0.1, 0.2, 0.3])


def write_tensors(path: pathlib.Path, fields: dict[str, npt.NDArray[Any]]) -> None:
    """A tensor file of float32 and uint8 fields."""
    kinds = {"float32": 10, "uint8": 1}
    head = b"tensor_file\0\x01\x00" + struct.pack("<I", len(fields))
    offset = len(head) + sum(13 + len(n) + 8 * a.ndim for n, a in fields.items())
    body = b""
    for name, array in fields.items():
        head += struct.pack("<H", len(name)) + name.encode()
        head += struct.pack("<HBQ", array.ndim, kinds[array.dtype.name], offset + len(body))
        head += struct.pack(f"<{array.ndim}Q", *array.shape)
        body += array.tobytes()
    path.write_bytes(head + body)


def write_rgl(
    path: pathlib.Path,
    turns: int = 0,
    slope: float = 0.0,
    size: int = 8,
    drop: str = "",
    extra: str = "",
    nan: str = "",
    zero: str = "",
    reverse: str = "",
    cut: str = "",
) -> None:
    """Flat tables: rgb (.1, .2, .3), ndf 2, sigma 1/2; and damages.

    ``turns``: 0 isotropic, else the azimuths cover that share of the turn, from -pi on, and rgb
    grows by ``slope`` per radian.
    """
    azimuths = np.linspace(-np.pi, -np.pi + 2.0 * np.pi / max(turns, 1), 9)
    phi = np.zeros(1) if turns == 0 else azimuths
    theta = np.linspace(0.0, 0.5 * np.pi, 5)
    grown = 1.0 + slope * (phi - phi[0])
    shape = (len(phi), len(theta))
    fields = {
        "description": np.frombuffer(b"flat", dtype=np.uint8),
        "phi_i": phi.astype(np.float32),
        "theta_i": theta.astype(np.float32),
        "sigma": np.full((2, 16), 0.5, dtype=np.float32),
        "ndf": np.full((2, 16), 2.0, dtype=np.float32),
        "vndf": np.ones((*shape, 2, 16), dtype=np.float32),
        "rgb": (
            grown[:, None, None, None, None]
            * COLOUR[:, None, None]
            * np.ones((*shape, 3, size, size))
        ).astype(np.float32),
        "jacobian": np.ones(1, dtype=np.uint8),
    }
    if drop:
        del fields[drop]
    if extra:
        fields[extra] = np.zeros(1, dtype=np.float32)
    if nan:
        fields[nan].flat[3] = np.nan
    if zero:
        fields[zero][...] = 0.0
    if reverse:
        fields[reverse] = fields[reverse][::-1].copy()
    if cut:
        fields[cut] = fields[cut][:1]
    write_tensors(path, fields)


def write_cornell(path: pathlib.Path) -> Array:
    """Rows (K, 4 + 3) of random spectra at three wavelengths for one incident direction."""
    rng = np.random.default_rng(7)
    theta, phi = np.meshgrid(np.radians([5.0, 30.0, 60.0]), np.radians([0.0, 120.0, 240.0]))
    rows = np.stack([np.full(9, 0.5), np.zeros(9), theta.ravel(), phi.ravel()], axis=1)
    rows = np.concatenate([rows, rng.random((9, 3))], axis=1)
    text = "# a paint\n3  # wavelengths\n400 550\n700\n"
    path.write_text(text + "\n".join(" ".join(f"{x:.17g}" for x in row) for row in rows) + "\n")
    return rows


BASIS = """<AngleBasis><AngleBasisName>five</AngleBasisName>
<AngleBasisBlock><Theta>0</Theta><nPhis>1</nPhis><ThetaBounds><LowerTheta>0</LowerTheta>
<UpperTheta>20</UpperTheta></ThetaBounds></AngleBasisBlock>
<AngleBasisBlock><Theta>50</Theta><nPhis>4</nPhis><ThetaBounds><LowerTheta>20</LowerTheta>
<UpperTheta>90</UpperTheta></ThetaBounds></AngleBasisBlock></AngleBasis>
"""


def write_klems(path: pathlib.Path) -> dict[str, Array]:
    """Four blocks of random numbers over five patches; the first number is 0.125."""
    rng = np.random.default_rng(8)
    blocks: dict[str, Array] = {}
    text = ""
    for name in ("Transmission Front", "Transmission Back", "Reflection Front", "Reflection Back"):
        matrix = np.round(rng.random((5, 5)), 4)
        if not blocks:
            matrix[0, 0] = 0.125
        blocks[name.lower()] = matrix
        numbers = ",\n".join(", ".join(f"{x:g}" for x in row) for row in matrix)
        text += (
            "<WavelengthData><LayerNumber>System</LayerNumber>"
            '<Wavelength unit="Integral">Visible</Wavelength><WavelengthDataBlock>'
            f"<WavelengthDataDirection>{name}</WavelengthDataDirection>"
            "<ColumnAngleBasis>five</ColumnAngleBasis><RowAngleBasis>five</RowAngleBasis>"
            f"<ScatteringData>{numbers},</ScatteringData></WavelengthDataBlock></WavelengthData>\n"
        )
    path.write_text(
        '<?xml version="1.0"?>\n<WindowElement xmlns="http://windows.lbl.gov"><Optical><Layer>'
        "<Material><Name>blind</Name></Material><DataDefinition>"
        f"<IncidentDataStructure>Columns</IncidentDataStructure>{BASIS}</DataDefinition>"
        f"{text}</Layer></Optical></WindowElement>\n"
    )
    return blocks


def write_merl(path: pathlib.Path, material: Any) -> None:
    """Values of an isotropic material at the centres of MERL's bins; -1 below the horizon."""
    theta_h = 0.5 * np.pi * ((np.arange(90) + 0.5) / 90) ** 2
    theta_d = 0.5 * np.pi * (np.arange(90) + 0.5) / 90
    phi_d = np.pi * (np.arange(180) + 0.5) / 180
    th, td, pd = np.meshgrid(theta_h, theta_d, phi_d, indexing="ij")
    d = spherical(td, pd)
    c, s = np.cos(th), np.sin(th)

    def turned(v: Array) -> Array:  # the pole tilted to theta_h in the xz plane
        return np.stack([c * v[..., 0] + s * v[..., 2], v[..., 1],
                         c * v[..., 2] - s * v[..., 0]], axis=-1)  # fmt: skip

    wi, wo = turned(d), turned(d * np.array([-1.0, -1.0, 1.0]))
    up = (wi[..., 2] > 0.0) & (wo[..., 2] > 0.0)
    values = np.full((*up.shape, 3), -1.0)
    values[up] = material.eval(wi[up], wo[up]) * 1500.0 / np.array([1.0, 1.15, 1.66])
    path.write_bytes(
        struct.pack("<3i", 90, 90, 180) + np.moveaxis(values, -1, 0).astype("<f8").tobytes()
    )
