"""The guard makes the last check of each joint velocity command before it is sent to the arm.

A command that passes is finite and within the limits, and the arm can stop from it before a joint's limit and before it touches table,
floor or itself. The guard knows nothing of swings (planned joint motions). A command that exceeds a limit is cut to the limit and reported.
Damage (a position beyond its limit, overspeed or contact) latches: the arm makes a controlled stop and rests until `reset`.
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
from .command_limits import CUT_BY_ACCELERATION, CUT_BY_POSITION, CUT_BY_SPEED, NOT_CUT, clip_to_room, cut_joints, limit_command
from .stops import ArmStop

LONGEST_COMMAND_INTERVAL = 0.05  # s, largest time between commands that is used to limit the change of the command
FIRST_STOP_STEP = 0.005  # s, largest time for which the first command of a stop brakes
LONGEST_GUESS = 0.3  # s after the last measurement for which the position is computed from the commands; then the arm is at rest
STEEPER = 2.0  # largest change of commands over the acceleration limit that the URDF states: more, because the servo corrects errors
MOST_SENT = 200  # number of commands that are kept, those of 0.4 s: joint states may be 0.1 s old
LEAST_SIGHTINGS = 3  # number of successive joint states that must show damage
CUTS = {CUT_BY_SPEED: ArmStop.SPEED_CUT, CUT_BY_POSITION: ArmStop.POSITION_CUT, CUT_BY_ACCELERATION: ArmStop.ACCELERATION_CUT}


@dataclass(frozen=True, slots=True)
class GuardParams:
    """Limits of the guard, the last check of each command."""

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
        """Return the joint limits that commands must keep.

        The acceleration limit is that of the rate at which the velocity command may change. It is not that of the motors.

        Args:
            model: The arm.
            speed_scale: Share of the speed limits that commands may use, 0.01 to 1.
        """
        limits = model.limits.reduced(speed=speed_scale, margin=self.margin)
        stated = limits.acceleration < NO_ACCELERATION_LIMIT
        return replace(limits, acceleration=np.where(stated, STEEPER * limits.acceleration, self.acceleration))


class Guard:
    """Last check of each joint velocity command, which cuts it to the limits or replaces it by that of a controlled stop.

    Attributes:
        braking: (n,) rad/s^2, deceleration of each joint in a stop: the acceleration limit of swings.
        command_timeout: s, time for which the drives hold a command.
        hold: s, longest time for which a command may act, including delays.
        latched: Why only commands of a stop are returned until `reset`; None if nothing has latched.
        params: Limits of the guard.
    """

    def __init__(self, model: ArmModel, params: GuardParams | None = None, limits: SwingLimits | None = None) -> None:
        """Create the guard of an arm, in rest and without a latched failure.

        Args:
            model: The arm.
            params: Limits of the guard; None for the default.
            limits: Limits of swings, from which braking and holding of commands follow; None for the default.
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
        """Clear the latched failure and what is known of earlier joint states, so that commands pass again. The last command is kept."""
        self.latched = None
        self._measured: tuple[Joints, float] | None = None  # and when (s, monotonic) that was
        self._time: float | None = None  # s, of the joint state that the last command answered
        self._stopping = False  # whether the last command was one of a stop
        self._damaged, self._damaged_since, self._found = 0, 0.0, False  # joint states in a row that show damage, since when, from a gap on

    @property
    def speed_scale(self) -> float:
        """Share of the speed limits that commands may use, 0.01 to 1."""
        return self._scale

    @speed_scale.setter
    def speed_scale(self, scale: float) -> None:
        if scale != self._scale:
            self._scale, self._limits = scale, self.params.of_joints(self._model, scale).bounds

    @property
    def last(self) -> Array:
        """The last command (n,) rad/s that was returned."""
        return self._last

    def begin_from(self, qdot: Array) -> None:
        """Replace the last command by the measured joint speeds, after a time in which the arm did not follow commands.

        Args:
            qdot: (n,) rad/s, measured joint speeds.
        """
        speed = self._model.speed_limits
        self._last, self._time = np.clip(qdot, -speed, speed), None
        self._sent.clear()

    def check_state(self, joints: Joints, after_gap: bool = False) -> Failure | None:
        """Check a joint state for damage: a position beyond its limit, overspeed or contact.

        Damage latches when successive joint states have shown it for `persistence` seconds. Damage that the first joint state after a gap
        shows does not latch, because the driver may have named its joints wrongly; it stops the arm only as long as it is measured.

        Args:
            joints: Measured joint state, accepted by `JointStateCheck`.
            after_gap: Whether joint states were missing before this one.

        Returns:
            The damage, if it has lasted long enough or was there after a gap; otherwise None.
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
        """Check a command, and return the permitted one.

        Args:
            joints: Measured joint state, accepted by `JointStateCheck`.
            command: (n,) rad/s, wanted command.
            now: s, monotonic time.
            planned: s, time on the clock of `joints` at which the plan was made that the command follows; None if it follows no plan.
            age: s, age of `joints`. The present position is computed from it and the commands that were sent since.

        Returns:
            The permitted command (n,) rad/s, which may be cut or that of a stop; and why it differs from the wanted one, or None.
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
        if begins or cut == NOT_CUT:  # how long the arm has had for the first command is not known
            return allowed, None
        names = (name for name, is_cut in zip(self._model.names, cut_joints(allowed, command), strict=True) if is_cut)
        return allowed, Failure(CUTS[cut], joints=", ".join(names))

    def stop(self, now: float, joints: Joints | None = None, age: float = 0.0) -> Array:
        """Return the next command (n,) rad/s of a controlled stop, which is zero at the end of the stop.

        If no command was sent for a long time, the drives have held the last one until their timeout and have braked since then. The stop
        begins from the speed that is left.

        The drives may hold the commands of a stop, too. If the arm could then touch something, because an earlier delay has used up the
        distance for that, the command is smaller than with the usual deceleration: distance is more important than a smooth motion.

        Args:
            now: s, monotonic time.
            joints: Measured joint state; None if there is no new one.
            age: s, age of `joints`.
        """
        passed = 0.0 if self._now is None else max(now - self._now, 0.0)
        if not self._stopping:
            passed = max(min(passed, FIRST_STOP_STEP), passed - self.command_timeout)
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
        """Latch a failure, so that only commands of a stop are returned until `reset`; return the next command (n,) rad/s of the stop.

        Args:
            failure: Why the arm must stop. An already latched failure is kept.
            now: s, monotonic time.
        """
        self.latched = self.latched or failure
        return self.stop(now)

    def _damage(self, joints: Joints) -> Failure | None:
        """Return the damage that this joint state shows; None if it shows none."""
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
        """Remember the command that is returned, and when."""
        self._last, self._now, self._stopping = command, now, is_stop
        self._sent.append((now, command))

    def _place(self, joints: Joints, measured: float, now: float) -> Array:
        """Return the joint positions (n,) rad at `now`, computed from those measured at `measured` and the commands sent since.

        Both times are s on the monotonic clock.
        """
        q, until = joints.q, now
        for sent, command in reversed(self._sent):
            begin = min(max(sent, measured), until)
            q, until = q + min(until - begin, self.command_timeout) * command, begin
            if sent <= measured:
                return q
        return q + (until - measured) * joints.qdot

    def _clear_of_all(self, q: Array, command: Array) -> Array:
        """Return the command multiplied by the largest share with which the arm touches nothing if the drives hold it and then brake."""
        for share in (1.0, 0.75, 0.5, 0.25):
            if braking_clearance(q, share * command, self.braking, self.command_timeout, self._model.bodies)[0] > 0.0:
                return share * command
        return np.zeros(len(q))

    def _near(self, q: Array, command: Array) -> Failure | None:
        """Return a failure if the arm would come too near to an obstacle while it brakes from `command`; None if it would not.

        Braking at once and braking after the drives have held the command are checked. A motion away from the obstacle is permitted.
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
        """Return the time (s) since the last command, which limits the change of the next one, and remember `time`.

        It is the difference of the stamps of the joint states, because these arrive irregularly. After a stop it is at most the time since
        the last command of the stop.
        """
        passed = 0.0 if self._time is None else min(max(time - self._time, 0.0), LONGEST_COMMAND_INTERVAL)
        if self._stopping and self._now is not None:
            passed = min(passed, max(now - self._now, 0.0))
        self._time = time
        return passed
