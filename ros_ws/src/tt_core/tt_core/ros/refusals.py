"""Reports of refused inputs of a node, at a bounded rate."""

from __future__ import annotations

import math
import time
from enum import Enum

from ..errors import TtError
from .diagnostics import Status

REFUSAL_INTERVAL = 0.1  # s, least time between two reports


class RefusalLine(Enum):
    """Lines that a node writes to the terminal about refused inputs."""

    REFUSED = "{what} refused: {error}"


class Refusals:
    """Counts the refused messages of one input, and reports them on /diagnostics and in the terminal, at most once in REFUSAL_INTERVAL.

    Attributes:
        total: Number of refusals so far.
    """

    def __init__(self, status: Status, what: str) -> None:
        """Start to count.

        Args:
            status: Diagnostics of the node.
            what: Name of the input, e.g. "image of left".
        """
        self._status, self._what = status, what
        self.total, self._reported, self._last = 0, 0, -math.inf

    def __call__(self, error: TtError) -> None:
        """Count one refusal, and publish it unless the last report was less than REFUSAL_INTERVAL ago.

        The status holds the number of all refusals, and of those since the last report.

        Args:
            error: Its failure is published as the reason.
        """
        self.total += 1
        now = time.monotonic()
        if now >= self._last + REFUSAL_INTERVAL:
            left_out, self._reported, self._last = self.total - self._reported - 1, self.total, now
            text = f"{self._what} refused: {error}"
            self._status.publish(text, warn=True, reason=error.failure, total=self.total, left_out=left_out)
            self._status.terminal.warn(RefusalLine.REFUSED, what=self._what, error=error)
