"""A table's rows as the fitting kernels take them, and the lobes that can be fitted.

With H = wi + wo (transmission: wi mirrored in the surface plane), slopes X = (Hx/Hz)^2 and
Y = (Hy/Hz)^2, c = cos theta_i cos theta_o, tilt = |H|^2 / Hz^2 = 1 / cos^2 theta_h and the Schlick
weight S = (1 - wo.h)^5, every lobe is, times both cosines::

    y = ks (r0 + (1 - r0) S) P(mx, my, alpha)             reflection
    y = ks (1 - r0) (1 - S) P(mx, my, alpha)              transmission                   (1)
    P = g exp(-X/mx^2 - Y/my^2 - alpha ln c) / (mx my)                                   (2)

    kurt       g = tilt^2 c / (2 pi |H|)
    ward       g = sqrt(c) / (4 pi),           alpha = 0, r0 = 1                         (3)
    beckmann   g = tilt^2 G / (4 pi),          alpha = 0                                 (4)

G is the V-cavity term min(1, 2 hz cos theta_i / (wo.h), 2 hz cos theta_o / (wo.h)). The fourth
model has the heavy-tailed density and the height-correlated masking of Smith, alpha = 0::

    ggx        P = tilt^2 / (4 pi mx my) (1 + X/mx^2 + Y/my^2)^-2  2 / (s_i + s_o)       (5)
               s = sqrt(1 + (mx^2 x^2 + my^2 y^2) / z^2)  of each direction

So one exponential a row is all that a lobe costs, and ks r0 and ks (1 - r0) enter linearly. The
diffuse part is y = kd c / pi, in transmission with ``diffuse_transmission`` for kd.

Sources: Kurt et al. 2010 and thesis eqs. 3.4-3.6 (kurt); Ward 1992 (3); Cook and Torrance 1982 with
the normalisation 4 (4); Walter et al. 2007, Heitz 2014 (5). Only ``kurt`` can be rendered; the
others are there to be compared with.
"""

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from .. import _check
from .table import MeasuredTable

Float64Array = npt.NDArray[np.float64]

MODELS = ("kurt", "ward", "beckmann", "ggx")
WEIGHTS = ("auto", "sine", "table", "equal")
LIGHTS = ("above", "below", "both")
GRAZING = 1e-6  # cosine below which a row says nothing: its y is zero whatever the lobe


@dataclasses.dataclass(frozen=True)
class Rows:
    """The rows of one side, K of them in C channels.

    ``features`` (9, K): X, Y, S, ln c, g, then x^2/z^2 and y^2/z^2 of both directions;
    ``diffuse`` (K,): c / pi; ``measured`` (K, C): f c; ``weight`` (K, C):
    zero where nothing was measured; ``ggx``: eq. (5) in place of (2); ``sign``: +1 reflection,
    -1 transmission.
    """

    features: Float64Array
    diffuse: Float64Array
    measured: Float64Array
    weight: Float64Array
    ggx: bool
    sign: float

    @property
    def channels(self) -> int:
        """C."""
        return int(self.measured.shape[1])

    def mean_channel(self) -> "Rows":
        """The same rows with one channel, the mean of those that were measured."""
        if self.channels == 1:
            return self
        some = np.maximum((self.weight > 0.0).sum(axis=1, keepdims=True), 1)
        seen = np.where(self.weight > 0.0, self.measured, 0.0)
        mean = _check.frozen(seen.sum(axis=1, keepdims=True) / some)
        return dataclasses.replace(
            self, measured=mean, weight=_check.frozen(self.weight.max(axis=1, keepdims=True))
        )


def features(wi: Float64Array, wo: Float64Array, model: str) -> Float64Array:
    """Features (9, K) of direction pairs (K, 3), either side; cosines must not vanish."""
    ci, co = np.abs(wi[:, 2]), np.abs(wo[:, 2])
    hx, hy, hz = wi[:, 0] + wo[:, 0], wi[:, 1] + wo[:, 1], ci + co
    length = np.sqrt(hx * hx + hy * hy + hz * hz)
    tilt = (length / hz) ** 2
    dx, dy, dz = wi[:, 0] - wo[:, 0], wi[:, 1] - wo[:, 1], ci - co
    u = 0.5 * length
    schlick = ((dx * dx + dy * dy + dz * dz) / (4.0 * (1.0 + u))) ** 5
    if model == "kurt":
        g = tilt**2 * ci * co / (2.0 * math.pi * length)
    elif model == "ward":
        g = np.sqrt(ci * co) / (4.0 * math.pi)
    else:
        g = tilt**2 / (4.0 * math.pi)
        if model == "beckmann":
            g *= np.minimum(1.0, 2.0 * (hz / length) * np.minimum(ci, co) / u)
    slopes = [(v / z) ** 2 for w, z in ((wi, ci), (wo, co)) for v in (w[:, 0], w[:, 1])]
    rows = [(hx / hz) ** 2, (hy / hz) ** 2, schlick, np.log(ci * co), g, *slopes]
    return np.ascontiguousarray(np.stack(rows))


def row_weights(table: MeasuredTable, kind: str) -> Float64Array:
    """Weight (K,) of every row: the table's solid angles, sin theta_o, or 1."""
    if kind == "sine" or (kind == "auto" and table.weight is None):
        return np.asarray(np.hypot(table.wo[:, 0], table.wo[:, 1]))
    if kind == "equal":
        return np.ones(len(table.wo))
    if table.weight is None:
        raise _check.fail("weights", "needs a table with solid angles", kind)
    return np.asarray(table.weight, dtype=np.float64)


def lit_from(table: MeasuredTable, light: str) -> MeasuredTable:
    """The rows with the light "above" the surface, "below" it, or "both".

    Raises
    ------
    ValueError
        If there are none.
    """
    _check.choice("light", light, LIGHTS)
    if light == "both":
        return table
    rows = table.wi[:, 2] > 0.0 if light == "above" else table.wi[:, 2] < 0.0
    if not rows.any():
        raise _check.fail("light", f"the table has no light from {light}", light)
    return table if rows.all() else table.select(rows)


def rows_of(table: MeasuredTable, side: str, model: str, weights: str) -> Rows | None:
    """Rows of one side of a table, "reflection" or "transmission"; None if it has none.

    Zero measurements get weight zero (thesis eq. 3.7 sums over the non-zero ones), rows at the
    horizon are left out. Pairs below the surface are taken as seen from there.
    """
    _check.choice("model", model, MODELS)
    _check.choice("weights", weights, WEIGHTS)
    reflection = side == "reflection"
    zi, zo = table.wi[:, 2], table.wo[:, 2]
    keep = (zi * zo > 0.0) if reflection else (zi * zo < 0.0)
    keep &= (np.abs(zi) > GRAZING) & (np.abs(zo) > GRAZING)
    wi, wo, f = table.wi[keep], table.wo[keep], np.asarray(table.f)[keep]
    w = row_weights(table, weights)[keep, None] * (f != 0.0)
    if not w.any():
        return None
    c = np.abs(wi[:, 2] * wo[:, 2])
    return Rows(
        features=_check.frozen(features(wi, wo, model)),
        diffuse=_check.frozen(c / math.pi),
        measured=_check.frozen(f * c[:, None]),
        weight=_check.frozen(w),
        ggx=model == "ggx",
        sign=1.0 if reflection else -1.0,
    )


def diffuse_mode(f: npt.ArrayLike) -> float:
    """Kd = pi times the most common BSDF value, thesis section 3.4.1.

    The value is the mean of the fullest bin of a histogram of the non-zero values ``f`` (K,); the
    bins are 2 IQR / K^(1/3) wide (Freedman and Diaconis 1981) and end at the 95th percentile,
    beyond which lie the highlights. Never negative.
    """
    values = _check.array("f", f).reshape(-1)
    values = values[values != 0.0]
    if not len(values):
        return 0.0
    low, q1, q3, high = np.percentile(values, [0.0, 25.0, 75.0, 95.0])
    width = 2.0 * (q3 - q1) / len(values) ** (1.0 / 3.0)
    if width <= 0.0 or high <= low:
        return max(0.0, math.pi * float(np.median(values)))
    bins = int(min(max(math.ceil((high - low) / width), 8), 4096))
    counts, edges = np.histogram(values, bins=bins, range=(low, high))
    k = int(np.argmax(counts))
    inside = (values >= edges[k]) & (values <= edges[k + 1])
    return max(0.0, math.pi * float(values[inside].mean()))
