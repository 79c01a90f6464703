"""What stands in the ball's way: table, its edge and the net. Kernels that do not validate; state = (9,) position, velocity, spin."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .constants import BALL_RADIUS, NET_HEIGHT, NET_OVERHANG, NET_X, TABLE_LENGTH, TABLE_WIDTH
from .flight import crossing, step
from .states import Array

MOST_ACCELERATION = 100.0  # m/s^2, more than a ball ever has; bounds how far its arc is from the chord


@njit(cache=True)
def over_table(state: Array) -> bool:
    """Whether the centre of the ball is above the playing surface."""
    return 0.0 <= state[0] <= TABLE_LENGTH and 0.0 <= state[1] <= TABLE_WIDTH


@njit(cache=True)
def meets_surface(state: Array, end: Array, h: float, contact: float, air: Array, trial: Array, work: Array) -> float:
    """Seconds into the step of h s, from state to end, at which the ball comes down to z = contact over the table, or inf."""
    at = np.inf
    if end[2] <= contact:
        if state[2] > contact:
            at = crossing(state, 0.0, h, 2, contact, air, trial, work)
        elif state[5] > 0.0 and end[5] < 0.0:  # up from the surface and down again in one step
            at = crossing(state, crossing(state, 0.0, h, 5, 0.0, air, trial, work), h, 2, contact, air, trial, work)
    elif state[2] > contact and state[5] < 0.0 < end[5]:  # a valley within the step
        bottom = crossing(state, 0.0, h, 5, 0.0, air, trial, work)
        if trial[2] <= contact:
            at = crossing(state, 0.0, bottom, 2, contact, air, trial, work)
    return at if at < np.inf and over_table(trial) else np.inf


@njit(cache=True)
def _edge_gap(state: Array, contact: float) -> float:
    """m from a ball of radius `contact` beside the table, centre not below its surface, to the edge."""
    x = max(-state[0], state[0] - TABLE_LENGTH, 0.0)
    y = max(-state[1], state[1] - TABLE_WIDTH, 0.0)
    z = max(state[2], 0.0)
    return math.sqrt(x * x + y * y + z * z) - contact


@njit(cache=True)
def meets_edge(state: Array, end: Array, h: float, contact: float, air: Array, trial: Array, work: Array) -> float:
    """Seconds into the step at which a ball falling past the table touches its edge, or inf.

    Looked for between the heights `contact` and 0 of the centre, where a falling ball is for some milliseconds, at their ends and middle.
    """
    if not (state[2] > 0.0 and end[2] < contact) or contact <= 0.0:
        return np.inf
    low = crossing(state, 0.0, h, 2, contact, air, trial, work) if state[2] > contact else 0.0
    high = crossing(state, low, h, 2, 0.0, air, trial, work) if end[2] < 0.0 else h
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
def meets_net(state: Array, end: Array, h: float, air: Array, trial: Array, work: Array) -> float:
    """Seconds into the step at which the ball meets the net, or inf: its front the net below the tape, or its centre the net's plane less
    than a radius above the tape."""
    sag = MOST_ACCELERATION * h * h / 8.0
    side = 1.0 if state[0] > NET_X else -1.0
    for level, top in ((NET_X + side * BALL_RADIUS, NET_HEIGHT), (NET_X, NET_HEIGHT + BALL_RADIUS)):
        if side * (state[0] - level) > 0.0 >= side * (end[0] - level):
            chord = state[2] + (end[2] - state[2]) * (level - state[0]) / (end[0] - state[0])
            if chord > top + sag:
                continue
            t = crossing(state, 0.0, h, 0, level, air, trial, work)
            if 0.0 < trial[2] < top and -NET_OVERHANG < trial[1] < TABLE_WIDTH + NET_OVERHANG:
                return t
    return np.inf
