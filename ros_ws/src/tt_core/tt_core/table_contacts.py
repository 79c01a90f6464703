"""Contacts of the ball with table, table edge and net within one integration step, as compiled functions that do not validate.

A state (9,) is position (m), velocity (m/s), spin (rad/s) in frame `table`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .arrays import VZ, Array, X, Y, Z
from .constants import BALL_RADIUS, NET_HEIGHT, NET_OVERHANG, NET_X, TABLE_LENGTH, TABLE_WIDTH
from .flight import AirCoefficients, crossing_time, step

MOST_ACCELERATION = 100.0  # m/s^2, more than a ball ever has; bounds how far its arc is from the chord


@njit(cache=True)
def over_table(state: Array) -> bool:
    """Tell whether the centre of a ball with the given state (9,) is above the playing surface, at any height."""
    return 0.0 <= state[X] <= TABLE_LENGTH and 0.0 <= state[Y] <= TABLE_WIDTH


@njit(cache=True)
def meets_surface(state: Array, end: Array, h: float, contact: float, air: AirCoefficients, trial: Array, work: Array) -> float:
    """Find the time at which the falling ball touches the playing surface within one step.

    Args:
        state: (9,) the ball at the start of the step.
        end: (9,) the ball at the end of the step.
        h: s, length of the step.
        contact: m, height of the ball's centre when the ball touches a surface.
        air: Coefficients.
        trial: (9,) filled with the ball at the contact.
        work: (8, 3) scratch.

    Returns:
        The time of the contact, s after the start of the step; inf if there is none.
    """
    at = np.inf
    if end[Z] <= contact:
        if state[Z] > contact:
            at = crossing_time(state, 0.0, h, Z, contact, air, trial, work)
        elif state[VZ] > 0.0 and end[VZ] < 0.0:  # up from the surface and down again in one step
            at = crossing_time(state, crossing_time(state, 0.0, h, VZ, 0.0, air, trial, work), h, Z, contact, air, trial, work)
    elif state[Z] > contact and state[VZ] < 0.0 < end[VZ]:  # a valley within the step
        bottom = crossing_time(state, 0.0, h, VZ, 0.0, air, trial, work)
        if trial[Z] <= contact:
            at = crossing_time(state, 0.0, bottom, Z, contact, air, trial, work)
    return at if at < np.inf and over_table(trial) else np.inf


@njit(cache=True)
def _edge_gap(state: Array, contact: float) -> float:
    """Return the distance in m from the edge to a ball of radius `contact` beside the table, its centre not below the surface."""
    x = max(-state[X], state[X] - TABLE_LENGTH, 0.0)
    y = max(-state[Y], state[Y] - TABLE_WIDTH, 0.0)
    z = max(state[Z], 0.0)
    return math.sqrt(x * x + y * y + z * z) - contact


@njit(cache=True)
def meets_edge(state: Array, end: Array, h: float, contact: float, air: AirCoefficients, trial: Array, work: Array) -> float:
    """Find the time at which a ball that falls beside the table touches the table's edge within one step.

    Whether the ball touches the edge is checked at three times, while the height of its centre falls from `contact` to 0, which takes some
    milliseconds: at the start, in the middle and at the end.

    Args:
        state: (9,) the ball at the start of the step.
        end: (9,) the ball at the end of the step.
        h: s, length of the step.
        contact: m, height of the ball's centre when the ball touches a surface.
        air: Coefficients.
        trial: (9,) filled with states at trial times, the last one within 1e-15 h of the contact.
        work: (8, 3) scratch.

    Returns:
        The time of the contact, s after the start of the step; inf if there is none.
    """
    if not (state[Z] > 0.0 and end[Z] < contact) or contact <= 0.0:
        return np.inf
    low = crossing_time(state, 0.0, h, Z, contact, air, trial, work) if state[Z] > contact else 0.0
    high = crossing_time(state, low, h, Z, 0.0, air, trial, work) if end[Z] < 0.0 else h
    for t in (low, 0.5 * (low + high), high):
        step(state, t, air, trial, work)
        if _edge_gap(trial, contact) <= 0.0:
            high = t
            for _ in range(50):
                middle = 0.5 * (low + high)
                step(state, middle, air, trial, work)
                if _edge_gap(trial, contact) <= 0.0:
                    high = middle
                else:
                    low = middle
            return high
    return np.inf


@njit(cache=True)
def meets_net(state: Array, end: Array, h: float, air: AirCoefficients, trial: Array, work: Array) -> float:
    """Find the time at which the ball meets the net within one step.

    The ball meets the net when its front reaches the net below the tape, or when its centre reaches the plane of the net less than a radius
    above the tape.

    Args:
        state: (9,) the ball at the start of the step.
        end: (9,) the ball at the end of the step.
        h: s, length of the step.
        air: Coefficients.
        trial: (9,) filled with the ball at the contact.
        work: (8, 3) scratch.

    Returns:
        The time of the contact, s after the start of the step; inf if there is none.
    """
    sag = MOST_ACCELERATION * h * h / 8.0
    side = 1.0 if state[X] > NET_X else -1.0
    for level, top in ((NET_X + side * BALL_RADIUS, NET_HEIGHT), (NET_X, NET_HEIGHT + BALL_RADIUS)):
        if side * (state[X] - level) > 0.0 >= side * (end[X] - level):
            chord = state[Z] + (end[Z] - state[Z]) * (level - state[X]) / (end[X] - state[X])
            if chord > top + sag:
                continue
            t = crossing_time(state, 0.0, h, X, level, air, trial, work)
            if 0.0 < trial[Z] < top and -NET_OVERHANG < trial[Y] < TABLE_WIDTH + NET_OVERHANG:
                return t
    return np.inf
