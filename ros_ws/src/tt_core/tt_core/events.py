"""The ball from event to event: flight, bounces on the table, and what ends a path, each at its exact instant.

The integrator walks in steps of MAX_STEP. A step in which an event function changes sign is cut at the root, which is found by integrating
to trial times, not by interpolation, so an event is as exact as the flight.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from .bounce import rebound_table
from .constants import BALL_RADIUS, FLOOR_Z, NET_X
from .flight import MAX_STEP, crossing, ease, step
from .physics import Physics
from .states import Array, BallState
from .table_contacts import meets_edge, meets_net, meets_surface

Rows = npt.NDArray[np.int64]

MOST_BOUNCES = 16  # then the ball rolls
LONGEST = 5.0  # s of a path; no ball flies longer
FARTHEST = 100.0  # m, of each coordinate; no hall is larger
FASTEST = 1000.0  # m/s, sum over the axes; a ball that is faster comes from a broken state
HIT_WINDOW = (-0.3, 0.0)  # m in x, dissertation Section 4.5.1

STOP_TIME, STOP_X, STOP_LANDING, STOP_LIU = range(4)  # kinds of stop rules
ENDED = ("stop", "floor", "net", "edge", "rolling", "too long", "too far")
END_STOP, END_FLOOR, END_NET, END_EDGE, END_ROLLING, END_TOO_LONG, END_TOO_FAR, ROWS_FULL = range(8)


@njit(cache=True)
def _stops(state: Array, end: Array, h: float, kind: int, value: float, bounced: bool, air: Array, trial: Array, work: Array) -> float:
    """The time within the step at which the stop rule holds, or inf; the rule by landing is the contact itself."""
    if kind == STOP_X and (state[0] - value) * (end[0] - value) <= 0.0 and state[0] != value:
        return crossing(state, 0.0, h, 0, value, air, trial, work)
    if kind != STOP_LIU:
        return np.inf
    best = np.inf
    if state[0] > HIT_WINDOW[0] >= end[0]:
        best = crossing(state, 0.0, h, 0, HIT_WINDOW[0], air, trial, work)
    if bounced:
        enter = 0.0
        if state[0] > HIT_WINDOW[1]:
            enter = crossing(state, 0.0, h, 0, HIT_WINDOW[1], air, trial, work) if end[0] <= HIT_WINDOW[1] else np.inf
        if enter <= h:
            step(state, enter, air, trial, work)
            if trial[5] <= 0.0:
                best = min(best, enter)
            elif end[5] <= 0.0:
                best = min(best, crossing(state, enter, h, 5, 0.0, air, trial, work))
    return best


@njit(cache=True)
def put_row(rows: Array, n: int, time: float, state: Array) -> None:
    rows[n, 0] = time
    for k in range(9):
        rows[n, 1 + k] = state[k]


@njit(cache=True)
def is_lost(state: Array) -> bool:
    """Whether the ball is too far or too fast to be one; so it is if a number is not finite."""
    for k in range(3):
        if not abs(state[k]) <= FARTHEST:
            return True
    return not abs(state[3]) + abs(state[4]) + abs(state[5]) <= FASTEST


@njit(cache=True)
def walk(
    start: float, state: Array, duration: float, kind: int, value: float, air: Array, table: Array, contact: float, rows: Array, at: Rows
) -> tuple[int, int, int]:
    """Fill rows (n, 10) of time, position, velocity, spin; two rows of one time are a bounce, the second in `at` (MOST_BOUNCES,).
    Returns rows, bounces, index into ENDED, or ROWS_FULL when rows are too few.

    start: s, the time of the first row. duration: s, of the longest path.
    """
    work, trial, end, now = np.empty((8, 3)), np.empty(9), np.empty(9), state.copy()
    put_row(rows, 0, start, now)
    t, n, bounces = 0.0, 1, 0
    while n + 3 < len(rows):
        h = min(MAX_STEP * ease(now, air), duration - t)
        if h <= 0.0:
            return n, bounces, END_STOP if kind == STOP_TIME else END_TOO_LONG
        step(now, h, air, end, work)
        hit, edge, net, stop, floor = np.inf, np.inf, np.inf, np.inf, np.inf
        if end[2] <= contact or now[5] < 0.0 < end[5]:
            hit = meets_surface(now, end, h, contact, air, trial, work)
            if hit == np.inf:
                edge = meets_edge(now, end, h, contact, air, trial, work)
        if min(now[0], end[0]) - BALL_RADIUS <= NET_X <= max(now[0], end[0]) + BALL_RADIUS:
            net = meets_net(now, end, h, air, trial, work)
        if kind in (STOP_X, STOP_LIU):
            stop = _stops(now, end, h, kind, value, bounces > 0, air, trial, work)
        if end[2] <= FLOOR_Z + BALL_RADIUS < now[2]:
            floor = crossing(now, 0.0, h, 2, FLOOR_Z + BALL_RADIUS, air, trial, work)
        first = min(hit, stop, floor, edge, net)
        if first <= h:
            step(now, first, air, end, work)
            h = first
        if is_lost(end):
            return n, bounces, END_TOO_FAR
        t += h
        for k in range(9):
            now[k] = end[k]
        put_row(rows, n, start + t, now)
        n += 1
        if first == np.inf:
            continue
        if first == stop or (first == hit and kind == STOP_LANDING):
            return n, bounces, END_STOP
        if first != hit:
            return n, bounces, END_FLOOR if first == floor else END_NET if first == net else END_EDGE
        now[2] = contact
        rebound_table(now[3:6], now[6:9], table)
        put_row(rows, n, start + t, now)
        at[bounces] = n
        n += 1
        bounces += 1
        if bounces == MOST_BOUNCES:
            return n, bounces, END_ROLLING
    return n, bounces, ROWS_FULL


def next_contact(ball: BallState, physics: Physics) -> tuple[BallState, str]:
    """Fly the ball to whatever it meets next.

    Args:
        ball: Where the flight starts, in `table`.
        physics: Models of air and table.

    Returns:
        The ball just before the contact, and "table", "net", "edge" or "floor"; another word of ENDED if it meets nothing.
    """
    rows, at = np.empty((512, 10)), np.empty(MOST_BOUNCES, np.int64)
    air, table = physics.air.coefficients, physics.table.coefficients
    n, _, ended = walk(ball.time, ball.vector, LONGEST, STOP_LANDING, 0.0, air, table, physics.contact_height, rows, at)
    return BallState.from_vector(float(rows[n - 1, 0]), rows[n - 1, 1:]), "table" if ended == END_STOP else ENDED[ended]
