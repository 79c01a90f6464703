"""Inverse kinematics of a stroke: find the posture (joint positions) and joint speeds that give the racket its state.

Position and normal of the racket's face are five conditions on five to eight joints, so zero to three freedoms (free angles) are left. The
search starts from postures all over the joint limits, so its result does not depend on a start value (`posture_search`; `elbow_search` for
an arm with closed-form inverse kinematics). The best posture needs the least share of the joint speeds that are possible there within the
swing time, turns the face little at the strike, and lets the arm return soon.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.constants import COMMAND_TIMEOUT
from tt_core.errors import BadChoice, check_array
from tt_core.failures import Failure
from tt_core.params import check, param
from tt_core.states import Array, RacketState

from . import dissertation
from .ik.elbow_search import Face, elbow_search
from .ik.newton import Target, newton
from .ik.posture_cost import PostureWeights, turning_rate
from .ik.posture_search import ATLAS_SIZE, any_posture, search_postures
from .ik.velocity_allocation import ONES, least_shares, steady_rows
from .joints import HOLD_RESERVE, JointBounds, JointLimits
from .kinematics import Chain, forward
from .model import ArmModel

REACH_METHODS = ("best", "near", "any", "liu")
FINER = (1, 2)  # multiples of `grid` that are tried one after the other, until a posture within all limits is found
MORE = (1, 4, 16)  # multiples of `seeds` that are tried one after the other, until a posture within all limits is found


class ReachFailure(Enum):
    """Codes of failures: why there is no usable posture for a racket state."""

    OUT_OF_REACH = "out of reach"
    NOT_CONVERGED = "Newton's method did not converge"
    BEYOND_POSITION_LIMIT = "joint {joint} would be {beyond:.3f} {unit} beyond its limit"
    BEYOND_SPEED_LIMIT = "needs {ratio:.2f} of the joint speed limits"


@dataclass(frozen=True, slots=True)
class ReachParams:
    """Parameters of the posture search: weights of its cost, and numbers of start postures."""

    swing_time: float = param(
        0.38,
        "s",
        "time from the start to the strike, which bounds the possible joint speeds; set by the stroke selection to the time left",
        low=0.05,
        high=10.0,
    )
    acceleration: float = param(
        10.0,
        "rad/s^2",
        "acceleration of each joint that the search counts on; set by the stroke selection to that of swings",
        low=0.1,
        high=1000.0,
    )
    affordable: float = param(
        0.9, "", "share of the possible joint speeds that may be spent to keep the face from turning; our choice", low=0.0, high=1.0
    )
    turning_weight: float = param(
        0.03, "s/rad", "cost of the rate at which the face normal turns, beside the share of the possible speeds", low=0.0, high=100.0
    )
    margin: float = param(
        0.03, "rad", "distance of a posture from the position limits, in addition to the room to brake", low=0.0, high=0.5
    )
    return_weight: float = param(
        5.0,
        "1/s",
        "cost of the time from the strike until the arm waits again, beside the share of the possible speeds",
        low=0.0,
        high=1000.0,
    )
    command_timeout: float = param(
        COMMAND_TIMEOUT + HOLD_RESERVE,
        "s",
        "time for which a joint may keep its speed before it brakes; set by the stroke selection to that of swings",
        low=0.0,
        high=10.0,
    )
    grid: int = param(
        12, "", "values of each of two freedoms on the grid where the search of an arm with a closed form starts", low=4, high=64
    )
    seeds: int = param(
        64,
        "",
        "known postures from which the search of any other arm starts; 4 and 16 times as many where it finds none within all limits",
        low=1,
        high=1000,
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """Posture and joint speeds at the strike (the time of the hit), or the reason why there are none.

    Attributes:
        q: (n,) rad or m, joint positions; the start posture if none was found.
        qdot: (n,) rad/s or m/s, joint speeds; zero if no posture was found.
        ratio: Largest ratio of a joint's speed to its limit; inf if no posture was found.
        turning: rad/s, rate at which the face normal turns.
        reason: Why the posture cannot be used; None if it can.
    """

    q: Array
    qdot: Array
    ratio: float
    turning: float
    reason: Failure | None


class Rating(NamedTuple):
    """Comparison of a posture and its joint speeds with the limits.

    Attributes:
        ratio: Largest ratio of a joint's speed to its limit.
        turning: rad/s, rate at which the face normal turns.
        joint: Index of the joint that is furthest beyond its position limit, or nearest to it.
        beyond: rad or m by which this joint is beyond its limit; negative within the limit.
    """

    ratio: float
    turning: float
    joint: int
    beyond: float


@njit(cache=True)
def rate(q: Array, qdot: Array, rows: Array, limits: JointBounds) -> Rating:
    """Compare a posture and its joint speeds with the limits.

    Args:
        q: (n,) rad or m, joint positions.
        qdot: (n,) rad/s or m/s, joint speeds.
        rows: (5, n) matrix of `steady_rows` in this posture, from joint speeds to the velocity of the face and the turning of its normal.
        limits: (n,) limits of the joints.
    """
    ratio, joint, beyond = 0.0, 0, -np.inf
    for i in range(len(q)):
        ratio = max(ratio, abs(qdot[i]) / limits[i].speed)
        outside = max(limits[i].low - q[i], q[i] - limits[i].high)
        if outside > beyond:
            joint, beyond = i, outside
    return Rating(ratio, turning_rate(rows, qdot), joint, beyond)


@njit(cache=True)
def nearest_posture(
    position: Array, normal: Array, velocity: Array, seed: Array, limits: JointBounds, chain: Chain
) -> tuple[bool, Array, Array, tuple[float, float, int, float]]:
    """Find a posture near a seed by Newton's method, and the least joint speeds for the racket's velocity.

    Args:
        position: (3,) m in `table`, wanted position of the face centre.
        normal: (3,) wanted unit normal of the face in `table`.
        velocity: (3,) m/s in `table`, wanted velocity of the face centre.
        seed: (n,) rad or m, posture from which the iteration starts.
        limits: (n,) limits of the joints. The joint speeds are the least ones as shares of the speed limits.
        chain: Geometry of the arm.

    Returns:
        Whether there is such a posture, its joint positions (n,) and joint speeds (n,), and the fields of its `Rating`. They are plain
        tuples, because Python gets these 0.5 us sooner than a NamedTuple.
    """
    found, q, rows = newton(position, normal, seed, chain)
    n = len(seed)
    qdot = np.zeros(n)
    if found:
        columns = np.empty((3, n))
        for k in range(3):
            for i in range(n):
                columns[k, i] = rows[k, i] * limits[i].speed
        found = least_shares(columns, velocity, qdot) < np.inf
        for k in range(3):
            missing = velocity[k]
            for i in range(n):
                missing -= columns[k, i] * qdot[i]
            found = found and abs(missing) < 1e-6
        for i in range(n):
            qdot[i] *= limits[i].speed
    ratio, turning, joint, beyond = rate(q, qdot, rows, limits)
    return found, q, qdot, (ratio, turning, joint, beyond)


def reach(
    model: ArmModel,
    racket: RacketState,
    seed: Array,
    params: ReachParams | None = None,
    *,
    qdot: Array | None = None,
    method: str = "best",
    limits: JointLimits | None = None,
) -> Reach:
    """Find the posture and the joint speeds that give the racket its position, normal and velocity at the strike.

    Args:
        model: The arm.
        racket: Wanted racket state at the strike.
        seed: (n,) rad or m, joint positions from which the arm starts.
        params: Parameters of the posture search; None for the default.
        qdot: (n,) rad/s or m/s, joint speeds at `seed`; None if the arm is at rest there.
        method: "best" searches all postures for the best one. "near" takes the posture that Newton's method finds from the seed, with the
            least joint speeds. "any" takes the first posture within the position limits. "liu" is the dissertation's method, see
            `dissertation`.
        limits: Limits of the joints; None for those of the arm.

    Returns:
        The posture. Its `reason` tells why it cannot be used, if it cannot.

    Raises:
        BadShape: An array has another shape.
        NotFinite: A number is NaN or infinite.
        BadChoice: The dissertation's method is asked of an arm without seven joints.
    """
    n = len(model.names)
    seed, limits = check_array("seed", seed, (n,)).copy(), limits or model.limits
    if method == "liu" and n != dissertation.JOINTS:
        raise BadChoice("method", method, REACH_METHODS[:3])
    if method == "best":
        speeds = np.zeros(n) if qdot is None else check_array("qdot", qdot, (n,))
        return _searched(model, racket, np.array([seed, speeds, model.waiting]), params or ReachParams(), limits)
    if method == "any":
        q, target, seeds = np.empty(n), Target(racket.position.copy(), racket.normal), (params or ReachParams()).seeds
        if not any(any_posture(target, seed, limits.bounds, times * seeds, model.atlas, model.chain, q) for times in MORE):
            return _failed(seed, ReachFailure.OUT_OF_REACH)
        seed = q
    if method in ("near", "any"):
        found, q, speeds, rating = nearest_posture(
            racket.position.copy(), racket.normal, racket.velocity.copy(), seed, limits.bounds, model.chain
        )
        return _rated(limits, q, speeds, Rating(*rating)) if found else _failed(seed, ReachFailure.NOT_CONVERGED)
    posture = dissertation.posture(model, racket, seed)
    if posture is None:
        return _failed(seed, ReachFailure.NOT_CONVERGED)
    return _compared(model, limits, posture, dissertation.joint_speeds(model, posture, racket.velocity))


def adjust(model: ArmModel, racket: RacketState, before: Reach, limits: JointLimits | None = None) -> Reach:
    """Change a posture and its joint speeds as little as possible, for a racket state that has changed a little.

    Args:
        model: The arm.
        racket: Wanted racket state after the change.
        before: Posture and joint speeds for the racket state before the change.
        limits: Limits of the joints; None for those of the arm.

    Returns:
        The new posture. Its `reason` tells why it cannot be used, if it cannot.
    """
    limits = limits or model.limits
    found, q, rows = newton(racket.position.copy(), racket.normal, np.array(before.q), model.chain)
    if not found:
        return _failed(q, ReachFailure.NOT_CONVERGED)
    scaled = rows[:3] * limits.speed
    missing = racket.velocity - rows[:3] @ before.qdot
    return _compared(model, limits, q, before.qdot + limits.speed * (scaled.T @ np.linalg.solve(scaled @ scaled.T, missing)))


def _searched(model: ArmModel, racket: RacketState, start: Array, params: ReachParams, limits: JointLimits) -> Reach:
    """Return the best posture of the search; start (3, n): start positions, start speeds, and positions of the waiting posture."""
    bounds = limits.reduced(acceleration=params.acceleration).bounds
    weights = PostureWeights(
        params.swing_time, params.affordable, params.turning_weight, params.margin, params.return_weight, params.command_timeout
    )
    position, velocity, cost = racket.position.copy(), racket.velocity.copy(), np.array(weights)
    found = _failed(start[0], ReachFailure.OUT_OF_REACH)
    for times in FINER if model.closed_form is not None else MORE:
        if model.closed_form is not None:
            face = Face(position, racket.rotation, velocity)
            best = elbow_search(face, start, bounds, cost, times * params.grid, model.closed_form, model.chain)
        else:
            count = min(times * params.seeds, ATLAS_SIZE)
            best = search_postures(Target(position, racket.normal), velocity, start, bounds, cost, count, model.atlas, model.chain)
        if best.cost < math.inf:
            found = _compared(model, limits, best.q, best.qdot)
        if found.reason is None:
            break
    return found


def _compared(model: ArmModel, limits: JointLimits, q: Array, qdot: Array) -> Reach:
    _, rotation, jacobian = forward(q, model.chain)
    return _rated(limits, q, qdot, rate(q, qdot, steady_rows(jacobian, rotation, ONES), limits.bounds))


def _rated(limits: JointLimits, q: Array, qdot: Array, rating: Rating) -> Reach:
    """Return the posture as a Reach, with the reason if it is beyond a limit."""
    reason = None
    if rating.beyond > 0.0:
        joint = limits.names[rating.joint]
        reason = Failure(ReachFailure.BEYOND_POSITION_LIMIT, joint=joint, beyond=rating.beyond, unit=limits.units[rating.joint])
    elif rating.ratio > 1.0:
        reason = Failure(ReachFailure.BEYOND_SPEED_LIMIT, ratio=rating.ratio)
    return Reach(q, qdot, rating.ratio, rating.turning, reason)


def _failed(q: Array, code: ReachFailure) -> Reach:
    return Reach(q, np.zeros(len(q)), math.inf, 0.0, Failure(code))
