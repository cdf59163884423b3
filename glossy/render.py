"""From a scene to a picture: environment, surface points, method, diffuse term, background.

Nothing is computed here: each step is a call of the module that does it, and only what the scene
needs is called (no irradiance without kd, no rays without a visible environment).
"""

import dataclasses
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _check
from ._arguments import checked
from .scene import Scene

if TYPE_CHECKING:
    from .brdf import Material
    from .cubemap import CubeMap
    from .frames import SurfacePoints
    from .trace import Trace

FloatArray = npt.NDArray[np.floating]


@dataclasses.dataclass(frozen=True)
class Rendering:
    """A picture and how it was made.

    ``image`` (H, W, 3); ``seen`` (H, W): pixels that see the surface, ``covered`` their number;
    ``samples``: taps of each lobe; ``seconds``: what each stage took, compilation included;
    ``cube``: the environment as it was read.
    """

    image: FloatArray
    seen: npt.NDArray[np.bool_]
    covered: int
    environment: str
    size: int
    method: str
    samples: list[int]
    options: dict[str, Any]
    seconds: dict[str, float]
    cube: "CubeMap"

    def to_dict(self) -> dict[str, Any]:
        """Everything but the pixels, fit for JSON."""
        height, width = self.image.shape[:2]
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        del fields["image"], fields["seen"], fields["cube"]
        return {"width": width, "height": height, **fields}


@dataclasses.dataclass(frozen=True)
class TruthRendering:
    """The ground truth of a picture: ``image`` and ``error`` (H, W, 3), by `error_kind`."""

    image: FloatArray
    error: FloatArray
    error_kind: str
    seen: npt.NDArray[np.bool_]
    covered: int
    environment: str
    size: int
    estimator: str
    options: dict[str, Any]
    seconds: dict[str, float]
    radiance_rms: float
    cube: "CubeMap"

    @property
    def rms_error(self) -> float:
        """Root mean square of the error estimates over the covered pixels and channels."""
        return float(np.sqrt(np.sum(np.square(self.error)) / max(3 * self.covered, 1)))

    def to_dict(self) -> dict[str, Any]:
        """Everything but the pixels, fit for JSON."""
        height, width = self.image.shape[:2]
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        del fields["image"], fields["error"], fields["seen"], fields["cube"]
        relative = self.rms_error / self.radiance_rms if self.radiance_rms > 0.0 else 0.0
        errors = {
            "rms_error": self.rms_error,
            "relative_rms_error": relative,
            "max_error": float(np.max(self.error, initial=0.0)),
        }
        return {"width": width, "height": height, **fields, **errors}


class Clock:
    """Seconds since the last look, by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Book the time since the last lap on ``stage``."""
        now = time.perf_counter()
        self.seconds[stage] = round(now - self._last, 6)
        self._last = now


def split_options(method: str, options: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """(options of the method's preparation, options of the method)."""
    from . import methods

    names = methods.preparation_options(method)
    own = {k: v for k, v in options.items() if k not in names}
    return {k: v for k, v in options.items() if k in names}, own


def actual_samples(material: "Material", method: str, samples: int, threshold: float) -> list[int]:
    """Taps of each lobe: for regular patterns the count nearest to the budget."""
    from . import methods
    from .pattern import pattern_for_budget

    lobes = [lobe for lobe, _ in material.sided_lobes()]
    if method != "regular":
        return [methods.tap_count(method, lobe, samples) for lobe in lobes]
    return [len(pattern_for_budget(lobe, samples, threshold)) for lobe in lobes]


def diffuse_irradiance(
    material: "Material", cube: "CubeMap", points: "SurfacePoints"
) -> dict[str, Any]:
    """``irradiance`` and ``irradiance_below`` (..., 3) for ``shade``, those the material needs.

    Interpolated in ``irradiance_map``, whose error is stated there.
    """
    sides = []
    if material.diffuse.any():
        sides.append(("irradiance", 1.0))
    if material.diffuse_below.any():
        sides.append(("irradiance_below", -1.0))
    if not sides:
        return {}
    from .irradiance import irradiance_map

    table = irradiance_map(cube)
    return {name: table.lookup(side * points.normal) for name, side in sides}


def auto_exposure(image: FloatArray, seen: Any) -> float:
    """Stops that bring the brightest hundredth of the surface's pixels to white, in halves."""
    from .exposure import stops_to_white

    return stops_to_white(image[seen] if np.any(seen) else image.reshape(-1, 3))


def write_picture(
    path: str,
    image: FloatArray,
    seen: Any,
    exposure: float | None = None,
    metadata: Mapping[str, str] | None = None,
) -> float | None:
    """Write an image; a PNG is exposed by ``exposure`` stops, or ``auto_exposure`` if None.

    Its header says so (``exposure.KEY``). ``metadata``: attributes of an EXR's header.
    Returns the stops used, None for the linear formats, which are never exposed.

    Raises
    ------
    ValueError
        For an exposure given to a linear format.
    """
    from .exposure import KEY
    from .image_write import write_image

    if not path.lower().endswith(".png"):
        if exposure is not None:
            raise _check.fail("exposure", "is for PNG; EXR and HDR hold linear radiance", exposure)
        write_image(path, image, metadata=metadata if path.lower().endswith(".exr") else None)
        return None
    stops = auto_exposure(image, seen) if exposure is None else exposure
    write_image(path, image, exposure=stops, metadata={KEY: repr(stops)})
    return stops


def with_background(scene: Scene, cube: "CubeMap", image: FloatArray, seen: Any) -> FloatArray:
    """``image`` with the environment, level 0, where nothing is seen."""
    camera = scene.view()
    if camera is None or scene.background == "black" or seen.all():
        return image
    image[~seen] = cube.lookup(camera.rays()[~seen])
    return image


def finer(scene: Scene, supersampling: int) -> Scene:
    """The scene with a camera of ``supersampling`` times the pixels along each axis.

    Raises
    ------
    ValueError
        For a count that is not from 1 to 16, or above 1 with a G-buffer.
    """
    k = _check.count("supersampling", supersampling, high=16)
    camera = scene.view()
    if k == 1:
        return scene
    if camera is None:
        raise _check.fail("supersampling", "must be 1 with a G-buffer, which has its points", k)
    large = dataclasses.replace(camera, width=k * camera.width, height=k * camera.height)
    return dataclasses.replace(scene, camera=large)


def averaged(rays: npt.NDArray[Any], k: int) -> npt.NDArray[Any]:
    """Mean over the k x k rays of a pixel: (k H, k W, ...) -> (H, W, ...); as it is for k = 1."""
    if k == 1:
        return rays
    height, width = rays.shape[0] // k, rays.shape[1] // k
    blocks = rays.reshape(height, k, width, k, *rays.shape[2:])
    kind = rays.dtype if rays.dtype.kind == "f" else np.float64
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float64), dtype=kind)


def averaged_error(rays: npt.NDArray[Any], k: int, kind: str) -> npt.NDArray[Any]:
    """Error of ``averaged``: standard errors of rays are independent, other errors add up."""
    if kind == "standard" and k > 1:
        return np.asarray(np.sqrt(averaged(np.square(rays), k)) / k)
    return averaged(rays, k)


@checked
def render_scene(scene: Scene, supersampling: int = 1) -> Rendering:
    """Render a scene with its real-time method, ``supersampling`` rays along a pixel's axes.

    Raises
    ------
    ValueError
        For a value out of range or an option foreign to the method.
    OSError
        If a file cannot be read.
    """
    from . import methods
    from .shading import shade

    clock = Clock()
    preparation, options = split_options(scene.method, scene.options)
    methods.check_options(scene.method, {k: v for k, v in options.items() if k != "precision"})
    scene = finer(scene, supersampling)
    material, points = scene.load_material(), scene.points()
    known = methods.options(scene.method)
    clock.lap("scene")
    cube = scene.environment.load()
    clock.lap("environment")
    prepared = methods.prepare(scene.method, cube, material, **preparation)
    clock.lap("prepare")
    counted: dict[str, Any] = {"samples": scene.samples} if "samples" in known else {}
    image = shade(
        points,
        material,
        prepared,
        method=scene.method,
        **diffuse_irradiance(material, cube, points),
        **counted,
        **options,
    )
    clock.lap("shade")
    if scene.method in methods.PLANNED:
        shaded = {**options, "points": points}
        taps = methods.planned_counts(scene.method, material, prepared, shaded)
    else:
        threshold = options.get("threshold", known.get("threshold", 0.1))
        taps = actual_samples(material, scene.method, scene.samples, threshold)
    seen = averaged(points.coverage, supersampling) >= 0.5
    return Rendering(
        image=averaged(with_background(scene, cube, image, points.coverage), supersampling),
        seen=seen,
        covered=int(seen.sum()),
        environment=scene.environment.source,
        size=cube.size,
        method=scene.method,
        samples=taps,
        options={**preparation, **options},
        seconds=clock.seconds,
        cube=cube,
    )


@checked
def render_reference(
    scene: Scene, estimator: str | None = None, supersampling: int = 1, **options: Any
) -> TruthRendering:
    """The ground truth of a scene; ``options`` are those of ``reference``.

    ``estimator`` is ``texels`` by default, and ``qmc`` for a file of measurements, for which
    ``texels`` is slow.

    Raises
    ------
    ValueError, OSError
        As ``render_scene``.
    """
    from .reference import reference

    clock = Clock()
    scene = finer(scene, supersampling)
    material, points = scene.load_bsdf(), scene.points()
    estimator = estimator or ("qmc" if scene.is_measured else "texels")
    clock.lap("scene")
    cube = scene.environment.load()
    clock.lap("environment")
    given = {k: v for k, v in options.items() if v is not None}
    truth = reference(points, material, cube, estimator=estimator, **given)
    clock.lap("integrate")
    hit = points.coverage
    seen = averaged(hit, supersampling) >= 0.5
    radiance = np.array(truth.radiance)
    surface = averaged(np.where(hit[..., None], radiance, 0.0), supersampling)[seen]
    level = float(np.sqrt(np.mean(np.square(surface)))) if seen.any() else 0.0
    error = np.where(hit[..., None], truth.error, 0.0)
    return TruthRendering(
        image=averaged(with_background(scene, cube, radiance, hit), supersampling),
        error=averaged_error(error, supersampling, truth.error_kind),
        error_kind=truth.error_kind,
        seen=seen,
        covered=int(seen.sum()),
        environment=scene.environment.source,
        size=cube.size,
        estimator=estimator,
        options=given,
        seconds=clock.seconds,
        radiance_rms=level,
        cube=cube,
    )


@dataclasses.dataclass(frozen=True)
class PixelTrace:
    """The taps of one pixel; ``difference``: of their sum and the pixel as it is rendered."""

    pixel: tuple[int, int]
    trace: "Trace"

    @property
    def difference(self) -> float:
        """Largest difference over the channels."""
        return float(np.max(np.abs(np.subtract(self.trace.tap_sum, self.trace.radiance))))

    def to_dict(self) -> dict[str, Any]:
        """Everything, fit for JSON."""
        return {"pixel": list(self.pixel), "difference": self.difference, **self.trace.to_dict()}

    def format(self) -> str:
        """A table for people: frame, taps, sum."""
        rows = [f"pixel {self.pixel[0]}, {self.pixel[1]}"]
        for name in ("normal", "tangent", "bitangent", "view", "view_local"):
            vector = " ".join(f"{v:+.7f}" for v in getattr(self.trace, name))
            rows.append(f"{name.replace('_', ' '):<11} {vector}")
        rows.append(self.trace.format_table())
        rows.append(f"difference of sum and pixel {self.difference:.3g}")
        return "\n".join(rows)


@checked
def trace_pixel(scene: Scene, x: int, y: int) -> PixelTrace:
    """Every tap of the pixel in column ``x`` and row ``y``.

    Raises
    ------
    ValueError
        If the pixel is outside the picture or sees no surface.
    """
    from . import methods
    from .pyramid import build_pyramid
    from .trace import trace

    preparation, options = split_options(scene.method, scene.options)
    material, points = scene.load_material(), scene.points()
    height, width = points.shape
    if not (0 <= x < width and 0 <= y < height):
        raise _check.fail("pixel", f"must be inside {width} x {height}", (x, y))
    if not points.coverage[y, x]:
        raise _check.fail("pixel", "must see the surface", (x, y))
    if scene.method in methods.PREPARE:  # looks up no pyramid; trace will say so
        preparation = {}
    pyramid = build_pyramid(scene.environment.load(), **preparation)
    if "samples" in methods.options(scene.method):
        options = {"samples": scene.samples, **options}
    if scene.method in methods.PLANNED:  # by the plan of the whole picture
        from .planning.auto import planned

        own = {k: v for k, v in options.items() if k != "precision"}
        options = {**options, "plan": planned(material, pyramid, points=points, **own)}
    traced = trace(points[y, x], material, pyramid, method=scene.method, **options)
    return PixelTrace((x, y), traced)
