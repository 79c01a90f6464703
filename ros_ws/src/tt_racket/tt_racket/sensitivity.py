"""Landing error of a returned ball if racket and ball at the hit differ by random errors from those for which the stroke was solved."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from tt_core.arrays import POSITION, SPIN, VELOCITY, VX, VY, VZ, Array, X, Y, Z
from tt_core.bounce import rebound_racket
from tt_core.flight import fly_into
from tt_core.params import check, param
from tt_core.physics import Physics, PhysicsCoefficients, physics_coefficients
from tt_core.states import BallState

from .shooting import COARSE_FLIGHT_STEP
from .stroke import Stroke

# elements of a strike (11,), the quantities at the hit that have errors: racket velocity m/s, alpha and beta rad, ball velocity m/s and
# spin rad/s
STRIKE_VELOCITY, ALPHA, BETA, BALL_VELOCITY, BALL_SPIN = slice(0, 3), 3, 4, slice(5, 8), slice(8, 11)
STRIKE_SIZE = 11


@dataclass(frozen=True)
class StrikeErrorParams:
    """Standard deviations of racket and ball at the hit, equal for all axes.

    The default values are assumptions of the size of the errors of measurement and arm.
    """

    racket_velocity: float = param(
        0.03, "m/s", "standard deviation of the racket's velocity at the strike, on each axis; an assumption", low=0.0, high=1.0
    )
    racket_angle: float = param(
        0.01, "rad", "standard deviation of the face's angle at the strike, about each of its two axes; an assumption", low=0.0, high=0.5
    )
    ball_velocity: float = param(
        0.05, "m/s", "standard deviation of the ball's velocity at the strike, on each axis; an assumption", low=0.0, high=2.0
    )
    ball_spin: float = param(
        15.0, "rad/s", "standard deviation of the ball's spin at the strike, about each axis; an assumption", low=0.0, high=500.0
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)

    @cached_property
    def sigmas(self) -> Array:
        """Standard deviations (11,): racket velocity (3) m/s, two angles of the face rad, ball velocity (3) m/s, ball spin (3) rad/s."""
        return np.repeat([self.racket_velocity, self.racket_angle, self.ball_velocity, self.ball_spin], [3, 2, 3, 3])


@njit(cache=True)
def _land(
    position: Array, strike: Array, flight_time: float, physics: PhysicsCoefficients, ball: Array, normal: Array, work: Array
) -> tuple[float, float]:
    """Return x and y (m) where the hit ball comes down to z = 0 in `table`.

    Args:
        position: (3,) m, of the ball at the hit.
        strike: (11,) racket velocity, alpha, beta, ball velocity, ball spin.
        flight_time: s, from the hit to the goal. After it the ball is assumed to move straight along its velocity.
        physics: Models of air and racket.
        ball: (9,) scratch memory.
        normal: (3,) scratch memory.
        work: (8, 3) scratch memory.
    """
    alpha, beta = strike[ALPHA], strike[BETA]
    ball[POSITION], ball[VELOCITY], ball[SPIN] = position, strike[BALL_VELOCITY], strike[BALL_SPIN]
    normal[0], normal[1], normal[2] = math.sin(beta) * math.cos(alpha), -math.sin(alpha), math.cos(beta) * math.cos(alpha)
    rebound_racket(ball[VELOCITY], ball[SPIN], strike[STRIKE_VELOCITY], normal, physics.racket)
    fly_into(ball, flight_time, physics.air, COARSE_FLIGHT_STEP, ball, work)
    return ball[X] - ball[Z] * ball[VX] / ball[VZ], ball[Y] - ball[Z] * ball[VY] / ball[VZ]


@njit(cache=True)
def landing_covariance(position: Array, strike: Array, sigmas: Array, flight_time: float, physics: PhysicsCoefficients) -> Array:
    """Return the covariance of the landing place that follows from errors of racket and ball at the hit.

    The propagation is linear: the landing place is computed once for each quantity changed by its standard deviation.

    Args:
        position: (3,) m in `table`, of the ball at the hit.
        strike: (11,) racket velocity (3) m/s, alpha and beta rad, ball velocity (3) m/s and spin (3) rad/s before the hit, in `table`.
        sigmas: (11,) standard deviations of the elements of `strike`, see `StrikeErrorParams.sigmas`.
        flight_time: s, from the hit to the goal.
        physics: Models of air and racket.

    Returns:
        (2, 2) m^2, covariance of the landing place's x and y.
    """
    out, work, ball, normal, moved = np.zeros((2, 2)), np.empty((8, 3)), np.empty(9), np.empty(3), np.empty(STRIKE_SIZE)
    x, y = _land(position, strike, flight_time, physics, ball, normal, work)
    for i in range(STRIKE_SIZE):
        moved[:] = strike
        moved[i] += sigmas[i] / math.cos(strike[ALPHA]) if i == BETA else sigmas[i]
        moved_x, moved_y = _land(position, moved, flight_time, physics, ball, normal, work)
        dx, dy = moved_x - x, moved_y - y
        out[0, 0] += dx * dx
        out[0, 1] += dx * dy
        out[1, 1] += dy * dy
    out[1, 0] = out[0, 1]
    return out


@njit(cache=True)
def _landing_rms_entry(
    position: Array,
    velocity: Array,
    spin: Array,
    racket_velocity: Array,
    angles: tuple[float, float],
    sigmas: Array,
    flight_time: float,
    physics: Array,
) -> float:
    """Return the root mean square of `landing_covariance` in m, for arguments from Python: the ball, the racket, alpha and beta."""
    strike = np.empty(STRIKE_SIZE)
    strike[STRIKE_VELOCITY], strike[BALL_VELOCITY], strike[BALL_SPIN] = racket_velocity, velocity, spin
    strike[ALPHA], strike[BETA] = angles
    covariance = landing_covariance(position, strike, sigmas, flight_time, physics_coefficients(physics))
    return math.sqrt(covariance[0, 0] + covariance[1, 1])


def landing_rms(ball: BallState, stroke: Stroke, flight_time: float, physics: Physics, errors: StrikeErrorParams) -> float:
    """Return the root mean square landing error of a stroke, caused by errors of racket and ball at the hit.

    Args:
        ball: Ball just before the hit.
        stroke: Stroke that was solved for this ball.
        flight_time: s, from the hit to the goal of the stroke.
        physics: Models of air and racket.
        errors: Standard deviations of racket and ball at the hit.

    Returns:
        Root mean square distance in m of the landing places from the one without errors; inf for a stroke without a racket.
    """
    racket = stroke.racket
    if racket is None:
        return math.inf
    angles = racket.alpha, racket.beta
    rms = _landing_rms_entry(
        ball.position, ball.velocity, ball.spin, racket.velocity, angles, errors.sigmas, flight_time, physics.coefficients
    )
    return float(rms)
