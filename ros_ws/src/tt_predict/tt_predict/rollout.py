"""From a state of the ball to its path: flight and bounces, every event exact (dissertation Section 4.5.1, without its time grid).

The integrator walks in steps of MAX_STEP. A step in which an event function changes sign is cut at the root, which is found by integrating
to trial times, not by interpolation, so an event is as exact as the flight. `method="liu"` is the time grid, for comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from tt_core.errors import TtError, check_range
from tt_core.events import (
    ENDED,
    LONGEST,
    MOST_BOUNCES,
    ROWS_FULL,
    STOP_LANDING,
    STOP_LIU,
    STOP_TIME,
    STOP_X,
    walk,
)
from tt_core.flight import LEAST_EASE, MAX_STEP
from tt_core.physics import Physics
from tt_core.states import Array, BallPath, BallState, Bounce

from .dissertation import LIU_STEP, walk_stepped

MOST_POINTS = 2000  # of a path that is published, see `thinned`
SPACING = 0.005  # s between the points of a path that has been thinned out


@dataclass(frozen=True, slots=True)
class StopRule:
    """Where a path ends, unless the floor, the net or the table's edge ends it."""

    kind: int
    value: float = 0.0

    @classmethod
    def liu(cls) -> StopRule:
        """After a bounce: in -0.3 <= x <= 0 as soon as the ball does not rise, else at x = -0.3 (Section 4.5.1)."""
        return cls(STOP_LIU)

    @classmethod
    def at_time(cls, t: float) -> StopRule:
        """At the time t (s), the same clock as the ball's."""
        return cls(STOP_TIME, check_range("t", t, -math.inf, math.inf))

    @classmethod
    def at_x(cls, x: float) -> StopRule:
        """Where the centre crosses the plane x (m)."""
        return cls(STOP_X, check_range("x", x, -100.0, 100.0))

    @classmethod
    def at_landing(cls) -> StopRule:
        """At the next contact with the table, before the rebound."""
        return cls(STOP_LANDING)

    def longest(self, start: float) -> float:
        """s of the longest path from `start`; raises OutOfRange for a stop time before it."""
        return check_range("stop time after the ball's", self.value - start, 0.0, LONGEST) if self.kind == STOP_TIME else LONGEST


_MOST_ROWS = math.ceil(LONGEST / (MAX_STEP * LEAST_EASE)) + 2 * MOST_BOUNCES + 8
_ROWS = {"exact": math.ceil(LONGEST / MAX_STEP) + 2 * MOST_BOUNCES + 8, "liu": math.ceil(LONGEST / LIU_STEP) + MOST_BOUNCES + 8}


def rollout(ball: BallState, physics: Physics, stop: StopRule, *, method: str = "exact") -> BallPath:
    """The path of the ball from its state to the stop rule or to what else ends it; `ended` tells: "stop", "floor", "net", "edge" (of the
    table), "rolling" after MOST_BOUNCES, "too long" after LONGEST seconds, "too far" where it leaves FARTHEST or is over FASTEST.

    Points lie at most MAX_STEP apart. What the ball does after net and edge nobody can tell, so the path ends there.
    method: "exact", or "liu", the dissertation's own scheme, see `walk_stepped`, which ends at steps only.
    Raises OutOfRange for a stop time before the ball's, TtError for an unknown method.
    """
    if method not in _ROWS:
        raise TtError(f"method {method!r} is none of {', '.join(map(repr, _ROWS))}")
    time, duration = ball.time, stop.longest(ball.time)
    size, ended = _ROWS[method], ROWS_FULL
    while ended == ROWS_FULL:
        rows, at = np.empty((size, 10)), np.empty(MOST_BOUNCES, np.int64)
        n, bounced, ended = (walk if method == "exact" else walk_stepped)(
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
        if ended == ROWS_FULL and size >= _MOST_ROWS:
            raise TtError(f"path of more than {size} points")
        size = min(8 * size, _MOST_ROWS)  # small steps, see tt_core.flight.ease
    rows = rows[:n]
    rows.flags.writeable = False
    bounces = tuple(_bounce(rows, i) for i in at[:bounced].tolist()) if bounced else ()
    return BallPath.trusted(rows, bounces, ENDED[ended])


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
