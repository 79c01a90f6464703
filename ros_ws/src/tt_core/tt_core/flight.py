"""The ball in the air: gravity, drag and Magnus force (dissertation Section 3.2), integrated to rounding error.

The acceleration depends on velocity and spin only, so one Dormand-Prince step of order 5 on the velocity carries the position with it.
At MAX_STEP its error is about 1e-11 m over a flight. Kernels take and fill plain arrays, state = (9,) position, velocity, spin;
they are compiled, allocation-free in the loop and do not validate; a division by zero gives inf: the check for it costs 5 % of the time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from .constants import AIR_DENSITY, BALL_MASS, BALL_RADIUS, GRAVITY
from .errors import check_array
from .params import check, param
from .states import Array

MAX_STEP = 0.025  # s, of the integrator
CALM = 1.0  # m/s, below which steps shrink, see `ease`; with these two the largest error of 10,000 flights is 1.4e-10 m
LEAST_EASE = 0.01  # of a step

DRAG_UNIT = AIR_DENSITY / BALL_MASS * 0.5 * math.pi * BALL_RADIUS**2  # 1/m for C_D = 1, (3.1)
LIFT_UNIT = AIR_DENSITY / BALL_MASS * 4.0 / 3.0 * math.pi * BALL_RADIUS**3  # dimensionless for C_M = 1, (3.1)


@dataclass(frozen=True)
class Aerodynamics:
    """Coefficients of the air.

    Drag C_D = drag + drag_h h, lift C_M = lift + lift_h h + lift_ratio / (ratio_offset + S), with h of (3.3) and the spin ratio
    S = r |w| / |v|; acceleration -g - C_D DRAG_UNIT |v| v + C_M LIFT_UNIT w x v (3.1); spin falls with rate spin_decay.
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
        """The dissertation's (3.1)-(3.3)."""
        return cls()

    @classmethod
    def measured(cls) -> Aerodynamics:
        """Fitted to real balls: K = 1.80e-3 / (0.353 + S), k_d = 0.131 1/m, spin time constant 12.5 s."""
        return cls(0.131 / DRAG_UNIT, 0.0, 0.0, 0.0, 1.80e-3 / LIFT_UNIT, 0.353, 1.0 / 12.5)

    @classmethod
    def gravity_only(cls) -> Aerodynamics:
        """The free falling ball of Fig. 3.12."""
        return cls(0.0, 0.0, 0.0, 0.0)

    @cached_property
    def coefficients(self) -> Array:
        """(8,) for the kernels, units applied."""
        d, m = DRAG_UNIT, LIFT_UNIT
        return np.array(
            [
                self.gravity,
                self.drag * d,
                self.drag_h * d,
                self.lift * m,
                self.lift_h * m,
                self.lift_ratio * m,
                self.ratio_offset,
                self.spin_decay,
            ]
        )

    def acceleration(self, velocity: Array, spin: Array) -> Array:
        """(3,) m/s^2 for velocity (3,) m/s and spin (3,) rad/s in `table`, (3.1). Raises BadShape, NotFinite."""
        out = np.empty(3)
        accelerate(check_array("velocity", velocity, (3,)), check_array("spin", spin, (3,)), self.coefficients, out)
        return out


@njit(cache=True, error_model="numpy")
def _pull(v0: float, v1: float, v2: float, w0: float, w1: float, w2: float, c: Array) -> tuple[float, float, float]:
    """(3.1)-(3.3); h = 0 where (3.3) is 0/0: no spin, or spin along the flight."""
    across, flat = v0 * w1 - v1 * w0, v0 * v0 + v1 * v1
    norm = math.sqrt(across * across + flat * w2 * w2)
    h = across / norm if norm > 1e-9 else 0.0
    speed = math.sqrt(flat + v2 * v2)
    drag = (c[1] + c[2] * h) * speed
    lift = c[3] + c[4] * h
    if c[5] != 0.0 and speed > 0.0:
        lift += c[5] / (c[6] + BALL_RADIUS * math.sqrt(w0 * w0 + w1 * w1 + w2 * w2) / speed)
    return (
        -drag * v0 + lift * (w1 * v2 - w2 * v1),
        -drag * v1 + lift * (w2 * v0 - w0 * v2),
        -drag * v2 + lift * (w0 * v1 - w1 * v0) - c[0],
    )


@njit(cache=True, error_model="numpy")
def accelerate(v: Array, w: Array, c: Array, out: Array) -> None:
    """The acceleration (3,) for velocity and spin (3,)."""
    out[0], out[1], out[2] = _pull(v[0], v[1], v[2], w[0], w[1], w[2], c)


# Dormand and Prince 1980, RK5(4)7M, the order 5 row
_A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
    ]
)
_B = np.array([35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84])
_C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0])


@njit(cache=True, forceinline=True, error_model="numpy")
def step(state: Array, h: float, c: Array, out: Array, work: Array) -> None:
    """One step of h seconds from state (9,) into out (9,), which may be the same; work (8, 3) is scratch."""
    v0, v1, v2, w0, w1, w2 = state[3], state[4], state[5], state[6], state[7], state[8]
    dp0, dp1, dp2, dv0, dv1, dv2, fade = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
    for i in range(6):
        s0, s1, s2 = v0, v1, v2
        for j in range(i):
            a = h * _A[i, j]
            s0 += a * work[j, 0]
            s1 += a * work[j, 1]
            s2 += a * work[j, 2]
        if c[7] != 0.0:
            fade = math.exp(-c[7] * _C[i] * h)
        a0, a1, a2 = _pull(s0, s1, s2, fade * w0, fade * w1, fade * w2, c)
        work[i, 0], work[i, 1], work[i, 2] = a0, a1, a2
        b = h * _B[i]
        dp0 += b * s0
        dp1 += b * s1
        dp2 += b * s2
        dv0 += b * a0
        dv1 += b * a1
        dv2 += b * a2
    out[0], out[1], out[2] = state[0] + dp0, state[1] + dp1, state[2] + dp2
    out[3], out[4], out[5] = v0 + dv0, v1 + dv1, v2 + dv2
    out[6], out[7], out[8] = fade * w0, fade * w1, fade * w2


@njit(cache=True, error_model="numpy")
def ease(state: Array, c: Array) -> float:
    """The share of a step that is as exact as the step is elsewhere: less than 1 where h of (3.3) swings round, with spin along the flight.

    h is a direction; the length that goes with it, over the spin, is a velocity, and steps shrink with it below CALM.
    """
    if c[2] == 0.0 and c[4] == 0.0:
        return 1.0
    across, flat = state[3] * state[7] - state[4] * state[6], state[3] * state[3] + state[4] * state[4]
    spin = state[6] * state[6] + state[7] * state[7] + state[8] * state[8]
    length = across * across + flat * state[8] * state[8]
    share = 1.0 if length >= CALM * CALM * spin else math.sqrt(length / spin) / CALM
    return share if share > LEAST_EASE else LEAST_EASE  # of NaN, too: whoever walks by these steps comes to an end


@njit(cache=True, error_model="numpy")
def fly_into(state: Array, duration: float, c: Array, max_step: float, out: Array, work: Array) -> None:
    """Fill out (9,) with the state `duration` seconds later, free flight; duration may be negative. work (8, 3) is scratch."""
    out[:] = state
    even = duration / max(1, math.ceil(abs(duration) / max_step - 1e-9))
    left = duration
    while left != 0.0:
        h = even * ease(out, c)
        if abs(h) > abs(left) - 1e-12:
            h = left
        step(out, h, c, out, work)
        left -= h


@njit(cache=True, error_model="numpy")
def fly(state: Array, duration: float, c: Array, max_step: float = MAX_STEP) -> Array:
    """(9,) the state of `fly_into`."""
    out = np.empty(9)
    fly_into(state, duration, c, max_step, out, np.empty((8, 3)))
    return out


@njit(cache=True, error_model="numpy")
def crossing(state: Array, low: float, high: float, axis: int, level: float, c: Array, trial: Array, work: Array) -> float:
    """The time in [low, high] s after `state` at which state[axis] crosses `level`, within one step; trial (9,) is the state then.

    axis: 0 to 2 of position or 5, the velocity up. Newton's method, kept between the ends, on states integrated to the trial time: as exact
    as the flight. The signs at low and high must differ.
    """
    if low == 0.0:
        trial[:] = state
    else:
        step(state, low, c, trial, work)
    t = low
    falls = trial[axis] > level
    for _ in range(60):
        f = trial[axis] - level
        if (f > 0.0) == falls:
            low = t
        else:
            high = t
        if axis < 3:
            slope = trial[3 + axis]
        else:
            accelerate(trial[3:6], trial[6:9], c, work[0])
            slope = work[0, axis - 3]
        new = t - f / slope if slope != 0.0 else high
        if f == 0.0 or abs(new - t) < 1e-15:
            break
        t = new if low <= new <= high else 0.5 * (low + high)
        step(state, t, c, trial, work)
    return t
