"""Every tap of one pixel of the lattice, from the kernels of its picture (``lattice.tap``).

With w, F and R of eq. (4) of ``shade``::

    share = w F / sum w F,   weight = ks R share,   contribution = radiance * weight
"""

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check, methods
from .._jit import Scalar, kernel
from ..brdf import Material
from ..frames import SurfacePoints
from ..pyramid import Pyramid
from ..sampler import k_trilinear_rgb
from ..shading import k_frame
from ..trace import Printed, Vector, to_vector, vector_text
from .shade import lattice_table
from .tap import k_gauss_level, k_lattice_pixel, k_lattice_tap, k_reflected

FloatArray = npt.NDArray[np.floating]

COLUMNS = 12
ZERO, ONE = np.float32(0.0), np.float32(1.0)


@dataclasses.dataclass(frozen=True)
class LatticeTap:
    """One tap: ``wh``, ``wi_local`` in the frame (t, b, n), ``wi`` in world coordinates.

    ``area``: a of eq. (3); ``texels``: variance of the tap in texels^2 of level 0; the ``level``
    asked for; ``relative``: w of eq. (2), without F. A tap not ``kept`` fell below the horizon.
    """

    lobe: int
    index: int
    kept: bool
    wh: Vector
    wi_local: Vector
    wi: Vector
    area: float
    texels: float
    level: float
    radiance: Vector
    relative: float
    share: Vector
    weight: Vector
    contribution: Vector


@dataclasses.dataclass(frozen=True, repr=False)
class LatticeTrace(Printed):
    """All taps of one pixel, and the pixel; fields as in ``glossy.trace.Trace``.

    ``normaliser``: sum w F of each lobe; ``reflectivity``: its ks R.
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
    reflectivity: tuple[Vector, ...]
    taps: tuple[LatticeTap, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; ``schema`` 1."""
        return {"schema": 1, **dataclasses.asdict(self)}

    def format_table(self) -> str:
        """The taps as text, one line each, then the pixel."""
        lines = [
            f"method {self.method}  {self.options}",
            f"{'lobe':>4} {'k':>4} {'wh (t, b, n)':^26} {'wi (world)':^26} {'a':>8} {'texels':>10} "
            f"{'level':>7} {'w':>10} {'share':>8} {'L (rgb)':^32} {'weight':>10}",
        ]
        for tap in self.taps:
            start = f"{tap.lobe:4d} {tap.index:4d} {vector_text(tap.wh, 8, 5)} "
            if not tap.kept:
                lines.append(f"{start}{'below the horizon: left out':^40}")
                continue
            lines.append(
                f"{start}{vector_text(tap.wi, 8, 5)} {tap.area:8.5f} {tap.texels:10.4g} "
                f"{tap.level:7.3f} {tap.relative:10.4g} {tap.share[1]:8.5f} "
                f"{vector_text(tap.radiance, 10, 5, 'g')} {tap.weight[1]:10.4g}"
            )
        lines.append("share and weight: green channel; texels: variance of the tap")
        for j, (divisor, white) in enumerate(zip(self.normaliser, self.reflectivity, strict=True)):
            lines.append(f"lobe {j} is divided by {vector_text(divisor, 12, 7, 'g')}")
            lines.append(f"lobe {j} reflects      {vector_text(white, 12, 7, 'g')}")
        lines.append(f"sum of taps {vector_text(self.tap_sum, 12, 7, 'g')}")
        lines.append(f"pixel       {vector_text(self.radiance, 12, 7, 'g')}")
        return "\n".join(lines)


@kernel
def _trace(
    normal: FloatArray,
    tangent: FloatArray,
    view: FloatArray,
    taps: FloatArray,
    width: FloatArray,
    lobe: FloatArray,
    ks: FloatArray,
    r0: FloatArray,
    table: FloatArray,
    law: FloatArray,
    texels: Scalar,
    bias: Scalar,
    steps: Scalar,
    buffer: npt.NDArray[np.float32],
    chain: npt.NDArray[np.int64],
    stride: Scalar,
    out: FloatArray,
    white: FloatArray,
) -> None:
    # out: kept, wi (3), a, variance, level, L (3), w, Schlick's term; white: ks R
    frame, wo = k_frame(normal, tangent, view)
    if wo[2] <= ZERO:
        return
    pixel = k_lattice_pixel(wo, lobe, width)
    spread = pixel[7] * texels
    for k in range(taps.shape[0]):
        kept, x, y, z, area, weight, schlick = k_lattice_tap(taps[k], lobe, pixel, wo, frame)
        if not kept:
            continue
        d = ONE / max(abs(x), abs(y), abs(z))
        variance = spread * area * (d * d * d)
        level = k_gauss_level(variance, law[0], law[1]) + bias
        r, g, b = k_trilinear_rgb(x, y, z, level, buffer, chain, stride, steps)
        out[k, 0] = ONE
        out[k, 1], out[k, 2], out[k, 3] = x, y, z
        out[k, 4], out[k, 5], out[k, 6] = area, variance, level
        out[k, 7], out[k, 8], out[k, 9] = r, g, b
        out[k, 10], out[k, 11] = weight, schlick
    white[0], white[1], white[2] = k_reflected(table, lobe, ks, r0, wo)


def trace_lattice(
    point: SurfacePoints, material: Material, pyramid: Pyramid, precision: str, **options: Any
) -> LatticeTrace:
    """Every tap at one point; ``glossy.trace`` has checked the arguments."""
    dtype = _check.dtype_of(precision)
    own = {k: o for k, o in options.items() if k != "kernel"}
    table = lattice_table(material, pyramid, **own).cast(dtype)
    n, t, v = (
        _check.frozen(a.reshape(3).astype(dtype)) for a in (point.normal, point.tangent, point.view)
    )
    buffer, chain, stride = pyramid.kernel_arguments
    wo = point.local_view.reshape(3)
    rows: list[LatticeTap] = []
    sums, whites = [], []
    for j, (_, side) in enumerate(material.sided_lobes()):
        part = slice(int(table.first[j]), int(table.first[j + 1]))
        out = np.zeros((part.stop - part.start, COLUMNS), dtype=dtype)
        white = np.zeros(3, dtype=dtype)
        _trace(
            n, t, v, table.taps[part], table.widths[j], table.lobes[j], table.ks[j], table.r0[j],
            table.white[j], table.law, table.texels, table.bias, table.steps,
            buffer, chain, stride, out, white,
        )  # fmt: skip
        found = out.astype(float)
        r0 = table.r0[j].astype(float)
        fresnel = (r0 if side > 0.0 else 0.0) + (1.0 - r0) * found[:, 11:]
        relative = found[:, 10:11] * fresnel
        total = relative.sum(axis=0)
        shares = relative / np.where(total > 0.0, total, 1.0)
        sums.append(to_vector(total))
        whites.append(to_vector(white))
        rows += [_tap(j, k, side, wo, point, *pair, white)
                 for k, pair in enumerate(zip(found, shares, strict=True))]  # fmt: skip
    given = {"precision": precision, **options}
    contributions = [tap.contribution for tap in rows]
    return LatticeTrace(
        method="lattice",
        options=given,
        normal=to_vector(point.normal),
        tangent=to_vector(point.tangent),
        bitangent=to_vector(point.bitangent),
        view=to_vector(point.view),
        view_local=to_vector(wo),
        radiance=to_vector(methods.resolve("lattice")(point, material, pyramid, **given)),
        tap_sum=to_vector(np.sum(contributions, axis=0) if rows else np.zeros(3)),
        normaliser=tuple(sums),
        reflectivity=tuple(whites),
        taps=tuple(rows),
    )


def _tap(
    j: int,
    k: int,
    side: float,
    wo: FloatArray,
    point: SurfacePoints,
    row: FloatArray,
    share: FloatArray,
    white: FloatArray,
) -> LatticeTap:
    """One row; wh from the two directions."""
    kept = bool(row[0])
    basis = np.stack([v.reshape(3) for v in (point.tangent, point.bitangent, point.normal)])
    local = basis @ row[1:4]
    half = local * [1.0, 1.0, side] + wo
    wh = half / np.linalg.norm(half) if kept else np.zeros(3)
    weight = white * share
    return LatticeTap(
        lobe=j,
        index=k,
        kept=kept,
        wh=to_vector(wh),
        wi_local=to_vector(local),
        wi=to_vector(row[1:4]),
        area=float(row[4]),
        texels=float(row[5]),
        level=float(row[6]),
        radiance=to_vector(row[7:10]),
        relative=float(row[10]),
        share=to_vector(share),
        weight=to_vector(weight),
        contribution=to_vector(row[7:10] * weight),
    )
