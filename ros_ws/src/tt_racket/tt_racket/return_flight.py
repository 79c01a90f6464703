"""Flight of the returned ball to its goal, and the obstacles on its way. Kernels do not validate their arguments."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.arrays import VELOCITY, VZ, Array, X, Y, Z
from tt_core.constants import BALL_RADIUS, NET_HEIGHT, NET_X, TABLE_WIDTH
from tt_core.flight import AirCoefficients, ease, step
from tt_core.table_contacts import meets_net, meets_surface

from .solution import CLEAR, EARLY, NET_HIT, OWN_HALF, SIDEWAYS

FINE_STEP = 0.08  # s, longest integration step of the flight that decides on the exactness of a stroke: an error of 6e-8 m at most
FINE_WAY = 0.6  # m, longest way that the ball flies in such a step
SAME_INSTANT = 1e-6  # s, a contact that is nearer to the asked landing time than this is the landing


@njit(cache=True, error_model="numpy")
def fine_step(velocity: Array) -> float:
    """Return the longest integration step in s with which a flight from this velocity (3,) m/s has an error of at most 6e-8 m."""
    return min(FINE_STEP, FINE_WAY / math.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2]))


@njit(cache=True, error_model="numpy")
def fly_return(after: Array, flight_time: float, air: AirCoefficients, contact: float, end: Array, work: Array) -> tuple[int, float]:
    """Integrate the flight of the returned ball for the asked flight time, and find the first obstacle on its way.

    There is no obstacle if the ball's first contact is on the opponent's half of the table at the end of the flight time. A state (9,) is
    position m, velocity m/s and spin rad/s in `table`.

    Args:
        after: (9,) state of the ball just after the hit.
        flight_time: s, asked time from the hit to the landing.
        air: Coefficients of the flight model.
        contact: m, height of the ball's centre when the ball touches the table.
        end: (9,) output: filled with the state of the ball after the flight time.
        work: (8, 3) scratch memory.

    Returns:
        The obstacle, a constant of `solution`, and its amount. CLEAR: 0. NET_HIT: m by which the ball is too low to pass over the net.
        SIDEWAYS: m beside the table. OWN_HALF and EARLY: s by which the ball touches the table before the flight time has passed.
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
                met, missing = NET_HIT, NET_HEIGHT + BALL_RADIUS - trial[Z]
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
