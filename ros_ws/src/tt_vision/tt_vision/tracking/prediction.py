"""The ball at a time, with an honest covariance, from the unknowns of a fitted window.

Derivatives alone would give a covariance that is too small in three places. Close to a bounce it is not certain whether the ball has
bounced yet, and its velocity is that of one of two branches. Behind a bounce, velocity and spin are bound to each other by the rebound,
which is not linear: what the derivatives miss of it is added. And while the spin is not well known, place and velocity are bound to the
acceleration that this spin makes, which is not linear in it: it hardly grows any more from 300 to 600 rad/s. So errors lie on a curved
surface; points on that surface replace those on its tangent plane. Without them the squared errors are twice what the covariance says.
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
    DRAG,
    LIFT,
    PARAMETERS,
    REST,
    Scratch,
    acceleration_jacobian,
    advance,
    air_with_factors,
    bounce_now,
    scratch,
    start_tangents,
    with_factors,
)

from .window_fit import add_noise, invert

DOUBT = 4.0  # standard deviations of the time of a bounce, within which it is not certain whether the ball has bounced
LITTLE = 1e-3  # of the spread of accelerations before anything is seen: what is known better than that does not count
CORNER = math.sqrt(2.0)  # standard deviations of each of four coordinates at the corners of a cube; the rest of the weight is in its middle
SIDES = math.sqrt(3.0)  # standard deviations, of the outer points of the Gauss-Hermite rule with three points, each of weight 1/6


@njit(cache=True)
def _missed_by_derivatives(before: Array, spread: Array, models: PhysicsCoefficients, spin_noise: float, out: Array) -> None:
    """Fill out (6, 6) with the covariance of velocity and spin after a bounce that derivatives miss.

    Args:
        before: (9,) just before the bounce.
        spread: (6, 6) covariance of velocity and spin there.
        models: Of the table.
        spin_noise: rad/s, standard deviation of a change of spin that no model knows.
        out: Filled.
    """
    out[:] = 0.0
    for k in range(3):
        out[3 + k, 3 + k] = spin_noise * spin_noise
    scale = np.sqrt(np.maximum(np.diag(spread), 1e-30))
    values, axes = np.linalg.eigh(spread / scale / scale.reshape(-1, 1))
    middle = before[VX:].copy()
    rebound_table(middle[:3], middle[3:], models.table)
    low, high = np.empty(6), np.empty(6)
    for k in range(6):
        point = SIDES * math.sqrt(max(0.0, values[k])) * axes[:, k] * scale
        low[:], high[:] = before[VX:] - point, before[VX:] + point
        rebound_table(low[:3], low[3:], models.table)
        rebound_table(high[:3], high[3:], models.table)
        bent = low + high - 2.0 * middle  # twice what is not linear, on both sides
        out += bent * bent.reshape(-1, 1) / 12.0


@njit(cache=True)
def _unbounced_or_bounced(
    state: Array, before: Array, since: float, sigma: float, spread: Array, models: PhysicsCoefficients, space: Scratch, other_spread: Array
) -> float:
    """Find the other branch of a ball close to a bounce.

    Args:
        state: (9,) of the ball.
        before: (9,) just before its last bounce.
        since: s since then, inf without a bounce.
        sigma: s, standard deviation of the time of that bounce.
        spread: (9, 9) covariance of `state`.
        models: Of air and table.
        space: Its `end` is filled with the other branch.
        other_spread: (9, 9) covariance of `before`; becomes that of the other branch.

    Returns:
        The probability of the other branch.
    """
    other, contact = space.end, models.contact_height
    if since < DOUBT * sigma:  # it may not have bounced yet
        step(before, since, models.air, other, space.work)
        return 0.5 * math.erfc(since / (sigma * math.sqrt(2.0)))
    height, fall = state[Z] - contact, -state[VZ]
    deviation = math.sqrt(max(0.0, spread[Z, Z]))
    if fall > REST and -contact < height < DOUBT * deviation and over_table(state):  # it may have bounced already
        ahead = height / fall
        step(state, ahead, models.air, space.trial, space.work)
        space.trial[Z] = contact
        start_tangents(space.tangents)
        _missed_by_derivatives(space.trial, np.ascontiguousarray(spread[VX:, VX:]), models, 0.0, other_spread[VX:, VX:])
        missed = other_spread[VX:, VX:].copy()
        bounce_now(space.trial, space.tangents, models, space)
        jump = np.ascontiguousarray(space.tangents[:, :9])
        other_spread[:] = jump @ spread @ jump.T
        other_spread[VX:, VX:] += missed
        step(space.trial, -ahead, models.air, other, space.work)
        return 0.5 * math.erfc(height / (deviation * math.sqrt(2.0)))
    return 0.0


@njit(cache=True)
def _curve(state: Array, covariance: Array, broad: Array, models: PhysicsCoefficients, space: Scratch) -> None:
    """Replace the spread along the spin and the lift by that of points whose place and velocity go with their acceleration, in place.

    Args:
        state: (9,) of the ball.
        covariance: (PARAMETERS, PARAMETERS) of state and factors.
        broad: (5,) standard deviations of spin (3,), and of the logarithms of drag and lift, before anything is seen.
        models: Of air, with all factors.
        space: Scratch.
    """
    air, jacobian = models.air, space.jacobian
    v, w = state[VX : VX + 3], state[WX : WX + 3]
    a = acceleration_jacobian(v[0], v[1], v[2], w[0], w[1], w[2], air, jacobian)
    here = np.array([a[0], a[1], a[2]])
    slopes = np.zeros((3, PARAMETERS))
    slopes[:, VX : WX + 3] = jacobian[:, :6]
    slopes[:, DRAG], slopes[:, LIFT] = jacobian[:, 6], jacobian[:, 7]
    across = covariance @ slopes.T  # (PARAMETERS, 3)
    seen = slopes @ across
    unseen = np.zeros((3, 3))
    for r in range(3):
        for c in range(3):
            for k in range(5):
                unseen[r, c] += jacobian[r, 3 + k] * jacobian[c, 3 + k] * broad[k] ** 2
        unseen[r, r] += 1e-6
        seen[r, r] += 1e-9
    gain = across @ invert(seen + LITTLE * unseen)
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
    """Return state (9,) and covariance (9, 9) of the ball later.

    Args:
        unknowns: (n,) at the start of the window.
        covariance: (n, n) of them.
        duration: s after the start of the window, not negative.
        unseen: s, of this, since the last measurement.
        physics: (19,) `Physics.coefficients`.
        noise: (3,) power densities of acceleration and of change of spin, and rad/s, the change of spin at a bounce that no model knows.
        broad: (5,) see `_curve`.
    """
    models, space = with_factors(physics_coefficients(physics), unknowns), scratch()
    state, tangents, before = unknowns[:9].copy(), np.empty((9, PARAMETERS)), np.empty(9)
    start_tangents(tangents)
    known = np.ascontiguousarray(covariance[:PARAMETERS, :PARAMETERS])
    missed, before_spread = np.zeros((6, 6)), np.empty((9, 9))
    left, since, sigma = duration, np.inf, 0.0
    while left > 1e-12:
        h, contact = advance(state, tangents, left, models, space)
        left -= h
        since += h
        if contact:
            before[:] = state
            row = tangents[Z].copy() / state[VZ]
            sigma, since = math.sqrt(max(0.0, row @ known @ row)), 0.0
            before_spread[:] = tangents @ known @ tangents.T
            _missed_by_derivatives(before, np.ascontiguousarray(before_spread[VX:, VX:]), models, noise[2], missed)
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
    share = _unbounced_or_bounced(state, before, since, sigma, out, models, space, before_spread)
    if share > 0.0:
        if share > 0.5:
            swapped = state.copy()
            state[:] = space.end
            space.end[:] = swapped
            swapped_spread = out.copy()
            out[:] = before_spread
            before_spread[:] = swapped_spread
            share = 1.0 - share
        apart = space.end - state
        out += share * (before_spread - out + apart * apart.reshape(-1, 1))
    return state, 0.5 * (out + out.T)
