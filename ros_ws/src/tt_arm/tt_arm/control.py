"""The arm from strokes and joint states to commands, without ROS. It keeps the swing; the guard checks each command last.

Two threads may share one `ArmControl`: `step`, `refuse`, `watch` and `enable` belong to the thread of the servo, `take`, which plans for
milliseconds, to another one. A swing that was planned while the arm was stopped is dropped.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from tt_core.errors import TtError, check_range
from tt_core.failures import Failure
from tt_core.params import check, param
from tt_core.states import Array, RacketState

from . import dissertation
from .joints import Joints
from .model import ArmModel
from .reach import Reach, ReachParams, reach
from .safety.guard import Guard, GuardParams
from .safety.joint_states import JointStateCheck, JointStateParams
from .safety.stops import ArmStop
from .servo import ServoParams, follow
from .stroke_correction import stroke_distance
from .stroke_selection import Refusal, SelectionParams, StrokeSelection, select_sooner, select_stroke
from .swing import Swing, SwingLimits, plan, strike
from .trajectory.legs import make_leg
from .trajectory.path import Path

AT_REST = 0.02  # rad/s, below which a stop is over
AT_WAITING = 0.02  # rad, from the waiting posture, within which the first motion after enabling is over


@dataclass(frozen=True, slots=True)
class ControlParams:
    """When strokes are taken, and when a path is given up."""

    ahead: float = param(
        0.006,
        "s",
        "time from a joint state to the begin of the swing planned on it; no more than `servo.lead`, so that it begins once it is planned",
        low=0.0,
        high=0.5,
    )
    replan: bool = param(True, "", "whether newer strokes for the ball on its way may change the swing")
    replan_distance: float = param(
        0.002, "m", "distance of a newer stroke from the present one, below which the swing stays; see `stroke_distance`", low=0.0, high=1.0
    )
    same_ball: float = param(
        0.2,
        "s",
        "time between two strikes below which they are for one ball; at 94 balls a minute those of two balls are 0.3 s apart",
        low=0.0,
        high=10.0,
    )
    commit: float = param(
        0.06,
        "s",
        "time before the strike from which newer strokes for its ball change nothing; room for planning and a smooth change",
        low=0.0,
        high=1.0,
    )
    largest_correction: float = param(
        1.0, "m", "distance of a newer stroke from the present one, above which the swing stays; see `stroke_distance`", low=0.0, high=10.0
    )
    hurry: float = param(
        1.0,
        "s",
        "time between the strikes for two balls below which the arm hurries: it selects the stroke after which it waits again soonest",
        low=0.0,
        high=1000.0,
    )
    lost: float = param(0.15, "rad", "distance of any joint from the path at which the swing is given up", low=0.01, high=3.0)
    rejoin: float = param(
        0.03,
        "rad",
        "distance of any joint from the path above which the swing is given up after a gap in the joint states",
        low=0.0,
        high=3.0,
    )
    horizon: float = param(3.0, "s", "time to the strike above which a stroke is refused", low=0.1, high=1000.0)
    patience: float = param(0.1, "s", "time for which commands are cut without a pause before their path is given up", low=0.0, high=10.0)
    failures: int = param(
        3,
        "",
        "paths that are given up within `failure_window` because the arm did not follow, after which it rests for `pause`",
        low=1,
        high=100,
    )
    failure_window: float = param(1.0, "s", "time within which paths that are given up are counted, see `failures`", low=0.01, high=100.0)
    pause: float = param(1.0, "s", "rest after `failures`, after which the arm tries again, slowly as after enabling", low=0.0, high=100.0)
    first_speed: float = param(0.15, "", "share of the speed limits for the first motion after enabling", low=0.01, high=1.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


@dataclass(frozen=True, slots=True, eq=False)
class ControlStep:
    """What follows from one joint state.

    Attributes:
        command: (n,) rad/s.
        reason: Why it is not what the swing wants, or None.
        begun: The swing that begins with this command, or None.
        interrupted: Whether a stroke was given up because of a gap; its strokes may be taken again.
    """

    command: Array
    reason: Failure | None = None
    begun: Swing | None = None
    interrupted: bool = False


class ArmControl:
    """The arm's controller. Call `step` with each joint state and `take` with each set of strokes; both only use the times they are given.

    Attributes:
        enabled: Whether motion is switched on.
        joints: The last joint state that was accepted, None before the first and after silence.
        limits: What swings may use, at full speed.
        swing: The swing on its way, or None.
        coming: The swing that begins next, or None.
        stroke: The stroke on its way and its posture, or None.
        held: Why the arm must not move for now, by the name of who calls `hold`.
    """

    def __init__(
        self,
        model: ArmModel,
        limits: SwingLimits | None = None,
        reaching: ReachParams | None = None,
        servo: ServoParams | None = None,
        guard: GuardParams | None = None,
        selection: SelectionParams | None = None,
        params: ControlParams | None = None,
        states: JointStateParams | None = None,
    ) -> None:
        """Begin at rest, not enabled.

        Args:
            model: The arm.
            limits: What swings may use.
            reaching: What the posture search weighs.
            servo: Feed-forward and feedback.
            guard: What the guard lets through.
            selection: How many candidates are tried.
            params: When strokes are taken, and when a path is given up.
            states: Which joint states are used.
        """
        self.model, self.limits, self.reaching = model, limits or SwingLimits(), reaching or ReachParams()
        self.servo, self.selection, self.params = servo or ServoParams(), selection or SelectionParams(), params or ControlParams()
        self.guard = Guard(model, guard, self.limits)
        self.states = JointStateCheck(model, states)
        self.enabled, self._off = False, Failure(ArmStop.NOT_ENABLED)
        self.joints: Joints | None = None
        self.swing: Swing | None = None
        self.coming: Swing | None = None
        self.stroke: tuple[RacketState, Reach] | None = None
        self.held: dict[str, Failure] = {}
        self._refusal: tuple[Failure | None, float] = None, -np.inf  # why a joint state was refused last, and when (s, monotonic)
        self._scale = 1.0
        self._arriving = False  # until the waiting posture is reached for the first time
        self._cut_since: float | None = None
        self._rest: Failure | None = None  # why the arm comes to rest before it plans anew
        self._given_up: deque[float] = deque(maxlen=self.params.failures)  # s, when paths were, because the arm did not follow
        self._pause: tuple[Failure, float] | None = None  # why the arm rests for a while, and until when (s, monotonic)
        self._begin = -np.inf  # s, the strike before the coming one, which no newer swing may touch
        self._before = self._ball = -np.inf  # s, when the ball before this one, and this one, can be hit first
        self._lock, self._stops = threading.Lock(), 0  # how often the swing was given up

    def enable(self, on: bool, reason: Failure | None = None) -> None:
        """Switch motion on or off.

        Args:
            on: True resets what has latched. False begins a controlled stop.
            reason: Why the arm is switched off.
        """
        self.enabled, self._off = on, reason or Failure(ArmStop.NOT_ENABLED)
        self._forget()
        if on:
            self.guard.reset()
            self._arriving = True
            self._given_up.clear()
            self._rest = self._pause = None

    @property
    def speed_scale(self) -> float:
        """Share of the speed limits that motion may use, 0.01 to 1; may be set at any time."""
        return self._scale

    @speed_scale.setter
    def speed_scale(self, scale: float) -> None:
        self._scale = check_range("speed_scale", scale, 0.01, 1.0)
        self._give_up()

    def hold(self, who: str, failure: Failure | None) -> None:
        """Stop the arm for `failure` until `who` calls again with None."""
        if failure is None:
            self.held.pop(who, None)
        else:
            self.held[who] = failure

    @property
    def stopped_by(self) -> Failure | None:
        """Return why the arm must not move at all, whatever the joint states are; None when it may."""
        if self.guard.latched is not None:
            return self.guard.latched
        held = tuple(self.held.values())  # a copy: two threads look
        return (held[0] if held else None) if self.enabled else self._off

    def step(self, joints: Joints, now: float | None = None, clock: float | None = None, *, has_speeds: bool = True) -> ControlStep:
        """Return the command for the time of `joints`: along the swing, else towards waiting, else that of a stop.

        Args:
            joints: As measured.
            now: s, monotonic, when it came; its own time if None.
            clock: s, what the clock of the stamps showed then; None where there is no such clock.
            has_speeds: See `JointStateCheck.accept`.
        """
        now = joints.time if now is None else now
        before = self.states.last
        accepted = self.states.accept(joints, now, clock, has_speeds=has_speeds)
        if isinstance(accepted, Failure):
            return self.refuse(now, accepted)
        clock_went_back = before is not None and accepted.time <= before.time
        interrupted = clock_went_back and self.stroke is not None
        if clock_went_back:  # what is planned is for times of the old clock
            self._forget()
        self.joints = joints = accepted
        age = 0.0 if clock is None else min(max(clock - joints.time, 0.0), self.states.params.late)
        damage = self.guard.look(joints, self.states.gap)
        stopped = self.stopped_by or damage or self._paused(now)
        if stopped is not None:
            self._forget()
            self._arriving = self._arriving or damage is not None
            return ControlStep(self.guard.stop(now, joints, age), stopped)
        interrupted = (self.states.gap and self._resume(joints)) or interrupted
        if self._rest is not None and (self.guard.last.any() or np.abs(joints.qdot).max() > AT_REST):
            return ControlStep(self.guard.stop(now, joints, age), self._rest, interrupted=interrupted)
        self._rest = None
        self.guard.speed_scale = self._speed
        if (np.abs(self.guard.last) > self._speed * self.model.speed_limits + 1e-9).any():
            return ControlStep(self.guard.stop(now, joints, age), Failure(ArmStop.SLOWING, scale=self._speed))
        return self._follow(joints, now, age, interrupted)

    def refuse(self, now: float, failure: Failure) -> ControlStep:
        """Return the next command of a stop, for a joint state that cannot be used. The swing may go on with the next good one."""
        self._refusal = failure, now
        return ControlStep(self.guard.stop(now), self.stopped_by or failure)

    def watch(self, now: float) -> ControlStep | None:
        """Return the next command of a stop when at `now` (s, monotonic) joint states have ceased; None while all is well."""
        silence = self.states.silence(now) if self.states.last is not None else None
        if silence is None:
            return None
        self.joints = None
        failure, at = self._refusal
        reason = failure if now - at < self.states.deadline else silence  # states that come but cannot be used tell more than silence
        return ControlStep(self.guard.stop(now), self.stopped_by or reason)

    def take(self, rackets: Sequence[RacketState]) -> StrokeSelection:
        """Plan for the candidate strokes, in order of preference. The swing begins by itself in a later `step`."""
        with self._lock:
            stops, joints, swing, coming, begin = self._stops, self.joints, self.swing, self.coming, self._begin
            stroke = self.stroke
        stopped = self.stopped_by
        if stopped is not None:
            return _refused(stopped)
        if joints is None or swing is None:
            return _refused(Failure(ArmStop.NO_STATE))
        if self._arriving and not self._arrived(joints):
            return _refused(Failure(ArmStop.ARRIVING))
        if rackets and min(r.time for r in rackets) > joints.time + self.params.horizon:
            return _refused(Failure(ArmStop.FAR_AHEAD, ahead=rackets[0].time - joints.time, bound=self.params.horizon))
        left = stroke[0].time - joints.time if stroke is not None else -np.inf
        if stroke is not None and left < self.params.commit and any(abs(r.time - stroke[0].time) < self.params.same_ball for r in rackets):
            return _refused(Failure(ArmStop.SWING_COMMITTED, left=left, bound=self.params.commit))
        current = stroke if left > 0.0 else None
        if current is not None and any(abs(r.time - current[0].time) < self.params.same_ball for r in rackets):
            if not self.params.replan:
                return _refused(Failure(ArmStop.SWING_ON_ITS_WAY))
            correction = min(stroke_distance(current[0], r) for r in rackets)
            if correction < self.params.replan_distance:
                return _refused(Failure(ArmStop.SWING_WILL_DO))
            if correction > self.params.largest_correction:
                return _refused(Failure(ArmStop.CORRECTION_TOO_LARGE, distance=correction, bound=self.params.largest_correction))
        elif current is not None:  # another ball: what is on its way comes first
            begin, current = current[0].time, None
        time = max(joints.time + self.params.ahead, begin)
        start = _path_at(time, swing, coming).joints(time)
        hurried = self._hurries(rackets)
        selected = select_stroke(self.model, rackets, start, self._limits, self.reaching, self.selection, current, hurried)
        if selected.swing is None or not self._commit(selected, begin, stops):
            return selected if selected.swing is None else _refused(Failure(ArmStop.STOPPED_MEANWHILE))
        return self._sooner(selected, rackets, start, begin, stops) if hurried and current is None else selected

    def _commit(self, selected: StrokeSelection, begin: float, stops: int) -> bool:
        """Let a selected swing come next, unless the swing was given up since `stops`; return whether it comes."""
        if selected.racket is None or selected.reach is None:
            return False
        with self._lock:
            if stops != self._stops:
                return False
            self.coming, self.stroke, self._begin = selected.swing, (selected.racket, selected.reach), begin
        return True

    def _sooner(
        self, selected: StrokeSelection, rackets: Sequence[RacketState], start: Joints, begin: float, stops: int
    ) -> StrokeSelection:
        """Change a swing that comes or has begun to the candidate after which the arm waits again soonest, and return the selection.

        The arm need not wait for the posture search of all candidates: it moves on the first one meanwhile, and from there to the best one.
        """
        sooner = select_sooner(self.model, rackets, start, self._limits, self.reaching, self.selection, selected)
        with self._lock:
            joints, swing, coming = self.joints, self.swing, self.coming
        if sooner is selected or joints is None or swing is None or sooner.racket is None or sooner.reach is None:
            return selected
        time = max(joints.time + self.params.ahead, begin)
        planned = strike(self.model, _path_at(time, swing, coming).joints(time), sooner.reach, sooner.racket.time, self._limits)
        changed = replace(sooner, swing=planned.swing)
        return changed if planned.swing is not None and self._commit(changed, begin, stops) else selected

    def fail(self, error: Exception, now: float) -> Array:
        """Latch for an error of the program itself.

        Args:
            error: What was raised.
            now: s, monotonic.

        Returns:
            The next command (n,) rad/s of a stop, or zero if not even that can be computed.
        """
        failure = Failure(ArmStop.INTERNAL, error=f"{type(error).__name__}: {error}")
        self._forget()
        try:
            return self.guard.latch(failure, now)
        except Exception:  # nothing here may be trusted
            self.guard.latched = failure
            return np.zeros(len(self.model.names))

    @property
    def _speed(self) -> float:
        """Return the share of the speed limits for now."""
        return self._scale * (self.params.first_speed if self._arriving else 1.0)

    @property
    def _limits(self) -> SwingLimits:
        """Return what swings may use for now."""
        return self.limits if self._speed == 1.0 else replace(self.limits, speed_share=max(0.01, self._speed * self.limits.speed_share))

    def _arrived(self, joints: Joints) -> bool:
        """Return whether the arm is at its waiting posture, which ends the first motion after enabling."""
        if np.abs(joints.q - self.model.waiting).max() < AT_WAITING and np.abs(joints.qdot).max() < AT_REST:
            self._arriving = False
        return not self._arriving

    def _resume(self, joints: Joints) -> bool:
        """Go on after a gap from what is measured; return whether a stroke was given up."""
        self.guard.begin_from(joints.qdot)
        self._cut_since = None
        if self.swing is None or self._off_path(self.swing, joints) <= self.params.rejoin:
            return False
        interrupted = self.stroke is not None
        self._give_up()
        return interrupted

    def _follow(self, joints: Joints, now: float, age: float, interrupted: bool) -> ControlStep:
        """Return the command along the swing. A swing begins, ends and is planned anew here."""
        if self._arriving and self._arrived(joints):
            self._give_up()
        begun = None
        with self._lock:
            if self.coming is not None and joints.time + self.servo.lead >= self.coming.start.time:
                self.swing, self.coming, begun = self.coming, None, self.coming
        if self.swing is not None and self._off_path(self.swing, joints) > self.params.lost:
            self._give_up()
        if self.swing is None:
            try:
                self.swing = plan(self.model, joints, None, joints.time, self._limits)
            except TtError as error:
                return ControlStep(self.guard.stop(now, joints, age), self._does_not_follow(now, error))
        wanted = follow(self.swing, joints.time, joints.q, self._speed * self.model.speed_limits, self.servo)
        planned = self.swing.start.time if joints.time < self.swing.end_time else None  # waiting needs no plan
        command, cut = self.guard.check(joints, wanted, now, planned, age)
        if cut is None:
            self._cut_since = None
        elif self._is_spoilt(cut, joints.time):
            interrupted = interrupted or self.stroke is not None
            cut = self._does_not_follow(now, cut)
        return ControlStep(command, cut, begun, interrupted)

    def _is_spoilt(self, cut: Failure, time: float) -> bool:
        """Return whether the path cannot go on: the guard stopped it, or has cut it for longer than `patience`."""
        self._cut_since = time if self._cut_since is None else self._cut_since
        limits = ArmStop.SPEED_CUT, ArmStop.POSITION_CUT, ArmStop.ACCELERATION_CUT
        return cut.code not in limits or time - self._cut_since > self.params.patience

    def _does_not_follow(self, now: float, last: object) -> Failure:
        """Give up the path. After `failures` of these within `failure_window` the arm rests for `pause`, and then moves slowly."""
        self._give_up()
        self._cut_since = None
        self._given_up.append(now)
        count, window = self.params.failures, self.params.failure_window
        failure = Failure(ArmStop.NOT_FOLLOWING, count=len(self._given_up), window=window, last=last)
        if len(self._given_up) == count and now - self._given_up[0] <= window:
            self._pause, self._arriving = (failure, now + self.params.pause), True
            self._given_up.clear()
        self._rest = last if isinstance(last, Failure) and self._pause is None else failure
        return self._rest

    def _paused(self, now: float) -> Failure | None:
        """Return why the arm rests for a while, or None."""
        if self._pause is not None and now >= self._pause[1]:
            self._pause = None
        return None if self._pause is None else self._pause[0]

    def _off_path(self, swing: Swing, joints: Joints) -> float:
        """Return the largest distance (rad) of a joint from where the swing has it."""
        return float(np.abs(swing.sample(joints.time)[0] - joints.q).max())

    def _hurries(self, rackets: Sequence[RacketState]) -> bool:
        """Return whether these are for a ball that comes soon after another one, whether that was hit or not."""
        ball = min((racket.time for racket in rackets), default=-np.inf)
        if ball > self._ball + self.params.same_ball:
            self._before, self._ball = self._ball, ball
        return self._ball < self._before + self.params.hurry

    def _give_up(self) -> None:
        """Drop all swings and the stroke, and make a planning thread drop what it has planned meanwhile."""
        with self._lock:
            self.swing = self.coming = self.stroke = None
            self._begin, self._stops = -np.inf, self._stops + 1

    def _forget(self) -> None:
        """Drop all swings, and when balls came."""
        self._give_up()
        self._before = self._ball = -np.inf


def _path_at(time: float, swing: Swing, coming: Swing | None) -> Swing:
    """Return which of the swings the arm is on at `time`, s."""
    return coming if coming is not None and coming.start.time <= time else swing


def _refused(failure: Failure) -> StrokeSelection:
    return StrokeSelection.none((Refusal(failure),), failure)


def warm(model: ArmModel) -> None:
    """Compile every kernel of the arm, or load it from the cache, so that none is compiled while a ball flies."""
    control = ArmControl(model)
    control.enable(True)
    joints = Joints.at_rest(0.0, model.waiting)
    control.step(joints)
    middle = model.position_limits.mean(axis=1)
    near = model.waiting + np.clip(0.2 * (middle - model.waiting), -0.1, 0.1)  # rad or m
    position, rotation = model.racket(near)
    velocity = model.jacobian(near)[:3] @ (0.1 * model.speed_limits)
    racket = RacketState.facing(0.5, position, velocity, rotation[:, 2])
    control.take([racket])
    control.take([RacketState(0.5, racket.position + 0.005, racket.velocity, racket.alpha, racket.beta)])
    control.step(Joints.at_rest(0.002, model.waiting))
    for time in (0.004, 0.006):  # kernels that only a moving arm needs
        control.guard.check(Joints(time, joints.q, joints.qdot), np.full(len(joints.q), 0.01), time)
    for method in ("near", "liu") if len(model.names) == dissertation.JOINTS else ("near",):
        reach(model, racket, model.waiting, method=method)
    rest = np.zeros(len(model.names))
    Path(control.limits.of_joints(model).bounds, "auto").is_possible(1.0, make_leg(model.waiting, rest, rest, near, rest))
    for profile in ("quintic", "trapezoid", "polyline"):
        plan(model, joints, None, 0.0, SwingLimits(profile=profile))
