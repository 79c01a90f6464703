"""Kernels of the search among all postures for a stroke.

Two freedoms, the racket's turn about its normal and the elbow's swivel angle, give a posture in closed form. The search takes the
best points of a grid over both and refines them. The cost of a posture is bounded from below in steps, the cheapest first, and a posture is
given up as soon as it cannot be the best.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.states import Array

from ..joints import JointBounds
from ..kinematics import Chain, forward_into, inverse
from ..trajectory.profiles import largest_end_speed, least_time, least_time_to_rest
from .velocity_allocation import least_shares, least_shares_steady, steady_rows_into

LIMIT_COST = 20.0  # per rad beyond the room kept from a position limit
LATE_COST = 5.0  # for each of the times below that is too short
LATER = (1.0, 1.1, 1.4, 2.0, 3.0, 1e3)  # times the swing time; the last one asks what the joints can do at all
SCATTERED = 173  # stride through the grid, to meet a good posture early: a prime that is larger than any grid
STARTS = 2  # postures of the grid that are refined
CLOSE = 3.0  # cost above the best of the grid, up to which a posture may still be refined to a better one
STEEP = 8.0  # per rad of the step: a start that costs more than this above the best is given up
MOST_STEPS = 1000  # of one descent, which takes about 30
STEP_LEAST = 0.01  # rad, where the refinement ends
UNRESOLVED = 1e-6  # m/s, by which the joint speeds may miss the velocity; more is a singular posture
ONES = np.ones(7)
DIRECTIONS = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))


class PostureWeights(NamedTuple):
    """What the cost of a posture weighs, see `ReachParams`. From Python it is passed as an array in this order."""

    swing_time: float  # s
    affordable: float
    turning: float  # s/rad
    margin: float  # rad
    back: float  # 1/s
    hold: float  # s


JointTasks = npt.NDArray[np.void]  # (7,) of JOINT_TASK, a row for each joint
JOINT_TASK = np.dtype(
    [
        ("start", np.float64),  # rad, where the joint comes from
        ("start_speed", np.float64),  # rad/s
        ("waiting", np.float64),  # rad, where it goes afterwards
        ("low", np.float64),  # rad, limits
        ("high", np.float64),  # rad
        ("speed", np.float64),  # rad/s, both ways
        ("acceleration", np.float64),  # rad/s^2, both ways
    ]
)


class PostureTask(NamedTuple):
    """What is asked of a posture."""

    position: Array  # (3,) m, face centre
    rotation: Array  # (3, 3) of the racket; its turn about z is free
    velocity: Array  # (3,) m/s, of the face centre
    joints: JointTasks
    weights: PostureWeights


class BestPosture(NamedTuple):
    """The result of the search."""

    cost: float  # inf if there is no posture
    q: Array  # (7,) rad
    qdot: Array  # (7,) rad/s


class RefinedPosture(NamedTuple):
    """Where a descent has ended."""

    cost: float
    turn: float  # rad, of the racket about its normal
    swivel: float  # rad, of the elbow
    q: Array  # (7,) rad
    qdot: Array  # (7,) rad/s


class SpeedRange(NamedTuple):
    """Whether the joints can be at the posture in a time, and how soon they are back."""

    in_time: bool
    back: float  # s


class Scratch(NamedTuple):
    """Working memory of a search."""

    turned: Array  # (3, 3) rotation of the racket
    point: Array  # (3,) face centre
    jacobian: Array  # (6, 7)
    rows: Array  # (5, 7) of `steady_rows`, for joint speeds in rad/s
    scaled: Array  # (5, 7) the same for shares of the possible range of speeds
    middle: Array  # (7,) rad/s, middle of that range
    half: Array  # (7,) rad/s, half of its width
    wanted: Array  # (5,) what the rows are to give beside `middle`
    shares: Array  # (7,) of the range, the least ones
    steady: Array  # (7,) of the range, those that keep the face still
    mixed: Array  # (7,) rad/s


@njit(cache=True)
def _scratch() -> Scratch:
    return Scratch(
        np.empty((3, 3)), np.empty(3), np.empty((6, 7)), np.empty((5, 7)), np.empty((5, 7)),
        np.empty(7), np.empty(7), np.empty(5), np.empty(7), np.empty(7), np.empty(7),
    )  # fmt: skip


@njit(cache=True)
def _weights(row: Array) -> PostureWeights:
    """Return the weights by name, from an array in their order."""
    return PostureWeights(row[0], row[1], row[2], row[3], row[4], row[5])


@njit(cache=True)
def _joint_tasks(start: Array, limits: JointBounds) -> JointTasks:
    """Return what is asked of each joint; start (3, 7): q (rad) and qdot (rad/s) at the start, and q where the arm waits."""
    joints = np.empty(7, JOINT_TASK)
    for i in range(7):
        joint, bound = joints[i], limits[i]
        joint.start, joint.start_speed, joint.waiting = start[0, i], start[1, i], start[2, i]
        joint.low, joint.high, joint.speed, joint.acceleration = bound.low, bound.high, bound.speed, bound.acceleration
    return joints


@njit(cache=True)
def turning_rate(rows: Array, qdot: Array) -> float:
    """Return the rate (rad/s) at which the face normal turns, for rows (5, 7) of `steady_rows` and qdot (7,) in their unit."""
    x = y = 0.0
    for i in range(7):
        x += rows[3, i] * qdot[i]
        y += rows[4, i] * qdot[i]
    return math.hypot(x, y)


@njit(cache=True)
def _nearest_turn(q: float, start: float, low: float, high: float) -> float:
    """Return the same angle (rad) at the turn nearest to the start, or at the next turn if only that is within the limits."""
    q += 2.0 * math.pi * round((start - q) / (2.0 * math.pi))
    if not low <= q <= high:
        for other in (q - 2.0 * math.pi, q + 2.0 * math.pi):
            if low < other < high:
                return other
    return q


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
            angle = _nearest_turn(angle, joint.start, joint.low, joint.high)
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


@njit(cache=True)
def _limit_cost(q: Array, qdot: Array, joints: JointTasks, margin: float, hold: float) -> float:
    """Return the cost of joints without room to brake before a position limit, at once or after holding their speed for `hold` (s)."""
    cost = 0.0
    for i in range(7):
        joint = joints[i]
        room = min(qdot[i] ** 2 / (2.0 * joint.acceleration), 0.2 * (joint.high - joint.low)) + margin
        cost += LIMIT_COST * max(0.0, joint.low + room - q[i], q[i] - joint.high + room)
        stop = q[i] + hold * qdot[i] + 0.5 * qdot[i] * abs(qdot[i]) / joint.acceleration
        cost += LIMIT_COST * max(0.0, joint.low - stop, stop - joint.high)
    return cost


@njit(cache=True)
def _largest(shares: Array) -> float:
    most = 0.0
    for i in range(7):
        most = max(most, abs(shares[i]))
    return most


@njit(cache=True, inline="always")
def _hold_face_still(scratch: Scratch, affordable: float) -> bool:
    """Fill `scratch.steady` with the shares that keep the face as still as `affordable` allows; the face centre moves alike.

    Returns:
        Whether there are any.
    """
    shares, steady = scratch.shares, scratch.steady
    if _largest(shares) > affordable or least_shares_steady(scratch.scaled, scratch.wanted, steady) == math.inf:
        return False
    part = 1.0
    for i in range(7):
        step = steady[i] - shares[i]
        if abs(steady[i]) > affordable:
            part = min(part, (math.copysign(affordable, step) - shares[i]) / step)
    for i in range(7):
        steady[i] = shares[i] + part * (steady[i] - shares[i])
    return True


@njit(cache=True, inline="always")
def _place(turn: float, swivel: float, task: PostureTask, chain: Chain, q: Array, turned: Array) -> float:
    """Fill q (7,) with the posture for both freedoms.

    Returns:
        The time (s) to it at full speed; inf if it is out of reach.
    """
    c, s = math.cos(turn), math.sin(turn)
    rotation = task.rotation
    for k in range(3):
        turned[k, 0], turned[k, 1] = c * rotation[k, 0] + s * rotation[k, 1], c * rotation[k, 1] - s * rotation[k, 0]
        turned[k, 2] = rotation[k, 2]
    if not inverse(task.position, turned, swivel, chain, q):
        return math.inf
    return _choose_branch(q, task.joints)


@njit(cache=True, inline="always")
def _least_time_back(q: Array, task: PostureTask) -> float:
    """Return the least time (s) from the posture to waiting, with whatever joint speeds are best."""
    joints, back = task.joints, 0.0
    for i in range(7):
        joint = joints[i]
        back = max(back, least_time_to_rest(abs(joint.waiting - q[i]), joint.speed, joint.acceleration))
    return back


@njit(cache=True, inline="always")
def _speed_range(time: float, q: Array, task: PostureTask, scratch: Scratch) -> SpeedRange:
    """Fill middle and half width of the joint speeds that are possible at the posture in `time` (s).

    The returned time back is a lower bound: each joint takes the speed of its range that has it back soonest.
    """
    joints = task.joints
    middle, half, in_time, back = scratch.middle, scratch.half, True, 0.0
    for i in range(7):
        joint = joints[i]
        way, home, speed, acceleration = q[i] - joint.start, joint.waiting - q[i], joint.speed, joint.acceleration
        high = largest_end_speed(time, way, joint.start_speed, speed, acceleration)
        low = -largest_end_speed(time, -way, -joint.start_speed, speed, acceleration)
        middle[i], half[i], in_time = 0.5 * (high + low), 0.5 * (high - low), in_time and high > low
        ideal = math.copysign(min(speed, math.sqrt(2.0 * acceleration * abs(home))), home)
        back = max(back, least_time(home, max(low, min(high, ideal)), 0.0, speed, acceleration))
    return SpeedRange(in_time, back)


@njit(cache=True, inline="always")
def _scale_rows(velocity: Array, scratch: Scratch) -> None:
    """Express the wanted velocity, with a still face, in shares of the possible range of joint speeds."""
    rows, scaled, middle, half, wanted = scratch.rows, scratch.scaled, scratch.middle, scratch.half, scratch.wanted
    for k in range(5):
        wanted[k] = velocity[k] if k < 3 else 0.0
        for i in range(7):
            wanted[k] -= rows[k, i] * middle[i]
            scaled[k, i] = rows[k, i] * half[i]


@njit(cache=True, inline="always")
def _cheaper_speeds(least: float, late_cost: float, q: Array, qdot: Array, task: PostureTask, bound: float, scratch: Scratch) -> float:
    """Fill qdot (7,) with the cheaper of two joint speeds: the least ones, or those that keep the face still.

    Args:
        least: Lower bound of the cost without that of the speeds.
        late_cost: Cost of being late.
        q: (7,) rad, the posture.
        qdot: (7,) rad/s; filled if the result is not inf.
        task: What is asked.
        bound: Cost that a posture must stay below.
        scratch: With rows, range of speeds and least shares.

    Returns:
        The cost; inf if the posture is singular.
    """
    joints, weights, velocity = task.joints, task.weights, task.velocity
    rows, middle, half, mixed, shares, steady = scratch.rows, scratch.middle, scratch.half, scratch.mixed, scratch.shares, scratch.steady
    best = math.inf
    for still in (False, True):
        if still and (least + _largest(shares) >= min(best, bound) or not _hold_face_still(scratch, weights.affordable)):
            break
        given, back = steady if still else shares, 0.0
        for i in range(7):
            mixed[i] = middle[i] + half[i] * given[i]
            back = max(back, least_time(joints[i].waiting - q[i], mixed[i], 0.0, joints[i].speed, joints[i].acceleration))
        for k in range(3):
            missing = velocity[k]
            for i in range(7):
                missing -= rows[k, i] * mixed[i]
            if abs(missing) > UNRESOLVED:
                return best
        cost = late_cost + weights.back * back + _largest(given) + weights.turning * turning_rate(rows, mixed)
        cost += _limit_cost(q, mixed, joints, weights.margin, weights.hold)
        if cost < best:
            best = cost
            qdot[:] = mixed
    return best


@njit(cache=True)
def _posture(turn: float, swivel: float, task: PostureTask, chain: Chain, bound: float, q: Array, qdot: Array, scratch: Scratch) -> float:
    """Fill q (7,) rad and qdot (7,) rad/s of the best posture for both freedoms.

    Args:
        turn: rad, of the racket about its normal.
        swivel: rad, of the elbow.
        task: What is asked.
        chain: The geometry.
        bound: Cost that the posture must stay below.
        q: (7,) rad; filled.
        qdot: (7,) rad/s; filled.
        scratch: Working memory.

    Returns:
        The cost; inf as soon as it is known to reach `bound`, or if there is no such posture.
    """
    weights, turned = task.weights, scratch.turned
    nearest = _place(turn, swivel, task, chain, q, turned)
    if nearest == math.inf:
        return math.inf
    qdot[:] = 0.0
    least, late = _limit_cost(q, qdot, task.joints, weights.margin, weights.hold), 0
    while weights.swing_time * LATER[late] < nearest:
        late += 1
    if least + LATE_COST * late + weights.back * _least_time_back(q, task) >= bound:
        return math.inf
    known = False
    while True:  # until the joint speeds that are possible at the strike give the velocity
        last = late + 1 == len(LATER)
        in_time, back = _speed_range(weights.swing_time * LATER[late], q, task, scratch)
        if not in_time or last:
            back = 0.0
        if least + LATE_COST * late + weights.back * back >= bound:
            return math.inf
        if in_time:
            if not known:
                forward_into(q, chain, scratch.point, turned, scratch.jacobian)
                steady_rows_into(scratch.jacobian, turned, ONES, scratch.rows)
                known = True
            _scale_rows(task.velocity, scratch)
            if least_shares(scratch.scaled, scratch.wanted, scratch.shares, math.inf if last else 1.0) < math.inf:
                break
        late += 1
        if last:
            return math.inf
    least += LATE_COST * late + weights.back * back
    if least + _largest(scratch.shares) >= bound:
        return math.inf
    return _cheaper_speeds(least, LATE_COST * late, q, qdot, task, bound, scratch)


@njit(cache=True)
def _descend(
    turn: float, swivel: float, size: float, task: PostureTask, chain: Chain, best: RefinedPosture, scratch: Scratch
) -> RefinedPosture:
    """Refine a posture by a compass search with steps that halve.

    Args:
        turn: rad, of the racket, where it starts.
        swivel: rad, of the elbow, where it starts.
        size: rad, the first step.
        task: What is asked.
        chain: The geometry.
        best: The best refined posture so far. The search ends where that one was found, and when it cannot become better.
        scratch: Working memory.
    """
    here_q, here_qdot, q, qdot = np.empty(7), np.empty(7), np.empty(7), np.empty(7)
    here = _posture(turn, swivel, task, chain, math.inf, here_q, here_qdot, scratch)
    for _ in range(MOST_STEPS):
        if size <= STEP_LEAST:
            break
        moved = False
        for du, dv in DIRECTIONS:
            u, v = turn + du * size, swivel + dv * size
            cost = _posture(u, v, task, chain, here, q, qdot, scratch)
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
def search(
    position: Array, rotation: Array, velocity: Array, start: Array, limits: JointBounds, weights: Array, grid: int, chain: Chain
) -> BestPosture:
    """Search the best posture: a grid over both freedoms, then a compass search from its best points.

    Args:
        position: (3,) m, face centre.
        rotation: (3, 3) of the racket; its turn about z is free.
        velocity: (3,) m/s, of the face centre.
        start: (3, 7) q (rad) and qdot (rad/s) where the arm comes from, and q where it waits.
        limits: Of the joints.
        weights: (6,) of `PostureWeights`.
        grid: Values of each freedom.
        chain: The geometry.
    """
    task = PostureTask(position, rotation, velocity, _joint_tasks(start, limits), _weights(weights))
    costs, least, step, scratch = np.empty((grid, grid)), math.inf, 2.0 * math.pi / grid, _scratch()
    q, qdot = np.empty(7), np.empty(7)
    for n in range(grid * grid):
        at = SCATTERED * n % (grid * grid)
        i, j = at // grid, at % grid
        costs[i, j] = _posture(i * step, j * step, task, chain, least + CLOSE, q, qdot, scratch)
        least = min(least, costs[i, j])
    best = RefinedPosture(math.inf, math.inf, math.inf, start[0].copy(), np.zeros(7))
    for _ in range(STARTS):
        at = int(np.argmin(costs))
        i, j = at // grid, at % grid
        if costs[i, j] == math.inf:
            break
        refined = _descend(i * step, j * step, 0.5 * step, task, chain, best, scratch)
        if refined.cost < best.cost:
            best = refined
        for di in range(-1, 2):
            for dj in range(-1, 2):
                costs[(i + di) % grid, (j + dj) % grid] = math.inf
    return BestPosture(best.cost, best.q, best.qdot)
