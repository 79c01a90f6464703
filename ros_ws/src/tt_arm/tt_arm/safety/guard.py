"""The last word before the wire: what leaves is finite, within the limits, and able to stop before a joint's end, table, floor and arm.

Knows nothing of swings. What is a little too much is cut and told. What means damage latches: a controlled stop, and zero until `reset`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tt_core.failures import Failure
from tt_core.params import check, param
from tt_core.states import Array

from ..joints import Joints
from ..model import ArmModel
from ..swing import SwingLimits
from .clearance import OBSTACLES, braking_clearance, clearance
from .stops import ArmStop

LONGEST_STEP = 0.05  # s, after which a command may not differ from the last one by more than it may after this
FIRST_STEP = 0.005  # s, for which the first command of a stop brakes at most
LEAST_SIGHTINGS = 3  # joint states in a row that must show a damage


@dataclass(frozen=True, slots=True)
class GuardParams:
    """What the guard lets through."""

    acceleration: float = param(
        40.0, "rad/s^2", "steepest change of a command that follows a swing; twice what a swing uses", low=0.1, high=1000.0
    )
    margin: float = param(0.01, "rad", "kept from the position limits", low=0.0, high=0.5)
    tolerance: float = param(0.02, "rad", "a joint measured further than this beyond its limit means damage", low=0.0, high=0.5)
    overspeed: float = param(1.2, "", "times its speed limit, and a joint measured faster than this too", low=1.0, high=100.0)
    persistence: float = param(0.010, "s", "for which damage must be measured before it latches", low=0.0, high=1.0)
    clearance: float = param(0.005, "m", "kept from table, floor and arm; less than swings keep", low=0.0, high=0.5)
    stale_plan: float = param(
        5.0, "s", "after which a plan no longer moves the arm; a swing and its way back take 2", low=0.01, high=1000.0
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class Guard:
    """Cut commands to what is safe.

    Attributes:
        latched: None, or why only a stop leaves until `reset`.
        speed_scale: Share of the speed limits that commands may use.
    """

    def __init__(self, model: ArmModel, params: GuardParams | None = None, limits: SwingLimits | None = None) -> None:
        """Guard `model`. The braking limit is `limits.acceleration`, the one that swings keep and clearance is computed with."""
        self._model, self._params, limits = model, params or GuardParams(), limits or SwingLimits()
        self.braking, self.command_timeout = limits.acceleration, limits.command_timeout
        self.latched: Failure | None = None
        self.speed_scale = 1.0
        self._last = np.zeros(len(model.names))
        self._now: float | None = None  # s, monotonic, when the last command left
        self.reset()

    def reset(self) -> None:
        """Let commands through again, from the last one on."""
        self.latched = None
        self._time: float | None = None  # s, of the joint state that the last command answered
        self._stopping = False  # whether the last command was one of a stop
        self._damaged, self._damaged_since, self._found = 0, 0.0, False  # joint states in a row that show damage, since when, from a gap on

    @property
    def last(self) -> Array:
        """Return the last command (7,) rad/s."""
        return self._last

    def begin_from(self, qdot: Array) -> None:
        """Take the measured speeds qdot (7,) rad/s for the last command, after a time in which the arm did not follow commands."""
        speed = self._model.speed_limits
        self._last, self._time = np.clip(qdot, -speed, speed), None

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
        lasts = self._damaged >= LEAST_SIGHTINGS and joints.time - self._damaged_since >= self._params.persistence
        if lasts and not self._found:
            self.latched = self.latched or failure
        return failure if lasts or self._found else None

    def check(
        self, joints: Joints, command: Array, now: float, planned: float | None = None, age: float = 0.0
    ) -> tuple[Array, Failure | None]:
        """Return the command (7,) rad/s that may leave, and why it is another one, if it is.

        Args:
            joints: As measured, accepted by `JointStateCheck`.
            command: (7,) rad/s, as wanted.
            now: s, monotonic.
            planned: s, when the plan was made that the command follows, in the time of `joints`; None where it needs none.
            age: s, of `joints`: the arm has moved on since.
        """
        command, params, q = np.asarray(command, dtype=float), self._params, joints.q
        if self.latched is not None:
            return self.stop(now, joints), self.latched
        if command.shape != q.shape or not np.isfinite(command).all():
            return self.stop(now, joints), Failure(ArmStop.BROKEN_COMMAND, count=len(q), command=command)
        if planned is not None and joints.time - planned > params.stale_plan and command.any():
            return self.stop(now, joints), Failure(ArmStop.OLD_PLAN, age=joints.time - planned, bound=params.stale_plan)
        speed = self.speed_scale * self._model.speed_limits
        down, up = self._room(q, age + self.command_timeout)
        slow = np.clip(command, -speed, speed)
        cut = np.clip(slow, -down, up)
        begins, step = self._time is None, self._step(joints.time, now)
        # room to brake comes before smoothness
        allowed = np.clip(self._towards(cut, step), np.maximum(-down, -speed), np.minimum(up, speed))
        near = self._near(q, allowed, age) if allowed.any() else None
        if near is not None:
            return self.stop(now, joints), near
        self._last, self._now, self._stopping = allowed, now, False
        wrong = np.abs(allowed - command) > 1e-9
        if begins or not wrong.any():  # how long the arm has had for the first command is not known
            return allowed, None
        code = (
            ArmStop.SPEED_CUT if (slow != command).any() else ArmStop.POSITION_CUT if (cut != command).any() else ArmStop.ACCELERATION_CUT
        )
        return allowed, Failure(code, joints=", ".join(name for name, bad in zip(self._model.names, wrong, strict=True) if bad))

    def stop(self, now: float, joints: Joints | None = None) -> Array:
        """Return the next command (7,) rad/s of a controlled stop, zero at the end.

        Args:
            now: s, monotonic.
            joints: As measured, where that is known: then no joint comes nearer to its limit than it can brake, whatever its lag.

        Where no command has left for long, the drive still holds the last one until its own timeout, and brakes by itself from then on.
        The stop begins from that speed.
        """
        passed = 0.0 if self._now is None else max(now - self._now, 0.0)
        if not self._stopping:
            passed = max(min(passed, FIRST_STEP), passed - self.command_timeout)
        self._last, self._now, self._stopping = self._towards(np.zeros(len(self._last)), self.braking * passed), now, True
        if joints is not None:
            down, up = self._room(joints.q, 0.0)
            self._last = np.clip(self._last, -down, up)
        return self._last

    def latch(self, failure: Failure, now: float) -> Array:
        """Stop, and go on stopping until `reset`; the next command (7,) rad/s."""
        self.latched = self.latched or failure
        return self.stop(now)

    def _damage(self, joints: Joints) -> Failure | None:
        params, names, (low, high) = self._params, self._model.names, self._model.position_limits.T
        outside, share = np.maximum(low - joints.q, joints.q - high), np.abs(joints.qdot) / self._model.speed_limits
        i, k = int(outside.argmax()), int(share.argmax())
        if outside[i] > params.tolerance:
            return Failure(ArmStop.BEYOND_LIMIT, joint=names[i], value=float(outside[i]), bound=params.tolerance)
        if share[k] > params.overspeed:
            return Failure(ArmStop.OVERSPEED, joint=names[k], value=float(share[k]), bound=params.overspeed)
        left, what = clearance(joints.q, self._model.chain)
        return Failure(ArmStop.CONTACT, obstacle=OBSTACLES[what]) if left <= 0.0 else None

    def _near(self, q: Array, command: Array, age: float) -> Failure | None:
        """Braking from `command`, at once or after the drives have held it, would end too near to something, and not further than now."""
        chain, bound = self._model.chain, self._params.clearance
        left, what = braking_clearance(q, command, self.braking, age, chain)
        held, held_what = braking_clearance(q, command, self.braking, age + self.command_timeout, chain)
        if held + bound < left:  # a held command must not touch, no more: it takes a fault
            left, what = held + bound, held_what
        if left >= bound or left > clearance(q, chain)[0]:
            return None
        return Failure(ArmStop.NEAR, left=max(0.0, left), obstacle=OBSTACLES[what], bound=bound)

    def _room(self, q: Array, hold: float) -> tuple[Array, Array]:
        """rad/s (7,) down and up, at which each joint may move for `hold` (s) and then brake before its limit."""
        low, high = self._model.position_limits.T + self._params.margin * np.array([[1.0], [-1.0]])
        braking = self.braking
        down, up = (np.sqrt((braking * hold) ** 2 + 2.0 * braking * np.maximum(0.0, room)) - braking * hold for room in (q - low, high - q))
        return down, up

    def _step(self, time: float, now: float) -> float:
        """rad/s, by which a command may differ from the last one.

        Joint states come irregularly, so their stamps tell the time between two commands.
        After a stop only the time since its last command counts.
        """
        passed = 0.0 if self._time is None else min(max(time - self._time, 0.0), LONGEST_STEP)
        if self._stopping and self._now is not None:
            passed = min(passed, max(now - self._now, 0.0))
        self._time = time
        return self._params.acceleration * passed

    def _towards(self, command: Array, step: float) -> Array:
        return self._last + np.clip(command - self._last, -step, step)
