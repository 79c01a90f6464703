"""Where and when to hit: candidate strokes along the predicted path, best first (dissertation Section 4.5.1, and past it)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tt_core.errors import check_range
from tt_core.physics import Physics
from tt_core.states import BallPath, BallState, ReturnGoal

from .stroke import Stroke, solve


@dataclass(frozen=True)
class InterceptParams:
    """The window in which the arm can put the racket, and how many points of the path in it are tried."""

    x_low: float = -0.40  # m, a little more than dissertation Section 4.5.1: a later strike is one that the arm has time for
    x_high: float = 0.0  # m, dissertation Section 4.5.1
    y_low: float = 0.25  # m, where the arm reaches everything from its base
    y_high: float = 1.275  # m
    z_low: float = 0.12  # m, the racket's edge clears the table
    z_high: float = 0.55  # m
    spacing: float = 0.012  # s between candidates
    racket_speed: float = 3.5  # m/s, the most that is offered to the arm

    def __post_init__(self) -> None:
        check_range("x_low", self.x_low, -2.0, self.x_high)
        check_range("x_high", self.x_high, self.x_low, 1.0)
        check_range("y_low", self.y_low, -1.0, self.y_high)
        check_range("z_low", self.z_low, 0.0, self.z_high)
        check_range("spacing", self.spacing, 1e-3, 0.2)
        check_range("racket_speed", self.racket_speed, 0.1, 20.0)


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """strokes: solved, in order of preference. refused: for each point of the path that gave none, the ball there and why."""

    strokes: tuple[Stroke, ...]
    refused: tuple[tuple[BallState, str], ...]


def hit_points(path: BallPath, params: InterceptParams) -> list[BallState]:
    """The ball at the times at which it may be hit: after its one bounce, in the window."""
    if len(path.bounces) != 1:
        return []
    times = np.arange(path.bounces[0].time + params.spacing, path.times[-1], params.spacing)
    balls = (path.at(t) for t in times)
    return [
        ball
        for ball in balls
        if params.x_low <= ball.position[0] <= params.x_high
        and params.y_low <= ball.position[1] <= params.y_high
        and params.z_low <= ball.position[2] <= params.z_high
    ]


def intercept(path: BallPath, goal: ReturnGoal, physics: Physics, params: InterceptParams) -> Candidates:
    """Every hit point solved for the goal; slowest racket first, because the arm's speed is what runs out first."""
    strokes, refused = [], []
    for ball in hit_points(path, params):
        stroke = solve(ball, goal, physics)
        speed = np.linalg.norm(stroke.racket.velocity) if stroke.racket else 0.0
        if stroke.reason:
            refused.append((ball, stroke.reason))
        elif speed > params.racket_speed:
            refused.append((ball, f"racket speed {speed:.2f} m/s is over {params.racket_speed:g} m/s"))
        else:
            strokes.append((speed, stroke))
    strokes.sort(key=lambda pair: pair[0])
    return Candidates(tuple(stroke for _, stroke in strokes), tuple(refused))
