"""The bounding planes of a scene, as an object's lookups take them."""

from .. import _check, methods
from ..planes import BoundingPlanes
from .model import ObjectScene
from .prepared import PreparedScene


def check_planes(scene: ObjectScene) -> None:
    """Refuse planes for a method that cannot use them, before anything is baked."""
    for item in scene.objects if scene.planes else ():
        name, _ = scene.method_of(item)
        if item.glossy and name not in (*methods.PLANES, *methods.VIEWED):
            rule = f"must be one of {', '.join(methods.PLANES)} in a scene with [[planes]]"
            raise _check.fail("method.name", rule, name)


def bounding_planes(prepared: PreparedScene, index: int) -> BoundingPlanes | None:
    """The scene's planes about the place object ``index`` was captured from; None without any."""
    planes = prepared.scene.planes
    if not planes:
        return None
    return BoundingPlanes(prepared.geometry.center(index), planes)
