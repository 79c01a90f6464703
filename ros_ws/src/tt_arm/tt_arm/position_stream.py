"""Positions for arms that take no velocities: where each velocity command leads, a little ahead, and a stop there if no newer one comes.

The positions are those that the commands so far add up to, so that a drive with a lag follows without getting slower. They stay near the
measured ones. A trajectory controller that gets nothing newer follows the last points to their end: it holds the command for `ahead`, then
brakes, as drives do that take velocities and hold them for `swing.command_timeout`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from tt_core.errors import check_range
from tt_core.states import Array

LONGEST_AHEAD = 0.05  # s
LEASH = 0.1  # rad or m, by which the positions may differ from measured ones: 0.02 s of lag at 5 rad/s, or 5 m/s
LONGEST_STEP = 0.05  # s without a command, after which the positions start anew from measured ones


class PositionPoints(NamedTuple):
    """What a trajectory controller gets."""

    times: Array  # (2,) s from now
    positions: Array  # (2, n) rad or m
    velocities: Array  # (2, n) rad/s or m/s


class PositionStream:
    """Adds velocity commands up to positions."""

    def __init__(self, braking: Array, ahead: float) -> None:
        """Begin without a position.

        Args:
            braking: (n,) rad/s^2 or m/s^2, at which each joint brakes at the end of the points.
            ahead: s, at which the first point is.

        Raises:
            OutOfRange: `ahead` is not above 0, or above LONGEST_AHEAD.
        """
        self._braking, self._ahead = braking, check_range("ahead", ahead, 1e-3, LONGEST_AHEAD)
        self._reference: Array | None = None
        self._command, self._time = np.zeros(len(braking)), -np.inf

    def points(self, time: float, q: Array, command: Array) -> PositionPoints:
        """Return the points for a command.

        Args:
            time: s, by a clock that only goes forwards.
            q: (n,) rad or m, measured.
            command: (n,) rad/s or m/s.
        """
        passed = time - self._time
        if self._reference is None or not 0.0 <= passed <= LONGEST_STEP:
            reference = np.array(q)
        else:
            reference = np.clip(self._reference + passed * self._command, q - LEASH, q + LEASH)
        self._reference, self._command, self._time = reference, np.array(command), time
        held = reference + self._ahead * command
        stop = np.abs(command) / self._braking  # s, that each joint takes to brake
        positions = np.array([held, held + 0.5 * stop * command])
        times = np.array([self._ahead, self._ahead + max(float(stop.max()), 1e-3)])
        return PositionPoints(times, positions, np.array([command, np.zeros(len(command))]))
