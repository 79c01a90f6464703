"""The last check of a path: position, speed, acceleration, jerk, clearance and torque, on it and while braking from it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.failures import Failure
from tt_core.states import Array

from ..model import ArmModel
from ..safety.clearance import OBSTACLES, path_clearance
from .limits import SwingFailure, SwingLimits
from .path import Path
from .profiles import evaluate
from .torque import torque_shares

STEP = 1e-3  # s, between two looks at the limits
COARSE = 10e-3  # s, at most between two looks at the clearance: at 3 m/s the racket moves 30 mm
SLACK = 2e-3  # relative, for rounding


class Extremes(NamedTuple):
    """The extremes of a path, (n,) each."""

    low: Array  # rad, lowest position
    high: Array  # rad, highest position
    speed: Array  # rad/s
    acceleration: Array  # rad/s^2
    jerk: Array  # rad/s^3; a step of acceleration is a high jerk
    held_low: Array  # rad, lowest position of a joint that keeps its speed for the drives' timeout anywhere, then brakes
    held_high: Array  # rad, highest position of such a joint


@njit(cache=True, nogil=True)
def extremes(end: float, braking: Array, hold: float, knots: Array, coefficients: Array) -> Extremes:
    """Find the extremes of a path, every STEP.

    Args:
        end: s, until which the path is sampled.
        braking: (n,) rad/s^2, at which each joint brakes.
        hold: s, for which a drive may hold a command.
        knots: (joints, n) of the path, see `profiles`.
        coefficients: (joints, n, 6) of the path.
    """
    n = len(braking)
    low, high, speed, acceleration, jerk = np.full(n, np.inf), np.full(n, -np.inf), np.zeros(n), np.zeros(n), np.zeros(n)
    held_low, held_high = np.full(n, np.inf), np.full(n, -np.inf)
    q, qdot, qddot, before = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for k in range(int(end / STEP) + 2):
        evaluate(min(end, k * STEP), knots, coefficients, q, qdot, qddot)
        for i in range(n):
            low[i], high[i] = min(low[i], q[i]), max(high[i], q[i])
            stop = q[i] + hold * qdot[i] + 0.5 * qdot[i] * abs(qdot[i]) / braking[i]
            held_low[i], held_high[i] = min(held_low[i], stop), max(held_high[i], stop)
            speed[i], acceleration[i] = max(speed[i], abs(qdot[i])), max(acceleration[i], abs(qddot[i]))
            if k > 0:
                jerk[i] = max(jerk[i], abs(qddot[i] - before[i]) / STEP)
            before[i] = qddot[i]
    return Extremes(low, high, speed, acceleration, jerk, held_low, held_high)


def path_failure(path: Path, model: ArmModel, limits: SwingLimits) -> Failure | None:
    """Return the first limit that a path does not keep, or None.

    Args:
        path: What is checked.
        model: The arm.
        limits: What the swing may use.
    """
    joints, end, hold = limits.of_joints(model), path.duration, limits.hold
    names, units, polynomials = joints.names, joints.units, path.pieces[:2]
    braking = np.array(joints.acceleration)
    found = extremes(end, braking, hold, *polynomials)
    room = np.minimum(found.low - model.position_limits[:, 0], model.position_limits[:, 1] - found.high)
    i = int(room.argmin())
    if room[i] < limits.margin:
        return Failure(SwingFailure.POSITION_LIMIT, joint=names[i], distance=max(0.0, float(room[i])), unit=units[i])
    room = np.minimum(found.held_low - model.position_limits[:, 0], model.position_limits[:, 1] - found.held_high)
    i = int(room.argmin())
    if room[i] < 0.0:
        return Failure(SwingFailure.HELD_COMMAND, joint=names[i], beyond=-float(room[i]), unit=units[i])
    shares = {
        SwingFailure.SPEED_LIMIT: found.speed / joints.speed,
        SwingFailure.ACCELERATION_LIMIT: found.acceleration / joints.acceleration,
    }
    if limits.profile != "polyline":
        shares[SwingFailure.JERK_LIMIT] = found.jerk / joints.jerk
    for code, share in shares.items():
        if share.max() > 1.0 + SLACK:
            return Failure(code, joint=names[int(share.argmax())], share=float(share.max()))
    left, what = path_clearance(end, COARSE, braking, hold, limits.clearance, *polynomials, model.bodies)
    if left < limits.clearance:
        return Failure(SwingFailure.CLEARANCE, distance=max(0.0, left), obstacle=OBSTACLES[what])
    torque = torque_shares(model, end, 2.0 * COARSE, *polynomials)
    if torque.max() > limits.torque_share:
        return Failure(SwingFailure.TORQUE_LIMIT, joint=names[int(torque.argmax())], share=float(torque.max()))
    return None
