"""Vectors with named components for compiled functions, which the compiler keeps in registers."""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit


class Vector(NamedTuple):
    """A vector (x, y, z) in frame `table`; its unit depends on its use."""

    x: float
    y: float
    z: float


@njit(cache=True, inline="always")
def dot(a: Vector, b: Vector) -> float:
    """Return the inner product of two vectors."""
    return a.x * b.x + a.y * b.y + a.z * b.z


@njit(cache=True, inline="always")
def plus(a: Vector, factor: float, b: Vector) -> Vector:
    """Return the vector a + factor * b."""
    return Vector(a.x + factor * b.x, a.y + factor * b.y, a.z + factor * b.z)


@njit(cache=True, inline="always")
def norm(a: Vector) -> float:
    """Return the length of a vector."""
    return math.sqrt(a.x * a.x + a.y * a.y + a.z * a.z)
