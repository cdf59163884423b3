"""Tables of measurements, and their form as text."""

import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import glossy
from glossy.frames import spherical

ROUND_TRIP = 1e-9
"""Twelve digits of degrees and of values, divided by cosines of 0.01 and more."""


def make(k: int, channels: int, seed: int, weighted: bool) -> glossy.MeasuredTable:
    """Random rows above and below the surface, off the horizon."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(0.01, 1.0, (2, k)) * rng.choice([-1.0, 1.0], (2, k))
    wi, wo = spherical(np.arccos(z), rng.uniform(0.0, 2.0 * np.pi, (2, k)))
    weight = rng.random(k) if weighted else None
    return glossy.MeasuredTable(wi, wo, rng.normal(1.0, 0.5, (k, channels)), weight, name="a b")


@given(st.integers(1, 30), st.sampled_from([1, 3]), st.integers(0, 99), st.booleans())
def test_a_written_table_reads_as_it_was(
    tmp_path_factory: pytest.TempPathFactory, k: int, channels: int, seed: int, weighted: bool
) -> None:
    table = make(k, channels, seed, weighted)
    path = tmp_path_factory.mktemp("table") / "table.txt"
    table.write(path)
    back = glossy.read_measured(path)
    assert (back.name, back.source) == ("a b", str(path))
    assert (back.isotropic, back.channels) == (False, table.channels)
    for key in ("wi", "wo", "f", "transfer"):
        np.testing.assert_allclose(getattr(back, key), getattr(table, key), atol=ROUND_TRIP)
    assert (back.weight is None) == (table.weight is None)
    if table.weight is not None and back.weight is not None:
        np.testing.assert_allclose(back.weight, table.weight, atol=ROUND_TRIP)


def test_transfer_and_sides() -> None:
    table = make(50, 1, 3, False)
    np.testing.assert_allclose(table.transfer[:, 0], table.f[:, 0] * np.abs(table.wo[:, 2]))
    sides = table.wi[:, 2] * table.wo[:, 2]
    assert len(table.reflection) == np.sum(sides > 0.0)
    assert len(table.reflection) + len(table.transmission) == 50
    assert np.all(table.transmission.wi[:, 2] * table.transmission.wo[:, 2] < 0.0)
    assert len(table.select(np.zeros(50, dtype=bool)).reflection) == 0


def test_incident_directions_group_what_differs_by_less_than_the_tolerance() -> None:
    rng = np.random.default_rng(0)
    centres = spherical(np.radians([0.0, 10.0, 10.0, 40.0]), np.radians([0.0, 0.0, 90.0, 5.0]))
    label = rng.integers(0, 4, 200)
    near = centres[label] + rng.uniform(-1.0, 1.0, (200, 3)) * 2e-5
    wi = near / np.linalg.norm(near, axis=1, keepdims=True)
    table = glossy.MeasuredTable(wi, wi, np.ones((200, 1)))
    found, rows = table.incident_directions()
    assert len(found) == len(rows) == 4
    np.testing.assert_array_equal(np.sort(np.concatenate(rows)), np.arange(200))
    for direction, own in zip(found, rows, strict=True):
        assert len(np.unique(label[own])) == 1
        np.testing.assert_allclose(direction, centres[label[own[0]]], atol=5e-5)
    first = [own.min() for own in rows]
    assert first == sorted(first)


def test_the_thesis_form_with_comments_and_a_heading(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "foil.dat"
    path.write_text(
        "# name: white foil\n# measured on a rainy day\n\ntheta_i phi_i theta_o phi_o p\n"
        "60 0 60 180 0.5  # the mirror direction\n60, 0, 120, 180, 0.25\n60 0 90 10 0.125\n"
    )
    table = glossy.read_measured(path)
    assert (table.name, table.isotropic) == ("white foil", True)
    np.testing.assert_allclose(table.f[:, 0], [1.0, 0.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(table.wo[1], [-np.sin(np.pi / 3), 0.0, -0.5], atol=1e-12)
    assert len(table.transmission) == 1


def test_radians_and_bsdf_values_when_the_file_says_so(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "t.txt"
    path.write_text("# angles: radians\n# quantity: f\n0.5 0 1.0 3 2\n0.5 1 1.0 3 2\n")
    table = glossy.read_measured(path)
    assert not table.isotropic
    np.testing.assert_allclose(table.f[:, 0], 2.0)
    np.testing.assert_allclose(table.wo[0], spherical(1.0, 3.0))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("# only words\n", "no rows"),
        ("1 2 3\n", "has 3 columns"),
        ("1 2 3 4 5\n1 2 3 4\n", "number of columns"),
        ("1 2 3 4 five\n", "could not convert"),
        ("1 2 3 4 nan\n", "row 1 of 1 is not finite"),
        ("1 2 3 4 5\n1 2 3 4 1e999\n", "row 2 of 2 is not finite"),
        ("190 2 3 4 5\n", "theta_i must be from 0 to 180"),
        ("1 2 -3 4 5\n", "theta_o must be from 0 to 180"),
        ("90 2 3 4 5\n", "horizon"),
        ("# angles: grads\n1 2 3 4 5\n", "angles must be degrees or radians"),
        ("# columns: a b c d e\n1 2 3 4 5\n", "has 5 columns"),
        ("1 2 3 4 5\0\n", "not a text file"),
    ],
)
def test_a_damaged_text_is_one_line_that_names_the_file(
    tmp_path: pathlib.Path, text: str, says: str
) -> None:
    path = tmp_path / "t.txt"
    path.write_text(text)
    with pytest.raises(ValueError, match=says) as error:
        glossy.read_measured(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


def test_files_that_are_none(tmp_path: pathlib.Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"none\.txt"):
        glossy.read_measured(tmp_path / "none.txt")
    with pytest.raises(OSError, match="not a regular file"):
        glossy.read_measured(tmp_path, format="text")
    with pytest.raises(ValueError, match=r"must end in"):
        glossy.read_measured(tmp_path / "table.csv")
    with pytest.raises(ValueError, match="format: must be one of"):
        glossy.read_measured(tmp_path / "table.csv", format="excel")


UP = np.array([[0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("wi", "f", "more", "says"),
    [
        (2.0 * UP, [[1.0]], {}, "wi: must be unit"),
        (UP, [[1.0, 2.0]], {}, "one channel or three"),
        (UP, [[1.0], [2.0]], {}, "must have shapes"),
        (UP, [[np.nan]], {}, "f: must be finite"),
        (UP, [[1.0]], {"weight": [-1.0]}, "weight"),
        (UP, [[1.0]], {"channels": ("R", "G")}, "channels"),
    ],
)
def test_refusals_of_the_table(
    wi: npt.ArrayLike, f: npt.ArrayLike, more: dict[str, Any], says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        glossy.MeasuredTable(wi, UP, f, **more)
