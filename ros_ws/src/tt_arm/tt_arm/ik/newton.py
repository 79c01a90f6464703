"""Kernels of Newton's method for the posture: from a seed to the face's position and normal, dissertation (4.62)-(4.63).

Position and normal are five conditions on n joints; the pseudo-inverse takes the shortest step that meets them, 1 m of a linear joint
counting as 1 rad. Damping in proportion to the squared error (Levenberg and Marquardt) keeps the steps small near singular postures and
does not slow the last ones.

`newton` ignores the position limits: the robot adjusts a posture with it to a racket state that has changed a little. `settle` keeps them:
`posture_search` begins with it from seeds that may be far.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

from ..kinematics import Chain, forward_into
from .velocity_allocation import ONES, steady_rows_into

MOST_STEPS = 50
TOLERANCE = 7e-10  # m, and rad about either axis, where it ends: 1e-9 about both
DAMPING = 1e-3  # per squared error (m^2, rad^2)
LEAST_DAMPING = 1e-12
LONGEST_STEP = 0.7  # rad or m, of any joint in one step of `settle`


class NewtonPosture(NamedTuple):
    """Where Newton's method ended."""

    converged: bool
    q: Array  # (n,) rad or m
    rows: Array  # (5, n) of `steady_rows` there, for joint speeds


class Target(NamedTuple):
    """Where the face is wanted."""

    position: Array  # (3,) m, face centre
    normal: Array  # (3,) unit


class NewtonScratch(NamedTuple):
    """Working memory."""

    error: Array  # (5,) what is missing: position (m), rotation about the racket's x and y axes (rad)
    solved: Array  # (5,)
    lower: Array  # (5, 5)
    point: Array  # (3,)
    rotation: Array  # (3, 3)
    jacobian: Array  # (6, n)
    step: Array  # (n,) rad or m
    stuck: Array  # (n,) 1 for a joint that is held at its limit during a step, else 0


@njit(cache=True)
def newton_scratch(n: int) -> NewtonScratch:
    """Return working memory for n joints."""
    return NewtonScratch(
        np.empty(5), np.empty(5), np.empty((5, 5)), np.empty(3), np.empty((3, 3)), np.empty((6, n)), np.empty(n), np.empty(n)
    )


@njit(cache=True)
def _missing(position: Array, normal: Array, rotation: Array, point: Array, error: Array) -> float:
    """Fill what is missing to a position (3,) and normal (3,), see `NewtonScratch.error`.

    Returns:
        The largest of its numbers; inf where the face looks the other way.
    """
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
    return worst if cosine > 0.0 else math.inf


@njit(cache=True)
def _least_step(rows: Array, scratch: NewtonScratch) -> None:
    """Fill the step rows^T (rows rows^T + damping)^-1 error of the joints that are not stuck.

    Cholesky's method takes a fifth of the time of a call of LAPACK.
    """
    error, solved, lower, step, stuck = scratch.error, scratch.solved, scratch.lower, scratch.step, scratch.stuck
    n, damping = rows.shape[1], LEAST_DAMPING
    for i in range(5):
        damping += DAMPING * error[i] * error[i]
    for i in range(5):
        solved[i] = error[i]
        for j in range(i + 1):
            total = damping if i == j else 0.0
            for k in range(n):
                if stuck[k] == 0.0:
                    total += rows[i, k] * rows[j, k]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(max(total, 1e-15)) if i == j else total / lower[j, j]
        for k in range(i):
            solved[i] -= lower[i, k] * solved[k]
        solved[i] /= lower[i, i]
    for i in range(4, -1, -1):
        for k in range(i + 1, 5):
            solved[i] -= lower[k, i] * solved[k]
        solved[i] /= lower[i, i]
    for j in range(n):
        step[j] = 0.0
        if stuck[j] == 0.0:
            for i in range(5):
                step[j] += rows[i, j] * solved[i]


@njit(cache=True)
def newton(position: Array, normal: Array, seed: Array, chain: Chain) -> NewtonPosture:
    """Find the posture for a face position and normal.

    Args:
        position: (3,) m, face centre.
        normal: (3,) unit, face normal.
        seed: (n,) rad or m, where the search starts.
        chain: The geometry.
    """
    n = len(seed)
    q, rows, scratch = seed.copy(), np.empty((5, n)), newton_scratch(n)
    scratch.stuck[:] = 0.0
    for step in range(MOST_STEPS + 1):
        forward_into(q, chain, scratch.point, scratch.rotation, scratch.jacobian)
        worst = _missing(position, normal, scratch.rotation, scratch.point, scratch.error)
        steady_rows_into(scratch.jacobian, scratch.rotation, ONES, rows)
        if worst < TOLERANCE:
            return NewtonPosture(True, q, rows)
        if step < MOST_STEPS:
            _least_step(rows, scratch)
            q += scratch.step
    return NewtonPosture(False, q, rows)


@njit(cache=True)
def settle(target: Target, bounds: Array, most: int, chain: Chain, q: Array, rows: Array, scratch: NewtonScratch) -> bool:
    """Change q (n,) to a posture for a face position and normal within limits.

    A joint that a step would move beyond its limit stays at the limit, and the others make up for it.

    Args:
        target: Where the face is wanted.
        bounds: (n, 2) lowest and highest position, rad or m; infinite for a joint that may make whole turns.
        most: Steps.
        chain: The geometry.
        q: (n,) rad or m, changed in place; within the limits.
        rows: (5, n); filled with `steady_rows` there, for joint speeds.
        scratch: Working memory.

    Returns:
        Whether there is one.
    """
    n, stuck, step = len(q), scratch.stuck, scratch.step
    for count in range(most + 1):
        forward_into(q, chain, scratch.point, scratch.rotation, scratch.jacobian)
        worst = _missing(target.position, target.normal, scratch.rotation, scratch.point, scratch.error)
        steady_rows_into(scratch.jacobian, scratch.rotation, ONES, rows)
        if worst < TOLERANCE:
            return True
        if count == most:
            break
        stuck[:] = 0.0
        for _ in range(n):
            _least_step(rows, scratch)
            more = False
            for i in range(n):
                if (q[i] <= bounds[i, 0] and step[i] < 0.0) or (q[i] >= bounds[i, 1] and step[i] > 0.0):
                    stuck[i], more = 1.0, True
            if not more:
                break
        longest = 0.0
        for i in range(n):
            longest = max(longest, abs(step[i]))
        part = LONGEST_STEP / longest if longest > LONGEST_STEP else 1.0
        for i in range(n):
            q[i] = min(bounds[i, 1], max(bounds[i, 0], q[i] + part * step[i]))
    return False
