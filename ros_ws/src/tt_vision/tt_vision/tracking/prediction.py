"""State and covariance of the ball at a later time, from the result of the fit to a window of time (`window_fit`).

Linear propagation of the covariance, by derivatives alone, would make it too small in three cases, which are handled here:

- Close to a bounce it is not certain whether the ball has bounced. Its velocity is then that of one of two branches.
- After a bounce, velocity and spin depend on each other by the rebound, which is not linear. What the derivatives miss is added.
- While the spin is not well known, position and velocity depend on the acceleration that the spin causes. It is not linear in the spin:
  from 300 to 600 rad/s it hardly grows. So the possible states lie on a curved surface, and points on this surface replace those on its
  tangent plane. Without this the mean squared errors are twice what the covariance says.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.arrays import VX, VZ, WX, Array, Z
from tt_core.bounce import rebound_table
from tt_core.flight import step
from tt_core.physics import PhysicsCoefficients, physics_coefficients
from tt_core.table_contacts import over_table
from tt_core.tangents import (
    BY_DRAG,
    BY_LIFT,
    DRAG,
    LIFT,
    PARAMETERS,
    REST,
    TangentScratch,
    acceleration_jacobian,
    advance,
    air_with_factors,
    bounce_now,
    scratch,
    start_tangents,
    with_factors,
)

from .window_fit import add_noise, invert

DOUBT = 4.0  # standard deviations of the time of a bounce; within this of the bounce it is not certain whether the ball has bounced
LEAST_VARIANCE_SHARE = 1e-3  # share of the variance of the acceleration before any measurement that is added to its variance after the fit
CORNER = math.sqrt(2.0)  # standard deviations from the mean to each of the 16 points (+-CORNER in four coordinates) of a cubature rule
OUTER_SIGMAS = math.sqrt(
    3.0
)  # standard deviations from the mean to the outer points of the three-point Gauss-Hermite rule, each of weight 1/6


@njit(cache=True)
def _missed_by_derivatives(before: Array, covariance: Array, models: PhysicsCoefficients, spin_noise: float, out: Array) -> None:
    """Compute the part of the covariance of velocity and spin after a bounce that linear propagation misses.

    Args:
        before: (9,) state of the ball just before the bounce.
        covariance: (6, 6) covariance of velocity and spin just before the bounce.
        models: Coefficients; only those of the table are used.
        spin_noise: rad/s, standard deviation of a change of spin at a bounce that no model describes.
        out: (6, 6) filled with this part of the covariance.
    """
    out[:] = 0.0
    for k in range(3):
        out[3 + k, 3 + k] = spin_noise * spin_noise
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    values, axes = np.linalg.eigh(covariance / scale / scale.reshape(-1, 1))
    middle = before[VX:].copy()
    rebound_table(middle[:3], middle[3:], models.table)
    low, high = np.empty(6), np.empty(6)
    for k in range(6):
        point = OUTER_SIGMAS * math.sqrt(max(0.0, values[k])) * axes[:, k] * scale
        low[:], high[:] = before[VX:] - point, before[VX:] + point
        rebound_table(low[:3], low[3:], models.table)
        rebound_table(high[:3], high[3:], models.table)
        bent = low + high - 2.0 * middle  # twice what is not linear, on both sides
        out += bent * bent.reshape(-1, 1) / 12.0


@njit(cache=True)
def _unbounced_or_bounced(
    state: Array,
    before: Array,
    since: float,
    sigma: float,
    covariance: Array,
    models: PhysicsCoefficients,
    space: TangentScratch,
    other_covariance: Array,
) -> float:
    """Compute the other possible state of a ball close to a bounce: not bounced yet instead of bounced, or the other way round.

    Args:
        state: (9,) predicted state of the ball.
        before: (9,) state just before its last bounce.
        since: s since that bounce; infinite if there was none.
        sigma: s, standard deviation of the time of that bounce.
        covariance: (9, 9) covariance of `state`.
        models: Coefficients of air and table.
        space: Work arrays; `space.end` is filled with the other possible state.
        other_covariance: (9, 9) covariance of `before`, replaced by that of the other possible state.

    Returns:
        The probability of the other state; 0 if the ball is not close to a bounce.
    """
    other, contact = space.end, models.contact_height
    if since < DOUBT * sigma:  # it may not have bounced yet
        step(before, since, models.air, other, space.work)
        return 0.5 * math.erfc(since / (sigma * math.sqrt(2.0)))
    height, fall = state[Z] - contact, -state[VZ]
    deviation = math.sqrt(max(0.0, covariance[Z, Z]))
    if fall > REST and -contact < height < DOUBT * deviation and over_table(state):  # it may have bounced already
        ahead = height / fall
        step(state, ahead, models.air, space.trial, space.work)
        space.trial[Z] = contact
        start_tangents(space.tangents)
        _missed_by_derivatives(space.trial, np.ascontiguousarray(covariance[VX:, VX:]), models, 0.0, other_covariance[VX:, VX:])
        missed = other_covariance[VX:, VX:].copy()
        bounce_now(space.trial, space.tangents, models, space)
        jump = np.ascontiguousarray(space.tangents[:, :9])
        other_covariance[:] = jump @ covariance @ jump.T
        other_covariance[VX:, VX:] += missed
        step(space.trial, -ahead, models.air, other, space.work)
        return 0.5 * math.erfc(height / (deviation * math.sqrt(2.0)))
    return 0.0


@njit(cache=True)
def _curve(state: Array, covariance: Array, broad: Array, models: PhysicsCoefficients, space: TangentScratch) -> None:
    """Correct the covariance for the acceleration by the spin, which is not linear in the spin.

    The part of the covariance that belongs to the uncertainty of the spin and of the lift is replaced by that of 16 points. The position
    and velocity of each point are those that agree with its acceleration.

    Args:
        state: (9,) state of the ball.
        covariance: (PARAMETERS, PARAMETERS) of the state and of the logarithms of the factors, changed in place.
        broad: (5,) standard deviations before any measurement: of the three spin components (rad/s), and of the logarithms of the factors
            on drag and lift.
        models: Coefficients, of which those of the air are used, multiplied by the factors.
        space: Work arrays.
    """
    air, jacobian = models.air, space.jacobian
    v, w = state[VX : VX + 3], state[WX : WX + 3]
    a = acceleration_jacobian(v[0], v[1], v[2], w[0], w[1], w[2], air, jacobian)
    here = np.array([a[0], a[1], a[2]])
    slopes = np.zeros((3, PARAMETERS))
    slopes[:, VX : WX + 3] = jacobian[:, :6]
    slopes[:, DRAG], slopes[:, LIFT] = jacobian[:, BY_DRAG], jacobian[:, BY_LIFT]
    across = covariance @ slopes.T  # (PARAMETERS, 3)
    seen = slopes @ across
    unseen = np.zeros((3, 3))
    for r in range(3):
        for c in range(3):
            for k in range(5):
                unseen[r, c] += jacobian[r, 3 + k] * jacobian[c, 3 + k] * broad[k] ** 2
        unseen[r, r] += 1e-6
        seen[r, r] += 1e-9
    gain = across @ invert(seen + LEAST_VARIANCE_SHARE * unseen)
    values, axes = np.linalg.eigh(np.ascontiguousarray(covariance[WX : WX + 3, WX : WX + 3]))
    columns = np.zeros((4, PARAMETERS))
    rest = covariance.copy()
    for k in range(3):
        if values[k] > 0.0:
            columns[k] = np.ascontiguousarray(covariance[:, WX : WX + 3]) @ np.ascontiguousarray(axes[:, k]) / math.sqrt(values[k])
            rest -= columns[k] * columns[k].reshape(-1, 1)
    if rest[LIFT, LIFT] > 0.0:
        columns[3] = rest[:, LIFT] / math.sqrt(rest[LIFT, LIFT])
    for k in range(4):
        covariance -= columns[k] * columns[k].reshape(-1, 1)
    for corner in range(16):
        straight = np.zeros(PARAMETERS)
        for k in range(4):
            straight += CORNER * columns[k] if corner >> k & 1 else -CORNER * columns[k]
        moved = air_with_factors(air, math.exp(straight[DRAG]), math.exp(straight[LIFT]))
        a = acceleration_jacobian(
            v[0] + straight[VX],
            v[1] + straight[VX + 1],
            v[2] + straight[VX + 2],
            w[0] + straight[WX],
            w[1] + straight[WX + 1],
            w[2] + straight[WX + 2],
            moved,
            jacobian,
        )
        point = straight.copy()
        point[:WX] += gain[:WX] @ (np.array([a[0], a[1], a[2]]) - here - slopes @ straight)
        covariance += point * point.reshape(-1, 1) / (16.0 * CORNER**2)


@njit(cache=True)
def predict(
    unknowns: Array, covariance: Array, duration: float, unseen: float, physics: Array, noise: Array, broad: Array
) -> tuple[Array, Array]:
    """Predict the ball at a time after the start of the fitted window, through bounces on the table.

    Args:
        unknowns: (n,) fitted unknowns, see `window_fit`: the state at the start of the window (position m, velocity m/s, spin rad/s), then
            the logarithms of five factors and, if they are estimated, the errors of the cameras.
        covariance: (n, n) covariance of the unknowns.
        duration: s, from the start of the window to the wanted time, not negative.
        unseen: s, from the last measurement to the wanted time; noise is added for this time, none if it is negative.
        physics: (19,) `Physics.coefficients`.
        noise: (3,) what no model describes: power densities of the acceleration ((m/s^2)^2/Hz) and of the change of spin ((rad/s^2)^2/Hz),
            and the standard deviation of the change of spin at a bounce (rad/s).
        broad: (5,) standard deviations before any measurement: of the three spin components (rad/s), and of the logarithms of the factors
            on drag and lift.

    Returns:
        The state (9,) in `table` (position m, velocity m/s, spin rad/s) and its covariance (9, 9).
    """
    models, space = with_factors(physics_coefficients(physics), unknowns), scratch()
    state, tangents, before = unknowns[:9].copy(), np.empty((9, PARAMETERS)), np.empty(9)
    start_tangents(tangents)
    known = np.ascontiguousarray(covariance[:PARAMETERS, :PARAMETERS])
    missed, before_covariance = np.zeros((6, 6)), np.empty((9, 9))
    left, since, sigma = duration, np.inf, 0.0
    while left > 1e-12:
        h, contact = advance(state, tangents, left, models, space)
        left -= h
        since += h
        if contact:
            before[:] = state
            row = tangents[Z].copy() / state[VZ]
            sigma, since = math.sqrt(max(0.0, row @ known @ row)), 0.0
            before_covariance[:] = tangents @ known @ tangents.T
            _missed_by_derivatives(before, np.ascontiguousarray(before_covariance[VX:, VX:]), models, noise[2], missed)
            bounce_now(state, tangents, models, space)
    flow = np.eye(PARAMETERS)
    flow[:9] = tangents
    full = flow @ known @ flow.T
    full = 0.5 * (full + full.T)
    _curve(state, full, broad, models, space)
    out = full[:9, :9].copy()
    add_noise(out, max(0.0, unseen), noise)
    if since < np.inf:
        out[3:, 3:] += missed
        out[:3, 3:] += since * missed[:3]
        out[3:, :3] += since * missed[:, :3]
        out[:3, :3] += since * since * missed[:3, :3]
    share = _unbounced_or_bounced(state, before, since, sigma, out, models, space, before_covariance)
    if share > 0.0:
        if share > 0.5:
            swapped = state.copy()
            state[:] = space.end
            space.end[:] = swapped
            swapped_covariance = out.copy()
            out[:] = before_covariance
            before_covariance[:] = swapped_covariance
            share = 1.0 - share
        apart = space.end - state
        out += share * (before_covariance - out + apart * apart.reshape(-1, 1))
    return state, 0.5 * (out + out.T)
