"""When each joint moves: from where it is, through the strike at its instant, slowing down, and back to waiting, as one path.

The loop is that of dissertation Figure 1.9: approach, strike, slow down, return. Slowing down and returning are one leg, in which each
joint turns back as soon as it can, or two legs with a stop between them where something is in the way. A leg takes one time for all
joints, with one of the profiles of `trajectory.legs`.

The stages follow each other: approach to the strike, check, return to waiting, check, swing. `plan` calls them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from tt_core.errors import TtError, check_array, check_range
from tt_core.failures import Failure
from tt_core.states import Array

from .joints import JointLimits, Joints
from .model import ArmModel
from .reach import Reach
from .trajectory.jerk import SAME
from .trajectory.legs import LONGEST_LEG, PROFILES, STEP, Leg, make_leg
from .trajectory.limits import SwingFailure, SwingLimits
from .trajectory.path import Path
from .trajectory.path_check import path_failure
from .trajectory.profiles import evaluate

__all__ = ["LONGEST_LEG", "PROFILES", "NoStop", "StrikePlan", "Swing", "SwingFailure", "SwingLimits", "plan", "strike"]

AT_REST = 1e-3  # rad/s, below which a joint may wait where it is
SOFT = 1.6  # times the least time to slow down: a quintic without acceleration at its ends needs 1.5


class NoStop(TtError):
    """There is no way to come to rest within LONGEST_LEG.

    Attributes:
        qdot: (n,) rad/s, at the start.
        qddot: (n,) rad/s^2, at the start.
    """

    def __init__(self, qdot: Array, qddot: Array) -> None:
        """Keep the state."""
        super().__init__(f"there is no way to stop within {LONGEST_LEG:g} s from qdot = {qdot}, qddot = {qddot}")
        self.qdot, self.qddot = qdot, qddot


@dataclass(frozen=True, slots=True, eq=False)
class Swing:
    """A path of all joints over time.

    Attributes:
        start: Where it begins.
        strike_time: s; inf if there is no strike.
        end_time: s, from when on the arm is at rest.
        earliest: s, when the strike would have been possible at the earliest; inf if never.
        reason: Why there is no strike, or None. Without a strike the path only brakes and returns to waiting.
        knots: (joints, n) s since `start.time`, where the polynomials begin, padded with inf.
        coefficients: (joints, n, 6) of the polynomials in s since the knot, lowest power first.
    """

    start: Joints
    strike_time: float
    end_time: float
    earliest: float
    reason: Failure | None
    knots: Array = field(repr=False)
    coefficients: Array = field(repr=False)

    def sample(self, time: float) -> tuple[Array, Array]:
        """Return q (n,) rad and qdot (n,) rad/s at `time` (s). Before the start the motion is straight, after the end it is rest."""
        q, qdot, _ = self._at(time)
        return q, qdot

    def joints(self, time: float) -> Joints:
        """Return the motion at `time` (s) with the acceleration, from where another swing can take over."""
        return Joints(time, *self._at(time))

    def _at(self, time: float) -> tuple[Array, Array, Array]:
        n = len(self.knots)
        q, qdot, qddot = np.empty(n), np.empty(n), np.empty(n)
        evaluate(time - self.start.time, self.knots, self.coefficients, q, qdot, qddot)
        return q, qdot, qddot

    def table(self, step: float) -> tuple[Array, Array, Array]:
        """Sample the swing every `step` (s), and at strike and end.

        Returns:
            Times (n,) s since `start.time`, q (n, joints) and qdot (n, joints).
        """
        end = self.end_time - self.start.time
        times = np.unique(np.append(np.arange(0.0, end, step), [end, min(end, self.strike_time - self.start.time)]))
        rows = [self.sample(self.start.time + t) for t in times]
        return times, np.array([q for q, _ in rows]), np.array([qdot for _, qdot in rows])


class Task(NamedTuple):
    """Whose swing is planned, and within which limits."""

    model: ArmModel
    limits: SwingLimits
    joints: JointLimits  # those that the limits leave

    @classmethod
    def of(cls, model: ArmModel, limits: SwingLimits) -> Task:
        """Return the task for an arm and its limits."""
        return cls(model, limits, limits.of_joints(model))

    def new_path(self) -> Path:
        """Return an empty path within these limits."""
        return Path(self.joints.bounds, self.limits.profile)

    def is_moving(self, qdot: Array, qddot: Array) -> bool:
        """Return whether an arm with qdot (n,) rad/s moves, or will when its qddot (n,) rad/s^2 is reduced to zero."""
        return bool((np.abs(qdot) + 0.5 * qddot**2 / self.joints.jerk).max() > AT_REST)


class StrikePlan(NamedTuple):
    """What came of planning a strike."""

    swing: Swing | None
    earliest: float  # s, when the strike is possible at the earliest; inf if never
    failure: Failure | None  # why there is no swing


def plan(model: ArmModel, start: Joints, target: Reach | None, strike_time: float, limits: SwingLimits | None = None) -> Swing:
    """Plan the swing that has the joints at target.q with target.qdot at `strike_time`, and then waits for the next ball.

    A start at rest is held as long as an unhurried approach allows. A moving start has no jump in position or speed, nor in acceleration
    but with the profile "polyline".

    Args:
        model: The arm.
        start: Where the swing begins; its speeds must be within the limits.
        target: Posture and speeds at the strike; None only returns to waiting.
        strike_time: s.
        limits: What the swing may use.

    Raises:
        BadShape: Start or target have another number of joints.
        OutOfRange: `strike_time` is outside its range.
        NotFinite: `strike_time` is NaN or infinite.
        NoStop: There is no way to come to rest.
    """
    task = Task.of(model, limits or SwingLimits())
    strike_time, start = check_range("strike_time", strike_time, -1e18, 1e18), _within_limits(task, start)
    if target is not None:
        check_array("target.q", target.q, (len(model.names),))
    planned = StrikePlan(None, math.inf, None) if target is None else _strike(task, start, target, strike_time)
    if planned.swing is not None:
        return planned.swing
    qdot = start.qdot if task.is_moving(start.qdot, start.qddot) else np.zeros(len(start.q))
    path, _ = _return_path(task, start.q, qdot, start.qddot)
    return Swing(start, math.inf, start.time + path.duration, planned.earliest, planned.failure, *path.pieces[:2])


def strike(model: ArmModel, start: Joints, target: Reach, strike_time: float, limits: SwingLimits) -> StrikePlan:
    """Plan a strike, as `plan` does, without the way home of an arm that makes none.

    Args:
        model: The arm.
        start: Where the swing begins; its speeds must be within the limits.
        target: Posture and speeds at the strike.
        strike_time: s.
        limits: What the swing may use.
    """
    task = Task.of(model, limits)
    return _strike(task, _within_limits(task, start), target, strike_time)


def _strike(task: Task, start: Joints, target: Reach, strike_time: float) -> StrikePlan:
    """Plan a strike from a start within the limits: approach, check, return, check."""
    if target.reason is not None:
        return StrikePlan(None, math.inf, target.reason)
    leg = make_leg(start.q, start.qdot, start.qddot, target.q, target.qdot)
    shortest = task.new_path().shortest_time(0.0, leg)
    earliest, time = start.time + shortest, strike_time - start.time
    if math.isinf(shortest):
        return StrikePlan(None, earliest, Failure(SwingFailure.NO_WAY))
    if time < shortest:
        return StrikePlan(None, earliest, Failure(SwingFailure.TOO_SOON, missing=shortest - time))
    path, failure = _approach(task, leg, time, shortest)
    if failure is None:
        homeward, failure = _return_path(task, target.q, target.qdot, np.zeros(len(start.q)))
    if failure is not None:
        return StrikePlan(None, earliest, failure)
    path.join(homeward)
    return StrikePlan(Swing(start, strike_time, start.time + path.duration, earliest, None, *path.pieces[:2]), earliest, None)


def _approach(task: Task, leg: Leg, time: float, shortest: float) -> tuple[Path, Failure | None]:
    """Return the approach of `time` (s), unhurried if that is possible, otherwise as quick as possible, and the limit that it breaks."""
    moving = task.is_moving(leg["v0"], leg["a0"])
    failure: Failure | None = None
    for hurry in (task.limits.unhurried, 1.0):
        path = task.new_path()
        approach = path.shortest_time(time if moving else min(time, hurry * shortest), leg)
        if approach > time + SAME:
            failure = Failure(SwingFailure.TOO_FAST if moving else SwingFailure.TOO_LATE)
            continue
        if approach < time:
            path.rest(leg["q0"].copy(), time - approach)
        path.leg(approach, leg)
        failure = path_failure(path, task.model, task.limits)
        if failure is None:
            break
    return path, failure


def _return_path(task: Task, q: Array, qdot: Array, qddot: Array) -> tuple[Path, Failure | None]:
    """Return the first way to waiting that breaks no limit: at once, by a soft stop, or by the shortest stop.

    If there is none: the last one, and the limit that it breaks.
    """
    for softly in (None, SOFT, 1.0):
        path = task.new_path()
        arrives = append_return(path, task, make_leg(q, qdot, qddot, task.model.waiting, np.zeros(len(q))), softly)
        failure = path_failure(path, task.model, task.limits) if arrives else Failure(SwingFailure.NO_WAY_BACK, bound=LONGEST_LEG)
        if failure is None:
            break
    return path, failure


def append_return(path: Path, task: Task, leg: Leg, softly: float | None) -> bool:
    """Append slowing down, returning and waiting.

    Args:
        path: What is there so far.
        task: The arm and its limits.
        leg: From the motion at the start to waiting.
        softly: Duration of a stop on the way, in its least times; None for no stop.

    Returns:
        Whether there is such a way within LONGEST_LEG. Where there is none, the path ends with the stop.
    """
    if softly is not None and (leg["v0"].any() or leg["a0"].any()):
        time, brake = _brake(path, task, leg, softly)
        path.leg(time, brake)
        leg = make_leg(brake["q1"], np.zeros(len(leg)), np.zeros(len(leg)), leg["q1"], leg["v1"])
    least = max(STEP, path.shortest_time(0.0, leg))
    time = path.shortest_time(task.limits.unhurried_return * least, leg)
    found = not math.isinf(time)
    if found:
        path.leg(time, leg)
    path.rest(leg["q1" if found else "q0"].copy(), 0.0)
    return found


def _brake(path: Path, task: Task, leg: Leg, softly: float) -> tuple[float, Leg]:
    """Return duration (s) and leg of a stop: the first that is possible, which ends halfway between going on and stopping at once."""
    q0, v0, a0 = leg["q0"], leg["v0"], leg["a0"]
    time = float((softly * np.abs(v0) / task.joints.acceleration).max())
    while time < LONGEST_LEG:
        brake = make_leg(q0, v0, a0, q0 + 0.5 * time * v0, np.zeros(len(q0)))
        if path.is_possible(time, brake):
            return time, brake
        time += STEP
    raise NoStop(v0, a0)


def _within_limits(task: Task, start: Joints) -> Joints:
    """Return the start with speeds and accelerations within the limits, and without acceleration where none is kept."""
    check_array("start.q", start.q, (len(task.model.names),))
    speed, acceleration = task.joints.speed, task.joints.acceleration
    qdot, qddot = np.clip(start.qdot, -speed, speed), np.clip(start.qddot, -acceleration, acceleration)
    if task.limits.profile == "polyline" or not task.is_moving(qdot, qddot):
        qddot = np.zeros(len(qdot))
    same = (qdot == start.qdot).all() and (qddot == start.qddot).all()
    return start if same else Joints(start.time, start.q, qdot, qddot)
