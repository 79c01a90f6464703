"""Which posture brings the racket to its state (inverse kinematics).

Face position and normal are five conditions on seven joints. The two freedoms left are the racket's turn about its normal and the
elbow's angle about the line from shoulder to wrist; with both given the posture is a closed form. They are chosen by a search over their
whole range, so the answer does not hang on a start. The best posture spends the least share of the joint speeds that can be had there
within the swing time, lets the face turn little at the strike, and has the arm back soon.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numba import njit
from tt_core.errors import check_array
from tt_core.failures import Failure
from tt_core.params import check, param
from tt_core.states import Array, RacketState

from .ik.ik_search import ONES, search, turning
from .ik.velocity_allocation import allocate, least_shares, steady_rows, steady_rows_into
from .kinematics import Chain, forward, forward_into
from .model import ArmModel

FINER = 2  # times the grid, where the plain one finds no posture at all
NEWTON_STEPS, NEWTON_ENDS = 50, 7e-10  # steps at most; m and rad about either axis, where it ends: 1e-9 about both


class ReachFailure(Enum):
    """Why a posture cannot be used."""

    OUT_OF_REACH = "out of reach"
    NOT_CONVERGED = "Newton's method did not converge"
    BEYOND_POSITION_LIMIT = "joint {joint} would be {beyond:.3f} rad beyond its limit"
    BEYOND_SPEED_LIMIT = "needs {ratio:.2f} of the joint speed limits"


@dataclass(frozen=True, slots=True)
class ReachParams:
    """What the choice among the postures weighs."""

    swing_time: float = param(
        0.38, "s", "from the seed to the strike; what is possible in it weighs each joint; `choose` sets what is left", low=0.05, high=10.0
    )
    acceleration: float = param(10.0, "rad/s^2", "for the swing time; `choose` sets that of the swing", low=0.1, high=1000.0)
    affordable: float = param(
        0.9, "", "share of what is possible that may be spent to keep the face from turning; our choice", low=0.0, high=1.0
    )
    turning_weight: float = param(
        0.03, "s/rad", "cost of the rate at which the face normal turns, against the share spent", low=0.0, high=100.0
    )
    margin: float = param(0.03, "rad", "kept from the position limits, beside the room to brake", low=0.0, high=0.5)
    return_weight: float = param(
        5.0, "1/s", "cost of the time from the strike until the arm waits again, against the share spent", low=0.0, high=1000.0
    )
    command_timeout: float = param(
        0.1, "s", "for which a drive may hold its speed before it brakes; `choose` sets that of the swing", low=0.0, high=10.0
    )
    grid: int = param(12, "", "values of each freedom at the start of the search", low=4, high=64)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """A posture for the strike.

    q: (7,) rad. qdot: (7,) rad/s. ratio: max |qdot| / limit. turning: rad/s, of the face normal. reason: None, or why it cannot be used.
    """

    q: Array
    qdot: Array
    ratio: float
    turning: float
    reason: Failure | None


@njit(cache=True)
def _least_step(rows: Array, x: Array, q: Array, lower: Array) -> None:
    """q + rows^T (rows rows^T)^-1 x in place, for rows (5, 7), by Cholesky's method: a fifth of the time of a call of LAPACK.

    x (5,), the error, and lower (5, 5) are overwritten.
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
            x[i] -= lower[i, k] * x[k]
        x[i] /= lower[i, i]
    for i in range(4, -1, -1):
        for k in range(i + 1, 5):
            x[i] -= lower[k, i] * x[k]
        x[i] /= lower[i, i]
        for j in range(7):
            q[j] += rows[i, j] * x[i]


@njit(cache=True)
def newton(position: Array, normal: Array, seed: Array, chain: Chain, steps: int, tolerance: float) -> tuple[bool, Array, Array]:
    """Newton-Raphson with the pseudo-inverse from `seed` (7,), (4.63): whether it converged, q (7,), and rows (5, 7) of `steady_rows`,
    per rad/s."""
    q, error = seed.copy(), np.empty(5)
    point, rotation, jacobian, rows, lower = np.empty(3), np.empty((3, 3)), np.empty((6, 7)), np.empty((5, 7)), np.empty((5, 5))
    for step in range(steps + 1):
        forward_into(q, chain, point, rotation, jacobian)
        x, y, z = rotation[0, 2], rotation[1, 2], rotation[2, 2]
        tx, ty, tz = y * normal[2] - z * normal[1], z * normal[0] - x * normal[2], x * normal[1] - y * normal[0]
        sine, cosine = math.sqrt(tx * tx + ty * ty + tz * tz), x * normal[0] + y * normal[1] + z * normal[2]
        factor = math.atan2(sine, cosine) / sine if sine > 1e-12 else 1.0
        worst = 0.0
        for k in range(5):
            wrong = (
                position[k] - point[k] if k < 3 else factor * (rotation[0, k - 3] * tx + rotation[1, k - 3] * ty + rotation[2, k - 3] * tz)
            )
            error[k], worst = wrong, max(worst, abs(wrong))
        steady_rows_into(jacobian, rotation, ONES, rows)
        if worst < tolerance and cosine > 0.0:
            return True, q, rows
        if step < steps:
            _least_step(rows, error, q, lower)
    return False, q, rows


@njit(cache=True)
def judge(q: Array, qdot: Array, rows: Array, limits: Array, speeds: Array) -> tuple[float, float, int, float]:
    """max |qdot| / limit; rad/s, of the face normal; the joint that is furthest beyond its position limit, and by how much (rad)."""
    ratio, joint, beyond = 0.0, 0, -np.inf
    for i in range(7):
        ratio = max(ratio, abs(qdot[i]) / speeds[i])
        outside = max(limits[i, 0] - q[i], q[i] - limits[i, 1])
        if outside > beyond:
            joint, beyond = i, outside
    return ratio, turning(rows, qdot), joint, beyond


@njit(cache=True)
def nearest(
    position: Array, normal: Array, velocity: Array, seed: Array, limits: Array, speeds: Array, chain: Chain
) -> tuple[bool, Array, Array, float, float, int, float]:
    """Newton's posture and its least joint speeds: whether there are any, q (7,), qdot (7,), and what `judge` says of them."""
    found, q, rows = newton(position, normal, seed, chain, NEWTON_STEPS, NEWTON_ENDS)
    qdot = np.zeros(7)
    if found:
        columns = np.empty((3, 7))
        for k in range(3):
            for i in range(7):
                columns[k, i] = rows[k, i] * speeds[i]
        found = least_shares(columns, velocity, qdot) < np.inf
        for k in range(3):
            missing = velocity[k]
            for i in range(7):
                missing -= columns[k, i] * qdot[i]
            found = found and abs(missing) < 1e-6
        qdot *= speeds
    ratio, turning, joint, beyond = judge(q, qdot, rows, limits, speeds)
    return found, q, qdot, ratio, turning, joint, beyond


def reach(
    model: ArmModel,
    racket: RacketState,
    seed: Array,
    params: ReachParams | None = None,
    *,
    qdot: Array | None = None,
    method: str = "best",
) -> Reach:
    """The posture and joint speeds that put the face centre, its normal and its velocity where `racket` wants them.

    seed: (7,) rad, from where the arm will come; qdot: (7,) rad/s, if it moves there. method: "best" searches both freedoms; "near"
    takes the posture that Newton's method finds from the seed, with the least joint speeds; "liu" is (4.62)-(4.65) as printed.
    Raises BadShape, NotFinite.
    """
    seed = check_array("seed", seed, (7,)).copy()
    position, velocity = racket.position.copy(), racket.velocity.copy()
    speed = model.speed_limits
    if method == "best":
        params = params or ReachParams()
        limits = np.column_stack([model.position_limits, speed])
        turning, back, hold = params.turning_weight, params.return_weight, params.command_timeout
        weights = np.array([params.swing_time, params.acceleration, params.affordable, turning, params.margin, back, hold])
        start = np.array([seed, np.zeros(7) if qdot is None else check_array("qdot", qdot, (7,)), model.waiting])
        for finer in (1, FINER):
            cost, q, qdot = search(position, racket.rotation, velocity, start, limits, weights, finer * params.grid, model.chain)
            if cost < math.inf:
                break
        else:
            return Reach(seed, np.zeros(7), math.inf, 0.0, Failure(ReachFailure.OUT_OF_REACH))
        return _judged(model, q, qdot)
    if method == "near":
        answer = nearest(position, racket.normal, velocity, seed, model.position_limits, speed, model.chain)
        return _told(model, *answer[1:]) if answer[0] else Reach(seed, np.zeros(7), math.inf, 0.0, Failure(ReachFailure.NOT_CONVERGED))
    found, q, _ = newton(position, racket.normal, seed, model.chain, NEWTON_STEPS, NEWTON_ENDS)
    return (
        _judged(model, q, allocate(model, q, velocity, method="liu"))
        if found
        else Reach(seed, np.zeros(7), math.inf, 0.0, Failure(ReachFailure.NOT_CONVERGED))
    )


def adjust(model: ArmModel, racket: RacketState, before: Reach) -> Reach:
    """The answer for `racket` next to that for a racket state near it: the least changes of posture and joint speeds."""
    found, q, rows = newton(racket.position.copy(), racket.normal, np.array(before.q), model.chain, NEWTON_STEPS, NEWTON_ENDS)
    if not found:
        return Reach(q, np.zeros(7), math.inf, 0.0, Failure(ReachFailure.NOT_CONVERGED))
    scaled = rows[:3] * model.speed_limits
    missing = racket.velocity - rows[:3] @ before.qdot
    return _judged(model, q, before.qdot + model.speed_limits * (scaled.T @ np.linalg.solve(scaled @ scaled.T, missing)))


def _judged(model: ArmModel, q: Array, qdot: Array) -> Reach:
    """With ratio, turning rate and, where a limit is broken, the reason."""
    _, rotation, jacobian = forward(q, model.chain)
    return _told(model, q, qdot, *judge(q, qdot, steady_rows(jacobian, rotation, ONES), model.position_limits, model.speed_limits))


def _told(model: ArmModel, q: Array, qdot: Array, ratio: float, turning: float, joint: int, beyond: float) -> Reach:
    reason = None
    if beyond > 0.0:
        reason = Failure(ReachFailure.BEYOND_POSITION_LIMIT, joint=model.names[joint], beyond=beyond)
    elif ratio > 1.0:
        reason = Failure(ReachFailure.BEYOND_SPEED_LIMIT, ratio=ratio)
    return Reach(q, qdot, ratio, turning, reason)
