"""Solve the exact stroke by the shooting method: a two-point boundary value problem, coupled with the racket (dissertation 4.2, 4.3).

The unknown is the velocity after the hit. The spin about x follows from it by (4.16), and the racket state from velocity and spin.
Broyden's method corrects the velocity with flights that are integrated in long steps. Near the solution the difference between such a
coarse flight and the exact flight is computed, and the point aimed at is moved by this difference. Kernels do not validate their arguments.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.arrays import POSITION, SPIN, VELOCITY, Array
from tt_core.flight import fly_into
from tt_core.physics import PhysicsCoefficients, physics_coefficients

from .dissertation import sam_velocity
from .impact import spin_after
from .return_flight import fine_step, fly_return
from .solution import (
    BALL_AFTER,
    CLEAR,
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

LANDING_TOLERANCE = 3e-8  # m, largest landing error of a solution
COARSE_FLIGHT_STEP = 0.3  # s, longest integration step of the coarse flights, which are 1e-5 m inexact
COARSE_TOLERANCE = 1e-3  # m, landing error of the coarse flight below which its difference from the exact flight is computed
FINE_TOLERANCE = 2e-8  # m, distance between coarse flight and moved aim below which an exact flight is tried
MOST_CORRECTIONS = 40


@njit(cache=True, error_model="numpy")
def _first_inverse(v: Array, goal: Goal, drag: float, lift: float) -> Array:
    """Return (3, 3) d velocity / d landing to first order in drag and Magnus force: (1 - T/2 da/dv)^-1 / T is (1 + T/2 da/dv) / T."""
    half = 0.5 * goal.flight_time
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    out = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = half * drag * v[i] * v[j] / speed
        out[i, i] += 1.0 + half * drag * speed
    out[0, 2] -= half * lift * goal.spin_y
    out[2, 0] += half * lift * goal.spin_y
    out[0, 1] += half * lift * goal.spin_z
    out[1, 0] -= half * lift * goal.spin_z
    return out / goal.flight_time


@njit(cache=True, error_model="numpy")
def _update_inverse(inverse: Array, moved: Array, end: Array, last: Array, step: Array, row: Array) -> None:
    """Update the inverse Jacobian (3, 3) in place (Broyden 1965).

    Args:
        inverse: d velocity / d landing.
        moved: (3,) m/s, last correction of the velocity.
        end: (9,) the ball at the flight time now.
        last: (9,) the ball at the flight time before the correction.
        step: (3,) scratch.
        row: (3,) scratch.
    """
    scale = 0.0
    for i in range(3):
        step[i], row[i] = 0.0, 0.0
        for j in range(3):
            step[i] += inverse[i, j] * (end[j] - last[j])
            row[i] += moved[j] * inverse[j, i]
        scale += moved[i] * step[i]
    if abs(scale) > 1e-300:
        for i in range(3):
            for j in range(3):
                inverse[i, j] += (moved[i] - step[i]) * row[j] / scale


@njit(cache=True, error_model="numpy")
def _distance(a: Array, b: Array) -> float:
    """Return the distance between two points, the first three elements of `a` and `b`."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@njit(cache=True, error_model="numpy")
def shoot(ball: Ball, goal: Goal, physics: PhysicsCoefficients, most: int, out: Array) -> Solution:
    """Solve the stroke (racket state that sends the ball to the goal) with the full flight model.

    Args:
        ball: Ball just before the hit.
        goal: Asked landing place, flight time and spin of the return.
        physics: Models of air, table and racket.
        most: Largest number of corrections of the velocity. With fewer than MOST_CORRECTIONS a residual over LANDING_TOLERANCE is no
            failure.
        out: (18,) output: filled with the ball after the hit and the racket, in the order of `solution`.

    Returns:
        How the search ended. If its obstacle is not CLEAR, `out` must not be used.
    """
    obstacle, missing = check_question(ball, goal)
    if obstacle != CLEAR:
        return failed(obstacle, missing, np.inf, 0)
    air, contact, flight_time = physics.air, physics.contact_height, goal.flight_time
    target, aim, moved, step, row = np.empty((5, 3))
    coarse, last, fine = np.empty((3, 9))  # the ball at the flight time: now, one correction ago, and by an exact flight
    after, work = out[BALL_AFTER], np.empty((8, 3))
    position, velocity, spin = after[POSITION], after[VELOCITY], after[SPIN]
    target[0], target[1], target[2] = goal.landing_x, goal.landing_y, contact
    for k in range(3):
        position[k], aim[k] = ball.position[k], target[k]
    drag = sam_velocity(ball.position, target, goal, air, velocity)
    inverse = _first_inverse(velocity, goal, drag, air.lift)
    tolerance, n = COARSE_TOLERANCE, 0
    while True:
        if not is_usable_velocity(ball, velocity):
            return failed(NO_SOLUTION, np.inf, np.inf, n)
        spin_after(ball.velocity, ball.spin, velocity, goal.spin_y, goal.spin_z, spin)
        last[:] = coarse
        fly_into(after, flight_time, air, COARSE_FLIGHT_STEP, coarse, work)
        if n > 0:
            _update_inverse(inverse, moved, coarse, last, step, row)
        if _distance(coarse, aim) < tolerance or n >= most:
            if tolerance == COARSE_TOLERANCE and n < most:
                fly_into(after, flight_time, air, fine_step(velocity), fine, work)
                tolerance = FINE_TOLERANCE
            else:
                obstacle, missing = fly_return(after, flight_time, air, contact, fine, work)
                residual = _distance(fine, target)
                if residual < LANDING_TOLERANCE or n >= most:
                    break
            for k in range(3):
                aim[k] = target[k] - (fine[k] - coarse[k])
        for i in range(3):
            moved[i] = -(inverse[i, 0] * (coarse[0] - aim[0]) + inverse[i, 1] * (coarse[1] - aim[1]) + inverse[i, 2] * (coarse[2] - aim[2]))
        for i in range(3):
            velocity[i] += moved[i]
        n += 1
    if residual >= LANDING_TOLERANCE and most == MOST_CORRECTIONS:
        return failed(NO_SOLUTION, residual, residual, n)
    flown = Solution(obstacle, missing, residual, n, np.inf, 0.0, 0.0)
    return with_racket(ball, physics.racket, contact, flown, out)


@njit(cache=True, error_model="numpy")
def shoot_entry(
    position: Array, velocity: Array, spin: Array, goal: Array, physics: Array, most: int, out: Array
) -> tuple[tuple[int, float, float], tuple[float, int], tuple[float, float]]:
    """Call `shoot` from Python with plain arrays.

    The result is plain tuples, because they are returned faster than a NamedTuple: in 0.2 us instead of 0.7 us.

    Args:
        position: (3,) m in `table`, of the ball just before the hit.
        velocity: (3,) m/s in `table`, of the ball just before the hit.
        spin: (3,) rad/s in `table`, of the ball just before the hit.
        goal: (5,) `ReturnGoal.vector`: landing x and y m, flight time s, spin y and z rad/s.
        physics: (19,) `Physics.coefficients`.
        most: Largest number of corrections of the velocity.
        out: (18,) output: filled with the ball after the hit and the racket, in the order of `solution`.

    Returns:
        (obstacle, missing, share), (residual, corrections), (alpha, beta), the fields of `solution.Solution`.
    """
    s = shoot(Ball(position, velocity, spin), goal_numbers(goal), physics_coefficients(physics), most, out)
    return (s.obstacle, s.missing, s.share), (s.residual, s.corrections), (s.alpha, s.beta)
