"""Cost of a posture for a stroke, and the joint speeds with which it is least.

Lower bounds of the cost are computed in steps, beginning with the one that takes the least computing time. A posture is given up as soon as
a bound shows that it cannot be the best.
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

LIMIT_COST = 20.0  # per rad or m by which a joint comes nearer to its position limit than it should
LATE_COST = 5.0  # for each of the times of LATER that is too short
LATER = (1.0, 1.1, 1.4, 2.0, 3.0, 1e3)  # multiples of the swing time; with the last one, only the speed limits count
TOO_FAST_COST = 50.0  # per 1 by which the largest share of the possible joint speeds exceeds 1
REFINED_POSTURES = 2  # number of the found postures that are refined
REFINED_EXCESS = 3.0  # largest excess over the lowest cost found with which a posture may still be refined to the best one
STEEPEST_COST = 8.0  # 1/rad; a refinement whose cost exceeds the best by more than this times its step is given up
UNRESOLVED = 1e-6  # m/s, largest error of the velocity that joint speeds may leave; a posture with a larger one is singular


class PostureWeights(NamedTuple):
    """Weights of the cost of a posture, from ReachParams. Python code passes them as an array (6,) in this order.

    The unit rad of a joint stands for m if the joint is linear, here and below.

    Attributes:
        swing_time: s, time from the start to the strike.
        affordable: Share of the possible joint speeds that may be used to keep the face from turning, 0 to 1.
        turning: s/rad, cost of the rate at which the face normal turns.
        margin: rad, distance of a posture from the position limits, in addition to the distance for braking.
        back: 1/s, cost of the time from the strike until the arm waits again.
        hold: s, time for which a joint may keep its speed before it brakes.
    """

    swing_time: float
    affordable: float
    turning: float
    margin: float
    back: float
    hold: float


JointTasks = npt.NDArray[np.void]  # (n,) of JOINT_TASK, a row for each joint
JOINT_TASK = np.dtype(
    [
        ("start", np.float64),  # rad, position from which the joint starts
        ("start_speed", np.float64),  # rad/s
        ("waiting", np.float64),  # rad, position of the waiting posture, to which it returns
        ("low", np.float64),  # rad, limits
        ("high", np.float64),  # rad
        ("speed", np.float64),  # rad/s, both ways
        ("acceleration", np.float64),  # rad/s^2, both ways
    ]
)


class PostureTask(NamedTuple):
    """Data that the cost of each posture of a search depends on.

    Attributes:
        velocity: (3,) m/s in `table`, wanted velocity of the racket's face centre.
        joints: (n,) start, waiting position and limits of each joint.
        weights: Weights of the cost.
    """

    velocity: Array
    joints: JointTasks
    weights: PostureWeights


class BestPosture(NamedTuple):
    """Result of a posture search.

    Attributes:
        cost: Cost of the best posture; inf if none was found.
        q: (n,) rad or m, joint positions; those of the start if none was found.
        qdot: (n,) rad/s or m/s, joint speeds; zero if none was found.
    """

    cost: float
    q: Array
    qdot: Array


class SpeedRange(NamedTuple):
    """Whether all joints can reach a posture in a given time, and how long the return takes at least.

    Attributes:
        in_time: Whether all joints can be at the posture in this time.
        back: s, lower bound of the time from the posture back to the waiting posture.
    """

    in_time: bool
    back: float


class CostScratch(NamedTuple):
    """Scratch memory for the cost of a posture.

    A "share" is a joint speed's difference from the middle of the joint's possible range of speeds, over half of the width of this range.

    Attributes:
        point: (3,) m, centre of the racket's face.
        turned: (3, 3) rotation from racket to `table`.
        jacobian: (6, n) Jacobian of the racket.
        rows: (5, n) matrix from joint speeds to velocity and turning of the face, see `steady_rows`.
        scaled: (5, n) the same matrix for shares.
        middle: (n,) rad/s, middle of each joint's possible range of speeds.
        half: (n,) rad/s, half of the width of this range.
        wanted: (5,) velocity (m/s) and turning (rad/s) of the face that the shares must give in addition to the speeds `middle`.
        shares: (n,) shares with the least maximum.
        steady: (n,) shares that keep the face from turning.
        mixed: (n,) rad/s, joint speeds.
    """

    point: Array
    turned: Array
    jacobian: Array
    rows: Array
    scaled: Array
    middle: Array
    half: Array
    wanted: Array
    shares: Array
    steady: Array
    mixed: Array


@njit(cache=True)
def cost_scratch(n: int) -> CostScratch:
    """Return scratch memory for the cost of a posture of an arm with n joints."""
    return CostScratch(
        np.empty(3), np.empty((3, 3)), np.empty((6, n)), np.empty((5, n)), np.empty((5, n)),
        np.empty(n), np.empty(n), np.empty(5), np.empty(n), np.empty(n), np.empty(n),
    )  # fmt: skip


@njit(cache=True)
def posture_weights(row: Array) -> PostureWeights:
    """Return the weights of an array (6,) as a NamedTuple."""
    return PostureWeights(row[0], row[1], row[2], row[3], row[4], row[5])


@njit(cache=True)
def joint_tasks(start: Array, limits: JointBounds) -> JointTasks:
    """Return start, waiting position and limits of each joint as a structured array (n,) of JOINT_TASK.

    Args:
        start: (3, n) joint positions (rad) and speeds (rad/s) from which the arm starts, and joint positions (rad) of the waiting posture.
        limits: (n,) limits of the joints.
    """
    joints = np.empty(len(limits), JOINT_TASK)
    for i in range(len(limits)):
        joint, bound = joints[i], limits[i]
        joint.start, joint.start_speed, joint.waiting = start[0, i], start[1, i], start[2, i]
        joint.low, joint.high, joint.speed, joint.acceleration = bound.low, bound.high, bound.speed, bound.acceleration
    return joints


@njit(cache=True)
def turning_rate(rows: Array, qdot: Array) -> float:
    """Return the rate (rad/s) at which the normal of the racket's face turns.

    Args:
        rows: (5, n) matrix of `steady_rows`.
        qdot: (n,) joint speeds (rad/s), or shares of the speed limits if `rows` is for these.
    """
    x = y = 0.0
    for i in range(len(qdot)):
        x += rows[3, i] * qdot[i]
        y += rows[4, i] * qdot[i]
    return math.hypot(x, y)


@njit(cache=True)
def nearest_turn(q: float, start: float, low: float, high: float) -> float:
    """Return the angle that differs from q by whole turns and is nearest to the start.

    If it is outside the limits and the angle one turn beside it is inside, that one is returned.

    Args:
        q: rad, angle of a joint.
        start: rad, angle from which the joint starts.
        low: rad, lower position limit.
        high: rad, upper position limit.
    """
    q += 2.0 * math.pi * round((start - q) / (2.0 * math.pi))
    if not low <= q <= high:
        for other in (q - 2.0 * math.pi, q + 2.0 * math.pi):
            if low < other < high:
                return other
    return q


@njit(cache=True, inline="always")
def _limit_cost(n: int, q: Array, qdot: Array, joints: JointTasks, margin: float, hold: float) -> float:
    """Return the cost of joints that cannot brake before their position limit, at once or after keeping their speed for `hold` (s)."""
    cost = 0.0
    for i in range(n):
        joint = joints[i]
        room = min(qdot[i] ** 2 / (2.0 * joint.acceleration), 0.2 * (joint.high - joint.low)) + margin
        cost += LIMIT_COST * max(0.0, joint.low + room - q[i], q[i] - joint.high + room)
        stop = q[i] + hold * qdot[i] + 0.5 * qdot[i] * abs(qdot[i]) / joint.acceleration
        cost += LIMIT_COST * max(0.0, joint.low - stop, stop - joint.high)
    return cost


@njit(cache=True, inline="always")
def _least_limit_cost(n: int, q: Array, joints: JointTasks, margin: float) -> float:
    """Return the `_limit_cost` of joints at rest within their limits, which is the least for all joint speeds."""
    cost = 0.0
    for i in range(n):
        joint = joints[i]
        cost += LIMIT_COST * max(0.0, joint.low + margin - q[i], q[i] - joint.high + margin)
    return cost


@njit(cache=True, inline="always")
def _largest(n: int, shares: Array) -> float:
    most = 0.0
    for i in range(n):
        most = max(most, abs(shares[i]))
    return most


@njit(cache=True, inline="always")
def _hold_face_still(n: int, scratch: CostScratch, affordable: float) -> bool:
    """Fill `scratch.steady` with shares that turn the face as little as `affordable` permits, with the same velocity of the face centre.

    Returns:
        Whether there are such shares.
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
    """Return the least time (s) from the posture to the waiting posture, with the best possible joint speeds at the start."""
    joints, back = task.joints, 0.0
    for i in range(n):
        joint = joints[i]
        back = max(back, least_time_to_rest(abs(joint.waiting - q[i]), joint.speed, joint.acceleration))
    return back


@njit(cache=True, inline="always")
def _speed_range(n: int, time: float, q: Array, task: PostureTask, scratch: CostScratch) -> SpeedRange:
    """Fill middle and half width of the ranges of joint speeds that are possible if the arm reaches the posture in `time` (s).

    The returned time of the return is a lower bound: it assumes that each joint has the speed of its range with which it is back soonest.
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
def _scale_rows(n: int, velocity: Array, scratch: CostScratch) -> None:
    """Fill `scratch.scaled` and `scratch.wanted`: the equations for the shares that give the wanted velocity without turning the face."""
    rows, scaled, middle, half, wanted = scratch.rows, scratch.scaled, scratch.middle, scratch.half, scratch.wanted
    for k in range(5):
        wanted[k] = velocity[k] if k < 3 else 0.0
        for i in range(n):
            wanted[k] -= rows[k, i] * middle[i]
            scaled[k, i] = rows[k, i] * half[i]


@njit(cache=True, inline="always")
def _cheaper_speeds(
    n: int, least: float, late_cost: float, q: Array, qdot: Array, task: PostureTask, bound: float, scratch: CostScratch
) -> float:
    """Fill qdot (n,) with the joint speeds of lower cost: the least ones, or those that keep the face from turning.

    Args:
        n: Number of joints.
        least: Lower bound of the cost without that of the speeds.
        late_cost: Cost of being late.
        q: (n,) rad, joint positions.
        qdot: (n,) rad/s, output: filled if the result is not inf.
        task: Data of the search.
        bound: Cost below which a posture must be.
        scratch: Scratch memory with rows, ranges of speeds and least shares.

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
    """Return the time in which the slowest joint moves from the start to a posture at its full speed.

    Args:
        q: (n,) rad, joint positions.
        joints: (n,) start and limits of each joint.

    Returns:
        s; inf if the posture is beyond a position limit.
    """
    longest = 0.0
    for i in range(len(q)):
        joint = joints[i]
        if not joint.low <= q[i] <= joint.high:
            return math.inf
        longest = max(longest, abs(q[i] - joint.start) / joint.speed)
    return longest


class PostureQuestion(NamedTuple):
    """Data that the computation of one posture's cost needs.

    Attributes:
        nearest: s, time from the start to the posture at full speed, the result of `time_to`.
        bound: Cost below which the posture must be; the computation ends when it is known to be higher.
        known: Whether `CostScratch.rows` already is the matrix of this posture.
    """

    nearest: float
    bound: float
    known: bool


@njit(cache=True, inline="always")
def cost_of_joints(
    n: int, q: Array, question: PostureQuestion, task: PostureTask, chain: Chain, qdot: Array, scratch: CostScratch
) -> float:
    """Compute the best joint speeds at a posture, and the cost of the posture with them.

    Args:
        n: Number of joints; with a constant the compiler unrolls the loops.
        q: (n,) rad or m, joint positions.
        question: Data of this posture, and the bound of its cost.
        task: Data of the search.
        chain: Geometry of the arm.
        qdot: (n,) rad/s or m/s, output: filled with the joint speeds.
        scratch: Scratch memory.

    Returns:
        The cost; inf as soon as it is known to reach the bound, or if the posture cannot give the velocity.
    """
    nearest, bound, known = question
    weights, late = task.weights, 0
    while weights.swing_time * LATER[late] < nearest:
        late += 1
    least = _least_limit_cost(n, q, task.joints, weights.margin)
    if least + LATE_COST * late >= bound or least + LATE_COST * late + weights.back * _least_time_back(n, q, task) >= bound:
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
