"""A material that is known by its methods: what they return is held to what it must be.

One NaN or one direction that is no unit vector would go into the radiance, and into its error,
without a word.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check

Float64Array = npt.NDArray[np.float64]


class GivenMaterial:
    """``eval``, ``sample`` and ``pdf`` of a user's material, with their results checked.

    Raises
    ------
    ValueError
        From each method, for results that are no finite real numbers or of another shape, for
        samples that are not unit vectors, and for densities below 0.
    """

    def __init__(self, material: Any) -> None:
        self.material = material

    def eval(self, wi: Float64Array, wo: Float64Array) -> Float64Array:
        """BSDF, (...) or (..., 3) of directions (..., 3), or what is broadcast to them."""
        out = _numbers("eval", self.material.eval(wi, wo))
        return _shaped("eval", out, wi.shape[:-1], wi.shape)

    def sample(self, xi: Float64Array, wo: Float64Array) -> Float64Array:
        """Directions (..., 3) of numbers (..., 2)."""
        out = _numbers("sample", self.material.sample(xi, wo))
        if out.shape != (*xi.shape[:-1], 3):
            raise _refused("sample", f"an array of shape {(*xi.shape[:-1], 3)}", out.shape)
        length = np.sqrt(np.einsum("...i,...i->...", out, out))
        off = np.abs(length - 1.0) > _check.UNIT_TOLERANCE
        if off.any():
            raise _refused("sample", "unit vectors", f"one of length {float(length[off][0]):g}")
        return out

    def pdf(self, wi: Float64Array, wo: Float64Array) -> Float64Array:
        """Density (...) of directions (..., 3)."""
        out = _numbers("pdf", self.material.pdf(wi, wo))
        if (out < 0.0).any():
            raise _refused("pdf", "densities of at least 0", float(out.min()))
        return _shaped("pdf", out, wi.shape[:-1])


def _refused(method: str, rule: str, got: object) -> ValueError:
    return _check.fail("material", f"{method} must return {rule}", got)


def _numbers(method: str, value: Any) -> Float64Array:
    try:
        out = np.asarray(_check.array("material", value), dtype=np.float64)
    except ValueError:
        raise _refused(method, "an array of real numbers", value) from None
    bad = ~np.isfinite(out)
    if bad.any():
        raise _refused(method, "finite numbers", float(out[bad][0]))
    return out


def _shaped(method: str, out: Float64Array, *shapes: tuple[int, ...]) -> Float64Array:
    """``out`` if it is of one of some shapes, or broadcast to the first that it can be."""
    if out.shape in shapes:
        return out
    for shape in shapes:
        pairs = zip(out.shape[::-1], shape[::-1], strict=False)
        if out.ndim <= len(shape) and all(a in (1, b) for a, b in pairs):
            return np.broadcast_to(out, shape)
    raise _refused(method, f"an array of shape {' or '.join(map(str, shapes))}", out.shape)
