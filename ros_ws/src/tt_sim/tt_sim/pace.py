"""Simulated time beside the real one."""

from __future__ import annotations

import time

SLEW = 2e-6  # s, by which the stamps are brought nearer to the system's clock in a step; in a second of ticks that is 1 ms


class Pace:
    """A clock that runs `rtf` times as fast as the real one, from the system's time on.

    Attributes:
        start: s, simulated time of the start, which is the system's.
    """

    def __init__(self, rtf: float) -> None:
        """Start it; rtf: simulated seconds per real second."""
        self.start, self._real_start, self._rtf = time.time(), time.monotonic(), rtf
        self._system_start = self.start  # later by as long as the clock has stood still

    def follow_system_clock(self) -> None:
        """Bring stamps nearer to the system's clock, which its time service makes faster or slower; only at rtf = 1."""
        if self._rtf == 1.0:
            drift = time.time() - self._system_start - (time.monotonic() - self._real_start)
            self._real_start -= min(max(drift, -SLEW), SLEW)

    def sleep_until(self, moment: float) -> None:
        """Sleep until a simulated time (s), or not at all when it has passed."""
        time.sleep(max(0.0, (moment - self.start) / self._rtf - (time.monotonic() - self._real_start)))

    def stand_still(self, moment: float, duration: float) -> None:
        """Stay at a simulated time (s) for `duration` (s); from then on this clock is behind the system's."""
        time.sleep(duration)
        before, self._real_start = self._real_start, time.monotonic() - (moment - self.start) / self._rtf
        self._system_start += self._real_start - before

    def late(self, moment: float, now: float) -> float:
        """Return by how many real seconds a simulated time (s) has passed at `now` (s, monotonic clock)."""
        return now - self._real_start - (moment - self.start) / self._rtf
