"""Motions of one joint between two states in a given time, within limits of speed, acceleration and jerk.

All speeds that are possible at a time t lie between two envelopes: the fastest speed that the limits permit, which is
min(v0 + a t, v_max, v1 + a (T - t)), and the slowest one. Therefore the distances that are possible in the time T form an interval, and a
weighted mean of the two envelopes covers each of them within the limits.

The jerk limit is kept by averaging: the moving average of a motion over a window of time exceeds no limit that the motion keeps, and turns
a step of acceleration into a ramp. So a jerk limit makes the motion longer by the duration of one ramp, moves both ends by half a ramp at
their speeds, and changes nothing else.

The kernels do not check their arguments. Units are rad and s, or m and s for a linear joint. A motion is a sequence of polynomials: `knots`
(n,) are the times at which they start, and `coefficients` (n, 6) are those of the powers of the time since then, lowest power first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

LIMIT_SLACK = 1e-9  # relative tolerance, for rounding exactly at a limit
CHECKS = 96  # number of points at which a quintic is compared with its limits; between them it increases by less than 0.1 %


class Ends(NamedTuple):
    """States of one joint at the start (0) and at the end (1) of a motion; the acceleration at the end is 0.

    Attributes:
        q0: rad, position at the start.
        v0: rad/s, speed at the start.
        a0: rad/s^2, acceleration at the start.
        q1: rad, position at the end.
        v1: rad/s, speed at the end.
    """

    q0: float
    v0: float
    a0: float
    q1: float
    v1: float


class Bounds(NamedTuple):
    """Limits of one joint for both directions: speed in rad/s, acceleration in rad/s^2, jerk in rad/s^3."""

    speed: float
    acceleration: float
    jerk: float


class Decay(NamedTuple):
    """State of a joint after its acceleration was reduced to zero with the largest jerk.

    Attributes:
        time: s, duration of the reduction.
        q: rad, position after it.
        v: rad/s, speed after it.
    """

    time: float
    q: float
    v: float


@njit(cache=True)
def least_time(distance: float, v0: float, v1: float, speed: float, acceleration: float) -> float:
    """Return the shortest time (s) in which a joint moves by a distance, without a jerk limit.

    A longer time need not be possible if v0 is not zero.

    Args:
        distance: rad, with sign.
        v0: rad/s, speed at the start.
        v1: rad/s, speed at the end.
        speed: rad/s, speed limit.
        acceleration: rad/s^2, acceleration limit.
    """
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
    """Return the shortest time (s) in which a joint moves by a distance and comes to rest, with the best possible speed at the start.

    Args:
        distance: rad, not negative.
        speed: rad/s, speed limit.
        acceleration: rad/s^2, acceleration limit.
    """
    ramp = 0.5 * speed * speed / acceleration
    return math.sqrt(2.0 * distance / acceleration) if distance < ramp else (distance + ramp) / speed


@njit(cache=True)
def _peak_speed(time: float, v0: float, v1: float, speed: float, acceleration: float) -> float:
    """Return the highest speed (rad/s) of the fastest motion of duration `time` (s) between the speeds v0 and v1."""
    return min(speed, 0.5 * (v0 + v1 + acceleration * time))


@njit(cache=True)
def largest_distance(time: float, v0: float, v1: float, speed: float, acceleration: float) -> float:
    """Return the largest distance (rad) that a joint can move in a given time, without a jerk limit.

    The smallest distance is -largest_distance(time, -v0, -v1, ...).

    Args:
        time: s, duration of the motion.
        v0: rad/s, speed at the start.
        v1: rad/s, speed at the end.
        speed: rad/s, speed limit.
        acceleration: rad/s^2, acceleration limit.
    """
    peak = _peak_speed(time, v0, v1, speed, acceleration)
    ramps = (peak * peak - 0.5 * (v0 * v0 + v1 * v1)) / acceleration
    return ramps + peak * (time - (2.0 * peak - v0 - v1) / acceleration)


@njit(cache=True)
def is_possible(time: float, distance: float, v0: float, v1: float, speed: float, acceleration: float) -> bool:
    """Return whether a joint can move by a distance in exactly the given time, without a jerk limit.

    Args:
        time: s, duration of the motion.
        distance: rad, with sign.
        v0: rad/s, speed at the start.
        v1: rad/s, speed at the end.
        speed: rad/s, speed limit.
        acceleration: rad/s^2, acceleration limit.
    """
    if abs(v1 - v0) > acceleration * time * (1.0 + LIMIT_SLACK):
        return False
    slack = LIMIT_SLACK * (1.0 + abs(distance))
    most, least = largest_distance(time, v0, v1, speed, acceleration), -largest_distance(time, -v0, -v1, speed, acceleration)
    return least - slack <= distance <= most + slack


@njit(cache=True)
def largest_end_speed(time: float, distance: float, v0: float, speed: float, acceleration: float) -> float:
    """Return the largest speed (rad/s) that a joint can have after it has moved by a distance in a given time.

    The smallest speed is -largest_end_speed(time, -distance, -v0, ...). If that is larger than the largest one, the motion is impossible.

    Args:
        time: s, duration of the motion.
        distance: rad, with sign.
        v0: rad/s, speed at the start.
        speed: rad/s, speed limit.
        acceleration: rad/s^2, acceleration limit.
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
    """Compute a motion whose speed is piecewise linear: the weighted mean of the fastest and the slowest speeds that covers the distance.

    The acceleration at the start and the jerk limit are ignored.

    Args:
        time: s, duration of the motion, which must be possible, see `is_possible`.
        ends: States of the joint at start and end.
        bounds: Limits of the joint.
        knots: (5,) s or longer, output: filled with the starts of the polynomials, beginning with 0.
        coefficients: (5, 6) or longer, output: filled with the polynomials.

    Returns:
        The number of polynomials: 5.
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
    """Return the state of a joint after its acceleration is reduced to zero.

    Args:
        q0: rad, position at the start.
        v0: rad/s, speed at the start.
        a0: rad/s^2, acceleration at the start.
        jerk: rad/s^3, absolute value of the jerk.
    """
    time = abs(a0) / jerk
    return Decay(time, q0 + time * (v0 + time * a0 / 3.0), v0 + 0.5 * time * a0)


@njit(cache=True)
def trapezoid_is_possible(time: float, ends: Ends, bounds: Bounds) -> bool:
    """Return whether `trapezoid` can make a motion within the limits.

    Args:
        time: s, duration of the motion.
        ends: States of the joint at start and end.
        bounds: Limits of the joint.
    """
    first, q, v = decay(ends.q0, ends.v0, ends.a0, bounds.jerk)
    ramp = 2.0 * bounds.acceleration / bounds.jerk
    left, distance = time - first - ramp, ends.q1 - q - 0.5 * ramp * (v + ends.v1)
    return left > 0.0 and is_possible(left, distance, v, ends.v1, bounds.speed, bounds.acceleration)


@njit(cache=True)
def trapezoid(time: float, ends: Ends, bounds: Bounds, knots: Array, coefficients: Array) -> int:
    """Compute a motion with trapezoidal acceleration in a given time (dissertation Section 1.1).

    First the acceleration at the start is reduced to zero. Then a motion of `polyline` between the moved ends is averaged over the duration
    of one ramp. This is the time in which the largest jerk changes the acceleration from its upper to its lower limit, the largest step of
    `polyline`. So each step of the acceleration becomes a constant jerk for this time.

    Args:
        time: s, duration of the motion, which must be possible, see `trapezoid_is_possible`.
        ends: States of the joint at start and end.
        bounds: Limits of the joint.
        knots: (12,) s or longer, output: filled with the starts of the polynomials, beginning with 0.
        coefficients: (12, 6) or longer, output: filled with the polynomials.

    Returns:
        The number of polynomials, at most 12.
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
    """Compute a motion as one polynomial of fifth degree (dissertation Section 1.1); the limits are not checked.

    Args:
        time: s, duration of the motion.
        ends: States of the joint at start and end.
        knots: (1,) s or longer, output: filled with 0, the start of the polynomial.
        coefficients: (1, 6) or longer, output: filled with the polynomial.

    Returns:
        The number of polynomials: 1.
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
    """Return whether the motion of `quintic` keeps the limits of speed, acceleration and jerk.

    The jerk is compared exactly. Speed and acceleration are compared with 0.998 of their limits at CHECKS points, so that they keep the
    limits everywhere.

    Args:
        time: s, duration of the motion.
        ends: States of the joint at start and end.
        bounds: Limits of the joint.
    """
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
def evaluate_path(t: float, knots: Array, coefficients: Array, q: Array, qdot: Array, qddot: Array) -> None:
    """Compute position, speed and acceleration of all joints on a path at one time.

    Before the first knot the joints move with constant speed. After the last knot the last polynomial is used.

    Args:
        t: s since the start of the path.
        knots: (joints, n) s, starts of the polynomials, padded with inf.
        coefficients: (joints, n, 6) polynomials in the time since their start, lowest power first.
        q: (joints,) rad, output: filled with the positions.
        qdot: (joints,) rad/s, output: filled with the speeds.
        qddot: (joints,) rad/s^2, output: filled with the accelerations.
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
