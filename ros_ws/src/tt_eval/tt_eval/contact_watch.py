"""Detection of the contact of racket and ball from joint states and the tracked ball, for nodes that get no other message of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from tt_arm.joints import Joints
from tt_arm.kinematics import forward
from tt_arm.model import ArmModel
from tt_core.constants import BALL_RADIUS, RACKET_RADIUS
from tt_core.states import Array, BallState, RacketState

CONTACT_DISTANCE = 0.3  # m between ball and racket, below which a contact is searched for
CLOSING = 0.5  # m/s, approach speed of ball and racket below which there is no contact
SPARE = 0.01  # m outside the rim of the racket within which a contact is assumed, because neither ball nor racket is known exactly


class Met(NamedTuple):
    """State of the racket when it meets the ball."""

    racket: RacketState  # time, position, velocity and orientation in `table`
    turning: Array  # (3,) rad/s, angular velocity in `table`


def racket_of(model: ArmModel, joints: Joints) -> Met:
    """Return the state of the racket for a state of the joints."""
    position, rotation, jacobian = forward(joints.q.copy(), model.chain)
    velocity, turning = np.split(jacobian @ joints.qdot, 2)
    return Met(RacketState.facing(joints.time, position, velocity, rotation[:, 2]), turning)


def is_near(racket: RacketState, ball: BallState) -> bool:
    """Tell whether the ball is nearer than CONTACT_DISTANCE to the racket at the time of the racket, if it flies straight on until then."""
    place = ball.position + (racket.time - ball.time) * ball.velocity
    return bool(np.linalg.norm(place - racket.position) < CONTACT_DISTANCE)


def time_to_contact(racket: RacketState, ball: BallState) -> float:
    """Return the time (s) until the ball meets the racket's face, if both move straight on.

    Args:
        racket: The racket.
        ball: The ball at the same time.

    Returns:
        The time; negative if the contact was before; inf if the ball passes beside the racket or does not approach it.
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
