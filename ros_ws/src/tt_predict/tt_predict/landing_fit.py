"""Identify coefficients of the air from shots for which the ball's state after the hit and its first bounce are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.optimize import least_squares
from tt_core.arrays import VZ, Array, X, Y, Z
from tt_core.errors import BadShape, TtError, check_array, check_choice
from tt_core.events import LONGEST_PATH
from tt_core.flight import MAX_STEP, crossing_time, ease, step
from tt_core.physics import Physics, physics_coefficients
from tt_core.states import BallState

from .coefficients import LEAST_SCALE, RANGES, NoFlights, coefficient, with_coefficients

LANDING_SPREADS = {
    "air.drag": 0.3,
    "air.lift_ratio": 0.5,
    "air.ratio_offset": 1.0,
}  # prior standard deviations, as shares of the coefficients
OTHER_SPREAD = 0.3  # prior standard deviation of other coefficients, as a share
LOST = 10.0  # m and s: residual of a ball that does not come down to the table
LEAST_MISS = np.array([1e-4, 1e-4, 1e-5])  # m, m, s: least unit of the residuals, above their rounding errors
SCALINGS = 3  # number of fits; each uses the median residuals of the previous one as units


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """Coefficients of the air that were identified from shots and their first bounces.

    Attributes:
        physics: Models with the identified values.
        names: Names of the n fitted coefficients, for example "air.drag".
        values: (n,) identified values, in the units of the coefficients.
        intervals: (n,) half the widths of their 95 % confidence intervals.
        errors: Median distance in m between predicted and recorded bounces, before the fit and after it.
    """

    physics: Physics
    names: tuple[str, ...]
    values: Array
    intervals: Array
    errors: tuple[float, float]


class BadLandings(TtError):
    """The numbers of shots, bounces and times differ, or a bounce is not within 5 s after its shot."""


@njit(cache=True)
def _land_entry(states: Array, physics: Array, out: Array) -> None:
    """Fill out (n, 3) with x and y in m and the time in s after the start at which balls (n, 9) come down to the contact height.

    Net and table edges are ignored, because the shots are known to have met the table first. A row is NaN if its ball does not come down.
    """
    models = physics_coefficients(physics)
    air, contact, work, now, end = models.air, models.contact_height, np.empty((8, 3)), np.empty(9), np.empty(9)
    for i in range(len(states)):
        now[:] = states[i]
        out[i] = np.nan
        t = 0.0
        while t < LONGEST_PATH:
            h = MAX_STEP * ease(now, air)
            step(now, h, air, end, work)
            if end[Z] <= contact and end[VZ] < 0.0 and now[Z] > contact:
                t += crossing_time(now, 0.0, h, Z, contact, air, end, work)
                out[i, 0], out[i, 1], out[i, 2] = end[X], end[Y], t
                break
            now[:] = end
            t += h


def identify_landings(
    states: Sequence[BallState] | Array,
    landings: Array,
    times: Array,
    physics: Physics | None = None,
    names: Sequence[str] = ("air.drag", "air.lift_ratio", "air.ratio_offset"),
) -> Identification:
    """Fit coefficients of the air to shots for which the ball's state after the hit and its first bounce are known.

    The residuals of the least squares fit are place and time of the bounce, each in units of its own median residual. The loss function
    grows linearly for large residuals (soft L1), so that wrong pairs have little influence. Coefficients that the shots hardly determine
    stay near those of `physics`, because of the prior standard deviations in LANDING_SPREADS. The first bounce does not depend on the
    coefficients of the table; `identify` fits those, to flights that were recorded beyond the bounce.

    Args:
        states: State of each ball just after the hit; or an array (n, 9) of position m, velocity m/s, spin rad/s in `table` at the time 0.
        landings: (n, 2) or (n, 3) m in `table`, the ball's centre at its first bounce.
        times: (n,) s, times of these bounces, on the clock of the states.
        physics: Models from which the fit starts; None for `Physics.measured()`.
        names: Names of the coefficients of the air to fit.

    Returns:
        The identified coefficients with their confidence intervals.

    Raises:
        NoFlights: There is no pair.
        BadLandings: The numbers of states, landings and times differ, or a bounce is not within LONGEST_PATH after its shot.
        BadShape: An array has another shape.
        NotFinite: A number is NaN or infinite.
        BadChoice: A name is not one of a coefficient of the air.
    """
    physics, count = Physics.measured() if physics is None else physics, len(states)
    if count == 0:
        raise NoFlights
    choices = tuple(name for name in RANGES if name.startswith("air."))
    for name in names:
        check_choice("coefficient", name, choices)
    balls = [ball if isinstance(ball, BallState) else BallState.from_vector(0.0, check_array("state", ball, (9,))) for ball in states]
    starts, seen = np.array([ball.vector for ball in balls]), check_array("landings", landings, (-1, -1))
    if seen.shape[1] not in (2, 3):
        raise BadShape("landings", seen.shape, "(n, 2) or (n, 3)")
    durations = check_array("times", times, (-1,))
    if not len(seen) == len(durations) == count:
        raise BadLandings(f"{count} states, {len(seen)} landings, {len(durations)} times")
    durations = durations - [ball.time for ball in balls]
    if not ((durations > 0.0) & (durations < LONGEST_PATH)).all():
        raise BadLandings(f"bounces {durations.min():g} to {durations.max():g} s after their shots, wanted 0 to {LONGEST_PATH:g}")
    wanted = np.column_stack([seen[:, :2], durations])
    first = np.array([coefficient(physics, name) for name in names])
    shares = np.array([LANDING_SPREADS.get(name, OTHER_SPREAD) for name in names])
    prior_sigmas = shares * np.maximum(np.abs(first), LEAST_SCALE)
    low, high = np.array([RANGES[name] for name in names]).reshape(-1, 2).T

    def misses(values: Array) -> Array:
        out = np.empty((count, 3))
        _land_entry(starts, with_coefficients(physics, names, values).coefficients, out)
        return np.where(np.isfinite(out), out - wanted, LOST)

    def distance(off: Array) -> float:
        return float(np.median(np.linalg.norm(off[:, :2], axis=1)))

    values, off = first, misses(first)
    before = distance(off)
    for _ in range(SCALINGS if len(first) else 0):
        scale = np.maximum(1.4826 * np.median(np.abs(off), axis=0), LEAST_MISS)

        def residuals(x: Array, scale: Array = scale) -> Array:
            return np.concatenate([(misses(x) / scale).ravel(), (x - first) / prior_sigmas])

        found = least_squares(residuals, values, bounds=(low, high), x_scale=prior_sigmas, loss="soft_l1", diff_step=1e-4, xtol=1e-8)
        values, off = found.x, misses(found.x)
    half = np.zeros(0)
    if len(first):
        rows, r = found.jac[: -len(first)].reshape(count, 3, -1), found.fun[: -len(first)].reshape(count, 3)
        bread = np.linalg.pinv(found.jac.T @ found.jac)
        scores = np.einsum("nkp,nk->np", rows, r * (1.0 + r * r) ** 0.25)  # `jac` is scaled for the loss: these are the gradient
        prior = np.diag((1.0 / prior_sigmas) ** 2)
        half = 1.96 * np.sqrt(np.diag(bread @ (scores.T @ scores + prior) @ bread))
    return Identification(with_coefficients(physics, names, values), tuple(names), values, half, (before, distance(off)))
