"""Search for the best posture (joint positions) of an arm with closed-form inverse kinematics (see `closed_form`) for a stroke.

A posture of such an arm that holds the racket's face has two freedoms (free angles): the rotation of the racket about its normal, and the
swivel angle of the elbow about the line from shoulder to wrist. Their values give the posture in closed form. The search computes the cost
on a grid over both, and refines the best points.
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
    REFINED_EXCESS,
    REFINED_POSTURES,
    STEEPEST_COST,
    BestPosture,
    CostScratch,
    JointTasks,
    PostureQuestion,
    PostureTask,
    cost_of_joints,
    cost_scratch,
    joint_tasks,
    nearest_turn,
    posture_weights,
)

SCATTERED = 173  # stride through the grid, so that a good posture is found early; a prime that is larger than any grid
MOST_ELBOW_STEPS = 1000  # largest number of steps of one refinement, which takes about 30
STEP_LEAST = 0.01  # rad, step size at which the refinement ends
SEARCH_DIRECTIONS = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))


class Face(NamedTuple):
    """Wanted state of the racket's face at the strike.

    Attributes:
        position: (3,) m in `table`, face centre.
        rotation: (3, 3) rotation from racket to `table`; the rotation about the racket's z axis, the face normal, is free.
        velocity: (3,) m/s in `table`, velocity of the face centre.
    """

    position: Array
    rotation: Array
    velocity: Array


class WantedFace(NamedTuple):
    """Wanted position and rotation of the racket's face, with scratch memory.

    Attributes:
        position: (3,) m in `table`, face centre.
        rotation: (3, 3) rotation from racket to `table`; the rotation about the racket's z axis, the face normal, is free.
        turned: (3, 3) scratch memory for the same rotation after a rotation about the normal.
        angles: (7, 2) scratch memory for two angles (rad) of each joint, see `_choose_branch`.
        times: (7, 2) scratch memory for the times (s) in which the joints reach them.
    """

    position: Array
    rotation: Array
    turned: Array
    angles: Array
    times: Array


class Freedoms(NamedTuple):
    """Values of the two free angles of a posture that holds the racket's face.

    Attributes:
        turn: rad, rotation of the racket about its normal.
        swivel: rad, angle of the elbow about the line from shoulder to wrist; 0 is up.
    """

    turn: float
    swivel: float


class RefinedPosture(NamedTuple):
    """Result of the refinement of one posture.

    Attributes:
        cost: Cost of the posture; inf if there is none.
        turn: rad, rotation of the racket about its normal.
        swivel: rad, angle of the elbow about the line from shoulder to wrist.
        q: (7,) rad, joint positions.
        qdot: (7,) rad/s, joint speeds.
    """

    cost: float
    turn: float
    swivel: float
    q: Array
    qdot: Array


@njit(cache=True, inline="always")
def _choose_branch(q: Array, joints: JointTasks, angles: Array, times: Array) -> float:
    """Replace q (7,) by the joint angles with the same positions of all links that are reached soonest from the start.

    There are eight such branches. Each of their three bits negates q2, q4 or q6 and rotates the two joints beside it by pi.

    Args:
        q: Joint angles in rad, input and output.
        joints: (7,) start and limits of each joint.
        angles: (7, 2) scratch memory for the two possible angles of each joint.
        times: (7, 2) scratch memory for the times in which the joints reach them.

    Returns:
        The time (s) from the start at full speed; inf if all branches are beyond a position limit.
    """
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
    """Fill q (7,) with the posture for given values of both freedoms.

    Returns:
        The time (s) from the start to the posture at full speed; inf if it is out of reach.
    """
    c, s = math.cos(at.turn), math.sin(at.turn)
    rotation, turned = face.rotation, face.turned
    for k in range(3):
        turned[k, 0], turned[k, 1] = c * rotation[k, 0] + s * rotation[k, 1], c * rotation[k, 1] - s * rotation[k, 0]
        turned[k, 2] = rotation[k, 2]
    if not inverse(face.position, turned, at.swivel, arm, q):
        return math.inf
    return _choose_branch(q, joints, face.angles, face.times)


class Posture(NamedTuple):
    """Posture and its joint speeds: q (7,) rad and qdot (7,) rad/s."""

    q: Array
    qdot: Array


class Elbow(NamedTuple):
    """Data that all steps of an elbow search use.

    Attributes:
        face: Wanted position and rotation of the racket's face.
        task: Wanted velocity, joints and weights of the cost.
        arm: Geometry of the arm for the closed form.
        chain: Geometry of the arm.
        scratch: CostScratch memory of the cost.
    """

    face: WantedFace
    task: PostureTask
    arm: ElbowArm
    chain: Chain
    scratch: CostScratch


@njit(cache=True)
def _posture(
    at: Freedoms, face: WantedFace, task: PostureTask, arm: ElbowArm, chain: Chain, scratch: CostScratch, bound: float, posture: Posture
) -> float:
    """Compute the posture for given values of both freedoms, its best joint speeds and its cost.

    Args:
        at: Values of the freedoms.
        face: Wanted position and rotation of the face.
        task: Data of the search.
        arm: Geometry of the arm for the closed form.
        chain: Geometry of the arm.
        scratch: CostScratch memory.
        bound: Cost below which the posture must be.
        posture: Output: its arrays are filled.

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
    """Refine a posture by a compass search over both freedoms, with steps that are halved when none is better.

    Args:
        turn: rad, rotation of the racket about its normal at the start.
        swivel: rad, angle of the elbow at the start.
        size: rad, first step size.
        elbow: Data of the search.
        best: The best refined posture so far. The search ends if it comes near to this one, or cannot become better.
    """
    face, task, arm, chain, scratch = elbow
    here_q, here_qdot, q, qdot = np.empty(7), np.empty(7), np.empty(7), np.empty(7)
    here = _posture(Freedoms(turn, swivel), face, task, arm, chain, scratch, math.inf, Posture(here_q, here_qdot))
    for _ in range(MOST_ELBOW_STEPS):
        if size <= STEP_LEAST:
            break
        moved = False
        for du, dv in SEARCH_DIRECTIONS:
            u, v = turn + du * size, swivel + dv * size
            cost = _posture(Freedoms(u, v), face, task, arm, chain, scratch, here, Posture(q, qdot))
            if cost < here:
                here, turn, swivel, moved = cost, u, v, True
                here_q[:], here_qdot[:] = q, qdot
                break
        if not moved:
            size *= 0.5
            same = max(abs(turn - best.turn), abs(swivel - best.swivel)) < 2.0 * size
            if same or here > best.cost + STEEPEST_COST * size:
                break
    return RefinedPosture(here, turn, swivel, here_q, here_qdot)


@njit(cache=True, nogil=True)
def elbow_search(face: Face, start: Array, limits: JointBounds, weights: Array, grid: int, arm: ElbowArm, chain: Chain) -> BestPosture:
    """Search for the posture and joint speeds with the lowest cost: on a grid over both freedoms, then by a compass search.

    Args:
        face: Wanted position, rotation and velocity of the racket's face.
        start: (3, 7) joint positions (rad) and speeds (rad/s) from which the arm starts, and joint positions of the waiting posture.
        limits: (7,) limits of the joints.
        weights: (6,) the fields of `PostureWeights`.
        grid: Number of values of each freedom on the grid.
        arm: Geometry of the arm for the closed form.
        chain: Geometry of the arm.

    Returns:
        The best posture; its cost is inf if none was found.
    """
    task = PostureTask(face.velocity, joint_tasks(start, limits), posture_weights(weights))
    wanted = WantedFace(face.position, face.rotation, np.empty((3, 3)), np.empty((7, 2)), np.empty((7, 2)))
    scratch = cost_scratch(7)
    elbow = Elbow(wanted, task, arm, chain, scratch)
    costs, least, step = np.empty((grid, grid)), math.inf, 2.0 * math.pi / grid
    q, qdot = np.empty(7), np.empty(7)
    for n in range(grid * grid):
        at = SCATTERED * n % (grid * grid)
        i, j = at // grid, at % grid
        costs[i, j] = _posture(Freedoms(i * step, j * step), wanted, task, arm, chain, scratch, least + REFINED_EXCESS, Posture(q, qdot))
        least = min(least, costs[i, j])
    best = RefinedPosture(math.inf, math.inf, math.inf, start[0].copy(), np.zeros(7))
    for _ in range(REFINED_POSTURES):
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
