"""The flight of the returned ball to its goal, and what it meets before. Kernels do not validate."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.arrays import VELOCITY, VZ, Array, X, Y, Z
from tt_core.constants import BALL_RADIUS, NET_HEIGHT, NET_X, TABLE_WIDTH
from tt_core.flight import AirCoefficients, ease, step
from tt_core.table_contacts import meets_net, meets_surface

from .solution import CLEAR, EARLY, NET, OWN_HALF, SIDEWAYS

FINE_STEP = 0.08  # s, of the flight to which a stroke is exact: 6e-8 m off at most
FINE_WAY = 0.6  # m, that such a step is long at most
SAME_INSTANT = 1e-6  # s, a contact this near the landing is the landing


@njit(cache=True, error_model="numpy")
def fine_step(velocity: Array) -> float:
    """Return the longest step in s of an exact flight that starts with a velocity (3,)."""
    return min(FINE_STEP, FINE_WAY / math.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2]))


@njit(cache=True, error_model="numpy")
def fly_return(after: Array, flight_time: float, air: AirCoefficients, contact: float, end: Array, work: Array) -> tuple[int, float]:
    """Fly from the hit to the goal in fine steps.

    The return is clear if its first contact is on the opponent's half at the flight time.

    Args:
        after: (9,) the ball just after the hit.
        flight_time: s.
        air: Coefficients.
        contact: m, height of the ball's centre in contact with the table.
        end: (9,) filled with the ball at the flight time.
        work: (8, 3) scratch.

    Returns:
        CLEAR and 0, or what the ball meets first and by how much: m under the top of the net (NET), m beside the table (SIDEWAYS), s before
        the flight time (OWN_HALF, EARLY).
    """
    trial, now = np.empty(9), after.copy()
    even, left = flight_time / math.ceil(flight_time / fine_step(after[VELOCITY])), flight_time
    met, missing = CLEAR, 0.0
    while left > 0.0:
        h = even * ease(now, air)
        if h > left - 1e-12:
            h = left
        step(now, h, air, end, work)
        if met == CLEAR and now[X] - BALL_RADIUS < NET_X < end[X] + BALL_RADIUS:
            if meets_net(now, end, h, air, trial, work) < np.inf:
                met, missing = NET, NET_HEIGHT + BALL_RADIUS - trial[Z]
            elif now[X] < NET_X <= end[X]:
                y = now[Y] + (end[Y] - now[Y]) * (NET_X - now[X]) / (end[X] - now[X])
                beside = max(-y, y - TABLE_WIDTH)
                if beside > 0.0:
                    met, missing = SIDEWAYS, beside
        elif met == CLEAR and now[X] > NET_X and not 0.0 <= now[Y] <= TABLE_WIDTH:
            met, missing = SIDEWAYS, max(-now[Y], now[Y] - TABLE_WIDTH)
        lands = h == left and now[Z] > contact and contact - end[Z] < -SAME_INSTANT * end[VZ]
        if met == CLEAR and not lands and (end[Z] <= contact or now[VZ] < 0.0 < end[VZ]):
            before = left - meets_surface(now, end, h, contact, air, trial, work)
            if before > SAME_INSTANT:
                met, missing = (OWN_HALF if trial[X] < NET_X else EARLY), before
        left -= h
        now[:] = end
    return met, missing
