"""Vectors in space for kernels: three numbers by name, which a compiled kernel keeps in registers."""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit


class Vector(NamedTuple):
    """A vector of frame `table`."""

    x: float
    y: float
    z: float


@njit(cache=True, inline="always")
def dot(a: Vector, b: Vector) -> float:
    """Return the inner product."""
    return a.x * b.x + a.y * b.y + a.z * b.z


@njit(cache=True, inline="always")
def plus(a: Vector, factor: float, b: Vector) -> Vector:
    """Return a + factor b."""
    return Vector(a.x + factor * b.x, a.y + factor * b.y, a.z + factor * b.z)


@njit(cache=True, inline="always")
def norm(a: Vector) -> float:
    """Return the length."""
    return math.sqrt(a.x * a.x + a.y * a.y + a.z * a.z)
