"""Reasons why a path of the ball ends."""

from __future__ import annotations

from .text_enum import TextEnum


class PathEnd(TextEnum):
    """What ends a path, the computed flight of the ball."""

    STOP = "stop"  # the stop rule holds
    FLOOR = "floor"
    NET = "net"
    EDGE = "edge"  # of the table
    ROLLING = "rolling"  # after MOST_BOUNCES
    TOO_LONG = "too long"  # after LONGEST_PATH seconds
    TOO_FAR = "too far"  # farther than FARTHEST or faster than FASTEST
