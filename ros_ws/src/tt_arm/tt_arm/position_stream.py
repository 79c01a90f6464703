"""Convert velocity commands to trajectory points, for arms whose driver takes positions and not velocities.

The positions are the integral of the commands so far, so that a drive with a lag follows without getting slower. They are kept near the
measured positions. The points lead a short time ahead and then stop. A trajectory controller that gets no newer points follows the last
ones to their end: it keeps the commanded velocity for `ahead` seconds and then brakes, as drives do that take velocities and hold them for
`swing.command_timeout`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from tt_core.errors import check_range
from tt_core.states import Array

LONGEST_AHEAD = 0.05  # s, largest `ahead`
LEASH = 0.1  # rad or m, largest difference of the positions from measured ones: 0.02 s of lag at 5 rad/s, or 5 m/s
LONGEST_PAUSE = 0.05  # s without a command, after which the positions start again from measured ones


class PositionPoints(NamedTuple):
    """Two points of a joint trajectory for a trajectory controller: where the command leads, and where the joints stop after it.

    Attributes:
        times: (2,) s from now.
        positions: (2, n) rad or m.
        velocities: (2, n) rad/s or m/s; zero in the second point.
    """

    times: Array
    positions: Array
    velocities: Array


class PositionStream:
    """Converter that integrates velocity commands to positions for a trajectory controller."""

    def __init__(self, braking: Array, ahead: float) -> None:
        """Create it without a position.

        Args:
            braking: (n,) rad/s^2 or m/s^2, deceleration with which each joint brakes at the end of the points.
            ahead: s from now, time of the first point.

        Raises:
            OutOfRange: `ahead` is not above 0, or above LONGEST_AHEAD.
        """
        self._braking, self._ahead = braking, check_range("ahead", ahead, 1e-3, LONGEST_AHEAD)
        self._reference: Array | None = None
        self._command, self._time = np.zeros(len(braking)), -np.inf

    def points(self, time: float, q: Array, command: Array) -> PositionPoints:
        """Return the trajectory points for a velocity command.

        Args:
            time: s, present time on a monotonic clock.
            q: (n,) rad or m, measured joint positions.
            command: (n,) rad/s or m/s, velocity command.
        """
        passed = time - self._time
        if self._reference is None or not 0.0 <= passed <= LONGEST_PAUSE:
            reference = np.array(q)
        else:
            reference = np.clip(self._reference + passed * self._command, q - LEASH, q + LEASH)
        self._reference, self._command, self._time = reference, np.array(command), time
        held = reference + self._ahead * command
        stop = np.abs(command) / self._braking  # s, that each joint takes to brake
        positions = np.array([held, held + 0.5 * stop * command])
        times = np.array([self._ahead, self._ahead + max(float(stop.max()), 1e-3)])
        return PositionPoints(times, positions, np.array([command, np.zeros(len(command))]))
