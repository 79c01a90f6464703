"""The dissertation's own prediction, for comparison: RK4 on a time grid, every event at the first step past it (Section 4.5.1)."""

from __future__ import annotations

import numpy as np
from numba import njit
from tt_core.bounce import rebound_table
from tt_core.constants import BALL_RADIUS, FLOOR_Z
from tt_core.events import (
    END_FLOOR,
    END_ROLLING,
    END_STOP,
    END_TOO_FAR,
    END_TOO_LONG,
    HIT_WINDOW,
    MOST_BOUNCES,
    STOP_LANDING,
    STOP_LIU,
    STOP_TIME,
    STOP_X,
    Rows,
    is_lost,
    put_row,
)
from tt_core.flight import accelerate
from tt_core.states import Array
from tt_core.table_contacts import over_table

LIU_STEP = 1.0 / 1200.0  # s, dissertation Section 4.5.1


@njit(cache=True)
def _rk4(state: Array, h: float, air: Array, k: Array, v: Array) -> None:
    """(4.59)-(4.61), in place; k (4, 3) and v (4, 3) are scratch."""
    w = state[6:9]
    for i in range(4):
        part = 0.0 if i == 0 else h if i == 3 else 0.5 * h
        for j in range(3):
            v[i, j] = state[3 + j] + (part * k[i - 1, j] if i else 0.0)
        accelerate(v[i], w, air, k[i])
    for j in range(3):
        state[j] += h / 6.0 * (v[0, j] + 2.0 * v[1, j] + 2.0 * v[2, j] + v[3, j])
        state[3 + j] += h / 6.0 * (k[0, j] + 2.0 * k[1, j] + 2.0 * k[2, j] + k[3, j])


@njit(cache=True)
def walk_stepped(
    start: float, state: Array, duration: float, kind: int, value: float, air: Array, table: Array, contact: float, rows: Array, at: Rows
) -> tuple[int, int, int]:
    """As `tt_core.events.walk`, by the dissertation's scheme: RK4 of LIU_STEP, constant spin, events at the first step past them.

    The ball is at the table in the first step with z <= contact, wherever that is; net and edge are no obstacles.
    """
    k, v = np.empty((4, 3)), np.empty((4, 3))
    now, last = state.copy(), state.copy()
    put_row(rows, 0, start, now)
    n, bounces = 1, 0
    for i in range(1, len(rows)):
        if kind == STOP_TIME and (i - 1) * LIU_STEP >= duration - 1e-12:
            return n, bounces, END_STOP
        if n + 2 > len(rows):
            break
        last[:] = now
        _rk4(now, LIU_STEP, air, k, v)
        if is_lost(now):
            return n, bounces, END_TOO_FAR
        put_row(rows, n, start + i * LIU_STEP, now)
        n += 1
        window = bounces > 0 and HIT_WINDOW[0] <= now[0] <= HIT_WINDOW[1] and now[5] <= 0.0
        if kind == STOP_LIU and (window or now[0] <= HIT_WINDOW[0]):
            return n, bounces, END_STOP
        if kind == STOP_X and (last[0] - value) * (now[0] - value) <= 0.0:
            return n, bounces, END_STOP
        if now[2] <= contact and now[5] < 0.0 and over_table(now) and last[2] > contact - 0.5 * BALL_RADIUS:
            if kind == STOP_LANDING:
                return n, bounces, END_STOP
            rebound_table(now[3:6], now[6:9], table)
            put_row(rows, n, rows[n - 1, 0], now)
            at[bounces] = n
            n += 1
            bounces += 1
            if bounces == MOST_BOUNCES:
                return n, bounces, END_ROLLING
        if now[2] <= FLOOR_Z + BALL_RADIUS:
            return n, bounces, END_FLOOR
    return n, bounces, END_TOO_LONG
