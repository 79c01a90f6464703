"""Tells what a node refuses, at a bounded rate."""

from __future__ import annotations

import math
import time
from enum import Enum

from ..errors import TtError
from .diagnostics import Status

INTERVAL = 0.1  # s, at least, between two refusals that are told


class RefusalLine(Enum):
    """What the terminal tells of refusals."""

    REFUSED = "{what} refused: {error}"


class Refusals:
    """Publishes on /diagnostics what is refused of one kind of input, at most once in INTERVAL.

    Attributes:
        total: How many refusals there were.
    """

    def __init__(self, status: Status, what: str) -> None:
        """Begin to count. `what` names the input, e.g. "image of left"."""
        self._status, self._what = status, what
        self.total, self._told, self._last = 0, 0, -math.inf

    def __call__(self, error: TtError) -> None:
        """Count a refusal, and publish it with the number of those before it that were not published.

        Args:
            error: Its failure is published as the reason.
        """
        self.total += 1
        now = time.monotonic()
        if now >= self._last + INTERVAL:
            left_out, self._told, self._last = self.total - self._told - 1, self.total, now
            text = f"{self._what} refused: {error}"
            self._status.publish(text, warn=True, reason=error.failure, total=self.total, left_out=left_out)
            self._status.terminal.warn(RefusalLine.REFUSED, what=self._what, error=error)
