"""The trace is the pixel: its samples add up to what ``shade`` returns."""

import json

import numpy as np
import pytest
from test_shading import LOBES, bright_cube, random_points

import glossy

MATERIAL = glossy.Material(
    reflection=[LOBES["fresnel"], LOBES["aniso"]], transmission=[glossy.Lobe(0.2, 0.1, r0=0.3)]
)


@pytest.mark.parametrize("method", ["regular", "importance"])
@pytest.mark.parametrize("precision", ["single", "double"])
def test_samples_add_up_to_the_pixel(method: str, precision: str) -> None:
    points, pyramid = random_points(6), glossy.build_pyramid(bright_cube())
    picture = glossy.shade(points, MATERIAL, pyramid, method, precision=precision, samples=14)
    for i in range(6):
        trace = glossy.trace(points[i], MATERIAL, pyramid, method, precision, samples=14)
        assert np.allclose(trace.radiance, picture[i], rtol=0, atol=0)
        assert np.allclose(trace.tap_sum, picture[i], rtol=2e-6 if precision == "single" else 1e-13)


@pytest.mark.parametrize("method", ["regular", "importance"])
def test_each_sample_states_the_brdf_and_the_density_it_used(method: str) -> None:
    points, pyramid = random_points(4), glossy.build_pyramid(bright_cube(16))
    lobe = LOBES["fresnel"]
    material = glossy.Material(reflection=[lobe])
    for i in range(4):
        trace = glossy.trace(points[i], material, pyramid, method, "double", samples=14)
        kept = [tap for tap in trace.taps if tap.kept]
        assert len(kept) > 3
        for tap in kept:
            assert np.allclose(tap.brdf, material.eval(tap.wi_local, trace.view_local), rtol=1e-9)
            direct = np.array(tap.brdf) * tap.cos_i / (len(trace.taps) * tap.pdf_wi)
            assert np.allclose(tap.weight, direct, rtol=1e-12)
            looked_up = pyramid.sample(tap.wi, tap.level, precision="double")
            assert np.allclose(tap.radiance, looked_up, rtol=1e-12)
            if method == "importance":
                assert tap.pdf_wi == pytest.approx(
                    float(lobe.pdf(tap.wi_local, trace.view_local)), rel=1e-9
                )


def test_dropped_samples_are_listed() -> None:
    grazing = glossy.SurfacePoints([0, 0, 1.0], [1.0, 0, 0], [0.995, 0, 0.0998])
    pyramid = glossy.build_pyramid(bright_cube(16))
    trace = glossy.trace(grazing, glossy.Lobe(0.3), pyramid, samples=30)
    dropped = [tap for tap in trace.taps if not tap.kept]
    assert dropped
    assert all(tap.contribution == (0.0, 0.0, 0.0) for tap in dropped)
    assert "below the horizon" in trace.format_table()


@pytest.mark.parametrize("method", ["regular", "thesis", "lattice", "auto"])
def test_a_trace_prints_as_its_table(method: str) -> None:
    pyramid = glossy.build_pyramid(bright_cube(16))
    options = {"max_error": 0.3} if method == "auto" else {"samples": 7}
    trace = glossy.trace(random_points(1), LOBES["iso"], pyramid, method, **options)
    assert str(trace) == trace.format_table()
    pixel = " ".join(f"{v:.7g}" for v in trace.radiance)
    assert repr(trace) == f"<{type(trace).__name__} of {method}: radiance {pixel}>"


def test_trace_becomes_json() -> None:
    pyramid = glossy.build_pyramid(bright_cube(16))
    trace = glossy.trace(random_points(1), LOBES["iso"], pyramid, samples=7)
    data = json.loads(json.dumps(trace.to_dict()))
    assert data["schema"] == 1
    assert len(data["taps"]) == len(trace.taps) == 7
    assert set(data["taps"][0]) >= {"wh", "wi", "texels", "level", "radiance", "brdf", "weight"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"point": random_points(2)}, "point: must be a single point"),
        ({"method": "mc"}, "method: must be one of regular, importance"),
        ({"treshold": 0.1}, "treshold: is no option of method 'regular'"),
    ],
)
def test_bad_requests_are_refused(change: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"point": random_points(1), **change}
    pyramid = glossy.build_pyramid(bright_cube(8))
    with pytest.raises(ValueError, match=message):
        glossy.trace(material=LOBES["iso"], pyramid=pyramid, **arguments)  # type: ignore[arg-type]
