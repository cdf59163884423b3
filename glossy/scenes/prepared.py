"""A scene ready for pictures: geometry, light maps and cube maps, made once and kept on disk.

What was made is stored under a digest of everything it depends on: objects, lights, environment,
settings and the sources that make it. A moved camera or another method finds it again; a moved
object makes a new one. ``update`` makes it again in any case.
"""

import contextlib
import dataclasses
import hashlib
import os
import pathlib
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check, methods
from .._npz import load_npz
from .._output import write_npz
from .._sources import sources_of
from ..cubemap import CubeMap
from ..irradiance import irradiance_map
from ..pyramid import build_pyramid
from .bake import Progress, bake
from .capture import Radiance, capture
from .geometry import Geometry
from .lightmaps import LightMaps, layout
from .model import ObjectScene
from .shapes import Mesh, Rectangle

IRRADIANCE_SIZE = 16


def cache_root() -> pathlib.Path:
    """Folder of baked scenes: below ``XDG_CACHE_HOME`` or ``~/.cache``."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (pathlib.Path(base) if base else pathlib.Path.home() / ".cache") / "glossy" / "scenes"


def _store(path: pathlib.Path, arrays: dict[str, npt.NDArray[Any]]) -> None:
    """Keep arrays for the next time; a full or read-only disk is no error."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_npz(path, arrays)


def _load(path: pathlib.Path) -> dict[str, npt.NDArray[Any]] | None:
    """The arrays of a stored file, None if it is not there or damaged."""
    try:
        return load_npz(path)
    except (OSError, ValueError):
        return None


class PreparedScene:
    """A scene's geometry, light maps and cube maps.

    Made by ``prepare``. ``scene``: as given; ``geometry``: its objects, then its lights; ``maps``;
    ``seconds``: what each stage took, and ``cached``: which came from disk.
    """

    def __init__(
        self,
        scene: ObjectScene,
        cache: bool = True,
        update: bool = False,
        progress: Progress | None = None,
    ) -> None:
        self.scene = scene
        self.seconds: dict[str, float] = {}
        self.cached: dict[str, bool] = {}
        self._cache, self._update = cache, update
        self._cubes: dict[int, CubeMap] = {}
        self._lookups: dict[tuple[int, str], Any] = {}
        self._shadows: dict[tuple[int, str], Any] = {}
        self._alone: dict[int, Geometry] = {}
        self._irradiance: dict[int, CubeMap] = {}
        start = time.perf_counter()
        self.sky = self._sky()
        placed = [(o.shape, o.transform) for o in scene.objects]
        placed += [(Rectangle(light.size), light.transform) for light in scene.lights]
        self.geometry = Geometry(placed)
        self._book("scene", start)
        self._digest = self._bake_digest()
        start = time.perf_counter()
        self.maps = self._light_maps(progress)
        self._book("bake", start)
        self.world = Radiance(scene, self.geometry, self.maps, self.sky)

    def _book(self, stage: str, start: float) -> None:
        spent = time.perf_counter() - start
        self.seconds[stage] = round(self.seconds.get(stage, 0.0) + spent, 6)

    def _sky(self) -> CubeMap | None:
        if self.scene.environment is None:
            return None
        cube = self.scene.environment.load()
        scale = np.asarray(self.scene.environment_scale, dtype=np.float32)
        return cube if np.all(scale == 1.0) else CubeMap(cube.faces * scale)

    def _bake_digest(self) -> str:
        digest = hashlib.sha256()
        for source in sources_of(pathlib.Path(__file__)):
            digest.update(source.read_bytes())
        for item in self.scene.objects:
            kept = dataclasses.replace(item, method={}, name="", capture_size=None)
            digest.update(repr(kept).encode())
            for file in (item.light_map, item.shape.file if isinstance(item.shape, Mesh) else None):
                if file is not None:
                    digest.update(pathlib.Path(file).read_bytes())
        digest.update(repr((self.scene.lights, self.scene.bake)).encode())
        if self.sky is not None:
            digest.update(self.sky.faces.tobytes())
        return digest.hexdigest()[:24]

    def _light_maps(self, progress: Progress | None) -> LightMaps:
        path = cache_root() / f"{self._digest}.npz"
        stored = _load(path) if self._cache and not self._update else None
        self.cached["bake"] = stored is not None
        if stored is not None:
            sides: dict[int, list[tuple[int, int]]] = {}
            for j, rows, columns in stored["sides"].tolist():
                sides.setdefault(j, []).append((rows, columns))
            plan = layout(self.geometry, 1.0, sides)
            values = stored["values"]
            if values.shape == (plan.count, 3):
                error = float(stored["error"])
                return LightMaps(self.scene, self.geometry, plan, values, error)
        sky = None if self.sky is None else build_pyramid(self.sky)
        maps = bake(self.scene, self.geometry, sky, progress)
        if self._cache:
            ends = [*maps.plan.first[1:], len(maps.plan.charts)]
            rows_of = zip(maps.plan.first, ends, strict=True)
            rows = [
                (j, *maps.plan.charts[c, 1:3])
                for j, (a, b) in enumerate(rows_of)
                for c in range(a, b)
            ]
            table = np.array(rows, dtype=np.int64).reshape(-1, 3)
            _store(path, {"values": maps.values, "sides": table, "error": np.array(maps.error)})
        return maps

    def cube_map(self, index: int, update: bool = False) -> CubeMap:
        """The captured cube map of object ``index``; made on the first use or when asked.

        Raises
        ------
        ValueError
            If there is no such object.
        """
        _check.count("object", index, low=0, high=len(self.scene.objects) - 1)
        if index in self._cubes and not update:
            return self._cubes[index]
        start = time.perf_counter()
        settings = self.scene.capture
        size = self.scene.objects[index].capture_size or settings.size
        name = f"{self._digest}-{index}-{size}-{settings.supersampling}.npz"
        path = cache_root() / name
        stored = _load(path) if self._cache and not (update or self._update) else None
        if stored is not None and stored["faces"].shape == (6, size, size, 3):
            cube = CubeMap(stored["faces"])
        else:
            stored = None
            cube = capture(self.world, index, size, settings.supersampling)
            if self._cache:
                _store(path, {"faces": cube.faces})
        self.cached["capture"] = self.cached.get("capture", True) and stored is not None
        self._cubes[index] = cube
        for kept in (self._lookups, self._shadows):
            for key in [k for k in kept if k[0] == index]:
                del kept[key]
        self._irradiance.pop(index, None)
        self._book("capture", start)
        return cube

    def irradiance(self, index: int, normals: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Irradiance (..., 3) that an object's cube map gives surfaces of these normals."""
        if index not in self._irradiance:
            start = time.perf_counter()
            self._irradiance[index] = irradiance_map(self.cube_map(index), IRRADIANCE_SIZE)
            self._book("irradiance", start)
        return self._irradiance[index].lookup(normals)

    def lookup(self, index: int, method: str, **options: Any) -> Any:
        """What ``method`` looks up for an object: made of its cube map, a MIP pyramid mostly."""
        key = (index, repr((method, sorted(options.items()))))
        cube = self.cube_map(index)
        if key not in self._lookups:
            start = time.perf_counter()
            material = self.scene.objects[index].material
            self._lookups[key] = methods.prepare(method, cube, material, **options)
            self._book("prepare", start)
        return self._lookups[key]

    def self_occluder(self, index: int) -> Geometry | None:
        """An object alone, which may be in the way of its own light; None if it is convex.

        Its cube map holds the other objects as light: what they hide is not in it.
        """
        if self.geometry.convex(index):
            return None
        if index not in self._alone:
            item = self.scene.objects[index]
            self._alone[index] = Geometry([(item.shape, item.transform)])
        return self._alone[index]

    def shadows(
        self,
        index: int,
        method: str,
        preparation: Mapping[str, Any],
        options: bool | Mapping[str, Any],
    ) -> Any:
        """Shadows of an object on itself, made once; None if it is convex or has them off.

        None with bounding planes, too: light is then not infinitely far away.

        ``preparation``: options of ``lookup``; ``options``: the scene's ``shadows``.
        """
        if options is False or method not in methods.SHADOWS or self.scene.planes:
            return None
        alone = self.self_occluder(index)
        if alone is None:
            return None
        own = {} if options is True else dict(options)
        key = (index, repr((method, sorted(preparation.items()), sorted(own.items()))))
        if key not in self._shadows:
            lookup = self.lookup(index, method, **preparation)
            start = time.perf_counter()
            self._shadows[key] = methods.shadows(method, alone, lookup, **own)
            self._book("shadows", start)
        return self._shadows[key]


def prepare(
    scene: ObjectScene,
    cache: bool = True,
    update: bool = False,
    progress: Progress | None = None,
) -> PreparedScene:
    """Make a scene ready for pictures: read its files, bake its light maps or find them on disk.

    Parameters
    ----------
    scene : ObjectScene
        As ``load_scene`` returns it.
    cache : bool
        Keep light maps and cube maps below ``~/.cache/glossy/scenes`` (``XDG_CACHE_HOME``).
    update : bool
        Make them anew even if they are there.
    progress : callable, optional
        Wraps the loop of the baker.

    Raises
    ------
    ValueError, OSError
        For files that cannot be used.
    """
    return PreparedScene(scene, cache, update, progress)
