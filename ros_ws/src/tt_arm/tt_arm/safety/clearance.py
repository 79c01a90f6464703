"""Distances of the racket and the arm's bodies to the table, the floor and each other, on a path and while braking.

The racket is represented by the circle of its rim, the bodies by the capsules of `arm_urdf.bodies` (all points within a radius of a line
segment). Bodies that do not move are not compared with table and floor, and neighbours are not compared with each other, see `body_pairs`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.constants import FLOOR_Z, TABLE_LENGTH, TABLE_THICKNESS, TABLE_WIDTH
from tt_core.states import Array

from ..kinematics import Bodies, place_bodies
from ..trajectory.profiles import evaluate_path

OBSTACLES = ("the table", "the floor", "itself")
TABLE_LOW, TABLE_HIGH = (0.0, 0.0, -TABLE_THICKNESS), (TABLE_LENGTH, TABLE_WIDTH, 0.0)  # m
RIM_DISTANCE = 0.08  # m; within this distance the points of the rim are used, beyond it a sphere around the racket's centre
RIM_POINTS = 12  # number of points of the rim
CIRCLE = np.array([(math.cos(2.0 * math.pi * k / RIM_POINTS), math.sin(2.0 * math.pi * k / RIM_POINTS)) for k in range(RIM_POINTS)])
MOST_CHECKS = 10_000  # largest number of checks along a path; 30 s in steps of 10 ms are 3,000
HELD_CLEARANCE = 0.005  # m, distance to keep if a command is held; the guard keeps none, because it checks every command
EVERY = 2  # at each second check of a path, what follows if the drives hold their command is checked, too
HOLDING = 3  # number of postures that are checked while the drive holds the last command, see `braking_clearance`
BRAKING = 3  # number of postures that are checked while the arm brakes, the last one at rest


Pairs = npt.NDArray[np.int64]


class Places(NamedTuple):
    """Scratch memory for the positions of the m capsules and the racket in `table`.

    Attributes:
        starts: (m, 3) m, first ends of the capsules' segments.
        ends: (m, 3) m, second ends of the capsules' segments.
        face: (3,) m, centre of the racket's face.
        rotation: (3, 3) rotation from racket to `table`.
        rim: (RIM_POINTS, 3) m, points of the racket's rim.
    """

    starts: Array
    ends: Array
    face: Array
    rotation: Array
    rim: Array


@njit(cache=True)
def places(count: int) -> Places:
    """Return scratch memory for an arm with `count` capsules."""
    return Places(np.empty((count, 3)), np.empty((count, 3)), np.empty(3), np.empty((3, 3)), np.empty((RIM_POINTS, 3)))


@njit(cache=True)
def from_table(x: float, y: float, z: float) -> float:
    """Return the distance (m) of the point x, y, z (m, in `table`) to the table top, a box; 0 inside it."""
    x, y, z = max(-x, x - TABLE_LENGTH, 0.0), max(-y, y - TABLE_WIDTH, 0.0), max(z, -TABLE_THICKNESS - z, 0.0)
    return math.sqrt(x * x + y * y + z * z)


@njit(cache=True, error_model="numpy")
def from_segment(x: float, y: float, z: float, starts: Array, ends: Array, m: int) -> float:
    """Return the distance (m) of the point x, y, z (m) to the line segment from starts[m] to ends[m], arrays (capsules, 3) m."""
    ux, uy, uz = ends[m, 0] - starts[m, 0], ends[m, 1] - starts[m, 1], ends[m, 2] - starts[m, 2]
    x, y, z = x - starts[m, 0], y - starts[m, 1], z - starts[m, 2]
    square = ux * ux + uy * uy + uz * uz
    share = min(1.0, max(0.0, (x * ux + y * uy + z * uz) / square)) if square > 0.0 else 0.0
    x, y, z = x - share * ux, y - share * uy, z - share * uz
    return math.sqrt(x * x + y * y + z * z)


@njit(cache=True)
def _slope(t: float, starts: Array, ends: Array, m: int) -> float:
    """Return half of the derivative by t of the squared distance (m^2) to the table top, at start + t (end - start) of segment m."""
    slope = 0.0
    for k in range(3):
        way = ends[m, k] - starts[m, k]
        at = starts[m, k] + t * way
        slope += way * (min(0.0, at - TABLE_LOW[k]) + max(0.0, at - TABLE_HIGH[k]))
    return slope


@njit(cache=True, error_model="numpy")
def segment_from_table(starts: Array, ends: Array, m: int) -> float:
    """Return the distance (m) of the line segment from starts[m] to ends[m] to the table top, a box; 0 if they touch.

    The squared distance is convex along the segment. It is a parabola between the points where the segment crosses the planes of the box.

    Args:
        starts: (capsules, 3) m in `table`, first ends of the segments.
        ends: (capsules, 3) m in `table`, second ends of the segments.
        m: Index of the segment.
    """
    if _slope(0.0, starts, ends, m) >= 0.0:
        t = 0.0
    elif _slope(1.0, starts, ends, m) <= 0.0:
        t = 1.0
    else:
        low, high = 0.0, 1.0
        for k in range(3):
            way = ends[m, k] - starts[m, k]
            if abs(way) < 1e-12:
                continue
            for side in (TABLE_LOW[k], TABLE_HIGH[k]):
                t = (side - starts[m, k]) / way
                if low < t < high:
                    if _slope(t, starts, ends, m) > 0.0:
                        high = t
                    else:
                        low = t
        down, up = _slope(low, starts, ends, m), _slope(high, starts, ends, m)
        t = low - down * (high - low) / (up - down) if up > down else low
    return from_table(
        starts[m, 0] + t * (ends[m, 0] - starts[m, 0]),
        starts[m, 1] + t * (ends[m, 1] - starts[m, 1]),
        starts[m, 2] + t * (ends[m, 2] - starts[m, 2]),
    )


@njit(cache=True, error_model="numpy")
def between_segments(starts: Array, ends: Array, m: int, other: int) -> float:
    """Return the distance (m) between two line segments.

    Args:
        starts: (capsules, 3) m, first ends of the segments.
        ends: (capsules, 3) m, second ends of the segments.
        m: Index of one segment.
        other: Index of the other segment.
    """
    a = b = c = d = e = 0.0
    for k in range(3):
        u, v, w = ends[m, k] - starts[m, k], ends[other, k] - starts[other, k], starts[m, k] - starts[other, k]
        a, b, c, d, e = a + u * u, b + u * v, c + v * v, d + u * w, e + v * w
    whole = a * c - b * b
    s = min(1.0, max(0.0, (b * e - c * d) / whole)) if whole > 1e-12 * a * c else 0.0
    t = (b * s + e) / c if c > 0.0 else 0.0
    if t < 0.0 or t > 1.0 or c == 0.0:  # the other segment's end is nearest
        t = min(1.0, max(0.0, t))
        s = min(1.0, max(0.0, (b * t - d) / a)) if a > 0.0 else 0.0
    square = 0.0
    for k in range(3):
        apart = starts[m, k] - starts[other, k] + s * (ends[m, k] - starts[m, k]) - t * (ends[other, k] - starts[other, k])
        square += apart * apart
    return math.sqrt(square)


@njit(cache=True)
def bodies_from_table(starts: Array, ends: Array, radii: Array, reaches: Array, first: int, most: float) -> float:
    """Return the least distance (m) of the capsules to the table, or `most` if none is nearer than that.

    Args:
        starts: (m, 3) m in `table`, first ends of the capsules' segments.
        ends: (m, 3) m in `table`, second ends of the capsules' segments.
        radii: (m,) m, radii of the capsules.
        reaches: (m,) m, radii of spheres that contain the capsules, around their middles.
        first: Index of the first capsule to check; those before it do not move.
        most: m, largest distance of interest.
    """
    for m in range(first, len(radii)):
        middle = from_table(0.5 * (starts[m, 0] + ends[m, 0]), 0.5 * (starts[m, 1] + ends[m, 1]), 0.5 * (starts[m, 2] + ends[m, 2]))
        if middle - reaches[m] < most:
            most = min(most, segment_from_table(starts, ends, m) - radii[m])
    return most


@njit(cache=True)
def bodies_from_floor(starts: Array, ends: Array, radii: Array, first: int, most: float) -> float:
    """Return the least distance (m) of the capsules to the floor, or `most` if none is nearer than that.

    Args:
        starts: (m, 3) m in `table`, first ends of the capsules' segments.
        ends: (m, 3) m in `table`, second ends of the capsules' segments.
        radii: (m,) m, radii of the capsules.
        first: Index of the first capsule to check; those before it do not move.
        most: m, largest distance of interest.
    """
    for m in range(first, len(radii)):
        most = min(most, min(starts[m, 2], ends[m, 2]) - radii[m] - FLOOR_Z)
    return most


@njit(cache=True)
def _fill_rim(face: Array, rotation: Array, around: float, rim: Array) -> None:
    """Fill `rim` (RIM_POINTS, 3) m with points of the rim of a racket with this centre (3,) m, rotation (3, 3) and radius `around` (m)."""
    for k in range(RIM_POINTS):
        c, s = around * CIRCLE[k, 0], around * CIRCLE[k, 1]
        for j in range(3):
            rim[k, j] = face[j] + c * rotation[j, 0] + s * rotation[j, 1]


@njit(cache=True)
def bodies_from_each_other(starts: Array, ends: Array, radii: Array, reaches: Array, pairs: Pairs, most: float) -> float:
    """Return the least distance (m) between the capsules of each pair, or `most` if none are nearer than that.

    Args:
        starts: (m, 3) m, first ends of the capsules' segments.
        ends: (m, 3) m, second ends of the capsules' segments.
        radii: (m,) m, radii of the capsules.
        reaches: (m,) m, radii of spheres that contain the capsules, around their middles.
        pairs: (p, 2) indices of capsules; pairs with the racket, whose second index is -1, are skipped.
        most: m, largest distance of interest.
    """
    for p in range(len(pairs)):
        m, other = pairs[p, 0], pairs[p, 1]
        if other < 0:
            continue
        square, bound = 0.0, most + reaches[m] + reaches[other]
        for k in range(3):
            apart = 0.5 * (starts[m, k] + ends[m, k] - starts[other, k] - ends[other, k])
            square += apart * apart
        if bound > 0.0 and square < bound * bound:
            most = min(most, between_segments(starts, ends, m, other) - radii[m] - radii[other])
    return most


@njit(cache=True, inline="always")
def _clearances(q: Array, bodies: Bodies, at: Places, most: float) -> tuple[float, float, float]:
    """Return the result of `clearances`, with `most` (m) in place of larger distances, which need not be computed then.

    `at` is scratch memory.
    """
    starts, ends, face, rotation, rim = at
    radii, reaches, owners, pairs, around = bodies.radii, bodies.reaches, bodies.owners, bodies.pairs, bodies.rim
    place_bodies(q, bodies, starts, ends, face, rotation)
    first, filled = 0, False
    while first < len(owners) and owners[first] < 0:  # these stand still
        first += 1
    table = from_table(face[0], face[1], face[2]) - around
    if table < min(most, RIM_DISTANCE):
        _fill_rim(face, rotation, around, rim)
        table, filled = math.inf, True
        for k in range(RIM_POINTS):
            table = min(table, from_table(rim[k, 0], rim[k, 1], rim[k, 2]))
    table = bodies_from_table(starts, ends, radii, reaches, first, min(most, table))
    floor = bodies_from_floor(starts, ends, radii, first, min(most, face[2] - FLOOR_Z - around))
    itself = most
    for p in range(len(pairs)):
        m = pairs[p, 0]
        if pairs[p, 1] < 0:
            left = from_segment(face[0], face[1], face[2], starts, ends, m) - radii[m] - around
            if left < min(itself, RIM_DISTANCE):
                if not filled:
                    _fill_rim(face, rotation, around, rim)
                left, filled = math.inf, True
                for k in range(RIM_POINTS):
                    left = min(left, from_segment(rim[k, 0], rim[k, 1], rim[k, 2], starts, ends, m) - radii[m])
            itself = min(itself, left)
    return table, floor, bodies_from_each_other(starts, ends, radii, reaches, pairs, itself)


@njit(cache=True)
def clearances(q: Array, bodies: Bodies) -> tuple[float, float, float]:
    """Compute the least distance of the arm and its racket to each of OBSTACLES: the table, the floor, and the arm itself.

    Args:
        q: (n,) rad or m, joint positions.
        bodies: Capsules and racket of the arm.

    Returns:
        Three distances in m. A value that is not positive means contact. Values above RIM_DISTANCE may be smaller than the true distance,
        by at most twice the racket's radius.
    """
    return _clearances(q, bodies, places(len(bodies.owners)), math.inf)


@njit(cache=True, inline="always")
def _clearance(q: Array, bodies: Bodies, at: Places, most: float) -> tuple[float, int]:
    """Return the result of `clearance`, or `most` (m) and any obstacle if no distance is below `most`. `at` is scratch memory."""
    table, floor, itself = _clearances(q, bodies, at, most)
    if table <= floor and table <= itself:
        return table, 0
    return (floor, 1) if floor <= itself else (itself, 2)


@njit(cache=True)
def clearance(q: Array, bodies: Bodies) -> tuple[float, int]:
    """Return the least distance (m) of the arm and its racket to any obstacle, and the index of the nearest one in OBSTACLES.

    Args:
        q: (n,) rad or m, joint positions.
        bodies: Capsules and racket of the arm.
    """
    return _clearance(q, bodies, places(len(bodies.owners)), math.inf)


@njit(cache=True)
def _braking_clearance(
    q: Array, qdot: Array, braking: Array, hold: float, bodies: Bodies, at: Places, here: float, most: float
) -> tuple[float, int]:
    """Return the result of `braking_clearance`, or `most` (m) and any obstacle if no distance is below `most`.

    `here` (m) is the clearance at `q`. Postures that are so near to `q` that the clearance there cannot be below `most` are not checked.
    `at` is scratch memory.
    """
    n = len(q)
    longest, posture, least, what = 0.0, np.empty(n), most, 0
    for i in range(n):
        longest = max(longest, abs(qdot[i]) / braking[i])
    held = HOLDING if hold > 0.0 else 0
    for k in range(1, held + BRAKING + 1):
        moves = 0.0  # m, of any point at most
        for i in range(n):
            if k <= held:
                way = hold * k / held * qdot[i]
            else:
                t = min(longest * (k - held) / BRAKING, abs(qdot[i]) / braking[i])
                way = hold * qdot[i] + t * (qdot[i] - 0.5 * t * math.copysign(braking[i], qdot[i]))
            posture[i] = q[i] + way
            moves += bodies.levers[i] * abs(way)
        if here - moves < least:
            left, near = _clearance(posture, bodies, at, least)
            if left < least:
                least, what = left, near
    return least, what


@njit(cache=True)
def braking_clearance(q: Array, qdot: Array, braking: Array, hold: float, bodies: Bodies) -> tuple[float, int]:
    """Compute the least distance to any obstacle while the arm brakes to rest.

    HOLDING postures are checked while the joints keep their speed, and BRAKING postures while they brake.

    Args:
        q: (n,) rad, joint positions at the start.
        qdot: (n,) rad/s, joint speeds at the start.
        braking: (n,) rad/s^2, deceleration with which each joint brakes.
        hold: s, time for which each joint keeps its speed before it brakes.
        bodies: Capsules and racket of the arm.

    Returns:
        The distance in m, and the index of the nearest obstacle in OBSTACLES.
    """
    return _braking_clearance(q, qdot, braking, hold, bodies, places(len(bodies.owners)), -math.inf, math.inf)


@njit(cache=True, nogil=True)
def path_clearance(
    end: float, step: float, braking: Array, hold: float, enough: float, knots: Array, coefficients: Array, bodies: Bodies
) -> tuple[float, int]:
    """Compute the least distance to any obstacle on a path, and while the arm brakes from any point of it.

    Braking at once and braking after the drives have held their command are checked. The time to the next check is at least `step`. It is
    longer if, with the present speeds and the acceleration limits of the joints, nothing can come nearer than `enough` before.

    Args:
        end: s, time from the start of the path up to which it is checked.
        step: s, least time between two checks.
        braking: (n,) rad/s^2, acceleration limit of each joint, with which it also brakes.
        hold: s, time for which a drive may hold its command.
        enough: m, distance to keep; the search ends when it finds a smaller one.
        knots: (joints, n) s, starts of the polynomials of the path, see `profiles`.
        coefficients: (joints, n, 6) polynomials of the path.
        bodies: Capsules and racket of the arm.

    Returns:
        The distance in m, and the index of the nearest obstacle in OBSTACLES. Distances while braking are part of it only if they are less
        than `enough`. Distances after a held command are increased by `enough` - HELD_CLEARANCE, so that they need only be HELD_CLEARANCE.
        The distance is -inf for a path that is too long to be checked, or is not finite.
    """
    n, lever, least, what = len(braking), bodies.levers, np.inf, 0
    q, qdot, qddot, at = np.empty(n), np.empty(n), np.empty(n), places(len(bodies.owners))
    rise = 0.0  # m/s^2, at which the speed of any point changes at most
    for i in range(n):
        rise += braking[i] * lever[i]
    time, last = 0.0, False
    for check in range(MOST_CHECKS):
        last = time >= end
        evaluate_path(min(end, time), knots, coefficients, q, qdot, qddot)
        here, near = _clearance(q, bodies, at, math.inf)
        if math.isnan(here):
            return -np.inf, near
        moves, speed = 0.0, 0.0  # m, by which braking moves any point at most; m/s, of any point at most
        for i in range(n):
            moves += lever[i] * (abs(qdot[i]) * hold + qdot[i] ** 2 / (2.0 * braking[i]))
            speed += lever[i] * abs(qdot[i])
        room = here - moves - enough  # falls by 2 speed at most: half of it for the way, half for braking
        left = here
        if room < 0.0 and moves > 0.0:
            most = min(left, enough)
            braked, obstacle = _braking_clearance(q, qdot, braking, 0.0, bodies, at, here, most)
            if braked < most:
                left, near = braked, obstacle
            if hold > 0.0 and check % EVERY == 0:  # only a touch counts: a command is held only if the process fails
                most, excess = min(left, enough), enough - HELD_CLEARANCE
                braked, obstacle = _braking_clearance(q, qdot, braking, hold, bodies, at, here, most - excess)
                if braked + excess < most:
                    left, near = braked + excess, obstacle
        if left < least:
            least, what = left, near
            if least < enough:
                break
        if last:
            return least, what
        speed += 0.5 * hold * rise
        time += max(step, (math.sqrt(speed * speed + rise * max(0.0, room)) - speed) / rise)
    return (least if least < enough else -np.inf), what
