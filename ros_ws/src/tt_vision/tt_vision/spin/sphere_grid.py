"""Points that are spread evenly over a sphere, and a cube map that gives the point nearest to a direction."""

from __future__ import annotations

import functools
import math

import numpy as np
from numba import njit
from scipy.spatial import KDTree
from tt_core.states import Array


@functools.cache
def fibonacci(n: int) -> Array:
    """Return n unit vectors (n, 3) that are evenly spread over the sphere (Fibonacci lattice). The array is shared; do not change it."""
    i = np.arange(n) + 0.5
    z = 1.0 - 2.0 * i / n
    angle = math.pi * (3.0 - math.sqrt(5.0)) * i
    return np.stack([np.sqrt(1.0 - z * z) * np.cos(angle), np.sqrt(1.0 - z * z) * np.sin(angle), z], axis=1)


@functools.cache
def fibonacci_single(n: int) -> np.ndarray:
    """Return the unit vectors `fibonacci(n)`, (n, 3), in single precision (float32)."""
    return fibonacci(n).astype(np.float32)


@functools.cache
def cube(n: int, edge: int) -> np.ndarray:
    """Return a cube map of the nearest points: for each cell of the six faces of a cube around the sphere the index of a point.

    Args:
        n: Number of points on the sphere, those of `fibonacci(n)`.
        edge: Number of cells along an edge of the cube.

    Returns:
        (6, edge, edge) int16: the index of the point nearest to the direction of the cell's centre. The faces are +x, -x, +y, -y, +z, -z.
    """
    points, nearest = KDTree(fibonacci(n)), np.empty((6, edge, edge), dtype=np.int16)
    middles = (2.0 * np.arange(edge) + 1.0) / edge - 1.0
    directions = np.empty((edge, edge, 3))
    for face in range(6):
        axis = face // 2
        directions[..., axis] = 1.0 if face % 2 == 0 else -1.0
        directions[..., (axis + 1) % 3] = middles[:, None]
        directions[..., (axis + 2) % 3] = middles
        nearest[face] = points.query(directions / np.linalg.norm(directions, axis=-1, keepdims=True))[1]
    return nearest


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def nearest_point(cube: np.ndarray, x: float, y: float, z: float) -> int:
    """Look up the point on the sphere that is nearest to a direction, as accurately as the cells of the cube map allow.

    Args:
        cube: (6, edge, edge) from the function `cube`.
        x: x component of the direction, whose length does not matter.
        y: y component of the direction.
        z: z component of the direction.

    Returns:
        The index of the point.
    """
    n = cube.shape[1]
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, u, v, w = 0, y, z, x
    elif ay >= az:
        face, u, v, w = 2, z, x, y
    else:
        face, u, v, w = 4, x, y, z
    if w < 0.0:
        face, w = face + 1, -w
    return cube[face, min(n - 1, int((u / w + 1.0) * 0.5 * n)), min(n - 1, int((v / w + 1.0) * 0.5 * n))]
