"""Why a ball did not come back, in the order of the stages."""

from __future__ import annotations

from tt_core.text_enum import TextEnum
from tt_sim.world.outcome import Result


class Miss(TextEnum):
    """Kinds of failure; the values are the words of sweeps and tables."""

    NOT_SEEN = "not seen"  # no burst of images, or a measurement without spin
    REFUSED_SPIN = "refused spin"  # a spin was measured and refused
    OUT_OF_REACH = "out of reach"  # no stroke, or no posture of the arm
    TOO_LATE = "too late"  # the arm cannot be there in time
    RACKET_TOO_SLOW = "racket too slow"  # the stroke asks for more speed or torque than there is
    MISSED = "missed"  # the arm swung, the racket did not touch the ball
    NET = "net"
    LONG = "long"
    WIDE = "wide"
    SHORT = "short"
    DOUBLE_BOUNCE = "double bounce"
    SECOND_HIT = "second hit"
    FLYING = "flying"


OF_RESULT = {  # OFF_TABLE is LONG or WIDE, by the place
    Result.MISSED: Miss.MISSED,
    Result.DOUBLE_BOUNCE: Miss.DOUBLE_BOUNCE,
    Result.FLYING: Miss.FLYING,
    Result.NET: Miss.NET,
    Result.OWN_HALF: Miss.SHORT,
    Result.SECOND_HIT: Miss.SECOND_HIT,
}
