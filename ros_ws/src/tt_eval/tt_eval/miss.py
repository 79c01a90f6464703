"""Kinds of failure to return a ball, in the order of the stages."""

from __future__ import annotations

from tt_core.text_enum import TextEnum
from tt_sim.world.outcome import Result


class Miss(TextEnum):
    """Kinds of failure to return a ball. The values are the words in sweeps and tables."""

    NOT_SEEN = "not seen"  # no burst of images, or a measurement without spin
    REFUSED_SPIN = "refused spin"  # a spin was measured and refused
    OUT_OF_REACH = "out of reach"  # no stroke, or no posture of the arm
    TOO_LATE = "too late"  # the arm cannot be there in time
    RACKET_TOO_SLOW = "racket too slow"  # the stroke asks for more speed or torque than there is
    MISSED = "missed"  # the arm swung, the racket did not touch the ball
    NET = "net"  # the return touched the net and did not land on the opponent's half
    LONG = "long"  # the return flew over the end of the table
    WIDE = "wide"  # the return passed the side of the table
    SHORT = "short"  # the return landed on the robot's half
    DOUBLE_BOUNCE = "double bounce"  # the ball bounced twice on the robot's half before the racket
    SECOND_HIT = "second hit"  # the racket touched the ball twice
    FLYING = "flying"  # the return has not landed until the end of the simulation


OF_RESULT = {  # without OFF_TABLE, which is LONG or WIDE, depending on the place
    Result.MISSED: Miss.MISSED,
    Result.DOUBLE_BOUNCE: Miss.DOUBLE_BOUNCE,
    Result.FLYING: Miss.FLYING,
    Result.NET: Miss.NET,
    Result.OWN_HALF: Miss.SHORT,
    Result.SECOND_HIT: Miss.SECOND_HIT,
}
