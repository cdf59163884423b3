"""The ground truth against radiance integrated by other people's software.

``radiance_mitsuba.npz`` comes with the tests. The two files on real maps may not be
handed on: ``GLOSSY_CONFORMANCE`` names their folder where they are.
"""

import json
import os
import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import tolerances

import glossy
from glossy import CubeMap, Lobe, Material, SurfacePoints
from glossy.latlong import latlong_to_cube

Array = npt.NDArray[np.float64]

REAL = ("lebombo", "stpeters")
MATERIALS = ("iso0.15", "iso0.1", "aniso", "sharp0.02", "rough0.5", "fresnel", "alanod2")
MITSUBA = (
    "iso0.15",
    "iso0.10",
    "aniso",
    "mirror0.01",
    "rough0.5",
    "fresnel",
    "twolobe",
    "frosted",
)


def relative_rms(a: Array, b: Array) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2)))


def surface(data: Any) -> SurfacePoints:
    return SurfacePoints(data["normal"], data["tangent"], data["view"])


@pytest.fixture(scope="module")
def real() -> dict[str, tuple[Any, CubeMap]]:
    folder = os.environ.get("GLOSSY_CONFORMANCE")
    if not folder or not pathlib.Path(folder).is_dir():
        pytest.skip("radiance of the real maps is not here: set GLOSSY_CONFORMANCE to its folder")
    found = {name: np.load(pathlib.Path(folder) / f"radiance_{name}.npz") for name in REAL}
    return {name: (data, CubeMap(data["faces"])) for name, data in found.items()}


@pytest.fixture(scope="module")
def mitsuba(conformance: pathlib.Path) -> tuple[Any, CubeMap]:
    data = np.load(conformance / "radiance_mitsuba.npz")
    return data, CubeMap(latlong_to_cube(data["environment"], 512, orientation="mitsuba"))


def real_material(data: Any, name: str) -> Material:
    lobes = [Lobe(mx, my, ks, r0, alpha) for ks, mx, my, r0, alpha in data[f"{name}_lobes"]]
    return Material(float(data[f"{name}_kd"]), lobes)


def mitsuba_material(data: Any, name: str) -> Material:
    spec = json.loads(str(data["materials_json"]))[name]
    sides: dict[str, list[Lobe]] = {"r": [], "t": []}
    for row in spec["lobes"]:
        lobe = Lobe(row["mx"], row["my"], row["k"], row["r0"], row["alpha"])
        sides[row["kind"]].append(lobe)
    return Material(spec["kd"], sides["r"], sides["t"])


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("place", REAL)
def test_texels_on_real_maps(real: dict[str, tuple[Any, CubeMap]], place: str, name: str) -> None:
    data, cube = real[place]
    expected = data[f"{name}_radiance"]
    truth = glossy.reference(surface(data), real_material(data, name), cube)
    limit = tolerances.CONFORMANCE_SHARP if name == "sharp0.02" else tolerances.CONFORMANCE
    error = relative_rms(truth.radiance, expected)
    print(f"{place} {name}: relative RMS {error:.1e}")
    assert error <= limit
    slack = 3.0 * data[f"{name}_error"] + 1e-5 * expected
    assert np.all(np.abs(truth.radiance - expected) <= truth.error + slack)


@pytest.mark.parametrize("name", ["iso0.15", "sharp0.02", "rough0.5", "alanod2"])
@pytest.mark.parametrize("place", REAL)
@pytest.mark.parametrize("estimator", ["mc", "qmc"])
def test_z_scores_on_real_maps(
    real: dict[str, tuple[Any, CubeMap]], place: str, name: str, estimator: str
) -> None:
    data, cube = real[place]
    truth = glossy.reference(
        surface(data), real_material(data, name), cube, estimator, samples=8192, seed=1
    )
    z = (truth.radiance - data[f"{name}_radiance"]) / truth.error
    print(f"{place} {name} {estimator}: z rms {np.sqrt(np.mean(z**2)):.2f}")
    low, high = tolerances.Z_RMS[estimator]
    assert low < np.sqrt(np.mean(z**2)) < high
    assert np.abs(np.median(z)) < 0.5


@pytest.mark.parametrize("name", MITSUBA)
def test_texels_against_mitsuba(mitsuba: tuple[Any, CubeMap], name: str) -> None:
    data, cube = mitsuba
    expected = data[f"{name}_radiance"]
    truth = glossy.reference(surface(data), mitsuba_material(data, name), cube)
    error = relative_rms(truth.radiance, expected)
    print(f"mitsuba {name}: relative RMS {error:.1e}")
    assert error <= tolerances.CONFORMANCE_CONVERTED
