"""Detection of the next ball in the states or paths of balls that follow one another."""

from __future__ import annotations

import math

NEXT_BALL_STEP = 0.3  # m; a ball at an x larger by this than the previous one is another ball
NEXT_BALL_GAP = 0.5  # s without a ball, after which the next one is another ball


class BallChange:
    """Time and place at which the ball was last; it detects from newer ones when another ball comes."""

    def __init__(self) -> None:
        """Create it without a ball."""
        self._time = self._x = -math.inf  # s, m: of the ball the last time

    def is_new(self, time: float, x: float) -> bool:
        """Return whether another ball than the last time has come, and remember time and place.

        Args:
            time: s, of the ball.
            x: m in `table`, of the ball.
        """
        is_new = x > self._x + NEXT_BALL_STEP or not self._time <= time <= self._time + NEXT_BALL_GAP
        self._time, self._x = time, x
        return is_new
