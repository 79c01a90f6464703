"""The ball from event to event: flight, bounces on the table, and what ends a path, each at its exact instant.

The integrator takes steps of MAX_STEP. A step in which an event function changes sign is cut at the root. The root is found by integrating
to trial times, not by interpolation, so an event is as exact as the flight.
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
from .flight import MAX_STEP, AirCoefficients, crossing, ease, step
from .path_end import PathEnd
from .physics import Physics, PhysicsCoefficients, physics_coefficients
from .states import BallState
from .table_contacts import meets_edge, meets_net, meets_surface

Rows = npt.NDArray[np.int64]

MOST_BOUNCES = 16  # then the ball rolls
LONGEST_PATH = 5.0  # s of a path; no ball flies longer
FARTHEST = 100.0  # m, of each coordinate; no hall is larger
FASTEST = 1000.0  # m/s, sum over the axes; a ball that is faster comes from a broken state
LIU_WINDOW_LOW, LIU_WINDOW_HIGH = -0.3, 0.0  # m in x, where the dissertation hits, Section 4.5.1


class StopKind(IntEnum):
    """Kinds of stop rules."""

    TIME = 0  # a time after the start
    X = 1  # a plane x
    LANDING = 2  # the next contact with the table
    LIU = 3  # the dissertation's rule, Section 4.5.1


class StopCondition(NamedTuple):
    """Where a path ends if nothing else ends it, as kernels take it.

    Attributes:
        kind: A StopKind.
        x: m, for StopKind.X.
        longest: s, longest duration of the path; for StopKind.TIME the duration asked for.
    """

    kind: int
    x: float
    longest: float


_ENDS = tuple(PathEnd)
# what `walk` returns: indices into _ENDS, or that the rows were too few
END_STOP, END_FLOOR, END_NET, END_EDGE, END_ROLLING, END_TOO_LONG, END_TOO_FAR, ROWS_FULL = range(len(_ENDS) + 1)


def path_end_of(end: int) -> PathEnd:
    """Return what a kernel's number END_STOP to END_TOO_FAR means."""
    return _ENDS[end]


@njit(cache=True)
def _stops_at(
    state: Array, end: Array, h: float, stop: StopCondition, bounced: bool, air: AirCoefficients, trial: Array, work: Array
) -> float:
    """Return the seconds into the step at which StopKind.X or StopKind.LIU holds, or inf. `bounced`: after a bounce."""
    if stop.kind == StopKind.X:
        crosses = (state[X] - stop.x) * (end[X] - stop.x) <= 0.0 and state[X] != stop.x
        return crossing(state, 0.0, h, X, stop.x, air, trial, work) if crosses else np.inf
    if stop.kind != StopKind.LIU:
        return np.inf
    best = np.inf
    if state[X] > LIU_WINDOW_LOW >= end[X]:
        best = crossing(state, 0.0, h, X, LIU_WINDOW_LOW, air, trial, work)
    if bounced:
        enter = 0.0
        if state[X] > LIU_WINDOW_HIGH:
            enter = crossing(state, 0.0, h, X, LIU_WINDOW_HIGH, air, trial, work) if end[X] <= LIU_WINDOW_HIGH else np.inf
        if enter <= h:
            step(state, enter, air, trial, work)
            if trial[VZ] <= 0.0:
                best = min(best, enter)
            elif end[VZ] <= 0.0:
                best = min(best, crossing(state, enter, h, VZ, 0.0, air, trial, work))
    return best


@njit(cache=True)
def put_row(rows: Array, n: int, time: float, state: Array) -> None:
    """Write time (s) and state (9,) into row n of rows (m, 10)."""
    rows[n, TIME] = time
    row = rows[n, STATE]
    for k in range(9):
        row[k] = state[k]


@njit(cache=True)
def is_lost(state: Array) -> bool:
    """Tell whether the state (9,) is too far away or too fast to be a ball, or not finite."""
    for k in range(3):
        if not abs(state[k]) <= FARTHEST:
            return True
    return not abs(state[VX]) + abs(state[VY]) + abs(state[VZ]) <= FASTEST


@njit(cache=True)
def walk(
    start: float, state: Array, stop: StopCondition, physics: PhysicsCoefficients, rows: Array, bounce_rows: Rows
) -> tuple[int, int, int]:
    """Fly and bounce until the path ends.

    Args:
        start: s, time of the first row.
        state: (9,) the ball at the start.
        stop: Where to stop.
        physics: Models of air and table.
        rows: (n, 10) filled with time and state of each point. Two rows of one time are a bounce.
        bounce_rows: (MOST_BOUNCES,) filled with the second row of each bounce.

    Returns:
        The number of rows, the number of bounces, and END_... or ROWS_FULL if rows are too few.
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
            floor = crossing(now, 0.0, h, Z, FLOOR_Z + BALL_RADIUS, air, trial, work)
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
    """Call `walk` from Python: kind, x and longest are those of StopCondition, physics (19,) is `Physics.coefficients`."""
    return walk(start, state, StopCondition(kind, x, longest), physics_coefficients(physics), rows, bounce_rows)


def next_contact(ball: BallState, physics: Physics) -> BallState:
    """Fly the ball to whatever it meets next: table, net, table edge or floor.

    Args:
        ball: Where the flight starts, in `table`.
        physics: Models of air and table.

    Returns:
        The ball just before the contact.
    """
    rows, bounce_rows = np.empty((512, 10)), np.empty(MOST_BOUNCES, np.int64)
    n, _, _ = walk_entry(ball.time, ball.vector, int(StopKind.LANDING), 0.0, LONGEST_PATH, physics.coefficients, rows, bounce_rows)
    return BallState.from_vector(float(rows[n - 1, TIME]), rows[n - 1, STATE])
