"""The stroke that sends the ball to the goal: a two-point boundary value problem, coupled with the racket (dissertation 4.2, 4.3).

Unknown is the velocity v1 after the hit. Spin x follows from it by (4.16), the flight from both, the racket from all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS, NET_HEIGHT, NET_OVERHANG, NET_X, TABLE_LENGTH, TABLE_WIDTH
from tt_core.errors import TtError
from tt_core.flight import MAX_STEP, fly, step
from tt_core.physics import Physics
from tt_core.states import Array, BallState, RacketState, ReturnGoal

from .impact import racket_for, spin_after

TOLERANCE = 1e-9  # m, of the landing
COARSE_STEP = 0.1  # s, of the flights far from the solution: 1e-7 m off
COARSE = 1e-6  # m, the residual from which the flights are exact
MOST_CORRECTIONS = 40
FASTEST = 60.0  # m/s after the hit; past it the search has left the field


@dataclass(frozen=True, slots=True, eq=False)
class Stroke:
    """The answer: racket and ball just after the hit, both None without a solution, and why not.

    residual: m, how far from the goal the full flight model puts the landing point at the asked time. corrections: of v1.
    """

    racket: RacketState | None
    ball_after: BallState | None
    residual: float
    corrections: int
    reason: str | None = None


@njit(cache=True)
def _aim_sam(p0: Array, spin_y: float, spin_z: float, target: Array, flight_time: float, air: Array, v1: Array) -> None:
    """(4.58): drag axis by axis, no Magnus force. D takes h of (3.3) for the straight way to the target."""
    dx, dy = target[0] - p0[0], target[1] - p0[1]
    across = dx * spin_y
    norm = math.sqrt(across * across + (dx * dx + dy * dy) * spin_z * spin_z)
    d = air[1] + (air[2] * across / norm if norm > 0.0 else 0.0)
    for k in range(2):
        way = target[k] - p0[k]
        v1[k] = math.copysign((math.exp(d * abs(way)) - 1.0) / (d * flight_time), way) if d > 0.0 else way / flight_time
    v1[2] = 0.5 * air[0] * flight_time + (target[2] - p0[2]) / flight_time


@njit(cache=True)
def _shoot(
    ball: Array, spin_y: float, spin_z: float, target: Array, flight_time: float, air: Array, most: int, after: Array
) -> tuple[float, int]:
    """Correct after[3:6] = v1 by Broyden's method until the flight ends on target; returns the residual (m) and the corrections made.

    The start of the inverse Jacobian is that of a flight without air, 1 / flight_time.
    """
    inverse = np.eye(3) / flight_time
    miss, last, change, moved, b, row = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    residual, max_step, fresh = np.inf, COARSE_STEP, True
    for n in range(most + 1):
        if abs(after[3] - ball[3]) < 1e-6 or not abs(after[3]) + abs(after[4]) + abs(after[5]) < FASTEST:
            return np.inf, n
        spin_after(ball[3:6], ball[6:9], after[3:6], spin_y, spin_z, after[6:9])
        end = fly(after, flight_time, air, max_step if n < most else MAX_STEP)
        for k in range(3):
            last[k] = miss[k]
            miss[k] = end[k] - target[k]
        residual = math.sqrt(miss[0] * miss[0] + miss[1] * miss[1] + miss[2] * miss[2])
        if (residual < TOLERANCE and max_step == MAX_STEP) or n == most:
            return residual, n
        if not fresh:
            for k in range(3):
                change[k] = miss[k] - last[k]
            scale = 0.0
            for i in range(3):
                b[i] = inverse[i, 0] * change[0] + inverse[i, 1] * change[1] + inverse[i, 2] * change[2]
                row[i] = moved[0] * inverse[0, i] + moved[1] * inverse[1, i] + moved[2] * inverse[2, i]
                scale += moved[i] * b[i]
            if abs(scale) > 1e-300:
                for i in range(3):
                    for j in range(3):
                        inverse[i, j] += (moved[i] - b[i]) * row[j] / scale
        fresh = residual < COARSE and max_step == COARSE_STEP
        if fresh:
            max_step = MAX_STEP  # its residuals do not compare with the coarse ones
        for i in range(3):
            moved[i] = -(inverse[i, 0] * miss[0] + inverse[i, 1] * miss[1] + inverse[i, 2] * miss[2])
            after[3 + i] += moved[i]
    return residual, most


_CLEAR, _NET, _TABLE = range(3)


@njit(cache=True)
def _obstacle(after: Array, flight_time: float, air: Array, contact: float) -> int:
    """What the returned ball meets before the goal: looked at in steps of at most MAX_STEP and where it crosses the net."""
    work, now, end, over = np.empty((8, 3)), after.copy(), np.empty(9), np.empty(9)
    steps = math.ceil(flight_time / MAX_STEP)
    h = flight_time / steps
    for _ in range(steps):
        step(now, h, air, end, work)
        if now[0] < NET_X <= end[0]:
            s = h * (NET_X - now[0]) / (end[0] - now[0])
            for _newton in range(4):
                step(now, s, air, over, work)
                s += (NET_X - over[0]) / over[3]
            step(now, s, air, over, work)
            if over[2] < NET_HEIGHT + BALL_RADIUS and -NET_OVERHANG < over[1] < TABLE_WIDTH + NET_OVERHANG:
                return _NET
        if end[2] < contact and 0.0 <= end[0] <= NET_X and 0.0 <= end[1] <= TABLE_WIDTH:
            return _TABLE
        now[:] = end
    return _CLEAR


_REASONS = {_NET: "the return would hit the net", _TABLE: "the return would hit the robot's half of the table"}


def _refused(reason: str, residual: float = math.inf, corrections: int = 0) -> Stroke:
    return Stroke(None, None, residual, corrections, reason)


def solve(ball: BallState, goal: ReturnGoal, physics: Physics, *, method: str = "exact", corrections: int = MOST_CORRECTIONS) -> Stroke:
    """The racket state at the ball's time and place that sends it to the goal.

    ball: at the hit, flying to -x. method: "exact", the full model, from the "sam" start, or "sam", the simple one (4.48)-(4.58) alone.
    corrections: the most that "exact" makes; fewer give a coarser answer in less time. The racket's face lies contact_height behind the
    ball's centre, and its normal points from it to the ball.
    A goal that cannot be met is a Stroke with a reason; raises TtError for an unknown method.
    """
    if method not in ("exact", "sam"):
        raise TtError(f"method {method!r} is none of 'exact', 'sam'")
    if not (NET_X < goal.landing[0] < TABLE_LENGTH and 0.0 < goal.landing[1] < TABLE_WIDTH):
        return _refused(f"landing {goal.landing} is not on the opponent's half, x {NET_X} to {TABLE_LENGTH}, y 0 to {TABLE_WIDTH}")
    if ball.velocity[0] >= 0.0:
        return _refused(f"the ball does not come: v_x = {ball.velocity[0]:g} m/s")
    if ball.position[0] >= NET_X:
        return _refused(f"the ball is on the opponent's side: x = {ball.position[0]:g} m")
    air, target = physics.air.coefficients, np.append(goal.landing, physics.contact_height)
    before, after = ball.vector, ball.vector
    _aim_sam(ball.position, goal.spin_y, goal.spin_z, target, goal.flight_time, air, after[3:6])
    most = corrections if method == "exact" else 0
    residual, made = _shoot(before, goal.spin_y, goal.spin_z, target, goal.flight_time, air, most, after)
    if not residual < math.inf or (method == "exact" and made == MOST_CORRECTIONS):
        return _refused(f"no velocity leads to the goal in {goal.flight_time:g} s", residual, made)
    velocity, normal = np.empty(3), np.empty(3)
    share = racket_for(before[3:6], before[6:9], after[3:6], after[6:9], physics.racket.coefficients, velocity, normal)
    if share > 1.0:
        return _refused(f"the asked change of spin is {share:.2f} times what the rubber gives", residual, made)
    met = _obstacle(after, goal.flight_time, air, physics.contact_height)
    if met != _CLEAR:
        return _refused(_REASONS[met], residual, made)
    racket = RacketState.facing(ball.time, ball.position - physics.contact_height * normal, velocity, normal)
    return Stroke(racket, BallState.from_vector(ball.time, after), residual, made)
