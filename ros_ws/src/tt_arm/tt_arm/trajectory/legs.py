"""Kernels of legs: motions in which all joints begin and end together, with one of the profiles of the dissertation's Section 1.1.

- "quintic": a polynomial of fifth degree.
- "trapezoid": trapezoidal accelerations in a given time.
- "polyline": piecewise linear speed. It makes every motion that the limits of speed and acceleration permit, but its acceleration has
  steps, so it keeps no jerk limit.
- "ruckig": the shortest motion with a jerk limit, see `jerk`; it is not computed here.
- "auto": for each joint the quintic if it keeps the limits, otherwise the trapezoid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.states import Array

from ..joints import JointBounds
from .profiles import (
    Bounds,
    Ends,
    is_possible,
    least_time,
    polyline,
    quintic,
    quintic_is_possible,
    trapezoid,
    trapezoid_is_possible,
)

PROFILE_NAMES = ("auto", "quintic", "trapezoid", "polyline", "ruckig")
AUTO, QUINTIC, TRAPEZOID, POLYLINE, RUCKIG = range(5)
LEG_STEP = 1e-3  # s, of the search for the shortest leg
SHORTEST_LEG, LONGEST_LEG = 1e-6, 10.0  # s, range of durations that is searched; see `shortest_time` for slow joints
LEG_HALVINGS = 20  # of LEG_STEP, to 1e-9 s


Leg = npt.NDArray[np.void]  # (n,) of LEG: states of each joint at the start (0) and at the end (1), where the acceleration is 0
LEG = np.dtype(
    [
        ("q0", np.float64),  # rad
        ("v0", np.float64),  # rad/s
        ("a0", np.float64),  # rad/s^2
        ("q1", np.float64),  # rad
        ("v1", np.float64),  # rad/s
    ]
)


class Pieces(NamedTuple):
    """Polynomials of a path that is being built.

    Attributes:
        knots: (joints, n) s from the start of the path, times at which the polynomials begin, padded with inf.
        coefficients: (joints, n, 6) coefficients of the polynomials in the time (s) since the knot, lowest power first; positions in rad.
        counts: (joints,) number of polynomials of each joint so far.
    """

    knots: Array
    coefficients: Array
    counts: npt.NDArray[np.int64]


def make_leg(q0: Array, v0: Array, a0: Array, q1: Array, v1: Array) -> Leg:
    """Return the ends of a leg (motion in which all joints begin and end together) as a structured array (n,) of LEG.

    Args:
        q0: (n,) rad, positions at the start.
        v0: (n,) rad/s, speeds at the start.
        a0: (n,) rad/s^2, accelerations at the start.
        q1: (n,) rad, positions at the end.
        v1: (n,) rad/s, speeds at the end.
    """
    leg = np.empty(len(q0), LEG)
    leg["q0"], leg["v0"], leg["a0"], leg["q1"], leg["v1"] = q0, v0, a0, q1, v1
    return leg


@njit(cache=True)
def _ends(leg: Leg, i: int) -> Ends:
    joint = leg[i]
    return Ends(joint.q0, joint.v0, joint.a0, joint.q1, joint.v1)


@njit(cache=True)
def _bounds(limits: JointBounds, i: int) -> Bounds:
    joint = limits[i]
    return Bounds(joint.speed, joint.acceleration, joint.jerk)


@njit(cache=True, nogil=True)
def leg_is_possible(time: float, leg: Leg, limits: JointBounds, kind: int) -> bool:
    """Return whether a leg (motion in which all joints begin and end together) keeps the limits of speed, acceleration and jerk.

    Args:
        time: s, duration of the leg.
        leg: (n,) states of the joints at start and end.
        limits: (n,) limits of the joints.
        kind: Profile, AUTO, QUINTIC, TRAPEZOID or POLYLINE; the last one is checked without the jerk limit.
    """
    for i in range(len(leg)):
        ends, bounds = _ends(leg, i), _bounds(limits, i)
        if kind == POLYLINE:
            possible = is_possible(time, ends.q1 - ends.q0, ends.v0, ends.v1, bounds.speed, bounds.acceleration)
        else:
            possible = kind != QUINTIC and trapezoid_is_possible(time, ends, bounds)
            possible = possible or (kind != TRAPEZOID and quintic_is_possible(time, ends, bounds))
        if not possible:
            return False
    return True


@njit(cache=True, nogil=True)
def shortest_time(time: float, leg: Leg, limits: JointBounds, kind: int) -> float:
    """Return the shortest duration (s) in which all joints can make a leg, the motion from one state to another, within their limits.

    Args:
        time: s, shortest duration that is wanted.
        leg: States of the joints at both ends.
        limits: Limits of the joints.
        kind: Profile, AUTO, QUINTIC, TRAPEZOID or POLYLINE.

    Returns:
        The duration, at least `time`; inf if it exceeds both LONGEST_LEG and twice the least time of the joints, which a quintic keeps
        from rest to rest.
    """
    time = max(time, SHORTEST_LEG)
    for i in range(len(leg)):
        ends, bounds = _ends(leg, i), _bounds(limits, i)
        time = max(time, least_time(ends.q1 - ends.q0, ends.v0, ends.v1, bounds.speed, bounds.acceleration))
    if leg_is_possible(time, leg, limits, kind):
        return time
    longest = max(LONGEST_LEG, 2.0 * time)
    while not leg_is_possible(time + LEG_STEP, leg, limits, kind):
        time += LEG_STEP
        if not time <= longest:  # this form ends the search for NaN, too
            return np.inf
    low, high = time, time + LEG_STEP
    for _ in range(LEG_HALVINGS):
        middle = 0.5 * (low + high)
        if leg_is_possible(middle, leg, limits, kind):
            high = middle
        else:
            low = middle
    return high


@njit(cache=True)
def append_leg(begin: float, time: float, leg: Leg, limits: JointBounds, kind: int, path: Pieces) -> None:
    """Append the polynomials of a leg (motion in which all joints begin and end together) to a path.

    Args:
        begin: s from the start of the path, time at which the leg begins.
        time: s, duration of the leg, for which it must be possible.
        leg: (n,) states of the joints at start and end.
        limits: (n,) limits of the joints.
        kind: Profile, AUTO, QUINTIC, TRAPEZOID or POLYLINE.
        path: Polynomials of the path, changed in place.
    """
    all_knots, all_coefficients, counts = path
    for i in range(len(leg)):
        n = counts[i]
        knots, coefficients = all_knots[i, n:], all_coefficients[i, n:]
        ends, bounds = _ends(leg, i), _bounds(limits, i)
        if kind == POLYLINE:
            more = polyline(time, ends, bounds, knots, coefficients)
        elif kind == QUINTIC or (kind == AUTO and quintic_is_possible(time, ends, bounds)):
            more = quintic(time, ends, knots, coefficients)
        else:
            more = trapezoid(time, ends, bounds, knots, coefficients)
        knots[:more] += begin
        counts[i] += more


@njit(cache=True)
def append_rest(begin: float, q: Array, path: Pieces) -> None:
    """Append a rest to a path.

    Args:
        begin: s from the start of the path, time at which the rest begins.
        q: (n,) rad, joint positions of the rest.
        path: Polynomials of the path, changed in place.
    """
    knots, coefficients, counts = path
    for i in range(len(q)):
        knots[i, counts[i]] = begin
        coefficients[i, counts[i], 0] = q[i]
        counts[i] += 1
