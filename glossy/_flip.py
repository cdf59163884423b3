"""FLIP: the difference two viewers alternating between the images would notice.

The figure of Andersson et al., "FLIP: A Difference Evaluator for Alternating Images" (2020), and
its extension to high dynamic range (2021), as computed by their own program.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check

Plane = npt.NDArray[Any]

LUMINANCE = (0.2126729, 0.7151522, 0.0721750)
DARKEST, BRIGHTEST = 1e-6, 1e30  # of the reference's largest luminance, for its exposures


def flip_error(
    a: Sequence[Plane], b: Sequence[Plane], kind: str, labels: tuple[str, str] = ("a", "b")
) -> float:
    """Mean FLIP error of test ``a`` against reference ``b``: one or three linear channels each.

    ``kind`` "ldr" wants values in [0, 1]; "hdr" chooses its exposures by the reference and sees
    negative values as 0. The viewer is the program's own default (67 pixels per degree).

    Raises
    ------
    ValueError
        Not installed; values or a number of channels that FLIP is not defined for.
    """
    try:
        import flip_evaluator
    except ImportError:
        raise ValueError("FLIP is not installed: pip install glossy-envmap[flip]") from None
    if len(a) not in (1, 3):
        raise _check.fail("flip", "takes one or three channels", len(a))
    images = []
    for label, planes in zip(labels, (a, b), strict=True):
        stacked = np.stack([planes[i % len(planes)] for i in range(3)], axis=-1)
        with np.errstate(over="ignore"):  # refused below
            image = np.ascontiguousarray(stacked, dtype=np.float32)
        low, high = float(image.min()), float(image.max())
        if kind == "ldr" and not (low >= 0.0 and high <= 1.0):
            raise _check.fail(label, "must be in [0, 1] for LDR-FLIP", f"{low:g} to {high:g}")
        if kind == "hdr" and not high <= BRIGHTEST:
            raise _check.fail(label, f"must be at most {BRIGHTEST:g} for HDR-FLIP", high)
        images.append(np.maximum(image, np.float32(0.0)))
    test, reference = images
    if np.array_equal(test, reference):
        return 0.0
    brightest = float((reference @ np.array(LUMINANCE, dtype=np.float32)).max())
    if kind == "hdr" and brightest < DARKEST:  # the program would end this process
        raise _check.fail(labels[1], "is black: HDR-FLIP sets its exposures by it", brightest)
    _, mean, _ = flip_evaluator.evaluate(
        reference, test, kind.upper(), inputsRGB=False, applyMagma=False
    )
    return float(mean)
