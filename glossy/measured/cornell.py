"""Cornell's gonioreflectometer text: irregular directions, spectra of (usually) 31 wavelengths.

``#`` starts a comment. Numbers in order: the count n of wavelengths, n wavelengths [nm], then rows
theta_i phi_i theta_o phi_o [rad] and the BRDF [1/sr] at each wavelength.

A spectrum becomes linear RGB as the colour of the reflectance under daylight D65::

    XYZ = sum_l f(l) D65(l) (x, y, z)(l),     RGB = M XYZ, scaled so that f = 1 gives (1, 1, 1) (1)

with the colour matching functions of CIE 1931 and the sRGB primaries. The sum runs over 400, 410,
..., 700 nm; a spectrum at other wavelengths is interpolated linearly, and its end values held.
Sources: CIE 015 (tables), IEC 61966-2-1 (M).
"""

import dataclasses
import pathlib

import numpy as np
import numpy.typing as npt

from .._files import check_words, read_text
from ..frames import spherical
from .solid_angle import solid_angles
from .table import HORIZON, MeasuredTable

Float64Array = npt.NDArray[np.float64]

MOST_WAVELENGTHS = 4096
MOST_CHARACTERS = 1 << 26

GRID = np.arange(400.0, 701.0, 10.0)  # nm
D65 = np.array([
    82.7549, 91.4860, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861, 115.923, 108.811,
    109.354, 107.802, 104.790, 107.689, 104.405, 104.046, 100.000, 96.3342, 95.7880, 88.6856,
    90.0062, 89.5991, 87.6987, 83.2886, 83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213,
    71.6091,
])  # fmt: skip
CIE_X = np.array([
    0.01431, 0.04351, 0.13438, 0.28390, 0.34828, 0.33620, 0.29080, 0.19536, 0.09564, 0.03201,
    0.00490, 0.00930, 0.06327, 0.16550, 0.29040, 0.43345, 0.59450, 0.76210, 0.91630, 1.02630,
    1.06220, 1.00260, 0.85445, 0.64240, 0.44790, 0.28350, 0.16490, 0.08740, 0.04677, 0.02270,
    0.01136,
])  # fmt: skip
CIE_Y = np.array([
    0.00040, 0.00121, 0.00400, 0.01160, 0.02300, 0.03800, 0.06000, 0.09098, 0.13902, 0.20802,
    0.32300, 0.50300, 0.71000, 0.86200, 0.95400, 0.99495, 0.99500, 0.95200, 0.87000, 0.75700,
    0.63100, 0.50300, 0.38100, 0.26500, 0.17500, 0.10700, 0.06100, 0.03200, 0.01700, 0.00821,
    0.00410,
])  # fmt: skip
CIE_Z = np.array([
    0.06785, 0.20740, 0.64560, 1.38560, 1.74706, 1.77211, 1.66920, 1.28764, 0.81295, 0.46518,
    0.27200, 0.15820, 0.07825, 0.04216, 0.02030, 0.00875, 0.00390, 0.00210, 0.00165, 0.00110,
    0.00080, 0.00034, 0.00019, 0.00005, 0.00002, 0.0, 0.0, 0.0, 0.0, 0.0,
    0.0,
])  # fmt: skip
XYZ_TO_RGB = np.array([
    [3.2404542, -1.5371385, -0.4985314],
    [-0.9692660, 1.8760108, 0.0415560],
    [0.0556434, -0.2040259, 1.0572252],
])  # fmt: skip


@dataclasses.dataclass(frozen=True, eq=False)
class Spectra:
    """The rows of a Cornell file as they are.

    ``wavelengths`` (n,) [nm]; ``angles`` (K, 4) theta_i phi_i theta_o phi_o [rad];
    ``values`` (K, n) BRDF [1/sr].
    """

    wavelengths: Float64Array
    angles: Float64Array
    values: Float64Array


def rgb_weights(wavelengths: npt.ArrayLike) -> Float64Array:
    """Matrix (3, n) from a spectrum at rising ``wavelengths`` (n,) [nm] to linear RGB, eq. (1)."""
    at = np.asarray(wavelengths, dtype=np.float64)
    hats = np.stack([np.interp(GRID, at, row) for row in np.eye(len(at))], axis=1)
    weights = XYZ_TO_RGB @ (np.stack([CIE_X, CIE_Y, CIE_Z]) * D65) @ hats
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def read_cornell_spectra(path: str | pathlib.Path) -> Spectra:
    """Read a Cornell text file without converting its spectra.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        For what is not a number, a wrong count of numbers, values that are not finite.
    """
    text = read_text(path)
    if len(text) > MOST_CHARACTERS:
        raise ValueError(f"{path}: has more than {MOST_CHARACTERS} characters")
    check_words(str(path), text)
    words = " ".join(line.split("#")[0] for line in text.splitlines()).split()
    try:
        numbers = np.array(words, dtype=np.float64)
    except ValueError as error:
        reason = " ".join(str(error).split())[:100]
        raise ValueError(f"{path}: holds what is not a number: {reason}") from None
    if not len(numbers):
        raise ValueError(f"{path}: has no numbers")
    if not np.isfinite(numbers).all():
        bad = int(np.flatnonzero(~np.isfinite(numbers))[0]) + 1
        raise ValueError(f"{path}: number {bad} of {len(numbers)} is not finite")
    n = int(numbers[0]) if 1.0 <= numbers[0] <= MOST_WAVELENGTHS else 0
    if n != numbers[0]:
        raise ValueError(f"{path}: must start with a count of wavelengths, got {numbers[0]:g}")
    rows, rest = divmod(len(numbers) - 1 - n, 4 + n)
    if rows < 1 or rest:
        raise ValueError(
            f"{path}: {len(numbers)} numbers are not {n} wavelengths and rows of {4 + n}"
        )
    wavelengths = numbers[1 : 1 + n]
    if np.any(np.diff(wavelengths) <= 0.0):
        raise ValueError(f"{path}: wavelengths must rise")
    table = numbers[1 + n :].reshape(rows, 4 + n)
    theta = table[:, [0, 2]]
    if theta.min() < -1e-9 or theta.max() > 0.5 * np.pi + 1e-6:
        worst = float(theta.flat[np.argmax(np.abs(theta - 0.25 * np.pi))])
        raise ValueError(f"{path}: polar angles must be from 0 to pi/2, got {worst:g}")
    return Spectra(wavelengths, table[:, :4], table[:, 4:])


def read_cornell(path: str | pathlib.Path) -> MeasuredTable:
    """Read a Cornell text file as an RGB table, eq. (1); see `read_cornell_spectra`.

    Colours outside the RGB gamut have negative values; they stay. The surfaces are isotropic.
    Weights are the shares of the hemisphere nearest to each outgoing direction.
    """
    spectra = read_cornell_spectra(path)
    theta_i, phi_i, theta_o, phi_o = spectra.angles.T
    wi, wo = spherical(theta_i, phi_i), spherical(theta_o, phi_o)
    f = spectra.values @ rgb_weights(spectra.wavelengths).T
    lit = wi[:, 2] > HORIZON
    if not lit.any():
        raise ValueError(f"{path}: all incident directions lie in the horizon")
    table = MeasuredTable(
        wi[lit],
        wo[lit],
        f[lit],
        name=pathlib.Path(path).stem,
        source=str(path),
        isotropic=True,
    )
    weight = solid_angles(table)
    return MeasuredTable(table.wi, table.wo, table.f, weight, table.name, table.source, True)
