"""False-colour pictures of the difference of two images, with a legend that gives the values.

Each pixel shows the channel c in which test a and reference b differ most, ::

    |a_c - b_c|     unsigned: a perceptually even map from black to pale yellow               (1)
      a_c - b_c     signed: blue where the test is darker, white equal, red brighter          (2)

on a linear scale that ends at ``limit``; beyond it the map's last colour. Unless given, the limit
is the 99.9th percentile of (1) rounded up to 1, 2 or 5 times a power of ten: a single outlier
would turn the picture black. The legend says where the scale ends and how large (1) becomes.
Pixels outside a mask are grey, and take no part in the scale.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check
from ._arguments import checked

Plane = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]
Float32Array = npt.NDArray[np.float32]
Pixels = npt.NDArray[np.uint8]

PERCENTILE = 99.9
SMALLEST = 256  # smaller pictures are enlarged by a whole factor, so that the legend can be read
WIDEST = 4096  # but not beyond this width; white rows make up for the rest
TALLEST = 4096  # of the legend
MAPS = {False: "inferno", True: "RdBu_r"}
OUTSIDE = (128, 128, 128)


def difference(a: Sequence[Plane], b: Sequence[Plane], mask: Mask | None = None) -> Float32Array:
    """Signed difference (H, W) in the channel that differs most, eq. (2), of planes (H, W).

    It is 0 outside the mask, whatever is there.

    Raises
    ------
    ValueError
        If a difference is NaN or infinite in single precision.
    """
    out = np.zeros(a[0].shape, dtype=np.float32)
    for first, second in zip(a, b, strict=True):
        with np.errstate(all="ignore"):
            d = np.subtract(first, second, dtype=np.float32)
        if mask is not None:
            d[~mask] = 0.0
        if not np.isfinite(d).all():
            raise _check.fail("a - b", "must be finite in single precision", "NaN or infinity")
        np.copyto(out, d, where=np.abs(d) > np.abs(out))
    return out


def round_up(value: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten that is not below ``value``; 1 for 0."""
    if value <= 0.0:
        return 1.0
    exponent = math.floor(math.log10(value))
    steps = (float(f"{m}e{exponent + e}") for e in (0, 1) for m in (1, 2, 5))
    return next(step for step in steps if step >= value)


@checked
def difference_picture(
    a: npt.ArrayLike,
    b: npt.ArrayLike,
    *,
    signed: bool = False,
    limit: float | None = None,
    unit: str = "radiance",
) -> Pixels:
    """False-colour picture of a - b with its legend at the right.

    Parameters
    ----------
    a, b : (H, W) or (H, W, C) array
        Test and reference, finite, of one shape.
    signed : bool
        Equation (2) in place of (1).
    limit : float > 0, optional
        End of the scale, in the unit of the images.
    unit : str
        Name of the unit, for the legend.

    Returns
    -------
    (H', W', 3) uint8, sRGB; the picture's pixels are exact, enlarged by a whole factor if small.

    Raises
    ------
    ValueError
        For differing or unsuited shapes, NaN or infinity, a limit out of range.
    """
    first, second = _check.array("a", a, np.float32), _check.array("b", b, np.float32)
    if first.ndim not in (2, 3) or first.size == 0 or first.shape != second.shape:
        raise _check.fail(
            "a, b", "must have one shape (H, W) or (H, W, C)", [first.shape, second.shape]
        )
    planes_a, planes_b = (
        [v] if v.ndim == 2 else [v[..., c] for c in range(v.shape[2])] for v in (first, second)
    )
    return planes_picture(planes_a, planes_b, signed=signed, limit=limit, unit=unit)


def planes_picture(
    a: Sequence[Plane],
    b: Sequence[Plane],
    *,
    mask: Mask | None = None,
    signed: bool = False,
    limit: float | None = None,
    unit: str = "radiance",
) -> Pixels:
    """`difference_picture` of separate channels, each (H, W), and of a mask (H, W)."""
    d = difference(a, b, mask)
    size = np.abs(d)
    top = float(size.max())
    if limit is None:
        seen = size if mask is None else size[mask]
        end = round_up(float(np.percentile(seen, PERCENTILE)) or top)
    else:
        end = _check.positive("limit", limit)
    from matplotlib import colormaps

    table = colormaps[MAPS[signed]](np.linspace(0.0, 1.0, 256), bytes=True)[:, :3]
    with np.errstate(over="ignore"):  # beyond the scale
        v = np.divide(d if signed else size, end, dtype=np.float64)
    place = (v + 1.0) * 127.5 if signed else v * 255.0
    picture = table[np.rint(np.clip(place, 0.0, 255.0)).astype(np.uint8)]
    if mask is not None:
        picture[~mask] = OUTSIDE
    factor = max(1, min(-(-SMALLEST // d.shape[0]), WIDEST // d.shape[1]))
    picture = picture.repeat(factor, axis=0).repeat(factor, axis=1)
    height = max(picture.shape[0], SMALLEST)
    bar = _legend(table, min(height, TALLEST), end, top, signed, unit)
    parts = [
        np.pad(p, ((0, height - len(p)), (0, 0), (0, 0)), constant_values=255)
        for p in (picture, bar)
    ]
    return np.concatenate(parts, axis=1)


def _legend(table: Pixels, height: int, end: float, top: float, signed: bool, unit: str) -> Pixels:
    # a white strip (height, w, 3): the colour bar, its numbers, unit, and what lies beyond
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    dots = min(max(height / 4.0, 64.0), 400.0)  # dots per inch: a strip of some four inches
    figure = Figure(figsize=(1.5, height / dots), dpi=dots, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.08, 0.1, 0.16, 0.76))
    low = -end if signed else 0.0
    column = table[:, None]
    axes.imshow(column, origin="lower", aspect="auto", extent=(0.0, 1.0, low, end))
    axes.set_xticks([])
    axes.yaxis.tick_right()
    ticks = np.linspace(low, end, 5 if signed else 6)
    axes.set_yticks(ticks, [f"{t:.4g}".replace("-", "\N{MINUS SIGN}") for t in ticks])
    axes.tick_params(labelsize=8)
    name = "test \N{MINUS SIGN} reference" if signed else "|test \N{MINUS SIGN} reference|"
    figure.text(0.08, 0.975, f"{name}\n[{unit}]", fontsize=7.5, va="top")
    figure.text(0.08, 0.025, f"largest: {top:.3g}", fontsize=7.5, va="bottom")
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.asarray(canvas.buffer_rgba())[..., :3]  # type: ignore[no-untyped-call]
    rows = np.minimum(np.arange(height), len(pixels) - 1)  # the canvas may round by one row
    return pixels[rows]
