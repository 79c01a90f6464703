"""The servo: joint velocity commands that keep the arm on the path of its swing (planned joint motion)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_core.params import check, param
from tt_core.states import Array

from .swing import Swing
from .trajectory.profiles import evaluate_path


@dataclass(frozen=True, slots=True)
class ServoParams:
    """Parameters of the servo: gain of the feedback, and time by which the feed-forward looks ahead."""

    gain: float = param(
        15.0, "1/s", "gain of the position error; well below 1 / (4 lead), where the loop begins to oscillate", low=0.0, high=1000.0
    )
    lead: float = param(
        0.006,
        "s",
        "time by which the path is read ahead: the lag of the arm (5 ms) and half of a tick of 2 ms, after which a command takes effect",
        low=0.0,
        high=0.1,
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


@njit(cache=True)
def servo_speed(q_path: float, qdot_ahead: float, q: float, gain: float, speed: float) -> float:
    """Return the velocity command (rad/s) for one joint: speed of the path plus gain times position error, within the speed limit.

    Args:
        q_path: rad, position of the joint on the path now.
        qdot_ahead: rad/s, speed of the joint on the path at the time when the command takes effect.
        q: rad, measured position.
        gain: 1/s, gain of the position error.
        speed: rad/s, speed limit for both directions.
    """
    return min(speed, max(-speed, qdot_ahead + gain * (q_path - q)))


@njit(cache=True)
def servo_command(since: float, lead: float, gain: float, knots: Array, coefficients: Array, q: Array, speed: Array, out: Array) -> None:
    """Compute the velocity commands of all joints.

    Args:
        since: s, time since the start of the path.
        lead: s, time after which a command takes effect, by which the speed of the path is read ahead.
        gain: 1/s, gain of the position error.
        knots: (joints, n) s, starts of the polynomials of the path, see `profiles`.
        coefficients: (joints, n, 6) polynomials of the path.
        q: (n,) rad, measured positions.
        speed: (n,) rad/s, speed limits for both directions.
        out: (n,) rad/s, output: filled with the commands.
    """
    n = len(q)
    q_path, qdot_ahead, unused, unused_too = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    evaluate_path(since + lead, knots, coefficients, unused, qdot_ahead, unused_too)
    evaluate_path(since, knots, coefficients, q_path, unused, unused_too)
    for i in range(n):
        out[i] = servo_speed(q_path[i], qdot_ahead[i], q[i], gain, speed[i])


def follow(swing: Swing, time: float, q: Array, speed_limits: Array, params: ServoParams) -> Array:
    """Compute the joint velocity command that follows a swing.

    Args:
        swing: The planned joint motion.
        time: s, time of the measurement, on the clock of the swing.
        q: (n,) rad, joint positions measured at `time`.
        speed_limits: (n,) rad/s, for both directions.
        params: Gain and lead of the servo.

    Returns:
        (n,) rad/s, joint velocities within the limits.
    """
    command, since = np.empty(len(q)), time - swing.start.time
    servo_command(since, params.lead, params.gain, swing.knots, swing.coefficients, q, speed_limits, command)
    return command
