"""Which posture brings the racket to its state (inverse kinematics).

Face position and normal are five conditions on seven joints. The two freedoms left are the racket's turn about its normal and the
elbow's angle about the line from shoulder to wrist; with both given the posture is a closed form. They are chosen by a search over their
whole range, so the answer does not hang on a start. The best posture spends the least share of the joint speeds that can be had there
within the swing time, lets the face turn little at the strike, and has the arm back soon.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_core.errors import check_array, check_range
from tt_core.states import Array, RacketState

from .kinematics import Chain, forward, inverse
from .model import ArmModel
from .motion import fastest, least_time
from .speeds import allocate, least_shares, least_shares_steady, steady_rows

LIMIT_COST = 20.0  # per rad beyond the room kept from a position limit
LATE_COST = 5.0  # for each of the times below that is too short
LATER = (1.0, 1.1, 1.4, 2.0, 3.0, 1e3)  # times the swing time; the last one asks what the joints can do at all
FINER = 2  # times the grid, where the plain one finds no posture at all
STARTS = 2  # postures of the grid that are refined
STEP_LEAST = 0.01  # rad, where the refinement ends
NEWTON_STEPS, NEWTON_ENDS = 50, 1e-9  # steps at most; m and rad, where Newton's method ends
ONES = np.ones(7)
UNSOLVED = "Newton's method did not converge"


@dataclass(frozen=True, slots=True)
class ReachParams:
    """What the choice among the postures weighs."""

    swing_time: float = 0.38  # s, from the seed to the strike; what is possible in it weighs each joint; `choose` sets what is left
    acceleration: float = 10.0  # rad/s^2, for the swing time; `choose` sets that of the swing
    affordable: float = 0.9  # share of what is possible that may be spent to keep the face from turning; our choice
    turning_weight: float = 0.03  # s/rad, cost of the rate at which the face normal turns, against the share spent
    margin: float = 0.03  # rad, kept from the position limits, beside the room to brake
    return_weight: float = 5.0  # 1/s, cost of the time from the strike until the arm waits again, against the share spent
    grid: int = 12  # values of each freedom at the start of the search

    def __post_init__(self) -> None:
        check_range("swing_time", self.swing_time, 0.05, 10.0)
        check_range("acceleration", self.acceleration, 0.1, 1000.0)
        check_range("affordable", self.affordable, 0.0, 1.0)
        check_range("turning_weight", self.turning_weight, 0.0, 100.0)
        check_range("margin", self.margin, 0.0, 0.5)
        check_range("return_weight", self.return_weight, 0.0, 1000.0)
        check_range("grid", self.grid, 4, 64)


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """A posture for the strike.

    q: (7,) rad. qdot: (7,) rad/s. ratio: max |qdot| / limit. turning: rad/s, of the face normal. reason: None, or why it cannot be used.
    """

    q: Array
    qdot: Array
    ratio: float
    turning: float
    reason: str | None


@njit(cache=True)
def _turning(rows: Array, shares: Array) -> float:
    """rad/s, of the face normal, for rows (5, 7) of `steady_rows`."""
    x = y = 0.0
    for i in range(7):
        x += rows[3, i] * shares[i]
        y += rows[4, i] * shares[i]
    return math.hypot(x, y)


@njit(cache=True)
def _steadier(rows: Array, wanted: Array, shares: Array, affordable: float) -> Array:
    """What to add to the least shares (7,) to hold the face as still as `affordable` allows; the face centre moves alike."""
    still = np.empty(7)
    if np.abs(shares).max() > affordable or least_shares_steady(rows, wanted, still) == np.inf:
        return np.zeros(7)
    part = 1.0
    for i in range(7):
        step = still[i] - shares[i]
        if abs(still[i]) > affordable:
            part = min(part, (math.copysign(affordable, step) - shares[i]) / step)
    return part * (still - shares)


@njit(cache=True)
def _wind(q: Array, branch: int, seed: Array, limits: Array) -> float:
    """The same links in space by other angles, in place, each wound to the turn nearest to the seed; returns the way, s at full speed.

    Each bit of `branch` negates q2, q4 or q6 and turns its neighbours by pi.
    """
    for k in range(3):
        if branch >> k & 1:
            q[2 * k] += math.pi
            q[2 * k + 1] *= -1.0
            q[2 * k + 2] += math.pi
    far = 0.0
    for i in range(7):
        q[i] += 2.0 * math.pi * round((seed[i] - q[i]) / (2.0 * math.pi))
        for way in (-2.0 * math.pi, 2.0 * math.pi):
            if max(limits[i, 0] - q[i] - way, q[i] + way - limits[i, 1]) < 0.0 < max(limits[i, 0] - q[i], q[i] - limits[i, 1]):
                q[i] += way
        far = max(far, abs(q[i] - seed[i]) / limits[i, 2])
        if not limits[i, 0] <= q[i] <= limits[i, 1]:
            far += 1e3
    return far


@njit(cache=True)
def _posture(
    turn: float, swivel: float, position: Array, rotation: Array, velocity: Array, seed: Array, limits: Array, weights: Array, chain: Chain,
    bound: float,
) -> tuple[float, Array, Array]:  # fmt: skip
    """Cost, q (7,) and qdot (7,) of the best posture with both freedoms given; inf as soon as the cost is seen to exceed `bound`.

    seed: (3, 7) q, qdot, and q where it waits. limits: (7, 3) low, high, speed. weights: (6,) swing time, acceleration, affordable,
    turning, margin, return.
    """
    q, qdot, other = np.empty(7), np.zeros(7), np.empty(7)
    c, s = math.cos(turn), math.sin(turn)
    turned = rotation.copy()
    turned[:, 0], turned[:, 1] = c * rotation[:, 0] + s * rotation[:, 1], c * rotation[:, 1] - s * rotation[:, 0]
    if not inverse(position, turned, swivel, chain, other):
        return np.inf, q, qdot
    nearest = np.inf
    for branch in range(8):
        wound = other.copy()
        far = _wind(wound, branch, seed[0], limits)
        if far < nearest:
            nearest, q = far, wound
    if nearest > 1e3:
        return np.inf, q, qdot

    speed, acceleration = limits[:, 2], weights[1]
    _, _, jacobian = forward(q, chain)
    rows = steady_rows(jacobian, turned, ONES)
    middle, half, wanted, shares = np.empty(7), np.empty(7), np.empty(5), np.empty(7)
    scaled = rows
    for late in range(len(LATER)):
        time, cost = weights[0] * LATER[late], late * LATE_COST
        if cost > bound:
            return np.inf, q, qdot
        if time < nearest:
            continue
        wanted[:3] = velocity
        wanted[3:] = 0.0
        in_time = True
        for i in range(7):  # the joint speeds possible at the strike
            high = fastest(time, q[i] - seed[0, i], seed[1, i], speed[i], acceleration)
            low = -fastest(time, seed[0, i] - q[i], -seed[1, i], speed[i], acceleration)
            middle[i], half[i] = 0.5 * (high + low), 0.5 * (high - low)
            wanted -= rows[:, i] * middle[i]
            in_time = in_time and high > low
        scaled = rows * half
        if in_time and least_shares(scaled[:3].copy(), wanted[:3].copy(), shares) <= 1.0:
            break
    if np.abs(rows[:3] @ (middle + half * shares) - velocity).max() > 1e-6:  # singular
        return np.inf, q, qdot
    more = _steadier(scaled, wanted, shares, weights[2])
    best = np.inf
    for part in (0.0, 1.0):
        mixed = middle + half * (shares + part * more)
        back = 0.0
        for i in range(7):
            back = max(back, least_time(seed[2, i] - q[i], mixed[i], 0.0, speed[i], acceleration))
        own = cost + weights[5] * back + np.abs(shares + part * more).max() + weights[3] * _turning(rows, mixed)
        for i in range(7):
            room = min(mixed[i] ** 2 / (2.0 * acceleration), 0.2 * (limits[i, 1] - limits[i, 0])) + weights[4]
            own += LIMIT_COST * max(0.0, limits[i, 0] + room - q[i], q[i] - limits[i, 1] + room)
        if own < best:
            best, qdot = own, mixed
    return best, q, qdot


@njit(cache=True)
def search(
    position: Array, rotation: Array, velocity: Array, seed: Array, limits: Array, weights: Array, grid: int, chain: Chain
) -> tuple[float, Array, Array]:
    """Cost, q (7,), qdot (7,) of the best posture: a grid over both freedoms, then a compass search from its best points."""
    costs, least = np.empty((grid, grid)), np.inf
    step = 2.0 * math.pi / grid
    for i in range(grid):
        for j in range(grid):
            costs[i, j] = _posture(i * step, j * step, position, rotation, velocity, seed, limits, weights, chain, least)[0]
            least = min(least, costs[i, j])
    best, q, qdot = np.inf, seed[0].copy(), np.zeros(7)
    for _ in range(STARTS):
        at = np.argmin(costs)
        i, j = at // grid, at % grid
        if costs[i, j] == np.inf:
            break
        turn, swivel, size = i * step, j * step, 0.5 * step
        here, here_q, here_qdot = _posture(turn, swivel, position, rotation, velocity, seed, limits, weights, chain, np.inf)
        for di in range(-1, 2):
            for dj in range(-1, 2):
                costs[(i + di) % grid, (j + dj) % grid] = np.inf
        while size > STEP_LEAST:
            moved = False
            for du, dv in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)):
                u, v = turn + du * size, swivel + dv * size
                cost, there, there_qdot = _posture(u, v, position, rotation, velocity, seed, limits, weights, chain, here)
                if cost < here:
                    here, here_q, here_qdot, turn, swivel, moved = cost, there, there_qdot, u, v, True
                    break
            if not moved:
                size *= 0.5
        if here < best:
            best, q, qdot = here, here_q, here_qdot
    return best, q, qdot


@njit(cache=True)
def _least_step(rows: Array, error: Array, q: Array) -> None:
    """q + rows^T (rows rows^T)^-1 error in place, for rows (5, 7), by Cholesky's method: a fifth of the time of a call of LAPACK."""
    lower, x = np.empty((5, 5)), np.empty(5)
    for i in range(5):
        x[i] = error[i]
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
    point, rotation, jacobian = forward(q, chain)
    for step in range(steps + 1):
        x, y, z = rotation[0, 2], rotation[1, 2], rotation[2, 2]
        tx, ty, tz = y * normal[2] - z * normal[1], z * normal[0] - x * normal[2], x * normal[1] - y * normal[0]
        sine, cosine = math.sqrt(tx * tx + ty * ty + tz * tz), x * normal[0] + y * normal[1] + z * normal[2]
        factor = math.atan2(sine, cosine) / sine if sine > 1e-12 else 1.0
        error[:3] = position - point
        for k in range(2):
            error[3 + k] = factor * (rotation[0, k] * tx + rotation[1, k] * ty + rotation[2, k] * tz)
        rows = steady_rows(jacobian, rotation, ONES)
        if np.abs(error).max() < tolerance and cosine > 0.0:
            return True, q, rows
        if step == steps:
            break
        _least_step(rows, error, q)
        point, rotation, jacobian = forward(q, chain)
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
    return ratio, _turning(rows, qdot), joint, beyond


@njit(cache=True)
def nearest(
    position: Array, normal: Array, velocity: Array, seed: Array, limits: Array, speeds: Array, chain: Chain
) -> tuple[bool, Array, Array, float, float, int, float]:
    """Newton's posture and its least joint speeds: whether there are any, q (7,), qdot (7,), and what `judge` says of them."""
    found, q, rows = newton(position, normal, seed, chain, NEWTON_STEPS, NEWTON_ENDS)
    shares = np.zeros(7)
    if found:
        columns = rows[:3] * speeds
        found = least_shares(columns, velocity, shares) < np.inf and np.abs(columns @ shares - velocity).max() < 1e-6
    qdot = shares * speeds
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
    position, velocity, rotation = racket.position.copy(), racket.velocity.copy(), racket.rotation
    speed = model.speed_limits
    if method == "best":
        params = params or ReachParams()
        limits = np.column_stack([model.position_limits, speed])
        weights = np.array(
            [params.swing_time, params.acceleration, params.affordable, params.turning_weight, params.margin, params.return_weight]
        )
        start = np.array([seed, np.zeros(7) if qdot is None else check_array("qdot", qdot, (7,)), model.waiting])
        for finer in (1, FINER):
            cost, q, qdot = search(position, rotation, velocity, start, limits, weights, finer * params.grid, model.chain)
            if cost < math.inf:
                break
        else:
            return Reach(seed, np.zeros(7), math.inf, 0.0, "out of reach")
        return _judged(model, q, qdot)
    if method == "near":
        answer = nearest(position, rotation[:, 2].copy(), velocity, seed, model.position_limits, speed, model.chain)
        return _told(model, *answer[1:]) if answer[0] else Reach(seed, np.zeros(7), math.inf, 0.0, UNSOLVED)
    found, q, _ = newton(position, rotation[:, 2].copy(), seed, model.chain, NEWTON_STEPS, NEWTON_ENDS)
    return _judged(model, q, allocate(model, q, velocity, method="liu")) if found else Reach(seed, np.zeros(7), math.inf, 0.0, UNSOLVED)


def adjust(model: ArmModel, racket: RacketState, before: Reach) -> Reach:
    """The answer for `racket` next to that for a racket state near it: the least changes of posture and joint speeds."""
    found, q, rows = newton(racket.position.copy(), racket.normal.copy(), np.array(before.q), model.chain, NEWTON_STEPS, NEWTON_ENDS)
    if not found:
        return Reach(q, np.zeros(7), math.inf, 0.0, UNSOLVED)
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
        reason = f"joint {model.names[joint]} would be {beyond:.3f} rad beyond its limit"
    elif ratio > 1.0:
        reason = f"needs {ratio:.2f} of the joint speed limits"
    return Reach(q, qdot, ratio, turning, reason)
