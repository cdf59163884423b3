"""What holds for fits, photons and mirror buffers whatever the numbers: scale, turns, energy."""

import functools
import math
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import glossy
from glossy.camera import Camera
from glossy.frames import normalise, spherical
from glossy.measured.fit import fit_table
from glossy.measured.photon import ABSORBED, REFLECTED, PhotonTable
from glossy.measured.synthetic import synthetic_table
from glossy.planar import MirrorBuffer, map_samples, mirror_camera, render_mirror
from glossy.scenes.geometry import Geometry, Hits
from glossy.scenes.shapes import Rectangle, Transform

Array = npt.NDArray[np.float64]
SEEDS = st.integers(0, 10**6)
FAST: dict[str, Any] = {"grid": 4, "levels": 2, "rounds": 1}

SIGMAS = 5.0
"""Of a binomial count: one in two million."""

# --- fits -----------------------------------------------------------------------------------------


@settings(max_examples=4)
@given(
    st.floats(0.1, 0.5), st.floats(1.0, 3.0), st.floats(0.1, 1.0), st.floats(0.0, 0.5),
    st.floats(0.0, 0.4),
)  # fmt: skip
def test_a_clean_table_gives_its_lobe_back(
    m: float, aspect: float, ks: float, alpha: float, kd: float
) -> None:
    lobe = glossy.Lobe(m, m / aspect, ks=ks, r0=0.6, alpha=alpha)
    fit = fit_table(synthetic_table(glossy.Material(kd, [lobe])), **FAST)
    assert fit.material is not None
    found = fit.material.reflection[0]
    assert found.widths == pytest.approx(lobe.widths, rel=1e-3)
    assert np.multiply(found.ks, found.r0) == pytest.approx(0.6 * ks, rel=5e-3)
    assert fit.material.kd == pytest.approx(kd, abs=1e-3)


@settings(max_examples=3)
@given(st.floats(0.05, 1.2), st.integers(0, 50))
def test_a_brighter_table_has_a_brighter_lobe_of_the_same_shape(scale: float, seed: int) -> None:
    """The metric's error scales with the values: `l2` is linear in them."""
    material = glossy.Material(0.05, [glossy.Lobe(0.25, 0.12, ks=0.7, r0=1.0)])
    plain = synthetic_table(material, noise=0.05, seed=seed)
    scaled = glossy.MeasuredTable(plain.wi, plain.wo, scale * plain.f)
    a, b = (fit_table(t, metric="l2", fixed={"r0": 1.0}, **FAST) for t in (plain, scaled))
    assert a.material is not None
    assert b.material is not None
    one, other = a.material.reflection[0], b.material.reflection[0]
    assert other.widths == pytest.approx(one.widths, rel=1e-3)
    assert other.ks == pytest.approx(np.multiply(scale, one.ks), rel=1e-3)
    assert b.error == pytest.approx(scale * a.error, rel=1e-3)


# --- photons --------------------------------------------------------------------------------------


@functools.cache
def photons(scale: float = 1.0) -> PhotonTable:
    """An isotropic lobe on a diffuse ground."""
    material = glossy.Material(0.2 * scale, [glossy.Lobe(0.3, ks=0.5 * scale)])
    degrees = (np.array([0.0, 30.0, 60.0]), np.arange(0.0, 90.0, 6.0), np.arange(0.0, 360.0, 15.0))
    i, o, p = np.meshgrid(*(np.radians(d) for d in degrees), indexing="ij")
    wi, wo = spherical(i, np.zeros_like(i)).reshape(-1, 3), spherical(o, p).reshape(-1, 3)
    return PhotonTable(glossy.MeasuredTable(wi, wo, material.eval(wi, wo), isotropic=True))


@settings(max_examples=15)
@given(st.floats(0.0, 1.05), st.floats(0.0, 2.0 * math.pi), SEEDS, st.sampled_from([0, 1]))
def test_photons_are_reflected_or_absorbed_and_none_is_made(
    theta: float, phi: float, seed: int, method: int
) -> None:
    count = 2000
    wi = np.broadcast_to(spherical(theta, phi), (count, 3))
    share = photons().shares(wi[:1])
    assert 0.0 < share[0][0] < 1.0
    assert share[1][0] == 0.0
    after = photons().bounce(wi, seed, ("inversion", "rejection")[method])
    left = after.fate == REFLECTED
    assert np.all(left | (after.fate == ABSORBED))
    p = float(share[0][0])
    assert abs(left.sum() - p * count) <= SIGMAS * math.sqrt(count * p * (1.0 - p))
    assert np.all(after.wo[left][:, 2] > 0.0)
    assert not after.wo[~left].any()
    assert np.linalg.norm(after.wo[left], axis=-1) == pytest.approx(1.0, abs=1e-9)


@settings(max_examples=15)
@given(st.floats(0.0, 1.05), st.floats(0.0, 6.0), st.floats(0.1, 3.0))
def test_shares_of_an_isotropic_table_do_not_know_the_azimuth(
    theta: float, phi: float, turn: float
) -> None:
    """And are linear in its values."""
    wi = spherical(np.full(2, theta), np.array([phi, phi + turn]))
    full, half = photons().shares(wi)[0], photons(0.5).shares(wi)[0]
    assert full[0] == pytest.approx(full[1], rel=1e-9)
    assert half == pytest.approx(0.5 * full, rel=1e-9)


# --- mirror buffers -------------------------------------------------------------------------------


class Lit:
    """Shapes of one colour under a sky of another: what the mirror pass is shown."""

    def __init__(self, size: float, place: tuple[float, float, float]) -> None:
        x, y, z = place
        flat = Transform(place, rotation=(-90.0, 0.0, 0.0))
        wall = Transform((x, y + 5.0 * size, z - 4.0 * size))
        self.geometry = Geometry(
            [(Rectangle((4.0 * size, 5.0 * size)), flat), (Rectangle((90 * size, 60 * size)), wall)]
        )

    def of_hits(self, hits: Hits, directions: Array) -> Array:
        return np.where(hits.found[..., None], [0.5, 0.7, 0.9], 0.2)


def buffer(size: float, place: tuple[float, float, float]) -> MirrorBuffer:
    """A wall mirrored in a floor through ``place``, everything ``size`` times as large."""
    base = np.array(place)
    eye, target = base + size * np.array([0.4, 1.3, 2.2]), base + size * np.array([0.0, 0.3, -1.0])
    camera = Camera(tuple(eye), tuple(target), fov=60.0, width=19, height=12)
    mirror = mirror_camera(camera, base, np.array([0.0, 1.0, 0.0]))
    return render_mirror(cast(Any, Lit(size, place)), 0, mirror)


@functools.cache
def plain_buffer() -> MirrorBuffer:
    return buffer(1.0, (0.0, 0.0, 0.0))


def drawn(seed: int) -> tuple[Array, Array]:
    """Points of the floor, and directions to the wall."""
    rng = np.random.default_rng(seed)
    x = rng.uniform([-0.8, 0.0, -1.0], [0.8, 0.0, 1.0], (40, 3))
    return x, normalise(rng.uniform([-5.0, 0.2, -4.0], [5.0, 3.0, -4.0], (40, 3)) - x)


@settings(max_examples=10)
@given(SEEDS, st.floats(1e-3, 1e3), st.sampled_from([1, 2]))
def test_the_length_of_a_direction_does_not_move_its_sample(
    seed: int, length: float, intersections: int
) -> None:
    x, w = drawn(seed)
    a, b = (map_samples(plain_buffer(), x, f * w, intersections) for f in (1.0, length))
    np.testing.assert_allclose(a.x, b.x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(a.y, b.y, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(a.distance, b.distance, rtol=1e-9)
    assert np.all(a.distance > 0.0)


@settings(max_examples=6)
@given(SEEDS, st.floats(0.1, 10.0), st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_a_moved_and_enlarged_room_maps_to_the_same_pixels(
    seed: int, size: float, place: tuple[float, float, float]
) -> None:
    x, w = drawn(seed)
    a = map_samples(plain_buffer(), x, w)
    b = map_samples(buffer(size, place), np.array(place) + size * x, w)
    assume(not a.missed.all())
    kept = ~(a.missed | b.missed)  # one at the very edge of the buffer may fall out by rounding
    assert kept.sum() >= (~a.missed).sum() - 1
    np.testing.assert_allclose(a.x[kept], b.x[kept], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(a.y[kept], b.y[kept], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(size * a.distance[kept], b.distance[kept], rtol=1e-5)
