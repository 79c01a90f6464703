"""How uncertain a predicted ball is: its covariance carried along the path, through flight and bounce, by sigma points.

Gripping and slipping balls leave the bounce so differently that 2 n sigma points are off by a third behind it. So POINTS balls are taken
instead, evenly spread over the normal distribution (Sobol) and corrected to its exact mean and covariance, each on its own exact path.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numba import njit
from scipy.stats import norm, qmc
from tt_core.errors import TtError, check_array
from tt_core.events import END_STOP, MOST_BOUNCES, walk
from tt_core.physics import Physics
from tt_core.states import Array, BallState

from .rollout import StopRule

POINTS = 256
_ROWS = 4096  # of one path


@dataclass(frozen=True, slots=True, eq=False)
class Uncertainty:
    """Where and when balls of the covariance meet a stop rule.

    mean: (10,) time, position, velocity, spin. covariance: (10, 10). reached: the share of sigma points that met the rule and count.
    """

    mean: Array
    covariance: Array
    reached: float


@njit(cache=True)
def _ends(
    points: Array, start: float, kind: int, value: float, longest: float, air: Array, table: Array, contact: float, out: Array
) -> int:
    """Ends (n, 10) of the paths of points (n, 9) that meet the rule; returns how many do."""
    rows, at, n = np.empty((_ROWS, 10)), np.empty(MOST_BOUNCES, np.int64), 0
    for i in range(len(points)):
        filled, _, ended = walk(start, points[i], longest, kind, value, air, table, contact, rows, at)
        if ended == END_STOP:
            out[n] = rows[filled - 1]
            n += 1
    return n


@cache
def _unit_points() -> Array:
    """(POINTS, 9) of mean 0 and covariance 1, symmetric."""
    half = norm.ppf(qmc.Sobol(9, rng=0).random(POINTS // 2))
    points = np.concatenate([half, -half])
    root = np.linalg.cholesky(points.T @ points / POINTS)
    return np.linalg.solve(root, points.T).T


def sigma_points(ball: BallState) -> Array:
    """(POINTS, 9). Raises TtError for a ball without covariance or with one that is not positive semidefinite."""
    if ball.covariance is None:
        raise TtError("the ball has no covariance")
    values, axes = np.linalg.eigh(0.5 * (ball.covariance + ball.covariance.T))
    if values[0] < -1e-9 * max(1e-12, values[-1]):
        raise TtError(f"covariance has the negative eigenvalue {values[0]:g}")
    return ball.vector + _unit_points() @ (axes * np.sqrt(np.maximum(values, 0.0))).T


def uncertainty(ball: BallState, physics: Physics, stop: StopRule) -> Uncertainty | None:
    """Of `ball` with its covariance where it meets `stop`; None when no sigma point does.

    Raises TtError for a ball without a covariance, or with none that is one, and OutOfRange for a stop time before the ball's.
    """
    return _uncertainty(sigma_points(ball), ball.time, physics, stop)


def covariances(ball: BallState, physics: Physics, times: Array) -> Array:
    """(n, 9, 9) at times (n,) s, not before the ball's: position, velocity, spin in that order.

    At the bounce itself some sigma points are before and some after it, and velocity and spin are spread as much. Raises TtError for times
    that no sigma point reaches, and as `spread`.
    """
    times, points, out = check_array("times", times, (-1,)), sigma_points(ball), []
    for time in times:
        found = _uncertainty(points, ball.time, physics, StopRule.at_time(time)) if time >= ball.time else None
        if found is None:
            raise TtError(f"no ball of this covariance is in the air at {time:g} s")
        out.append(found.covariance[1:, 1:])
    return np.array(out).reshape(-1, 9, 9)


def _uncertainty(points: Array, start: float, physics: Physics, stop: StopRule) -> Uncertainty | None:
    ends = np.empty((POINTS, 10))
    model = physics.air.coefficients, physics.table.coefficients, physics.contact_height
    n = _ends(points, start, stop.kind, stop.value, stop.longest(start), *model, ends)
    if n == 0:
        return None
    mean = ends[:n].mean(axis=0)
    off = ends[:n] - mean
    return Uncertainty(mean, off.T @ off / n, n / POINTS)
