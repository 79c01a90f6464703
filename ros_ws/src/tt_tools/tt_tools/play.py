"""Timing of playback: recorded messages and clock ticks in one order, and the position of playback in the recording."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Iterator
from typing import NamedTuple


class PlaybackItem(NamedTuple):
    """One thing that a player publishes: a recorded message, or a clock tick, which is a message on /clock.

    Attributes:
        time: Time in the recording, ns.
        topic: Name and type of the message's topic; None for a clock tick.
        data: The serialized message (CDR); empty for a clock tick.
    """

    time: int
    topic: tuple[str, str] | None = None
    data: bytes = b""


def with_clock(messages: Iterable[PlaybackItem], start: int, stop: int, period: int) -> Iterator[PlaybackItem]:
    """Yield recorded messages together with clock ticks at equal intervals, in the order of time.

    A tick comes before a message of the same time.

    Args:
        messages: The messages, in the order of time.
        start: Time of the first tick in the recording, ns.
        stop: Time of the recording after which there are no more ticks, ns.
        period: Time from one tick to the next, ns.
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
    """The position of playback in a recording. It advances by `rate` recorded seconds per second, unless playback is paused.

    A step (message or clock tick) that is late is played at once, not dropped, and delays do not add up. The present time `now` is that of
    the caller's monotonic clock. All methods may be called by any thread.
    """

    def __init__(self, position: int, rate: float, now: float, *, paused: bool = False) -> None:
        """Set the first position.

        Args:
            position: Time in the recording at which playback begins, ns.
            rate: Recorded seconds per second.
            now: Present time, s.
            paused: Whether playback begins paused.
        """
        self._lock = threading.Lock()
        self._position, self._since, self._rate, self._paused = position, now, rate, paused
        self._singles = 0  # number of messages that are still to be played although playback is paused
        self._moves, self._origin = 0, position

    @property
    def paused(self) -> bool:
        """Whether playback is paused."""
        return self._paused

    @property
    def rate(self) -> float:
        """Recorded seconds per second."""
        return self._rate

    @property
    def moves(self) -> int:
        """How often `seek` was called. A change tells that the position has jumped."""
        return self._moves

    @property
    def origin(self) -> int:
        """Position to which the last `seek` went, or at which playback began without one; time in the recording, ns."""
        return self._origin

    def position(self, now: float) -> int:
        """Return the position at the present time `now` (s), as time in the recording, ns."""
        with self._lock:
            return self._at(now)

    def _at(self, now: float) -> int:
        return self._position if self._paused else self._position + round((now - self._since) * self._rate * 1e9)

    def wait(self, step: PlaybackItem, now: float) -> float:
        """Return the time until a step is due.

        Args:
            step: The next message or clock tick.
            now: Present time, s.

        Returns:
            Time to wait, s; 0 for a step that is late. While playback is paused it is infinite, or 0 if `play_next` asked for a message.
        """
        with self._lock:
            if self._paused:
                return 0.0 if self._singles else math.inf
            return max(0.0, (step.time - self._at(now)) * 1e-9 / self._rate)

    def done(self, step: PlaybackItem) -> None:
        """Note that a step was played. While paused, the position moves to it, and a message uses up one request of `play_next`."""
        with self._lock:
            if self._paused:
                self._position = step.time
                self._singles -= step.topic is not None and self._singles > 0

    def pause(self, paused: bool, now: float) -> None:
        """Pause playback at the present time `now` (s), or resume it if `paused` is False. Requests of `play_next` are dropped."""
        with self._lock:
            self._position, self._since, self._paused, self._singles = self._at(now), now, paused, 0

    def set_rate(self, rate: float, now: float) -> None:
        """Change the rate (recorded seconds per second) at the present time `now` (s)."""
        with self._lock:
            self._position, self._since, self._rate = self._at(now), now, rate

    def seek(self, position: int, now: float) -> None:
        """Move playback to `position` (time in the recording, ns) at the present time `now` (s)."""
        with self._lock:
            self._position, self._since, self._singles, self._origin = position, now, 0, position
            self._moves += 1

    def play_next(self) -> bool:
        """Ask for one more message to be played while playback is paused. Return False, without effect, if it is not paused."""
        with self._lock:
            self._singles += self._paused
            return self._paused
