"""Radiance pictures written byte by byte: codings, orders, and what headers do to the values."""

import pathlib
import warnings

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from picture_files import radiance_bytes, rgbe_values

from glossy import image

Bytes = npt.NDArray[np.uint8]

ORDERS = {
    "-Y {} +X {}": lambda p: p,
    "+Y {} +X {}": lambda p: p[::-1],
    "-Y {} -X {}": lambda p: p[:, ::-1],
    "+Y {} -X {}": lambda p: p[::-1, ::-1],
    "+X {} -Y {}": lambda p: p.swapaxes(0, 1),  # scanlines are columns, from the left, top first
    "-X {} -Y {}": lambda p: p.swapaxes(0, 1)[:, ::-1],
    "+X {} +Y {}": lambda p: p.swapaxes(0, 1)[::-1],
    "-X {} +Y {}": lambda p: p.swapaxes(0, 1)[::-1, ::-1],
}


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return tmp_path_factory.mktemp("radiance") / "a.hdr"


def picture(seed: int, lines: int, length: int, values: int) -> Bytes:
    """Quads with runs; normalised, so that no pixel has the mantissas 1, 1, 1 of a repeat."""
    rng = np.random.default_rng(seed)
    quads = rng.integers(0, 256, (values, 4)).astype(np.uint8)
    quads[:, rng.integers(3)] |= 128
    counts = rng.integers(1, 700, lines * length)
    picked = np.repeat(rng.integers(0, values, lines * length), counts)[: lines * length]
    return np.asarray(quads[picked].reshape(lines, length, 4))


@given(
    st.integers(0, 2**32),
    st.integers(1, 4),
    st.sampled_from([1, 7, 8, 40, 700]),
    st.integers(1, 5),
    st.sampled_from(["flat", "old", "new", "mixed"]),
    st.sampled_from(sorted(ORDERS)),
)
def test_every_coding_and_order_reads_as_its_pixels(
    file: pathlib.Path, seed: int, lines: int, length: int, values: int, coding: str, order: str
) -> None:
    if length < 8:  # which the newer coding does not have
        coding = "old"
    quads = picture(seed, lines, length, values)
    file.write_bytes(radiance_bytes(quads, coding=coding, size=order))
    expected = ORDERS[order](rgbe_values(quads))
    np.testing.assert_array_equal(image.read_image(file).pixels, expected)


FACTORS = st.floats(1e-3, 1e3)


@given(st.lists(FACTORS, max_size=3), st.lists(st.tuples(FACTORS, FACTORS, FACTORS), max_size=2))
def test_values_are_divided_by_every_exposure_and_colour_correction(
    file: pathlib.Path, exposures: list[float], corrections: list[tuple[float, float, float]]
) -> None:
    quads = picture(1, 2, 9, 5)
    lines = [f"EXPOSURE={e!r}" for e in exposures]
    lines += [f"COLORCORR= {r!r} {g!r} {b!r}" for r, g, b in corrections]
    file.write_bytes(radiance_bytes(quads, ["FORMAT=32-bit_rle_rgbe", *lines]))
    scale = np.prod([[e] * 3 for e in exposures] + [list(c) for c in corrections] + [[1.0] * 3], 0)
    np.testing.assert_allclose(
        image.read_image(file).pixels, rgbe_values(quads) / scale, rtol=2e-7, atol=1e-44
    )


@pytest.mark.parametrize(
    ("lines", "magic", "end"),
    [
        ((), "#?RADIANCE\n", "\n"),
        (("FORMAT= 32-bit_rle_rgbe",), "#?RADIANCE\n", "\n"),
        (("FORMAT = 32-bit_rle_rgbe ",), "#?RGBE\n", "\n"),
        (("FORMAT=32-bit_rle_rgbe",), "", "\n"),
        (("OWNER=\xa9 M\xfcller", "# = =", "FORMAT=32-bit_rle_rgbe"), "#?RADIANCE\r\n", "\r\n"),
        (("VIEW= -vtv -vp 0 0 0", "X" * 5000), "#?RADIANCE\n", "\n"),
        # of pictures that this one was put together from
        (("a.hdr:", "\tEXPOSURE=2", "\tCOLORCORR=1 2 3", "pcompos a.hdr"), "#?RADIANCE\n", "\n"),
    ],
)
def test_headers_of_other_writers(
    file: pathlib.Path, lines: tuple[str, ...], magic: str, end: str
) -> None:
    quads = picture(2, 3, 8, 4)
    file.write_bytes(radiance_bytes(quads, lines, magic=magic, end=end))
    np.testing.assert_array_equal(image.read_image(file).pixels, rgbe_values(quads))


def test_other_files_that_name_the_format_are_not_taken_for_it(tmp_path: pathlib.Path) -> None:
    data = b"P5\n# FORMAT=32-bit_rle_rgbe\n2 1\n255\nFO"
    (tmp_path / "a.pgm").write_bytes(data)
    pixels = image.read_image(tmp_path / "a.pgm", "linear").pixels
    np.testing.assert_allclose(pixels[0, :, 0] * 255, list(b"FO"), rtol=1e-6)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (radiance_bytes(picture(0, 2, 8, 2), ["FORMAT=32-bit_rle_xyze"]), "pixels are CIE XYZ"),
        (radiance_bytes(picture(0, 2, 8, 2), ["FORMAT=ascii"]), "pixels are 'ascii', only"),
        (radiance_bytes(picture(0, 2, 8, 2), ["EXPOSURE=dark"]), "EXPOSURE must be a positive"),
        (radiance_bytes(picture(0, 2, 8, 2), ["EXPOSURE=0"]), "EXPOSURE must be a positive"),
        (radiance_bytes(picture(0, 2, 8, 2), ["EXPOSURE=1e300"] * 2), "product of its EXPOSURE"),
        (radiance_bytes(picture(0, 2, 8, 2), ["COLORCORR=1 2"]), "COLORCORR must be 3 positive"),
        (radiance_bytes(picture(0, 2, 8, 2), size="-Y {} +Y {}"), "without a line such as"),
        (radiance_bytes(picture(0, 2, 8, 2), size="{} {}"), "without a line such as"),
        (radiance_bytes(picture(0, 2, 300, 2), size="-Y 2 +X 301"), "damaged|truncated"),
        (radiance_bytes(picture(0, 2, 300, 2), coding="new", size="-Y 2 +X 299"), "another width"),
        (radiance_bytes(picture(0, 2, 300, 1), coding="old", size="-Y 2 +X 299"), "longer than"),
        (radiance_bytes(np.ones((1, 9, 4), np.uint8)), "longer than its scanline|truncated"),
        (radiance_bytes(picture(0, 2, 300, 2), coding="new")[:-1], "truncated"),
        (radiance_bytes(picture(0, 2, 300, 2), coding="flat")[:-1], "truncated"),
        (radiance_bytes(picture(0, 1, 8, 2), size="-Y 200000 +X 1000"), "truncated"),
        (b"#?RADIANCE\n" + b"x" * 3_000_000, "header"),
    ],
)
def test_what_is_not_read_is_said(file: pathlib.Path, data: bytes, said: str) -> None:
    file.write_bytes(data)
    with pytest.raises(ValueError, match=said) as caught:
        image.read_image(file)
    assert str(caught.value).startswith(f"{file}: cannot be read: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (("PRIMARIES=.7 .3 .2 .7 .1 .05 .31 .33",), ["PRIMARIES 0.7 0.3"]),
        (("GAMMA=2.2", "PRIMARIES=1 0 0 1 0 0 .33 .33"), ["GAMMA 2.2", "PRIMARIES 1 0"]),
        (("GAMMA=high",), ["GAMMA high"]),
        (("PRIMARIES=sRGB",), ["PRIMARIES nan"]),
        (("PRIMARIES=0 0 0 0 0 0 0 0", "GAMMA=1"), []),  # Photoshop, which means none
        (("PRIMARIES=.64 .33 .29 .60 .15 .06 .3333 .3333",), []),
        (("PRIMARIES=.64 .33 .30 .60 .15 .06 .3127 .3290", "GAMMA=1.00"), []),
    ],
)
def test_what_is_not_applied_is_warned_of_once(
    file: pathlib.Path, lines: tuple[str, ...], said: list[str]
) -> None:
    file.write_bytes(radiance_bytes(picture(3, 2, 8, 2), lines))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        image.read_image(file)
        planes = image.read_planes(file)  # which only lists them
    assert len(caught) == bool(said)
    assert all(s in str(caught[0].message) for s in said)
    assert len(image.unapplied(planes.metadata)) == len(said)
