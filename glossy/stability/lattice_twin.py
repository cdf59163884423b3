"""The lattice once more, in extended precision: plain matrices, angles and powers.

As ``lattice.frame`` and ``lattice.shade`` print it, with their constants. The covariance is
inverted as a matrix, axes come from an angle, and Schlick's term and level are written out. Shared
are the tables, ``lattice_taps`` and ``reflectivity_table``, which ``checks`` measures by
themselves.
"""

from typing import Any

import numpy as np

from ..brdf import Lobe
from ..lattice import frame, tap
from ..lattice.table import lattice_taps, reflectivity_table
from ..pyramid import Pyramid
from ..taps import tap_constants
from .twin import Extended, Float64Array, extended, lookup


def _number(value: Any) -> np.longdouble:
    return np.longdouble(float(value))


def _matrix(xx: Any, xy: Any, yy: Any) -> Extended:
    """Symmetric (K, 2, 2)."""
    rows = np.broadcast_arrays(xx, xy, xy, yy)
    return np.asarray(np.stack(rows, axis=-1).reshape(*rows[0].shape, 2, 2))


def _inverse(a: Extended) -> Extended:
    det = a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] * a[..., 1, 0]
    swapped = np.stack([a[..., 1, 1], -a[..., 0, 1], -a[..., 1, 0], a[..., 0, 0]], axis=-1)
    return np.asarray((swapped / det[..., None]).reshape(a.shape))


def _below(z: Extended) -> tuple[Extended, Extended]:
    """Normal distribution by the approximation of ``frame``, and its density."""
    density = np.exp(-z * z / 2) * _number(frame.INV_SQRT_2PI)
    t = 1 / (1 + _number(frame.P) * z)
    terms = (frame.B1, frame.B2, frame.B3, frame.B4, frame.B5)
    series: Any = sum(_number(b) * t ** (k + 1) for k, b in enumerate(terms))
    return np.asarray(1 - density * series), np.asarray(density)


def _moments(wo: Extended, lobe: Lobe) -> tuple[Extended, Extended]:
    """Mean (K, 2) and covariance (K, 2, 2) of slopes, eqs. (1) to (3) of ``frame``."""
    mx, my = (extended(m) for m in lobe.widths)
    beta = 1 - extended(lobe.alpha)
    s = np.stack([mx * mx / 2, my * my / 2])
    se = s * wo[:, :2]  # S e |wo_xy|
    root = np.sqrt(np.maximum((se * wo[:, :2]).sum(axis=-1), _number(frame.TINY)))
    oz = np.maximum(wo[:, 2], _number(frame.GRAZING))
    below, density = _below(np.minimum(oz / (2 * root), _number(frame.FAR)))
    w = 2 * root / oz
    slope, spread = (w * v / (below + w * density) for v in (below, density))
    e = se / root[:, None]
    mean = beta * slope[:, None] * e
    less = beta * (slope * slope - spread)
    a = _matrix(s[0] - less * e[:, 0] ** 2, -less * e[:, 0] * e[:, 1], s[1] - less * e[:, 1] ** 2)
    bend = max(4 * beta - 1, extended(0.0))
    return mean, _inverse(_inverse(a) + bend * np.eye(2))


def _axes(
    wo: Extended, mean: Extended, covariance: Extended
) -> tuple[Extended, Extended, Extended, Extended]:
    """[g1 g2] (K, 2, 2), s1^2, s2^2 and a0 (K,), eq. (4) of ``frame``."""
    hz = 1 / np.sqrt(1 + (mean * mean).sum(axis=-1))
    h = np.concatenate([mean, np.ones_like(mean[:, :1])], axis=-1) * hz[:, None]
    up = np.concatenate([wo[:, :2], np.maximum(wo[:, 2:], _number(frame.GRAZING))], axis=-1)
    c = (up * h).sum(axis=-1)
    dh = hz[:, None, None] * (np.eye(3)[:, :2] - h[:, :, None] * h[:, None, :2])
    wo_dh = (up[:, :, None] * dh).sum(axis=1)
    j = 2 * (h[:, :, None] * wo_dh[:, None] + c[:, None, None] * dh)
    first = np.sqrt((j[..., 0] ** 2).sum(axis=-1))
    shear = (j[..., 0] * j[..., 1]).sum(axis=-1) / first
    height = c * hz**3
    r = np.stack([first, shear, 0 * first, 4 * height / first], axis=-1).reshape(-1, 2, 2)
    image = np.einsum("kab,kbc,kdc->kad", r, covariance, r)
    xx, xy, yy = image[:, 0, 0], image[:, 0, 1], image[:, 1, 1]
    c_det = covariance[:, 0, 0] * covariance[:, 1, 1] - covariance[:, 0, 1] ** 2
    det = (4 * height) ** 2 * c_det
    difference = xx - yy + _number(frame.NUDGE) * det / (xx + yy)
    major = (xx + yy + np.hypot(difference, 2 * xy)) / 2
    minor = det / major
    turn = np.arctan2(2 * xy, difference) / 2
    cosine, sine = np.cos(turn), np.sin(turn)
    axes = np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(-1, 2, 2)
    scaled = axes * np.sqrt(np.stack([major, minor], axis=-1))[:, None]
    return np.einsum("kab,kbc->kac", _inverse(r), scaled), major, minor, height


def _level(variance: Extended, a: float, b: float) -> Extended:
    """Eqs. (5) and (6) of ``shade``."""
    one, base = 4 * extended(a) - extended(b), _number(tap.BASE)
    knee = _number(tap.KNEE) * one
    fine = np.maximum((variance - base) / (one - base) * (one + knee) / (variance + knee), 0)
    scaled = np.maximum((variance + b) / a, extended(1e-4000))
    first = np.floor(np.log2(scaled) / 2)
    u = scaled / 4**first
    slack, scale = _number(tap.SLACK), _number(tap.SCALE)
    return np.asarray(
        np.where(variance < one, fine, first + (slack - 3 / ((u + 4) * (u + 1))) * scale)
    )


def _reflectivity(wo: Extended, lobe: Lobe, side: float) -> Extended:
    """R (K,): ``reflectivity_table`` read bilinearly."""
    mx, my = (extended(m) for m in lobe.widths)
    table = extended(reflectivity_table(*lobe.widths, lobe.alpha))
    x, y = np.sqrt(mx) * abs(wo[:, 0]), np.sqrt(my) * abs(wo[:, 1])
    flat = wo[:, 0] ** 2 + wo[:, 1] ** 2
    seen = flat > _number(tap.TINY)
    k = np.where(seen, np.sqrt((mx * x * x + my * y * y) / np.where(seen, flat, 1)), mx)
    sides = np.where(seen, np.sqrt(x) + np.sqrt(y), 1)
    c = wo[:, 2]
    row = c / 2 * (1 + (1 + k) / (c + k)) * (table.shape[0] - 1)
    column = np.where(seen, np.sqrt(y) / sides, 0) * (table.shape[1] - 1)
    i = np.clip(row.astype(int), 0, table.shape[0] - 2)
    j = np.clip(column.astype(int), 0, max(table.shape[1] - 2, 0))
    u, v = (row - i)[:, None], (column - j)[:, None]
    end = np.minimum(j + 1, table.shape[1] - 1)
    low, high = ((1 - u) * table[i, at] + u * table[i + 1, at] for at in (j, end))
    full, edge, rest = ((1 - v) * low + v * high).T
    alpha = extended(lobe.alpha)
    scale = (c + k) ** (1 - alpha) / np.maximum(c, _number(frame.GRAZING)) ** alpha
    r0 = extended(lobe.r0)
    both = r0 * full + (1 - r0) * edge**5 if side > 0 else (1 - r0) * rest
    return np.asarray(both * scale)


def shade_lobe(
    wo: Extended, axes: tuple[Extended, Extended, Extended], lobe: Lobe, side: float,
    pyramid: Pyramid, samples: int, bias: float,
) -> Extended:  # fmt: skip
    """One lobe of scalar ks and r0 seen from local ``wo`` (K, 3), (K, 3); ``axes``: t, b, n."""
    taps = lattice_taps(samples)
    a, b = tap_constants(pyramid.filter or "box")
    mean, covariance = _moments(wo, lobe)
    g, major, minor, height = _axes(wo, mean, covariance)
    octaves = np.maximum(np.log2(major / minor) / 2, 0)
    t = np.minimum(octaves, 4) / 4
    powers = t[:, None] ** np.arange(5)
    place = np.einsum("nac,kc->kna", extended(taps.place), powers)
    log_weight = powers @ extended(taps.log_weight).T
    log2_width = powers @ extended(taps.log2_width) + np.maximum(octaves - 4, 0)
    s = mean[:, None] + np.einsum("kab,knb->kna", g, place)
    hz = 1 / np.sqrt(1 + (s * s).sum(axis=-1))
    h = np.concatenate([s, np.ones_like(s[..., :1])], axis=-1) * hz[..., None]
    c = (wo[:, None] * h).sum(axis=-1)
    wi = 2 * c[..., None] * h - wo[:, None]
    kept = (c > 0) & (wi[..., 2] > 0) & (wo[:, None, 2] > 0)
    world: Any = sum(
        wi[..., k, None] * (side if k == 2 else 1.0) * axes[k][:, None] for k in range(3)
    )
    d = np.sqrt((world * world).sum(axis=-1)) / np.abs(world).max(axis=-1)
    spread = (minor * 4**log2_width / height)[:, None] * pyramid.size**2 / 4
    variance = spread * np.where(kept, c, 1) * hz**3 * d**3
    light: Float64Array = lookup(pyramid, world, _level(variance, a, b) + bias)
    q = (s[..., 0] / extended(lobe.widths[0])) ** 2 + (s[..., 1] / extended(lobe.widths[1])) ** 2
    exponent = log_weight + (place * place).sum(axis=-1) / 2 - q
    z = np.where(kept, wi[..., 2], 1)
    schlick = (1 - np.minimum(c, 1)) ** 5
    r0 = extended(lobe.r0)
    fresnel = r0 + (1 - r0) * schlick if side > 0 else (1 - r0) * (1 - schlick)
    ramp = np.sqrt(minor) * 2**log2_width
    cosine = z / np.maximum(z, ramp[:, None]) ** extended(lobe.alpha)
    weight = np.where(kept, np.exp(exponent) / hz * cosine * fresnel, 0)
    total = weight.sum(axis=-1, keepdims=True)
    mixed = (weight[..., None] * light).sum(axis=1) / np.where(total > 0, total, 1)
    seen = (wo[:, 2] > 0) & (total[:, 0] > 0)
    value = extended(lobe.ks) * np.where(seen, _reflectivity(wo, lobe, side), 0)
    return np.asarray(value[:, None] * mixed)
