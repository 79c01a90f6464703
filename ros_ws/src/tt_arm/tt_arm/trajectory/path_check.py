"""Last check of a planned path: position, speed, acceleration, jerk, clearance and torque, on the path and while braking from it."""

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
from .profiles import evaluate_path
from .torque import torque_shares

LIMIT_STEP = 1e-3  # s between two checks of the limits
CLEARANCE_STEP = 10e-3  # s, least time between two checks of the clearance: at 3 m/s the racket moves 30 mm
LIMIT_TOLERANCE = 2e-3  # relative excess of a limit that is tolerated, for rounding


class Extremes(NamedTuple):
    """Extreme values of each joint on a path, arrays (n,).

    Attributes:
        low: rad, lowest position.
        high: rad, highest position.
        speed: rad/s, largest absolute speed.
        acceleration: rad/s^2, largest absolute acceleration.
        jerk: rad/s^3, largest absolute jerk; a step of the acceleration gives a high jerk.
        held_low: rad, lowest position that a joint would reach if its drive held a command anywhere on the path and then braked.
        held_high: rad, highest such position.
    """

    low: Array
    high: Array
    speed: Array
    acceleration: Array
    jerk: Array
    held_low: Array
    held_high: Array


@njit(cache=True, nogil=True)
def extremes(end: float, braking: Array, hold: float, knots: Array, coefficients: Array) -> Extremes:
    """Find the extreme values of each joint on a path, which is sampled every LIMIT_STEP seconds.

    Args:
        end: s, time from the start of the path up to which it is sampled.
        braking: (n,) rad/s^2, deceleration with which each joint brakes.
        hold: s, time for which a drive may hold a command.
        knots: (joints, n) s, starts of the polynomials of the path, see `profiles`.
        coefficients: (joints, n, 6) polynomials of the path.
    """
    n = len(braking)
    low, high, speed, acceleration, jerk = np.full(n, np.inf), np.full(n, -np.inf), np.zeros(n), np.zeros(n), np.zeros(n)
    held_low, held_high = np.full(n, np.inf), np.full(n, -np.inf)
    q, qdot, qddot, before = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for k in range(int(end / LIMIT_STEP) + 2):
        evaluate_path(min(end, k * LIMIT_STEP), knots, coefficients, q, qdot, qddot)
        for i in range(n):
            low[i], high[i] = min(low[i], q[i]), max(high[i], q[i])
            stop = q[i] + hold * qdot[i] + 0.5 * qdot[i] * abs(qdot[i]) / braking[i]
            held_low[i], held_high[i] = min(held_low[i], stop), max(held_high[i], stop)
            speed[i], acceleration[i] = max(speed[i], abs(qdot[i])), max(acceleration[i], abs(qddot[i]))
            if k > 0:
                jerk[i] = max(jerk[i], abs(qddot[i] - before[i]) / LIMIT_STEP)
            before[i] = qddot[i]
    return Extremes(low, high, speed, acceleration, jerk, held_low, held_high)


def path_failure(path: Path, model: ArmModel, limits: SwingLimits) -> Failure | None:
    """Return a failure with the first limit that a path does not keep; None if it keeps all limits.

    Args:
        path: The path to check.
        model: The arm.
        limits: Limits that swings must keep.
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
        if share.max() > 1.0 + LIMIT_TOLERANCE:
            return Failure(code, joint=names[int(share.argmax())], share=float(share.max()))
    left, what = path_clearance(end, CLEARANCE_STEP, braking, hold, limits.clearance, *polynomials, model.bodies)
    if left < limits.clearance:
        return Failure(SwingFailure.CLEARANCE, distance=max(0.0, left), obstacle=OBSTACLES[what])
    torque = torque_shares(model, end, 2.0 * CLEARANCE_STEP, *polynomials)
    if torque.max() > limits.torque_share:
        return Failure(SwingFailure.TORQUE_LIMIT, joint=names[int(torque.argmax())], share=float(torque.max()))
    return None
