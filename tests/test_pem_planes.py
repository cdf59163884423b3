"""The method "pem" with bounding planes."""

import numpy as np
import numpy.typing as npt
import pytest
import rooms
import tolerances
from test_planes import redirect, spread

import glossy
from glossy import BoundingPlanes, Lobe, Material, SurfacePoints
from glossy.frames import normalise
from glossy.pem.glossiness import calibrate
from glossy.pem.maps import PartialMaps
from glossy.pem.shade import FOOTPRINTS, MEAN_SHIFT, cosine_exponent

MATERIAL = Material(reflection=[Lobe(0.2)], transmission=[Lobe(0.1, ks=0.5, r0=0.2)])


@pytest.fixture(scope="module")
def maps() -> PartialMaps:
    return glossy.partial_maps(rooms.capture(64), 6)


@pytest.mark.parametrize("footprint", FOOTPRINTS)
@pytest.mark.parametrize("projected", [False, True])
def test_lookups_are_turned(maps: PartialMaps, footprint: str, projected: bool) -> None:
    """Against turned directions one by one; the albedo from the same method in a white map."""
    kind = "projected" if projected else "thesis"
    p, planes = rooms.sphere_points(20, 2), rooms.planes(blend=0.2, footprint=kind)
    assert p.position is not None
    white = glossy.partial_maps(glossy.environment("white", size=8), 6)
    cos_o = np.sum(p.view * p.normal, axis=-1, keepdims=True)
    expected = np.zeros((20, 3))
    for part, m, r in (
        (Material(reflection=MATERIAL.reflection), 0.2, 2.0 * cos_o * p.normal - p.view),
        (Material(transmission=MATERIAL.transmission), 0.1, -p.view),
    ):
        pairs = list(zip(p.position, r, strict=True))
        v = normalise([redirect(planes, x, w) for x, w in pairs])
        level = np.full(20, float(calibrate(maps.filter, 64).level(cosine_exponent(m))))
        if footprint != "constant":
            level -= 1.5 * np.log2(np.abs(v).max(axis=-1)) + MEAN_SHIFT
        if footprint == "view":
            level += 0.5 * np.log2(cos_o[:, 0])
        if projected:
            level += 0.5 * np.log2([spread(planes, x, w) for x, w in pairs])
        albedo = glossy.shade(p, part, white, method="pem", precision="double")
        expected += albedo * maps.sample(v, level, precision="double")
    image = glossy.shade(
        p, MATERIAL, maps, "pem", "double", parallax=planes, footprint=footprint
    )  # fmt: skip
    # finite differences of the spread where it is projected; constants pass through float32
    assert glossy.relative_rms(image, expected) < (1e-4 if projected else 1e-6)
    single = glossy.shade(p, MATERIAL, maps, "pem", parallax=planes, footprint=footprint)
    assert glossy.relative_rms(single, image) < 10.0 * tolerances.SINGLE


def test_planes_bring_the_picture_to_the_truth(maps: PartialMaps) -> None:
    """Seen head-on, where the cosine is the lobe: what is left is the filter's error."""
    ball, turned = rooms.sphere_points(60, 3), rooms.sphere_points(60, 4)
    p = SurfacePoints(turned.normal, None, turned.normal, position=ball.position)
    truth = glossy.reference(p, Lobe(0.1), maps.cube, "qmc", 2048, parallax=rooms.planes()).radiance
    near = glossy.shade(p, Lobe(0.1), maps, "pem", parallax=rooms.planes(), footprint="distance")
    without = glossy.shade(p, Lobe(0.1), maps, "pem", footprint="distance")
    assert glossy.relative_rms(near, truth) < 0.06
    assert glossy.relative_rms(without, truth) > 0.2


def test_visibility_with_planes(maps: PartialMaps) -> None:
    """All seen is all of it; it is linear; nothing seen is black."""
    p, planes = rooms.sphere_points(40, 6), rooms.planes()
    shares = np.random.default_rng(1).random((40, 6))

    def under(visibility: npt.NDArray[np.float64] | None) -> npt.NDArray[np.floating]:
        return glossy.shade(
            p, MATERIAL, maps, "pem", "double", parallax=planes, visibility=visibility
        )

    whole = under(None)
    np.testing.assert_allclose(under(np.ones(6)), whole, rtol=tolerances.SINGLE)
    both = np.add(under(shares), under(1.0 - shares))
    np.testing.assert_allclose(both, whole, rtol=tolerances.SINGLE)
    assert not np.any(under(np.zeros(6)))


def test_without_planes_nothing_changes(maps: PartialMaps) -> None:
    p = rooms.sphere_points(20, 5)
    plain = glossy.shade(p, MATERIAL, maps, "pem", "double", footprint="distance", bias=0.4)
    same = glossy.shade(
        p, MATERIAL, maps, "pem", "double", parallax=BoundingPlanes(rooms.CENTRE, []),
        footprint="distance", bias=0.4,
    )  # fmt: skip
    np.testing.assert_allclose(same, plain, rtol=1e-9)
