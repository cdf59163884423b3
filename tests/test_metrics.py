"""Image metrics against plain float64 formulas, their invariances, and refusals."""

import dataclasses
import json
import math
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import tolerances
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import glossy
from glossy import _flip, _sweep, difference, metrics

Array = np.ndarray[Any, Any]
WIDTHS = {np.float16: 16, np.float32: 32, np.float64: 64}


def naive(a: Array, b: Array) -> dict[str, float]:
    a, b = a.astype(np.float64), b.astype(np.float64)
    d = a - b
    logs = (np.log(np.maximum(v, 0.0) + 1e-4) for v in (a, b))
    signal = np.sqrt(np.mean(b**2))
    error = np.sqrt(np.mean(d**2))
    return {
        "rms": error,
        "relative_rms": error / signal if signal > 0 else math.inf if error > 0 else 0.0,
        "mae": np.mean(np.abs(d)),
        "bias": np.mean(d),
        "relative_mse": np.mean(d**2 / (b**2 + 0.01)),
        "log_rms": np.sqrt(np.mean((next(logs) - next(logs)) ** 2)),
        "max_abs": np.abs(d).max(),
    }


@st.composite
def pairs(draw: st.DrawFn, channels: int | None = None) -> tuple[Array, Array]:
    dtype = draw(st.sampled_from(list(WIDTHS)))
    size = draw(st.tuples(st.integers(1, 9), st.integers(1, 9)))
    shape = (*size, draw(st.integers(1, 5)) if channels is None else channels)
    plain = st.floats(-1000.0, 1000.0, width=WIDTHS[dtype])  # type: ignore[arg-type]
    values = plain.map(lambda v: v if abs(v) > 1e-6 else 0.0)  # squares that the twin can hold
    a, b = (draw(hnp.arrays(dtype, shape, elements=values)) for _ in range(2))
    return a, b


def close(value: float, expected: float) -> bool:
    return value == pytest.approx(expected, rel=tolerances.ROUNDOFF, abs=1e-280)


@given(pairs())
def test_figures_agree_with_the_plain_formulas(pair: tuple[Array, Array]) -> None:
    a, b = pair
    got = glossy.compare(a, b)
    expected = naive(a, b)
    scale = expected["mae"] if expected["mae"] else 1.0
    for name in ("rms", "relative_rms", "mae", "relative_mse", "max_abs"):
        assert close(getattr(got, name), expected[name]), name
    assert got.bias == pytest.approx(expected["bias"], abs=tolerances.ROUNDOFF * scale)
    assert got.log_rms == pytest.approx(expected["log_rms"], rel=1e-9, abs=tolerances.ROUNDOFF)
    for name in ("rms", "relative_rms", "mae", "bias", "relative_mse", "log_rms"):
        assert getattr(glossy, name)(a, b) == getattr(got, name)
    x, y = got.max_at
    spot = np.abs(a.astype(float) - b.astype(float))
    assert spot[y, x, got.channels.index(got.max_channel)] == got.max_abs
    assert (y, x) == tuple(np.argwhere(spot.max(axis=2) == got.max_abs)[0])
    for c, error in enumerate(got.channel_rms):
        assert close(error, naive(a[..., c], b[..., c])["rms"])


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, np.uint8, np.int32])
@pytest.mark.parametrize("layout", ["C", "F", "reversed", "sliced"])
def test_many_blocks_of_any_layout(dtype: type, layout: str) -> None:
    rng = np.random.default_rng(3)
    shape = (301, 777, 3)
    both: list[Array] = [(rng.random(shape) * 200).astype(dtype) for _ in range(2)]
    a, b = both
    changes: dict[str, Callable[[Array], Array]] = {
        "C": np.ascontiguousarray,
        "F": np.asfortranarray,
        "reversed": lambda v: v[::-1, ::-1],
        "sliced": lambda v: v[::2, 1::3, :2],
    }
    p, q = changes[layout](a), changes[layout](b)
    got, expected = glossy.compare(p, q), naive(p, q)
    for name, value in expected.items():
        assert getattr(got, name) == pytest.approx(value, rel=tolerances.ROUNDOFF, abs=1e-10), name


@given(pairs())
def test_identical_images_are_identical(pair: tuple[Array, Array]) -> None:
    a = pair[0]
    got = glossy.compare(a, a.copy())
    assert got.identical
    assert got.rms == got.relative_rms == got.mae == got.bias == got.log_rms == 0.0
    assert math.isinf(got.psnr)
    out = got.to_dict()
    assert out["psnr"] is None
    assert out["identical"] is True


@given(pairs(), st.integers(-20, 20))
def test_scaling_by_powers_of_two_is_exact(pair: tuple[Array, Array], k: int) -> None:
    a, b = (v.astype(np.float64) for v in pair)
    s = 2.0**k
    assert glossy.rms(s * a, s * b) == s * glossy.rms(a, b)
    assert glossy.mae(s * a, s * b) == s * glossy.mae(a, b)
    assert glossy.relative_rms(s * a, s * b) == glossy.relative_rms(a, b)
    assert glossy.relative_mse(s * a, s * b, 0.01 * s * s) == pytest.approx(
        glossy.relative_mse(a, b), rel=tolerances.ROUNDOFF
    )


@given(pairs())
def test_distances_are_symmetric(pair: tuple[Array, Array]) -> None:
    a, b = pair
    for distance in (glossy.rms, glossy.mae):
        assert distance(a, b) == distance(b, a)
    assert glossy.bias(a, b) == -glossy.bias(b, a)
    assert glossy.log_rms(a, b) == pytest.approx(
        glossy.log_rms(b, a), rel=1e-9, abs=tolerances.ROUNDOFF
    )


@given(pairs(), st.randoms(use_true_random=False))
def test_pixels_may_be_in_any_order(pair: tuple[Array, Array], random: Any) -> None:
    a, b = pair
    order = list(range(a.shape[0] * a.shape[1]))
    random.shuffle(order)
    p, q = (v.reshape(-1, 1, v.shape[2])[order] for v in (a, b))
    assert close(glossy.rms(p, q), glossy.rms(a, b))


@given(pairs(), st.data())
def test_a_mask_compares_what_it_keeps(pair: tuple[Array, Array], data: st.DataObject) -> None:
    a, b = pair
    mask = data.draw(hnp.arrays(np.bool_, a.shape[:2]))
    mask[data.draw(st.integers(0, mask.shape[0] - 1)), 0] = True
    spoiled = a.copy()
    spoiled[~mask] = np.nan
    got = glossy.compare(spoiled, b, mask=mask.astype(np.float32))
    expected = naive(a[mask], b[mask])
    for name in ("rms", "mae", "relative_mse", "max_abs"):
        assert close(getattr(got, name), expected[name]), name
    assert got.pixels == int(mask.sum())
    x, y = got.max_at
    assert mask[y, x]


def test_a_mask_over_many_blocks() -> None:
    rng = np.random.default_rng(4)
    a, b = rng.random((2, 700, 500, 3)).astype(np.float32)
    mask = np.zeros((700, 500), dtype=bool)
    mask[300:650, 20:90] = True
    got = glossy.compare(a, b, mask=mask)
    for name, value in naive(a[mask], b[mask]).items():
        assert getattr(got, name) == pytest.approx(value, rel=tolerances.ROUNDOFF, abs=1e-15), name
    d = np.where(mask[..., None], np.abs(a.astype(float) - b), 0.0).max(axis=2)
    y, x = divmod(int(d.argmax()), d.shape[1])
    assert got.max_at == (x, y)


@pytest.mark.parametrize(
    ("scale", "dtype"), [(1e30, np.float32), (1e38, np.float32), (1e200, float), (1e307, float),
                         (1e-30, np.float32), (1e-44, np.float32), (1e-200, float), (1e-300, float)]
)  # fmt: skip
def test_far_from_one(scale: float, dtype: type) -> None:
    rng = np.random.default_rng(6)
    both: list[Array] = [(rng.random((40, 50, 3)) * scale).astype(dtype) for _ in range(2)]
    a, b = both
    got = glossy.compare(a, b)
    down = math.ldexp(1.0, -math.frexp(scale)[1])
    p, q = (v.astype(np.float64) * down for v in (a, b))
    expected = naive(p, q)
    assert got.relative_rms == pytest.approx(expected["relative_rms"], rel=tolerances.ROUNDOFF)
    for name in ("rms", "mae", "max_abs", "bias"):
        got_down = getattr(got, name) * down
        assert got_down == pytest.approx(expected[name], rel=tolerances.ROUNDOFF, abs=1e-14)
    for c, error in enumerate(got.channel_rms):
        one = naive(p[..., c], q[..., c])["rms"]
        assert error * down == pytest.approx(one, rel=tolerances.ROUNDOFF)
    assert got.psnr == pytest.approx(-20 * math.log10(got.rms), rel=tolerances.ROUNDOFF)
    eps = math.sqrt(0.01) * down
    expected_mse = np.mean(((p - q) / np.hypot(q, eps)) ** 2)
    assert got.relative_mse == pytest.approx(expected_mse, rel=1e-11, abs=1e-300)
    logs = [np.log(v.astype(np.float64) + 1e-4) for v in (a, b)]
    expected_log = np.sqrt(np.mean((logs[0] - logs[1]) ** 2))
    assert got.log_rms == pytest.approx(expected_log, rel=1e-9, abs=tolerances.ROUNDOFF)


@pytest.mark.parametrize("error", [1e-140, 1e-170, 1e-300])
def test_the_smallest_differences_beside_large_values(error: float) -> None:
    """Their squares vanish in float64; the figures do not."""
    b = np.zeros((9, 8, 3))
    b[0] = 1000.0
    a = b.copy()
    a[3, 4, 1] = error
    got = glossy.compare(a, b)
    assert not got.identical
    assert got.rms == pytest.approx(error / math.sqrt(b.size), rel=tolerances.ROUNDOFF)
    expected = error / (1000.0 * math.sqrt(8 * 3))
    assert got.relative_rms == pytest.approx(expected, rel=tolerances.ROUNDOFF)
    assert math.isfinite(got.psnr)


def test_one_wrong_pixel_among_many_is_found_and_counted_exactly() -> None:
    """A sum of a million ones and one 1e16: naive summation would lose the ones."""
    a = np.zeros((1000, 1000))
    b = np.ones((1000, 1000))
    a[617, 321] = 1e8 + 1.0
    got = glossy.compare(a, b)
    assert got.max_at == (321, 617)
    assert got.max_abs == 1e8
    assert got.rms**2 * 1e6 == pytest.approx(1e16 + 999_999, rel=1e-15)


@pytest.mark.parametrize("threads", [2, 5])
def test_same_bits_for_any_number_of_threads(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(8)
    a, b = rng.random((2, 900, 800, 3)).astype(np.float32)
    mask = rng.random((900, 800)) > 0.3
    monkeypatch.setattr(_sweep, "_processors", lambda: 1)
    serial, masked = glossy.compare(a, b), glossy.compare(a, b, mask=mask)
    monkeypatch.setattr(_sweep, "_processors", lambda: threads)
    assert glossy.compare(a, b) == serial
    assert glossy.compare(a, b, mask=mask) == masked


@given(
    pairs(),
    st.floats(0.0, 10.0),
    st.floats(0.0, 2.0),
    st.lists(st.floats(0.0, 100.0), min_size=1, max_size=4),
    st.data(),
)
def test_outliers_and_percentiles_of_pixels(
    pair: tuple[Array, Array], x: float, r: float, wanted: list[float], data: st.DataObject
) -> None:
    a, b = (v.astype(float) for v in pair)
    mask = data.draw(hnp.arrays(np.bool_, a.shape[:2]))
    mask[0, data.draw(st.integers(0, mask.shape[1] - 1))] = True
    spoiled = pair[0].copy()
    spoiled[~mask] = np.nan
    got = glossy.compare(
        spoiled, pair[1], mask=mask, max_difference=x, max_relative_difference=r, percentiles=wanted
    )
    d = np.abs(a - b)[mask]
    assert got.outliers == int((d - r * np.abs(b[mask]) > x).any(axis=1).sum())
    assert got.outlier_share == got.outliers / got.pixels
    assert (got.max_difference, got.max_relative_difference) == (x, r)
    largest = d.max(axis=1)
    assert got.percentiles is not None
    for (p, value), q in zip(got.percentiles, wanted, strict=True):
        assert p == q
        assert value in largest
        n = largest.size
        assert Fraction(repr(p)) * n <= 100 * int((largest <= value).sum())
        assert value == largest.min() or 100 * int((largest < value).sum()) < Fraction(repr(p)) * n
    assert next(iter(got.to_dict()["percentiles"].values())) == got.percentiles[0][1]


def test_figures_of_pixels_over_many_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(14)
    a, b = rng.random((2, 600, 400, 3)).astype(np.float32)
    d = np.abs(a.astype(float) - b).max(axis=2)
    mask = np.zeros(d.shape, dtype=bool)
    mask[200:210, 5:90] = True
    for threads in (1, 3):
        monkeypatch.setattr(_sweep, "_processors", lambda n=threads: n)
        for kept in (None, mask):
            seen = d.ravel() if kept is None else d[kept]
            got = glossy.compare(a, b, mask=kept, max_difference=0.6, percentiles=[50])
            assert got.outliers == int((seen > 0.6).sum())
            assert got.percentiles == ((50, np.sort(seen)[seen.size // 2 - 1]),)


def test_outliers_beyond_the_range_of_floats() -> None:
    a, b = np.full((2, 3), 1.7e308), np.full((2, 3), -1.7e308)
    got = glossy.compare(a, b, max_relative_difference=1.5, percentiles=[50])
    assert got.outliers == 6
    assert got.to_dict()["percentiles"] == {"50": None}
    assert glossy.compare(b, b, max_relative_difference=1.5).outliers == 0


def test_figures_of_pixels_are_there_on_request() -> None:
    got = glossy.compare(ONES, 0 * ONES)
    assert (got.outliers, got.outlier_share, got.percentiles, got.max_difference) == (None,) * 4
    assert glossy.compare(ONES, 0 * ONES, percentiles=[]).percentiles == ()


@given(st.floats(1e-3, 1e3), st.floats(1e-6, 1e3))
def test_psnr_states_its_peak(peak: float, offset: float) -> None:
    b = np.zeros((4, 5, 3))
    assert glossy.psnr(b + offset, b, peak) == pytest.approx(
        20 * math.log10(peak / offset), abs=1e-9
    )
    got = glossy.compare(b + offset, b, peak=peak)
    assert (got.psnr, got.peak) == (glossy.psnr(b + offset, b, peak), peak)


def test_a_black_reference() -> None:
    a, b = np.full((3, 4), 0.5), np.zeros((3, 4))
    got = glossy.compare(a, b)
    assert math.isinf(got.relative_rms)
    assert got.to_dict()["relative_rms"] is None
    assert glossy.compare(b, b).relative_rms == 0.0


def test_dictionary_has_the_fields_and_is_json() -> None:
    got = glossy.compare(np.ones((3, 4, 3)), np.full((3, 4, 3), 0.5))
    out = json.loads(json.dumps(got.to_dict(), allow_nan=False))
    names = [f.name for f in dataclasses.fields(metrics.Comparison)]
    assert list(out) == ["schema", *names]
    assert out["schema"] == 1
    assert out["max_at"] == [0, 0]
    assert out["channels"] == ["R", "G", "B"]


ONES = np.ones((4, 5, 3))


def spoiled(value: float, *places: tuple[int, int, int]) -> Array:
    out = ONES.copy()
    for place in places:
        out[place] = value
    return out


@pytest.mark.parametrize(
    ("a", "b", "options", "message"),
    [
        (spoiled(np.nan, (2, 3, 1), (3, 0, 0)), ONES, {},
         r"a: must be finite, got 2 NaN or inf values, the first at x=3, y=2, channel G"),
        (ONES, spoiled(np.inf, (0, 4, 2)), {}, r"b: must be finite, got 1 .* x=4, y=0, channel B"),
        (spoiled(np.inf, (1, 1, 0)), spoiled(np.inf, (1, 1, 0)), {}, r"a: must be finite, got 1"),
        (ONES, ONES[:, :4], {}, r"a, b: must have one shape, got \[\(4, 5, 3\), \(4, 4, 3\)\]"),
        (ONES, ONES[..., :1], {}, "one shape"),
        (np.ones(3), np.ones(3), {}, r"a: must have shape \(H, W\)"),
        (np.ones((0, 3)), np.ones((0, 3)), {}, "with values"),
        (ONES * 1j, ONES, {}, "a: must be an array of real numbers"),
        ([[1, 2], [3]], ONES, {}, "a: must be an array of real numbers"),
        ("text", ONES, {}, "a: must be an array of real numbers"),
        (ONES, ONES, {"peak": 0.0}, "peak"),
        (ONES, ONES, {"peak": np.nan}, "peak"),
        (ONES, ONES, {"mask": np.ones((5, 4))}, r"mask: must have shape \(4, 5\)"),
        (ONES, ONES, {"mask": np.zeros((4, 5))}, "mask: must keep a pixel"),
        (ONES, ONES, {"mask": np.full((4, 5), np.nan)}, "mask: must not hold NaN"),
        (ONES, ONES, {"channels": ("R", "G")}, "channels: must be 3 different names"),
        (ONES, ONES, {"log_epsilon": 0.0}, "log_epsilon"),
        (ONES, ONES, {"relative_epsilon": -1.0}, "relative_epsilon"),
        (ONES, ONES, {"max_difference": -1.0}, "max_difference"),
        (ONES, ONES, {"max_relative_difference": np.inf}, "max_relative_difference"),
        (ONES, ONES, {"percentiles": [50, 100.5]}, r"percentiles: must be in \[0, 100\]"),
        (ONES, ONES, {"flip": "sdr"}, "flip: must be one of ldr, hdr"),
        (ONES, ONES, {"flip": True, "mask": np.ones((4, 5))}, "flip: .*without mask"),
    ],
)  # fmt: skip
def test_refusals(a: Any, b: Any, options: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        glossy.compare(a, b, **options)
    assert "\n" not in str(caught.value)


def flip_pair() -> tuple[Array, Array]:
    rng = np.random.default_rng(9)
    y, x = np.mgrid[0:40, 0:60]
    b = np.stack([0.5 + 0.4 * np.sin(x / 9), 0.5 + 0.4 * np.cos(y / 7), x / 60], axis=-1)
    return np.clip(b + 0.1 * rng.standard_normal(b.shape), 0.0, 1.0), b


@pytest.mark.parametrize("kind", ["ldr", "hdr"])
def test_flip_is_the_mean_of_its_error_map(kind: str) -> None:
    import flip_evaluator

    a, b = flip_pair()
    error_map, _, _ = flip_evaluator.evaluate(
        b.astype(np.float32), a.astype(np.float32), kind.upper(), inputsRGB=False, applyMagma=False
    )
    got = glossy.compare(a, b, flip=kind)
    assert got.flip == pytest.approx(error_map.mean(), rel=1e-5)
    assert got.flip is not None
    assert 0.01 < got.flip < 1.0
    assert got.flip_kind == kind
    assert glossy.compare(b, b, flip=kind).flip == 0.0
    assert glossy.compare(a, b).flip is None


def test_flip_takes_hdr_by_default_and_grey_images() -> None:
    a, b = flip_pair()
    got = glossy.compare(5 * a, 5 * b, flip=True)
    assert got.flip_kind == "hdr"
    grey = glossy.compare(a[..., 0], b[..., 0], flip="ldr").flip
    assert grey == glossy.compare(a[..., [0] * 3], b[..., [0] * 3], flip="ldr").flip


@pytest.mark.parametrize(
    ("a", "b", "kind", "message"),
    [
        (ONES, 2 * ONES, "ldr", r"b: must be in \[0, 1\] for LDR-FLIP"),
        (ONES, 0 * ONES, "hdr", "b: is black: HDR-FLIP"),
        (ONES, 1e-9 * ONES, "hdr", "b: is black: HDR-FLIP"),
        (ONES, 1e35 * ONES, "hdr", "b: must be at most"),
        (ONES[..., :2], ONES[..., :2], "ldr", "flip: takes one or three channels"),
    ],
)
def test_flip_never_ends_the_process(a: Array, b: Array, kind: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        glossy.compare(a, b, flip=kind)


def test_hdr_flip_of_a_mostly_black_reference() -> None:
    """The program would call exit() on some; in a process of its own this shows."""
    code = (
        "import numpy as np, glossy\n"
        "a = np.full((20, 20, 3), 0.5); a[:12] = 0; b = a * 1.1; b[0] = -1\n"
        "low = glossy.compare(a * 3e-6, b * 3e-6, flip=True).flip\n"
        "print(glossy.compare(a, b, flip=True).flip, low)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr + done.stdout
    assert all(0.0 <= float(v) <= 1.0 for v in done.stdout.split())


def test_flip_not_installed_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(ValueError, match=r"pip install glossy-envmap\[flip\]"):
        _flip.flip_error([ONES[..., 0]], [ONES[..., 0]], "ldr")


# difference pictures ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "up"),
    [(0.0, 1.0), (0.3, 0.5), (0.5, 0.5), (0.51, 1.0), (1.0, 1.0), (7e-9, 1e-8), (2.1e7, 5e7)],
)
def test_scale_ends_are_round(value: float, up: float) -> None:
    assert difference.round_up(value) == up


def test_difference_keeps_the_channel_that_differs_most() -> None:
    a = np.array([[[1.0, 2.0, 3.0], [0.0, 0.0, 5.0]]])
    b = np.array([[[1.5, 1.9, 3.1], [0.0, 0.0, 4.0]]])
    d = difference.difference([a[..., c] for c in range(3)], [b[..., c] for c in range(3)])
    np.testing.assert_array_equal(d, np.array([[-0.5, 1.0]], dtype=np.float32))


def luminance(pixels: Array) -> Array:
    return np.asarray(pixels @ np.array([0.2126, 0.7152, 0.0722]))


def test_picture_grows_brighter_with_the_difference_up_to_its_limit() -> None:
    b = np.zeros((300, 101))
    a = np.broadcast_to(np.linspace(0.0, 1.0, 101), b.shape)
    picture = glossy.difference_picture(a, b, limit=0.5)
    assert picture.shape[0] == 300
    assert picture.shape[1] > 101  # the legend
    row = luminance(picture[150, :101].astype(float))
    assert (np.diff(row[:51]) > 0).all()
    assert (picture[150, 51:101] == picture[150, 101 - 1]).all()
    assert luminance(picture[0, 0].astype(float)) < 10
    legend = picture[:, 101:]
    assert len(np.unique(legend.reshape(-1, 3), axis=0)) > 200  # the colour bar and its text


def test_signed_picture_is_blue_below_white_between_and_red_above() -> None:
    b = np.ones((256, 3, 3))
    a = b + np.array([-0.1, 0.0, 0.1])[:, None]
    row = glossy.difference_picture(a, b, signed=True)[100, :3].astype(int)
    assert row[0, 2] > row[0, 0] + 50
    assert row[1].min() > 240
    assert row[2, 0] > row[2, 2] + 50


def test_small_pictures_are_enlarged_exactly() -> None:
    rng = np.random.default_rng(2)
    a, b = rng.random((2, 8, 6, 3))
    picture = glossy.difference_picture(a, b, limit=1.0)
    assert picture.shape[0] == 256
    blocks = picture[:, : 6 * 32].reshape(8, 32, 6, 32, 3)
    assert (blocks == blocks[:, :1, :, :1]).all()


def test_one_outlier_does_not_blacken_the_picture() -> None:
    b = np.zeros((200, 200))
    a = np.full((200, 200), 0.01)
    a[3, 4] = 1000.0
    picture = glossy.difference_picture(a, b)
    assert luminance(picture[100, 100].astype(float)) > 200


@pytest.mark.parametrize(
    ("a", "b", "options", "message"),
    [
        (ONES, ONES[:2], {}, "one shape"),
        (spoiled(np.nan, (0, 0, 0)), ONES, {}, "finite"),
        (ONES, ONES, {"limit": 0.0}, "limit"),
    ],
)
def test_picture_refusals(a: Array, b: Array, options: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        glossy.difference_picture(a, b, **options)
