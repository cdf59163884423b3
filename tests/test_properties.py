"""Properties that hold whatever the numbers: resolution, symmetry, agreement of the estimators."""

import math

import numpy as np
import plain_truth
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from symmetry import rotations, turn_faces

import glossy
from glossy.cubemap import texel_directions
from glossy.frames import normalise

MAGNIFIED = 0.04
"""Smooth map at N = 16 against 64: the filter widens the coarse levels by a share of a texel."""

SIGMAS = 6.0
"""A few hundred correlated standard errors from 16 replicates, whose tails are heavy."""

WIDTHS = st.floats(0.02, 1.0)
METHODS = st.sampled_from(["regular", "importance", "thesis"])


def smooth(size: int) -> glossy.CubeMap:
    """Averages over texels of a map of low order: the same light at every N."""
    fine = 256 // size
    d = normalise(texel_directions(256))
    light = np.stack([1.0 + 0.5 * d[..., 0], 1.5 + d[..., 1] * d[..., 2], 0.5 + d[..., 2] ** 2], -1)
    return glossy.CubeMap(light.reshape(6, size, fine, size, fine, 3).mean(axis=(2, 4)))


def noise(seed: int, size: int = 8) -> glossy.CubeMap:
    return glossy.CubeMap(np.random.default_rng(seed).random((6, size, size, 3)))


def turned(p: glossy.SurfacePoints, r: plain_truth.Array) -> glossy.SurfacePoints:
    return glossy.SurfacePoints(p.normal @ r.T, p.tangent @ r.T, p.view @ r.T)


PYRAMIDS = {size: glossy.build_pyramid(smooth(size)) for size in (16, 64)}


@settings(max_examples=30)
@given(WIDTHS, WIDTHS, METHODS, st.integers(5, 60), st.integers(0, 1000))
def test_resolution_does_not_change_brightness(
    mx: float, my: float, method: str, samples: int, seed: int
) -> None:
    """The footprint counts texels, so N cancels: a smooth map looks the same at any N."""
    p, lobe = plain_truth.points(seed, 8, 0.2), glossy.Lobe(mx, my)
    coarse, fine = (
        glossy.shade(p, lobe, PYRAMIDS[size], method, "double", samples=samples)
        for size in (16, 64)
    )
    assert np.all(np.abs(coarse - fine) <= MAGNIFIED * fine.max())
    assert coarse.mean() == pytest.approx(fine.mean(), rel=0.01)


@settings(max_examples=15)
@given(WIDTHS, WIDTHS, st.integers(0, 23), st.floats(0.0, 1.0), st.integers(0, 1000))
def test_truth_turns_with_the_scene(
    mx: float, my: float, turn: int, alpha: float, seed: int
) -> None:
    """Cube symmetries carry texels onto texels: both results lie within both bounds."""
    r, lobe = rotations()[turn], glossy.Lobe(mx, my, alpha=alpha, r0=0.3)
    p, cube = plain_truth.points(seed, 3, 0.1), noise(seed)
    a = glossy.reference(p, lobe, cube)
    b = glossy.reference(turned(p, r), lobe, glossy.CubeMap(turn_faces(cube.faces, r)))
    assert np.all(np.abs(a.radiance - b.radiance) <= a.error + b.error)


@settings(max_examples=8)
@given(WIDTHS, st.integers(1, 23), st.sampled_from(["mc", "qmc"]), st.integers(0, 1000))
def test_random_truths_turn_with_the_scene(m: float, turn: int, kind: str, seed: int) -> None:
    """The draws meet the map elsewhere after a turn: equal within the standard errors."""
    r, lobe = rotations()[turn], glossy.Lobe(m)
    p, cube = plain_truth.points(seed, 4, 0.2), noise(seed)
    a = glossy.reference(p, lobe, cube, kind, samples=2048)
    b = glossy.reference(turned(p, r), lobe, glossy.CubeMap(turn_faces(cube.faces, r)), kind,
                         samples=2048)  # fmt: skip
    assert np.all(np.abs(a.radiance - b.radiance) <= SIGMAS * np.hypot(a.error, b.error) + 1e-9)


@settings(max_examples=12)
@given(
    st.floats(0.005, 1.5),
    st.floats(0.005, 1.5),
    st.floats(0.0, 1.0),
    st.floats(0.05, 1.0),
    st.booleans(),
    st.integers(0, 10**6),
)
def test_the_three_truths_agree(
    mx: float, my: float, alpha: float, cosine: float, through: bool, seed: int
) -> None:
    """They share the lookup and the BSDF only: any lobe, view and side."""
    lobe = glossy.Lobe(mx, my, alpha=alpha, r0=0.2)
    material = glossy.Material(0.2, [] if through else [lobe], [lobe] if through else [])
    p, cube = plain_truth.point(seed, cosine), noise(seed)
    bound = glossy.reference(p, material, cube)
    for kind in ("mc", "qmc"):
        random = glossy.reference(p, material, cube, kind, samples=4096, seed=seed)
        gap = np.abs(random.radiance - bound.radiance)
        assert np.all(gap <= bound.error + SIGMAS * random.error + 1e-9), kind


@settings(max_examples=10)
@given(WIDTHS, WIDTHS, st.floats(0.05, 1.0), METHODS, st.integers(0, 1000))
def test_more_light_is_never_darker(
    mx: float, my: float, cosine: float, method: str, seed: int
) -> None:
    """Every weight and every filter tap is positive, so a map that is larger looks brighter."""
    rng = np.random.default_rng(seed)
    faces = rng.random((6, 8, 8, 3))
    more = faces + rng.random(faces.shape) * (rng.random(faces.shape) < 0.1)
    p = plain_truth.point(seed, cosine)
    dark, bright = (
        glossy.shade(p, glossy.Lobe(mx, my), glossy.build_pyramid(glossy.CubeMap(f)), method,
                     "double")
        for f in (faces, more)
    )  # fmt: skip
    assert np.all(bright >= dark * (1.0 - 1e-6))
    assert math.isfinite(float(bright.max()))
