"""Uncertainty of a predicted ball: propagation of its covariance through flight and bounce by sigma points (sample states).

After a bounce, a ball that grips the table moves so differently from one that slips on it that the usual 2 n sigma points give a covariance
that is wrong by a third. So SIGMA_POINTS sample states are used instead. They are drawn once from the normal distribution with a fixed
seed, and corrected so that their mean and covariance are exact. The exact path of each of them is computed.
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

SIGMA_POINTS = 256  # number of sigma points
SEED = 1  # seed of the points; with it, standard deviations are within 0.6 % of those of 40,000 points in 95 % of 225 cases
_ROWS = 4096  # largest number of points of one path


class UncertaintyFailure(Enum):
    """Why there is no uncertainty at the end of a path."""

    NO_COVARIANCE = "the ball has no covariance"
    NOT_A_COVARIANCE = "covariance has the negative eigenvalue {eigenvalue:g}"
    NOT_IN_THE_AIR = "no ball of this covariance is in the air at {time:g} s"


class NoCovariance(TtError):
    """The ball has no covariance, but one is needed."""

    def __init__(self) -> None:
        super().__init__(UncertaintyFailure.NO_COVARIANCE)


class NotACovariance(TtError):
    """A matrix that should be a covariance has a negative eigenvalue."""

    def __init__(self, eigenvalue: float) -> None:
        """Keep the smallest eigenvalue."""
        super().__init__(UncertaintyFailure.NOT_A_COVARIANCE, eigenvalue=eigenvalue)
        self.eigenvalue = eigenvalue


class NotInTheAir(TtError):
    """A time at which none of the sigma points of a ball is in flight any more, so that there is no covariance."""

    def __init__(self, time: float) -> None:
        """Keep the time in s."""
        super().__init__(UncertaintyFailure.NOT_IN_THE_AIR, time=time)
        self.time = time


@dataclass(frozen=True, slots=True, eq=False)
class Uncertainty:
    """Mean and covariance of time and state of the ball at the end of its path, which a stop rule defines.

    Attributes:
        mean: (10,) time s, position m, velocity m/s, spin rad/s, in `table`.
        covariance: (10, 10) covariance of these, in the squares of these units.
        reached: Share of the sigma points whose paths met the rule, 0 to 1. Mean and covariance are those of these points only.
    """

    mean: Array
    covariance: Array
    reached: float


@njit(cache=True)
def _ends_entry(points: Array, start: float, kind: int, x: float, longest: float, physics: Array, out: Array) -> int:
    """Compute the path of each sigma point up to the stop rule.

    Args:
        points: (n, 9) states at the time `start`.
        start: s.
        kind: Kind of StopCondition.
        x: m, x of StopCondition.
        longest: s, longest duration of StopCondition.
        physics: (19,) `Physics.coefficients`.
        out: (n, 10) output: filled with time and state at the end of those paths that meet the rule.

    Returns:
        The number of paths that meet the rule, and so of filled rows.
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
    """Return (SIGMA_POINTS, 9) points with mean 0 and the unit matrix as covariance, symmetric about 0."""
    half = np.random.default_rng(SEED).standard_normal((SIGMA_POINTS // 2, 9))
    points = np.concatenate([half, -half])
    root = np.linalg.cholesky(points.T @ points / SIGMA_POINTS)
    return np.linalg.solve(root, points.T).T


def sigma_points(ball: BallState) -> Array:
    """Return (SIGMA_POINTS, 9) states (position m, velocity m/s, spin rad/s) whose mean and covariance are exactly those of the ball.

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
    """Predict time and state of the ball at the end of its path, with their covariance.

    Args:
        ball: State in which the path starts, with its covariance.
        physics: Models of air and table.
        stop: Condition at which the path ends.

    Returns:
        Mean and covariance; None if the path of no sigma point meets the condition.

    Raises:
        NoCovariance: The ball has no covariance.
        NotACovariance: Its covariance is not positive semidefinite.
        OutOfRange: The stop time is before the ball's time.
    """
    return _uncertainty(sigma_points(ball), ball.time, physics, stop)


def covariances(ball: BallState, physics: Physics, times: Array) -> Array:
    """Predict the covariance of the ball's state at given times.

    Near the time of the bounce some sigma points (sample states) are before it and some after it, so the variances of velocity and spin are
    large there.

    Args:
        ball: State in which the path starts, with its covariance.
        physics: Models of air and table.
        times: (n,) s, not before the ball's time.

    Returns:
        (n, 9, 9) covariances of position m, velocity m/s, spin rad/s in that order.

    Raises:
        NoCovariance: The ball has no covariance.
        NotACovariance: Its covariance is not positive semidefinite.
        NotInTheAir: At one of the times no sigma point is in flight, or the time is before the ball's.
    """
    times, points, out = check_array("times", times, (-1,)), sigma_points(ball), []
    for time in times:
        found = _uncertainty(points, ball.time, physics, StopRule.at_time(time)) if time >= ball.time else None
        if found is None:
            raise NotInTheAir(float(time))
        out.append(found.covariance[1:, 1:])
    return np.array(out).reshape(-1, 9, 9)


def _uncertainty(points: Array, start: float, physics: Physics, stop: StopRule) -> Uncertainty | None:
    """Return mean and covariance at the stop rule for sigma points (n, 9) that start at the time `start` (s); None if none meets it."""
    ends = np.empty((SIGMA_POINTS, 10))
    n = _ends_entry(points, start, int(stop.kind), stop.value, stop.longest(start), physics.coefficients, ends)
    if n == 0:
        return None
    mean = ends[:n].mean(axis=0)
    off = ends[:n] - mean
    return Uncertainty(mean, off.T @ off / n, n / SIGMA_POINTS)
