"""Controller of the arm without ROS: it gets strokes and joint states, and returns joint velocity commands.

A stroke is the racket's position, orientation and velocity at one time that returns the ball; a swing is the joint motion that makes it.
The controller keeps the present swing; the guard makes the last check of each command.

Two threads may share one `ArmControl`. The servo's thread calls `step`, `refuse`, `watch` and `enable`; another thread calls `take`, which
needs milliseconds for planning. A swing that was planned while the arm was stopped is dropped.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from tt_core.errors import TtError, check_range
from tt_core.failures import Failure
from tt_core.params import check, param
from tt_core.states import Array, RacketState

from . import dissertation
from .joints import Joints
from .model import ArmModel
from .reach import ReachParams, reach
from .safety.clearance import clearance
from .safety.guard import Guard, GuardParams
from .safety.joint_states import JointStateCheck, JointStateParams
from .safety.stops import ArmStop
from .servo import ServoParams, follow
from .stroke_correction import stroke_distances
from .stroke_selection import PlannedStroke, Refusal, SelectionParams, StrokeSelection, select_sooner, select_stroke
from .swing import Swing, SwingLimits, plan, strike
from .trajectory.legs import make_leg
from .trajectory.path import Path

STOPPED_SPEED = 0.02  # rad/s, joint speed below which a stop is over
AT_WAITING = 0.02  # rad, distance from the waiting posture within which the first motion after enabling is over


@dataclass(frozen=True, slots=True)
class ControlParams:
    """Parameters of the arm's controller: when it takes strokes, and when it replaces a swing (planned joint motion) or gives it up."""

    ahead: float = param(
        0.006,
        "s",
        "time from a joint state to the begin of the swing planned on it; no more than `servo.lead`, so that it begins once it is planned",
        low=0.0,
        high=0.5,
    )
    replan: bool = param(True, "", "whether newer strokes for the ball on its way may change the swing")
    replan_distance: float = param(
        0.002,
        "m",
        "distance of a newer stroke from the present one, below which the swing stays; see `stroke_distances`",
        low=0.0,
        high=1.0,
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
        1.0, "m", "distance of a newer stroke from the present one, above which the swing stays; see `stroke_distances`", low=0.0, high=10.0
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
    """Result of one control step: the command that answers one joint state.

    Attributes:
        command: (n,) rad/s or m/s, joint velocity command.
        reason: Why the command differs from what the swing asks for; None if it does not.
        begun: The swing that begins with this command; None if none begins.
        interrupted: Whether the present stroke was given up, so that the candidate strokes may be passed to `take` again. The cause is a
            gap in the joint states, a clock that went back, or a swing that the guard does not let pass.
    """

    command: Array
    reason: Failure | None = None
    begun: Swing | None = None
    interrupted: bool = False


class ArmControl:
    """Controller of the arm. Call `step` with each joint state, and `take` with each set of candidate strokes.

    A stroke is the racket's position, orientation and velocity at one time that returns the ball; a swing is the joint motion that makes
    it. The controller reads no clock; it uses only the times that it is given.

    Attributes:
        enabled: Whether motion is switched on.
        joints: The last accepted joint state; None before the first one and after joint states have ceased.
        limits: Limits that swings must keep at full speed.
        swing: The present swing; None if there is none.
        coming: The planned swing that begins next; None if there is none.
        stroke: Racket state and posture of the stroke that the arm now moves for; None if there is none.
        held: Reasons why the arm must not move for now, by the names given to `hold`.
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
        """Create a controller that is not enabled and has no swing. A parameter that is None has its default.

        Args:
            model: The arm.
            limits: Limits that swings must keep.
            reaching: Parameters of the posture search.
            servo: Parameters of the servo.
            guard: Limits of the guard.
            selection: How many candidate strokes are tried.
            params: When strokes are taken, and when a swing is given up.
            states: Which joint states are accepted.
        """
        self.model, self.limits, self.reaching = model, limits or SwingLimits(), reaching or ReachParams()
        self.servo, self.selection, self.params = servo or ServoParams(), selection or SelectionParams(), params or ControlParams()
        self.guard = Guard(model, guard, self.limits)
        self.states = JointStateCheck(model, states)
        self.enabled, self._off = False, Failure(ArmStop.NOT_ENABLED)
        self.joints: Joints | None = None
        self.swing: Swing | None = None
        self.coming: Swing | None = None
        self.stroke: PlannedStroke | None = None
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
        self._is_soonest = False  # whether the search for a stroke after which the arm waits sooner is done for this ball
        self._lock, self._stops = threading.Lock(), 0  # how often the swing was given up

    def enable(self, on: bool, reason: Failure | None = None) -> None:
        """Switch the motion of the arm on or off.

        Args:
            on: True permits motion and resets the latched failure of the guard. False begins a controlled stop.
            reason: Why the arm is switched off; None for NOT_ENABLED.
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
        """Share of the speed limits that the arm may use, 0.01 to 1. It may be set at any time; the present swing is then planned anew."""
        return self._scale

    @speed_scale.setter
    def speed_scale(self, scale: float) -> None:
        self._scale = check_range("speed_scale", scale, 0.01, 1.0)
        self._give_up()

    def hold(self, who: str, failure: Failure | None) -> None:
        """Stop the arm for a reason that a caller reports, until the same caller withdraws it.

        Args:
            who: Name of the caller.
            failure: Why the arm must not move; None withdraws the reason of this caller.
        """
        if failure is None:
            self.held.pop(who, None)
        else:
            self.held[who] = failure

    @property
    def stopped_by(self) -> Failure | None:
        """Why the arm must not move, whatever the joint states are: latched, held or not enabled; None if it may move."""
        if self.guard.latched is not None:
            return self.guard.latched
        held = tuple(self.held.values())  # a copy: two threads look
        return (held[0] if held else None) if self.enabled else self._off

    def step(self, joints: Joints, now: float | None = None, clock: float | None = None, *, has_speeds: bool = True) -> ControlStep:
        """Return the command that answers a joint state.

        The command follows the present swing. Without one it moves the arm to the waiting posture. It is that of a controlled stop if the
        arm must not move or the joint state is refused.

        Args:
            joints: Measured joint state.
            now: s, monotonic time at which it arrived; None for its own time.
            clock: s, reading at that time of the clock that makes the stamps; None if there is no such clock.
            has_speeds: False if the driver sends no speeds; they are then computed from the positions.
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
        damage = self.guard.check_state(joints, self.states.gap)
        stopped = self.stopped_by or damage or self._paused(now)
        if stopped is not None:
            self._forget()
            self._arriving = self._arriving or damage is not None
            return ControlStep(self.guard.stop(now, joints, age), stopped)
        interrupted = (self.states.gap and self._resume(joints)) or interrupted
        if self._rest is not None and (self.guard.last.any() or np.abs(joints.qdot).max() > STOPPED_SPEED):
            return ControlStep(self.guard.stop(now, joints, age), self._rest, interrupted=interrupted)
        self._rest = None
        self.guard.speed_scale = self._speed
        if (np.abs(self.guard.last) > self._speed * self.model.speed_limits + 1e-9).any():
            return ControlStep(self.guard.stop(now, joints, age), Failure(ArmStop.SLOWING, scale=self._speed))
        return self._follow(joints, now, age, interrupted)

    def refuse(self, now: float, failure: Failure) -> ControlStep:
        """Return the next command of a controlled stop, for a joint state that cannot be used.

        The swing is kept and may continue with the next valid joint state.

        Args:
            now: s, monotonic time.
            failure: Why the joint state cannot be used.
        """
        self._refusal = failure, now
        return ControlStep(self.guard.stop(now), self.stopped_by or failure)

    def watch(self, now: float) -> ControlStep | None:
        """Return the next command of a controlled stop if valid joint states have ceased; None if they have not.

        Args:
            now: s, monotonic time.
        """
        silence = self.states.silence(now) if self.states.last is not None else None
        if silence is None:
            return None
        self.joints = None
        failure, at = self._refusal
        reason = failure if now - at < self.states.deadline else silence  # states that come but cannot be used tell more than silence
        return ControlStep(self.guard.stop(now), self.stopped_by or reason)

    def take(self, rackets: Sequence[RacketState], go_on: Callable[[], bool] | None = None) -> StrokeSelection:
        """Select one of the candidate strokes and plan its swing, which begins in a later call of `step`.

        If balls come one soon after the other, another stroke is then searched, after which the arm waits for the next ball sooner.

        Args:
            rackets: Racket states of the candidates, in order of preference.
            go_on: Called before each step of that search; if it returns False, the search ends, and begins again with the next strokes for
                this ball. None: the search is not interrupted.

        Returns:
            The selected stroke with its swing. If no candidate can be made, or the present swing is kept, it has no stroke but the reasons.
        """
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
        left = stroke.racket.time - joints.time if stroke is not None else -np.inf
        if (
            stroke is not None
            and left < self.params.commit
            and any(abs(r.time - stroke.racket.time) < self.params.same_ball for r in rackets)
        ):
            return _refused(Failure(ArmStop.SWING_COMMITTED, left=left, bound=self.params.commit))
        current, kept = (stroke if left > 0.0 else None), False
        if current is not None and any(abs(r.time - current.racket.time) < self.params.same_ball for r in rackets):
            if not self.params.replan:
                return _refused(Failure(ArmStop.SWING_ON_ITS_WAY))
            correction = float(stroke_distances(current.racket, rackets).min())
            kept = correction < self.params.replan_distance
            if correction > self.params.largest_correction:
                return _refused(Failure(ArmStop.CORRECTION_TOO_LARGE, distance=correction, bound=self.params.largest_correction))
        elif current is not None:  # another ball: what is on its way comes first
            begin, current = current.racket.time, None
        time = max(joints.time + self.params.ahead, begin)
        start = _path_at(time, swing, coming).joints(time)
        hurried = self._hurries(rackets)
        self._is_soonest = self._is_soonest and current is not None
        if kept and current is not None:
            selected = StrokeSelection(None, current.racket, current.reach, coming or swing, (), corrects=True)
        else:
            selected = select_stroke(self.model, rackets, start, self._limits, self.reaching, self.selection, current, hurried)
            if selected.swing is None or not self._commit(selected, begin, stops):
                return selected if selected.swing is None else _refused(Failure(ArmStop.STOPPED_MEANWHILE))
        last = selected
        if hurried and not self._is_soonest:
            last = self._sooner(selected, rackets, start, begin, stops, go_on or (lambda: True))
        return _refused(Failure(ArmStop.SWING_WILL_DO)) if kept and last is selected else last

    def _commit(self, selected: StrokeSelection, begin: float, stops: int) -> bool:
        """Make a selected swing the coming one, unless swings were given up since the count `stops` was read; return whether it is."""
        if selected.racket is None or selected.reach is None:
            return False
        with self._lock:
            if stops != self._stops:
                return False
            self.coming, self.stroke, self._begin = selected.swing, PlannedStroke(selected.racket, selected.reach), begin
        return True

    def _sooner(
        self,
        selected: StrokeSelection,
        rackets: Sequence[RacketState],
        start: Joints,
        begin: float,
        stops: int,
        go_on: Callable[[], bool],
    ) -> StrokeSelection:
        """Replace the selected swing by one after which the arm waits for the next ball sooner, if there is one; return the selection.

        The arm begins with the first selected stroke while the postures of the other candidates are searched, and then changes to the best.
        """
        self._is_soonest = True

        def goes_on() -> bool:
            self._is_soonest = go_on()
            return self._is_soonest

        sooner = select_sooner(self.model, rackets, start, self._limits, self.reaching, self.selection, selected, goes_on)
        with self._lock:
            joints, swing, coming = self.joints, self.swing, self.coming
        if sooner is selected or joints is None or swing is None or sooner.racket is None or sooner.reach is None:
            return selected
        time = max(joints.time + self.params.ahead, begin)
        planned = strike(self.model, _path_at(time, swing, coming).joints(time), sooner.reach, sooner.racket.time, self._limits)
        changed = replace(sooner, swing=planned.swing, corrects=False)
        return changed if planned.swing is not None and self._commit(changed, begin, stops) else selected

    def fail(self, error: Exception, now: float) -> Array:
        """Stop the arm because of an error of the program itself, until it is enabled again.

        Args:
            error: The exception that was raised.
            now: s, monotonic time.

        Returns:
            The next command (n,) rad/s of a controlled stop; zero if even that cannot be computed.
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
        """Share of the speed limits that the arm may use at present; it is smaller during the first motion after enabling."""
        return self._scale * (self.params.first_speed if self._arriving else 1.0)

    @property
    def _limits(self) -> SwingLimits:
        """Limits that swings must keep at present, with the present share of the speed limits."""
        return self.limits if self._speed == 1.0 else replace(self.limits, speed_share=max(0.01, self._speed * self.limits.speed_share))

    def _arrived(self, joints: Joints) -> bool:
        """Return whether the arm is at its waiting posture, which ends the first motion after enabling."""
        if np.abs(joints.q - self.model.waiting).max() < AT_WAITING and np.abs(joints.qdot).max() < STOPPED_SPEED:
            self._arriving = False
        return not self._arriving

    def _resume(self, joints: Joints) -> bool:
        """Continue after a gap in the joint states from the measured state; return whether a stroke was given up."""
        self.guard.begin_from(joints.qdot)
        self._cut_since = None
        if self.swing is None or self._off_path(self.swing, joints) <= self.params.rejoin:
            return False
        interrupted = self.stroke is not None
        self._give_up()
        return interrupted

    def _follow(self, joints: Joints, now: float, age: float, interrupted: bool) -> ControlStep:
        """Return the command along the present swing; begin the coming swing, or plan a return to waiting if there is none."""
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
        elif self._is_aging(self.swing, joints.time):
            self._renew(self.swing, joints.time)
        wanted = follow(self.swing, joints.time, joints.q, self._speed * self.model.speed_limits, self.servo)
        planned = self.swing.start.time if joints.time < self.swing.end_time else None  # waiting needs no plan
        command, cut = self.guard.check(joints, wanted, now, planned, age)
        if cut is None:
            self._cut_since = None
        elif self._is_spoilt(cut, joints.time):
            interrupted = interrupted or self.stroke is not None
            cut = self._does_not_follow(now, cut)
        return ControlStep(command, cut, begun, interrupted)

    def _is_aging(self, swing: Swing, time: float) -> bool:
        """Return whether a long way back to the waiting posture must be planned anew, before the guard stops it as a stale plan."""
        returns = swing.strike_time == np.inf or time > swing.strike_time
        return returns and time < swing.end_time and time > swing.start.time + 0.5 * self.guard.params.stale_plan

    def _renew(self, swing: Swing, time: float) -> None:
        """Plan the return to the waiting posture again, from the planned joint state at `time` (s). A next swing is kept."""
        with suppress(TtError):  # if there is no new plan, the arm follows the present one until the guard stops it as too old
            renewed = plan(self.model, swing.joints(time), None, time, self._limits)
            with self._lock:
                if self.coming is None:
                    self.swing, self._stops = renewed, self._stops + 1

    def _is_spoilt(self, cut: Failure, time: float) -> bool:
        """Return whether the swing must be given up: the guard has stopped it, or has cut its commands for longer than `patience`."""
        self._cut_since = time if self._cut_since is None else self._cut_since
        limits = ArmStop.SPEED_CUT, ArmStop.POSITION_CUT, ArmStop.ACCELERATION_CUT
        return cut.code not in limits or time - self._cut_since > self.params.patience

    def _does_not_follow(self, now: float, last: object) -> Failure:
        """Give up the swing and return the reason.

        After `failures` of these within `failure_window` the arm rests for `pause`, and then moves slowly as after enabling.
        """
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
        """Return why the arm rests for the time `pause`; None if it does not."""
        if self._pause is None:
            return None
        failure, until = self._pause
        if now < until:
            return failure
        self._pause = None
        return None

    def _off_path(self, swing: Swing, joints: Joints) -> float:
        """Return the largest distance (rad) of a joint from its position on the swing."""
        return float(np.abs(swing.sample(joints.time)[0] - joints.q).max())

    def _hurries(self, rackets: Sequence[RacketState]) -> bool:
        """Return whether these strokes are for a ball that comes less than `hurry` after the ball before it, hit or not."""
        ball = min((racket.time for racket in rackets), default=-np.inf)
        if ball > self._ball + self.params.same_ball:
            self._before, self._ball = self._ball, ball
        return self._ball < self._before + self.params.hurry

    def _give_up(self) -> None:
        """Drop all swings and the stroke, and make the planning thread drop a swing that it is planning now."""
        with self._lock:
            self.swing = self.coming = self.stroke = None
            self._begin, self._stops = -np.inf, self._stops + 1

    def _forget(self) -> None:
        """Drop all swings and the stroke, and forget the times of the last balls."""
        self._give_up()
        self._before = self._ball = -np.inf


def _path_at(time: float, swing: Swing, coming: Swing | None) -> Swing:
    """Return the swing, `swing` or `coming`, that the arm follows at `time` (s)."""
    return coming if coming is not None and coming.start.time <= time else swing


def _refused(failure: Failure) -> StrokeSelection:
    return StrokeSelection.none((Refusal(failure),), failure)


def warm(model: ArmModel) -> None:
    """Compile every kernel of the arm, or load it from the cache, so that none is compiled while a ball is in flight."""
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
        control.guard.check(Joints(time, joints.q, joints.qdot), np.sign(middle - model.waiting), time)
    control.guard.stop(0.0065, joints)  # kernels of an arm that brakes, or is near to something
    clearance(model.waiting.copy(), model.bodies)
    for method in ("near", "liu") if len(model.names) == dissertation.JOINTS else ("near",):
        reach(model, racket, model.waiting, method=method)
    rest = np.zeros(len(model.names))
    Path(control.limits.of_joints(model).bounds, "auto").is_possible(1.0, make_leg(model.waiting, rest, rest, near, rest))
    for profile in ("quintic", "trapezoid", "polyline"):
        plan(model, joints, None, 0.0, SwingLimits(profile=profile))
