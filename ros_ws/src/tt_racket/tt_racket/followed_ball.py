"""What is kept from one path of a ball to the next, while it is followed: what is asked of its return, and that it has bounced."""

from __future__ import annotations

import math

from tt_core.states import BallPath, ReturnGoal

from .goal import GoalParams, default_goal

SETTLED = 0.1  # s after the first path of a ball, from when on its default goal stays: first estimates of the spin are rough
BACK = 0.3  # m, by which another ball is at least farther away than the last one was
GAP = 0.5  # s without a path, after which it is another ball
UNSURE = 0.02  # s, by which a bounce may come earlier than the last path told


class FollowedBall:
    """One ball after the other, as their paths tell.

    Attributes:
        bounced: Whether the ball has bounced on the robot's half before the last path began.
    """

    def __init__(self) -> None:
        """Begin without a ball."""
        self.bounced = False
        self._goal: ReturnGoal | None = None
        self._first = self._last = self._bounce = -math.inf  # s: of its first and last path, and of its bounce
        self._x = -math.inf  # m, where the last path began

    def follow(self, path: BallPath, params: GoalParams, asked: ReturnGoal | None = None) -> ReturnGoal:
        """Take the next path; return the goal of the ball.

        Args:
            path: From a newer state of the ball, or of another ball.
            params: What is asked by default.
            asked: The goal if somebody has asked for one.
        """
        start, x = float(path.times[0]), float(path.positions[0, 0])
        if x > self._x + BACK or not self._last <= start <= self._last + GAP:
            self._goal, self._first, self._bounce = None, start, math.inf
        if path.bounces:
            self._bounce = path.bounces[0].time
        self.bounced = not path.bounces and start > self._bounce - UNSURE
        self._last, self._x = start, x
        if self._goal is None or start < self._first + SETTLED:
            self._goal = default_goal(path.spins[0], params)
        return asked or self._goal
