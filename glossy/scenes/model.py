"""What a scene of objects consists of, as its file names it (``load``)."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _check, methods
from ..brdf import Material
from ..camera import Camera
from ..frames import normalise
from ..scene import BACKGROUNDS, EnvironmentSource
from .shapes import KINDS, Mesh, Rectangle, Shape, Sphere, Transform, _numbers, kind_of

Float64Array = npt.NDArray[np.float64]

ALBEDO_ANGLES = 8


@dataclasses.dataclass(frozen=True)
class Checker:
    """A second diffuse colour on every other cell of a part's (u, v).

    ``kd`` (RGB or one number) stands for the material's own; ``repeat``: cells along u and v.
    """

    kd: float | Sequence[float] = 0.1
    repeat: Sequence[float] = (8.0, 8.0)

    def __post_init__(self) -> None:
        kd = _check.rgb("kd", self.kd, high=1.0)
        object.__setattr__(self, "kd", tuple(kd.tolist()))
        object.__setattr__(self, "repeat", _numbers("repeat", self.repeat, 2, positive=True))


@dataclasses.dataclass(frozen=True)
class SceneObject:
    """One object.

    Parameters
    ----------
    shape, transform, material
    name : str
        For messages and reports.
    checker : Checker, optional
    light_map : str, optional
        Image of irradiance (linear), instead of baking it. Box: the six faces side by side.
    emission : RGB
        Radiance of the surface's own. Small bright things are better an ``AreaLight``.
    casts_shadow : bool
        False for what lets light through, such as glass: it is then left out of the light's way.
    capture_size : int, optional
        Texels along an edge of its cube map, instead of the scene's.
    method : mapping
        ``name``, ``samples`` and options laid over those of the scene.
    """

    shape: Shape = dataclasses.field(default_factory=Sphere)
    transform: Transform = dataclasses.field(default_factory=Transform)
    material: Material = dataclasses.field(default_factory=lambda: Material(kd=0.5))
    name: str = ""
    checker: Checker | None = None
    light_map: str | None = None
    emission: float | Sequence[float] = 0.0
    casts_shadow: bool = True
    capture_size: int | None = None
    method: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        emission = _check.rgb("emission", self.emission)
        object.__setattr__(self, "emission", tuple(emission.tolist()))
        if not isinstance(self.casts_shadow, bool):
            raise _check.fail("casts_shadow", "must be true or false", self.casts_shadow)
        if self.capture_size is not None:
            _power_of_two("capture_size", self.capture_size)
        if self.checker is not None and isinstance(self.shape, Mesh):
            raise _check.fail("checker", "is not for a mesh, which has no (u, v)", self.shape.file)

    @property
    def translucent(self) -> bool:
        """Whether diffuse light comes through."""
        return bool(self.material.diffuse_below.any())

    @property
    def glossy(self) -> bool:
        """Whether the object has lobes and therefore a cube map of its own."""
        return bool(self.material.lobes)

    def albedo(self) -> Float64Array:
        """(3,) what the object reflects of light from everywhere, kd and lobes, at most 1.

        In the diffuse world that light maps and cube maps show, a metal is a grey of its albedo:
        the mean over cosine-weighted directions of the material's reflectivity.
        """
        if not self.glossy:
            return np.minimum(self.material.diffuse, 1.0)
        sine2 = (np.arange(ALBEDO_ANGLES) + 0.5) / ALBEDO_ANGLES
        wo = np.column_stack([np.sqrt(sine2), np.zeros(ALBEDO_ANGLES), np.sqrt(1.0 - sine2)])
        reflectivity, _ = self.material.albedo(wo)
        rgb = np.broadcast_to(
            np.asarray(reflectivity).reshape(ALBEDO_ANGLES, -1), (ALBEDO_ANGLES, 3)
        )
        return np.asarray(np.minimum(rgb.mean(axis=0), 1.0))


@dataclasses.dataclass(frozen=True)
class AreaLight:
    """A rectangle that sends ``radiance`` from its front, +z before it is turned; black behind."""

    size: Sequence[float] = (1.0, 1.0)
    radiance: float | Sequence[float] = 1.0
    transform: Transform = dataclasses.field(default_factory=Transform)

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", Rectangle(self.size).size)
        rgb = _check.rgb("radiance", self.radiance)
        object.__setattr__(self, "radiance", tuple(rgb.tolist()))

    def corners(self) -> Float64Array:
        """(4, 3) counter-clockwise as seen from the front."""
        matrix = self.transform.matrix(np.array([*self.size, 2.0]) / 2.0)
        unit = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
        return unit @ matrix[:, :3].T + matrix[:, 3]


@dataclasses.dataclass(frozen=True)
class BoundingPlane:
    """A plane that stands for what reflected rays hit; length and sign of the normal are free."""

    point: Sequence[float] = (0.0, 0.0, 0.0)
    normal: Sequence[float] = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _numbers("point", self.point, 3))
        normal = _numbers("normal", self.normal, 3)
        if not any(normal):
            raise _check.fail("normal", "must not be zero", self.normal)
        object.__setattr__(self, "normal", tuple(normalise(normal).tolist()))


@dataclasses.dataclass(frozen=True)
class BakeSettings:
    """How light maps are made: ``texel`` is their spacing in scene units (0: diagonal / 150)."""

    texel: float = 0.0
    samples: int = 256
    bounces: int = 4

    def __post_init__(self) -> None:
        object.__setattr__(self, "texel", _check.in_range("texel", self.texel, 0.0))
        _power_of_two("samples", self.samples, low=16)
        _check.count("bounces", self.bounces, low=0, high=64)


@dataclasses.dataclass(frozen=True)
class CaptureSettings:
    """How cube maps are captured: texels along an edge, and rays a texel along each axis."""

    size: int = 256
    supersampling: int = 2

    def __post_init__(self) -> None:
        _power_of_two("size", self.size)
        _check.count("supersampling", self.supersampling, high=16)


def _power_of_two(name: str, value: int, low: int = 1) -> None:
    _check.count(name, value, low=low, high=4096)
    if value & (value - 1):
        raise _check.fail(name, "must be a power of two", value)


@dataclasses.dataclass(frozen=True)
class ObjectScene:
    """A scene of objects; see ``docs/scenes.md`` for each part.

    ``environment_scale`` multiplies the environment's radiance; without an environment the sky is
    black. ``supersampling``: rays a pixel along each axis.
    """

    objects: tuple[SceneObject, ...]
    camera: Camera
    lights: tuple[AreaLight, ...] = ()
    environment: EnvironmentSource | None = None
    environment_scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    planes: tuple[BoundingPlane, ...] = ()
    background: str = "environment"
    method: str = "regular"
    samples: int = 20
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    bake: BakeSettings = dataclasses.field(default_factory=BakeSettings)
    capture: CaptureSettings = dataclasses.field(default_factory=CaptureSettings)
    supersampling: int = 2

    def __post_init__(self) -> None:
        _check.choice("background", self.background, BACKGROUNDS)
        _check.count("samples", self.samples)
        _check.count("camera.supersampling", self.supersampling, high=16)
        for k, item in enumerate(self.objects):
            name = item.method.get("name", self.method)
            if not item.glossy or name not in methods.VIEWED:
                continue
            if not isinstance(item.shape, Rectangle):
                rule = f"{name!r} is for rectangles"
                raise _check.fail(f"objects[{k}].method.name", rule, KINDS[kind_of(item.shape)])
            if item.material.transmission:
                rule = f"must have no transmission with the method {name!r}"
                raise _check.fail(f"objects[{k}].material", rule, len(item.material.transmission))

    def bounding_planes(self) -> Float64Array:
        """(planes, 2, 3): point and unit normal of each."""
        rows = [(p.point, p.normal) for p in self.planes]
        return np.array(rows, dtype=np.float64).reshape(-1, 2, 3)

    def method_of(self, item: SceneObject) -> tuple[str, dict[str, Any]]:
        """Method and options (``samples`` among them) of one object, the scene's beneath its own.

        Options of the scene's method are left behind when the object names another method.
        """
        own = dict(item.method)
        name = str(own.pop("name", self.method))
        common = dict(self.options) if name == self.method else {}
        given = {"samples": self.samples, **common, **own}
        if "samples" not in methods.options(name):
            del given["samples"]
        return name, given


__all__ = [
    "AreaLight",
    "BakeSettings",
    "BoundingPlane",
    "CaptureSettings",
    "Checker",
    "ObjectScene",
    "SceneObject",
]
