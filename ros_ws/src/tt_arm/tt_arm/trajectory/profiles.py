"""One joint from one position and speed to another in a given time, within limits of speed, acceleration and jerk.

All speeds possible at a time t lie between two envelopes: as fast as the limits allow, min(v0 + a t, v_max, v1 + a (T - t)), and as slow.
The distances possible in the time T are therefore an interval, and mixing the two envelopes reaches each of them within the limits.
Its average over a window, the ramp, has trapezoids for accelerations: no limit is passed by an average, and a step of acceleration becomes
a ramp. So a jerk limit takes one ramp of time and shifts the ends by half a ramp at their speeds, and all else is as without it.
Kernels do not validate; rad, s. A motion is a row of polynomials: `knots` (n,), the times where they start, and `coefficients` (n, 6) in
the time since then, lowest power first.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.states import Array

SLACK = 1e-9  # relative, for rounding at the very limit
CHECKS = 96  # points at which a quintic is compared with its limits; between them it rises by less than 0.1 %


@njit(cache=True)
def least_time(distance: float, v0: float, v1: float, speed: float, acceleration: float) -> float:
    """The shortest time; longer ones may not all be possible when v0 is not zero."""
    direct = 0.5 * (v0 + v1) * abs(v1 - v0) / acceleration
    if distance < direct:
        distance, v0, v1 = -distance, -v0, -v1
    peak = math.sqrt(max(0.0, acceleration * distance + 0.5 * (v0 * v0 + v1 * v1)))
    if peak <= speed:
        return max(abs(v1 - v0) / acceleration, (2.0 * peak - v0 - v1) / acceleration)
    ramps = (speed * speed - 0.5 * (v0 * v0 + v1 * v1)) / acceleration
    return (2.0 * speed - v0 - v1) / acceleration + (distance - ramps) / speed


@njit(cache=True)
def soonest(distance: float, speed: float, acceleration: float) -> float:
    """The shortest time to come to rest at `distance`, not negative, with whatever speed at the start is best."""
    ramp = 0.5 * speed * speed / acceleration
    return math.sqrt(2.0 * distance / acceleration) if distance < ramp else (distance + ramp) / speed


@njit(cache=True)
def _peak(time: float, v0: float, v1: float, speed: float, acceleration: float) -> float:
    return min(speed, 0.5 * (v0 + v1 + acceleration * time))


@njit(cache=True)
def farthest(time: float, v0: float, v1: float, speed: float, acceleration: float) -> float:
    """The largest distance in `time`; the smallest is -farthest(time, -v0, -v1)."""
    peak = _peak(time, v0, v1, speed, acceleration)
    ramps = (peak * peak - 0.5 * (v0 * v0 + v1 * v1)) / acceleration
    return ramps + peak * (time - (2.0 * peak - v0 - v1) / acceleration)


@njit(cache=True)
def possible(time: float, distance: float, v0: float, v1: float, speed: float, acceleration: float) -> bool:
    if abs(v1 - v0) > acceleration * time * (1.0 + SLACK):
        return False
    slack = SLACK * (1.0 + abs(distance))
    most, least = farthest(time, v0, v1, speed, acceleration), -farthest(time, -v0, -v1, speed, acceleration)
    return least - slack <= distance <= most + slack


@njit(cache=True)
def fastest(time: float, distance: float, v0: float, speed: float, acceleration: float) -> float:
    """The largest speed at the end of `distance` in `time`; the smallest is -fastest(time, -distance, -v0), none when that is larger."""
    k = v0 - acceleration * time
    square = 2.0 * k * k - 2.0 * v0 * v0 + 4.0 * acceleration * distance
    v1 = k + math.sqrt(square) if square > 0.0 else -math.inf
    if v0 + v1 - acceleration * time < -2.0 * speed:  # the slow envelope runs back at full speed
        square = 2.0 * acceleration * (distance + speed * time) - (v0 + speed) ** 2
        v1 = math.sqrt(square) - speed if square > 0.0 else -math.inf
    return min(v1, speed, v0 + acceleration * time)


@njit(cache=True)
def polyline(time: float, q0: float, v0: float, q1: float, v1: float, speed: float, acceleration: float, knots: Array, c: Array) -> int:
    """The mixed envelopes: fills 5 knots (from 0) and their coefficients, returns 5. The motion must be possible."""
    high, low = _peak(time, v0, v1, speed, acceleration), -_peak(time, -v0, -v1, speed, acceleration)
    most, least = farthest(time, v0, v1, speed, acceleration), -farthest(time, -v0, -v1, speed, acceleration)
    share = min(1.0, max(0.0, (q1 - q0 - least) / (most - least))) if most - least > 1e-12 else 0.5
    knots[0] = 0.0
    corners = np.array([high - v0, acceleration * time - high + v1, v0 - low, acceleration * time - v1 + low]) / acceleration
    corners.sort()
    knots[1:5] = np.minimum(np.maximum(corners, 0.0), time)
    position, before = q0, v0
    for i in range(5):
        end = knots[i + 1] if i < 4 else time
        up = min(high, v0 + acceleration * end, v1 + acceleration * (time - end))
        down = max(low, v0 - acceleration * end, v1 - acceleration * (time - end))
        after = share * up + (1.0 - share) * down
        h = end - knots[i]
        c[i] = 0.0
        c[i, 0], c[i, 1] = position, before
        if h > 0.0:
            c[i, 2] = 0.5 * (after - before) / h
        position += 0.5 * h * (before + after)
        before = after
    return 5


@njit(cache=True)
def eased(q0: float, v0: float, a0: float, jerk: float) -> tuple[float, float, float]:
    """The time in which an acceleration a0 ends at `jerk`, and position and speed then."""
    time = abs(a0) / jerk
    return time, q0 + time * (v0 + time * a0 / 3.0), v0 + 0.5 * time * a0


@njit(cache=True)
def trapezoid_possible(
    time: float, q0: float, v0: float, a0: float, q1: float, v1: float, speed: float, acceleration: float, jerk: float
) -> bool:
    """Whether `trapezoid` can: the jerk limit's part of `possible`."""
    first, q0, v0 = eased(q0, v0, a0, jerk)
    ramp = 2.0 * acceleration / jerk
    within = time - first - ramp
    return within > 0.0 and possible(within, q1 - q0 - 0.5 * ramp * (v0 + v1), v0, v1, speed, acceleration)


@njit(cache=True)
def trapezoid(
    time: float, q0: float, v0: float, a0: float, q1: float, v1: float, speed: float, acceleration: float, jerk: float,
    knots: Array, c: Array,
) -> int:  # fmt: skip
    """Trapezoids of acceleration in a fixed time (dissertation Section 1.1), from the acceleration a0 to none: fills at most 12 knots and
    their coefficients, returns how many. The motion must be possible.

    a0 ends first. Then the polyline between the shifted ends is averaged over the ramp, in which its largest step, from `acceleration` to
    -`acceleration`, keeps the jerk limit: each step is a jerk for the length of the ramp.
    """
    first, q, v = eased(q0, v0, a0, jerk)
    ramp = 2.0 * acceleration / jerk
    within = time - first - ramp
    corners, pieces = np.empty(6), np.empty((5, 6))
    polyline(within, q + 0.5 * ramp * v, v, q1 - 0.5 * ramp * v1, v1, speed, acceleration, corners, pieces)
    corners[5] = within
    jerks, before = np.empty(6), 0.0
    for i in range(6):
        after = 2.0 * pieces[i, 2] if i < 5 else 0.0
        jerks[i], before = (after - before) / ramp, after
    changes = np.append(corners, corners + ramp)
    changes.sort()
    n, a = 0, a0
    if first > 0.0:
        knots[0], c[0] = 0.0, 0.0
        c[0, 0], c[0, 1], c[0, 2], c[0, 3] = q0, v0, 0.5 * a0, -math.copysign(jerk, a0) / 6.0
        n, a = 1, 0.0
    for i in range(11):
        h = changes[i + 1] - changes[i]
        if h <= 0.0:
            continue
        middle, total = 0.5 * (changes[i] + changes[i + 1]), 0.0
        for k in range(6):
            if corners[k] < middle < corners[k] + ramp:
                total += jerks[k]
        knots[n], c[n] = first + changes[i], 0.0
        c[n, 0], c[n, 1], c[n, 2], c[n, 3] = q, v, 0.5 * a, total / 6.0
        q += h * (v + h * (0.5 * a + h * total / 6.0))
        v += h * (a + 0.5 * h * total)
        a += h * total
        n += 1
    return n


@njit(cache=True)
def quintic(time: float, q0: float, v0: float, a0: float, q1: float, v1: float, knots: Array, c: Array) -> int:
    """The fifth degree polynomial from the acceleration a0 to none (dissertation Section 1.1): fills one knot, returns 1."""
    knots[0] = 0.0
    d = q1 - q0
    c[0, 0], c[0, 1], c[0, 2] = q0, v0, 0.5 * a0
    c[0, 3] = (10.0 * d - (6.0 * v0 + 4.0 * v1) * time - 1.5 * a0 * time**2) / time**3
    c[0, 4] = (-15.0 * d + (8.0 * v0 + 7.0 * v1) * time + 1.5 * a0 * time**2) / time**4
    c[0, 5] = (6.0 * d - 3.0 * (v0 + v1) * time - 0.5 * a0 * time**2) / time**5
    return 1


@njit(cache=True)
def quintic_holds(
    time: float, q0: float, v0: float, a0: float, q1: float, v1: float, speed: float, acceleration: float, jerk: float
) -> bool:
    """Whether the quintic keeps the jerk limit, and 0.998 of the others at CHECKS points, so that it keeps them all the way."""
    knots, c = np.empty(1), np.empty((1, 6))
    quintic(time, q0, v0, a0, q1, v1, knots, c)
    turn = -0.2 * c[0, 4] / c[0, 5] if c[0, 5] != 0.0 else 0.0  # where the jerk, a parabola, turns
    for t in (0.0, time, min(time, max(0.0, turn))):
        if abs(6.0 * c[0, 3] + t * (24.0 * c[0, 4] + t * 60.0 * c[0, 5])) > jerk:
            return False
    for k in range(1, CHECKS):
        t = time * k / CHECKS
        v = c[0, 1] + t * (2.0 * c[0, 2] + t * (3.0 * c[0, 3] + t * (4.0 * c[0, 4] + t * 5.0 * c[0, 5])))
        a = 2.0 * c[0, 2] + t * (6.0 * c[0, 3] + t * (12.0 * c[0, 4] + t * 20.0 * c[0, 5]))
        if abs(v) > 0.998 * speed or abs(a) > 0.998 * acceleration:
            return False
    return True


@njit(cache=True)
def evaluate(t: float, knots: Array, coefficients: Array, q: Array, qdot: Array, qddot: Array) -> None:
    """Fills q, qdot, qddot (7,) at `t`, for knots (7, n), padded with inf, and coefficients (7, n, 6); linear before 0."""
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
