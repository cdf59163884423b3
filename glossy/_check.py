"""Argument validation: one place for the rules and for the wording of their errors.

Every function returns the argument in the form the kernels take (C order, one dtype), or raises
``ValueError`` with one line that names the argument, the rule and the value.
"""

import math
import warnings
from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.floating]
Float64Array = npt.NDArray[np.float64]
Policy = Literal["error", "clamp", "keep"]
Precision = Literal["single", "double"]

MOST = 2**63 - 1  # largest whole number of the kernels
UNIT_TOLERANCE = 1e-3  # how far from 1 the length of a "unit" vector may be


def fail(name: str, rule: str, value: object) -> ValueError:
    """The one form of a refusal, on one line: argument, rule, value."""
    try:
        text = " ".join(repr(value).split())
    except (ValueError, RecursionError):  # an integer of thousands of digits; lists without end
        text = f"a value of type {type(value).__name__} that is too long to print"
    return ValueError(f"{name}: {rule}, got {text if len(text) <= 80 else text[:77] + '...'}")


def shortened(text: str, limit: int = 300) -> str:
    """One line of at most ``limit`` characters: messages that quote a damaged file have no end."""
    line = " ".join(text.split())
    return line if len(line) <= limit else line[: limit - 3] + "..."


def array(name: str, value: npt.ArrayLike, dtype: type = np.float64) -> npt.NDArray[np.floating]:
    """Anything NumPy converts to real numbers, as a C-ordered array of ``dtype``.

    Texts, dates and truth values are no numbers, but an array of truth values is one of 0 and 1;
    masked elements have no value; numbers that ``dtype`` cannot hold are refused.
    """
    if np.ma.is_masked(value):
        raise fail(name, "must not have masked elements", value)
    try:
        raw = np.asarray(value)
        listed = value if isinstance(value, list | tuple) else (value,)
        if raw.dtype.kind not in "fiubO" or any(isinstance(v, bool) for v in listed):
            raise TypeError
        with np.errstate(over="raise"):
            return np.ascontiguousarray(raw, dtype=dtype) if raw.ndim else raw.astype(dtype)
    except (FloatingPointError, OverflowError):
        raise fail(name, f"must fit {np.dtype(dtype).name}", value) from None
    except (TypeError, ValueError, RecursionError):
        raise fail(name, "must be an array of real numbers", value) from None


def real(
    name: str, value: npt.ArrayLike, rule: str = "must be an array of real numbers"
) -> npt.NDArray[Any]:
    """An array of real numbers or truth values, in its own type."""
    if np.ma.is_masked(value):
        raise fail(name, "must not have masked elements", value)
    try:
        raw = np.asarray(value)
    except (TypeError, ValueError, RecursionError):
        raise fail(name, rule, value) from None
    if raw.dtype.kind not in "biuf":
        raise fail(name, rule, value)
    return raw


def frozen(value: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A read-only C-ordered view: kernel inputs all take this form.

    Numba compiles once more for each mix of layouts and of writeable and read-only arguments; a
    read-only view costs nothing, so every wrapper passes its inputs through here.
    """
    view = np.ascontiguousarray(value).view()
    view.flags.writeable = False
    return view


def number(name: str, value: object) -> float:
    """A finite real number; texts, truth values and masked elements are none."""
    try:
        if isinstance(value, str | bytes | bool | np.bool_) or np.ma.is_masked(value):
            raise TypeError
        result = float(value)  # type: ignore[arg-type]  # the except clause is the check
    except OverflowError:
        raise fail(name, "must fit float64", value) from None
    except (TypeError, ValueError):
        raise fail(name, "must be a number", value) from None
    if not math.isfinite(result):
        raise fail(name, "must be finite", value)
    return result


def in_range(
    name: str,
    value: object,
    low: float = -math.inf,
    high: float = math.inf,
    open_low: bool = False,
    open_high: bool = False,
) -> float:
    """A finite number between two bounds, each included unless said open."""
    result = number(name, value)
    below = result <= low if open_low else result < low
    above = result >= high if open_high else result > high
    if below or above:
        left = "(" if open_low or math.isinf(low) else "["
        right = ")" if open_high or math.isinf(high) else "]"
        raise fail(name, f"must be in {left}{low:g}, {high:g}{right}", value)
    return result


def positive(name: str, value: object) -> float:
    """A finite number above zero."""
    return in_range(name, value, low=0.0, open_low=True)


def count(name: str, value: object, low: int = 1, high: int | None = None) -> int:
    """A whole number of at least ``low``, at most ``high`` (2^63 - 1); True, 2.5 are refused."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool | np.bool_)
    if not whole:
        raise fail(name, "must be a whole number", value)
    result: int = int(value)  # type: ignore[call-overload]
    if result < low or result > (MOST if high is None else high):
        rule = f"must be from {low} to {high}"
        if high is None:
            rule = f"must be at least {low}" if result < low else "must be below 2^63"
        raise fail(name, rule, value)
    return result


def choice(name: str, value: object, options: Iterable[str]) -> str:
    """One of a set of names."""
    names = list(options)
    if not isinstance(value, str) or value not in names:
        raise fail(name, f"must be one of {', '.join(names)}", value)
    return value


def dtype_of(precision: object) -> type[np.float32] | type[np.float64]:
    """The NumPy type of ``precision``: "single" is float32, "double" float64."""
    name = choice("precision", precision, ("single", "double"))
    return np.float32 if name == "single" else np.float64


def rgb(name: str, value: npt.ArrayLike, low: float = 0.0, high: float = math.inf) -> Float64Array:
    """A number or an RGB triple within bounds, as three float64."""
    raw = array(name, value)
    if raw.shape not in ((), (3,)):
        raise fail(name, "must be a number or three (RGB)", value)
    if not np.all(np.isfinite(raw)) or np.any(raw < low) or np.any(raw > high):
        bounds = f"in [{low:g}, {high:g}]" if math.isfinite(high) else f"finite and >= {low:g}"
        raise fail(name, f"must be {bounds}", value)
    return np.array(np.broadcast_to(raw, (3,)), dtype=np.float64)


def vectors(name: str, value: npt.ArrayLike, dtype: type = np.float64) -> FloatArray:
    """An array (..., 3) of finite, non-zero vectors of any length."""
    v = array(name, value, dtype)
    if v.ndim == 0 or v.shape[-1] != 3:
        raise fail(name, "must have shape (..., 3)", v.shape)
    finite = np.isfinite(v)
    if not finite.all():
        bad = np.asarray(~finite.all(axis=-1))
        raise fail(name, f"must be finite{first_place(bad)}", v[bad][0].tolist())
    zero = np.asarray(~v.any(axis=-1))
    if zero.any():
        rule = f"must not contain a zero vector{first_place(zero)}"
        raise fail(name, rule, f"{int(zero.sum())} of them")
    return v


def first_place(where: npt.NDArray[np.bool_]) -> str:
    """Where the first True is, in words: a pixel of a picture (column, row), else an index."""
    index = [int(i) for i in np.unravel_index(int(np.argmax(where)), where.shape)]
    if len(index) == 2:
        return f" (pixel {index[1]},{index[0]})"
    return f" (index {', '.join(str(i) for i in index)})" if index else ""


def truth_values(name: str, value: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """An array of True and False, a C-ordered copy; of numbers, 0 is False."""
    rule = "must be an array of truth values"
    raw = real(name, value, rule)
    if np.any(raw != raw):
        raise fail(name, rule, value)
    return np.array(raw, dtype=bool, order="C")


def unit_vectors(name: str, value: npt.ArrayLike) -> Float64Array:
    """An array (..., 3) of vectors of length 1 within ``UNIT_TOLERANCE``, renormalised."""
    v = vectors(name, value).astype(np.float64, copy=False)
    length = np.sqrt(np.einsum("...i,...i->...", v, v))
    off = np.asarray(np.abs(length - 1.0) > UNIT_TOLERANCE)
    if off.any():
        rule = f"must be unit vectors within {UNIT_TOLERANCE:g}{first_place(off)}"
        raise fail(name, rule, f"length {float(length[off].flat[0]):.6g}")
    return np.ascontiguousarray(v / length[..., None])


def radiance(
    name: str, value: npt.NDArray[np.float32], negative: str = "error", nonfinite: str = "error"
) -> npt.NDArray[np.float32]:
    """Radiance under the two policies; a change is warned about with its count.

    ``negative``: ``error`` refuses, ``clamp`` sets to 0, ``keep`` leaves. ``nonfinite``: ``error``
    refuses, ``clamp`` sets NaN and -inf to 0 and +inf to the largest finite value, ``keep`` leaves.
    Counts are of channel values, not of texels.
    """
    choice("negative", negative, ("error", "clamp", "keep"))
    choice("nonfinite", nonfinite, ("error", "clamp", "keep"))
    finite = np.isfinite(value)
    bad = value.size - int(np.count_nonzero(finite))
    if bad and nonfinite == "error":
        raise fail(
            name,
            "must be finite (nonfinite='clamp' or 'keep' admits them)",
            f"{bad} NaN or inf values",
        )
    if bad and nonfinite == "clamp":
        top = np.float32(value[finite].max(initial=0.0))
        value = np.where(finite, value, np.where(np.isposinf(value), top, np.float32(0.0)))
        message = f"{name}: {bad} NaN or infinite values replaced (largest finite value {top:g})"
        warnings.warn(message, stacklevel=3)
    below = value < 0.0
    low = int(np.count_nonzero(below))
    if low and negative == "error":
        lowest = float(value[below].min())
        raise fail(
            name,
            "must not be negative (negative='clamp' or 'keep' admits it)",
            f"{low} negative values, lowest {lowest:g}",
        )
    if low and negative == "clamp":
        lowest = float(value[below].min())
        message = f"{name}: {low} negative values clamped to 0 (lowest {lowest:g})"
        warnings.warn(message, stacklevel=3)
        value = np.maximum(value, np.float32(0.0))
    return value
