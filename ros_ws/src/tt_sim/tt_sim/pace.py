"""Relation of simulated time to real time."""

from __future__ import annotations

import time

SLEW = 2e-6  # s, largest correction towards the system's clock in one call; 1 ms in one second of ticks


class Pace:
    """Clock of the simulated time: it starts at the system's time and runs `rtf` times as fast as real time.

    Attributes:
        start: s, simulated time of the start, equal to the system's time then.
    """

    def __init__(self, rtf: float) -> None:
        """Start the clock.

        Args:
            rtf: Real-time factor: simulated seconds per real second.
        """
        self.start, self._real_start, self._rtf = time.time(), time.monotonic(), rtf
        self._system_start = self.start  # later by as long as the clock has stood still

    def follow_system_clock(self) -> None:
        """Correct the simulated time by a small step towards the system's clock, which a time service may change; only if rtf is 1."""
        if self._rtf == 1.0:
            drift = time.time() - self._system_start - (time.monotonic() - self._real_start)
            self._real_start -= min(max(drift, -SLEW), SLEW)

    def sleep_until(self, moment: float) -> None:
        """Sleep until a simulated time (s); return at once if it has passed."""
        time.sleep(max(0.0, (moment - self.start) / self._rtf - (time.monotonic() - self._real_start)))

    def stand_still(self, moment: float, duration: float) -> None:
        """Stop the simulated time for a while; afterwards it is behind the system's clock.

        Args:
            moment: s, simulated time at which it stops.
            duration: s, real time for which it stops.
        """
        time.sleep(duration)
        before, self._real_start = self._real_start, time.monotonic() - (moment - self.start) / self._rtf
        self._system_start += self._real_start - before

    def late(self, moment: float, now: float) -> float:
        """Return how long ago a simulated time was reached, in real seconds; negative if it is still to come.

        Args:
            moment: s, simulated time.
            now: s, monotonic clock.
        """
        return now - self._real_start - (moment - self.start) / self._rtf
