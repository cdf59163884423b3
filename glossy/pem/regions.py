"""Median cut of a cube map: rectangles of texels of equal importance, each face for itself.

Every face is cut into the same number of rectangles. A rectangle that is to become k regions is
cut across its longer side, at the border between two lines of texels that divides its importance
most nearly as the numbers of regions on the two sides, k1 = k//2 (fewer if there are not as many
texels) and k - k1::

    importance = sum of luminance x solid angle,   |I(c) k - k1(c) I| -> min over borders c     (1)

Ties, as in a black rectangle, go to the border nearest the middle. So the regions of a face differ
from their mean by what the cuts at borders leave over: a cut into halves leaves at most half of a
line (row or column) of texels, and all cuts above a region together less than ``LINES`` times the
face's heaviest line. Different faces may hold regions of different importance.

Source: Debevec 2005, "A median cut algorithm for light probe sampling", applied to the faces of a
cube as Knuth et al. do (section 4).
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from .. import _check
from .._arguments import checked
from ..cubemap import CubeMap, face_directions
from ..frames import normalise

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709
LINES = 1.6  # 2/3 of a line for k1 : k - k1 = 1 : 2, and the regions' number doubles on the way up


@dataclasses.dataclass(frozen=True, eq=False)
class Regions:
    """A partition of a cube map's texels into R rectangles, each on one face.

    Attributes
    ----------
    size : int
        Texels along a face's edge, N.
    face : (R,) int
        0..5; the regions of a face follow each other.
    rows, columns : (R, 2) int
        First texel, and the one after the last.
    solid_angle : (R,) [sr]
        They sum to 4 pi.
    power : (R, 3)
        Sum of radiance x solid angle, per channel.
    importance : (R,)
        Luminance of the power; negative texels count as 0.
    direction : (R, 3)
        Unit: where the region's light comes from, the mean of its texels' directions weighted by
        importance; of a black region the mean weighted by solid angle, its centre.
    labels : (6, N, N) int32
        Region of each texel.
    """

    size: int
    face: Int64Array
    rows: Int64Array
    columns: Int64Array
    solid_angle: Float64Array
    power: Float64Array
    importance: Float64Array
    direction: Float64Array
    labels: npt.NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.face)

    def box(self, index: int) -> tuple[int, slice, slice]:
        """Index of a region's texels in (6, N, N, ...) arrays."""
        (top, bottom), (left, right) = self.rows[index], self.columns[index]
        return int(self.face[index]), slice(int(top), int(bottom)), slice(int(left), int(right))

    def masked(self, cube: CubeMap, index: int) -> CubeMap:
        """The cube map with everything but one region black."""
        faces = np.zeros_like(cube.faces)
        faces[self.box(index)] = cube.faces[self.box(index)]
        return CubeMap(faces, negative="keep")

    def __repr__(self) -> str:
        return f"Regions(count={len(self)}, size={self.size})"


def _cut(sums: Float64Array, box: tuple[int, int, int, int], parts: int) -> tuple[int, int, int]:
    """Axis, border and regions before it of the cut of a rectangle into ``parts`` > 1; eq. (1)."""
    top, bottom, left, right = box
    high, wide = bottom - top, right - left
    if wide >= high:
        length, line = wide, high
        before = sums[bottom, left : right + 1] - sums[top, left : right + 1]
    else:
        length, line = high, wide
        before = sums[top : bottom + 1, right] - sums[top : bottom + 1, left]
    border = np.arange(1, length)
    first = np.clip(parts // 2, parts - line * (length - border), line * border)
    share = before[1:-1] - before[0]
    miss = np.abs(share * parts - first * (before[-1] - before[0]))
    best = border[miss == miss.min()]
    at = int(best[np.argmin(np.abs(2 * best - length))])
    return (1 if wide >= high else 0), at, int(first[at - 1])


def _split(importance: Float64Array, parts: int) -> list[tuple[int, int, int, int]]:
    """Rectangles (top, bottom, left, right) of one face (N, N), in the order of the cuts."""
    n = len(importance)
    sums = np.zeros((n + 1, n + 1))
    sums[1:, 1:] = importance.cumsum(axis=0).cumsum(axis=1)
    done, todo = [], [((0, n, 0, n), parts)]
    while todo:
        box, k = todo.pop()
        if k == 1:
            done.append(box)
            continue
        top, bottom, left, right = box
        axis, at, first = _cut(sums, box, k)
        if axis == 1:
            a, b = (top, bottom, left, left + at), (top, bottom, left + at, right)
        else:
            a, b = (top, top + at, left, right), (top + at, bottom, left, right)
        todo += [(b, k - first), (a, first)]
    return done


@checked
def regions(cube: CubeMap, count: int = 48) -> Regions:
    """Cut a cube map into regions of equal importance on each face.

    Parameters
    ----------
    cube : CubeMap
        Any size.
    count : int
        Number of regions over the cube: a multiple of six, at most the number of texels.

    Raises
    ------
    ValueError
        For a count that is not a multiple of six or exceeds the texels, or non-finite radiance.
    """
    n = cube.size
    whole = _check.count("count", count, low=6, high=6 * n * n)
    if whole % 6:
        raise _check.fail("count", "must be a multiple of six", count)
    if not np.all(np.isfinite(cube.faces)):
        raise _check.fail("cube", "must be finite", "NaN or inf")
    omega = cube.solid_angles()
    weighed = np.maximum(cube.faces @ LUMINANCE, 0.0) * omega
    boxes = [(f, *box) for f in range(6) for box in _split(weighed[f], whole // 6)]
    table = np.array(boxes, dtype=np.int64)
    found = Regions(
        size=n,
        face=table[:, 0],
        rows=table[:, 1:3],
        columns=table[:, 3:5],
        solid_angle=np.zeros(whole),
        power=np.zeros((whole, 3)),
        importance=np.zeros(whole),
        direction=np.zeros((whole, 3)),
        labels=np.empty((6, n, n), dtype=np.int32),
    )
    along = (np.arange(n) + 0.5) * (2.0 / n) - 1.0
    inverse = 1.0 / np.sqrt(1.0 + along**2 + along[:, None] ** 2)  # of the length of (s, t, 1)
    sums = np.zeros((whole, 3))
    for i in range(whole):
        box = found.box(i)
        area, share = omega[box[1:]], weighed[box]
        found.labels[box] = i
        found.solid_angle[i] = area.sum()
        found.power[i] = np.einsum("rcx,rc->x", cube.faces[box].astype(np.float64), area)
        found.importance[i] = share.sum()
        weight = share / share.max() if found.importance[i] > 0.0 else area
        weight = weight * inverse[box[1:]]
        sums[i] = (
            weight.sum(axis=0) @ along[box[2]],
            weight.sum(axis=1) @ along[box[1]],
            weight.sum(),
        )
    s, t = sums[:, 0] / sums[:, 2], sums[:, 1] / sums[:, 2]
    found.direction[...] = normalise(face_directions(found.face, s, t))
    for value in vars(found).values():
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
    return found
