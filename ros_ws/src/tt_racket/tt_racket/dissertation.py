"""The dissertation's own stroke by its simple aerodynamic model, SAM (4.48)-(4.58): for comparison, and as the start of the exact stroke.

In this model drag acts on each axis separately, and there is no Magnus force, so there is a closed formula for the velocity after the hit.
Kernels do not validate their arguments.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.arrays import POSITION, SPIN, VELOCITY, Array
from tt_core.flight import AirCoefficients
from tt_core.physics import PhysicsCoefficients, physics_coefficients

from .impact import spin_after
from .return_flight import fly_return
from .solution import (
    BALL_AFTER,
    CLEAR,
    EARLY,
    NO_SOLUTION,
    Ball,
    Goal,
    Solution,
    check_question,
    failed,
    goal_numbers,
    is_usable_velocity,
    with_racket,
)


@njit(cache=True, error_model="numpy")
def sam_velocity(position: Array, target: Array, goal: Goal, air: AirCoefficients, velocity: Array) -> float:
    """Compute the velocity after the hit by the dissertation's simple aerodynamic model (4.58).

    Args:
        position: (3,) m in `table`, of the ball at the hit.
        target: (3,) m in `table`, of the ball at the landing.
        goal: Flight time, and spin after the hit.
        air: Coefficients of the flight model.
        velocity: (3,) m/s in `table`, output: filled with the velocity after the hit.

    Returns:
        The drag factor D in 1/m, the deceleration divided by the square of the speed. It holds for the spin direction h of (3.3) on the
        straight line to the target.
    """
    dx, dy = target[0] - position[0], target[1] - position[1]
    across = dx * goal.spin_y
    norm = math.sqrt(across * across + (dx * dx + dy * dy) * goal.spin_z * goal.spin_z)
    d = air.drag + (air.drag_h * across / norm if norm > 0.0 else 0.0)
    for k in range(2):
        way = target[k] - position[k]
        velocity[k] = math.copysign((math.exp(d * abs(way)) - 1.0) / (d * goal.flight_time), way) if d > 0.0 else way / goal.flight_time
    velocity[2] = 0.5 * air.gravity * goal.flight_time + (target[2] - position[2]) / goal.flight_time
    return d


@njit(cache=True, error_model="numpy")
def sam_stroke(ball: Ball, goal: Goal, physics: PhysicsCoefficients, out: Array) -> Solution:
    """Solve the stroke by the simple aerodynamic model (SAM), and compute its residual by a flight with the full model.

    A return that lands too early is no obstacle here, because a return by this model misses the goal in any case.

    Args:
        ball: Ball just before the hit.
        goal: Asked landing place, flight time and spin of the return.
        physics: Models of air, table and racket.
        out: (18,) output: filled with the ball after the hit and the racket, in the order of `solution`.

    Returns:
        How the search ended. If its obstacle is not CLEAR, `out` must not be used.
    """
    obstacle, missing = check_question(ball, goal)
    if obstacle != CLEAR:
        return failed(obstacle, missing, np.inf, 0)
    after, contact = out[BALL_AFTER], physics.contact_height
    velocity, target = after[VELOCITY], np.array([goal.landing_x, goal.landing_y, contact])
    after[POSITION] = ball.position
    sam_velocity(ball.position, target, goal, physics.air, velocity)
    if not is_usable_velocity(ball, velocity):
        return failed(NO_SOLUTION, np.inf, np.inf, 0)
    spin_after(ball.velocity, ball.spin, velocity, goal.spin_y, goal.spin_z, after[SPIN])
    end = np.empty(9)
    obstacle, missing = fly_return(after, goal.flight_time, physics.air, contact, end, np.empty((8, 3)))
    if obstacle == EARLY:
        obstacle, missing = CLEAR, 0.0
    residual = math.sqrt((end[0] - target[0]) ** 2 + (end[1] - target[1]) ** 2 + (end[2] - target[2]) ** 2)
    flown = Solution(obstacle, missing, residual, 0, np.inf, 0.0, 0.0)
    return with_racket(ball, physics.racket, contact, flown, out)


@njit(cache=True, error_model="numpy")
def sam_stroke_entry(
    position: Array, velocity: Array, spin: Array, goal: Array, physics: Array, out: Array
) -> tuple[tuple[int, float, float], tuple[float, int], tuple[float, float]]:
    """Call `sam_stroke` from Python with plain arrays.

    Args:
        position: (3,) m in `table`, of the ball just before the hit.
        velocity: (3,) m/s in `table`, of the ball just before the hit.
        spin: (3,) rad/s in `table`, of the ball just before the hit.
        goal: (5,) `ReturnGoal.vector`: landing x and y m, flight time s, spin y and z rad/s.
        physics: (19,) `Physics.coefficients`.
        out: (18,) output: filled with the ball after the hit and the racket, in the order of `solution`.

    Returns:
        (obstacle, missing, share), (residual, corrections), (alpha, beta), the fields of `solution.Solution`.
    """
    s = sam_stroke(Ball(position, velocity, spin), goal_numbers(goal), physics_coefficients(physics), out)
    return (s.obstacle, s.missing, s.share), (s.residual, s.corrections), (s.alpha, s.beta)
