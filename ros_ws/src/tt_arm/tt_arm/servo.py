"""Joint velocity commands that keep the arm on its path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_core.params import check, param
from tt_core.states import Array

from .swing import Swing
from .trajectory.profiles import evaluate


@dataclass(frozen=True, slots=True)
class ServoParams:
    """Feed-forward and feedback of the servo."""

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
    """Return the command (rad/s) for one joint: the path's speed ahead plus gain times the position error, within the speed limit.

    Args:
        q_path: rad, where the path has the joint now.
        qdot_ahead: rad/s of the path, when the command takes effect.
        q: rad, as measured.
        gain: 1/s.
        speed: rad/s, limit both ways.
    """
    return min(speed, max(-speed, qdot_ahead + gain * (q_path - q)))


@njit(cache=True)
def servo_command(since: float, lead: float, gain: float, knots: Array, coefficients: Array, q: Array, speed: Array, out: Array) -> None:
    """Fill the command of all joints.

    Args:
        since: s, time since the start of the path.
        lead: s, by which the path is read ahead.
        gain: 1/s.
        knots: (joints, n) of the path, see `profiles`.
        coefficients: (joints, n, 6) of the path.
        q: (n,) rad, as measured.
        speed: (n,) rad/s, limits both ways.
        out: (n,) rad/s; filled.
    """
    n = len(q)
    q_path, qdot_ahead, unused, unused_too = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    evaluate(since + lead, knots, coefficients, unused, qdot_ahead, unused_too)
    evaluate(since, knots, coefficients, q_path, unused, unused_too)
    for i in range(n):
        out[i] = servo_speed(q_path[i], qdot_ahead[i], q[i], gain, speed[i])


def follow(swing: Swing, time: float, q: Array, speed_limits: Array, params: ServoParams) -> Array:
    """Compute the command that follows a swing.

    Args:
        swing: The path.
        time: s.
        q: (n,) rad, as measured at `time`.
        speed_limits: (n,) rad/s, both ways.
        params: Of the servo.

    Returns:
        (n,) rad/s.
    """
    command, since = np.empty(len(q)), time - swing.start.time
    servo_command(since, params.lead, params.gain, swing.knots, swing.coefficients, q, speed_limits, command)
    return command
