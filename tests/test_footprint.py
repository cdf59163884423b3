"""Texels per sample: closed forms against the sources' own words."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glossy.footprint import border_sines, lobe_area
from glossy.frames import reflect, spherical

widths = st.floats(1e-3, 0.4)
cosines = st.floats(0.01, 1.0)
azimuths = st.floats(0.0, 6.28)


@given(widths, widths, cosines, azimuths, st.floats(0.05, 0.9))
def test_area_is_the_ellipse_of_the_reflected_border(
    mx: float, my: float, cos_o: float, phi: float, threshold: float
) -> None:
    """Reflect the border half vectors and take arccos, tan and pi u v, as the paper says."""
    wo = spherical(math.acos(cos_o), phi)
    reach = math.sqrt(-math.log(threshold))
    centre = reflect(wo, [0.0, 0.0, 1.0])
    angles = []
    for m, azimuth in ((mx, 0.0), (my, 0.5 * math.pi)):
        border = reflect(wo, spherical(math.atan(reach * m), azimuth))
        # the paper's arccos loses digits at small angles; the chord does not
        angles.append(2.0 * math.asin(min(1.0, 0.5 * float(np.linalg.norm(border - centre)))))
    if max(angles) < 0.5 * math.pi:
        expected = min(math.pi * math.tan(angles[0]) * math.tan(angles[1]), 2.0 * math.pi)
    else:
        expected = 2.0 * math.pi
    assert float(lobe_area(mx, my, wo, threshold)) == pytest.approx(expected, rel=1e-7)


def test_area_is_continuous_and_bounded_where_the_tangent_blows_up() -> None:
    """At normal view the angle is twice theta: 90 degrees at sqrt(-ln xi) m = 1."""
    m = np.linspace(0.3, 2.0, 2000)
    areas = np.array([float(lobe_area(a, a, [0, 0, 1.0], 0.01)) for a in m])
    assert np.all(np.isfinite(areas))
    assert np.all(np.diff(areas) >= 0.0)
    assert np.abs(np.diff(areas)).max() < 0.05
    assert areas[-1] == 2.0 * math.pi


@pytest.mark.parametrize("threshold", [0.0, 1.0, -0.1, math.nan, "low"])
def test_threshold_out_of_range_is_refused(threshold: object) -> None:
    with pytest.raises(ValueError, match="threshold: must be"):
        border_sines(0.1, 0.1, threshold)  # type: ignore[arg-type]
