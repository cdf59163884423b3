"""How far an image is from a reference: RMS, PSNR and their relatives.

For a test image a and a reference b of n channel values in all, d = a - b, ::

    rms            sqrt(sum d^2 / n)                                                         (1)
    relative rms   sqrt(sum d^2 / sum b^2)                                                   (2)
    mae            sum |d| / n                                                               (3)
    bias           sum d / n                                                                 (4)
    psnr           20 log10(peak / rms)  [dB]                                                (5)
    relative mse   sum (d^2 / (b^2 + e)) / n                 e = 0.01 [radiance^2]           (6)
    log rms        sqrt(sum (ln(a+ + e) - ln(b+ + e))^2 / n)  e = 1e-4 [radiance]            (7)

with a+ = max(a, 0). One sweep over blocks of rows that stay in the processor's cache converts the
values to float64 and sums them pairwise; the blocks' sums are then added exactly. So the figures
are the same for any number of threads, and no full-size temporary is made. Figures of single pixels
(outliers, percentiles) are those of `_outliers`, and cost a further sweep each when asked for.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check
from ._arguments import checked
from ._outliers import count_outliers, percentiles_of
from ._sweep import Sums, sweep

Plane = npt.NDArray[Any]

RELATIVE_EPSILON = 0.01
LOG_EPSILON = 1e-4


@dataclasses.dataclass(frozen=True)
class Comparison:
    """All figures of one comparison; the module's equations define them.

    Parameters
    ----------
    rms, relative_rms, mae, bias, relative_mse, log_rms : float
        Over all channels and the pixels compared. ``relative_rms`` is infinite where the
        reference is black and the test is not.
    psnr, peak : float
        In dB, infinite for identical images, and the peak it was computed with.
    max_abs, max_at, max_channel : float, (x, y), str
        The largest absolute difference, its first pixel and its channel.
    channel_rms : one float for each channel
        Equation (1) by channel.
    width, height, channels, pixels : int, int, names, int
        Size of the images, channels compared, and pixels compared (those of the mask).
    relative_epsilon, log_epsilon : float
        The constants of equations (6) and (7).
    identical : bool
        No value differs.
    flip, flip_kind : float and "ldr" or "hdr", or None
        Mean FLIP error in [0, 1], if asked for.
    max_difference, max_relative_difference : float or None
        The tolerance X and R of a pixel, if outliers were asked for.
    outliers, outlier_share : int and float, or None
        Pixels with |a - b| above X + R |b| in a channel, and their share of ``pixels``.
    percentiles : pairs (p, value), or None
        ``value`` is the least that p percent of the pixels do not exceed by their largest |a - b|.
    """

    rms: float
    relative_rms: float
    mae: float
    psnr: float
    peak: float
    max_abs: float
    max_at: tuple[int, int]
    max_channel: str
    bias: float
    relative_mse: float
    log_rms: float
    channel_rms: tuple[float, ...]
    width: int
    height: int
    channels: tuple[str, ...]
    pixels: int
    relative_epsilon: float
    log_epsilon: float
    identical: bool
    flip: float | None = None
    flip_kind: str | None = None
    max_difference: float | None = None
    max_relative_difference: float | None = None
    outliers: int | None = None
    outlier_share: float | None = None
    percentiles: tuple[tuple[float, float], ...] | None = None

    def to_dict(self) -> dict[str, Any]:
        """The figures under their names with ``"schema": 1``; infinities become None.

        The percentiles are a mapping from p, as text, to the value.
        """
        out: dict[str, Any] = {"schema": 1}
        for name, value in dataclasses.asdict(self).items():
            out[name] = [_finite(v) for v in value] if isinstance(value, tuple) else _finite(value)
        if self.percentiles is not None:
            out["percentiles"] = {f"{p:.15g}": _finite(v) for p, v in self.percentiles}
        return out


def rms(a: npt.ArrayLike, b: npt.ArrayLike, mask: npt.ArrayLike | None = None) -> float:
    """Root mean square difference, eq. (1).

    Parameters
    ----------
    a, b : (H, W) or (H, W, C) array
        Test and reference, of one shape.
    mask : (H, W) array, optional
        Pixels compared: those that are not zero. The others may hold anything.

    Raises
    ------
    ValueError
        For differing or unsuited shapes, NaN or infinity, a mask of another shape or empty.
    """
    return _rms(_measure(a, b, mask))


def relative_rms(a: npt.ArrayLike, b: npt.ArrayLike, mask: npt.ArrayLike | None = None) -> float:
    """RMS difference over the RMS of the reference ``b``, eq. (2); arguments as for `rms`."""
    return _relative_rms(_measure(a, b, mask))


def mae(a: npt.ArrayLike, b: npt.ArrayLike, mask: npt.ArrayLike | None = None) -> float:
    """Mean absolute difference, eq. (3); arguments as for `rms`."""
    s = _measure(a, b, mask)
    return s.total("absolute") / s.count / s.scale


def bias(a: npt.ArrayLike, b: npt.ArrayLike, mask: npt.ArrayLike | None = None) -> float:
    """Mean signed difference a - b, eq. (4); arguments as for `rms`."""
    s = _measure(a, b, mask)
    return s.total("signed") / s.count / s.scale


def psnr(
    a: npt.ArrayLike, b: npt.ArrayLike, peak: float = 1.0, mask: npt.ArrayLike | None = None
) -> float:
    """Peak signal-to-noise ratio [dB], eq. (5), infinite for identical images.

    ``peak`` is the largest signal, above 0: state it with the figure. Else as for `rms`.
    """
    return _psnr(rms(a, b, mask), _check.positive("peak", peak))


def relative_mse(
    a: npt.ArrayLike,
    b: npt.ArrayLike,
    epsilon: float = RELATIVE_EPSILON,
    mask: npt.ArrayLike | None = None,
) -> float:
    """Mean of d^2 / (b^2 + epsilon), eq. (6); ``epsilon`` [radiance^2] above 0, else as `rms`."""
    e = _check.positive("epsilon", epsilon)
    s = _measure(a, b, mask, relative_epsilon=e)
    return s.total("relative") / s.count


def log_rms(
    a: npt.ArrayLike,
    b: npt.ArrayLike,
    epsilon: float = LOG_EPSILON,
    mask: npt.ArrayLike | None = None,
) -> float:
    """RMS difference of ln(max(v, 0) + epsilon), eq. (7); ``epsilon`` above 0, else as `rms`."""
    s = _measure(a, b, mask, log_epsilon=_check.positive("epsilon", epsilon))
    return math.sqrt(s.total("log") / s.count)


@checked
def compare(
    a: npt.ArrayLike,
    b: npt.ArrayLike,
    *,
    peak: float = 1.0,
    mask: npt.ArrayLike | None = None,
    flip: bool | str = False,
    channels: Sequence[str] | None = None,
    relative_epsilon: float = RELATIVE_EPSILON,
    log_epsilon: float = LOG_EPSILON,
    max_difference: float | None = None,
    max_relative_difference: float | None = None,
    percentiles: Sequence[float] | None = None,
) -> Comparison:
    """Every figure of test ``a`` against reference ``b``.

    Parameters
    ----------
    a, b : (H, W) or (H, W, C) array
        Linear values of one shape.
    peak : float > 0
        Largest signal, for the PSNR.
    mask : (H, W) array, optional
        Pixels compared: those that are not zero. The others may hold anything.
    flip : bool, "ldr" or "hdr"
        Also compute the mean FLIP error (True: "hdr"); see `flip_error`. Not with a mask.
    channels : C names, optional
        R, G, B, A; Y; or numbers, by default.
    relative_epsilon, log_epsilon : float > 0
        Constants of equations (6) and (7).
    max_difference, max_relative_difference : float >= 0, optional
        Also count outliers: pixels with |a - b| > X + R |b| in a channel, the one not given 0.
    percentiles : numbers from 0 to 100, optional
        Also these percentiles of the pixels' largest |a - b|.

    Raises
    ------
    ValueError
        As for `rms`, or for a parameter out of range.
    """
    first, second = _image("a", a), _image("b", b)
    if first.shape != second.shape:
        raise _check.fail("a, b", "must have one shape", [first.shape, second.shape])
    number = first.shape[2]
    names = _default_names(number) if channels is None else tuple(channels)
    if not all(isinstance(own, str) for own in names):
        raise _check.fail("channels", f"must be {number} different names", channels)
    if len(names) != number or len(set(names)) != number:
        raise _check.fail("channels", f"must be {number} different names", channels)
    pairs = [{n: v[..., i] for i, n in enumerate(names)} for v in (first, second)]
    return compare_planes(
        *pairs,
        peak=peak,
        mask=mask,
        flip=flip,
        relative_epsilon=relative_epsilon,
        log_epsilon=log_epsilon,
        max_difference=max_difference,
        max_relative_difference=max_relative_difference,
        percentiles=percentiles,
    )


def compare_planes(
    a: Mapping[str, Plane],
    b: Mapping[str, Plane],
    *,
    peak: float = 1.0,
    mask: npt.ArrayLike | None = None,
    flip: bool | str = False,
    relative_epsilon: float = RELATIVE_EPSILON,
    log_epsilon: float = LOG_EPSILON,
    max_difference: float | None = None,
    max_relative_difference: float | None = None,
    percentiles: Sequence[float] | None = None,
    labels: tuple[str, str] = ("a", "b"),
) -> Comparison:
    """`compare` on separate channels (H, W) under the same names; errors use ``labels``."""
    signal = _check.positive("peak", peak)
    e2 = _check.positive("relative_epsilon", relative_epsilon)
    e1 = _check.positive("log_epsilon", log_epsilon)
    kind = "hdr" if flip is True else flip
    if kind is not False:
        _check.choice("flip", kind, ("ldr", "hdr"))
        if mask is not None:
            raise _check.fail("flip", "is a figure of whole images, without mask", flip)
    tolerance = _tolerance(max_difference, max_relative_difference)
    ranks = [] if percentiles is None else [_percent(p) for p in percentiles]
    names = tuple(a)
    planes_a, planes_b = list(a.values()), [b[n] for n in names]
    height, width = planes_a[0].shape
    kept = _mask(mask, (height, width))
    s = sweep(planes_a, planes_b, kept, names, labels, e2, e1)
    error = _rms(s)
    peak_value, x, y, channel = s.largest
    flip_mean = None
    if kind is not False:
        from ._flip import flip_error

        flip_mean = flip_error(planes_a, planes_b, str(kind), labels)
    outside = None if tolerance is None else count_outliers(planes_a, planes_b, kept, *tolerance)
    values = percentiles_of(planes_a, planes_b, kept, ranks) if ranks else []
    return Comparison(
        rms=error,
        relative_rms=_relative_rms(s),
        mae=s.total("absolute") / s.count / s.scale,
        psnr=_psnr(error, signal),
        peak=signal,
        max_abs=peak_value / s.scale,
        max_at=(x, y),
        max_channel=names[channel],
        bias=s.total("signed") / s.count / s.scale,
        relative_mse=s.total("relative") / s.count,
        log_rms=math.sqrt(s.total("log") / s.count),
        channel_rms=tuple(
            math.sqrt(s.channel("squared", c) / s.pixels) / s.scale for c in range(len(names))
        ),
        width=width,
        height=height,
        channels=names,
        pixels=s.pixels,
        relative_epsilon=e2,
        log_epsilon=e1,
        identical=peak_value == 0.0,
        flip=flip_mean,
        flip_kind=None if kind is False else str(kind),
        max_difference=None if tolerance is None else tolerance[0],
        max_relative_difference=None if tolerance is None else tolerance[1],
        outliers=outside,
        outlier_share=None if outside is None else outside / s.pixels,
        percentiles=None if percentiles is None else tuple(zip(ranks, values, strict=True)),
    )


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _tolerance(absolute: float | None, relative: float | None) -> tuple[float, float] | None:
    if absolute is None and relative is None:
        return None
    x = _check.in_range("max_difference", absolute or 0.0, 0.0)
    return x, _check.in_range("max_relative_difference", relative or 0.0, 0.0)


def _percent(value: float) -> float:
    return _check.in_range("percentiles", value, 0.0, 100.0)


def _rms(s: Sums) -> float:
    return math.sqrt(s.total("squared") / s.count) / s.scale


def _relative_rms(s: Sums) -> float:
    error, signal = s.total("squared"), s.total("reference")
    if error == 0.0:
        return 0.0
    return math.sqrt(error) / math.sqrt(signal) if signal > 0.0 else math.inf


def _psnr(error: float, peak: float) -> float:
    return math.inf if error == 0.0 else 20.0 * (math.log10(peak) - math.log10(error))


def _measure(
    a: npt.ArrayLike,
    b: npt.ArrayLike,
    mask: npt.ArrayLike | None,
    relative_epsilon: float | None = None,
    log_epsilon: float | None = None,
) -> Sums:
    first, second = _image("a", a), _image("b", b)
    if first.shape != second.shape:
        raise _check.fail("a, b", "must have one shape", [first.shape, second.shape])
    number = first.shape[2]
    planes_a, planes_b = ([v[..., i] for i in range(number)] for v in (first, second))
    names = _default_names(number)
    kept = _mask(mask, first.shape[:2])
    return sweep(planes_a, planes_b, kept, names, ("a", "b"), relative_epsilon, log_epsilon)


def _image(name: str, value: npt.ArrayLike) -> Plane:
    raw = _check.real(name, value)
    if raw.ndim not in (2, 3) or raw.size == 0:
        raise _check.fail(name, "must have shape (H, W) or (H, W, C) with values", raw.shape)
    return raw if raw.ndim == 3 else raw[..., None]


def _mask(mask: npt.ArrayLike | None, shape: tuple[int, ...]) -> npt.NDArray[np.bool_] | None:
    if mask is None:
        return None
    raw = _image("mask", mask)
    raw = raw[..., 0] if raw.shape[2] == 1 else raw
    if raw.shape != shape:
        raise _check.fail("mask", f"must have shape {shape}", raw.shape)
    if raw.dtype.kind == "f" and np.isnan(raw).any():
        raise _check.fail("mask", "must not hold NaN", f"{int(np.isnan(raw).sum())} of them")
    kept: npt.NDArray[np.bool_] = raw != 0
    if not kept.any():
        raise _check.fail("mask", "must keep a pixel", "none")
    return kept


def _default_names(number: int) -> tuple[str, ...]:
    if number == 1:
        return ("Y",)
    return tuple("RGBA"[:number]) if number in (3, 4) else tuple(str(i) for i in range(number))
