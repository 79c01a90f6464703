"""What the kernels that solve a stroke take and give: ball, goal, solution; and the checks that they share.

Kernels do not validate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.arrays import SPIN, VELOCITY, Array, X
from tt_core.bounce import RacketCoefficients
from tt_core.constants import NET_X, TABLE_LENGTH, TABLE_WIDTH

from .impact import racket_for

# what stands against a stroke, as kernels tell it; `stroke` makes failures of them
(CLEAR, LANDING_ASIDE, BALL_LEAVES, BALL_BEYOND_NET, NO_SOLUTION, TOO_MUCH_SPIN, NET, OWN_HALF, SIDEWAYS, EARLY) = range(10)

# parts of the array (18,) that a kernel fills with a stroke
BALL_AFTER, RACKET_VELOCITY, NORMAL, RACKET_POSITION = slice(0, 9), slice(9, 12), slice(12, 15), slice(15, 18)
STROKE_SIZE = 18
FASTEST = 60.0  # m/s, sum over the axes after the hit; past it a search has left the field


class Ball(NamedTuple):
    """The ball just before the hit: position in m, velocity in m/s, spin in rad/s, (3,) each."""

    position: Array
    velocity: Array
    spin: Array


class Goal(NamedTuple):
    """A ReturnGoal for the kernels, in m, s and rad/s."""

    landing_x: float
    landing_y: float
    flight_time: float
    spin_y: float
    spin_z: float


class Solution(NamedTuple):
    """How a search for a stroke ended.

    Attributes:
        obstacle: CLEAR, or what stands against the stroke.
        missing: By how much, in m, s, m/s or as a share, as the obstacle has it.
        residual: m, from the goal to the landing at the asked time.
        corrections: How often the velocity after the hit was corrected.
        share: The asked change of spin over the largest that the rubber gives; inf if the search did not come so far.
        alpha: rad, of the racket.
        beta: rad, of the racket.
    """

    obstacle: int
    missing: float
    residual: float
    corrections: int
    share: float
    alpha: float
    beta: float


@njit(cache=True)
def goal_numbers(row: Array) -> Goal:
    """Name the numbers of `ReturnGoal.vector` (5,)."""
    return Goal(row[0], row[1], row[2], row[3], row[4])


@njit(cache=True)
def failed(obstacle: int, missing: float, residual: float, corrections: int) -> Solution:
    """Return a solution without a racket."""
    return Solution(obstacle, missing, residual, corrections, np.inf, 0.0, 0.0)


@njit(cache=True)
def check_question(ball: Ball, goal: Goal) -> tuple[int, float]:
    """Return what makes the question pointless, whatever the racket does, and by how much; or CLEAR and 0."""
    beside = max(NET_X - goal.landing_x, goal.landing_x - TABLE_LENGTH, -goal.landing_y, goal.landing_y - TABLE_WIDTH)
    if beside >= 0.0:
        return LANDING_ASIDE, beside
    if ball.velocity[X] >= 0.0:
        return BALL_LEAVES, ball.velocity[X]
    if ball.position[X] >= NET_X:
        return BALL_BEYOND_NET, ball.position[X] - NET_X
    return CLEAR, 0.0


@njit(cache=True, error_model="numpy")
def with_racket(ball: Ball, rubber: RacketCoefficients, contact: float, flown: Solution, out: Array) -> Solution:
    """Find the racket for a ball after the hit.

    Args:
        ball: Before the hit.
        rubber: Coefficients.
        contact: m, from the face of the racket to the centre of the ball.
        flown: What the flight after the hit came to.
        out: (18,) with BALL_AFTER given; the rest is filled.

    Returns:
        `flown` with share and angles of the racket, or TOO_MUCH_SPIN.
    """
    after, normal, position = out[BALL_AFTER], out[NORMAL], out[RACKET_POSITION]
    share = racket_for(ball.velocity, ball.spin, after[VELOCITY], after[SPIN], rubber, out[RACKET_VELOCITY], normal)
    if share > 1.0:
        return Solution(TOO_MUCH_SPIN, share - 1.0, flown.residual, flown.corrections, share, 0.0, 0.0)
    for k in range(3):
        position[k] = ball.position[k] - contact * normal[k]
    alpha, beta = -math.asin(min(1.0, max(-1.0, normal[1]))), math.atan2(normal[0], normal[2])
    return Solution(flown.obstacle, flown.missing, flown.residual, flown.corrections, share, alpha, beta)


@njit(cache=True)
def is_possible(ball: Ball, velocity: Array) -> bool:
    """Tell whether a velocity (3,) m/s after the hit is one: (4.16) has a solution, and the search has not left the field."""
    differs = not abs(velocity[0] - ball.velocity[0]) < 1e-6
    return differs and abs(velocity[0]) + abs(velocity[1]) + abs(velocity[2]) < FASTEST
