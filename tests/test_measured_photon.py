"""Photon bounces: shares, directions, tries, and what one threshold a photon does wrong."""

import pathlib

import chi2
import measured_files as files
import numpy as np
import numpy.typing as npt
import pytest

import glossy
from glossy.frames import reflect, spherical
from glossy.measured.leave_one_out import leave_one_out
from glossy.measured.photon import PhotonTable

Array = npt.NDArray[np.float64]

ALPHA = 1e-3
"""One false alarm in a thousand families of goodness-of-fit tests; the seeds are fixed."""

RULE = 0.02
"""Kinks of a piecewise linear density in the bins of the test's quadrature, and the rim."""

MATERIAL = glossy.Material(kd=0.2, reflection=[glossy.Lobe(0.3, 0.3, ks=0.5)])


def table(theta_i: Array, step: float = 5.0) -> glossy.MeasuredTable:
    """An isotropic table of a lobe on a diffuse ground."""
    grids = (np.radians(theta_i), np.radians(np.arange(0.0, 90.0, step)),
             np.radians(np.arange(0.0, 360.0, 2.0 * step)))  # fmt: skip
    i, o, p = np.meshgrid(*grids, indexing="ij")
    wi, wo = spherical(i, np.zeros_like(i)).reshape(-1, 3), spherical(o, p).reshape(-1, 3)
    return glossy.MeasuredTable(wi, wo, MATERIAL.eval(wi, wo), isotropic=True)


@pytest.fixture(scope="module")
def paint() -> glossy.MeasuredTable:
    return table(np.array([0.0, 25.0, 50.0, 75.0]))


@pytest.fixture(scope="module")
def blind(tmp_path_factory: pytest.TempPathFactory) -> glossy.MeasuredTable:
    path = tmp_path_factory.mktemp("photon") / "blind.xml"
    files.write_klems(path)
    raw = glossy.read_measured(path)
    return glossy.MeasuredTable(raw.wi, raw.wo, 0.2 * raw.f)  # so that some light is absorbed


def test_shares_are_the_albedo(paint: glossy.MeasuredTable) -> None:
    """At measured angles; the triangles of 5 by 10 degrees and the polygon at the rim cost 1 %."""
    photons = PhotonTable(paint)
    wi = spherical(np.radians([25.0, 50.0]), np.array([0.3, 2.0]))
    r, t = photons.shares(wi)
    np.testing.assert_allclose(r, MATERIAL.albedo(wi)[0], rtol=0.02)
    assert not t.any()
    half_way = spherical(np.radians(37.5), 1.0)
    assert photons.shares(half_way)[0] == pytest.approx(r.mean(), rel=1e-6)


@pytest.mark.parametrize("method", ["inversion", "rejection"])
@pytest.mark.parametrize("interpolation", ["linear", "half-vector"])
def test_photons_follow_their_density(
    paint: glossy.MeasuredTable, blind: glossy.MeasuredTable, method: str, interpolation: str
) -> None:
    cases = [
        (PhotonTable(t, interpolation), spherical(np.radians(a), 0.4) * [1, 1, s])
        for t, a, s in ((paint, 60.0, 1), (blind, 30.0, -1))
    ]
    for photons, wi in cases:
        bounce = photons.bounce(np.broadcast_to(wi, (30_000, 3)), seed=1, method=method)
        r, t = photons.shares(wi)
        for fate, share in ((0, 1.0 - r - t), (1, r), (2, t)):
            seen = np.mean(bounce.fate == fate)
            assert abs(seen - share) < 4.0 * np.sqrt(share * (1.0 - share) / 30_000) + 1e-9
        moving = bounce.wo[bounce.fate == 1]
        assert np.all(moving[:, 2] * wi[2] > 0.0)
        np.testing.assert_allclose(np.linalg.norm(moving, axis=1), 1.0, atol=1e-9)
        pole = reflect(wi, [0.0, 0.0, 1.0])

        def reflected(w: Array, p: PhotonTable = photons, v: Array = wi) -> Array:
            return np.where(w[:, 2] * v[2] > 0.0, p.density(w, v, method), 0.0)

        density = chi2.expected(reflected, pole, 0.5)
        if interpolation == "linear":
            assert density.sum() == pytest.approx(float(r), rel=RULE)
        probability = density / density.sum()
        p = chi2.p_value(chi2.counts(moving, pole, 0.5), probability)
        assert p > chi2.sidak(ALPHA, 8)


def test_tries_are_as_many_as_expected(paint: glossy.MeasuredTable) -> None:
    """Geometric with the expected mean; the inversion needs one."""
    photons = PhotonTable(paint)
    wi = np.broadcast_to(spherical(np.radians(40.0), 0.0), (20_000, 3))
    expected = float(photons.expected_tries(wi[0]))
    bounce = photons.bounce(wi, seed=3, method="rejection")
    tries = bounce.tries[bounce.fate == 1]
    assert abs(tries.mean() - expected) < 4.0 * expected / np.sqrt(len(tries))
    fast = photons.bounce(wi, seed=3)
    assert set(fast.tries[fast.fate == 1]) == {1}
    assert not fast.tries[fast.fate == 0].any()
    np.testing.assert_array_equal(fast.fate, bounce.fate)  # one roulette for both


def test_one_threshold_a_photon_is_biased(paint: glossy.MeasuredTable) -> None:
    """The thesis's pseudo-code, in plain NumPy, fails the test that the redrawn one passes."""
    photons = PhotonTable(paint)
    wi = spherical(np.radians(25.0), 0.0)
    rng = np.random.default_rng(4)
    top = float(photons.expected_tries(wi)) * float(photons.shares(wi)[0]) / (2.0 * np.pi)
    pole = reflect(wi, [0.0, 0.0, 1.0])
    probability = chi2.expected(
        lambda w: np.where(w[:, 2] > 0.0, photons.density(w, wi), 0.0), pole, 0.5
    )
    probability /= probability.sum()
    passed = {}
    for redrawn in (False, True):
        todo, found = rng.random(20_000) * top, []
        for _ in range(300):  # a threshold near the top is hardly ever passed: those are dropped
            z, turn = rng.random(len(todo)), rng.random(len(todo)) * 2.0 * np.pi
            w = spherical(np.arccos(z), turn)
            taken = todo < photons.density(w, wi)
            found.append(w[taken])
            todo = todo[~taken]
            if redrawn:
                todo = rng.random(len(todo)) * top
        counted = chi2.counts(np.concatenate(found), pole, 0.5)
        passed[redrawn] = chi2.p_value(counted, probability) > ALPHA
    assert passed == {False: False, True: True}


def test_same_seed_same_fate(paint: glossy.MeasuredTable) -> None:
    photons = PhotonTable(paint)
    wi = np.broadcast_to(spherical(0.5, 0.0), (100, 3))
    a, b, c = photons.bounce(wi, 7), photons.bounce(wi[:50], 7), photons.bounce(wi, 8)
    np.testing.assert_array_equal(a.wo[:50], b.wo)
    assert np.any(a.wo != c.wo)


def test_refusals(paint: glossy.MeasuredTable) -> None:
    photons = PhotonTable(paint)
    with pytest.raises(ValueError, match="method: must be one of"):
        photons.bounce([[0.0, 0.0, 1.0]], method="guess")
    with pytest.raises(ValueError, match=r"wi: must have shape \(K, 3\)"):
        photons.bounce([0.0, 0.0, 1.0])
    with pytest.raises(ValueError, match="interpolation: must be one of"):
        PhotonTable(paint, "cubic")


# leaving directions out -------------------------------------------------------------------------


def test_leave_one_out_prefers_alignment_for_a_lobe() -> None:
    found = leave_one_out(table(np.arange(0.0, 76.0, 15.0)))
    assert [round(x.theta) for x in found] == [15, 30, 45, 60]
    for left in found:
        assert left.error["half-vector"] < 0.5 * left.error["linear"]
        assert left.peak["half-vector"] < left.peak["linear"]
    assert len(leave_one_out(table(np.arange(0.0, 76.0, 15.0)), most=2)) == 2
    with pytest.raises(ValueError, match="lies between others"):
        leave_one_out(table(np.array([0.0, 30.0])))


def test_leave_one_out_on_real_data(real_data: pathlib.Path) -> None:
    """A satin film: alignment halves the error."""
    table = glossy.read_measured(real_data / "brdf" / "satin_rosaline_rgb.bsdf")
    found = leave_one_out(table, most=3)
    mean = {name: np.mean([x.error[name] for x in found]) for name in ("linear", "half-vector")}
    assert len(found) == 3
    assert mean["half-vector"] < 0.5 * mean["linear"]
