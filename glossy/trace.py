"""Every sample of one pixel: what an engineer compares with a shader, line by line.

The samples come from the same compiled function as the picture (``shading.k_tap``), so that the sum
of the contributions is the pixel. Columns follow eq. (1) of ``shading``, eq. (4) of ``thesis``::

    contribution = radiance * share * brdf * cos_i / pdf_wi = radiance * weight

share is 1/n for ``regular`` and ``importance``, w / sum w for ``thesis``.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _check, methods
from ._arguments import checked
from ._jit import Scalar, kernel
from .brdf import Lobe, Material
from .footprint import JACOBIAN, k_lobe_area
from .frames import SurfacePoints
from .pyramid import Pyramid
from .sampler import k_trilinear_rgb
from .shading import TABLES as SUMS
from .shading import k_frame, k_fresnel, k_tap
from .tap_table import TapTable
from .thesis import MeanTable, k_share, thesis_table
from .thesis_tiles import BY_BRDF_COS, BY_PDF_COS

FloatArray = npt.NDArray[np.floating]
Vector = tuple[float, float, float]

TABLES: dict[str, Callable[..., TapTable]] = {**SUMS, "thesis": thesis_table}
SUM = -1  # no mean: the weights hold 1/n
COLUMNS = 16


@dataclasses.dataclass(frozen=True)
class Tap:
    """One sample of the pixel.

    ``wh``, ``wi_local`` in the frame (t, b, n), ``wi`` in world coordinates; ``texels`` covered at
    level 0 and the ``level`` asked for (before clamping to the chain); ``radiance`` looked up;
    ``brdf`` [1/sr] with ks; ``pdf_wh``, ``pdf_wi`` [1/sr]; ``share`` of the sample in the mean;
    ``weight`` = share * brdf cos_i / pdf_wi; ``contribution`` = radiance * weight. A sample that is
    not ``kept`` fell below the horizon.
    """

    lobe: int
    index: int
    kept: bool
    wh: Vector
    wi_local: Vector
    wi: Vector
    cos_i: float
    texels: float
    level: float
    radiance: Vector
    brdf: Vector
    pdf_wh: float
    pdf_wi: float
    share: Vector
    weight: Vector
    contribution: Vector


class Printed:
    """Prints as a table, and stands in a list or a debugger as one short line."""

    method: str
    radiance: Vector

    def format_table(self) -> str:
        """The samples as text."""
        raise NotImplementedError

    def __str__(self) -> str:
        return self.format_table()

    def __repr__(self) -> str:
        pixel = " ".join(f"{v:.7g}" for v in self.radiance)
        return f"<{type(self).__name__} of {self.method}: radiance {pixel}>"


@dataclasses.dataclass(frozen=True, repr=False)
class Trace(Printed):
    """All samples of one pixel, and the pixel; ``print`` shows ``format_table``.

    ``radiance`` is the glossy radiance as ``shade`` returns it; ``tap_sum`` the sum of the
    contributions. ``normaliser``: what the sum of each lobe is divided by, n or, for ``thesis``,
    the sum of pdf_wi, pdf_wi * cos_i or brdf * cos_i over the kept samples. ``normal``,
    ``tangent``, ``bitangent``, ``view`` in world coordinates; ``view_local`` in the frame.
    """

    method: str
    options: dict[str, Any]
    normal: Vector
    tangent: Vector
    bitangent: Vector
    view: Vector
    view_local: Vector
    radiance: Vector
    tap_sum: Vector
    normaliser: tuple[Vector, ...]
    taps: tuple[Tap, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; ``schema`` 1."""
        return {"schema": 1, **dataclasses.asdict(self)}

    def format_table(self) -> str:
        """The samples as text, one line each, then the pixel."""
        head = (
            f"{'lobe':>4} {'k':>4} {'wh (t, b, n)':^26} {'wi (world)':^26} {'texels':>10} "
            f"{'level':>7} {'pdf wi':>10} {'brdf':>10} {'share':>8} {'L (rgb)':^32} {'weight':>10}"
        )
        lines = [f"method {self.method}  {self.options}", head]
        below = "below the horizon: adds nothing"
        below += ", is left out" if self.method == "thesis" else ", counts in n"
        for tap in self.taps:
            start = f"{tap.lobe:4d} {tap.index:4d} {vector_text(tap.wh, 8, 5)} "
            if not tap.kept:
                lines.append(f"{start}{below:^40}")
                continue
            lines.append(
                f"{start}{vector_text(tap.wi, 8, 5)} {tap.texels:10.4g} {tap.level:7.3f} "
                f"{tap.pdf_wi:10.4g} {tap.brdf[1]:10.4g} {tap.share[1]:8.5f} "
                f"{vector_text(tap.radiance, 10, 5, 'g')} {tap.weight[1]:10.4g}"
            )
        lines.append("brdf, share and weight: green channel")
        for j, divisor in enumerate(self.normaliser):
            lines.append(f"lobe {j} is divided by {vector_text(divisor, 12, 7, 'g')}")
        lines.append(f"sum of taps {vector_text(self.tap_sum, 12, 7, 'g')}")
        lines.append(f"pixel       {vector_text(self.radiance, 12, 7, 'g')}")
        return "\n".join(lines)


def vector_text(v: Vector, width: int, digits: int, form: str = "f") -> str:
    """Three numbers as columns of a table."""
    return " ".join(f"{x:{width}.{digits}{form}}" for x in v)


def to_vector(v: npt.ArrayLike) -> Vector:
    """Three numbers as a tuple of floats."""
    x, y, z = (float(c) for c in np.asarray(v).reshape(3))
    return x, y, z


@kernel
def _trace(
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    taps: FloatArray,
    lobe: FloatArray,
    ks: FloatArray,
    r0: FloatArray,
    border: FloatArray,
    footprint: Scalar,
    estimator: Scalar,
    bias: Scalar,
    steps: Scalar,
    pi: Scalar,
    buffer: npt.NDArray[np.float32],
    chain: npt.NDArray[np.int64],
    stride: Scalar,
    out: FloatArray,
) -> None:
    # kept, wi (3), texels, level, L (3), weight without F, ks F weight (3), w of a mean (3)
    frame, wo = k_frame(normal, tangent, view)
    area = np.float32(1.0) * pi
    if footprint != JACOBIAN:
        area = k_lobe_area(border[0], border[1], wo, pi)
    for k in range(taps.shape[0]):
        kept, x, y, z, texels, level, weight, schlick = k_tap(
            taps[k], lobe, area, footprint, bias, wo, frame
        )
        if not kept or wo[2] <= np.float32(0.0):
            continue
        r, g, b = k_trilinear_rgb(x, y, z, level, buffer, chain, stride, steps)
        out[k, 0] = np.float32(1.0)
        out[k, 1], out[k, 2], out[k, 3] = x, y, z
        out[k, 4], out[k, 5] = texels, level
        out[k, 6], out[k, 7], out[k, 8] = r, g, b
        out[k, 9] = weight
        share = np.float32(1.0) * pi
        if estimator != SUM:
            share = k_share(estimator, taps[k], wo, weight)
        for c in range(3):
            fresnel = k_fresnel(r0[c], schlick, lobe[4])
            out[k, 10 + c] = ks[c] * fresnel * weight
            out[k, 13 + c] = share * fresnel if estimator == BY_BRDF_COS else share


@checked
def trace(
    point: SurfacePoints,
    material: Material | Lobe,
    pyramid: Pyramid,
    method: str = "regular",
    precision: str = "single",
    **options: Any,
) -> Trace:
    """Every sample that a method takes at one point.

    Parameters
    ----------
    point : SurfacePoints
        Exactly one point (any shape of size 1).
    method : "regular", "importance", "thesis", "lattice" or "auto"
        For ``lattice`` the columns are its own (``lattice.trace.LatticeTrace``); for ``auto`` the
        traces of the methods it chose (``planning.trace.PlanTrace``).
    **options
        As for ``shade``.

    Raises
    ------
    ValueError
        For more than one point, a method without samples to list, or a foreign option.
    """
    if math.prod(point.shape) != 1:
        raise _check.fail("point", "must be a single point", point.shape)
    known = (*TABLES, *methods.TRACES)
    methods.check_options(_check.choice("method", method, known), options)
    if isinstance(material, Lobe):
        material = Material(reflection=[material])
    if method in methods.TRACES:
        listed: Trace = methods.tracer(method)(point, material, pyramid, precision, **options)
        return listed
    dtype = _check.dtype_of(precision)
    given = {"precision": precision, **options}
    table = TABLES[method](material, pyramid, **options)
    cast = table.cast(dtype)
    n, t, v = (
        _check.frozen(a.reshape(3).astype(dtype)) for a in (point.normal, point.tangent, point.view)
    )
    buffer, chain, stride = pyramid.kernel_arguments
    wo = point.local_view.reshape(3)
    estimator = table.estimator if isinstance(table, MeanTable) else SUM
    rows: list[Tap] = []
    normaliser = []
    for j, (lobe, side) in enumerate(material.sided_lobes()):
        part = slice(int(table.first[j]), int(table.first[j + 1]))
        out = np.zeros((part.stop - part.start, COLUMNS), dtype=dtype)
        _trace(
            n, t, v, cast.taps[part], cast.lobes[j], cast.ks[j], cast.r0[j], cast.borders[j],
            cast.footprint, estimator, cast.bias, cast.steps, dtype(math.pi), buffer, chain, stride,
            out,
        )  # fmt: skip
        found = out.astype(float)
        count = len(found) if estimator == SUM else 1  # what the weights of k_tap are divided by
        sums = found[:, 13:16].sum(axis=0)
        taps = []
        for k, row in enumerate(found):
            share = np.full(3, 1.0 / count)
            if estimator != SUM:
                share = row[13:16] / np.where(sums > 0.0, sums, 1.0)
            taps.append(_tap(j, k, lobe, side, table.taps[part][k], wo, row, count, share))
        normaliser.append(_normaliser(taps, estimator))
        rows += taps
    total = np.sum([tap.contribution for tap in rows], axis=0) if rows else np.zeros(3)
    return Trace(
        method=method,
        options={k: o for k, o in given.items() if k != "pattern"},
        normal=to_vector(point.normal),
        tangent=to_vector(point.tangent),
        bitangent=to_vector(point.bitangent),
        view=to_vector(point.view),
        view_local=to_vector(wo),
        radiance=to_vector(methods.resolve(method)(point, material, pyramid, **given)),
        tap_sum=to_vector(total),
        normaliser=tuple(normaliser),
        taps=tuple(rows),
    )


def _normaliser(taps: list[Tap], estimator: int) -> Vector:
    """What the sum over one lobe's samples is divided by, see ``Trace``."""
    kept = [tap for tap in taps if tap.kept]
    if estimator == SUM:
        return to_vector(np.full(3, float(len(taps))))
    cos = np.array([tap.cos_i for tap in kept])
    pdf = np.array([tap.pdf_wi for tap in kept])
    if estimator == BY_BRDF_COS:
        return to_vector(cos @ np.array([tap.brdf for tap in kept]) if kept else np.zeros(3))
    return to_vector(np.full(3, np.sum(pdf * cos if estimator == BY_PDF_COS else pdf)))


def _tap(
    j: int,
    k: int,
    lobe: Lobe,
    side: float,
    tap: FloatArray,
    wo: FloatArray,
    row: FloatArray,
    count: int,
    share: FloatArray,
) -> Tap:
    """One row of the trace, with the quantities that eq. (2) of ``shading`` cancels restored.

    ``count``: factor 1/count in the weights of the row and of ``tap``.
    """
    h = tap[:3]
    cos_h = float(wo @ h)
    local = 2.0 * cos_h * h - wo
    local = local * np.array([1.0, 1.0, side])
    mx, my = lobe.widths
    d = math.exp(-((h[0] / h[2] / mx) ** 2) - (h[1] / h[2] / my) ** 2)
    d /= math.pi * mx * my * h[2] ** 4
    pdf_wh = d / (count * tap[3])
    kept = bool(row[0])
    pdf_wi = pdf_wh / (4.0 * cos_h) if cos_h > 0.0 else 0.0
    cos_i = abs(float(local[2])) if kept else 0.0
    whole = row[10:13] * count  # brdf cos_i / pdf_wi
    brdf = whole * pdf_wi / cos_i if kept and cos_i > 0.0 else np.zeros(3)
    weight = share * whole
    return Tap(
        lobe=j,
        index=k,
        kept=kept,
        wh=to_vector(h),
        wi_local=to_vector(local),
        wi=to_vector(row[1:4]) if kept else to_vector(np.zeros(3)),
        cos_i=cos_i,
        texels=float(row[4]),
        level=float(row[5]),
        radiance=to_vector(row[6:9]),
        brdf=to_vector(brdf),
        pdf_wh=pdf_wh,
        pdf_wi=pdf_wi,
        share=to_vector(share),
        weight=to_vector(weight),
        contribution=to_vector(row[6:9] * weight),
    )
