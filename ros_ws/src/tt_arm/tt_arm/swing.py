"""When each joint moves: from where it is, through the strike at its instant, slowing down, and back to waiting, as one path.

The loop is that of dissertation Figure 1.9: approach, strike, slow down, return. Slowing down and returning are one leg, in which each
joint turns back as soon as it can, or two with a stop between where something is in the way. A leg takes one time for all joints, with
one of the profiles of Section 1.1: "quintic", the fifth degree polynomial; "trapezoid", trapezoidal acceleration in a fixed time;
"polyline", speed in straight pieces, which reaches all that speed and acceleration allow, but steps in acceleration, so that no jerk limit
can hold; or by "ruckig", the shortest with a jerk limit. "auto" is the quintic for each joint where that keeps the limits, else the
trapezoid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.errors import TtError, check_range
from tt_core.failures import Failure
from tt_core.params import check, param
from tt_core.states import Array

from .joints import Joints
from .model import ArmModel
from .reach import Reach
from .safety.clearance import OBSTACLES, path_clearance
from .trajectory.jerk import SAME, append, least_jerky
from .trajectory.profiles import evaluate, least_time, polyline, possible, quintic, quintic_holds, trapezoid, trapezoid_possible
from .trajectory.torque import torque_shares

PIECES = 48  # per joint: hold, three legs of at most twelve, rest
STEP = 1e-3  # s, of the search for the earliest strike and of the last check of the limits
COARSE = 10e-3  # s, of the check against the table: at 3 m/s the racket moves 30 mm
SHORTEST, LONGEST = 1e-6, 10.0  # s, legs that are tried
PROFILES = ("auto", "quintic", "trapezoid", "polyline", "ruckig")
AUTO, QUINTIC, TRAPEZOID, POLYLINE, RUCKIG = range(5)
SLACK = 2e-3  # relative, for rounding in the last check of the limits
AT_REST = 1e-3  # rad/s, below which a joint may wait where it is
SOFT = 1.6  # times the least time to slow down: a quintic without acceleration at its ends needs 1.5


class SwingFailure(Enum):
    """Why there is no swing through the strike."""

    NO_WAY = "the limits allow no way to this strike"
    TOO_SOON = "the strike is {missing:.3f} s too soon"
    TOO_LATE = "the limits allow no way that arrives as late as the strike"
    TOO_FAST = "the arm moves too fast to arrive as late as the strike"
    NO_WAY_BACK = "the way back to waiting takes more than {bound:g} s"
    POSITION_LIMIT = "joint {joint} would come within {distance:.3f} rad of its limit on the way"
    HELD_COMMAND = "joint {joint} would run {beyond:.3f} rad beyond its limit if its drive held a command"
    SPEED_LIMIT = "joint {joint} would need {share:.3f} of its speed limit on the way"
    ACCELERATION_LIMIT = "joint {joint} would need {share:.3f} of its acceleration limit on the way"
    JERK_LIMIT = "joint {joint} would need {share:.3f} of its jerk limit on the way"
    CLEARANCE = "the arm would come within {distance:.3f} m of {obstacle} on the way or braking there"
    TORQUE_LIMIT = "joint {joint} would need {share:.2f} of its rated torque on the way"


@dataclass(frozen=True, slots=True)
class SwingLimits:
    """What a swing may use; position and speed limits are the model's."""

    acceleration: float = param(
        20.0, "rad/s^2", "of each joint; needs 0.76 of the rated torque at most (assumed inertias), our choice", low=0.1, high=1000.0
    )
    speed_share: float = param(1.0, "", "of the speed limits, Table A.12", low=0.01, high=1.0)
    unhurried: float = param(1.4, "", "a leg from rest to the strike takes this times its least time, if there is time", low=1.0, high=10.0)
    unhurried_return: float = param(1.0, "", "and so may the way back: the next ball comes soon", low=1.0, high=10.0)
    torque_share: float = param(1.0, "", "of the rated torque, checked over the whole path with assumed inertias", low=0.01, high=100.0)
    margin: float = param(0.02, "rad", "kept from the position limits; more than the guard keeps", low=0.0, high=0.5)
    clearance: float = param(
        0.010, "m", "that racket and forearm keep from table, floor and arm; more than the guard keeps", low=0.0, high=0.5
    )
    command_timeout: float = param(
        0.1, "s", "for which the drives hold a command; from anywhere on a path they may do that, then brake, unhurt", low=0.0, high=10.0
    )
    jerk: float = param(
        4000.0,
        "rad/s",
        '^3 of each joint, but for the profile "polyline"; our choice: 5 ms to the full acceleration',
        low=1.0,
        high=1000000.0,
    )
    profile: str = param("auto", "", "profile of a joint's motion, see `tt_arm.swing`", choices=PROFILES)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)

    @property
    def ramp(self) -> float:
        """s, that the jerk limit takes of the time of a leg, see `motion`."""
        return 0.0 if self.profile == "polyline" else 2.0 * self.acceleration / self.jerk


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
    reason: Failure | None
    knots: Array = field(repr=False)  # (7, n) s since start.time, padded with inf
    coefficients: Array = field(repr=False)  # (7, n, 6) in s since the knot, lowest power first

    def sample(self, time: float) -> tuple[Array, Array]:
        """q (7,) rad and qdot (7,) rad/s at `time` (s); before the start straight towards it, rest after the end."""
        q, qdot, _ = self._at(time)
        return q, qdot

    def joints(self, time: float) -> Joints:
        """The same with the acceleration, from where another swing can take over."""
        return Joints(time, *self._at(time))

    def _at(self, time: float) -> tuple[Array, Array, Array]:
        q, qdot, qddot = np.empty(7), np.empty(7), np.empty(7)
        evaluate(time - self.start.time, self.knots, self.coefficients, q, qdot, qddot)
        return q, qdot, qddot

    def table(self, step: float) -> tuple[Array, Array, Array]:
        """times (n,) s since start.time, every `step` and at strike and end; q and qdot (n, 7)."""
        end = self.end_time - self.start.time
        times = np.unique(np.append(np.arange(0.0, end, step), [end, min(end, self.strike_time - self.start.time)]))
        rows = [self.sample(self.start.time + t) for t in times]
        return times, np.array([q for q, _ in rows]), np.array([v for _, v in rows])


@njit(cache=True, nogil=True)
def _holds(
    time: float, q0: Array, v0: Array, a0: Array, q1: Array, v1: Array, speed: Array, acceleration: float, jerk: float, kind: int
) -> bool:
    for i in range(7):
        if kind == POLYLINE:
            holds = possible(time, q1[i] - q0[i], v0[i], v1[i], speed[i], acceleration)
        else:
            ends = (time, q0[i], v0[i], a0[i], q1[i], v1[i], speed[i], acceleration, jerk)
            holds = kind != QUINTIC and trapezoid_possible(*ends)
            holds = holds or (kind != TRAPEZOID and quintic_holds(*ends))
        if not holds:
            return False
    return True


@njit(cache=True, nogil=True)
def _longer(
    time: float, q0: Array, v0: Array, a0: Array, q1: Array, v1: Array, speed: Array, acceleration: float, jerk: float, kind: int
) -> float:
    """The shortest leg (s) of at least `time` that keeps the limits in all joints; inf when there is none below LONGEST."""
    time = max(time, SHORTEST)
    for i in range(7):
        time = max(time, least_time(q1[i] - q0[i], v0[i], v1[i], speed[i], acceleration))
    if _holds(time, q0, v0, a0, q1, v1, speed, acceleration, jerk, kind):
        return time
    while not _holds(time + STEP, q0, v0, a0, q1, v1, speed, acceleration, jerk, kind):
        time += STEP
        if not time <= LONGEST:  # also where it is NaN
            return np.inf
    low, high = time, time + STEP
    for _ in range(20):
        middle = 0.5 * (low + high)
        if _holds(middle, q0, v0, a0, q1, v1, speed, acceleration, jerk, kind):
            high = middle
        else:
            low = middle
    return high


@njit(cache=True)
def _leg(
    begin: float, time: float, q0: Array, v0: Array, a0: Array, q1: Array, v1: Array, speed: Array, acceleration: float, jerk: float,
    kind: int, knots: Array, coefficients: Array, pieces: npt.NDArray[np.int64],
) -> None:  # fmt: skip
    """Appends a leg of `time` that starts at `begin`; pieces (7,) counts the polynomials of each joint."""
    for i in range(7):
        n = pieces[i]
        to, into = knots[i, n:], coefficients[i, n:]
        ends = (time, q0[i], v0[i], a0[i], q1[i], v1[i])
        if kind == POLYLINE:
            pieces[i] += polyline(time, q0[i], v0[i], q1[i], v1[i], speed[i], acceleration, to, into)
        elif kind == QUINTIC or (kind == AUTO and quintic_holds(*ends, speed[i], acceleration, jerk)):
            pieces[i] += quintic(*ends, to, into)
        else:
            pieces[i] += trapezoid(*ends, speed[i], acceleration, jerk, to, into)
        knots[i, n : pieces[i]] += begin


@njit(cache=True)
def _rest(begin: float, q: Array, knots: Array, coefficients: Array, pieces: npt.NDArray[np.int64]) -> None:
    for i in range(7):
        knots[i, pieces[i]] = begin
        coefficients[i, pieces[i], 0] = q[i]
        pieces[i] += 1


@njit(cache=True, nogil=True)
def extremes(
    end: float, braking: float, hold: float, knots: Array, coefficients: Array
) -> tuple[Array, Array, Array, Array, Array, Array, Array]:  # fmt: skip
    """Lowest and highest q, highest |qdot|, |qddot| and jerk (7,) each, every STEP until `end`; a step of acceleration is a high jerk.

    The last two are the lowest and highest q (7,) of a joint that keeps its speed for `hold` (s) anywhere, then brakes (rad/s^2).
    """
    low, high, speed, acceleration, jerk = np.full(7, np.inf), np.full(7, -np.inf), np.zeros(7), np.zeros(7), np.zeros(7)
    lowest, highest = np.full(7, np.inf), np.full(7, -np.inf)
    q, qdot, qddot, before = np.empty(7), np.empty(7), np.empty(7), np.empty(7)
    for k in range(int(end / STEP) + 2):
        evaluate(min(end, k * STEP), knots, coefficients, q, qdot, qddot)
        for i in range(7):
            low[i], high[i] = min(low[i], q[i]), max(high[i], q[i])
            stop = q[i] + hold * qdot[i] + 0.5 * qdot[i] * abs(qdot[i]) / braking
            lowest[i], highest[i] = min(lowest[i], stop), max(highest[i], stop)
            speed[i], acceleration[i] = max(speed[i], abs(qdot[i])), max(acceleration[i], abs(qddot[i]))
            if k > 0:
                jerk[i] = max(jerk[i], abs(qddot[i] - before[i]) / STEP)
            before[i] = qddot[i]
    return low, high, speed, acceleration, jerk, lowest, highest


class Path:
    """A path in the making: each call appends polynomials for all joints; `now` (s) is how long it is."""

    def __init__(self, model: ArmModel, limits: SwingLimits) -> None:
        self.model, self.limits, self.kind, self.now = model, limits, PROFILES.index(limits.profile), 0.0
        self.speed, self._bounds = limits.speed_share * model.speed_limits, (limits.acceleration, limits.jerk)
        self.knots, self.coefficients, self._pieces = np.full((7, PIECES), np.inf), np.zeros((7, PIECES, 6)), np.zeros(7, np.int64)

    def longer(self, time: float, q0: Array, v0: Array, a0: Array, q1: Array, v1: Array) -> float:
        """s, the shortest possible leg of at least `time`; inf if there is none."""
        if self.kind != RUCKIG:
            return float(_longer(time, q0, v0, a0, q1, v1, self.speed, *self._bounds, self.kind))
        leg = least_jerky(q0, v0, a0, q1, v1, self.speed, *self._bounds, time)
        return math.inf if leg is None else float(leg.duration)

    def holds(self, time: float, q0: Array, v0: Array, a0: Array, q1: Array, v1: Array) -> bool:
        """Whether a leg of `time` (s) is possible."""
        if self.kind != RUCKIG:
            return bool(_holds(time, q0, v0, a0, q1, v1, self.speed, *self._bounds, self.kind))
        return self.longer(time, q0, v0, a0, q1, v1) <= time + SAME

    def rest(self, q: Array, time: float) -> None:
        _rest(self.now, q, self.knots, self.coefficients, self._pieces)
        self.now += time

    def leg(self, time: float, q0: Array, v0: Array, a0: Array, q1: Array, v1: Array) -> None:
        """One of `longer`'s."""
        if self.kind == RUCKIG:
            leg = least_jerky(q0, v0, a0, q1, v1, self.speed, *self._bounds, time)
            if leg is None:
                raise TtError(f"ruckig finds no leg of {time:g} s from {q0}, {v0}, {a0} to {q1}, {v1}")
            append(leg, self.now, self.knots, self.coefficients, self._pieces)
            time = leg.duration
        else:
            _leg(self.now, time, q0, v0, a0, q1, v1, self.speed, *self._bounds, self.kind, self.knots, self.coefficients, self._pieces)
        self.now += time

    def home(self, q: Array, qdot: Array, qddot: Array, softly: float | None) -> bool:
        """Slow down, return, wait: in one leg, or with a stop between in `softly` times the least time. Whether there is such a way below
        LONGEST; where there is none it ends with the stop."""
        waiting, none = self.model.waiting.copy(), np.zeros(7)
        if softly is not None and (np.abs(qdot).max() > 0.0 or np.abs(qddot).max() > 0.0):
            brake, stop = self._brake(q, qdot, qddot, softly)
            self.leg(brake, q, qdot, qddot, stop, none)
            q, qdot, qddot = stop, none, none
        least = max(STEP, self.longer(0.0, q, qdot, qddot, waiting, none))
        time = self.longer(self.limits.unhurried_return * least, q, qdot, qddot, waiting, none)
        found = not math.isinf(time)
        if found:
            self.leg(time, q, qdot, qddot, waiting, none)
        self.rest(waiting if found else q, 0.0)
        return found

    def join(self, other: Path) -> None:
        """What the other path does, after this one."""
        for i, (have, more) in enumerate(zip(self._pieces, other._pieces, strict=True)):
            self.knots[i, have : have + more] = self.now + other.knots[i, :more]
            self.coefficients[i, have : have + more] = other.coefficients[i, :more]
        self._pieces += other._pieces
        self.now += other.now

    def _brake(self, q: Array, qdot: Array, qddot: Array, softly: float) -> tuple[float, Array]:
        """s, and where (7,) it ends: the first leg that is possible, halfway between going on and stopping at once."""
        time = softly * float(np.abs(qdot).max()) / self.limits.acceleration
        while time < LONGEST:
            stop = q + 0.5 * time * qdot
            if self.holds(time, q, qdot, qddot, stop, np.zeros(7)):
                return time, stop
            time += STEP
        raise TtError(f"no way to stop within {LONGEST:g} s from qdot = {qdot}, qddot = {qddot}")

    def hits(self) -> Failure | None:
        """What is in the way: a joint's end or another limit of it, the table, the floor, the arm itself or the motors' torque."""
        names, (acceleration, jerk) = self.model.names, self._bounds
        hold, path = self.limits.command_timeout, (self.knots, self.coefficients)
        low, high, fastest, hardest, sharpest, lowest, highest = extremes(self.now, acceleration, hold, *path)
        room = np.minimum(low - self.model.position_limits[:, 0], self.model.position_limits[:, 1] - high)
        if room.min() < self.limits.margin:
            return Failure(SwingFailure.POSITION_LIMIT, joint=names[int(room.argmin())], distance=max(0.0, float(room.min())))
        room = np.minimum(lowest - self.model.position_limits[:, 0], self.model.position_limits[:, 1] - highest)
        if room.min() < 0.0:
            return Failure(SwingFailure.HELD_COMMAND, joint=names[int(room.argmin())], beyond=-float(room.min()))
        shares = {SwingFailure.SPEED_LIMIT: fastest / self.speed, SwingFailure.ACCELERATION_LIMIT: hardest / acceleration}
        if self.kind != POLYLINE:
            shares[SwingFailure.JERK_LIMIT] = sharpest / jerk
        for code, share in shares.items():
            if share.max() > 1.0 + SLACK:
                return Failure(code, joint=names[int(share.argmax())], share=float(share.max()))
        enough = self.limits.clearance
        left, what = path_clearance(self.now, COARSE, acceleration, hold, enough, *path, self.model.chain)
        if left < enough:
            return Failure(SwingFailure.CLEARANCE, distance=max(0.0, left), obstacle=OBSTACLES[what])
        torque = torque_shares(self.model, self.now, 2.0 * COARSE, *path)
        if torque.max() > self.limits.torque_share:
            return Failure(SwingFailure.TORQUE_LIMIT, joint=names[int(torque.argmax())], share=float(torque.max()))
        return None


def _homeward(model: ArmModel, limits: SwingLimits, q: Array, qdot: Array, qddot: Array) -> tuple[Path, Failure | None]:
    """The first way to waiting that nothing is in: at once, by a soft stop, by the shortest stop; else the last, and what is in it."""
    for softly in (None, SOFT, 1.0):
        path = Path(model, limits)
        reason = path.hits() if path.home(q, qdot, qddot, softly) else Failure(SwingFailure.NO_WAY_BACK, bound=LONGEST)
        if reason is None:
            break
    return path, reason


def strike(
    model: ArmModel, start: Joints, target: Reach, strike_time: float, limits: SwingLimits
) -> tuple[Swing | None, float, Failure | None]:
    """The swing through the target, or None; the earliest possible strike (s), inf if there is none; and why there is no swing.

    See `plan`; this spares the way home of an arm that makes no strike.
    """
    start = _begin(model, start, limits)
    if target.reason is not None:
        return None, math.inf, target.reason
    path, moving = Path(model, limits), _moves(start.qdot, start.qddot, limits)
    ends = (np.array(start.q), np.array(start.qdot), np.array(start.qddot), target.q, target.qdot)
    time, shortest = strike_time - start.time, path.longer(0.0, *ends)
    earliest = start.time + shortest
    if math.isinf(shortest):
        return None, earliest, Failure(SwingFailure.NO_WAY)
    if time < shortest:
        return None, earliest, Failure(SwingFailure.TOO_SOON, missing=shortest - time)
    reason: Failure | None = None
    for hurry in (limits.unhurried, 1.0):
        path = Path(model, limits)
        approach = path.longer(time if moving else min(time, hurry * shortest), *ends)
        if approach > time + SAME:
            reason = Failure(SwingFailure.TOO_FAST if moving else SwingFailure.TOO_LATE)
            continue
        if approach < time:
            path.rest(ends[0], time - approach)
        path.leg(approach, *ends)
        reason = path.hits()
        if reason is None:
            break
    if reason is not None:
        return None, earliest, reason
    homeward, reason = _homeward(model, limits, target.q, target.qdot, np.zeros(7))
    if reason is not None:
        return None, earliest, reason
    path.join(homeward)
    return Swing(start, strike_time, start.time + path.now, earliest, None, path.knots, path.coefficients), earliest, None


def _begin(model: ArmModel, start: Joints, limits: SwingLimits) -> Joints:
    """The start within the limits, without acceleration where none is kept."""
    speed, kept = limits.speed_share * model.speed_limits, limits.acceleration
    qdot, qddot = np.clip(start.qdot, -speed, speed), np.clip(start.qddot, -kept, kept)
    if limits.profile == "polyline" or not _moves(qdot, qddot, limits):
        qddot = np.zeros(7)
    same = (qdot == start.qdot).all() and (qddot == start.qddot).all()
    return start if same else Joints(start.time, start.q, qdot, qddot)


def _moves(qdot: Array, qddot: Array, limits: SwingLimits) -> bool:
    """Whether the arm does, or is about to."""
    return bool((np.abs(qdot) + 0.5 * qddot**2 / limits.jerk).max() > AT_REST)


def plan(model: ArmModel, start: Joints, target: Reach | None, strike_time: float, limits: SwingLimits | None = None) -> Swing:
    """The swing from `start` that has the joints at target.q with target.qdot at `strike_time` (s), and then waits for the next ball.

    A start at rest is held as long as an unhurried approach allows; a moving start has no jump in position or speed, nor in acceleration
    but with the profile "polyline". target None only returns to waiting. The start's speeds must be within the limits.
    Raises OutOfRange, NotFinite.
    """
    limits = limits or SwingLimits()
    strike_time, start = check_range("strike_time", strike_time, -1e18, 1e18), _begin(model, start, limits)
    swing, earliest, reason = (None, math.inf, None) if target is None else strike(model, start, target, strike_time, limits)
    if swing is not None:
        return swing
    qdot = np.array(start.qdot) if _moves(start.qdot, start.qddot, limits) else np.zeros(7)
    path, _ = _homeward(model, limits, np.array(start.q), qdot, np.array(start.qddot))
    return Swing(start, math.inf, start.time + path.now, earliest, reason, path.knots, path.coefficients)
