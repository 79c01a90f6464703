"""The net as a probability: a path that meets the tape goes on while it is not certain that the ball does."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from tt_core.constants import BALL_RADIUS, NET_HEIGHT, NET_X
from tt_core.path_end import PathEnd
from tt_core.physics import Physics
from tt_core.states import BallPath, BallState

from .rollout import StopRule, rollout
from .uncertainty import uncertainty

PAST = NET_X - 2.0 * BALL_RADIUS  # m, x where a ball has passed the net
NEAR = 0.08  # m above the tape, from where on a touch is too improbable to be looked at
CERTAIN = 0.99  # probability of a touch, above which a path ends at the net


class NetPath(NamedTuple):
    """A path and what the net may do to it."""

    path: BallPath
    touch: float  # probability that the ball touches the net; the path is that of a ball that does not


def rollout_past_net(ball: BallState, physics: Physics, stop: StopRule) -> NetPath:
    """Predict the path of a ball that may or may not touch the net.

    Behind the net it is the mean path of those balls of the covariance that pass.

    Args:
        ball: Where the path starts; without a covariance it is certain.
        physics: Models of air and table.
        stop: Where the path ends if nothing else ends it.
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
    return path.positions[0, 0] > NET_X >= path.positions[at, 0] and float(path.positions[at, 2]) < NET_HEIGHT + BALL_RADIUS + NEAR
