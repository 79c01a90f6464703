"""Kernel of Newton's method for the posture: from a seed to the face's position and normal, dissertation (4.62)-(4.63).

The robot uses it to adjust a posture to a racket state that has changed a little. Position and normal are five conditions on seven joints;
the pseudo-inverse takes the shortest step that meets them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

from ..kinematics import Chain, forward_into
from .velocity_allocation import steady_rows_into

MOST_STEPS = 50
TOLERANCE = 7e-10  # m, and rad about either axis, where it ends: 1e-9 about both
ONES = np.ones(7)


class NewtonPosture(NamedTuple):
    """Where Newton's method ended."""

    converged: bool
    q: Array  # (7,) rad
    rows: Array  # (5, 7) of `steady_rows` there, for joint speeds in rad/s


@njit(cache=True)
def _least_step(rows: Array, error: Array, q: Array, lower: Array) -> None:
    """Add rows^T (rows rows^T)^-1 error to q, by Cholesky's method, in a fifth of the time of a call of LAPACK.

    Args:
        rows: (5, 7).
        error: (5,); overwritten.
        q: (7,); changed in place.
        lower: (5, 5) working memory.
    """
    for i in range(5):
        for j in range(i + 1):
            total = 1e-12 if i == j else 0.0
            for k in range(7):
                total += rows[i, k] * rows[j, k]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(max(total, 1e-15)) if i == j else total / lower[j, j]
        for k in range(i):
            error[i] -= lower[i, k] * error[k]
        error[i] /= lower[i, i]
    for i in range(4, -1, -1):
        for k in range(i + 1, 5):
            error[i] -= lower[k, i] * error[k]
        error[i] /= lower[i, i]
        for j in range(7):
            q[j] += rows[i, j] * error[i]


@njit(cache=True)
def newton(position: Array, normal: Array, seed: Array, chain: Chain) -> NewtonPosture:
    """Find the posture for a face position and normal.

    Args:
        position: (3,) m, face centre.
        normal: (3,) unit, face normal.
        seed: (7,) rad, where the search starts.
        chain: The geometry.
    """
    q, error = seed.copy(), np.empty(5)
    point, rotation, jacobian, rows, lower = np.empty(3), np.empty((3, 3)), np.empty((6, 7)), np.empty((5, 7)), np.empty((5, 5))
    for step in range(MOST_STEPS + 1):
        forward_into(q, chain, point, rotation, jacobian)
        x, y, z = rotation[0, 2], rotation[1, 2], rotation[2, 2]
        tx, ty, tz = y * normal[2] - z * normal[1], z * normal[0] - x * normal[2], x * normal[1] - y * normal[0]
        sine, cosine = math.sqrt(tx * tx + ty * ty + tz * tz), x * normal[0] + y * normal[1] + z * normal[2]
        factor = math.atan2(sine, cosine) / sine if sine > 1e-12 else 1.0  # turns the cross product into a rotation vector
        worst = 0.0
        for k in range(3):
            error[k] = position[k] - point[k]
        for k in range(2):
            error[3 + k] = factor * (rotation[0, k] * tx + rotation[1, k] * ty + rotation[2, k] * tz)
        for k in range(5):
            worst = max(worst, abs(error[k]))
        steady_rows_into(jacobian, rotation, ONES, rows)
        if worst < TOLERANCE and cosine > 0.0:
            return NewtonPosture(True, q, rows)
        if step < MOST_STEPS:
            _least_step(rows, error, q, lower)
    return NewtonPosture(False, q, rows)
