"""The scene file of a scene of objects: TOML tables to ``model``, with errors by dotted key."""

import dataclasses
import glob
import os
import pathlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from .. import _check, methods
from .._files import check_regular, is_name
from ..brdf import Material
from ..camera import Camera
from ..scene import EnvironmentSource, make_material
from .model import (
    AreaLight,
    BakeSettings,
    BoundingPlane,
    CaptureSettings,
    Checker,
    ObjectScene,
    SceneObject,
)
from .shapes import KINDS, SHAPES, Mesh, Shape, Transform

T = TypeVar("T")
Table = Mapping[str, Any]

TOP = (
    "camera", "environment", "background", "materials", "objects", "lights", "planes", "method",
    "bake", "capture",
)  # fmt: skip
PLACE = ("position", "scale", "rotation")
OBJECT = (
    "name", "shape", *PLACE, "material", "checker", "light_map", "emission", "casts_shadow",
    "capture_size", "method",
)  # fmt: skip


def _fields(kind: Any) -> list[str]:
    return [f.name for f in dataclasses.fields(kind)]


def _dotted(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def _known(where: str, table: Table, names: Any) -> None:
    for key in table:
        if key not in names:
            raise ValueError(f"{_dotted(where, key)}: unknown key, known are {', '.join(names)}")


def _table(where: str, value: object) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise _check.fail(where, "must be a table", value)
    return dict(value)


def _tables(where: str, value: object) -> list[tuple[str, dict[str, Any]]]:
    """The tables of a list, each with its dotted name."""
    if not isinstance(value, list):
        raise _check.fail(where, f"must be a list of tables ([[{where}]])", value)
    return [(f"{where}[{k}]", _table(f"{where}[{k}]", item)) for k, item in enumerate(value)]


def _inside(where: str, make: Callable[[], T]) -> T:
    """What ``make`` gives, its errors named by where in the file they are."""
    try:
        return make()
    except (OSError, ValueError) as error:
        kind = type(error) if isinstance(error, OSError) else ValueError
        raise kind(_dotted(where, str(error))) from None


def _build(where: str, kind: Callable[..., T], table: Table) -> T:
    _known(where, table, _fields(kind))
    return _inside(where, lambda: kind(**table))


def _file(where: str, value: object, folder: pathlib.Path) -> str:
    if not is_name(value):
        raise _check.fail(where, "must be a path", value)
    path = str(folder / value)
    try:
        check_regular(path)
    except FileNotFoundError:
        raise FileNotFoundError(f"{where}: no such file {path!r}") from None
    except OSError as error:
        raise type(error)(f"{where}: {error}") from None
    return path


def _shape(where: str, value: object, folder: pathlib.Path) -> Shape:
    table = _table(where, value)
    kind = SHAPES[_check.choice(f"{where}.kind", table.pop("kind", "sphere"), KINDS)]
    _known(where, table, ["kind", *_fields(kind)])
    if kind is Mesh:
        table["file"] = _file(f"{where}.file", table.get("file"), folder)
    return _inside(where, lambda: kind(**table))


def _material(where: str, value: object, named: Table, folder: pathlib.Path) -> Material:
    if isinstance(value, str) and value in named:
        value = named[value]
        assert isinstance(value, Material)
        return value
    if isinstance(value, dict):
        from ..materials import material_from_dict

        return material_from_dict(value, where)
    if not isinstance(value, str):
        raise _check.fail(where, "must be a text or a table", value)
    is_file = value.lower().endswith((".toml", ".json")) or os.path.isfile(folder / value)
    text = _file(where, value, folder) if is_file else value
    try:
        return make_material(text)
    except ValueError as error:
        own = f"not one of the scene's own ({', '.join(named)}); " if named else ""
        which = "" if "=" in value else f"no material {value!r}; "
        raise ValueError(f"{where}: {which}{own}{error}") from None


def _method(where: str, table: Table, default: str) -> None:
    """Check a method's name and options."""
    name = table.get("name", default)

    def check() -> None:
        _check.choice("name", name, (*methods.METHODS, *methods.VIEWED))
        kept = ("name", "samples", "precision", *methods.preparation_options(name))
        own = {k: v for k, v in table.items() if k not in kept}
        if "shadows" in own:
            methods.check_shadows(name, own.pop("shadows"))
        methods.check_options(name, own)
        if "samples" in table:
            _check.count("samples", table["samples"])

    _inside(where, check)


def _object(where: str, table: dict[str, Any], named: Table, folder: pathlib.Path) -> SceneObject:
    _known(where, table, OBJECT)
    if "shape" not in table:
        raise ValueError(f"{where}.shape: is required")
    given: dict[str, Any] = {
        k: table[k] for k in ("emission", "casts_shadow", "capture_size") if k in table
    }
    given["shape"] = _shape(f"{where}.shape", table["shape"], folder)
    place = {k: table[k] for k in PLACE if k in table}
    given["transform"] = _inside(where, lambda: Transform(**place))
    if "material" in table:
        given["material"] = _material(f"{where}.material", table["material"], named, folder)
    if "checker" in table:
        checker = _table(f"{where}.checker", table["checker"])
        given["checker"] = _build(f"{where}.checker", Checker, checker)
    if "light_map" in table:
        given["light_map"] = _file(f"{where}.light_map", table["light_map"], folder)
    name = table.get("name", "")
    if not isinstance(name, str):
        raise _check.fail(f"{where}.name", "must be a text", name)
    given["method"] = _table(f"{where}.method", table.get("method", {}))
    return _inside(where, lambda: SceneObject(name=name, **given))


def _environment(
    value: object, folder: pathlib.Path
) -> tuple[EnvironmentSource, tuple[float, ...]]:
    table = _table("environment", value)
    scale = _check.rgb("environment.scale", table.pop("scale", 1.0))
    source = table.get("source")
    if isinstance(source, str) and ("*" in source or (folder / source).exists()):
        table["source"] = str(folder / source)
    _known("environment", table, [*_fields(EnvironmentSource), "scale"])
    found = _inside("environment", lambda: EnvironmentSource(**table))
    from ..environment import BUILTIN

    there = glob.glob(found.source) if "*" in found.source else os.path.exists(found.source)
    if found.source not in BUILTIN and not there:
        rule = f"no such file, and no built-in map ({', '.join(BUILTIN)})"
        raise FileNotFoundError(f"environment.source: {rule}: {found.source!r}")
    return found, tuple(scale.tolist())


def parse(data: Table, folder: pathlib.Path) -> ObjectScene:
    """The scene of a parsed file whose paths are relative to ``folder``.

    Raises
    ------
    ValueError, FileNotFoundError
        One line that names the dotted key.
    """
    _known("", data, TOP)
    camera = _table("camera", data.get("camera", {}))
    supersampling = camera.pop("supersampling", 2)
    _known("camera", camera, [*_fields(Camera), "supersampling"])
    named: dict[str, Material] = {}
    for name, value in _table("materials", data.get("materials", {})).items():
        named[name] = _material(f"materials.{name}", value, {}, folder)
    objects = [
        _object(where, table, named, folder) for where, table in _tables("objects", data["objects"])
    ]
    lights = []
    for where, table in _tables("lights", data.get("lights", [])):
        _known(where, table, ("size", "radiance", *PLACE))
        place = {k: table.pop(k) for k in PLACE if k in table}
        transform = _inside(where, lambda place=place: Transform(**place))  # type: ignore[misc]
        lights.append(_build(where, AreaLight, {**table, "transform": transform}))
    planes = [_build(w, BoundingPlane, t) for w, t in _tables("planes", data.get("planes", []))]
    environment, scale = None, (1.0, 1.0, 1.0)
    if "environment" in data:
        environment, scale = _environment(data["environment"], folder)  # type: ignore[assignment]
    method = _table("method", data.get("method", {}))
    _method("method", method, "regular")
    name = method.pop("name", "regular")
    for k, item in enumerate(objects):
        _method(f"objects[{k}].method", item.method, name)
    return _inside(
        "",
        lambda: ObjectScene(
            objects=tuple(objects),
            camera=_inside("camera", lambda: Camera(**camera)),
            lights=tuple(lights),
            environment=environment,
            environment_scale=scale,
            planes=tuple(planes),
            background=data.get("background", "environment"),
            method=name,
            samples=method.pop("samples", 20),
            options=method,
            bake=_build("bake", BakeSettings, _table("bake", data.get("bake", {}))),
            capture=_build("capture", CaptureSettings, _table("capture", data.get("capture", {}))),
            supersampling=supersampling,
        ),
    )


def overlay(scene: ObjectScene, given: Table, method_options: Sequence[str]) -> ObjectScene:
    """``scene`` with the command line's arguments laid over it.

    A method named there stands for those of all objects, which keep their samples; samples and
    options named there stand for every object's own.

    Raises
    ------
    ValueError
        For an argument that a scene of objects has no use for, or a value out of range.
    """
    for name in ("material", "gbuffer", "shape"):
        if name in given:
            raise ValueError(f"--{name}: has no meaning for a scene of objects")
    picture = {k: given[k] for k in ("width", "height") if k in given}
    change: dict[str, Any] = {"camera": dataclasses.replace(scene.camera, **picture)}
    for name in ("background", "samples", "supersampling"):
        if name in given:
            change[name] = given[name]
    keys = {"env": "source", "size": "size", "input_layout": "layout", "orientation": "orientation",
            "negative": "negative", "nonfinite": "nonfinite", "crop": "crop",
            "max_pixels": "max_pixels"}  # fmt: skip
    env = {field: given[name] for name, field in keys.items() if name in given}
    if env:
        change["environment"] = dataclasses.replace(scene.environment or EnvironmentSource(), **env)
    options = {k: given[k] for k in (*method_options, "samples") if k in given}
    known = (*methods.METHODS, *methods.VIEWED)
    method = _check.choice("--method", given.get("method", scene.method), known)
    kept = scene.options if method == scene.method else {}
    change |= {"method": method, "options": {**kept, **options}}
    change["options"].pop("samples", None)
    objects = []
    for item in scene.objects:
        own = dict(item.method)
        if "method" in given:
            own = {k: v for k, v in own.items() if k == "samples"}
        objects.append(dataclasses.replace(item, method={**own, **options}))
        _method("--method", objects[-1].method, method)
    _method("--method", change["options"], method)
    return dataclasses.replace(scene, objects=tuple(objects), **change)
