"""A path of all joints that is built by appending legs (motions in which all joints begin and end together) and rests."""

from __future__ import annotations

import math

import numpy as np
from tt_core.errors import TtError
from tt_core.states import Array

from ..joints import JointBounds
from .jerk import SAME_DURATION, append, shortest_leg
from .legs import LEG, PROFILE_NAMES, RUCKIG, Leg, Pieces, append_leg, append_rest, leg_is_possible, shortest_time

PIECES = 48  # largest number of polynomials of each joint: a rest, three legs of at most twelve, a rest


class NoLeg(TtError):
    """There is no leg (motion in which all joints begin and end together) of the given duration between the given ends.

    Attributes:
        time: s, duration.
        leg: States of the joints at start and end.
    """

    def __init__(self, time: float, leg: Leg) -> None:
        """Keep the duration and the leg."""
        super().__init__(f"there is no leg of {time:g} s with {LEG.names} = {leg.tolist()}")
        self.time, self.leg = time, leg


class Path:
    """Path of all joints as polynomials, to which legs (motions in which all joints begin and end together) and rests are appended.

    Attributes:
        duration: s, duration of the path so far.
        pieces: The polynomials.
    """

    def __init__(self, limits: JointBounds, profile: str) -> None:
        """Create an empty path.

        Args:
            limits: (n,) limits of the joints, which each leg must keep.
            profile: Profile of the legs, one of PROFILE_NAMES.
        """
        self.duration = 0.0
        n = len(limits)
        self.pieces = Pieces(np.full((n, PIECES), np.inf), np.zeros((n, PIECES, 6)), np.zeros(n, np.int64))
        self._limits, self._kind = limits, PROFILE_NAMES.index(profile)

    def shortest_time(self, time: float, leg: Leg) -> float:
        """Return the duration (s) of the shortest motion that keeps the limits and lasts at least `time` (s); inf if there is none.

        Args:
            time: s, least duration.
            leg: States of the joints at start and end.
        """
        if self._kind != RUCKIG:
            return float(shortest_time(time, leg, self._limits, self._kind))
        shortest = shortest_leg(leg, self._limits, time)
        return math.inf if shortest is None else float(shortest.duration)

    def is_possible(self, time: float, leg: Leg) -> bool:
        """Return whether a motion of given duration between given ends keeps the limits.

        Args:
            time: s, duration of the motion.
            leg: States of the joints at start and end.
        """
        if self._kind != RUCKIG:
            return bool(leg_is_possible(time, leg, self._limits, self._kind))
        return self.shortest_time(time, leg) <= time + SAME_DURATION

    def rest(self, q: Array, time: float) -> None:
        """Append a rest at the joint positions q (n,) rad for `time` (s)."""
        append_rest(self.duration, q, self.pieces)
        self.duration += time

    def leg(self, time: float, leg: Leg) -> None:
        """Append a leg (motion in which all joints begin and end together) to the path.

        Args:
            time: s, duration of the leg, for which it must be possible: a result of `shortest_time`.
            leg: States of the joints at start and end.

        Raises:
            NoLeg: The profile is "ruckig", and ruckig finds no such leg.
        """
        if self._kind == RUCKIG:
            shortest = shortest_leg(leg, self._limits, time)
            if shortest is None:
                raise NoLeg(time, leg)
            append(shortest, self.duration, self.pieces)
            time = shortest.duration
        else:
            append_leg(self.duration, time, leg, self._limits, self._kind, self.pieces)
        self.duration += time

    def join(self, other: Path) -> None:
        """Append the polynomials of another path of the same joints."""
        mine, others = self.pieces, other.pieces
        for i, (have, more) in enumerate(zip(mine.counts, others.counts, strict=True)):
            mine.knots[i, have : have + more] = self.duration + others.knots[i, :more]
            mine.coefficients[i, have : have + more] = others.coefficients[i, :more]
        mine.counts[:] += others.counts
        self.duration += other.duration
