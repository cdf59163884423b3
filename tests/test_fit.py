"""Kurt lobes fitted to synthetic tables: metrics, grid search, recovery, options, refusals."""

import dataclasses

import numba
import numpy as np
import numpy.typing as npt
import pytest
import tolerances

import glossy
from glossy.energy import energy
from glossy.measured import fit_grid, fit_metrics, fit_polish, fit_rows, fit_space
from glossy.measured.fit import Fit, fit_table
from glossy.measured.synthetic import synthetic_table
from glossy.measured.table import MeasuredTable

FAST = {"grid": 5, "levels": 3, "rounds": 1}
METAL = glossy.Material(0.02, [glossy.Lobe(0.2, 0.1, ks=0.8, r0=0.7, alpha=0.3)])
TWO = glossy.Material(
    0.05,
    [glossy.Lobe(0.1, 0.06, ks=0.5, r0=0.8, alpha=0.4), glossy.Lobe(0.4, 0.3, ks=0.4, r0=0.5)],
)
FROSTED = glossy.Material(
    0.3,
    [glossy.Lobe(0.2, ks=0.5, r0=0.3)],
    [glossy.Lobe(0.3, ks=0.6, r0=0.0, alpha=0.2)],
    diffuse_transmission=0.1,
)
PAINT = glossy.Material((0.4, 0.2, 0.1), [glossy.Lobe(0.15, ks=(0.9, 0.7, 0.5), r0=0.2)])


@pytest.fixture(scope="module")
def table() -> MeasuredTable:
    return synthetic_table(METAL, noise=0.05)


def naive_metric(table: MeasuredTable, model: npt.NDArray[np.float64], name: str) -> float:
    """The metric from the table and the model's BSDF, term by term, without the features."""
    total = weights = 0.0
    for wi, wo, f, g in zip(table.wi, table.wo, table.f[:, 0], model, strict=True):
        if f == 0.0:
            continue
        w = float(np.sqrt(1.0 - wo[2] ** 2))
        a, b = f * abs(wo[2]) * abs(wi[2]), g * abs(wo[2]) * abs(wi[2])
        if name == "cubic-root":
            a, b = float(np.cbrt(a)), float(np.cbrt(b))
        elif name == "log":
            a, b = np.sign(a) * np.log(1.0 + abs(a)), np.log(1.0 + b)
        total += w * (abs(a - b) if name == "l1" else (a - b) ** 2)
        weights += w
    return total / weights if name == "l1" else float(np.sqrt(total / weights))


@pytest.mark.parametrize("metric", fit_metrics.METRICS)
def test_the_error_of_a_fit_is_the_metric_of_its_material(
    metric: str, table: MeasuredTable
) -> None:
    fit = fit_table(table, metric=metric, **FAST)  # type: ignore[arg-type]
    assert fit.material is not None
    model = np.asarray(fit.material.eval(table.wo, table.wi), dtype=np.float64)
    assert fit.error == pytest.approx(naive_metric(table, model, metric), rel=tolerances.ROUNDOFF)
    np.testing.assert_allclose(fit.eval(table.wi, table.wo)[:, 0], model, rtol=1e-11, atol=1e-300)
    assert fit.stages[1].error <= fit.stages[0].error


def test_a_zero_row_does_not_count(table: MeasuredTable) -> None:
    """Eq. 3.7 sums over the non-zero measurements: shadowed rows change nothing."""
    fit = fit_table(table, weights="sine", **FAST)  # type: ignore[arg-type]
    dark = MeasuredTable(
        np.concatenate([table.wi, table.wi[::7]]),
        np.concatenate([table.wo, table.wo[::7]]),
        np.concatenate([table.f, 0.0 * table.f[::7]]),
    )
    again = fit_table(dark, weights="sine", **FAST)  # type: ignore[arg-type]
    assert again.error == pytest.approx(fit.error, rel=1e-9)


@pytest.mark.parametrize("material", [METAL, TWO, FROSTED], ids=["one", "two", "frosted"])
def test_parameters_come_back_from_a_clean_table(material: glossy.Material) -> None:
    table = synthetic_table(material)
    fit = fit_table(table, len(material.reflection), rounds=2, grid=6)
    assert fit.material is not None
    assert fit.error < 1e-7
    assert fit.material.kd == pytest.approx(material.kd, abs=1e-5)
    below = fit.material.diffuse_transmission
    assert below == pytest.approx(material.diffuse_transmission, abs=1e-5)
    for found, true in zip(fit.material.lobes, material.lobes, strict=True):
        for name in ("mx", "my", "alpha", "r0", "ks"):
            assert getattr(found, name) == pytest.approx(getattr(true, name), abs=2e-4), name


def test_colour_is_found_with_one_shape() -> None:
    fit = fit_table(synthetic_table(PAINT, isotropic=True), **FAST)  # type: ignore[arg-type]
    assert fit.material is not None
    lobe = fit.material.reflection[0]
    assert fit.material.kd == pytest.approx(PAINT.kd, abs=1e-5)
    assert lobe.ks == pytest.approx(PAINT.reflection[0].ks, abs=1e-4)
    assert (lobe.mx, lobe.my) == pytest.approx((0.15, 0.15), abs=1e-5)


def test_noise_shadow_and_few_directions_move_the_roughness_little() -> None:
    table = synthetic_table(METAL, theta=(10.0, 50.0), noise=0.1, shadow=12.0, rows=18, seed=3)
    fit = fit_table(table, **FAST)  # type: ignore[arg-type]
    assert fit.material is not None
    lobe = fit.material.reflection[0]
    assert lobe.mx == pytest.approx(0.2, rel=0.03)
    assert lobe.my == pytest.approx(0.1, rel=0.03)
    assert lobe.ks * lobe.r0 == pytest.approx(0.56, rel=0.03)  # type: ignore[operator]


def test_fewer_lobes_are_never_better() -> None:
    table = synthetic_table(TWO, noise=0.05)
    one, two = (fit_table(table, n, grid=5, rounds=2) for n in (1, 2))
    assert two.error < one.error


def test_a_diffuse_surface_needs_no_lobe() -> None:
    fit = fit_table(synthetic_table(glossy.Material(0.4), noise=0.02, rows=6), 0)
    assert fit.material is not None
    assert fit.material.lobes == ()
    assert fit.material.kd == pytest.approx(0.4, rel=5e-3)


def test_same_input_same_bits_for_any_number_of_threads() -> None:
    table = synthetic_table(METAL, theta=(30.0, 60.0), phi=(0.0,), noise=0.05, rows=12)
    threads = numba.get_num_threads()
    found = []
    for n in (threads, 1):
        numba.set_num_threads(n)
        found.append(fit_table(table, polish="global", seed=4, **FAST))  # type: ignore[arg-type]
    numba.set_num_threads(threads)
    a, b = (f.parameters["reflection"] for f in found)
    np.testing.assert_array_equal(a, b)
    assert found[0].error == found[1].error


def test_the_first_grid_level_is_the_product_of_equidistant_values(table: MeasuredTable) -> None:
    """Thesis 3.4.1 step 2 as nested loops over NumPy values of the lobe."""
    rows = fit_rows.rows_of(table, "reflection", "kurt", "sine")
    assert rows is not None
    bounds = {"mx": (0.1, 0.3), "my": (0.05, 0.2), "ks": (0.2, 1.0)}
    space = fit_space.make_space("reflection", 1, 1, bounds, {"alpha": 0.3})
    y = rows.measured[:, 0]
    best, total, count = fit_grid.search_lobe(rows, space, y, 0.0 * y, 0, 3, 1, "linear")
    axes = [np.linspace(a, b, 3) for a, b in ((0.1, 0.3), (0.05, 0.2), (0.0, 1.0), (0.2, 1.0))]
    tried = {}
    for mx in axes[0]:
        for my in axes[1]:
            for r0 in axes[2]:
                for ks in axes[3]:
                    model = ks * fit_metrics.lobe_values(rows, mx, my, 0.3, r0)
                    tried[mx, my, 0.3, r0, ks] = float((rows.weight[:, 0] * abs(y - model)).sum())
    assert count == len(tried) == 81
    assert tuple(best) == min(tried, key=lambda k: tried[k])
    assert total == pytest.approx(min(tried.values()), rel=tolerances.ROUNDOFF)


def test_a_level_shrinks_the_box_by_the_step(table: MeasuredTable) -> None:
    """+- range / (n - 1) about the best: 0.1 to 0.3 by fives, then steps of 0.025."""
    rows = fit_rows.rows_of(table, "reflection", "kurt", "sine")
    assert rows is not None
    held = {"my": 0.1, "alpha": 0.3, "r0": 0.7, "ks": 0.8}
    space = fit_space.make_space("reflection", 1, 1, {"mx": (0.05, 0.45)}, held)
    y = rows.measured[:, 0]
    found = [fit_grid.search_lobe(rows, space, y, 0 * y, 0, 5, k, "linear") for k in (1, 2, 3)]
    assert [f[2] for f in found] == [5, 10, 15]
    assert found[0][0][0] in np.linspace(0.05, 0.45, 5)
    step = (found[1][0][0] - found[0][0][0]) / 0.05
    assert step == pytest.approx(round(step), abs=1e-9)
    assert found[2][1] <= found[1][1] <= found[0][1]


def test_the_jacobian_is_the_derivative(table: MeasuredTable) -> None:
    for model in fit_rows.MODELS:
        rows = fit_rows.rows_of(table, "reflection", model, "sine")
        assert rows is not None
        space = fit_space.make_space("reflection", 1, 1, {}, {})
        p = np.array([0.1, 0.2, 0.12, 0.3, 0.6, 0.7])
        exact = fit_polish.jacobian(rows, space, p)[:, 0]
        for k in range(len(p)):
            h = 1e-6
            low, high = p.copy(), p.copy()
            if space.logarithmic[k]:
                low[k], high[k] = p[k] * np.exp(-h), p[k] * np.exp(h)
            else:
                low[k], high[k] = p[k] - h, p[k] + h
            ends = [fit_metrics.model_values(rows, q)[:, 0] for q in (low, high)]
            np.testing.assert_allclose(exact[:, k], (ends[1] - ends[0]) / (2 * h), atol=1e-7)


def test_the_diffuse_mode_is_found_beside_a_highlight() -> None:
    rng = np.random.default_rng(0)
    f = np.concatenate([rng.normal(0.2, 0.01, 600), rng.exponential(5.0, 300), np.zeros(500)])
    assert fit_rows.diffuse_mode(f) == pytest.approx(0.2 * np.pi, rel=0.03)
    assert fit_rows.diffuse_mode(np.full(9, 0.3)) == pytest.approx(0.3 * np.pi)
    assert fit_rows.diffuse_mode(np.zeros(4)) == 0.0


def test_bounds_and_fixed_values_hold(table: MeasuredTable) -> None:
    fit = fit_table(
        table,
        2,
        bounds={"mx": (0.05, 0.15), "reflection[1].mx": (0.3, 0.5)},
        fixed={"r0": 0.9, "reflection[0].alpha": 0.0, "kd": 0.01},
        **FAST,  # type: ignore[arg-type]
    )
    assert fit.material is not None
    first, second = fit.material.reflection
    assert 0.05 <= first.mx <= 0.15
    assert 0.3 <= second.mx <= 0.5
    assert (first.r0, second.r0, first.alpha, fit.material.kd) == (0.9, 0.9, 0.0, 0.01)
    assert "reflection[0].mx" in fit.at_bounds


def test_the_mode_stays_when_asked(table: MeasuredTable) -> None:
    fit = fit_table(table, kd="mode", **FAST)  # type: ignore[arg-type]
    assert fit.material is not None
    assert fit.material.kd == pytest.approx(fit_rows.diffuse_mode(table.f))


def test_an_isotropic_table_gives_an_isotropic_lobe(table: MeasuredTable) -> None:
    fit = fit_table(table, isotropic=True, **FAST)  # type: ignore[arg-type]
    assert fit.material is not None
    assert fit.material.reflection[0].mx == fit.material.reflection[0].my


def test_time_limit_gives_the_best_so_far(table: MeasuredTable) -> None:
    fit = fit_table(table, 2, time_limit=1e-9)
    assert fit.stopped
    assert fit.material is not None
    assert np.isfinite(fit.error)


BRIGHT = glossy.Material(0.05, [glossy.Lobe(0.3, ks=0.9, r0=0.6, alpha=0.9)])
"""Sends out more than it receives from 65 degrees."""


def below(limit: float) -> npt.NDArray[np.float64]:
    """Angles to a limit that the bound is not told of, but for the limit."""
    return np.append(np.arange(0.0, limit, 0.7), limit)


@pytest.fixture(scope="module")
def bright() -> MeasuredTable:
    return synthetic_table(BRIGHT, theta=(10.0, 60.0), phi=(0.0,), isotropic=True, rows=16)


def test_a_fit_says_how_much_more_it_sends_out_than_it_receives(bright: MeasuredTable) -> None:
    fit = fit_table(bright, **FAST)  # type: ignore[arg-type]
    assert fit.material is not None
    assert fit.energy is not None
    expected = energy(fit.material)
    assert fit.energy["largest"] == expected.largest > 1.5
    assert fit.energy["worst"] == expected.worst
    assert fit.energy["exceeds_from"] == expected.exceeds_from
    assert fit.energy["limit"] is None
    assert fit.to_dict()["energy"] == fit.energy


@pytest.mark.parametrize(("limit", "polish"), [(89.9, "local"), (70.0, "local"), (80.0, "none")])
def test_a_bounded_fit_sends_out_no_more_than_it_receives(
    limit: float, polish: str, bright: MeasuredTable
) -> None:
    options = {**FAST, "polish": polish}
    free = fit_table(bright, **options)  # type: ignore[arg-type]
    fit = fit_table(bright, energy_limit=limit, **options)  # type: ignore[arg-type]
    assert free.material is not None
    assert fit.material is not None
    assert energy(free.material, below(limit)).largest > 1.05
    assert energy(fit.material, below(limit)).largest <= 1.0
    assert fit.energy is not None
    assert fit.energy["limit"] == limit
    if polish == "local":  # what is left of the room is small
        assert energy(fit.material, below(limit)).largest > 0.9
    # better than the same lobe dimmed for the sake of its grazing end
    scale = 0.9 / energy(free.material, [limit]).largest
    lobe = free.material.reflection[0]
    dimmed = glossy.Material(
        free.material.kd, [dataclasses.replace(lobe, ks=float(np.asarray(lobe.ks)) * scale)]
    )
    model = np.asarray(dimmed.eval(bright.wo, bright.wi), dtype=np.float64)
    assert fit.error <= naive_metric(bright, model, "l1")


def test_a_fit_within_its_energy_is_left_alone(table: MeasuredTable) -> None:
    free, held = (fit_table(table, energy_limit=x, **FAST) for x in (None, 20.0))  # type: ignore[arg-type]
    assert np.array_equal(free.parameters["reflection"], held.parameters["reflection"])
    assert held.error == free.error


def test_colours_are_bounded_one_by_one() -> None:
    colours = glossy.Material(
        (0.0, 0.3, 0.0), [glossy.Lobe(0.3, ks=(0.9, 0.9, 0.2), r0=0.6, alpha=0.9)]
    )
    rows = synthetic_table(colours, theta=(10.0, 60.0), phi=(0.0,), isotropic=True, rows=16)
    fit = fit_table(rows, energy_limit=85.0, polish="none", **FAST)  # type: ignore[arg-type]
    assert fit.material is not None
    sent = energy(fit.material, [85.0]).reflectivity.max(axis=(0, 1))
    assert sent[:2] == pytest.approx(1.0, abs=1e-4)
    assert sent[2] < 0.9


def plain_baseline(model: str, wi: npt.NDArray[np.float64], wo: npt.NDArray[np.float64]) -> float:
    """The baselines as their papers print them, with trigonometry; mx .3, my .2, ks .5, r0 .4."""
    mx, my, ks, r0 = 0.3, 0.2, 0.5, 0.4
    h = (wi + wo) / np.linalg.norm(wi + wo)
    theta, phi = np.arccos(h[2]), np.arctan2(h[1], h[0])
    u, ci, co = float(wo @ h), wi[2], wo[2]
    fresnel = r0 + (1 - r0) * (1 - u) ** 5
    e = np.tan(theta) ** 2 * ((np.cos(phi) / mx) ** 2 + (np.sin(phi) / my) ** 2)
    if model == "ward":
        return float(ks * np.exp(-e) / (4 * np.pi * mx * my * np.sqrt(ci * co)))
    if model == "beckmann":
        d = np.exp(-e) / (np.pi * mx * my * np.cos(theta) ** 4)
        g = min(1.0, 2 * h[2] * co / u, 2 * h[2] * ci / u)
        return float(ks * fresnel * d * g / (4 * ci * co))
    d = 1 / (np.pi * mx * my * ((h[0] / mx) ** 2 + (h[1] / my) ** 2 + h[2] ** 2) ** 2)

    def smith(v: npt.NDArray[np.float64]) -> float:
        return float((np.sqrt(1 + ((mx * v[0]) ** 2 + (my * v[1]) ** 2) / v[2] ** 2) - 1) / 2)

    return float(ks * fresnel * d / (1 + smith(wi) + smith(wo)) / (4 * ci * co))


@pytest.mark.parametrize("model", ["ward", "beckmann", "ggx"])
def test_baselines_are_what_their_papers_print_and_are_recovered(model: str) -> None:
    wi, wo = synthetic_table(METAL).wi, synthetic_table(METAL).wo
    f = [plain_baseline(model, i, o) for i, o in zip(wi, wo, strict=True)]
    fit = fit_table(MeasuredTable(wi, wo, f), model=model, **FAST)  # type: ignore[arg-type]
    assert fit.material is None
    assert fit.error < 1e-7
    p = fit.parameters["reflection"]
    r0, ks = (1.0, 0.5) if model == "ward" else (0.4, 0.5)
    assert p == pytest.approx([0.0, 0.3, 0.2, 0.0, r0, ks], abs=1e-3)
    np.testing.assert_allclose(fit.eval(wi, wo)[:, 0], f, rtol=5e-3, atol=1e-5)


def test_what_a_baseline_does_not_have_cannot_be_fixed_for_one_lobe(table: MeasuredTable) -> None:
    held = {"reflection[0].r0": 0.5, "mx": 0.2}
    fit = fit_table(table, model="ward", fixed=held, polish="none", **FAST)  # type: ignore[arg-type]
    _, mx, _, alpha, r0, _ = fit.parameters["reflection"]
    assert (mx, alpha, r0) == (0.2, 0.0, 1.0)


REFUSALS = [
    ({"metric": "l3"}, "metric: must be one of"),
    ({"model": "phong"}, "model: must be one of"),
    ({"reflection": -1}, "reflection: must be at least 0"),
    ({"transmission": 1}, "the table has no transmission rows"),
    ({"bounds": {"m": (0, 1)}}, "bounds: name: must be one of"),
    ({"bounds": {"mx": (0.5, 0.1)}}, r"must be \(low, high\)"),
    ({"bounds": {"r0": (0.0, 2.0)}}, r"bounds: r0: must be in \[0, 1\]"),
    ({"fixed": {"reflection[1].mx": 0.1}}, "there are 1 reflection lobes"),
    ({"fixed": {"ks": (0.1, 0.2)}}, "one for each of 1 channels"),
    ({"fixed": {"mx": (0.1, 0.2)}}, "must be one number"),
    ({"grid": 1}, "grid: must be at least 2"),
    ({"time_limit": 0.0}, "time_limit: must be in"),
    ({"light": "below"}, "the table has no light from below"),
    ({"spacing": "cubic"}, "spacing: must be one of"),
    ({"energy_limit": 90.0}, r"energy_limit: must be in \[0, 90\)"),
    ({"energy_limit": 80.0, "model": "ggx", "polish": "none"}, "energy_limit: is for model 'kurt'"),
    (
        {"energy_limit": 89.9, "fixed": {"ks": 0.9, "alpha": 1.0}, "polish": "none"},
        "cannot be held",
    ),
]


@pytest.mark.parametrize(("options", "message"), REFUSALS)
def test_bad_options_are_refused_in_one_line(
    options: dict[str, object], message: str, table: MeasuredTable
) -> None:
    with pytest.raises(ValueError, match=message):
        fit_table(table, **options)  # type: ignore[arg-type]


def test_weights_of_the_table_are_those_of_its_grid(table: MeasuredTable) -> None:
    """On a uniform grid the solid angles are sin theta_o times a constant: the same metric."""
    by_table = fit_table(table, weights="table", **FAST)  # type: ignore[arg-type]
    by_sine = fit_table(table, weights="sine", **FAST)  # type: ignore[arg-type]
    assert by_table.error == pytest.approx(by_sine.error, rel=1e-6)
    bare = MeasuredTable(table.wi, table.wo, table.f)
    with pytest.raises(ValueError, match="needs a table with solid angles"):
        fit_table(bare, weights="table")


def test_light_from_below_is_the_same_seen_from_there(table: MeasuredTable) -> None:
    flip = [1.0, 1.0, -1.0]
    both = MeasuredTable(
        np.concatenate([table.wi, table.wi * flip]),
        np.concatenate([table.wo, table.wo * flip]),
        np.concatenate([table.f, 0.5 * table.f]),
    )
    above, below = (fit_table(both, light=x, **FAST) for x in ("above", "below"))  # type: ignore[arg-type]
    assert above.rows == below.rows == len(table)
    assert below.error == pytest.approx(0.5 * above.error, rel=1e-3)


def test_a_fit_says_everything_in_plain_values(table: MeasuredTable) -> None:
    fit: Fit = fit_table(table, **FAST)  # type: ignore[arg-type]
    record = fit.to_dict()
    assert set(record) == {f.name for f in dataclasses.fields(Fit)}
    assert record["material"]["reflection"][0]["mx"] == fit.parameters["reflection"][1]
