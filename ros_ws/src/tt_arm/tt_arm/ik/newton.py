"""Newton's method for the inverse kinematics, (4.62)-(4.63) of the dissertation.

It starts from a seed (a posture) and changes it until the racket's face has the wanted position and normal. These are five conditions on n
joints. The pseudo-inverse gives the shortest step that meets them, where 1 m of a linear joint counts as 1 rad. Damping in proportion to
the squared error (Levenberg-Marquardt) keeps the steps small near singular postures and does not slow the last steps.

`newton` ignores the position limits. The robot uses it to adjust a posture to a racket state that has changed a little.
`converge_within_limits` keeps the limits. `posture_search` uses it with seeds that may be far from the solution.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

from ..kinematics import Chain, forward_into
from .velocity_allocation import ONES, steady_rows_into

MOST_NEWTON_STEPS = 50
FACE_TOLERANCE = 7e-10  # m, and rad about each of two axes, largest error of a solution: 1e-9 rad about both
DAMPING = 1e-3  # damping per squared error (m^2, rad^2)
LEAST_DAMPING = 1e-12
LONGEST_NEWTON_STEP = 0.7  # rad or m, of any joint in one step of `converge_within_limits`


class NewtonPosture(NamedTuple):
    """Result of Newton's method.

    Attributes:
        converged: Whether the face has the wanted position and normal.
        q: (n,) rad or m, last joint positions.
        rows: (5, n) matrix from joint speeds to velocity and turning of the face in this posture, see `steady_rows`.
    """

    converged: bool
    q: Array
    rows: Array


class Target(NamedTuple):
    """Wanted position (3,) m of the racket's face centre, and wanted unit normal (3,) of the face, both in `table`."""

    position: Array
    normal: Array


class NewtonScratch(NamedTuple):
    """Scratch memory of Newton's method for n joints.

    Attributes:
        error: (5,) remaining error: position (m), rotation about the racket's x and y axes (rad).
        solved: (5,) solution of the normal equations.
        lower: (5, 5) Cholesky factor.
        point: (3,) m, face centre in `table`.
        rotation: (3, 3) rotation from racket to `table`.
        jacobian: (6, n) Jacobian of the racket.
        step: (n,) rad or m, step of the joints.
        stuck: (n,) 1 for a joint that is kept at its limit during a step, else 0.
    """

    error: Array
    solved: Array
    lower: Array
    point: Array
    rotation: Array
    jacobian: Array
    step: Array
    stuck: Array


@njit(cache=True)
def newton_scratch(n: int) -> NewtonScratch:
    """Return scratch memory of Newton's method for n joints."""
    return NewtonScratch(
        np.empty(5), np.empty(5), np.empty((5, 5)), np.empty(3), np.empty((3, 3)), np.empty((6, n)), np.empty(n), np.empty(n)
    )


@njit(cache=True)
def _missing(position: Array, normal: Array, rotation: Array, point: Array, error: Array) -> float:
    """Compute the error of a racket pose from a wanted position (3,) and normal (3,), see `NewtonScratch.error`.

    Returns:
        The largest absolute element of the error; inf if the angle between the normals is 90 degrees or more.
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
    """Compute the damped Newton step rows^T (rows rows^T + damping)^-1 error of the joints that are not kept at a limit.

    The Cholesky decomposition written here takes a fifth of the time of a call of LAPACK.
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
    """Find a posture with a wanted position and normal of the racket's face, ignoring the position limits.

    Args:
        position: (3,) m in `table`, wanted position of the face centre.
        normal: (3,) wanted unit normal of the face in `table`.
        seed: (n,) rad or m, posture from which the iteration starts.
        chain: Geometry of the arm.

    Returns:
        The posture. Its `converged` tells whether the iteration was successful.
    """
    n = len(seed)
    q, rows, scratch = seed.copy(), np.empty((5, n)), newton_scratch(n)
    scratch.stuck[:] = 0.0
    for step in range(MOST_NEWTON_STEPS + 1):
        forward_into(q, chain, scratch.point, scratch.rotation, scratch.jacobian)
        worst = _missing(position, normal, scratch.rotation, scratch.point, scratch.error)
        steady_rows_into(scratch.jacobian, scratch.rotation, ONES, rows)
        if worst < FACE_TOLERANCE:
            return NewtonPosture(True, q, rows)
        if step < MOST_NEWTON_STEPS:
            _least_step(rows, scratch)
            q += scratch.step
    return NewtonPosture(False, q, rows)


@njit(cache=True)
def converge_within_limits(target: Target, bounds: Array, most: int, chain: Chain, q: Array, rows: Array, scratch: NewtonScratch) -> bool:
    """Change a posture by Newton's method until the racket's face has a wanted position and normal, within the position limits.

    A joint that a step would move beyond its limit stays at the limit, and the other joints make the motion instead.

    Args:
        target: Wanted position and normal of the face.
        bounds: (n, 2) rad or m, lowest and highest position; infinite for a joint that can make whole turns.
        most: Largest number of steps.
        chain: Geometry of the arm.
        q: (n,) rad or m, joint positions within the limits at the start; changed in place.
        rows: (5, n) output: filled with the matrix from joint speeds to velocity and turning of the face, see `steady_rows`.
        scratch: Scratch memory.

    Returns:
        Whether the iteration converged to such a posture.
    """
    n, stuck, step = len(q), scratch.stuck, scratch.step
    for count in range(most + 1):
        forward_into(q, chain, scratch.point, scratch.rotation, scratch.jacobian)
        worst = _missing(target.position, target.normal, scratch.rotation, scratch.point, scratch.error)
        steady_rows_into(scratch.jacobian, scratch.rotation, ONES, rows)
        if worst < FACE_TOLERANCE:
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
        part = LONGEST_NEWTON_STEP / longest if longest > LONGEST_NEWTON_STEP else 1.0
        for i in range(n):
            q[i] = min(bounds[i, 1], max(bounds[i, 0], q[i] + part * step[i]))
    return False
