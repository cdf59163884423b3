"""Mesh files: all kinds say the same, corners meet by place, and what is damaged is one line."""

import json
import os
import pathlib
import warnings
from collections.abc import Callable
from typing import Any

import mesh_files as files
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from glossy import _memory
from glossy.scenes import topology
from glossy.scenes.load import parse
from glossy.scenes.mesh_files import read_mesh
from glossy.scenes.soup import MOST_EARS, Soup, cut, fan
from glossy.scenes.topology import Surface, surface

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

SINGLE = 1e-7
"""Coordinates that the file keeps in float32, of a mesh of extent 1."""


def made(points: Array, triangles: Ints, normals: Array | None = None) -> Surface:
    return surface(Soup(points, triangles, normals), "mesh")


def volume(mesh: Surface) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    return float(np.einsum("ij,ij", a, np.cross(b, c)) / 6.0)


# what is read -----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", files.KINDS)
def test_a_box_is_the_same_closed_box_in_every_kind_of_file(
    tmp_path: pathlib.Path, kind: str
) -> None:
    points, triangles = files.box()
    found = surface(read_mesh(files.write(tmp_path, kind, points, triangles)), kind)
    assert found.closed
    assert found.vertices.shape == (8, 3)
    np.testing.assert_array_equal(found.vertices[found.triangles], points[triangles])
    outward = found.vertices * 2.0 - 1.0
    assert np.all(np.einsum("ij,ij->i", found.normals, outward) > 1.0)  # smooth about the corner
    assert volume(found) == pytest.approx(1.0)


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(files.KINDS),
    st.sampled_from(files.KINDS),
)
@example(33591730, "ascii.ply", "binary.ply")  # two triangles back to back, whose normals cancel
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_kinds_of_files_agree_on_any_triangles(
    tmp_path: pathlib.Path, seed: int, one: str, other: str
) -> None:
    draw = np.random.default_rng(seed)
    points = draw.random((7, 3)).astype(np.float32).astype(np.float64)
    triangles = draw.integers(0, 7, (9, 3))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # windings of what is drawn
        a, b = (
            surface(read_mesh(files.write(tmp_path, kind, points, triangles)), kind)
            for kind in (one, other)
        )
    # vertices come in the order in which a file has them
    np.testing.assert_allclose(b.vertices[b.triangles], a.vertices[a.triangles], atol=SINGLE)
    np.testing.assert_allclose(b.normals[b.triangles], a.normals[a.triangles], atol=1e-6)
    assert a.closed == b.closed


@pytest.mark.parametrize("kind", ["ascii.ply", "binary.ply", "obj", "binary.stl", "off", "glb"])
def test_another_library_reads_the_same(tmp_path: pathlib.Path, kind: str) -> None:
    trimesh: Any = pytest.importorskip("trimesh")
    draw = np.random.default_rng(4)
    points, triangles = draw.random((20, 3)), draw.integers(0, 20, (30, 3))
    path = files.write(tmp_path, kind, points, triangles)
    theirs, ours = trimesh.load_mesh(path, process=False), read_mesh(path)
    np.testing.assert_allclose(
        ours.points[ours.triangles], theirs.vertices[theirs.faces], atol=SINGLE
    )


def test_normals_are_the_means_that_another_library_gives() -> None:
    trimesh: Any = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(2)
    ball.vertices = ball.vertices * [1.0, 0.3, 2.0]
    found = made(np.array(ball.vertices), np.array(ball.faces))
    np.testing.assert_array_equal(found.vertices, ball.vertices)
    np.testing.assert_array_equal(found.triangles, ball.faces)
    np.testing.assert_allclose(found.normals, ball.vertex_normals, atol=1e-14)


def test_polygons_of_all_sizes_in_one_file(tmp_path: pathlib.Path) -> None:
    expected = [[0, 1, 2], [0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3], [0, 3, 4]]
    np.testing.assert_array_equal(
        fan(np.array([3, 2, 4, 5]), np.array([0, 1, 2, 0, 1, 0, 1, 2, 3, 0, 1, 2, 3, 4])), expected
    )
    head = "element vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
    head += "property uchar red\nelement face 4\nproperty uchar flags\n"
    head += "property list uchar int vertex_index\nproperty list uchar float texcoord\nend_header\n"
    corners = np.arange(15.0).reshape(5, 3)
    rows = [[0, 1, 2], [0, 1], [0, 1, 2, 3], [0, 1, 2, 3, 4]]
    lines = "".join(f"7 {len(r)} {' '.join(map(str, r))} 2 .5 .5\n" for r in rows)
    body = b"".join(row.astype("<f4").tobytes() + b"\1" for row in corners)
    for row in rows:
        body += bytes([7, len(row)]) + np.array(row, "<i4").tobytes() + b"\2" + b"\0" * 8
    texts = files.text(np.column_stack([corners, np.ones(5)])) + lines
    for kind, data in (("ascii", texts.encode()), ("binary_little_endian", body)):
        path = tmp_path / "mixed.ply"
        path.write_bytes(f"ply\r\nformat {kind} 1.0\n{head}".encode() + data)
        found = read_mesh(str(path))
        np.testing.assert_array_equal(found.triangles, expected)
        np.testing.assert_array_equal(found.points, corners)
    path = tmp_path / "mixed.obj"
    lines = "".join("f " + " ".join(str(k + 1) for k in row) + "\n" for row in rows)
    path.write_text(files.text(corners, "v ") + lines)
    np.testing.assert_array_equal(read_mesh(str(path)).triangles, expected)


@given(
    st.integers(0, 2**32 - 1), st.integers(4, 24), st.integers(0, 23), st.sampled_from([-1.0, 1.0])
)
def test_faces_with_dents_are_covered_once(seed: int, count: int, turn: int, way: float) -> None:
    """Triangles of a star-like face, in any plane: all its way round, and of its area in sum."""
    rng = np.random.default_rng(seed)
    angle = way * np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    radius = rng.uniform(0.2, 1.0, count)
    flat = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    corners = np.roll(flat, turn % count, axis=0) @ np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    after = np.roll(corners, -1, axis=0)
    newell = np.cross(corners, after).sum(axis=0)
    before = np.arange(3)  # of another face, and a vertex that nobody names
    points = np.concatenate([np.eye(3), corners])
    lengths, named = np.array([3, count]), np.concatenate([before, np.arange(count) + 3])
    found = cut(points, lengths, named)
    assert found.shape == (count - 1, 3)
    np.testing.assert_array_equal(found[0], before)
    a, b, c = np.moveaxis(points[found[1:]], 1, 0)
    areas = np.cross(b - a, c - a) @ newell / np.linalg.norm(newell)
    assert areas.min() > -1e-12
    assert areas.sum() == pytest.approx(np.linalg.norm(newell))
    assert set(found[1:].ravel()) == set(range(3, 3 + count))


def test_faces_with_dents_in_files(tmp_path: pathlib.Path) -> None:
    """An L from its arm's corner: its fan would fill the notch."""
    corners = [(2, 1), (1, 1), (1, 2), (0, 2), (0, 0), (2, 0)]
    path = tmp_path / "l.obj"
    path.write_text("".join(f"v {x} {y} 0\n" for x, y in corners) + "f 1 2 3 4 5 6\n")
    (tmp_path / "l.off").write_text(
        "OFF\n6 1 0\n" + "".join(f"{x} {y} 0\n" for x, y in corners) + "6 0 1 2 3 4 5\n"
    )
    for name in ("l.obj", "l.off"):
        found = read_mesh(str(tmp_path / name))
        a, b, c = np.moveaxis(found.points[found.triangles], 1, 0)
        assert np.cross(b - a, c - a)[:, 2].min() > 0.0


def test_a_face_with_more_dents_than_are_cut_is_refused() -> None:
    flat = np.stack([np.arange(MOST_EARS + 1.0), np.arange(MOST_EARS + 1.0) % 2, np.zeros(1001)], 1)
    with pytest.raises(ValueError, match=r"dents has 1002 corners, at most 1000"):
        cut(np.concatenate([flat, [[1.0, -9.0, 0.0]]]), np.array([1002]), np.arange(1002))


def test_obj_indices_count_back_from_where_they_stand(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "parts.obj"
    part = "v 0 0 {0}\nv 1 0 {0}\nv 0 1 {0}\nvn 0 0 1\nf -3//-1 -2//-1 -1//-1 # a part\n"
    path.write_text("mtllib ../gone.mtl\nusemtl red\n" + part.format(0) + "s 1\n" + part.format(5))
    found = read_mesh(str(path))
    np.testing.assert_array_equal(found.points[found.triangles][:, :, 2], [[0] * 3, [5] * 3])
    assert found.normals is not None
    np.testing.assert_array_equal(found.normals, [[0, 0, 1]] * 6)


def test_gltf_nodes_place_turn_and_mirror(tmp_path: pathlib.Path) -> None:
    points, triangles = files.box()
    tree, data = files.gltf_tree(points, triangles)
    half = np.sqrt(0.5)
    tree["nodes"] = [
        {"children": [1], "translation": [10, 0, 0], "camera": 0},
        {"mesh": 0, "rotation": [0, 0, half, half], "scale": [1, 2, 3]},
        {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},
        {"mesh": 0, "translation": [99, 0, 0]},  # in no scene
    ]
    tree["scenes"] = [{"nodes": [0, 2]}]
    path = tmp_path / "placed.glb"
    path.write_bytes(files.glb(tree, data))
    found = surface(read_mesh(str(path)), "placed")
    assert found.closed
    assert volume(found) == pytest.approx(6.0 + 1.0, rel=1e-6)
    np.testing.assert_allclose(found.vertices.min(axis=0), [-1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(found.vertices.max(axis=0), [10, 1, 3], atol=1e-6)


def test_gltf_strips_fans_quantised_places_and_normals(tmp_path: pathlib.Path) -> None:
    tree, _ = files.gltf_tree(*files.box())
    places = np.array([[0, 0, 0, 9], [127, 0, 0, 9], [0, 127, 0, 9], [127, 127, 0, 9]], "i1")
    data = places.tobytes() + np.array([[0, 0, 2.0]] * 4, "<f4").tobytes()
    tree["bufferViews"] = [
        {"buffer": 0, "byteLength": 16, "byteStride": 4},
        {"buffer": 0, "byteOffset": 16, "byteLength": 48},
    ]
    quantised = {"componentType": 5120, "normalized": True}
    tree["accessors"] = [
        {"bufferView": 0, "count": 4, "type": "VEC3", **quantised},
        {"bufferView": 1, "count": 4, "type": "VEC3", "componentType": 5126},
    ]
    attributes = {"POSITION": 0, "NORMAL": 1}
    tree["meshes"][0]["primitives"] = [
        {"attributes": attributes, "mode": 5},
        {"attributes": attributes, "mode": 6},
        {"attributes": attributes, "mode": 1},
    ]
    path = tmp_path / "strip.glb"
    path.write_bytes(files.glb(tree, data))
    found = read_mesh(str(path))
    np.testing.assert_array_equal(found.triangles, [[0, 1, 2], [1, 3, 2], [4, 5, 6], [4, 6, 7]])
    np.testing.assert_array_equal(found.points[:4], places[:, :3] / 127)
    assert found.normals is not None
    np.testing.assert_array_equal(found.normals, [[0, 0, 2]] * 8)


# what meets and what is outside -----------------------------------------------------------------


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_corners_meet_whatever_their_indices_and_order(seed: int, negative_zero: bool) -> None:
    points, triangles = files.box()
    draw = np.random.default_rng(seed)
    copies = np.repeat(points, 3, axis=0)
    order = draw.permutation(len(copies))
    where = np.empty(len(copies), dtype=np.int64)
    where[order] = np.arange(len(copies))
    shuffled = copies[order]
    if negative_zero:
        shuffled[::2] = np.where(shuffled[::2] == 0.0, -0.0, shuffled[::2])
    rows = draw.permutation(len(triangles))
    given_as = where[3 * triangles[rows] + draw.integers(0, 3, triangles.shape)]
    found, plain = made(shuffled, given_as), made(points, triangles[rows])
    assert found.closed
    assert len(found.vertices) == 8
    np.testing.assert_array_equal(found.vertices[found.triangles], plain.vertices[plain.triangles])
    np.testing.assert_array_equal(found.normals[found.triangles], plain.normals[plain.triangles])


def test_a_gap_is_a_gap_and_a_vertex_that_nothing_names_is_not_there() -> None:
    points, triangles = files.box()
    moved = points[triangles].reshape(-1, 3)
    moved[5] = np.nextafter(moved[5], 2.0)
    assert not made(moved, np.arange(36).reshape(-1, 3)).closed
    stray = np.concatenate([points, [[np.nan, 1e30, 7.0]]])
    assert len(made(stray, triangles).vertices) == 8


def test_triangles_without_area_and_repeated_ones_are_left_out() -> None:
    points, triangles = files.box()
    more = np.concatenate([triangles, triangles[:3, [1, 2, 0]], [[0, 0, 1], [2, 2, 2]]])
    found = made(points, more)
    assert found.closed
    np.testing.assert_array_equal(found.triangles, triangles)
    sheet = np.array([[0, 1, 2], [2, 1, 0]])
    flat = made(np.eye(3), sheet)
    assert not flat.closed
    np.testing.assert_array_equal(flat.triangles, [[0, 1, 2]])
    np.testing.assert_allclose(flat.normals, np.full((3, 3), 3.0**-0.5))


def test_two_boxes_that_share_a_side_stay_closed() -> None:
    points, triangles = files.box()
    found = made(
        np.concatenate([points, points + np.array([1.0, 0.0, 0.0])]),
        np.concatenate([triangles, triangles + 8]),
    )
    assert found.closed
    assert len(found.vertices) == 12
    assert volume(found) == pytest.approx(2.0)


def test_normals_of_the_file_keep_its_creases() -> None:
    points, triangles = files.box()
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    flat = np.cross(b - a, c - a)
    corners, normals = points[triangles].reshape(-1, 3), np.repeat(flat, 3, axis=0)
    index = np.arange(36).reshape(-1, 3)
    found = made(corners, index, normals)
    assert found.closed
    assert len(found.vertices) == 24  # eight corners of three sides each
    np.testing.assert_allclose(found.normals[found.triangles], flat[:, None] * np.ones((1, 3, 1)))
    # of the other winding they are turned; without length or number they are the mean
    np.testing.assert_allclose(made(corners, index, -normals).normals, found.normals)
    normals[:18:2] = np.nan
    normals[1:18:2] = 0.0
    part = made(corners, index, normals)
    assert np.isfinite(part.normals).all()
    np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1.0)


def test_what_is_wound_inside_out_is_turned_and_told() -> None:
    points, triangles = files.box()
    expected = made(points, triangles)
    with pytest.warns(UserWarning, match="12 of 12 triangles are wound inside out, and turned"):
        found = made(points, triangles[:, ::-1])
    np.testing.assert_allclose(found.normals, expected.normals)
    assert volume(found) == pytest.approx(1.0)
    far = np.concatenate([points, points + 5.0])
    with pytest.warns(UserWarning, match="12 of 24 triangles"):
        assert volume(made(far, np.concatenate([triangles, triangles[:, ::-1] + 8]))) > 1.9


def test_a_cavity_stays_and_a_part_beside_a_hollow_is_turned() -> None:
    points, triangles = files.box()
    inner = 0.25 + 0.5 * points
    hollow = np.concatenate([points, inner]), np.concatenate([triangles, triangles[:, ::-1] + 8])
    assert volume(made(*hollow)) == pytest.approx(1.0 - 0.125)
    solid = np.concatenate([points, inner]), np.concatenate([triangles, triangles + 8])
    assert volume(made(*solid)) == pytest.approx(1.0 + 0.125)
    with pytest.warns(UserWarning, match="24 of 24"):  # all of it, the cavity too
        assert volume(made(hollow[0], hollow[1][:, ::-1])) == pytest.approx(1.0 - 0.125)
    # inside the bounding box of an L, but not inside the L
    lying, standing = points * [3.0, 1.0, 1.0], points * [1.0, 3.0, 1.0] + [0.0, 1.0, 0.0]
    beside = 0.5 * points + [2.0, 2.0, 0.25]
    parts = [lying, standing, beside]
    rows = np.concatenate([triangles, triangles + 8, triangles[:, ::-1] + 16])
    with pytest.warns(UserWarning, match="12 of 36"):
        made(np.concatenate(parts), rows)


def test_parts_beyond_the_count_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    points, triangles = files.box()
    monkeypatch.setattr(topology, "TESTED", 5)
    rows = np.concatenate([triangles, triangles[:, ::-1] + 8])
    with pytest.warns(UserWarning, match="more parts within each other than are looked at"):
        made(np.concatenate([4.0 * points, points + 1.0]), rows)


def test_mixed_windings_are_told_and_have_no_outside() -> None:
    points, triangles = files.box()
    triangles[3] = triangles[3, ::-1]
    with pytest.warns(UserWarning, match="wound opposite ways"):
        assert not made(points, triangles).closed


# what is refused --------------------------------------------------------------------------------


def refuse(path: pathlib.Path, says: str) -> None:
    """A refusal is one line that names the file."""
    with pytest.raises(ValueError, match=says) as error:
        surface(read_mesh(str(path)), str(path))
    assert path.name in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400 + len(str(path))


@pytest.mark.parametrize("index", [8, -1, 2**31 - 1])
@pytest.mark.parametrize("kind", ["ascii.ply", "binary.ply", "off", "obj", "glb"])
def test_an_index_that_names_no_vertex(tmp_path: pathlib.Path, kind: str, index: int) -> None:
    points, triangles = files.box()
    triangles[5, 1] = index - 9 if kind == "obj" and index < 0 else index
    refuse(
        pathlib.Path(files.write(tmp_path, kind, points, triangles)), "a face names (vertex|num)"
    )


@pytest.mark.parametrize(
    ("name", "data", "says"),
    [
        ("a.obj", b"v 0 0 0\nf 0 0 0\n", "line 2: a face names number 0, of 1 before it"),
        ("a.obj", b"v 0 0\n", "line 1"),
        ("a.obj", b"v 0 0 x\n", "line 1"),
        ("a.obj", b"v 0 0 0\nf 1//1 1//1 1//1\n", "names normal 1, of 0"),
        ("a.obj", b"v 0 0 0\nf 1 1 %s\n" % (b"9" * 400), "line 2"),
        ("a.obj", b"v %s 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n" % (b"9" * 400), "finite corners"),
        ("a.obj", b"v 0 0 0\nl 1 1\n", "must hold triangles"),
        ("a.obj", b"v 1e30 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "within 1e.12 of the origin"),
        ("a.ply", b"ply\n", "no PLY header"),
        ("a.ply", b"ply\nend_header\n", "names no format"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 9999999999\nproperty float x\n"
                  b"end_header\n1\n", "cut short"),
        ("a.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty float x\n"
                  b"element face 1\nproperty list uint int vertex_index\nend_header\n"
                  b"\xff\xff\xff\xff", "cut short, or a list has 4.29497e.09"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex %s\nend_header\n" % (b"9" * 5000), "no "),
        ("a.stl", b"solid a\nvertex 1 2 3\nendsolid", "neither a text of triangles"),
        ("a.stl", b"\0" * 80 + b"\2\0\0\0" + b"\0" * 50, "neither a text of triangles"),
        ("a.stl", b"vertex 1 2 3 vertex 1 2 nine vertex 1 2 3", "no mesh"),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n", "cut short"),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "claims 3"),
        ("a.off", b"4OFF\n3 1 0\n", "no OFF header"),
        ("a.gltf", b"{}", "damaged .KeyError"),
        ("a.gltf", b"[" * 100_000, "no mesh"),
        ("a.glb", b"glTF\2\0\0\0\0\0\0\0\xff\xff\xff\xffJSON", "cut short"),
        ("a.zip", b"PK\3\4", "a mesh must end in .ply, .obj, .stl, .off, .glb, .gltf"),
        ("a.xyz", b"1 2 3\n", "a mesh must end in"),
        ("a.dae", b"<!DOCTYPE x>", "a mesh must end in"),
    ],
)  # fmt: skip
def test_damaged_meshes(tmp_path: pathlib.Path, name: str, data: bytes, says: str) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    refuse(path, says)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "needs KHR_draco"),
        ({"extensionsUsed": ["EXT_mesh_gpu_instancing"]}, "needs EXT_mesh_gpu"),
        ({"asset": {"version": "1.0"}}, "is glTF 1.0, not 2"),
        ({"scenes": []}, "damaged"),
        ({"nodes": [{"mesh": 0, "children": [0]}]}, "two ways to node 0"),
        ({"nodes": [{"mesh": -1}]}, "'-1' for a whole number"),
        ({"nodes": []}, "damaged"),
        ({"meshes": [{"primitives": []}]}, "has no triangles in its scene"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 4}] * 2}, "ends beyond its buffer"),
        ({"buffers": [{"uri": "../secret.bin"}]}, "outside its folder"),
        ({"buffers": [{"uri": "%2e%2e/secret.bin"}]}, "outside its folder"),
        ({"buffers": [{"uri": "/etc/passwd"}]}, "outside its folder"),
        ({"buffers": [{"uri": "file:///etc/passwd"}]}, "outside its folder"),
        ({"buffers": [{"uri": "https://example.org/a.bin"}]}, "outside its folder"),
        ({"buffers": [{"uri": "link.bin"}]}, "outside its folder"),
        ({"buffers": [{"uri": "pipe.bin"}]}, "is not a regular file"),
        ({"buffers": [{"uri": "data:;base64,!"}]}, "no mesh"),
    ],
)
def test_gltf_that_leads_elsewhere_or_says_what_is_not_read(
    tmp_path: pathlib.Path, change: dict[str, Any], says: str
) -> None:
    tree, data = files.gltf_tree(*files.box())
    secret, folder = tmp_path / "secret.bin", tmp_path / "inside"
    folder.mkdir()
    secret.write_bytes(data)
    (folder / "link.bin").symlink_to(secret)
    os.mkfifo(folder / "pipe.bin")
    path = folder / "a.glb"
    path.write_bytes(files.glb({**tree, **change}, data))
    refuse(path, says)


def test_a_buffer_in_a_file_of_the_folder(tmp_path: pathlib.Path) -> None:
    tree, data = files.gltf_tree(*files.box(), uri="the%20data.bin")
    (tmp_path / "the data.bin").write_bytes(data)
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(tree))
    assert len(read_mesh(str(path)).triangles) == 12


@pytest.mark.parametrize("kind", files.KINDS)
def test_reading_asks_for_memory_before_it_takes_it(
    tmp_path: pathlib.Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = files.write(tmp_path, kind, *files.box())
    monkeypatch.setattr(_memory, "limit", lambda: 500)
    with pytest.raises(ValueError, match=r"would take .* of memory, more than"):
        surface(read_mesh(path), path)


def test_a_gltf_of_repeated_nodes_takes_no_more_than_the_limit(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tree, data = files.gltf_tree(*files.box())
    tree["nodes"] = [{"mesh": 0}] * 2000
    tree["scenes"] = [{"nodes": list(range(2000))}]
    tree["meshes"][0]["primitives"] *= 200
    path = tmp_path / "bomb.glb"
    path.write_bytes(files.glb(tree, data))
    refuse(path, "more than 100000 parts")
    monkeypatch.setattr(_memory, "limit", lambda: 10_000_000)
    refuse(path, "would take .* of memory")


@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
@pytest.mark.parametrize("where", ["mesh", "material", "light_map"])
def test_scenes_open_regular_files_only(tmp_path: pathlib.Path, kind: str, where: str) -> None:
    name = {"mesh": "a.ply", "material": "a.toml", "light_map": "a.exr"}[where]
    path = tmp_path / name
    make: dict[str, Callable[[], None]] = {
        "pipe": lambda: os.mkfifo(path),
        "device": lambda: path.symlink_to("/dev/zero"),
        "folder": path.mkdir,
    }
    make[kind]()
    item: dict[str, Any] = {"shape": {"kind": "sphere"}}
    item |= {"shape": {"kind": "mesh", "file": name}} if where == "mesh" else {where: name}
    key = "shape.file" if where == "mesh" else where
    says = rf"objects\[0\]\.{key}: .*{name}: is (not a regular file|a directory)"
    with pytest.raises(OSError, match=says):
        parse({"objects": [item]}, tmp_path)
