"""The schedule of a player: recorded messages and clock ticks in one order, each at its time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple


class Step(NamedTuple):
    """A recorded message, or a tick of the clock.

    Attributes:
        time: ns, of the recording.
        topic: Name and type of the topic; None for a tick.
    """

    time: int
    topic: tuple[str, str] | None = None
    data: bytes = b""


def with_clock(messages: Iterable[Step], start: int, stop: int, period: int) -> Iterator[Step]:
    """Yield messages, and a tick of the clock every `period` from `start` to `stop` (all in ns).

    A tick comes before a message of the same time.
    """
    tick = start
    for step in messages:
        while tick <= step.time:
            yield Step(tick)
            tick += period
        yield step
    while tick <= stop:
        yield Step(tick)
        tick += period


def pace(steps: Iterable[Step], start: int, rate: float, now: Callable[[], float], sleep: Callable[[float], None]) -> Iterator[Step]:
    """Yield each step at its time; a late one is not dropped, and delays do not add up.

    Args:
        steps: In the order of time.
        start: ns, the time of the recording that is now.
        rate: Recorded seconds in a second.
        now: Gives s.
        sleep: Takes s; called before every step, with 0 for one that is late.
    """
    origin = now()
    for step in steps:
        sleep(max(0.0, origin + (step.time - start) * 1e-9 / rate - now()))
        yield step
