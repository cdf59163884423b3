"""Difference pictures at the ends of what they are given: masks, sizes, magnitudes."""

from typing import Any

import numpy as np
import pytest

import glossy
from glossy import difference, image_write

Array = np.ndarray[Any, Any]
RNG = np.random.default_rng(12)


def planes(v: Array) -> list[Array]:
    return [v[..., c] for c in range(v.shape[2])]


@pytest.mark.parametrize("signed", [False, True])
def test_equal_images_are_one_colour_with_a_legend(signed: bool) -> None:
    a = RNG.random((260, 300, 3))
    picture = glossy.difference_picture(a, a, signed=signed)
    shown, legend = picture[:, :300], picture[:, 300:]
    assert (shown == shown[0, 0]).all()
    assert len(np.unique(legend.reshape(-1, 3), axis=0)) > 200
    assert (legend == 255).all(axis=2).mean() > 0.4


@pytest.mark.parametrize("signed", [False, True])
def test_pixels_outside_a_mask_are_grey_and_do_not_count(signed: bool) -> None:
    b = RNG.random((256, 300, 3)).astype(np.float32)
    a = b + np.float32(0.25)
    mask = np.zeros((256, 300), dtype=bool)
    mask[10:40, 20:90] = True
    spoiled = a.copy()
    spoiled[~mask] = RNG.choice([np.nan, np.inf, 1e30], (int((~mask).sum()), 3))
    picture = difference.planes_picture(planes(spoiled), planes(b), mask=mask, signed=signed)
    whole = glossy.difference_picture(a, b, signed=signed)
    np.testing.assert_array_equal(picture[10:40, 20:90], whole[10:40, 20:90])
    assert (picture[:, :300][~mask] == difference.OUTSIDE).all()
    np.testing.assert_array_equal(picture[:, 300:], whole[:, 300:])  # the scale, too
    with pytest.raises(ValueError, match="a - b: must be finite"):
        difference.planes_picture(planes(spoiled), planes(b))


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("size", [1e-40, 1e-30, 1e30, 1e38])
def test_any_magnitude_has_its_scale(size: float, signed: bool) -> None:
    """Even where the reciprocal of the limit leaves single precision."""
    one = np.array([[0.0, 0.25, 1.0, 2.0]])
    unit, row = (
        glossy.difference_picture(s * one, 0 * one, limit=s, signed=signed)[:, : 4 * 256]
        for s in (1.0, size)
    )
    np.testing.assert_array_equal(row, unit)
    free = glossy.difference_picture(size * one, 0 * one, signed=signed)
    assert len(np.unique(free[0, : 4 * 256], axis=0)) == 4


def test_a_limit_below_single_precision_is_a_limit() -> None:
    picture = glossy.difference_picture([[0.0, 1.0]], [[0.0, 0.0]], limit=1e-300)
    assert (picture[0, 0] != picture[0, 256]).any()


@pytest.mark.parametrize(
    ("shape", "expected"),
    [((1, 9000), (256, 9000)), ((5000, 3), (5000, 3)), ((3, 2000), (256, 4000))],
)
def test_the_longest_and_the_widest(shape: tuple[int, int], expected: tuple[int, int]) -> None:
    """Enlarged no further than can be looked at; what is missing is white."""
    a = RNG.random(shape)
    picture = glossy.difference_picture(a, 0 * a)
    assert picture.shape[0] == expected[0]
    assert expected[1] + 64 < picture.shape[1] < expected[1] + 1000
    factor = expected[1] // shape[1]
    assert (picture[shape[0] * factor :, : expected[1]] == 255).all()


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, np.uint8, np.uint32])
def test_planes_of_any_type(dtype: type) -> None:
    a: Array = RNG.integers(0, 100, (20, 30, 3)).astype(dtype)
    b: Array = RNG.integers(0, 100, (20, 30, 3)).astype(dtype)
    d = a.astype(float) - b.astype(float)
    spot = np.abs(d).argmax(axis=2)[..., None]
    got = difference.difference(planes(a), planes(b))
    np.testing.assert_array_equal(np.abs(got), np.abs(d).max(axis=2))
    np.testing.assert_array_equal(got, np.take_along_axis(d, spot, axis=2)[..., 0])


@pytest.mark.parametrize(("signed", "name"), [(False, "inferno"), (True, "RdBu_r")])
def test_each_step_of_the_scale_has_its_colour_of_the_map(signed: bool, name: str) -> None:
    """256 even steps from one end of the scale to the other are the 256 colours, in order."""
    from matplotlib import colormaps

    low = -3.0 if signed else 0.0
    d = np.linspace(low, 3.0, 256, dtype=np.float32)[None]
    picture = glossy.difference_picture(d, 0 * d, signed=signed, limit=3.0)
    factor = 4096 // 256
    table = colormaps[name](np.arange(256), bytes=True)[:, :3]
    np.testing.assert_array_equal(picture[0, : 256 * factor : factor], table)


def test_legend_tells_its_two_kinds_and_limits_apart() -> None:
    a = RNG.random((256, 64))
    legends = [
        glossy.difference_picture(a, 0 * a, **options)[:, 64:].tobytes()
        for options in ({}, {"signed": True}, {"limit": 0.5}, {"unit": "cd/m2"})
    ]
    assert len(set(legends)) == 4
    assert glossy.difference_picture(a, 0 * a)[:, 64:].tobytes() == legends[0]


def test_the_picture_is_what_the_writer_takes(tmp_path: Any) -> None:
    picture = glossy.difference_picture(RNG.random((30, 40)), np.zeros((30, 40)))
    image_write.write_png(tmp_path / "d.png", picture)
    read = glossy.read_image(tmp_path / "d.png", encoding="linear").pixels
    np.testing.assert_array_equal(np.rint(read * 255), picture)
