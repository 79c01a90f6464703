"""Shortest legs with a jerk limit, from any speed and acceleration, computed by the library ruckig.

A leg is a motion in which all joints begin and end together.
"""

from __future__ import annotations

from ruckig import InputParameter, Result, Ruckig, Trajectory

from ..joints import JointBounds
from .legs import Leg, Pieces

SAME_DURATION = 1e-6  # s by which a leg may last longer than asked


def shortest_leg(leg: Leg, limits: JointBounds, time: float = 0.0) -> Trajectory | None:
    """Compute the shortest leg (motion in which all joints begin and end together) that keeps the limits, with the library ruckig.

    Args:
        leg: States of the joints at start and end.
        limits: (n,) limits of the joints.
        time: s, least duration of the leg; 0 for the shortest possible one.

    Returns:
        The leg as a trajectory of ruckig; None if ruckig finds none.
    """
    n = len(leg)
    given, found = InputParameter(n), Trajectory(n)
    given.current_position, given.current_velocity, given.current_acceleration = leg["q0"].tolist(), leg["v0"].tolist(), leg["a0"].tolist()
    given.target_position, given.target_velocity, given.target_acceleration = leg["q1"].tolist(), leg["v1"].tolist(), [0.0] * n
    given.max_velocity, given.max_acceleration = limits["speed"].tolist(), limits["acceleration"].tolist()
    given.max_jerk = limits["jerk"].tolist()
    if time > 0.0:
        given.minimum_duration = time
    done = Ruckig(n).calculate(given, found)
    return found if done in (Result.Working, Result.Finished) else None


def append(leg: Trajectory, begin: float, path: Pieces) -> None:
    """Append the cubic polynomials of a leg (motion in which all joints begin and end together) to a path.

    Args:
        leg: Trajectory of ruckig.
        begin: s from the start of the path, time at which the leg begins.
        path: Polynomials of the path, changed in place.
    """
    for i, profile in enumerate(leg.profiles[0]):
        since = begin
        for part in (profile.brake, profile):
            for t, j, a, v, p in zip(part.t, part.j, part.a, part.v, part.p, strict=False):
                if t > 0.0:
                    n = path.counts[i]
                    path.knots[i, n] = since
                    path.coefficients[i, n, :4] = p, v, 0.5 * a, j / 6.0
                    path.counts[i] += 1
                    since += t
