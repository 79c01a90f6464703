"""Data of a ball that are kept from one predicted path to the next one: the goal of its return, and whether it has bounced."""

from __future__ import annotations

import math

from tt_core.ball_change import BallChange
from tt_core.states import BallPath, ReturnGoal

from .goal import GoalParams, default_goal

GOAL_SETTLING_TIME = 0.1  # s after the first path of a ball, after which its goal is kept: the first estimates of the spin are rough
UNSURE = 0.02  # s by which a bounce may happen before the time that the previous path predicted


class FollowedBall:
    """The ball that is now in flight: its goal, and whether it has bounced. It detects from the paths when a new ball comes.

    Attributes:
        bounced: Whether the ball had bounced on the robot's half before the last path began.
    """

    def __init__(self) -> None:
        """Create it without a ball."""
        self.bounced = False
        self._goal: ReturnGoal | None = None
        self._first = self._bounce = -math.inf  # s: of its first path, and of its bounce
        self._change = BallChange()

    def follow(self, path: BallPath, params: GoalParams, asked: ReturnGoal | None = None) -> ReturnGoal:
        """Take the next predicted path, update `bounced`, and return the goal of the ball's return.

        The default goal may change with the estimated spin during the first GOAL_SETTLING_TIME seconds of a ball, and is then kept.

        Args:
            path: Predicted flight from a newer state of the same ball, or of another ball.
            params: Default goal for each kind of spin.
            asked: A goal that a user has asked for, which replaces the default goal; None for none.
        """
        start = float(path.times[0])
        if self._change.is_new(start, float(path.positions[0, 0])):
            self._goal, self._first, self._bounce = None, start, math.inf
        if path.bounces:
            self._bounce = path.bounces[0].time
        self.bounced = not path.bounces and start > self._bounce - UNSURE
        if self._goal is None or start < self._first + GOAL_SETTLING_TIME:
            self._goal = default_goal(path.spins[0], params)
        return asked or self._goal
