"""Rotations in three dimensions, as compiled functions. Where speed does not matter, scipy's Rotation is used."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .states import Array


@njit(cache=True, nogil=True)
def rotation_matrix(v: Array) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector v (3,) in rad, by Rodrigues' formula."""
    angle2 = float(v @ v)
    angle = math.sqrt(angle2)
    a, b = 1.0, 0.5
    if angle > 1e-9:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + a * k + b * (k @ k)


@njit(cache=True, nogil=True)
def left_jacobian(v: Array) -> Array:
    """Return the left Jacobian J (3, 3) of the rotation vector v (3,) in rad.

    With exp = `rotation_matrix`, exp(v + d) = exp(J d) exp(v) to first order in a small change d of the rotation vector.
    """
    angle2 = float(v @ v)
    angle = math.sqrt(angle2)
    if angle < 1e-4:
        a, b = 0.5, 1.0 / 6.0
    else:
        a, b = (1.0 - math.cos(angle)) / angle2, (angle - math.sin(angle)) / (angle2 * angle)
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + a * k + b * (k @ k)
