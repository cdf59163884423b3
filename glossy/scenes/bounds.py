"""The bounding planes of a scene, as an object's lookups take them."""

from ..planes import BoundingPlanes
from .prepared import PreparedScene


def bounding_planes(prepared: PreparedScene, index: int) -> BoundingPlanes | None:
    """The scene's planes about the place object ``index`` was captured from; None without any."""
    planes = prepared.scene.planes
    if not planes:
        return None
    return BoundingPlanes(prepared.geometry.center(index), planes)
