"""Predict the path (flight and bounces) of the ball from one state of it (dissertation Section 4.5.1).

`tt_core.events.walk` computes the path, with the exact time of each event. The dissertation has events at the steps of a time grid only;
`method="liu"` does the same, for comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from tt_core.arrays import POSITION, SPIN, STATE, TIME, VELOCITY, Array
from tt_core.errors import BadChoice, OutOfRange, check_range
from tt_core.events import LONGEST_PATH, MOST_BOUNCES, ROWS_FULL, StopKind, path_end_of, walk_entry
from tt_core.flight import LEAST_EASE, MAX_STEP
from tt_core.physics import Physics
from tt_core.states import BallPath, BallState, Bounce

from .dissertation import LIU_STEP, walk_stepped_entry

MOST_POINTS = 2000  # a path of more points is published with points SPACING apart, see `thinned`
SPACING = 0.005  # s between the points of such a path


@dataclass(frozen=True, slots=True)
class StopRule:
    """Condition at which the predicted path of the ball ends, unless floor, net or table edge end it earlier.

    Use the class methods to create one.

    Attributes:
        kind: Kind of the condition.
        value: Time in s or x in m at which the path ends; 0 if the kind has no number.
    """

    kind: StopKind
    value: float = 0.0

    @classmethod
    def liu(cls) -> StopRule:
        """Return the rule of the dissertation's Section 4.5.1.

        The path ends after a bounce as soon as the ball is in -0.3 m <= x <= 0 and does not rise, and at the latest at x = -0.3 m.
        """
        return cls(StopKind.LIU)

    @classmethod
    def at_time(cls, t: float) -> StopRule:
        """Return the rule that ends the path at the time t (s), on the same clock as the time of the ball."""
        return cls(StopKind.TIME, check_range("t", t, -math.inf, math.inf))

    @classmethod
    def at_x(cls, x: float) -> StopRule:
        """Return the rule that ends the path where the centre of the ball crosses the plane at x (m, in `table`, -100 to 100)."""
        return cls(StopKind.X, check_range("x", x, -100.0, 100.0))

    @classmethod
    def at_landing(cls) -> StopRule:
        """Return the rule that ends the path at the next contact with the table, just before the rebound."""
        return cls(StopKind.LANDING)

    def longest(self, start: float) -> float:
        """Return the longest duration in s that a path which begins at the time `start` (s) can have.

        Raises:
            OutOfRange: The stop time is before `start`, or later than LONGEST_PATH after it.
        """
        if self.kind is not StopKind.TIME:
            return LONGEST_PATH
        return check_range("stop time after the ball's", self.value - start, 0.0, LONGEST_PATH)


_MOST_ROWS = math.ceil(LONGEST_PATH / (MAX_STEP * LEAST_EASE)) + 2 * MOST_BOUNCES + 8
_ROWS = {"exact": math.ceil(LONGEST_PATH / MAX_STEP) + 2 * MOST_BOUNCES + 8, "liu": math.ceil(LONGEST_PATH / LIU_STEP) + MOST_BOUNCES + 8}
_WALKS = {"exact": walk_entry, "liu": walk_stepped_entry}


def rollout(ball: BallState, physics: Physics, stop: StopRule, *, method: str = "exact") -> BallPath:
    """Predict the path of the ball through flight and bounces.

    The points of the path are at most MAX_STEP seconds apart. A path ends at the net or the table's edge, because the flight after such a
    contact cannot be predicted.

    Args:
        ball: State in which the path starts, in `table`.
        physics: Models of air and table.
        stop: Condition at which the path ends if no contact ends it earlier.
        method: "exact", or "liu" for the dissertation's own scheme, with events at time steps only (`dissertation.walk_stepped`).

    Returns:
        The path. Its `ended` tells why it ends.

    Raises:
        OutOfRange: The stop time is before the ball's time, or the path has more points than any path of LONGEST_PATH seconds.
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
    """Return the path with every second point only, for publication, because large messages are slow.

    Both points of each bounce and the last point are kept. Between points that are 40 ms apart, interpolation of a launched ball's path has
    an error of at most 0.01 mm and 0.7 mm/s. A path of more than MOST_POINTS points, which occurs if the spin axis is parallel to the
    velocity, keeps points that are SPACING seconds apart.
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
