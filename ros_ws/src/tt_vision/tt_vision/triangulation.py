"""Compiled triangulation of points: the linear solution (B.74) of the Nagoya dissertation, with each equation divided by the depth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

from .projection import ray, unpack_camera

DEPTH_PASSES = 3  # each with the depths of the one before; the first one takes all depths as equal


class NormalEquations(NamedTuple):
    """Normal equations of a least-squares problem with three unknowns, summed over equations p X + q Y + r Z = b.

    Attributes:
        xx: Sum of p p. This and the next five are the upper triangle of the normal matrix.
        xy: Sum of p q.
        xz: Sum of p r.
        yy: Sum of q q.
        yz: Sum of q r.
        zz: Sum of r r.
        x: Sum of p b. This and the next two are the right side.
        y: Sum of q b.
        z: Sum of r b.
    """

    xx: float
    xy: float
    xz: float
    yy: float
    yz: float
    zz: float
    x: float
    y: float
    z: float


@njit(cache=True, nogil=True, forceinline=True)
def _with_equation(n: NormalEquations, p: float, q: float, r: float, b: float) -> NormalEquations:
    return NormalEquations(
        n.xx + p * p, n.xy + p * q, n.xz + p * r, n.yy + q * q, n.yz + q * r, n.zz + r * r, n.x + p * b, n.y + q * b, n.z + r * b
    )


@njit(cache=True, nogil=True)
def triangulate_points(vectors: Array, pixels: Array) -> Array:
    """Compute the positions of n points from the pixels at which m cameras see them; the arguments are not validated.

    Args:
        vectors: (m, 20) `Camera.vector` of each camera, m >= 2.
        pixels: (m, n, 2) pixels, column and row.

    Returns:
        (n, 3) m in `table`, NaN for a point whose rays are parallel.
    """
    m, points = len(vectors), np.empty((pixels.shape[1], 3))
    rays, depths = np.empty((m, 2)), np.empty(m)
    for i in range(len(points)):
        for j in range(m):
            rays[j] = ray(unpack_camera(vectors[j]).optics, pixels[j, i, 0], pixels[j, i, 1])
            depths[j] = 1.0
        for _ in range(DEPTH_PASSES):
            sums = NormalEquations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            for j in range(m):
                c, x, y, depth = unpack_camera(vectors[j]), rays[j, 0], rays[j, 1], depths[j]
                r = c.rotation
                sums = _with_equation(
                    sums, (x * r.zx - r.xx) / depth, (x * r.zy - r.xy) / depth, (x * r.zz - r.xz) / depth, (c.tx - x * c.tz) / depth
                )
                sums = _with_equation(
                    sums, (y * r.zx - r.yx) / depth, (y * r.zy - r.yy) / depth, (y * r.zz - r.yz) / depth, (c.ty - y * c.tz) / depth
                )
            n = sums
            f, g, h = n.yy * n.zz - n.yz * n.yz, n.xz * n.yz - n.xy * n.zz, n.xy * n.yz - n.xz * n.yy
            det = n.xx * f + n.xy * g + n.xz * h
            if det < 1e-14 * (n.xx + n.yy + n.zz) ** 3:
                points[i] = np.nan
                break
            points[i, 0] = (f * n.x + g * n.y + h * n.z) / det
            points[i, 1] = (g * n.x + (n.xx * n.zz - n.xz * n.xz) * n.y + (n.xy * n.xz - n.xx * n.yz) * n.z) / det
            points[i, 2] = (h * n.x + (n.xy * n.xz - n.xx * n.yz) * n.y + (n.xx * n.yy - n.xy * n.xy) * n.z) / det
            for j in range(m):
                c = unpack_camera(vectors[j])
                r = c.rotation
                depths[j] = r.zx * points[i, 0] + r.zy * points[i, 1] + r.zz * points[i, 2] + c.tz
    return points
