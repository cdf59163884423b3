"""Triangles as a mesh file has them, before anything is made of them."""

import dataclasses

import numpy as np
import numpy.typing as npt

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]


@dataclasses.dataclass(frozen=True, eq=False)
class Soup:
    """``points`` (V, 3), ``triangles`` (T, 3), and ``normals`` (V, 3), NaN where the file has none.

    Raises
    ------
    ValueError
        If a triangle names a vertex that is not there.
    """

    points: Float64Array
    triangles: Int64Array
    normals: Float64Array | None = None

    def __post_init__(self) -> None:
        index, count = self.triangles, len(self.points)
        if index.size and (index.min() < 0 or index.max() >= count):
            worst = int(index.min() if index.min() < 0 else index.max())
            raise ValueError(f"a face names vertex {worst}, of {count} that count from 0")


def fan(lengths: Int64Array, corners: Int64Array) -> Int64Array:
    """Triangles (T, 3) of polygons about their first corners.

    ``lengths``: corners of each polygon; ``corners``: those of all, one after the other.
    """
    start, each = np.cumsum(lengths) - lengths, np.maximum(lengths - 2, 0)
    first = np.repeat(start, each)
    step = np.arange(len(first)) - np.repeat(np.cumsum(each) - each, each)
    return np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], axis=1)
