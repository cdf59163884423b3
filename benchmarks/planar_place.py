"""The hall's reflectors for the benchmarks: mirror buffer, real time, converged buffer, truth."""

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

import glossy
from glossy.planar import MirrorBuffer, mirror_pass, reference_planar, shade_planar
from glossy.planar.converge import Refined, Refinement
from glossy.planar.shade import Fallback
from glossy.scenes import View, prepare, view
from glossy.scenes.model import BakeSettings, CaptureSettings, ObjectScene
from glossy.scenes.render import Part, shade_part

Array = npt.NDArray[np.float64]

REFLECTORS = ("floor", "panel", "table top")


class Place:
    """One reflector of the built-in ``hall`` in a view of ``height`` pixels, one ray each.

    ``scale`` and ``margin`` are those of the mirror pass. ``coarse`` bakes quickly, to try things
    out.
    """

    def __init__(
        self, height: int, reflector: str = "floor", scale: float = 1.0, coarse: bool = False
    ) -> None:
        scene = glossy.load_scene("hall")
        assert isinstance(scene, ObjectScene)
        if coarse:
            bake, capture = BakeSettings(0.5, samples=16, bounces=1), CaptureSettings(64, 1)
            scene = dataclasses.replace(scene, bake=bake, capture=capture)
        self.prepared, self.scale = prepare(scene), scale
        camera = dataclasses.replace(scene.camera, width=16 * height // 9, height=height)
        self.seen = view(self.prepared, camera, 1)
        names = [scene.objects[part.index].name for part in self.seen.parts]
        self.at = names.index(reflector)
        self.part = self.seen.parts[self.at]
        self._buffers: dict[tuple[float, bool], MirrorBuffer] = {}
        self._spare: dict[bool, Fallback] = {}
        self._kept: dict[Any, Any] = {}

    def buffer(self, margin: float = 0.0, white: bool = False) -> MirrorBuffer:
        """The mirror buffer, kept; ``white``: no light in it is above 1."""
        key = (margin, white)
        if key not in self._buffers:
            if white:
                whole = self.buffer(margin)
                made = dataclasses.replace(whole, radiance=np.minimum(whole.radiance, 1.0))
            else:
                made = mirror_pass(self.prepared, self.part, self.scale, margin)
            self._buffers[key] = made
        return self._buffers[key]

    def spare(self, white: bool = False) -> Fallback:
        """The reflector's own cube map, for samples that miss the buffer; kept."""
        if white not in self._spare:
            index = self.part.index
            cube = self.prepared.cube_map(index)
            if white:
                cube = glossy.CubeMap(np.minimum(cube.faces, 1.0))
            centre = self.prepared.geometry.center(index)
            self._spare[white] = Fallback(glossy.build_pyramid(cube), centre)
        return self._spare[white]

    def with_material(self, material: glossy.Material) -> Part:
        """The part as if it had other lobes."""
        bare = dataclasses.replace(material, kd=0.0, diffuse_transmission=0.0, kd_falloff=False)
        return dataclasses.replace(self.part, material=bare)

    def real_time(
        self, material: glossy.Material, margin: float = 0.0, white: bool = False, **options: Any
    ) -> Array:
        """Radiance (K, 3) of the lobes from the buffer, with a few samples."""
        part, buffer = self.with_material(material), self.buffer(margin, white)
        value = shade_planar(
            part.points, part.material, buffer, fallback=self.spare(white), **options
        )
        return np.asarray(value, dtype=np.float64)

    def converged(
        self,
        material: glossy.Material,
        samples: int,
        margin: float = 0.0,
        white: bool = False,
        **options: Any,
    ) -> Refined:
        """The same with very many samples, kept."""
        key = ("converged", material, samples, margin, white, *sorted(options.items()))
        if key not in self._kept:
            part, buffer = self.with_material(material), self.buffer(margin, white)
            spare = self.spare(white)
            run = Refinement(part.points, part.material, buffer, fallback=spare, seed=1, **options)
            run.add(samples)
            self._kept[key] = run.state
        found: Refined = self._kept[key]
        return found

    def truth(self, material: glossy.Material, samples: int) -> tuple[Array, Array]:
        """Ray-cast radiance (K, 3) of the lobes and its standard error, kept."""
        key = ("truth", material, samples)
        if key not in self._kept:
            found = reference_planar(self.prepared, self.with_material(material), samples=samples)
            self._kept[key] = found.radiance, found.error
        radiance, error = self._kept[key]
        return radiance, error

    def picture(self, lobes: Array, diffuse: bool = True) -> Array:
        """(H, W, 3): the view with these lobes (K, 3) on the reflector.

        Without ``diffuse`` its diffuse term is left out, as that of a metal.
        """
        if "others" not in self._kept:
            self._kept["others"] = [
                shade_part(self.prepared, part) for part in self.seen.parts if part is not self.part
            ]
        others = list(self._kept["others"])
        seen: View = self.seen
        if not diffuse:
            base = seen.base.copy()
            base[self.part.rays] = 0.0
            seen = dataclasses.replace(seen, base=base)
        return seen.picture([*others[: self.at], lobes, *others[self.at :]])

    def diffuse(self) -> Array:
        """Radiance (K, 3) of the reflector without its lobes."""
        return np.asarray(self.seen.base[self.part.rays])

    def heights(self) -> Array:
        """(K,) distance from the plane of what each point mirrors [m]; inf for the sky."""
        camera, buffer = self.buffer().camera, self.buffer()
        assert self.part.points.position is not None
        pixel = camera.project(self.part.points.position)
        column, row = (
            np.clip(pixel[:, k].astype(np.intp), 0, size - 1)
            for k, size in enumerate((camera.width, camera.height))
        )
        away = (buffer.position[row, column] - camera.point) @ camera.normal
        return np.where(buffer.hit[row, column], away, np.inf)


def apart(a: Array, b: Array, noise: Array | float, scale: Array | None = None) -> float:
    """RMS of a - b without what ``noise`` (standard errors) adds, over the RMS of ``scale``."""
    square = float(np.mean(np.square(a - b)) - np.mean(np.square(noise)))
    return float(np.sqrt(max(square, 0.0) / np.mean(np.square(b if scale is None else scale))))
