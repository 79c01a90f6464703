"""Offsets between the clock of this machine and those of others, from the times of a question and its answer (RFC 5905, Section 8)."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

OFFSET_WINDOW = 10.0  # s, for which a measured offset is used
MAX_SOURCES = 16
MAX_SAMPLES = 64  # of one source; at 4 questions a second the window holds 40
MAX_NAME = 128  # characters of the name of a source
CLOCK_ROUNDING = 1e-6  # s; a time of day as float64 is exact to 2.4e-7 s


class ClockOffset(NamedTuple):
    """Offset of one other clock from ours.

    Attributes:
        source: Name of the node whose clock it is.
        offset: s, that clock minus ours.
        uncertainty: s, largest possible error of `offset`: half the time between question and answer.
    """

    source: str
    offset: float
    uncertainty: float

    @property
    def least(self) -> float:
        """Smallest absolute offset that agrees with the measurement, s; 0 if the clock may be right."""
        return max(0.0, abs(self.offset) - self.uncertainty)


class _Sample(NamedTuple):
    time: float
    offset: float
    uncertainty: float


class ClockOffsets:
    """Offsets of at most MAX_SOURCES other clocks.

    The offset of a clock is that of the quickest exchange, question and answer, in the last OFFSET_WINDOW seconds.
    """

    def __init__(self) -> None:
        self._samples: dict[str, deque[_Sample]] = {}

    def add(self, source: str, t1: float, t2: float, t4: float) -> bool:
        """Add one exchange: a question to another node for its time, and the answer.

        Earlier exchanges that contradict this one are dropped, because one of the two clocks must have been set since then.

        Args:
            source: Name of the node that answered.
            t1: s, our clock when we asked.
            t2: s, the other clock when the node answered.
            t4: s, our clock when the answer came.

        Returns:
            False if the exchange is refused: t4 is before t1, the name is longer than MAX_NAME, or MAX_SOURCES other clocks are known.
        """
        if not t1 <= t4 or len(source) > MAX_NAME:
            return False
        if source not in self._samples:
            self._samples = {name: kept for name, kept in self._samples.items() if _recent(kept[-1], t4)}
            if len(self._samples) >= MAX_SOURCES:
                return False
        uncertainty = (t4 - t1) / 2.0
        newest = _Sample(t4, (t2 - t1) - uncertainty, uncertainty)
        kept = (sample for sample in self._samples.get(source, ()) if _recent(sample, t4) and _agree(sample, newest))
        self._samples[source] = deque((*kept, newest), MAX_SAMPLES)
        return True

    def offset(self, source: str, now: float) -> ClockOffset | None:
        """Return the offset of one clock.

        Args:
            source: Name of the node whose clock it is.
            now: s, our clock.

        Returns:
            The offset, or None if there was no exchange in the OFFSET_WINDOW seconds before `now`.
        """
        recent = [sample for sample in self._samples.get(source, ()) if _recent(sample, now)]
        if not recent:
            return None
        best = min(recent, key=lambda sample: sample.uncertainty)
        return ClockOffset(source, best.offset, best.uncertainty)

    def all(self, now: float) -> list[ClockOffset]:
        """Return the offsets of all clocks that are known at `now` (s, our clock), sorted by name."""
        return [known for source in sorted(self._samples) if (known := self.offset(source, now)) is not None]

    def worst(self, now: float) -> ClockOffset | None:
        """Return the offset that is largest even if its uncertainty is subtracted; None if no clock is known at `now` (s, our clock)."""
        return max(self.all(now), key=lambda known: known.least, default=None)


def _recent(sample: _Sample, now: float) -> bool:
    """Tell whether a sample still counts at `now` (s)."""
    return abs(now - sample.time) <= OFFSET_WINDOW


def _agree(one: _Sample, other: _Sample) -> bool:
    """Tell whether one offset lies within the uncertainty of both."""
    return abs(one.offset - other.offset) <= one.uncertainty + other.uncertainty + CLOCK_ROUNDING
