"""How far racket, hand and forearm stay from the table, the floor and the arm itself, on the way and while braking.

The racket is the circle of its rim, hand and forearm are points along their axes with a radius, upper arm and pedestal are capsules.
Upper arm and forearm meet at an elbow whose limits keep them apart. The radii are those of the URDF's collision elements.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.constants import FLOOR_Z, TABLE_LENGTH, TABLE_THICKNESS, TABLE_WIDTH
from tt_core.states import Array

from ..kinematics import Chain, collision_radii, skeleton
from ..trajectory.profiles import evaluate

OBSTACLES = ("the table", "the floor", "itself")
NEAR = 0.08  # m, within which the racket is its rim and not a sphere around its centre
AROUND = 12  # points of the rim
CIRCLE = np.array([(math.cos(2.0 * math.pi * k / AROUND), math.sin(2.0 * math.pi * k / AROUND)) for k in range(AROUND)])
FOLDED = -0.5  # cosine between forearm and hand, below which the rim can reach the forearm; above it is 7 cm away
ALONG = 8  # parts of the forearm; the capsules seen from its points are at most 3 mm nearer
HANDLE = 4  # of eighths of the way from the wrist to the face centre that are looked at
MOST_LOOKS = 10_000  # at a path; 30 s of it in steps of 10 ms are 3,000
HELD = 0.005  # m, kept where a command is held; the guard keeps none, as it looks at every command
EVERY = 2  # looks at a path, of which one is at what follows from a held command
HOLDING = 3  # postures looked at while the drive holds the last command, see `braking_clearance`
BRAKING = 3  # postures looked at while the arm brakes, the last at rest


@njit(cache=True)
def from_table(x: float, y: float, z: float) -> float:
    """Return the distance (m) of a point in `table` to the table top; 0 inside it."""
    return math.hypot(math.hypot(max(-x, x - TABLE_LENGTH, 0.0), max(-y, y - TABLE_WIDTH, 0.0)), max(z, -TABLE_THICKNESS - z, 0.0))


@njit(cache=True)
def from_segment(x: float, y: float, z: float, start: Array, end: Array) -> float:
    """Return the distance (m) of a point to the segment from `start` (3,) to `end` (3,)."""
    ux, uy, uz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    x, y, z = x - start[0], y - start[1], z - start[2]
    share = min(1.0, max(0.0, (x * ux + y * uy + z * uz) / (ux * ux + uy * uy + uz * uz)))
    x, y, z = x - share * ux, y - share * uy, z - share * uz
    return math.sqrt(x * x + y * y + z * z)


@njit(cache=True)
def clearances(q: Array, chain: Chain) -> tuple[float, float, float]:
    """Compute the least distance of a posture to each of OBSTACLES.

    Args:
        q: (7,) rad.
        chain: The geometry.

    Returns:
        m; a value that is not positive is a touch. Beyond NEAR the values are too small, by twice the racket's radius at most.
    """
    points, rotation, radii = np.empty((5, 3)), np.empty((3, 3)), collision_radii(chain)
    rim, forearm, upper_arm, pedestal = radii.racket, radii.forearm, radii.upper_arm, radii.pedestal
    folded = skeleton(q, chain, points, rotation) < FOLDED
    shoulder, elbow, wrist, face, foot = points[0], points[1], points[2], points[3], points[4]
    base = chain.base_position
    foot[0], foot[1], foot[2] = base[0], base[1], min(FLOOR_Z, base[2])
    x, y, z = face[0], face[1], face[2]
    table, floor = from_table(x, y, z) - rim, z - FLOOR_Z - rim
    itself = min(from_segment(x, y, z, shoulder, elbow) - upper_arm, from_segment(x, y, z, foot, shoulder) - pedestal) - rim
    if folded:
        itself = min(itself, from_segment(x, y, z, elbow, wrist) - forearm - rim)
    if min(table, itself) < NEAR:
        table, itself = np.inf, np.inf
        for k in range(AROUND):
            c, s = rim * CIRCLE[k, 0], rim * CIRCLE[k, 1]
            x = face[0] + c * rotation[0, 0] + s * rotation[0, 1]
            y = face[1] + c * rotation[1, 0] + s * rotation[1, 1]
            z = face[2] + c * rotation[2, 0] + s * rotation[2, 1]
            table = min(table, from_table(x, y, z))
            itself = min(itself, from_segment(x, y, z, shoulder, elbow) - upper_arm, from_segment(x, y, z, foot, shoulder) - pedestal)
            if folded:
                itself = min(itself, from_segment(x, y, z, elbow, wrist) - forearm)
    for k in range(ALONG + HANDLE):
        if k <= ALONG:
            start, end, share = elbow, wrist, k / ALONG
        else:
            start, end, share = wrist, face, (k - ALONG) / 8.0
        x, y, z = start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]), start[2] + share * (end[2] - start[2])
        table, floor = min(table, from_table(x, y, z) - forearm), min(floor, z - FLOOR_Z - forearm)
        if k >= ALONG:
            itself = min(itself, from_segment(x, y, z, shoulder, elbow) - upper_arm - forearm)
        itself = min(itself, from_segment(x, y, z, foot, shoulder) - pedestal - forearm)
    return table, floor, itself


@njit(cache=True)
def clearance(q: Array, chain: Chain) -> tuple[float, int]:
    """Return the least of `clearances` (m), and the index in OBSTACLES of what is nearest."""
    table, floor, itself = clearances(q, chain)
    if table <= floor and table <= itself:
        return table, 0
    return (floor, 1) if floor <= itself else (itself, 2)


@njit(cache=True)
def braking_clearance(q: Array, qdot: Array, braking: Array, hold: float, chain: Chain) -> tuple[float, int]:
    """Compute the least clearance on the way to rest. HOLDING and BRAKING postures are looked at.

    Args:
        q: (7,) rad.
        qdot: (7,) rad/s.
        braking: (7,) rad/s^2, at which each joint brakes.
        hold: s, for which each joint keeps its speed first.
        chain: The geometry.

    Returns:
        m, and the index in OBSTACLES of what is nearest.
    """
    longest, posture, least, what = 0.0, np.empty(7), np.inf, 0
    for i in range(7):
        longest = max(longest, abs(qdot[i]) / braking[i])
    held = HOLDING if hold > 0.0 else 0
    for k in range(1, held + BRAKING + 1):
        for i in range(7):
            if k <= held:
                posture[i] = q[i] + hold * k / held * qdot[i]
            else:
                t = min(longest * (k - held) / BRAKING, abs(qdot[i]) / braking[i])
                posture[i] = q[i] + hold * qdot[i] + t * (qdot[i] - 0.5 * t * math.copysign(braking[i], qdot[i]))
        left, near = clearance(posture, chain)
        if left < least:
            least, what = left, near
    return least, what


@njit(cache=True)
def levers(chain: Chain) -> Array:
    """Return for each joint the largest distance (7,) m of any point of racket, hand and forearm from its axis."""
    lengths, beyond, rim = chain.lengths, chain.mount_position, collision_radii(chain).racket
    aside = math.hypot(beyond[0], beyond[1])
    hand = math.hypot(aside, lengths[3] + beyond[2]) + rim
    out = np.full(7, hand)
    out[:4] += lengths[2]
    out[:2] += lengths[1]
    out[6] = aside + rim
    return out


@njit(cache=True, nogil=True)
def path_clearance(
    end: float, step: float, braking: Array, hold: float, enough: float, knots: Array, coefficients: Array, chain: Chain
) -> tuple[float, int]:
    """Compute the least clearance on a path and while braking from anywhere on it, at once or after the drive has held its speed.

    The next look is `step` later, or as late as nothing can come nearer than `enough` before it: the points of the arm move by the speeds
    of the joints at most, and these change by their accelerations at most.

    Args:
        end: s, until which the path is looked at.
        step: s, least time between two looks.
        braking: (7,) rad/s^2, acceleration limit of each joint, at which it also brakes.
        hold: s, for which a drive may hold its speed.
        enough: m, below which the search ends.
        knots: (7, n) of the path, see `profiles`.
        coefficients: (7, n, 6) of the path.
        chain: The geometry.

    Returns:
        m, and the index in OBSTACLES of what is nearest; -inf for a path that is too long to be looked at, or not finite.
    """
    q, qdot, qddot, least, what, lever = np.empty(7), np.empty(7), np.empty(7), np.inf, 0, levers(chain)
    rise = 0.0  # m/s^2, at which the speed of any point changes at most
    for i in range(7):
        rise += braking[i] * lever[i]
    time, last = 0.0, False
    for look in range(MOST_LOOKS):
        last = time >= end
        evaluate(min(end, time), knots, coefficients, q, qdot, qddot)
        left, near = clearance(q, chain)
        if math.isnan(left):
            return -np.inf, near
        moves, speed = 0.0, 0.0  # m, by which braking moves any point at most; m/s, of any point at most
        for i in range(7):
            moves += lever[i] * (abs(qdot[i]) * hold + qdot[i] ** 2 / (2.0 * braking[i]))
            speed += lever[i] * abs(qdot[i])
        room = left - moves - enough  # falls by 2 speed at most: half of it for the way, half for braking
        if room < 0.0 and moves > 0.0:
            braked, obstacle = braking_clearance(q, qdot, braking, 0.0, chain)
            if braked < left:
                left, near = braked, obstacle
            if hold > 0.0 and look % EVERY == 0:  # only a touch counts: a command is held only if the process fails
                braked, obstacle = braking_clearance(q, qdot, braking, hold, chain)
                if braked - HELD + enough < left:
                    left, near = braked - HELD + enough, obstacle
        if left < least:
            least, what = left, near
            if least < enough:
                break
        if last:
            return least, what
        speed += 0.5 * hold * rise
        time += max(step, (math.sqrt(speed * speed + rise * max(0.0, room)) - speed) / rise)
    return (least if least < enough else -np.inf), what
