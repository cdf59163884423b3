"""Cameras, shapes, scene files and G-buffers against closed forms."""

import math
import os
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import tolerances
from hypothesis import given
from hypothesis import strategies as st

from glossy import read_environment, write_image
from glossy import scene as scenes
from glossy.frames import SurfacePoints, normalise
from glossy.gbuffer import pick_channels, read_gbuffer, write_gbuffer
from glossy.materials import parse_material
from glossy.scene import (
    Camera,
    EnvironmentSource,
    Plane,
    Scene,
    Sphere,
    default_camera,
    surface_points,
)

FloatArray = npt.NDArray[np.floating]


def load_scene(path: pathlib.Path) -> Scene:
    scene = scenes.load_scene(path)
    assert isinstance(scene, Scene)
    return scene


def hit_point(camera: Camera, shape: Any, row: int, col: int) -> FloatArray | None:
    """Twin of the sphere's intersection for one pixel: the quadratic formula, scalar."""
    ray = camera.rays()[row, col]
    away = np.subtract(camera.position, shape.center)
    b, c = float(ray @ away), float(away @ away) - shape.radius**2
    disc = b * b - c
    if disc <= 0.0 or b >= 0.0:
        return None
    return np.asarray(np.asarray(camera.position) + (-b - math.sqrt(disc)) * ray)


def test_the_middle_of_an_odd_picture_looks_at_the_target() -> None:
    camera = Camera((1, 2, 3), (-2, 0.5, 0), fov=50, width=5, height=3)
    along = normalise(np.subtract(camera.target, camera.position))
    assert np.abs(camera.rays()[1, 2] - along).max() < tolerances.ROUNDOFF


def test_rows_run_down_and_columns_to_the_right() -> None:
    rays = Camera(width=4, height=4).rays()
    assert np.all(np.diff(rays[..., 1], axis=0) < 0)
    assert np.all(np.diff(rays[..., 0], axis=1) > 0)


def test_field_of_view_is_vertical_and_reaches_the_picture_edge() -> None:
    """Half a pixel beyond the outermost centre lies fov/2: tan differs by one pixel height."""
    camera = Camera(fov=40, width=10, height=20)
    top = camera.rays()[0, 4:6].mean(axis=0)
    tan = top[1] / -top[2]
    assert tan == pytest.approx(math.tan(math.radians(20)) * (1 - 1 / 20), abs=1e-12)


@given(
    st.tuples(*[st.floats(-1, 1)] * 3),
    st.floats(0.2, 3.0),
    st.floats(20, 90),
)
def test_sphere_hits_lie_on_the_sphere(
    center: tuple[float, float, float], radius: float, fov: float
) -> None:
    camera = Camera((0.5, 1.0, 6.0), center, fov=fov, width=9, height=7)
    sphere = Sphere(center, radius)
    points = surface_points(camera, sphere)
    for row, col in np.ndindex(7, 9):
        p = hit_point(camera, sphere, row, col)
        if p is None:
            continue
        assert points.coverage[row, col]
        n = (p - center) / radius
        assert np.abs(points.normal[row, col] - n).max() < tolerances.INTERSECTION
        assert np.sum(points.normal[row, col] * points.view[row, col]) > 0


def test_sphere_silhouette_is_where_the_tangent_cone_is() -> None:
    """A ray meets the sphere exactly when its angle to the axis is below asin(r/d)."""
    camera = Camera((0, 0, 4), (0, 0, 0), fov=40, width=65, height=65)
    angle = np.arccos(np.clip(camera.rays() @ [0, 0, -1], -1, 1))
    expected = angle < math.asin(1 / 4)
    assert np.array_equal(surface_points(camera, Sphere()).coverage, expected)
    assert 0.2 < expected.mean() < 0.5


def test_a_centred_sphere_is_symmetric_in_the_picture() -> None:
    points = surface_points(default_camera(Sphere(), 32, 32), Sphere())
    n, seen = points.normal, points.coverage
    assert np.array_equal(seen, seen[::-1])
    assert np.array_equal(seen, seen[:, ::-1])
    assert np.abs(n - n[:, ::-1] * [-1, 1, 1])[seen].max() < tolerances.ROUNDOFF
    assert np.abs(n - n[::-1] * [1, -1, 1])[seen].max() < tolerances.ROUNDOFF
    assert 0.68 < seen.mean() < 0.78  # pi/4 of 0.96^2


def test_sphere_tangent_is_the_convention() -> None:
    """T = normalise(cross(+y, n)), b = cross(n, t): +x and +y where the sphere faces +z."""
    points = surface_points(default_camera(Sphere(), 33, 33), Sphere())
    seen = points.coverage
    expected = normalise(np.cross([0.0, 1.0, 0.0], points.normal[seen]))
    assert np.abs(points.tangent[seen] - expected).max() < tolerances.ROUNDOFF
    assert np.abs(points.tangent[16, 16] - [1, 0, 0]).max() < tolerances.ROUNDOFF
    assert np.abs(points.bitangent[16, 16] - [0, 1, 0]).max() < tolerances.ROUNDOFF
    assert np.abs(np.linalg.norm(points.view, axis=-1) - 1).max() < tolerances.ROUNDOFF


def test_a_camera_inside_or_behind_sees_nothing() -> None:
    assert not surface_points(Camera((0, 0, 0.5), (0, 0, 0)), Sphere()).coverage.any()
    assert not surface_points(Camera((0, 0, 4), (0, 0, 9)), Sphere()).coverage.any()
    assert not surface_points(Camera((0, -1, 4), (0, 0, 0)), Plane()).coverage.any()


def test_plane_is_seen_below_its_horizon() -> None:
    camera = Camera((0, 2, 5), (0, 2, 0), fov=60, width=16, height=20)
    points = surface_points(camera, Plane())
    assert not points.coverage[:10].any()
    assert points.coverage[10:].all()
    assert np.all(points.normal[points.coverage] == [0, 1, 0])
    assert np.all(points.tangent[points.coverage] == [1, 0, 0])
    turned = surface_points(camera, Plane(tangent=(0, 0, 2)))
    assert np.all(turned.tangent[points.coverage] == [0, 0, 1])


@pytest.mark.parametrize("shape", [Sphere((1, 2, 3), 2.5), Plane((0, 1, 0), (1, 1, 0))])
@pytest.mark.parametrize(("width", "height"), [(64, 64), (64, 100), (100, 64)])
def test_the_default_camera_shows_the_shape(shape: Any, width: int, height: int) -> None:
    seen = surface_points(default_camera(shape, width, height), shape).coverage
    assert seen.any()
    assert not seen.all()
    if isinstance(shape, Sphere):
        assert not seen[0].any()
        assert not seen[:, 0].any()
        assert seen.sum() > 0.6 * min(width, height) ** 2


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Camera(fov=180), "fov"),
        (lambda: Camera(target=(0, 0, 4)), "target"),
        (lambda: Camera(up=(0, 0, 1)), "up"),
        (lambda: Camera(width=0), "width"),
        (lambda: Camera(position=(1, 2)), "position"),
        (lambda: Sphere(radius=0), "radius"),
        (lambda: Plane(normal=(0, 0, 0)), "normal"),
        (lambda: Plane(tangent=(0, 3, 0)), "tangent"),
        (lambda: Scene(background="red"), "background"),
    ],
)
def test_bad_values_are_refused_by_name(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ValueError, match=f"^{words}: must"):
        make()


SCENE = """
material = "mx=.2,my=.075"
background = "black"
[environment]
source = "studio"
size = 64
[shape]
kind = "sphere"
radius = 2
[camera]
position = [0, 1, 9]
fov = 45
width = 30
height = 20
[method]
name = "importance"
samples = 40
bias = -0.5
"""


def write(folder: pathlib.Path, text: str) -> pathlib.Path:
    path = folder / "scene.toml"
    path.write_text(text)
    return path


def test_scene_file_is_read(tmp_path: pathlib.Path) -> None:
    scene = load_scene(write(tmp_path, SCENE))
    assert (scene.environment.source, scene.environment.size) == ("studio", 64)
    assert scene.shape == Sphere(radius=2)
    assert scene.camera == Camera((0, 1, 9), (0, 0, 0), fov=45, width=30, height=20)
    assert (scene.method, scene.samples, dict(scene.options)) == ("importance", 40, {"bias": -0.5})
    assert scene.background == "black"
    assert scene.points().shape == (20, 30)


def test_an_empty_scene_file_is_the_default_scene(tmp_path: pathlib.Path) -> None:
    scene = load_scene(write(tmp_path, ""))
    assert scene.view() == Scene().view()
    assert scene.environment == Scene().environment


def test_material_table(tmp_path: pathlib.Path) -> None:
    text = "[material]\nkd = 0.3\n[[material.reflection]]\nmx = 0.1\nks = [1, 0.5, 0.2]\n"
    material = load_scene(write(tmp_path, text)).load_material()
    assert material.kd == 0.3
    assert material.reflection[0].widths == (0.1, 0.1)
    assert material.reflection[0].ks == (1.0, 0.5, 0.2)


def test_paths_are_relative_to_the_scene_file(tmp_path: pathlib.Path) -> None:
    (tmp_path / "room.hdr").write_bytes(b"")
    scene = load_scene(write(tmp_path, '[environment]\nsource = "room.hdr"\n'))
    assert scene.environment.source == str(tmp_path / "room.hdr")


def test_six_png_faces_by_a_pattern_beside_the_scene_file(tmp_path: pathlib.Path) -> None:
    rng = np.random.default_rng(2)
    faces = (rng.integers(0, 256, (6, 8, 8, 3)) / 255.0).astype(np.float32)
    files = [tmp_path / f"sky_{name}.png" for name in ("px", "nx", "py", "ny", "pz", "nz")]
    for file, face in zip(files, faces, strict=True):
        write_image(file, face)
    table = 'source = "sky_*.png"\nsize = 8\nencoding = "srgb"\n'
    scene = load_scene(write(tmp_path, f"[environment]\n{table}"))
    assert scene.environment.source == str(tmp_path / "sky_*.png")
    expected = read_environment(files, size=8, encoding="srgb")
    assert np.array_equal(scene.environment.load().faces, expected.faces)
    missing = EnvironmentSource(str(tmp_path / "room_*.png"))
    with pytest.raises(ValueError, match="must hold a file for face"):
        missing.load()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[camera]\nfow = 3", "camera.fow: unknown key"),
        ("colour = 3", "colour: unknown key"),
        ("[[material.reflection]]\nmz = 1", r"material: reflection\[0\]: key: must be one of"),
        ("[camera]\nfov = 200", "fov: must be in"),
        ("[camera]\nposition = 'here'", "position: must"),
        ("[shape]\nkind = 'cube'", "shape.kind: must be one of"),
        ("material = 3", "material: must be"),
        ("gbuffer = 'a.npz'\n[shape]\nradius = 2", "gbuffer: stands for"),
        ('gbuffer = "a\\u0085b.exr"', "gbuffer: must be a path"),
        (f"gbuffer = '{'x' * 5000}'", "gbuffer: must be a path"),
        ('material = "a\\nb.toml"', "material: must be a text"),
        ('[environment]\nsource = "a\\u2028*"', "source: must be a name or a path"),
        ("camera = 3", "camera: must be a table"),
        ("[camera", "must be TOML, got Expected"),
    ],
)
def test_bad_scene_files_name_the_file_and_the_key(
    tmp_path: pathlib.Path, text: str, words: str
) -> None:
    with pytest.raises(ValueError, match=rf"scene\.toml: {words}"):
        load_scene(write(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"[camera]\nfov = 1{'0' * 400}", "fov: must fit float64"),
        (f"[camera]\nwidth = 1{'0' * 400}", "width: must be from 1 to"),
        (f"[camera]\nfov = 1{'0' * 9000}", "must be TOML, got Exceeds the limit"),
        (f"[camera]\nposition = [1{'0' * 400}, 0, 0]", "position: must fit"),
        ("[camera]\nfov = true", "fov: must be a number"),
        ("[camera]\nfov = 2020-01-01", "fov: must be a number"),
        ("[camera]\nposition = [0, 1, true]", "position: must be an array of real numbers"),
        ("[camera]\nposition = ['0', '1', '2']", "position: must be an array of real numbers"),
        (f"[camera]\nfov = {'[' * 9000}{']' * 9000}", "must be TOML, got tables nested too deeply"),
        (f"a{'.a' * 64} = 1", "must be TOML, got a key of more than 64 parts"),
        (f"x = 1 \n[a{' . a' * 20000}]", "must be TOML, got a key of more than 64 parts"),
        ("a = {b" + '."."' * 64 + " = 1}", "must be TOML, got a key of more than 64 parts"),
        (f"a{'.a' * 63} = [{'.1,' * 200}]", "must be TOML, got Invalid value"),
        (f"[shape]\nradius = 1{'0' * 400}", "radius: must fit"),
        ("[shape]\nradius = '1'", "radius: must be a number"),
        ("[shape]\nradius = 1e-320", "radius: must be in"),
        ("[shape]\ncenter = [1e308, 0, 0]", "center: must be within"),
        ("[camera]\nposition = [0, 1e200, 0]", "position: must be within"),
        ("[material]\nkd = true", "material: kd: must be a finite number"),
        (f"[material]\nkd = 1{'0' * 400}", "material: kd: must be a finite number"),
        (f"[method]\nsamples = 1{'0' * 400}", "samples: must be below 2"),
        (f"[environment]\nsize = 1{'0' * 400}", "size: must be below 2"),
        (f"[environment]\nsource = '{'x' * 5000}'\nsize = true", "size: must be a whole number"),
    ],
)
def test_numbers_that_are_none_or_too_large_are_one_line(
    tmp_path: pathlib.Path, text: str, words: str
) -> None:
    with pytest.raises(ValueError, match=rf"scene\.toml: {words}") as error:
        load_scene(write(tmp_path, text))
    assert len(str(error.value)) < 500
    assert "\n" not in str(error.value)


def test_a_byte_order_mark_is_skipped(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xef\xbb\xbfmaterial = 'mx=.2'\n")
    scene = load_scene(path)
    assert isinstance(scene, Scene)
    assert scene.material == "mx=.2"


def test_an_empty_file_is_the_default_scene(tmp_path: pathlib.Path) -> None:
    assert load_scene(write(tmp_path, "")) == Scene(camera=default_camera(Sphere()))


@pytest.mark.parametrize("read", [load_scene, parse_material, read_gbuffer])
def test_what_has_no_end_is_refused_unopened(tmp_path: pathlib.Path, read: Any) -> None:
    for suffix in (".toml", ".json") if read is not read_gbuffer else (".npz", ".exr"):
        pipe = tmp_path / f"pipe{suffix}"
        os.mkfifo(pipe)
        with pytest.raises(OSError, match="is not a regular file"):
            read(pipe)
        endless = tmp_path / f"zero{suffix}"
        endless.symlink_to("/dev/zero")
        with pytest.raises(OSError, match="is not a regular file"):
            read(endless)


@pytest.fixture
def points() -> SurfacePoints:
    return surface_points(default_camera(Sphere(), 24, 16), Sphere())


@pytest.mark.parametrize(
    ("suffix", "tolerance"), [(".npz", tolerances.ROUNDOFF), (".exr", tolerances.SINGLE)]
)
def test_gbuffer_round_trip(
    tmp_path: pathlib.Path, points: SurfacePoints, suffix: str, tolerance: float
) -> None:
    path = tmp_path / f"points{suffix}"
    write_gbuffer(path, points)
    back = read_gbuffer(path)
    seen = points.coverage
    assert np.array_equal(back.coverage, seen)
    for name in ("normal", "tangent", "view"):
        assert np.abs(getattr(back, name) - getattr(points, name))[seen].max() < tolerance
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_zero_normals_are_background_and_tangents_optional(
    tmp_path: pathlib.Path, points: SurfacePoints
) -> None:
    normal = np.where(points.coverage[..., None], points.normal, 0.0)
    np.savez(tmp_path / "p.npz", normal=normal, view=points.view)
    back = read_gbuffer(tmp_path / "p.npz")
    assert np.array_equal(back.coverage, points.coverage)
    seen = points.coverage
    assert np.abs(back.tangent - points.tangent)[seen].max() < tolerances.ROUNDOFF


@pytest.mark.parametrize(
    "names", ["N.X N.Y N.Z V.X V.Y V.Z", "Normal.R Normal.G Normal.B wo.x wo.y wo.z"]
)
def test_channel_spellings(points: SurfacePoints, names: str) -> None:
    stack = np.concatenate([points.normal, points.view], axis=-1)
    found = pick_channels({name: stack[..., k] for k, name in enumerate(names.split())})
    assert np.array_equal(found["normal"], points.normal)
    assert np.array_equal(found["view"], points.view)


def test_bad_gbuffers_name_the_file_and_the_fault(
    tmp_path: pathlib.Path, points: SurfacePoints
) -> None:
    def refused(name: str, words: str, **arrays: Any) -> None:
        np.savez(tmp_path / name, **arrays)
        with pytest.raises(ValueError, match=rf"{name}: {words}"):
            read_gbuffer(tmp_path / name)

    refused("a.npz", "misses array view", normal=points.normal)
    refused("b.npz", "normal: must have shape", normal=np.ones(3), view=np.ones(3))
    refused("c.npz", "view: must be unit", normal=points.normal, view=3 * points.view)
    refused("d.npz", "mask: must have", normal=points.normal, view=points.view, mask=[True])
    (tmp_path / "e.npz").write_text("no archive")
    with pytest.raises(ValueError, match=r"e\.npz: not an npz"):
        read_gbuffer(tmp_path / "e.npz")
    (tmp_path / "f.jpg").write_text("")
    with pytest.raises(ValueError, match=r"f\.jpg: a G-buffer must be"):
        read_gbuffer(tmp_path / "f.jpg")
    with pytest.raises(FileNotFoundError):
        read_gbuffer(tmp_path / "absent.npz")


def test_positions_lie_on_the_shape_and_on_the_ray() -> None:
    sphere = Sphere((1.0, 2.0, 3.0), 0.5)
    camera = default_camera(sphere, 16, 12)
    p = surface_points(camera, sphere)
    assert p.position is not None
    seen = p.coverage
    away = (p.position - sphere.center)[seen]
    np.testing.assert_allclose(away, 0.5 * p.normal[seen], atol=tolerances.INTERSECTION)
    plane = Plane((0.0, 1.0, 0.0))
    q = surface_points(default_camera(plane, 16, 12), plane)
    assert q.position is not None
    np.testing.assert_allclose(q.position[q.coverage][:, 1], 1.0, atol=tolerances.INTERSECTION)
    assert not q.position[~q.coverage].any()
