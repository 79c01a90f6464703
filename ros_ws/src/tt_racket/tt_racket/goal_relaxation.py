"""What to give up when a goal is out of reach: the nearest feasible return by spin, by time or by place, each by its name."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from tt_core.constants import NET_X, TABLE_LENGTH, TABLE_WIDTH
from tt_core.errors import TtError
from tt_core.params import check, param
from tt_core.physics import Physics
from tt_core.states import Array, BallState, ReturnGoal

from .stroke import Stroke, solve

AS_ASKED = "as asked"
HALVINGS = 5  # of the last step of a search
_DIRECTIONS = [(math.cos(a), math.sin(a)) for a in np.arange(8) * math.pi / 4.0]


@dataclass(frozen=True)
class RelaxationParams:
    """order: what is given up first. The steps of a search, and how far it goes."""

    order: tuple[str, ...] = param(
        ("spin", "time", "place"), "", "what of a goal out of reach is given up, in this order", choices=("spin", "time", "place")
    )
    spin_step: float = param(40.0, "rad/s", "", low=1.0, high=1000.0)
    time_step: float = param(0.04, "s", "", low=0.005, high=1.0)
    time_most: float = param(0.4, "s", "longer or shorter", low=0.0, high=2.0)
    place_step: float = param(0.1, "m", "", low=0.01, high=1.0)
    place_most: float = param(0.6, "m", "", low=0.0, high=2.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)
        if len(set(self.order)) != len(self.order) or not set(self.order) <= set(_SEARCHES):
            raise TtError(f"order = {self.order} is not an order of {', '.join(_SEARCHES)}")


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """A return and what it gives up: `name` is "as asked", "spin", "time", "place", or "spin and" one of the others.

    given: as text, how much. goal: that of the stroke.
    """

    name: str
    given: str
    goal: ReturnGoal
    stroke: Stroke


Solver = Callable[[ReturnGoal], Stroke]
Way = tuple[Callable[[float], "ReturnGoal | None"], list[float]]  # a goal for how much is given up, and the amounts to try


def _with_spin(goal: ReturnGoal, spin: Array) -> ReturnGoal:
    return ReturnGoal(goal.landing, goal.flight_time, float(spin[0]), float(spin[1]))


def _by_spin(ball: BallState, goal: ReturnGoal, params: RelaxationParams) -> Iterator[Way]:
    """From the asked spin towards the ball's own, which every rubber leaves it, and towards none and then the opposite."""
    asked = np.array([goal.spin_y, goal.spin_z])
    for end in (ball.spin[1:], -asked):
        length = float(np.linalg.norm(end - asked))
        if length > 0.0:
            amounts = [*np.arange(params.spin_step, length, params.spin_step), length]
            yield lambda amount, end=end, length=length: _with_spin(goal, asked + amount / length * (end - asked)), amounts  # type: ignore[misc]


def _by_time(ball: BallState, goal: ReturnGoal, params: RelaxationParams) -> Iterator[Way]:
    def changed(sign: float, amount: float) -> ReturnGoal | None:
        time = goal.flight_time + sign * amount
        return ReturnGoal(goal.landing, time, goal.spin_y, goal.spin_z) if 0.1 <= time <= 3.0 else None

    amounts = list(np.arange(1, round(params.time_most / params.time_step) + 1) * params.time_step)
    for sign in (-1.0, 1.0):
        yield lambda amount, sign=sign: changed(sign, amount), amounts  # type: ignore[misc]


def _by_place(ball: BallState, goal: ReturnGoal, params: RelaxationParams) -> Iterator[Way]:
    def moved(direction: tuple[float, float], amount: float) -> ReturnGoal | None:
        landing = goal.landing + amount * np.array(direction)
        inside = NET_X < landing[0] < TABLE_LENGTH and 0.0 < landing[1] < TABLE_WIDTH
        return ReturnGoal(landing, goal.flight_time, goal.spin_y, goal.spin_z) if inside else None

    amounts = list(np.arange(1, round(params.place_most / params.place_step) + 1) * params.place_step)
    for direction in _DIRECTIONS:
        yield lambda amount, direction=direction: moved(direction, amount), amounts  # type: ignore[misc]


_SEARCHES = {"spin": _by_spin, "time": _by_time, "place": _by_place}


def _least(ways: list[Way], solver: Solver) -> tuple[float, ReturnGoal, Stroke] | None:
    """The least amount over all ways at which the return is feasible: amounts rise together, the last step is halved."""
    longest = max((len(amounts) for _, amounts in ways), default=0)
    for i in range(longest):
        found = []
        for goal_for, amounts in ways:
            if i >= len(amounts) or (goal := goal_for(amounts[i])) is None or (stroke := solver(goal)).racket is None:
                continue
            low, best = (amounts[i - 1] if i else 0.0), (amounts[i], goal, stroke)
            for _ in range(HALVINGS):
                middle = 0.5 * (low + best[0])
                nearer = goal_for(middle)
                if nearer and (stroke := solver(nearer)).racket:
                    best = (middle, nearer, stroke)
                else:
                    low = middle
            found.append(best)
        if found:
            return min(found, key=lambda one: one[0])
    return None


def _tell(name: str, amount: float, goal: ReturnGoal) -> str:
    if name == "spin":
        return f"{amount:.0f} rad/s to y {goal.spin_y:.0f}, z {goal.spin_z:.0f}"
    if name == "time":
        return f"{goal.flight_time:.3f} s"
    return f"{amount:.3f} m to x {goal.landing[0]:.3f}, y {goal.landing[1]:.3f}"


def choices(
    ball: BallState, goal: ReturnGoal, physics: Physics, params: RelaxationParams | None = None, racket_speed: float = math.inf
) -> tuple[Choice, ...]:
    """For each name in the order, the nearest feasible return to an unfeasible goal that gives up that alone; what has none is left out."""
    params, found = params or RelaxationParams(), []
    for name in params.order:
        ways = list(_SEARCHES[name](ball, goal, params))
        least = _least(ways, lambda one: solve(ball, one, physics, racket_speed=racket_speed))
        if least:
            found.append(Choice(name, _tell(name, least[0], least[1]), least[1], least[2]))
    return tuple(found)


def relax_goal(
    ball: BallState, goal: ReturnGoal, physics: Physics, params: RelaxationParams | None = None, racket_speed: float = math.inf
) -> Choice:
    """The return as asked, or the first of the order that makes it feasible, or, if spin may be given up, the first of the others with the
    ball's own spin or with none.

    racket_speed: m/s, the most there is. Without any, the choice "as asked" with the stroke's reason.
    """
    params = params or RelaxationParams()

    def solver(one: ReturnGoal) -> Stroke:
        return solve(ball, one, physics, racket_speed=racket_speed)

    asked = Choice(AS_ASKED, "nothing", goal, solver(goal))
    if asked.stroke.racket:
        return asked
    bases = [("", "", goal)]
    if "spin" in params.order:
        spins = {"the ball's own spin": ball.spin[1:], "no spin": np.zeros(2)}
        bases += [("spin and ", f"{name}, ", _with_spin(goal, spin)) for name, spin in spins.items()]
    for prefix, told, base in bases:
        for name in params.order:
            if prefix and name == "spin":
                continue
            least = _least(list(_SEARCHES[name](ball, base, params)), solver)
            if least:
                return Choice(prefix + name, told + _tell(name, least[0], least[1]), least[1], least[2])
    return asked
