"""Relax a goal for which there is no stroke: find the feasible goal nearest to it by changing its spin, flight time or landing place.

A stroke is the racket's position, orientation and velocity at one time that returns the ball.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Flag, auto
from typing import NamedTuple

import numpy as np
from tt_core.arrays import Array
from tt_core.constants import NET_X, TABLE_LENGTH, TABLE_WIDTH
from tt_core.errors import TtError
from tt_core.params import check, param
from tt_core.physics import Physics
from tt_core.states import BallState, ReturnGoal

from .stroke import Stroke, solve

AMOUNT_HALVINGS = 5  # of the last step of a search
SHORTEST_FLIGHT, LONGEST_FLIGHT = 0.1, 3.0  # s, flight times that are tried
LANDING_DIRECTIONS = 8  # in which other landings are tried


class GoalPart(Flag):
    """Parts of a return's goal that may be given up (changed): spin, flight time, landing place. Flags can be combined."""

    SPIN = auto()
    TIME = auto()
    PLACE = auto()


NOTHING = GoalPart(0)
_PARTS = {"spin": GoalPart.SPIN, "time": GoalPart.TIME, "place": GoalPart.PLACE}
_TIME, _SPIN = 2, slice(3, 5)  # elements of ReturnGoal.vector


@dataclass(frozen=True)
class RelaxationParams:
    """Parameters of the relaxation: the order in which parts of the goal are given up, and the steps and bounds of the search."""

    order: tuple[str, ...] = param(
        ("spin", "time", "place"), "", "what of a goal out of reach is given up, in this order", choices=("spin", "time", "place")
    )
    spin_step: float = param(40.0, "rad/s", "step in which less of the asked spin is tried", low=1.0, high=1000.0)
    time_step: float = param(0.04, "s", "step in which shorter and longer flight times are tried", low=0.005, high=1.0)
    time_most: float = param(0.4, "s", "largest change of the flight time, shorter or longer", low=0.0, high=2.0)
    place_step: float = param(0.1, "m", "step in which other landing places are tried", low=0.01, high=1.0)
    place_most: float = param(0.6, "m", "largest distance between the asked landing place and another", low=0.0, high=2.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)
        if len(set(self.order)) != len(self.order):
            raise TtError(f"order = {self.order} names a part of the goal twice")


@dataclass(frozen=True, slots=True)
class Relaxation:
    """Difference between a relaxed goal and the asked one.

    Attributes:
        parts: Parts of the goal that are given up; NOTHING if the goal is as asked.
        spin: rad/s, length of the change of the spin's y and z components.
        time: s, change of the flight time; positive if it is longer than asked.
        place: m, distance between the asked landing place and the new one.
    """

    parts: GoalPart = NOTHING
    spin: float = 0.0
    time: float = 0.0
    place: float = 0.0

    @classmethod
    def between(cls, asked: ReturnGoal, goal: ReturnGoal, parts: GoalPart) -> Relaxation:
        """Return the difference between a relaxed goal and the asked one.

        Args:
            asked: The asked goal.
            goal: The relaxed goal.
            parts: Parts that `goal` gives up.
        """
        change = goal.vector - asked.vector
        return cls(parts, math.hypot(*change[_SPIN].tolist()), float(change[_TIME]), math.hypot(*change[:2].tolist()))

    def rank(self, order: Sequence[str]) -> int:
        """Return the rank of this relaxation in an order of preference, smaller is better.

        0 is a goal as asked. Then follow the relaxations that give up one part, in the given order; then those that give up spin and
        another part, in the order of the other part.

        Args:
            order: "spin", "time" and "place" in the order in which they are given up, as in RelaxationParams.
        """
        if self.parts is NOTHING:
            return 0
        together = self.parts & ~GoalPart.SPIN
        if together is NOTHING or self.parts is together:
            return [_PARTS[name] for name in order].index(self.parts)
        return len(order) + [_PARTS[name] for name in order].index(together)

    def __str__(self) -> str:
        """Return the given-up parts and amounts as text, "as asked" if nothing is given up."""
        texts = {
            GoalPart.SPIN: f"spin by {self.spin:.0f} rad/s",
            GoalPart.TIME: f"time by {self.time:+.3f} s",
            GoalPart.PLACE: f"place by {self.place:.3f} m",
        }
        return " and ".join(text for part, text in texts.items() if part in self.parts) or "as asked"


AS_ASKED = Relaxation()


class Return(NamedTuple):
    """One way to return a ball: the ball, the goal and the stroke.

    Attributes:
        ball: Ball just before the hit.
        goal: Goal for which the stroke was solved.
        stroke: The stroke; its `reason` tells why there is none.
        relaxation: Difference between `goal` and the goal that was asked for; AS_ASKED if there is none.
    """

    ball: BallState
    goal: ReturnGoal
    stroke: Stroke
    relaxation: Relaxation = AS_ASKED


class _Line(NamedTuple):
    """Goals on a line in the space of ReturnGoal.vector: base + amount / length * change."""

    part: GoalPart
    base: Array
    change: Array
    length: float  # in the unit of the amounts
    amounts: list[float]  # to try, rising


def _goal_at(line: _Line, amount: float) -> ReturnGoal | None:
    """Return the goal at an amount along a line; None if the changed flight time or landing place is out of bounds."""
    vector = line.base + amount / line.length * line.change
    x, y, time, _, _ = vector.tolist()
    if line.part is GoalPart.TIME and not SHORTEST_FLIGHT <= time <= LONGEST_FLIGHT:
        return None
    if line.part is GoalPart.PLACE and not (NET_X < x < TABLE_LENGTH and 0.0 < y < TABLE_WIDTH):
        return None
    return ReturnGoal.from_vector(vector)


def _lines(part: GoalPart, ball: BallState, base: Array, params: RelaxationParams) -> list[_Line]:
    """Return the lines along which other values of one part of the goal are tried.

    There are two lines for the spin: from the asked spin to the spin that the ball already has, for which the rubber need not change
    the spin; and from the asked spin through zero to its opposite.
    """
    if part is GoalPart.SPIN:
        lines = []
        for change in (ball.spin[1:] - base[_SPIN], -base[_SPIN] - base[_SPIN]):
            length = float(np.linalg.norm(change))
            if length > 0.0:
                amounts = [*np.arange(params.spin_step, length, params.spin_step), length]
                lines.append(_Line(part, base, np.array([0.0, 0.0, 0.0, *change]), length, amounts))
        return lines
    if part is GoalPart.TIME:
        amounts = list(np.arange(1, round(params.time_most / params.time_step) + 1) * params.time_step)
        return [_Line(part, base, np.array([0.0, 0.0, sign, 0.0, 0.0]), 1.0, amounts) for sign in (-1.0, 1.0)]
    amounts = list(np.arange(1, round(params.place_most / params.place_step) + 1) * params.place_step)
    angles = np.arange(LANDING_DIRECTIONS) * 2.0 * math.pi / LANDING_DIRECTIONS
    return [_Line(part, base, np.array([math.cos(a), math.sin(a), 0.0, 0.0, 0.0]), 1.0, amounts) for a in angles]


def _nearest(line: _Line, i: int, ball: BallState, physics: Physics, racket_speed: float) -> tuple[float, ReturnGoal, Stroke] | None:
    """Try amount number i of a line. If it is feasible, bisect the last step; return the least feasible amount, its goal and stroke."""
    if i >= len(line.amounts) or (goal := _goal_at(line, line.amounts[i])) is None:
        return None
    stroke = solve(ball, goal, physics, racket_speed=racket_speed)
    if stroke.racket is None:
        return None
    low, best = (line.amounts[i - 1] if i else 0.0), (line.amounts[i], goal, stroke)
    for _ in range(AMOUNT_HALVINGS):
        middle = 0.5 * (low + best[0])
        nearer = _goal_at(line, middle)
        if nearer and (stroke := solve(ball, nearer, physics, racket_speed=racket_speed)).racket:
            best = (middle, nearer, stroke)
        else:
            low = middle
    return best


def _least(lines: list[_Line], ball: BallState, physics: Physics, racket_speed: float) -> tuple[ReturnGoal, Stroke] | None:
    """Return the feasible goal with the least amount over all lines, and its stroke; None if no line has one."""
    for i in range(max((len(line.amounts) for line in lines), default=0)):
        found = [best for line in lines if (best := _nearest(line, i, ball, physics, racket_speed)) is not None]
        if found:
            _, goal, stroke = min(found, key=lambda one: one[0])
            return goal, stroke
    return None


def relax_part(
    part: str, ball: BallState, goal: ReturnGoal, physics: Physics, params: RelaxationParams, racket_speed: float = math.inf
) -> Return | None:
    """Change one part of a goal that has no stroke, by the least amount with which there is a stroke.

    Args:
        part: "spin", "time" (flight time) or "place" (landing place).
        ball: Ball just before the hit.
        goal: Goal for which there is no stroke.
        physics: Models of air, table and racket.
        params: Steps and bounds of the search.
        racket_speed: m/s, highest speed of the racket.

    Returns:
        The return with the changed goal; None if no change within the bounds has a stroke.
    """
    flag = _PARTS[part]
    found = _least(_lines(flag, ball, goal.vector, params), ball, physics, racket_speed)
    return Return(ball, found[0], found[1], Relaxation.between(goal, found[0], flag)) if found else None


def relax_goal(asked: Return, physics: Physics, params: RelaxationParams | None = None, racket_speed: float = math.inf) -> Return:
    """Find the relaxed goal nearest to an asked one for which there is no stroke.

    First one part of the goal is given up (changed), in the order of `params.order`. If no single part helps and spin is in the order, time
    or place is changed together with the spin: first with the spin that the ball already has, then without spin.

    Args:
        asked: Ball and asked goal, with the result of `stroke.solve` for them.
        physics: Models of air, table and racket.
        params: Order, steps and bounds of the search; None for the default.
        racket_speed: m/s, highest speed of the racket.

    Returns:
        The return with the relaxed goal; `asked` if it has a stroke, or if no relaxed goal has one.
    """
    if asked.stroke.racket:
        return asked
    params, ball, goal = params or RelaxationParams(), asked.ball, asked.goal
    for part in params.order:
        if (relaxed := relax_part(part, ball, goal, physics, params, racket_speed)) is not None:
            return relaxed
    if "spin" not in params.order:
        return asked
    for spin in (ball.spin[1:], np.zeros(2)):
        base = ReturnGoal(goal.landing, goal.flight_time, float(spin[0]), float(spin[1]))
        for part in params.order:
            if part != "spin" and (other := relax_part(part, ball, base, physics, params, racket_speed)) is not None:
                parts = GoalPart.SPIN | _PARTS[part]
                return Return(ball, other.goal, other.stroke, Relaxation.between(goal, other.goal, parts))
    return asked
