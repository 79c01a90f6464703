"""When each joint moves: from where it is, through the strike at its instant, slowing down, and back to waiting, as one path.

The loop is that of dissertation Figure 1.9: approach, strike, slow down to rest, return. Each leg takes one time for all joints, with one
of the profiles of Chapter 1: "quintic", the fifth degree polynomial; "polyline", speed in straight pieces, the mixed envelopes of
`motion`, which reach all that the limits allow; "ruckig", trapezoidal acceleration, which limits jerk as well. "auto" is the quintic for
each joint where that keeps the limits, else the polyline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.errors import TtError, check_array, check_range
from tt_core.states import Array

from .clearance import OBSTACLES, path_clearance
from .jerk import SAME, append, least_jerky
from .model import ArmModel
from .motion import evaluate, least_time, polyline, possible, quintic, quintic_holds
from .reach import Reach
from .torque import torque_shares

PIECES = 32  # per joint: hold, three legs of five or (ruckig) seven and two to slow down first, rest
STEP = 1e-3  # s, of the search for the earliest strike and of the last check of the limits
COARSE = 10e-3  # s, of the check against the table: at 3 m/s the racket moves 30 mm
LONGEST = 10.0  # s, the longest leg that is tried
PROFILES = ("auto", "quintic", "polyline", "ruckig")
RUCKIG = PROFILES.index("ruckig")
AT_REST = 1e-3  # rad/s, below which a joint may wait where it is
SOFT = 1.6  # times the least time to slow down: a quintic without acceleration at its ends needs 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """The joints at one instant: time s, q (7,) rad, qdot (7,) rad/s."""

    time: float
    q: Array
    qdot: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", check_range("time", self.time, -math.inf, math.inf))
        for name in ("q", "qdot"):
            object.__setattr__(self, name, check_array(name, getattr(self, name), (7,)))


@dataclass(frozen=True, slots=True)
class SwingLimits:
    """What a swing may use; position and speed limits are the model's."""

    acceleration: float = 20.0  # rad/s^2 of each joint; needs 0.76 of the rated torque at most (assumed inertias), our choice
    speed_share: float = 1.0  # of the speed limits, Table A.12
    unhurried: float = 1.4  # a leg from rest to the strike takes this times its least time, if there is time
    unhurried_return: float = 1.15  # and so does the way back: the next ball comes soon
    torque_share: float = 1.0  # of the rated torque, checked over the whole path with assumed inertias
    margin: float = 0.02  # rad, kept from the position limits; more than the guard keeps
    clearance: float = 0.010  # m, that racket and forearm keep from table, floor and arm; more than the guard keeps
    jerk: float = 2000.0  # rad/s^3 of each joint, for the profile "ruckig"; our choice: 10 ms to the full acceleration
    profile: str = "auto"  # of a joint: see PROFILES and the top of this file

    def __post_init__(self) -> None:
        check_range("acceleration", self.acceleration, 0.1, 1000.0)
        check_range("speed_share", self.speed_share, 0.01, 1.0)
        check_range("torque_share", self.torque_share, 0.01, 100.0)
        check_range("jerk", self.jerk, 1.0, 1e6)
        check_range("margin", self.margin, 0.0, 0.5)
        check_range("clearance", self.clearance, 0.0, 0.5)
        check_range("unhurried", self.unhurried, 1.0, 10.0)
        check_range("unhurried_return", self.unhurried_return, 1.0, 10.0)
        if self.profile not in PROFILES:
            raise TtError(f"profile = {self.profile!r} is none of {', '.join(PROFILES)}")


@dataclass(frozen=True, slots=True, eq=False)
class Swing:
    """A path of all joints over time.

    start: where it begins. strike_time, end_time: s; it rests from end_time on. earliest: s, when the strike would have been possible
    at the earliest, inf if never. reason: None, or why there is no strike: then the path only brakes and returns to waiting, and
    strike_time is inf.
    """

    start: Joints
    strike_time: float
    end_time: float
    earliest: float
    reason: str | None
    knots: Array = field(repr=False)  # (7, n) s since start.time, padded with inf
    coefficients: Array = field(repr=False)  # (7, n, 6) in s since the knot, lowest power first

    def sample(self, time: float) -> tuple[Array, Array]:
        """q (7,) rad and qdot (7,) rad/s at `time` (s); before the start straight towards it, rest after the end."""
        q, qdot, qddot = np.empty(7), np.empty(7), np.empty(7)
        evaluate(time - self.start.time, self.knots, self.coefficients, q, qdot, qddot)
        return q, qdot

    def table(self, step: float) -> tuple[Array, Array, Array]:
        """times (n,) s since start.time, every `step` and at strike and end; q and qdot (n, 7)."""
        end = self.end_time - self.start.time
        times = np.unique(np.append(np.arange(0.0, end, step), [end, min(end, self.strike_time - self.start.time)]))
        rows = [self.sample(self.start.time + t) for t in times]
        return times, np.array([q for q, _ in rows]), np.array([v for _, v in rows])


@njit(cache=True)
def _holds(time: float, q0: Array, v0: Array, q1: Array, v1: Array, speed: Array, acceleration: float, only_quintic: bool) -> bool:
    for i in range(7):
        if only_quintic:
            if not quintic_holds(time, q0[i], v0[i], q1[i], v1[i], speed[i], acceleration):
                return False
        elif not possible(time, q1[i] - q0[i], v0[i], v1[i], speed[i], acceleration):
            return False
    return True


@njit(cache=True)
def _least(q0: Array, v0: Array, q1: Array, v1: Array, speed: Array, acceleration: float, only_quintic: bool) -> float:
    """The shortest time (s) of a leg that keeps the limits in all joints; inf when there is none below LONGEST."""
    time = 1e-6
    for i in range(7):
        time = max(time, least_time(q1[i] - q0[i], v0[i], v1[i], speed[i], acceleration))
    if _holds(time, q0, v0, q1, v1, speed, acceleration, only_quintic):
        return time
    while not _holds(time + STEP, q0, v0, q1, v1, speed, acceleration, only_quintic):
        time += STEP
        if time > LONGEST:
            return np.inf
    low, high = time, time + STEP
    for _ in range(20):
        middle = 0.5 * (low + high)
        if _holds(middle, q0, v0, q1, v1, speed, acceleration, only_quintic):
            high = middle
        else:
            low = middle
    return high


@njit(cache=True)
def _leg(
    begin: float, time: float, q0: Array, v0: Array, q1: Array, v1: Array, speed: Array, acceleration: float, profile: int,
    knots: Array, coefficients: Array, pieces: npt.NDArray[np.int64],
) -> None:  # fmt: skip
    """Appends a leg of `time` that starts at `begin`; pieces (7,) counts the polynomials of each joint."""
    for i in range(7):
        n = pieces[i]
        smooth = profile == 1 or (profile == 0 and quintic_holds(time, q0[i], v0[i], q1[i], v1[i], speed[i], acceleration))
        if smooth:
            pieces[i] += quintic(time, q0[i], v0[i], q1[i], v1[i], knots[i, n:], coefficients[i, n:])
        else:
            pieces[i] += polyline(time, q0[i], v0[i], q1[i], v1[i], speed[i], acceleration, knots[i, n:], coefficients[i, n:])
        knots[i, n : pieces[i]] += begin


@njit(cache=True)
def _rest(begin: float, q: Array, knots: Array, coefficients: Array, pieces: npt.NDArray[np.int64]) -> None:
    for i in range(7):
        knots[i, pieces[i]] = begin
        coefficients[i, pieces[i], 0] = q[i]
        pieces[i] += 1


@njit(cache=True)
def extremes(end: float, knots: Array, coefficients: Array) -> tuple[Array, Array, Array, Array]:
    """Lowest and highest q, highest |qdot| and |qddot| (7,) each, every STEP until `end`."""
    q, qdot, qddot = np.empty(7), np.empty(7), np.empty(7)
    low, high, speed, acceleration = np.full(7, np.inf), np.full(7, -np.inf), np.zeros(7), np.zeros(7)
    for k in range(int(end / STEP) + 2):
        evaluate(min(end, k * STEP), knots, coefficients, q, qdot, qddot)
        low, high = np.minimum(low, q), np.maximum(high, q)
        speed, acceleration = np.maximum(speed, np.abs(qdot)), np.maximum(acceleration, np.abs(qddot))
    return low, high, speed, acceleration


class _Path:
    """A path in the making: each call appends polynomials for all joints; `now` (s) is how long it is."""

    def __init__(self, model: ArmModel, limits: SwingLimits, profile: str) -> None:
        self.model, self.limits, self.kind, self.now = model, limits, PROFILES.index(profile), 0.0
        self.speed = limits.speed_share * model.speed_limits
        self.knots, self.coefficients, self._pieces = np.full((7, PIECES), np.inf), np.zeros((7, PIECES, 6)), np.zeros(7, np.int64)

    def least(self, q0: Array, v0: Array, q1: Array, v1: Array) -> float:
        if self.kind == RUCKIG:
            return self.longer(0.0, q0, v0, q1, v1)
        return _least(q0, v0, q1, v1, self.speed, self.limits.acceleration, self.kind == 1)

    def longer(self, time: float, q0: Array, v0: Array, q1: Array, v1: Array) -> float:
        """s, the shortest possible leg of at least `time`, for a profile that has gaps between the possible times; inf if there is none."""
        if self.kind != RUCKIG:
            return time
        leg = least_jerky(q0, v0, q1, v1, self.speed, self.limits.acceleration, self.limits.jerk, time)
        return math.inf if leg is None else float(leg.duration)

    def holds(self, time: float, q0: Array, v0: Array, q1: Array, v1: Array) -> bool:
        if self.kind == RUCKIG:
            return self.longer(time, q0, v0, q1, v1) <= time + SAME
        return _holds(time, q0, v0, q1, v1, self.speed, self.limits.acceleration, self.kind == 1)

    def rest(self, q: Array, time: float) -> None:
        _rest(self.now, q, self.knots, self.coefficients, self._pieces)
        self.now += time

    def leg(self, time: float, q0: Array, v0: Array, q1: Array, v1: Array) -> None:
        acceleration = self.limits.acceleration
        if self.kind == RUCKIG:
            leg = least_jerky(q0, v0, q1, v1, self.speed, acceleration, self.limits.jerk, time)
            if leg is None:
                raise TtError(f"ruckig finds no leg of {time:g} s from {q0}, {v0} to {q1}, {v1}")
            append(leg, self.now, self.knots, self.coefficients, self._pieces)
            self.now += leg.duration
            return
        _leg(self.now, time, q0, v0, q1, v1, self.speed, acceleration, self.kind, self.knots, self.coefficients, self._pieces)
        self.now += time

    def home(self, q: Array, qdot: Array, softly: float) -> None:
        """Slow down in `softly` times the least time, return, wait."""
        still, waiting = np.zeros(7), self.model.waiting.copy()
        brake = softly * float(np.abs(qdot).max()) / self.limits.acceleration
        if brake > 0.0:
            brake += self.limits.acceleration / self.limits.jerk if self.kind == RUCKIG else 0.0
            stop = q + 0.5 * brake * qdot
            self.leg(brake, q, qdot, stop, still)
            q = stop
        self.leg(max(STEP, self.limits.unhurried_return * self.least(q, still, waiting, still)), q, still, waiting, still)
        self.rest(waiting, 0.0)

    def hits(self) -> str | None:
        """What is in the way: a joint's end, the table, the floor, the arm itself or the motors' torque."""
        low, high, _, _ = extremes(self.now, self.knots, self.coefficients)
        room = np.minimum(low - self.model.position_limits[:, 0], self.model.position_limits[:, 1] - high)
        if room.min() < self.limits.margin:
            return f"joint {self.model.names[int(room.argmin())]} would come within {max(0.0, room.min()):.3f} rad of its limit on the way"
        braking, enough = self.limits.acceleration, self.limits.clearance
        left, what = path_clearance(self.now, COARSE, braking, enough, self.knots, self.coefficients, self.model.chain)
        if left < enough:
            return f"the arm would come within {max(0.0, 1e3 * left):.0f} mm of {OBSTACLES[what]} on the way or braking there"
        shares = torque_shares(self.model, self.now, 2.0 * COARSE, self.knots, self.coefficients)
        if shares.max() > self.limits.torque_share:
            return f"joint {self.model.names[int(shares.argmax())]} would need {shares.max():.2f} of its rated torque on the way"
        return None


def plan(model: ArmModel, start: Joints, target: Reach | None, strike_time: float, limits: SwingLimits | None = None) -> Swing:
    """The swing from `start` that has the joints at target.q with target.qdot at `strike_time` (s), and then waits for the next ball.

    A start at rest is held as long as an unhurried approach allows; a moving start has no jump in position or speed. target None only
    returns to waiting. The start's speeds must be within the limits. Raises OutOfRange, NotFinite.
    """
    limits = limits or SwingLimits()
    strike_time = check_range("strike_time", strike_time, -1e18, 1e18)
    hardest = "ruckig" if limits.profile == "ruckig" else "polyline"
    path = _Path(model, limits, limits.profile)
    q0, v0 = np.array(start.q), np.clip(start.qdot, -path.speed, path.speed)
    start, moving = Joints(start.time, q0, v0), bool(np.abs(v0).max() > AT_REST)
    earliest, reason = math.inf, None if target is None else target.reason
    if target is not None and reason is None:
        time, shortest = strike_time - start.time, path.least(q0, v0, target.q, target.qdot)
        earliest = start.time + shortest
        if math.isinf(shortest):
            reason = "the limits allow no way to this strike"
        elif time < shortest:
            reason = f"the strike is {1e3 * (shortest - time):.0f} ms too soon"
        elif moving and not path.holds(time, q0, v0, target.q, target.qdot):
            reason = "the arm moves too fast to arrive as late as that"
        else:
            for hurry, softly, profile in ((limits.unhurried, SOFT, limits.profile), (1.0, SOFT, limits.profile), (1.0, 1.0, hardest)):
                path = _Path(model, limits, profile)
                approach = time if moving else path.longer(min(time, hurry * shortest), q0, v0, target.q, target.qdot)
                if approach > time + SAME:
                    reason = "the limits allow no way that arrives then"
                    continue
                if approach < time:
                    path.rest(q0, time - approach)
                path.leg(approach, q0, v0, target.q, target.qdot)
                path.home(target.q, target.qdot, softly)
                reason = path.hits()
                if reason is None:
                    return Swing(start, strike_time, start.time + path.now, earliest, None, path.knots, path.coefficients)
    for softly, profile in ((SOFT, limits.profile), (1.0, hardest)):
        path = _Path(model, limits, profile)
        path.home(q0, v0 if moving else np.zeros(7), softly)
        if path.hits() is None:
            break
    return Swing(start, math.inf, start.time + path.now, earliest, reason, path.knots, path.coefficients)
