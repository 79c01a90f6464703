"""The last word before the wire: whatever is asked, what leaves is finite, within the limits, and able to stop before a joint's end.

Knows nothing of swings. Small limits are cut and told; what means that something is broken latches: zero velocity until `reset`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tt_core.errors import check_range
from tt_core.states import Array

from .model import ArmModel


@dataclass(frozen=True, slots=True)
class GuardParams:
    """What the guard lets through."""

    acceleration: float = 40.0  # rad/s^2, steepest change of a command; twice what a swing uses
    braking: float = 20.0  # rad/s^2, that a joint can surely brake with; what a swing uses
    margin: float = 0.01  # rad, kept from the position limits
    tolerance: float = 0.02  # rad, a joint measured further than this beyond its limit means that something is broken
    stale: float = 0.05  # s without a joint state, after which the arm stops; 25 ticks of 2 ms

    def __post_init__(self) -> None:
        for name in ("acceleration", "braking"):
            check_range(name, getattr(self, name), 0.1, 1000.0)
        for name in ("margin", "tolerance"):
            check_range(name, getattr(self, name), 0.0, 0.5)
        check_range("stale", self.stale, 1e-3, 10.0)


class Guard:
    """`latched`: None, or why only zero leaves until `reset`."""

    def __init__(self, model: ArmModel, params: GuardParams | None = None) -> None:
        self._model, self._params = model, params or GuardParams()
        self._time: float | None = None
        self._last = np.zeros(7)
        self.latched: str | None = None

    def check(self, time: float, command: Array, q: Array) -> tuple[Array, str | None]:
        """The command (7,) rad/s that may leave at `time` (s), for joints measured at q (7,) rad, and why it is another one, if it is."""
        command, q, params = np.asarray(command, dtype=float), np.asarray(q, dtype=float), self._params
        low, high = self._model.position_limits.T
        if self.latched is None:
            self.latched = self._broken(command, q, low, high)
        if self.latched is not None:
            return self._slew(time, np.zeros(7)), self.latched
        speed = self._model.speed_limits
        up = np.minimum(speed, np.sqrt(2.0 * params.braking * np.maximum(0.0, high - params.margin - q)))
        down = np.minimum(speed, np.sqrt(2.0 * params.braking * np.maximum(0.0, q - low - params.margin)))
        cut = np.clip(command, -down, up)
        allowed = np.clip(self._slew(time, cut), -down, up)  # room to brake comes before smoothness
        self._last = allowed
        wrong = np.abs(allowed - command) > 1e-9
        if not wrong.any():
            return allowed, None
        names = ", ".join(name for name, bad in zip(self._model.names, wrong, strict=True) if bad)
        return allowed, f"{'position or speed' if (cut != command).any() else 'acceleration'} limit: {names}"

    def stop(self, time: float) -> Array:
        """The next command (7,) of a controlled stop, zero at the end."""
        return self._slew(time, np.zeros(7))

    def stale(self, then: float, now: float) -> bool:
        """Whether a joint state of `then` (s) is too old `now`."""
        return now - then > self._params.stale

    def reset(self) -> None:
        """Lets commands through again, from zero."""
        self.latched, self._last, self._time = None, np.zeros(7), None

    def _broken(self, command: Array, q: Array, low: Array, high: Array) -> str | None:
        if command.shape != (7,) or q.shape != (7,):
            return f"7 joints expected, got a command of shape {command.shape} for joints of shape {q.shape}"
        if not (np.isfinite(command).all() and np.isfinite(q).all()):
            return f"not finite: command {command} at q = {q}"
        outside = np.maximum(low - q, q - high)
        if outside.max() > self._params.tolerance:
            return f"joint {self._model.names[int(outside.argmax())]} is {outside.max():.3f} rad beyond its limit"
        return None

    def _slew(self, time: float, command: Array) -> Array:
        """Towards `command`, no faster than the acceleration allows since the last one."""
        passed = 0.0 if self._time is None else min(max(time - self._time, 0.0), self._params.stale)
        step = self._params.acceleration * passed
        self._time = time
        self._last = self._last + np.clip(command - self._last, -step, step)
        return self._last
