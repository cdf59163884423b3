"""Pictures of a scene of objects: what each pixel sees, and the light it sends.

Rays through a grid of points in every pixel meet the scene. What is not glossy is known at once:
light maps, lights, sky, and the diffuse term of glossy objects (``View.base``). The lobes of each
glossy object are left to a method, or to the ground truth, over its surface points (``View.parts``)
with the object's own cube map; ``View.picture`` puts both together. The real-time picture and its
ground truth thus differ in the integral over the cube map alone, as in the thesis's comparisons.
"""

import dataclasses
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .. import _check, methods
from ..brdf import Material
from ..camera import Camera
from ..frames import SurfacePoints, dot
from .bake import Progress
from .bounds import bounding_planes, check_planes
from .geometry import Hits
from .model import ObjectScene
from .prepared import PreparedScene, prepare
from .shapes import Rectangle

if TYPE_CHECKING:
    from ..reference import Truth

FloatArray = npt.NDArray[np.floating]
Float64Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

BAND = 1 << 20  # rays at a time
GRAZING = 1e-3  # least cosine between an interpolated normal and the view


@dataclasses.dataclass(frozen=True)
class Part:
    """The points of one glossy object in a view.

    ``index`` of the object; ``rays`` (K,) flat indices of the view's rays; ``points`` (K,) with
    their positions; ``material``: its lobes alone, since the diffuse term is in the view's base;
    ``camera``: the view's.
    """

    index: int
    rays: npt.NDArray[np.intp]
    points: SurfacePoints
    material: Material
    camera: Camera


@dataclasses.dataclass(frozen=True)
class View:
    """What a camera sees of a prepared scene, before any lobe is evaluated.

    ``base`` (rays, 3): radiance without the lobes; ``parts``; ``seen`` (H, W): pixels at least half
    of whose rays meet an object; ``glossy`` (H, W): the same for glossy objects; ``shape``: (H, W);
    ``grid``: rays a pixel along each axis.
    """

    base: Float64Array
    parts: tuple[Part, ...]
    seen: BoolArray
    glossy: BoolArray
    shape: tuple[int, int]
    grid: int

    def picture(self, lobes: Sequence[FloatArray]) -> Float64Array:
        """(H, W, 3): the base plus the radiance (K, 3) of each part's lobes, pixels averaged."""
        rays = self.base.copy()
        for part, radiance in zip(self.parts, lobes, strict=True):
            rays[part.rays] += radiance
        return self.averaged(rays)

    def averaged(self, rays: FloatArray) -> Float64Array:
        """Mean over the rays of each pixel: (rays, C) -> (H, W, C)."""
        (h, w), k = self.shape, self.grid
        return np.asarray(rays.reshape(h, k, w, k, -1).mean(axis=(1, 3)), dtype=np.float64)

    def errors(self, errors: Sequence[FloatArray], kind: str) -> Float64Array:
        """(H, W, 3) error of ``picture`` from those of the parts.

        Standard errors of a pixel's rays are independent; bounds add up.
        """
        rays = np.zeros_like(self.base)
        for part, error in zip(self.parts, errors, strict=True):
            rays[part.rays] = error
        if kind == "bound":
            return self.averaged(rays)
        return np.asarray(np.sqrt(self.averaged(np.square(rays))) / self.grid)


def _facing(normal: Float64Array, view: Float64Array) -> Float64Array:
    """Interpolated normals bent until they face the viewer, as the triangle under them does."""
    cosine = dot(normal, view)
    bend = np.maximum(GRAZING - cosine, 0.0)
    out = normal + bend[:, None] * view
    return np.asarray(out / np.linalg.norm(out, axis=-1, keepdims=True))


def _diffuse(
    prepared: PreparedScene, index: int, hits: Hits, points: SurfacePoints
) -> Float64Array:
    """Radiance (K, 3) of a glossy or translucent object without its lobes.

    What comes through is lit by the rectangle's other side, or by the cube map from behind.
    """
    item = prepared.scene.objects[index]
    value = prepared.maps.diffuse(hits)
    glow = np.asarray(item.emission)
    if item.translucent:
        if isinstance(item.shape, Rectangle):
            below = prepared.maps.below(hits)
        else:
            below = prepared.irradiance(index, -points.normal)
        value += item.material.diffuse_below / np.pi * below
    share = item.material.diffuse_share(points.local_view)
    return value if share is None else glow + share * (value - glow)


def view(prepared: PreparedScene, camera: Camera | None = None, grid: int | None = None) -> View:
    """What ``camera`` (the scene's by default) sees, with ``grid`` rays along a pixel's axes."""
    scene = prepared.scene
    camera = camera or scene.camera
    k = scene.supersampling if grid is None else _check.count("supersampling", grid, high=16)
    width, height = camera.width, camera.height
    rays = dataclasses.replace(camera, width=width * k, height=height * k).rays()
    rays = rays.reshape(-1, 3)
    eye = np.asarray(camera.position)
    base = np.zeros((len(rays), 3))
    found = np.full(len(rays), -1, dtype=np.int64)
    pieces: dict[int, list[tuple[npt.NDArray[np.intp], ...]]] = {}
    for start in range(0, len(rays), BAND):
        d = rays[start : start + BAND]
        hits = prepared.geometry.cast(np.broadcast_to(eye, d.shape), _check.frozen(d))
        value = prepared.world.of_hits(hits, d)
        if scene.background == "black":
            value[~hits.found] = 0.0
        for j, item in enumerate(scene.objects):
            on = np.flatnonzero(hits.object == j)
            if not (item.glossy or item.translucent) or not len(on):
                continue
            own = _picked(hits, on)
            normal = _facing(own.normal, -d[on])
            points = SurfacePoints(normal, own.tangent, -d[on], position=own.position)
            value[on] = _diffuse(prepared, j, own, points)
            if item.glossy:
                piece = (on + start, normal, own.tangent, -d[on], own.position)
                pieces.setdefault(j, []).append(piece)  # type: ignore[arg-type]
        base[start : start + BAND] = value
        found[start : start + BAND] = hits.object
    parts = []
    for j, rows in sorted(pieces.items()):
        on, normal, tangent, away, position = (np.concatenate(a) for a in zip(*rows, strict=True))
        points = SurfacePoints(normal, tangent, away, position=position)
        lobes = dataclasses.replace(
            scene.objects[j].material, kd=0.0, diffuse_transmission=0.0, kd_falloff=False
        )
        parts.append(Part(j, on, points, lobes, camera))
    shiny = np.array([o.glossy for o in scene.objects] + [False] * (len(scene.lights) + 1))

    def share(which: BoolArray) -> BoolArray:
        return np.asarray(which.reshape(height, k, width, k).mean(axis=(1, 3)) >= 0.5)

    seen = share((found >= 0) & (found < len(scene.objects)))
    return View(base, tuple(parts), seen, share(shiny[found]), (height, width), k)


def _picked(hits: Hits, index: npt.NDArray[np.intp]) -> Hits:
    return Hits(*(getattr(hits, f.name)[index] for f in dataclasses.fields(Hits)))


@dataclasses.dataclass(frozen=True)
class Shaded:
    """Radiance (K, 3) of a part's lobes, the seconds of each stage, and what the method reports."""

    radiance: FloatArray
    seconds: Mapping[str, float]
    report: Mapping[str, Any]


def _shaded(prepared: PreparedScene, part: Part) -> Shaded:
    from ..render import split_options
    from ..shading import shade

    name, options = prepared.scene.method_of(prepared.scene.objects[part.index])
    if name in methods.VIEWED:
        found: Shaded = methods.viewed(name)(prepared, part, **options)
        return found
    cast = options.pop("shadows", True)
    preparation, own = split_options(name, options)
    lookup = prepared.lookup(part.index, name, **preparation)
    planes = bounding_planes(prepared, part.index)
    shadows = prepared.shadows(part.index, name, preparation, cast)
    start = time.perf_counter()
    made = {}
    if shadows is not None:
        own["visibility"] = shadows.visibility(part.points)
        made["shadow_maps"] = len(shadows)
    radiance = shade(part.points, part.material, lookup, method=name, parallax=planes, **own)
    return Shaded(radiance, {"shade": time.perf_counter() - start}, made)


def shade_part(prepared: PreparedScene, part: Part) -> FloatArray:
    """Radiance (K, 3) of a part's lobes by the method of its object."""
    return _shaded(prepared, part).radiance


@dataclasses.dataclass(frozen=True)
class ObjectRendering:
    """A picture of a scene of objects and how it was made.

    ``image`` (H, W, 3); ``seen`` (H, W): pixels that see an object; ``objects``: for each glossy
    one in view its name, rays, method and options; ``bake_error``: relative RMS standard error of
    the light maps; ``seconds`` and ``cached`` by stage; ``exposure``: of its display picture.
    """

    image: FloatArray
    seen: BoolArray
    covered: int
    supersampling: int
    objects: list[dict[str, Any]]
    bake_error: float
    texels: int
    cached: dict[str, bool]
    seconds: dict[str, float]
    exposure: float

    def to_dict(self) -> dict[str, Any]:
        """Everything but the pixels, fit for JSON."""
        height, width = self.image.shape[:2]
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        for name in ("image", "seen", "error", "exposure"):
            fields.pop(name, None)
        return {"width": width, "height": height, **fields}


@dataclasses.dataclass(frozen=True)
class ObjectTruth(ObjectRendering):
    """The ground truth of the same picture, over the same light maps.

    That is over the same cube maps too, but for planar reflectors, whose rays are cast.
    ``error`` (H, W, 3), "bound" or "standard", is that of the lobes' integrals alone.
    """

    error: FloatArray
    error_kind: str
    estimator: str

    def to_dict(self) -> dict[str, Any]:
        """Everything but the pixels, fit for JSON."""
        rms = float(np.sqrt(np.mean(np.square(self.error))))
        return {**super().to_dict(), "rms_error": rms, "max_error": float(self.error.max())}


def _common(
    prepared: PreparedScene, seen: View, objects: list[dict[str, Any]], start: float
) -> dict[str, Any]:
    seconds = {**prepared.seconds, "total": round(time.perf_counter() - start, 6)}
    return {
        "seen": seen.seen,
        "covered": int(seen.seen.sum()),
        "supersampling": seen.grid,
        "objects": objects,
        "bake_error": prepared.maps.error,
        "texels": len(prepared.maps.values),
        "cached": dict(prepared.cached),
        "seconds": seconds,
        "exposure": view_exposure(prepared, seen),
    }


def view_exposure(prepared: PreparedScene, seen: View) -> float:
    """Stops for every picture of a view (``glossy.exposure``), by at most ``MOST`` of its rays.

    What objects with a buffer of their own reflect is left out.
    """
    from ..exposure import MOST, estimate, stops_to_white

    k = seen.grid
    wide = seen.seen if seen.seen.any() else np.ones_like(seen.seen)
    index = np.flatnonzero(wide.repeat(k, axis=0).repeat(k, axis=1))
    index = index[:: -(-index.size // MOST)]
    radiance = seen.base[index]
    for part in seen.parts:
        if prepared.scene.method_of(prepared.scene.objects[part.index])[0] in methods.VIEWED:
            continue
        of_index = np.minimum(np.searchsorted(part.rays, index), len(part.rays) - 1)
        hit = part.rays[of_index] == index
        on, cube = of_index[hit], prepared.cube_map(part.index)
        points = part.points
        radiance[hit] += estimate(points.normal[on], points.view[on], part.material, cube)
    return stops_to_white(radiance)


def _label(scene: ObjectScene, index: int) -> str:
    return scene.objects[index].name or f"objects[{index}]"


def render_objects(
    scene: ObjectScene | PreparedScene, progress: Progress | None = None, update: bool = False
) -> ObjectRendering:
    """The real-time picture of a scene of objects.

    Parameters
    ----------
    scene : ObjectScene or PreparedScene
        A prepared scene keeps its light maps, cube maps and pyramids between pictures.
    progress, update
        As for ``prepare``.

    Raises
    ------
    ValueError, OSError
        For files and options that cannot be used.
    """
    start = time.perf_counter()
    check_planes(scene.scene if isinstance(scene, PreparedScene) else scene)
    prepared = scene if isinstance(scene, PreparedScene) else prepare(scene, True, update, progress)
    lap = time.perf_counter()
    seen = view(prepared)
    looked = time.perf_counter() - lap
    lobes, objects = [], []
    spent = {"view": looked, "shade": 0.0}
    for part in seen.parts:
        name, options = prepared.scene.method_of(prepared.scene.objects[part.index])
        shaded = _shaded(prepared, part)
        lobes.append(shaded.radiance)
        for stage, seconds in shaded.seconds.items():
            spent[stage] = spent.get(stage, 0.0) + seconds
        row = {"name": _label(prepared.scene, part.index), "rays": len(part.rays), "method": name}
        objects.append({**row, "options": options, **shaded.report})
    image = seen.picture(lobes)
    common = _common(prepared, seen, objects, start)
    common["seconds"] |= {stage: round(seconds, 6) for stage, seconds in spent.items()}
    return ObjectRendering(image=image.astype(np.float32), **common)


def _truth(
    prepared: PreparedScene, part: Part, estimator: str, occlusion: bool, given: Mapping[str, Any]
) -> "Truth":
    """The truth of a part's lobes: rays where the method has them, else over the cube map."""
    from ..reference import reference

    name, _ = prepared.scene.method_of(prepared.scene.objects[part.index])
    if name in methods.VIEWED:
        own = methods.viewed(name, methods.VIEWED_TRUTHS)
        found: Truth = own(prepared, part, estimator=estimator, **given)
        return found
    alone = prepared.self_occluder(part.index) if occlusion else None
    if alone is not None:
        from ..pem.truth import reference_occluded

        cube = prepared.cube_map(part.index)
        return reference_occluded(part.points, part.material, cube, alone, estimator, **given)
    return reference(
        part.points,
        part.material,
        prepared.cube_map(part.index),
        estimator=estimator,
        diffuse=False,
        parallax=bounding_planes(prepared, part.index),
        **given,
    )


def reference_objects(
    scene: ObjectScene | PreparedScene,
    estimator: str | None = None,
    progress: Progress | None = None,
    update: bool = False,
    occlusion: bool = False,
    **options: Any,
) -> ObjectTruth:
    """The ground truth of the same picture: the lobes integrated over the captured cube maps.

    Those of planar reflectors are integrated by casting rays (``planar.reference_planar``).
    ``options`` are those of ``reference``, the others as for ``render_objects``. The estimator is
    "texels" by default; with bounding planes or planar reflectors light depends on the place, and
    "qmc" stands for it. ``occlusion``: objects that are not convex stand in the way of their own
    light, by rays (``pem.reference_occluded``); "qmc" then as well.

    Raises
    ------
    ValueError, OSError
        As ``render_objects``, and ``reference``.
    """
    plan = scene.scene if isinstance(scene, PreparedScene) else scene
    placed = any(o.glossy and plan.method_of(o)[0] in methods.VIEWED for o in plan.objects)
    if occlusion and plan.planes:
        raise _check.fail("occlusion", "must be false in a scene with [[planes]]", occlusion)
    if estimator in (None, "texels"):
        estimator = "qmc" if plan.planes or placed or occlusion else "texels"
    start = time.perf_counter()
    prepared = scene if isinstance(scene, PreparedScene) else prepare(scene, True, update, progress)
    seen = view(prepared)
    given = {k: v for k, v in options.items() if v is not None}
    lobes, errors, objects = [], [], []
    kind = "bound" if estimator == "texels" else "standard"
    for part in seen.parts:
        truth = _truth(prepared, part, estimator, occlusion, given)
        lobes.append(truth.radiance)
        errors.append(truth.error)
        kind = truth.error_kind
        row = {"name": _label(prepared.scene, part.index), "rays": len(part.rays)}
        objects.append({**row, "options": given})
    return ObjectTruth(
        image=seen.picture(lobes),
        error=seen.errors(errors, kind),
        error_kind=kind,
        estimator=estimator,
        **_common(prepared, seen, objects, start),
    )
