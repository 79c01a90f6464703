"""What a node refuses, told without flooding."""

from __future__ import annotations

import math
import time

from .diagnostics import Status

INTERVAL = 0.1  # s, at least, between two refusals that are told


class Refusals:
    """Tell on /diagnostics what is refused of one kind of input, at most once in INTERVAL.

    Attributes:
        total: How many refusals there were.
    """

    def __init__(self, status: Status, what: str) -> None:
        """what: the input, for people, e.g. "image of left"."""
        self._status, self._what = status, what
        self.total, self._told, self._last = 0, 0, -math.inf

    def __call__(self, reason: object) -> None:
        """Count a refusal, and tell it with the number of those before it that were not told. reason: for people, e.g. an error."""
        self.total += 1
        now = time.monotonic()
        if now >= self._last + INTERVAL:
            left_out, self._told, self._last = self.total - self._told - 1, self.total, now
            self._status.tell(f"{self._what} refused: {reason}", warn=True, total=self.total, left_out=left_out)
