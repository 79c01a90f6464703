"""The stroke that sends the ball to the goal: a two-point boundary value problem, coupled with the racket (dissertation 4.2, 4.3).

Unknown is the velocity v1 after the hit. Spin x follows from it by (4.16), the flight from both, the racket from all. Broyden's method
corrects v1 on flights of long steps; what these are off from the exact flight is found once, at the solution, and aimed off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS, NET_HEIGHT, NET_X, TABLE_LENGTH, TABLE_WIDTH
from tt_core.errors import TtError
from tt_core.flight import ease, fly_into, step
from tt_core.physics import Physics
from tt_core.states import Array, BallState, RacketState, ReturnGoal
from tt_core.table_contacts import meets_net, meets_surface

from .impact import racket_for, spin_after

TOLERANCE = 3e-8  # m, of the landing
FINE_STEP = 0.08  # s, of the flight to which the answer is exact: 6e-8 m off at most
FINE_WAY = 0.6  # m, that such a step is long at most
COARSE_STEP = 0.3  # s, of the flights that are corrected: 1e-5 m off
COARSE = 1e-3  # m, the miss from which it pays to know what they are off
FINE = 2e-8  # m, the miss of the coarse flight to the place aimed off
MOST_CORRECTIONS = 40
FASTEST = 60.0  # m/s after the hit; past it the search has left the field
SAME_INSTANT = 1e-6  # s, a contact this near the landing is the landing


@dataclass(frozen=True, slots=True, eq=False)
class Stroke:
    """The answer: racket and ball just after the hit, both None without a solution, and why not.

    residual: m, how far from the goal the full flight model puts the landing point at the asked time. corrections: of v1.
    missing: by how much the goal is out of reach, in the unit of `reason`, 0 when solved. share: of the change of spin that the rubber can
    give at this change of velocity, over 1 there is no racket; inf where the search did not get that far.
    """

    racket: RacketState | None
    ball_after: BallState | None
    residual: float
    corrections: int
    reason: str | None = None
    missing: float = 0.0
    share: float = math.inf


@njit(cache=True, error_model="numpy")
def _aim_sam(p0: Array, spin_y: float, spin_z: float, target: Array, flight_time: float, air: Array, v1: Array) -> float:
    """(4.58): drag axis by axis, no Magnus force. Returns D, which takes h of (3.3) for the straight way to the target."""
    dx, dy = target[0] - p0[0], target[1] - p0[1]
    across = dx * spin_y
    norm = math.sqrt(across * across + (dx * dx + dy * dy) * spin_z * spin_z)
    d = air[1] + (air[2] * across / norm if norm > 0.0 else 0.0)
    for k in range(2):
        way = target[k] - p0[k]
        v1[k] = math.copysign((math.exp(d * abs(way)) - 1.0) / (d * flight_time), way) if d > 0.0 else way / flight_time
    v1[2] = 0.5 * air[0] * flight_time + (target[2] - p0[2]) / flight_time
    return d


@njit(cache=True, error_model="numpy")
def _first_inverse(v: Array, spin_y: float, spin_z: float, d: float, flight_time: float, air: Array) -> Array:
    """(3, 3) d v1 / d landing to first order in drag D and Magnus force: (1 - T/2 da/dv)^-1 / T is (1 + T/2 da/dv) / T."""
    half = 0.5 * flight_time
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    lift = air[3]
    out = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = half * d * v[i] * v[j] / speed
        out[i, i] += 1.0 + half * d * speed
    out[0, 2] -= half * lift * spin_y
    out[2, 0] += half * lift * spin_y
    out[0, 1] += half * lift * spin_z
    out[1, 0] -= half * lift * spin_z
    return out / flight_time


_CLEAR, _NET, _TABLE, _SIDE, _EARLY, _SEARCH, _SPIN, _ASIDE, _AWAY, _BEYOND = range(10)


@njit(cache=True, error_model="numpy")
def _fine_step(v: Array) -> float:
    return min(FINE_STEP, FINE_WAY / math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]))


@njit(cache=True, error_model="numpy")
def _walk(after: Array, flight_time: float, air: Array, contact: float, end: Array, work: Array) -> tuple[int, float]:
    """Fly to the landing, end (9,), in fine steps; what the ball meets before, and by how much: m under the top of the
    net or beside the table, s before the landing.

    The bounce of a ball that goes where it should is that on the opponent's half at the flight time.
    """
    trial, now = np.empty(9), after.copy()
    even, left = flight_time / math.ceil(flight_time / _fine_step(after[3:6])), flight_time
    met, missing = _CLEAR, 0.0
    while left > 0.0:
        h = even * ease(now, air)
        if h > left - 1e-12:
            h = left
        step(now, h, air, end, work)
        if met == _CLEAR and now[0] - BALL_RADIUS < NET_X < end[0] + BALL_RADIUS:
            if meets_net(now, end, h, air, trial, work) < np.inf:
                met, missing = _NET, NET_HEIGHT + BALL_RADIUS - trial[2]
            elif now[0] < NET_X <= end[0]:
                y = now[1] + (end[1] - now[1]) * (NET_X - now[0]) / (end[0] - now[0])
                missing = max(-y, y - TABLE_WIDTH)
                met = _SIDE if missing > 0.0 else _CLEAR
        elif met == _CLEAR and now[0] > NET_X and not 0.0 <= now[1] <= TABLE_WIDTH:
            met, missing = _SIDE, max(-now[1], now[1] - TABLE_WIDTH)
        lands = h == left and now[2] > contact and contact - end[2] < -SAME_INSTANT * end[5]
        if met == _CLEAR and not lands and (end[2] <= contact or now[5] < 0.0 < end[5]):
            before = left - meets_surface(now, end, h, contact, air, trial, work)
            if before > SAME_INSTANT:
                met, missing = (_TABLE if trial[0] < NET_X else _EARLY), before
        left -= h
        now[:] = end
    return met, missing


@njit(cache=True, error_model="numpy")
def find(
    p0: Array,
    v0: Array,
    w0: Array,
    landing: Array,
    flight_time: float,
    spin_y: float,
    spin_z: float,
    air: Array,
    rubber: Array,
    contact: float,
    most: int,
    exact: bool,
    out: Array,
) -> tuple[int, float, float, int, float, float, float]:
    """p0, v0, w0 (3,) of the ball, landing (2,); fills out (18,): the ball after the hit (9,), the racket's velocity, normal and position.

    Returns what is in the way, by how much, residual, corrections, share, alpha, beta.
    """
    beside = max(NET_X - landing[0], landing[0] - TABLE_LENGTH, -landing[1], landing[1] - TABLE_WIDTH)
    if beside >= 0.0:
        return _ASIDE, beside, np.inf, 0, np.inf, 0.0, 0.0
    if v0[0] >= 0.0:
        return _AWAY, v0[0], np.inf, 0, np.inf, 0.0, 0.0
    if p0[0] >= NET_X:
        return _BEYOND, p0[0] - NET_X, np.inf, 0, np.inf, 0.0, 0.0
    target, aim, miss, moved, b, row = np.empty((6, 3))
    after, velocity, normal = out[:9], out[9:12], out[12:15]
    end, last, fine = np.empty((3, 9))
    work = np.empty((8, 3))
    target[0], target[1], target[2] = landing[0], landing[1], contact
    for k in range(3):
        after[k], aim[k] = p0[k], target[k]
    d = _aim_sam(p0, spin_y, spin_z, target, flight_time, air, after[3:6])
    inverse = _first_inverse(after[3:6], spin_y, spin_z, d, flight_time, air)
    tolerance, n = COARSE, 0
    while True:
        if abs(after[3] - v0[0]) < 1e-6 or not abs(after[3]) + abs(after[4]) + abs(after[5]) < FASTEST:
            return _SEARCH, np.inf, np.inf, n, np.inf, 0.0, 0.0
        spin_after(v0, w0, after[3:6], spin_y, spin_z, after[6:9])
        last[:] = end
        fly_into(after, flight_time, air, COARSE_STEP, end, work)
        if n > 0:  # Broyden's update of the inverse Jacobian
            scale = 0.0
            for i in range(3):
                b[i], row[i] = 0.0, 0.0
                for j in range(3):
                    b[i] += inverse[i, j] * (end[j] - last[j])
                    row[i] += moved[j] * inverse[j, i]
                scale += moved[i] * b[i]
            if abs(scale) > 1e-300:
                for i in range(3):
                    for j in range(3):
                        inverse[i, j] += (moved[i] - b[i]) * row[j] / scale
        off = math.sqrt((end[0] - aim[0]) ** 2 + (end[1] - aim[1]) ** 2 + (end[2] - aim[2]) ** 2)
        if off < tolerance or n >= most:
            if tolerance == COARSE and n < most:
                fly_into(after, flight_time, air, _fine_step(after[3:6]), fine, work)
                tolerance = FINE
            else:
                met, missing = _walk(after, flight_time, air, contact, fine, work)
                residual = math.sqrt((fine[0] - target[0]) ** 2 + (fine[1] - target[1]) ** 2 + (fine[2] - target[2]) ** 2)
                if residual < TOLERANCE or n >= most:
                    break
            for k in range(3):
                aim[k] = target[k] - (fine[k] - end[k])
        for k in range(3):
            miss[k] = end[k] - aim[k]
        for i in range(3):
            moved[i] = -(inverse[i, 0] * miss[0] + inverse[i, 1] * miss[1] + inverse[i, 2] * miss[2])
            after[3 + i] += moved[i]
        n += 1
    if exact and residual >= TOLERANCE and most == MOST_CORRECTIONS:
        return _SEARCH, residual, residual, n, np.inf, 0.0, 0.0
    share = racket_for(v0, w0, after[3:6], after[6:9], rubber, velocity, normal)
    if share > 1.0:
        return _SPIN, share - 1.0, residual, n, share, 0.0, 0.0
    for k in range(3):
        out[15 + k] = p0[k] - contact * normal[k]
    if not exact and met == _EARLY:
        met = _CLEAR  # it misses the goal anyway
    alpha = -math.asin(min(1.0, max(-1.0, normal[1])))
    return met, missing if met != _CLEAR else 0.0, residual, n, share, alpha, math.atan2(normal[0], normal[2])


def _why(met: int, missing: float, share: float, goal: ReturnGoal) -> str:
    if met == _ASIDE:
        return f"landing {goal.landing} is not on the opponent's half, x {NET_X} to {TABLE_LENGTH}, y 0 to {TABLE_WIDTH}"
    if met == _AWAY:
        return f"the ball does not come: v_x = {missing:g} m/s"
    if met == _BEYOND:
        return f"the ball is on the opponent's side: x = {NET_X + missing:g} m"
    if met == _SPIN:
        return f"the asked change of spin is {share:.2f} times what the rubber gives"
    if met == _SEARCH:
        return f"no velocity leads to the goal in {goal.flight_time:g} s"
    if met == _NET:
        return f"the return would hit the net, {1e3 * missing:.0f} mm too low"
    if met == _SIDE:
        return f"the return would leave the table sideways, {1e3 * missing:.0f} mm beside it"
    if met == _EARLY:
        return f"the return would land {1e3 * missing:.0f} ms too early"
    return f"the return would hit the robot's half of the table, {1e3 * missing:.0f} ms before the goal"


def solve(
    ball: BallState,
    goal: ReturnGoal,
    physics: Physics,
    *,
    method: str = "exact",
    corrections: int = MOST_CORRECTIONS,
    racket_speed: float = math.inf,
) -> Stroke:
    """The racket state at the ball's time and place that sends it to the goal.

    ball: at the hit, flying to -x. method: "exact", the full model, from the "sam" start, or "sam", the simple one (4.48)-(4.58) alone.
    corrections: the most that "exact" makes; fewer give a coarser answer in less time. racket_speed: m/s, the most there is. The racket's
    face lies contact_height behind the ball's centre, and its normal points from it to the ball.
    The landing is exact to 1e-7 m, to 1e-4 m where spin comes to lie along the flight, for h of (3.3) jumps there.
    A goal that cannot be met is a Stroke with a reason; raises TtError for an unknown method.
    """
    if method not in ("exact", "sam"):
        raise TtError(f"method {method!r} is none of 'exact', 'sam'")
    out, exact = np.empty(18), method == "exact"
    met, missing, residual, made, share, alpha, beta = find(
        ball.position,
        ball.velocity,
        ball.spin,
        goal.landing,
        goal.flight_time,
        goal.spin_y,
        goal.spin_z,
        physics.air.coefficients,
        physics.racket.coefficients,
        physics.contact_height,
        corrections if exact else 0,
        exact,
        out,
    )
    if met != _CLEAR:
        return Stroke(None, None, residual, made, _why(met, missing, share, goal), missing, share)
    out.flags.writeable = False
    velocity = out[9:12]
    if racket_speed < math.inf and (speed := math.hypot(*velocity.tolist())) > racket_speed:
        reason = f"racket speed {speed:.2f} m/s is over {racket_speed:g} m/s"
        return Stroke(None, None, residual, made, reason, speed - racket_speed, share)
    racket = RacketState.trusted(ball.time, out[15:], velocity, alpha, beta)
    return Stroke(racket, BallState.trusted(ball.time, out[:3], out[3:6], out[6:9]), residual, made, None, 0.0, share)
