"""Plan a swing: the motion of all joints from their present state through the strike at its time and back to the waiting posture.

The strike is the time at which the racket hits the ball. The phases are those of the dissertation's Figure 1.9: approach, strike, slow
down, return. A leg is a motion in which all joints begin and end together, with one of the profiles of `trajectory.legs`. Slowing down and
returning are one leg, in which each joint turns back as soon as it can; or two legs with a stop between them, where something is in the
way of the single leg.

`plan` plans the approach to the strike, checks it, plans the return to the waiting posture, and checks that.
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
from .trajectory.jerk import SAME_DURATION
from .trajectory.legs import LEG_STEP, LONGEST_LEG, PROFILE_NAMES, Leg, make_leg
from .trajectory.limits import SwingFailure, SwingLimits
from .trajectory.path import Path
from .trajectory.path_check import path_failure
from .trajectory.profiles import evaluate_path

__all__ = ["PROFILE_NAMES", "NoStop", "StrikePlan", "Swing", "SwingFailure", "SwingLimits", "plan", "strike"]

REST_SPEED = 1e-3  # rad/s, speed below which a joint counts as being at rest
SOFT = 1.6  # duration of a soft stop over the least time to slow down; a quintic without acceleration at its ends needs 1.5


class NoStop(TtError):
    """There is no way to come to rest within LONGEST_LEG.

    Attributes:
        qdot: (n,) rad/s, joint speeds at the start.
        qddot: (n,) rad/s^2, joint accelerations at the start.
    """

    def __init__(self, qdot: Array, qddot: Array) -> None:
        """Keep the state."""
        super().__init__(f"there is no way to stop within {LONGEST_LEG:g} s from qdot = {qdot}, qddot = {qddot}")
        self.qdot, self.qddot = qdot, qddot


@dataclass(frozen=True, slots=True, eq=False)
class Swing:
    """A planned motion of all joints over time, as polynomials: a strike and the return, or only the return to the waiting posture.

    Attributes:
        start: State of the joints at which the motion begins.
        strike_time: s, time at which the racket hits the ball; inf if there is no strike.
        end_time: s, time from which on the arm is at rest.
        earliest: s, earliest time at which the strike would have been possible; inf if it is not possible at any time.
        reason: Why there is no strike; None if there is one, or if none was asked for. Without a strike the arm only brakes and returns to
            the waiting posture.
        knots: (joints, n) s since `start.time`, times at which the polynomials begin, padded with inf.
        coefficients: (joints, n, 6) coefficients of the polynomials in the time (s) since the knot, lowest power first; positions in rad
            or m.
    """

    start: Joints
    strike_time: float
    end_time: float
    earliest: float
    reason: Failure | None
    knots: Array = field(repr=False)
    coefficients: Array = field(repr=False)

    def sample(self, time: float) -> tuple[Array, Array]:
        """Return joint positions (n,) rad and speeds (n,) rad/s at `time` (s).

        Before the start of the swing the joints move with constant speed; after its end they are at rest.
        """
        q, qdot, _ = self._at(time)
        return q, qdot

    def joints(self, time: float) -> Joints:
        """Return the state of the joints at `time` (s), with accelerations, so that another swing can start from it."""
        return Joints(time, *self._at(time))

    def _at(self, time: float) -> tuple[Array, Array, Array]:
        n = len(self.knots)
        q, qdot, qddot = np.empty(n), np.empty(n), np.empty(n)
        evaluate_path(time - self.start.time, self.knots, self.coefficients, q, qdot, qddot)
        return q, qdot, qddot

    def table(self, step: float) -> tuple[Array, Array, Array]:
        """Sample the swing every `step` (s), and also at the strike and at the end.

        Returns:
            Times (n,) s since `start.time`, positions (n, joints) rad and speeds (n, joints) rad/s.
        """
        end = self.end_time - self.start.time
        times = np.unique(np.append(np.arange(0.0, end, step), [end, min(end, self.strike_time - self.start.time)]))
        rows = [self.sample(self.start.time + t) for t in times]
        return times, np.array([q for q, _ in rows]), np.array([qdot for _, qdot in rows])


class SwingTask(NamedTuple):
    """The arm for which a swing is planned, and the limits that the swing must keep.

    Attributes:
        model: The arm.
        limits: Parameters that limit swings.
        joints: Limits of the joints that follow from both.
    """

    model: ArmModel
    limits: SwingLimits
    joints: JointLimits

    @classmethod
    def of(cls, model: ArmModel, limits: SwingLimits) -> SwingTask:
        """Return the task for an arm and the parameters that limit its swings."""
        return cls(model, limits, limits.of_joints(model))

    def new_path(self) -> Path:
        """Return an empty path, to which legs within these limits can be appended."""
        return Path(self.joints.bounds, self.limits.profile)

    def is_moving(self, qdot: Array, qddot: Array) -> bool:
        """Return whether the arm moves, or will move while its acceleration is reduced to zero.

        Args:
            qdot: (n,) rad/s, joint speeds.
            qddot: (n,) rad/s^2, joint accelerations.
        """
        return bool((np.abs(qdot) + 0.5 * qddot**2 / self.joints.jerk).max() > REST_SPEED)


class StrikePlan(NamedTuple):
    """Result of planning a strike: the swing, or the reason why there is none.

    Attributes:
        swing: The swing with the strike; None if it is not possible.
        earliest: s, earliest time at which the strike is possible; inf if it is not possible at any time.
        failure: Why there is no swing; None if there is one.
    """

    swing: Swing | None
    earliest: float
    failure: Failure | None


def plan(model: ArmModel, start: Joints, target: Reach | None, strike_time: float, limits: SwingLimits | None = None) -> Swing:
    """Plan the swing in which the joints have the positions and speeds of `target` at `strike_time`, and then return to wait.

    If the arm is at rest at the start, it waits there as long as an unhurried approach permits. If it moves, position and speed continue
    without a jump, and so does the acceleration except with the profile "polyline". If the strike is not possible, the swing only returns
    to the waiting posture.

    Args:
        model: The arm.
        start: State of the joints at which the swing begins. Speeds and accelerations beyond the limits are cut to them.
        target: Joint positions and speeds at the strike; None to return to the waiting posture without a strike.
        strike_time: s, time of the strike.
        limits: Limits that the swing must keep; None for the default.

    Returns:
        The swing. Its `reason` tells why it has no strike.

    Raises:
        BadShape: Start or target have another number of joints.
        OutOfRange: `strike_time` is outside its range.
        NotFinite: `strike_time` is NaN or infinite.
        NoStop: There is no way to come to rest.
    """
    task = SwingTask.of(model, limits or SwingLimits())
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
    """Plan a swing with a strike as `plan` does, but plan no return to the waiting posture if the strike is not possible.

    Args:
        model: The arm.
        start: State of the joints at which the swing begins. Speeds and accelerations beyond the limits are cut to them.
        target: Joint positions and speeds at the strike.
        strike_time: s, time of the strike.
        limits: Limits that the swing must keep.

    Returns:
        The swing, or the reason why there is none.
    """
    task = SwingTask.of(model, limits)
    return _strike(task, _within_limits(task, start), target, strike_time)


def return_time(model: ArmModel, target: Reach, strike_time: float, limits: SwingLimits) -> float:
    """Return the time (s) at which the arm waits again after a strike, without a check whether its way back keeps all limits.

    Args:
        model: The arm.
        target: Joint positions and speeds at the strike.
        strike_time: s, time of the strike.
        limits: Limits that the swing must keep.
    """
    task, rest = SwingTask.of(model, limits), np.zeros(len(model.names))
    return strike_time + _time_back(task.new_path(), task, make_leg(target.q, target.qdot, rest, model.waiting, rest))


def _time_back(path: Path, task: SwingTask, leg: Leg) -> float:
    """Return the duration (s) of a return to the waiting posture along a leg; inf if it is not possible."""
    least = max(LEG_STEP, path.shortest_time(0.0, leg))
    return path.shortest_time(task.limits.unhurried_return * least, leg)


def _strike(task: SwingTask, start: Joints, target: Reach, strike_time: float) -> StrikePlan:
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


def _approach(task: SwingTask, leg: Leg, time: float, shortest: float) -> tuple[Path, Failure | None]:
    """Return the approach, which arrives after `time` (s), and the reason why it is not possible, or None.

    A slow (unhurried) approach is tried first, then the shortest one, whose duration is `shortest` (s).
    """
    moving = task.is_moving(leg["v0"], leg["a0"])
    failure: Failure | None = None
    for hurry in (task.limits.unhurried, 1.0):
        path = task.new_path()
        approach = path.shortest_time(time if moving else min(time, hurry * shortest), leg)
        if approach > time + SAME_DURATION:
            failure = Failure(SwingFailure.TOO_FAST if moving else SwingFailure.TOO_LATE)
            continue
        if approach < time:
            path.rest(leg["q0"].copy(), time - approach)
        path.leg(approach, leg)
        failure = path_failure(path, task.model, task.limits)
        if failure is None:
            break
    return path, failure


def _return_path(task: SwingTask, q: Array, qdot: Array, qddot: Array) -> tuple[Path, Failure | None]:
    """Return the path to the waiting posture, and None, or the limit that it breaks.

    Three ways are tried until one keeps all limits: without a stop, with a soft stop, and with the shortest stop. If none does, the last
    one is returned.
    """
    for softly in (None, SOFT, 1.0):
        path = task.new_path()
        arrives = append_return(path, task, make_leg(q, qdot, qddot, task.model.waiting, np.zeros(len(q))), softly)
        failure = path_failure(path, task.model, task.limits) if arrives else Failure(SwingFailure.NO_WAY_BACK)
        if failure is None:
            break
    return path, failure


def append_return(path: Path, task: SwingTask, leg: Leg, softly: float | None) -> bool:
    """Append to a path the legs that slow down and return to the waiting posture, and rest there.

    Args:
        path: The path so far, to which the legs are appended.
        task: The arm and the limits of the swing.
        leg: Ends of the motion: the state of the joints at the end of `path`, and the waiting posture.
        softly: Duration of a stop on the way, as a multiple of the least time to slow down; None for no stop.

    Returns:
        Whether there is such a way. Where there is none, the path ends with the stop.
    """
    if softly is not None and (leg["v0"].any() or leg["a0"].any()):
        time, brake = _brake(path, task, leg, softly)
        path.leg(time, brake)
        leg = make_leg(brake["q1"], np.zeros(len(leg)), np.zeros(len(leg)), leg["q1"], leg["v1"])
    time = _time_back(path, task, leg)
    found = not math.isinf(time)
    if found:
        path.leg(time, leg)
    path.rest(leg["q1" if found else "q0"].copy(), 0.0)
    return found


def _brake(path: Path, task: SwingTask, leg: Leg, softly: float) -> tuple[float, Leg]:
    """Return duration (s) and leg of the shortest possible stop, at least `softly` times the least time to slow down.

    During the stop each joint moves by half of the distance that it would move at its present speed. Raises NoStop.
    """
    q0, v0, a0 = leg["q0"], leg["v0"], leg["a0"]
    time = float((softly * np.abs(v0) / task.joints.acceleration).max())
    while time < LONGEST_LEG:
        brake = make_leg(q0, v0, a0, q0 + 0.5 * time * v0, np.zeros(len(q0)))
        if path.is_possible(time, brake):
            return time, brake
        time += LEG_STEP
    raise NoStop(v0, a0)


def _within_limits(task: SwingTask, start: Joints) -> Joints:
    """Return the start with speeds and accelerations cut to the limits; without acceleration for "polyline" or an arm at rest."""
    check_array("start.q", start.q, (len(task.model.names),))
    speed, acceleration = task.joints.speed, task.joints.acceleration
    qdot, qddot = np.clip(start.qdot, -speed, speed), np.clip(start.qddot, -acceleration, acceleration)
    if task.limits.profile == "polyline" or not task.is_moving(qdot, qddot):
        qddot = np.zeros(len(qdot))
    same = (qdot == start.qdot).all() and (qddot == start.qddot).all()
    return start if same else Joints(start.time, start.q, qdot, qddot)
