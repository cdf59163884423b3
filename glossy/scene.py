"""What a picture is of: camera, shape, environment, material, and the scene file.

World coordinates are right-handed with +y up. A pixel (column i, row j, row 0 on top) of a
camera looking along ``f`` with ``r = f x up`` and ``u = r x f`` sees along ::

    d = f + tan(fov/2) ( (2 (i + 1/2) - W)/H r + (1 - 2 (j + 1/2)/H) u )               (1)

so ``fov`` is the vertical field of view and pixels are square. What the ray meets first gives the
shading frame: the outward normal, the tangent (the sphere's field ``cross(+y, n)`` unless a plane
names its own) and ``view = -d / |d|``. Pixels that meet nothing are masked out.

A scene file is TOML; every key is optional ::

    material = "mx=0.2,my=0.075"      # a name, a file, parameters, or a [material] table
    background = "environment"        # or "black"

    [environment]
    source = "spots"                  # a built-in name, a file, or a folder of six files
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
"""

import dataclasses
import math
import os
import pathlib
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _check
from .frames import SurfacePoints, dot, normalise

if TYPE_CHECKING:
    from .brdf import Material
    from .cubemap import CubeMap

Float64Array = npt.NDArray[np.float64]

MAX_PIXELS = 65536
SHAPES = ("sphere", "plane")
BACKGROUNDS = ("environment", "black")
FRAME_TAN = math.tan(math.radians(15.0))  # the unit sphere seen from 4 fills 96 % of this


def _vector(name: str, value: object) -> tuple[float, float, float]:
    v = _check.array(name, value)  # type: ignore[arg-type]
    if v.shape != (3,) or not np.all(np.isfinite(v)):
        raise _check.fail(name, "must be three finite numbers", value)
    return float(v[0]), float(v[1]), float(v[2])


@dataclasses.dataclass(frozen=True)
class Camera:
    """Perspective camera, eq. (1).

    Parameters
    ----------
    position, target : three numbers
        Where the eye is and what is in the middle of the picture.
    up : three numbers
        Not along the line of sight.
    fov : float in (0, 180) [degree]
        Vertical field of view.
    width, height : int >= 1
        Pixels.

    Raises
    ------
    ValueError
        For values out of range, or an ``up`` along the line of sight.
    """

    position: Sequence[float] = (0.0, 0.0, 4.0)
    target: Sequence[float] = (0.0, 0.0, 0.0)
    up: Sequence[float] = (0.0, 1.0, 0.0)
    fov: float = 30.0
    width: int = 256
    height: int = 256

    def __post_init__(self) -> None:
        for name in ("position", "target", "up"):
            object.__setattr__(self, name, _vector(name, getattr(self, name)))
        fov = _check.in_range("fov", self.fov, 0.0, 180.0, open_low=True, open_high=True)
        object.__setattr__(self, "fov", fov)
        for name in ("width", "height"):
            _check.count(name, getattr(self, name), high=MAX_PIXELS)
        self.axes()

    def axes(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Right, up and forward unit vectors, (3,) each."""
        along = np.subtract(self.target, self.position)
        if not along.any():
            raise _check.fail("target", "must differ from position", self.target)
        forward = normalise(along)
        if not np.any(self.up):
            raise _check.fail("up", "must not be zero", self.up)
        right = np.cross(forward, normalise(self.up))
        if np.linalg.norm(right) < 1e-6:
            raise _check.fail("up", "must not lie along the line of sight", self.up)
        right = normalise(right)
        return right, np.cross(right, forward), forward

    def rays(self) -> Float64Array:
        """Unit directions (H, W, 3) through the pixel centres, away from the eye."""
        right, up, forward = self.axes()
        scale = math.tan(math.radians(self.fov) / 2.0)
        x = (2.0 * (np.arange(self.width) + 0.5) - self.width) / self.height * scale
        y = (1.0 - 2.0 * (np.arange(self.height) + 0.5) / self.height) * scale
        d = forward + x[None, :, None] * right + y[:, None, None] * up
        return normalise(d)


@dataclasses.dataclass(frozen=True)
class Sphere:
    """A sphere seen from outside; a camera within it sees nothing."""

    center: Sequence[float] = (0.0, 0.0, 0.0)
    radius: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", _vector("center", self.center))
        object.__setattr__(self, "radius", _check.positive("radius", self.radius))

    def intersect(
        self, origin: Float64Array, rays: Float64Array
    ) -> tuple[Float64Array, npt.NDArray[np.bool_]]:
        """Outward normals (H, W, 3) at the first hit of unit ``rays``, and where there is one."""
        to_eye = (origin - np.asarray(self.center)) / self.radius
        outside = float(to_eye @ to_eye) > 1.0
        b = rays @ to_eye
        # the squared distance of the ray from the centre, without the cancellation of b^2 - c
        off = to_eye - b[..., None] * rays
        under = 1.0 - dot(off, off)
        hit = (under > 0.0) & (b < 0.0) & outside
        distance = -b - np.sqrt(np.maximum(under, 0.0))
        return to_eye + distance[..., None] * rays, hit


@dataclasses.dataclass(frozen=True)
class Plane:
    """An infinite plane, seen from the side its normal points to; above its horizon is nothing.

    ``tangent`` is the direction of ``mx``; by default cross(+y, normal), or +x where that is zero.
    """

    point: Sequence[float] = (0.0, 0.0, 0.0)
    normal: Sequence[float] = (0.0, 1.0, 0.0)
    tangent: Sequence[float] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _vector("point", self.point))
        normal = _vector("normal", self.normal)
        if not any(normal):
            raise _check.fail("normal", "must not be zero", self.normal)
        object.__setattr__(self, "normal", tuple(normalise(normal).tolist()))
        if self.tangent is not None:
            tangent = _vector("tangent", self.tangent)
            if np.linalg.norm(np.cross(tangent, self.normal)) < 1e-3 * np.linalg.norm(tangent):
                raise _check.fail("tangent", "must not lie along the normal", self.tangent)
            object.__setattr__(self, "tangent", tuple(normalise(tangent).tolist()))

    def intersect(
        self, origin: Float64Array, rays: Float64Array
    ) -> tuple[Float64Array, npt.NDArray[np.bool_]]:
        """Normals (H, W, 3), and where ``rays`` meet the plane's front."""
        n = np.asarray(self.normal)
        above = float((origin - np.asarray(self.point)) @ n) > 0.0
        hit = (rays @ n < 0.0) & above
        return np.broadcast_to(n, rays.shape), hit


Shape = Sphere | Plane


def surface_points(camera: Camera, shape: Shape) -> SurfacePoints:
    """What each pixel of ``camera`` sees of ``shape``.

    Returns
    -------
    SurfacePoints of shape (H, W); its mask is False where the shape is not seen.
    """
    rays = camera.rays()
    normal, hit = shape.intersect(np.asarray(camera.position), rays)
    up = np.array([0.0, 0.0, 1.0])
    normal = np.where(hit[..., None], normal, up)
    tangent = shape.tangent if isinstance(shape, Plane) else None
    return SurfacePoints(normalise(normal), tangent, -rays, hit)


def default_camera(shape: Shape, width: int = 256, height: int = 256) -> Camera:
    """A camera that shows ``shape``: a sphere fills 96 % of the shorter side; a plane its horizon."""
    if isinstance(shape, Sphere):
        fit = max(1.0, height / width)
        fov = math.degrees(2.0 * math.atan(FRAME_TAN * fit))
        position = np.add(shape.center, (0.0, 0.0, 4.0 * shape.radius))
        return Camera(tuple(position), shape.center, fov=fov, width=width, height=height)
    from .frames import sphere_tangent

    n = np.asarray(shape.normal)
    side = np.asarray(shape.tangent if shape.tangent is not None else sphere_tangent(n))
    back = np.cross(side, n)
    position = np.asarray(shape.point) + 1.5 * n + 4.0 * back
    target = np.asarray(shape.point) + 0.6 * n
    return Camera(tuple(position), tuple(target), tuple(n), 40.0, width, height)


@dataclasses.dataclass(frozen=True)
class EnvironmentSource:
    """Where the light comes from: a built-in name, a file or a folder, and how to read it.

    A built-in name wins over a file of that name: write ``./sky`` for the file.
    """

    source: str = "spots"
    size: int = 256
    layout: str | None = None
    orientation: str = "glossy"
    negative: str = "clamp"
    nonfinite: str = "error"

    def __post_init__(self) -> None:
        if not isinstance(self.source, str):
            raise _check.fail("source", "must be a name or a path", self.source)
        _check.count("size", self.size)

    def load(self) -> "CubeMap":
        """The cube map. Errors of reading are those of ``read_environment``."""
        from . import environment

        if self.source in environment.BUILTIN:
            return environment.environment(self.source, size=self.size)
        if not os.path.exists(self.source):
            names = ", ".join(environment.BUILTIN)
            rule = f"must be a file, a folder or one of {names}"
            raise _check.fail("environment", rule, self.source)
        return environment.read_environment(
            self.source,
            size=self.size,
            layout=self.layout,
            orientation=self.orientation,
            negative=self.negative,
            nonfinite=self.nonfinite,
        )


@dataclasses.dataclass(frozen=True)
class Scene:
    """Everything a picture needs. ``gbuffer`` (a file), when given, stands for shape and camera.

    ``options`` go to the method as they are; None of ``camera`` is ``default_camera``.
    """

    environment: EnvironmentSource = EnvironmentSource()
    material: str | Mapping[str, Any] = "mx=0.15"
    shape: Shape = Sphere()
    camera: Camera | None = None
    gbuffer: str | None = None
    background: str = "environment"
    method: str = "regular"
    samples: int = 20
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)

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

            return read_gbuffer(str(self.gbuffer))
        return surface_points(camera, self.shape)

    def load_material(self) -> "Material":
        """The material that ``material`` names or describes."""
        return make_material(self.material)


def make_material(value: str | Mapping[str, Any]) -> "Material":
    """A material from a text (name, file, parameters) or from a table of its numbers."""
    if isinstance(value, str):
        from .materials import parse_material

        return parse_material(value)
    from .brdf import Lobe, Material

    _known("material", value, ("kd", "reflection", "transmission"))
    sides: dict[str, list[Lobe]] = {}
    for side in ("reflection", "transmission"):
        rows = value.get(side, [])
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise ValueError(f"material.{side}: must be an array of tables")
        for k, row in enumerate(rows):
            _known(f"material.{side}[{k}]", row, [f.name for f in dataclasses.fields(Lobe)])
        sides[side] = [Lobe(**row) for row in rows]
    return Material(kd=value.get("kd", 0.0), **sides)


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
    if isinstance(material, str):
        material = _beside(material, folder)
    elif isinstance(material, dict):
        make_material(material)
    else:
        raise ValueError(f"material: must be a text or a table, got {material!r}")
    gbuffer = data.get("gbuffer")
    if gbuffer is not None:
        if not isinstance(gbuffer, str):
            raise ValueError(f"gbuffer: must be a path, got {gbuffer!r}")
        if "shape" in data or "camera" in data:
            raise ValueError("gbuffer: stands for shape and camera, which cannot be given too")
        gbuffer = _beside(gbuffer, folder)
    return Scene(
        environment=EnvironmentSource(**env),
        material=material,
        shape=shape,
        camera=camera,
        gbuffer=gbuffer,
        background=data.get("background", "environment" if gbuffer is None else "black"),
        method=method.pop("name", "regular"),
        samples=method.pop("samples", 20),
        options=method,
    )


def _beside(text: str, folder: pathlib.Path) -> str:
    """A path relative to the scene file if there is one, else the text as it is."""
    there = folder / text
    return str(there) if there.exists() else text


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene file; paths in it are relative to it.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        One line naming the file and the dotted key, for bad TOML, an unknown key or a bad value.
    """
    file = pathlib.Path(path)
    with file.open("rb") as stream:
        try:
            return _parse(tomllib.load(stream), file.parent)
        except (ValueError, TypeError) as error:
            raise ValueError(f"{file}: {error}") from None
