"""Symmetries of the cube: rotations, and cube maps turned by them."""

import itertools

import numpy as np
import numpy.typing as npt

from glossy.cubemap import locate, texel_directions

Float64Array = npt.NDArray[np.float64]


def rotations(mirrors: bool = False) -> list[Float64Array]:
    """The 24 rotations of the cube as matrices; with its mirrors, 48."""
    found = []
    for axes in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            m = np.zeros((3, 3))
            m[np.arange(3), axes] = signs
            if mirrors or np.linalg.det(m) > 0.0:
                found.append(m)
    return found


def turn_faces(faces: npt.NDArray[np.float32], rotation: Float64Array) -> npt.NDArray[np.float32]:
    """Faces (6, N, N, C) of the map seen from a turned cube: new(d) = old(R^T d)."""
    n = faces.shape[1]
    f, s, t = locate(texel_directions(n) @ rotation)
    col = ((s + 1.0) * 0.5 * n).astype(int)
    row = ((t + 1.0) * 0.5 * n).astype(int)
    return np.asarray(faces[f, row, col])
