"""Lat-long pictures: conventions, power, and a supersampled NumPy twin of the conversion."""

import math
import pathlib
from collections.abc import Callable

import numba
import numpy as np
import numpy.typing as npt
import pytest
import tolerances
from hypothesis import given
from hypothesis import strategies as st

from glossy import latlong
from glossy.cubemap import CubeMap, face_directions, texel_directions, texel_solid_angles
from glossy.latlong import cube_to_latlong, latlong_power, latlong_to_cube

Float64Array = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

PI = math.pi

# Where the tools' own formulas put a world direction, as fractions of the picture, written out
# again here in the tools' axes. World to tool: z-up tools have (x, -z, y).
Formula = Callable[[Float64Array, Float64Array, Float64Array], tuple[Float64Array, Float64Array]]
FORMULAS: dict[str, Formula] = {
    "glossy": lambda x, y, z: (np.arctan2(x, -z) / (2 * PI), np.arccos(y) / PI),
    "mitsuba": lambda x, y, z: (np.arctan2(x, -z) / (2 * PI), np.arccos(y) / PI),
    "openexr": lambda x, y, z: (0.5 - np.arctan2(x, z) / (2 * PI), 0.5 - np.arcsin(y) / PI),
    "godot": lambda x, y, z: (np.arctan2(x, -z) / (2 * PI), np.arccos(y) / PI),
    "three": lambda x, y, z: (np.arctan2(z, x) / (2 * PI) + 0.5, 0.5 - np.arcsin(y) / PI),
    "blender": lambda x, y, z: (
        -np.arctan2(-z, x) / (2 * PI) + 0.5,
        0.5 - np.arctan2(y, np.hypot(x, -z)) / PI,
    ),
    "unity": lambda x, y, z: (0.5 - np.arctan2(z, x) / (2 * PI), np.arccos(y) / PI),
    "pbrt-v3": lambda x, y, z: (np.arctan2(-z, x) / (2 * PI), np.arccos(y) / PI),
}

# Where the horizontal axes land: the fraction of the width, read off the formulas by hand.
COLUMNS = {
    "glossy": {"+x": 0.25, "+z": 0.5, "-x": 0.75, "-z": 0.0},
    "mitsuba": {"+x": 0.25, "+z": 0.5, "-x": 0.75, "-z": 0.0},
    "openexr": {"+x": 0.25, "+z": 0.5, "-x": 0.75, "-z": 0.0},
    "godot": {"+x": 0.25, "+z": 0.5, "-x": 0.75, "-z": 0.0},
    "three": {"-z": 0.25, "+x": 0.5, "+z": 0.75, "-x": 0.0},
    "blender": {"-z": 0.25, "+x": 0.5, "+z": 0.75, "-x": 0.0},
    "unity": {"+z": 0.25, "+x": 0.5, "-z": 0.75, "-x": 0.0},
    "pbrt-v3": {"+x": 0.0, "-z": 0.25, "-x": 0.5, "+z": 0.75},
}
FACES = ("+x", "-x", "+y", "-y", "+z", "-z")


def evaluate(pixels: Float32Array, d: Float64Array, name: str, rule: str) -> Float64Array:
    """The picture's function at directions (..., 3), by the tool's formula."""
    height, width = pixels.shape[:2]
    flat = (d / np.linalg.norm(d, axis=-1, keepdims=True)).reshape(-1, 3)
    u, v = FORMULAS[name](flat[:, 0], np.clip(flat[:, 1], -1.0, 1.0), flat[:, 2])
    column, theta = u * width, v * PI
    if rule == "texels":
        i = np.minimum((theta / PI * height).astype(int), height - 1)
        return np.asarray(pixels[i, np.floor(column).astype(int) % width].reshape(d.shape), float)
    column = u * (width - 1) if name == "openexr" else column - 0.5
    left = np.floor(column).astype(int)
    a = (column - left)[:, None]
    if rule == "poles":  # rows 0 and H-1 on the poles, linear in theta
        row = theta / PI * (height - 1)
        i = np.minimum(row.astype(int), height - 2)
        b = (row - i)[:, None]
    else:  # linear in cos(theta) between the conserving nodes
        node = np.cos((np.arange(height) + 0.5) * PI / height) / math.cos(PI / 2 / height)
        y = np.cos(theta)
        i = np.clip(np.searchsorted(-node, -y) - 1, 0, height - 2)
        b = ((node[i] - y) / (node[i] - node[i + 1]))[:, None]
    p = pixels.astype(np.float64)
    lo, hi = left % width, (left + 1) % width
    if name == "openexr":  # the first column again, as the last
        lo, hi = left % (width - 1), left % (width - 1) + 1
    top = p[i, lo] * (1 - a) + p[i, hi] * a
    low = p[i + 1, lo] * (1 - a) + p[i + 1, hi] * a
    return np.asarray((top * (1 - b) + low * b).reshape(d.shape))


def twin(pixels: Float32Array, size: int, name: str, rule: str, k: int) -> Float64Array:
    """Faces by k x k samples a texel, weighted by solid angle."""
    c = (np.arange(size * k) + 0.5) * (2.0 / (size * k)) - 1.0
    d = face_directions(np.arange(6)[:, None, None], c[None, None, :], c[None, :, None])
    weight = np.linalg.norm(d, axis=-1, keepdims=True) ** -3.0
    value = evaluate(pixels, d, name, rule) * weight
    shape = (6, size, k, size, k)
    total = value.reshape(*shape, 3).sum(axis=(2, 4))
    return np.asarray(total / weight.reshape(*shape, 1).sum(axis=(2, 4)))


def noise(height: int, seed: int = 0) -> Float32Array:
    return np.random.default_rng(seed).random((height, 2 * height, 3)).astype(np.float32)


def power(faces: Float32Array) -> Float64Array:
    return CubeMap(faces).power()


# conventions ------------------------------------------------------------------------------------


def test_every_preset_is_pinned() -> None:
    assert set(FORMULAS) == set(COLUMNS) == set(latlong.ORIENTATIONS)


@pytest.mark.parametrize("name", FORMULAS)
def test_texel_directions_invert_the_tools_formula(name: str) -> None:
    height = 7
    d = latlong.latlong_directions(height, name)
    u, v = FORMULAS[name](d[..., 0], np.clip(d[..., 1], -1.0, 1.0), d[..., 2])
    i, j = np.mgrid[:height, : 2 * height]
    row = i / (height - 1) if name in ("mitsuba", "openexr") else (i + 0.5) / height
    np.testing.assert_allclose(v, row, atol=1e-7)  # asin near the poles
    column = j / (2 * height - 1) if name == "openexr" else (j + 0.5) / (2 * height)
    apart = (u - column + 0.5) % 1.0 - 0.5
    assert np.abs(apart[(v > 1e-6) & (v < 1 - 1e-6)]).max() < tolerances.ROUNDOFF


@pytest.mark.parametrize("name", COLUMNS)
@pytest.mark.parametrize("axis", FACES)
def test_a_light_on_an_axis_reaches_the_middle_of_its_face(name: str, axis: str) -> None:
    height = 32
    width = 2 * height
    pixels = np.zeros((height, width, 3), dtype=np.float32)
    if axis[1] == "y":
        pixels[:2] = 1.0 if axis == "+y" else 0.0
        pixels[-2:] = 1.0 if axis == "-y" else 0.0
    else:
        j = round(COLUMNS[name][axis] * width)
        pixels[height // 2 - 2 : height // 2 + 2, [(j + k) % width for k in (-2, -1, 0, 1)]] = 1.0
    middle = latlong_to_cube(pixels, 3, name)[:, 1, 1, 0]
    assert middle.argmax() == FACES.index(axis)
    assert np.sort(middle)[-2] == 0.0


def test_left_and_right_of_the_glossy_picture() -> None:
    """Seen from inside with +y up, -x is to the right of +z: the picture is not mirrored."""
    d = latlong.latlong_directions(8)
    right = d[4, 9]
    assert right[2] > 0.7
    assert right[0] < 0.0
    assert d[0, 0, 1] > 0.9


def test_a_matrix_is_the_preset_it_equals() -> None:
    pixels = noise(8)
    matrix = [[0, 0, -1], [0, 1, 0], [1, 0, 0]]
    assert np.array_equal(latlong_to_cube(pixels, 4, matrix), latlong_to_cube(pixels, 4, "three"))


def test_godot_and_blender_are_where_their_formulas_coincide() -> None:
    pixels = noise(8)
    for a, b in (("godot", "glossy"), ("blender", "three")):
        assert np.array_equal(latlong_to_cube(pixels, 4, a), latlong_to_cube(pixels, 4, b))


# the conversion -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "height", "size", "rule", "k", "bound"),
    [
        ("glossy", 16, 4, "texels", 48, tolerances.SUPERSAMPLED_STEPS),
        ("unity", 12, 3, "texels", 48, tolerances.SUPERSAMPLED_STEPS),
        ("glossy", 6, 8, "centres", 32, tolerances.SUPERSAMPLED_LINEAR),
        ("three", 6, 5, "centres", 32, tolerances.SUPERSAMPLED_LINEAR),
        ("mitsuba", 7, 8, "poles", 32, tolerances.SUPERSAMPLED_LINEAR),
        ("mitsuba", 16, 3, "poles", 32, tolerances.SUPERSAMPLED_LINEAR),
        ("openexr", 7, 8, "poles", 32, tolerances.SUPERSAMPLED_LINEAR),
        ("openexr", 16, 3, "poles", 32, tolerances.SUPERSAMPLED_LINEAR),
    ],
)
def test_conversion_equals_a_supersampled_twin(
    name: str, height: int, size: int, rule: str, k: int, bound: float
) -> None:
    pixels = noise(height)
    if name == "openexr":  # its first and last column are one meridian
        pixels[:, -1] = pixels[:, 0]
    assert (
        np.abs(latlong_to_cube(pixels, size, name) - twin(pixels, size, name, rule, k)).max()
        < bound
    )


@given(
    st.integers(2, 24),
    st.floats(0, 1, exclude_max=True),
    st.floats(0, 1, exclude_max=True),
    st.sampled_from([1, 2, 3, 4, 7, 16, 33]),
    st.sampled_from(["glossy", "three", "unity", "mitsuba", "openexr", "tilted"]),
)
def test_each_source_texel_keeps_its_power(
    height: int, row: float, column: float, size: int, name: str
) -> None:
    """One lit texel anywhere, poles and seams included, at sizes that reduce and that enlarge."""
    pixels = np.zeros((height, 2 * height, 3), dtype=np.float32)
    pixels[int(row * height), int(column * 2 * height)] = (1.0, 50.0, 3000.0)
    how: object = name
    if name == "tilted":
        a = np.random.default_rng(height).standard_normal((3, 3))
        how = np.linalg.qr(a)[0]
    before = latlong_power(pixels, how)  # type: ignore[arg-type]
    after = power(latlong_to_cube(pixels, size, how))  # type: ignore[arg-type]
    np.testing.assert_allclose(after, before, rtol=tolerances.CONVERTED_POWER)


@pytest.mark.parametrize("row", [0, 1, -1])
def test_the_rows_at_the_poles(row: int) -> None:
    for size in (8, 64, 256):
        pixels = np.zeros((32, 64, 3), dtype=np.float32)
        pixels[row, 5] = 1.0
        edge = np.cos(np.arange(33) * PI / 32)
        expected = (edge[:-1] - edge[1:])[row] * PI / 32
        after = power(latlong_to_cube(pixels, size))
        np.testing.assert_allclose(after, expected, rtol=tolerances.CONVERTED_POWER)


@pytest.mark.parametrize("name", ["glossy", "mitsuba", "openexr"])
@pytest.mark.parametrize("size", [1, 5, 8, 64])
def test_white_stays_white_beside_a_sun(name: str, size: int) -> None:
    pixels = np.ones((16, 32, 3), dtype=np.float32)
    assert np.array_equal(latlong_to_cube(pixels, size, name), np.ones((6, size, size, 3)))
    pixels[3, 4] = 1e5
    faces = latlong_to_cube(pixels, size, name)
    lit = faces > 1.0 + 1e-6
    assert lit.any()
    assert np.abs(faces[~lit] - 1.0).max(initial=0.0) <= 1e-6
    assert faces.min() >= 1.0


def test_power_of_a_rows_solid_angle() -> None:
    for name in ("glossy", "mitsuba"):
        omega = latlong.latlong_solid_angles(9, name)
        assert omega.sum() * 18 == pytest.approx(4 * PI, rel=tolerances.ROUNDOFF)
        theta = (np.arange(200_000) + 0.5) * (PI / 200_000)
        if name == "mitsuba":  # the first row's tent over the first interval
            inside = theta < PI / 8
            weight = (1 - theta[inside] / (PI / 8)) * np.sin(theta[inside])
            assert omega[0] == pytest.approx(weight.sum() * PI / 200_000 * 2 * PI / 18, rel=1e-8)


def test_two_columns_that_are_one_meridian_count_half_each() -> None:
    omega = latlong.latlong_solid_angles(9, "openexr")
    assert omega.sum() * 17 == pytest.approx(4 * PI, rel=tolerances.ROUNDOFF)
    for column, share in ((0, 0.5), (17, 0.5), (8, 1.0)):
        pixels = np.zeros((9, 18, 3), dtype=np.float32)
        pixels[4, column] = 1.0
        assert latlong_power(pixels, "openexr")[0] == pytest.approx(share * omega[4], rel=1e-12)


def test_turning_the_picture_turns_the_cube() -> None:
    """A quarter of the width moves +x to where -z was: faces permute, bit for bit."""
    pixels = noise(16)
    faces = latlong_to_cube(pixels, 4)
    turned = latlong_to_cube(np.roll(pixels, 8, axis=1), 4)
    np.testing.assert_allclose(turned[4], faces[0], atol=tolerances.SINGLE)
    np.testing.assert_allclose(turned[2], np.rot90(faces[2], 3, (0, 1)), atol=tolerances.SINGLE)


def test_same_bits_for_any_number_of_threads() -> None:
    pixels, before = noise(24), numba.get_num_threads()
    try:
        runs = []
        for threads in (1, before):
            numba.set_num_threads(threads)
            cube = CubeMap(latlong_to_cube(pixels, 40))
            runs.append((cube.faces, latlong_to_cube(pixels, 9), cube_to_latlong(cube, 20)))
    finally:
        numba.set_num_threads(before)
    for a, b in zip(*runs, strict=True):
        assert np.array_equal(a, b)


# back to a picture --------------------------------------------------------------------------------


def smooth(d: Float64Array) -> Float64Array:
    x, y, z = d[..., 0], d[..., 1], d[..., 2]
    return np.stack([1 + 0.5 * x + 0.3 * y * z, 1.2 + 0.8 * z, np.exp(y + 0.5 * x)], axis=-1)


@pytest.mark.parametrize("name", FORMULAS)
def test_round_trip_of_a_smooth_map(name: str) -> None:
    height = 64
    pixels = smooth(latlong.latlong_directions(height, name)).astype(np.float32)
    cube = CubeMap(latlong_to_cube(pixels, 64, name))
    error = np.abs(cube_to_latlong(cube, height, name) - pixels) / pixels
    assert error.max() < tolerances.ROUND_TRIP
    assert error.mean() < 0.1 * tolerances.ROUND_TRIP
    np.testing.assert_allclose(
        cube.faces, smooth(unit(texel_directions(64))), rtol=tolerances.ROUND_TRIP
    )


def unit(d: Float64Array) -> Float64Array:
    return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))


def test_a_picture_of_another_convention_reads_back_as_the_same_cube() -> None:
    cube = CubeMap(latlong_to_cube(noise(8), 8))
    for name in FORMULAS:
        again = latlong_to_cube(cube_to_latlong(cube, 64, name), 8, name)
        assert np.abs(again - cube.faces).max() < 0.12  # bilinear lookup of noise, then averaged
        assert np.abs(again - cube.faces).mean() < 0.03


# another program's picture ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mitsuba_map() -> Float32Array:
    data = np.load(pathlib.Path(__file__).parent / "data" / "radiance_mitsuba.npz")
    return np.asarray(data["environment"], dtype=np.float32)


def test_mitsuba_picture_against_its_lookup_formula(mitsuba_map: Float32Array) -> None:
    """Column u W - 1/2, row theta/pi (H - 1), bilinear: the mean over the texels at the discs."""
    size, k = 64, 48
    faces = latlong_to_cube(mitsuba_map, size, "mitsuba")
    f, r, c = np.unravel_index(np.argsort(faces[..., 1].reshape(-1))[-700:], (6, size, size))
    offset = (np.arange(k) + 0.5) / k
    s = (c[:, None, None] + offset[None, None, :]) * (2.0 / size) - 1.0
    t = (r[:, None, None] + offset[None, :, None]) * (2.0 / size) - 1.0
    d = face_directions(f[:, None, None], s, t)
    weight = np.linalg.norm(d, axis=-1, keepdims=True) ** -3.0
    mean = (evaluate(mitsuba_map, d, "mitsuba", "poles") * weight).sum(axis=(1, 2))
    mean /= weight.sum(axis=(1, 2))
    dark = faces[..., 1].min()
    assert mean[:, 1].min() < 20.0 * dark < 1000.0 * dark < mean[:, 1].max()  # edges among them
    error = np.abs(faces[f, r, c] - mean)
    assert (error / mean[:, 1:2]).mean() < tolerances.MITSUBA_TEXEL
    assert error.max() < tolerances.MITSUBA_TEXEL * mean.max()


def test_the_row_rule_matters(mitsuba_map: Float32Array) -> None:
    """Half-texel rows are wrong by tens of per cent at the edges of discs."""
    right = latlong_to_cube(mitsuba_map, 128, "mitsuba")
    wrong = latlong_to_cube(mitsuba_map, 128, "glossy")
    assert np.abs(wrong / right - 1.0).max() > 0.3
    np.testing.assert_allclose(
        power(right), latlong_power(mitsuba_map, "mitsuba"), rtol=tolerances.CONVERTED_POWER
    )


# real maps ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def real_maps(real_data: pathlib.Path) -> dict[str, Float32Array]:
    from glossy.image import read_image

    files = sorted((real_data / "env").iterdir())
    return {f.name: np.maximum(read_image(f).rgb(), 0.0) for f in files}


@pytest.mark.parametrize("size", [64, 128, 256, 512])
def test_real_maps_keep_their_power(real_maps: dict[str, Float32Array], size: int) -> None:
    assert len(real_maps) >= 8
    for name, pixels in real_maps.items():
        after = power(latlong_to_cube(pixels, size))
        np.testing.assert_allclose(
            after, latlong_power(pixels), rtol=tolerances.CONVERTED_POWER, err_msg=name
        )


def test_the_sun_15_degrees_from_the_zenith(real_maps: dict[str, Float32Array]) -> None:
    """All that lies beyond 4 degrees from the sun set to 0: what is left is the sun's power."""
    pixels = real_maps["kloppenheim_05_1k.hdr"]
    d = latlong.latlong_directions(pixels.shape[0])
    hottest = np.unravel_index(pixels.sum(axis=2).argmax(), pixels.shape[:2])
    assert math.degrees(math.acos(d[hottest][1])) == pytest.approx(15.0, abs=0.5)
    alone = pixels * (d @ d[hottest] > math.cos(math.radians(4.0)))[..., None]
    alone = np.ascontiguousarray(alone, dtype=np.float32)
    assert latlong_power(alone)[1] > 0.5 * latlong_power(pixels)[1]
    for size in (16, 64, 256, 512):
        faces = latlong_to_cube(alone, size)
        np.testing.assert_allclose(
            power(faces), latlong_power(alone), rtol=tolerances.CONVERTED_POWER
        )
        away = unit(texel_directions(size)) @ d[hottest] < math.cos(math.radians(4.0) + 3.0 / size)
        assert faces[away].max() < 1e-6 * faces.max()


# refusals -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pixels", "size", "orientation", "said"),
    [
        (np.zeros((4, 9, 3)), 4, "glossy", "pixels"),
        (np.zeros((1, 2, 3)), 4, "glossy", "pixels"),
        (np.zeros((4, 8)), 4, "glossy", "pixels"),
        (np.full((4, 8, 3), np.nan), 4, "glossy", "96 NaN"),
        (np.zeros((4, 8, 3)), 0, "glossy", "size"),
        (np.zeros((4, 8, 3)), 4, "octane", "orientation"),
        (np.zeros((4, 8, 3)), 4, np.ones((3, 3)), "orthogonal"),
        (np.zeros((4, 8, 3)), 4, np.eye(2), "3 x 3"),
    ],
)
def test_refusals(pixels: object, size: int, orientation: object, said: str) -> None:
    with pytest.raises(ValueError, match=said) as caught:
        latlong_to_cube(pixels, size, orientation)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_solid_angles_agree_with_the_cube() -> None:
    assert texel_solid_angles(5).sum() * 6 == pytest.approx(4 * PI, rel=tolerances.ROUNDOFF)
