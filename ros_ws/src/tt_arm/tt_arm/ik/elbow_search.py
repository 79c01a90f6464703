"""Kernels of the search among all postures of an arm with a closed form, see `closed_form`, for a stroke.

Two freedoms, the racket's turn about its normal and the elbow's swivel angle, give a posture in closed form. The search takes the best
points of a grid over both and refines them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

from ..joints import JointBounds
from ..kinematics import Chain
from .closed_form import ElbowArm, inverse
from .posture_cost import (
    BestPosture,
    JointTasks,
    PostureTask,
    Scratch,
    cost_scratch,
    joint_tasks,
    nearest_turn,
    posture_cost,
    posture_weights,
)

SCATTERED = 173  # stride through the grid, to meet a good posture early: a prime that is larger than any grid
STARTS = 2  # postures of the grid that are refined
CLOSE = 3.0  # cost above the best of the grid, up to which a posture may still be refined to a better one
STEEP = 8.0  # per rad of the step: a start that costs more than this above the best is given up
MOST_STEPS = 1000  # of one descent, which takes about 30
STEP_LEAST = 0.01  # rad, where the refinement ends
DIRECTIONS = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))


class Face(NamedTuple):
    """What is asked of the racket."""

    position: Array  # (3,) m, face centre
    rotation: Array  # (3, 3) of the racket; its turn about z is free
    velocity: Array  # (3,) m/s, of the face centre


class ElbowTask(NamedTuple):
    """What is asked, the arm, and working memory."""

    position: Array  # (3,) m, face centre
    rotation: Array  # (3, 3) of the racket; its turn about z is free
    task: PostureTask
    arm: ElbowArm
    chain: Chain
    turned: Array  # (3, 3) rotation of the racket
    scratch: Scratch


class RefinedPosture(NamedTuple):
    """Where a descent has ended."""

    cost: float
    turn: float  # rad, of the racket about its normal
    swivel: float  # rad, of the elbow
    q: Array  # (7,) rad
    qdot: Array  # (7,) rad/s


@njit(cache=True, inline="always")
def _choose_branch(q: Array, joints: JointTasks) -> float:
    """Replace q (7,) by those angles for the same links in space that are nearest to the start.

    Each bit of the eight branches negates q2, q4 or q6 and turns its neighbours by pi.

    Returns:
        The time (s) from the start at full speed; inf if all branches are beyond a position limit.
    """
    angles, times = np.empty((7, 2)), np.empty((7, 2))
    for i in range(7):
        joint = joints[i]
        for k in range(2):
            angle = (-q[i] if i % 2 else q[i] + math.pi) if k else q[i]
            angle = nearest_turn(angle, joint.start, joint.low, joint.high)
            inside = joint.low <= angle <= joint.high
            angles[i, k], times[i, k] = angle, abs(angle - joint.start) / joint.speed if inside else math.inf
    nearest, best = math.inf, 0
    for branch in range(8):
        b0, b1, b2 = branch & 1, branch >> 1 & 1, branch >> 2
        time = max(times[0, b0], times[1, b0], times[2, b0 ^ b1], times[3, b1], times[4, b1 ^ b2], times[5, b2], times[6, b2])
        if time < nearest:
            nearest, best = time, branch
    b0, b1, b2 = best & 1, best >> 1 & 1, best >> 2
    q[0], q[1], q[2], q[3] = angles[0, b0], angles[1, b0], angles[2, b0 ^ b1], angles[3, b1]
    q[4], q[5], q[6] = angles[4, b1 ^ b2], angles[5, b2], angles[6, b2]
    return nearest


@njit(cache=True, inline="always")
def _place(turn: float, swivel: float, elbow: ElbowTask, q: Array) -> float:
    """Fill q (7,) with the posture for both freedoms.

    Returns:
        The time (s) to it at full speed; inf if it is out of reach.
    """
    c, s = math.cos(turn), math.sin(turn)
    rotation, turned = elbow.rotation, elbow.turned
    for k in range(3):
        turned[k, 0], turned[k, 1] = c * rotation[k, 0] + s * rotation[k, 1], c * rotation[k, 1] - s * rotation[k, 0]
        turned[k, 2] = rotation[k, 2]
    if not inverse(elbow.position, turned, swivel, elbow.arm, q):
        return math.inf
    return _choose_branch(q, elbow.task.joints)


@njit(cache=True)
def _posture(turn: float, swivel: float, elbow: ElbowTask, bound: float, q: Array, qdot: Array) -> float:
    """Fill q (7,) rad and qdot (7,) rad/s of the best posture for both freedoms.

    Args:
        turn: rad, of the racket about its normal.
        swivel: rad, of the elbow.
        elbow: What is asked.
        bound: Cost that the posture must stay below.
        q: (7,) rad; filled.
        qdot: (7,) rad/s; filled.

    Returns:
        The cost; inf as soon as it is known to reach `bound`, or if there is no such posture.
    """
    nearest = _place(turn, swivel, elbow, q)
    return math.inf if nearest == math.inf else posture_cost(q, nearest, elbow.task, bound, elbow.chain, False, qdot, elbow.scratch)


@njit(cache=True)
def _descend(
    turn: float, swivel: float, size: float, elbow: ElbowTask, best: RefinedPosture
) -> RefinedPosture:
    """Refine a posture by a compass search with steps that halve.

    Args:
        turn: rad, of the racket, where it starts.
        swivel: rad, of the elbow, where it starts.
        size: rad, the first step.
        elbow: What is asked.
        best: The best refined posture so far. The search ends where that one was found, and when it cannot become better.
    """
    here_q, here_qdot, q, qdot = np.empty(7), np.empty(7), np.empty(7), np.empty(7)
    here = _posture(turn, swivel, elbow, math.inf, here_q, here_qdot)
    for _ in range(MOST_STEPS):
        if size <= STEP_LEAST:
            break
        moved = False
        for du, dv in DIRECTIONS:
            u, v = turn + du * size, swivel + dv * size
            cost = _posture(u, v, elbow, here, q, qdot)
            if cost < here:
                here, turn, swivel, moved = cost, u, v, True
                here_q[:], here_qdot[:] = q, qdot
                break
        if not moved:
            size *= 0.5
            same = max(abs(turn - best.turn), abs(swivel - best.swivel)) < 2.0 * size
            if same or here > best.cost + STEEP * size:
                break
    return RefinedPosture(here, turn, swivel, here_q, here_qdot)


@njit(cache=True, nogil=True)
def elbow_search(
    face: Face, start: Array, limits: JointBounds, weights: Array, grid: int, arm: ElbowArm, chain: Chain
) -> BestPosture:
    """Search the best posture: a grid over both freedoms, then a compass search from its best points.

    Args:
        face: What is asked.
        start: (3, 7) q (rad) and qdot (rad/s) where the arm comes from, and q where it waits.
        limits: Of the joints.
        weights: (6,) of `PostureWeights`.
        grid: Values of each freedom.
        arm: The geometry in closed form.
        chain: The geometry.
    """
    task = PostureTask(face.velocity, joint_tasks(start, limits), posture_weights(weights))
    elbow = ElbowTask(face.position, face.rotation, task, arm, chain, np.empty((3, 3)), cost_scratch(7))
    costs, least, step = np.empty((grid, grid)), math.inf, 2.0 * math.pi / grid
    q, qdot = np.empty(7), np.empty(7)
    for n in range(grid * grid):
        at = SCATTERED * n % (grid * grid)
        i, j = at // grid, at % grid
        costs[i, j] = _posture(i * step, j * step, elbow, least + CLOSE, q, qdot)
        least = min(least, costs[i, j])
    best = RefinedPosture(math.inf, math.inf, math.inf, start[0].copy(), np.zeros(7))
    for _ in range(STARTS):
        at = int(np.argmin(costs))
        i, j = at // grid, at % grid
        if costs[i, j] == math.inf:
            break
        refined = _descend(i * step, j * step, 0.5 * step, elbow, best)
        if refined.cost < best.cost:
            best = refined
        for di in range(-1, 2):
            for dj in range(-1, 2):
                costs[(i + di) % grid, (j + dj) % grid] = math.inf
    return BestPosture(best.cost, best.q, best.qdot)
