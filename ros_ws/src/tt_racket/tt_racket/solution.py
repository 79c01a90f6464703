"""Inputs and results of the kernels that solve a stroke (ball, goal, solution), and the checks that these kernels share.

A stroke is the racket's position, orientation and velocity at one time that returns the ball. Kernels do not validate their arguments.
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

# obstacles: why kernels find no stroke, or CLEAR; `stroke` turns them into members of StrokeFailure
(CLEAR, LANDING_ASIDE, BALL_LEAVES, BALL_BEYOND_NET, NO_SOLUTION, TOO_MUCH_SPIN, NET_HIT, OWN_HALF, SIDEWAYS, EARLY) = range(10)

# parts of the array (18,) that a kernel fills with a stroke: ball just after the hit (position m, velocity m/s, spin rad/s), then the
# racket's velocity m/s, unit face normal and position m, all in `table`
BALL_AFTER, RACKET_VELOCITY, RACKET_NORMAL, RACKET_POSITION = slice(0, 9), slice(9, 12), slice(12, 15), slice(15, 18)
STROKE_SIZE = 18
DIVERGED_SPEED = 60.0  # m/s, largest sum of the absolute velocities on the axes after the hit; a search that exceeds it diverges


class Ball(NamedTuple):
    """Ball just before the hit: position in m, velocity in m/s, spin in rad/s, each (3,) in `table`."""

    position: Array
    velocity: Array
    spin: Array


class Goal(NamedTuple):
    """Goal of the return as kernels take it: the fields of ReturnGoal, in m, s and rad/s."""

    landing_x: float
    landing_y: float
    flight_time: float
    spin_y: float
    spin_z: float


class Solution(NamedTuple):
    """Result of a kernel that solves a stroke.

    Attributes:
        obstacle: CLEAR, or the constant of this module that tells why there is no stroke.
        missing: Amount by which the goal is out of reach, in m, s, m/s or as a share, according to the obstacle; 0 for CLEAR.
        residual: m, distance between the goal and the ball's position after the asked flight time; inf if no flight was computed.
        corrections: Number of corrections of the velocity after the hit.
        share: The asked change of spin divided by the largest change that the rubber can give; inf if it was not computed.
        alpha: rad, angle of the racket as in RacketState.
        beta: rad, angle of the racket as in RacketState.
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
    """Return the numbers of `ReturnGoal.vector` (5,) as a NamedTuple."""
    return Goal(row[0], row[1], row[2], row[3], row[4])


@njit(cache=True)
def failed(obstacle: int, missing: float, residual: float, corrections: int) -> Solution:
    """Return the result of a search without success.

    Args:
        obstacle: Constant of this module that tells why there is no stroke.
        missing: Amount by which the goal is out of reach, in the unit that the obstacle has.
        residual: m, distance between the goal and the ball after the flight; inf if no flight was computed.
        corrections: Number of corrections made.
    """
    return Solution(obstacle, missing, residual, corrections, np.inf, 0.0, 0.0)


@njit(cache=True)
def check_question(ball: Ball, goal: Goal) -> tuple[int, float]:
    """Check whether ball and goal permit a stroke at all.

    Returns:
        CLEAR and 0 if they do. Else LANDING_ASIDE and the m by which the landing is outside the opponent's half, BALL_LEAVES and the ball's
        velocity in x in m/s, or BALL_BEYOND_NET and the m by which the ball is beyond the net.
    """
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
    """Complete a stroke by the racket state that gives the ball its state after the hit.

    Args:
        ball: Ball just before the hit.
        rubber: Coefficients of the racket's rebound model.
        contact: m, distance between the racket's face and the ball's centre at the hit.
        flown: Result of the flight after the hit, still without share and angles.
        out: (18,) the stroke. Its part BALL_AFTER is given; its other parts are filled.

    Returns:
        `flown` with share and angles of the racket; or a solution with TOO_MUCH_SPIN if the rubber cannot give the asked spin.
    """
    after, normal, position = out[BALL_AFTER], out[RACKET_NORMAL], out[RACKET_POSITION]
    share = racket_for(ball.velocity, ball.spin, after[VELOCITY], after[SPIN], rubber, out[RACKET_VELOCITY], normal)
    if share > 1.0:
        return Solution(TOO_MUCH_SPIN, share - 1.0, flown.residual, flown.corrections, share, 0.0, 0.0)
    for k in range(3):
        position[k] = ball.position[k] - contact * normal[k]
    alpha, beta = -math.asin(min(1.0, max(-1.0, normal[1]))), math.atan2(normal[0], normal[2])
    return Solution(flown.obstacle, flown.missing, flown.residual, flown.corrections, share, alpha, beta)


@njit(cache=True)
def is_usable_velocity(ball: Ball, velocity: Array) -> bool:
    """Tell whether a velocity (3,) m/s after the hit is usable in a search.

    It must differ in x from the ball's velocity before the hit, because otherwise (4.16) of the dissertation gives no spin, and the sum of
    its absolute components must be less than DIVERGED_SPEED.
    """
    differs = not abs(velocity[0] - ball.velocity[0]) < 1e-6
    return differs and abs(velocity[0]) + abs(velocity[1]) + abs(velocity[2]) < DIVERGED_SPEED
