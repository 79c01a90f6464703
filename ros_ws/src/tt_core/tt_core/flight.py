"""Flight of the ball: gravity, drag and Magnus force (dissertation Section 3.2), integrated up to rounding errors.

The dissertation is "Racket Control and Spinning Ball Measurement for Table Tennis Robot" (Nagoya University); numbers such as (3.1) are its
equations.

The acceleration depends on velocity and spin only, so one Dormand-Prince step of order 5 integrates the velocity and gives the position,
too. With steps of MAX_STEP the position is about 1e-11 m off after a flight.

Kernels take and fill arrays: a state (9,) is position (m), velocity (m/s), spin (rad/s) in frame `table`. They are compiled, allocate
nothing in their loops and do not validate. A division by zero gives inf, because the check for it costs 5 % of the time. Python passes
coefficients to them as one array, to which `air_coefficients` gives names.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit

from .arrays import SPIN, VELOCITY, VX, VY, VZ, WX, WY, WZ, Array, X, Y, Z
from .constants import AIR_DENSITY, BALL_MASS, BALL_RADIUS, GRAVITY
from .errors import check_array
from .params import check, param

MAX_STEP = 0.025  # s, longest step of the integrator
CALM = 1.0  # m/s, below which steps are shorter, see `ease`; with these two the largest error of 10,000 flights is 1.4e-10 m
LEAST_EASE = 0.01  # least share of a full step that `ease` returns

DRAG_UNIT = AIR_DENSITY / BALL_MASS * 0.5 * math.pi * BALL_RADIUS**2  # 1/m for C_D = 1, (3.1)
LIFT_UNIT = AIR_DENSITY / BALL_MASS * 4.0 / 3.0 * math.pi * BALL_RADIUS**3  # dimensionless for C_M = 1, (3.1)


class AirCoefficients(NamedTuple):
    """Coefficients of `Aerodynamics` as the compiled functions take them: those of drag times DRAG_UNIT, those of lift times LIFT_UNIT.

    The acceleration of the ball is -gravity e_z - (drag + drag_h h) |v| v + (lift + lift_h h + lift_ratio / (ratio_offset + S)) w x v, with
    velocity v, spin w, the spin ratio S = r |w| / |v| and h of the dissertation's (3.3), a number from -1 to 1 that depends on the
    directions of velocity and spin. Liu's model (3.1)-(3.3) has lift_ratio = 0.

    Attributes:
        gravity: m/s^2.
        drag: 1/m, a_D of (3.2) times DRAG_UNIT.
        drag_h: 1/m, b_D of (3.2) times DRAG_UNIT.
        lift: a_M of (3.2) times LIFT_UNIT, dimensionless.
        lift_h: b_M of (3.2) times LIFT_UNIT, dimensionless.
        lift_ratio: Numerator of the lift's part that falls with the spin ratio, times LIFT_UNIT, dimensionless.
        ratio_offset: Number that is added to the spin ratio in the denominator of this part.
        spin_decay: 1/s, rate at which the spin decays.
    """

    gravity: float
    drag: float
    drag_h: float
    lift: float
    lift_h: float
    lift_ratio: float
    ratio_offset: float
    spin_decay: float


@njit(cache=True)
def air_coefficients(row: Array) -> AirCoefficients:
    """Give names to the coefficients in the array `Aerodynamics.coefficients` (8,)."""
    return AirCoefficients(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7])


@dataclass(frozen=True)
class Aerodynamics:
    """Model of the forces of the air on the ball, and of gravity.

    The spin ratio is S = r |w| / |v|. h is that of the dissertation's (3.3), a number from -1 to 1 that depends on the directions of
    velocity and spin. The drag coefficient is C_D = drag + drag_h h. The lift coefficient is
    C_M = lift + lift_h h + lift_ratio / (ratio_offset + S). The acceleration is -g - C_D DRAG_UNIT |v| v + C_M LIFT_UNIT w x v (3.1). The
    spin falls exponentially at the rate spin_decay.

    Raises:
        OutOfRange: A coefficient is outside its range.
        NotFinite: A coefficient is NaN or infinite.
    """

    drag: float = param(0.505, "", "drag coefficient a_D of (3.2)", low=0.0, high=2.0)
    drag_h: float = param(0.065, "", "change of the drag coefficient with h of (3.3), b_D of (3.2)", low=-1.0, high=1.0)
    lift: float = param(0.094, "", "lift coefficient a_M of (3.2)", low=-1.0, high=1.0)
    lift_h: float = param(-0.026, "", "change of the lift coefficient with h of (3.3), b_M of (3.2)", low=-1.0, high=1.0)
    lift_ratio: float = param(0.0, "", "numerator of the part of the lift coefficient that falls with the spin ratio", low=-1.0, high=1.0)
    ratio_offset: float = param(1.0, "", "offset of the spin ratio in the denominator of that part", low=0.01, high=10.0)
    spin_decay: float = param(0.0, "1/s", "rate at which the spin decays", low=0.0, high=10.0)
    gravity: float = param(GRAVITY, "m/s^2", "acceleration of gravity", low=0.0, high=30.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)

    @classmethod
    def liu(cls) -> Aerodynamics:
        """Return the model of Liu's dissertation, (3.1)-(3.3)."""
        return cls()

    @classmethod
    def measured(cls) -> Aerodynamics:
        """Return a model fitted to real balls, whose lift falls with the spin ratio S.

        The lift K in K w x v is 1.80e-3 / (0.353 + S), the drag k_d in k_d |v| v is 0.131 1/m, and the spin decays with the time constant
        12.5 s.
        """
        return cls(0.131 / DRAG_UNIT, 0.0, 0.0, 0.0, 1.80e-3 / LIFT_UNIT, 0.353, 1.0 / 12.5)

    @classmethod
    def gravity_only(cls) -> Aerodynamics:
        """Return a model without drag and lift: free fall, as in Fig. 3.12 of the dissertation."""
        return cls(0.0, 0.0, 0.0, 0.0)

    @cached_property
    def coefficients(self) -> Array:
        """All coefficients as one array (8,), in the order of `AirCoefficients`; the form in which Python passes them to kernels."""
        return np.array(
            AirCoefficients(
                gravity=self.gravity,
                drag=self.drag * DRAG_UNIT,
                drag_h=self.drag_h * DRAG_UNIT,
                lift=self.lift * LIFT_UNIT,
                lift_h=self.lift_h * LIFT_UNIT,
                lift_ratio=self.lift_ratio * LIFT_UNIT,
                ratio_offset=self.ratio_offset,
                spin_decay=self.spin_decay,
            )
        )

    def acceleration(self, velocity: Array, spin: Array) -> Array:
        """Return the acceleration of the ball (3.1).

        Args:
            velocity: (3,) m/s in `table`.
            spin: (3,) rad/s in `table`.

        Returns:
            (3,) m/s^2 in `table`.

        Raises:
            BadShape: An array has another shape.
            NotFinite: A number is NaN or infinite.
        """
        out = np.empty(3)
        _accelerate_entry(check_array("velocity", velocity, (3,)), check_array("spin", spin, (3,)), self.coefficients, out)
        return out


@njit(cache=True, error_model="numpy")
def _acceleration(v0: float, v1: float, v2: float, w0: float, w1: float, w2: float, air: AirCoefficients) -> tuple[float, float, float]:
    """Return the acceleration (3.1)-(3.3) for velocity and spin; h = 0 where (3.3) is 0/0: no spin, or spin along the flight."""
    across, flat = v0 * w1 - v1 * w0, v0 * v0 + v1 * v1
    norm = math.sqrt(across * across + flat * w2 * w2)
    h = across / norm if norm > 1e-9 else 0.0
    speed = math.sqrt(flat + v2 * v2)
    drag = (air.drag + air.drag_h * h) * speed
    lift = air.lift + air.lift_h * h
    if air.lift_ratio != 0.0 and speed > 0.0:
        lift += air.lift_ratio / (air.ratio_offset + BALL_RADIUS * math.sqrt(w0 * w0 + w1 * w1 + w2 * w2) / speed)
    return (
        -drag * v0 + lift * (w1 * v2 - w2 * v1),
        -drag * v1 + lift * (w2 * v0 - w0 * v2),
        -drag * v2 + lift * (w0 * v1 - w1 * v0) - air.gravity,
    )


@njit(cache=True, error_model="numpy")
def accelerate(velocity: Array, spin: Array, air: AirCoefficients, out: Array) -> None:
    """Compute the acceleration of the ball, (3.1)-(3.3) of the dissertation.

    Args:
        velocity: (3,) m/s.
        spin: (3,) rad/s.
        air: Coefficients.
        out: (3,) filled with the acceleration, m/s^2.
    """
    out[0], out[1], out[2] = _acceleration(velocity[0], velocity[1], velocity[2], spin[0], spin[1], spin[2], air)


@njit(cache=True, error_model="numpy")
def _accelerate_entry(velocity: Array, spin: Array, air: Array, out: Array) -> None:
    """Call `accelerate` from Python."""
    accelerate(velocity, spin, air_coefficients(air), out)


# Dormand and Prince 1980, RK5(4)7M, the row of order 5
RK_A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
    ]
)
RK_B = np.array([35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84])
RK_C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0])


@njit(cache=True, forceinline=True, error_model="numpy")
def step(state: Array, h: float, air: AirCoefficients, out: Array, work: Array) -> None:
    """Integrate the flight over one step.

    Args:
        state: (9,) position (m), velocity (m/s), spin (rad/s) at the start of the step.
        h: s, length of the step.
        air: Coefficients.
        out: (9,) filled with the state at the end of the step; may be `state` itself.
        work: (8, 3) scratch.
    """
    v0, v1, v2, w0, w1, w2 = state[VX], state[VY], state[VZ], state[WX], state[WY], state[WZ]
    dp0, dp1, dp2, dv0, dv1, dv2, fade = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
    for i in range(6):
        s0, s1, s2 = v0, v1, v2
        for j in range(i):
            a = h * RK_A[i, j]
            s0 += a * work[j, 0]
            s1 += a * work[j, 1]
            s2 += a * work[j, 2]
        if air.spin_decay != 0.0:
            fade = math.exp(-air.spin_decay * RK_C[i] * h)
        a0, a1, a2 = _acceleration(s0, s1, s2, fade * w0, fade * w1, fade * w2, air)
        work[i, 0], work[i, 1], work[i, 2] = a0, a1, a2
        b = h * RK_B[i]
        dp0 += b * s0
        dp1 += b * s1
        dp2 += b * s2
        dv0 += b * a0
        dv1 += b * a1
        dv2 += b * a2
    out[X], out[Y], out[Z] = state[X] + dp0, state[Y] + dp1, state[Z] + dp2
    out[VX], out[VY], out[VZ] = v0 + dv0, v1 + dv1, v2 + dv2
    out[WX], out[WY], out[WZ] = fade * w0, fade * w1, fade * w2


@njit(cache=True, error_model="numpy")
def ease(state: Array, air: AirCoefficients) -> float:
    """Return the factor, LEAST_EASE to 1, by which a step is shortened here so that it is as accurate as a full step elsewhere.

    The factor is below 1 where the spin lies nearly along the flight, because h of (3.3) changes fast there. The denominator of h divided
    by the spin is a velocity. Below CALM the factor is proportional to this velocity.

    Args:
        state: (9,) position (m), velocity (m/s), spin (rad/s).
        air: Coefficients.
    """
    if air.drag_h == 0.0 and air.lift_h == 0.0:
        return 1.0
    across, flat = state[VX] * state[WY] - state[VY] * state[WX], state[VX] * state[VX] + state[VY] * state[VY]
    spin = state[WX] * state[WX] + state[WY] * state[WY] + state[WZ] * state[WZ]
    length = across * across + flat * state[WZ] * state[WZ]
    share = 1.0 if length >= CALM * CALM * spin else math.sqrt(length / spin) / CALM
    return share if share > LEAST_EASE else LEAST_EASE  # also if it is NaN, so that integration with these steps comes to an end


@njit(cache=True, error_model="numpy")
def fly_into(state: Array, duration: float, air: AirCoefficients, max_step: float, out: Array, work: Array) -> None:
    """Integrate the free flight over any duration, without contacts.

    Args:
        state: (9,) position (m), velocity (m/s), spin (rad/s) at the start.
        duration: s, may be negative.
        air: Coefficients.
        max_step: s, longest step.
        out: (9,) filled with the state `duration` later.
        work: (8, 3) scratch.
    """
    out[:] = state
    even = duration / max(1, math.ceil(abs(duration) / max_step - 1e-9))
    left = duration
    while left != 0.0:
        h = even * ease(out, air)
        if abs(h) > abs(left) - 1e-12:
            h = left
        step(out, h, air, out, work)
        left -= h


@njit(cache=True, error_model="numpy")
def fly(state: Array, duration: float, air: Array, max_step: float = MAX_STEP) -> Array:
    """Return the state after a free flight without contacts.

    Args:
        state: (9,) position (m), velocity (m/s), spin (rad/s) at the start.
        duration: s, may be negative.
        air: (8,) `Aerodynamics.coefficients`.
        max_step: s, longest step.

    Returns:
        (9,) the state `duration` later.
    """
    out = np.empty(9)
    fly_into(state, duration, air_coefficients(air), max_step, out, np.empty((8, 3)))
    return out


@njit(cache=True, error_model="numpy")
def crossing_time(state: Array, low: float, high: float, axis: int, level: float, air: AirCoefficients, trial: Array, work: Array) -> float:
    """Find the time within one step at which an element of the state crosses a level.

    Newton's method, limited to the interval from `low` to `high`, works on states that are integrated to each trial time. So the result is
    as accurate as the flight.

    Args:
        state: (9,) position (m), velocity (m/s), spin (rad/s) at the start of the step.
        low: s after `state`, before the crossing.
        high: s after `state`, after the crossing. The signs of state[axis] - level must differ at `low` and `high`.
        axis: Element of the state: X, Y, Z or VZ.
        level: m, or m/s for VZ.
        air: Coefficients.
        trial: (9,) filled with the state at the crossing.
        work: (8, 3) scratch.

    Returns:
        The time of the crossing, s after `state`.
    """
    if low == 0.0:
        trial[:] = state
    else:
        step(state, low, air, trial, work)
    t = low
    falls = trial[axis] > level
    for _ in range(60):
        f = trial[axis] - level
        if (f > 0.0) == falls:
            low = t
        else:
            high = t
        if axis <= Z:
            slope = trial[VX + axis]
        else:
            accelerate(trial[VELOCITY], trial[SPIN], air, work[0])
            slope = work[0, axis - VX]
        new = t - f / slope if slope != 0.0 else high
        if f == 0.0 or abs(new - t) < 1e-15:
            break
        t = new if low <= new <= high else 0.5 * (low + high)
        step(state, t, air, trial, work)
    return t
