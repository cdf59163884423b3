"""The lattice method: its loops against a plain evaluation, its limits, and its error."""

import math

import numpy as np
import numpy.typing as npt
import pytest

import glossy
from glossy import Lobe, Material, SurfacePoints, methods
from glossy.albedo import lobe_albedo
from glossy.lattice.table import counts, lattice_taps, nearest_count
from glossy.stability import checks
from glossy.stability.cases import make_map
from glossy.taps import tap_constants

Array = npt.NDArray[np.float64]

MATERIALS = {
    "round": Material(reflection=[Lobe(0.15)]),
    "long": Material(reflection=[Lobe(0.3, 0.06, ks=[0.9, 0.6, 0.3], r0=[0.9, 0.4, 0.1])]),
    "two": Material(reflection=[Lobe(0.05, alpha=0.5, ks=0.5), Lobe(0.4, 0.2, r0=0.04, alpha=1.0)]),
    "thin": Material(transmission=[Lobe(0.2, 0.1, r0=[0.1, 0.3, 0.5], alpha=0.3)]),
}

FURNACE = 1e-3
"""What reading the reflectivity bilinearly from its table costs, relative."""
SINGLE = 2e-4
"""Axes of nearly round lobes turn with rounding; the pattern with them."""
TILED = 2e-5
"""Two orders of the same float32 operations; round lobes as above."""


def points(count: int = 40, seed: int = 3, low: float = 0.05) -> SurfacePoints:
    r = np.random.default_rng(seed)
    n = r.normal(size=(count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    t = np.cross(n, r.normal(size=(count, 3)))
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    c = r.uniform(low, 1.0, count)[:, None]
    phi = r.uniform(0.0, 2.0 * math.pi, count)[:, None]
    side = np.sqrt(1.0 - c * c) * (np.cos(phi) * t + np.sin(phi) * np.cross(n, t))
    return SurfacePoints(n, t, c * n + side)


def gauss_level(v: Array, a: float, b: float) -> Array:
    """Eqs. (5) and (6) of ``lattice.shade``."""
    one, base = 4.0 * a - b, 1.0 / 6.0
    knee = 0.5 * one
    fine = np.maximum((v - base) / (one - base) * (one + knee) / (v + knee), 0.0)
    u = np.maximum((v + b) / a, 1e-300)
    first = np.floor(0.5 * np.log2(u))
    u = u * 4.0**-first
    return np.where(v < one, fine, first + (0.3 - 3.0 / ((u + 4.0) * (u + 1.0))) / 0.225)


def moments(wo: Array, mx: float, my: float, beta: float) -> tuple[Array, Array]:
    """Eqs. (1)-(3) of ``lattice.frame`` with plain matrices."""
    flat = wo[:2]
    s = np.diag([mx * mx, my * my]) / 2.0
    size = math.hypot(*flat)
    if size < 1e-12:
        mean, a = np.zeros(2), s
    else:
        e = flat / size
        su = math.sqrt(e @ s @ e)
        z = min(wo[2] / (2.0 * size * su), 12.0)
        below = 0.5 * math.erfc(-z / math.sqrt(2.0))
        density = math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
        w = 2.0 * size * su / wo[2]
        total = below + w * density
        slope, spread = w * below / total, w * density / total
        mean = beta * slope * (s @ e) / su
        a = s - beta * (slope**2 - spread) * np.outer(s @ e, s @ e) / su**2
    return mean, np.asarray(
        np.linalg.inv(np.linalg.inv(a) + max(4.0 * beta - 1.0, 0.0) * np.eye(2))
    )


def twin(p: SurfacePoints, material: Material, pyramid: glossy.Pyramid, samples: int) -> Array:
    """The method one point and one tap at a time, by plain matrices."""
    out = np.zeros((len(p.normal), 3))
    a, b = tap_constants(pyramid.filter or "box")
    for k, wo in enumerate(p.local_view):
        frame = np.stack([p.tangent[k], p.bitangent[k], p.normal[k]])
        for lobe, side in material.sided_lobes():
            mx, my = lobe.widths
            mean, c = moments(wo, mx, my, 1.0 - lobe.alpha)
            h = np.append(mean, 1.0) / math.sqrt(1.0 + mean @ mean)
            dh = h[2] * (np.eye(3)[:, :2] - np.outer(h, h[:2]))
            j = 2.0 * (np.outer(h, wo @ dh) + (wo @ h) * dh)
            q, r = np.linalg.qr(j)
            variance, axes = np.linalg.eigh(r @ c @ r.T)
            s2, s1 = np.sqrt(variance)
            g = np.linalg.inv(r) @ axes[:, ::-1] * [s1, s2]
            assert q.shape == (3, 2)
            if np.linalg.det(g) * np.linalg.det(np.linalg.inv(r)) < 0.0:
                g[:, 1] *= -1.0  # taps come in pairs z, -z: only the handedness matters
            place, weight, width = lattice_taps(samples).at(s1 / s2)
            s = mean + place @ g.T
            wh = np.column_stack([s, np.ones(len(s))])
            wh /= np.linalg.norm(wh, axis=1, keepdims=True)
            cos = wh @ wo
            wi = 2.0 * cos[:, None] * wh - wo
            keep = (cos > 0.0) & (wi[:, 2] > 0.0)
            w = weight * np.exp(0.5 * (place**2).sum(1) - (s[:, 0] / mx) ** 2 - (s[:, 1] / my) ** 2)
            ramp = np.maximum(wi[:, 2], width * s2) ** -lobe.alpha
            w = np.where(keep, w * wi[:, 2] * ramp / wh[:, 2], 0.0)
            world = (wi * [1.0, 1.0, side]) @ frame
            area = np.abs(cos) * wh[:, 2] ** 3 / ((wo @ h) * h[2] ** 3)
            spread = (width * s2) ** 2 * area * pyramid.size**2 / 4.0
            v = spread / np.abs(world).max(axis=1) ** 3
            light = pyramid.sample(world, gauss_level(v, a, b), precision="double")
            one = (1.0 - np.minimum(cos, 1.0)) ** 5
            r0 = np.broadcast_to(lobe.r0, 3)
            f = r0 + (1.0 - r0) * one[:, None]
            f = f if side > 0.0 else 1.0 - f
            white = lobe_albedo(lobe, wo, transmitted=side < 0.0)
            wf = w[:, None] * f
            out[k] += white * (wf * light).sum(0) / wf.sum(0)
    return out


def spots(filter: str = "round") -> glossy.Pyramid:
    return glossy.build_pyramid(glossy.environment("spots", size=64), filter=filter)


def relative(a: npt.ArrayLike, b: npt.ArrayLike) -> float:
    x, y = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    return float(np.sqrt(np.mean((x - y) ** 2) / np.mean(y**2)))


@pytest.mark.parametrize("name", MATERIALS)
def test_the_kernel_is_the_equations(name: str) -> None:
    p, pyramid = points(12), spots()
    got = glossy.shade(p, MATERIALS[name], pyramid, method="lattice", precision="double", samples=8)
    assert relative(got, twin(p, MATERIALS[name], pyramid, 8)) < FURNACE


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("samples", [1, 7, 8])
def test_vector_loop_and_plain_loop_agree(name: str, samples: int) -> None:
    p, pyramid = points(200), spots("gauss6")
    shade = [
        glossy.shade(p, MATERIALS[name], pyramid, method="lattice", samples=samples, **options)
        for options in ({}, {"kernel": "plain"}, {"precision": "double"})
    ]
    assert relative(shade[0], shade[1]) < TILED
    assert relative(shade[1], shade[2]) < SINGLE


@pytest.mark.parametrize("m", [(0.01, 0.01), (0.15, 0.15), (0.5, 0.5), (0.3, 0.03), (2.0, 0.5)])
@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_white_light_gives_the_albedo(m: tuple[float, float], alpha: float) -> None:
    """Whatever the number of taps and however many fall below the horizon."""
    p = points(100, low=0.02)
    material = Material(reflection=[Lobe(*m, alpha=alpha, r0=[1.0, 0.5, 0.04])])
    white = glossy.build_pyramid(glossy.environment("white", size=8))
    want = material.albedo(p.local_view)[0]
    for samples in (1, 6, 20):
        got = glossy.shade(
            p, material, white, method="lattice", samples=samples, precision="double"
        )
        np.testing.assert_allclose(got, want, rtol=5e-3)
        assert relative(got, want) < FURNACE


@pytest.mark.parametrize(
    ("m", "figures"),
    [
        ((0.05, 0.05), (4e-4, 8e-4, 1.5e-3)),
        ((0.003, 0.003), (7e-4, 2e-3, 4e-3)),
        ((1e-4, 1e-4), (5e-3, 6e-3, 1e-2)),
        ((0.03, 0.003), (5e-4, 2e-3, 3e-3)),
        ((1.0, 1e-3), (3e-3, 5e-3, 1e-2)),
    ],
)
def test_white_light_within_the_figures_of_the_page(
    m: tuple[float, float], figures: tuple[float, float, float]
) -> None:
    """The table in docs/lattice.md, for r0 = 1, .5, .04: reached to a quarter, and not passed."""
    many = 90 if m[0] == m[1] else 30  # a long lobe's albedo takes its time
    c = np.concatenate([np.geomspace(1.01e-6, 0.1, many), np.linspace(0.1, 0.999, many // 2)])
    phi = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, c.size)
    s = np.sqrt((1.0 - c) * (1.0 + c))
    wo = np.stack([s * np.cos(phi), s * np.sin(phi), c], axis=-1)
    up, side = np.broadcast_to([0.0, 0.0, 1.0], wo.shape), np.broadcast_to([1.0, 0, 0], wo.shape)
    white = glossy.build_pyramid(glossy.environment("white", size=8))
    largest = np.zeros(3)
    for alpha in (0.0, 1.0):
        material = Material(reflection=[Lobe(*m, alpha=alpha, r0=[1.0, 0.5, 0.04])])
        got = glossy.shade(
            SurfacePoints(up, side, wo), material, white, method="lattice", samples=1,
            precision="double",
        )  # fmt: skip
        gap = np.abs(got / material.albedo(wo)[0] - 1.0)
        largest = np.maximum(largest, gap.max(axis=0))
    assert np.all(largest <= figures)
    assert np.all(largest > np.array(figures) / 4.0)


def test_turning_scene_and_map_together_changes_nothing() -> None:
    """A quarter turn about y, which maps faces onto faces."""
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # z -> x -> -z
    p, cube = points(50), glossy.environment("spots", size=32)
    texels = glossy.build_pyramid(cube).levels[0]
    directions = cube_directions(32)
    turned = glossy.CubeMap(cube.lookup(directions @ turn))  # L'(w) = L(turn^T w)
    assert texels.shape == turned.faces.shape
    q = SurfacePoints(p.normal @ turn.T, p.tangent @ turn.T, p.view @ turn.T)
    material = Material(reflection=[Lobe(0.3, 0.1)])
    pair = [
        glossy.shade(a, material, glossy.build_pyramid(c), method="lattice", precision="double")
        for a, c in ((p, cube), (q, turned))
    ]
    assert relative(pair[1], pair[0]) < 2e-6  # float32 texels looked up at their centres


def cube_directions(n: int) -> Array:
    x = (np.arange(n) + 0.5) * 2.0 / n - 1.0
    s, t = np.meshgrid(x, x)
    o = np.ones_like(s)
    faces = ((o, -t, -s), (-o, -t, s), (s, o, t), (s, -o, -t), (s, -t, o), (-s, -t, -o))
    d = np.stack([np.stack(f, axis=-1) for f in faces])
    return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))


def test_linear_in_radiance_and_black_from_behind() -> None:
    p = points(30)
    cube = glossy.environment("studio", size=32)
    twice = glossy.CubeMap(2.0 * cube.faces)
    material = MATERIALS["two"]
    one, two = (
        glossy.shade(p, material, glossy.build_pyramid(c), method="lattice") for c in (cube, twice)
    )
    np.testing.assert_array_equal(two, 2.0 * one)
    with pytest.warns(UserWarning, match="look into the surface"):
        behind = SurfacePoints(p.normal, p.tangent, -p.view)
    assert not glossy.shade(behind, material, glossy.build_pyramid(cube), method="lattice").any()


@pytest.mark.parametrize(("alpha", "largest"), [(0.5, 2e-3), (1.0, 8e-3)])
def test_taps_set_without_a_jump(alpha: float, largest: float) -> None:
    """Radiance times its cosine to the alpha along a turning view: 20 000 steps, 30 taps to set.

    Without the ramp at the horizon whole taps went out for alpha = 1: steps of 8 % here, 24 % with
    seven taps.
    """
    theta = np.linspace(0.3, 1.55, 20001)
    view = np.stack([np.sin(theta), np.cos(theta), 0.0 * theta], axis=-1)
    up, side = (
        np.broadcast_to([0.0, 1.0, 0.0], view.shape),
        np.broadcast_to([1.0, 0, 0], view.shape),
    )
    p = SurfacePoints(up, side, view)
    pyramid = glossy.build_pyramid(glossy.environment("studio", size=64), filter="round")
    for samples in (7, 30):
        light = glossy.shade(
            p, Lobe(0.3, alpha=alpha), pyramid, method="lattice", precision="double",
            samples=samples,
        )[:, 1] * np.cos(theta) ** alpha  # fmt: skip
        assert np.abs(np.diff(np.log(light))).max() < largest


@pytest.mark.parametrize("lobe", [Lobe(0.05), Lobe(0.15), Lobe(0.4), Lobe(0.2, 0.075)])
def test_error_falls_below_the_papers_patterns(lobe: Lobe) -> None:
    """At equal taps, on a map that no table was made with, against the integral itself."""
    p, cube = points(150), glossy.environment("spots", size=128)
    material = Material(reflection=[lobe])
    truth = glossy.reference(p, material, cube, tolerance=2e-3).radiance
    round_taps, gauss6 = (glossy.build_pyramid(cube, filter=f) for f in ("round", "gauss6"))
    n = len(glossy.pattern_for_budget(lobe, 14))
    error = relative(glossy.shade(p, material, round_taps, method="lattice", samples=n), truth)
    regular = min(
        relative(glossy.shade(p, material, gauss6, samples=14, footprint=f, bias=b), truth)
        for f in ("paper", "thesis", "jacobian")
        for b in (-1.0, -0.5, 0.0)
    )
    assert error < 0.8 * regular
    few = relative(glossy.shade(p, material, round_taps, method="lattice", samples=3), truth)
    assert error < few


def test_more_elongated_lobes_want_more_taps_and_the_table_gives_them() -> None:
    for n in counts():
        taps = lattice_taps(n)
        assert len(taps) == n
        for elongation in (1.0, 3.0, 16.0, 100.0):
            place, weight, width = taps.at(elongation)
            assert weight.min() > 0.0
            assert weight.sum() == pytest.approx(1.0)
            np.testing.assert_allclose(weight @ place, 0.0, atol=1e-12)
            assert width > 0.0
            spread = weight @ place**2 + np.array([width / elongation, width]) ** 2
            if n >= 3 and elongation == 1.0:
                np.testing.assert_allclose(spread, 1.0, atol=0.2)


def test_budget_takes_the_nearest_count() -> None:
    largest = counts()[-1]
    assert nearest_count(7) == 7
    assert nearest_count(10 * largest) == largest
    assert methods.tap_count("lattice", Lobe(0.1), 9) == 9
    with pytest.raises(ValueError, match=r"^samples: must be"):
        nearest_count(0)


@pytest.mark.parametrize("name", MATERIALS)
def test_traced_taps_add_up_to_the_pixel(name: str) -> None:
    p, pyramid, material = points(6, low=0.01), spots(), MATERIALS[name]
    picture = glossy.shade(
        p, material, pyramid, method="lattice", precision="double", samples=9, bias=0.5
    )
    for k in range(len(picture)):
        trace = glossy.trace(p[k], material, pyramid, "lattice", "double", samples=9, bias=0.5)
        np.testing.assert_allclose(trace.radiance, picture[k], rtol=1e-12)
        np.testing.assert_allclose(trace.tap_sum, picture[k], rtol=1e-12)
        kept = [tap for tap in trace.taps if tap.kept]
        assert 0 < len(kept) <= 9 * len(material.sided_lobes())
        for tap in kept:
            looked_up = pyramid.sample(tap.wi, tap.level, precision="double")
            np.testing.assert_allclose(tap.radiance, looked_up, rtol=1e-12)
            both = (1.0, 1.0, math.copysign(1.0, tap.wi_local[2])) * np.array(tap.wi_local)
            mirrored = 2.0 * (np.dot(tap.wh, trace.view_local)) * np.array(tap.wh) - both
            np.testing.assert_allclose(mirrored, trace.view_local, atol=1e-12)
        text = trace.format_table()
        assert len(text.splitlines()) == len(trace.taps) + 5 + 2 * len(trace.normaliser)
        assert trace.to_dict()["schema"] == 1


@pytest.mark.parametrize("m", [(1e-4, 1e-4), (2.0, 2.0), (1.0, 1e-3)])
@pytest.mark.parametrize("alpha", [0.0, 1.0])
def test_hard_lobes_and_views_stay_finite(m: tuple[float, float], alpha: float) -> None:
    """Views to 1e-6 above the surface and along the normal, 1000:1, one texel, levels off the end.

    Every pixel is within the map's range times the albedo; both loops agree with double precision
    to a few roundings of the input, 2e-7 over wo.n.
    """
    material = Material(reflection=[Lobe(*m, alpha=alpha, r0=[0.2, 0.5, 1.0])])
    room = 5e-3 if m[0] == m[1] else 4e-2  # a table of 65 x 49 nodes at 1000:1
    for cosine in (1.0, 0.1, 1e-6):
        p = checks.points_of((cosine,), "axes")
        white = np.asarray(material.albedo(p.local_view)[0])
        for size, samples, bias in ((1, 1, 0.0), (32, 7, 0.0), (32, 64, 50.0), (32, 8, -1e30)):
            cube = make_map("smooth", size)
            pyramid = glossy.build_pyramid(cube)
            values = [
                glossy.shade(
                    p, material, pyramid, method="lattice", samples=samples, bias=bias, **options
                )
                for options in ({"precision": "double"}, {}, {"kernel": "plain"})
            ]
            low, high = cube.faces.min(axis=(0, 1, 2)), cube.faces.max(axis=(0, 1, 2))
            for value in values:
                assert np.all(value >= (1.0 - room) * low * white)
                assert np.all(value <= (1.0 + room) * high * white)
                np.testing.assert_allclose(value, values[0], rtol=1e-5 + 2e-7 / cosine)


def test_bad_input_is_one_line() -> None:
    p, pyramid = points(2), spots()
    for options, name in (({"samples": 0}, "samples"), ({"bias": math.nan}, "bias")):
        with pytest.raises(ValueError, match=f"^{name}: "):
            glossy.shade(p, MATERIALS["round"], pyramid, method="lattice", **options)
    with pytest.raises(ValueError, match=r"^prepared: must be a Pyramid"):
        glossy.shade(p, MATERIALS["round"], "spots", method="lattice")
    with pytest.raises(ValueError, match=r"^elongation: must be"):
        lattice_taps(7).at(0.5)
