"""Ground truth of planar reflectors: the lobes integrated by casting rays into the scene.

::

    L(x, wo) = integral L_met(x, wi) f(wi, wo) abs(wi.n) dwi                                (1)

L_met is the radiance of the first thing that the ray from x along wi meets: the diffuse world of
light maps, lights and sky (``scenes.capture``), which the mirror pass shows too. The lobe's light
is thus exact up to its standard error, where the mirror buffer has only what the mirrored camera
sees. Nothing here knows of buffers; the estimators are those of ``glossy.reference``.
"""

from collections.abc import Iterator

import numpy as np

from .. import _check
from ..reference import MOST_SAMPLES, SAMPLES, Truth, draw_passes, seen_points
from ..scenes.prepared import PreparedScene
from ..scenes.render import Part
from ..scenes.shapes import Box, Rectangle, Sphere
from ..truth.rays import Float64Array, LightSampler, RayDraws

ESTIMATORS = ("qmc", "mc")


def reference_planar(
    prepared: PreparedScene,
    part: Part,
    estimator: str = "qmc",
    samples: int | None = None,
    tolerance: float | None = None,
    seed: int = 0,
) -> Truth:
    """Ray-cast truth of eq. (1) at the points of a reflector.

    Parameters
    ----------
    prepared : PreparedScene
    part : Part
        Of ``scenes.view(prepared).parts``: a rectangle, or any other convex shape (box, sphere),
        which cannot see itself. It is left out of its own rays' way.
    estimator : "qmc" or "mc"
        Low-discrepancy or independent draws.
    samples : int, optional
        Evaluations of the BSDF per point (4096; at most 262 144 when a tolerance is given). Half
        of them are directions towards the scene's area lights and its sky, if it has any.
    tolerance : float, optional
        Double the samples until the RMS of the standard errors is at most this share of the RMS
        radiance.
    seed : int
        A point's draws depend on it and on the point's index alone.

    Returns
    -------
    Truth
        Radiance and standard error (K, 3) of the lobes.

    Raises
    ------
    ValueError
        For an object that is not convex, an unknown estimator, or numbers out of range.
    """
    *_, last = reference_planar_passes(prepared, part, estimator, samples, tolerance, seed)
    return last


def reference_planar_passes(
    prepared: PreparedScene,
    part: Part,
    estimator: str = "qmc",
    samples: int | None = None,
    tolerance: float | None = None,
    seed: int = 0,
) -> Iterator[Truth]:
    """Yield the truth, better from pass to pass; the last is what ``reference_planar`` returns.

    Arguments as there; the samples double from pass to pass.
    """
    _check.choice("estimator", estimator, ESTIMATORS)
    _check.count("seed", seed, low=0, high=2**63 - 1)
    goal = None if tolerance is None else _check.positive("tolerance", tolerance)
    default = SAMPLES if goal is None else MOST_SAMPLES
    most = _check.count("samples", default if samples is None else samples, low=2)
    shape = prepared.scene.objects[part.index].shape
    if not isinstance(shape, Rectangle | Box | Sphere):
        raise _check.fail("part", "must be of a convex shape", type(shape).__name__)
    assert part.points.position is not None

    def trace(origins: Float64Array, directions: Float64Array) -> Float64Array:
        return prepared.world.along(origins, directions, skip=part.index)

    corners = np.array([light.corners() for light in prepared.scene.lights]).reshape(-1, 4, 3)
    seen, frames, views = seen_points(part.points)
    position = part.points.position.reshape(-1, 3)[seen]
    lights = LightSampler(corners, prepared.sky)
    draws = RayDraws(part.material, trace, lights, frames, views, position)
    return draw_passes(part.points.shape, seen, draws, estimator, most, goal, seed)
