"""Solve one stroke: the racket state that sends a given ball to a given goal (dissertation Chapter 4)."""

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

STROKE_METHODS = ("exact", "sam")


@dataclass(frozen=True, slots=True, eq=False)
class Stroke:
    """A stroke (racket state at one time that returns the ball), or the reason why there is none.

    Attributes:
        racket: Racket at the hit; None if there is no stroke.
        ball_after: Ball just after the hit; None if there is no stroke.
        residual: m, distance between the goal and the ball's position after the asked flight time, computed with the full flight model;
            inf if no flight was computed.
        corrections: Number of corrections of the velocity after the hit that the solver made.
        reason: Why there is no stroke; its code is a StrokeFailure. None if there is a stroke.
        missing: Amount by which the goal is out of reach, in m, m/s or s according to `reason`, or `share` - 1 for TOO_MUCH_SPIN; 0 if
            there is a stroke.
        share: The asked change of spin divided by the largest change that the rubber can give with this change of velocity. If it is over
            1, no racket state gives the spin. It is inf if the solver stopped before it computed the share.
    """

    racket: RacketState | None
    ball_after: BallState | None
    residual: float
    corrections: int
    reason: Failure | None = None
    missing: float = 0.0
    share: float = math.inf


def _failure(obstacle: int, missing: float, share: float, ball: BallState, goal: ReturnGoal) -> Failure:
    """Return why there is no stroke, with the numbers that explain it.

    Args:
        obstacle: What a kernel returned, one of the constants of `solution`.
        missing: As in `Stroke`.
        share: As in `Stroke`.
        ball: The ball just before the hit.
        goal: The goal of the return.
    """
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
    if obstacle == solution.NET_HIT:
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
    """Find the racket state that hits the ball at its present time and position and sends it to the goal.

    The racket's face is at the distance physics.contact_height from the ball's centre, and its normal points to the ball. The landing
    place is exact to 1e-7 m. Where the spin axis becomes parallel to the velocity during the flight, the error may be up to 1e-4 m,
    because the direction h of the spin in (3.3) is not continuous there.

    Args:
        ball: State just before the hit; it must fly to -x.
        goal: Asked landing place, flight time and spin of the return.
        physics: Models of air, table and racket.
        method: "exact" uses the full flight model. "sam" uses the dissertation's simple aerodynamic model (4.48)-(4.58), from which
            "exact" starts.
        corrections: Largest number of corrections that "exact" makes. A smaller number takes less time and gives a less exact stroke.
        racket_speed: m/s, highest speed of the racket.

    Returns:
        The stroke. If the goal cannot be met, its `racket` is None and its `reason` is set.

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
        raise BadChoice("method", method, STROKE_METHODS)
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
