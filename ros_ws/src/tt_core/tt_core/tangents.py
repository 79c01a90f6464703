"""Flight and bounces with exact derivatives of the ball's state by its initial state and by coefficients of air and table.

The variational equations of the flight are integrated with the flight itself, by the same Runge-Kutta step. At a bounce the derivatives
jump: they are changed by the Jacobian of the rebound and by the change of the time of the bounce. Together these are the saltation matrix
of hybrid systems (Leine and Nijmeijer: Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Section 7). In this module the ball
flies through net and floor, and past the edges of the table.

A state (9,) is position (m), velocity (m/s), spin (rad/s) in frame `table`. Derivatives are by the parameters (PARAMETERS,): the initial
state, then the natural logarithms of factors on drag, lift, and the restitution, friction and grip of the table. None of these compiled
functions (kernels) validates its arguments.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from .arrays import SPIN, VELOCITY, VX, VY, VZ, WX, WY, WZ, Array, X, Y, Z
from .bounce import TableCoefficients, rebound_table
from .constants import BALL_RADIUS
from .flight import MAX_STEP, RK_A, RK_B, RK_C, AirCoefficients, accelerate, ease, step
from .physics import PhysicsCoefficients
from .table_contacts import meets_surface, over_table

PARAMETERS = 14
DRAG, LIFT, RESTITUTION, FRICTION, GRIP = range(9, PARAMETERS)  # logarithms of factors, after the state
BY_DRAG, BY_LIFT = 6, 7  # columns of `acceleration_jacobian` after those of velocity and spin
LEAST_SPIN = 5.0  # rad/s: for less spin, the derivatives of h (3.3), which jumps at zero spin, are those at this spin
SUNK = 0.05  # m below the contact; a falling ball over the table that is less deep should have bounced just before
REST = 0.05  # m/s: a slower ball does not bounce any more


class TangentScratch(NamedTuple):
    """Arrays in which the functions of this module keep intermediate results."""

    work: Array  # (8, 3), scratch of the integrator
    trial: Array  # (9,), state at a trial time
    end: Array  # (9,), state at the end of a step
    stages: Array  # (6, 3, PARAMETERS), derivatives of the acceleration at each stage
    stage: Array  # (3, PARAMETERS), derivatives of the velocity at one stage
    jacobian: Array  # (3, 8), of the acceleration by velocity, spin, and the logarithms of drag and lift
    tangents: Array  # (9, PARAMETERS), derivatives of the state by the parameters


@njit(cache=True)
def scratch() -> TangentScratch:
    """Return new arrays for the other functions of this module."""
    return TangentScratch(
        np.empty((8, 3)),
        np.empty(9),
        np.empty(9),
        np.empty((6, 3, PARAMETERS)),
        np.empty((3, PARAMETERS)),
        np.empty((3, 8)),
        np.empty((9, PARAMETERS)),
    )


@njit(cache=True)
def air_with_factors(air: AirCoefficients, drag: float, lift: float) -> AirCoefficients:
    """Return the coefficients of the air with its drag and its lift multiplied by factors.

    Args:
        air: Coefficients.
        drag: Factor on the drag.
        lift: Factor on the lift.
    """
    return AirCoefficients(
        air.gravity,
        air.drag * drag,
        air.drag_h * drag,
        air.lift * lift,
        air.lift_h * lift,
        air.lift_ratio * lift,
        air.ratio_offset,
        air.spin_decay,
    )


@njit(cache=True)
def with_factors(physics: PhysicsCoefficients, parameters: Array) -> PhysicsCoefficients:
    """Return the coefficients of air and table multiplied by factors; those of the racket stay.

    Args:
        physics: Coefficients.
        parameters: (PARAMETERS,) whose elements DRAG to GRIP are the natural logarithms of the factors.
    """
    table = physics.table
    return PhysicsCoefficients(
        air_with_factors(physics.air, math.exp(parameters[DRAG]), math.exp(parameters[LIFT])),
        TableCoefficients(
            table.restitution * math.exp(parameters[RESTITUTION]),
            table.friction * math.exp(parameters[FRICTION]),
            table.grip * math.exp(parameters[GRIP]),
        ),
        physics.racket,
        physics.contact_height,
    )


@njit(cache=True, error_model="numpy")
def acceleration_jacobian(
    v0: float, v1: float, v2: float, w0: float, w1: float, w2: float, air: AirCoefficients, out: Array
) -> tuple[float, float, float]:
    """Compute the acceleration of the ball, (3.1)-(3.3) of the dissertation, and its derivatives.

    Args:
        v0: m/s, velocity along x.
        v1: m/s, velocity along y.
        v2: m/s, velocity along z.
        w0: rad/s, spin about x.
        w1: rad/s, spin about y.
        w2: rad/s, spin about z.
        air: Coefficients.
        out: (3, 8) filled with the derivatives by velocity, spin, and the logarithms of factors on drag and lift.

    Returns:
        The three components of the acceleration, m/s^2.
    """
    across, flat = v0 * w1 - v1 * w0, v0 * v0 + v1 * v1
    norm2 = across * across + flat * w2 * w2
    norm, speed2 = math.sqrt(norm2), flat + v2 * v2
    speed = math.sqrt(speed2)
    spin = math.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    h = across / norm if norm > 1e-9 else 0.0
    lift, ratio = air.lift + air.lift_h * h, 0.0
    dratio = 0.0  # of the lift by the spin ratio
    if air.lift_ratio != 0.0 and speed > 0.0:
        ratio = BALL_RADIUS * spin / speed
        part = air.lift_ratio / (air.ratio_offset + ratio)
        lift += part
        dratio = -part / (air.ratio_offset + ratio)
    drag = air.drag + air.drag_h * h
    c0, c1, c2 = w1 * v2 - w2 * v1, w2 * v0 - w0 * v2, w0 * v1 - w1 * v0
    out[0, BY_DRAG], out[1, BY_DRAG], out[2, BY_DRAG] = -drag * speed * v0, -drag * speed * v1, -drag * speed * v2
    out[0, BY_LIFT], out[1, BY_LIFT], out[2, BY_LIFT] = lift * c0, lift * c1, lift * c2
    h_scale = 0.0
    if air.drag_h != 0.0 or air.lift_h != 0.0:
        bounded = max(norm, LEAST_SPIN * speed)
        h_scale = w2 / (bounded * bounded * bounded) if bounded > 0.0 else 0.0
    for k in range(3):
        # derivatives of h: of `across`, and of its norm
        if k == 0:
            hv, hw = h_scale * (flat * w2 * w1 - across * w2 * v0), h_scale * (-flat * w2 * v1)
            v, w = v0, w0
        elif k == 1:
            hv, hw = h_scale * (-flat * w2 * w0 - across * w2 * v1), h_scale * (flat * w2 * v0)
            v, w = v1, w1
        else:
            hv, hw = 0.0, -h_scale * across * flat
            v, w = v2, w2
        by_v = air.lift_h * hv - dratio * ratio * v / speed2 if speed2 > 0.0 else 0.0
        by_w = air.lift_h * hw + (dratio * BALL_RADIUS * w / (spin * speed) if spin > 0.0 and speed > 0.0 else 0.0)
        drag_v = drag * v / speed if speed > 0.0 else 0.0
        drag_v += air.drag_h * hv * speed
        drag_w = air.drag_h * hw * speed
        out[0, k], out[1, k], out[2, k] = c0 * by_v - v0 * drag_v, c1 * by_v - v1 * drag_v, c2 * by_v - v2 * drag_v
        out[0, 3 + k], out[1, 3 + k], out[2, 3 + k] = c0 * by_w - v0 * drag_w, c1 * by_w - v1 * drag_w, c2 * by_w - v2 * drag_w
        out[k, k] -= drag * speed
    # w x v by v is [w]x, by w it is -[v]x
    out[0, 1] -= lift * w2
    out[0, 2] += lift * w1
    out[1, 0] += lift * w2
    out[1, 2] -= lift * w0
    out[2, 0] -= lift * w1
    out[2, 1] += lift * w0
    out[0, 4] += lift * v2
    out[0, 5] -= lift * v1
    out[1, 3] -= lift * v2
    out[1, 5] += lift * v0
    out[2, 3] += lift * v1
    out[2, 4] -= lift * v0
    return -drag * speed * v0 + lift * c0, -drag * speed * v1 + lift * c1, -drag * speed * v2 + lift * c2 - air.gravity


@njit(cache=True, error_model="numpy")
def _step(state: Array, tangents: Array, h: float, air: AirCoefficients, space: TangentScratch) -> None:
    """Integrate one step of h seconds in place, as `tt_core.flight.step` does, with the derivatives tangents (9, PARAMETERS)."""
    v0, v1, v2, w0, w1, w2 = state[VX], state[VY], state[VZ], state[WX], state[WY], state[WZ]
    work, stages, stage, jacobian = space.work, space.stages, space.stage, space.jacobian
    dp0, dp1, dp2, dv0, dv1, dv2, fade = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
    position = tangents[0:3]
    velocity = tangents[3:6]
    spin = tangents[6:9]
    for i in range(6):
        s0, s1, s2 = v0, v1, v2
        stage[:] = velocity
        for j in range(i):
            a = h * RK_A[i, j]
            s0 += a * work[j, 0]
            s1 += a * work[j, 1]
            s2 += a * work[j, 2]
            for r in range(3):
                for c in range(PARAMETERS):
                    stage[r, c] += a * stages[j, r, c]
        if air.spin_decay != 0.0:
            fade = math.exp(-air.spin_decay * RK_C[i] * h)
        a0, a1, a2 = acceleration_jacobian(s0, s1, s2, fade * w0, fade * w1, fade * w2, air, jacobian)
        work[i, 0], work[i, 1], work[i, 2] = a0, a1, a2
        b = h * RK_B[i]
        for r in range(3):
            jv0, jv1, jv2 = jacobian[r, 0], jacobian[r, 1], jacobian[r, 2]
            jw0, jw1, jw2 = fade * jacobian[r, 3], fade * jacobian[r, 4], fade * jacobian[r, 5]
            for c in range(PARAMETERS):
                stages[i, r, c] = (
                    jv0 * stage[0, c] + jv1 * stage[1, c] + jv2 * stage[2, c] + jw0 * spin[0, c] + jw1 * spin[1, c] + jw2 * spin[2, c]
                )
                position[r, c] += b * stage[r, c]
            stages[i, r, DRAG] += jacobian[r, BY_DRAG]
            stages[i, r, LIFT] += jacobian[r, BY_LIFT]
        dp0 += b * s0
        dp1 += b * s1
        dp2 += b * s2
        dv0 += b * a0
        dv1 += b * a1
        dv2 += b * a2
    for i in range(6):
        b = h * RK_B[i]
        for r in range(3):
            for c in range(PARAMETERS):
                velocity[r, c] += b * stages[i, r, c]
    for r in range(3):
        for c in range(PARAMETERS):
            spin[r, c] *= fade
    state[X], state[Y], state[Z] = state[X] + dp0, state[Y] + dp1, state[Z] + dp2
    state[VX], state[VY], state[VZ] = v0 + dv0, v1 + dv1, v2 + dv2
    state[WX], state[WY], state[WZ] = fade * w0, fade * w1, fade * w2


@njit(cache=True, error_model="numpy")
def _bounce(state: Array, tangents: Array, physics: PhysicsCoefficients, space: TangentScratch) -> None:
    """Let a ball in contact bounce, in place, with the derivatives tangents (9, PARAMETERS)."""
    air, table, decay = physics.air, physics.table, physics.air.spin_decay
    before, after = space.work[6], space.work[7]
    accelerate(state[VELOCITY], state[SPIN], air, before)
    vx, vy, vz, wx, wy, wz = state[VX], state[VY], state[VZ], state[WX], state[WY], state[WZ]
    rebound_table(state[VELOCITY], state[SPIN], table)
    accelerate(state[VELOCITY], state[SPIN], air, after)
    ux, uy = vx - BALL_RADIUS * wy, vy + BALL_RADIUS * wx
    slip = math.sqrt(ux * ux + uy * uy)
    grips = slip == 0.0 or 0.4 * table.grip <= table.friction * (1.0 + table.restitution) * abs(vz) / slip
    share = 0.4 * table.grip if grips else table.friction * (1.0 + table.restitution) * abs(vz) / slip
    turn = 1.5 / BALL_RADIUS
    for c in range(PARAMETERS):
        late = -tangents[Z, c] / vz  # change of the time of the bounce
        dvx, dvy, dvz = tangents[VX, c] + late * before[0], tangents[VY, c] + late * before[1], tangents[VZ, c] + late * before[2]
        dwx, dwy, dwz = tangents[WX, c] - late * decay * wx, tangents[WY, c] - late * decay * wy, tangents[WZ, c] - late * decay * wz
        dux, duy = dvx - BALL_RADIUS * dwy, dvy + BALL_RADIUS * dwx
        if grips:
            dshare = share if c == GRIP else 0.0
        else:
            dshare = share * (dvz / vz - (ux * dux + uy * duy) / (slip * slip))
            if c == FRICTION:
                dshare += share
            elif c == RESTITUTION:
                dshare += share * table.restitution / (1.0 + table.restitution)
        rise = -table.restitution * (dvz + (vz if c == RESTITUTION else 0.0))
        px, py = dshare * ux + share * dux, dshare * uy + share * duy
        tangents[X, c] += late * (vx - state[VX])
        tangents[Y, c] += late * (vy - state[VY])
        tangents[Z, c] = -late * state[VZ]
        tangents[VX, c] = dvx - px - late * after[0]
        tangents[VY, c] = dvy - py - late * after[1]
        tangents[VZ, c] = rise - late * after[2]
        tangents[WX, c] = dwx - turn * py + late * decay * state[WX]
        tangents[WY, c] = dwy + turn * px + late * decay * state[WY]
        tangents[WZ, c] = dwz + late * decay * state[WZ]


@njit(cache=True)
def advance(state: Array, tangents: Array, longest: float, physics: PhysicsCoefficients, space: TangentScratch) -> tuple[float, bool]:
    """Let the ball fly one step, or to its next bounce if that comes first; change state and derivatives in place.

    Args:
        state: (9,) position (m), velocity (m/s), spin (rad/s) of the ball.
        tangents: (9, PARAMETERS) derivatives of the state by the parameters.
        longest: s, longest step, positive.
        physics: Coefficients of air and table, already multiplied by all factors.
        space: TangentScratch arrays.

    Returns:
        The duration in s, and whether the ball now touches the table, so that `bounce_now` must be called. The duration is negative for a
        ball that is already below its contact with the table: it goes back to the contact.
    """
    air, contact = physics.air, physics.contact_height
    if contact - SUNK < state[Z] < contact and state[VZ] < -REST and over_table(state):
        h = (contact - state[Z]) / state[VZ]
        for _ in range(3):
            step(state, h, air, space.trial, space.work)
            h -= (space.trial[Z] - contact) / space.trial[VZ]
        _step(state, tangents, h, air, space)
        return h, True
    h = min(MAX_STEP * ease(state, air), longest)
    step(state, h, air, space.end, space.work)
    if space.end[Z] <= contact or state[VZ] < 0.0 < space.end[VZ]:
        at = meets_surface(state, space.end, h, contact, air, space.trial, space.work)
        if at <= h and space.trial[VZ] < -REST:
            _step(state, tangents, at, air, space)
            return at, True
    _step(state, tangents, h, air, space)
    return h, False


@njit(cache=True)
def bounce_now(state: Array, tangents: Array, physics: PhysicsCoefficients, space: TangentScratch) -> None:
    """Let the ball bounce that `advance` has brought to the table; change state and derivatives in place.

    Args:
        state: (9,) position (m), velocity (m/s), spin (rad/s) of the ball.
        tangents: (9, PARAMETERS) derivatives of the state by the parameters.
        physics: Coefficients of air and table, already multiplied by all factors.
        space: TangentScratch arrays.
    """
    state[Z] = physics.contact_height
    _bounce(state, tangents, physics, space)


@njit(cache=True)
def fly_through(state: Array, tangents: Array, duration: float, physics: PhysicsCoefficients, space: TangentScratch) -> int:
    """Let the ball fly and bounce for a given duration; change state and derivatives in place.

    Args:
        state: (9,) position (m), velocity (m/s), spin (rad/s) of the ball.
        tangents: (9, PARAMETERS) derivatives of the state by the parameters.
        duration: s, not negative.
        physics: Coefficients of air and table, already multiplied by all factors.
        space: TangentScratch arrays.

    Returns:
        The number of bounces.
    """
    left, bounces = duration, 0
    while left > 1e-12:
        h, contact = advance(state, tangents, left, physics, space)
        left -= h
        if contact:
            bounce_now(state, tangents, physics, space)
            bounces += 1
    return bounces


@njit(cache=True)
def start_tangents(tangents: Array) -> None:
    """Fill tangents (9, PARAMETERS) with the derivatives at the start: 1 for each state by itself, 0 for all others."""
    tangents[:] = 0.0
    for k in range(9):
        tangents[k, k] = 1.0
