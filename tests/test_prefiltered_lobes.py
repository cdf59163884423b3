"""Lobes fitted to BRDFs: exact where the BRDF is such a lobe, energy, residuals, tracking."""

import math
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glossy.brdf import Lobe, Material
from glossy.frames import spherical
from glossy.measured.material import MeasuredMaterial, measured_material
from glossy.measured.synthetic import synthetic_table
from glossy.prefiltered import profiles, track
from glossy.prefiltered.approximate import approximate, default_angles
from glossy.prefiltered.error import lobe_error
from glossy.prefiltered.fit import fit_slice
from glossy.prefiltered.slices import half_width, make_slice
from glossy.prefiltered.stack import ring_solid_angles
from glossy.prefiltered.ward import Ward

Float64Array = npt.NDArray[np.float64]

QUADRATURE = 2e-3  # of the slices' half-vector cells, largest relative error of the albedo seen
NODES = 5e-3  # relative error of 64 linear pieces over a smooth profile


class Round:
    """A BRDF times cos theta_i that is round about an axis in the plane of incidence."""

    def __init__(self, profile: Callable[[Float64Array], Float64Array], turn: float = 0.0) -> None:
        self.profile, self.turn = profile, turn

    def axis(self, wo: Float64Array) -> Float64Array:
        theta = np.arccos(np.clip(wo[..., 2], -1.0, 1.0)) + self.turn
        return spherical(theta, np.arctan2(wo[..., 1], wo[..., 0]) + math.pi)

    def eval(self, wi: Float64Array, wo: Float64Array) -> Float64Array:
        axis = self.axis(wo)
        cross = np.linalg.norm(np.cross(wi, axis), axis=-1)
        angle = np.arctan2(cross, np.einsum("...i,...i->...", wi, axis))
        z = wi[..., 2]
        return np.where(z > 0.0, self.profile(angle) / np.maximum(z, 1e-9), 0.0)


def bell(angle: Float64Array) -> Float64Array:
    return np.asarray(np.exp(-((angle / 0.1) ** 2)))


@pytest.mark.parametrize("turn", [0.0, -0.15])
@pytest.mark.parametrize("mode", ["single", "multi"])
def test_a_round_lobe_is_found_as_it_is(turn: float, mode: str) -> None:
    views = [0.5, 0.8]
    stack, *_ = approximate(Round(bell, turn), mode, elevations=views, cosine="inside")
    assert stack.theta_offset == pytest.approx(turn, abs=1e-3)
    assert stack.phi_offset == pytest.approx(0.0, abs=1e-4)  # of the search for the peak
    expected = np.broadcast_to(bell(stack.angles), stack.profiles.shape[:2])
    assert stack.profiles[..., 0] == pytest.approx(expected, abs=NODES)
    assert lobe_error(Round(bell, turn), [stack], views).rms.max() < NODES


def test_what_is_left_of_a_round_lobe_is_next_to_nothing() -> None:
    stacks = approximate(
        Round(bell), "multi", lobes=3, elevations=[0.6], cosine="inside", finish="minimum"
    )
    volumes = [float(s.volumes()[0, 0]) for s in stacks]
    assert max(volumes[1:]) < NODES * volumes[0]


@settings(max_examples=6)
@given(
    st.floats(0.03, 0.5),
    st.floats(0.0, 1.0),
    st.sampled_from([("single", 1), ("flat", 1), ("multi", 2)]),
    st.sampled_from(["outside", "inside"]),
)
def test_an_even_sky_gives_the_albedo(
    m: float, r0: float, how: tuple[str, int], cosine: str
) -> None:
    """Against the albedo's own quadrature, which shares nothing with the slices."""
    material = Material(kd=0.3, reflection=[Lobe(m, r0=r0)])
    cosines = np.array([0.1, 0.4, 1.0])
    stacks = approximate(material, how[0], how[1], cosines, cosine=cosine)
    wo = spherical(np.arccos(cosines), np.zeros(3))
    total = sum(s.furnace(wo) for s in stacks)[:, 0]  # type: ignore[index]
    glossy = Material(reflection=material.reflection)
    assert total == pytest.approx(glossy.albedo(wo)[0], rel=QUADRATURE)


@settings(max_examples=8)
@given(st.floats(0.02, 0.6), st.floats(0.06, 1.0), st.booleans(), st.integers(1, 5))
def test_minimum_profiles_leave_nothing_negative(
    m: float, cosine: float, outside: bool, count: int
) -> None:
    lobe = Ward(ks=1.0, alpha=m)
    piece = make_slice(lobe, cosine, half_width(lobe), outside)
    angles = default_angles(lobe)
    lobes = fit_slice(piece, angles, count, finish="minimum")
    rest = piece.value.copy()
    held = []
    for axis, profile in lobes:
        at = profiles.angle_to(axis, piece.wi)
        rest -= profiles.evaluate(angles, profile, at)
        held.append(float(piece.area @ rest[:, 0]))
    assert rest.min() >= -1e-12 * piece.value.max()
    assert np.all(np.diff(held) <= 0.0)


def test_the_mean_profile_is_the_closest_in_the_mean_square() -> None:
    """Any other profile about the same axis is further away: a perturbation of each node."""
    lobe = Ward(alpha=0.2)
    piece = make_slice(lobe, 0.6, half_width(lobe), False)
    angles = np.linspace(0.0, 2.5, 24)
    axis = np.array([-0.8, 0.0, 0.6])
    at = profiles.angle_to(axis, piece.wi)
    best = profiles.mean_profile(piece.function, axis, angles)

    def apart(profile: Float64Array) -> float:
        f = profiles.evaluate(angles, profile, at)
        return float(piece.area @ ((f - piece.value) ** 2)[:, 0])

    for gain in (0.95, 1.05):
        assert apart(best) < apart(best * gain)


def test_more_lobes_and_a_common_fit_come_closer() -> None:
    lobe, views = Ward(ks=0.8, alpha=0.1), [0.4, 0.7]
    errors = [
        lobe_error(lobe, approximate(lobe, "multi", n, views, finish=finish), views).rms.mean()
        for n, finish in ((1, "mean"), (3, "mean"), (3, "refit"))
    ]
    assert errors[1] < 0.7 * errors[0]
    assert errors[2] < 0.7 * errors[1]


def test_the_common_fit_of_a_very_narrow_lobe_keeps_its_tails_dark() -> None:
    """Squares hardly see a tail of 1/sr beside a peak of 1e8/sr, which yet holds all the light."""
    lobe, views = Lobe(1e-4), [0.5]
    errors = [
        lobe_error(lobe, approximate(lobe, "multi", 3, views, finish=finish), views).rms[0]
        for finish in ("mean", "refit")
    ]
    assert errors[1] < 0.5 * errors[0]


def test_stacks_follow_their_lobe_whatever_the_order_in_the_slices() -> None:
    theta_o = np.linspace(1.4, 0.2, 9)
    mirror = spherical(theta_o, math.pi)
    tracks = [
        spherical(theta_o + a * theta_o, math.pi + np.full(9, p))
        for a, p in ((0.0, 0.0), (-0.2, 0.3), (-0.2, -0.3))
    ]
    axes = np.stack(tracks, axis=1)
    rng = np.random.default_rng(3)
    mixed = [rng.permutation(3) for _ in theta_o]
    found = track.order(
        np.array([a[m] for a, m in zip(axes, mixed, strict=True)]), np.ones((9, 3)), theta_o
    )
    undone = np.array([m[f] for m, f in zip(mixed, found, strict=True)])
    assert np.all(undone == undone[:1])
    assert mirror == pytest.approx(axes[:, 0])


@given(st.floats(0.0, 1.5), st.floats(0.0, 1.5), st.floats(-3.1, 3.1))
def test_offsets_lead_back_to_the_axis(theta_o: float, theta: float, phi: float) -> None:
    axis = spherical(theta, phi)
    a, b = track.offsets(axis, theta_o)
    assert abs(b) <= 0.5 * math.pi + 1e-12
    assert spherical(theta_o + a, math.pi + b) == pytest.approx(axis, abs=1e-12)


def test_the_axis_of_a_stack_never_jumps() -> None:
    """Ward's three lobes: the greatest turn between slices is a few times the mean one."""
    for stack in approximate(Ward(ks=0.8, alpha=0.04), "multi", 3):
        wo = spherical(np.arccos(stack.cosines), np.zeros(len(stack.cosines)))
        theta_o = np.arccos(stack.cosines)
        pairs = zip(stack.axis(wo), theta_o, strict=True)
        turned = np.array([track.turned(a[None], float(t))[0] for a, t in pairs])
        turn = np.arccos(np.clip(np.sum(turned[1:] * turned[:-1], axis=-1), -1.0, 1.0))
        assert turn.max() < math.radians(2.5)


def test_glancing_axes_stay_above_the_horizon_and_profiles_finite() -> None:
    """Ward's f has no bound in the horizon, where it sends nothing."""
    (stack,) = approximate(Ward(alpha=0.5), elevations=[0.01, 0.05, 0.1])
    axis = stack.axis(spherical(np.arccos(stack.cosines), np.zeros(3)))
    assert axis[:, 2].min() > 0.0
    assert np.isfinite(stack.profiles).all()


def test_a_lobe_with_a_hollow_needs_the_search_by_volume() -> None:
    """M section 7: the peak is on the rim, the lobe is round about the middle."""
    hollow = Round(lambda a: bell(a) * (0.2 + (a / 0.1) ** 2))
    views = [0.7, 0.9]
    errors = {}
    for search in ("peak", "candidates", "volume"):
        stacks = approximate(hollow, elevations=views, cosine="inside", search=search)
        errors[search] = lobe_error(hollow, stacks, views).rms.max()
    assert errors["peak"] > 0.3
    assert errors["candidates"] < 0.02
    assert errors["volume"] < 0.1


def test_light_sent_back_is_a_stack_of_its_own() -> None:
    def both(a: Float64Array) -> Float64Array:
        return bell(a)

    class Retro(Round):
        def eval(self, wi: Float64Array, wo: Float64Array) -> Float64Array:
            turned = wo * [-1.0, -1.0, 1.0]
            return np.asarray(super().eval(wi, wo) + 0.5 * super().eval(wi, turned))

    material = Retro(both)
    views = [0.6, 0.75, 0.9]
    first, second = approximate(
        material, "multi", 2, views, cosine="inside", search="candidates", finish="minimum"
    )
    assert first.theta_offset == pytest.approx(0.0, abs=1e-3)
    wo = spherical(np.arccos(views), np.zeros(3))
    assert second.axis(wo) == pytest.approx(wo, abs=1e-3)
    ratio = second.volumes().sum() / first.volumes().sum()
    assert ratio == pytest.approx(0.5, rel=0.03)  # the lobes overlap a little


def test_flat_keeps_one_shape_and_the_brightness_of_every_slice() -> None:
    lobe = Lobe(0.15, r0=[0.9, 0.5, 0.3])
    (stack,) = approximate(lobe, "flat", elevations=6)
    assert stack.profiles.shape[0] == 1
    assert stack.volumes()[0] == pytest.approx(1.0)
    wo = spherical(np.arccos(stack.view_cosines), np.zeros(6))
    assert stack.weights == pytest.approx(lobe_albedo(lobe, wo), rel=QUADRATURE)
    (sharp,) = approximate(lobe, "flat", elevations=6, characteristic=0.2)
    (blunt,) = approximate(lobe, "flat", elevations=6, characteristic=1.0)
    assert sharp.profiles[0, 0, 0] > blunt.profiles[0, 0, 0]


def test_rows_of_a_table_are_approximated_as_well() -> None:
    """A table made of a lobe: the same stack but for the interpolation between its rows."""
    lobe = Lobe(0.3, r0=0.5)
    table = MeasuredMaterial(
        synthetic_table(Material(reflection=[lobe]), phi=[0.0], isotropic=True)
    )
    views = [0.5, 0.8]
    (a,) = approximate(table, elevations=views, angles=default_angles(lobe))
    wo = spherical(np.arccos(views), np.zeros(2))
    assert a.furnace(wo) == pytest.approx(lobe_albedo(lobe, wo)[:, None], rel=0.05)
    assert lobe_error(lobe, [a], views).rms.max() < 0.5


def lobe_albedo(lobe: Lobe, wo: Float64Array) -> Float64Array:
    return np.asarray(Material(reflection=[lobe]).albedo(wo)[0])


@pytest.mark.parametrize("name", ["cornell_cayman.brdf", "satin_rosaline_rgb.bsdf"])
def test_real_measurements_keep_their_brightness(real_data: pathlib.Path, name: str) -> None:
    """Against sampling; ``albedo`` is of light from there, and measured data break reciprocity."""
    material = measured_material(real_data / "brdf" / name)
    views = [0.4, 0.8]
    (stack,) = approximate(material, elevations=views)
    xi = np.random.default_rng(1).uniform(1e-9, 1.0, (20000, 2))
    for wo in spherical(np.arccos(views), np.zeros(2)):
        wi = material.sample(xi, np.broadcast_to(wo, (len(xi), 3)))
        weight = np.maximum(wi[:, 2], 0.0) / material.pdf(wi, np.broadcast_to(wo, wi.shape))
        values = material.eval(wi, np.broadcast_to(wo, wi.shape)) * weight[:, None]
        allowed = 5.0 * values.std(axis=0) / math.sqrt(len(xi)) + 5e-3 * values.mean(axis=0)
        assert np.all(np.abs(stack.furnace(wo) - values.mean(axis=0)) < allowed)


def test_ward_against_its_formula() -> None:
    wi, wo = spherical(0.7, 0.3), spherical(0.5, -2.5)
    h = (wi + wo) / np.linalg.norm(wi + wo)
    tan = math.tan(math.acos(h[2])) / 0.2
    plain = 0.1 / math.pi + 0.8 * math.exp(-(tan**2)) / (
        4.0 * math.pi * 0.04 * math.sqrt(wi[2] * wo[2])
    )
    ward = Ward(0.1, 0.8, 0.2)
    assert ward.eval(wi, wo) == pytest.approx(plain)
    assert ward.eval(wo, wi) == pytest.approx(plain)
    assert Ward(0.1, [0.8, 0.4, 0.0], 0.2).eval(wi, wo)[0] == pytest.approx(plain)
    assert ward.eval(wi * [1.0, 1.0, -1.0], wo) == 0.0


def test_ward_sampled_gives_the_albedo_of_the_slice() -> None:
    ward = Ward(0.0, 0.8, 0.15)
    wo = spherical(0.8, 0.0)
    xi = np.random.default_rng(1).uniform(1e-9, 1.0, (20000, 2))
    wi = ward.sample(xi, np.broadcast_to(wo, (20000, 3)))
    values = ward.eval(wi, wo) * np.maximum(wi[:, 2], 0.0) / ward.pdf(wi, wo)
    piece = make_slice(ward, float(wo[2]), half_width(ward), False)
    sigma = float(values.std()) / math.sqrt(len(values))
    assert values.mean() == pytest.approx(piece.albedo[0], abs=5.0 * sigma)


@pytest.mark.parametrize(
    ("material", "options", "said"),
    [
        (Lobe(0.2, 0.1), {}, "material: must be isotropic"),
        (Material(transmission=[Lobe(0.2)]), {}, "material: must not transmit"),
        (Material(kd=0.5), {}, "material: must reflect besides kd"),
        ("paint", {}, "material: must have eval"),
        (Lobe(0.2), {"mode": "double"}, "mode: must be one of single, flat, multi"),
        (Lobe(0.2), {"lobes": 2}, "lobes: must be 1 for mode 'single'"),
        (Lobe(0.2), {"mode": "multi", "lobes": 99}, "lobes: must be from 1 to 16"),
        (Lobe(0.2), {"cosine": "none"}, "cosine: must be one of"),
        (Lobe(0.2), {"finish": "none"}, "finish: must be one of"),
        (Lobe(0.2), {"search": "none"}, "search: must be one of"),
        (Lobe(0.2), {"elevations": [0.9, 0.1]}, "cosines: must be a vector of rising"),
        (Lobe(0.2), {"elevations": 0}, "elevations: must be at least 1"),
        (Lobe(0.2), {"angles": [0.1, 0.2]}, "angles: must rise from 0"),
        (Lobe(0.2), {"characteristic": 0.5}, "characteristic: belongs to mode 'flat'"),
        (Lobe(0.2), {"mode": "flat", "characteristic": 2.0}, "characteristic: must be in"),
    ],
)
def test_bad_input_is_one_line(material: Any, options: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        approximate(material, **options)


def test_errors_are_of_one_kind_of_cosine() -> None:
    lobe = Lobe(0.2)
    both = [approximate(lobe, elevations=2, cosine=c)[0] for c in ("outside", "inside")]
    with pytest.raises(ValueError, match="of one kind of cosine"):
        lobe_error(lobe, both)
    with pytest.raises(ValueError, match=r"cosines: must be a vector within"):
        lobe_error(lobe, both[:1], [0.0])


def test_volumes_of_the_stacks_are_those_of_the_slices() -> None:
    stack, *_ = approximate(Ward(alpha=0.1), "multi", 2, [0.5, 0.9])
    omega = ring_solid_angles(stack.angles)
    assert stack.volumes()[0] == pytest.approx(omega @ stack.profiles[0])
