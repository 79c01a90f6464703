"""Kernels of the cost of a posture for a stroke, and of the joint speeds that make it least.

The cost of a posture is bounded from below in steps, the cheapest first, and a posture is given up as soon as it cannot be the best.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.states import Array

from ..joints import JointBounds
from ..kinematics import Chain, forward_into
from ..trajectory.profiles import largest_end_speed, least_time, least_time_to_rest
from .velocity_allocation import ONES, least_shares, least_shares_steady, steady_rows_into

LIMIT_COST = 20.0  # per rad or m beyond the room kept from a position limit
LATE_COST = 5.0  # for each of the times below that is too short
LATER = (1.0, 1.1, 1.4, 2.0, 3.0, 1e3)  # times the swing time; the last one asks what the joints can do at all
TOO_FAST_COST = 50.0  # for each share of the speed limits above 1
UNRESOLVED = 1e-6  # m/s, by which the joint speeds may miss the velocity; more is a singular posture


class PostureWeights(NamedTuple):
    """What the cost of a posture weighs, see `ReachParams`. From Python it is passed as an array in this order.

    A joint's rad stand for m where it is linear, here and below.
    """

    swing_time: float  # s
    affordable: float
    turning: float  # s/rad
    margin: float  # rad
    back: float  # 1/s
    hold: float  # s


JointTasks = npt.NDArray[np.void]  # (n,) of JOINT_TASK, a row for each joint
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

    velocity: Array  # (3,) m/s, of the face centre
    joints: JointTasks
    weights: PostureWeights


class BestPosture(NamedTuple):
    """The result of a search."""

    cost: float  # inf if there is no posture
    q: Array  # (n,) rad or m
    qdot: Array  # (n,) rad/s or m/s


class SpeedRange(NamedTuple):
    """Whether the joints can be at the posture in a time, and how soon they are back."""

    in_time: bool
    back: float  # s


class Scratch(NamedTuple):
    """Working memory of a search."""

    point: Array  # (3,) face centre
    turned: Array  # (3, 3) rotation of the racket
    jacobian: Array  # (6, n)
    rows: Array  # (5, n) of `steady_rows`, for joint speeds
    scaled: Array  # (5, n) the same for shares of the possible range of speeds
    middle: Array  # (n,) rad/s, middle of that range
    half: Array  # (n,) rad/s, half of its width
    wanted: Array  # (5,) what the rows are to give beside `middle`
    shares: Array  # (n,) of the range, the least ones
    steady: Array  # (n,) of the range, those that keep the face still
    mixed: Array  # (n,) rad/s


@njit(cache=True)
def cost_scratch(n: int) -> Scratch:
    """Return working memory for n joints."""
    return Scratch(
        np.empty(3), np.empty((3, 3)), np.empty((6, n)), np.empty((5, n)), np.empty((5, n)),
        np.empty(n), np.empty(n), np.empty(5), np.empty(n), np.empty(n), np.empty(n),
    )  # fmt: skip


@njit(cache=True)
def posture_weights(row: Array) -> PostureWeights:
    """Return the weights by name, from an array in their order."""
    return PostureWeights(row[0], row[1], row[2], row[3], row[4], row[5])


@njit(cache=True)
def joint_tasks(start: Array, limits: JointBounds) -> JointTasks:
    """Return what is asked of each joint; start (3, n): q (rad) and qdot (rad/s) at the start, and q where the arm waits."""
    joints = np.empty(len(limits), JOINT_TASK)
    for i in range(len(limits)):
        joint, bound = joints[i], limits[i]
        joint.start, joint.start_speed, joint.waiting = start[0, i], start[1, i], start[2, i]
        joint.low, joint.high, joint.speed, joint.acceleration = bound.low, bound.high, bound.speed, bound.acceleration
    return joints


@njit(cache=True)
def turning_rate(rows: Array, qdot: Array) -> float:
    """Return the rate (rad/s) at which the face normal turns, for rows (5, n) of `steady_rows` and qdot (n,) in their unit."""
    x = y = 0.0
    for i in range(len(qdot)):
        x += rows[3, i] * qdot[i]
        y += rows[4, i] * qdot[i]
    return math.hypot(x, y)


@njit(cache=True)
def nearest_turn(q: float, start: float, low: float, high: float) -> float:
    """Return the same angle (rad) at the turn nearest to the start, or at the next turn if only that is within the limits."""
    q += 2.0 * math.pi * round((start - q) / (2.0 * math.pi))
    if not low <= q <= high:
        for other in (q - 2.0 * math.pi, q + 2.0 * math.pi):
            if low < other < high:
                return other
    return q


@njit(cache=True, inline="always")
def _limit_cost(n: int, q: Array, qdot: Array, joints: JointTasks, margin: float, hold: float) -> float:
    """Return the cost of joints without room to brake before a position limit, at once or after holding their speed for `hold` (s)."""
    cost = 0.0
    for i in range(n):
        joint = joints[i]
        room = min(qdot[i] ** 2 / (2.0 * joint.acceleration), 0.2 * (joint.high - joint.low)) + margin
        cost += LIMIT_COST * max(0.0, joint.low + room - q[i], q[i] - joint.high + room)
        stop = q[i] + hold * qdot[i] + 0.5 * qdot[i] * abs(qdot[i]) / joint.acceleration
        cost += LIMIT_COST * max(0.0, joint.low - stop, stop - joint.high)
    return cost


@njit(cache=True, inline="always")
def _largest(n: int, shares: Array) -> float:
    most = 0.0
    for i in range(n):
        most = max(most, abs(shares[i]))
    return most


@njit(cache=True, inline="always")
def _hold_face_still(n: int, scratch: Scratch, affordable: float) -> bool:
    """Fill `scratch.steady` with the shares that keep the face as still as `affordable` allows; the face centre moves alike.

    Returns:
        Whether there are any.
    """
    shares, steady = scratch.shares, scratch.steady
    if _largest(n, shares) > affordable or least_shares_steady(scratch.scaled, scratch.wanted, steady) == math.inf:
        return False
    part = 1.0
    for i in range(n):
        step = steady[i] - shares[i]
        if abs(steady[i]) > affordable:
            part = min(part, (math.copysign(affordable, step) - shares[i]) / step)
    for i in range(n):
        steady[i] = shares[i] + part * (steady[i] - shares[i])
    return True


@njit(cache=True, inline="always")
def _least_time_back(n: int, q: Array, task: PostureTask) -> float:
    """Return the least time (s) from the posture to waiting, with whatever joint speeds are best."""
    joints, back = task.joints, 0.0
    for i in range(n):
        joint = joints[i]
        back = max(back, least_time_to_rest(abs(joint.waiting - q[i]), joint.speed, joint.acceleration))
    return back


@njit(cache=True, inline="always")
def _speed_range(n: int, time: float, q: Array, task: PostureTask, scratch: Scratch) -> SpeedRange:
    """Fill middle and half width of the joint speeds that are possible at the posture in `time` (s).

    The returned time back is a lower bound: each joint takes the speed of its range that has it back soonest.
    """
    joints = task.joints
    middle, half, in_time, back = scratch.middle, scratch.half, True, 0.0
    for i in range(n):
        joint = joints[i]
        way, home, speed, acceleration = q[i] - joint.start, joint.waiting - q[i], joint.speed, joint.acceleration
        high = largest_end_speed(time, way, joint.start_speed, speed, acceleration)
        low = -largest_end_speed(time, -way, -joint.start_speed, speed, acceleration)
        middle[i], half[i], in_time = 0.5 * (high + low), 0.5 * (high - low), in_time and high > low
        ideal = math.copysign(min(speed, math.sqrt(2.0 * acceleration * abs(home))), home)
        back = max(back, least_time(home, max(low, min(high, ideal)), 0.0, speed, acceleration))
    return SpeedRange(in_time, back)


@njit(cache=True, inline="always")
def _scale_rows(n: int, velocity: Array, scratch: Scratch) -> None:
    """Express the wanted velocity, with a still face, in shares of the possible range of joint speeds."""
    rows, scaled, middle, half, wanted = scratch.rows, scratch.scaled, scratch.middle, scratch.half, scratch.wanted
    for k in range(5):
        wanted[k] = velocity[k] if k < 3 else 0.0
        for i in range(n):
            wanted[k] -= rows[k, i] * middle[i]
            scaled[k, i] = rows[k, i] * half[i]


@njit(cache=True, inline="always")
def _cheaper_speeds(
    n: int, least: float, late_cost: float, q: Array, qdot: Array, task: PostureTask, bound: float, scratch: Scratch
) -> float:
    """Fill qdot (n,) with the cheaper of two joint speeds: the least ones, or those that keep the face still.

    Args:
        n: Count of the joints.
        least: Lower bound of the cost without that of the speeds.
        late_cost: Cost of being late.
        q: (n,) rad, the posture.
        qdot: (n,) rad/s; filled if the result is not inf.
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
        if still and (least + _largest(n, shares) >= min(best, bound) or not _hold_face_still(n, scratch, weights.affordable)):
            break
        given, back = steady if still else shares, 0.0
        for i in range(n):
            mixed[i] = middle[i] + half[i] * given[i]
            back = max(back, least_time(joints[i].waiting - q[i], mixed[i], 0.0, joints[i].speed, joints[i].acceleration))
        for k in range(3):
            missing = velocity[k]
            for i in range(n):
                missing -= rows[k, i] * mixed[i]
            if abs(missing) > UNRESOLVED:
                return best
        cost = late_cost + weights.back * back + _largest(n, given) + weights.turning * turning_rate(rows, mixed)
        cost += TOO_FAST_COST * max(0.0, _largest(n, given) - 1.0)
        cost += _limit_cost(n, q, mixed, joints, weights.margin, weights.hold)
        if cost < best:
            best = cost
            qdot[:] = mixed
    return best


@njit(cache=True)
def time_to(q: Array, joints: JointTasks) -> float:
    """Return the time (s) from the start to a posture at full speed; inf if it is beyond a position limit."""
    longest = 0.0
    for i in range(len(q)):
        joint = joints[i]
        if not joint.low <= q[i] <= joint.high:
            return math.inf
        longest = max(longest, abs(q[i] - joint.start) / joint.speed)
    return longest


class PostureQuestion(NamedTuple):
    """What is asked of one posture."""

    nearest: float  # s, of `time_to`
    bound: float  # cost that the posture must stay below
    known: bool  # whether the rows of the working memory are already those of the posture


@njit(cache=True, inline="always")
def cost_of_joints(n: int, q: Array, question: PostureQuestion, task: PostureTask, chain: Chain, qdot: Array, scratch: Scratch) -> float:
    """Fill the best joint speeds qdot (n,) at a posture.

    Args:
        n: Count of the joints; a constant lets the compiler unroll the loops.
        q: (n,) rad or m, the posture.
        question: What is asked.
        task: What is asked of every posture.
        chain: The geometry.
        qdot: (n,) rad/s or m/s; filled.
        scratch: Working memory.

    Returns:
        The cost; inf as soon as it is known to reach the bound, or if the posture cannot give the velocity.
    """
    nearest, bound, known = question
    weights, late = task.weights, 0
    qdot[:] = 0.0
    least = _limit_cost(n, q, qdot, task.joints, weights.margin, weights.hold)
    while weights.swing_time * LATER[late] < nearest:
        late += 1
    if least + LATE_COST * late + weights.back * _least_time_back(n, q, task) >= bound:
        return math.inf
    while True:  # until the joint speeds that are possible at the strike give the velocity
        last = late + 1 == len(LATER)
        in_time, back = _speed_range(n, weights.swing_time * LATER[late], q, task, scratch)
        if not in_time or last:
            back = 0.0
        if least + LATE_COST * late + weights.back * back >= bound:
            return math.inf
        if in_time:
            if not known:
                forward_into(q, chain, scratch.point, scratch.turned, scratch.jacobian)
                steady_rows_into(scratch.jacobian, scratch.turned, ONES, scratch.rows)
                known = True
            _scale_rows(n, task.velocity, scratch)
            if least_shares(scratch.scaled, scratch.wanted, scratch.shares, math.inf if last else 1.0) < math.inf:
                break
        late += 1
        if last:
            return math.inf
    least += LATE_COST * late + weights.back * back
    least += TOO_FAST_COST * max(0.0, _largest(n, scratch.shares) - 1.0)
    if least + _largest(n, scratch.shares) >= bound:
        return math.inf
    return _cheaper_speeds(n, least, LATE_COST * late, q, qdot, task, bound, scratch)
