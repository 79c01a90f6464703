"""The stroke that sends the ball to a goal, from a ball and a goal to the racket (dissertation Chapter 4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from tt_core.arrays import POSITION, SPIN, VELOCITY
from tt_core.constants import NET_X
from tt_core.errors import BadChoice
from tt_core.failures import Failure
from tt_core.physics import Physics
from tt_core.states import BallState, RacketState, ReturnGoal

from . import solution
from .dissertation import sam_stroke_entry
from .failures import StrokeFailure
from .shooting import MOST_CORRECTIONS, shoot_entry
from .solution import BALL_AFTER, CLEAR, RACKET_POSITION, RACKET_VELOCITY, STROKE_SIZE

METHODS = ("exact", "sam")


@dataclass(frozen=True, slots=True, eq=False)
class Stroke:
    """A stroke, or why there is none.

    Attributes:
        racket: The racket at the strike, None without a stroke.
        ball_after: The ball just after the hit, None without a stroke.
        residual: m, from the goal to where the full flight model puts the ball at the asked time.
        corrections: How often the velocity after the hit was corrected.
        reason: Why there is no stroke, a code of StrokeFailure; None if there is one.
        missing: By how much the goal is out of reach, in the unit of `reason`; 0 if it is not.
        share: The asked change of spin over the largest that the rubber gives at this change of velocity. Over 1 there is no racket. It is
            inf if the search did not come so far.
    """

    racket: RacketState | None
    ball_after: BallState | None
    residual: float
    corrections: int
    reason: Failure | None = None
    missing: float = 0.0
    share: float = math.inf


def _failure(obstacle: int, missing: float, share: float, ball: BallState, goal: ReturnGoal) -> Failure:
    """Return the failure of a kernel's obstacle."""
    if obstacle == solution.LANDING_ASIDE:
        x, y = goal.landing.tolist()
        return Failure(StrokeFailure.LANDING_ASIDE, x=x, y=y, beside=missing)
    if obstacle == solution.BALL_LEAVES:
        return Failure(StrokeFailure.BALL_LEAVES, v_x=missing)
    if obstacle == solution.BALL_BEYOND_NET:
        return Failure(StrokeFailure.BALL_BEYOND_NET, x=NET_X + missing)
    if obstacle == solution.NO_SOLUTION:
        return Failure(StrokeFailure.NO_SOLUTION, flight_time=goal.flight_time)
    if obstacle == solution.TOO_MUCH_SPIN:
        return Failure(StrokeFailure.TOO_MUCH_SPIN, share=share)
    if obstacle == solution.NET:
        return Failure(StrokeFailure.NET, low=missing)
    if obstacle == solution.SIDEWAYS:
        return Failure(StrokeFailure.SIDEWAYS, beside=missing)
    return Failure(StrokeFailure.EARLY if obstacle == solution.EARLY else StrokeFailure.OWN_HALF, early=missing)


def solve(
    ball: BallState,
    goal: ReturnGoal,
    physics: Physics,
    *,
    method: str = "exact",
    corrections: int = MOST_CORRECTIONS,
    racket_speed: float = math.inf,
) -> Stroke:
    """Find the racket state at the ball's time and place that sends the ball to the goal.

    The face of the racket lies contact_height behind the ball's centre, and its normal points to the ball. The landing is exact to 1e-7 m,
    or to 1e-4 m if spin comes to lie along the flight, because h of (3.3) jumps there.

    Args:
        ball: At the hit, flying to -x.
        goal: What the return is asked to do.
        physics: Models of air, table and racket.
        method: "exact", the full model, or "sam", the dissertation's simple model (4.48)-(4.58), which is also the start of "exact".
        corrections: Most corrections of "exact". Fewer take less time and give a coarser stroke.
        racket_speed: m/s, highest speed of the racket.

    Returns:
        The stroke. A goal that cannot be met gives one without a racket, with the reason.

    Raises:
        BadChoice: `method` is unknown.
    """
    out = np.empty(STROKE_SIZE)
    position, velocity, spin = ball.position, ball.velocity, ball.spin
    if method == "exact":
        verdict, accuracy, angles = shoot_entry(position, velocity, spin, goal.vector, physics.coefficients, corrections, out)
    elif method == "sam":
        verdict, accuracy, angles = sam_stroke_entry(position, velocity, spin, goal.vector, physics.coefficients, out)
    else:
        raise BadChoice("method", method, METHODS)
    (obstacle, missing, share), (residual, made) = verdict, accuracy
    if obstacle != CLEAR:
        return Stroke(None, None, residual, made, _failure(obstacle, missing, share, ball, goal), missing, share)
    out.flags.writeable = False
    racket_velocity = out[RACKET_VELOCITY]
    if racket_speed < math.inf and (speed := math.hypot(*racket_velocity.tolist())) > racket_speed:
        reason = Failure(StrokeFailure.RACKET_TOO_FAST, speed=speed, bound=racket_speed)
        return Stroke(None, None, residual, made, reason, speed - racket_speed, share)
    after = out[BALL_AFTER]
    racket = RacketState.trusted(ball.time, out[RACKET_POSITION], racket_velocity, *angles)
    ball_after = BallState.trusted(ball.time, after[POSITION], after[VELOCITY], after[SPIN])
    return Stroke(racket, ball_after, residual, made, None, 0.0, share)
