"""When the racket meets the ball, from joint states and the followed ball, for those whom nobody tells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from tt_arm.joints import Joints
from tt_arm.kinematics import forward
from tt_arm.model import ArmModel
from tt_core.constants import BALL_RADIUS, RACKET_RADIUS
from tt_core.states import Array, BallState, RacketState

NEAR = 0.3  # m, between ball and racket, from where on the ball is looked at closely
CLOSING = 0.5  # m/s, of ball and racket towards each other, below which there is no stroke
SPARE = 0.01  # m, by which the ball may meet the racket outside its rim, because neither is known exactly


class Met(NamedTuple):
    """The racket as it meets the ball."""

    racket: RacketState
    turning: Array  # (3,) rad/s, angular velocity


def racket_of(model: ArmModel, joints: Joints) -> Met:
    """Return the racket at a joint state."""
    position, rotation, jacobian = forward(joints.q.copy(), model.chain)
    velocity, turning = np.split(jacobian @ joints.qdot, 2)
    return Met(RacketState.facing(joints.time, position, velocity, rotation[:, 2]), turning)


def is_near(racket: RacketState, ball: BallState) -> bool:
    """Return whether a ball, carried straight on to the time of the racket, is so near that it should be looked at closely."""
    place = ball.position + (racket.time - ball.time) * ball.velocity
    return bool(np.linalg.norm(place - racket.position) < NEAR)


def time_to_contact(racket: RacketState, ball: BallState) -> float:
    """Return the time (s) until the ball meets the face, negative after it; inf if it passes beside or does not come closer.

    Args:
        racket: The racket.
        ball: At the same time.
    """
    offset, towards, normal = ball.position - racket.position, ball.velocity - racket.velocity, racket.normal
    if towards @ normal > 0.0:
        normal = -normal
    closing = -float(towards @ normal)
    if closing < CLOSING:
        return np.inf
    time = (float(offset @ normal) - BALL_RADIUS) / closing
    beside = offset + time * towards
    beside -= (beside @ normal) * normal
    return time if float(np.linalg.norm(beside)) < RACKET_RADIUS + SPARE else np.inf
