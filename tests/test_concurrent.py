"""Pictures made at once by several Python threads are those made one after the other."""

import concurrent.futures
import pathlib

import numpy as np

import glossy
from glossy.render import render_reference, render_scene
from glossy.scene import EnvironmentSource, Scene, Sphere, default_camera

SIZE = 8
METHODS = ("regular", "importance", "thesis", "regular")


def test_scenes_rendered_at_once_are_those_rendered_in_turn(tmp_path: pathlib.Path) -> None:
    """Reading, preparing, shading, the truth: every step of four pictures, from one file."""
    pixels = np.random.default_rng(2).random((2 * SIZE, 4 * SIZE, 3)).astype(np.float32)
    glossy.write_image(tmp_path / "map.exr", pixels)
    source = EnvironmentSource(str(tmp_path / "map.exr"), size=SIZE)
    camera = default_camera(Sphere(), 24, 20)
    scenes = [
        Scene(source, f"mx={0.1 + 0.05 * k}", camera=camera, method=method)
        for k, method in enumerate(METHODS)
    ]

    def made(scene: Scene) -> list[bytes]:
        truth = render_reference(scene, "qmc", samples=32)
        return [render_scene(scene).image.tobytes(), truth.image.tobytes(), truth.error.tobytes()]

    alone = [made(scene) for scene in scenes]
    with concurrent.futures.ThreadPoolExecutor(len(scenes)) as pool:
        for _ in range(3):
            assert list(pool.map(made, scenes)) == alone
    assert len({pictures[0] for pictures in alone}) == len(scenes)
