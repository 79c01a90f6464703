"""Reasons why there is no stroke (racket state that returns the ball), each with its sentence."""

from enum import Enum

from tt_core.constants import NET_X, TABLE_LENGTH, TABLE_WIDTH


class StrokeFailure(Enum):
    """Reasons why there is no stroke, used as codes of `tt_core.failures.Failure`.

    The value of a member is the sentence for people; its placeholders are filled with the numbers of the Failure, in SI units.
    """

    # ball and goal permit no stroke at all
    LANDING_ASIDE = f"landing ({{x:g}}, {{y:g}}) m is not on the opponent's half, x {NET_X} to {TABLE_LENGTH}, y 0 to {TABLE_WIDTH}"
    BALL_LEAVES = "the ball does not come: v_x = {v_x:g} m/s"
    BALL_BEYOND_NET = "the ball is on the opponent's side: x = {x:g} m"
    NO_HIT_POINT = "the ball does not come within reach"
    # no return has the asked landing, time and spin
    NO_SOLUTION = "no velocity leads to the goal in {flight_time:g} s"
    TOO_MUCH_SPIN = "the asked change of spin is {share:.2f} times what the rubber gives"
    # the return would have them, but it meets an obstacle on its way
    NET = "the return would hit the net, {low:.3f} m too low"
    OWN_HALF = "the return would hit the robot's half of the table, {early:.3f} s before the goal"
    SIDEWAYS = "the return would leave the table sideways, {beside:.3f} m beside it"
    EARLY = "the return would land {early:.3f} s too early"
    # the arm
    RACKET_TOO_FAST = "racket speed {speed:.2f} m/s is over {bound:g} m/s"
