"""Ground truth: the radiance that leaves surface points under an environment map, with its error.

::

    L(wo) = integral over the sphere of L(wi) f(wi, wo) abs(wi.n) dwi                        (1)

L between texel centres is the cube map's seamless bilinear lookup: what infinitely many unfiltered
samples see.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from . import _check
from .brdf import Material
from .cubemap import CubeMap
from .frames import SurfacePoints
from .truth.cells import radiance_tree
from .truth.texels import integrate

Float64Array = npt.NDArray[np.float64]

TOLERANCE = 1e-3
WORK = 2_000_000


@dataclasses.dataclass(frozen=True)
class Truth:
    """Radiance (..., 3) float64, its error (..., 3), and what kind of error that is.

    ``error_kind`` is "bound" (the truth lies within) or "standard" (one standard error).
    ``samples`` (...): evaluations of the BSDF that each point took.
    """

    radiance: Float64Array
    error: Float64Array
    error_kind: str
    estimator: str
    samples: npt.NDArray[np.int64]


def reference(points: SurfacePoints, material: Material, cube: CubeMap, estimator: str = "texels",
              samples: int | None = None, tolerance: float | None = None, seed: int = 0,
              diffuse: bool = True) -> Truth:
    """Ground truth of eq. (1) at surface points.

    Parameters
    ----------
    points : SurfacePoints
        Masked points cost nothing and come out 0.
    material : Material
    cube : CubeMap
    estimator : "texels"
        Deterministic quadrature.
    samples : int, optional
        Most evaluations spent per point and lobe.
    tolerance : float, optional
        Error bound asked for, relative to each point's radiance (1e-3).
    seed : int
        Of the random estimators.
    diffuse : bool
        False leaves the term kd / pi out.
    """
    _check.choice("estimator", estimator, ("texels",))
    tol = TOLERANCE if tolerance is None else _check.positive("tolerance", tolerance)
    work = WORK if samples is None else _check.count("samples", samples)
    _check.count("seed", seed, low=0)
    packed = (material if diffuse else dataclasses.replace(material, kd=0.0)).pack()
    seen = np.asarray(points.coverage)
    frames = np.stack([points.tangent[seen], points.bitangent[seen], points.normal[seen]], axis=1)
    value, bound, used = integrate(frames, points.local_view[seen], packed, radiance_tree(cube),
                                   tol, work)
    radiance, error = np.zeros((*points.shape, 3)), np.zeros((*points.shape, 3))
    count = np.zeros(points.shape, dtype=np.int64)
    radiance[seen], error[seen], count[seen] = value, bound, used
    return Truth(radiance, error, "bound", estimator, count)
