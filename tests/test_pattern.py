"""Regular, budget and importance patterns against their definition, sample by sample."""

import csv
import io
import json
import math
import re
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import ROUNDOFF

import glossy
from glossy import brdf, pattern
from glossy.lowdiscrepancy import hammersley, radical_inverse
from glossy.pattern import importance_pattern, pattern_for_budget, regular_pattern

Array = npt.NDArray[np.float64]
Pair = tuple[float, float]

SPACINGS = ("s1", "s2")
WIDTHS = st.floats(0.01, 1.0)
LOBES = st.tuples(WIDTHS, WIDTHS) | WIDTHS.map(lambda m: (m, m))
THRESHOLDS = st.floats(1e-4, 0.9)


def exponent(h: Array, mx: float, my: float) -> Array:
    """Eq. P5 with its angles."""
    theta, phi = np.arctan2(np.hypot(h[:, 0], h[:, 1]), h[:, 2]), np.arctan2(h[:, 1], h[:, 0])
    return -(np.tan(theta) ** 2) * ((np.cos(phi) / mx) ** 2 + (np.sin(phi) / my) ** 2)


def naive(mx: float, my: float, circles: int, spacing: str, threshold: float) -> Array:
    """Every circle twice, sample by sample; the start with the larger sum of exp(q)."""
    theta_max = math.atan(math.sqrt(-math.log(threshold)) * max(mx, my))
    r0 = 1 / math.sqrt(2)
    s = theta_max / (circles - 0.5 + (r0 if spacing == "s2" else 0.0))
    kept = [(0.0, 0.0, 1.0)] if spacing == "s1" else []
    radii = [i * s for i in range(1, circles)] if spacing == "s1" else []
    radii = radii or [(r0 + i) * s for i in range(circles) if spacing == "s2"]
    first = 6 if spacing == "s1" else 4
    for theta in radii:
        n = 2 * math.floor(first * math.sin(theta) / (2 * math.sin(radii[0])) + 0.5)
        best, best_sum = [], -1.0
        for offset in (0.0, 0.5):
            samples, total = [], 0.0
            for k in range(n):
                phi = 2 * math.pi * (k + offset) / n
                x, y = math.tan(theta) * math.cos(phi), math.tan(theta) * math.sin(phi)
                value = math.exp(-((x / mx) ** 2) - (y / my) ** 2)
                if value >= threshold:
                    samples.append(
                        (
                            math.sin(theta) * math.cos(phi),
                            math.sin(theta) * math.sin(phi),
                            math.cos(theta),
                        )
                    )
                    total += value
            if total > best_sum * (1 + 1e-9):
                best, best_sum = samples, total
        kept += best
    return np.array(kept)  # fmt: skip


@pytest.mark.parametrize(
    ("widths", "circles", "spacing", "threshold", "count"),
    [
        ((0.15, 0.15), 3, "s1", 0.1, 19),
        ((0.15, 0.15), 2, "s2", 0.1, 14),
        ((0.15, 0.15), 3, "s2", 0.1, 30),
        ((0.2, 0.075), 4, "s1", 0.2, 17),
        ((0.075, 0.2), 4, "s1", 0.2, 17),
        ((0.15, 0.15), 10, "s1", 0.1, 271),
        ((0.6, 0.6), 3, "s2", 0.01, 28),
        ((0.15, 0.15), 1, "s1", 0.1, 1),
        ((0.15, 0.15), 1, "s2", 0.1, 4),
    ],
)
def test_published_counts(
    widths: Pair, circles: int, spacing: str, threshold: float, count: int
) -> None:
    assert len(regular_pattern(glossy.Lobe(*widths), circles, spacing, threshold)) == count


@given(LOBES, st.integers(1, 12), st.sampled_from(SPACINGS), THRESHOLDS)
def test_only_the_arcs_inside_the_lobe_are_generated_yet_none_is_missed(
    m: Pair, n_c: int, spacing: str, xi0: float
) -> None:
    expected = naive(*m, n_c, spacing, xi0)
    p = regular_pattern(m, n_c, spacing, xi0)
    assert len(p) == len(expected)
    np.testing.assert_allclose(p.half_vectors, expected, atol=ROUNDOFF)


@pytest.mark.parametrize("m", [(1.0, 1e-3), (1e-3, 1.0), (10.0, 0.02), (1e-5, 1e-2)])
@pytest.mark.parametrize("spacing", SPACINGS)
def test_extreme_anisotropy_equals_the_definition(m: Pair, spacing: str) -> None:
    expected = naive(*m, 60, spacing, 0.1)
    p = regular_pattern(m, 60, spacing, 0.1)
    np.testing.assert_allclose(p.half_vectors, expected, atol=ROUNDOFF)


@given(LOBES, st.integers(1, 15), st.sampled_from(SPACINGS), THRESHOLDS)
def test_a_regular_pattern_stays_in_the_lobe_and_is_its_own_half_turn(
    m: Pair, n_c: int, spacing: str, xi0: float
) -> None:
    p = regular_pattern(m, n_c, spacing, xi0)
    h = p.half_vectors
    assert np.all(exponent(h, *m) >= math.log(xi0) - ROUNDOFF * 1e3)
    assert np.all(h[:, 2] > 0)
    np.testing.assert_allclose(np.linalg.norm(h, axis=1), 1, atol=ROUNDOFF)
    turned = h * [-1, -1, 1]
    nearest = np.abs(h[:, None] - turned[None]).max(axis=2).min(axis=0)
    assert nearest.max() < ROUNDOFF
    low, high = pattern._circles(*m, n_c, spacing, xi0).bounds
    assert low <= len(p) <= high


@given(WIDTHS, st.integers(1, 12), st.sampled_from(SPACINGS))
def test_isotropic_circles_start_at_zero(m: float, n_c: int, spacing: str) -> None:
    h = regular_pattern((m, m), n_c, spacing).half_vectors
    theta = np.round(h[:, 2], 12)
    for value in np.unique(theta[theta < 1 - 1e-12]):
        circle = h[theta == value]
        assert np.any((circle[:, 1] == 0.0) & (circle[:, 0] > 0.0))


@pytest.mark.parametrize("m", [(0.15, 0.15), (0.2, 0.075), (0.5, 0.1)])
@pytest.mark.parametrize(("spacing", "cover"), [("s1", 3 / math.pi), ("s2", 2**1.5 / math.pi)])
def test_cells_cover_their_share_of_the_lobe(m: Pair, spacing: str, cover: float) -> None:
    """Dense patterns: sum of D hz s^2 tends to ``cover`` of the density above the threshold.

    One percent: the border cuts cells of 1/120 of the lobe's half axis.
    """
    p: Any = regular_pattern(m, 120, spacing, 0.1)
    energy = len(p) * p.cell * p.projected_pdf_constant
    assert energy == pytest.approx(0.9 * cover, rel=0.01)


@given(LOBES, st.integers(1, 60), THRESHOLDS)
def test_the_budget_takes_the_nearest_count_then_the_smaller_then_s1(
    m: Pair, budget: int, xi0: float
) -> None:
    found: list[tuple[int, int, str, int]] = []
    counts, n_c = [0], 0
    while min(counts) < 2 * budget:
        n_c += 1
        counts = [len(regular_pattern(m, n_c, s, xi0)) for s in SPACINGS]
        found += [(abs(n - budget), n, s, n_c) for n, s in zip(counts, SPACINGS, strict=True)]
    _, n, spacing, n_c = min(found)
    p = pattern_for_budget(m, budget, xi0)
    assert (len(p), p.spacing, p.circles) == (n, spacing, n_c)


@pytest.mark.parametrize(
    ("m", "budget", "xi0"),
    [
        ((1.0, 1e-3), 20, 0.1),
        ((1.0, 1e-3), 1000, 0.1),
        ((1e-3, 1.0), 1000, 0.1),
        ((0.15, 0.15), 10_000, 0.1),
        ((0.2, 0.075), 10_000, 1e-6),
        ((10.0, 10.0), 500, 1e-6),
        ((1e-5, 1e-5), 30, 0.99),
    ],
)
def test_budget_searches_end_near_the_budget(m: Pair, budget: int, xi0: float) -> None:
    """Counts come in steps of a circle; the largest is about 2 sqrt(pi n) of n, both spacings."""
    p: Any = pattern_for_budget(m, budget, xi0)
    assert abs(len(p) - budget) <= max(3, math.sqrt(math.pi * budget))
    assert np.isfinite([p.cell, p.pdf_constant, p.projected_pdf_constant]).all()


def test_patterns_that_cannot_come_nearest_are_never_generated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of twice 141 numbers of circles, none of those that have more samples than the nearest."""
    made: list[int] = []
    real = pattern._half_vectors

    def counted(*args: Any) -> Any:
        found = real(*args)
        made.append(len(found))
        return found

    monkeypatch.setattr(pattern, "_half_vectors", counted)
    pattern._search(0.2, 0.07, 10_000, 0.123)
    assert len(made) <= 141
    assert max(made) <= 10_100


@given(LOBES, st.integers(1, 6), st.sampled_from(SPACINGS))
def test_constants_are_the_means_of_the_density(m: Pair, n_c: int, spacing: str) -> None:
    """Eqs. P4 and P18 with angles."""
    p = regular_pattern(m, n_c, spacing)
    theta = np.arctan2(np.hypot(*p.half_vectors[:, :2].T), p.half_vectors[:, 2])
    d = np.exp(exponent(p.half_vectors, *m)) / (math.pi * m[0] * m[1] * np.cos(theta) ** 4)
    assert p.pdf_constant == pytest.approx(d.mean(), rel=1e-9)
    assert p.projected_pdf_constant == pytest.approx((d * np.cos(theta)).mean(), rel=1e-9)


@pytest.mark.parametrize("m", [1e-5, 1e-3, 0.15])
def test_the_constant_scales_with_the_lobe(m: float) -> None:
    """A narrow lobe is the same Gaussian at another scale; its peak is 1/(pi m^2)."""
    p = regular_pattern((m, m), 3, "s1")
    q = exponent(p.half_vectors, m, m)
    flat = np.exp(q).mean() / (math.pi * m * m)
    assert p.pdf_constant == pytest.approx(flat, rel=8 * m * m + 1e-9)


@given(LOBES, st.integers(1, 100))
def test_the_importance_pattern_is_the_lobes_sampling_of_hammersley_points(m: Pair, n: int) -> None:
    lobe = glossy.Lobe(*m)
    p: Any = importance_pattern(lobe, n)
    assert len(p) == n
    assert p.method == "importance"
    wo = np.array([0.0, 0.0, 1.0])
    wi = lobe.sample(hammersley(n), wo)
    half = wi + wo
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    np.testing.assert_allclose(p.half_vectors, half, atol=1e-10)
    pdf_wh = lobe.pdf(wi, wo) * 4 * (half @ wo)
    np.testing.assert_allclose(p.cell * n * pdf_wh, 1, rtol=1e-7)


def test_importance_half_vectors_have_the_lobes_mean_slope() -> None:
    """-ln(xi1) averages 1 - ln(2)/(2n), as the module says, to the next order 1/n^2."""
    for n in (8, 64, 4096):
        h = importance_pattern((0.2, 0.05), n).half_vectors
        radius2 = -exponent(h, 0.2, 0.05)
        assert radius2.mean() == pytest.approx(1 - math.log(2) / (2 * n), abs=0.2 / n**2)


def test_low_discrepancy_points() -> None:
    assert radical_inverse([0, 1, 2, 3, 4, 6]).tolist() == [0, 0.5, 0.25, 0.75, 0.125, 0.375]
    assert radical_inverse(2**53 - 1) == 1 - 2.0**-53
    assert sorted(radical_inverse(np.arange(64)) * 64) == list(range(64))
    for n in (1, 2, 7, 40):
        xi = hammersley(n)
        assert xi.shape == (n, 2)
        assert np.all((xi[:, 0] > 0) & (xi[:, 0] < 1) & (xi[:, 1] >= 0) & (xi[:, 1] < 1))
    for bad in (-1, 0.5, 2**53):
        with pytest.raises(ValueError, match="index: must be whole"):
            radical_inverse(bad)


def test_a_users_table() -> None:
    h = [[0, 0, 1.0005], [0.1, 0, math.sqrt(0.99)]]
    bare = glossy.Pattern(h)
    assert len(bare) == 2
    assert bare.half_vectors[0].tolist() == [0, 0, 1]
    assert (bare.cell, bare.pdf_constant, bare.widths) == (None, None, None)
    known: Any = glossy.Pattern(h, cell=[0.1, 0.2], pdf_constant=3.0)
    assert known.cell.tolist() == [0.1, 0.2]
    assert (known.pdf_constant, known.projected_pdf_constant) == (3.0, None)
    made: Any = glossy.Pattern(h, lobe=glossy.Lobe(0.2, 0.1))
    d = np.exp([0, -0.01 / 0.99 / 0.04]) / (math.pi * 0.02 * np.array([1, 0.99**2]))
    assert made.pdf_constant == pytest.approx(d.mean())
    assert made.cell * len(made) * made.projected_pdf_constant == pytest.approx(1)
    for array in (made.half_vectors, known.cell):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


UP = [[0.0, 0.0, 1.0]]
NOT_A_LOBE: Any = 0.2
HALF: Any = 2.5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: glossy.Pattern([0, 0, 1]), r"half_vectors: must have shape \(n, 3\)"),
        (lambda: glossy.Pattern(np.empty((0, 3))), "half_vectors: must have shape"),
        (lambda: glossy.Pattern([[0, 0, 2]]), "half_vectors: must be unit"),
        (lambda: glossy.Pattern([[0, 0, -1]]), "half_vectors: must lie above"),
        (lambda: glossy.Pattern([[1, 0, 0]]), "half_vectors: must lie above"),
        (lambda: glossy.Pattern([[np.nan, 0, 1]]), "half_vectors: must be finite"),
        (lambda: glossy.Pattern(UP, cell=0), "cell: must be in"),
        (lambda: glossy.Pattern(UP, cell=[1, 2]), "cell: must be a number or have shape"),
        (lambda: glossy.Pattern(UP, cell=[-1]), "cell: must be finite and positive"),
        (lambda: glossy.Pattern(UP, pdf_constant=np.inf), "pdf_constant: must be finite"),
        (lambda: glossy.Pattern(UP, projected_pdf_constant=-1), "projected_pdf_constant: must"),
        (lambda: glossy.Pattern(UP, lobe=NOT_A_LOBE), "lobe: must be a Lobe or"),
        (lambda: regular_pattern((0.2, 0)), "my: must be in"),
        (lambda: regular_pattern((0.2, 0.1), 0), "circles: must be at least 1"),
        (lambda: regular_pattern((0.2, 0.1), HALF), "circles: must be a whole number"),
        (lambda: regular_pattern((0.2, 0.2), 10_000), "circles: must place at most"),
        (lambda: regular_pattern((0.2, 0.1), spacing="s3"), "spacing: must be one of s1, s2"),
        (lambda: regular_pattern((0.2, 0.1), threshold=0), "threshold: must be in"),
        (lambda: regular_pattern((0.2, 0.1), threshold=1), "threshold: must be in"),
        (lambda: pattern_for_budget((0.2, 0.1), 0), "samples: must be from 1 to"),
        (lambda: pattern_for_budget((0.2, 0.1), threshold=2), "threshold: must be in"),
        (lambda: importance_pattern((0.2, 0.1), -1), "samples: must be from 1 to"),
        (lambda: glossy.Pattern(UP).export("xml"), "form: must be one of json, csv, glsl"),
    ],
)
def test_refusals(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message) as error:
        call()
    assert "\n" not in str(error.value)


TABLES = [
    regular_pattern((0.2, 0.075), 4, "s1", 0.2),
    importance_pattern((1e-5, 1e-5), 5),
    glossy.Pattern(UP),
]


@pytest.mark.parametrize("table", TABLES)
def test_json_and_csv_hold_every_bit(table: glossy.Pattern) -> None:
    data = json.loads(table.export("json"))
    assert data.pop("schema") == 1
    assert data.pop("samples") == len(table)
    again = glossy.Pattern(data["half_vectors"], data["cell"], data["pdf_constant"])
    np.testing.assert_array_equal(np.array(data["half_vectors"]), table.half_vectors)
    np.testing.assert_array_equal(again.cell, table.cell)
    assert again.pdf_constant == table.pdf_constant
    assert set(data) == set(table.__dataclass_fields__)

    rows = list(csv.DictReader(io.StringIO(table.export("csv"))))
    h = np.array([[float(r[k]) for k in ("hx", "hy", "hz")] for r in rows])
    np.testing.assert_array_equal(h, table.half_vectors)
    if table.cell is None:
        assert {r["cell"] for r in rows} == {""}
    else:
        np.testing.assert_array_equal(
            [float(r["cell"]) for r in rows], np.broadcast_to(table.cell, len(table))
        )


FLOAT = r"-?\d+\.\d+(?:e[+-]?\d+)?"
GRAMMAR = {
    "glsl": (
        r"const vec3 PATTERN\[{n}\] = vec3\[{n}\]\(\n((?:    vec3\({f}, {f}, {f}\),?\n)+)\);\n",
        r"const float {name} = ({f});\n",
        "const int PATTERN_SIZE = {n};\n",
        r"const float PATTERN_CELL\[{n}\] = float\[{n}\]\(\n((?:    {f},?\n)+)\);\n",
    ),
    "hlsl": (
        r"static const float3 PATTERN\[{n}\] = {{\n((?:    float3\({f}, {f}, {f}\),?\n)+)}};\n",
        r"static const float {name} = ({f});\n",
        "static const int PATTERN_SIZE = {n};\n",
        r"static const float PATTERN_CELL\[{n}\] = {{\n((?:    {f},?\n)+)}};\n",
    ),
    "wgsl": (
        r"const PATTERN: array<vec3<f32>, {n}> = array<vec3<f32>, {n}>\(\n"
        r"((?:    vec3<f32>\({f}, {f}, {f}\),?\n)+)\);\n",
        r"const {name}: f32 = ({f});\n",
        "const PATTERN_SIZE: i32 = {n};\n",
        r"const PATTERN_CELL: array<f32, {n}> = array<f32, {n}>\(\n((?:    {f},?\n)+)\);\n",
    ),
}


@pytest.mark.parametrize("form", ["glsl", "hlsl", "wgsl"])
@pytest.mark.parametrize("table", TABLES)
def test_shader_tables_read_back_as_the_same_float32(form: str, table: glossy.Pattern) -> None:
    text = table.export(form)
    rows, number, size, cells = (
        g.replace("{n}", str(len(table)))
        .replace("{f}", FLOAT)
        .replace("{{", "{")
        .replace("}}", "}")
        for g in GRAMMAR[form]
    )

    def values(found: str) -> Array:
        body = re.sub(r"float3|vec3<f32>|vec3", "", found)
        assert not body.rstrip().endswith(",")
        return np.array([float(v) for v in re.findall(FLOAT, body)]).astype(np.float32)

    assert size in text
    match = re.search(rows, text)
    assert match
    np.testing.assert_array_equal(
        values(match[1]).reshape(-1, 3), table.half_vectors.astype(np.float32)
    )
    found: dict[str, Any] = dict.fromkeys(("PATTERN_PDF", "PATTERN_PDF_PROJECTED", "PATTERN_CELL"))
    for name in found:
        match = re.search(number.replace("{name}", name), text)
        found[name] = None if match is None else np.float32(float(match[1]))
    given = (table.pdf_constant, table.projected_pdf_constant, table.cell)
    for name, value in zip(found, given, strict=True):
        if isinstance(value, np.ndarray):
            match = re.search(cells, text)
            assert match
            np.testing.assert_array_equal(values(match[1]), value.astype(np.float32))
        else:
            assert found[name] == (None if value is None else np.float32(value))


def test_patterns_need_no_compiler() -> None:
    code = (
        "import sys, glossy; p = glossy.regular_pattern((0.2, 0.1)); p.export('glsl');"
        "assert 'numba' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_bounds_of_roughness_are_the_lobes() -> None:
    assert (pattern.M_MIN, pattern.M_MAX) == (brdf.M_MIN, brdf.M_MAX)
