"""From a state of the ball to its path: flight and bounces, every event exact (dissertation Section 4.5.1, without its time grid).

The integrator walks in steps of MAX_STEP. A step in which an event function changes sign is cut at the root, which is found by integrating
to trial times, not by interpolation, so an event is as exact as the flight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_core.bounce import rebound_table
from tt_core.constants import BALL_RADIUS, FLOOR_Z, TABLE_LENGTH, TABLE_WIDTH
from tt_core.errors import check_range
from tt_core.flight import MAX_STEP, step
from tt_core.physics import Physics
from tt_core.states import Array, BallPath, BallState, Bounce

MOST_BOUNCES = 16  # then the ball rolls
LONGEST = 5.0  # s of a path; no ball flies longer
HIT_WINDOW = (-0.3, 0.0)  # m in x, dissertation Section 4.5.1

_TIME, _X, _LANDING, _LIU = range(4)
_ENDED = ("stop", "floor", "rolling", "too long")


@dataclass(frozen=True, slots=True)
class StopRule:
    """Where a path ends, whatever else: the floor ends it too."""

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


@njit(cache=True)
def _event(state: Array, axis: int, level: float) -> float:
    return state[axis] - level


@njit(cache=True)
def _root(state: Array, low: float, high: float, axis: int, level: float, air: Array, work: Array, trial: Array) -> float:
    """The time in [low, high] after `state` at which state[axis] crosses `level` (Illinois rule)."""
    step(state, low, air, trial, work)
    f_low = _event(trial, axis, level)
    step(state, high, air, trial, work)
    f_high = _event(trial, axis, level)
    for _ in range(60):
        if abs(f_high - f_low) < 1e-300:
            break
        middle = (low * f_high - high * f_low) / (f_high - f_low)
        step(state, middle, air, trial, work)
        f = _event(trial, axis, level)
        if f * f_high < 0.0:
            low, f_low = high, f_high
        else:
            f_low *= 0.5
        moved = abs(high - middle)
        high, f_high = middle, f
        if f == 0.0 or moved < 1e-15:
            break
    return high


@njit(cache=True)
def _contact(state: Array, end: Array, h: float, level: float, air: Array, work: Array, trial: Array) -> float:
    """The time within the step at which the ball comes down to z = level, or inf."""
    if end[2] <= level:
        if state[2] > level:
            return _root(state, 0.0, h, 2, level, air, work, trial)
        if state[5] > 0.0 and end[5] < 0.0:  # up from the surface and down again in one step
            return _root(state, _root(state, 0.0, h, 5, 0.0, air, work, trial), h, 2, level, air, work, trial)
    elif state[2] > level and state[5] < 0.0 < end[5]:  # a valley within the step
        bottom = _root(state, 0.0, h, 5, 0.0, air, work, trial)
        step(state, bottom, air, trial, work)
        if trial[2] <= level:
            return _root(state, 0.0, bottom, 2, level, air, work, trial)
    return np.inf


@njit(cache=True)
def _stop(state: Array, end: Array, h: float, kind: int, value: float, bounced: bool, air: Array, work: Array, trial: Array) -> float:
    """The time within the step at which the stop rule holds, or inf; the rule by landing is the contact itself."""
    if kind == _X and (state[0] - value) * (end[0] - value) <= 0.0 and state[0] != value:
        return _root(state, 0.0, h, 0, value, air, work, trial)
    if kind != _LIU:
        return np.inf
    best = np.inf
    if state[0] > HIT_WINDOW[0] >= end[0]:
        best = _root(state, 0.0, h, 0, HIT_WINDOW[0], air, work, trial)
    if bounced:
        enter = 0.0
        if state[0] > HIT_WINDOW[1]:
            enter = _root(state, 0.0, h, 0, HIT_WINDOW[1], air, work, trial) if end[0] <= HIT_WINDOW[1] else np.inf
        if enter <= h:
            step(state, enter, air, trial, work)
            if trial[5] <= 0.0:
                best = min(best, enter)
            elif end[5] <= 0.0:
                best = min(best, _root(state, enter, h, 5, 0.0, air, work, trial))
    return best


@njit(cache=True)
def roll(
    state: Array, duration: float, kind: int, value: float, air: Array, table: Array, contact: float, times: Array, states: Array
) -> tuple[int, int, int]:
    """Fill times (s after the start) and states (n, 9); two rows of one time are a bounce. Returns rows, bounces, index into _ENDED."""
    work, trial = np.empty((8, 3)), np.empty(9)
    now, end = state.copy(), np.empty(9)
    t, n, bounces = 0.0, 1, 0
    times[0], states[0] = 0.0, now
    while n + 3 < len(times):
        h = min(MAX_STEP, duration - t)
        if h <= 0.0:
            return n, bounces, 0 if kind == _TIME else 3
        step(now, h, air, end, work)
        hit = _contact(now, end, h, contact, air, work, trial)
        if hit <= h:
            step(now, hit, air, trial, work)
            if not (0.0 <= trial[0] <= TABLE_LENGTH and 0.0 <= trial[1] <= TABLE_WIDTH):
                hit = np.inf
        stop = _stop(now, end, h, kind, value, bounces > 0, air, work, trial)
        floor = np.inf
        if end[2] <= FLOOR_Z + BALL_RADIUS < now[2]:
            floor = _root(now, 0.0, h, 2, FLOOR_Z + BALL_RADIUS, air, work, trial)
        first = min(hit, stop, floor)
        if first <= h:
            step(now, first, air, end, work)
            h = first
        t += h
        now[:] = end
        times[n], states[n] = t, now
        n += 1
        if first == stop and stop < np.inf:
            return n, bounces, 0
        if first == floor and floor < np.inf:
            return n, bounces, 1
        if first == hit and hit < np.inf:
            if kind == _LANDING:
                return n, bounces, 0
            now[2] = contact
            rebound_table(now[3:6], now[6:9], table)
            times[n], states[n] = t, now
            n += 1
            bounces += 1
            if bounces == MOST_BOUNCES:
                return n, bounces, 2
    return n, bounces, 3


_ROWS = math.ceil(LONGEST / MAX_STEP) + 2 * MOST_BOUNCES + 8


def rollout(ball: BallState, physics: Physics, stop: StopRule) -> BallPath:
    """The path of the ball from its state to the stop rule, the floor, or LONGEST seconds; `ended` tells which.

    Points lie at most MAX_STEP apart. Bounces are those on the table's surface; the net and the table's edge are not obstacles here.
    Raises OutOfRange for a stop time before the ball's.
    """
    duration = LONGEST
    if stop.kind == _TIME:
        duration = check_range("stop time after the ball's", stop.value - ball.time, 0.0, LONGEST)
    times, states = np.empty(_ROWS), np.empty((_ROWS, 9))
    n, bounced, ended = roll(
        ball.vector,
        duration,
        stop.kind,
        stop.value,
        physics.air.coefficients,
        physics.table.coefficients,
        physics.contact_height,
        times,
        states,
    )
    times, states = times[:n] + ball.time, states[:n]
    bounces: tuple[Bounce, ...] = ()
    if bounced:
        rows = np.flatnonzero(np.diff(times) == 0.0)
        bounces = tuple(
            Bounce(BallState.from_vector(times[i], states[i]), BallState.from_vector(times[i], states[i + 1]))
            for i in rows
            if states[i, 5] < 0.0 < states[i + 1, 5]
        )
    return BallPath(times, states[:, :3], states[:, 3:6], states[:, 6:], bounces, _ENDED[ended])
