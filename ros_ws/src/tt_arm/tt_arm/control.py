"""The arm from strokes and joint states to commands, without ROS: it holds the swing, and the guard has the last word."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from tt_core.errors import check_range
from tt_core.states import Array, RacketState

from .choice import Choice, ChoiceParams, apart, choose
from .guard import Guard, GuardParams
from .model import ArmModel
from .reach import Reach, ReachParams, reach
from .servo import ServoParams, follow
from .swing import Joints, Swing, SwingLimits, plan


@dataclass(frozen=True, slots=True)
class ControlParams:
    """When strokes are taken."""

    ahead: float = 0.010  # s, a new swing begins this long after the joint state it is planned on, room for the planning itself
    replan: bool = True  # newer strokes for the ball on its way may change the swing
    replan_distance: float = 0.002  # m, what they must differ by, see `apart`
    same_ball: float = 0.2  # s, strikes closer than this are for one ball; at 94 balls a minute those of two are 0.3 s apart
    hurry: float = 1.0  # s from the strike for one ball to that for the next, below which the arm hurries; see `choose`
    lost: float = 0.15  # rad off the path, at which the swing is given up
    horizon: float = 3.0  # s, a strike further ahead than this is refused

    def __post_init__(self) -> None:
        check_range("ahead", self.ahead, 0.0, 0.5)
        check_range("replan_distance", self.replan_distance, 0.0, 1.0)
        check_range("same_ball", self.same_ball, 0.0, 10.0)
        check_range("hurry", self.hurry, 0.0, 1000.0)
        check_range("lost", self.lost, 0.01, 3.0)
        check_range("horizon", self.horizon, 0.1, 1000.0)


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What one joint state leads to: the command (7,) rad/s, why it is not what the swing wants, and the swing that begins with it."""

    command: Array
    reason: str | None = None
    begun: Swing | None = None


class ArmControl:
    """Call `step` with each joint state and `take` with each set of strokes; both only use the times they are given."""

    def __init__(
        self,
        model: ArmModel,
        limits: SwingLimits | None = None,
        reaching: ReachParams | None = None,
        servo: ServoParams | None = None,
        guard: GuardParams | None = None,
        choosing: ChoiceParams | None = None,
        params: ControlParams | None = None,
    ) -> None:
        self.model, self.limits, self.reaching = model, limits or SwingLimits(), reaching or ReachParams()
        self.servo, self.choosing, self.params = servo or ServoParams(), choosing or ChoiceParams(), params or ControlParams()
        self.guard = Guard(model, guard)
        self.enabled, self._off = False, "not enabled"
        self._stale_looks = self._late = 0
        self.joints: Joints | None = None
        self.swing: Swing | None = None
        self.coming: Swing | None = None
        self.stroke: tuple[RacketState, Reach] | None = None
        self._begin = -np.inf  # s, the strike before the coming one, which no newer swing may touch
        self._before = self._ball = -np.inf  # s, when the ball before this one, and this one, can be hit first

    def enable(self, on: bool, reason: str = "not enabled") -> None:
        """Switches motion on, forgetting what latched, or off by a controlled stop for that reason."""
        self.enabled, self._off = on, reason
        self._forget()
        if on:
            self.guard.reset()

    def step(self, joints: Joints, now: float | None = None) -> Step:
        """The command for the time of `joints`: along the swing, else towards waiting, else zero. now: s, if known, when they came."""
        self.joints, self._stale_looks = joints, 0
        self._late = self._late + 1 if now is not None and self.guard.late(joints.time, now) else 0
        if not self.enabled or self.guard.latched:
            self._forget()
            return Step(self.guard.stop(joints.time), self.guard.latched or self._off)
        if now is not None and self._late > 1:
            self._give_up()
            return Step(self.guard.stop(joints.time), f"joint state is {now - joints.time:.3f} s old")
        begun = None
        if self.coming is not None and joints.time + self.servo.lead >= self.coming.start.time:
            self.swing, self.coming, begun = self.coming, None, self.coming
        if self.swing is None or np.abs(self.swing.sample(joints.time)[0] - joints.q).max() > self.params.lost:
            self._give_up()
            self.swing = plan(self.model, joints, None, joints.time, self.limits)
        wanted = follow(self.swing, joints.time, joints.q, self.model.speed_limits, self.servo)
        planned = self.swing.start.time if joints.time < self.swing.end_time else None  # waiting needs no plan
        command, reason = self.guard.check(joints.time, wanted, joints.q, joints.qdot, planned)
        return Step(command, reason, begun)

    def take(self, rackets: Sequence[RacketState]) -> Choice:
        """Plans for the candidate strokes, in order of preference; the swing begins by itself in a later `step`."""
        if not self.enabled or self.guard.latched:
            return Choice(None, None, None, None, (self.guard.latched or self._off,))
        if self.joints is None or self.swing is None:
            return Choice(None, None, None, None, ("no joint state in time",))
        if rackets and min(r.time for r in rackets) > self.joints.time + self.params.horizon:
            return Choice(None, None, None, None, (f"the strike is {rackets[0].time - self.joints.time:.2f} s ahead",))
        current, begin = self.stroke if self.stroke is not None and self.stroke[0].time > self.joints.time else None, self._begin
        if current is not None and any(abs(r.time - current[0].time) < self.params.same_ball for r in rackets):
            if not self.params.replan:
                return Choice(None, None, None, None, ("a swing is on its way",))
            if min(apart(current[0], r) for r in rackets) < self.params.replan_distance:
                return Choice(None, None, None, None, ("the swing on its way will do",))
        elif current is not None:  # another ball: what is on its way comes first
            begin, current = current[0].time, None
        time = max(self.joints.time + self.params.ahead, begin)
        path = self.coming if self.coming is not None and self.coming.start.time <= time else self.swing
        choice = choose(self.model, rackets, path.joints(time), self.limits, self.reaching, self.choosing, current, self._hurries(rackets))
        if choice.swing is not None and choice.racket is not None and choice.reach is not None:
            self.coming, self.stroke, self._begin = choice.swing, (choice.racket, choice.reach), begin
        return choice

    def _hurries(self, rackets: Sequence[RacketState]) -> bool:
        """Whether these are for a ball that comes soon after another one, be that hit or not."""
        ball = min((racket.time for racket in rackets), default=-np.inf)
        if ball > self._ball + self.params.same_ball:
            self._before, self._ball = self._ball, ball
        return self._ball < self._before + self.params.hurry

    def watch(self, time: float) -> Array | None:
        """The next command (7,) of a stop when at `time` (s) the last joint state is stale; None while all is well.

        The second look in a row counts, here and in `step`: a process that was held up itself has old mail, once. Where the arm was braked
        its swing is given up: it goes on from where it is then, for to chase a swing that has moved on would be cut until it latches.
        """
        stale = self.joints is not None and self.guard.stale(self.joints.time, time)
        self._stale_looks = self._stale_looks + 1 if stale else 0
        if self._stale_looks < 2:
            return None
        self._give_up()
        return self.guard.stop(time)

    def fail(self, reason: str) -> Array:
        """Something else broke: latches; the command (7,) is zero at once, the drives brake, for nothing here may be trusted."""
        self._forget()
        return self.guard.latch(reason)

    def ending(self, tick: float) -> list[Array]:
        """The commands (7,) of a stop, `tick` (s) apart, the last zero: for a process that ends."""
        self.enable(False, "ended")
        time = 0.0 if self.joints is None else self.joints.time
        commands = [self.guard.stop(time + tick)]
        while commands[-1].any():
            commands.append(self.guard.stop(time + (len(commands) + 1) * tick))
        return commands

    def _give_up(self) -> None:
        self.swing = self.coming = self.stroke = None
        self._begin = -np.inf

    def _forget(self) -> None:
        self._give_up()
        self._before = self._ball = -np.inf


def warm(model: ArmModel) -> None:
    """Compiles every kernel of the arm, or loads it from the cache."""
    control = ArmControl(model)
    control.enable(True)
    joints = Joints(0.0, model.waiting, np.zeros(7))
    control.step(joints)
    racket = RacketState(0.5, np.array([-0.15, 0.70, 0.25]), np.array([1.48, 0.095, 1.41]), -0.011, 0.792)  # Table 4.3 case 1
    control.take([racket])
    control.take([RacketState(0.5, racket.position + 0.005, racket.velocity, racket.alpha, racket.beta)])
    control.step(Joints(0.02, model.waiting, np.zeros(7)))
    for time in (0.03, 0.04):  # what moves only
        control.guard.check(time, np.full(7, 0.01), joints.q, joints.qdot)
    for method in ("near", "liu"):
        reach(model, racket, model.waiting, method=method)
    for profile in ("quintic", "trapezoid", "polyline"):
        plan(model, joints, None, 0.0, SwingLimits(profile=profile))
