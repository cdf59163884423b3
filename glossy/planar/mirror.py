"""The mirror pass: a scene seen from behind a plane reflector, into a buffer.

The camera is mirrored at the plane through q with unit normal n, eye and axes alike, so a pixel of
the buffer is the pixel of the picture at the same place: no axis is flipped::

    x' = x - 2 ((x - q).n) n,   v' = v - 2 (v.n) n                                        (1)
    (X, Y, Z) = M (x - C'),   pixel = (X / Z, Y / Z),   pixel (i, j) spans [i, i+1) x [j, j+1)  (2)

M's rows are Fx r' + cx f', cy f' - Fy u', f', with F the distance of the image plane in pixels and
c the middle of the buffer. Rays start where they cross the plane, so that all behind it is clipped,
and the reflector itself is not there. What a pixel sees is its radiance, its place and its normal.
The pixels beside a floor's end see past the wall that ends it, from outside the room. They would
shine through its edge, so they weigh ``DOUBT`` in every mean: pixels that see the sky from a place
of the plane that is beyond the reflector and hidden from the real camera.

Pixels that see the sky have no place: they stand for a plane at infinity, which any ray meets along
its own direction. Pixels whose ray never reaches the plane (beyond its horizon) hold nothing.

A ray that starts inside a closed body standing on the plane sees the body's far side from within;
the picture shows that body's front there, and the mapping a guess of what it hides.

Source: thesis section 4.5.1, after Diefenbach and Badler 1997. Departure: the thesis flips the
vertical axis, for its camera keeps its handedness.
"""

import dataclasses
import functools
import math

import numpy as np
import numpy.typing as npt

from .. import _check
from ..camera import MAX_PIXELS, Camera
from ..frames import dot, normalise
from ..scenes.capture import Radiance
from ..scenes.geometry import Geometry
from ..scenes.shapes import RECTANGLE
from .levels import Levels, build_levels

Float64Array = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]

BAND = 1 << 20  # rays at a time
HORIZON = 1e-9  # least cosine between a ray and the plane's normal
DOUBT = 1e-3


@dataclasses.dataclass(frozen=True, eq=False)
class MirrorCamera:
    """A camera mirrored at a plane, eqs. (1) and (2); made by ``mirror_camera``.

    ``position`` (3,): C'; ``matrix`` (3, 3): M; ``point``, ``normal`` (3,): the plane, the normal
    towards the real camera; ``width``, ``height``: pixels of the buffer, margin included.
    """

    position: Float64Array
    matrix: Float64Array
    point: Float64Array
    normal: Float64Array
    width: int
    height: int

    def rays(self) -> Float64Array:
        """Unit directions (H, W, 3) through the pixels' centres, away from C'."""
        x, y = np.arange(self.width) + 0.5, np.arange(self.height) + 0.5
        pixels = np.stack([*np.meshgrid(x, y), np.ones((self.height, self.width))], axis=-1)
        return normalise(pixels @ np.linalg.inv(self.matrix).T)

    def project(self, positions: npt.ArrayLike) -> Float64Array:
        """Pixels (..., 2) of places (..., 3), eq. (2); NaN for what is not in front of C'."""
        x = _check.array("positions", positions)
        if x.ndim == 0 or x.shape[-1] != 3:
            raise _check.fail("positions", "must have shape (..., 3)", x.shape)
        v = (x - self.position) @ self.matrix.T
        depth = np.where(v[..., 2:] > 0.0, v[..., 2:], np.nan)
        return np.asarray(v[..., :2] / depth)

    @property
    def density(self) -> float:
        """Pixels per steradian in the middle of the picture, Fx Fy."""
        return float(abs(np.linalg.det(self.matrix)))


def mirror_camera(
    camera: Camera,
    point: npt.ArrayLike,
    normal: npt.ArrayLike,
    scale: float = 1.0,
    margin: float = 0.0,
) -> MirrorCamera:
    """Mirror a camera at a plane.

    Parameters
    ----------
    camera : Camera
    point, normal : (3,) arrays
        The plane; length and sign of the normal are free.
    scale : float > 0
        Pixels of the buffer along each axis of a pixel of the picture; 0.5 is half the resolution.
    margin : float >= 0
        What the buffer shows beyond the picture, on every side, in picture heights.

    Raises
    ------
    ValueError
        For a camera in the plane, or a value out of range.
    """
    q = _check.array("point", point).astype(np.float64)
    n = _check.vectors("normal", normal).astype(np.float64)
    for name, v in (("point", q), ("normal", n)):
        if v.shape != (3,) or not np.all(np.isfinite(v)):
            raise _check.fail(name, "must be three finite numbers", v.tolist())
    n = normalise(n)
    factor = _check.in_range("scale", scale, 0.0, 16.0, open_low=True)
    _check.in_range("margin", margin, 0.0, 4.0)
    eye = np.asarray(camera.position, dtype=np.float64)
    height = float((eye - q) @ n)
    if height == 0.0:
        raise _check.fail("camera.position", "must not lie in the reflector's plane", eye.tolist())
    n = n if height > 0.0 else -n
    axes = np.array(camera.axes())
    right, up, forward = axes - 2.0 * (axes @ n)[:, None] * n
    wide, high = (max(1, round(p * factor)) for p in (camera.width, camera.height))
    extra = math.ceil(margin * high)
    size = (wide + 2 * extra, high + 2 * extra)
    if max(size) > MAX_PIXELS:
        raise _check.fail("scale, margin", f"must give at most {MAX_PIXELS} pixels a side", size)
    away = 0.5 / math.tan(math.radians(camera.fov) / 2.0)  # image plane, in picture heights
    fx, fy = away * wide / camera.width * camera.height, away * high
    matrix = np.stack(
        [fx * right + 0.5 * size[0] * forward, 0.5 * size[1] * forward - fy * up, forward]
    )
    position = eye - 2.0 * abs(height) * n
    return MirrorCamera(position, matrix, q, n, *size)


@dataclasses.dataclass(frozen=True, eq=False)
class MirrorBuffer:
    """What the mirror pass stores; made by ``render_mirror``, or by hand.

    Attributes
    ----------
    camera : MirrorCamera
    radiance : (H, W, 3) float32
    position, normal : (H, W, 3) float64
        World; 0 where nothing is hit.
    hit : (H, W) bool
        False where the sky is seen.
    covered : (H, W) bool
        False where the ray never reaches the plane; such pixels count nowhere.
    doubtful : (H, W) bool, optional
        True where the sky is seen from beyond the reflector and out of the real camera's sight;
        such pixels weigh ``DOUBT``.

    Raises
    ------
    ValueError
        For a wrong shape, or radiance that is negative or not finite.
    """

    camera: MirrorCamera
    radiance: Float32Array
    position: Float64Array
    normal: Float64Array
    hit: BoolArray
    covered: BoolArray
    doubtful: BoolArray | None = None

    def __post_init__(self) -> None:
        shape = (self.camera.height, self.camera.width)
        for name in ("radiance", "position", "normal"):
            if getattr(self, name).shape != (*shape, 3):
                raise _check.fail(name, f"must have shape {(*shape, 3)}", getattr(self, name).shape)
        for name in ("hit", "covered", "doubtful"):
            if getattr(self, name) is not None and getattr(self, name).shape != shape:
                raise _check.fail(name, f"must have shape {shape}", getattr(self, name).shape)
        radiance = _check.radiance("radiance", np.asarray(self.radiance, dtype=np.float32))
        object.__setattr__(self, "radiance", radiance)

    @functools.cached_property
    def planes(self) -> Float64Array:
        """Tangent planes (H, W, 4): the normal N, and N.(x - C'); zero where nothing is hit."""
        out = np.zeros((*self.hit.shape, 4))
        out[..., :3] = self.normal
        out[..., 3] = dot(self.normal, self.position - self.camera.position)
        out[~self.hit] = 0.0
        return np.asarray(_check.frozen(out))

    @functools.cached_property
    def _pyramids(self) -> dict[str, Levels]:
        return {}

    def pyramid(self, filter: str = "box") -> Levels:
        """The buffer's own pyramid (see ``build_levels``), made on first use."""
        if filter not in self._pyramids:
            weights = self.covered.astype(np.float32)
            if self.doubtful is not None:
                weights[self.doubtful] *= DOUBT
            self._pyramids[filter] = build_levels(self.radiance, weights, filter)
        return self._pyramids[filter]


def reflector_plane(geometry: Geometry, index: int) -> tuple[Float64Array, Float64Array]:
    """Point and unit normal of a rectangle of the scene.

    Raises
    ------
    ValueError
        If the object is no rectangle.
    """
    if int(geometry.kinds[index]) != RECTANGLE:
        raise _check.fail("object", "must be a rectangle to be a planar reflector", index)
    matrix = geometry.forwards[index]
    return matrix[:, 3].copy(), normalise(np.cross(matrix[:, 0], matrix[:, 1]))


def _doubtful(
    geometry: Geometry, index: int, camera: MirrorCamera, places: Float64Array
) -> BoolArray:
    """Places (K, 3) of the plane beyond the reflector that the real camera cannot see."""
    eye = camera.position - 2.0 * ((camera.position - camera.point) @ camera.normal) * camera.normal
    local = places @ geometry.inverses[index][:, :3].T + geometry.inverses[index][:, 3]
    out = np.any(np.abs(local[:, :2]) > 1.0, axis=-1)
    away = places[out] - eye
    far = np.linalg.norm(away, axis=-1)
    out[out] = geometry.occluded(eye, away, far=far * (1.0 - 1e-6), skip=index)
    return np.asarray(out)


def render_mirror(world: Radiance, index: int, camera: MirrorCamera) -> MirrorBuffer:
    """The mirror pass: the diffuse world that ``camera`` sees through the plane.

    Parameters
    ----------
    world : Radiance
        ``PreparedScene.world``: light maps, lights and sky.
    index : int
        The reflector, which is left out; -1 leaves out nothing.
    camera : MirrorCamera
    """
    d = camera.rays().reshape(-1, 3)
    cosine = d @ camera.normal
    covered = cosine > HORIZON
    away = float((camera.point - camera.position) @ camera.normal) / np.where(covered, cosine, 1.0)
    radiance = np.zeros((len(d), 3), dtype=np.float32)
    position, normal = np.zeros((len(d), 3)), np.zeros((len(d), 3))
    hit, doubtful = np.zeros(len(d), dtype=bool), np.zeros(len(d), dtype=bool)
    seen = np.flatnonzero(covered)
    for start in range(0, len(seen), BAND):
        pick = seen[start : start + BAND]
        along = d[pick]
        origins = camera.position + away[pick, None] * along
        hits = world.geometry.cast(
            _check.frozen(origins), _check.frozen(along), near=world.geometry.offset, skip=index
        )
        radiance[pick] = world.of_hits(hits, along)
        on = pick[hits.found]
        hit[on] = True
        position[on], normal[on] = hits.position[hits.found], hits.normal[hits.found]
        if index >= 0:
            sky = ~hits.found
            doubtful[pick[sky]] = _doubtful(world.geometry, index, camera, origins[sky])
    shape = (camera.height, camera.width)
    return MirrorBuffer(
        camera,
        radiance.reshape(*shape, 3),
        position.reshape(*shape, 3),
        normal.reshape(*shape, 3),
        hit.reshape(shape),
        covered.reshape(shape),
        doubtful.reshape(shape),
    )
