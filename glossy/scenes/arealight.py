"""Irradiance from a rectangle of constant radiance: in closed form, and what of it is in sight.

For radiance 1 and the polygon's vertices v_i as seen from the point, clipped to the horizon ::

    E = 1/2 sum_i theta_i (n . v_i x v_i+1) / |v_i x v_i+1|,   theta_i the angle between them   (1)

Lambert's formula. Shadows scale it: with points y_k spread over the light and visibility V ::

    E_visible = E * sum w_k V_k / sum w_k,   w = cos at the surface * cos at the light / r^2    (2)

so a point that sees all of the light has no sampling error.
"""

import math

import numpy as np
import numpy.typing as npt

from .. import _check
from .._jit import Scalar, kernel, row_kernel
from .._threads import in_rows

Float64Array = npt.NDArray[np.float64]


@kernel
def _edge(ax: Scalar, ay: Scalar, az: Scalar, bx: Scalar, by: Scalar, bz: Scalar) -> Scalar:
    """One term of eq. (1) in a frame whose z is the normal: theta (v_i x v_i+1)_z / |...|."""
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    length = math.sqrt(cx * cx + cy * cy + cz * cz)
    if length == 0.0:
        return 0.0
    return math.atan2(length, ax * bx + ay * by + az * bz) * cz / length


@row_kernel
def _towards(
    begin: int,
    end: int,
    points: Float64Array,
    normals: Float64Array,
    corner: Float64Array,
    edges: Float64Array,
    xi: Float64Array,
    direction: Float64Array,
    distance: Float64Array,
    weight: Float64Array,
    whole: Float64Array,
) -> None:
    # (K, 3) x2, (3,), (2, 3), (N, 2) -> (K, 3), (K,), (K,), (K,); point k takes xi[k % N]
    lx = edges[0, 1] * edges[1, 2] - edges[0, 2] * edges[1, 1]
    ly = edges[0, 2] * edges[1, 0] - edges[0, 0] * edges[1, 2]
    lz = edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0]
    area = math.sqrt(lx * lx + ly * ly + lz * lz)
    lx, ly, lz = lx / area, ly / area, lz / area
    for k in range(begin, end):
        px, py, pz = corner[0] - points[k, 0], corner[1] - points[k, 1], corner[2] - points[k, 2]
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        distance[k], weight[k], whole[k] = 1.0, 0.0, 0.0
        direction[k, 0], direction[k, 1], direction[k, 2] = nx, ny, nz
        if px * lx + py * ly + pz * lz >= 0.0:
            continue  # behind the light
        # a frame about the normal (Duff et al.'s form), and the corners in it
        sign = math.copysign(1.0, nz)
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        tx, ty, tz = 1.0 + sign * nx * nx * a, sign * b, -sign * nx
        sx, sy, sz = b, sign + ny * ny * a, -ny
        total = 0.0
        first_x = first_y = first_z = last_x = last_y = last_z = 0.0
        started = False
        for i in range(4):
            u0, v0 = (1.0 if 0 < i < 3 else 0.0), (1.0 if i > 1 else 0.0)
            j = (i + 1) % 4
            u1, v1 = (1.0 if 0 < j < 3 else 0.0), (1.0 if j > 1 else 0.0)
            x = px + u0 * edges[0, 0] + v0 * edges[1, 0]
            y = py + u0 * edges[0, 1] + v0 * edges[1, 1]
            z = pz + u0 * edges[0, 2] + v0 * edges[1, 2]
            ax, ay, az = (
                x * tx + y * ty + z * tz,
                x * sx + y * sy + z * sz,
                x * nx + y * ny + z * nz,
            )
            x = px + u1 * edges[0, 0] + v1 * edges[1, 0]
            y = py + u1 * edges[0, 1] + v1 * edges[1, 1]
            z = pz + u1 * edges[0, 2] + v1 * edges[1, 2]
            bx, by, bz = (
                x * tx + y * ty + z * tz,
                x * sx + y * sy + z * sz,
                x * nx + y * ny + z * nz,
            )
            if az <= 0.0 and bz <= 0.0:
                continue
            if az < 0.0:
                f = az / (az - bz)
                ax, ay, az = ax + f * (bx - ax), ay + f * (by - ay), 0.0
            elif bz < 0.0:
                f = az / (az - bz)
                bx, by, bz = ax + f * (bx - ax), ay + f * (by - ay), 0.0
            if not started:
                first_x, first_y, first_z, started = ax, ay, az, True
            else:  # the piece along the horizon, empty where the polygon went on
                total += _edge(last_x, last_y, last_z, ax, ay, az)
            total += _edge(ax, ay, az, bx, by, bz)
            last_x, last_y, last_z = bx, by, bz
        if not started:
            continue
        total += _edge(last_x, last_y, last_z, first_x, first_y, first_z)
        whole[k] = max(-0.5 * total, 0.0)
        u, v = xi[k % xi.shape[0], 0], xi[k % xi.shape[0], 1]
        dx = px + u * edges[0, 0] + v * edges[1, 0]
        dy = py + u * edges[0, 1] + v * edges[1, 1]
        dz = pz + u * edges[0, 2] + v * edges[1, 2]
        square = dx * dx + dy * dy + dz * dz
        r = math.sqrt(square)
        dx, dy, dz = dx / r, dy / r, dz / r
        direction[k, 0], direction[k, 1], direction[k, 2] = dx, dy, dz
        distance[k] = r
        cosine = dx * nx + dy * ny + dz * nz
        weight[k] = max(cosine, 0.0) * max(-(dx * lx + dy * ly + dz * lz), 0.0) / square


def towards(
    points: Float64Array, normals: Float64Array, corners: Float64Array, xi: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """From each point to one point of the light: direction, distance, w of eq. (2), E of eq. (1).

    ``points``, ``normals`` (K, 3), ``corners`` (4, 3) counter-clockwise from the front, ``xi``
    (N, 2): point k takes number k mod N.
    """
    count = len(points)
    out = np.empty((count, 3)), np.empty(count), np.empty(count), np.empty(count)
    edges = np.stack([corners[1] - corners[0], corners[3] - corners[0]])
    place, up, corner, sides, number = (
        _check.frozen(a) for a in (points, normals, corners[0], edges, xi)
    )
    in_rows(_towards, len(place), place, up, corner, sides, number, *out, grain=64)
    return out
