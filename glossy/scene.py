"""What a picture is of: environment, material, shape, camera and method, and the scene file.

A scene file is TOML; every key is optional, paths are relative to the file ::

    material = "mx=0.2,my=0.075"      # a name, a file, parameters, or a [material] table
    background = "environment"        # or "black"

    [environment]
    source = "spots"                  # a built-in name, a file, a folder or pattern of six files
    size = 256

    [shape]
    kind = "sphere"                   # center, radius; or "plane": point, normal, tangent

    [camera]
    position = [0, 0, 4]
    target = [0, 0, 0]
    fov = 30                          # degrees, vertical
    width = 256
    height = 256

    [method]
    name = "regular"
    samples = 20
    threshold = 0.1                   # and any other option of the method

``gbuffer = "points.exr"`` stands for shape and camera, as does a table of a file and how it is
read (docs/gbuffer.md) ::

    [gbuffer]
    file = "points.exr"
    normal = "Ns"
    normalise = true

A file with ``[[objects]]`` is a scene of objects instead: docs/scenes.md.
"""

import dataclasses
import os
import pathlib
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from . import _check
from ._arguments import checked
from ._files import is_name, read_toml
from .camera import Camera, Plane, Shape, Sphere, default_camera, surface_points
from .frames import SurfacePoints

if TYPE_CHECKING:
    from .brdf import Material
    from .cubemap import CubeMap
    from .measured.material import MeasuredMaterial
    from .scenes.model import ObjectScene

__all__ = [
    "Camera",
    "EnvironmentSource",
    "Plane",
    "Scene",
    "Shape",
    "Sphere",
    "default_camera",
    "load_scene",
    "make_material",
    "surface_points",
]

SHAPES = ("sphere", "plane")
MEASURED = (".bsdf", ".brdf", ".xml", ".binary", ".txt", ".dat")
BACKGROUNDS = ("environment", "black")
GBUFFER = ("normal", "view", "tangent", "mask", "encoded", "normalise")


@dataclasses.dataclass(frozen=True)
class EnvironmentSource:
    """Where the light comes from: a built-in name, a file, six files, and how to read it.

    ``source``: a name, a file, a folder of six faces, or a pattern of them (``sky_*.exr``); the
    other fields as for ``read_environment``. A built-in name wins over a file of that
    name: write ``./sky`` for the file.
    """

    source: str = "spots"
    size: int = 256
    layout: str | None = None
    orientation: str | None = None
    negative: str = "clamp"
    nonfinite: str = "error"
    encoding: str | None = None
    crop: str = "error"
    max_pixels: int = 2**28

    def __post_init__(self) -> None:
        _check.count("size", self.size)
        if not is_name(self.source):
            raise _check.fail("source", "must be a name or a path", self.source)

    def load(self) -> "CubeMap":
        """The cube map. Errors of reading are those of ``read_environment``."""
        from .environment import BUILTIN, environment, read_environment
        from .layouts import is_face_set

        if self.source in BUILTIN:
            return environment(self.source, size=self.size)
        if not (os.path.exists(self.source) or is_face_set(self.source)):
            names = ", ".join(BUILTIN)
            rule = f"must be a file, a folder, a pattern of six files or one of {names}"
            raise _check.fail("environment", rule, self.source)
        return read_environment(
            self.source,
            size=self.size,
            layout=self.layout,
            orientation=self.orientation,
            negative=self.negative,
            nonfinite=self.nonfinite,
            encoding=self.encoding,
            crop=self.crop,
            max_pixels=self.max_pixels,
        )


@dataclasses.dataclass(frozen=True)
class Scene:
    """Everything a picture needs. ``gbuffer`` (a file), when given, stands for shape and camera.

    ``options`` go to the method as they are, ``gbuffer_options`` to ``read_gbuffer``; None of
    ``camera`` is ``default_camera``.
    """

    environment: EnvironmentSource = dataclasses.field(default_factory=EnvironmentSource)
    material: str | Mapping[str, Any] = "mx=0.15"
    shape: Shape = dataclasses.field(default_factory=Sphere)
    camera: Camera | None = None
    gbuffer: str | None = None
    background: str = "environment"
    method: str = "regular"
    samples: int = 20
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    gbuffer_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        _check.choice("background", self.background, BACKGROUNDS)
        _check.count("samples", self.samples)

    def view(self) -> Camera | None:
        """The camera, or None for a G-buffer."""
        if self.gbuffer is not None:
            return None
        return self.camera if self.camera is not None else default_camera(self.shape)

    def points(self) -> SurfacePoints:
        """The surface points (H, W) of the picture."""
        camera = self.view()
        if camera is None:
            from .gbuffer import read_gbuffer

            return read_gbuffer(str(self.gbuffer), **self.gbuffer_options)
        return surface_points(camera, self.shape)

    def load_material(self) -> "Material":
        """The material that ``material`` names or describes; measured ones are refused."""
        if self.is_measured:
            rule = "is measured: the ground truth takes it, the methods need lobes fitted to it"
            raise _check.fail("material", rule, self.material)
        return make_material(self.material)

    def load_bsdf(self) -> "Material | MeasuredMaterial":
        """What the ground truth integrates: the material, or a file of measurements as it is."""
        if not self.is_measured:
            return make_material(self.material)
        from .measured.material import measured_material

        return measured_material(str(self.material))

    @property
    def is_measured(self) -> bool:
        """Whether ``material`` is a file of measurements, by its suffix."""
        text = self.material
        return isinstance(text, str) and pathlib.Path(text).suffix.lower() in MEASURED


def make_material(value: str | Mapping[str, Any]) -> "Material":
    """A material from a text (name, file, parameters) or from a table of its numbers."""
    if isinstance(value, str):
        from .materials import parse_material

        return parse_material(value)
    from .materials import material_from_dict

    return material_from_dict(value)


def _known(where: str, table: Mapping[str, Any], names: Iterable[str]) -> None:
    for key in table:
        if key not in names:
            dotted = f"{where}.{key}" if where else key
            raise ValueError(f"{dotted}: unknown key, known are {', '.join(names)}")


def _table(data: Mapping[str, Any], name: str) -> dict[str, Any]:
    value = data.get(name, {})
    if not isinstance(value, dict):
        raise ValueError(f"{name}: must be a table, got {value!r}")
    return dict(value)


def _names(kind: type) -> list[str]:
    return [f.name for f in dataclasses.fields(kind)]


def _parse(data: Mapping[str, Any], folder: pathlib.Path) -> Scene:
    for key in ("planes", "lights", "materials", "bake", "capture"):
        if key in data:
            raise ValueError(f"{key}: is for a scene of objects, which has [[objects]]")
    _known(
        "", data, ("environment", "material", "shape", "camera", "gbuffer", "background", "method")
    )
    env = _table(data, "environment")
    _known("environment", env, _names(EnvironmentSource))
    if isinstance(env.get("source"), str):
        env["source"] = _beside(env["source"], folder)
    shape_table = _table(data, "shape")
    kind = _check.choice("shape.kind", shape_table.pop("kind", "sphere"), SHAPES)
    maker: type[Sphere] | type[Plane] = Sphere if kind == "sphere" else Plane
    _known("shape", shape_table, ["kind", *_names(maker)])
    shape = maker(**shape_table)
    camera_table = _table(data, "camera")
    _known("camera", camera_table, _names(Camera))
    given = dataclasses.asdict(default_camera(shape)) if "position" not in camera_table else {}
    camera: Camera | None
    if set(camera_table) <= {"width", "height"}:
        camera = default_camera(shape, **camera_table)
    else:
        camera = Camera(**{**given, **camera_table})
    method = _table(data, "method")
    material = data.get("material", "mx=0.15")
    if is_name(material):
        material = _beside(material, folder)
    elif isinstance(material, dict):
        make_material(material)
    else:
        raise ValueError(f"material: must be a text or a table, got {material!r}")
    gbuffer, reading = data.get("gbuffer"), {}
    if isinstance(gbuffer, dict):
        _known("gbuffer", gbuffer, ("file", *GBUFFER))
        reading = {key: value for key, value in gbuffer.items() if key != "file"}
        gbuffer = gbuffer.get("file", "")
    if gbuffer is not None:
        if not is_name(gbuffer):
            raise ValueError(f"gbuffer: must be a path, or a table with a file, got {gbuffer!r}")
        if "shape" in data or "camera" in data:
            raise ValueError("gbuffer: stands for shape and camera, which cannot be given too")
        gbuffer = _beside(gbuffer, folder)
    return Scene(
        environment=EnvironmentSource(**env),
        material=material,
        shape=shape,
        camera=camera,
        gbuffer=gbuffer,
        gbuffer_options=reading,
        background=data.get("background", "environment" if gbuffer is None else "black"),
        method=method.pop("name", "regular"),
        samples=method.pop("samples", 20),
        options=method,
    )


def _beside(text: str, folder: pathlib.Path) -> str:
    """A path relative to the scene file if there is one, else the text as it is.

    A pattern with ``*`` is relative to the scene file if it matches files there.
    """
    there = folder / text
    found = os.path.exists(there) or ("*" in there.name and any(there.parent.glob(there.name)))
    return str(there) if found else text


@checked
def load_scene(
    path: str | os.PathLike[str], folder: str | os.PathLike[str] | None = None
) -> "Scene | ObjectScene":
    """Read a scene file; paths in it are relative to it.

    Parameters
    ----------
    path : str or Path
        A file, or a built-in scene: ``room``, ``showroom``, ``hall``. Write ``./room`` for a
        file of that name.
    folder : str or Path, optional
        What paths in the file are relative to; its own folder by default.

    Returns
    -------
    ``ObjectScene`` if the file has ``[[objects]]`` (docs/scenes.md), else ``Scene``.

    Raises
    ------
    OSError
        If the file, or one it names, cannot be read.
    ValueError
        One line naming the file and the dotted key, for bad TOML, an unknown key or a bad value.
    """
    from .scenes.builtin import builtin_scene

    file = builtin_scene(str(path)) or pathlib.Path(path)
    if not os.path.exists(file):
        split = "=" in str(path) or str(path).startswith(",")
        hint = ", or a material that a blank splits: put it in quotes" if split else ""
        raise FileNotFoundError(f"{file}: no such scene file{hint}")
    data = read_toml(file)
    here = file.parent if folder is None else pathlib.Path(folder)
    try:
        if "objects" in data:
            from .scenes.load import parse

            return parse(data, here)
        return _parse(data, here)
    except OSError as error:
        raise type(error)(f"{file}: {_check.shortened(str(error))}") from None
    except (ValueError, TypeError) as error:
        raise ValueError(f"{file}: {_check.shortened(str(error))}") from None
