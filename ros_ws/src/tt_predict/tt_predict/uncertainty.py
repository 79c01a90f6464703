"""Uncertainty of a predicted ball: its covariance carried along the path, through flight and bounce, by sigma points.

A ball that grips leaves the bounce so differently from one that slips that the usual 2 n sigma points are off by a third behind it. So
POINTS balls are taken instead. They are drawn from the normal distribution, always the same, and corrected to its exact mean and
covariance. Each flies on its own exact path.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cache

import numpy as np
from numba import njit
from tt_core.arrays import Array
from tt_core.errors import TtError, check_array
from tt_core.events import END_STOP, MOST_BOUNCES, StopCondition, walk
from tt_core.physics import Physics, physics_coefficients
from tt_core.states import BallState

from .rollout import StopRule

POINTS = 256
SEED = 1  # of the points; standard deviations are then within 0.6 % of those of 40,000 points in 95 % of 225 cases
_ROWS = 4096  # of one path


class UncertaintyFailure(Enum):
    """Why there is no uncertainty at the end of a path."""

    NO_COVARIANCE = "the ball has no covariance"
    NOT_A_COVARIANCE = "covariance has the negative eigenvalue {eigenvalue:g}"
    NOT_IN_THE_AIR = "no ball of this covariance is in the air at {time:g} s"


class NoCovariance(TtError):
    """A ball without a covariance, where one is needed."""

    def __init__(self) -> None:
        super().__init__(UncertaintyFailure.NO_COVARIANCE)


class NotACovariance(TtError):
    """A matrix with a negative eigenvalue, where a covariance is needed."""

    def __init__(self, eigenvalue: float) -> None:
        """Keep the smallest eigenvalue."""
        super().__init__(UncertaintyFailure.NOT_A_COVARIANCE, eigenvalue=eigenvalue)
        self.eigenvalue = eigenvalue


class NotInTheAir(TtError):
    """A time at which no ball of a covariance flies."""

    def __init__(self, time: float) -> None:
        """Keep the time in s."""
        super().__init__(UncertaintyFailure.NOT_IN_THE_AIR, time=time)
        self.time = time


@dataclass(frozen=True, slots=True, eq=False)
class Uncertainty:
    """Where and when balls of the covariance meet a stop rule.

    Attributes:
        mean: (10,) time in s, position, velocity, spin.
        covariance: (10, 10) of these.
        reached: Share of the sigma points that met the rule. The others do not count.
    """

    mean: Array
    covariance: Array
    reached: float


@njit(cache=True)
def _ends_entry(points: Array, start: float, kind: int, x: float, longest: float, physics: Array, out: Array) -> int:
    """Fly each sigma point to the stop rule.

    Args:
        points: (n, 9) states at the time `start`.
        start: s.
        kind: As of StopCondition, like `x` and `longest`.
        x: m.
        longest: s.
        physics: (19,) `Physics.coefficients`.
        out: (n, 10) filled with time and state at the end of those paths that meet the rule.

    Returns:
        How many paths meet the rule.
    """
    stop, model = StopCondition(kind, x, longest), physics_coefficients(physics)
    rows, bounce_rows, n = np.empty((_ROWS, 10)), np.empty(MOST_BOUNCES, np.int64), 0
    for i in range(len(points)):
        filled, _, end = walk(start, points[i], stop, model, rows, bounce_rows)
        if end == END_STOP:
            out[n] = rows[filled - 1]
            n += 1
    return n


@cache
def _unit_points() -> Array:
    """Return (POINTS, 9) points of mean 0 and covariance 1, symmetric about 0."""
    half = np.random.default_rng(SEED).standard_normal((POINTS // 2, 9))
    points = np.concatenate([half, -half])
    root = np.linalg.cholesky(points.T @ points / POINTS)
    return np.linalg.solve(root, points.T).T


def sigma_points(ball: BallState) -> Array:
    """Return (POINTS, 9) states whose mean and covariance are those of the ball.

    Raises:
        NoCovariance: The ball has no covariance.
        NotACovariance: Its covariance is not positive semidefinite.
    """
    if ball.covariance is None:
        raise NoCovariance
    values, axes = np.linalg.eigh(0.5 * (ball.covariance + ball.covariance.T))
    if values[0] < -1e-9 * max(1e-12, values[-1]):
        raise NotACovariance(float(values[0]))
    return ball.vector + _unit_points() @ (axes * np.sqrt(np.maximum(values, 0.0))).T


def uncertainty(ball: BallState, physics: Physics, stop: StopRule) -> Uncertainty | None:
    """Predict where and when the ball meets a stop rule, with the covariance.

    Args:
        ball: Where the path starts, with its covariance.
        physics: Models of air and table.
        stop: The rule.

    Returns:
        Mean and covariance, or None if no sigma point meets the rule.

    Raises:
        NoCovariance: The ball has no covariance.
        NotACovariance: Its covariance is not positive semidefinite.
        OutOfRange: The stop time is before the ball's time.
    """
    return _uncertainty(sigma_points(ball), ball.time, physics, stop)


def covariances(ball: BallState, physics: Physics, times: Array) -> Array:
    """Predict the covariance of the ball at many times.

    At the time of the bounce some sigma points are before it and some after it, so the variances of velocity and spin are large there.

    Args:
        ball: Where the path starts, with its covariance.
        physics: Models of air and table.
        times: (n,) s, not before the ball's time.

    Returns:
        (n, 9, 9) of position, velocity, spin in that order.

    Raises:
        NoCovariance: The ball has no covariance.
        NotACovariance: Its covariance is not positive semidefinite.
        NotInTheAir: No sigma point flies at one of the times.
    """
    times, points, out = check_array("times", times, (-1,)), sigma_points(ball), []
    for time in times:
        found = _uncertainty(points, ball.time, physics, StopRule.at_time(time)) if time >= ball.time else None
        if found is None:
            raise NotInTheAir(float(time))
        out.append(found.covariance[1:, 1:])
    return np.array(out).reshape(-1, 9, 9)


def _uncertainty(points: Array, start: float, physics: Physics, stop: StopRule) -> Uncertainty | None:
    """Return mean and covariance of points (n, 9), which start at `start` (s), where they meet the rule."""
    ends = np.empty((POINTS, 10))
    n = _ends_entry(points, start, int(stop.kind), stop.value, stop.longest(start), physics.coefficients, ends)
    if n == 0:
        return None
    mean = ends[:n].mean(axis=0)
    off = ends[:n] - mean
    return Uncertainty(mean, off.T @ off / n, n / POINTS)
