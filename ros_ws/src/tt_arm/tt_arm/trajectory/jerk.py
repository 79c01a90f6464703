"""Legs that are the shortest with a jerk limit, from any state of speed and acceleration, by ruckig."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from ruckig import InputParameter, Result, Ruckig, Trajectory
from tt_core.states import Array

SAME = 1e-6  # s, that a leg may last longer than asked


def least_jerky(
    q0: Array, v0: Array, a0: Array, q1: Array, v1: Array, speed: Array, acceleration: float, jerk: float, time: float = 0.0
) -> Trajectory | None:
    """The shortest leg of all joints that lasts at least `time` (s) and ends without acceleration; None when there is none.

    q, v, a: (7,) rad, rad/s, rad/s^2. speed: (7,) rad/s. acceleration: rad/s^2. jerk: rad/s^3.
    """
    given, found = InputParameter(7), Trajectory(7)
    given.current_position, given.current_velocity, given.current_acceleration = q0.tolist(), v0.tolist(), a0.tolist()
    given.target_position, given.target_velocity, given.target_acceleration = q1.tolist(), v1.tolist(), [0.0] * 7
    given.max_velocity, given.max_acceleration, given.max_jerk = speed.tolist(), [acceleration] * 7, [jerk] * 7
    if time > 0.0:
        given.minimum_duration = time
    done = Ruckig(7).calculate(given, found)
    return found if done in (Result.Working, Result.Finished) else None


def append(leg: Trajectory, begin: float, knots: Array, coefficients: Array, pieces: npt.NDArray[np.int64]) -> None:
    """The leg's cubic pieces after those that are there; see `motion` for knots (7, n) and coefficients (7, n, 6)."""
    for i, profile in enumerate(leg.profiles[0]):
        since = begin
        for part in (profile.brake, profile):
            for t, j, a, v, p in zip(part.t, part.j, part.a, part.v, part.p, strict=False):
                if t > 0.0:
                    knots[i, pieces[i]] = since
                    coefficients[i, pieces[i], :4] = p, v, 0.5 * a, j / 6.0
                    pieces[i] += 1
                    since += t
