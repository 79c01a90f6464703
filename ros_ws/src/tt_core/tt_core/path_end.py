"""Reasons why a path of the ball ends."""

from __future__ import annotations

from enum import Enum


class PathEnd(str, Enum):
    """What ends a path, the computed flight of the ball. A member equals its word, and `str` gives the word."""

    STOP = "stop"  # the stop rule holds
    FLOOR = "floor"
    NET = "net"
    EDGE = "edge"  # of the table
    ROLLING = "rolling"  # after MOST_BOUNCES
    TOO_LONG = "too long"  # after LONGEST_PATH seconds
    TOO_FAR = "too far"  # farther than FARTHEST or faster than FASTEST

    def __str__(self) -> str:
        """Return the word."""
        return self.value
