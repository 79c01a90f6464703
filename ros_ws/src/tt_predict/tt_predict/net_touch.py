"""Prediction near the net: while it is uncertain whether the ball touches the net, its path continues behind the net.

The probability of a touch is computed from the covariance of the ball.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from tt_core.constants import BALL_RADIUS, NET_HEIGHT, NET_X
from tt_core.path_end import PathEnd
from tt_core.physics import Physics
from tt_core.states import BallPath, BallState

from .rollout import StopRule, rollout
from .uncertainty import uncertainty

PAST = NET_X - 2.0 * BALL_RADIUS  # m, x at which a ball has passed the net
TOUCH_HEIGHT = 0.08  # m above the tape; the probability of a touch is not computed for a path that passes the net higher than this
CERTAIN = 0.99  # probability of a touch above which the path ends at the net


class NetPath(NamedTuple):
    """Predicted path of a ball, and the probability that the ball touches the net.

    Attributes:
        path: Path of a ball that does not touch the net, or that ends there if a touch is certain.
        touch: Probability that the ball touches the net, 0 to 1.
    """

    path: BallPath
    touch: float


def rollout_past_net(ball: BallState, physics: Physics, stop: StopRule) -> NetPath:
    """Predict the path of a ball which may touch the net, and the probability of a touch.

    If the path meets the net but a touch is not certain, the path continues behind the net. There it is the path of the mean of those balls
    of the covariance that pass the net.

    Args:
        ball: State in which the path starts. Without a covariance it is taken as exact, so the probability is 0 or 1.
        physics: Models of air and table.
        stop: Condition at which the path ends if no contact ends it earlier.

    Returns:
        The path and the probability.
    """
    path = rollout(ball, physics, stop)
    if ball.covariance is None or not _is_near(path):
        return NetPath(path, float(path.ended is PathEnd.NET))
    passing = uncertainty(ball, physics, StopRule.at_x(PAST))
    touch = 1.0 - passing.reached if passing is not None else 1.0
    if passing is None or path.ended is not PathEnd.NET or touch > CERTAIN:
        return NetPath(path, touch)
    beyond = rollout(BallState.from_vector(float(passing.mean[0]), passing.mean[1:]), physics, stop)
    before = path.times < beyond.times[0]
    joined = BallPath(
        np.concatenate([path.times[before], beyond.times]),
        np.concatenate([path.positions[before], beyond.positions]),
        np.concatenate([path.velocities[before], beyond.velocities]),
        np.concatenate([path.spins[before], beyond.spins]),
        (*path.bounces, *beyond.bounces),
        beyond.ended,
    )
    return NetPath(joined, touch)


def _is_near(path: BallPath) -> bool:
    """Return whether a path meets the net, or passes close above it."""
    if path.ended is PathEnd.NET:
        return True
    at = int(np.argmax(path.positions[:, 0] <= NET_X))
    return path.positions[0, 0] > NET_X >= path.positions[at, 0] and float(path.positions[at, 2]) < NET_HEIGHT + BALL_RADIUS + TOUCH_HEIGHT
