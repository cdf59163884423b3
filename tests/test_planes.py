"""Bounding planes: the kernel against a plain twin, rays cast in a room, and the truth."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import rooms
import tolerances
from hypothesis import given
from hypothesis import strategies as st
from test_transmission import DENSE

import glossy
from glossy import BoundingPlanes, Lobe, Material, SurfacePoints
from glossy.frames import normalise, spherical
from glossy.truth.planes import PlaneLight

Array = npt.NDArray[np.float64]

LOBE = Lobe(0.15, 0.25, r0=0.3, alpha=0.3)
BOTH_SIDES = Material(reflection=[LOBE], transmission=[Lobe(0.2, ks=0.7, r0=0.1)])
FLOOR_AND_CEILING = [((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), ((0.0, 2.5, 0.0), (0.0, -2.0, 0.0))]


def smooth_max(a: float, b: float, k: float) -> float:
    low = max(0.0, k - abs(a - b)) ** 2 / (4.0 * k) if k > 0.0 else 0.0
    return max(a, b) + low


def redirect(planes: BoundingPlanes, x: Array, w: Array) -> Array:
    """The definition, one ray at a time."""
    q = 0.0
    for point, normal in planes.planes:
        distance = float(np.dot(np.subtract(point, x), normal))
        if distance != 0.0:
            q = smooth_max(float(np.dot(w, normal)) / distance, q, planes.width)
    return np.asarray(w + q * (x - planes.centre))


def spread(planes: BoundingPlanes, x: Array, w: Array) -> float:
    """Solid angle at the centre per solid angle at the point, by finite differences."""
    u = normalise(np.cross(w, [0.3, -0.7, 0.6]))
    v = np.cross(w, u)
    h = 1e-4
    sides = [
        normalise(redirect(planes, x, normalise(w + h * e)))
        - normalise(redirect(planes, x, normalise(w - h * e)))
        for e in (u, v)
    ]
    return float(np.linalg.norm(np.cross(sides[0], sides[1]))) / (4.0 * h * h)


def twin(
    p: SurfacePoints, material: Any, pyramid: glossy.Pyramid, planes: BoundingPlanes, **options: Any
) -> Array:
    """Sum over the traced samples, each looked up where its direction meets the planes."""
    out = np.zeros((*p.shape, 3))
    assert p.position is not None
    power = 1 if options.get("footprint") == "paper" else 3
    for k in range(p.shape[0]):
        for tap in glossy.trace(p[k], material, pyramid, precision="double", **options).taps:
            if not tap.kept:
                continue
            w = np.array(tap.wi)
            v = redirect(planes, p.position[k], w)
            ratio = (np.abs(w).max() / np.abs(normalise(v)).max()) ** power
            if planes.footprint == "projected":
                ratio *= spread(planes, p.position[k], w)
            level = tap.level + 0.5 * math.log2(ratio)
            value = pyramid.sample(v, level, precision="double")
            out[k] += np.array(tap.weight) * value
    return out


@pytest.fixture(scope="module")
def room() -> glossy.CubeMap:
    return rooms.capture(64)


@pytest.fixture(scope="module")
def pyramid(room: glossy.CubeMap) -> glossy.Pyramid:
    return glossy.build_pyramid(room)


@pytest.mark.parametrize("method", DENSE)
@pytest.mark.parametrize(
    "planes",
    [
        rooms.planes(),
        rooms.planes(footprint="projected"),
        rooms.planes(blend=0.5),
        BoundingPlanes(rooms.CENTRE, FLOOR_AND_CEILING, blend=0.3, footprint="projected"),
    ],
    ids=["nearest", "projected", "blend", "two planes"],
)
def test_the_kernel_is_its_plain_twin(
    method: str, planes: BoundingPlanes, pyramid: glossy.Pyramid
) -> None:
    p = rooms.sphere_points(3, 1)
    options = {"method": method, "samples": 9, "footprint": "paper"}
    if method == "importance":
        del options["footprint"]
    fast = glossy.shade(p, BOTH_SIDES, pyramid, parallax=planes, precision="double", **options)  # type: ignore[arg-type]
    plain = twin(p, BOTH_SIDES, pyramid, planes, **options)
    # finite differences of the footprint, where it is projected
    limit = 1e-4 if planes.footprint == "projected" else 1e-9
    np.testing.assert_allclose(fast, plain, rtol=limit)
    single = glossy.shade(p, BOTH_SIDES, pyramid, parallax=planes, **options)  # type: ignore[arg-type]
    np.testing.assert_allclose(single, fast, rtol=50.0 * tolerances.SINGLE)


def test_a_mirror_in_a_room_shows_what_rays_see(
    room: glossy.CubeMap, pyramid: glossy.Pyramid
) -> None:
    """m = 0.001, one sample: with the planes the ray-cast colour, without them another."""
    p = rooms.sphere_points(200, 2)
    assert p.position is not None
    mirror = glossy.frames.reflect(p.view, p.normal)
    cos_h = np.sum(p.view * p.normal, axis=-1, keepdims=True)
    seen = rooms.ray_cast(p.position, mirror) * cos_h  # alpha = 0 darkens like cos
    options: dict[str, Any] = {"method": "importance", "samples": 1, "bias": -20.0}
    corrected = glossy.shade(p, Lobe(1e-3), pyramid, parallax=rooms.planes(), **options)
    plain = glossy.shade(p, Lobe(1e-3), pyramid, **options)
    assert glossy.relative_rms(corrected, seen) < 0.01
    assert glossy.relative_rms(plain, seen) > 0.2


def test_the_truth_integrates_what_rays_see(room: glossy.CubeMap) -> None:
    """Against a sum over half-vector slopes of ray-cast radiance: no map and no planes in it."""
    p = rooms.sphere_points(6, 3)
    assert p.position is not None
    cells = 120
    g = (np.arange(cells) + 0.5) * (11.0 / cells) - 5.5
    a, b = np.meshgrid(g, g, indexing="ij")
    mx, my = LOBE.widths
    h = np.stack([a * mx, b * my, np.ones_like(a)], axis=-1)
    area = mx * my * (11.0 / cells) ** 2 * np.sum(h**2, axis=-1) ** -1.5
    h = normalise(h)
    expected = np.zeros((6, 3))
    for k in range(6):
        wo = p.local_view[k]
        u = h @ wo
        wi = normalise(2.0 * u[..., None] * h - wo)
        good = (u > 0.0) & (wi[..., 2] > 0.0)
        f = Material(reflection=[LOBE]).eval(wi, np.broadcast_to(wo, wi.shape))
        world = glossy.frames.to_world(wi, p.tangent[k], p.normal[k])
        light = rooms.ray_cast(np.broadcast_to(p.position[k], world.shape), world)
        weight = np.where(good, f * wi[..., 2] * 4.0 * u * area, 0.0)
        expected[k] = np.sum(light * weight[..., None], axis=(0, 1))
    truth = glossy.reference(p, LOBE, room, "qmc", 4096, parallax=rooms.planes())
    assert glossy.relative_rms(truth.radiance, expected) < tolerances.ROOM_MAP
    plain = glossy.reference(p, LOBE, room)
    assert glossy.relative_rms(plain.radiance, expected) > 0.05


@pytest.mark.parametrize("method", DENSE)
@pytest.mark.parametrize("blend", [0.0, 0.4])
def test_dense_samples_tend_to_the_truth(method: str, blend: float, room: glossy.CubeMap) -> None:
    planes = rooms.planes(blend=blend)
    p = rooms.sphere_points(6, 4)
    box = glossy.build_pyramid(room, filter="box")
    options, limit = DENSE[method]
    shaded = glossy.shade(
        p, BOTH_SIDES, box, method=method, parallax=planes, precision="double", **options
    )
    truth = glossy.reference(p, BOTH_SIDES, room, "qmc", 4096, parallax=planes).radiance
    assert glossy.relative_rms(shaded, truth) < limit


def test_at_the_centre_and_without_planes_nothing_changes(pyramid: glossy.Pyramid) -> None:
    p = rooms.sphere_points(20, 5)
    centred = SurfacePoints(p.normal, p.tangent, p.view, position=rooms.CENTRE)
    plain = glossy.shade(p, LOBE, pyramid, precision="double")
    for points, planes in (
        (centred, rooms.planes(blend=0.5)),
        (centred, rooms.planes(footprint="projected")),
        (p, BoundingPlanes(rooms.CENTRE, [])),
    ):
        same = glossy.shade(points, LOBE, pyramid, precision="double", parallax=planes)
        np.testing.assert_allclose(same, plain, rtol=1e-9)


def test_masked_points_are_black_and_threads_do_not_matter(pyramid: glossy.Pyramid) -> None:
    p = rooms.sphere_points(20, 6)
    mask = np.arange(20) % 3 > 0
    q = SurfacePoints(p.normal, p.tangent, p.view, mask, p.position)
    part = glossy.shade(q, LOBE, pyramid, parallax=rooms.planes())
    whole = glossy.shade(p, LOBE, pyramid, parallax=rooms.planes())
    assert not part[~mask].any()
    np.testing.assert_array_equal(part[mask], whole[mask])


# --- the truth's own lookup and draws -------------------------------------------------------------


@pytest.mark.parametrize("blend", [0.0, 0.6])
@given(st.integers(0, 10**6))
def test_the_truths_lookup_is_the_definition(blend: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = [(rng.normal(size=3), rng.normal(size=3)) for _ in range(int(rng.integers(0, 5)))]
    planes = BoundingPlanes(rng.normal(size=3), rows, blend=blend)
    x, w = rng.normal(size=3), normalise(rng.normal(size=3))
    light = PlaneLight(glossy.CubeMap(np.ones((6, 1, 1, 3))), planes, x[None])
    found = light.redirect(w[None, None])[0, 0]
    np.testing.assert_allclose(normalise(found), normalise(redirect(planes, x, w)), atol=1e-9)


@pytest.mark.parametrize(
    "rows",
    [rooms.PLANES, FLOOR_AND_CEILING, rooms.PLANES[:3], []],
    ids=["room", "floor and ceiling", "half a room", "none"],
)
def test_draws_have_the_density_they_say(rows: list[Any]) -> None:
    """The density integrates to 1, and a mean of sampled directions is that of the density."""
    planes = BoundingPlanes(rooms.CENTRE, rows)
    light = PlaneLight(rooms.capture(4), planes, (rooms.CENTRE + np.array([0.3, -0.4, 0.2]))[None])
    cells = 300
    cos = (np.arange(cells) + 0.5) * (2.0 / cells) - 1.0
    phi = (np.arange(cells) + 0.5) * (2.0 * math.pi / cells)
    t, f = np.meshgrid(np.arccos(cos), phi, indexing="ij")
    w = spherical(t, f).reshape(1, -1, 3)
    weight = light.pdf(w)[0] * (4.0 * math.pi / cells**2)
    assert weight.sum() == pytest.approx(1.0, abs=0.01)
    drawn = light.sample(np.random.default_rng(0).uniform(size=(1, 40000, 2)))[0]
    np.testing.assert_allclose(drawn.mean(axis=0), weight @ w[0], atol=0.015)


def test_random_draws_agree_with_low_discrepancy(room: glossy.CubeMap) -> None:
    planes = BoundingPlanes(rooms.CENTRE, FLOOR_AND_CEILING, blend=0.2)
    p = rooms.sphere_points(5, 7)
    fine = glossy.reference(p, BOTH_SIDES, room, "qmc", 16384, parallax=planes)
    drawn = glossy.reference(p, BOTH_SIDES, room, "mc", 8192, seed=3, parallax=planes)
    z = (drawn.radiance - fine.radiance) / drawn.error
    assert np.abs(z).max() < tolerances.Z_MAX


# --- transitions and parameters -------------------------------------------------------------------


def test_blending_rounds_the_crease_and_leaves_the_rest() -> None:
    hard, soft = (BoundingPlanes(rooms.CENTRE, FLOOR_AND_CEILING, blend=b) for b in (0.0, 0.4))
    x = rooms.CENTRE + np.array([0.4, 0.1, 0.0])
    theta = math.radians(90.0) + np.linspace(-0.02, 0.02, 81)
    rays = np.stack([np.sin(theta), np.cos(theta), np.zeros_like(theta)], axis=-1)
    bends = []
    for planes in (hard, soft):
        v = normalise(np.array([redirect(planes, x, w) for w in rays]))
        bends.append(np.abs(np.diff(np.arctan2(v[:, 1], v[:, 0]), 2)).max())
    assert bends[1] < 0.1 * bends[0]
    down = np.array([0.1, -0.99, 0.0])
    np.testing.assert_array_equal(redirect(hard, x, down), redirect(soft, x, down))


def test_descriptions() -> None:
    box = BoundingPlanes.box(rooms.LOW, rooms.HIGH, rooms.CENTRE)
    assert box == rooms.planes()
    assert BoundingPlanes.box([0, 0, 0], [2, 4, 6]).centre == (1.0, 2.0, 3.0)
    one = BoundingPlanes([0, 1, 0], [glossy.Plane((0, 0, 0), (0, 3, 0))], blend=0.5)
    assert one.planes == (((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),)
    assert one.width == 0.5


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: BoundingPlanes([0, 0], []), "centre: must be three finite numbers"),
        (lambda: BoundingPlanes([0, 0, 0], [([0, 0, 0],)]), r"planes\[0\]: must be a point and"),
        (
            lambda: BoundingPlanes([0, 0, 0], [([0, 0, 0], [0, 0, 0])]),
            r"planes\[0\] normal: must not be zero",
        ),
        (lambda: BoundingPlanes([0, 0, 0], [], blend=2), "blend: must be in"),
        (lambda: BoundingPlanes([0, 0, 0], [], footprint="mine"), "footprint: must be one of"),
        (lambda: BoundingPlanes.box([0, 0, 0], [1, 0, 1]), "high: must lie above low"),
    ],
)
def test_bad_descriptions_are_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_bad_uses_are_refused(room: glossy.CubeMap, pyramid: glossy.Pyramid) -> None:
    p = rooms.sphere_points(2, 8)
    nowhere = SurfacePoints(p.normal, p.tangent, p.view)
    planes = rooms.planes()
    with pytest.raises(ValueError, match="points: must have positions"):
        glossy.shade(nowhere, LOBE, pyramid, parallax=planes)
    with pytest.raises(ValueError, match="parallax: must be BoundingPlanes"):
        glossy.shade(p, LOBE, pyramid, parallax=[0, 1, 0])
    with pytest.raises(ValueError, match="points: must have positions"):
        glossy.reference(nowhere, LOBE, room, "qmc", parallax=planes)
    with pytest.raises(ValueError, match="estimator: must be mc or qmc with parallax"):
        glossy.reference(p, LOBE, room, parallax=planes)
    with pytest.raises(ValueError, match="samplez: is no option"):
        glossy.shade(p, LOBE, pyramid, parallax=planes, samplez=3)
