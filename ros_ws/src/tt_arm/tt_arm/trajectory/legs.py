"""Kernels of legs: motions of all joints that begin and end together, with one of the profiles of dissertation Section 1.1.

- "quintic": the polynomial of fifth degree.
- "trapezoid": trapezoids of acceleration in a fixed time.
- "polyline": speed in straight pieces. It reaches all that speed and acceleration allow, but its acceleration has steps, so no jerk limit
  can hold.
- "ruckig": the shortest motion with a jerk limit, see `jerk`; not computed here.
- "auto": for each joint the quintic where that keeps the limits, otherwise the trapezoid.
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

PROFILES = ("auto", "quintic", "trapezoid", "polyline", "ruckig")
AUTO, QUINTIC, TRAPEZOID, POLYLINE, RUCKIG = range(5)
STEP = 1e-3  # s, of the search for the shortest leg
SHORTEST_LEG, LONGEST_LEG = 1e-6, 10.0  # s, legs that are tried
HALVINGS = 20  # of STEP, to 1e-9 s


Leg = npt.NDArray[np.void]  # (n,) of LEG: the start (0) and the end (1) of each joint; it ends without acceleration
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
    """The polynomials of a path that is being built."""

    knots: Array  # (joints, n) s since the start of the path, padded with inf
    coefficients: Array  # (joints, n, 6) in s since the knot, lowest power first
    counts: npt.NDArray[np.int64]  # (n,) polynomials of each joint so far


def make_leg(q0: Array, v0: Array, a0: Array, q1: Array, v1: Array) -> Leg:
    """Return a leg from start (0) to end (1), each (n,) in rad, rad/s, rad/s^2."""
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
    """Return whether a leg of `time` (s) keeps the limits of speed, acceleration and jerk in all joints."""
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
    """Return the shortest duration (s) of a leg, at least `time`, that keeps the limits in all joints; inf if it exceeds LONGEST_LEG."""
    time = max(time, SHORTEST_LEG)
    for i in range(len(leg)):
        ends, bounds = _ends(leg, i), _bounds(limits, i)
        time = max(time, least_time(ends.q1 - ends.q0, ends.v0, ends.v1, bounds.speed, bounds.acceleration))
    if leg_is_possible(time, leg, limits, kind):
        return time
    while not leg_is_possible(time + STEP, leg, limits, kind):
        time += STEP
        if not time <= LONGEST_LEG:  # also where it is NaN
            return np.inf
    low, high = time, time + STEP
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if leg_is_possible(middle, leg, limits, kind):
            high = middle
        else:
            low = middle
    return high


@njit(cache=True)
def append_leg(begin: float, time: float, leg: Leg, limits: JointBounds, kind: int, path: Pieces) -> None:
    """Append a leg of `time` (s) that begins `begin` (s) after the start of the path. It must be possible."""
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
    """Append rest at q (n,) rad from `begin` (s) on."""
    knots, coefficients, counts = path
    for i in range(len(q)):
        knots[i, counts[i]] = begin
        coefficients[i, counts[i], 0] = q[i]
        counts[i] += 1
