"""Find candidate strokes along the predicted path of the ball, best first (an extension of dissertation Section 4.5.1).

A stroke is the racket's position, orientation and velocity at one time that returns the ball. A stroke "as asked" meets the asked goal
exactly; a relaxed one gives up a part of it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from tt_core.arrays import POSITION, SPIN, VELOCITY
from tt_core.errors import BadChoice, check_range
from tt_core.failures import Failure
from tt_core.hit_windows import HIT_WINDOWS, RACKET_SPEED, HitWindow
from tt_core.params import check, param
from tt_core.physics import Physics
from tt_core.states import BallPath, BallState, ReturnGoal

from .failures import StrokeFailure
from .goal_relaxation import SHORTEST_FLIGHT, GoalPart, Relaxation, RelaxationParams, Return, relax_goal
from .sensitivity import StrikeErrorParams, landing_rms
from .stroke import Stroke, solve

MOST_FALLBACK = 16  # largest number of strokes with another flight time: an arm tries ten of them, and corrects to their neighbours
FALLBACK_CORRECTIONS = 5  # of the solver for such a stroke; more are needed only where the spin of the return lies along its flight
FALLBACK_RESIDUAL = 1e-3  # m, landing error of such a stroke; after these corrections 99.9 % of 2,450 had less
MOST_CANDIDATES = 64  # largest number of offered strokes, and of points of a path at which a stroke is solved: a usual ball has 30
EASIEST = 0.35  # share of the window's points; where the PA10 could make most strokes of 18 balls that it could not return as asked
_NEAR = HIT_WINDOWS["near"]


@dataclass(frozen=True)
class InterceptParams:
    """Parameters of the search for strokes: box in which the ball may be hit, points of the path to try, order of the candidates."""

    x_low: float = param(
        _NEAR.x_low,
        "m",
        "lowest x of the ball at the hit; lower than in dissertation Section 4.5.1, because the arm has time for a later strike",
        low=-2.0,
        high=1.0,
    )
    x_high: float = param(_NEAR.x_high, "m", "highest x of the ball at the hit, dissertation Section 4.5.1", low=-2.0, high=1.0)
    y_low: float = param(_NEAR.y_low, "m", "lowest y of the ball at the hit; the arm reaches everything from its base", low=-1.0, high=5.0)
    y_high: float = param(
        _NEAR.y_high, "m", "highest y of the ball at the hit; the arm reaches everything from its base", low=-1.0, high=5.0
    )
    z_low: float = param(_NEAR.z_low, "m", "lowest z of the ball at the hit; the racket's edge clears the table", low=0.0, high=5.0)
    z_high: float = param(
        _NEAR.z_high, "m", "highest z of the ball at the hit; the arm reaches everything from its base", low=0.0, high=5.0
    )
    spacing: float = param(0.012, "s", "time between two points of the path at which a stroke is tried", low=0.001, high=0.2)
    racket_speed: float = param(RACKET_SPEED, "m/s", "highest racket speed of the strokes that are offered to the arm", low=0.1, high=20.0)
    relaxed: int = param(
        4,
        "",
        "points of the path at which a relaxed goal is searched when none gives the goal as asked; 10 ms each at most",
        low=1,
        high=100,
    )
    fallback_time: float = param(
        0.0,
        "s",
        "change of the flight time of further strokes, with the asked spin and without any, for an arm that can make none as asked; "
        "-0.1 s saves the most; 0: none",
        low=-0.4,
        high=0.4,
    )
    as_asked: int = param(6, "", "strokes as asked that are offered before those with another flight time", low=1, high=100)
    landing_rms: float = param(
        0.5,
        "m",
        "landing error under typical strike errors that counts as much in the order of candidates as a racket at racket_speed",
        low=0.01,
        high=1000.0,
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)
        check_range("x_low", self.x_low, -2.0, self.x_high)
        check_range("y_low", self.y_low, -1.0, self.y_high)
        check_range("z_low", self.z_low, 0.0, self.z_high)

    @classmethod
    def window(cls, name: str) -> InterceptParams:
        """Return the default parameters with a named hit window of `tt_core.hit_windows`.

        Args:
            name: "near" is the dissertation's window, extended to later hits. "reachable" is where the PA10 reaches 99 % of random rackets.

        Raises:
            BadChoice: There is no window of that name.
        """
        if name not in HIT_WINDOWS:
            raise BadChoice("window", name, tuple(HIT_WINDOWS))
        return cls.of(HIT_WINDOWS[name])

    @classmethod
    def of(cls, window: HitWindow, racket_speed: float = RACKET_SPEED) -> InterceptParams:
        """Return the default parameters with the hit window and racket speed of an arm file.

        Args:
            window: Box in which the ball may be hit.
            racket_speed: m/s, highest racket speed of the strokes.
        """
        return cls(**asdict(window), racket_speed=racket_speed)


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Candidate strokes that return one ball, and the points of its path at which there is no stroke as asked.

    Attributes:
        strokes: Strokes with a racket, in order of preference.
        refused: For each point of the path at which no stroke meets the goal as asked: the ball at this point, and the reason.
        relaxed: For each stroke, in the same order, what it gives up of the asked goal.
    """

    strokes: tuple[Stroke, ...]
    refused: tuple[tuple[BallState, Failure], ...]
    relaxed: tuple[Relaxation, ...] = ()

    @property
    def reason(self) -> Failure | None:
        """Why there is no stroke: the most frequent reason in `refused`, or NO_HIT_POINT if that is empty; None if there is a stroke."""
        if self.strokes:
            return None
        counts = Counter(failure.code for _, failure in self.refused)
        commonest = max(counts, key=lambda code: counts[code], default=None)
        return next((failure for _, failure in self.refused if failure.code is commonest), Failure(StrokeFailure.NO_HIT_POINT))


def intercept(
    path: BallPath,
    goal: ReturnGoal,
    physics: Physics,
    params: InterceptParams,
    relaxation: RelaxationParams | None = None,
    errors: StrikeErrorParams | None = None,
    *,
    bounced: bool = False,
) -> Candidates:
    """Find the candidate strokes that return the ball.

    Args:
        path: Predicted flight of the ball.
        goal: The asked goal of the return.
        physics: Models of air, table and racket.
        params: Hit window, points that are tried, and weights of the order.
        relaxation: Which parts of the goal are given up if no point of the path has a stroke as asked; None for the default.
        errors: Standard deviations at the hit, from which the landing error of each stroke is computed; None for the default.
        bounced: Whether the ball's bounce on the robot's half was before the path begins.

    Returns:
        The strokes, best first. The first criterion is the given-up part of the goal: as asked comes first, then the order in `relaxation`.
        The second is a sum that is small for a slow racket, because the arm's speed is the scarcest, and for a small landing error. If
        `params.fallback_time` is not 0, strokes with another flight time are inserted after the first `params.as_asked` strokes.
    """
    relaxation, errors = relaxation or RelaxationParams(), errors or StrikeErrorParams()
    balls = hit_points(path, params, bounced)
    tried = as_asked(balls, goal, physics, params)
    returns = [one for one in tried if one.stroke.racket is not None]
    refused = tuple((one.ball, one.stroke.reason) for one in tried if one.stroke.reason is not None)
    if not returns:
        returns = relaxed(tried, physics, params, relaxation)
    returns = ordered(returns, physics, params, relaxation, errors)
    if params.fallback_time and balls:
        returns[params.as_asked : params.as_asked] = with_other_time(balls, goal, physics, params)
        del returns[MOST_CANDIDATES:]
    return Candidates(tuple(one.stroke for one in returns), refused, tuple(one.relaxation for one in returns))


def hit_points(path: BallPath, params: InterceptParams, bounced: bool = False) -> list[BallState]:
    """Return the states of the ball in which it may be hit: after its only bounce and inside the hit window.

    The times of the states are multiples of `params.spacing`, so that newer paths of the same ball have the same times. If there are more
    than MOST_CANDIDATES states, every second, third, ... of them is returned.

    Args:
        path: Predicted flight of the ball.
        params: Hit window and spacing.
        bounced: Whether the only bounce was before the path begins, so that the path must have none.

    Returns:
        The states in the order of time; empty if the path has another number of bounces or does not pass through the window.
    """
    if len(path.bounces) != (0 if bounced else 1):
        return []
    first = path.times[0] if bounced else path.bounces[0].time + params.spacing
    times = params.spacing * np.arange(math.ceil(first / params.spacing), math.ceil(path.times[-1] / params.spacing))
    rows = path.rows(times)
    low, high = (params.x_low, params.y_low, params.z_low), (params.x_high, params.y_high, params.z_high)
    inside = np.flatnonzero(((rows[:, POSITION] >= low) & (rows[:, POSITION] <= high)).all(axis=1))
    inside = inside[:: max(1, math.ceil(len(inside) / MOST_CANDIDATES))]
    return [BallState.trusted(float(times[i]), rows[i, POSITION], rows[i, VELOCITY], rows[i, SPIN]) for i in inside]


def as_asked(balls: Sequence[BallState], goal: ReturnGoal, physics: Physics, params: InterceptParams) -> list[Return]:
    """Solve a stroke that meets the goal as asked for each state of the ball.

    Args:
        balls: States of the ball in which it may be hit.
        goal: The asked goal.
        physics: Models of air, table and racket.
        params: Has the highest racket speed.

    Returns:
        One Return for each ball, with the stroke or the reason why there is none.
    """
    return [Return(ball, goal, solve(ball, goal, physics, racket_speed=params.racket_speed)) for ball in balls]


def with_other_time(balls: Sequence[BallState], goal: ReturnGoal, physics: Physics, params: InterceptParams) -> list[Return]:
    """Find the feasible returns with the flight time changed by `params.fallback_time`, with the asked spin and without spin.

    They are for an arm that can make no stroke as asked. The balls near the share EASIEST of the window come first, because the arm can
    make their strokes most often.

    Args:
        balls: States of the ball in which it may be hit, in the order of time.
        goal: The asked goal.
        physics: Models of air, table and racket.
        params: Change of the flight time, and highest racket speed.

    Returns:
        At most MOST_FALLBACK returns, which all have a stroke.
    """
    time, found = max(SHORTEST_FLIGHT, goal.flight_time + params.fallback_time), list[Return]()
    others = (
        (replace(goal, flight_time=time), GoalPart.TIME),
        (ReturnGoal(goal.landing, time, 0.0, 0.0), GoalPart.TIME | GoalPart.SPIN),
    )
    for i in sorted(range(len(balls)), key=lambda i: abs(i - EASIEST * len(balls))):
        for other, parts in others:
            stroke = solve(balls[i], other, physics, corrections=FALLBACK_CORRECTIONS, racket_speed=params.racket_speed)
            if stroke.racket is not None and stroke.residual < FALLBACK_RESIDUAL:
                found.append(Return(balls[i], other, stroke, Relaxation.between(goal, other, parts)))
        if len(found) >= MOST_FALLBACK:
            break
    return found[:MOST_FALLBACK]


def relaxed(asked: Sequence[Return], physics: Physics, params: InterceptParams, relaxation: RelaxationParams) -> list[Return]:
    """Relax the goal (give up a part of it) for some of the balls, and return the returns that have a stroke.

    Args:
        asked: Balls with the asked goal, as `as_asked` returns them. About `params.relaxed` of them are used, at regular intervals.
        physics: Models of air, table and racket.
        params: Number of balls to use, and highest racket speed.
        relaxation: Order, steps and bounds of what is given up.
    """
    found = (relax_goal(one, physics, relaxation, params.racket_speed) for one in asked[:: max(1, len(asked) // params.relaxed)])
    return [one for one in found if one.stroke.racket is not None]


def ordered(
    returns: Sequence[Return], physics: Physics, params: InterceptParams, relaxation: RelaxationParams, errors: StrikeErrorParams
) -> list[Return]:
    """Sort returns by preference, best first.

    The part of the goal that a return gives up decides first, by the order of `relaxation`; then the sum of the racket's speed over
    `params.racket_speed` and the landing error over `params.landing_rms`.

    Args:
        returns: Each must have a stroke.
        physics: Models of air, table and racket.
        params: Weights of racket speed and landing error.
        relaxation: Order of preference of what is given up.
        errors: Standard deviations at the hit, from which the landing error is computed.
    """

    def cost(one: Return) -> tuple[int, float]:
        assert one.stroke.racket is not None
        speed = math.hypot(*one.stroke.racket.velocity.tolist()) / params.racket_speed
        off = landing_rms(one.ball, one.stroke, one.goal.flight_time, physics, errors) / params.landing_rms
        return one.relaxation.rank(relaxation.order), speed + off

    return sorted(returns, key=cost)
