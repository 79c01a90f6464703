"""Flight of the ball with its events, each at its exact time: bounces on the table, and the event that ends the flight.

The integrator takes steps of MAX_STEP. A step in which an event function changes sign is shortened so that it ends at the event. The time
of the event is found by integrating to trial times, not by interpolation, so it is as accurate as the flight.

A path is the flight of the ball from a given state, as rows of time and state; a predicted one in most uses.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from .arrays import SPIN, STATE, TIME, VELOCITY, VX, VY, VZ, Array, X, Z
from .bounce import rebound_table
from .constants import BALL_RADIUS, FLOOR_Z, NET_X
from .flight import MAX_STEP, AirCoefficients, crossing_time, ease, step
from .path_end import PathEnd
from .physics import Physics, PhysicsCoefficients, physics_coefficients
from .states import BallState
from .table_contacts import meets_edge, meets_net, meets_surface

Rows = npt.NDArray[np.int64]

MOST_BOUNCES = 16  # then the ball rolls
LONGEST_PATH = 5.0  # s of a path; no ball flies longer
LARGEST_COORDINATE = 100.0  # m, of each coordinate; no hall is larger
LARGEST_SPEED_SUM = 1000.0  # m/s, sum over the axes; a ball that is faster comes from a broken state
LIU_WINDOW_LOW, LIU_WINDOW_HIGH = -0.3, 0.0  # m in x, where the dissertation hits, Section 4.5.1


class StopKind(IntEnum):
    """Kinds of conditions that end a path."""

    TIME = 0  # a time after the start
    X = 1  # a plane x
    LANDING = 2  # the next contact with the table
    LIU = 3  # the dissertation's rule, Section 4.5.1


class StopCondition(NamedTuple):
    """Condition that ends a path unless the floor, the net or the table's edge ends it before. The form that kernels take.

    Attributes:
        kind: A StopKind.
        x: m, the plane of StopKind.X.
        longest: s, longest duration of the path; for StopKind.TIME the duration asked for.
    """

    kind: int
    x: float
    longest: float


_ENDS = tuple(PathEnd)
# what `walk` returns: an index into _ENDS, or ROWS_FULL if there were too few rows for the path
END_STOP, END_FLOOR, END_NET, END_EDGE, END_ROLLING, END_TOO_LONG, END_TOO_FAR, ROWS_FULL = range(len(_ENDS) + 1)


def path_end_of(end: int) -> PathEnd:
    """Return the PathEnd for a number from END_STOP to END_TOO_FAR, as `walk` returns it."""
    return _ENDS[end]


@njit(cache=True)
def _stops_at(
    state: Array, end: Array, h: float, stop: StopCondition, bounced: bool, air: AirCoefficients, trial: Array, work: Array
) -> float:
    """Return the seconds into the step at which StopKind.X or StopKind.LIU holds, or inf. `bounced`: after a bounce."""
    if stop.kind == StopKind.X:
        crosses = (state[X] - stop.x) * (end[X] - stop.x) <= 0.0 and state[X] != stop.x
        return crossing_time(state, 0.0, h, X, stop.x, air, trial, work) if crosses else np.inf
    if stop.kind != StopKind.LIU:
        return np.inf
    best = np.inf
    if state[X] > LIU_WINDOW_LOW >= end[X]:
        best = crossing_time(state, 0.0, h, X, LIU_WINDOW_LOW, air, trial, work)
    if bounced:
        enter = 0.0
        if state[X] > LIU_WINDOW_HIGH:
            enter = crossing_time(state, 0.0, h, X, LIU_WINDOW_HIGH, air, trial, work) if end[X] <= LIU_WINDOW_HIGH else np.inf
        if enter <= h:
            step(state, enter, air, trial, work)
            if trial[VZ] <= 0.0:
                best = min(best, enter)
            elif end[VZ] <= 0.0:
                best = min(best, crossing_time(state, enter, h, VZ, 0.0, air, trial, work))
    return best


@njit(cache=True)
def put_row(rows: Array, n: int, time: float, state: Array) -> None:
    """Write a time and a state into a row of an array.

    Args:
        rows: (m, 10) time (s) and state of each point.
        n: Index of the row.
        time: s.
        state: (9,) position (m), velocity (m/s), spin (rad/s).
    """
    rows[n, TIME] = time
    row = rows[n, STATE]
    for k in range(9):
        row[k] = state[k]


@njit(cache=True)
def is_lost(state: Array) -> bool:
    """Tell whether a state (9,) is not finite, farther than LARGEST_COORDINATE or faster than LARGEST_SPEED_SUM, as no ball is."""
    for k in range(3):
        if not abs(state[k]) <= LARGEST_COORDINATE:
            return True
    return not abs(state[VX]) + abs(state[VY]) + abs(state[VZ]) <= LARGEST_SPEED_SUM


@njit(cache=True)
def walk(
    start: float, state: Array, stop: StopCondition, physics: PhysicsCoefficients, rows: Array, bounce_rows: Rows
) -> tuple[int, int, int]:
    """Compute the path of the ball, flight and bounces, until something ends it.

    Args:
        start: s, time of the first row.
        state: (9,) position (m), velocity (m/s), spin (rad/s) of the ball at the start.
        stop: Where to stop.
        physics: Coefficients of air and table.
        rows: (n, 10) filled with time and state of each point. Two rows of the same time are a bounce: before and after it.
        bounce_rows: (MOST_BOUNCES,) filled with the index of the second row of each bounce.

    Returns:
        The number of rows filled, the number of bounces, and what ended the path: a number from END_STOP to END_TOO_FAR, or ROWS_FULL if
        there are too few rows.
    """
    air, contact = physics.air, physics.contact_height
    work, trial, end, now = np.empty((8, 3)), np.empty(9), np.empty(9), state.copy()
    put_row(rows, 0, start, now)
    t, n, bounces = 0.0, 1, 0
    while n + 3 < len(rows):
        h = min(MAX_STEP * ease(now, air), stop.longest - t)
        if h <= 0.0:
            return n, bounces, END_STOP if stop.kind == StopKind.TIME else END_TOO_LONG
        step(now, h, air, end, work)
        table, edge, net, stopped, floor = np.inf, np.inf, np.inf, np.inf, np.inf  # s into the step
        if end[Z] <= contact or now[VZ] < 0.0 < end[VZ]:
            table = meets_surface(now, end, h, contact, air, trial, work)
            if table == np.inf:
                edge = meets_edge(now, end, h, contact, air, trial, work)
        if min(now[X], end[X]) - BALL_RADIUS <= NET_X <= max(now[X], end[X]) + BALL_RADIUS:
            net = meets_net(now, end, h, air, trial, work)
        if stop.kind == StopKind.X or stop.kind == StopKind.LIU:
            stopped = _stops_at(now, end, h, stop, bounces > 0, air, trial, work)
        if end[Z] <= FLOOR_Z + BALL_RADIUS < now[Z]:
            floor = crossing_time(now, 0.0, h, Z, FLOOR_Z + BALL_RADIUS, air, trial, work)
        first = min(table, stopped, floor, edge, net)
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
        if first == stopped or (first == table and stop.kind == StopKind.LANDING):
            return n, bounces, END_STOP
        if first != table:
            return n, bounces, END_FLOOR if first == floor else END_NET if first == net else END_EDGE
        now[Z] = contact
        rebound_table(now[VELOCITY], now[SPIN], physics.table)
        put_row(rows, n, start + t, now)
        bounce_rows[bounces] = n
        n += 1
        bounces += 1
        if bounces == MOST_BOUNCES:
            return n, bounces, END_ROLLING
    return n, bounces, ROWS_FULL


@njit(cache=True)
def walk_entry(
    start: float, state: Array, kind: int, x: float, longest: float, physics: Array, rows: Array, bounce_rows: Rows
) -> tuple[int, int, int]:
    """Compute the path of the ball as `walk` does, with arguments that can be passed from Python.

    Args:
        start: s, time of the first row.
        state: (9,) position (m), velocity (m/s), spin (rad/s) of the ball at the start.
        kind: A StopKind, see StopCondition.
        x: m, see StopCondition.
        longest: s, see StopCondition.
        physics: (19,) `Physics.coefficients`.
        rows: (n, 10) filled with time and state of each point.
        bounce_rows: (MOST_BOUNCES,) filled with the index of the second row of each bounce.

    Returns:
        As `walk` returns.
    """
    return walk(start, state, StopCondition(kind, x, longest), physics_coefficients(physics), rows, bounce_rows)


def next_contact(ball: BallState, physics: Physics) -> BallState:
    """Compute the flight of the ball up to what it meets next: table, net, table edge or floor.

    Args:
        ball: Where the flight starts, in `table`.
        physics: Models of air and table.

    Returns:
        The ball just before the contact.
    """
    rows, bounce_rows = np.empty((512, 10)), np.empty(MOST_BOUNCES, np.int64)
    n, _, _ = walk_entry(ball.time, ball.vector, int(StopKind.LANDING), 0.0, LONGEST_PATH, physics.coefficients, rows, bounce_rows)
    return BallState.from_vector(float(rows[n - 1, TIME]), rows[n - 1, STATE])
