"""Measured materials as they are used: between their rows, sampled, integrated, rendered."""

import json
import pathlib
from typing import Any

import chi2
import measured_files as files
import numpy as np
import numpy.typing as npt
import pytest
from scipy.interpolate import RegularGridInterpolator

import glossy
from glossy import cli
from glossy.frames import half_vector, reflect, spherical
from glossy.measured.disc import build_disc, from_disc, to_disc
from glossy.measured.interpolate import TableFunction
from glossy.measured.material import MeasuredMaterial

Array = npt.NDArray[np.float64]

ROUNDOFF = 1e-9
"""float64 through half a dozen trigonometric functions and back; angles of a grid to 1e-5 rad."""

ANGLES = 1e-4
"""Angles of a grid are merged at 1e-5 rad; times slopes of a few per radian."""

CELLS = 2e-3
"""128 x 64 cells of half vectors: what a smooth function leaves of the midpoint rule."""

STEPS = 5e-3
"""A piecewise constant density, integrated by Gauss-Legendre over bins that its steps cut."""

ALPHA = 1e-3
"""One false alarm in a thousand families of goodness-of-fit tests; the seeds are fixed."""


def pairs(k: int, seed: int, lowest: float = 0.05) -> tuple[Array, Array]:
    """Random directions above the surface, (k, 3) twice."""
    rng = np.random.default_rng(seed)
    z, phi = rng.uniform(lowest, 1.0, (2, k)), rng.uniform(0.0, 2.0 * np.pi, (2, k))
    wi, wo = spherical(np.arccos(z), phi)
    return wi, wo


def grid_table(
    material: Any,
    theta_i: Array,
    phi_i: Array,
    theta_o: Array,
    phi_o: Array,
    isotropic: bool = False,
) -> glossy.MeasuredTable:
    """A full grid of angles [deg] of a material with ``eval``."""
    a = np.meshgrid(*(np.radians(x) for x in (theta_i, phi_i, theta_o, phi_o)), indexing="ij")
    wi, wo = spherical(a[0], a[1]).reshape(-1, 3), spherical(a[2], a[3]).reshape(-1, 3)
    return glossy.MeasuredTable(wi, wo, material.eval(wi, wo), isotropic=isotropic)


LOBE = glossy.Material(kd=0.3, reflection=[glossy.Lobe(0.3, 0.15, ks=0.4)])
ISOTROPIC = glossy.Material(kd=[0.3, 0.2, 0.1], reflection=[glossy.Lobe(0.25, 0.25, ks=0.4)])


def exact_values(wi: Array, wo: Array) -> Array:
    """The isotropic material as a function of directions alone."""
    return np.asarray(ISOTROPIC.eval(wi, wo), dtype=np.float64)


T_I, P_I = np.array([0.0, 20.0, 45.0, 70.0]), np.arange(0.0, 360.0, 45.0)
T_O, P_O = np.arange(0.0, 90.0, 10.0), np.arange(0.0, 360.0, 15.0)


# between rows -----------------------------------------------------------------------------------


def test_disc_map_keeps_areas_and_returns() -> None:
    w, _ = pairs(500, 1)
    np.testing.assert_allclose(from_disc(to_disc(w)), w, atol=1e-12)
    step = 1e-6
    sides = [
        to_disc(spherical(0.7 + a * step, 1.1 + b * step)) for a, b in ((0, 0), (1, 0), (0, 1))
    ]
    area = np.linalg.det(np.stack([sides[1] - sides[0], sides[2] - sides[0]])) / step**2
    assert area == pytest.approx(np.sin(0.7), rel=1e-5)  # second order in the step


def test_linear_on_a_grid_is_the_quadrilinear_interpolation() -> None:
    """Against SciPy's, over the four angles with azimuths continued past the turn."""
    table = grid_table(LOBE, T_I, P_I, T_O, P_O)
    angles = np.meshgrid(*(np.radians(a) for a in (T_I, P_I, T_O, P_O)), indexing="ij")
    values = LOBE.eval(spherical(angles[0], angles[1]), spherical(angles[2], angles[3]))
    values[0] = values[0, :1]  # at normal incidence all azimuths are one direction
    values = np.concatenate([values, values[:, :1]], axis=1)
    values = np.concatenate([values, values[..., :1]], axis=3)
    axes = (T_I, np.append(P_I, 360.0), T_O, np.append(P_O, 360.0))
    reference = RegularGridInterpolator([np.radians(a) for a in axes], values)
    wi, wo = pairs(3000, 2, lowest=0.35)
    queries = []
    for w in (wi, wo):
        queries += [np.arccos(w[:, 2]), np.arctan2(w[:, 1], w[:, 0]) % (2.0 * np.pi)]
    expected = reference(np.stack(queries, axis=1))
    found = TableFunction(table, "linear", "f", "none")(wi, wo)[:, 0]
    np.testing.assert_allclose(found, expected, atol=ANGLES)


@pytest.mark.parametrize("interpolation", ["linear", "half-vector"])
@pytest.mark.parametrize("scattered", [False, True])
def test_rows_are_met_and_a_constant_stays_one(interpolation: str, scattered: bool) -> None:
    table = grid_table(ISOTROPIC, T_I, np.zeros(1), T_O, P_O, isotropic=True)
    if scattered:
        table = table.select(np.random.default_rng(3).random(len(table)) < 0.7)
    function = TableFunction(table, interpolation)
    assert function.symmetry == "isotropic"
    # at normal incidence an isotropic table averages what it holds for all azimuths
    rows = table.wi[:, 2] < 0.99
    found = function(table.wi[rows], table.wo[rows])
    np.testing.assert_allclose(found, table.f[rows], atol=ANGLES)
    flat = glossy.MeasuredTable(table.wi, table.wo, np.full((len(table), 1), 0.25), isotropic=True)
    wi, wo = pairs(2000, 4, lowest=0.0)
    np.testing.assert_allclose(TableFunction(flat, interpolation, "f")(wi, wo), 0.25, rtol=ROUNDOFF)


def test_half_vector_alignment_moves_the_lobe_and_blending_does_not() -> None:
    """A function of the half vector alone, half way between incident angles 25 degrees apart."""

    class Peak:
        def eval(self, wi: Array, wo: Array) -> Array:
            h = half_vector(wi, wo)
            return np.asarray(np.exp(-((h[..., 0] ** 2 + h[..., 1] ** 2) / 0.02)))

    wi = np.tile(spherical(np.radians(32.5), 0.0), (400, 1))
    wo = reflect(wi, spherical(np.radians(np.linspace(0.0, 8.0, 400)), 0.7))
    truth = Peak().eval(wi, wo)
    table = grid_table(Peak(), np.array([20.0, 45.0]), np.zeros(1), np.arange(0.0, 90.0, 2.0),
                       np.arange(0.0, 360.0, 4.0), isotropic=True)  # fmt: skip
    error = {
        name: np.abs(TableFunction(table, name, "f")(wi, wo)[:, 0] - truth).max()
        for name in ("linear", "half-vector")
    }
    assert error["half-vector"] < 0.02  # the grid of 2 by 4 degrees, on a peak of 1
    assert error["linear"] > 0.4


def test_symmetries_supply_azimuths() -> None:
    quarter = grid_table(LOBE, T_I, np.arange(0.0, 91.0, 45.0), T_O, P_O)
    half = grid_table(LOBE, T_I, np.arange(0.0, 181.0, 45.0), T_O, P_O)
    turn = grid_table(LOBE, T_I, P_I, T_O, P_O)
    functions = [TableFunction(t, "linear") for t in (quarter, half, turn)]
    assert [f.symmetry for f in functions] == ["quadrant", "mirror", "none"]
    wi, wo = pairs(500, 5)
    values = [f(wi, wo) for f in functions]
    np.testing.assert_allclose(values[0], values[2], atol=ANGLES)
    np.testing.assert_allclose(values[1], values[2], atol=ANGLES)
    with pytest.raises(ValueError, match="symmetry: must be one of"):
        TableFunction(turn, symmetry="round")


def test_sides_of_the_surface(tmp_path: pathlib.Path) -> None:
    """Each block of a Klems file answers for its sides; one-sided passing light is reciprocal."""
    path = tmp_path / "blind.xml"
    matrices = files.write_klems(path)
    table = glossy.read_measured(path)
    function = TableFunction(table, "linear", symmetry="none")
    for (si, so), name in (
        ((1, 1), "reflection front"),
        ((1, -1), "transmission front"),
        ((-1, 1), "transmission back"),
        ((-1, -1), "reflection back"),
    ):
        wi, wo = np.array([[0.0, 0.0, si]]), np.array([[0.0, 0.0, so]])
        assert function(wi, wo)[0, 0] == pytest.approx(matrices[name][0, 0])
    front = TableFunction(table.select(table.wi[:, 2] > 0.0), symmetry="none")
    wi, wo = pairs(50, 6)
    below = wo * [1, 1, -1]
    np.testing.assert_allclose(front(below, wi), front(wi, below))
    assert not front(wi * [1, 1, -1], below).any()


def test_quantities_agree_on_the_rows_and_differ_between() -> None:
    table = grid_table(ISOTROPIC, T_I, np.zeros(1), T_O, P_O, isotropic=True)
    rows = (table.wi[:, 2] < 0.99) & (table.wo[:, 2] > 0.1)
    wi, wo = pairs(100, 7)
    between = []
    for quantity in ("f", "p", "root"):
        function = TableFunction(table, quantity=quantity)
        found = function(table.wi[rows], table.wo[rows])
        np.testing.assert_allclose(found, table.f[rows], atol=1e-3)
        between.append(function(wi, wo))
    assert min(np.abs(between[a] - between[b]).max() for a, b in ((0, 1), (1, 2), (2, 0))) > 1e-3


def test_beyond_the_measured_angles_the_value_stays() -> None:
    t_i, t_o = np.array([0.0, 40.0]), np.arange(0.0, 71.0, 10.0)
    table = grid_table(ISOTROPIC, t_i, np.zeros(1), t_o, P_O, isotropic=True)
    last, grazing = spherical(np.radians([[40.0], [89.9]]), np.zeros(1))
    low, lower = spherical(np.radians([[70.0], [89.99]]), np.full(1, 2.0))
    for quantity in ("f", "p", "root"):
        function = TableFunction(table, "linear", quantity)
        expected = function(last, low)
        np.testing.assert_allclose(function(grazing, low), expected, rtol=1e-6)
        np.testing.assert_allclose(function(last, lower), expected, rtol=1e-6)


def test_directions_measured_twice_are_averaged() -> None:
    wo = np.repeat(pairs(40, 8)[0], 2, axis=0)
    disc = build_disc(wo, np.arange(80.0)[:, None])
    inside = disc.values[:40, 0]
    np.testing.assert_allclose(np.sort(inside), np.arange(40) * 2 + 0.5)


# sampling ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sided(tmp_path_factory: pytest.TempPathFactory) -> MeasuredMaterial:
    """Anisotropic, reflecting and passing light on both sides."""
    path = tmp_path_factory.mktemp("klems") / "blind.xml"
    files.write_klems(path)
    return glossy.measured_material(path)


@pytest.fixture(scope="module")
def painted() -> MeasuredMaterial:
    """Isotropic with a lobe, colours."""
    t_i, t_o, p_o = (
        np.arange(0.0, 86.0, 15.0),
        np.arange(0.0, 90.0, 4.0),
        np.arange(0.0, 360.0, 6.0),
    )
    return MeasuredMaterial(grid_table(ISOTROPIC, t_i, np.zeros(1), t_o, p_o, isotropic=True))


def test_samples_follow_their_density(sided: MeasuredMaterial, painted: MeasuredMaterial) -> None:
    views = [spherical(np.radians(t), p) for t, p in ((0.0, 0.0), (35.0, 1.0), (80.0, 4.0))]
    cases = [(m, v) for m in (sided, painted) for v in views]
    cases += [(sided, views[1] * [1, 1, -1])]
    rng = np.random.default_rng(9)
    for material, wo in cases:
        xi = rng.random((20_000, 2))
        many = np.broadcast_to(wo, (len(xi), 3))
        pole = reflect(wo, [0.0, 0.0, 1.0])
        found = chi2.counts(material.sample(xi, many), pole, 0.3)
        density = chi2.expected(lambda w, m=material, v=wo: m.pdf(w, v), pole, 0.3)  # type: ignore[misc]
        assert density.sum() == pytest.approx(1.0, abs=STEPS)
        assert chi2.p_value(found, density) > chi2.sidak(ALPHA, len(cases))


def test_the_weights_of_samples_are_bounded(painted: MeasuredMaterial) -> None:
    """A tenth of the draws follow the cosine, so f cos / pdf stays below what it integrates to."""
    rng = np.random.default_rng(10)
    for t in (10.0, 60.0, 85.0):
        wo = np.broadcast_to(spherical(np.radians(t), 1.0), (5000, 3))
        wi = painted.sample(rng.random((5000, 2)), wo)
        weight = painted.eval(wi, wo)[:, 1] * np.abs(wi[:, 2]) / painted.pdf(wi, wo)
        assert weight.std() < 0.5 * weight.mean()


def test_albedo(sided: MeasuredMaterial, painted: MeasuredMaterial) -> None:
    flat = MeasuredMaterial(painted.table, function=lambda wi, wo: np.ones((len(wi), 3)) / np.pi)
    wo = spherical(np.radians([0.0, 30.0, 60.0, 85.0]), 0.5)
    np.testing.assert_allclose(flat.albedo(wo)[0], 1.0, atol=CELLS)
    assert not painted.albedo(wo)[1].any()
    exact = MeasuredMaterial(painted.table, function=exact_values)
    np.testing.assert_allclose(exact.albedo(wo)[0], ISOTROPIC.albedo(wo)[0], atol=CELLS)
    assert exact.albedo(wo[0])[0].shape == (3,)
    # by Monte Carlo with the material's own sampling, light and view exchanged in the function
    rng = np.random.default_rng(11)
    for v in (wo[1], wo[1] * [1, 1, -1]):
        r, t = sided.albedo(v)
        many = np.broadcast_to(v, (40_000, 3))
        w = sided.sample(rng.random((40_000, 2)), many)
        value = sided.eval(many, w) * np.abs(w[:, 2]) / sided.pdf(w, many)
        same = w[:, 2] * v[2] > 0.0
        for found, share in ((r, np.where(same, value, 0.0)), (t, np.where(same, 0.0, value))):
            standard = share.std() / np.sqrt(len(share))
            assert abs(found - share.mean()) < 4.0 * standard + CELLS


def test_refusals(painted: MeasuredMaterial) -> None:
    up = np.array([0.0, 0.0, 1.0])
    with pytest.raises(ValueError, match="table: must be a MeasuredTable"):
        MeasuredMaterial(painted)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="interpolation: must be one of"):
        MeasuredMaterial(painted.table, interpolation="cubic")
    with pytest.raises(ValueError, match="quantity: must be one of"):
        MeasuredMaterial(painted.table, quantity="q")
    with pytest.raises(ValueError, match="xi: must have shape"):
        painted.sample([0.5, 1.5], up)
    with pytest.raises(ValueError, match="wo: must be unit"):
        painted.eval(up, 2.0 * up)


# the ground truth -------------------------------------------------------------------------------


def test_the_truth_of_a_function_is_that_of_the_material_it_comes_from() -> None:
    """Exact evaluation, tables for sampling only: within the errors of both estimators."""
    table = grid_table(ISOTROPIC, T_I, np.zeros(1), T_O, P_O, isotropic=True)
    measured = MeasuredMaterial(table, function=exact_values)
    cube = glossy.environment("studio", size=16)
    rng = np.random.default_rng(12)
    normal = rng.normal(size=(6, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    view = normal + 0.5 * rng.normal(size=(6, 3))
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    view *= np.where(np.sum(view * normal, axis=1) > 0.0, 1.0, -1.0)[:, None]
    points = glossy.SurfacePoints(normal, view=view)
    exact = glossy.reference(points, ISOTROPIC, cube)
    for estimator in ("mc", "qmc"):
        found = glossy.reference(points, measured, cube, estimator, samples=4096)
        z = (found.radiance - exact.radiance) / (found.error + exact.error)
        assert np.abs(z).max() < 5.0
        assert found.error.max() < 0.05 * exact.radiance.max()


def test_command(tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "foil.txt", tmp_path / "out.exr"
    grid_table(ISOTROPIC, T_I, np.zeros(1), T_O, P_O, isotropic=True).write(path)
    size = ["--width", "12", "--height", "12", "--env", "white", "--size", "8"]
    common = [*size, "--material", str(path), "-o", str(out)]
    assert cli.main(["reference", *common, "--samples", "256", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["estimator"] == "qmc"
    image = glossy.read_image(out)
    centre = image.pixels[6, 6, [image.channels.index(c) for c in "RGB"]]
    material = glossy.measured_material(path)
    expected = material.albedo(np.array([0.0, 0.0, 1.0]))[0]
    np.testing.assert_allclose(centre, expected, rtol=0.05)  # 256 samples, and a grid of 10 degrees
    assert cli.main(["render", *common]) == 2
    assert "is measured: the ground truth takes it" in capsys.readouterr().err
