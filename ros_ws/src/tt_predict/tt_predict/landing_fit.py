"""Coefficients of the air from shots whose state after the hit and whose first bounce are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.optimize import least_squares
from tt_core.arrays import VZ, Array, X, Y, Z
from tt_core.errors import BadShape, TtError, check_array, check_choice
from tt_core.events import LONGEST_PATH
from tt_core.flight import MAX_STEP, crossing, ease, step
from tt_core.physics import Physics, physics_coefficients
from tt_core.states import BallState

from .coefficients import LEAST_SCALE, RANGES, NoFlights, coefficient, with_coefficients

LANDING_SPREADS = {
    "air.drag": 0.3,
    "air.lift_ratio": 0.5,
    "air.ratio_offset": 1.0,
}  # standard deviations before anything is seen, as shares
OTHER_SPREAD = 0.3  # of other coefficients
LOST = 10.0  # m, and s: miss of a ball that does not come down
LEAST_MISS = np.array([1e-4, 1e-4, 1e-5])  # m, m, s: of a residual that is told from rounding
SCALINGS = 3  # fits, each in units of the residuals of the one before


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """Coefficients that were found from shots and their first bounces.

    Attributes:
        physics: The models with the values found.
        names: What was fitted, "air.drag" and the like.
        values: (n,) of these.
        intervals: (n,) half the width of their 95 % intervals.
        errors: m, median distance between predicted and recorded bounces before and after the fit.
    """

    physics: Physics
    names: tuple[str, ...]
    values: Array
    intervals: Array
    errors: tuple[float, float]


class BadLandings(TtError):
    """Shots and bounces that do not belong together."""


@njit(cache=True)
def _land_entry(states: Array, physics: Array, out: Array) -> None:
    """Fill out (n, 3) with x and y in m and the time in s after the start at which balls (n, 9) come down to their contact height.

    Net and edges are no obstacle: the shots are known to have met the table first. NaN for a ball that does not come down.
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
                t += crossing(now, 0.0, h, Z, contact, air, end, work)
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
    """Fit drag and lift to shots whose state after the hit and whose first bounce are known.

    The fit is least squares of place and time of the bounce, each in units of its own median residual, with a loss that grows linearly
    (soft L1), so that wrong pairs count little. Coefficients that the shots hardly determine stay near those of `physics`
    (LANDING_SPREADS). The first bounce does not depend on the table, so nothing about the table can be found here; flights that were seen
    beyond it tell, see `identify`.

    Args:
        states: Each ball after the hit, or an array (n, 9) of position, velocity, spin at the time 0.
        landings: (n, 2) or (n, 3) m, the ball's centre at its first bounce.
        times: (n,) s of these bounces, on the clock of the states.
        physics: The models to start from; None for `Physics.measured()`.
        names: Of the coefficients of the air.

    Returns:
        The coefficients with their intervals.

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
    spreads = shares * np.maximum(np.abs(first), LEAST_SCALE)
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
            return np.concatenate([(misses(x) / scale).ravel(), (x - first) / spreads])

        found = least_squares(residuals, values, bounds=(low, high), x_scale=spreads, loss="soft_l1", diff_step=1e-4, xtol=1e-8)
        values, off = found.x, misses(found.x)
    half = np.zeros(0)
    if len(first):
        rows, r = found.jac[: -len(first)].reshape(count, 3, -1), found.fun[: -len(first)].reshape(count, 3)
        bread = np.linalg.pinv(found.jac.T @ found.jac)
        scores = np.einsum("nkp,nk->np", rows, r * (1.0 + r * r) ** 0.25)  # `jac` is scaled for the loss: these are the gradient
        prior = np.diag((1.0 / spreads) ** 2)
        half = 1.96 * np.sqrt(np.diag(bread @ (scores.T @ scores + prior) @ bread))
    return Identification(with_coefficients(physics, names, values), tuple(names), values, half, (before, distance(off)))
