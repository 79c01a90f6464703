"""How far a returned ball lands from the goal when racket and ball are not quite what the stroke was solved for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from tt_core.bounce import rebound_racket
from tt_core.flight import fly_into
from tt_core.params import check, param
from tt_core.physics import Physics
from tt_core.states import Array, BallState

from .stroke import COARSE_STEP, Stroke


@dataclass(frozen=True)
class StrikeErrorParams:
    """Standard deviations at the strike, each axis alike; assumptions of the order that measurement and arm reach."""

    racket_velocity: float = param(0.03, "m/s", "", low=0.0, high=1.0)
    racket_angle: float = param(0.01, "rad", "about each of the two axes of the face", low=0.0, high=0.5)
    ball_velocity: float = param(0.05, "m/s", "", low=0.0, high=2.0)
    ball_spin: float = param(15.0, "rad/s", "", low=0.0, high=500.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)

    @cached_property
    def sigmas(self) -> Array:
        """(11,) of racket velocity, two angles, ball velocity, ball spin."""
        return np.repeat([self.racket_velocity, self.racket_angle, self.ball_velocity, self.ball_spin], [3, 2, 3, 3])


@njit(cache=True)
def landing_covariance(
    ball: Array, velocity: Array, alpha: float, beta: float, flight_time: float, sigmas: Array, air: Array, rubber: Array
) -> Array:
    """(2, 2) m^2 of the place where the ball comes down to the height of the goal: linear, by differences of one sigma.

    ball (9,) at the hit; racket by velocity and angles; sigmas (11,) as of StrikeErrorParams.
    """
    out, work, aim = np.zeros((2, 2)), np.empty((8, 3)), np.zeros(2)
    state, end, racket, normal = np.empty(9), np.empty(9), np.empty(3), np.empty(3)
    for i in range(-1, 11):  # -1: none
        state[:], racket[:], a, b = ball, velocity, alpha, beta
        if i >= 5:
            state[i - 2] += sigmas[i]
        elif i == 4:
            b += sigmas[i] / math.cos(alpha)
        elif i == 3:
            a += sigmas[i]
        elif i >= 0:
            racket[i] += sigmas[i]
        normal[0], normal[1], normal[2] = math.sin(b) * math.cos(a), -math.sin(a), math.cos(b) * math.cos(a)
        rebound_racket(state[3:6], state[6:9], racket, normal, rubber)
        fly_into(state, flight_time, air, COARSE_STEP, end, work)
        x, y = end[0] - end[2] * end[3] / end[5], end[1] - end[2] * end[4] / end[5]  # on along its velocity to the height of the goal
        if i < 0:
            aim[0], aim[1] = x, y
        dx, dy = x - aim[0], y - aim[1]
        out[0, 0] += dx * dx
        out[0, 1] += dx * dy
        out[1, 1] += dy * dy
    out[1, 0] = out[0, 1]
    return out


def landing_rms(ball: BallState, stroke: Stroke, flight_time: float, physics: Physics, errors: StrikeErrorParams) -> float:
    """m, root mean square distance of landings from the goal under `errors`; inf for a stroke without a racket."""
    if stroke.racket is None:
        return math.inf
    racket = stroke.racket
    covariance = landing_covariance(
        ball.vector,
        racket.velocity,
        racket.alpha,
        racket.beta,
        flight_time,
        errors.sigmas,
        physics.air.coefficients,
        physics.racket.coefficients,
    )
    return math.sqrt(covariance[0, 0] + covariance[1, 1])
