"""Ring, line, several rings and the blend, against the thesis's own formulas and examples."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import glossy

Float64Array = npt.NDArray[np.float64]

ROUNDED = 1e-9


def by_the_book(
    pairs: list[tuple[float, float]], mx: float, my: float, xi0: float = 0.01
) -> Float64Array:
    """Eqs. 4.10-4.13 for pairs (xi1, xi2), phi in its own quadrant."""
    out = []
    for xi1, xi2 in pairs:
        phi = math.atan2(my * math.sin(2 * math.pi * xi2), mx * math.cos(2 * math.pi * xi2))
        slope = math.cos(phi) ** 2 / mx**2 + math.sin(phi) ** 2 / my**2
        theta = (1 - xi1) * math.atan(math.sqrt(-math.log(xi0) / slope))
        out.append(
            (
                math.sin(theta) * math.cos(phi),
                math.sin(theta) * math.sin(phi),
                math.cos(theta),
            )
        )
    return np.array(out)


@pytest.mark.parametrize("mx", [0.3, 0.2])
def test_ring(mx: float) -> None:
    pairs = [(1.0, 0.0), *((0.6, k / 6) for k in range(6))]
    own = glossy.thesis_pattern((mx, 0.3), 7, "ring")
    assert np.allclose(own.half_vectors, by_the_book(pairs, mx, 0.3), atol=ROUNDED)
    assert (own.spacing, own.circles, own.threshold, own.method) == ("ring", 1, 0.01, "thesis")


@pytest.mark.parametrize("widths", [(0.01, 0.14), (0.14, 0.01)])
def test_line_of_five_is_the_thesis_example(widths: tuple[float, float]) -> None:
    a = 0.25 if widths[0] < widths[1] else 0.0
    pairs = [(0.2, a), (0.6, a), (1.0, a + 0.5), (0.6, a + 0.5), (0.2, a + 0.5)]
    own = glossy.thesis_pattern(glossy.Lobe(*widths), 5)
    assert own.spacing == "line"
    assert np.allclose(own.half_vectors, by_the_book(pairs, *widths), atol=ROUNDED)
    across = own.half_vectors[:, 0 if a else 1]
    assert np.array_equal(across, np.zeros(5))


def test_even_lines_are_evenly_spaced() -> None:
    theta = np.arcsin(glossy.thesis_pattern((0.3, 0.01), 6, "line").half_vectors[:, 0])
    assert np.allclose(np.diff(theta), theta[1] - theta[0], atol=ROUNDED)
    assert np.allclose(theta, -theta[::-1], atol=ROUNDED)


def test_ten_in_three_rings_of_three() -> None:
    """One in the middle; the radii average to that of the single ring."""
    own = glossy.thesis_pattern((0.1, 0.1), 10, "multi-ring")
    theta = np.arccos(own.half_vectors[:, 2])
    border = math.atan(math.sqrt(-math.log(0.01)) * 0.1)
    assert np.allclose(np.sort(theta) / border, [0.0] + 3 * [0.2] + 3 * [0.4] + 3 * [0.6])
    single = glossy.thesis_pattern((0.1, 0.1), 10, "ring").half_vectors
    assert np.arccos(single[1:, 2]).mean() == pytest.approx(theta[1:].mean())
    assert np.allclose(own.half_vectors[:, :2].sum(axis=0), 0.0, atol=ROUNDED)
    assert (own.spacing, own.circles) == ("multi-ring", 3)


def as_set(pattern: glossy.Pattern) -> Float64Array:
    h = np.round(pattern.half_vectors, 9) + 0.0
    return np.asarray(h[np.lexsort(h.T)])


@pytest.mark.parametrize("flip", [False, True])
def test_choice_by_anisotropy_and_the_ends_of_the_blend(flip: bool) -> None:
    for ratio, auto, blend in ((1.0, "ring", "ring"), (0.85, "ring", "ring"), (0.41, "ring", None),
                               (0.39, "line", None), (0.19, "line", "line")):  # fmt: skip
        widths = (0.2 * ratio, 0.2) if flip else (0.2, 0.2 * ratio)
        assert glossy.thesis_pattern(widths, 9).spacing == auto
        if blend:
            mixed, pure = (glossy.thesis_pattern(widths, 9, k) for k in ("blend", blend))
            assert np.array_equal(as_set(mixed), as_set(pure))
    assert glossy.thesis_pattern((0.2, 0.1), 9, anisotropy=0.6).spacing == "line"


@given(
    st.floats(0.01, 1.0), st.floats(0.02, 1.0), st.integers(1, 25), st.booleans(),
    st.sampled_from([0.05, 0.4, 1.0]),
)  # fmt: skip
def test_the_blend_is_smooth(
    wide: float, ratio: float, n: int, flip: bool, anisotropy: float
) -> None:
    """A change of the widths by 1e-6 moves no half vector by more than some of it."""
    found = []
    for r in (ratio, min(ratio * (1.0 + 1e-6), 1.0)):
        widths = (wide * r, wide) if flip else (wide, wide * r)
        found.append(glossy.thesis_pattern(widths, n, "blend", anisotropy=anisotropy).half_vectors)
    assert np.abs(found[0] - found[1]).max() < 1e-5


@given(
    st.floats(1e-5, 10.0), st.floats(1e-5, 10.0), st.integers(1, 60),
    st.sampled_from(["auto", "ring", "line", "multi-ring", "blend"]), st.floats(1e-6, 0.99),
)  # fmt: skip
def test_every_sample_is_inside_the_border(
    mx: float, my: float, n: int, kind: str, xi0: float
) -> None:
    own = glossy.thesis_pattern((mx, my), n, kind, xi0)
    h = own.half_vectors
    assert len(own) == n
    q = (h[:, 0] / h[:, 2] / mx) ** 2 + (h[:, 1] / h[:, 2] / my) ** 2
    assert np.all(np.exp(-q) >= xi0 * (1.0 - 1e-6))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "square"}, "kind: must be one of auto, ring, line, multi-ring, blend"),
        ({"samples": 0}, "samples: "),
        ({"anisotropy": 0.0}, "anisotropy: "),
        ({"radius": 0.4}, "radius: "),
        ({"rings": 0}, "rings: "),
        ({"threshold": 0.0}, "threshold: "),
        ({"lobe": (0.0, 1.0)}, "mx: "),
    ],
)
def test_bad_arguments_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        glossy.thesis_pattern(**{"lobe": (0.1, 0.1), **change})
