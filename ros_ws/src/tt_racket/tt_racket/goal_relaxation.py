"""What to give up of a goal that is out of reach: the nearest feasible return by spin, by time or by place."""

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

HALVINGS = 5  # of the last step of a search
SHORTEST_FLIGHT, LONGEST_FLIGHT = 0.1, 3.0  # s, flight times that are tried
DIRECTIONS = 8  # in which other landings are tried


class GoalPart(Flag):
    """Parts of a goal that may be given up."""

    SPIN = auto()
    TIME = auto()
    PLACE = auto()


NOTHING = GoalPart(0)
_PARTS = {"spin": GoalPart.SPIN, "time": GoalPart.TIME, "place": GoalPart.PLACE}
_TIME, _SPIN = 2, slice(3, 5)  # elements of ReturnGoal.vector


@dataclass(frozen=True)
class RelaxationParams:
    """What is given up first, in which steps it is searched for, and how far."""

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
    """What a goal gives up of the asked one.

    Attributes:
        parts: What is given up; NOTHING if the goal is as asked.
        spin: rad/s, by which the spin about y and z is changed.
        time: s, by which the flight time is changed; positive is longer.
        place: m, from the asked landing to the new one.
    """

    parts: GoalPart = NOTHING
    spin: float = 0.0
    time: float = 0.0
    place: float = 0.0

    @classmethod
    def between(cls, asked: ReturnGoal, goal: ReturnGoal, parts: GoalPart) -> Relaxation:
        """Return what `goal` gives up of `asked`."""
        change = goal.vector - asked.vector
        return cls(parts, math.hypot(*change[_SPIN].tolist()), float(change[_TIME]), math.hypot(*change[:2].tolist()))

    def rank(self, order: Sequence[str]) -> int:
        """Return the place of this in an order of preference: one part by the order, then spin together with another part by the order."""
        if self.parts is NOTHING:
            return 0
        together = self.parts & ~GoalPart.SPIN
        if together is NOTHING or self.parts is together:
            return [_PARTS[name] for name in order].index(self.parts)
        return len(order) + [_PARTS[name] for name in order].index(together)

    def __str__(self) -> str:
        """Return it as text, "as asked" if nothing is given up."""
        texts = {
            GoalPart.SPIN: f"spin by {self.spin:.0f} rad/s",
            GoalPart.TIME: f"time by {self.time:+.3f} s",
            GoalPart.PLACE: f"place by {self.place:.3f} m",
        }
        return " and ".join(text for part, text in texts.items() if part in self.parts) or "as asked"


AS_ASKED = Relaxation()


class Return(NamedTuple):
    """A way to return a ball.

    Attributes:
        ball: At the hit.
        goal: That of the stroke.
        stroke: The stroke, or the reason why there is none.
        relaxation: What `goal` gives up of the asked goal.
    """

    ball: BallState
    goal: ReturnGoal
    stroke: Stroke
    relaxation: Relaxation = AS_ASKED


class _Line(NamedTuple):
    """Goals along a line: base + amount / length * change, as vectors of ReturnGoal."""

    part: GoalPart
    base: Array
    change: Array
    length: float  # in the unit of the amounts
    amounts: list[float]  # to try, rising


def _goal_at(line: _Line, amount: float) -> ReturnGoal | None:
    """Return the goal at an amount along a line, None where the part that changes is out of bounds."""
    vector = line.base + amount / line.length * line.change
    x, y, time, _, _ = vector.tolist()
    if line.part is GoalPart.TIME and not SHORTEST_FLIGHT <= time <= LONGEST_FLIGHT:
        return None
    if line.part is GoalPart.PLACE and not (NET_X < x < TABLE_LENGTH and 0.0 < y < TABLE_WIDTH):
        return None
    return ReturnGoal.from_vector(vector)


def _lines(part: GoalPart, ball: BallState, base: Array, params: RelaxationParams) -> list[_Line]:
    """Return the lines along which a part of the goal is given up.

    The spin goes towards that of the ball, which every rubber leaves it, and through none towards the opposite of the asked one.
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
    angles = np.arange(DIRECTIONS) * 2.0 * math.pi / DIRECTIONS
    return [_Line(part, base, np.array([math.cos(a), math.sin(a), 0.0, 0.0, 0.0]), 1.0, amounts) for a in angles]


def _nearest(line: _Line, i: int, ball: BallState, physics: Physics, racket_speed: float) -> tuple[float, ReturnGoal, Stroke] | None:
    """Try the line's amount number i, and if it is feasible halve the last step; return amount, goal and stroke."""
    if i >= len(line.amounts) or (goal := _goal_at(line, line.amounts[i])) is None:
        return None
    stroke = solve(ball, goal, physics, racket_speed=racket_speed)
    if stroke.racket is None:
        return None
    low, best = (line.amounts[i - 1] if i else 0.0), (line.amounts[i], goal, stroke)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + best[0])
        nearer = _goal_at(line, middle)
        if nearer and (stroke := solve(ball, nearer, physics, racket_speed=racket_speed)).racket:
            best = (middle, nearer, stroke)
        else:
            low = middle
    return best


def _least(lines: list[_Line], ball: BallState, physics: Physics, racket_speed: float) -> tuple[ReturnGoal, Stroke] | None:
    """Return the feasible goal with the least amount over all lines, whose amounts rise together, and its stroke."""
    for i in range(max((len(line.amounts) for line in lines), default=0)):
        found = [best for line in lines if (best := _nearest(line, i, ball, physics, racket_speed)) is not None]
        if found:
            _, goal, stroke = min(found, key=lambda one: one[0])
            return goal, stroke
    return None


def relax_part(
    part: str, ball: BallState, goal: ReturnGoal, physics: Physics, params: RelaxationParams, racket_speed: float = math.inf
) -> Return | None:
    """Give up one part of a goal out of reach, as little of it as possible.

    Args:
        part: "spin", "time" or "place".
        ball: At the hit.
        goal: Out of reach.
        physics: Models.
        params: Steps and bounds of the search.
        racket_speed: m/s, highest speed of the racket.

    Returns:
        The nearest feasible return, or None.
    """
    flag = _PARTS[part]
    found = _least(_lines(flag, ball, goal.vector, params), ball, physics, racket_speed)
    return Return(ball, found[0], found[1], Relaxation.between(goal, found[0], flag)) if found else None


def relax_goal(
    ball: BallState, goal: ReturnGoal, physics: Physics, params: RelaxationParams | None = None, racket_speed: float = math.inf
) -> Return:
    """Find the return as asked, or the one that gives up what comes first in the order.

    One part is given up first. If that does not help, and spin may be given up, the other parts are given up with the spin of the ball
    itself, then with no spin.

    Args:
        ball: At the hit.
        goal: As asked.
        physics: Models.
        params: Order, steps and bounds of the search.
        racket_speed: m/s, highest speed of the racket.

    Returns:
        The return. If nothing helps it is as asked, without a racket, with the stroke's reason.
    """
    params = params or RelaxationParams()
    asked = Return(ball, goal, solve(ball, goal, physics, racket_speed=racket_speed))
    if asked.stroke.racket:
        return asked
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
