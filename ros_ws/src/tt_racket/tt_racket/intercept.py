"""Where and when to hit: candidate strokes along the predicted path, best first (dissertation Section 4.5.1, and past it)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from tt_core.errors import TtError, check_range
from tt_core.params import check, param
from tt_core.physics import Physics
from tt_core.states import BallPath, BallState, ReturnGoal

from .goal_relaxation import AS_ASKED, RelaxationParams, relax_goal
from .sensitivity import StrikeErrorParams, landing_rms
from .stroke import Stroke, solve

MOST_CANDIDATES = 64  # points of a path at which a stroke is solved: a usual ball has 30


@dataclass(frozen=True)
class InterceptParams:
    """The window in which the arm can put the racket, and how many points of the path in it are tried."""

    x_low: float = param(-0.40, "m", "a little more than dissertation Section 4.5.1: a later strike is one that the arm has time for")
    x_high: float = param(0.0, "m", "dissertation Section 4.5.1")
    y_low: float = param(0.25, "m", "where the arm reaches everything from its base")
    y_high: float = param(1.275, "m", "")
    z_low: float = param(0.12, "m", "the racket's edge clears the table")
    z_high: float = param(0.55, "m", "")
    spacing: float = param(0.012, "s", "between candidates", low=0.001, high=0.2)
    racket_speed: float = param(3.5, "m/s", "the most that is offered to the arm", low=0.1, high=20.0)
    traded: int = param(4, "", "points at which a return is searched that gives up some of the goal, 10 ms each at most", low=1, high=100)
    landing_rms: float = param(0.5, "m", "as bad in the order of candidates as a racket at racket_speed", low=0.01, high=1000.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)
        check_range("x_low", self.x_low, -2.0, self.x_high)
        check_range("x_high", self.x_high, self.x_low, 1.0)
        check_range("y_low", self.y_low, -1.0, self.y_high)
        check_range("z_low", self.z_low, 0.0, self.z_high)

    @classmethod
    def window(cls, name: str) -> InterceptParams:
        """ "near": the dissertation's, to a later strike; "reachable": where the arm from its base reaches 99 % of random rackets.

        Raises TtError for another name.
        """
        if name not in ("near", "reachable"):
            raise TtError(f"window {name!r} is none of 'near', 'reachable'")
        return cls() if name == "near" else cls(x_low=-0.70, y_low=0.20, y_high=1.325, z_high=0.70)


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """strokes: solved, in order of preference. refused: for each point of the path that did not give the goal as asked, the ball there and
    why. given: for each stroke what of the goal it gives up, AS_ASKED for nothing."""

    strokes: tuple[Stroke, ...]
    refused: tuple[tuple[BallState, str], ...]
    given: tuple[str, ...] = ()


def hit_points(path: BallPath, params: InterceptParams) -> list[BallState]:
    """The ball at the times at which it may be hit: after its one bounce, in the window; at most MOST_CANDIDATES, evenly taken."""
    if len(path.bounces) != 1:
        return []
    times = np.arange(path.bounces[0].time + params.spacing, path.times[-1], params.spacing)
    rows = path.rows(times)
    low, high = (params.x_low, params.y_low, params.z_low), (params.x_high, params.y_high, params.z_high)
    inside = np.flatnonzero(((rows[:, :3] >= low) & (rows[:, :3] <= high)).all(axis=1))
    inside = inside[:: max(1, math.ceil(len(inside) / MOST_CANDIDATES))]
    return [BallState.trusted(float(times[i]), rows[i, :3], rows[i, 3:6], rows[i, 6:]) for i in inside]


def intercept(
    path: BallPath,
    goal: ReturnGoal,
    physics: Physics,
    params: InterceptParams,
    trade: RelaxationParams | None = None,
    errors: StrikeErrorParams | None = None,
) -> Candidates:
    """Every hit point solved for the goal, best first: slow rackets, because the arm's speed is what runs out first, and returns that land
    near the goal in spite of `errors`. When no point gives the goal as asked, `traded` of them give up what `trade` says, and what comes
    first in its order comes first.
    """
    errors, refused = errors or StrikeErrorParams(), []
    order: list[tuple[int, float, Stroke, str]] = []
    balls = hit_points(path, params)

    def cost(ball: BallState, stroke: Stroke, time: float) -> float:
        assert stroke.racket is not None
        speed = math.hypot(*stroke.racket.velocity.tolist()) / params.racket_speed
        return speed + landing_rms(ball, stroke, time, physics, errors) / params.landing_rms

    for ball in balls:
        stroke = solve(ball, goal, physics, racket_speed=params.racket_speed)
        if stroke.racket:
            order.append((0, cost(ball, stroke, goal.flight_time), stroke, AS_ASKED))
        else:
            refused.append((ball, stroke.reason or ""))
    if not order:
        trade = trade or RelaxationParams()
        for ball in balls[:: max(1, len(balls) // params.traded)]:
            choice = relax_goal(ball, goal, physics, trade, params.racket_speed)
            if choice.stroke.racket:
                rank = choice.name.count("and") * len(trade.order) + trade.order.index(choice.name.split()[-1])
                order.append((rank, cost(ball, choice.stroke, choice.goal.flight_time), choice.stroke, f"{choice.name}: {choice.given}"))
    order.sort(key=lambda one: one[:2])
    return Candidates(tuple(one[2] for one in order), tuple(refused), tuple(one[3] for one in order))
