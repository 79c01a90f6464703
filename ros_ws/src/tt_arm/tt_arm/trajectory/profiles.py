"""One joint from one position and speed to another in a given time, within limits of speed, acceleration and jerk.

All speeds that are possible at a time t lie between two envelopes: as fast as the limits allow, min(v0 + a t, v_max, v1 + a (T - t)), and
as slow as they allow. The distances that are possible in the time T are therefore an interval, and a mixture of the two envelopes reaches
each of them within the limits.

The jerk limit follows from an average: averaging a motion over a window of time passes no limit, and turns a step of acceleration into a
ramp. So a jerk limit takes one ramp of time, shifts both ends by half a ramp at their speeds, and changes nothing else.

The kernels do not check their arguments. Units are rad and s, or m and s for a linear joint. A motion is a row of polynomials: `knots`
(n,), the times where they start, and `coefficients` (n, 6) in the time since then, lowest power first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

SLACK = 1e-9  # relative, for rounding at the very limit
CHECKS = 96  # points at which a quintic is compared with its limits; between them it rises by less than 0.1 %


class Ends(NamedTuple):
    """The start (0) and the end (1) of a motion of one joint. It ends without acceleration."""

    q0: float  # rad
    v0: float  # rad/s
    a0: float  # rad/s^2
    q1: float  # rad
    v1: float  # rad/s


class Bounds(NamedTuple):
    """The limits of one joint, both ways."""

    speed: float  # rad/s
    acceleration: float  # rad/s^2
    jerk: float  # rad/s^3


class Decay(NamedTuple):
    """What follows when an acceleration is reduced to zero at the jerk limit."""

    time: float  # s, that it takes
    q: float  # rad, position then
    v: float  # rad/s, speed then


@njit(cache=True)
def least_time(distance: float, v0: float, v1: float, speed: float, acceleration: float) -> float:
    """Return the shortest time (s) for `distance` between the speeds v0 and v1. Not all longer times are possible when v0 is not zero."""
    direct = 0.5 * (v0 + v1) * abs(v1 - v0) / acceleration
    if distance < direct:
        distance, v0, v1 = -distance, -v0, -v1
    peak = math.sqrt(max(0.0, acceleration * distance + 0.5 * (v0 * v0 + v1 * v1)))
    if peak <= speed:
        return max(abs(v1 - v0) / acceleration, (2.0 * peak - v0 - v1) / acceleration)
    ramps = (speed * speed - 0.5 * (v0 * v0 + v1 * v1)) / acceleration
    return (2.0 * speed - v0 - v1) / acceleration + (distance - ramps) / speed


@njit(cache=True)
def least_time_to_rest(distance: float, speed: float, acceleration: float) -> float:
    """Return the shortest time (s) to come to rest at `distance` (not negative), from whatever start speed is best."""
    ramp = 0.5 * speed * speed / acceleration
    return math.sqrt(2.0 * distance / acceleration) if distance < ramp else (distance + ramp) / speed


@njit(cache=True)
def _peak_speed(time: float, v0: float, v1: float, speed: float, acceleration: float) -> float:
    """Return the highest speed of the fast envelope."""
    return min(speed, 0.5 * (v0 + v1 + acceleration * time))


@njit(cache=True)
def largest_distance(time: float, v0: float, v1: float, speed: float, acceleration: float) -> float:
    """Return the largest distance in `time` (s) between the speeds v0 and v1. The smallest is -largest_distance(time, -v0, -v1, ...)."""
    peak = _peak_speed(time, v0, v1, speed, acceleration)
    ramps = (peak * peak - 0.5 * (v0 * v0 + v1 * v1)) / acceleration
    return ramps + peak * (time - (2.0 * peak - v0 - v1) / acceleration)


@njit(cache=True)
def is_possible(time: float, distance: float, v0: float, v1: float, speed: float, acceleration: float) -> bool:
    """Return whether `distance` in exactly `time` (s) between the speeds v0 and v1 is possible without a jerk limit."""
    if abs(v1 - v0) > acceleration * time * (1.0 + SLACK):
        return False
    slack = SLACK * (1.0 + abs(distance))
    most, least = largest_distance(time, v0, v1, speed, acceleration), -largest_distance(time, -v0, -v1, speed, acceleration)
    return least - slack <= distance <= most + slack


@njit(cache=True)
def largest_end_speed(time: float, distance: float, v0: float, speed: float, acceleration: float) -> float:
    """Return the largest speed at the end of `distance` in `time` (s) from the speed v0.

    The smallest is -largest_end_speed(time, -distance, -v0, ...). If that is larger, there is no such motion.
    """
    k = v0 - acceleration * time
    square = 2.0 * k * k - 2.0 * v0 * v0 + 4.0 * acceleration * distance
    v1 = k + math.sqrt(square) if square > 0.0 else -math.inf
    if v0 + v1 - acceleration * time < -2.0 * speed:  # the slow envelope runs back at full speed
        square = 2.0 * acceleration * (distance + speed * time) - (v0 + speed) ** 2
        v1 = math.sqrt(square) - speed if square > 0.0 else -math.inf
    return min(v1, speed, v0 + acceleration * time)


@njit(cache=True)
def polyline(time: float, ends: Ends, bounds: Bounds, knots: Array, coefficients: Array) -> int:
    """Fill a motion whose speed is a polyline, the mixture of both envelopes that covers the distance; a0 and the jerk limit are ignored.

    Args:
        time: s, for which the motion must be possible, see `is_possible`.
        ends: Start and end.
        bounds: The limits.
        knots: (5,) or more, filled, from 0 on.
        coefficients: (5, 6) or more, filled.

    Returns:
        How many polynomials were filled: 5.
    """
    q0, v0, _, q1, v1 = ends
    speed, acceleration, _ = bounds
    high, low = _peak_speed(time, v0, v1, speed, acceleration), -_peak_speed(time, -v0, -v1, speed, acceleration)
    most, least = largest_distance(time, v0, v1, speed, acceleration), -largest_distance(time, -v0, -v1, speed, acceleration)
    share = min(1.0, max(0.0, (q1 - q0 - least) / (most - least))) if most - least > 1e-12 else 0.5
    knots[0] = 0.0
    corners = np.array([high - v0, acceleration * time - high + v1, v0 - low, acceleration * time - v1 + low]) / acceleration
    corners.sort()
    knots[1:5] = np.minimum(np.maximum(corners, 0.0), time)
    position, before = q0, v0
    for i in range(5):
        end = knots[i + 1] if i < 4 else time
        fast = min(high, v0 + acceleration * end, v1 + acceleration * (time - end))
        slow = max(low, v0 - acceleration * end, v1 - acceleration * (time - end))
        after = share * fast + (1.0 - share) * slow
        duration = end - knots[i]
        coefficients[i] = 0.0
        coefficients[i, 0], coefficients[i, 1] = position, before
        if duration > 0.0:
            coefficients[i, 2] = 0.5 * (after - before) / duration
        position += 0.5 * duration * (before + after)
        before = after
    return 5


@njit(cache=True)
def decay(q0: float, v0: float, a0: float, jerk: float) -> Decay:
    """Return what follows when the acceleration a0 is reduced to zero at `jerk`."""
    time = abs(a0) / jerk
    return Decay(time, q0 + time * (v0 + time * a0 / 3.0), v0 + 0.5 * time * a0)


@njit(cache=True)
def trapezoid_is_possible(time: float, ends: Ends, bounds: Bounds) -> bool:
    """Return whether `trapezoid` can make this motion."""
    first, q, v = decay(ends.q0, ends.v0, ends.a0, bounds.jerk)
    ramp = 2.0 * bounds.acceleration / bounds.jerk
    left, distance = time - first - ramp, ends.q1 - q - 0.5 * ramp * (v + ends.v1)
    return left > 0.0 and is_possible(left, distance, v, ends.v1, bounds.speed, bounds.acceleration)


@njit(cache=True)
def trapezoid(time: float, ends: Ends, bounds: Bounds, knots: Array, coefficients: Array) -> int:
    """Fill a motion with trapezoids of acceleration in a fixed time (dissertation Section 1.1), from the acceleration a0 to none.

    First a0 is reduced to zero. Then a polyline of speed between the shifted ends is averaged over one ramp. The ramp is as long as the
    jerk limit takes from `acceleration` to -`acceleration`, the largest step of the polyline; each step becomes a jerk for that long.

    Args:
        time: s, for which the motion must be possible, see `trapezoid_is_possible`.
        ends: Start and end.
        bounds: The limits.
        knots: (12,) or more, filled, from 0 on.
        coefficients: (12, 6) or more, filled.

    Returns:
        How many polynomials were filled, at most 12.
    """
    first, q, v = decay(ends.q0, ends.v0, ends.a0, bounds.jerk)
    ramp = 2.0 * bounds.acceleration / bounds.jerk
    left = time - first - ramp
    corners, pieces = np.empty(6), np.empty((5, 6))
    polyline(left, Ends(q + 0.5 * ramp * v, v, 0.0, ends.q1 - 0.5 * ramp * ends.v1, ends.v1), bounds, corners, pieces)
    corners[5] = left
    jerks, before = np.empty(6), 0.0
    for i in range(6):
        after = 2.0 * pieces[i, 2] if i < 5 else 0.0
        jerks[i], before = (after - before) / ramp, after
    changes = np.append(corners, corners + ramp)  # s, where a jerk begins or ends
    changes.sort()
    n, a = 0, ends.a0
    if first > 0.0:
        knots[0], coefficients[0] = 0.0, 0.0
        coefficients[0, 0], coefficients[0, 1], coefficients[0, 2] = ends.q0, ends.v0, 0.5 * ends.a0
        coefficients[0, 3] = -math.copysign(bounds.jerk, ends.a0) / 6.0
        n, a = 1, 0.0
    for i in range(11):
        duration = changes[i + 1] - changes[i]
        if duration <= 0.0:
            continue
        middle, total = 0.5 * (changes[i] + changes[i + 1]), 0.0
        for k in range(6):
            if corners[k] < middle < corners[k] + ramp:
                total += jerks[k]
        knots[n], coefficients[n] = first + changes[i], 0.0
        coefficients[n, 0], coefficients[n, 1], coefficients[n, 2], coefficients[n, 3] = q, v, 0.5 * a, total / 6.0
        q += duration * (v + duration * (0.5 * a + duration * total / 6.0))
        v += duration * (a + 0.5 * duration * total)
        a += duration * total
        n += 1
    return n


@njit(cache=True)
def quintic(time: float, ends: Ends, knots: Array, coefficients: Array) -> int:
    """Fill the polynomial of fifth degree from the acceleration a0 to none (dissertation Section 1.1).

    Args:
        time: s.
        ends: Start and end.
        knots: (1,) or more, filled: 0.
        coefficients: (1, 6) or more, filled.

    Returns:
        How many polynomials were filled: 1.
    """
    q0, v0, a0, q1, v1 = ends
    knots[0] = 0.0
    c, d = coefficients[0], q1 - q0
    c[0], c[1], c[2] = q0, v0, 0.5 * a0
    c[3] = (10.0 * d - (6.0 * v0 + 4.0 * v1) * time - 1.5 * a0 * time**2) / time**3
    c[4] = (-15.0 * d + (8.0 * v0 + 7.0 * v1) * time + 1.5 * a0 * time**2) / time**4
    c[5] = (6.0 * d - 3.0 * (v0 + v1) * time - 0.5 * a0 * time**2) / time**5
    return 1


@njit(cache=True)
def quintic_is_possible(time: float, ends: Ends, bounds: Bounds) -> bool:
    """Return whether the quintic keeps the jerk limit, and 0.998 of the other limits at CHECKS points, so that it keeps them everywhere."""
    knots, coefficients = np.empty(1), np.empty((1, 6))
    quintic(time, ends, knots, coefficients)
    c = coefficients[0]
    turn = -0.2 * c[4] / c[5] if c[5] != 0.0 else 0.0  # s, where the jerk, a parabola, has its extreme
    for t in (0.0, time, min(time, max(0.0, turn))):
        if abs(6.0 * c[3] + t * (24.0 * c[4] + t * 60.0 * c[5])) > bounds.jerk:
            return False
    for k in range(1, CHECKS):
        t = time * k / CHECKS
        v = c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * (4.0 * c[4] + t * 5.0 * c[5])))
        a = 2.0 * c[2] + t * (6.0 * c[3] + t * (12.0 * c[4] + t * 20.0 * c[5]))
        if abs(v) > 0.998 * bounds.speed or abs(a) > 0.998 * bounds.acceleration:
            return False
    return True


@njit(cache=True)
def evaluate(t: float, knots: Array, coefficients: Array, q: Array, qdot: Array, qddot: Array) -> None:
    """Fill position, speed and acceleration of all joints at one time. Before the first knot the motion is straight.

    Args:
        t: s since the start of the path.
        knots: (joints, n) s, padded with inf.
        coefficients: (joints, n, 6).
        q: (n,) rad; filled.
        qdot: (n,) rad/s; filled.
        qddot: (n,) rad/s^2; filled.
    """
    for i in range(knots.shape[0]):
        n = 0
        while n + 1 < knots.shape[1] and knots[i, n + 1] <= t:
            n += 1
        h, c = t - knots[i, n], coefficients[i, n]
        if h < 0.0:
            q[i], qdot[i], qddot[i] = c[0] + h * c[1], c[1], 0.0
            continue
        q[i] = c[0] + h * (c[1] + h * (c[2] + h * (c[3] + h * (c[4] + h * c[5]))))
        qdot[i] = c[1] + h * (2.0 * c[2] + h * (3.0 * c[3] + h * (4.0 * c[4] + h * 5.0 * c[5])))
        qddot[i] = 2.0 * c[2] + h * (6.0 * c[3] + h * (12.0 * c[4] + h * 20.0 * c[5]))
