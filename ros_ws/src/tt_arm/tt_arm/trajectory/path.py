"""A path of all joints in the making: legs and rests, one after the other."""

from __future__ import annotations

import math

import numpy as np
from tt_core.errors import TtError
from tt_core.states import Array

from ..joints import JointBounds
from .jerk import SAME, append, shortest_leg
from .legs import LEG, PROFILES, RUCKIG, Leg, Pieces, append_leg, append_rest, leg_is_possible, shortest_time

PIECES = 48  # polynomials of each joint: a rest, three legs of at most twelve, a rest


class NoLeg(TtError):
    """There is no leg of a given duration.

    Attributes:
        time: s.
        leg: Start and end.
    """

    def __init__(self, time: float, leg: Leg) -> None:
        """Keep the duration and the leg."""
        super().__init__(f"there is no leg of {time:g} s with {LEG.names} = {leg.tolist()}")
        self.time, self.leg = time, leg


class Path:
    """Polynomials for all joints, to which each call appends.

    Attributes:
        duration: s, of what is there so far.
        pieces: The polynomials.
    """

    def __init__(self, limits: JointBounds, profile: str) -> None:
        """Begin an empty path.

        Args:
            limits: Of the joints.
            profile: One of PROFILES.
        """
        self.duration = 0.0
        n = len(limits)
        self.pieces = Pieces(np.full((n, PIECES), np.inf), np.zeros((n, PIECES, 6)), np.zeros(n, np.int64))
        self._limits, self._kind = limits, PROFILES.index(profile)

    def shortest_time(self, time: float, leg: Leg) -> float:
        """Return the duration (s) of the shortest possible leg, at least `time`; inf if there is none."""
        if self._kind != RUCKIG:
            return float(shortest_time(time, leg, self._limits, self._kind))
        shortest = shortest_leg(leg, self._limits, time)
        return math.inf if shortest is None else float(shortest.duration)

    def is_possible(self, time: float, leg: Leg) -> bool:
        """Return whether a leg of `time` (s) is possible."""
        if self._kind != RUCKIG:
            return bool(leg_is_possible(time, leg, self._limits, self._kind))
        return self.shortest_time(time, leg) <= time + SAME

    def rest(self, q: Array, time: float) -> None:
        """Append rest at q (n,) rad for `time` (s)."""
        append_rest(self.duration, q, self.pieces)
        self.duration += time

    def leg(self, time: float, leg: Leg) -> None:
        """Append a leg of `time` (s), as `shortest_time` returns it.

        Raises:
            NoLeg: ruckig finds none.
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
        """Append another path."""
        mine, others = self.pieces, other.pieces
        for i, (have, more) in enumerate(zip(mine.counts, others.counts, strict=True)):
            mine.knots[i, have : have + more] = self.duration + others.knots[i, :more]
            mine.coefficients[i, have : have + more] = others.coefficients[i, :more]
        mine.counts[:] += others.counts
        self.duration += other.duration
