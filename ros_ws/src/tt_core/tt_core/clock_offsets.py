"""How far the clocks of other machines are off, from the four times of a question and its answer (RFC 5905, Section 8)."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

WINDOW = 10.0  # s, for which a measurement counts
MAX_SOURCES = 16
MAX_SAMPLES = 64  # of one source; at 4 questions a second the window holds 40
MAX_NAME = 128  # characters of the name of a source
ROUNDING = 1e-6  # s; a time of day as float64 is exact to 2.4e-7 s


class ClockOffset(NamedTuple):
    """What is known of one clock.

    Attributes:
        source: Whose clock it is.
        offset: s, that clock minus ours.
        uncertainty: s, by which the offset may be wrong at most, however the way out and the way back share the delay.
    """

    source: str
    offset: float
    uncertainty: float

    @property
    def least(self) -> float:
        """Return the least by which the clock is off, s; 0 if it may be right."""
        return max(0.0, abs(self.offset) - self.uncertainty)


class _Sample(NamedTuple):
    time: float
    offset: float
    uncertainty: float


class ClockOffsets:
    """The offsets of at most MAX_SOURCES clocks, each from the shortest exchange of the last WINDOW seconds."""

    def __init__(self) -> None:
        self._samples: dict[str, deque[_Sample]] = {}

    def add(self, source: str, t1: float, t2: float, t4: float) -> bool:
        """Take one exchange.

        Exchanges that contradict the newest one are dropped: since then one of the two clocks was set.

        Args:
            source: Who answered.
            t1: s, our clock when we asked.
            t2: s, its clock when it answered.
            t4: s, our clock when the answer came.

        Returns:
            False if the exchange is refused: t4 is before t1, the name is longer than MAX_NAME, or there are MAX_SOURCES others.
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
        """Return the offset of one clock, or None without an exchange in the WINDOW seconds before `now` (s, our clock)."""
        recent = [sample for sample in self._samples.get(source, ()) if _recent(sample, now)]
        if not recent:
            return None
        best = min(recent, key=lambda sample: sample.uncertainty)
        return ClockOffset(source, best.offset, best.uncertainty)

    def all(self, now: float) -> list[ClockOffset]:
        """Return the offsets of all clocks that are known at `now` (s, our clock), by name."""
        return [known for source in sorted(self._samples) if (known := self.offset(source, now)) is not None]

    def worst(self, now: float) -> ClockOffset | None:
        """Return the clock that is off by the most beyond its uncertainty, or None if none is known at `now` (s, our clock)."""
        return max(self.all(now), key=lambda known: known.least, default=None)


def _recent(sample: _Sample, now: float) -> bool:
    """Tell whether a sample still counts at `now` (s)."""
    return abs(now - sample.time) <= WINDOW


def _agree(one: _Sample, other: _Sample) -> bool:
    """Tell whether one offset lies within the uncertainty of both."""
    return abs(one.offset - other.offset) <= one.uncertainty + other.uncertainty + ROUNDING
