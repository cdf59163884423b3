"""Whatever is given to a public function: it works, or one line names the argument."""

import collections.abc
import datetime
import os
import pathlib
import string
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import glossy
from glossy import _arguments
from glossy.frames import spherical
from glossy.gbuffer import write_gbuffer

Call = tuple[str, dict[str, Any]]

CUBE = glossy.CubeMap(np.ones((6, 4, 4, 3)))
PYRAMID = glossy.build_pyramid(CUBE)
LOBE = glossy.Lobe(0.2)
MATERIAL = glossy.Material(kd=0.5, reflection=[LOBE])
POINTS = glossy.SurfacePoints([[0, 0, 1.0]] * 2, None, [[0, 0.6, 0.8]] * 2)
CAMERA = glossy.Camera(width=4, height=3)
IMAGE = np.random.default_rng(0).random((3, 4, 3))
WI = spherical(np.linspace(0.0, 1.0, 6), 0.3)
TABLE = glossy.MeasuredTable(WI, spherical(np.full(6, 0.3), 0.0), np.ones(6))

POSITION: dict[str, Any] = {"position": (0, 0, 4), "target": (0, 0, 0), "up": (0, 1, 0)}
TRUTH: dict[str, Any] = {
    "points": POINTS, "material": MATERIAL, "cube": CUBE, "estimator": "qmc", "samples": 32,
    "tolerance": 0.5, "seed": 0, "diffuse": True, "parallax": None,
}  # fmt: skip
TWO: dict[str, Any] = {"a": IMAGE, "b": IMAGE}

VALID: dict[str, dict[str, Any]] = {
    "BoundingPlanes": {"centre": [0, 0, 0], "planes": [([0, 0, -1], [0, 0, 1])], "blend": 0.0},
    "Camera": {**POSITION, "fov": 30.0, "width": 4, "height": 3},
    "CubeMap": {"faces": np.ones((6, 2, 2, 3)), "negative": "error", "nonfinite": "error"},
    "Lobe": {"mx": 0.2, "my": 0.1, "ks": 1.0, "r0": 1.0, "alpha": 0.0},
    "Material": {
        "kd": 0.0, "reflection": [LOBE], "transmission": [], "diffuse_transmission": 0.0,
        "kd_falloff": False,
    },
    "MeasuredTable": {
        "wi": WI, "wo": WI, "f": np.ones(6), "weight": None, "isotropic": False, "channels": (),
    },
    "MeasuredMaterial": {"table": TABLE, "interpolation": "half-vector", "quantity": "root"},
    "Pattern": {"half_vectors": [[0, 0, 1.0]], "cell": None, "pdf_constant": None, "lobe": None},
    "Plane": {"point": (0, 0, 0), "normal": (0, 1, 0), "tangent": (1, 0, 0)},
    "Pyramid": {"levels": [np.ones((6, 1, 1, 3))], "storage": "rgba32f"},
    "Sphere": {"center": (0, 0, 0), "radius": 1.0},
    "SurfacePoints": {
        "normal": [0, 0, 1.0], "tangent": [1.0, 0, 0], "view": [0, 0, 1.0], "mask": None,
        "position": [0, 0, 0.0], "normalise": False,
    },
    "bias": {**TWO, "mask": None},
    "build_pyramid": {"cube": CUBE, "filter": "gauss6", "storage": "rgba32f"},
    "compare": {
        **TWO, "peak": 1.0, "mask": None, "channels": None, "relative_epsilon": 0.01,
        "log_epsilon": 0.01,
    },
    "converge": {
        "points": POINTS, "material": MATERIAL, "prepared": PYRAMID, "cube": CUBE,
        "method": "regular", "target_error": 0.9, "time_limit": 0.01, "passes": 1, "samples": 32,
        "seed": 0, "parallax": None, "options": {},
    },
    "difference_picture": {**TWO, "signed": False, "limit": None, "unit": "radiance"},
    "energy": {"material": MATERIAL, "theta": [0.1]},
    "environment": {"name": "white", "size": 4, "seed": 0},
    "export_shader": {
        "material": MATERIAL, "language": "glsl", "method": "regular", "name": "glossy",
        "path": None, "pattern": None, "parallax": None,
    },
    "importance_pattern": {"lobe": LOBE, "samples": 4},
    "irradiance": {"cube": CUBE, "normal": [0, 0, 1.0]},
    "irradiance_map": {"cube": CUBE, "size": 4},
    "lattice_taps": {"samples": 7},
    "load_scene": {"path": "s.toml"},
    "log_rms": {**TWO, "epsilon": 0.01, "mask": None},
    "material": {"name": "alanod-2000gs"},
    "partial_maps": {
        "cube": CUBE, "count": 6, "filter": "pem5:sqrtcos", "storage": "rgba32f",
        "layout": "cropped",
    },
    "pattern_for_budget": {"lobe": LOBE, "samples": 7, "threshold": 0.1},
    "psnr": {**TWO, "peak": 1.0, "mask": None},
    "read_environment": {
        "path": "i.exr", "size": 4, "layout": None, "orientation": "glossy", "negative": "clamp",
        "nonfinite": "error", "encoding": None,
    },
    "read_gbuffer": {"path": "g.npz", "normalise": False, "encoded": (), "normal": None},
    "read_image": {"path": "i.exr", "encoding": None, "max_pixels": 1000},
    "reference": TRUTH,
    "reference_passes": TRUTH,
    "regions": {"cube": CUBE, "count": 6},
    "regular_pattern": {"lobe": LOBE, "circles": 3, "spacing": "s2", "threshold": 0.1},
    "shade": {
        "points": POINTS, "material": MATERIAL, "prepared": PYRAMID, "method": "regular",
        "precision": "single", "irradiance": [1, 1, 1.0], "irradiance_below": None,
        "parallax": None, "samples": 7, "threshold": 0.1, "footprint": "paper", "bias": 0.0,
        "pattern": None, "subtexel_bits": None, "kernel": "auto",
    },
    "split_sum_chain": {"cube": CUBE, "widths": [0.2]},
    "surface_points": {"camera": CAMERA, "shape": glossy.Sphere()},
    "tap_level": {"filter": "gauss6", "width": 0.1},
    "tap_width": {"filter": "gauss6", "level": 1.0},
    "thesis_pattern": {
        "lobe": LOBE, "samples": 7, "kind": "auto", "threshold": 0.01, "anisotropy": 0.4,
        "radius": 0.6, "rings": 3,
    },
    "trace": {
        "point": POINTS[0], "material": MATERIAL, "pyramid": PYRAMID, "method": "regular",
        "precision": "single", "samples": 7,
    },
    "write_exr": {"path": "o.exr", "channels": {"Y": np.ones((2, 2))}, "half": False},
    "write_image": {"path": "o.exr", "pixels": IMAGE, "exposure": 0.0, "bits": 8, "half": False},
}  # fmt: skip
"""Arguments that work; tables that others of them make are not repeated."""

OTHERS = {"prepared": ("pyramid",), "lobe": ("mx", "my"), "name": ("material",)}
"""Names that a refusal may have instead: of the method's own, or of what an argument holds."""

TEXT = st.text(string.ascii_letters + string.digits, max_size=6)
SCALARS = st.one_of(
    st.none(), TEXT, st.booleans(), st.integers(-3, 3), st.sampled_from([10**400, -(10**400)]),
    st.sampled_from([np.nan, np.inf, -1.0, 0.5, 1e300, 1j, b"x", "a\0b", "0.2"]),
    st.sampled_from([datetime.date(2020, 1, 1), np.datetime64("2020-01-01"), np.bool_(True)]),
)  # fmt: skip
OBJECTS = st.sampled_from(
    [
        CUBE, PYRAMID, LOBE, MATERIAL, POINTS, CAMERA, TABLE, glossy.Lobe, len, object(), {1, 2},
        np.array(["a", "b"]), np.array([object()]), np.array(["2020-01-01"], "datetime64[D]"),
        np.ma.masked_array([1.0, 2.0, 3.0], mask=[False, True, False]), np.zeros(0), IMAGE,
        np.ones((1, 1, 1, 1, 1)), np.full(3, np.nan), np.array([10**400, 0]), np.ones(3) * 1j,
    ]
)  # fmt: skip
VALUES = st.recursive(
    SCALARS | OBJECTS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=2),
    max_leaves=4,
)


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Files to read, in a folder where what is written does no harm."""
    before, place = pathlib.Path.cwd(), tmp_path_factory.mktemp("arguments")
    os.chdir(place)
    glossy.write_exr("i.exr", {c: np.ones((4, 8), np.float32) for c in "RGB"})
    write_gbuffer("g.npz", glossy.surface_points(CAMERA, glossy.Sphere()))
    pathlib.Path("s.toml").write_text("material = 'mx=.2'\n")
    yield
    os.chdir(before)


def call(name: str, arguments: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = getattr(glossy, name)(**arguments)
        if isinstance(found, collections.abc.Iterator):
            list(found)


@pytest.mark.parametrize("name", VALID)
def test_what_is_valid_works(name: str) -> None:
    call(name, VALID[name])


@pytest.mark.parametrize("name", VALID)
@settings(max_examples=40)
@given(st.data())
def test_any_value_works_or_is_one_line_that_names_the_argument(name: str, data: Any) -> None:
    argument = data.draw(st.sampled_from(sorted(VALID[name])))
    value = data.draw(VALUES)
    try:
        call(name, {**VALID[name], argument: value})
    except (ValueError, OSError) as error:
        text = str(error)
        assert "\n" not in text
        assert len(text) < 400
        if isinstance(value, str) and value and value in text:
            return  # a file, or what is missing in it
        named = (argument.rstrip("s"), *OTHERS.get(argument, ()))
        assert any(word in text.partition("got")[0] for word in named), (argument, value, text)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("shade", {"material": "alanod"}, "material: must be a Material or a Lobe, got 'alanod'"),
        ("shade", {"points": PYRAMID, "prepared": POINTS}, "points: must be SurfacePoints, got <"),
        ("shade", {"prepared": CUBE}, "prepared: must be a Pyramid, got <class 'glossy.cubemap.C"),
        ("shade", {"method": "split-sum"}, "samples: is no option of method 'split-sum'"),
        ("shade", {"method": "thesis", "prepared": []}, r"prepared: must be a Pyramid, got \[\]"),
        ("shade", {"pattern": 7}, "pattern: must be a Pattern or a sequence, got 7"),
        ("trace", {"point": None}, "point: must be SurfacePoints, got None"),
        ("trace", {"pyramid": "studio"}, "pyramid: must be a Pyramid, got 'studio'"),
        ("reference", {"cube": "studio"}, "cube: must be a CubeMap, got 'studio'"),
        ("reference", {"cube": POINTS, "points": CUBE}, "points: must be SurfacePoints"),
        ("reference", {"material": glossy.Lobe}, "material: must have eval, sample and pdf"),
        ("reference", {"material": [LOBE]}, "material: must have eval, sample and pdf"),
        ("reference", {"diffuse": "no"}, "diffuse: must be True or False, got 'no'"),
        ("reference", {"parallax": 3}, "parallax: must be BoundingPlanes or None, got 3"),
        ("surface_points", {"shape": CAMERA}, "shape: must be a Sphere or a Plane, got <class"),
        ("surface_points", {"camera": []}, r"camera: must be a Camera, got \[\]"),
        ("build_pyramid", {"cube": np.ones((6, 4, 4, 3))}, "cube: must be a CubeMap, got <class"),
        ("Material", {"reflection": 3}, "reflection: must be a sequence, got 3"),
        ("Material", {"reflection": ["alanod"]}, "reflection: must be a sequence of Lobe"),
        ("Material", {"reflection": np.array("x")}, "reflection: must be a sequence, got <class"),
        ("energy", {"material": LOBE}, "material: must be a Material, got <class"),
        ("read_image", {"path": None}, "path: must be a path, got None"),
        ("read_image", {"path": "a\0b"}, "path: must not hold a zero character"),
        ("read_environment", {"path": [1] * 6}, "path: must be a path, got 1"),
        ("write_exr", {"channels": IMAGE}, "channels: must be a mapping of names to values"),
    ],
)  # fmt: skip
def test_what_is_said(name: str, change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        call(name, {**VALID[name], **change})


def test_a_path_of_two_lines_is_a_message_of_one() -> None:
    with pytest.raises(FileNotFoundError, match=r"^a b\.exr: no such file or directory$"):
        glossy.read_image("a\nb.exr")
    with pytest.raises(ValueError, match=r"^a b: a G-buffer must be"):
        glossy.read_gbuffer("a\nb")


@pytest.mark.parametrize("prepared", [None, "studio", CUBE, PYRAMID, [], POINTS, len])
@pytest.mark.parametrize("method", ["split-sum", "bent", "axis-taps", "pem", "prefiltered"])
def test_what_methods_look_up_is_named_by_what_makes_it(method: str, prepared: Any) -> None:
    with pytest.raises(ValueError, match=r"^prepared: must come from "):
        glossy.shade(POINTS, LOBE, prepared, method)


@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        (glossy.fit_table, ("alanod",), "table: must be a MeasuredTable, got 'alanod'"),
        (glossy.prefilter, (None, None), "cube: must be a CubeMap, got None"),
        (glossy.filter_map, ("studio", [0], [1], 4), "cube: must be a CubeMap, got 'studio'"),
        (glossy.plan, (PYRAMID, MATERIAL), "material: must be a Material or a Lobe, got <class"),
        (glossy.read_measured, (3,), "path: must be a path, got 3"),
        (glossy.measured_material, ([],), r"path: must be a path, got \[\]"),
    ],
)
def test_what_is_said_of_slow_functions(function: Any, arguments: Any, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        function(*arguments)


def test_functions_of_scenes_take_scenes() -> None:
    from glossy.render import render_reference, render_scene, trace_pixel

    functions: list[Any] = [render_scene, render_reference, trace_pixel]
    for function in functions:
        with pytest.raises(ValueError, match="scene: must be a Scene, got 'room'"):
            function("room")


def test_an_object_with_the_methods_is_a_material_of_the_truth() -> None:
    class Grey:
        def __init__(self) -> None:
            self.eval, self.sample, self.pdf = LOBE.eval, LOBE.sample, LOBE.pdf

    own = glossy.reference(POINTS, Grey(), CUBE, "qmc", samples=32)
    ours = glossy.reference(POINTS, LOBE, CUBE, "qmc", samples=32)
    assert np.allclose(own.radiance, ours.radiance)


def test_annotations_of_every_checked_function_resolve() -> None:
    """Those that are only imported for type checkers too."""
    for name in glossy.__all__:
        function = getattr(glossy, name)
        if hasattr(function, "__wrapped__"):
            assert all(not isinstance(hint, str) for hint in _arguments.hints(function).values())
