"""What is a number: one rule for every argument, and one line when it is broken."""

import datetime
import fractions
from typing import Any

import numpy as np
import pytest

from glossy import _check
from glossy.brdf import Lobe
from glossy.camera import Camera

HUGE = 10**400  # beyond float64
ENDLESS = 1 << 20000  # beyond the digits that Python prints
DEEP: list[Any] = []
for _ in range(5000):
    DEEP = [DEEP]
NOT_NUMBERS = [True, "0.2", b"1", datetime.date(2020, 1, 1), None, [0.1], HUGE, ENDLESS, 1j, DEEP]
NOT_ARRAYS = [
    True, "0.2", ["0.2", "0.3"], [True, 0.5], [HUGE, 0], ENDLESS, datetime.date(2020, 1, 1),
    np.array(["2020-01-01"], dtype="datetime64[D]"), [[1.0], [1.0, 2.0]], 1j, {"a": 1}, DEEP,
    np.ma.masked_array([1.0, 2.0], mask=[True, False]),
]  # fmt: skip


def refusal(make: Any, *given: Any) -> str:
    with pytest.raises(ValueError, match=r"^x: must ") as error:
        make("x", *given)
    text = str(error.value)
    assert "\n" not in text
    assert len(text) < 160
    return text


@pytest.mark.parametrize("value", NOT_NUMBERS, ids=lambda v: type(v).__name__)
def test_what_is_no_number_is_refused_on_one_line(value: object) -> None:
    refusal(_check.number, value)
    refusal(_check.count, value)


@pytest.mark.parametrize("value", NOT_ARRAYS, ids=lambda v: type(v).__name__)
def test_what_is_no_array_of_numbers_is_refused_on_one_line(value: object) -> None:
    refusal(_check.array, value)


def test_numbers_of_other_types_are_numbers() -> None:
    assert _check.number("x", np.float32(0.5)) == 0.5
    assert _check.number("x", fractions.Fraction(1, 4)) == 0.25
    mixed: Any = [fractions.Fraction(1, 4), 10**30]
    assert _check.array("x", mixed).tolist() == [0.25, 1e30]
    assert _check.array("x", np.array([True, False])).tolist() == [1.0, 0.0]
    assert _check.array("x", np.ma.masked_array([1.0], mask=[False])).tolist() == [1.0]


def test_a_number_beyond_single_precision_is_refused_there_alone() -> None:
    assert _check.array("x", [1e300])[0] == 1e300
    assert "must fit float32" in refusal(_check.array, [1e300], np.float32)
    assert np.isinf(_check.array("x", [np.inf], np.float32)[0])


def test_counts_end_where_the_kernels_do() -> None:
    assert _check.count("x", 2**63 - 1) == 2**63 - 1
    assert "below 2^63" in refusal(_check.count, 2**63)


def test_an_array_is_quoted_on_one_line() -> None:
    assert "\n" not in str(_check.fail("x", "must be small", np.eye(9)))


@pytest.mark.parametrize("value", [HUGE, "0.2", True])
def test_materials_and_cameras_take_numbers_only(value: Any) -> None:
    for make in (lambda: Lobe(value), lambda: Lobe(0.1, r0=value), lambda: Camera(fov=value)):
        with pytest.raises(ValueError, match=r"^(mx|r0|fov): must "):
            make()
