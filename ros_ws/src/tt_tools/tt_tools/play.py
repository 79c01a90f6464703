"""The schedule of a player: recorded messages and clock ticks in one order, and where playback stands in it."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Iterator
from typing import NamedTuple


class PlaybackItem(NamedTuple):
    """A recorded message, or a tick of the clock.

    Attributes:
        time: ns, of the recording.
        topic: Name and type of the topic; None for a tick.
    """

    time: int
    topic: tuple[str, str] | None = None
    data: bytes = b""


def with_clock(messages: Iterable[PlaybackItem], start: int, stop: int, period: int) -> Iterator[PlaybackItem]:
    """Yield messages, and a tick of the clock every `period` from `start` to `stop` (all in ns).

    A tick comes before a message of the same time.
    """
    tick = start
    for step in messages:
        while tick <= step.time:
            yield PlaybackItem(tick)
            tick += period
        yield step
    while tick <= stop:
        yield PlaybackItem(tick)
        tick += period


class Playback:
    """Where playback stands: recorded time passes with `rate` unless it is paused. All methods may be called by any thread.

    A late step is not dropped, and delays do not add up.
    """

    def __init__(self, position: int, rate: float, now: float, *, paused: bool = False) -> None:
        """Begin.

        Args:
            position: ns, time of the recording that is now.
            rate: Recorded seconds in a second.
            now: s.
            paused: Whether time stands still.
        """
        self._lock = threading.Lock()
        self._position, self._since, self._rate, self._paused = position, now, rate, paused
        self._singles = 0  # messages that are to be played although it is paused
        self._moves, self._origin = 0, position

    @property
    def paused(self) -> bool:
        """Whether time stands still."""
        return self._paused

    @property
    def rate(self) -> float:
        """Recorded seconds in a second."""
        return self._rate

    @property
    def moves(self) -> int:
        """How often `seek` was called."""
        return self._moves

    @property
    def origin(self) -> int:
        """Where the last `seek` went to, or where playback began; ns, of the recording."""
        return self._origin

    def position(self, now: float) -> int:
        """Return the time of the recording, ns, at `now`, s."""
        with self._lock:
            return self._at(now)

    def _at(self, now: float) -> int:
        return self._position if self._paused else self._position + round((now - self._since) * self._rate * 1e9)

    def wait(self, step: PlaybackItem, now: float) -> float:
        """Return how long until a step is due, s; infinite while playback is paused, 0 for one that is late."""
        with self._lock:
            if self._paused:
                return 0.0 if self._singles else math.inf
            return max(0.0, (step.time - self._at(now)) * 1e-9 / self._rate)

    def done(self, step: PlaybackItem) -> None:
        """Record that a step was played. While paused, it moves the position and uses up one message that `play_next` asked for."""
        with self._lock:
            if self._paused:
                self._position = step.time
                self._singles -= step.topic is not None and self._singles > 0

    def pause(self, paused: bool, now: float) -> None:
        """Stop or go on at `now`, s."""
        with self._lock:
            self._position, self._since, self._paused, self._singles = self._at(now), now, paused, 0

    def set_rate(self, rate: float, now: float) -> None:
        """Go on with another rate at `now`, s."""
        with self._lock:
            self._position, self._since, self._rate = self._at(now), now, rate

    def seek(self, position: int, now: float) -> None:
        """Go on at `position`, ns of the recording, at `now`, s."""
        with self._lock:
            self._position, self._since, self._singles, self._origin = position, now, 0, position
            self._moves += 1

    def play_next(self) -> bool:
        """Play one more message although playback is paused. Return False if it is not paused."""
        with self._lock:
            self._singles += self._paused
            return self._paused
