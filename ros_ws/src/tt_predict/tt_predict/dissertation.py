"""The dissertation's own prediction of the path, for comparison: RK4 on a time grid, with events at grid times only (Section 4.5.1)."""

from __future__ import annotations

import numpy as np
from numba import njit
from tt_core.arrays import POSITION, SPIN, TIME, VELOCITY, VZ, Array, X, Z
from tt_core.bounce import rebound_table
from tt_core.constants import BALL_RADIUS, FLOOR_Z
from tt_core.events import (
    END_FLOOR,
    END_ROLLING,
    END_STOP,
    END_TOO_FAR,
    END_TOO_LONG,
    LIU_WINDOW_HIGH,
    LIU_WINDOW_LOW,
    MOST_BOUNCES,
    Rows,
    StopCondition,
    StopKind,
    is_lost,
    put_row,
)
from tt_core.flight import AirCoefficients, accelerate
from tt_core.physics import PhysicsCoefficients, physics_coefficients
from tt_core.table_contacts import over_table

LIU_STEP = 1.0 / 1200.0  # s, dissertation Section 4.5.1


@njit(cache=True)
def _rk4(state: Array, h: float, air: AirCoefficients, k: Array, v: Array) -> None:
    """Integrate state (9,) by one RK4 step of h seconds (4.59)-(4.61), in place. k (4, 3) and v (4, 3) are scratch memory."""
    position, velocity, spin = state[POSITION], state[VELOCITY], state[SPIN]
    for i in range(4):
        part = 0.0 if i == 0 else h if i == 3 else 0.5 * h
        for j in range(3):
            v[i, j] = velocity[j] + (part * k[i - 1, j] if i else 0.0)
        accelerate(v[i], spin, air, k[i])
    for j in range(3):
        position[j] += h / 6.0 * (v[0, j] + 2.0 * v[1, j] + 2.0 * v[2, j] + v[3, j])
        velocity[j] += h / 6.0 * (k[0, j] + 2.0 * k[1, j] + 2.0 * k[2, j] + k[3, j])


@njit(cache=True)
def walk_stepped(
    start: float, state: Array, stop: StopCondition, physics: PhysicsCoefficients, rows: Array, bounce_rows: Rows
) -> tuple[int, int, int]:
    """Integrate flight and bounces until the path ends, as `tt_core.events.walk` does, but by the dissertation's scheme.

    The scheme is RK4 with steps of LIU_STEP and constant spin. Each event takes place at the end of the step in which it happens. The ball
    touches the table at the end of the first step in which its centre falls to the contact height, although it may be lower by then. Net
    and table edge are ignored.

    Args:
        start: s, time of the first row.
        state: (9,) ball at the start: position m, velocity m/s, spin rad/s in `table`.
        stop: Condition at which the path ends.
        physics: Models of air and table.
        rows: (n, 10) output: filled with time s and state of each point. Two rows with the same time are a bounce.
        bounce_rows: (MOST_BOUNCES,) output: filled with the index of the second row of each bounce.

    Returns:
        The number of rows, the number of bounces, and the END_... constant of `tt_core.events` that tells why the path ends.
    """
    k, v = np.empty((4, 3)), np.empty((4, 3))
    now, last = state.copy(), state.copy()
    put_row(rows, 0, start, now)
    contact, n, bounces = physics.contact_height, 1, 0
    for i in range(1, len(rows)):
        if stop.kind == StopKind.TIME and (i - 1) * LIU_STEP >= stop.longest - 1e-12:
            return n, bounces, END_STOP
        if n + 2 > len(rows):
            break
        last[:] = now
        _rk4(now, LIU_STEP, physics.air, k, v)
        if is_lost(now):
            return n, bounces, END_TOO_FAR
        put_row(rows, n, start + i * LIU_STEP, now)
        n += 1
        in_window = bounces > 0 and LIU_WINDOW_LOW <= now[X] <= LIU_WINDOW_HIGH and now[VZ] <= 0.0
        if stop.kind == StopKind.LIU and (in_window or now[X] <= LIU_WINDOW_LOW):
            return n, bounces, END_STOP
        if stop.kind == StopKind.X and (last[X] - stop.x) * (now[X] - stop.x) <= 0.0:
            return n, bounces, END_STOP
        if now[Z] <= contact and now[VZ] < 0.0 and over_table(now) and last[Z] > contact - 0.5 * BALL_RADIUS:
            if stop.kind == StopKind.LANDING:
                return n, bounces, END_STOP
            rebound_table(now[VELOCITY], now[SPIN], physics.table)
            put_row(rows, n, rows[n - 1, TIME], now)
            bounce_rows[bounces] = n
            n += 1
            bounces += 1
            if bounces == MOST_BOUNCES:
                return n, bounces, END_ROLLING
        if now[Z] <= FLOOR_Z + BALL_RADIUS:
            return n, bounces, END_FLOOR
    return n, bounces, END_TOO_LONG


@njit(cache=True)
def walk_stepped_entry(
    start: float, state: Array, kind: int, x: float, longest: float, physics: Array, rows: Array, bounce_rows: Rows
) -> tuple[int, int, int]:
    """Call `walk_stepped` from Python with plain numbers and arrays.

    Args:
        start: s, time of the first row.
        state: (9,) ball at the start: position m, velocity m/s, spin rad/s in `table`.
        kind: Kind of StopCondition.
        x: m, x of StopCondition.
        longest: s, longest duration of StopCondition.
        physics: (19,) `Physics.coefficients`.
        rows: (n, 10) output: filled with time s and state of each point. Two rows with the same time are a bounce.
        bounce_rows: (MOST_BOUNCES,) output: filled with the index of the second row of each bounce.

    Returns:
        The number of rows, the number of bounces, and the END_... constant of `tt_core.events` that tells why the path ends.
    """
    return walk_stepped(start, state, StopCondition(kind, x, longest), physics_coefficients(physics), rows, bounce_rows)
