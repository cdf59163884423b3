"""Progressive refinement: the estimate is the reference's, the display the better of two."""

import json
import math
import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import rooms
from hypothesis import given
from hypothesis import strategies as st
from plain_truth import points

import glossy
from glossy import Lobe, Material
from glossy.cli import main
from glossy.converge import Limits, blend
from glossy.image import read_planes

Array = npt.NDArray[np.float64]

MATERIAL = Material(0.2, [Lobe(0.3, r0=0.5)])


def states(**options: Any) -> list[glossy.Convergence]:
    cube = glossy.environment("spots", size=16)
    p = points(1, 24)
    given = {"irradiance": glossy.irradiance(cube, p.normal), "samples": 9}
    pyramid = glossy.build_pyramid(cube)
    return list(glossy.converge(p, MATERIAL, pyramid, cube, options=given, **options))


def test_the_first_state_is_the_real_time_picture_and_no_other_contains_it() -> None:
    """The estimates are those of the one-shot reference, whatever picture was shown before."""
    cube, p = glossy.environment("spots", size=16), points(1, 24)
    light = glossy.irradiance(cube, p.normal)
    shown = glossy.shade(p, MATERIAL, glossy.build_pyramid(cube), samples=9, irradiance=light)
    found = states(passes=4, seed=5)
    np.testing.assert_array_equal(found[0].display, shown.astype(np.float64))
    assert [s.passes for s in found] == [0, 1, 2, 3, 4]
    for state in found[1:]:
        truth = glossy.reference(p, MATERIAL, cube, "qmc", state.samples, seed=5)
        np.testing.assert_array_equal(state.estimate, truth.radiance)
        np.testing.assert_array_equal(state.error, truth.error)
        gap = state.estimate - found[0].display
        expected = found[0].display + state.weight[:, None] * gap
        np.testing.assert_allclose(state.display, expected, rtol=1e-12)


def test_the_error_falls_and_the_display_follows_the_better_picture() -> None:
    cube, p = glossy.environment("spots", size=16), points(1, 24)
    truth = glossy.reference(p, MATERIAL, cube).radiance
    found = states(passes=7)
    errors = [s.relative_error for s in found]
    assert errors[0] == math.inf
    assert errors[-1] < 0.25 * errors[1]
    shown = glossy.rms(found[0].display, truth)
    for state in found[1:]:
        own = glossy.rms(state.estimate, truth)
        assert glossy.rms(state.display, truth) < 1.3 * min(shown, own)
    weights = [float(s.weight.mean()) for s in found]
    assert weights[0] == 0.0
    assert weights[-1] > 0.7
    assert weights[-1] > weights[1]


def test_limits_stop_it() -> None:
    reached = states(target_error=0.1)
    assert reached[-1].relative_error <= 0.1 < reached[-2].relative_error
    assert len(states(time_limit=1e-6)) == 2  # one pass is always made
    assert [s.samples for s in states(samples=200)][-1] >= 200


@given(st.integers(0, 10**6))
def test_the_rule_lies_between_the_pictures_and_keeps_the_quieter_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, e, sigma = rng.uniform(0.0, 2.0, (3, 5, 3))
    display, weight = blend(a, e, sigma)
    assert np.all((weight >= 0.0) & (weight <= 1.0))
    assert np.all(display <= np.maximum(a, e) + 1e-12)
    assert np.all(display >= np.minimum(a, e) - 1e-12)
    for k in range(5):
        noise, apart = float(sigma[k] @ sigma[k]), float((e - a)[k] @ (e - a)[k])
        assert weight[k] == pytest.approx(max(0.0, 1.0 - noise / apart))


def test_without_noise_the_estimate_is_shown_and_without_a_gap_the_picture() -> None:
    a, e = np.ones((2, 3)), np.array([[2.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
    np.testing.assert_array_equal(blend(a, e, np.zeros((2, 3)))[0], e)
    display, weight = blend(a, e, np.full((2, 3), 0.5))
    np.testing.assert_allclose(weight, [0.25, 0.0])
    np.testing.assert_allclose(display[1], a[1])


def test_the_rule_is_better_than_either_picture_where_they_are_equally_good() -> None:
    """Pictures of independent errors of one size: the mean square of the display is the least."""
    rng = np.random.default_rng(0)
    truth = np.zeros((20000, 3))
    a, e = truth + rng.normal(0.0, 0.1, truth.shape), truth + rng.normal(0.0, 0.1, truth.shape)
    display, _ = blend(a, e, np.full(truth.shape, 0.1))
    assert glossy.rms(display, truth) < 0.09


def test_bounding_planes_are_in_both_pictures() -> None:
    cube = rooms.capture(16)
    p = rooms.sphere_points(10, 1)
    lobe, planes = Lobe(0.2), rooms.planes()
    pyramid = glossy.build_pyramid(cube)
    *_, last = glossy.converge(p, lobe, pyramid, cube, passes=3, parallax=planes)
    truth = glossy.reference(p, lobe, cube, "qmc", last.samples, parallax=planes)
    np.testing.assert_array_equal(last.estimate, truth.radiance)
    shown = next(glossy.converge(p, lobe, pyramid, cube, passes=3, parallax=planes)).display
    np.testing.assert_array_equal(shown, glossy.shade(p, lobe, pyramid, parallax=planes))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"target_error": 0.0}, "target_error: must be in"),
        ({"time": -1.0}, "time: must be in"),
        ({"passes": 0}, "passes: must be at least 1"),
    ],
)
def test_bad_limits_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Limits(**values)


# --- the command ----------------------------------------------------------------------------------

SMALL = ["--width", "10", "--height", "10", "--size", "16", "--material", "mx=.3,kd=.1"]


def test_render_converge_writes_display_estimate_and_error(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, truth = str(tmp_path / "out.exr"), str(tmp_path / "truth.exr")
    assert main(["render", *SMALL, "--converge", "--passes", "3", "--json", "-o", out]) == 0
    said = json.loads(capsys.readouterr().out)
    assert [row["passes"] for row in said["states"]] == [0, 1, 2, 3]
    assert said["states"][0]["relative_error"] is None
    assert said["relative_error"] == said["states"][-1]["relative_error"]
    samples = ["--estimator", "qmc", "--samples", str(said["samples"])]
    assert main(["reference", *SMALL, *samples, "--background", "black", "-o", truth]) == 0
    image, expected = read_planes(out), read_planes(truth)
    assert {f"{p}.{c}" for p in ("estimate", "error") for c in "RGB"} < set(image.planes)
    for name in "RGB":
        np.testing.assert_array_equal(image.planes[f"estimate.{name}"], expected.planes[name])


def test_render_converge_speaks_of_each_pass_and_exposes_all_alike(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.png"
    assert main(["render", *SMALL, "--converge", "--passes", "2", "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "real-time picture after" in said
    assert "pass 2: 256 samples a point, relative standard error" in said
    assert "exposure:" in said
    assert [f.name for f in tmp_path.iterdir()] == ["out.png"]


def test_limits_without_converge_are_refused(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["render", "--passes", "2", "-o", str(tmp_path / "x.exr")]) == 2
    assert "--passes: has a meaning with --converge only" in capsys.readouterr().err
