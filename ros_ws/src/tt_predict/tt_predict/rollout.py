"""From a state of the ball to its path: flight and bounces, every event exact (dissertation Section 4.5.1, without its time grid).

`tt_core.events.walk` does the work. `method="liu"` is the dissertation's time grid, for comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from tt_core.arrays import POSITION, SPIN, STATE, TIME, VELOCITY, Array
from tt_core.errors import BadChoice, OutOfRange, check_range
from tt_core.events import LONGEST, MOST_BOUNCES, ROWS_FULL, StopKind, path_end_of, walk_entry
from tt_core.flight import LEAST_EASE, MAX_STEP
from tt_core.physics import Physics
from tt_core.states import BallPath, BallState, Bounce

from .dissertation import LIU_STEP, walk_stepped_entry

MOST_POINTS = 2000  # of a path that is published, see `thinned`
SPACING = 0.005  # s between the points of a path that has been thinned out


@dataclass(frozen=True, slots=True)
class StopRule:
    """Where a path ends, unless the floor, the net or the table's edge ends it. Made by one of the class methods.

    Attributes:
        kind: Which rule.
        value: The time in s or the x in m of the rule, 0 if it needs none.
    """

    kind: StopKind
    value: float = 0.0

    @classmethod
    def liu(cls) -> StopRule:
        """Stop after a bounce, in -0.3 <= x <= 0 as soon as the ball does not rise, else at x = -0.3 (Section 4.5.1)."""
        return cls(StopKind.LIU)

    @classmethod
    def at_time(cls, t: float) -> StopRule:
        """Stop at the time t (s), of the same clock as the ball's time."""
        return cls(StopKind.TIME, check_range("t", t, -math.inf, math.inf))

    @classmethod
    def at_x(cls, x: float) -> StopRule:
        """Stop where the centre of the ball crosses the plane x (m), -100 to 100."""
        return cls(StopKind.X, check_range("x", x, -100.0, 100.0))

    @classmethod
    def at_landing(cls) -> StopRule:
        """Stop at the next contact with the table, before the rebound."""
        return cls(StopKind.LANDING)

    def longest(self, start: float) -> float:
        """Return the longest duration in s of a path from the time `start` (s).

        Raises:
            OutOfRange: The stop time is before `start`, or later than LONGEST after it.
        """
        return check_range("stop time after the ball's", self.value - start, 0.0, LONGEST) if self.kind is StopKind.TIME else LONGEST


_MOST_ROWS = math.ceil(LONGEST / (MAX_STEP * LEAST_EASE)) + 2 * MOST_BOUNCES + 8
_ROWS = {"exact": math.ceil(LONGEST / MAX_STEP) + 2 * MOST_BOUNCES + 8, "liu": math.ceil(LONGEST / LIU_STEP) + MOST_BOUNCES + 8}
_WALKS = {"exact": walk_entry, "liu": walk_stepped_entry}


def rollout(ball: BallState, physics: Physics, stop: StopRule, *, method: str = "exact") -> BallPath:
    """Predict the path of the ball.

    Points lie at most MAX_STEP apart. After net and edge the ball cannot be predicted, so the path ends there.

    Args:
        ball: Where the path starts, in `table`.
        physics: Models of air and table.
        stop: Where the path ends if nothing else ends it.
        method: "exact", or "liu", the dissertation's own scheme, which ends at time steps only (`dissertation.walk_stepped`).

    Returns:
        The path. Its `ended` tells what ended it.

    Raises:
        OutOfRange: The stop time is before the ball's time, or the path has more points than any path of LONGEST seconds.
        BadChoice: `method` is unknown.
    """
    if method not in _WALKS:
        raise BadChoice("method", method, tuple(_WALKS))
    walk, duration = _WALKS[method], stop.longest(ball.time)
    size, end = _ROWS[method], ROWS_FULL
    while end == ROWS_FULL:
        rows, bounce_rows = np.empty((size, 10)), np.empty(MOST_BOUNCES, np.int64)
        points, bounced, end = walk(ball.time, ball.vector, int(stop.kind), stop.value, duration, physics.coefficients, rows, bounce_rows)
        if end == ROWS_FULL and size >= _MOST_ROWS:
            raise OutOfRange("number of points of the path", size + 1, 1, size)
        size = min(8 * size, _MOST_ROWS)  # steps may be small, see tt_core.flight.ease
    rows = rows[:points]
    rows.flags.writeable = False
    bounces = tuple(_bounce(rows, i) for i in bounce_rows[:bounced].tolist()) if bounced else ()
    return BallPath.trusted(rows, bounces, path_end_of(end))


def thinned(path: BallPath) -> BallPath:
    """Return the path with every second point, as it is published: messages are slow.

    Both points of each bounce and the last point stay. Interpolation between points of a launched ball, 40 ms apart, is off by at most 0.01
    mm and 0.7 mm/s. A path of more than MOST_POINTS points, which happens with spin along the flight, keeps points SPACING apart.
    """
    bounces = np.flatnonzero(np.diff(path.times) == 0.0)
    if len(path.times) <= MOST_POINTS:
        even = np.arange(0, len(path.times), 2)
    else:
        even = np.searchsorted(path.times, np.arange(path.times[0], path.times[-1], SPACING))
    kept = np.unique(np.concatenate([even, bounces, bounces + 1, [len(path.times) - 1]]))
    return BallPath(path.times[kept], path.positions[kept], path.velocities[kept], path.spins[kept], path.bounces, path.ended)


def _bounce(rows: Array, i: int) -> Bounce:
    """Return the bounce between rows i - 1 and i of (n, 10)."""
    time = float(rows[i, TIME])
    before, after = (BallState.trusted(time, s[POSITION], s[VELOCITY], s[SPIN]) for s in (rows[i - 1, STATE], rows[i, STATE]))
    return Bounce(before, after)
