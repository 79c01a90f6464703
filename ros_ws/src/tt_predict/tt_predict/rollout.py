"""From a state of the ball to its path: flight and bounces, every event exact (dissertation Section 4.5.1, without its time grid).

The integrator walks in steps of MAX_STEP. A step in which an event function changes sign is cut at the root, which is found by integrating
to trial times, not by interpolation, so an event is as exact as the flight. `method="liu"` is the time grid, for comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.bounce import rebound_table
from tt_core.constants import BALL_RADIUS, FLOOR_Z, NET_X
from tt_core.court import meets_edge, meets_net, meets_surface, over_table
from tt_core.errors import TtError, check_range
from tt_core.flight import LEAST_EASE, MAX_STEP, accelerate, crossing, ease, step
from tt_core.physics import Physics
from tt_core.states import Array, BallPath, BallState, Bounce

Rows = npt.NDArray[np.int64]

MOST_BOUNCES = 16  # then the ball rolls
LONGEST = 5.0  # s of a path; no ball flies longer
FARTHEST = 100.0  # m, of each coordinate; no hall is larger
FASTEST = 1000.0  # m/s, sum over the axes; a ball that is faster comes from a broken state
MOST_POINTS = 2000  # of a path that is published, see `thinned`
SPACING = 0.005  # s between the points of a path that has been thinned out
HIT_WINDOW = (-0.3, 0.0)  # m in x, dissertation Section 4.5.1
LIU_STEP = 1.0 / 1200.0  # s, dissertation Section 4.5.1

_TIME, _X, _LANDING, _LIU = range(4)
_ENDED = ("stop", "floor", "net", "edge", "rolling", "too long", "too far")
_STOP, _FLOOR, _NET, _EDGE, _ROLLING, _TOO_LONG, _TOO_FAR, _FULL = range(8)


@dataclass(frozen=True, slots=True)
class StopRule:
    """Where a path ends, unless the floor, the net or the table's edge ends it."""

    kind: int
    value: float = 0.0

    @classmethod
    def liu(cls) -> StopRule:
        """After a bounce: in -0.3 <= x <= 0 as soon as the ball does not rise, else at x = -0.3 (Section 4.5.1)."""
        return cls(_LIU)

    @classmethod
    def at_time(cls, t: float) -> StopRule:
        """At the time t (s), the same clock as the ball's."""
        return cls(_TIME, check_range("t", t, -math.inf, math.inf))

    @classmethod
    def at_x(cls, x: float) -> StopRule:
        """Where the centre crosses the plane x (m)."""
        return cls(_X, check_range("x", x, -100.0, 100.0))

    @classmethod
    def at_landing(cls) -> StopRule:
        """At the next contact with the table, before the rebound."""
        return cls(_LANDING)

    def longest(self, start: float) -> float:
        """s of the longest path from `start`; raises OutOfRange for a stop time before it."""
        return check_range("stop time after the ball's", self.value - start, 0.0, LONGEST) if self.kind == _TIME else LONGEST


@njit(cache=True)
def _stops(state: Array, end: Array, h: float, kind: int, value: float, bounced: bool, air: Array, trial: Array, work: Array) -> float:
    """The time within the step at which the stop rule holds, or inf; the rule by landing is the contact itself."""
    if kind == _X and (state[0] - value) * (end[0] - value) <= 0.0 and state[0] != value:
        return crossing(state, 0.0, h, 0, value, air, trial, work)
    if kind != _LIU:
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
def _put(rows: Array, n: int, time: float, state: Array) -> None:
    rows[n, 0] = time
    for k in range(9):
        rows[n, 1 + k] = state[k]


@njit(cache=True)
def _is_lost(state: Array) -> bool:
    """Whether the ball is too far or too fast to be one; so it is if a number is not finite."""
    for k in range(3):
        if not abs(state[k]) <= FARTHEST:
            return True
    return not abs(state[3]) + abs(state[4]) + abs(state[5]) <= FASTEST


@njit(cache=True)
def roll(
    start: float, state: Array, duration: float, kind: int, value: float, air: Array, table: Array, contact: float, rows: Array, at: Rows
) -> tuple[int, int, int]:
    """Fill rows (n, 10) of time, position, velocity, spin; two rows of one time are a bounce, the second in `at` (MOST_BOUNCES,).
    Returns rows, bounces, index into _ENDED, or _FULL when rows are too few.

    start: s, the time of the first row. duration: s, of the longest path.
    """
    work, trial, end, now = np.empty((8, 3)), np.empty(9), np.empty(9), state.copy()
    _put(rows, 0, start, now)
    t, n, bounces = 0.0, 1, 0
    while n + 3 < len(rows):
        h = min(MAX_STEP * ease(now, air), duration - t)
        if h <= 0.0:
            return n, bounces, _STOP if kind == _TIME else _TOO_LONG
        step(now, h, air, end, work)
        hit, edge, net, stop, floor = np.inf, np.inf, np.inf, np.inf, np.inf
        if end[2] <= contact or now[5] < 0.0 < end[5]:
            hit = meets_surface(now, end, h, contact, air, trial, work)
            if hit == np.inf:
                edge = meets_edge(now, end, h, contact, air, trial, work)
        if min(now[0], end[0]) - BALL_RADIUS <= NET_X <= max(now[0], end[0]) + BALL_RADIUS:
            net = meets_net(now, end, h, air, trial, work)
        if kind in (_X, _LIU):
            stop = _stops(now, end, h, kind, value, bounces > 0, air, trial, work)
        if end[2] <= FLOOR_Z + BALL_RADIUS < now[2]:
            floor = crossing(now, 0.0, h, 2, FLOOR_Z + BALL_RADIUS, air, trial, work)
        first = min(hit, stop, floor, edge, net)
        if first <= h:
            step(now, first, air, end, work)
            h = first
        if _is_lost(end):
            return n, bounces, _TOO_FAR
        t += h
        for k in range(9):
            now[k] = end[k]
        _put(rows, n, start + t, now)
        n += 1
        if first == np.inf:
            continue
        if first == stop or (first == hit and kind == _LANDING):
            return n, bounces, _STOP
        if first != hit:
            return n, bounces, _FLOOR if first == floor else _NET if first == net else _EDGE
        now[2] = contact
        rebound_table(now[3:6], now[6:9], table)
        _put(rows, n, start + t, now)
        at[bounces] = n
        n += 1
        bounces += 1
        if bounces == MOST_BOUNCES:
            return n, bounces, _ROLLING
    return n, bounces, _FULL


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
def roll_stepped(
    start: float, state: Array, duration: float, kind: int, value: float, air: Array, table: Array, contact: float, rows: Array, at: Rows
) -> tuple[int, int, int]:
    """As `roll`, by the dissertation's scheme: RK4 of LIU_STEP, constant spin, and every event at the first step that is past it.

    The ball is at the table in the first step with z <= contact, wherever that is; net and edge are no obstacles.
    """
    k, v = np.empty((4, 3)), np.empty((4, 3))
    now, last = state.copy(), state.copy()
    _put(rows, 0, start, now)
    n, bounces = 1, 0
    for i in range(1, len(rows)):
        if kind == _TIME and (i - 1) * LIU_STEP >= duration - 1e-12:
            return n, bounces, _STOP
        if n + 2 > len(rows):
            break
        last[:] = now
        _rk4(now, LIU_STEP, air, k, v)
        if _is_lost(now):
            return n, bounces, _TOO_FAR
        _put(rows, n, start + i * LIU_STEP, now)
        n += 1
        window = bounces > 0 and HIT_WINDOW[0] <= now[0] <= HIT_WINDOW[1] and now[5] <= 0.0
        if kind == _LIU and (window or now[0] <= HIT_WINDOW[0]):
            return n, bounces, _STOP
        if kind == _X and (last[0] - value) * (now[0] - value) <= 0.0:
            return n, bounces, _STOP
        if now[2] <= contact and now[5] < 0.0 and over_table(now) and last[2] > contact - 0.5 * BALL_RADIUS:
            if kind == _LANDING:
                return n, bounces, _STOP
            rebound_table(now[3:6], now[6:9], table)
            _put(rows, n, rows[n - 1, 0], now)
            at[bounces] = n
            n += 1
            bounces += 1
            if bounces == MOST_BOUNCES:
                return n, bounces, _ROLLING
        if now[2] <= FLOOR_Z + BALL_RADIUS:
            return n, bounces, _FLOOR
    return n, bounces, _TOO_LONG


_MOST_ROWS = math.ceil(LONGEST / (MAX_STEP * LEAST_EASE)) + 2 * MOST_BOUNCES + 8
_ROWS = {"exact": math.ceil(LONGEST / MAX_STEP) + 2 * MOST_BOUNCES + 8, "liu": math.ceil(LONGEST / LIU_STEP) + MOST_BOUNCES + 8}


def rollout(ball: BallState, physics: Physics, stop: StopRule, *, method: str = "exact") -> BallPath:
    """The path of the ball from its state to the stop rule or to what else ends it; `ended` tells: "stop", "floor", "net", "edge" (of the
    table), "rolling" after MOST_BOUNCES, "too long" after LONGEST seconds, "too far" where it leaves FARTHEST or is over FASTEST.

    Points lie at most MAX_STEP apart. What the ball does after net and edge nobody can tell, so the path ends there.
    method: "exact", or "liu", the dissertation's own scheme, see `roll_stepped`, which ends at steps only.
    Raises OutOfRange for a stop time before the ball's, TtError for an unknown method.
    """
    if method not in _ROWS:
        raise TtError(f"method {method!r} is none of {', '.join(map(repr, _ROWS))}")
    time, duration = ball.time, stop.longest(ball.time)
    size, ended = _ROWS[method], _FULL
    while ended == _FULL:
        rows, at = np.empty((size, 10)), np.empty(MOST_BOUNCES, np.int64)
        n, bounced, ended = (roll if method == "exact" else roll_stepped)(
            time,
            ball.vector,
            duration,
            stop.kind,
            stop.value,
            physics.air.coefficients,
            physics.table.coefficients,
            physics.contact_height,
            rows,
            at,
        )
        if ended == _FULL and size >= _MOST_ROWS:
            raise TtError(f"path of more than {size} points")
        size = min(8 * size, _MOST_ROWS)  # small steps, see tt_core.flight.ease
    rows = rows[:n]
    rows.flags.writeable = False
    bounces = tuple(_bounce(rows, i) for i in at[:bounced].tolist()) if bounced else ()
    return BallPath.trusted(rows, bounces, _ENDED[ended])


def thinned(path: BallPath) -> BallPath:
    """The path itself, or where it has more than MOST_POINTS, which happens with spin along the flight, points of it SPACING apart.

    Both points of each bounce and the last point stay.
    """
    if len(path.times) <= MOST_POINTS:
        return path
    bounces = np.flatnonzero(np.diff(path.times) == 0.0)
    even = np.searchsorted(path.times, np.arange(path.times[0], path.times[-1], SPACING))
    kept = np.unique(np.concatenate([even, bounces, bounces + 1, [len(path.times) - 1]]))
    return BallPath(path.times[kept], path.positions[kept], path.velocities[kept], path.spins[kept], path.bounces, path.ended)


def _bounce(rows: Array, i: int) -> Bounce:
    """Between rows i - 1 and i of (n, 10)."""
    time = float(rows[i, 0])
    before, after = (BallState.trusted(time, row[1:4], row[4:7], row[7:]) for row in (rows[i - 1], rows[i]))
    return Bounce(before, after)
