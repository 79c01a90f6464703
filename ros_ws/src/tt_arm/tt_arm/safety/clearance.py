"""How far racket, hand and forearm stay from the table, the floor and the arm itself, on the way and while braking.

The racket is the circle of its rim, hand and forearm are points along their axes with a radius, upper arm and pedestal are capsules.
Upper arm and forearm are joined at an elbow whose limits keep them apart.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.constants import FLOOR_Z, TABLE_LENGTH, TABLE_WIDTH
from tt_core.states import Array

from ..kinematics import Chain, skeleton
from ..trajectory.profiles import evaluate

OBSTACLES = ("the table", "the floor", "itself")
THICKNESS = 0.03  # m, of the table top, an assumption
RIM = 0.08  # m, from the face centre to the racket's edge, of the racket in the URDF
FOREARM = 0.06  # m, radius around elbow, wrist and handle, of the links in the URDF
UPPER_ARM = 0.08  # m, radius from shoulder to elbow, of the links in the URDF
PEDESTAL = 0.10  # m, radius from the floor to the shoulder, of the base in the URDF
NEAR = 0.08  # m, within which the racket is its rim and no ball
AROUND = 12  # points of the rim
CIRCLE = RIM * np.array([(math.cos(2.0 * math.pi * k / AROUND), math.sin(2.0 * math.pi * k / AROUND)) for k in range(AROUND)])
ALONG = 8  # parts of the forearm; the capsules seen from its points are at most 3 mm nearer
MOST_LOOKS = 10_000  # at a path; 30 s of it in steps of 10 ms are 3,000
HELD = 0.005  # m, kept where a command is held; the guard keeps none, as it looks at every command
EVERY = 2  # looks at a path, of which one is at what comes of a held command
HOLDING = 2  # postures looked at while the drive holds the last command, see `braking_clearance`
BRAKING = 3  # postures looked at while the arm brakes, the last at rest


@njit(cache=True)
def from_table(x: float, y: float, z: float) -> float:
    """m, from a point in `table` to the table top; 0 inside it."""
    return math.hypot(math.hypot(max(-x, x - TABLE_LENGTH, 0.0), max(-y, y - TABLE_WIDTH, 0.0)), max(z, -THICKNESS - z, 0.0))


@njit(cache=True)
def from_segment(x: float, y: float, z: float, start: Array, end: Array) -> float:
    """m, from a point to the segment from `start` (3,) to `end` (3,)."""
    ux, uy, uz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    x, y, z = x - start[0], y - start[1], z - start[2]
    share = min(1.0, max(0.0, (x * ux + y * uy + z * uz) / (ux * ux + uy * uy + uz * uz)))
    x, y, z = x - share * ux, y - share * uy, z - share * uz
    return math.sqrt(x * x + y * y + z * z)


@njit(cache=True)
def clearances(q: Array, chain: Chain) -> tuple[float, float, float]:
    """m, the least distance for q (7,) rad to each of OBSTACLES; not above 0 is a touch. Beyond NEAR at most 2 RIM too small."""
    points, rotation = np.empty((5, 3)), np.empty((3, 3))
    folded = skeleton(q, chain, points, rotation) < -0.5  # else the rim is 7 cm from the forearm
    shoulder, elbow, wrist, face, foot = points[0], points[1], points[2], points[3], points[4]
    base = chain.base_position
    foot[0], foot[1], foot[2] = base[0], base[1], min(FLOOR_Z, base[2])
    x, y, z = face[0], face[1], face[2]
    table, floor = from_table(x, y, z) - RIM, z - FLOOR_Z - RIM
    itself = min(from_segment(x, y, z, shoulder, elbow) - UPPER_ARM, from_segment(x, y, z, foot, shoulder) - PEDESTAL) - RIM
    if folded:
        itself = min(itself, from_segment(x, y, z, elbow, wrist) - FOREARM - RIM)
    if min(table, itself) < NEAR:
        table, itself = np.inf, np.inf
        for k in range(AROUND):
            c, s = CIRCLE[k, 0], CIRCLE[k, 1]
            x = face[0] + c * rotation[0, 0] + s * rotation[0, 1]
            y = face[1] + c * rotation[1, 0] + s * rotation[1, 1]
            z = face[2] + c * rotation[2, 0] + s * rotation[2, 1]
            table = min(table, from_table(x, y, z))
            itself = min(itself, from_segment(x, y, z, shoulder, elbow) - UPPER_ARM, from_segment(x, y, z, foot, shoulder) - PEDESTAL)
            if folded:
                itself = min(itself, from_segment(x, y, z, elbow, wrist) - FOREARM)
    for k in range(ALONG + 4):
        if k <= ALONG:
            start, end, share = elbow, wrist, k / ALONG
        else:  # to the handle
            start, end, share = wrist, face, (k - ALONG) / 8.0
        x, y, z = start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]), start[2] + share * (end[2] - start[2])
        table, floor = min(table, from_table(x, y, z) - FOREARM), min(floor, z - FLOOR_Z - FOREARM)
        if k >= ALONG:
            itself = min(itself, from_segment(x, y, z, shoulder, elbow) - UPPER_ARM - FOREARM)
        itself = min(itself, from_segment(x, y, z, foot, shoulder) - PEDESTAL - FOREARM)
    return table, floor, itself


@njit(cache=True)
def clearance(q: Array, chain: Chain) -> tuple[float, int]:
    """m, the least of `clearances`, and which of OBSTACLES it is from."""
    table, floor, itself = clearances(q, chain)
    if table <= floor and table <= itself:
        return table, 0
    return (floor, 1) if floor <= itself else (itself, 2)


@njit(cache=True)
def braking_clearance(q: Array, qdot: Array, braking: float, hold: float, chain: Chain) -> tuple[float, int]:
    """Return the least `clearance` (m) on the way to rest from q (7,) rad and qdot (7,) rad/s, and which of OBSTACLES it is from.

    Each joint keeps its speed for `hold` (s), then brakes at `braking` (rad/s^2). HOLDING and BRAKING postures are looked at.
    """
    longest, posture, least, what = np.abs(qdot).max() / braking, np.empty(7), np.inf, 0
    held = HOLDING if hold > 0.0 else 0
    for k in range(1, held + BRAKING + 1):
        for i in range(7):
            if k <= held:
                posture[i] = q[i] + hold * k / held * qdot[i]
            else:
                t = min(longest * (k - held) / BRAKING, abs(qdot[i]) / braking)
                posture[i] = q[i] + hold * qdot[i] + t * (qdot[i] - 0.5 * t * math.copysign(braking, qdot[i]))
        left, near = clearance(posture, chain)
        if left < least:
            least, what = left, near
    return least, what


@njit(cache=True)
def levers(chain: Chain) -> Array:
    """(7,) m, the most that any point of racket, hand and forearm is away from each joint's axis."""
    _, _, lengths, _, beyond = chain
    aside = math.hypot(beyond[0], beyond[1])
    hand = math.hypot(aside, lengths[3] + beyond[2]) + RIM
    out = np.full(7, hand)
    out[:4] += lengths[2]
    out[:2] += lengths[1]
    out[6] = aside + RIM
    return out


@njit(cache=True, nogil=True)
def path_clearance(
    end: float, step: float, braking: float, hold: float, enough: float, knots: Array, coefficients: Array, chain: Chain
) -> tuple[float, int]:  # fmt: skip
    """The least clearance (m) that was looked at on a path of polynomials (see `motion`) and on braking from it, after the drive has held
    the speed for `hold` (s) or at once, and from what, until
    `end` (s) or until it is below `enough` (m); -inf for a path that is too long to be looked at, or not finite.

    The next look is `step` (s) later, or as late as nothing can come as near as that before: the arm's points move by the joints' speeds
    at most, which change by `braking` (rad/s^2) at most.
    """
    q, qdot, qddot, least, what, lever = np.empty(7), np.empty(7), np.empty(7), np.inf, 0, levers(chain)
    time, last = 0.0, False
    for look in range(MOST_LOOKS):
        last = time >= end
        evaluate(min(end, time), knots, coefficients, q, qdot, qddot)
        left, near = clearance(q, chain)
        if math.isnan(left):
            return -np.inf, near
        moves, speed = 0.0, 0.0  # m, what braking moves any point at most; m/s
        for i in range(7):
            moves += lever[i] * (abs(qdot[i]) * hold + qdot[i] ** 2 / (2.0 * braking))
            speed += lever[i] * abs(qdot[i])
        rise = braking * lever.sum()  # m/s^2, of the speed
        room = left - moves - enough  # falls by 2 speed at most: half of it for the way, half for braking
        if room < 0.0 and moves > 0.0:
            braked, obstacle = braking_clearance(q, qdot, braking, 0.0, chain)
            if braked < left:
                left, near = braked, obstacle
            if hold > 0.0 and look % EVERY == 0:  # only a touch counts: it takes a fault of the process
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
