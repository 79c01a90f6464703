"""The last word before the wire: what leaves is finite, within the limits, and able to stop before a joint's end, table, floor and arm.

Knows nothing of swings. What is a little too much is cut and told; what means that something is broken, and what is cut for long, latches:
a controlled stop, and zero until `reset`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tt_core.errors import check_range
from tt_core.states import Array

from .clearance import OBSTACLES, braking_clearance, clearance
from .model import ArmModel


@dataclass(frozen=True, slots=True)
class GuardParams:
    """What the guard lets through."""

    acceleration: float = 40.0  # rad/s^2, steepest change of a command; twice what a swing uses
    speed_share: float = 1.0  # of the speed limits, Table A.12
    braking: float = 20.0  # rad/s^2, that a joint can surely brake with; what a swing uses
    margin: float = 0.01  # rad, kept from the position limits
    tolerance: float = 0.02  # rad, a joint measured further than this beyond its limit means that something is broken
    overspeed: float = 1.2  # times its speed limit, and a joint measured faster than this too
    clearance: float = 0.005  # m, kept from table, floor and arm; less than swings keep
    patience: float = 0.1  # s, for which commands are cut without a pause before they latch
    stale: float = 0.05  # s without a joint state, after which the arm stops; 25 ticks of 2 ms
    late: float = 0.2  # s, that joint states may be old when they come; a servo this far behind is blind
    stale_plan: float = 5.0  # s, after which a plan no longer moves the arm; a swing and its way back take 2

    def __post_init__(self) -> None:
        for name in ("acceleration", "braking"):
            check_range(name, getattr(self, name), 0.1, 1000.0)
        for name in ("margin", "tolerance", "clearance"):
            check_range(name, getattr(self, name), 0.0, 0.5)
        check_range("speed_share", self.speed_share, 0.0, 1.0)
        check_range("overspeed", self.overspeed, 1.0, 100.0)
        check_range("patience", self.patience, 0.0, 10.0)
        check_range("stale", self.stale, 1e-3, 10.0)
        check_range("late", self.late, 1e-3, 10.0)
        check_range("stale_plan", self.stale_plan, 1e-2, 1000.0)


class Guard:
    """`latched`: None, or why only zero leaves until `reset`."""

    def __init__(self, model: ArmModel, params: GuardParams | None = None) -> None:
        self._model, self._params = model, params or GuardParams()
        self.latched: str | None = None
        self._time: float | None = None
        self._cut_since: float | None = None
        self.reset()

    def check(
        self, time: float, command: Array, q: Array, qdot: Array | None = None, planned: float | None = None
    ) -> tuple[Array, str | None]:
        """The command (7,) rad/s that may leave at `time` (s), and why it is another one, if it is.

        q: (7,) rad, and qdot: (7,) rad/s, if known: measured. planned: s, when the plan was made that the command follows.
        """
        command, q = np.asarray(command, dtype=float), np.asarray(q, dtype=float)
        qdot = np.zeros(7) if qdot is None else np.asarray(qdot, dtype=float)
        self.latched = self.latched or self._broken(
            time, command, q, np.zeros(7) if qdot is None else np.asarray(qdot, dtype=float), planned
        )
        if self.latched is not None:
            return self.stop(time), self.latched
        params, (low, high) = self._params, self._model.position_limits.T
        speed = params.speed_share * self._model.speed_limits
        up = np.sqrt(2.0 * params.braking * np.maximum(0.0, high - params.margin - q))
        down = np.sqrt(2.0 * params.braking * np.maximum(0.0, q - low - params.margin))
        slow = np.clip(command, -speed, speed)
        cut = np.clip(slow, -down, up)
        begins, step = self._time is None, self._step(time)
        allowed = np.clip(self._towards(cut, step), np.maximum(-down, -speed), np.minimum(up, speed))  # room to brake before smoothness
        self.latched = self._collides(q, allowed) if allowed.any() else None
        self._last = allowed if self.latched is None else self._towards(np.zeros(7), step)
        if self.latched is not None:
            return self._last, self.latched
        wrong = np.abs(allowed - command) > 1e-9
        if begins or not wrong.any():  # the first is zero, since how long the arm has had for another is not known
            self._cut_since = None
            return allowed, None
        kind = "speed" if (slow != command).any() else "position" if (cut != command).any() else "acceleration"
        reason = f"{kind} limit: {', '.join(name for name, bad in zip(self._model.names, wrong, strict=True) if bad)}"
        self._cut_since = time if self._cut_since is None else self._cut_since
        if time - self._cut_since > params.patience:
            self.latched = reason = f"{reason}, for {time - self._cut_since:.3f} s"
        return allowed, reason

    def stop(self, time: float) -> Array:
        """The next command (7,) of a controlled stop, zero at the end."""
        self._last = self._towards(np.zeros(7), self._step(time))
        return self._last

    def latch(self, reason: str) -> Array:
        """Zero (7,) from now on."""
        self.latched, self._last = reason, np.zeros(7)
        return self._last

    def stale(self, then: float, now: float) -> bool:
        """Whether a joint state of `then` (s) is too old `now`."""
        return now - then > self._params.stale

    def late(self, then: float, now: float) -> bool:
        """Whether a joint state of `then` (s) comes too late `now`."""
        return now - then > self._params.late

    def reset(self) -> None:
        """Lets commands through again, from zero."""
        self.latched, self._last, self._time, self._cut_since = None, np.zeros(7), None, None

    def _broken(self, time: float, command: Array, q: Array, qdot: Array, planned: float | None) -> str | None:
        if not command.shape == q.shape == qdot.shape == (7,):
            return f"7 joints expected, got a command of shape {command.shape} for joints of shapes {q.shape} and {qdot.shape}"
        if not (np.isfinite(command).all() and np.isfinite(q).all() and np.isfinite(qdot).all()):
            return f"not finite: command {command} at q = {q}, qdot = {qdot}"
        low, high = self._model.position_limits.T
        outside, speed = np.maximum(low - q, q - high), np.abs(qdot) / self._model.speed_limits
        if outside.max() > self._params.tolerance:
            return f"joint {self._model.names[int(outside.argmax())]} is {outside.max():.3f} rad beyond its limit"
        if speed.max() > self._params.overspeed:
            return f"joint {self._model.names[int(speed.argmax())]} moves at {speed.max():.2f} times its speed limit"
        if planned is not None and time - planned > self._params.stale_plan and command.any():
            return f"the plan is {time - planned:.2f} s old"
        return None

    def _collides(self, q: Array, command: Array) -> str | None:
        """Whether braking from `command` ends too near to something, and not further from it than now."""
        left, what = braking_clearance(q, command, self._params.braking, self._model.chain)
        if left >= self._params.clearance or left > clearance(q, self._model.chain)[0]:
            return None
        return f"braking would end {max(0.0, 1e3 * left):.0f} mm from {OBSTACLES[what]}"

    def _step(self, time: float) -> float:
        """rad/s, by which a command may differ from the last one."""
        passed = 0.0 if self._time is None else min(max(time - self._time, 0.0), self._params.stale)
        self._time = time
        return self._params.acceleration * passed

    def _towards(self, command: Array, step: float) -> Array:
        return self._last + np.clip(command - self._last, -step, step)
