"""Bounding planes for the methods without a table of half vectors: twins, errors, scenes."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import rooms
import test_splitsum
import tolerances
from test_lattice import gauss_level
from test_planes import FLOOR_AND_CEILING, redirect, spread

import glossy
from glossy import BoundingPlanes, Lobe, Material, SurfacePoints, methods
from glossy.frames import normalise
from glossy.planning.auto import planned
from glossy.splitsum.chain import SplitSumChain
from glossy.taps import tap_constants

Array = npt.NDArray[np.float64]

LONG = Lobe(0.3, 0.1, ks=(0.9, 0.5, 0.2), r0=(0.9, 0.3, 0.04), alpha=0.3)
MATERIAL = Material(reflection=[LONG, Lobe(0.2, r0=0.5)], transmission=[Lobe(0.1, 0.2, ks=0.5)])
CHAINED = test_splitsum.NAMES


@pytest.fixture(scope="module")
def room() -> glossy.CubeMap:
    return rooms.capture(64)


@pytest.fixture(scope="module")
def pyramid(room: glossy.CubeMap) -> glossy.Pyramid:
    return glossy.build_pyramid(room, filter="round")


@pytest.fixture(scope="module")
def chain(room: glossy.CubeMap) -> SplitSumChain:
    return glossy.split_sum_chain(room)


def lattice_twin(p: SurfacePoints, pyramid: glossy.Pyramid, planes: BoundingPlanes) -> Array:
    """Sum over the traced taps, each with the variance it has along the corrected direction."""
    a, b = tap_constants(pyramid.filter or "box")
    out = np.zeros((*p.shape, 3))
    assert p.position is not None
    for k in range(p.shape[0]):
        found = glossy.trace(p[k], MATERIAL, pyramid, "lattice", "double", samples=9)
        for tap in found.taps:
            if not tap.kept:
                continue
            w = np.array(tap.wi)
            v = redirect(planes, p.position[k], w)
            change = (np.abs(w).max() / np.abs(normalise(v)).max()) ** 3
            if planes.footprint == "projected":
                change *= spread(planes, p.position[k], w)
            level = gauss_level(np.array(tap.texels * change), a, b)
            out[k] += np.array(tap.weight) * pyramid.sample(v, level, precision="double")
    return out


@pytest.mark.parametrize(
    "planes",
    [
        rooms.planes(),
        rooms.planes(blend=0.5),
        BoundingPlanes(rooms.CENTRE, FLOOR_AND_CEILING, blend=0.3, footprint="projected"),
    ],
    ids=["nearest", "blend", "projected"],
)
def test_the_lattice_is_its_plain_twin(planes: BoundingPlanes, pyramid: glossy.Pyramid) -> None:
    p = rooms.sphere_points(3, 1)
    options: dict[str, Any] = {"method": "lattice", "samples": 9, "parallax": planes}
    fast = glossy.shade(p, MATERIAL, pyramid, precision="double", **options)
    # finite differences of the footprint, where it is projected; constants of the level in float32
    limit = 1e-4 if planes.footprint == "projected" else 1e-7
    np.testing.assert_allclose(fast, lattice_twin(p, pyramid, planes), rtol=limit)
    single = glossy.shade(p, MATERIAL, pyramid, **options)
    np.testing.assert_allclose(single, fast, rtol=50.0 * tolerances.SINGLE)


class Turned:
    """A chain looked up where directions from the points of ``position`` meet the planes."""

    def __init__(self, chain: SplitSumChain, planes: BoundingPlanes, position: Array) -> None:
        self.chain, self.planes, self.position = chain, planes, position

    def sample(self, directions: Array, m: float, precision: str) -> Any:
        pairs = zip(self.position, directions, strict=True)
        turned = np.array([redirect(self.planes, x, w) for x, w in pairs])
        return self.chain.sample(turned, m, precision)


@pytest.mark.parametrize("name", CHAINED)
def test_lookups_in_a_chain_are_turned(name: str, chain: SplitSumChain) -> None:
    p, planes = rooms.sphere_points(30, 2), rooms.planes(blend=0.2)
    assert p.position is not None
    own: dict[str, Any] = {"samples": 6} if name == "axis-taps" else {}
    turned: Any = Turned(chain, planes, p.position)
    expected = test_splitsum.twin(p, MATERIAL, turned, name, 6)
    image = glossy.shade(p, MATERIAL, chain, name, "double", parallax=planes, **own)
    assert glossy.relative_rms(image, expected) < tolerances.ALBEDO_TABLE
    single = glossy.shade(p, MATERIAL, chain, name, parallax=planes, **own)
    assert glossy.relative_rms(single, image) < 10.0 * tolerances.SINGLE


@pytest.mark.parametrize("method", ["lattice", "split-sum", "axis-taps", "auto"])
def test_planes_bring_the_picture_to_the_truth(
    method: str, room: glossy.CubeMap, pyramid: glossy.Pyramid, chain: SplitSumChain
) -> None:
    """At places away from the centre; seen head-on, where a split sum is exact."""
    ball, turned = rooms.sphere_points(60, 3), rooms.sphere_points(60, 4)
    p = SurfacePoints(turned.normal, None, turned.normal, position=ball.position)
    prepared: Any = chain if method in CHAINED else pyramid
    planes = rooms.planes()
    lobe = Lobe(0.05, 0.15) if method == "axis-taps" else Lobe(0.1)
    own: dict[str, Any] = {"max_error": 0.02} if method == "auto" else {}
    truth = glossy.reference(p, lobe, room, "qmc", 2048, parallax=planes).radiance
    with_planes = glossy.shade(p, lobe, prepared, method, parallax=planes, **own)
    without = glossy.shade(p, lobe, prepared, method, **own)
    # lookups keep their solid angle as the point sees it: "projected" would follow the walls
    assert glossy.relative_rms(with_planes, truth) < 0.04
    assert glossy.relative_rms(without, truth) > 0.2


@pytest.mark.parametrize("method", ["lattice", *CHAINED, "auto"])
def test_at_the_centre_and_without_planes_nothing_changes(
    method: str, pyramid: glossy.Pyramid, chain: SplitSumChain
) -> None:
    p = rooms.sphere_points(20, 5)
    centred = SurfacePoints(p.normal, p.tangent, p.view, position=rooms.CENTRE)
    prepared: Any = chain if method in CHAINED else pyramid
    plain = glossy.shade(p, MATERIAL, prepared, method, precision="double")
    for points, planes in (
        (centred, rooms.planes(blend=0.5)),
        (p, BoundingPlanes(rooms.CENTRE, [])),
    ):
        same = glossy.shade(points, MATERIAL, prepared, method, "double", parallax=planes)
        np.testing.assert_allclose(same, plain, rtol=1e-9)


def test_auto_turns_the_lookups_of_its_plan(pyramid: glossy.Pyramid) -> None:
    p, planes = rooms.sphere_points(20, 6), rooms.planes()
    material = Material(reflection=[Lobe(0.1)])
    found = planned(material, pyramid, 0.02, points=p)
    assert found.method == "lattice"
    image = glossy.shade(p, material, pyramid, "auto", max_error=0.02, parallax=planes)
    own: dict[str, Any] = {"samples": found.samples[0]}
    np.testing.assert_array_equal(
        image, glossy.shade(p, material, pyramid, "lattice", parallax=planes, **own)
    )


def test_what_has_no_meaning_is_refused(
    chain: SplitSumChain, pyramid: glossy.Pyramid, monkeypatch: pytest.MonkeyPatch
) -> None:
    p = rooms.sphere_points(2, 7)
    wide = rooms.planes(footprint="projected")
    with pytest.raises(ValueError, match="footprint: must be 'thesis' for method 'split-sum'"):
        glossy.shade(p, Lobe(0.1), chain, "split-sum", parallax=wide)
    monkeypatch.delitem(methods.PLANES, "lattice")
    with pytest.raises(ValueError, match=r"parallax: is for the methods .*, got 'lattice'"):
        glossy.shade(p, Lobe(0.1), pyramid, "lattice", parallax=rooms.planes())


def test_masked_points_and_backs_are_black(pyramid: glossy.Pyramid, chain: SplitSumChain) -> None:
    p = rooms.sphere_points(20, 8)
    mask = np.arange(20) % 3 > 0
    with pytest.warns(UserWarning, match="20 of 20 points look into the surface"):
        back = SurfacePoints(p.normal, p.tangent, -p.view, position=p.position)
    masked = SurfacePoints(p.normal, p.tangent, p.view, mask, p.position)
    for method in ("lattice", "axis-taps"):
        prepared: Any = chain if method in CHAINED else pyramid
        assert not glossy.shade(back, MATERIAL, prepared, method, parallax=rooms.planes()).any()
        part = glossy.shade(masked, MATERIAL, prepared, method, parallax=rooms.planes())
        whole = glossy.shade(p, MATERIAL, prepared, method, parallax=rooms.planes())
        assert not part[~mask].any()
        np.testing.assert_array_equal(part[mask], whole[mask])
