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
    PostureQuestion,
    PostureTask,
    Scratch,
    cost_of_joints,
    cost_scratch,
    joint_tasks,
    nearest_turn,
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


class WantedFace(NamedTuple):
    """Where the face is wanted, and working memory."""

    position: Array  # (3,) m, face centre
    rotation: Array  # (3, 3) of the racket; its turn about z is free
    turned: Array  # (3, 3) the same after its turn


class Freedoms(NamedTuple):
    """Values of both freedoms."""

    turn: float  # rad, of the racket about its normal
    swivel: float  # rad, of the elbow


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
def _place(at: Freedoms, face: WantedFace, joints: JointTasks, arm: ElbowArm, q: Array) -> float:
    """Fill q (7,) with the posture for both freedoms.

    Returns:
        The time (s) to it at full speed; inf if it is out of reach.
    """
    c, s = math.cos(at.turn), math.sin(at.turn)
    rotation, turned = face.rotation, face.turned
    for k in range(3):
        turned[k, 0], turned[k, 1] = c * rotation[k, 0] + s * rotation[k, 1], c * rotation[k, 1] - s * rotation[k, 0]
        turned[k, 2] = rotation[k, 2]
    if not inverse(face.position, turned, at.swivel, arm, q):
        return math.inf
    return _choose_branch(q, joints)


class Posture(NamedTuple):
    """A posture with its joint speeds."""

    q: Array  # (7,) rad
    qdot: Array  # (7,) rad/s


class Elbow(NamedTuple):
    """What all steps of a search share."""

    face: WantedFace
    task: PostureTask
    arm: ElbowArm
    chain: Chain
    scratch: Scratch


@njit(cache=True)
def _posture(
    at: Freedoms, face: WantedFace, task: PostureTask, arm: ElbowArm, chain: Chain, scratch: Scratch, bound: float, posture: Posture
) -> float:
    """Fill the best posture for both freedoms.

    Args:
        at: Values of the freedoms.
        face: Where the face is wanted.
        task: What is asked.
        arm: The geometry in closed form.
        chain: The geometry.
        scratch: Working memory.
        bound: Cost that the posture must stay below.
        posture: Filled.

    Returns:
        The cost; inf as soon as it is known to reach `bound`, or if there is no such posture.
    """
    q, qdot = posture
    nearest = _place(at, face, task.joints, arm, q)
    if nearest == math.inf:
        return math.inf
    return cost_of_joints(7, q, PostureQuestion(nearest, bound, False), task, chain, qdot, scratch)


@njit(cache=True)
def _descend(turn: float, swivel: float, size: float, elbow: Elbow, best: RefinedPosture) -> RefinedPosture:
    """Refine a posture by a compass search with steps that halve.

    Args:
        turn: rad, of the racket, where it starts.
        swivel: rad, of the elbow, where it starts.
        size: rad, the first step.
        elbow: What is asked.
        best: The best refined posture so far. The search ends where that one was found, and when it cannot become better.
    """
    face, task, arm, chain, scratch = elbow
    here_q, here_qdot, q, qdot = np.empty(7), np.empty(7), np.empty(7), np.empty(7)
    here = _posture(Freedoms(turn, swivel), face, task, arm, chain, scratch, math.inf, Posture(here_q, here_qdot))
    for _ in range(MOST_STEPS):
        if size <= STEP_LEAST:
            break
        moved = False
        for du, dv in DIRECTIONS:
            u, v = turn + du * size, swivel + dv * size
            cost = _posture(Freedoms(u, v), face, task, arm, chain, scratch, here, Posture(q, qdot))
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
def elbow_search(face: Face, start: Array, limits: JointBounds, weights: Array, grid: int, arm: ElbowArm, chain: Chain) -> BestPosture:
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
    wanted, scratch = WantedFace(face.position, face.rotation, np.empty((3, 3))), cost_scratch(7)
    elbow = Elbow(wanted, task, arm, chain, scratch)
    costs, least, step = np.empty((grid, grid)), math.inf, 2.0 * math.pi / grid
    q, qdot = np.empty(7), np.empty(7)
    for n in range(grid * grid):
        at = SCATTERED * n % (grid * grid)
        i, j = at // grid, at % grid
        costs[i, j] = _posture(Freedoms(i * step, j * step), wanted, task, arm, chain, scratch, least + CLOSE, Posture(q, qdot))
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
