"""Readers of measured materials: what they say of good files, and of damaged ones."""

import os
import pathlib
import struct
from collections.abc import Callable
from typing import Any

import measured_files as files
import numpy as np
import numpy.typing as npt
import pytest
import scipy.spatial
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import glossy
from glossy import _memory
from glossy.frames import half_vector, spherical
from glossy.measured import klems, solid_angle
from glossy.measured.cornell import read_cornell_spectra, rgb_weights
from glossy.measured.klems import read_klems_data, standard_bases
from glossy.measured.merl import SCALE, SHAPE, evaluate_merl, read_merl_data
from glossy.measured.rgl import evaluate_rgl, read_rgl_data
from glossy.measured.solid_angle import solid_angles
from glossy.measured.tensor import read_tensors
from glossy.measured.warp import ALONE, FIRST, Warp, k_bilinear, k_invert, k_sample

Array = npt.NDArray[np.float64]

GRID_ROUNDOFF = 1e-9
"""float64 through square roots of differences of running sums."""

MAKERS: dict[str, Callable[[pathlib.Path], object]] = {
    ".brdf": files.write_cornell,
    ".bsdf": files.write_rgl,
    ".xml": files.write_klems,
    ".txt": lambda path: path.write_text("# name: a\n" + "30 0 30 180 .5\n30 0 60 180 .2\n" * 50),
}
"""Small files of each kind but MERL's, whose files have one size."""

TRILINEAR = 0.02
"""Bins of one degree (and of a hundredth near the mirror) on a lobe of m = 0.3: curvature."""

COUNTED = 0.05
"""Solid angles counted with 40 000 points: some 300 in each share."""


def sphere(k: int, seed: int) -> tuple[Array, Array]:
    """Pairs of random directions above the surface."""
    rng = np.random.default_rng(seed)
    z, phi = rng.uniform(0.05, 1.0, (2, k)), rng.uniform(0.0, 2.0 * np.pi, (2, k))
    return spherical(np.arccos(z), phi)  # type: ignore[return-value]  # two of them


# the warp ---------------------------------------------------------------------------------------


def test_the_warp_and_its_inverse_meet_and_the_density_is_the_bilinear_one() -> None:
    rng = np.random.default_rng(1)
    values = rng.random((2, 5, 7)) ** 3
    values[0, 2, 3:5] = 0.0
    warp = Warp.build(values)
    tables = (warp.values, warp.conditional, warp.marginal)
    blend = (0.3, 0.7, 0.0, 0.0)
    for u, v in rng.random((300, 2)):
        x, y, density = k_sample(*tables, u, v, (0, 1, 0, 0), blend)
        back = k_invert(*tables, x, y, (0, 1, 0, 0), blend)
        assert back[:2] == pytest.approx((u, v), abs=GRID_ROUNDOFF)
        expected = k_bilinear(warp.values, x, y, (0, 1, 0, 0), blend) * 4 * 6
        assert density == pytest.approx(expected, rel=GRID_ROUNDOFF)
        assert back[2] == pytest.approx(density, rel=GRID_ROUNDOFF)


def test_the_warp_integrates_to_one() -> None:
    """By the trapezoidal rule, exact for a bilinear function on its own nodes."""
    warp = Warp.build(np.random.default_rng(2).random((1, 6, 4)))
    n = np.array([[k_bilinear(warp.values, x / 3, y / 5, FIRST, ALONE) for x in range(4)]
                  for y in range(6)])  # fmt: skip
    assert np.trapezoid(np.trapezoid(n, axis=1), axis=0) == pytest.approx(1.0, abs=GRID_ROUNDOFF)
    with pytest.raises(ValueError, match="no mass"):
        Warp.build(np.zeros((1, 2, 2)))


# RGL --------------------------------------------------------------------------------------------


def test_rgl_agrees_with_another_programs_answers(real_data: pathlib.Path) -> None:
    """Single precision there: 1e-3 where f is above 1 % of its maximum, 1e-2 above 1e-4 of it."""
    folder = os.environ.get("GLOSSY_CONFORMANCE")
    answers = sorted(pathlib.Path(folder).glob("rgl_*.npz")) if folder else []
    if not answers:
        pytest.skip("answers of another program are not here: set GLOSSY_CONFORMANCE")
    assert len(answers) == 4
    for path in answers:
        data = read_rgl_data(real_data / "brdf" / f"{path.stem[4:]}_rgb.bsdf")
        with np.load(path) as answer:
            wi, wo, f = (answer[k].astype(np.float64) for k in ("wi", "wo", "f"))
        found = evaluate_rgl(data, *(v / np.linalg.norm(v, axis=1)[:, None] for v in (wi, wo)))
        error = np.abs(found - f) / np.maximum(np.abs(f), 1e-12)
        assert error[f > 0.01 * f.max()].max() < 1e-3
        assert error[f > 1e-4 * f.max()].max() < 1e-2


@pytest.mark.parametrize("turns", [0, 1, 2, 4])
def test_rgl_of_a_known_reflectance(tmp_path: pathlib.Path, turns: int) -> None:
    """With flat tables eq. (2) is closed: f = rgb ndf / (4 sigma cos theta_o)."""
    path = tmp_path / "flat.bsdf"
    files.write_rgl(path, turns=turns)
    data = read_rgl_data(path)
    assert (data.isotropic, data.description) == (turns == 0, "flat")
    wi, wo = sphere(200, 4)
    expected = np.array([0.1, 0.2, 0.3]) * 2.0 / (4.0 * 0.5) / wo[:, 2:]
    np.testing.assert_allclose(evaluate_rgl(data, wi, wo), expected, rtol=1e-6)
    assert not evaluate_rgl(data, wi * [1, 1, -1], wo).any()
    assert not evaluate_rgl(data, wi, wo * [1, 1, -1]).any()


@pytest.mark.parametrize("turns", [1, 2, 4])
def test_rgl_azimuths_are_followed_and_symmetry_supplies_the_rest(
    tmp_path: pathlib.Path, turns: int
) -> None:
    """The file's rgb is linear in |phi_i| over the stored range; the answer has its symmetry."""
    path = tmp_path / "azimuth.bsdf"
    files.write_rgl(path, turns=turns, slope=1.0)
    data = read_rgl_data(path)
    wi, wo = sphere(300, 5)
    phi = np.arctan2(wi[:, 1], wi[:, 0])
    if turns == 2:  # half a turn changes nothing
        phi = np.where(phi > 0.0, phi - np.pi, phi)
    if turns == 4:  # two mirrors; the stored quarter has x and y below zero
        phi = np.arctan2(np.abs(wi[:, 1]), np.abs(wi[:, 0])) - np.pi
    scale = (1.0 + phi + np.pi)[:, None]
    expected = scale * np.array([0.1, 0.2, 0.3]) * 2.0 / (4.0 * 0.5) / wo[:, 2:]
    np.testing.assert_allclose(evaluate_rgl(data, wi, wo), expected, rtol=1e-5)


def test_rgl_rows_have_the_solid_angle_of_the_hemisphere(tmp_path: pathlib.Path) -> None:
    """At normal incidence the half vectors up to 45 degrees reflect into the whole hemisphere."""
    path = tmp_path / "flat.bsdf"
    files.write_rgl(path, size=96)
    table = glossy.read_measured(path)
    found, rows = table.incident_directions()
    assert table.weight is not None
    assert table.isotropic
    assert found[0, 2] == pytest.approx(1.0)
    assert table.weight[rows[0]].sum() == pytest.approx(2.0 * np.pi, rel=COUNTED)
    np.testing.assert_allclose(table.f, np.array([0.1, 0.2, 0.3]) / table.wo[:, 2:], rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"drop": "vndf"}, "no field vndf"),
        ({"drop": "rgb", "extra": "spectra"}, "holds spectra"),
        ({"nan": "rgb"}, "rgb must hold finite"),
        ({"zero": "vndf"}, "vndf: a density has no mass"),
        ({"zero": "sigma"}, "sigma > 0"),
        ({"reverse": "theta_i"}, "must rise"),
        ({"cut": "ndf"}, "shapes of its fields"),
        ({"turns": 3}, "not a turn"),
    ],
)
def test_damaged_rgl(tmp_path: pathlib.Path, change: dict[str, Any], says: str) -> None:
    path = tmp_path / "bad.bsdf"
    files.write_rgl(path, **change)
    refuse(path, says)


def test_tensor_files_that_lie_about_their_size(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "bad.bsdf"
    head = b"tensor_file\0\x01\x00"
    field = struct.pack("<H3sHBQQ", 3, b"rgb", 1, 10, 0, 2**62)
    for data, says in (
        (b"tensor", "is not a tensor file"),
        (head, "cut short or damaged"),
        (b"tensor_file\0\x02\x00" + struct.pack("<I", 1), "version 2.0"),
        (head + struct.pack("<I", 2**32 - 1), "more than the limit"),
        (head + struct.pack("<I", 1) + field, "ends beyond it"),
        (head + struct.pack("<I", 1) + field[:-9], "cut short or damaged"),
        (head + struct.pack("<IH3sHBQ", 1, 3, b"rgb", 9999, 10, 0), "unknown shape"),
    ):
        path.write_bytes(data)
        refuse(path, says)


# Cornell ----------------------------------------------------------------------------------------


def test_a_flat_spectrum_is_grey_and_the_primaries_are_in_order() -> None:
    for at in (np.arange(400.0, 701.0, 10.0), np.linspace(390.0, 720.0, 12), np.array([550.0])):
        weights = rgb_weights(at)
        np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-12)
    weights = rgb_weights(np.arange(400.0, 701.0, 10.0))
    assert np.all(np.diff(np.argmax(weights, axis=1)) < 0)


def test_cornell_text(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "paint.brdf"
    rows = files.write_cornell(path)
    spectra = read_cornell_spectra(path)
    np.testing.assert_allclose(spectra.wavelengths, [400.0, 550.0, 700.0])
    np.testing.assert_allclose(spectra.angles, rows[:, :4])
    np.testing.assert_allclose(spectra.values, rows[:, 4:])
    table = glossy.read_measured(path)
    assert (table.isotropic, table.channels) == (True, ("R", "G", "B"))
    np.testing.assert_allclose(table.f, rows[:, 4:] @ rgb_weights(spectra.wavelengths).T)
    np.testing.assert_allclose(table.wo, spherical(rows[:, 2], rows[:, 3]), atol=1e-12)
    assert table.weight is not None
    assert table.weight.sum() == pytest.approx(2.0 * np.pi)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("# nothing\n", "has no numbers"),
        ("2 400 four", "not a number"),
        ("1 550 0 0 0 0 nan", "number 7 of 7 is not finite"),
        ("1e300 550 0 0 0 0 1", "count of wavelengths"),
        ("1.5 550 0 0 0 0 1", "count of wavelengths"),
        ("1 550 0 0 0 0", "rows of 5"),
        ("2 550 540 0 0 0 0 1 1", "must rise"),
        ("1 550 60 0 30 0 1", "polar angles"),
        ("1 550 0 0 0 0 " + "9" * 400, "number 7 of 7 is not finite"),
        ("9" * 400 + " 550 0 0 0 0 1", "number 1 of 7 is not finite"),
    ],
)
def test_damaged_cornell(tmp_path: pathlib.Path, text: str, says: str) -> None:
    path = tmp_path / "bad.brdf"
    path.write_text(text)
    refuse(path, says)


def test_cornell_counts_each_set_of_directions_once(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A query of the points is what takes the time."""
    asked = []
    tree: Any = scipy.spatial.cKDTree

    def counted(places: Any) -> Any:
        asked.append(len(places))
        return tree(places)

    monkeypatch.setattr("glossy.measured.solid_angle.cKDTree", counted)
    path = tmp_path / "grid.brdf"
    grid = [f"{t} 0 {o} {p} .5" for t in (0.1, 0.5, 0.9) for o in (0.2, 0.7) for p in (0, 1, 4)]
    path.write_text("1 550\n" + "\n".join(grid))
    weight = glossy.read_measured(path).weight
    assert weight is not None
    assert len(asked) == 1
    np.testing.assert_allclose(weight.reshape(3, 6).sum(axis=1), 2.0 * np.pi)
    monkeypatch.setattr(solid_angle, "MOST_SETS", 2)
    rows = [f"{t} 0 {t} 1 .5" for t in (0.1, 0.5, 0.9)]
    path.write_text("1 550\n" + "\n".join(rows))
    refuse(path, "at most 2 different sets of outgoing directions, got '3 incident")


@pytest.mark.parametrize("suffix", [".brdf", ".bsdf", ".xml", ".txt"])
def test_readers_ask_for_memory_before_they_take_it(
    tmp_path: pathlib.Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"large{suffix}"
    MAKERS[suffix](path)
    monkeypatch.setattr(_memory, "limit", lambda: 3000)
    refuse(path, "would take .* of memory, more than the limit")


def test_directions_that_nearly_meet_are_counted_before_they_are_listed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    theta = np.linspace(0.5, 0.5 + 9e-5, 40)
    wi = spherical(theta, np.zeros(40))
    table = glossy.MeasuredTable(wi, np.tile([[0.0, 0.0, 1.0]], (40, 1)), np.ones(40))
    assert len(table.incident_directions()[0]) == 1
    monkeypatch.setattr(_memory, "limit", lambda: 32)
    with pytest.raises(ValueError, match="wi: would take"):
        table.incident_directions()


def test_real_cornell_rows(real_data: pathlib.Path) -> None:
    """The counts and maxima that stand beside the files."""
    for name, top in (("cayman", 645.8), ("garnet_red", 38.37), ("krylon_blue", 66.52)):
        spectra = read_cornell_spectra(real_data / "brdf" / f"cornell_{name}.brdf")
        assert spectra.values.shape == (1439, 31)
        assert spectra.values.max() == pytest.approx(top, rel=1e-3)


# Klems ------------------------------------------------------------------------------------------


def test_klems_patches_blocks_and_directions(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "blind.xml"
    matrices = files.write_klems(path)
    data = read_klems_data(path)
    assert data.name == "blind"
    basis = data.incident["reflection front"]
    assert len(basis.theta) == 5
    assert basis.solid_angle.sum() == pytest.approx(2.0 * np.pi)
    assert basis.projected.sum() == pytest.approx(np.pi)
    table = glossy.read_measured(path)
    assert len(table) == 4 * 25
    for name, (side_i, side_o) in (
        ("transmission front", (1, -1)),
        ("transmission back", (-1, 1)),
        ("reflection front", (1, 1)),
        ("reflection back", (-1, -1)),
    ):
        np.testing.assert_allclose(data.blocks[name], matrices[name])
        pick = (table.wi[:, 2] * side_i > 0) & (table.wo[:, 2] * side_o > 0)
        block = table.select(pick)
        np.testing.assert_allclose(block.f[:, 0], matrices[name].T.reshape(-1))
        diagonal = block.select(np.eye(5, dtype=bool).reshape(-1))
        straight = diagonal.wi * ([-1, -1, 1] if side_i == side_o else [-1, -1, -1])
        np.testing.assert_allclose(diagonal.wo, straight, atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("<WindowElement", "<!DOCTYPE x><WindowElement", "entities"),
        ("</WindowElement>", "", "is not XML"),
        ("<nPhis>4", "<nPhis>" + "9" * 400, "nphis must be a number"),
        ("0.125", "9" * 400, "not finite"),
        ("WindowElement", "Window", "is not a BSDF file"),
        ("Columns", "TensorTree4", "not a Klems matrix"),
        ("<nPhis>4", "<nPhis>4.5", "whole number"),
        ("<nPhis>4", "<nPhis>-4", "a ring of -4"),
        ("<nPhis>4", "<nPhis>1e9", "a ring of 1e"),
        ("<LowerTheta>0", "<LowerTheta>x", "lowertheta must be a number"),
        ("Transmission Front", "Sideways", "unknown direction"),
        ("0.125", "0.125 0.125", "26 numbers, not 5 x 5"),
        ("0.125", "nan", "not finite"),
        ("0.125", "dark", "not a number"),
        ("<RowAngleBasis>five", "<RowAngleBasis>six", "no angle basis 'six'"),
        ("Visible", "Solar", "no matrix of visible light"),
    ],
)
def test_damaged_klems(tmp_path: pathlib.Path, old: str, new: str, says: str) -> None:
    path = tmp_path / "bad.xml"
    files.write_klems(path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, -1 if old in ("WindowElement", "Visible") else 1))
    refuse(path, says)


def plain_klems(path: pathlib.Path, rows: str, columns: str, count: int, define: str = "") -> None:
    """A file of one block that names bases."""
    numbers = ",".join(str(k % 7) for k in range(count))
    path.write_text(
        "<WindowElement><IncidentDataStructure>Columns</IncidentDataStructure>"
        f"{define}<WavelengthData><Wavelength>Visible</Wavelength><WavelengthDataBlock>"
        "<WavelengthDataDirection>Reflection Front</WavelengthDataDirection>"
        f"<ColumnAngleBasis>{columns}</ColumnAngleBasis><RowAngleBasis>{rows}</RowAngleBasis>"
        f"<ScatteringData>{numbers}</ScatteringData></WavelengthDataBlock></WavelengthData>"
        "</WindowElement>"
    )


@pytest.mark.parametrize(
    ("name", "patches", "last"),
    [
        ("LBNL/Klems Full", 145, 82.5),
        ("LBNL/Klems Half", 77, 80.75),
        ("LBNL/Klems Half", 73, 83.25),
        ("LBNL/Klems Quarter", 41, 76.5),
        ("klems quarter", 41, 76.5),
    ],
)
def test_klems_bases_that_a_file_only_names(
    tmp_path: pathlib.Path, name: str, patches: int, last: float
) -> None:
    path = tmp_path / "named.xml"
    only_named = f"<AngleBasis><AngleBasisName>{name}</AngleBasisName></AngleBasis>"
    for define in ("", only_named):
        plain_klems(path, name, name, patches**2, define)
        data = read_klems_data(path)
        basis = data.outgoing["reflection front"]
        assert data.blocks["reflection front"].shape == (patches, patches)
        assert basis.projected.sum() == pytest.approx(np.pi)
        assert basis.solid_angle.sum() == pytest.approx(2.0 * np.pi)
        assert np.degrees(basis.theta[-1]) == pytest.approx(last)
        np.testing.assert_array_equal(basis.low[1:] <= basis.theta[1:], True)
        np.testing.assert_array_equal(np.diff(np.unique(basis.high)) > 0.0, True)
    assert len(glossy.read_measured(path)) == patches**2


def test_klems_axes_of_two_bases_and_numbers_that_fit_none(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "named.xml"
    plain_klems(path, "LBNL/Klems Quarter", "LBNL/Klems Half", 41 * 73)
    assert read_klems_data(path).blocks["reflection front"].shape == (41, 73)
    plain_klems(path, "LBNL/Klems Half", "LBNL/Klems Half", 75**2)
    refuse(path, "5625 numbers, not 77 x 77 or 73 x 73")
    plain_klems(path, "LBNL/Klems Third", "LBNL/Klems Half", 9)
    refuse(path, "no angle basis 'LBNL/Klems Third'")
    plain_klems(path, "LBNL/Klems Quarter", "LBNL/Klems Quarter", 25, files.BASIS.replace(
        "five", "LBNL/Klems Quarter"))  # fmt: skip  # the file's own definition counts
    assert read_klems_data(path).blocks["reflection front"].shape == (5, 5)


def test_the_defined_basis_of_a_real_file_is_the_standard_one(real_data: pathlib.Path) -> None:
    data = read_klems_data(real_data / "brdf" / "lbnl_mecho_6216_klems_aniso.xml")
    (own,), theirs = standard_bases("LBNL/Klems Full"), data.incident["transmission front"]
    for name in ("theta", "phi", "low", "high", "count"):
        np.testing.assert_array_equal(getattr(own, name), getattr(theirs, name))


def test_klems_elements_within_each_other_take_linear_work(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "deep.xml"
    path.write_text("<WindowElement>" + "<AngleBasis>" * 50_000)
    refuse(path, "more than 16 deep")
    seen, tag = 0, klems._tag

    def counted(element: Any) -> str:
        nonlocal seen
        seen += 1
        return tag(element)

    monkeypatch.setattr(klems, "_tag", counted)
    work = []
    for n in (200, 400):
        inner = "<AngleBasis><AngleBasisBlock>" * 6 + "<x/>" * n
        inner += "</AngleBasisBlock></AngleBasis>" * 6
        plain_klems(path, "LBNL/Klems Quarter", "LBNL/Klems Quarter", 4, inner)
        seen = 0
        refuse(path, "theta must be a number")
        work.append(seen)
    assert work[1] < 2.5 * work[0]


def test_real_klems_transmits_straight_through(real_data: pathlib.Path) -> None:
    data = read_klems_data(real_data / "brdf" / "lbnl_mecho_6216_klems_aniso.xml")
    assert {m.shape for m in data.blocks.values()} == {(145, 145)}
    middle = slice(25, 93)  # 30 to 60 degrees
    found = np.argmax(data.blocks["transmission front"], axis=0)[middle]
    assert np.mean(found == np.arange(145)[middle]) > 0.9


# MERL -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def merl_file(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """A file of the size of the real ones, from a known material."""
    path = tmp_path_factory.mktemp("merl") / "known.binary"
    files.write_merl(path, LOBE)
    return path


LOBE = glossy.Material(kd=[0.1, 0.2, 0.3], reflection=[glossy.Lobe(0.3, 0.3, ks=0.5, r0=0.3)])


def test_merl_of_a_known_material(merl_file: pathlib.Path) -> None:
    values = read_merl_data(merl_file)
    wi, wo = sphere(4000, 6)
    h = half_vector(wi, wo)
    wo[:400] = 2.0 * np.einsum("ij,ij->i", wi, h)[:400, None] * h[:400] - wi[:400]
    found, expected = evaluate_merl(values, wi, wo), LOBE.eval(wi, wo)
    # the last bins of theta_d and theta_h reach beyond what was tabulated
    inside = np.minimum(wi[:, 2], wo[:, 2]) > 0.1
    np.testing.assert_allclose(found[inside], expected[inside], rtol=TRILINEAR)
    np.testing.assert_allclose(evaluate_merl(values, wo, wi), found, rtol=1e-9)
    assert not evaluate_merl(values, wi * [1, 1, -1], wo).any()


def test_merl_table(merl_file: pathlib.Path) -> None:
    table = glossy.read_measured(merl_file)
    found, rows = table.incident_directions()
    assert (len(found), table.isotropic, table.name) == (17, True, "known")
    assert table.weight is not None
    for direction, own in list(zip(found, rows, strict=True))[::4]:
        reflected = (table.weight[own, None] * table.transfer[own]).sum(axis=0)
        np.testing.assert_allclose(reflected, LOBE.albedo(direction)[0], rtol=COUNTED)


def test_merl_bins_that_were_not_measured_count_as_zero() -> None:
    values = np.full((3, *SHAPE), -1.0)
    assert not evaluate_merl(values, *sphere(10, 1)).any()
    assert SCALE[0] == pytest.approx(1.0 / 1500.0)


def test_damaged_merl(tmp_path: pathlib.Path, merl_file: pathlib.Path) -> None:
    path = tmp_path / "bad.binary"
    data = bytearray(merl_file.read_bytes())
    for change, says in (
        (data[:7], "7 bytes, not 90 x 90 x 180"),
        (struct.pack("<3i", 2**31 - 1, 2**31 - 1, 2**31 - 1), "2147483647 x"),
        (data[:-8], "not the 34992012 of a MERL file"),
        (data + b"\0", "not the 34992012"),
        (data[:12] + struct.pack("<d", np.nan) + data[20:], "holds 1 NaN"),
    ):
        path.write_bytes(change)
        refuse(path, says)


# all of them ------------------------------------------------------------------------------------


def refuse(path: pathlib.Path, says: str) -> None:
    """A refusal is one line that starts with the file's name."""
    with pytest.raises(ValueError, match=says) as error:
        glossy.read_measured(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 500 + len(str(path))


@pytest.mark.parametrize("suffix", [".brdf", ".bsdf", ".xml", ".binary", ".txt"])
def test_empty_and_binary_noise(tmp_path: pathlib.Path, suffix: str) -> None:
    path = tmp_path / f"noise{suffix}"
    path.write_bytes(b"")
    refuse(path, "is empty")
    path.write_bytes(np.random.default_rng(0).bytes(5000))
    refuse(path, "noise")


def test_solid_angles_of_a_grid() -> None:
    """Rings of equal solid angle: every point has the same share."""
    z = (np.arange(6) + 0.5) / 6
    wo = spherical(*np.meshgrid(np.arccos(z), 2.0 * np.pi * np.arange(12) / 12)).reshape(-1, 3)
    wi = np.tile([[0.0, 0.0, 1.0]], (len(wo), 1))
    table = glossy.MeasuredTable(
        np.tile(wi, (2, 1)), np.tile(wo, (2, 1)), np.ones((2 * len(wo), 1))
    )
    weight = solid_angles(table)
    assert weight.sum() == pytest.approx(2.0 * np.pi)
    np.testing.assert_allclose(weight[: len(wo)], weight[len(wo) :])
    rings = weight.reshape(2, 12, 6)
    np.testing.assert_allclose(rings, np.pi / 72, rtol=0.35)  # nearest points are not the rings


# any file ---------------------------------------------------------------------------------------

SAME_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
"""Each example writes its file anew."""


@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 3]), st.booleans())
@SAME_FOLDER
def test_any_table_survives_its_text(
    tmp_path: pathlib.Path, seed: int, channels: int, weighed: bool
) -> None:
    """Twelve digits of angles and of f |cos|."""
    draw = np.random.default_rng(seed)
    v = draw.normal(size=(2, 8, 3))
    v[..., 2] += np.where(v[..., 2] < 0.0, -0.1, 0.1)
    wi, wo = v / np.linalg.norm(v, axis=-1, keepdims=True)
    f = draw.normal(size=(8, channels))
    weight = draw.random(8) if weighed else None
    table = glossy.MeasuredTable(wi, wo, f, weight, name="some name", isotropic=bool(seed % 2))
    table.write(tmp_path / "t.txt")
    found = glossy.read_measured(tmp_path / "t.txt")
    np.testing.assert_allclose(found.wi, wi, atol=1e-11)
    np.testing.assert_allclose(found.wo, wo, atol=1e-11)
    np.testing.assert_allclose(found.f, f, rtol=1e-9, atol=1e-9)
    assert (found.name, found.isotropic) == ("some name", table.isotropic)
    assert (found.weight is None) == (weight is None)
    if weight is not None and found.weight is not None:
        np.testing.assert_allclose(found.weight, weight, rtol=1e-11)


@given(st.integers(0, 2**32 - 1), st.lists(st.integers(0, 4), max_size=4), st.booleans())
@SAME_FOLDER
def test_tensors_of_any_shape(
    tmp_path: pathlib.Path, seed: int, shape: list[int], whole: bool
) -> None:
    values = np.random.default_rng(seed).random(shape).astype(np.float32)
    fields: dict[str, npt.NDArray[Any]] = {"a": values}
    if whole:
        fields["b"] = (255 * values).astype(np.uint8)
    files.write_tensors(tmp_path / "t.bsdf", fields)
    found = read_tensors(tmp_path / "t.bsdf")
    assert set(found) == set(fields)
    for name, value in fields.items():
        np.testing.assert_array_equal(found[name], value)


@given(st.integers(0, 2**32 - 1), st.sampled_from([".brdf", ".bsdf", ".xml", ".txt"]))
@SAME_FOLDER
def test_a_damaged_file_is_read_or_refused_on_one_line(
    tmp_path: pathlib.Path, seed: int, suffix: str
) -> None:
    """Bytes changed, cut out and repeated; words replaced by what numbers may not be."""
    draw = np.random.default_rng(seed)
    path = tmp_path / f"damaged{suffix}"
    MAKERS[suffix](path)
    data = bytearray(path.read_bytes())
    for _ in range(draw.integers(1, 5)):
        at, n = int(draw.integers(0, max(len(data), 1))), int(draw.integers(1, 30))
        kind = draw.integers(0, 4)
        if kind == 0:
            data[at : at + 1] = draw.bytes(1)
        elif kind == 1:
            del data[at : at + n]
        elif kind == 2:
            data[at:at] = data[at : at + n]
        else:
            data[at : at + n] = [b"nan", b"1e999", b"-1", b"9" * 400][draw.integers(0, 4)]
    path.write_bytes(data)
    said = ""
    try:
        finite = bool(np.isfinite(glossy.read_measured(path).f).all())
    except ValueError as error:
        said, finite = str(error), True
    assert finite
    assert not said or said.startswith(str(path))
    assert "\n" not in said
    assert len(said) < 500 + len(str(path))
