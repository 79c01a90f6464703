"""The last check of a command: what leaves is finite, within the limits, and able to stop before a joint's limit, table, floor and arm.

The guard knows nothing of swings. A command that is a little too much is cut and reported. Damage latches: a controlled stop, and zero
until `reset`.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from tt_core.failures import Failure
from tt_core.params import check, param
from tt_core.states import Array

from ..joints import NO_ACCELERATION_LIMIT, JointLimits, Joints
from ..model import ArmModel
from ..trajectory.limits import SwingLimits
from .clearance import OBSTACLES, braking_clearance, clearance
from .command_limits import ACCELERATION, POSITION, SPEED, UNCUT, clip_to_room, cut_joints, limit_command
from .stops import ArmStop

LONGEST_STEP = 0.05  # s, after which a command may not differ from the last one by more than it may after this
FIRST_STEP = 0.005  # s, for which the first command of a stop brakes at most
LONGEST_GUESS = 0.3  # s after the last measurement, for which commands tell where the arm is; then it is at rest
STEEPER = 2.0  # changes of commands in terms of the accelerations that the description of an arm states: the servo corrects errors
MOST_SENT = 200  # commands that are kept, 0.4 s of them: joint states may be 0.1 s old
LEAST_SIGHTINGS = 3  # joint states in a row that must show a damage
CUTS = {SPEED: ArmStop.SPEED_CUT, POSITION: ArmStop.POSITION_CUT, ACCELERATION: ArmStop.ACCELERATION_CUT}


@dataclass(frozen=True, slots=True)
class GuardParams:
    """What the guard lets through."""

    acceleration: float = param(
        40.0,
        "rad/s^2",
        "steepest change of a command that follows a swing, for joints whose description states no acceleration; at least "
        "`swing.acceleration`, which is checked at the start",
        low=0.1,
        high=1000.0,
    )
    margin: float = param(
        0.01,
        "rad",
        "distance of the arm from the position limits; at most `swing.margin`, which is checked at the start",
        low=0.0,
        high=0.5,
    )
    tolerance: float = param(
        0.02, "rad", "distance of a measured position beyond its limit, above which it counts as damage", low=0.0, high=0.5
    )
    overspeed: float = param(1.2, "", "measured speed, in speed limits, above which it counts as damage", low=1.0, high=100.0)
    persistence: float = param(0.010, "s", "time for which damage must be measured before it latches", low=0.0, high=1.0)
    clearance: float = param(
        0.005,
        "m",
        "distance of racket and forearm from table, floor and arm; at most `swing.clearance`, which is checked at the start",
        low=0.0,
        high=0.5,
    )
    stale_plan: float = param(
        5.0, "s", "age of a plan above which it no longer moves the arm; a swing and its way back take 2 s", low=0.01, high=1000.0
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)

    def of_joints(self, model: ArmModel, speed_scale: float = 1.0) -> JointLimits:
        """Return the limits that commands must keep; the acceleration is that of a change of the command."""
        limits = model.limits.reduced(speed=speed_scale, margin=self.margin)
        stated = limits.acceleration < NO_ACCELERATION_LIMIT
        return replace(limits, acceleration=np.where(stated, STEEPER * limits.acceleration, self.acceleration))


class Guard:
    """Cut commands to what is safe.

    Attributes:
        braking: (n,) rad/s^2, at which each joint brakes in a stop: the acceleration limit of swings, with which clearance is computed.
        command_timeout: s, for which the drives hold a command.
        hold: s, for which a command may act.
        latched: None, or why only a stop leaves until `reset`.
        params: What is let through.
    """

    def __init__(self, model: ArmModel, params: GuardParams | None = None, limits: SwingLimits | None = None) -> None:
        """Guard an arm.

        Args:
            model: The arm.
            params: What is let through.
            limits: What swings may use.
        """
        self._model, self.params, limits = model, params or GuardParams(), limits or SwingLimits()
        self.braking, self.command_timeout, self.hold = np.array(limits.of_joints(model).acceleration), limits.command_timeout, limits.hold
        self.latched: Failure | None = None
        self._scale, self._limits = 1.0, self.params.of_joints(model).bounds
        self._last = np.zeros(len(model.names))
        self._now: float | None = None  # s, monotonic, when the last command left
        self._sent = deque[tuple[float, Array]](maxlen=MOST_SENT)  # when (s, monotonic) commands left, oldest first
        self.reset()

    def reset(self) -> None:
        """Let commands through again, from the last one on."""
        self.latched = None
        self._measured: tuple[Joints, float] | None = None  # and when (s, monotonic) that was
        self._time: float | None = None  # s, of the joint state that the last command answered
        self._stopping = False  # whether the last command was one of a stop
        self._damaged, self._damaged_since, self._found = 0, 0.0, False  # joint states in a row that show damage, since when, from a gap on

    @property
    def speed_scale(self) -> float:
        """Share of the speed limits that commands may use."""
        return self._scale

    @speed_scale.setter
    def speed_scale(self, scale: float) -> None:
        if scale != self._scale:
            self._scale, self._limits = scale, self.params.of_joints(self._model, scale).bounds

    @property
    def last(self) -> Array:
        """Return the last command (n,) rad/s."""
        return self._last

    def begin_from(self, qdot: Array) -> None:
        """Take the measured speeds qdot (n,) rad/s for the last command, after a time in which the arm did not follow commands."""
        speed = self._model.speed_limits
        self._last, self._time = np.clip(qdot, -speed, speed), None
        self._sent.clear()

    def look(self, joints: Joints, after_gap: bool = False) -> Failure | None:
        """Return the damage that the joint state shows, and latch it once it has lasted for `persistence` s without a pause.

        Args:
            joints: As measured, accepted by `JointStateCheck`.
            after_gap: Whether joint states were missing before this one. Damage that is there with the first one latches nothing: nobody
                has seen the arm come there, and the driver may name its joints wrongly. It stops the arm as long as it is measured.
        """
        failure = self._damage(joints)
        if failure is None:
            self._damaged = 0
            return None
        if self._damaged == 0:
            self._damaged_since, self._found = joints.time, after_gap
        self._damaged += 1
        lasts = self._damaged >= LEAST_SIGHTINGS and joints.time - self._damaged_since >= self.params.persistence
        if lasts and not self._found:
            self.latched = self.latched or failure
        return failure if lasts or self._found else None

    def check(
        self, joints: Joints, command: Array, now: float, planned: float | None = None, age: float = 0.0
    ) -> tuple[Array, Failure | None]:
        """Return the command (n,) rad/s that may leave, and why it is another one, if it is.

        Args:
            joints: As measured, accepted by `JointStateCheck`.
            command: (n,) rad/s, as wanted.
            now: s, monotonic.
            planned: s, when the plan was made that the command follows, in the time of `joints`; None where it needs none.
            age: s, of `joints`: the arm has moved on since, by the commands that were sent.
        """
        self._measured = joints, now - age
        command, params, q = np.array(command, dtype=float), self.params, self._place(joints, now - age, now)
        if self.latched is not None:
            return self.stop(now, joints, age), self.latched
        if command.shape != q.shape or not np.isfinite(command).all():
            return self.stop(now, joints, age), Failure(ArmStop.BROKEN_COMMAND, count=len(q), command=command)
        if planned is not None and joints.time - planned > params.stale_plan and command.any():
            return self.stop(now, joints, age), Failure(ArmStop.OLD_PLAN, age=joints.time - planned, bound=params.stale_plan)
        begins, passed, allowed = self._time is None, self._passed(joints.time, now), np.empty(len(q))
        cut = limit_command(q, command, self._last, passed, self.hold, self._limits, self.braking, allowed)
        near = self._near(q, allowed) if allowed.any() else None
        if near is not None:
            return self.stop(now, joints, age), near
        self._note(allowed, now, is_stop=False)
        if begins or cut == UNCUT:  # how long the arm has had for the first command is not known
            return allowed, None
        names = (name for name, is_cut in zip(self._model.names, cut_joints(allowed, command), strict=True) if is_cut)
        return allowed, Failure(CUTS[cut], joints=", ".join(names))

    def stop(self, now: float, joints: Joints | None = None, age: float = 0.0) -> Array:
        """Return the next command (n,) rad/s of a controlled stop, zero at the end.

        Where no command has left for long, the drive still holds the last one until its own timeout, and brakes by itself from then on.
        The stop begins from that speed.

        The command of a stop, too, may be held by the drives. Where the arm could then run into something, because an earlier delay has
        used up the room for that, it is smaller than the braking limit asks: room comes before smoothness.

        Args:
            now: s, monotonic.
            joints: As measured; None where nothing new is known.
            age: s, of `joints`.
        """
        passed = 0.0 if self._now is None else max(now - self._now, 0.0)
        if not self._stopping:
            passed = max(min(passed, FIRST_STEP), passed - self.command_timeout)
        step = self.braking * passed
        command = self._last + np.clip(-self._last, -step, step)
        if joints is not None:
            self._measured = joints, now - age
        if self._measured is not None and now - self._measured[1] <= LONGEST_GUESS and command.any():
            q = self._place(*self._measured, now)
            clip_to_room(q, self.command_timeout, self._limits, self.braking, command)
            command = self._clear_of_all(q, command)
        self._note(command, now, is_stop=True)
        return command

    def latch(self, failure: Failure, now: float) -> Array:
        """Stop, and go on stopping until `reset`; return the next command (n,) rad/s."""
        self.latched = self.latched or failure
        return self.stop(now)

    def _damage(self, joints: Joints) -> Failure | None:
        """Return the damage that this joint state shows."""
        params, names, (low, high) = self.params, self._model.names, self._model.position_limits.T
        outside, share = np.maximum(low - joints.q, joints.q - high), np.abs(joints.qdot) / self._model.speed_limits
        i, k = int(outside.argmax()), int(share.argmax())
        if outside[i] > params.tolerance:
            unit = self._model.limits.units[i]
            return Failure(ArmStop.BEYOND_LIMIT, joint=names[i], unit=unit, value=float(outside[i]), bound=params.tolerance)
        if share[k] > params.overspeed:
            return Failure(ArmStop.OVERSPEED, joint=names[k], value=float(share[k]), bound=params.overspeed)
        left, what = clearance(joints.q, self._model.bodies)
        return Failure(ArmStop.CONTACT, obstacle=OBSTACLES[what]) if left <= 0.0 else None

    def _note(self, command: Array, now: float, *, is_stop: bool) -> None:
        """Keep the command that leaves."""
        self._last, self._now, self._stopping = command, now, is_stop
        self._sent.append((now, command))

    def _place(self, joints: Joints, measured: float, now: float) -> Array:
        """Return where (n,) rad the commands have brought joints until `now` (s, monotonic) that were measured at `measured`."""
        q, until = joints.q, now
        for sent, command in reversed(self._sent):
            begin = min(max(sent, measured), until)
            q, until = q + min(until - begin, self.command_timeout) * command, begin
            if sent <= measured:
                return q
        return q + (until - measured) * joints.qdot

    def _clear_of_all(self, q: Array, command: Array) -> Array:
        """Return the largest share of a command which the drives may hold and then brake from without touching anything."""
        for share in (1.0, 0.75, 0.5, 0.25):
            if braking_clearance(q, share * command, self.braking, self.command_timeout, self._model.bodies)[0] > 0.0:
                return share * command
        return np.zeros(len(q))

    def _near(self, q: Array, command: Array) -> Failure | None:
        """Return a failure if braking from `command`, at once or after the drives have held it, ends too near to something.

        It is allowed if the arm is nearer to it now.
        """
        bodies, bound = self._model.bodies, self.params.clearance
        left, what = braking_clearance(q, command, self.braking, 0.0, bodies)
        held, held_what = braking_clearance(q, command, self.braking, self.hold, bodies)
        if held <= 0.0 or held + bound < left:  # only a touch counts: a command is held only if the process fails
            left, what = (0.0 if held <= 0.0 else held + bound), held_what
        if left >= bound or left > clearance(q, bodies)[0]:
            return None
        return Failure(ArmStop.NEAR, left=max(0.0, left), obstacle=OBSTACLES[what], bound=bound)

    def _passed(self, time: float, now: float) -> float:
        """Return the time (s) since the last command, after which the next one may differ from it, and keep `time`.

        Joint states come irregularly, so their stamps tell the time between two commands.
        After a stop only the time since its last command counts.
        """
        passed = 0.0 if self._time is None else min(max(time - self._time, 0.0), LONGEST_STEP)
        if self._stopping and self._now is not None:
            passed = min(passed, max(now - self._now, 0.0))
        self._time = time
        return passed
