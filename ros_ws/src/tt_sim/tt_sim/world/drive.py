"""Drives of the simulated arm: they follow the newest velocity command of one controller, and brake without a valid command."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tt_arm.joints import JOINT_ACCELERATION, JointLimits
from tt_core.constants import COMMAND_TIMEOUT
from tt_core.errors import check_array, check_range
from tt_core.params import check, param
from tt_core.states import Array

LARGEST_SPEED_COMMAND = 100.0  # rad/s, largest command that is accepted (and clipped to the speed limit); 16 times the fastest limit


@dataclass(frozen=True)
class DriveParams:
    """Behaviour of the drives without a valid command."""

    command_timeout: float = param(
        COMMAND_TIMEOUT,
        "s",
        "time for which a command holds, as in the drives of real arms; the arm must know it as `swing.command_timeout`",
        low=0.001,
        high=10.0,
    )
    braking: float = param(
        JOINT_ACCELERATION,
        "rad/s^2",
        "deceleration without a command of each joint whose description states no acceleration; the guard counts on `swing.acceleration`",
        low=0.1,
        high=1000.0,
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class Drive:
    """Velocity controllers of all joints.

    Attributes:
        sole: Whether at most one node publishes commands. While more do, the drives brake.
    """

    def __init__(self, limits: JointLimits, params: DriveParams | None = None) -> None:
        """Start without a command.

        Args:
            limits: Limits of the joints. Commands are clipped to their speed limits.
            params: Behaviour without a valid command.
        """
        self.params = params or DriveParams()
        self.sole = True
        self._names, self._speeds = limits.names, limits.speed
        self._deceleration = limits.reduced(acceleration=self.params.braking).acceleration
        self._given: tuple[Array, float] | None = None  # the newest command and when it came
        self._ramp: Array | None = None  # rad/s, while the joints brake

    def take(self, command: object, now: float) -> None:
        """Store a command, clipped to the speed limits.

        Args:
            command: (n,) rad/s, joint velocities.
            now: s, time by a clock that only goes forwards.

        Raises:
            BadShape: The command is not one number for each joint.
            NotFinite: A number is NaN or infinite.
            OutOfRange: A number is beyond LARGEST_SPEED_COMMAND.
        """
        values = check_array("command", command, (len(self._names),))
        for name, value in zip(self._names, values, strict=True):
            check_range(f"command of {name}", value, -LARGEST_SPEED_COMMAND, LARGEST_SPEED_COMMAND)
        self._given = np.clip(values, -self._speeds, self._speeds), now

    def command(self, now: float, duration: float, qdot: Array, timeout: float) -> Array:
        """Return the velocities that the joints follow for one tick, one step of the simulation.

        Args:
            now: s, by the clock of `take`.
            duration: s, of the tick.
            qdot: (n,) rad/s, joint velocities at the beginning of the tick, from which braking starts.
            timeout: s, by the clock of `take`: how long a command is valid. Negative: no command is.

        Returns:
            (n,) rad/s, the newest command while it is valid, otherwise a ramp to zero.
        """
        command, came = self._given or (None, now)
        if self.sole and command is not None and now - came <= timeout:
            self._ramp = None
            return command
        step = self._deceleration * duration
        last = np.array(qdot) if self._ramp is None else self._ramp
        self._ramp = last - np.clip(last, -step, step)
        return self._ramp

    @property
    def braking(self) -> bool:
        """Whether the drives had no valid command in the last tick."""
        return self._ramp is not None
