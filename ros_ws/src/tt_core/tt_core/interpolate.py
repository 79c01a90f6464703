"""Interpolation between two states of motion: cubic Hermite polynomials, as compiled kernels that do not validate."""

from __future__ import annotations

import numpy as np
from numba import njit

from .arrays import POSITION, SPIN, VELOCITY, Array


@njit(cache=True)
def hermite(p0: float, v0: float, p1: float, v1: float, duration: float, share: float) -> float:
    """Interpolate one coordinate by the cubic polynomial that has given values and rates at both ends of an interval.

    Args:
        p0: Value at the start.
        v0: Rate at the start, unit of the value per s.
        p1: Value at the end.
        v1: Rate at the end, unit of the value per s.
        duration: Length of the interval, s.
        share: Time since the start over `duration`, 0 to 1.

    Returns:
        The value of the polynomial, in the unit of p0 and p1.
    """
    left = 1.0 - share
    return p0 + share * share * (3.0 - 2.0 * share) * (p1 - p0) + duration * share * left * (left * v0 - share * v1)


@njit(cache=True)
def hermite_rate(p0: float, v0: float, p1: float, v1: float, duration: float, share: float) -> float:
    """Compute the time derivative of the polynomial of `hermite`.

    Args:
        p0: Value at the start.
        v0: Rate at the start, unit of the value per s.
        p1: Value at the end.
        v1: Rate at the end, unit of the value per s.
        duration: Length of the interval, s.
        share: Time since the start over `duration`, 0 to 1.

    Returns:
        The derivative, in the unit of v0 and v1.
    """
    left = 1.0 - share
    return 6.0 * share * left / duration * (p1 - p0) + left * (1.0 - 3.0 * share) * v0 + share * (3.0 * share - 2.0) * v1


@njit(cache=True)
def hermite_weights(duration: float, share: float) -> tuple[float, float, float, float]:
    """Return the factors on p0, v0, p1 and v1 whose sum is the polynomial of `hermite`, for many coordinates over the same interval.

    Args:
        duration: Length of the interval, s.
        share: Time since the start over `duration`, 0 to 1.
    """
    left = 1.0 - share
    start, start_rate = (1.0 + 2.0 * share) * left * left, share * left * left * duration
    return start, start_rate, share * share * (3.0 - 2.0 * share), -share * share * left * duration


@njit(cache=True)
def interpolate_states(times: Array, states: Array, at: Array) -> Array:
    """Interpolate states of the ball in time.

    Position is cubic, velocity is its derivative, spin is linear.

    Args:
        times: (n,) s, not decreasing. Two equal times are a bounce: the states before and after it.
        states: (n, 9) position (m), velocity (m/s), spin (rad/s) at these times.
        at: (m,) s, between the first and the last of `times`.

    Returns:
        (m, 9) the states at `at`. At the time of a bounce this is the state after the bounce.
    """
    out, last = np.empty((len(at), 9)), len(times) - 1
    for k in range(len(at)):
        end = min(np.searchsorted(times, at[k], side="right"), last)
        start = max(end - 1, 0)
        duration = times[end] - times[start]
        duration, share = (duration, (at[k] - times[start]) / duration) if duration > 0.0 else (1.0, 1.0)
        p0, v0, w0 = states[start, POSITION], states[start, VELOCITY], states[start, SPIN]
        p1, v1, w1 = states[end, POSITION], states[end, VELOCITY], states[end, SPIN]
        position, velocity, spin = out[k, POSITION], out[k, VELOCITY], out[k, SPIN]
        for i in range(3):
            position[i] = hermite(p0[i], v0[i], p1[i], v1[i], duration, share)
            velocity[i] = hermite_rate(p0[i], v0[i], p1[i], v1[i], duration, share)
            spin[i] = (1.0 - share) * w0[i] + share * w1[i]
    return out
